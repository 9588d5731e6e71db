"""Drift monitor: a CUSUM over the touches of production, each held against the prediction of the calibration.

With the state x of `linear` and the calibration's knowledge δ ~ N(0, C₀) before touch 1, the knowledge after touch τ is
N(m_τ, C_τ). A change d after touch τ is tested by what the touches τ+1 … t add: the likelihood ratio statistic T of
`linear.Evidence`. This is a CUSUM whose increments are the innovations of a Kalman filter and whose start τ and size d
are those that maximise it (generalised likelihood ratio):

    G_t = max over τ in the window, max over hypotheses h, of T_h(τ, t) - penalty (dim h - 1).

G_t beyond `THRESHOLD` raises the alarm, and the hypothesis with the largest penalised statistic is named, with those
that explain the touches about as well.

Two more things are seen. What creeps slower than the window was absorbed into m_t: `departure`, the chi-square of m_t
against C₀ - C_t, compares all touches of production with the calibration. And one bad touch is no drift: in the CUSUM
the residual of a touch counts with at most `LARGEST_RESIDUAL`, and fewer than `FEWEST` touches raise no alarm.

Sources: Page, Biometrika 41 (1954) 100 (CUSUM); Willsky and Jones (1976); Lorden, Ann. Math. Statist. 42 (1971) 1897;
Basseville and Nikiforov, Detection of Abrupt Changes (1993), section 7.2.4; Huber (1964), on bounded residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.monitoring.hypotheses import Explanation, Hypothesis, explanations, hypotheses_of, rivals
from scara_kinetostatic.monitoring.linear import Evidence, Information, Measured, State, measure
from scara_kinetostatic.monitoring.record import CalibrationRecord

THRESHOLD = 20.0
"""Of G: false alarms at most one in 1000 touches. Source: `benchmark/drift.py`."""
WINDOW = 40
"""A change is sought among the last so many touches."""
LARGEST_RESIDUAL = 4.0
"""Length of the whitened residual of a touch, less what was expected, beyond which it is shortened to this."""
FEWEST = 2
"""So many touches after a change are needed for an alarm: one alone may be a bad touch."""
DEPARTURE = 1e-5
"""p-value of the departure from the calibration below which the alarm is raised: it is examined at every touch."""


class Alarm(NamedTuple):
    """The calibration no longer holds.

    Attributes:
        touch: number of the touch that raised it, counted by the monitor from 0.
        since: number of the first touch after the change, as estimated; 0 where the calibration itself is contradicted.
        statistic: G, or the chi-square of the departure.
        best: the most likely change.
        rivals: names of what explains the touches about as well.
        kind: ``change``, or ``departure`` where it came slower than the window.
    """

    touch: int
    since: int
    statistic: float
    best: Explanation
    rivals: tuple[str, ...]
    kind: str


class _Start(NamedTuple):
    """Knowledge of the state after some touch.

    Attributes:
        touch: how many touches came before.
        mean: m, (p,).
        covariance: C, (p, p).
        matrix: sum of JᵀJ of the touches since, (p, p).
        score: sum of Jᵀr of the touches since, (p,).
    """

    touch: int
    mean: Floats
    covariance: Floats
    matrix: Floats
    score: Floats


class DriftMonitor:
    """Holds touch after touch against a calibration.

    Args:
        record: the calibration.
        cell: in which the touches are made; by default its own.
        threshold: of G.

    Example:
        >>> import scara_kinetostatic as sk
        >>> from scara_kinetostatic.monitoring.drift import DriftMonitor
        >>> from scara_kinetostatic.monitoring.record import CalibrationRecord
        >>> cell = sk.load_cell('cell.yaml')
        >>> monitor = DriftMonitor(CalibrationRecord.of_outcome(sk.diagnose('touches.csv', cell)))
        >>> for touch in sk.read_touches('touches.csv', cell):
        ...     _ = monitor.add(touch)
        >>> monitor.alarm is None
        True
    """

    def __init__(self, record: CalibrationRecord, cell: Cell | None = None, threshold: float = THRESHOLD) -> None:
        self.record = record
        self.state = State.of(record, cell)
        self.threshold = threshold
        self.count = 0
        self.statistic = 0.0
        self.alarm: Alarm | None = None
        self.last_distance = 0.0
        self._values = len(record.arm.model.names)
        self._objects: set[int] = set()
        self._mean = np.zeros(len(self.state.names))
        self._covariance = self.state.covariance
        self._starts: list[_Start] = []

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """What may have changed: of objects those that have been touched."""
        return hypotheses_of(self.state, self._values, sorted(self._objects))

    def add(self, touches: TouchSet) -> Alarm | None:
        """Hold touches against the calibration, in the order of time.

        Returns:
            The alarm, if one is raised or stands.
        """
        measured = measure(touches, self.record, self.state)
        for k in range(len(touches)):
            self.add_measured(measured.select(slice(k, k + 1)), int(touches.disc[k]))
        return self.alarm

    def add_measured(self, touch: Measured, disc: int) -> Alarm | None:
        """The same for one touch that has been linearised."""
        self._objects.add(disc)
        jacobian, residual = touch.jacobian[0], touch.residual[0]
        expected = jacobian @ self._mean
        spread = np.eye(2) + jacobian @ self._covariance @ jacobian.T
        innovation = residual - expected
        root = np.linalg.cholesky(spread)
        length = float(np.linalg.norm(np.linalg.solve(root, innovation)))
        self.last_distance = length
        bounded = expected + innovation * min(1.0, LARGEST_RESIDUAL / max(length, 1e-12))
        self._starts.append(
            _Start(self.count, self._mean, self._covariance, np.zeros_like(self._covariance), np.zeros_like(self._mean))
        )
        added, score = jacobian.T @ jacobian, jacobian.T @ bounded
        self._starts = [
            start._replace(matrix=start.matrix + added, score=start.score + score) for start in self._starts[-WINDOW:]
        ]
        gain = np.linalg.solve(spread, jacobian @ self._covariance).T
        self._mean = self._mean + gain @ (bounded - expected)
        covariance = self._covariance - gain @ spread @ gain.T
        self._covariance = (covariance + covariance.T) / 2
        self.count += 1
        return self._evaluate()

    def _evaluate(self) -> Alarm | None:
        among, best = self.hypotheses, None
        self.statistic = 0.0
        for start in self._starts:
            if self.count - start.touch < FEWEST:
                continue
            evidence = Evidence.of(Information(start.matrix, start.score), start.covariance, start.mean)
            statistic = _largest(evidence, among)
            if statistic > self.statistic:
                self.statistic, best = statistic, (start, evidence)
        if best is not None and self.statistic > self.threshold:
            self.alarm = self._alarm(best[0].touch, best[1], self.statistic, 'change')
        return self.alarm

    def _alarm(self, since: int, evidence: Evidence, statistic: float, kind: str) -> Alarm:
        ranking = explanations(evidence, self.state, self.hypotheses)
        first = self.count - 1 if self.alarm is None else self.alarm.touch
        return Alarm(first, since, statistic, ranking[0], tuple(rivals(ranking, evidence)), kind)


def _largest(evidence: Evidence, among: Sequence[Hypothesis]) -> float:
    """The largest statistic of single values; parts add to it only what further values must pay."""
    diagonal = np.diag(evidence.matrix)
    single = sorted({place for h in among for place in h.places})
    d = diagonal[single]
    with np.errstate(divide='ignore', invalid='ignore'):
        ratios = np.where(d > 1e-9 * diagonal.max(initial=0.0), evidence.score[single] ** 2 / d, 0.0)
    return float(ratios.max(initial=0.0))


def departure_p_value(statistic: float, freedoms: int) -> float:
    """p-value of a chi-square."""
    return float(chdtrc(freedoms, statistic)) if freedoms else 1.0

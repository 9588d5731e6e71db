"""Drift monitor: a CUSUM over the touches of production, each held against the prediction of the calibration. How
calibrations follow each other is `history`.

With the state x of `change` and the calibration's knowledge δ ~ N(0, C₀) before touch 1, the knowledge after touch τ is
N(m_τ, C_τ). A change d after touch τ is tested by what the touches τ+1 … t add: the likelihood ratio statistic T of
`Information`. This is a CUSUM whose increments are the innovations of a Kalman filter and whose start τ and size d are
those that maximise it (generalised likelihood ratio):

    G_t = max over τ, max over the values x_j, of T_j(τ, t).

G_t beyond `THRESHOLD` raises the alarm. The hypothesis with the largest penalised statistic is named, with those that
explain the touches about as well; both are worked out anew at every touch that follows, as a name needs more touches
than an alarm.

τ is among the last `WINDOW` touches, or 0: what creeps slower than the window is absorbed by m_τ, but not by the
calibration itself. The sums of the start 0 fade over `MEMORY` touches, so that a difference far below the noise is not
raised for the sole reason that there are many touches. And one bad touch is no drift: the residual of a touch counts
with at most `LARGEST_RESIDUAL`, and fewer than `FEWEST` touches raise no alarm.

Sources: Page, Biometrika 41 (1954) 100 (CUSUM); Willsky and Jones (1976); Lorden, Ann. Math. Statist. 42 (1971) 1897;
Basseville and Nikiforov, Detection of Abrupt Changes (1993), section 7.2.4; Huber (1964), on bounded residuals.
"""

from __future__ import annotations

from copy import copy
from pathlib import PurePath
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.gaussian.information import Gaussian, Information
from scara_kinetostatic.gaussian.p_values import as_rare
from scara_kinetostatic.model.touch import LATER, TouchSet
from scara_kinetostatic.monitoring.change import (
    LINEAR,
    CalibratedState,
    Hypothesis,
    Measured,
    change_title,
    hypotheses_of,
    measure,
    ranked,
    rivals,
)
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.report.page import Document

THRESHOLD = 20.0
"""Of G where the noise is known: false alarms at most one in 1000 touches. Where it was estimated, the value that F
exceeds as rarely. Source: `benchmark/drift.py`.
"""
WINDOW = 40
"""A change is sought among the last so many touches."""
LARGEST_RESIDUAL = 3.0
"""Length of the whitened residual of a touch, less what was expected, beyond which it is shortened to this.

A bad touch adds at most 9 to G. Source: `benchmark/drift.py`, false alarms with bad touches: with 4, one bad touch in
six raised an alarm together with the chance of its neighbours.
"""
FEWEST = 2
"""So many touches after a change are needed for an alarm: one alone may be a bad touch."""
MOST_REMAINING = 9.2
"""A change that leaves the median touch a larger chi-square, its 99 % quantile, does not explain the touches; a bad
touch hardly moves the median.
"""
BAD = 25.0
"""A touch to which a change leaves so large a chi-square, and so many times the median, has no part in its name."""
MEMORY = 500
"""Touches over which the comparison with the calibration itself fades; so many are kept."""


class Alarm(NamedTuple):
    """The calibration no longer holds.

    Attributes:
        touch: number of the touch that raised it, counted by the monitor from 0.
        since: number of the first touch after the change, as estimated; 0 where the calibration itself is contradicted.
        statistic: G.
        best: the most likely change.
        rivals: names of what explains the touches about as well.
        is_explained: whether the change explains most touches since; if not, no single part does.
    """

    touch: int
    since: int
    statistic: float
    best: Hypothesis
    rivals: tuple[str, ...]
    is_explained: bool


class _Start(NamedTuple):
    """Knowledge of the state after some touch, and what the touches since say.

    Attributes:
        touch: how many touches came before.
        known: m and C.
        since: of the touches since, their residuals bounded.
    """

    touch: int
    known: Gaussian
    since: Information


class DriftMonitor:
    """Holds touch after touch against a calibration.

    Args:
        record: the calibration.

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

    def __init__(self, record: CalibrationRecord) -> None:
        self.record = record
        self.state = CalibratedState.of(record)
        self.threshold = as_rare(THRESHOLD, 1, record.noise_freedoms)
        self.reset()

    def reset(self) -> None:
        """Begin anew, as after a repair or where an alarm was a mistake."""
        size = len(self.state.names)
        self.count = 0
        self.statistic = 0.0
        self.last_distance = 0.0
        self.alarm: Alarm | None = None
        self._raised: int | None = None
        self._objects: frozenset[int] = frozenset()
        self.hypotheses = hypotheses_of(self.state, ())  # of objects those that have been touched
        nothing = Information(np.zeros((size, size)), np.zeros(size))
        self._known = self.state.known
        self._from_calibration = _Start(0, self.state.known, nothing)
        self._starts: list[_Start] = []
        self._latest: tuple[Measured, ...] = ()

    def copy(self) -> DriftMonitor:
        """The monitor as it is now, such as before a touch that may be taken back."""
        return copy(self)

    def measure(self, touches: TouchSet) -> Measured:
        """Touches as linear measurements; they come after all touches of the calibration.

        Raises:
            InputError: one is so far from the model that nothing can be said.
        """
        return measure(touches.replace(order=np.full(len(touches), LATER)), self.record, self.state)

    def add(self, touches: TouchSet) -> Alarm | None:
        """Hold touches against the calibration, in the order of time.

        Returns:
            The alarm, if one is raised or stands.
        """
        measured = self.measure(touches)
        for k in range(len(touches)):
            self.add_measured(measured.select(slice(k, k + 1)), int(touches.disc[k]))
        return self.alarm

    def add_measured(self, touch: Measured, disc: int, *, named: bool = True) -> Alarm | None:
        """The same for one linearised touch; `named`: whether the name of an alarm is worked out, which takes time."""
        if disc not in self._objects:
            self._objects |= {disc}
            self.hypotheses = hypotheses_of(self.state, sorted(self._objects))
        self.last_distance = float(np.sqrt(touch.chi_squares(self._known)[0]))
        jacobian = touch.jacobian[0]
        expected = jacobian @ self._known.mean
        bounded = (touch.residual[0] - expected) * LARGEST_RESIDUAL / max(self.last_distance, LARGEST_RESIDUAL)
        self._latest = (*self._latest[1 - MEMORY :], touch)
        found, kept = touch._replace(residual=(expected + bounded)[None]).information(), self._from_calibration
        earlier = [start._replace(since=start.since.plus(found)) for start in self._starts[1 - WINDOW :]]
        self._starts = [*earlier, _Start(self.count, self._known, found)]
        self._from_calibration = kept._replace(since=kept.since.plus(found, 1 - 1 / MEMORY))
        self._known = self._known.conditioned(jacobian, bounded)
        self.count += 1
        return self._evaluate(named)

    def _evaluate(self, named: bool) -> Alarm | None:
        best, self.statistic = None, 0.0
        # parts add to the largest statistic of single values only what further values must pay
        single = sorted({place for h in self.hypotheses for place in h.places})
        for start in (self._from_calibration, *self._starts):
            if self.count - start.touch < FEWEST:
                continue
            statistic = start.known.change(start.since).largest_single(single)
            if statistic > self.statistic:
                self.statistic, best = statistic, start
        if best is not None and self.statistic > self.threshold:
            self._raised = self.count - 1 if self._raised is None else self._raised
            self.alarm = self._alarm(best, self._raised) if named else self.alarm
        return self.alarm

    def _alarm(self, start: _Start, raised: int) -> Alarm:
        """The change that explains the touches since a start, without those that none of the others agrees with."""
        latest = Measured(*map(np.concatenate, zip(*self._latest[start.touch - self.count :], strict=True)))
        fading = 1 - 1 / MEMORY if start is self._from_calibration else 1.0
        weight = np.asarray(fading ** np.arange(len(latest.residual))[::-1], dtype=np.float64)
        fewest = 0.8 * len(weight)
        while True:
            evidence = start.known.change(latest.information(weight))
            ranking = ranked(self.hypotheses, evidence, self.state)
            mean, places = start.known.mean.copy(), list(ranking[0].places)
            mean[places] += np.array(ranking[0].change) / self.state.scale[places]
            left = np.where(weight > 0, latest.chi_squares(start.known._replace(mean=mean)), 0.0)
            usual = float(np.median(left[weight > 0]))
            bad = np.argsort(-left)[: int((weight > 0).sum() - fewest)]
            bad = bad[left[bad] > max(BAD, BAD * usual)]
            if not len(bad):
                break
            weight[bad] = 0.0
        before = float(np.median(latest.chi_squares(start.known)[weight > 0]))
        explained = usual < max(MOST_REMAINING, LINEAR * before)
        return Alarm(raised, start.touch, self.statistic, ranking[0], rivals(ranking), explained)


class SinceTouch(NamedTuple):
    """The first touch after a change, as estimated.

    Attributes:
        recording: in which it is.
        number: in the recording.
    """

    recording: str
    number: str


def alarm_line(alarm: Alarm, since: SinceTouch | None) -> str:
    """An alarm in one line.

    Args:
        alarm: the alarm.
        since: its first touch, where it is known.
    """
    when = f'after {alarm.since} touches' if alarm.since else 'from the first touch on'
    if since is not None and alarm.since:
        when = f'since touch {since.number} of {PurePath(since.recording).name}'
    what = f'{alarm.best.title} ({alarm.best.text})'
    if not alarm.is_explained:
        what = f'no single part explains it, the largest is: {what}'
    elif alarm.rivals:
        what += f'; or {"; ".join(map(change_title, alarm.rivals[:3]))}'
    return f'the calibration no longer holds, {when}: {what}'


def drift_document(monitor: DriftMonitor, assumptions: str, alarm: Alarm | None, since: SinceTouch | None) -> Document:
    """The state of a monitor; `alarm` is the one that stands, `since` its first touch; SI units."""
    said = None
    if alarm is not None:
        said = {
            'touch': alarm.touch,
            'since': alarm.since,
            'since_touch': since,
            'statistic': alarm.statistic,
            'changed': alarm.best.name,
            **{key: getattr(alarm.best, key) for key in ('change', 'std', 'values', 'units')},
            'rivals': alarm.rivals,
            'explained': alarm.is_explained,
            'message': alarm_line(alarm, since),
        }
    return {
        'schema': 'scara_kinetostatic/drift/1',
        'calibration': monitor.record.source,
        'created': monitor.record.created,
        'touches': monitor.count,
        'statistic': monitor.statistic,
        'threshold': monitor.threshold,
        'assumptions': assumptions,
        'alarm': said,
    }

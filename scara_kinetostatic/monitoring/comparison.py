r"""What changed between two calibrations of one robot, in its uncertainty.

Both estimates are moved by the same errors of the cell description: the discs stand where they stood. With G the change
of an estimate by an error of one standard uncertainty, its column of the joint covariance, the difference has the
covariance

    S = N_A + N_B + Σ_common (G_A - G_B)(G_A - G_B)ᵀ + Σ_others G Gᵀ,

N what noise and the choice among credible models contribute. Two calibrations by the same plan have nearly the same G,
and declared errors cancel. Sources are common where both cells describe the same thing alike: an object of the same
name, place, radius and uncertainty, the same sensor, the same trusted nominal value.

Where one calibration found an effect that the other lacks, the other is extended by it, by its own touches
(`extension`): a disc that moved since is then a difference of its place, instead of one that only one model knows.

Directions that either calibration does not determine are left out: only combinations of values that both determine are
compared. The global test is Δᵀ S⁺ Δ ~ χ²; where the noise was estimated, the F distribution takes its place. Which part
moved says the likelihood ratio of each hypothesis (`hypotheses`). An object that moved shows by what its move does to
the second estimate, C Jᵀ J_e.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.monitoring.assumptions import of_stored_touches
from scara_kinetostatic.monitoring.difference import Difference, ParameterChange
from scara_kinetostatic.monitoring.extension import alone, is_comparable, with_common_effects
from scara_kinetostatic.monitoring.fit import Fit
from scara_kinetostatic.monitoring.hypotheses import Explanation, explanations, hypotheses_of, rivals
from scara_kinetostatic.monitoring.linear import Evidence, State
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.monitoring.same_robot import check_same_robot
from scara_kinetostatic.monitoring.significance import p_values

LEVEL = 0.01
"""p-value below which two calibrations differ. Source: the accepted rate of false alarms of the diagnosis."""
_RANK = 1e-10
"""Variance of a combination, in the largest of all, below which both calibrations hold it fixed."""


class Change(NamedTuple):
    """What changed from one calibration to the next.

    Attributes:
        before: the first calibration.
        after: the second.
        parameters: every value that both have.
        chi_square: of the difference of all determined combinations.
        degrees_of_freedom: their number.
        p_value: of no change at all.
        ranking: hypotheses of what changed, the best first.
        rivals: names of those that explain the difference about as well as the first.
        remaining_p_value: of nothing else having changed than the first hypothesis says.
        tip: root mean square displacement of the predicted tip at the touches of the second calibration, m.
        largest_tip: the largest there, m.
        only_before: labels of effects that the first has alone.
        only_after: labels of effects that the second has alone.
        not_compared: those of both that cannot be compared.
        notes: what limits the comparison, one sentence each.
    """

    before: CalibrationRecord
    after: CalibrationRecord
    parameters: tuple[ParameterChange, ...]
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    ranking: tuple[Explanation, ...]
    rivals: tuple[str, ...]
    remaining_p_value: float
    tip: float
    largest_tip: float
    only_before: tuple[str, ...]
    only_after: tuple[str, ...]
    not_compared: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def has_changed(self) -> bool:
        """Whether the calibrations differ."""
        return self.p_value < LEVEL


def compare_records(records: Sequence[CalibrationRecord]) -> list[Change]:
    """The changes between consecutive calibrations.

    Raises:
        InputError: fewer than two, or calibrations of different robots or cells.
    """
    if len(records) < 2:
        raise InputError('calibrations', f'expected two or more to compare, got {len(records)}')
    for record in records[1:]:
        check_same_robot(records[0], record)
    return [compare(before, after) for before, after in pairwise(records)]


def compare(before: CalibrationRecord, after: CalibrationRecord) -> Change:
    """What changed from one calibration to the next; `check_same_robot` has found nothing."""
    one, other = with_common_effects(before, after)
    names = _common_names(one, other)
    difference = Difference.of(one, other, names)
    root, held = _whitening(difference)
    whitened = root @ difference.change
    chi_square, freedoms = float(whitened @ whitened), len(whitened)
    evidence, state = _evidence(root, difference.change, names, other)
    among = [h for h in hypotheses_of(state, len(other.arm.model.names)) if _is_comparable(h.places, names, other)]
    ranking = explanations(evidence, state, among)
    noise, left = _noise_freedoms(before, after), max(chi_square - ranking[0].statistic, 0.0)
    remaining = p_values(left, max(freedoms - len(ranking[0].change), 0), noise)
    tip = _tip_change(before, after)
    return Change(
        before=before,
        after=after,
        parameters=difference.parameters,
        chi_square=chi_square,
        degrees_of_freedom=freedoms,
        p_value=float(p_values(chi_square, freedoms, noise)),
        ranking=tuple(ranking),
        rivals=tuple(rivals(ranking, evidence)),
        remaining_p_value=float(remaining),
        tip=rms(tip),
        largest_tip=float(tip.max(initial=0.0)),
        only_before=tuple(effect.label for effect in alone(before, after)),
        only_after=tuple(effect.label for effect in alone(after, before)),
        not_compared=_not_compared(before, after),
        notes=tuple(_notes(before, after, held, difference.parameters, freedoms)),
    )


def _whitening(difference: Difference) -> tuple[Floats, bool]:
    """Rows that whiten the determined combinations, (r, p); whether what both hold fixed differs."""
    kept = difference.combinations
    values, vectors = np.linalg.eigh(kept @ difference.covariance @ kept.T)
    large = values > _RANK * max(float(values.max(initial=0.0)), 1e-30)
    held = np.abs(vectors[:, ~large].T @ (kept @ difference.change)).max(initial=0.0) > 1e-9
    return (vectors[:, large] / np.sqrt(values[large])).T @ kept, bool(held)


def _common_names(one: CalibrationRecord, other: CalibrationRecord) -> tuple[str, ...]:
    """Names of the values that two calibrations have, and that mean the same in both."""
    cells = one.arm.cell, other.arm.cell
    without = {e.label for e in other.arm.model.effects if not is_comparable(e, *cells)}
    names = [name for name in one.arm.model.names if name in other.arm.model.names]
    return tuple(name for name in names if name in NAMES or name.rpartition('.')[0] not in without)


def _not_compared(before: CalibrationRecord, after: CalibrationRecord) -> tuple[str, ...]:
    """Labels of effects that mean nothing in the other's touches."""
    cells = before.arm.cell, after.arm.cell
    effects = (*before.arm.model.effects, *after.arm.model.effects)
    return tuple(dict.fromkeys(effect.label for effect in effects if not is_comparable(effect, *cells)))


def _evidence(root: Floats, change: Floats, names: Sequence[str], after: CalibrationRecord) -> tuple[Evidence, State]:
    """Evidence for changes of values and of the cell, in the state of the second calibration."""
    fit = Fit.of(after)
    state, values = fit.state, len(after.arm.model.names)
    where = [state.place(name) for name in names]
    response = np.zeros((len(names), len(state.names)))
    response[np.arange(len(names)), where] = 1.0
    response[:, values:] = fit.by_errors[where][:, values:]
    rows = root @ response
    return Evidence(rows.T @ (root @ change), rows.T @ rows), state


def _is_comparable(places: Sequence[int], names: Sequence[str], after: CalibrationRecord) -> bool:
    """Whether a hypothesis is about values that both calibrations have, or about the cell."""
    own = after.arm.model.names
    return all(place >= len(own) or own[place] in names for place in places)


def _noise_freedoms(before: CalibrationRecord, after: CalibrationRecord) -> float:
    """Degrees of freedom of the noise levels: infinite where both were given."""
    finite = [r.noise_freedoms for r in (before, after) if np.isfinite(r.noise_freedoms)]
    return sum(finite) if finite else np.inf


def _tip_change(before: CalibrationRecord, after: CalibrationRecord) -> Floats:
    """Displacement of the predicted tip at the touches of the second calibration, (n,), m."""
    touches = after.touches
    metadata = TouchMetadata.of(touches, after.arm.cell.sensor.frame)
    tips = [Predictor(record.arm).locate(touches.joints, after.forces, metadata).position for record in (before, after)]
    return np.asarray(np.linalg.norm(tips[1] - tips[0], axis=1))


def _notes(
    before: CalibrationRecord,
    after: CalibrationRecord,
    held: bool,
    parameters: Sequence[ParameterChange],
    freedoms: int,
) -> list[str]:
    notes = []
    if not freedoms:
        notes.append('there is nothing that both calibrations determine: nothing is compared')
    elif single := [p.name for p in parameters if np.isnan(p.std)]:
        notes.append(f'{", ".join(single)}: not determined each by itself; compared only in combination, if at all')
    if before.checksums & after.checksums:
        notes.append(
            'both calibrations contain the same recording: they are not independent, and the p-value is not valid'
        )
    if before.fixed != after.fixed or held:
        notes.append('the calibrations hold other parameters fixed: a wrong fixed value looks like a change')
    cells = before.arm.cell, after.arm.cell
    if others := {e.label for e in (*alone(before, after), *alone(after, before)) if is_comparable(e, *cells)}:
        notes.append(
            f'{", ".join(sorted(others))}: also fitted to the touches of the one that lacks it, to first order'
        )
    if before.measured and after.measured and before.measured > after.measured:
        notes.append(f'{after.source} is older than {before.source}: they are compared in the order given')
    assumed = dict.fromkeys(text for record in (before, after) for text in of_stored_touches(record))
    unfit = [r.source for r in (before, after) if r.arm.grade == 'unfit']
    return [*notes, *assumed, *(f'{source} is unfit for use' for source in unfit)]

"""What changed between two calibrations of one robot, in its uncertainty.

Both estimates are moved by the same errors of the cell description: the discs stand where they stood. With G the change
of an estimate by an error of one standard uncertainty, its column of the joint covariance, the difference has the
covariance

    S = N_A + N_B + Σ_common (G_A - G_B)(G_A - G_B)ᵀ + Σ_others G Gᵀ,

N what noise and the choice among credible models contribute. Two calibrations by the same plan have nearly the same G,
and declared errors cancel. Sources are common where both cells describe the same thing alike: an object of the same
name, place, radius and uncertainty, the same sensor, the same trusted nominal value.

Where one calibration found an effect that the other lacks, the other is extended by it, by its own touches
(`extended`): a disc that moved since is then a difference of its place, instead of one that only one model knows.

Directions that either calibration does not determine are left out: only combinations of values that both determine are
compared. The global test is Δᵀ S⁺ Δ ~ χ²; where the noise was estimated, the F distribution takes its place. Which part
moved says the likelihood ratio of each hypothesis (`hypotheses`). An object that moved shows by what its move does to
the second estimate, C Jᵀ J_e.

**The fit again, linearised** (`Fit`). The joint covariance of a record also holds what the choice among credible models
contributes. The estimates themselves are those of one model, and follow their data by that model alone: x = Ĉ Jᵀ r,
with Ĉ = (JᵀJ + Λ)⁻¹ and Λ the prior information of declared errors and trusted nominal values.

**Further effects** (`extended`). With r and J the whitened residuals and the derivatives of `linear` at the calibrated
values, K those by the values θ of the further effects, and Ĉ the covariance of all that was free in the fit,

    θ = (Kᵀ W K)⁻¹ Kᵀ r,    W = I - J Ĉ Jᵀ,    cov θ = (Kᵀ W K)⁻¹,

and the values that the calibration has change by -M θ, M = Ĉ Jᵀ K, with the further covariance M cov θ Mᵀ. r contains
what the declared errors have been estimated at; at the optimum it is orthogonal to all of J but their prior.

K is taken at the values that the other calibration has found: the direction of a periodic effect, say, has no
derivative where its amplitude is zero. What the touches do not show of θ is undetermined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space
from scipy.special import erfc

from scara_kinetostatic.calibration.declared_errors import UNDETECTED
from scara_kinetostatic.calibration.result import UndetectedErrors
from scara_kinetostatic.errors import InputError
from scara_kinetostatic.files.calibration_file import effect_entry, read_effect
from scara_kinetostatic.model.arrays import Floats, Indices, rms
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import EffectLaw
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import UNITS
from scara_kinetostatic.monitoring.hypotheses import Causes, hypotheses_of
from scara_kinetostatic.monitoring.linear import Evidence, State, measure, p_values, same_sources, stated_uncertainties
from scara_kinetostatic.monitoring.record import CalibrationRecord, check_same_arm

LEVEL = 0.01
"""p-value below which two calibrations differ. Source: the accepted rate of false alarms of the diagnosis."""


class Fit(NamedTuple):
    """The linearised fit.

    Attributes:
        state: what may be off.
        jacobian: J of the touches of the calibration, in units of the scale of the state, (2n, p).
        knowledge: Ĉ in the same units, (p, p): zero for what was held, exactly known or not determined.
    """

    state: State
    jacobian: Floats
    knowledge: Floats

    @classmethod
    def of(cls, record: CalibrationRecord, held: Indices | None = None) -> Fit:
        """That of a calibration; `held` are places of values that count as held, besides those that were."""
        state = State.of(record).of_stored_forces()
        jacobian = measure(record.touches, record, state).jacobian.reshape(-1, len(state.names))
        prior = np.full(len(state.names), np.inf)  # Λ: infinite for errors that are not declared
        prior[: state.values] = 0.0
        for name, std in stated_uncertainties(record.arm.cell).items():
            place = state.stated_place(name)
            prior[place] = (state.scale[place] / std) ** 2 / record.enlargement
        prior[[record.place(name) for name in (*record.fixed, *record.arm.model.held)]] = np.inf
        prior[[] if held is None else held] = np.inf
        free = np.flatnonzero(np.isfinite(prior))
        rows = jacobian[:, free]
        values, vectors = np.linalg.eigh(rows.T @ rows + np.diag(prior[free]))
        kept = values > 1e-9 * float(values.max(initial=1e-12))  # else not determined
        knowledge = np.zeros((len(prior), len(prior)))
        knowledge[np.ix_(free, free)] = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
        return cls(state, jacobian, knowledge)

    def by_stated(self, record: CalibrationRecord) -> dict[str, Floats]:
        """What an error of one standard uncertainty of each stated value does to the estimates, by name, (p,), SI."""
        found = {}
        for name, std in stated_uncertainties(record.arm.cell).items():
            place, sign = self.state.stated_place(name), 1.0 if name.startswith('nominal[') else -1.0
            size = sign * self.state.scale[place] / (std * np.sqrt(record.enlargement))
            found[name] = self.state.scale * self.knowledge[:, place] * size
        return found


def is_comparable(effect: EffectLaw, one: Cell, other: Cell) -> bool:
    """Whether an effect means the same in the recordings of two cells.

    Not what happened at a moment of one recording, nor friction of a random angle, which has no value, nor an error of
    an object that the cells describe otherwise: a description may have been corrected.
    """
    if effect.is_stepwise or effect.off_normal_std:
        return False
    stated = []
    for cell in (one, other):
        objects = {plate.name: (plate.x, plate.y) for plate in cell.plates}
        objects |= {d.name: d.corners if isinstance(d, Outline) else (d.x, d.y, d.radius) for d in cell.discs}  # type: ignore[misc]
        stated.append(objects.get(getattr(effect, 'target', '')))
    return stated[0] == stated[1]


def alone(record: CalibrationRecord, other: CalibrationRecord) -> list[EffectLaw]:
    """The effects of a calibration that another one lacks."""
    theirs = {(effect.label, effect.off_normal_std > 0) for effect in other.arm.effects}
    return [e for e in record.arm.effects if (e.label, e.off_normal_std > 0) not in theirs]


def _with_effects_of(record: CalibrationRecord, other: CalibrationRecord) -> CalibrationRecord:
    """A calibration extended by the effects that another one has found and that can be compared; as it is where its fit
    has undetected effects, for these are among them.
    """
    if record.undetected.columns:
        return record
    cell, model = record.arm.cell, other.arm.model
    own = {effect.label for effect in record.arm.model.effects}
    values = dict(zip((effect.label for effect in model.effects), model.effect_values, strict=True))
    missing = [e for e in alone(other, record) if e.label not in own and is_comparable(e, cell, other.arm.cell)]
    effects, discs = [], [disc.name for disc in cell.discs]
    for entry in map(effect_entry, missing):  # the cell may number its objects otherwise
        fields = {name: value for name, value in entry['fields'].items() if name not in ('discs', 'plate')}
        if 'disc' in fields and fields.get('target') in discs:
            fields['disc'] = discs.index(fields['target'])
        effects.append(read_effect(entry | {'fields': fields}, cell, other.source))
    return extended(record, effects, [values[effect.label] for effect in effects]) if effects else record


def extended(
    record: CalibrationRecord, effects: Sequence[EffectLaw], at: Sequence[tuple[float, ...]]
) -> CalibrationRecord:
    """A calibration with further effects, whose values its touches determine.

    Args:
        record: the calibration.
        effects: that it lacks.
        at: values of each at which it is linearised.
    """
    m, size = record.arm.model, len(record.arm.model.names)
    model = ExtendedModel(m.parameters, (*m.effects, *effects), (*m.effect_values, *map(tuple, at)))
    total = len(model.names)
    new, names = np.arange(size, total), (*model.names, *record.names[size:])
    gap = [size] * len(new)
    before = np.insert(np.insert(record.covariance, gap, 0.0, axis=0), gap, 0.0, axis=1)
    undetermined = np.insert(record.arm.undetermined, gap, 0.0, axis=0)
    arm = replace(record.arm, model=model, covariance=before[:total, :total], undetermined=undetermined)
    wide = replace(record, arm=arm, names=names, values=np.insert(record.values, gap, 0.0), covariance=before)
    residual = measure(record.touches, record, State.of(record).of_stored_forces()).residual.ravel()
    state, jacobian, knowledge = Fit.of(wide, new)
    columns = jacobian[:, new]
    by_new = -knowledge @ (jacobian.T @ columns)  # -M
    information = columns.T @ (columns + jacobian @ by_new)
    by_new[new] += np.eye(len(new))
    values, vectors = np.linalg.eigh((information + information.T) / 2)
    shown = values > 1e-9 * float((columns**2).sum(axis=0).max(initial=1e-12))  # else the touches do not show it
    directions = vectors[:, shown] / np.sqrt(values[shown])
    root = by_new @ directions
    found = root @ (directions.T @ (columns.T @ residual))
    places = [*range(total), *(state.error_place(name) for name in names[total:])]
    scale = state.scale[places]
    further = scale[:, None] * root[places]
    estimates, covariance = wide.values + scale * found[places], before + further @ further.T
    hidden = scale[:total, None] * (by_new @ vectors[:, ~shown])[:total]
    model, undetermined = model.with_array(estimates[:total]), np.hstack([arm.undetermined, hidden])
    arm = replace(arm, model=model, covariance=covariance[:total, :total], undetermined=undetermined)
    return replace(wide, arm=arm, values=estimates, covariance=covariance)


class ParameterChange(NamedTuple):
    """Change of one value from one calibration to the next.

    Attributes:
        name: of a parameter, or of an effect that both have.
        unit: SI.
        before: first value.
        after: second value.
        std: standard uncertainty of the difference; NaN where a calibration does not determine it, 0 where both hold
            it fixed.
    """

    name: str
    unit: str
    before: float
    after: float
    std: float

    @property
    def change(self) -> float:
        """`after` less `before`."""
        return self.after - self.before

    @property
    def z(self) -> float:
        """The change in standard uncertainties; NaN where there is none."""
        return self.change / self.std if self.std > 0 else np.nan

    @property
    def p_value(self) -> float:
        """Two-sided p-value of the change alone; NaN where there is none."""
        return float(erfc(abs(self.z) / np.sqrt(2))) if np.isfinite(self.z) else np.nan


class Change(NamedTuple):
    """What changed from one calibration to the next.

    Attributes:
        before: the first calibration.
        after: the second.
        parameters: every value that both have.
        chi_square: of the difference of all determined combinations.
        degrees_of_freedom: their number.
        p_value: of no change at all.
        causes: hypotheses of what changed.
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
    causes: Causes
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
        InputError: fewer than two, or calibrations of different robots.
    """
    if len(records) < 2:
        raise InputError('calibrations', f'expected two or more to compare, got {len(records)}')
    for record in records[1:]:
        check_same_arm(records[0].arm.cell, record.arm.cell, records[0].source, record.source)
    return [compare(before, after) for before, after in pairwise(records)]


def compare(before: CalibrationRecord, after: CalibrationRecord) -> Change:
    """What changed from one calibration of a robot to the next; it has the same undetected effects in both."""
    undetected = before.undetected, after.undetected
    before, after = before.without_undetected(), after.without_undetected()
    both = _with_effects_of(before, after), _with_effects_of(after, before)
    cells = before.arm.cell, after.arm.cell
    effects = (*before.arm.model.effects, *after.arm.model.effects)
    not_compared = tuple(dict.fromkeys(e.label for e in effects if not is_comparable(e, *cells)))
    names = [name for name in both[0].arm.model.names if name in both[1].arm.model.names]
    names = [n for n in names if n in UNITS or not (n.startswith(UNDETECTED) or n.rpartition('.')[0] in not_compared)]
    fits = [Fit.of(record) for record in both]
    state = fits[1].state
    scale = state.scale[[state.place(name) for name in names]]
    undetermined = [r.arm.undetermined[[r.arm.model.names.index(name) for name in names]] for r in both]
    hidden = np.concatenate(undetermined, axis=1)
    parameters, s = _differences(both, fits, names, hidden, _by_undetected(*undetected, names))
    kept = null_space((hidden / scale[:, None]).T, rcond=1e-9).T if hidden.size else np.eye(len(names))
    difference = np.array([p.change for p in parameters]) / scale
    sizes, vectors = np.linalg.eigh(kept @ (s / np.outer(scale, scale)) @ kept.T)
    large = sizes > 1e-10 * max(float(sizes.max(initial=0.0)), 1e-30)  # smaller: both hold it fixed
    is_held = bool(np.abs(vectors[:, ~large].T @ (kept @ difference)).max(initial=0.0) > 1e-9)
    root = (vectors[:, large] / np.sqrt(sizes[large])).T @ kept
    chi_square, freedoms = float(((root @ difference) ** 2).sum()), len(root)
    noise = sum(r.noise_freedoms for r in (before, after) if np.isfinite(r.noise_freedoms)) or np.inf
    p_value = float(p_values(chi_square, freedoms, noise))
    causes = Causes()
    if p_value < LEVEL:
        evidence = _evidence(root, difference, names, fits[1], len(both[1].arm.model.names))
        single = {k for k, name in enumerate(state.names[: state.values]) if name not in names}  # not in both
        among = [h for h in hypotheses_of(state) if not {*h.places} & single]
        causes = Causes.of(evidence, state, among, (chi_square, freedoms, noise))
    off = after.tip_moved(before.arm, after.arm)
    tip, largest = rms(off), float(off.max(initial=0.0))
    own, its = (tuple(effect.label for effect in alone(*pair)) for pair in ((before, after), (after, before)))
    notes = tuple(_notes(before, after, is_held, [p.name for p in parameters if np.isnan(p.std)]))
    test = chi_square, freedoms, p_value
    return Change(before, after, parameters, *test, causes, tip, largest, own, its, not_compared, notes)


def _differences(
    both: Sequence[CalibrationRecord], fits: Sequence[Fit], names: list[str], hidden: Floats, by_undetected: Floats
) -> tuple[tuple[ParameterChange, ...], Floats]:
    """Of values that both have, one by one, and S of them, SI, (p, p)."""
    places = [[record.place(name) for name in names] for record in both]
    covariances = [r.covariance[np.ix_(where, where)] for r, where in zip(both, places, strict=True)]
    s = covariances[0] + covariances[1] + by_undetected @ by_undetected.T
    by_stated = [fit.by_stated(record) for fit, record in zip(fits, both, strict=True)]
    cells = [record.arm.cell for record in both]
    same = same_sources(*cells)
    for name, _ in stated_uncertainties(cells[0]).items() & stated_uncertainties(cells[1]).items():
        if same(name):  # (a - b)(a - b)ᵀ in the place of a aᵀ + b bᵀ
            one, other = (found[name][where] for found, where in zip(by_stated, places, strict=True))
            s -= np.outer(one, other) + np.outer(other, one)
    std = np.sqrt(np.clip(np.diag(s), 0.0, None))
    independent = np.sqrt(np.clip(np.diag(covariances[0] + covariances[1]), 0.0, None))
    std[np.linalg.norm(hidden, axis=1) > independent] = np.nan
    units = [fits[1].state.units[place] for place in places[1]]
    values = (record.values[where].tolist() for record, where in zip(both, places, strict=True))
    return tuple(map(ParameterChange, names, units, *values, std.tolist())), s


def _by_undetected(before: UndetectedErrors, after: UndetectedErrors, names: Sequence[str]) -> Floats:
    """Changes of the difference of values by one standard deviation of each undetected effect, SI, (p, u).

    The robot has the same ones in both calibrations, but other touches show other parts of them.
    """
    sizes = (zip(one.columns, zip(one.size, one.at(names).T, strict=True), strict=True) for one in (before, after))
    parts, found = [dict(each) for each in sizes], []
    for column in parts[0].keys() | parts[1].keys():
        (size, moved), (other_size, other) = (part.get(column, (0.0, np.zeros(len(names)))) for part in parts)
        one = (size * other_size) ** 0.5
        found.append(other * (one / other_size) - moved * (one / size) if one else moved + other)
    return np.array(found).reshape(-1, len(names)).T


def _evidence(root: Floats, difference: Floats, names: Sequence[str], fit: Fit, values: int) -> Evidence:
    """Evidence for changes of values and of the cell, in the state of the second calibration."""
    where = [fit.state.place(name) for name in names]
    response = np.zeros((len(names), len(fit.state.names)))
    response[np.arange(len(names)), where] = 1.0
    by_errors = fit.knowledge @ (fit.jacobian.T @ fit.jacobian)  # change of the estimates by true errors, Ĉ JᵀJ
    response[:, values:] = by_errors[where][:, values:]
    rows = root @ response
    return Evidence(rows.T @ (root @ difference), rows.T @ rows)


def _notes(before: CalibrationRecord, after: CalibrationRecord, is_held: bool, single: Sequence[str]) -> list[str]:
    """What limits a comparison."""
    notes = []
    if single:
        notes += [f'{", ".join(single)}: not determined each by itself; compared only in combination, if at all']
    if before.checksums & after.checksums:
        same = 'both calibrations contain the same recording'
        notes += [f'{same}: they are not independent, and the p-value is not valid']
    if before.fixed != after.fixed or is_held:
        notes += ['the calibrations hold other parameters fixed: a wrong fixed value looks like a change']
    return notes + [f'{record.source} is unfit for use' for record in (before, after) if record.arm.grade == 'unfit']

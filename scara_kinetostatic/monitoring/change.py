"""Touches as linear measurements of what may have changed since a calibration.

At the calibrated model a touch leaves the whitened residual r (two numbers, of variance one each without any error):

    r = J δ + ε,    ε ~ N(0, I),    δ = x_true - x_calibrated,    x = (values of the model, errors of the cell).

The calibration itself says δ ~ N(0, C₀) with its joint covariance C₀: errors of the discs' places within their declared
uncertainties have moved the parameters, and the same discs touched again are predicted better than either alone says.
C₀ has zero rows for what was fixed or exactly known, and the plausible range of directions that the calibration
did not determine. What follows is `gaussian.information`. Numbers are scaled by plausible sizes of each value, so that
matrices are well conditioned.

Touches that a calibration has not seen are tested by r ~ N(0, I + J C₀ Jᵀ). C₀ is the joint covariance with the errors
of the cell, so that touches on the objects of the calibration are predicted better than touches on new ones.

**Hypotheses**: one parameter changed, or the parameters of one part of robot and cell, while all other values of the
state stayed. Each is judged by its likelihood ratio statistic T (`Information.ratio`) less a penalty per changed value,
as Schwarz's criterion has it: a single parameter is preferred to the part that contains it unless the further values
pay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.calibration.fit_point import fitted_surfaces, project
from scara_kinetostatic.calibration.identifiability import scales_of
from scara_kinetostatic.calibration.observations import UNDETECTED, DeclaredErrors, observe
from scara_kinetostatic.diagnosis.comparison import whitened_normal
from scara_kinetostatic.errors import InputError
from scara_kinetostatic.gaussian.information import Gaussian, Information
from scara_kinetostatic.gaussian.p_values import p_values
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.cell import Cell, Uncertainty
from scara_kinetostatic.model.parameters import DESCRIPTIONS, NAMES, P_EE, UNITS
from scara_kinetostatic.model.quantities import SCALES, scale_of, shown
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.monitoring.record import CalibrationRecord

LINEAR = 0.01
"""Part of a chi-square that a large change leaves as touches are linearised at the calibrated values: (δ / 2 R)² for a
change δ of the tip on a disc of radius R.
"""


class CalibratedState(NamedTuple):
    """What may be off: all values of the model and all errors that a cell can have, declared or not.

    Attributes:
        names: of each, (p,).
        units: SI unit of each.
        scale: its plausible size, SI, (p,).
        cell: in which every error is declared with a standard uncertainty of one SI unit.
        model: the values of the model by the calibration, (p - m,), SI.
        errors: estimates of the errors by it, (m,), SI.
        known: δ by the calibration, in units of `scale`.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: Floats
    cell: Cell
    model: Floats
    errors: Floats
    known: Gaussian

    @classmethod
    def of(cls, record: CalibrationRecord, cell: Cell | None = None, moved: Floats | None = None) -> CalibratedState:
        """That of a calibration, for touches in a cell.

        Errors of objects that the calibration does not know, or knows otherwise, are as the cell declares them.

        Args:
            record: the calibration.
            cell: by default its own.
            moved: changes of all values by one standard deviation of each undetected effect of objects and sensor that
                the touches have otherwise, (v, u), SI; by default all of other objects, none of the same.
        """
        arm, cell = record.arm, record.arm.cell if cell is None else cell
        before, now = ({disc.name: disc for disc in one.discs} for one in (arm.cell, cell))
        if moved is None:
            moved = record.shared * (before != now)
        every = _with_stds(cell, 1.0)
        discs, plates = tuple(every[: len(cell.discs)]), tuple(every[len(cell.discs) :])
        probe = DeclaredErrors.of(replace(cell, discs=discs, plates=plates, uncertainty=Uncertainty(1.0, 1.0, 1.0)))
        assert probe is not None
        names = (*arm.model.names, *probe.names)
        of_cell = [unit for source in probe.sources for unit in [source.unit] * source.components]
        of_effects = [p.unit for effect in arm.model.effects for p in effect.parameters]
        plausible = {'m': 1e-4, 'rad': 1e-3, '1': 1e-2}  # sizes of errors of the cell
        scale = np.concatenate([scales_of(arm.model), [plausible[unit] for unit in of_cell]])
        units = (*(UNITS[name] for name in arm.model.parameters.names), *of_effects, *of_cell)
        values, others = len(arm.model.names), described_otherwise(arm.cell, cell)
        mean, covariance = np.zeros(len(names)), np.zeros((len(names), len(names)))
        own = [k for k, name in enumerate(record.names) if k < values or _target(name) not in others]
        places = [k if k < values else values + probe.names.index(record.names[k]) for k in own]
        covariance[np.ix_(places, places)] = (record.covariance + moved @ moved.T)[np.ix_(own, own)]
        mean[places] = record.values[own]
        declared = DeclaredErrors.of(cell)
        for name, std in zip(declared.names, declared.units, strict=True) if declared else ():
            if (place := values + probe.names.index(name)) not in places:
                covariance[place, place] = std**2
        covariance[:values, :values] += arm.undetermined @ arm.undetermined.T
        known = Gaussian(np.zeros(len(names)), covariance / np.outer(scale, scale))
        return cls(names, units, scale, probe.cell, arm.model.as_array(), mean[values:], known)

    @property
    def values(self) -> int:
        """How many are values of the model."""
        return len(self.model)

    def is_possible(self, place: int, change: float, std: float) -> bool:
        """Whether a change leaves a compliance or backlash that is not negative beyond its uncertainty."""
        if not P_EE <= place < len(NAMES):
            return True
        known = np.sqrt(self.known.covariance[place, place]) * self.scale[place]
        return bool(self.model[place] + change > -_NEGATIVE * np.hypot(np.nan_to_num(std), known))

    def place(self, name: str) -> int:
        """Position of a value of the model or, if it has none of that name, of an error of the cell."""
        return self.names.index(name)


def described_otherwise(one: Cell, other: Cell) -> set[str]:
    """Names of the objects and plates that are not the same thing in two cells: one lacks them, or describes them
    otherwise, but for their uncertainty. A description may have been corrected.
    """
    first, second = ({item.name: item for item in _with_stds(cell, 0.0)} for cell in (one, other))
    return {name for name in first.keys() | second.keys() if first.get(name) != second.get(name)}


def _target(name: str) -> str:
    """The object of an error, such as ``disc_1`` of ``object_position[disc_1].x``; empty where it is of none."""
    return name.partition('[')[2].partition(']')[0]


def _with_stds(cell: Cell, std: float) -> list[Any]:
    """The objects and plates of a cell with other uncertainties."""
    objects: tuple[Any, ...] = (*cell.discs, *cell.plates)
    return [one._replace(**{name: std for name in one._fields if name.endswith('_std')}) for one in objects]


class Measured(NamedTuple):
    """n touches as linear measurements.

    Attributes:
        residual: r, (n, 2).
        jacobian: J by the state in units of its scale, (n, 2, p).
        normal: m with r·m the distance of the predicted tip from the circle of contact, (n, 2), m.
    """

    residual: Floats
    jacobian: Floats
    normal: Floats

    @property
    def tip_error(self) -> Floats:
        """Distance of the predicted tip from the circle that it touches, (n,), m."""
        return np.asarray((self.residual * self.normal).sum(axis=1))

    def information(self, weight: Floats | float = 1.0) -> Information:
        """What they say of the state together; `weight` of each, (n,)."""
        return Information.of(self.jacobian, self.residual, weight)

    def chi_squares(self, known: Gaussian) -> Floats:
        """Squared distance of each touch from its prediction by a knowledge of the state, (n,)."""
        return known.chi_squares(self.jacobian, self.residual)

    def select(self, which: Mask | slice) -> Measured:
        """Some of the touches."""
        return Measured(self.residual[which], self.jacobian[which], self.normal[which])


def measure(touches: TouchSet, record: CalibrationRecord, state: CalibratedState) -> Measured:
    """Touches as linear measurements at the calibrated model.

    Args:
        touches: in the cell of `state`.
        record: the calibration.
        state: what may be off.

    Raises:
        InputError: a touch is so far from the model that nothing can be said.
    """
    cell = state.cell
    if cell.has_outlines:  # the calibrated arm knows where the tip is, the nominal one about
        known = replace(cell, nominal=record.arm.model.parameters)
        given, touches = touches.surface, touches.replace(surface=observe(touches, known).surface)
        observations = observe(touches, cell, state.errors)
        point = project(observations, record.arm.model, record.arm.noise)
        surface = np.where(given < 0, fitted_surfaces(observations, cell, point), given)
        touches = touches.replace(surface=surface)
    observations = observe(touches, cell, state.errors)
    point = project(observations, record.arm.model, record.arm.noise)
    spread = np.sqrt(record.enlargement)
    residual, jacobian = -point.whitened.residual / spread, point.whitened.jacobian * state.scale / spread
    if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
        problem = 'a touch cannot be evaluated at the calibrated model'
        raise InputError(record.source, problem, 'check that robot and cell are those of the calibration')
    return Measured(residual, jacobian, whitened_normal(observations, point) * spread)


class PredictionTest(NamedTuple):
    """Chi-square of all touches, and each of them by itself.

    Attributes:
        chi_square: of all.
        freedoms: two per touch.
        p_value: of the calibration being right.
        distances: of each touch from its prediction, in standard deviations, (n,).
        p_values: of each touch, (n,).
        expected: standard deviation of the error of the tip, (n,), m.
    """

    chi_square: float
    freedoms: int
    p_value: float
    distances: Floats
    p_values: Floats
    expected: Floats

    @classmethod
    def of(cls, measured: Measured, known: Gaussian, noise: float) -> PredictionTest:
        """With noise that is known with so many degrees of freedom."""
        freedoms, squares = measured.residual.size, measured.chi_squares(known)
        chi_square, normal = known.chi_square(measured.jacobian, measured.residual), measured.normal[:, None]
        p_value, of_each = float(p_values(chi_square, freedoms, noise)), p_values(squares, 2, noise)
        expected = np.sqrt(normal @ known.spread(measured.jacobian) @ normal.swapaxes(1, 2))[:, 0, 0]
        return cls(chi_square, freedoms, p_value, np.sqrt(squares), of_each, expected)


_NEGATIVE = 4.0
"""Standard uncertainties below zero beyond which no compliance or backlash is, as for a grade."""
PENALTY = 4.0
"""Of each changed value, as Schwarz's criterion log n for about fifty measured numbers."""
_PARTS = {
    'base': (('x0', 'y0', 'theta1'), 'the base of the arm moved'),
    'tool': (('theta2', 'l2'), 'the tool moved or bent'),
    'gripper': (('p_ee', 'g_ee'), 'compliance and backlash of the gripper changed'),
    'transmission[joint1]': (('p1', 'g1'), 'compliance and backlash of joint 1 changed'),
    'transmission[joint2]': (('p2', 'g2'), 'compliance and backlash of joint 2 changed'),
}
_TITLES = {
    **{part: title for part, (_, title) in _PARTS.items()},
    'x0': 'the base moved along x',
    'y0': 'the base moved along y',
    'theta1': 'the zero of joint 1 changed, or the base turned',
    'theta2': 'the zero of joint 2 changed',
    'l1': 'link 1 changed its length',
    'l2': 'link 2 or the tool changed its length',
    **{name: f'the {DESCRIPTIONS[name].partition(",")[0]} changed' for name in NAMES[P_EE:]},
    'object_position': '{} moved',
    'object_radius': 'the radius of {} changed',
    'plate_position': 'plate {} moved',
    'plate_angle': 'plate {} turned',
    'radius': 'the radius of the tip changed, as by wear',
    'force_gain': 'the gain of the force sensor changed',
    'force_rotation': 'the force sensor turned',
}


class Hypothesis(NamedTuple):
    """One thing that may have changed, and how well that explains some evidence.

    Attributes:
        name: a parameter, a part, a source of the cell (``object_position[disc_1]``) or an effect.
        places: of its values in the state.
        values: names of these within it, such as ``x`` of an object's position.
        units: of these values.
        statistic: T, how much chi-square it explains; 0 before it is held against evidence.
        change: estimate of the change of each value, SI; empty before that, as `std`.
        std: its standard uncertainty, SI; NaN where the evidence does not determine it.
        distance: of a change of x and y, how far, and its standard uncertainty, m; None else.
    """

    name: str
    places: tuple[int, ...]
    values: tuple[str, ...]
    units: tuple[str, ...]
    statistic: float = 0.0
    change: tuple[float, ...] = ()
    std: tuple[float, ...] = ()
    distance: tuple[float, float] | None = None

    @property
    def title(self) -> str:
        """It in words."""
        return change_title(self.name)

    @property
    def text(self) -> str:
        """The change with its standard uncertainty; several values with their names, and how far it is."""
        largest = max(map(abs, self.change))
        found = []
        for name, value, std, unit in zip(self.values, self.change, self.std, self.units, strict=True):
            change = shown(value, std, unit, {unit: SCALES.get(name) or scale_of(largest, unit)}).text
            found.append(f'{name} {change}' if len(self.values) > 1 else change)
        far = f'{shown(*self.distance, "m", {"m": scale_of(largest, "m")}).text}: ' if self.distance else ''
        return far + ', '.join(found)

    @property
    def score(self) -> float:
        """T less the penalty of its values."""
        return self.statistic - PENALTY * len(self.places)


def change_title(name: str) -> str:
    """A change in words: ``disc_1 moved`` for ``object_position[disc_1]``."""
    if name in _TITLES:
        return _TITLES[name]
    kind, _, target = name.partition('[')
    words = f'the {kind.replace("_", " ")}{" of {}" * bool(target)} changed'
    return _TITLES.get(kind, words).format(target.rstrip(']'))


def hypotheses_of(state: CalibratedState, objects: Sequence[int] | None = None) -> tuple[Hypothesis, ...]:
    """All hypotheses about a state.

    Args:
        state: what may be off.
        objects: numbers of the objects that can have changed; None for all.
    """
    base = state.cell.nominal.names
    named: dict[str, tuple[int, ...]] = {name: (k,) for k, name in enumerate(base)}
    named |= {part: tuple(map(base.index, names)) for part, (names, _) in _PARTS.items()}
    touched = [disc for number, disc in enumerate(state.cell.discs) if objects is None or number in objects]
    shown_by = {'object': {disc.name for disc in touched}, 'plate': {disc.plate for disc in touched}}
    cell: dict[str, tuple[int, ...]] = {}
    effects: dict[str, tuple[int, ...]] = {}
    for place, full in enumerate(state.names[len(base) :], len(base)):
        label = full.partition('].')[0] + ']' if '].' in full else full.partition('.')[0]
        found = effects if place < state.values else cell
        found[label] = (*found.get(label, ()), place)
    for label, places in cell.items():
        kind, _, target = label.rstrip(']').partition('[')
        if target in shown_by.get(kind.partition('_')[0], {target}):
            named[label] = places
    named |= {label: at for label, at in effects.items() if label not in cell and not label.startswith(UNDETECTED)}
    hypotheses = []
    for name, places in named.items():
        values = tuple(state.names[place].removeprefix(f'{name}.') for place in places)
        hypotheses.append(Hypothesis(name, places, values, tuple(state.units[place] for place in places)))
    return tuple(hypotheses)


def ranked(hypotheses: Sequence[Hypothesis], evidence: Information, state: CalibratedState) -> list[Hypothesis]:
    """Those that are possible, with what they explain of the evidence, the best first."""
    found = []
    for hypothesis in hypotheses:
        ratio, scale = evidence.ratio(hypothesis.places), state.scale[list(hypothesis.places)]
        change, std = (tuple((scale * part).tolist()) for part in (ratio.change, ratio.std))
        far, unsure = float(np.linalg.norm(change)), float(scale[0] * ratio.size_std)
        distance = (far, unsure) if hypothesis.values == ('x', 'y') else None
        hypothesis = hypothesis._replace(statistic=ratio.statistic, change=change, std=std, distance=distance)
        if all(map(state.is_possible, hypothesis.places, change, std)):
            found.append(hypothesis)
    return sorted(found, key=lambda item: -item.score)


def rivals(ranking: Sequence[Hypothesis]) -> tuple[str, ...]:
    """Names of those that explain the evidence about as well as the first, by odds of 20 to 1."""
    own = set(ranking[0].places)
    others = [item for item in ranking[1:] if not own < set(item.places)]  # the part of the best is no rival
    return tuple(item.name for item in others if ranking[0].score - item.score <= 6.0)


class Causes(NamedTuple):
    """What may have changed where touches or calibrations contradict a calibration; empty where they do not.

    Attributes:
        ranking: the hypotheses, the best first.
        rivals: names of those that explain the evidence about as well as the first.
        remaining_p_value: of nothing else having changed than the first says; 1 where the error of linearisation may be
            what a large change leaves.
    """

    ranking: tuple[Hypothesis, ...] = ()
    rivals: tuple[str, ...] = ()
    remaining_p_value: float = 1.0

    @classmethod
    def of(cls, ranking: Sequence[Hypothesis], test: tuple[float, int, float]) -> Causes:
        """Of a ranking, and of a test of all evidence: chi-square, its degrees of freedom, and those of the noise."""
        chi_square, freedoms, noise = test
        left = max(chi_square - ranking[0].statistic, 0.0)
        freedoms = max(freedoms - len(ranking[0].change), 0)
        remaining = 1.0 if left < LINEAR * chi_square else float(p_values(left, freedoms, noise))
        return cls(tuple(ranking), rivals(ranking), remaining)

    def is_open(self, level: float) -> bool:
        """Whether what the likeliest change leaves is significant at a level."""
        return self.remaining_p_value < level

    @property
    def odds(self) -> list[tuple[str, float]]:
        """The likeliest change and its rivals in words, with their probabilities."""
        titled = [item for item in self.ranking if item.name in (self.ranking[0].name, *self.rivals)]
        weights = np.exp([(item.score - self.ranking[0].score) / 2 for item in titled])
        return [*zip((item.title for item in titled), (weights / weights.sum()).tolist(), strict=True)]

    def title(self, level: float) -> str:
        """The likeliest change in words, and how far it is."""
        best = f'{self.ranking[0].title} ({self.ranking[0].text})'
        return f'no single part explains it, the largest is: {best}' if self.is_open(level) else f'most likely {best}'

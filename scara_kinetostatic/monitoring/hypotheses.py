"""What may have changed since a calibration: one parameter, or the parameters of one part of robot and cell.

Each hypothesis is that some values of the state changed while all others stayed. It is judged by its likelihood ratio
statistic T (`Information.ratio`) less a penalty per changed value, as Schwarz's criterion has it: a single
parameter is preferred to the part that contains it unless the further values pay.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.declared_errors import UNDETECTED
from scara_kinetostatic.gaussian.information import Information
from scara_kinetostatic.gaussian.linear_model import p_values
from scara_kinetostatic.model.parameters import DESCRIPTIONS, NAMES, P_EE
from scara_kinetostatic.monitoring.linear import LINEAR, CalibratedState
from scara_kinetostatic.report.quantities import SCALES, scale_of, shown

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
    """All of them with what they explain of the evidence, the best first."""
    found = []
    for hypothesis in hypotheses:
        ratio, scale = evidence.ratio(hypothesis.places), state.scale[list(hypothesis.places)]
        change, std = (tuple((scale * part).tolist()) for part in (ratio.change, ratio.std))
        far, unsure = float(np.linalg.norm(change)), float(scale[0] * ratio.size_std)
        distance = (far, unsure) if hypothesis.values == ('x', 'y') else None
        found.append(hypothesis._replace(statistic=ratio.statistic, change=change, std=std, distance=distance))
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

    def title(self, level: float) -> str:
        """The likeliest change in words, and how far it is."""
        best = f'{self.ranking[0].title} ({self.ranking[0].text})'
        return f'no single part explains it, the largest is: {best}' if self.is_open(level) else f'most likely {best}'

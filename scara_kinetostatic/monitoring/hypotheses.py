"""What may have changed since a calibration: one parameter, or the parameters of one part of robot and cell.

Each hypothesis is that some values of the state changed while all others stayed. It is judged by its likelihood ratio
statistic T (`linear.Evidence.ratio`) less a penalty per changed value, as Schwarz's criterion has it: a single
parameter is preferred to the part that contains it unless the further values pay.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.parameters import NAMES, UNITS
from scara_kinetostatic.monitoring.linear import Evidence, State

PENALTY = 4.0
"""Of each changed value, as Schwarz's criterion log n for about fifty measured numbers."""
RIVAL = 6.0
"""Hypotheses whose penalised statistic is within this of the best are rivals: odds of 20 to 1."""
ALIAS = 0.999
"""Correlation of two hypotheses from which on no touch of this kind tells them apart."""
_PARTS = {
    'base': ('x0', 'y0', 'theta1'),
    'tool': ('theta2', 'l2'),
    'gripper': ('p_ee', 'g_ee'),
    'transmission[joint1]': ('p1', 'g1'),
    'transmission[joint2]': ('p2', 'g2'),
}
_TITLES = {
    'base': 'the base of the arm moved',
    'tool': 'the tool moved or bent',
    'gripper': 'compliance and backlash of the gripper changed',
    'transmission[joint1]': 'compliance and backlash of joint 1 changed',
    'transmission[joint2]': 'compliance and backlash of joint 2 changed',
    'x0': 'the base moved along x',
    'y0': 'the base moved along y',
    'theta1': 'the zero of joint 1 changed, or the base turned',
    'theta2': 'the zero of joint 2 changed',
    'l1': 'link 1 changed its length',
    'l2': 'link 2 or the tool changed its length',
    'p_ee': 'the compliance of the gripper changed',
    'g_ee': 'the backlash of the gripper changed',
    'p1': 'the compliance of joint 1 changed',
    'g1': 'the backlash of joint 1 changed',
    'p2': 'the compliance of joint 2 changed',
    'g2': 'the backlash of joint 2 changed',
    'object_position': '{} moved',
    'object_radius': 'the radius of {} changed',
    'plate_position': 'plate {} moved',
    'plate_angle': 'plate {} turned',
    'radius': 'the radius of the tip changed, as by wear',
    'force_gain': 'the gain of the force sensor changed',
    'force_rotation': 'the force sensor turned',
}


class Hypothesis(NamedTuple):
    """One thing that may have changed.

    Attributes:
        name: a parameter, a part, a source of the cell (``object_position[disc_1]``) or an effect.
        places: of its values in the state.
        units: of these values.
    """

    name: str
    places: tuple[int, ...]
    units: tuple[str, ...]

    @property
    def title(self) -> str:
        """It in words."""
        return change_title(self.name)


def change_title(name: str) -> str:
    """A change in words: ``disc_1 moved`` for ``object_position[disc_1]``."""
    if name in _TITLES:
        return _TITLES[name]
    kind, _, target = name.partition('[')
    return _TITLES.get(kind, f'{name} changed').format(target.rstrip(']'))


def hypotheses_of(state: State, values: int, objects: Sequence[int] | None = None) -> tuple[Hypothesis, ...]:
    """All hypotheses about a state.

    Args:
        state: what may be off.
        values: how many of its entries are values of the model.
        objects: numbers of the objects that can have changed; None for all.
    """
    found = [Hypothesis(name, (k,), (UNITS[name],)) for k, name in enumerate(NAMES)]
    found += [
        Hypothesis(part, tuple(map(NAMES.index, names)), tuple(UNITS[name] for name in names))
        for part, names in _PARTS.items()
    ]
    labels: dict[str, list[int]] = {}
    for k, name in enumerate(state.names[len(NAMES) :], len(NAMES)):
        labels.setdefault(name.rpartition('.')[0] if '.' in name else name, []).append(k)
    touched = None if objects is None else {state.cell.discs[k].name for k in objects}
    plates = {disc.plate for disc in state.cell.discs if touched is None or disc.name in touched}
    for label, places in labels.items():
        kind, _, target = label.partition('[')
        target = target.rstrip(']')
        is_cell = places[0] >= values
        if is_cell and kind.startswith('object') and touched is not None and target not in touched:
            continue
        if is_cell and kind.startswith('plate') and target not in plates:
            continue
        unit = {'plate_angle': 'rad', 'force_rotation': 'rad', 'force_gain': '1'}.get(kind, 'm') if is_cell else ''
        found.append(Hypothesis(label, tuple(places), (unit,) * len(places)))
    return tuple(found)


class Explanation(NamedTuple):
    """How well one hypothesis explains the evidence.

    Attributes:
        hypothesis: what changed.
        statistic: T, how much chi-square it explains.
        change: estimate of the change of each value, SI.
        std: its standard uncertainty, SI; NaN where the evidence does not determine it.
    """

    hypothesis: Hypothesis
    statistic: float
    change: tuple[float, ...]
    std: tuple[float, ...]

    @property
    def name(self) -> str:
        """Of the hypothesis."""
        return self.hypothesis.name

    @property
    def score(self) -> float:
        """T less the penalty of its values."""
        return self.statistic - PENALTY * len(self.change)


def explanations(evidence: Evidence, state: State, among: Sequence[Hypothesis]) -> list[Explanation]:
    """Every hypothesis, the best first."""
    found = []
    for hypothesis in among:
        where = list(hypothesis.places)
        statistic, change = evidence.ratio(where)
        block = evidence.matrix[np.ix_(where, where)]
        scale = state.scale[where]
        stds = scale * _stds(block)
        found.append(Explanation(hypothesis, statistic, tuple((scale * change).tolist()), tuple(stds.tolist())))
    return sorted(found, key=lambda item: -item.score)


def _stds(block: Floats) -> Floats:
    values, vectors = np.linalg.eigh(block)
    least = 1e-9 * max(float(values.max(initial=0.0)), 1e-12)
    if values.min(initial=1.0) <= least:
        return np.full(len(block), np.nan)
    return np.asarray(np.sqrt(((vectors**2) / values).sum(axis=1)))


def rivals(ranking: Sequence[Explanation], evidence: Evidence) -> list[str]:
    """Names of those that explain the evidence about as well as the first, and of its exact aliases."""
    if not ranking:
        return []
    best = ranking[0]
    own = set(best.hypothesis.places)
    others = [item for item in ranking[1:] if not own < set(item.hypothesis.places)]  # the part of the best is no rival
    near = [item for item in others if best.score - item.score <= RIVAL]
    aliases = [item for item in others if item not in near and _are_aliases(best, item, evidence)]
    return [item.name for item in (*near, *aliases)]


def _are_aliases(one: Explanation, other: Explanation, evidence: Evidence) -> bool:
    """Whether the evidence shows two single values alike."""
    if len(one.change) != 1 or len(other.change) != 1:
        return False
    i, j = one.hypothesis.places[0], other.hypothesis.places[0]
    m = evidence.matrix
    sizes = m[i, i] * m[j, j]
    return bool(sizes > 0 and m[i, j] ** 2 > ALIAS**2 * sizes)

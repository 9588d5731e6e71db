"""Laws of records: law (6) of the paper, q - q* = p c + g sign(c), and candidates that extend it.

With x what drives a record, the displacement or the load counted from rest, a law of what is driven is

    y = z + s Σ_i a_i B_i(x; θ, h),        a_i ≥ 0,

z the zero of y, s = ±1 its direction under a positive x, B_i functions of x up to now. The amplitudes a_i and the shape
parameters θ are common to all records; z and the initial state of friction h, from -1 to 1, are each record's own: they
depend on what happened before it. P_r is the play operator of half width r (`model.play_operator`).

Driven by its motion, the force is predicted. Law (6), solved for the force, is a spring with a dead zone: with the
deflection u,

    F = F0 + dz(u; g) / p        (`model.kinematics`),

F0 being the zero of the force sensor and 1/p the amplitude. With u = x - x0 the force depends on the displacement
alone. Candidates:

- softening: a spring whose stiffness decreases, u_s tanh(dz / u_s) instead of dz, with u_s = p F_s; without hysteresis.
- viscous: a damper in parallel, c dx/dt.
- friction: Coulomb friction in parallel, Fc sign(dx/dt).
- slip: Coulomb friction in series. u follows the motion until it reaches +h+ or -h-, h± = g + p F±, where the spring
  force is F+ or -F-; from there on the joint slips and u remains: u = x - P_r(x) + (h+ - h-) / 2, r = (h+ + h-) / 2.
- slip_no_gap: the same with g = 0 and h+ = h-; unequal limits are the same as another F0.

Driven by its load τ, the response is predicted:

- backlash, law (6): τ, and sign(τ), linear within the scatter of the load at rest or not; no memory.
- gap, law (6) as well: τ, and the sign that the load had last: an unloaded joint may stay where the load left it.
- friction: spring and gap with Coulomb friction in parallel: the play τ_e = P_r(τ), and τ_e / √(τ_e² + s²), the sign of
  τ_e with the gap rounded over a load s, where the flanks meet one after the other.
- load_friction: the same with friction that grows with the load, |τ - τ_e| ≤ r + μ |τ_e|.
- slip: τ and P_r(τ): a spring in series with such a spring with friction. Up to a load change of 2 r from the last
  reversal it is elastic, from there on it slips, and stays when the load goes.
- slips: τ and two of them, of half widths r and r + Δr, that begin in the same state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.joint_law import beyond_gap, rounded_sign
from scara_kinetostatic.model.play_operator import LARGEST_RATIO
from scara_kinetostatic.studies.loops.record import LOAD, MOTION, RecordPath

Values = Mapping[str, float]
_BAND, _CLOSER, _FRICTIONS = 4.0, (0.01, 0.03), (0.04, 0.1, 0.2, 0.35)
"""Standard deviations of the load at rest beyond which its sign is certain; where fits start: `Shape.starts`."""
Columns = Callable[[RecordPath, Values], tuple[Floats, ...]]
PARAMETERS = {
    'zero': ('zero of the {response}', 'm'),
    'compliance': ('compliance p', 'm/N'),
    'half_gap': ('half gap g', 'm'),
    'force_zero': ('zero of the {load}', 'N'),
    'slip_positive': ('slip {load}, positive', 'N'),
    'slip_negative': ('slip {load}, negative', 'N'),
    'damping': ('damping', 'N·s/m'),
    'slip_compliance': ('compliance of the slipping part', 'm/N'),
    'further_compliance': ('compliance of the second slipping part', 'm/N'),
    'slip_load': ('slip load', 'N'),
    'further_load': ('added slip load of the second part', 'N'),
    'friction': ('friction', 'N'),
    'friction_ratio': ('part of the load by which friction grows', '1'),
    'rounding': ('{load} over which the gap is rounded', 'N'),
}
"""What is reported of a law, by name: in words, and the SI unit for a force over a displacement."""


class Shape(NamedTuple):
    """A parameter in which a law is not linear.

    Attributes:
        name: key.
        starts: where fits start, in units of the largest driver of the records; a ratio as it is.
        least: lower bound, likewise.
        most: upper bound.
        is_ratio: whether it has no unit.
    """

    name: str
    starts: tuple[float, ...]
    least: float = 1e-3
    most: float = np.inf
    is_ratio: bool = False


class RecordLaw(NamedTuple):
    """A law of what is driven along a record.

    Attributes:
        name: key.
        effect: name of the physical effect; laws of one effect are forms of it, the simplest first.
        title: in words.
        amplitudes: names of the linear parameters.
        shape: the other parameters.
        columns: B, one for each amplitude, of a path and of the shape parameters with the 'state' of friction.
        has_state: whether each record has an initial state of friction to be found.
    """

    name: str
    effect: str
    title: str
    amplitudes: tuple[str, ...]
    shape: tuple[Shape, ...]
    columns: Columns
    has_state: bool = False

    @property
    def size(self) -> int:
        """Number of parameters that are common to all records."""
        return len(self.amplitudes) + len(self.shape)

    def basis(self, path: RecordPath, values: Values) -> Floats:
        """The functions side by side, in the direction of the path, (n, k)."""
        return path.direction * np.stack(self.columns(path, values), axis=1)


def reported(values: Values, zero: float) -> dict[str, float]:
    """The parameters as reported: of a motion compliance and limits of the force, from stiffness and deflections."""
    if 'stiffness' not in values:
        return dict(values)
    stiffness = values['stiffness']
    found = {'compliance': 1 / stiffness if stiffness > 0 else np.nan}
    if 'limit' in values:  # what makes the limits of the force differ is its zero
        force = stiffness * values['limit']
        return {**found, 'slip_positive': force + zero, 'slip_negative': force - zero}
    for name, value in list(values.items())[1:]:
        found[name.replace('limit', 'slip')] = stiffness * value if name.startswith('limit_') else value
    return {**found, 'force_zero': zero}


def _spring(path: RecordPath, values: Values) -> Floats:
    return beyond_gap(path.driver - path.driver.mean() - values['zero'], values['half_gap'])


def _softening(path: RecordPath, values: Values) -> tuple[Floats]:
    spring = _spring(path, values)
    limit = np.where(spring > 0, values['limit_positive'], values['limit_negative'])
    return (limit * np.tanh(spring / limit),)


def _slip(path: RecordPath, values: Values) -> tuple[Floats]:
    half_gap = values['half_gap']
    rising, falling = half_gap + values['limit_positive'], half_gap + values['limit_negative']
    held = path.driver - path.play_operator((rising + falling) / 2, values['state'])
    return (beyond_gap(held + (rising - falling) / 2, half_gap),)


_SPRING = (Shape('zero', (-0.4, -0.2, 0.0, 0.2, 0.4), least=-np.inf), Shape('half_gap', (*_CLOSER, 0.08, 0.2), 0.0))
_LIMITS = tuple(Shape(name, (0.02, 0.06, 0.15, 0.4)) for name in ('limit_positive', 'limit_negative'))
BACKLASH = RecordLaw(
    'backlash', 'backlash', 'law (6): slope and gap',
    ('stiffness',), _SPRING, lambda path, values: (_spring(path, values),),
)  # fmt: skip
MOTION_LAWS = (
    RecordLaw(
        'softening', 'softening', 'softening spring',
        ('stiffness',), (*_SPRING, *_LIMITS), _softening,
    ),
    RecordLaw(
        'viscous', 'viscous', 'damper in parallel',
        ('stiffness', 'damping'), _SPRING, lambda path, values: (_spring(path, values), path.speed),
    ),
    RecordLaw(
        'friction', 'friction', 'friction in parallel',
        ('stiffness', 'friction'), _SPRING, lambda path, values: (_spring(path, values), path.sense),
    ),
    RecordLaw(
        'slip_no_gap', 'slip', 'slip in series, no gap',
        ('stiffness',), (_LIMITS[0]._replace(name='limit'),),
        lambda path, values: (path.driver - path.play_operator(values['limit'], values['state']),), True,
    ),
    RecordLaw(
        'slip', 'slip', 'slip in series',
        ('stiffness',), (_SPRING[1], *_LIMITS), _slip, True,
    ),
)  # fmt: skip
"""Laws that are compared with law (6) where the motion drives."""


def _gap_that_returns(band: float | None) -> Columns:
    """Load and its sign, certain beyond so many of its standard deviations at rest; None: the sign as measured."""
    return lambda path, values: (path.driver, path.sign(band))


def _gap_that_stays(band: float) -> Columns:
    """Load and its last sign beyond so many of its standard deviations at rest."""
    return lambda path, values: (path.driver, path.last_sign(band, values['state']))


def _friction(path: RecordPath, values: Values) -> tuple[Floats, Floats]:
    """The load that friction in parallel leaves to the spring, and its sign, rounded."""
    elastic = path.play_operator(values['friction'], values['state'], values.get('friction_ratio', 0.0))
    return elastic, rounded_sign(elastic, values['rounding'])


def _slips(path: RecordPath, values: Values) -> tuple[Floats, ...]:
    """The load, and what one or two slipping parts in series take of it."""
    loads = np.cumsum([values[name] for name in ('slip_load', 'further_load') if name in values])
    return path.driver, *(path.play_operator(load, values['state']) for load in loads.tolist())


LOAD_BACKLASH = BACKLASH._replace(amplitudes=('compliance', 'half_gap'), shape=(), columns=_gap_that_returns(_BAND))
_GAP = RecordLaw(
    'gap', 'gap', 'gap that keeps its place when unloaded',
    LOAD_BACKLASH.amplitudes, (), _gap_that_stays(_BAND), True,
)  # fmt: skip
_FRICTION = RecordLaw(
    'friction', 'friction', 'friction in parallel',
    LOAD_BACKLASH.amplitudes,
    (Shape('friction', _FRICTIONS, most=3.0), Shape('rounding', (*_CLOSER, 0.1), most=1.0)),
    _friction, True,
)  # fmt: skip
_SLIP = RecordLaw(
    'slip', 'slip', 'slip in series with memory',
    ('compliance', 'slip_compliance'), (Shape('slip_load', (*_FRICTIONS, 0.55, 0.8), most=3.0),),
    _slips, True,
)  # fmt: skip
LOAD_LAWS = (
    _FRICTION,
    _FRICTION._replace(
        name='load_friction', effect='load_friction', title='friction in parallel that grows with the load',
        shape=(
            _FRICTION.shape[0],
            Shape('friction_ratio', (0.1, 0.3, 0.5), most=LARGEST_RATIO, is_ratio=True),
            _FRICTION.shape[1],
        ),
    ),
    _SLIP,
    _SLIP._replace(
        name='slips', title='two slips in series with memory', amplitudes=(*_SLIP.amplitudes, 'further_compliance'),
        shape=(*_SLIP.shape, Shape('further_load', (0.1, 0.3, 0.6), most=3.0)),
    ),
)  # fmt: skip
"""Laws that are compared with law (6) where the load drives, beside the gap that keeps its place."""
FAMILIES = {
    MOTION: ((BACKLASH,), (), MOTION_LAWS),
    LOAD: (
        # law (6) says nothing of a joint without load: what these records show of it there decides between the forms,
        # by the standard deviations of the load at rest up to which it has no certain sign, or counts as none
        tuple(LOAD_BACKLASH._replace(columns=_gap_that_returns(band)) for band in (_BAND, 2 * _BAND, 0.0, None)),
        tuple(_GAP._replace(columns=_gap_that_stays(band)) for band in (_BAND, 2 * _BAND, 4 * _BAND)),
        LOAD_LAWS,
    ),
}
"""By what drives: the forms of law (6), those of the gap that keeps its place, and the other candidates."""

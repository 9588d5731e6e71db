"""Laws of records: law (6) of the paper, q - q* = p c + g sign(c), and candidates that extend it.

Driven by its motion, the force is predicted. Law (6), solved for the force, is a spring with a dead zone: with the
deflection u,

    F = F0 + dz(u; g) / p,        dz(u; g) = sign(u) max(|u| - g, 0),

F0 being the zero of the force sensor. With u = x - x0 the force depends on the displacement alone. Candidates:

- softening: a spring whose stiffness decreases, Fs tanh(dz / (p Fs)) instead of dz / p; without hysteresis.
- viscous: a damper in parallel, c dx/dt.
- friction: Coulomb friction in parallel, Fc sign(dx/dt).
- slip: Coulomb friction in series, a play operator on u. u follows the motion until the spring force reaches +F+ or
  -F-; from there on the joint slips and u remains. With X the displacement since any instant, in a rising sweep

      u_k = X_k + min(u_0, min over j <= k of (h_j - X_j)),        h: deflection at which it slips,

  and the mirror image in a falling one. This is exact at the samples, without integration.
- slip_no_gap: the same with g = 0; F0 is then equivalent to a shift of u and of both bounds, and left out.

Driven by its load, the response is predicted. With the load τ counted from rest, a law is

    y = z + s Σ_i a_i B_i(τ; θ, h),        a_i ≥ 0,

z the response at no load, s = ±1 the direction of the response to a positive load, B_i functions of the load up to now.
The amplitudes a_i and the shape parameters θ are common to all records; z and the initial state of friction h, from -1
to 1, are each record's own: they depend on what happened before it. Functions:

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
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.play_operator import LARGEST_RATIO
from scara_kinetostatic.studies.loops.load_path import LoadPath
from scara_kinetostatic.studies.loops.motion import Motion

Values = Mapping[str, float]


class Parameter(NamedTuple):
    """A parameter of a law.

    Attributes:
        name: key.
        unit: SI, for a force over a displacement.
        starts: where fits start, in units of the range of the data; none for an amplitude, which is linear.
        least: lower bound, SI.
        most: upper bound, in the unit of the starts.
    """

    name: str
    unit: str
    starts: tuple[float, ...] = ()
    least: float = 0.0
    most: float = np.inf


class Law(NamedTuple):
    """A law of the force along a motion, or of the response along a load.

    Attributes:
        name: key.
        effect: name of the physical effect; laws of one effect are forms of it, the simplest first.
        title: in words.
        meaning: the same as a sentence, with {load} and {response}.
        parameters: common to all records, amplitudes first.
        function: of a path and of the parameters that are not amplitudes, with the 'state' of friction: B, (n, k) for k
            amplitudes; where there are none the force, (n,).
        has_state: whether each record has an initial state of friction to be found.
    """

    name: str
    effect: str
    title: str
    meaning: str
    parameters: tuple[Parameter, ...]
    function: Callable[[Any, Values], Floats]
    has_state: bool = False

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:
        """The linear parameters."""
        return tuple(each for each in self.parameters if not each.starts)

    @property
    def shape(self) -> tuple[Parameter, ...]:
        """The other parameters."""
        return tuple(each for each in self.parameters if each.starts)


def _dead_zone(deflection: Floats, half_gap: float) -> Floats:
    """dz(u; g), m."""
    return np.asarray(np.sign(deflection) * np.maximum(np.abs(deflection) - half_gap, 0.0))


def _spring(motion: Motion, values: Values) -> Floats:
    deflection = motion.driver - motion.driver.mean() - values['zero']
    return values['force_zero'] + _dead_zone(deflection, values['half_gap']) / values['compliance']


def _softening(motion: Motion, values: Values) -> Floats:
    force = _spring(motion, values) - values['force_zero']
    top = np.where(force > 0, values['slip_positive'], values['slip_negative']) + 1e-9 * motion.driven_range
    return np.asarray(values['force_zero'] + top * np.tanh(force / top))


def _viscous(motion: Motion, values: Values) -> Floats:
    return _spring(motion, values) + values['damping'] * motion.speed


def _friction(motion: Motion, values: Values) -> Floats:
    return _spring(motion, values) + values['friction'] * motion.sense


def _slip(motion: Motion, values: Values) -> Floats:
    compliance, half_gap, zero = values['compliance'], values.get('half_gap', 0.0), values.get('force_zero', 0.0)
    rising, falling = (half_gap + compliance * values[f'slip_{sense}'] for sense in ('positive', 'negative'))
    deflection = np.empty(len(motion))
    # the first reading tells the deflection; where it is below 2 % of the range it may be anywhere in the gap
    first_force = motion.driven[0] - zero
    place = min(max(first_force / (0.02 * motion.driven_range), -1.0), 1.0)
    here, before = first_force * compliance + place * half_gap + values['start'], motion.driver[0]
    for first, last in zip(motion.edges[:-1], motion.edges[1:], strict=True):
        sense = motion.sense[first]
        moved = sense * (motion.driver[first:last] - before)
        room = np.minimum.accumulate((rising if sense > 0 else falling) - moved)
        deflection[first:last] = sense * (moved + np.minimum(sense * here, room))
        here, before = deflection[last - 1], motion.driver[last - 1]
    return zero + _dead_zone(deflection, half_gap) / compliance


_START = Parameter('start', 'm', (0.0,), -np.inf)
_COMPLIANCE = Parameter('compliance', 'm/N', (0.03, 0.08, 0.2, 0.5), 1e-15)
_GAP_AND_ZERO = (Parameter('half_gap', 'm', (0.01, 0.03, 0.08, 0.2)), Parameter('force_zero', 'N', (0.0,), -np.inf))
_LAW6 = (Parameter('zero', 'm', (-0.4, -0.2, 0.0, 0.2, 0.4), -np.inf), _COMPLIANCE, *_GAP_AND_ZERO)
_SLIPS = (Parameter('slip_positive', 'N', (0.7, 1.1)), Parameter('slip_negative', 'N', (0.7, 1.1)))
BACKLASH = Law('backlash', 'backlash', 'law (6): slope and gap', '', _LAW6, _spring)
MOTION_LAWS = (
    Law(
        'softening',
        'softening',
        'softening spring',
        'a softening spring: the stiffness decreases with the load',
        (*_LAW6, *_SLIPS),
        _softening,
    ),
    Law(
        'viscous',
        'viscous',
        'damper in parallel',
        'viscous damping in parallel: a {load} proportional to the speed',
        (*_LAW6, Parameter('damping', 'N·s/m', (0.05, 0.5), -np.inf)),
        _viscous,
    ),
    Law(
        'friction',
        'friction',
        'friction in parallel',
        'Coulomb friction in parallel: the {load} jumps with the sense of motion',
        (*_LAW6, Parameter('friction', 'N', (0.05, 0.5))),
        _friction,
    ),
    Law(
        'slip_no_gap',
        'slip',
        'slip in series, no gap',
        'Coulomb friction in series, without a gap: the joint slips at a limit of the {load}',
        (_START, _COMPLIANCE, *_SLIPS),
        _slip,
    ),
    Law(
        'slip',
        'slip',
        'slip in series',
        'Coulomb friction in series: the joint slips at a limit of the {load}',
        (_START, _COMPLIANCE, *_GAP_AND_ZERO, *_SLIPS),
        _slip,
    ),
)
"""Laws that are compared with law (6) where the motion drives."""

_BAND = 4.0
"""Loads below so many of their standard deviations at rest have no certain sign."""


def _basis(*functions: Callable[[LoadPath, Values], Floats]) -> Callable[[LoadPath, Values], Floats]:
    """The functions side by side, (n, k)."""
    return lambda path, values: path.direction * np.stack([each(path, values) for each in functions], axis=1)


def _load(path: LoadPath, values: Values) -> Floats:
    return path.load


def _sign(path: LoadPath, values: Values, band: float = _BAND) -> Floats:
    return path.sign(band)


def _last_sign(path: LoadPath, values: Values, band: float = _BAND) -> Floats:
    return path.last_sign(band, values['state'])


def _slipping(path: LoadPath, values: Values) -> Floats:
    return path.play_operator(values['slip_load'], values['state'])


def _elastic(path: LoadPath, values: Values) -> Floats:
    """The load that friction in parallel leaves to the spring."""
    return path.play_operator(values['friction'], values['state'], values.get('friction_ratio', 0.0))


def _rounded_sign(path: LoadPath, values: Values) -> Floats:
    elastic = _elastic(path, values)
    return elastic / np.hypot(elastic, values['rounding'])


def _slipping_later(path: LoadPath, values: Values) -> Floats:
    return path.play_operator(values['slip_load'] + values['further_load'], values['state'])


_SLOPE, _HALF_GAP = Parameter('compliance', 'm/N'), Parameter('half_gap', 'm')
_SLIP = Parameter('slip_compliance', 'm/N')
_SLIP_LOAD = Parameter('slip_load', 'N', (0.04, 0.1, 0.2, 0.35, 0.55, 0.8), most=3.0)
_FRICTION = Parameter('friction', 'N', (0.04, 0.1, 0.2, 0.35), most=3.0)
_ROUNDING = Parameter('rounding', 'N', (0.01, 0.03, 0.1), most=1.0)
LOAD_BACKLASH = BACKLASH._replace(parameters=(_SLOPE, _HALF_GAP), function=_basis(_load, _sign))
GAP = Law(
    'gap',
    'gap',
    'gap that keeps its place when unloaded',
    'a gap that keeps its place when unloaded: the joint stays where the load left it',
    (_SLOPE, _HALF_GAP),
    _basis(_load, _last_sign),
    True,
)
BACKLASH_FORMS = (
    LOAD_BACKLASH,
    *(LOAD_BACKLASH._replace(function=_basis(_load, partial(_sign, band=band))) for band in (2 * _BAND, 0.0)),
    LOAD_BACKLASH._replace(function=_basis(_load, lambda path, values: path.sign_as_given())),
)
"""Law (6) says nothing of a joint without load; what these records show of it there decides between the forms."""
GAP_FORMS = (
    GAP,
    *(GAP._replace(function=_basis(_load, partial(_last_sign, band=band))) for band in (2 * _BAND, 4 * _BAND)),
)
"""The same for the largest load that counts as none."""
LOAD_LAWS = (
    Law(
        'friction',
        'friction',
        'friction in parallel',
        'friction in parallel with the spring: it holds part of the load in either sense',
        (_SLOPE, _HALF_GAP, _FRICTION, _ROUNDING),
        _basis(_elastic, _rounded_sign),
        True,
    ),
    Law(
        'load_friction',
        'load_friction',
        'friction in parallel that grows with the load',
        'friction in parallel with the spring that grows with the load',
        (
            _SLOPE,
            _HALF_GAP,
            _FRICTION,
            Parameter('friction_ratio', '1', (0.1, 0.3, 0.5), most=LARGEST_RATIO),
            _ROUNDING,
        ),
        _basis(_elastic, _rounded_sign),
        True,
    ),
    Law(
        'slip',
        'slip',
        'slip in series with memory',
        'slip in series with memory: part of the compliance slips under load and stays when the load has gone',
        (_SLOPE, _SLIP, _SLIP_LOAD),
        _basis(_load, _slipping),
        True,
    ),
    Law(
        'slips',
        'slip',
        'two slips in series with memory',
        'slip in series with memory: part of the compliance slips under load and stays when the load has gone',
        (
            _SLOPE,
            _SLIP,
            Parameter('further_compliance', 'm/N'),
            _SLIP_LOAD,
            Parameter('further_load', 'N', (0.1, 0.3, 0.6), most=3.0),
        ),
        _basis(_load, _slipping, _slipping_later),
        True,
    ),
)
"""Laws that are compared with law (6) where the load drives, beside `GAP`."""

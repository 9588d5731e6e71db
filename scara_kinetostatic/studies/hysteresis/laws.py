"""Laws of the force along a motion: law (6) of the paper, candidates that extend it, and simulated records of them.

Law (6), q - q* = p c + g sign(c), solved for the force is a spring with a dead zone: with the deflection u,

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
- reset: law (6) with u set by the measured force at every reversal. Not a candidate, since it uses the measured force;
  it shows whether law (6) fails only because of a wrong zero.

Simulated records have the motion of the measured loops, a sine whose amplitude increases from cycle to cycle, and noise
with a correlation r^k over k samples.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.hysteresis.motion import Motion, cut_at_reversals

Values = Mapping[str, float]

_INSIDE = 0.02
"""Share of the force range below which the first reading may be anywhere in the gap."""


class Parameter(NamedTuple):
    """A parameter of a law.

    Attributes:
        name: key.
        unit: SI.
        least: lower bound.
        starting_values: for fits, in units of the range of the data.
    """

    name: str
    unit: str
    least: float
    starting_values: tuple[float, ...]


class Law(NamedTuple):
    """A law of the force.

    Attributes:
        name: key.
        title: in words.
        parameters: what is fitted.
        force: along the motion, (n,), N.
    """

    name: str
    title: str
    parameters: tuple[Parameter, ...]
    force: Callable[[Values, Motion], Floats]

    def starts(self, motion: Motion) -> list[dict[str, float]]:
        """Every combination of starting values, SI."""
        names = [each.name for each in self.parameters]
        starting_values = [[_size(each, motion) * part for part in each.starting_values] for each in self.parameters]
        return [dict(zip(names, values, strict=True)) for values in product(*starting_values)]

    def scales(self, motion: Motion) -> Floats:
        """Scale of each parameter in the optimisation, SI."""
        return np.array(
            [_size(each, motion) * max(0.01, min(map(abs, each.starting_values))) for each in self.parameters]
        )


def _size(parameter: Parameter, motion: Motion) -> float:
    """Range of the data in the unit of a parameter."""
    length, force = motion.travel, motion.force_range / 2
    speed = float(np.abs(motion.speed).max())
    sizes = {'m': length, 'N': force, 'm/N': length / force, 'Ns/m': force / speed, '': 1.0}
    return sizes[parameter.unit]


_ZERO = Parameter('zero', 'm', -np.inf, (-0.4, -0.2, 0.0, 0.2, 0.4))
_START = Parameter('start', 'm', -np.inf, (0.0,))
_COMPLIANCE = Parameter('compliance', 'm/N', 1e-15, (0.03, 0.08, 0.2, 0.5))
_HALF_GAP = Parameter('half_gap', 'm', 0.0, (0.01, 0.03, 0.08, 0.2))
_SENSOR = Parameter('force_zero', 'N', -np.inf, (0.0,))
_SLIPS = tuple(Parameter(name, 'N', 0.0, (0.7, 1.1)) for name in ('slip_positive', 'slip_negative'))


def _dead_zone(deflection: Floats, half_gap: float) -> Floats:
    """dz(u; g), m."""
    return np.asarray(np.sign(deflection) * np.maximum(np.abs(deflection) - half_gap, 0.0))


def _backlash(values: Values, motion: Motion) -> Floats:
    deflection = motion.displacement - motion.displacement.mean() - values['zero']
    return values['force_zero'] + _dead_zone(deflection, values['half_gap']) / values['compliance']


def _softening(values: Values, motion: Motion) -> Floats:
    force = _backlash(values, motion) - values['force_zero']
    top = np.where(force > 0, values['slip_positive'], values['slip_negative']) + 1e-9 * motion.force_range
    return np.asarray(values['force_zero'] + top * np.tanh(force / top))


def _viscous(values: Values, motion: Motion) -> Floats:
    return _backlash(values, motion) + values['damping'] * motion.speed


def _friction(values: Values, motion: Motion) -> Floats:
    return _backlash(values, motion) + values['friction'] * motion.sense


def _slip(values: Values, motion: Motion) -> Floats:
    compliance, half_gap, zero = values['compliance'], values.get('half_gap', 0.0), values.get('force_zero', 0.0)
    bounds = {
        sign: sign * (half_gap + compliance * values[f'slip_{sense}'])
        for sign, sense in ((1, 'positive'), (-1, 'negative'))
    }
    deflection = np.empty(len(motion))
    here = _state(motion.force[0] - zero, values, motion) + values['start']
    before = motion.displacement[0]
    for k, first in enumerate(motion.edges[:-1]):
        rows = slice(first, motion.edges[k + 1])
        sense = motion.sense[first]
        moved = sense * (motion.displacement[rows] - before)
        room = np.minimum.accumulate(sense * bounds[int(sense)] - moved)
        deflection[rows] = sense * (moved + np.minimum(sense * here, room))
        here, before = deflection[rows.stop - 1], motion.displacement[rows.stop - 1]
    return zero + _dead_zone(deflection, half_gap) / compliance


def _reset(values: Values, motion: Motion) -> Floats:
    moved = motion.displacement - motion.displacement[motion.begins][motion.sweep]
    here = np.array([_state(motion.force[k] - values['force_zero'], values, motion) for k in motion.begins])
    return values['force_zero'] + _dead_zone(here[motion.sweep] + moved, values['half_gap']) / values['compliance']


def _state(force: float, values: Values, motion: Motion) -> float:
    """The deflection at a spring force, m; interpolated across the gap where the force is small."""
    place = min(max(force / (_INSIDE * motion.force_range), -1.0), 1.0)
    return force * values['compliance'] + place * values.get('half_gap', 0.0)


_LAW6 = (_ZERO, _COMPLIANCE, _HALF_GAP, _SENSOR)
BACKLASH = Law('backlash', 'law (6): slope and gap', _LAW6, _backlash)
SOFTENING = Law('softening', 'softening spring', (*_LAW6, *_SLIPS), _softening)
VISCOUS = Law('viscous', 'damper in parallel', (*_LAW6, Parameter('damping', 'Ns/m', -np.inf, (0.05, 0.5))), _viscous)
FRICTION = Law('friction', 'friction in parallel', (*_LAW6, Parameter('friction', 'N', 0.0, (0.05, 0.5))), _friction)
SLIP_NO_GAP = Law('slip_no_gap', 'slip in series, no gap', (_START, _COMPLIANCE, *_SLIPS), _slip)
SLIP = Law('slip', 'slip in series', (_START, _COMPLIANCE, _HALF_GAP, _SENSOR, *_SLIPS), _slip)
RESET = Law('reset', 'law (6), reset at every reversal', _LAW6[1:], _reset)
CANDIDATES = (SOFTENING, VISCOUS, FRICTION, SLIP_NO_GAP, SLIP)
"""Laws that are compared with law (6)."""


_AMPLITUDE, _PERIOD = 0.02, 2.0
"""Of the simulated motion, m and s."""
_GROWN, _FIRST = 2, 0.4
"""Cycles after which the amplitude is reached, and the share of it at the start."""


def sine(samples: int = 640, cycles: int = 5) -> tuple[Floats, Floats]:
    """Time (s) and displacement (m) of the simulated motion, each (samples,)."""
    time = np.linspace(0, _PERIOD * cycles, samples)
    size = np.minimum(_FIRST + (1 - _FIRST) * time / (_GROWN * _PERIOD), 1.0)
    return time, _AMPLITUDE * size * np.sin(2 * np.pi * time / _PERIOD)


def simulate_record(law: Law, values: Values, noise: float, seed: int, correlation: float = 0.0) -> Motion:
    """Simulated record of a law.

    Args:
        law: the law.
        values: its parameters, SI.
        noise: standard deviation of the force readings, N.
        seed: of the noise.
        correlation: of the noise from one sample to the next.
    """
    time, displacement = sine()
    rest = np.zeros(len(time))
    rest[-1] = 1.0  # no record has a constant force
    motion = cut_at_reversals(time, displacement, rest)
    force = law.force(values, motion)
    white = np.random.default_rng(seed).standard_normal(len(force))
    white[1:] *= np.sqrt(1 - correlation**2)
    return cut_at_reversals(
        motion.time, motion.displacement, force + noise * lfilter([1.0], [1.0, -correlation], white)
    )

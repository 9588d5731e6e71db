"""Laws of the response to a load: law (6) of the paper, and candidates with memory.

With the load τ counted from rest, a law is

    y = z + s Σ_i a_i B_i(τ; θ, h),        a_i ≥ 0,

z the response at no load, s = ±1 the direction of the response to a positive load, B_i functions of the load up to now.
The amplitudes a_i and the shape parameters θ are common to all records; z and the initial state of friction h, from -1
to 1, are each record's own: they depend on what happened before it. Functions:

- backlash, law (6): τ, and sign(τ), linear within the scatter of the load at rest or not; no memory.
- gap, law (6) as well: τ, and the sign that the load had last: an unloaded joint may stay where the load left it.
- softening: law (6) with |τ| τ: the compliance increases with the load.
- friction: a spring with Coulomb friction in parallel, the play operator P_r(τ) alone.
- slip: τ and P_r(τ): a spring in series with such a spring with friction. Up to a load change of 2 r from the last
  reversal it is elastic, from there on it slips, and stays when the load goes.
- slips: τ and two of them, of half widths r and r + Δr, that begin in the same state.
- jump: slip that jumps, to a share of r, when it begins.
- creep: law (6) with a lag of first order in the load.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.hysteresis.load_driven.load_path import LoadPath

Shape = tuple[float, ...]
"""Values of the shape parameters of a law."""
STATES = tuple(np.linspace(-1.0, 1.0, 21).tolist())
"""Initial states of friction from which a fit starts."""


class Amplitude(NamedTuple):
    """An amplitude: its name and how its unit is made, with {y} and {l} for the units of response and load."""

    name: str
    unit: str


class ShapeParameter(NamedTuple):
    """A shape parameter.

    Attributes:
        name: key.
        unit: {l} the unit of the load, s or 1.
        starting_values: where fits start; of a load in units of its largest value.
        is_load: whether it scales with the load.
        most: upper bound, in the same unit as the starting values.
    """

    name: str
    unit: str
    starting_values: tuple[float, ...]
    is_load: bool = True
    most: float = 3.0


class Law(NamedTuple):
    """A law of the response.

    Attributes:
        name: key.
        title: in words.
        family: name of the physical effect; laws of one family are forms of the same effect.
        amplitudes: linear parameters, not negative.
        shape: the other parameters.
        has_state: whether it has an initial state of friction.
        functions: B, (n, k), for a path, shape parameters and a state.
    """

    name: str
    title: str
    family: str
    amplitudes: tuple[Amplitude, ...]
    shape: tuple[ShapeParameter, ...]
    has_state: bool
    functions: Callable[[LoadPath, Shape, float], tuple[Floats, ...]]

    @property
    def states(self) -> tuple[float, ...]:
        """Initial states from which a fit starts."""
        return STATES if self.has_state else (0.0,)

    @property
    def names(self) -> tuple[str, ...]:
        """Of all common parameters, amplitudes first."""
        return (*(each.name for each in self.amplitudes), *(each.name for each in self.shape))

    @property
    def units(self) -> tuple[str, ...]:
        """Of all common parameters."""
        return (*(each.unit for each in self.amplitudes), *(each.unit for each in self.shape))

    def basis(self, path: LoadPath, shape: Shape, state: float) -> Floats:
        """B, (n, k)."""
        return np.stack(self.functions(path, shape, state), axis=1)


_COMPLIANCE = Amplitude('compliance', '{y}/{l}')
_HALF_GAP = Amplitude('half_gap', '{y}')
_SLIP = Amplitude('slip_compliance', '{y}/{l}')
_SLIP_LOAD = ShapeParameter('slip_load', '{l}', (0.04, 0.1, 0.2, 0.35, 0.55, 0.8))
_FURTHER = ShapeParameter('further_load', '{l}', (0.1, 0.3, 0.6))
_KINETIC = ShapeParameter('kinetic_share', '1', (0.3, 0.6, 0.85), is_load=False, most=1.0)
_TIME = ShapeParameter('time_constant', 's', (0.3, 1.0, 3.0, 10.0, 30.0), is_load=False, most=100.0)

_BAND = 4.0
"""Loads below so many of their standard deviations at rest have no certain sign."""


def _backlash(path: LoadPath, shape: Shape, state: float) -> tuple[Floats, ...]:
    return path.load, path.sign(_BAND)


def _gap(path: LoadPath, shape: Shape, state: float) -> tuple[Floats, ...]:
    return path.load, path.last_sign(_BAND, state)


BACKLASH = Law('backlash', 'law (6): slope and gap', 'backlash', (_COMPLIANCE, _HALF_GAP), (), False, _backlash)
BACKLASH_FORMS = (
    BACKLASH,
    BACKLASH._replace(functions=lambda path, shape, state: (path.load, path.sign(2 * _BAND))),
    BACKLASH._replace(functions=lambda path, shape, state: (path.load, path.sign(0.0))),
    BACKLASH._replace(functions=lambda path, shape, state: (path.load, path.sign_as_given())),
)
"""Law (6) says nothing of a joint without load; what these records show of it there decides between the forms."""
GAP = Law('gap', 'gap that keeps its place when unloaded', 'gap', (_COMPLIANCE, _HALF_GAP), (), True, _gap)
GAP_FORMS = (
    GAP,
    GAP._replace(functions=lambda path, shape, state: (path.load, path.last_sign(2 * _BAND, state))),
    GAP._replace(functions=lambda path, shape, state: (path.load, path.last_sign(4 * _BAND, state))),
)
"""The same for the largest load that counts as none."""
SOFTENING = Law(
    name='softening',
    title='softening spring',
    family='softening',
    amplitudes=(_COMPLIANCE, _HALF_GAP, Amplitude('softening', '{y}/{l}²')),
    shape=(),
    has_state=False,
    functions=lambda path, shape, state: (path.load, path.sign(_BAND), path.load * np.abs(path.load)),
)
FRICTION = Law(
    name='friction',
    title='friction in parallel',
    family='friction',
    amplitudes=(_COMPLIANCE,),
    shape=(_SLIP_LOAD._replace(name='friction'),),
    has_state=True,
    functions=lambda path, shape, state: (path.play_operator(shape[0], state),),
)
SLIP = Law(
    name='slip',
    title='slip in series with memory',
    family='slip',
    amplitudes=(_COMPLIANCE, _SLIP),
    shape=(_SLIP_LOAD,),
    has_state=True,
    functions=lambda path, shape, state: (path.load, path.play_operator(shape[0], state)),
)
SLIPS = Law(
    name='slips',
    title='two slips in series with memory',
    family='slip',
    amplitudes=(_COMPLIANCE, _SLIP, Amplitude('further_compliance', '{y}/{l}')),
    shape=(_SLIP_LOAD, _FURTHER),
    has_state=True,
    functions=lambda path, shape, state: (
        path.load,
        path.play_operator(shape[0], state),
        path.play_operator(shape[0] + shape[1], state),
    ),
)
JUMP = Law(
    name='jump',
    title='slip in series that jumps',
    family='slip',
    amplitudes=(_COMPLIANCE, _SLIP),
    shape=(_SLIP_LOAD, _KINETIC),
    has_state=True,
    functions=lambda path, shape, state: (path.load, path.jumping_play_operator(shape[0], shape[1], state)),
)
CREEP = Law(
    name='creep',
    title='creep',
    family='creep',
    amplitudes=(_COMPLIANCE, _HALF_GAP, Amplitude('creep_compliance', '{y}/{l}')),
    shape=(_TIME,),
    has_state=False,
    functions=lambda path, shape, state: (path.load, path.sign(_BAND), path.lag(shape[0])),
)
CANDIDATES = (SOFTENING, FRICTION, SLIP, SLIPS, JUMP, CREEP)
"""Laws that are compared with law (6), beside `GAP`; within a family the simplest first."""

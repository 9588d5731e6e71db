"""The parameters L̄ of the base model (table 1): names, units, order, values."""

from __future__ import annotations

from cmath import rect
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import read_only

_TABLE = (
    ('x0', 'm', 'base offset along x'),
    ('y0', 'm', 'base offset along y'),
    ('theta1', 'rad', 'offset of joint 1'),
    ('l1', 'm', 'length of link 1'),
    ('theta2', 'rad', 'offset of joint 2'),
    ('l2', 'm', 'length of link 2'),
    ('p_ee', 'm/N', 'compliance of the gripper'),
    ('p1', 'rad/Nm', 'compliance of joint 1'),
    ('p2', 'rad/Nm', 'compliance of joint 2'),
    ('g_ee', 'm', 'backlash of the gripper, half the gap'),
    ('g1', 'rad', 'backlash of joint 1, half the gap'),
    ('g2', 'rad', 'backlash of joint 2, half the gap'),
    ('s1', 'kg m', 'static moment about joint 1, with joint 2 and beyond at the elbow'),
    ('s2', 'kg m', 'static moment about joint 2'),
)
UNITS = {name: unit for name, unit, _ in _TABLE}
MOMENTS = ('s1', 's2')
"""Those that an arm has besides where gravity loads it in its plane."""
NAMES = tuple(name for name in UNITS if name not in MOMENTS)
"""Those of every arm."""
DESCRIPTIONS = {name: description for name, _, description in _TABLE}
LEVEL = (0.0, 0.0)
"""Gravity in the plane of an arm that does not stand upright."""
MOST_GRAVITY = 25.0
"""m/s², about that of Jupiter: no arm has to hold more."""
MILLI, MICRO, NANO = 1e-3, 1e-6, 1e-9
"""Of a unit."""
_LINK, _COMPLIANCE = 0.33, 1e-5
"""Of the nominal robot of table 1, m, and m/N or rad/Nm."""
X0, Y0, THETA1, L1, THETA2, L2, P_EE, P1, P2, G_EE, G1, G2 = range(len(NAMES))


@dataclass(frozen=True)
class Parameters:
    """One set of values of L̄ = [L, L_c, L_g] (4), SI units, in the order of table 1.

    Where `gravity` is not zero, the static moments `s1` and `s2` (kg m) are parameters, too: `names` has 14 then. Their
    centres of mass lie in the directions of the links, turned by `phi1` and `phi2` (rad), which are known.

    Estimates may be negative where noise makes them so; those of a real robot are not, see `check_physical`.

    Raises:
        ParameterError: a value is not a finite number, or gravity is larger than `MOST_GRAVITY`.
    """

    x0: float = 0.0
    y0: float = 0.0
    theta1: float = 0.0
    l1: float = _LINK
    theta2: float = 0.0
    l2: float = _LINK
    p_ee: float = _COMPLIANCE
    p1: float = _COMPLIANCE
    p2: float = _COMPLIANCE
    g_ee: float = 0.0
    g1: float = 0.0
    g2: float = 0.0
    s1: float = 0.0
    s2: float = 0.0
    gravity: tuple[float, float] = LEVEL
    phi1: float = 0.0
    phi2: float = 0.0

    def __post_init__(self) -> None:
        for name in self.names:
            value = getattr(self, name)
            if type(value) is float and isfinite(value):  # as nearly always
                continue
            if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
                raise ParameterError(name, f'expected a number, got {value!r}')
            if not isfinite(value):
                raise ParameterError(name, f'expected a finite number, got {value}')
            object.__setattr__(self, name, float(value))
        if self.gravity is LEVEL:
            return
        try:
            gx, gy = map(float, self.gravity)
        except (TypeError, ValueError):
            problem = f'expected two numbers, got {self.gravity!r}'
            raise ParameterError('gravity', problem, 'give (0.0, -9.81)') from None
        if not (gx * gx + gy * gy) ** 0.5 <= MOST_GRAVITY:
            problem = f'expected at most {MOST_GRAVITY:g} m/s² in size, got {(gx, gy)}'
            raise ParameterError('gravity', problem, 'give it in m/s²: (0.0, -9.81)')
        object.__setattr__(self, 'gravity', (gx + 0.0, gy + 0.0))

    @classmethod
    def from_array(cls, values: ArrayLike) -> Parameters:
        """From the 12 values in the order of `NAMES`."""
        return cls(*np.asarray(values, dtype=float).tolist())

    @classmethod
    def from_mapping(cls, values: Mapping[str, float], where: str = 'parameters') -> Parameters:
        """From a mapping that names every parameter once.

        Raises:
            ParameterError: a name is missing or unknown, or a value is no finite number.
        """
        wrong = sorted(set(NAMES) ^ set(values), key=str)
        if wrong:
            problem = 'unknown parameter' if wrong[0] in values else 'missing parameter'
            raise ParameterError(where, f'{problem} {wrong[0]!r}', f'give all of {" ".join(NAMES)}')
        return cls.from_array([values[name] for name in NAMES])

    @property
    def has_gravity(self) -> bool:
        """Whether gravity loads the joints."""
        return self.gravity != LEVEL

    @property
    def names(self) -> tuple[str, ...]:
        """`NAMES`, and `MOMENTS` where gravity loads the joints."""
        return NAMES + MOMENTS if self.has_gravity else NAMES

    @property
    def gravity_of_links(self) -> tuple[complex, complex]:
        """Gravity as it acts on moments along the links, g exp(-i phi) of each, complex, m/s²."""
        gravity = complex(*self.gravity)
        return gravity * rect(1.0, -self.phi1), gravity * rect(1.0, -self.phi2)

    def with_array(self, values: ArrayLike) -> Parameters:
        """Other values in the order of `names`, under the same gravity."""
        found = np.asarray(values, dtype=float).tolist()
        made = Parameters(*found)
        return replace(made, gravity=self.gravity, phi1=self.phi1, phi2=self.phi2) if self.has_gravity else made

    def as_array(self) -> NDArray[np.float64]:
        """The values in the order of `names`, (12,) or (14,)."""
        return np.array([getattr(self, name) for name in self.names])

    def as_dict(self) -> dict[str, float]:
        """The values by name, in the order of `names`."""
        return {name: getattr(self, name) for name in self.names}

    @cached_property
    def joint_compliances(self) -> NDArray[np.float64]:
        """p1 and p2, (2, 1), rad/Nm."""
        return read_only(np.array([[self.p1], [self.p2]]))

    @cached_property
    def joint_backlashes(self) -> NDArray[np.float64]:
        """g1 and g2, (2, 1), rad."""
        return read_only(np.array([[self.g1], [self.g2]]))

    def replace(self, **changes: Any) -> Parameters:
        """The same with some values changed."""
        return replace(self, **changes)

    def check_physical(self, where: str = 'parameters') -> None:
        """Whether a robot can have these values.

        Raises:
            ParameterError: a link of no length, a negative compliance or backlash, no compliance at all.
        """
        for name in ('l1', 'l2'):
            if getattr(self, name) <= 0:
                raise ParameterError(f'{where}: {name}', f'expected a positive length, got {getattr(self, name)}')
        if self.p_ee == self.p1 == self.p2 == 0:
            raise ParameterError(
                f'{where}: p_ee, p1, p2', 'all compliances are 0: a rigid arm has no force of contact', 'estimate them'
            )
        for name in ('p_ee', 'p1', 'p2', 'g_ee', 'g1', 'g2'):
            if getattr(self, name) < 0:
                raise ParameterError(f'{where}: {name}', f'expected a value of 0 or more, got {getattr(self, name)}')


PAPER_NOMINAL = Parameters()
"""L̄n of table 1."""

PAPER_ACTUAL = Parameters(2.5e-3, -2.2e-3, -1.7e-3, 0.3302, 7.0e-4, 0.3298, g_ee=9.5e-5).replace(
    **dict.fromkeys(('p_ee', 'p1', 'p2'), 1.1e-5), **dict.fromkeys(('g1', 'g2'), 2.9e-4)
)
"""L̄a, the "actual" values of table 2."""

PAPER_MEASURED = PAPER_ACTUAL.replace(p_ee=3.76e-5, p1=3.23e-5, p2=1.08e-4, g_ee=1.299e-4, g1=2.64e-4, g2=2.68e-4)
"""Compliances and backlashes measured on the real robot, figure 4(d).

The geometry is that of table 2, since the paper measured none; g_ee is the
middle of the measured range 5.49e-5 … 2.05e-4 m. The values are taken as they stand; read as whole
gaps, as section 5.2 describes them, g of (6) and (7) would be half of them.
"""

IN_MILLI, IN_MICRO = 1e3, 1e6
"""By these a quantity is in the unit with the prefix; MILLI and MICRO are their inverses."""

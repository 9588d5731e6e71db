"""The parameters L̄ of the base model (table 1): names, units, order, values; and quantities as text: unit prefix by
size, digits by uncertainty.
"""

from __future__ import annotations

from cmath import rect
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import floor, inf, isfinite, isnan, log10, pi
from typing import Any, NamedTuple

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
_LARGEST = {'m': 100.0, 'rad': 2 * pi, 'm/N': 1.0, 'rad/Nm': 1.0, 'kg m': 1e4}
"""Largest plausible size of a number by its unit."""
LEVEL = (0.0, 0.0)
"""Gravity in the plane of an arm that does not stand upright."""
MOST_GRAVITY = 25.0
"""m/s², about that of Jupiter: no arm has to hold more."""
MILLI, MICRO, NANO = 1e-3, 1e-6, 1e-9
"""Of a unit."""
_LINK, _COMPLIANCE = 0.33, 1e-5
"""Of the nominal robot of table 1, m, and m/N or rad/Nm."""
X0, Y0, THETA1, L1, THETA2, L2, P_EE, P1, P2, G_EE, G1, G2 = range(len(NAMES))


def implausible_size(value: float, unit: str) -> tuple[str, str] | None:
    """Problem and remedy where a number is too large for its unit, as one in mm or degrees; None where it is not."""
    if abs(value) <= _LARGEST.get(unit, inf):
        return None
    problem = f'expected at most {_LARGEST[unit]:.4g} {unit} in size, got {value!r}'
    hints = {'m': 'lengths are in m, not mm', 'rad': 'angles are in rad, not degrees'}
    return problem, hints.get(unit, 'give it in SI units')


def quantity(value: float, unit: str) -> str:
    """A value in SI units with a prefix that fits: `943 µm`, `-12 µm/N`, `3.1 mm`; a small pure number: `30 ppm`."""
    prefixes: tuple[tuple[str, float], ...] = (('', 1.0), ('m', MILLI), ('µ', MICRO))
    if unit.startswith('1'):  # a pure number, or one per something
        small = abs(value) < MILLI
        prefixes = (('ppm', MICRO),) if small else (('', 1.0),)
        unit = unit[1:] if small or unit == '1' else unit
    prefix, factor = next(((p, f) for p, f in prefixes if abs(value) >= f), prefixes[-1])
    size = value / factor
    return (f'{size:.2g} {prefix}{unit}' if abs(size) < 99.5 else f'{size:.0f} {prefix}{unit}').rstrip()


def percentage(part: float, digits: str = '.0f') -> str:
    """A part of a whole: `50 %`."""
    return f'{100 * part:{digits}} %'


def displacement(x: float, y: float) -> str:
    """A displacement in words: `75 µm further in x, 38 µm less in y`."""
    return ', '.join(f'{off(value, "m", "further", "less")} in {axis}' for axis, value in (('x', x), ('y', y)))


def off(value: float, unit: str, above: str, below: str) -> str:
    """A difference in words, of which one says where it is above 0 and one where it is not: `75 µm larger`."""
    return f'{quantity(abs(value), unit)} {above if value > 0 else below}'


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
NOT_DETERMINED = '–'
"""Stands where a quantity is not determined."""
_LEAST_P = 1e-12
"""Of p-values below this only that is said."""


class Scale(NamedTuple):
    """A unit with a prefix, and how many of it one SI unit is."""

    unit: str
    per_si: float


SCALES = {name: Scale(unit, 1.0) if name in MOMENTS else Scale(f'µ{unit}', IN_MICRO) for name, unit in UNITS.items()}
SCALES |= {name: Scale(f'm{UNITS[name]}', IN_MILLI) for name in NAMES[:6]}
"""The unit in which each parameter of the base model is shown."""
FIT_UNITS = {'m': Scale('mm', IN_MILLI), 'rad': Scale('°', 180 / pi)}
"""Of shapes fitted to a contour, by SI unit."""


class Shown(NamedTuple):
    """A value with its standard deviation, ready to print; std empty where there is none."""

    value: str
    std: str
    unit: str

    @property
    def text(self) -> str:
        """All in one."""
        return ' '.join(part for part in (self.value, f'± {self.std}' if self.std else '', self.unit) if part)


_PREFIXES = (('', 1.0), ('m', IN_MILLI), ('µ', IN_MICRO), ('n', IN_MILLI * IN_MICRO), ('p', IN_MICRO**2))


def scale_of(size: float, unit: str) -> Scale:
    """The prefix that fits a quantity of this size, SI; a pure number below 1e-3 is in millionths."""
    if unit.partition('/')[0] in ('m', 'rad', 'N', 'Nm', 's') and size > 0:
        prefix, factor = next(((p, f) for p, f in _PREFIXES if size * f >= 1.0), _PREFIXES[-1])
        return Scale(prefix + unit, factor)
    if unit.partition('/')[0] == '1' and 0 < size * IN_MILLI < 1:
        return Scale(f'ppm{unit[1:]}', IN_MICRO)
    return Scale('' if unit == '1' else unit, 1.0)


def shown(value: float, std: float, unit: str, units: Mapping[str, Scale] | None = None) -> Shown:
    """A value in any SI unit with a prefix that fits, and the digits its uncertainty allows.

    Args:
        value: the value; NaN where the data do not determine it.
        std: its standard deviation; NaN or 0 where there is none.
        unit: of both, SI.
        units: by SI unit, what is shown in a fixed unit instead.
    """
    scale = (units or {}).get(unit) or scale_of(max(abs(value), std if isfinite(std) else 0.0), unit)
    if isnan(value):
        return Shown('not determined', '', '')
    digits = decimals(std * scale.per_si)
    if digits is None:
        return Shown(unsigned_zero(f'{value * scale.per_si:.3g}'), '', scale.unit)
    number, deviation = (f'{quantity * scale.per_si:.{digits}f}' for quantity in (value, std))
    return Shown(unsigned_zero(number), deviation, scale.unit)


def micrometres(metres: float) -> str:
    """An error or uncertainty of the tip, in µm."""
    size = IN_MICRO * metres
    if not isfinite(size):
        return NOT_DETERMINED
    return f'{size:#.3g}'.rstrip('.') if abs(size) < 999.5 else f'{size:.0f}'


def unsigned_zero(number: str) -> str:
    """A number as text without the sign of a zero: ``-0.0`` is ``0.0``."""
    return number if any(digit in number for digit in '123456789nf') else number.removeprefix('-').removeprefix('−')


def decimals(std: float) -> int | None:
    """How many decimals show two digits of a standard deviation; None where there is none, or it is of no size."""
    # 5e-12: a standard deviation below this, in the unit in which it is shown, is none
    if not isfinite(std) or std < 5e-12:
        return None
    return min(12, max(0, 1 - floor(log10(std))))


def chance(p_value: float) -> str:
    """A p-value in short."""
    return f'{p_value:.2g}' if p_value >= _LEAST_P else f'below {_LEAST_P:g}'


def p_equals(p_value: float) -> str:
    """A p-value with its sign, such as ``p = 0.02`` and ``p < 1e-12``."""
    return f'p = {chance(p_value)}' if p_value >= _LEAST_P else f'p < {_LEAST_P:g}'


def count(number: int, thing: str, things: str = '') -> str:
    """`1 touch`, `2 touches`."""
    return f'{number} {thing if number == 1 else things or thing + "s"}'


def rounded_down(seconds: float) -> str:
    """A time below a limit, s: not rounded up to it."""
    return f'{int(100 * seconds) / 100:.2f}'

"""Quantities as text: unit prefix by size, digits by uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from scara_kinetostatic.model.parameters import MOMENTS, NAMES, UNITS
from scara_kinetostatic.model.parameters import percentage as percentage

MILLI, MICRO, PERCENT = 1e3, 1e6, 100.0
"""Of the unit with the prefix, so many are one."""
NOT_DETERMINED = '–'
"""Stands where a quantity is not determined."""


_LEAST_P = 1e-12
"""Of p-values below this only that is said."""


class Scale(NamedTuple):
    """A unit with a prefix, and how many of it one SI unit is."""

    unit: str
    per_si: float


SCALES = {name: Scale(unit, 1.0) if name in MOMENTS else Scale(f'µ{unit}', MICRO) for name, unit in UNITS.items()}
SCALES |= {name: Scale(f'm{UNITS[name]}', MILLI) for name in NAMES[:6]}
"""The unit in which each parameter of the base model is shown."""
FIT_UNITS = {'m': Scale('mm', MILLI), 'rad': Scale('°', 180 / math.pi)}
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


_PREFIXES = (('', 1.0), ('m', MILLI), ('µ', MICRO), ('n', MILLI * MICRO), ('p', MICRO**2))


def scale_of(size: float, unit: str) -> Scale:
    """The prefix that fits a quantity of this size, SI; a pure number below 1e-3 is in millionths."""
    if unit.partition('/')[0] in ('m', 'rad', 'N', 'Nm', 's') and size > 0:
        prefix, factor = next(((p, f) for p, f in _PREFIXES if size * f >= 1.0), _PREFIXES[-1])
        return Scale(prefix + unit, factor)
    if unit.partition('/')[0] == '1' and 0 < size * MILLI < 1:
        return Scale(f'ppm{unit[1:]}', MICRO)
    return Scale('' if unit == '1' else unit, 1.0)


def shown(value: float, std: float, unit: str, units: Mapping[str, Scale] | None = None) -> Shown:
    """A value in any SI unit with a prefix that fits, and the digits its uncertainty allows.

    Args:
        value: the value; NaN where the data do not determine it.
        std: its standard deviation; NaN or 0 where there is none.
        unit: of both, SI.
        units: by SI unit, what is shown in a fixed unit instead.
    """
    scale = (units or {}).get(unit) or scale_of(max(abs(value), std if math.isfinite(std) else 0.0), unit)
    if math.isnan(value):
        return Shown('not determined', '', '')
    digits = decimals(std * scale.per_si)
    if digits is None:
        return Shown(unsigned_zero(f'{value * scale.per_si:.3g}'), '', scale.unit)
    number, deviation = (f'{quantity * scale.per_si:.{digits}f}' for quantity in (value, std))
    return Shown(unsigned_zero(number), deviation, scale.unit)


def micrometres(metres: float) -> str:
    """An error or uncertainty of the tip, in µm."""
    size = MICRO * metres
    if not math.isfinite(size):
        return NOT_DETERMINED
    return f'{size:#.3g}'.rstrip('.') if abs(size) < 999.5 else f'{size:.0f}'


def unsigned_zero(number: str) -> str:
    """A number as text without the sign of a zero: ``-0.0`` is ``0.0``."""
    return number if any(digit in number for digit in '123456789nf') else number.removeprefix('-').removeprefix('−')


def decimals(std: float) -> int | None:
    """How many decimals show two digits of a standard deviation; None where there is none, or it is of no size."""
    # 5e-12: a standard deviation below this, in the unit in which it is shown, is none
    if not math.isfinite(std) or std < 5e-12:
        return None
    return min(12, max(0, 1 - math.floor(math.log10(std))))


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

"""Quantities as text: unit prefix by size, digits by uncertainty; probabilities and counts."""

from __future__ import annotations

from collections.abc import Mapping
from math import floor, inf, isfinite, isnan, log10, pi
from typing import NamedTuple

from scara_kinetostatic.model.parameters import IN_MICRO, IN_MILLI, MICRO, MILLI, MOMENTS, NAMES, UNITS

_LARGEST = {'m': 100.0, 'rad': 2 * pi, 'm/N': 1.0, 'rad/Nm': 1.0, 'kg m': 1e4}
"""Largest plausible size of a number by its unit."""


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

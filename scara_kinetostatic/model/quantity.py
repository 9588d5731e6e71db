"""Quantities in a sentence."""

from __future__ import annotations

_PREFIXES = (('', 1.0), ('m', 1e3), ('µ', 1e6))


def quantity(value: float, unit: str) -> str:
    """A value in SI units with a prefix that fits: `943 µm`, `-12 µm/N`, `3.1 mm`."""
    prefix, factor = next(((p, f) for p, f in _PREFIXES if abs(value) * f >= 1.0), _PREFIXES[-1])
    size = value * factor
    return f'{size:.2g} {prefix}{unit}' if abs(size) < 100 else f'{size:.0f} {prefix}{unit}'


def displacement(x: float, y: float) -> str:
    """A displacement in words: `75 µm further in x, 38 µm less in y`."""
    return ', '.join(
        f'{quantity(abs(value), "m")} {"further" if value > 0 else "less"} in {axis}'
        for axis, value in (('x', x), ('y', y))
    )

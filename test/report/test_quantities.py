"""Numbers with their units and digits."""

from __future__ import annotations

import pytest

from scara_kinetostatic.report.quantities import decimals, shown


@pytest.mark.parametrize(
    ('std', 'expected'),
    [(0.0015, 4), (0.094, 3), (0.81, 2), (1.2, 1), (11, 0), (851, 0), (0, None), (1e-15, None), (float('nan'), None)],
)
def test_decimals(std: float, expected: int | None) -> None:
    assert decimals(std) == expected


@pytest.mark.parametrize(
    ('value', 'std', 'unit', 'expected'),
    [
        (5.19e-5, 1.07e-6, 'm', '51.9 ± 1.1 µm'),
        (17.3061, 0.0246, '1/turn', '17.306 ± 0.025 1/turn'),
        (9.82e-5, 1.6e-6, '1', '98.2 ± 1.6 ppm'),
        (0.0322, 0.0023, '1', '0.0322 ± 0.0023'),
        (-3e-8, 1e-9, 'rad/(Nm)^3', '-30.0 ± 1.0 nrad/(Nm)^3'),
        (2e-7, float('nan'), '1/s', '0.2 ppm/s'),
        (0.0, 0.0, 'm', '0 m'),
        (2.5, 0.31, 'Nm', '2.50 ± 0.31 Nm'),
        (-1e-8, 1e-6, 'm', '0.0 ± 1.0 µm'),
        (-0.0, 0.0, 'm', '0 m'),
        (2e-4, 1e-19, 'm', '200 µm'),
        (float('nan'), float('nan'), 'm', 'not determined'),
    ],
)
def test_values_of_any_unit(value: float, std: float, unit: str, expected: str) -> None:
    assert shown(value, std, unit).text == expected

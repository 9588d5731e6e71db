"""How well a cell is known: what its description says comes back, what is not valid is refused by its key."""

from __future__ import annotations

import pytest

from scara_kinetostatic.errors import CellError, ParameterError
from scara_kinetostatic.files.cell_file import dump_cell, parse_cell
from scara_kinetostatic.model.cell import (
    PAPER_CELL,
    ArmClass,
    Cell,
    Disc,
    EffectSizes,
    Plate,
    Region,
    SizeMode,
    Uncertainty,
    different_parts,
)
from scara_kinetostatic.model.parameters import PAPER_NOMINAL

DECLARED = """
plates:
  - {name: a, origin: [0.0, 0.3], uncertainty: {center: 1.0e-3, angle: 2.0e-3}}
uncertainty:
  radius: 5.0e-6
  force_gain: 0.005
  force_rotation: 1.0e-3
  nominal: {l1: 1.0e-3, l2: 1.0e-3}
tolerance: {tip: 5.0e-5}
region: {x: [-0.35, 0.35], y: [0.20, 0.55]}
tip: {radius: 0.005}
gravity: [0.0, 0.0]
"""
PLAIN = dump_cell(PAPER_CELL)
DISC_1 = 'center: [-0.25, 0.3], radius: 0.15}'
CONTRACT = (
    PLAIN.replace(DISC_1, f'{DISC_1[:-1]}, uncertainty: {{center: 1.5e-5, radius: 5.0e-6}}, plate: a}}') + DECLARED
)


def test_reads_what_is_declared() -> None:
    cell = parse_cell(CONTRACT)
    assert cell.discs[0] == Disc('disc_1', -0.25, 0.3, 0.15, center_std=1.5e-5, radius_std=5e-6, plate='a')
    assert cell.discs[1] == PAPER_CELL.discs[1]
    assert cell.plates == (Plate('a', 0.0, 0.3, center_std=1e-3, angle_std=2e-3),)
    assert cell.uncertainty == Uncertainty(5e-6, 0.005, 1e-3, {'l1': 1e-3, 'l2': 1e-3})
    assert (cell.tolerance, cell.tip_radius) == (5e-5, 0.005)
    assert cell.region == Region(-0.35, 0.35, 0.20, 0.55)
    assert parse_cell(dump_cell(cell)) == cell
    assert different_parts(cell, PAPER_CELL) == ['disc_1', 'plates', 'uncertainty', 'tolerance', 'region']


def test_a_plate_may_be_known_to_20_mm() -> None:
    assert parse_cell(CONTRACT.replace('center: 1.0e-3', 'center: 0.02')).plates[0].center_std == 0.02


def test_what_is_absent_is_exactly_known() -> None:
    cell = parse_cell(PLAIN)
    assert cell == PAPER_CELL
    assert cell.uncertainty == Uncertainty()
    assert dump_cell(cell) == PLAIN


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('plate: a', 'plate: b', "objects[0].plate: no plate is named 'b'; the plates are a"),
        ('radius: 5.0e-6}', 'radius: -5.0e-6}', 'objects[0].uncertainty.radius: expected 0 to 0.002 m, got -5e-06'),
        ('center: 1.5e-5', 'centre: 1.5e-5', "objects[0].uncertainty: unknown key 'centre'"),
        ('center: 1.0e-3', 'center: 0.03', 'plates[0].uncertainty.center: expected 0 to 0.02 m, got 0.03'),
        ('center: 1.5e-5', 'center: 0.015', 'objects[0].uncertainty.center: expected 0 to 0.002 m, got 0.015'),
        ('radius: 5.0e-6}', 'radius: 5.0}', 'expected 0 to 0.002 m, got 5; it is in m: 1.5e-5 for 15 µm'),
        ('  radius: 5.0e-6', '  radius: 0.005', 'uncertainty.radius: expected 0 to 0.002 m, got 0.005'),
        ('force_gain: 0.005', 'force_gain: 0.5', 'expected 0 to 0.2, got 0.5; it is a part of 1: 0.005 for 0.5 %'),
        ('tip: 5.0e-5', 'tip: 50', 'tip: expected above 0, at most 0.005 m, got 50; give it in m: 5.0e-5 for 50'),
        ('l2: 1.0e-3}', 'l2: 0}', 'uncertainty.nominal.l2: expected a number above 0'),
        ('l2: 1.0e-3}', 'l3: 1.0e-3}', "uncertainty.nominal: unknown key 'l3'"),
        ('x: [-0.35, 0.35]', 'x: [0.35, -0.35]', 'region.x: expected the lower limit first, got [0.35, -0.35]'),
        (', y: [0.20, 0.55]', '', "region: the key 'y' is missing"),
        ('tip: 5.0e-5', 'tip: 0', 'tolerance.tip: expected above 0, at most'),
        ('gravity: [0.0, 0.0]', 'gravity: [0.0, -98.1]', 'gravity: expected at most 25 m/s²'),
    ],
)  # fmt: skip
def test_refuses_by_key(old: str, new: str, message: str) -> None:
    assert old in CONTRACT
    with pytest.raises(CellError) as caught:
        parse_cell(CONTRACT.replace(old, new))
    assert message in str(caught.value)


def test_a_cell_made_in_python_is_checked_alike() -> None:
    disc = Disc('pin', 0.3, 0.2, 0.05)
    for bad in (disc._replace(center_std=-1e-5), disc._replace(radius_std=float('nan')), disc._replace(plate='a')):
        with pytest.raises(ParameterError):
            Cell(PAPER_NOMINAL, (bad,))
    with pytest.raises(ParameterError):
        Cell(PAPER_NOMINAL, (disc,), tolerance=0.0)
    for wrong in ({'radius': -1.0}, {'nominal': {'l3': 1e-3}}, {'nominal': {'l1': 0.0}}):
        with pytest.raises(ParameterError):
            Uncertainty(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ('text', 'sizes'),
    [
        ('none', EffectSizes(SizeMode.NONE)),
        ('{sizes: none, base_compliance: 1.0e-7}', EffectSizes(SizeMode.NONE, stated={'base_compliance': 1e-7})),
        ('typical', EffectSizes(SizeMode.TYPICAL)),
        ('{sizes: estimated, arm: desktop}', EffectSizes(SizeMode.ESTIMATED, ArmClass.DESKTOP)),
        (
            '{sizes: typical, arm: printed, base_compliance: 2.0e-7, "transmission_error[joint1]": 0}',
            EffectSizes(
                SizeMode.TYPICAL, ArmClass.PRINTED, {'base_compliance': 2e-7, 'transmission_error[joint1]': 0.0}
            ),
        ),
    ],
)
def test_sizes_of_undetected_effects(text: str, sizes: EffectSizes) -> None:
    cell = parse_cell(f'{PLAIN}uncertainty: {{effects: {text}}}\n')
    assert cell.uncertainty.effects == sizes
    assert parse_cell(dump_cell(cell)) == cell


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('large', "uncertainty.effects: expected estimated or typical or none, got 'large'"),
        ('{sizes: none, arm: desktop}', 'uncertainty.effects.arm: has no meaning with sizes: none'),
        ('no', 'uncertainty.effects: expected estimated or typical or none'),
        ('{shift: 1.0e-5}', 'uncertainty.effects.shift: is a size in several units'),
        (
            '{sizes: typical, arm: wooden}',
            "uncertainty.effects.arm: expected industrial or desktop or printed, got 'wooden'",
        ),
        (
            '{base_complience: 1e-7}',
            "uncertainty.effects: unknown key 'base_complience'; did you mean 'base_compliance'?",
        ),
        ('{base_compliance: -1.0e-7}', 'uncertainty.effects.base_compliance: expected 0 to 1e-05, got -1e-07'),
        ('{base_compliance: 1.0}', 'uncertainty.effects.base_compliance: expected 0 to 1e-05, got 1'),
    ],
)
def test_refuses_sizes_of_undetected_effects(text: str, message: str) -> None:
    with pytest.raises(CellError) as caught:
        parse_cell(f'{PLAIN}uncertainty: {{effects: {text}}}\n')
    assert message in str(caught.value)

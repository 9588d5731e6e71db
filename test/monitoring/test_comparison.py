"""What `compare` says of two calibrations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from monitoring.simulated import CELL, DECLARED, TRUTH, moved, record_of, std_of, touches_of

from benchmark.common import record_of as as_record
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.effects.unnamed import Unnamed
from scara_kinetostatic.errors import InputError
from scara_kinetostatic.model.cell import Cell, Identification, Noise, Uncertainty
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.monitoring.comparison import compare, compare_records
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.monitoring.report import comparison_document, comparison_report
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.report.page import as_text
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches


def test_declared_errors_cancel(record: CalibrationRecord) -> None:
    later = record_of(DECLARED, 1, count=10)
    found = compare(record, later)
    independent = np.hypot(*(std_of(one, 'x0') for one in (record, later)))
    assert 0 < 2 * found.parameters[0].std < independent
    assert not found.has_changed
    other = replace(DECLARED, discs=tuple(disc._replace(x=disc.x + 1e-3) for disc in DECLARED.discs))
    elsewhere = compare(record, record_of(other, 1, world=1))
    assert elsewhere.parameters[0].std > 0.5 * independent


def test_p_values_and_z_without_a_change() -> None:
    cells = (CELL, DECLARED, replace(DECLARED, noise=None)) * 4
    pairs = [[record_of(cell, seed + k, world=k) for seed in (0, 100)] for k, cell in enumerate(cells)]
    changes = [compare(*pair) for pair in pairs]
    p = np.sort([change.p_value for change in changes])
    assert np.abs(p - (np.arange(12) + 0.5) / 12).max() < 0.5  # Kolmogorov: 1 of 1000
    z = np.array([[value.z for value in change.parameters] for change in changes])
    for k in range(3):
        assert 0.6 < np.sqrt(np.mean(z[k::3] ** 2)) < 1.4


@pytest.mark.parametrize(
    ('name', 'truth', 'effects'),
    [
        ('theta2', moved(theta2=1e-4), ()),
        ('l1', moved(l1=6e-5), ()),
        ('p1', moved(p1=TRUTH.p1), ()),
        ('g2', moved(g2=0.6 * TRUTH.g2), ()),
        ('base', moved(x0=1e-4, y0=-1e-4, theta1=1e-4), ()),
        ('object_position[disc_2]', TRUTH, ('object_position[disc_2]:x=5e-5,y=2e-5',)),
    ],
)
def test_the_part_that_moved_is_named(
    record: CalibrationRecord, name: str, truth: object, effects: tuple[str, ...]
) -> None:
    found = compare(record, record_of(DECLARED, 1, truth, effects))
    assert found.p_value < 1e-6
    assert found.causes.ranking[0].name == name
    if name in ('theta2', 'l1'):
        size = {'theta2': 1e-4, 'l1': 6e-5}[name]
        assert abs(found.causes.ranking[0].change[0] - size) < 4 * found.causes.ranking[0].std[0]


def test_what_is_not_determined_is_not_compared() -> None:
    plan = default_plan(CELL, 12, levels=(25.0,))
    sets = [simulate_touches(CELL, TRUTH, plan, seed=seed) for seed in range(2)]
    one_level = [as_record(calibrate(touches, CELL)) for touches in sets]
    found = compare(*one_level)
    stds = {p.name: p.std for p in found.parameters}
    assert np.isnan(stds['p_ee']) and np.isnan(stds['g_ee']) and stds['l1'] > 0
    assert 'p_ee, g_ee: not determined each by itself; compared only in combination, if at all' in found.notes
    assert found.degrees_of_freedom in (10, 11)  # each leaves out one combination, nearly the same
    mixed = compare(one_level[0], record_of(CELL, 5, world=None))
    assert mixed.degrees_of_freedom == 11 and mixed.p_value > 1e-3


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'nominal': CELL.nominal.replace(l1=0.4)}, 'another robot'),
        ({'identification': Identification(serial_number='2')}, "serial number '2'"),
    ],
)
def test_other_robots_are_refused(change: dict[str, object], words: str) -> None:
    one = record_of(replace(CELL, identification=Identification(serial_number='1')), 0, world=None)
    other = replace(one, arm=replace(one.arm, cell=replace(CELL, **change)))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=words):
        compare_records([one, other])
    with pytest.raises(InputError, match='two or more'):
        compare_records([one])


@pytest.mark.parametrize('cell', [CELL, DECLARED], ids=['exact', 'declared'])
@pytest.mark.parametrize('later', [True, False])
def test_an_effect_that_only_one_has_found_is_a_change(cell: Cell, later: bool) -> None:
    world, effect = None if cell is CELL else 0, 'object_position[disc_2]:x=1e-4,y=5e-5'
    plain = record_of(cell, 0, world=world)
    moved = _with_object_position(touches_of(cell, 1, effects=(effect,), world=world), cell)
    found = compare(plain, moved) if later else compare(moved, plain)
    assert found.p_value < 1e-12 and found.causes.ranking[0].name == 'object_position[disc_2]'
    assert found.only_after == (('object_position[disc_2]',) if later else ())
    x = {p.name: p for p in found.parameters}['object_position[disc_2].x']
    assert abs(x.change - (1e-4 if later else -1e-4)) < 4 * x.std < 4e-5
    tables = comparison_document([found])['changes'][0]['parameters']
    assert tables['l1']['from' if later else 'to'] == plain.arm.model.parameters.l1
    assert tables['object_position[disc_2].x']['from' if later else 'to'] is None
    assert 'object_position[disc_2].x' in as_text(comparison_report([found]))
    if cell is CELL:  # where it has not moved, the two models agree
        same = compare(plain, _with_object_position(touches_of(cell, 2, world=world), cell))
        assert same.p_value > 1e-3 and same.degrees_of_freedom == 14 and same.only_after


def _with_object_position(touches: TouchSet, cell: Cell) -> CalibrationRecord:
    return as_record(calibrate(touches, cell, (find(cell, 'object_position[disc_2]'),)))


def test_an_object_whose_description_was_corrected_has_not_moved() -> None:
    true = 'object_position[disc_2]:x=1e-4,y=5e-5'
    found = _with_object_position(touches_of(CELL, 1, effects=(true,), world=None), CELL)
    discs = [disc._replace(x=disc.x + 1e-4, y=disc.y + 5e-5) if disc.name == 'disc_2' else disc for disc in CELL.discs]
    corrected = record_of(replace(CELL, discs=(discs[2], discs[0], discs[1])), 2, world=None)
    for change in (compare(found, corrected), compare(corrected, found)):
        assert change.not_compared == ('object_position[disc_2]',) and change.p_value > 1e-3
        assert change.degrees_of_freedom == 12
    mixed = replace(CELL, discs=CELL.discs[::-1])
    moved = compare(found, record_of(mixed, 2, world=None))
    assert moved.causes.ranking[0].name == 'object_position[disc_2]' and moved.degrees_of_freedom == 14


def test_a_curve_that_only_one_has_is_compared() -> None:
    curve = Unnamed(target='disc_3', disc=2, channel='along', variable='direction')
    touches = touches_of(CELL, 1, world=None, count=18)
    curved, mixed = as_record(calibrate(touches, CELL, (curve,))), replace(CELL, discs=CELL.discs[::-1])
    plain = record_of(mixed, 2, world=None)
    for change in (compare(curved, plain), compare(plain, curved)):
        assert (*change.only_before, *change.only_after) == (curve.label,)
        assert change.p_value > 1e-3 and change.degrees_of_freedom > 12


def test_without_common_errors_a_change_is_the_difference_of_two_fits() -> None:
    one, other = (record_of(CELL, seed, moved(l1=2e-5 * seed), world=None) for seed in range(2))
    forth, back = compare(one, other), compare(other, one)
    std = np.sqrt(np.diag(one.covariance) + np.diag(other.covariance))
    for change, sign in ((forth, 1.0), (back, -1.0)):
        np.testing.assert_allclose([p.std for p in change.parameters], std, rtol=0.05)
        found = np.array([p.change for p in change.parameters])
        np.testing.assert_allclose((sign * found - (other.values - one.values)) / std, 0, atol=0.2)
        assert change.causes.ranking[0].name == 'l1'


def test_what_happened_in_one_recording_is_no_change() -> None:
    shift = find(CELL, 'shift[disc_2]')
    robot = ExtendedModel(TRUTH, (shift,), ((2e-4, 1e-4, 35.5),))
    touches = simulate_touches(CELL, robot, default_plan(CELL, 12), seed=3)
    shifted = as_record(calibrate(touches, CELL, (shift,), start=robot))
    plain = record_of(CELL, 2, world=None)
    for change in (compare(shifted, plain), compare(plain, shifted)):
        assert change.not_compared == ('shift[disc_2]',) and change.degrees_of_freedom == 12
        assert change.p_value > 1e-3


def test_a_robot_with_small_errors_is_unchanged_however_it_was_touched_and_named():
    """An encoder gain that one calibration names and another one, of other touches, has among undetected effects."""
    cell = replace(CELL, uncertainty=Uncertainty())
    effect = find(cell, 'encoder_gain[joint1]')
    robot = ExtendedModel(TRUTH, (effect,), ((4e-5,),))
    plan = default_plan(cell, 12, preload=0.3)
    chosen = np.random.default_rng(4).permutation(len(plan))
    parts = chosen[:48], chosen[48:60]
    made = [simulate_touches(cell, robot, plan.select(np.sort(part)), Noise(1e-5, 0.3), 3) for part in parts]
    records = [CalibrationRecord.of_outcome(calibrate_touches(touches, cell)) for touches in made]
    assert [bool(record.arm.effects) for record in records] == [True, False]
    assert [bool(record.undetected.columns) for record in records] == [True, True]
    found = compare(*records)
    assert found.p_value > 0.01
    assert found.only_before == (effect.label,)
    assert max(abs(value.z) for value in found.parameters) < 4


@pytest.mark.parametrize('change', [{'size': [-1.0]}, {'of_robot': []}, {'columns': [3]}, {'matrix': [[1.0]]}, [[0.0]]])
def test_damaged_undetected_effects_and_those_of_an_earlier_version_are_refused(
    record: CalibrationRecord, change: Any
) -> None:
    entry, names = record.document['covariance_with_cell'], record.arm.model.names
    right = {'rows': list(names), 'columns': ['a'], 'of_robot': [True], 'size': [1.0], 'matrix': [[0.0]] * len(names)}
    good, bad = (
        replace(record, document={**record.document, 'covariance_with_cell': {**entry, 'undetected': part}})
        for part in (right, right | change if isinstance(change, dict) else change)
    )
    assert good.undetected.columns == ('a',)
    with pytest.raises(ValueError, match='undetected|expected' if isinstance(change, dict) else 'an earlier version'):
        _ = bad.undetected

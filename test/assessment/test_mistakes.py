"""Mistakes in a cell description or in touches are named; nothing is blamed on good touches or on ordinary effects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pipeline.undeclared import path_of

from scara_kinetostatic import pipeline
from scara_kinetostatic.assessment.grade import Grade
from scara_kinetostatic.assessment.mistakes import (
    FEWEST_TOUCHES,
    Mistake,
    Origin,
    _misses,
    _reading,
    check_touches,
    wrong_unit,
)
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.errors import CellError, InputError, UnsupportedDataError
from scara_kinetostatic.model.cell import PAPER_CELL, Cell, Disc, Sensor, SensorFrame
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

SHORT = Cell(
    PAPER_NOMINAL.replace(l1=0.25, l2=0.21),
    (Disc('a', 0.20, 0.15, 0.030), Disc('b', -0.15, 0.22, 0.045), Disc('c', 0.05, -0.28, 0.030)),
    noise=PAPER_CELL.noise,
    sensor=Sensor(frame=SensorFrame.TOOL),
)
ROBOTS = {'paper': (PAPER_CELL, PAPER_ACTUAL), 'short': (SHORT, PAPER_ACTUAL.replace(l1=0.2502, l2=0.2093))}


def find_mistake(touches, cell, calibration=None, **known) -> Mistake | None:
    return check_touches(touches, cell, **known).mistake(calibration)


@pytest.fixture(scope='module')
def touches() -> dict[str, TouchSet]:
    plans = {name: default_plan(cell, 5) for name, (cell, _) in ROBOTS.items()}
    return {name: simulate_touches(cell, truth, plans[name], seed=1) for name, (cell, truth) in ROBOTS.items()}


def discs(change):
    return lambda cell: replace(cell, discs=tuple(change(disc) for disc in cell.discs))


def first_disc(change):
    return lambda cell: replace(cell, discs=(change(cell.discs[0]), *cell.discs[1:]))


def radii(*order):
    def change(cell):
        pairs = zip(cell.discs, order, strict=True)
        return replace(cell, discs=tuple(disc._replace(radius=cell.discs[k].radius) for disc, k in pairs))

    return change


def other_frame(cell):
    other = SensorFrame.BASE if cell.sensor.frame is SensorFrame.TOOL else SensorFrame.TOOL
    return replace(cell, sensor=cell.sensor._replace(frame=other))


OF_CELL = {
    'x and y are swapped in the centers of all discs': discs(lambda d: d._replace(x=d.y, y=d.x)),
    'x has the wrong sign in the center of (disc_1|a)': first_disc(lambda d: d._replace(x=-d.x)),
    'y has the wrong sign in the centers of all discs': discs(lambda d: d._replace(y=-d.y)),
    'radius is the diameter of every disc': discs(lambda d: d._replace(radius=2 * d.radius - 0.01)),
    'radius 0.(3|06) is the diameter of (disc_1|a)': first_disc(lambda d: d._replace(radius=2 * d.radius)),
    'the radii, or the centers, of (disc_1 and disc_2|a and b) are swapped': radii(1, 0, 2),
    'the forces are in the (base|tool) frame, not in the (tool|base) frame': other_frame,
}
IN_DEGREES = {('theta1',): 'theta1: 1', ('theta2',): 'theta2: -0.8', ('theta1', 'theta2'): 'theta1: 1 and theta2: -0.8'}
OF_TOUCHES = {
    'the two joints are in the wrong order': (lambda q: q[:, ::-1], None),
    'joint 1 turns the other way': (lambda q: q * [-1, 1], None),
    'joint 2 turns the other way': (lambda q: q * [1, -1], None),
    'both joints turn the other way': (lambda q: -q, None),
    'the angles of joint 2 are in degrees': (lambda q: q * [1, 180 / np.pi], None),
    'x and y of the force are swapped': (None, lambda f: f[:, ::-1]),
    'y of the force has the wrong sign': (None, lambda f: f * [1, -1]),
    'the sign of the force is wrong': (None, lambda f: -f),
    'the axes of the force sensor are turned by 90°': (None, lambda f: np.stack([f[:, 1], -f[:, 0]], axis=1)),
    'the forces are in kN, not in N': (None, lambda f: 1e-3 * f),
}


def alternating(statements):
    """Each with one of the robots."""
    return pytest.mark.parametrize(
        ('statement', 'robot'), [(statement, list(ROBOTS)[number % 2]) for number, statement in enumerate(statements)]
    )


@alternating(OF_CELL)
def test_a_mistake_of_the_cell_is_named(touches, robot, statement):
    mistake = find_mistake(touches[robot], OF_CELL[statement](ROBOTS[robot][0]))
    assert mistake is not None
    assert mistake.in_cell
    with pytest.raises(CellError, match=statement):
        raise mistake.error('touches.csv')


@pytest.mark.parametrize('names', IN_DEGREES)
def test_angles_in_degrees_are_named_with_the_value_to_set(touches, names):
    stated = {'theta1': 1.0, 'theta2': -0.8}
    cell = replace(SHORT, nominal=SHORT.nominal.replace(**{name: stated[name] for name in names}))
    mistake = find_mistake(touches['short'], cell)
    assert (mistake.where, mistake.statement) == ('robot.nominal', f'{IN_DEGREES[names]}: in degrees, not in rad')
    assert mistake.action == 'set ' + ' and '.join(f'{name}: {np.deg2rad(stated[name]):.6g}' for name in names)


@pytest.mark.parametrize('name', ['a', 'b'])
def test_a_diameter_beside_an_outline_is_named(name):
    block = Outline('block', ((0.02, 0.28), (0.10, 0.28), (0.10, 0.32), (0.02, 0.32)), 0.001)
    cell = replace(SHORT, discs=(*SHORT.discs[:2], block), tip_radius=0.005)
    made = simulate_touches(cell, ROBOTS['short'][1], default_plan(cell, 5), seed=1)
    right = {disc.name: disc.radius for disc in SHORT.discs}[name]
    wrong = discs(lambda d: d._replace(radius=2 * d.radius) if d.name == name else d)(cell)
    mistake = find_mistake(made, wrong)
    assert mistake.statement == f'radius {2 * right:g} is the diameter of {name}'
    assert mistake.action.startswith(f'set it to {right:g}')


@alternating(OF_TOUCHES)
def test_a_mistake_of_the_touches_is_named(touches, robot, statement):
    joints, force = OF_TOUCHES[statement]
    right = touches[robot]
    given = right.replace(joints=joints(right.joints) if joints else right.joints)
    given = given.replace(force=force(right.force) if force else right.force)
    mistake = find_mistake(given, ROBOTS[robot][0])
    assert mistake is not None
    assert not mistake.in_cell
    with pytest.raises(InputError, match=f'^touches.csv: {statement}'):
        raise mistake.error('touches.csv')


@pytest.mark.parametrize(('robot', 'part', 'stated'), [('short', -0.35, 0.0), ('paper', 0.3, 0.1)])
def test_a_coupling_of_the_joints_is_named_with_its_ratio(touches, robot, part, stated):
    cell, right = replace(ROBOTS[robot][0], coupling=stated), touches[robot]
    reported = replace(cell, coupling=part).readings(right.joints)
    given = right.replace(joints=cell.angles(reported))
    mistake = find_mistake(given, cell, origin=Origin.RECORDING)
    assert (mistake.where, mistake.in_cell, mistake.is_gross) == ('robot.coupling', True, True)
    assert mistake.statement.startswith('the reading of joint 2 contains ')
    assert float(mistake.statement.split()[6]) == pytest.approx(part, abs=1e-4)
    assert f'set robot.coupling to {mistake.statement.split()[6]}' in mistake.action
    if stated:
        of_arrays = find_mistake(given, cell)
        assert not of_arrays.in_cell
        assert float(of_arrays.action.split()[3]) == pytest.approx(part - stated, abs=1e-4)


@pytest.mark.parametrize(('stated', 'true'), [((1, 1), (-1, 1)), ((1, -1), (-1, 1))])
def test_a_direction_of_the_joints_is_named(touches, stated, true):
    cell, right = replace(ROBOTS['paper'][0], direction=stated), touches['paper']
    given = right.replace(joints=cell.angles(replace(cell, direction=true).readings(right.joints)))
    mistake = find_mistake(given, cell, origin=Origin.RECORDING)
    assert (mistake.where, mistake.in_cell) == ('robot.direction', True)
    assert mistake.action == f'set robot.direction to {list(true)}'


def test_joint_2_measured_from_the_base_is_named(touches):
    given = touches['short'].replace(joints=np.cumsum(touches['short'].joints, axis=1))
    assert find_mistake(given, SHORT).statement == 'joint 2 is measured from the base, not from link 1'


def test_a_coupling_where_there_is_none_is_to_be_left_out(touches):
    cell, right = replace(PAPER_CELL, coupling=0.1), touches['paper']
    mistake = find_mistake(right.replace(joints=cell.angles(right.joints)), cell, origin=Origin.RECORDING)
    assert (mistake.where, mistake.action) == ('robot.coupling', 'leave out robot.coupling')
    assert mistake.statement == 'the reading of joint 2 does not contain that of joint 1'


@pytest.mark.parametrize(('robot', 'length'), [('paper', 3e-3), ('short', 1e-2)])
def test_a_forgotten_tip_is_named(touches, robot, length):
    cell = ROBOTS[robot][0]
    short = discs(lambda d: d._replace(radius=d.radius - length))(cell)
    mistake = find_mistake(touches[robot], short)
    assert 'mm too small, or the radius of the tip is missing' in mistake.statement
    assert float(mistake.statement.split()[4]) == pytest.approx(1e3 * length, abs=0.15)
    assert mistake.action.startswith('add the radius of the tip to every radius')


@pytest.mark.parametrize('short', [3e-4, 1e-3])
def test_radii_that_are_all_short_are_named_by_the_calibration(touches, short):
    cell = discs(lambda d: d._replace(radius=d.radius - short))(PAPER_CELL)
    calibration = calibrate(touches['paper'], cell)
    mistake = find_mistake(touches['paper'], cell, calibration)
    error = -1e3 * calibration.parameters.g_ee
    assert mistake.statement.startswith(f'all radii are stated {error:.3g} mm too small')
    declared = replace(cell, uncertainty=replace(cell.uncertainty, radius=short))
    assert find_mistake(touches['paper'], declared, calibration) is None


def test_swapped_names_and_centers(touches):
    given = touches['paper']
    named = given.replace(disc=np.array([1, 0, 2])[given.disc])
    assert find_mistake(named, PAPER_CELL).statement.endswith('such as disc_2 where they meet disc_1')
    a, b, c = PAPER_CELL.discs
    swapped = replace(PAPER_CELL, discs=(a._replace(x=b.x, y=b.y), b._replace(x=a.x, y=a.y), c))
    assert find_mistake(given, swapped).statement == 'the radii, or the centers, of disc_1 and disc_2 are swapped'


@pytest.mark.parametrize(('name', 'value'), [('x0', 0.02), ('theta1', 0.1)])
def test_a_wrong_fixed_value(touches, name, value):
    mistake = find_mistake(touches['paper'], PAPER_CELL, fixed={name: value})
    assert f'of {name} contradicts the touches' in mistake.statement


def test_remedies_depend_on_what_holds_the_touches(touches):
    given = touches['paper'].replace(force=-touches['paper'].force)
    assert find_mistake(given, PAPER_CELL, origin=Origin.TABLE).action == 'change the signs of fx and fy'
    mistake = find_mistake(given, PAPER_CELL, origin=Origin.RECORDING)
    assert (mistake.where, mistake.action) == ('sensor.sign', 'set sensor.sign to on_robot')
    given = touches['paper'].replace(joints=touches['paper'].joints[:, ::-1])
    mistake = find_mistake(given, PAPER_CELL, origin=Origin.RECORDING)
    assert mistake.action == 'set robot.joint_names to [joint2, joint1]'


def test_a_gross_mistake_is_an_error_before_anything_is_fitted(touches):
    given = touches['paper']
    cell = OF_CELL['x and y are swapped in the centers of all discs'](PAPER_CELL)
    with pytest.raises(CellError, match=r'^objects: x and y are swapped in the centers of all discs'):
        calibrate_touches(given, cell)


def test_a_disc_far_from_its_place_is_named_where_the_fit_fails(touches, monkeypatch):
    def fails(*_):
        raise UnsupportedDataError('the fit does not converge')

    a, b, c = PAPER_CELL.discs
    off = replace(PAPER_CELL, discs=(a, b, c._replace(y=c.y + 0.05)))
    monkeypatch.setattr(pipeline, '_base_fit', fails)
    with pytest.raises(CellError, match=r'disc_3 stands about 50 mm .* measure the place of disc_3 again'):
        calibrate_touches(touches['paper'], off)


def test_a_disc_far_from_its_place_that_the_fit_corrects_asks_for_caution(touches):
    a, b, c = SHORT.discs
    outcome = calibrate_touches(touches['short'], replace(SHORT, discs=(a, b._replace(y=b.y + 0.03), c)))
    assert outcome.verdict == 'explained'
    (only,) = outcome.diagnosis.found
    assert only.effect.label == 'object_position[b]'
    assert abs(only.values[1].value + 0.03) < 4 * only.values[1].std
    assert outcome.assessment.grade.value == 'caution'
    assert 'by more than an error of measurement' in ' '.join(outcome.assessment.reasons)


def test_nothing_is_blamed_on_good_touches():
    for cell, truth in ROBOTS.values():
        for seed in range(2):
            rng = np.random.default_rng(seed)
            robot = truth.as_array() + rng.normal(0, [5e-3, 5e-3, 0.01, 3e-3, 0.01, 3e-3] + 6 * [0])
            plan = default_plan(cell, 8)
            plan = plan.select(np.sort(rng.choice(len(plan), rng.integers(12, len(plan)), replace=False)))
            given = simulate_touches(cell, Parameters.from_array(robot), plan, seed=seed)
            assert find_mistake(given, cell) is None


def test_nothing_is_blamed_on_ordinary_effects():
    plan = default_plan(PAPER_CELL, 3, preload=0.3)
    for effect in {effect.name: effect for effect in catalogue(PAPER_CELL)}.values():
        values = tuple(4 * value for value in effect.typical)
        given = simulate_touches(PAPER_CELL, ExtendedModel(PAPER_ACTUAL, (effect,), (values,)), plan, seed=2)
        mistake = find_mistake(given, PAPER_CELL)
        assert mistake is None, (effect.label, mistake.text)


def test_few_touches_and_touches_of_something_else_have_no_name(touches):
    given = touches['paper']
    cell = OF_CELL['x and y are swapped in the centers of all discs'](PAPER_CELL)
    assert find_mistake(given.select(np.arange(FEWEST_TOUCHES - 1)), cell) is None
    rng = np.random.default_rng(0)
    nonsense = given.replace(joints=rng.uniform(-2, 2, given.joints.shape), force=rng.normal(0, 20, given.force.shape))
    assert find_mistake(nonsense, PAPER_CELL) is None


def test_units_are_told_by_sizes():
    joints = np.array([[3.0, -12.0]])
    assert wrong_unit(joints, 0.21) is None
    assert wrong_unit(joints, 4.9e3) is None
    assert wrong_unit(joints, 0.02).text == 'the forces are in kN, not in N: a touch would have 0.02 N'
    assert wrong_unit(joints, 2e4).action == 'give them in N (then 20 N)'
    assert wrong_unit(np.rad2deg(joints[:, ::-1]), 20.0).statement.startswith('the angles of joint 1 and joint 2 are')


def test_derivatives_of_the_coarse_fit(touches):
    rng = np.random.default_rng(3)
    reading = _reading(touches['short'].joints, touches['short'].force, SHORT, {})
    values = reading.nominal + rng.normal(0, 1e-3, 13) * np.array([1, 1, 1, 1, 1, 1, 1e-2, 1e-2, 1e-2, 1, 1, 1, 1])
    found = _misses(reading, values)
    for j in range(13):
        step = 1e-7 * (np.arange(13) == j)
        up, down = _misses(reading, values + step), _misses(reading, values - step)
        for value, by in (('distance', 'by_distance'), ('angle', 'by_angle')):
            expected = (getattr(up, value) - getattr(down, value)) / 2e-7
            # what the torques add is left out: of second order, but where one of them is nearly zero
            error = np.abs(getattr(found, by)[:, j] - expected)
            assert np.quantile(error, 0.9) < 0.02 * max(np.abs(expected).max(), 1e-2), (j, value)


def test_a_mended_cell_that_would_be_refused_is_not_proposed(touches):
    stated = first_disc(lambda d: d._replace(radius=d.radius / 2))(PAPER_CELL)
    assert find_mistake(touches['paper'], stated).statement == 'radius of disc_1 is half of what it should be'


def test_an_object_that_all_its_touches_miss_asks_for_caution():
    *others, third = PAPER_CELL.discs
    larger = replace(PAPER_CELL, discs=(*others, third._replace(radius=1.5 * third.radius)))
    assessment = pipeline.calibrate_recordings([path_of('engine_a')], larger).assessment
    assert assessment.grade is Grade.CAUTION
    assert '28 of 84 touches meet no object, and none disc_3' in assessment.reasons[0]

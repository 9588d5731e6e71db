"""The touches to make next, and the program of the robot: what it keeps clear of, limits, order, refusals."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from cli.conftest import SLOW
from conftest import page_left_out
from scipy.spatial import cKDTree

from benchmark.next import random_cell
from scara_kinetostatic.cli.main import main
from scara_kinetostatic.errors import CellError, UnsupportedDataError
from scara_kinetostatic.files.calibration_file import nominal_arm
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.model.cell import PAPER_CELL, PAPER_DISCS, Lift, Noise, Region
from scara_kinetostatic.model.kinematics import forward, inverse, wrap
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.planning.candidate_touches import largest_variance
from scara_kinetostatic.planning.motion import Capsules, short_order
from scara_kinetostatic.planning.next_touches import Planner
from scara_kinetostatic.planning.prediction import tip_in_use
from scara_kinetostatic.planning.program import joint_angles, program
from scara_kinetostatic.running.campaign import clear_start
from scara_kinetostatic.simulation.plan import LIMIT_MARGIN, default_plan, load_plan
from scara_kinetostatic.simulation.streams import simulate_touches

CELL = replace(
    PAPER_CELL,
    discs=PAPER_DISCS,
    limits=((-2.6, 2.6), (-2.6, 2.6)),
    obstacles=(((0.30, 0.10), (0.50, 0.10), (0.50, 0.30)),),
    region=Region(-0.35, 0.35, 0.2, 0.55),
)
NEXT = (
    'order,object,elbow,angle_deg,force_N,x_m,y_m,approach_x_m,approach_y_m,q1_rad,q2_rad,'
    'approach_q1_rad,approach_q2_rad,reason'
)
PROGRAM = 'step,touch,kind,x_m,y_m,q1_rad,q2_rad,lift_m,speed_m_s,until_force_N'
LIFT = Lift('joint3', 0.02, 0.0)


BLOCK = Outline('block', ((0.15, 0.3), (0.25, 0.3), (0.25, 0.4), (0.15, 0.4)))
WITH_BLOCK = replace(CELL, discs=(CELL.discs[0], BLOCK), obstacles=(), tip_radius=0.005)


def planner_of(cell, **more):
    return Planner(nominal_arm(cell), **more)


@pytest.fixture(scope='module')
def planner():
    return planner_of(CELL)


def random_cells(number):
    """Random cells, every other one with a lift."""
    random = np.random.default_rng(5)
    for k in range(number):
        yield replace(random_cell(random), lift=LIFT if k % 2 else None)


def on_line(begin, end):
    """Places at most 1 mm apart on a straight move."""
    count = int(np.ceil(np.hypot(*(end - begin)) / 1e-3)) + 2
    return begin + np.linspace(0, 1, count)[:, None] * (end - begin)


def away_from_outlines(cell, places):
    """Distance of places from the nearest outline, m, from points 0.2 mm apart on its edges."""
    points = np.concatenate(
        [
            np.linspace(a, b, int(np.hypot(*np.subtract(b, a)) / 2e-4) + 2)
            for outline in cell.obstacles
            for a, b in zip(outline, (*outline[1:], outline[0]), strict=True)
        ]
        or [np.full((1, 2), 1e3)]
    )
    return cKDTree(points).query(places)[0]


@pytest.mark.parametrize('number', range(4))
def test_the_whole_program_keeps_clear_and_within_the_limits(number):
    cell = list(random_cells(4))[number]
    planner = planner_of(cell)
    try:
        planned = planner.accurate(6)
    except UnsupportedDataError as error:
        assert 'no touch can be reached' in str(error)
        return
    steps, p = program(planner, planned), cell.nominal
    limits = np.array(cell.limits).T
    for before, step in pairwise(steps):
        assert ((step.joints >= limits[0]) & (step.joints <= limits[1])).all()
        own = planned.plan.disc[step.touch - 1] if step.kind != 'travel' else None
        raised = step.kind == 'travel' and step.lift == LIFT.up
        sides = np.sign(np.sin([before.joints[1] + p.theta2, step.joints[1] + p.theta2]))
        if sides[0] != sides[1]:  # through the straight arm, at one place
            assert step.kind == 'travel'
            np.testing.assert_allclose(step.tip, before.tip)
            joints = before.joints + np.linspace(0, 1, 400)[:, None] * (step.joints - before.joints)
            assert np.isclose(joints[:, 1] + p.theta2, 0, atol=0.01).any()
            places = forward(p, joints)
        else:
            places = on_line(before.tip, step.tip)
            joints = inverse(p, places, sides[0])
            if step.kind == 'travel':
                middle = limits.mean(axis=0)
                joints = middle + wrap(joints - middle)
                assert np.abs(np.diff(joints, axis=0)).max() < 0.5
                assert ((joints >= limits[0]) & (joints <= limits[1])).all()
        if raised:
            continue
        apart = np.hypot(*(places[:, None] - cell.centers).transpose(2, 0, 1)) - cell.radii
        if own is not None:
            apart[:, own] = np.inf
        assert apart.min() >= planner.space.clearance - 1e-6
        assert away_from_outlines(cell, places).min() >= planner.space.clearance - 2e-4


@pytest.mark.parametrize('preload', [0.0, 0.3])
@pytest.mark.parametrize('lift', [None, LIFT])
def test_the_steps_of_every_touch_are_in_order(lift, preload):
    cell = replace(CELL, lift=lift, touch=CELL.touch._replace(speed=0.3))
    planner = planner_of(cell)
    planned = planner.accurate(9)
    planned = planned._replace(plan=replace(planned.plan, preload=np.full(9, preload)))
    steps = program(planner, planned)
    assert [step.touch for step in steps] == sorted(step.touch for step in steps)
    for number, (force, preload) in enumerate(zip(planned.plan.force, planned.plan.preload, strict=True), 1):
        own = [step for step in steps if step.touch == number]
        kinds = [step.kind for step in own]
        acting = ['approach', *['press'] * (1 + (preload > 0)), 'hold', 'retract']
        travels = len(kinds) - len(acting)
        assert kinds == ['travel'] * travels + acting
        assert travels >= 1
        np.testing.assert_allclose(own[travels - 1].tip, own[-1].tip)
        presses = [step.until for step in own if step.kind == 'press']
        assert presses == ([1.3 * force, force] if preload else [force])
        assert max(presses) <= cell.touch.max_force
        assert {step.speed for step in own if step.kind == 'travel'} == {0.3}
        assert all(step.speed <= cell.touch.contact_speed for step in own[travels:])
        if lift:
            assert [step.lift for step in own] == [0.02] * (travels - 1) + [0.0] * (len(own) - travels + 1)
        else:
            assert {step.lift for step in own} == {None}


def test_the_tip_reaches_the_disc_under_the_force_as_the_model_has_it(planner):
    planned = planner.accurate(6)
    touches = simulate_touches(CELL, CELL.nominal, planned.plan, Noise(0.0, 0.0))
    holds = [step.joints for step in program(planner, planned) if step.kind == 'hold']
    np.testing.assert_allclose(wrap(holds - touches.joints), 0, atol=1e-6)


def places_of(planner, plan):
    """Numbers of a plan's touches among the candidates."""
    rows, wanted = (
        np.stack([getattr(one, name) for name in ('disc', 'angle', 'posture', 'force', 'preload')], axis=-1)
        for one in (planner.candidates.plan, plan)
    )
    return [int(np.flatnonzero((rows == row).all(axis=1))[0]) for row in wanted]


def test_the_mean_variance_is_that_of_the_tip_over_the_region(planner):
    tip, scales = tip_in_use(planner.robot, 40.0), planner.robot.all_scales
    chosen = [3, 50, 200, 300, 400, 500, 77, 123]
    covariance = scales[:, None] * np.linalg.inv(planner.candidates.information_of(chosen)) * scales
    variance = np.einsum('gdik,kl,gdil->gd', tip, covariance, tip, optimize=True)
    assert largest_variance(planner.candidates, chosen) == pytest.approx(float(variance.mean()))


def test_touches_are_not_expected_to_lower_undetected_effects():
    outcome = calibrate_touches(simulate_touches(CELL, PAPER_ACTUAL, default_plan(CELL, 8), seed=1), CELL)
    found = Planner.of_outcome(outcome).accurate(4).uncertainty
    parts = [item.tip for item in outcome.budget if item.label.startswith(('undetected', 'rivals'))]
    assert found.undetected == pytest.approx(2 * np.linalg.norm(parts))
    assert found.least < found.undetected < found.planned < found.now


def test_preloads_are_planned_where_they_show_friction_in_the_joints():
    joints = frozenset({'joint_hysteresis[joint1]', 'joint_hysteresis[joint2]'})
    planner = planner_of(CELL, suspected=joints)
    plan = planner.accurate(18).plan
    plain = replace(plan, preload=np.zeros(18))
    values = [largest_variance(planner.candidates, places_of(planner, some)) for some in (plan, plain)]
    assert 4 <= (plan.preload > 0).sum() <= 14
    assert values[0] < 0.7 * values[1]


@pytest.mark.parametrize('label', ['object_position[disc_2]', 'object_radius[disc_1]'])
def test_a_disc_that_is_suspected_is_decided_although_it_does_not_move_the_tip(label, planner):
    known = simulate_touches(CELL, PAPER_ACTUAL, planner.accurate(16).plan, seed=1)
    plain, suspicious = (planner_of(CELL, touches=known, suspected=each) for each in (frozenset(), frozenset({label})))
    of_disc = suspicious.candidates.counting(suspicious._in_doubt, 1.0)
    planned = [one.accurate(8) for one in (plain, suspicious)]
    left = [largest_variance(of_disc, places_of(suspicious, one.plan)) for one in planned]
    assert left[1] < 0.9 * left[0]
    reasons = {reason.partition(',')[0] for reason in planned[1].reasons}
    assert f'decides {label}' in reasons


@pytest.mark.parametrize('label', ['transmission_error[joint1]', 'joint_slip[joint2]', 'load_friction[joint1]'])
def test_waves_and_slip_are_among_what_is_undecided(label):
    planner = planner_of(CELL, suspected=frozenset({label}))
    number = planner._in_doubt
    assert [planner.robot.model.names[k].rpartition('.')[0] for k in number] == [label]
    of_it = planner.candidates.counting(number, 1.0)
    assert largest_variance(of_it, places_of(planner, planner.accurate(15).plan)) < 0.5


def test_distances_of_moves_from_edges():
    edges = Capsules(np.array([[0.0, 0.0], [1.0, 1.0]]), np.array([[0.0, 1.0], [1.0, 1.0]]), np.array([0.1, 0.2]))
    a, b = np.array([[0.5, 0.0], [-0.5, 0.5], [0.5, 2.0]]), np.array([[0.5, 1.0], [0.5, 0.5], [0.5, 3.0]])
    expected = [
        [0.4, np.hypot(0.5, 0.0) - 0.2],
        [-0.1, np.hypot(0.5, 0.5) - 0.2],
        [np.hypot(0.5, 1) - 0.1, np.hypot(0.5, 1) - 0.2],
    ]
    np.testing.assert_allclose(edges.distance(a, b), expected)


def test_the_short_order_is_that_of_a_line():
    places = np.random.default_rng(2).permutation(9).astype(float)
    order = short_order(np.abs(places[:, None] - places))
    assert list(places[order]) in ([*range(9)], [*range(8, -1, -1)])


def test_what_is_given_up_is_left_out(planner):
    first = planner.accurate(9).plan
    given_up = ((int(first.disc[0]), float(first.angle[0]), int(first.posture[0])),)
    planned = replace(planner, given_up=given_up).accurate(4)
    assert any('given up' in text for text in planned.left_out)
    assert given_up[0] not in zip(planned.plan.disc, planned.plan.angle, planned.plan.posture, strict=True)


def test_a_suspected_place_is_undecided_although_the_cell_declares_its_uncertainty():
    label = 'object_position[disc_2]'
    cell = replace(CELL, discs=tuple(disc._replace(center_std=3e-6) for disc in CELL.discs))
    assert label not in {effect.label for effect in planner_of(cell).robot.effects}
    suspicious = planner_of(cell, suspected=frozenset({label}))
    names = np.array(suspicious.robot.model.names)[suspicious._in_doubt]
    assert list(names) == [f'{label}.x', f'{label}.y']
    assert {1} <= set(suspicious.accurate(4).plan.disc)


def test_without_a_lift_an_open_outline_is_refused():
    edge = Outline('edge', ((-0.05, 0.35), (0.10, 0.35)), is_open=True)
    cell = replace(CELL, discs=(*CELL.discs[:1], edge), tip_radius=0.005)
    with pytest.raises(CellError, match='behind an open outline'):
        planner_of(cell).accurate(9)
    assert len(planner_of(replace(cell, lift=LIFT)).accurate(9).plan) == 9


def test_a_disc_beyond_the_limits_is_left_out_with_the_reason():
    planned = planner_of(replace(CELL, limits=((-0.5, 2.0), (-2.2, 2.2)))).accurate(9)
    assert any(text.startswith('disc_1: ') and 'beyond the limits of joint1' in text for text in planned.left_out)
    near = planner_of(replace(CELL, limits=((-0.6, 0.3), (-2.2, 2.2)))).accurate(9)
    assert 0 not in near.plan.disc
    assert near.left_out[0].startswith('disc_1: ')


def surfaces_touched(plan):
    """Edge or corner of the block of each touch of it, and its part."""
    plan = plan.select(plan.disc == 1)
    surface, part = WITH_BLOCK.surfaces.places(plan.disc, plan.angle)
    return plan, WITH_BLOCK.surfaces.select(surface), part


def test_an_arm_that_is_not_calibrated_touches_no_sharp_corner():
    """Off by millimetres, it would slide off, or pass beside an edge near its end."""
    nominal = nominal_arm(WITH_BLOCK)
    for known, sharp in ((nominal, False), (replace(nominal, undetermined=np.zeros((12, 0))), True)):
        plan, touched, part = surfaces_touched(Planner(known).candidates.plan)
        to_end = np.where(touched.is_edge, (1 - np.abs(part)) * touched.halves, 0.0)
        assert len(plan) > 10 and (to_end.min() < WITH_BLOCK.touch.search) == sharp


def test_touches_made_on_an_outline_count_where_they_were_made():
    """On a block the place is not the direction of the force: what was known there would be touched again and again."""
    planner = planner_of(WITH_BLOCK)
    candidates = planner.candidates
    on_block = np.flatnonzero((candidates.plan.disc == 1) & (candidates.plan.preload == 0))
    touches = simulate_touches(WITH_BLOCK, PAPER_NOMINAL, candidates.plan.select(on_block), seed=0)
    known = replace(planner, touches=touches).candidates.prior - candidates.prior
    expected = candidates.information[on_block].sum(axis=0)
    np.testing.assert_allclose(np.trace(known), np.trace(expected), rtol=0.05)
    assert np.linalg.norm(known - expected) < 0.05 * np.linalg.norm(expected)


def test_what_a_press_may_do_is_judged_by_its_own_force():
    """On a sharp corner 20 N drag the tip of a soft arm a little aside, 60 N would drag it off."""
    soft = replace(WITH_BLOCK, nominal=PAPER_NOMINAL.replace(p_ee=2.6e-5, p1=2e-5, p2=4e-5))
    planner = Planner(replace(nominal_arm(soft), undetermined=np.zeros((12, 0))))
    plan = planner.candidates.plan
    on_block, touched, _ = surfaces_touched(plan)
    on_corner = on_block.force[~touched.is_edge]
    assert not any(planner.problems(plan))
    few, many = ((on_corner == force).sum() for force in soft.touch.force[::-1])
    assert few < 0.3 * many


def test_joints_that_turn_farther_are_planned_in_one_turn_about_the_middle():
    cell = replace(CELL, limits=((-1.0, 7.0), (-2.6, 2.6)))
    planner = planner_of(cell)
    space, planned = planner.space, planner.accurate(9)
    np.testing.assert_allclose(space.limits[:, 0], [3.0 - np.pi + LIMIT_MARGIN, 3.0 + np.pi - LIMIT_MARGIN])
    own = space.joints(planner.approach(planner.candidates.plan))
    assert space.is_within(own).all() and own[:, 0].max() > np.pi
    np.testing.assert_allclose(joint_angles(planner, planner.approach(planner.candidates.plan)), own, atol=0.01)
    assert all(np.abs(b.joints - a.joints).max() < np.pi for a, b in pairwise(program(planner, planned)))
    here = own[0]
    assert clear_start(planner, here)[1] == ''
    for turn in (2 * np.pi, -2 * np.pi):
        assert clear_start(planner, here + np.array([turn, 0.0])) == (
            None,
            'joint1 stands beyond robot.limits, or more than half a turn from their middle: move it',
        )


@pytest.fixture
def cell_file(tmp_path):
    def write(cell=CELL, text=lambda text: text):
        path = tmp_path / 'cell.yaml'
        path.write_text(text(dump_cell(cell)))
        return path

    return write


def rows_of(path):
    with path.open() as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    """A folder with a cell, its first touches, their recording and its calibration."""
    folder = tmp_path_factory.mktemp('made')
    (folder / 'cell.yaml').write_text(dump_cell(replace(CELL, tolerance=6e-5)))
    names = {name: str(folder / name) for name in ('cell.yaml', 'first', 'bag', 'result')}
    for verb in (
        ['next', '--touches', '24', '--out', names['first']],
        ['simulate', '--plan', f'{names["first"]}/plan.yaml', '--out', names['bag'], *SLOW],
        ['calibrate', names['bag'], '--out', names['result']],
    ):
        with page_left_out():
            assert main([*verb, '--cell', names['cell.yaml']]) == 0
    return folder


def test_first_touches_as_files(made):
    assert sorted(path.name for path in (made / 'first').iterdir()) == ['next.csv', 'plan.yaml', 'program.csv']
    for name, heading in (('next', NEXT), ('program', PROGRAM)):
        assert (made / 'first' / f'{name}.csv').read_text().splitlines()[0] == heading
    touches, steps = (rows_of(made / 'first' / f'{name}.csv') for name in ('next', 'program'))
    assert [row['order'] for row in touches] == [str(k) for k in range(1, 25)]
    assert [row['step'] for row in steps] == [str(k + 1) for k in range(len(steps))]
    assert {row['kind'] for row in steps} == {'travel', 'approach', 'press', 'hold', 'retract'}
    plan = load_plan(made / 'first' / 'plan.yaml', CELL)
    assert [float(row['force_N']) for row in touches] == plan.force.tolist()


def test_a_calibration_stands_for_its_recordings_until_it_is_enough(made, tmp_path, cell_file, capsys):
    cell, bag, out = ['--cell', str(made / 'cell.yaml')], str(made / 'bag'), tmp_path / 'out'
    known = ['--calibration', str(made / 'result' / 'calibration.json')]
    rows = []
    for bags in ([], [bag]):
        assert main(['next', *bags, *cell, *known, '--touches', '4', '--out', str(out)]) == 0
        rows.append(rows_of(out / 'next.csv'))
        said = capsys.readouterr().out
        assert 'now ' in said and 'predicted' in said
    assert rows[0] == rows[1] and len(rows[0]) == 4
    loose = cell_file(replace(CELL, tolerance=1e-3))
    assert main(['next', '--cell', str(loose), *known, '--out', str(tmp_path / 'none')]) == 0
    assert capsys.readouterr().out.startswith('enough: the expanded uncertainty of the tip is at most')
    assert not (tmp_path / 'none').exists()
    assert main(['next', bag, *cell, '--goal', 'decide', '--out', str(out)]) == 3
    assert 'nothing is to be decided' in capsys.readouterr().err
    assert main(['next', bag, *cell, *known, '--goal', 'decide', '--out', str(out)]) == 3
    assert 'give BAG in place of --calibration' in capsys.readouterr().err


def test_touches_that_decide_between_rivals(tmp_path, cell_file, capsys):
    cell, bag = cell_file(), str(tmp_path / 'bag')
    moved = ['--per-disc', '8', *SLOW, '--effect', 'sensor_nonlinearity:rate=0.012']
    assert main(['simulate', '--cell', str(cell), *moved, '--out', bag]) == 0
    out = tmp_path / 'decide'
    assert main(['next', bag, '--cell', str(cell), '--goal', 'decide', '--touches', '5', '--out', str(out)]) == 0
    said = capsys.readouterr().out
    assert re.search(r'possible causes: contact_compliance \(\d+ %\) or sensor_nonlinearity \(\d+ %\)', said)
    assert re.search(r'the likeliest: 5 touches: [\d.]+ → [\d.]+ %', said)
    rows = rows_of(out / 'next.csv')
    assert len(rows) == 5
    assert all(row['reason'].startswith('decides ') for row in rows)
    assert len({(row['object'], row['angle_deg'], row['elbow'], row['force_N']) for row in rows}) == 5


@pytest.mark.parametrize(
    ('change', 'status', 'message'),
    [
        ({'limits': None}, 2, 'robot.limits: the limits of the joints are missing'),
        ({'limits': ((-2.6, -2.5), (-2.6, 2.6))}, 3, 'no touch can be reached: '),
        ({'tolerance': 3e-6}, 3, '200 more touches leave the tip an expanded uncertainty of '),
        (
            {'tolerance': 3e-5, 'discs': tuple(disc._replace(center_std=1e-4) for disc in CELL.discs)},
            3,
            'is from object_position',
        ),
    ],
)
def test_bad_input_is_refused_in_one_line(change, status, message, tmp_path, cell_file, capsys):
    cell = cell_file(replace(CELL, **change))
    assert main(['next', '--cell', str(cell), '--out', str(tmp_path / 'out')]) == status
    said = capsys.readouterr().err
    assert said.count('\n') == 1
    assert message in said
    assert not (tmp_path / 'out').exists()

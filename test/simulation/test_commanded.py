"""The commanded cell: drives as a controller has them, force as the model has it, contacts on the way, faults."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from math import exp, hypot, nan

import numpy as np
import pytest

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.cell import PAPER_CELL, Cell, Disc, Lift, SensorFrame, SensorSign
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.kinematics import forward, inverse
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.simulation.commanded import Malfunction, ModelBody, Plant, PlantSettings, Reading, free_pose
from scara_kinetostatic.simulation.motion import Trajectory
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import SensorModel, in_sensor_frame
from scara_kinetostatic.simulation.truth import parse_effect, with_effects

LIMITS = ((-2.6, 2.6), (-2.6, 2.6))
CELL = replace(PAPER_CELL, limits=LIMITS)
LIFTED = replace(CELL, limits=((-3.3, 3.3), (-3.3, 3.3)), lift=Lift('z', 0.02, 0.0), hold={'wrist': 0.5})
IDEAL = SensorModel.ideal(250.0)
STEP, COARSE = 0.004, 0.02


def plant(cell: Cell = CELL, effects: Iterable[str] = (), sensors: SensorModel = IDEAL, **settings: object) -> Plant:
    truth = with_effects(PAPER_ACTUAL, [parse_effect(text, cell) for text in effects])
    return Plant(cell, ModelBody(cell, truth), settings=PlantSettings(**settings), sensors=sensors)


def go(at: Plant, positions: Iterable[float], duration: float = 0.5, rest: float = 0.3) -> list[Reading]:
    """To a place, and until the joints have followed."""
    at.command(at.names, [duration], [list(positions)])
    return [at.step(at.time + STEP) for _ in range(round((duration + rest) / STEP))]


def reach(at: Plant, positions: Iterable[float], duration: float = 0.5) -> Reading:
    """The same, where the way itself does not matter: in coarse steps of time."""
    at.body.tick = COARSE
    at.command(at.names, [duration], [list(positions)])
    return at.step(at.time + duration + 0.3)


def beside(disc: Disc, depth: float, angle: float = -np.pi / 2) -> list[float]:
    """Joint angles of the true arm with its rigid tip at a depth within a disc."""
    out = np.array([np.cos(angle), np.sin(angle)])
    tip = np.array([disc.x, disc.y]) + (disc.radius - depth) * out
    return inverse(PAPER_ACTUAL, tip[None], 1)[0].tolist()


@pytest.mark.parametrize(
    ('effects', 'tolerance'),
    [
        ([], 1e-3),
        (['contact_friction:coefficient=0.1', 'object_position[disc_2]:x=1e-4,y=-2e-4'], 5e-3),
        (['joint_hysteresis[joint1]:width=6e-5'], 1e-3),
        (['joint_slip[joint2]:compliance=2e-5,slip_torque=4'], 5e-3),
    ],
)
def test_a_held_touch_has_the_force_of_the_plan(effects: list[str], tolerance: float) -> None:
    """The trajectory of a plan commands Ḡ(S, F): without an inner solve, and with what friction and joints remember."""
    plan = default_plan(LIFTED, per_disc=4, preload=0.3).select(np.array([1, 8]))
    truth = with_effects(PAPER_ACTUAL, [parse_effect(text, LIFTED) for text in effects])
    planned = Trajectory(LIFTED, truth, plan)
    at = plant(LIFTED, effects, overload=1e3, start=tuple(planned.free_joints[0]))
    for k in range(len(plan)):
        poses = [planned.free_joints[k], planned.contact_joints[k], planned.peak_joints[k], planned.hold_joints[k]]
        reach(at, [*poses[0], 0.02, 0.5], 1.2)
        for joints in poses if plan.preload[k] else [poses[0], poses[1], poses[3]]:
            last = reach(at, [*joints, 0.0, 0.5])
        assert last.true_force == pytest.approx(planned.hold_force[k], abs=tolerance)
        assert last.force == pytest.approx(last.true_force, abs=1e-9)
        assert last.touched == LIFTED.discs[plan.disc[k]].name
        assert reach(at, [*poses[0], 0.0, 0.5]).touched == ''
        reach(at, [*poses[0], 0.02, 0.5], 0.2)


def test_on_the_way_the_force_is_that_of_the_model_at_the_motor_angles() -> None:
    at, disc = plant(), CELL.discs[1]
    go(at, beside(disc, -0.02))
    touching = 0
    for reading in go(at, beside(disc, 1e-3), 1.0):
        found = contact(PAPER_ACTUAL, reading.joints, [disc.x, disc.y], disc.radius, warm_start=[reading.true_force])
        assert reading.true_force == pytest.approx(found.force[0], abs=1e-4)
        assert reading.force == pytest.approx(reading.true_force)
        touching += bool(reading.touched)
    assert touching > 70
    assert hypot(*reading.true_force) > 20


def test_without_contact_the_sensor_reads_its_bias() -> None:
    at = plant(sensors=SensorModel(bias=(1.2, -0.8), force_noise=0.0))
    for reading in go(at, beside(CELL.discs[1], -0.01)):
        assert reading.true_force == (0.0, 0.0)
        assert reading.force == (1.2, -0.8)
        assert not reading.touched


def test_frame_and_sign_of_the_sensor() -> None:
    cell = replace(CELL, sensor=CELL.sensor._replace(frame=SensorFrame.TOOL, sign=SensorSign.ON_ROBOT))
    at = plant(cell)
    go(at, beside(cell.discs[1], -0.01))
    last = go(at, beside(cell.discs[1], 1e-3))[-1]
    expected = -in_sensor_frame(cell, PAPER_ACTUAL, np.array([last.joints]), np.array([last.true_force]))[0]
    assert last.force == pytest.approx(expected)


def test_the_error_of_a_touch_stays_and_the_next_has_another() -> None:
    at = plant(sensors=SensorModel(bias=(0.0, 0.0), force_noise=0.0, resolution=0.0))
    errors = []
    for _ in range(10):
        reach(at, beside(CELL.discs[1], -0.003), 0.3)
        reach(at, beside(CELL.discs[1], 1e-3), 0.3)
        held = [at.step(at.time + STEP) for _ in range(4)]
        found = [(np.subtract(one.joints, at.body.joints), np.subtract(one.force, one.true_force)) for one in held]
        assert np.ptp([force for _, force in found], axis=0) == pytest.approx(0.0, abs=1e-6)
        errors.append(np.concatenate(found[-1]))
    spread = np.std(errors, axis=0) / [1e-5, 1e-5, 0.3, 0.3]
    assert spread == pytest.approx(1.0, abs=0.6)


def test_a_motion_is_linear_between_its_points_and_replaces_the_former() -> None:
    at = plant(lag=0.0)
    begin = at.body.joints
    at.command(('joint2', 'joint1'), [0.4, 0.8], [[begin[1] + 0.2, begin[0]], [begin[1] + 0.2, begin[0] - 0.1]])
    assert at.step(0.1).joints == pytest.approx((begin[0], begin[1] + 0.05))
    assert at.step(0.6).joints == pytest.approx((begin[0] - 0.05, begin[1] + 0.2))
    at.command(at.names, [0.1], [begin])
    assert at.step(0.65).joints == pytest.approx((begin[0] - 0.025, begin[1] + 0.1))
    assert at.step(2.0).joints == pytest.approx(begin)
    at.command(at.names, [1.0], [[begin[0] - 0.2, begin[1]]])
    at.step(2.5)
    at.command(at.names, [], [])
    assert at.step(5.0).joints == pytest.approx((begin[0] - 0.1, begin[1]))


def test_a_joint_follows_with_a_lag_at_most_at_its_speed() -> None:
    at = plant(lag=0.05, speed=0.5)
    begin = at.body.joints[0]
    at.command(at.names, [1e-3], [[begin - 0.5, at.body.joints[1]]])
    at.step(0.4)
    # behind a setpoint in even motion by lag times speed
    assert at.body.joints[0] == pytest.approx(begin - 0.5 * (0.4 - 0.05 * (1 - exp(-0.4 / 0.05))), abs=1.1e-3)
    speeds = np.abs(np.diff([at.step(0.4 + STEP * k).joints[0] for k in range(400)])) / STEP
    assert speeds.max() <= 0.5 + 1e-9
    assert at.body.joints[0] == pytest.approx(begin - 0.5, abs=1e-8)


@pytest.mark.parametrize(
    ('names', 'times', 'points', 'problem'),
    [
        (('joint1',), [1.0], [[0.1]], 'expected the joints joint1 joint2'),
        ((), [], [], 'got none'),
        (('joint1', 'joint2'), [1.0], [[0.1]], 'expected 2 positions'),
        (('joint1', 'joint2'), [1.0, 2.0], [[0.1, 0.2]], 'expected 2 positions'),
        (('joint1', 'joint2'), [1.0], [[0.1, nan]], 'not a finite number'),
        (('joint1', 'joint2'), [1.0, 1.0], [[0.1, 0.1], [0.1, 0.1]], 'time_from_start'),
        (('joint1', 'joint2'), [nan], [[0.1, 0.1]], 'time_from_start'),
        (('joint1', 'joint2'), [1.0], [[0.1, 2.7]], 'joint2 at 2.7 is beyond its limits -2.6 to 2.6'),
    ],
)
def test_a_motion_that_makes_no_sense_is_refused_and_the_former_goes_on(
    names: tuple[str, ...], times: list[float], points: list[list[float]], problem: str
) -> None:
    at = plant(lag=0.0)
    goal = [at.body.joints[0] - 0.1, at.body.joints[1]]
    at.command(at.names, [0.5], [goal])
    with pytest.raises(ParameterError, match=f'^trajectory refused: .*{problem}'):
        at.command(names, times, points)
    assert at.step(1.0).joints == pytest.approx(goal)


def test_the_lift_and_held_joints_are_commanded_and_reported() -> None:
    at = plant(LIFTED)
    assert at.names == ('joint1', 'joint2', 'z', 'wrist')
    with pytest.raises(ParameterError, match=r'z at 0\.05 is beyond its limits'):
        at.command(at.names, [1.0], [[*at.body.joints, 0.05, 0.5]])
    last = go(at, [*at.body.joints, 0.01, 0.4])[-1]
    assert last.joints == pytest.approx([*at.body.joints, 0.01, 0.4], abs=1e-6)


def test_a_coupled_drive_is_commanded_and_reports_in_its_own_angles() -> None:
    at = plant(replace(CELL, coupling=0.25))
    q1, q2 = at.body.joints
    assert at.step(STEP).joints == pytest.approx([q1, q2 + 0.25 * q1], abs=1e-6)
    last = go(at, [q1 + 0.1, q2 + 0.25 * q1])[-1]
    assert at.body.joints == pytest.approx([q1 + 0.1, q2 - 0.025], abs=1e-6)
    assert last.joints == pytest.approx([q1 + 0.1, q2 + 0.25 * q1], abs=1e-6)


def test_raised_the_tip_passes_over_a_disc_lowered_onto_it_the_drives_stop() -> None:
    at, inside = plant(LIFTED), beside(LIFTED.discs[0], 0.1)
    assert not any(reading.touched for reading in go(at, [*inside, 0.02, 0.5], 2.0))
    assert go(at, [*inside, 0.0, 0.5])[-1].touched == 'disc_1'
    assert 'on disc_1' in at.stopped


def test_contact_while_travelling_stops_the_drives_until_reset() -> None:
    at, disc = plant(overload=100.0), CELL.discs[1]
    sides = [beside(disc, -0.03, angle) for angle in (-np.pi / 2, -2.5)]
    through = inverse(PAPER_ACTUAL, np.array([[disc.x - 0.02, disc.y - disc.radius + 0.03]]), 1)[0]
    go(at, sides[0])
    path = go(at, through, 0.3)
    assert path[-1].touched == 'disc_2'
    assert at.stopped.endswith('on disc_2, more than 100 N')
    assert at.peak_force > 100
    assert path[-1].joints == path[-10].joints
    with pytest.raises(ParameterError, match='the drives have stopped'):
        go(at, sides[0])
    at.reset()
    assert go(at, sides[0])[-1].touched == ''
    assert not at.stopped


@pytest.mark.parametrize('turn', [1, -1])
def test_an_obstacle_pushes_back_along_the_normal_of_its_edge_and_from_its_corner(turn: int) -> None:
    square = ((0.35, -0.1), (0.45, -0.1), (0.45, 0.1), (0.35, 0.1))[::turn]
    cell = replace(CELL, obstacles=(square,), tip_radius=0.005)
    for place, push in (((0.345, 0.03), (1.0, 0.0)), ((0.40, 0.105), (0.0, -1.0)), ((0.3465, 0.1035), (0.707, -0.707))):
        away, within = (np.array(place) - amount * np.array(push) for amount in (0.02, -6e-4))
        free, pressed = (inverse(PAPER_ACTUAL, tip[None], -1)[0] for tip in (away, within))
        at = plant(cell, start=tuple(free))
        last = go(at, pressed)[-1]
        assert last.touched == 'obstacle 1'
        assert hypot(*last.true_force) > 3
        assert np.array(last.true_force) / hypot(*last.true_force) == pytest.approx(push, abs=0.06)


def test_faults() -> None:
    at = plant(LIFTED)
    here = [*at.body.joints, 0.02, 0.5]
    goal = [here[0] - 0.1, here[1], 0.0, 0.5]
    for fault, expected in (
        (Malfunction.DOES_NOT_FOLLOW, here),
        (Malfunction.LIFT_STUCK, [*goal[:2], 0.02, 0.5]),
        (Malfunction.MOVED, [goal[0] + 0.04, *goal[1:]]),
        (Malfunction.HELD_MOVES, [*goal[:3], 0.54]),
    ):
        at.fault = fault
        assert go(at, goal)[-1].joints == pytest.approx(expected, abs=1e-6)
    at.fault = Malfunction.FREE_FORCE
    assert at.step(at.time + STEP).force == pytest.approx((30.0, 0.0))
    at.fault = Malfunction.SILENT_JOINTS
    assert at.step(at.time + STEP).joints is None
    at.fault = Malfunction.SILENT_WRENCH
    assert at.step(at.time + STEP).force is None
    at.fault = Malfunction.LATE
    assert go(at, here)[-1].time == pytest.approx(at.time - 0.3, abs=2 * STEP)
    at.fault = Malfunction.NONE
    assert at.step(at.time + STEP).time == at.time


def test_it_starts_near_the_objects_with_room_around() -> None:
    tip = forward(PAPER_NOMINAL, np.array([free_pose(CELL)]))
    gaps = np.hypot(*(tip - CELL.centers).T) - CELL.radii
    assert 0.03 < gaps.min() < 0.05
    wide = replace(CELL, limits=((-7.0, 6.0), (-2.6, 2.6)))
    assert abs(free_pose(wide)[0] + 0.5) < np.pi
    crowded = replace(CELL, discs=(Disc('all', 0.0, 0.0, 1.0),))
    with pytest.raises(UnsupportedDataError, match='no room'):
        free_pose(crowded)
    with pytest.raises(ParameterError, match='drives: lag'):
        PlantSettings(lag=-1.0)


def test_with_velocities_a_motion_is_a_spline_that_begins_with_the_rate_it_has() -> None:
    at = plant(lag=0.0)
    q1, q2 = at.body.joints
    at.command(at.names, [1.0, 2.0], [[q1 - 0.1, q2], [q1 - 0.3, q2]], [[-0.2, 0.0], [0.0, 0.0]])
    assert at.step(0.5).joints[0] == pytest.approx(q1 - 0.5 * 0.1 + 0.125 * 0.2, abs=1e-9)
    assert at.step(1.0).joints[0] == pytest.approx(q1 - 0.1)
    middle = at.step(1.5).joints[0]
    assert middle == pytest.approx(q1 - 0.2 - 0.125 * 0.2, abs=1e-9)
    rate = (at.step(1.5 + 1e-4).joints[0] - middle) / 1e-4
    at.command(at.names, [1.0], [[q1, q2]], [[0.0, 0.0]])
    at.step(1.5 + 2e-4)
    after = [at.step(1.5 + 1e-4 * k).joints[0] for k in (3, 4)]
    assert np.diff(after)[0] / 1e-4 == pytest.approx(rate, abs=2e-3)


def test_a_controller_scales_the_time_may_be_inactive_and_ends_at_rest() -> None:
    at = plant(lag=0.0)
    q1, q2 = at.body.joints
    with pytest.raises(ParameterError, match='the velocity of its last point is not zero'):
        at.command(at.names, [1.0], [[q1 - 0.1, q2]], [[0.1, 0.0]])
    with pytest.raises(ParameterError, match='expected 2 velocities'):
        at.command(at.names, [1.0, 2.0], [[q1 - 0.1, q2], [q1, q2]], [[0.1, 0.0, 0.0], [0.0, 0.0, 0.0]])
    at.scaling = 0.5
    at.command(at.names, [1.0], [[q1 - 0.1, q2]])
    assert at.step(1.0).joints[0] == pytest.approx(q1 - 0.05)
    at.active = False
    assert at.step(1.5).joints[0] == pytest.approx(q1 - 0.05)
    with pytest.raises(ParameterError, match='the controller is not running'):
        at.command(at.names, [1.0], [[q1, q2]])
    at.active = True
    assert at.step(2.0).joints[0] == pytest.approx(q1 - 0.05)

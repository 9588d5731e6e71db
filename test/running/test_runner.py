"""The runner in a simulated cell: a whole run, faults in every phase, and what is refused before anything moves."""

from __future__ import annotations

import re
from collections import deque
from concurrent.futures import BrokenExecutor, Future
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmark.rehearsal import Rehearsal
from scara_kinetostatic.errors import CellError, UnsupportedDataError
from scara_kinetostatic.files.calibration_file import nominal_arm
from scara_kinetostatic.model.cell import Cell, Disc, EffectSizes, Lift, Noise, Region, SizeMode, Uncertainty
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import forward, jacobian, quarter_turn
from scara_kinetostatic.model.kinetostatics import drag
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.planning.motion import Space, Waypoints
from scara_kinetostatic.planning.next_touches import Planner
from scara_kinetostatic.running.campaign import Campaign, End, Knowledge, calibrated, clear_start
from scara_kinetostatic.running.robot import AHEAD_OF_CONTACT, Command, Commander, Fault, Senses, Track
from scara_kinetostatic.running.runner import Runner
from scara_kinetostatic.simulation.commanded import (
    COMMANDED_SENSORS,
    Malfunction,
    ModelBody,
    Plant,
    PlantSettings,
    Reading,
)
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

CELL = Cell(
    Parameters(l1=0.33, l2=0.33, p_ee=1e-5, p1=1e-5, p2=1e-5),
    (Disc('disc_1', -0.25, 0.30, 0.15), Disc('disc_2', 0.20, 0.40, 0.05), Disc('disc_3', 0.05, 0.25, 0.08)),
    noise=Noise(joint=1e-5, force=0.3),
    tolerance=1e-4,
    region=Region(-0.35, 0.35, 0.2, 0.55),
    limits=((-2.6, 2.6), (-2.6, 2.6)),
)
TRUTH = Parameters(
    x0=2e-3, y0=-2e-3, theta1=3e-3, l1=0.3303, theta2=-2e-3, l2=0.3298,
    p_ee=1.5e-5, p1=2e-5, p2=1e-5, g_ee=5e-5, g1=1e-4, g2=1.5e-4,
)  # fmt: skip
LIFT = Lift('joint3', 0.02, 0.0)
WITH_BLOCK = replace(
    CELL,
    discs=(
        Disc('disc_1', -0.25, 0.30, 0.12),
        Outline('block', ((-0.02, 0.30), (0.08, 0.30), (0.08, 0.40), (-0.02, 0.40)), 0.002),
    ),
    tip_radius=0.005,
    tolerance=2e-4,
    uncertainty=Uncertainty(effects=EffectSizes(SizeMode.NONE)),
)
PLANNERS: dict[str, Planner] = {}


def nominal_planner(cell: Cell) -> Planner:
    """That of the nominal arm; what it plans first is worked out once for all runs in a cell."""
    if repr(cell) not in PLANNERS:
        planner = PLANNERS[repr(cell)] = Planner(nominal_arm(cell))
        vars(planner)['accurate'] = cache(planner.accurate)
    return PLANNERS[repr(cell)]


def rehearsal(
    cell: Cell = CELL,
    true: Cell | None = None,
    most: int = 100,
    patience: float = 0.0,
    resolution: float = COMMANDED_SENSORS.resolution,
    planner: Planner | None = None,
    rate: float = 125.0,
    **more: float,
) -> Rehearsal:
    sensors = replace(COMMANDED_SENSORS, bias=(1.4, -1.4), resolution=resolution)
    body = ModelBody(true or cell, TRUTH)
    body.tick = 1 / rate
    plant = Plant(cell, body, sensors=sensors, seed=1)
    planner = planner or nominal_planner(cell)
    one = Rehearsal(cell, plant, most, rate, planner, patience=patience, **more)
    one.runner.start()
    return one


def check_stands(one: Rehearsal, seconds: float = 1.0, within: float = 1e-4) -> None:
    """For some time from now on, s; rad."""
    before = one.plant._position[:2]
    one.run(longest=seconds)
    assert one.plant._position[:2] == pytest.approx(before, abs=within)


def until_phase(one: Rehearsal, phase: str, more: float = 0.2) -> None:
    """Into a phase, by some time, s."""
    one.run(lambda at: at.runner.status.phase == phase and at.time > 3.0, 120.0)
    one.run(longest=more)
    assert one.runner.status.phase == phase


def begin_anew(one: Rehearsal) -> None:
    """As `~/start` does after the end of a run."""
    former = one.runner
    one.runner = Runner(one.cell, 100, one._detector.poll, one._work, nominal_planner(one.cell), 10.0)
    one.runner.take_over(former)
    one.runner.start()


def test_a_run_at_a_disc_and_a_block_reaches_its_tolerance():
    """Though a calibration takes longer than a touch."""
    one = rehearsal(WITH_BLOCK, calibrating=20.0)
    one.run()
    end, campaign = one.runner.end, one.runner.campaign
    assert (end.status, end.reason.partition(':')[0]) == (0, 'enough')
    assert one.plant.peak_force < CELL.touch.max_force
    assert all(meant == met for meant, met in one.contacts)
    assert len(one.contacts) == campaign.accepted + campaign.failed
    touches = TouchSet.concatenate(campaign.touches)
    outcome = calibrate_touches(touches, WITH_BLOCK)
    assert outcome.verdict == 'none' and outcome.tip_uncertainty.worst <= 2.04e-4
    moved = (jacobian(TRUTH, touches.joints) @ touches.press[..., None])[..., 0]
    sides = np.sign((moved * quarter_turn(touches.force)).sum(axis=1))
    planned = drag(np.arctan2(-touches.force[:, 1], -touches.force[:, 0]), touches.posture)
    assert (sides == np.sign(planned))[touches.disc == 0].all(), 'the tip is dragged to the side that was planned'
    assert set(np.sign((moved * touches.force).sum(axis=1))) == {1.0, -1.0}, 'pressed, and eased from a preload'
    std = np.array([outcome[name].std for name in NAMES])
    off = np.array([outcome[name].value for name in NAMES]) - TRUTH.as_array()
    assert np.abs(off / std).max() < 4.5
    phases = [status.phase for _, status in one.history]
    assert phases.index('travel') < phases.index('approach') < phases.index('press') < phases.index('hold')


def test_the_tip_keeps_clear_of_a_block():
    space = Space(WITH_BLOCK, WITH_BLOCK.nominal, 0.012)
    begin = np.array([[0.2, 0.35], [0.2, 0.42], [0.03, 0.35], [0.2, 0.414]])
    end = np.array([[-0.08, 0.35], [-0.08, 0.42], [0.03, 0.36], [-0.08, 0.414]])
    assert space.is_clear(begin, end).tolist() == [False, True, False, False]
    assert space.is_clear(begin[2:3], end[2:3], but=np.array([1]))[0]
    assert space.object_at(np.array([0.03, 0.35])) == 'block'
    assert space.object_at(np.array([0.09, 0.35])) == 'block'
    assert space.object_at(np.array([0.13, 0.35])) == ''


def test_a_robot_from_where_no_way_leads_is_to_be_moved():
    limits = ((-2.27, 2.27), (-2.71, 2.71))
    discs = (
        Disc('disc_1', -0.210, 0.104, 0.094),
        Disc('disc_2', -0.321, -0.189, 0.06),
        Disc('disc_3', 0.079, 0.335, 0.114),
    )
    cell = replace(CELL, nominal=replace(CELL.nominal, l1=0.232, l2=0.352), limits=limits, discs=discs)
    corner = PlantSettings(start=(-2.19, -2.62))
    one = Rehearsal(cell, Plant(cell, ModelBody(cell, ExtendedModel(cell.nominal)), settings=corner))
    one.runner.start()
    one.run()
    reason = r'no way leads from \(-0\.\d{3}, 0\.\d{3}\) m, where the tip is, to the touches: move it'
    assert one.runner.end.status == 1
    assert re.fullmatch(reason, one.runner.end.reason)
    assert one.contacts == []


def test_a_coupled_drive_is_commanded_in_its_own_angles():
    runs = [rehearsal(replace(CELL, coupling=part)) for part in (0.0, 16 / 76)]
    commands = [[command for _ in range(1000) if (command := one.step())] for one in runs]
    assert len(commands[0]) == len(commands[1]) > 30
    for plain, coupled in zip(*commands, strict=True):
        expected = plain.positions + [0.0, 16 / 76] * plain.positions[:, :1]
        np.testing.assert_allclose(coupled.positions, expected, rtol=0, atol=1e-6)
    assert runs[1].plant.body.joints == pytest.approx(runs[0].plant.body.joints, abs=1e-6)


@pytest.mark.parametrize(
    ('phase', 'fault', 'says'),
    [
        ('travel', Malfunction.DOES_NOT_FOLLOW, 'does not follow'),
        ('travel', Malfunction.FREE_FORCE, 'force'),
        ('travel', Malfunction.SILENT_JOINTS, '/joint_states is silent'),
        ('approach', Malfunction.LATE, 's late'),
        ('press', Malfunction.DOES_NOT_FOLLOW, 'does not follow'),
        ('press', Malfunction.HELD_MOVES, 'must not'),
        ('press', Malfunction.FREE_FORCE, 'force'),
        ('press', Malfunction.SILENT_WRENCH, '/wrench is silent'),
    ],
)
def test_a_fault_stops_the_robot_within_a_second(phase, fault, says):
    one = rehearsal(replace(CELL, hold={'joint4': 0.0}))
    until_phase(one, phase)
    one.plant.fault, began = fault, one.time
    one.run(lambda at: at.runner.end is not None, 2.0)
    assert one.time - began < 1.0
    status = one.runner.status
    assert (status.phase, status.is_fault) == ('stopped', True)
    assert says in status.text
    one.run(longest=10.0)
    assert one.runner.is_over
    assert one.runner.end.status == 3
    assert one.plant.peak_force < CELL.touch.max_force
    one.plant.fault = Malfunction.NONE if fault is Malfunction.LATE else fault
    before = one.plant.step(one.time + 0.5).joints
    after = one.plant.step(one.time + 1.0).joints
    if before is not None and after is not None and fault is not Malfunction.HELD_MOVES:
        assert np.abs(np.subtract(after, before)).max() < 1e-4
    if phase == 'press' and fault in (Malfunction.HELD_MOVES, Malfunction.SILENT_WRENCH, Malfunction.FREE_FORCE):
        assert not one.plant.body.touched  # retracted


@pytest.mark.parametrize('fault', sorted({*Malfunction} - {Malfunction.DOES_NOT_FOLLOW, Malfunction.LIFT_STUCK}))
def test_from_a_fifth_of_a_second_after_a_fault_on_nothing_is_pressed_farther(fault):
    one = rehearsal(replace(CELL, hold={'joint4': 0.0}))
    until_phase(one, 'press', 0.0)
    one.plant.fault = fault
    one.run(longest=0.2)
    pressed, forces = np.hypot(*one.plant.body.force), []
    for _ in range(100):
        one.step()
        forces.append(np.hypot(*one.plant.body.force))
    assert (max(forces) > pressed + 5.0) == (fault is Malfunction.NONE)
    assert fault is Malfunction.NONE or max(forces) < pressed + 1.0, 'drives lag by 20 ms'


def test_every_command_is_whole_and_leads_on_from_where_the_robot_is():
    one = rehearsal(replace(CELL, lift=LIFT, hold={'joint4': 0.0}), most=3)
    commands = 0
    while not one.runner.is_over:
        before = np.array(one.plant._setpoint)
        command = one.step()
        if command is None:
            continue
        commands += 1
        assert command.names == (*CELL.joint_names, LIFT.joint, 'joint4')
        assert command.positions.shape == (len(command.times), 4) and np.isfinite(command.positions).all()
        assert command.velocities.shape in (command.positions.shape, (len(command.times), 0))
        assert command.times[0] > 0 and (np.diff(command.times) > 0).all()
        assert np.abs(command.positions[0] - before).max() < 2.0 * (command.times[0] + 0.01), 'rad/s'
    assert commands > 100 and one.runner.campaign.accepted == 3


def test_a_force_that_jumps_across_the_contact_is_seen():
    one = rehearsal(replace(CELL, hold={'joint4': 0.0}))
    # along x, so that the magnitude changes little
    one.run(lambda at: at.runner.status.phase == 'hold' and abs(at.plant.body.force[0]) < 0.4 * at.runner.senses.force)
    before, began = one.runner.senses.force, one.time
    one.plant.fault = Malfunction.FREE_FORCE
    one.run(lambda at: at.runner.end is not None, 2.0)
    assert one.time - began < 0.1
    assert 'the force jumps by 30 N' in one.runner.status.text
    assert one.runner.senses.force - before < 20.0


@pytest.mark.parametrize(
    ('fallen', 'end'), [(4e-4, ''), (3e-3, ': no motion of the robot explains that; none is left')]
)
def test_a_touch_that_slid_has_failed_and_without_a_force_the_run_ends(fallen, end):
    one = rehearsal()
    until_phase(one, 'hold', 0.0)
    campaign, joints = one.runner.campaign, one.plant.body.joints
    discs = tuple(disc._replace(radius=disc.radius - fallen) for disc in CELL.discs)
    one.plant.body = ModelBody(replace(CELL, discs=discs), TRUTH)
    one.plant.body.begin((joints[0], joints[1]), 0.0)
    accepted = campaign.accepted
    one.run(lambda at: at.runner.end is not None or campaign.accepted > accepted, 60.0)
    assert any('the force jumps by' in status.text for _, status in one.history)
    if end:
        assert f'{end} (in hold)' in one.runner.end.reason
        assert not one.plant.body.touched
    else:
        assert (campaign.failed, campaign.accepted) == (1, accepted + 1)
        assert one.plant.peak_force < CELL.touch.max_force


@pytest.mark.parametrize('phase', ['travel', 'approach', 'press'])
def test_the_robot_stands_when_the_runner_dies(phase):
    one = rehearsal()
    until_phase(one, phase)
    one.plant.step(one.time + 0.3)
    if phase == 'travel':  # one command is the whole way, through free space
        one.plant.step(one.time + 20.0)
        assert one.plant.body.joints == pytest.approx(one.runner.robot.motion.track.places[-1, :2], abs=1e-4)
    before = one.plant.step(one.plant.time + 1e-4).joints
    after = one.plant.step(one.plant.time + 2.0).joints
    assert np.abs(np.subtract(after, before)).max() < 1e-4
    assert one.plant.peak_force < 1.5 * CELL.touch.max_force


def test_somebody_else_moves_the_robot():
    one = rehearsal()
    until_phase(one, 'travel', 0.0)
    one.runner.pause()
    one.run(longest=0.5)
    here = one.plant.step(one.time + 0.004).joints
    assert here is not None
    one.plant.command(one.plant.names, [1.0], [[here[0] + 0.3, here[1]]])
    began = one.time
    one.run(lambda at: at.runner.end is not None, 2.0)
    assert one.time - began < 1.0
    assert 'moved by something else' in one.runner.status.text


def test_a_lift_that_does_not_lift_or_is_not_heard():
    one = rehearsal(replace(CELL, lift=LIFT))
    one.plant.fault = Malfunction.LIFT_STUCK
    one.plant._position[2] = one.plant._setpoint[2] = 0.0
    one.run(longest=5.0)
    assert 'behind, joint3 most: it does not follow' in one.runner.status.text
    assert one.fastest < 0.02  # the arm has not moved
    one = rehearsal(replace(CELL, lift=LIFT))
    until_phase(one, 'travel')
    add = one.runner.senses.add_joints
    one.runner.senses.add_joints = lambda now, stamp, joints, lift=None: add(now, stamp, joints)  # type: ignore
    one.run(lambda at: at.runner.end is not None, 1.0)
    assert '/joint_states has no position of joint3 (robot.lift)' in one.runner.status.text


RING = [(0.594 * np.cos(angle), 0.594 * np.sin(angle)) for angle in np.linspace(0, 2 * np.pi, 12, endpoint=False)]
IN_THE_WAY = (*CELL.discs, *(Disc(f'box_{k}', x, y, 0.02) for k, (x, y) in enumerate(RING)))
NOT_THERE = tuple(disc._replace(radius=0.02) for disc in CELL.discs)


@pytest.mark.parametrize(
    ('discs', 'says', 'most'),
    [(IN_THE_WAY, 'contact where none must be', 1.5), (NOT_THERE, 'no contact with disc_', 0.0)],
    ids=['in the way', 'not there'],
)
def test_an_object_that_nobody_knows_or_that_is_missing(discs, says, most):
    one = rehearsal(true=replace(CELL, discs=discs))
    one.run(longest=200.0)
    end = one.runner.end
    assert end.status == 3
    assert says in end.reason
    assert 'remain' not in end.reason
    assert one.plant.peak_force <= most * CELL.touch.max_force
    assert not one.plant.body.touched


def test_a_force_above_the_largest_one():
    one = rehearsal()
    until_phase(one, 'press')
    one.runner.cell = replace(CELL, touch=CELL.touch._replace(max_force=10.0))
    one.run(longest=10.0)
    assert 'more than touch.max_force' in one.runner.status.text
    assert not one.plant.body.touched


def test_pause_start_and_stop():
    one = rehearsal()
    until_phase(one, 'travel', 0.2)
    made = one.runner.campaign.accepted
    one.runner.pause()
    until_phase(one, 'paused')
    assert one.runner.campaign.accepted == made + 1, 'the touch under way'
    before = one.runner.senses.joints
    one.run(longest=2.0)
    assert np.abs(one.runner.senses.joints - before).max() < 1e-4
    one.runner.start()
    until_phase(one, 'press')
    one.runner.stop('stopped')
    one.run(longest=20.0)
    assert one.runner.is_over
    assert not one.plant.body.touched
    assert one.runner.end.status == 3


@pytest.mark.parametrize(
    ('change', 'error', 'says'),
    [
        ({'limits': None}, CellError, 'limits'),
        ({'tolerance': 1e-7}, UnsupportedDataError, 'tolerance is 0.1 µm'),
        ({'limits': ((-0.1, 0.1), (0.1, 0.3))}, UnsupportedDataError, 'no touch can be reached'),
    ],
    ids=['no limits', 'tolerance', 'unreachable'],
)
def test_what_is_refused_before_anything_moves(change, error, says):
    cell = replace(CELL, **change)
    with pytest.raises(error, match=says):
        Rehearsal(cell, Plant(cell, ModelBody(CELL, TRUTH), settings=PlantSettings(start=(0.5, 1.0))))


@pytest.mark.parametrize('fault', [Malfunction.SILENT_WRENCH, Malfunction.SILENT_JOINTS])
def test_a_busy_machine_sees_what_is_missing_and_does_not_wait_for_ever(fault):
    one = rehearsal(patience=3.0)
    until_phase(one, 'travel')
    one.plant.fault, one._period, began = fault, 0.05, one.time
    one.run(lambda at: at.runner.status.phase == 'waiting', 5.0)
    assert 'is silent' in one.runner.status.text
    assert one.time - began < 1.3
    one.run(longest=0.3)
    check_stands(one, within=5e-3)  # it slows down as if it were where it was seen
    one.run(lambda at: at.runner.end is not None, 10.0)
    assert 3.0 < one.time - began < 5.0
    assert 'waited for 3 s' in one.runner.status.text
    assert (one.runner.status.phase, one.runner.end.status) == ('stopped', 3)


def test_a_busy_machine_does_not_begin_without_a_force():
    one = Rehearsal(CELL, Plant(CELL, ModelBody(CELL, TRUTH)), rate=20.0)
    one.plant.fault = Malfunction.SILENT_WRENCH
    one.runner.start()
    commands = [one.step() for _ in range(150)]
    assert not any(commands)
    assert one.runner.status.text == '/wrench is silent (in idle)'


def test_a_process_that_was_killed_while_it_calibrates_ends_the_run():
    one, killed = rehearsal(), Future()
    until_phase(one, 'travel')
    killed.set_exception(BrokenExecutor('the process was terminated'))
    one.runner.campaign._job = killed
    one.run(lambda at: at.runner.is_over, 60.0)
    assert (one.runner.end.status, one.runner.status.is_fault) == (3, True)
    assert one.runner.end.reason.startswith('the process was terminated (in ')


def test_a_robot_that_stands_at_an_object_is_refused():
    one = rehearsal()
    one.plant.sensors = replace(one.plant.sensors, bias=(30.0, 0.0))
    one.run(longest=3.0)
    assert 'where nothing must be touched' in one.runner.status.text
    assert one.fastest < 0.02


def test_a_way_that_turns_back_is_followed_where_it_is_meant():
    """Out and back along the same joints: the robot on its way back is not behind by the whole loop."""
    out = np.linspace(0.0, 0.1, 21)[:, None] * [1.0, -1.0, 0.0] + [1.3, -1.2, 0.0]
    track = Track.of(np.concatenate([out, out[-2::-1]]), TRUTH)
    for at in (0.3, 0.7):
        near, off = track.nearest(track.place(at * track.length) + np.array([1e-5, 1e-5, np.nan]), at * track.length)
        assert near == pytest.approx(at * track.length, abs=1e-4)
        assert off < 1e-4
    far, _ = track.nearest(out[2], 0.4 * track.length)
    assert far == pytest.approx(track.at[2], abs=1e-4), 'a robot that stands behind is found there'
    nowhere = Track.of(np.array([[0.3, 1.0, 0.0]] * 2), TRUTH)
    assert nowhere.nearest(np.array([0.3, 1.02, np.nan]), 0.0) == (nowhere.length, pytest.approx(0.02)) == (0.0, 0.02)


def test_an_arm_that_is_known_stays_known():
    """A fit of touches that do not tell where the tip is plans on with the arm known before, not with the nominal."""
    planner = Planner(replace(nominal_arm(CELL), model=ExtendedModel(TRUTH)), now=1e-4)
    alike = default_plan(CELL, per_disc=18).select(np.arange(12))
    touches = simulate_touches(
        CELL, TRUTH, replace(alike, disc=np.zeros(12, dtype=int), posture=np.ones(12, dtype=int))
    )
    found = calibrated(CELL, touches, planner, (), 0.0)
    assert found.now is None or found.now > 2e-3
    assert found.planner.arm is planner.arm
    assert len(found.planned.plan)


def test_so_many_touches_decide_between_effects_and_no_more():
    asked = list[bool]()

    def work(_: object, cell: Cell, touches: TouchSet, former: Planner, given_up: object, decides: bool) -> Future[Any]:
        asked.append(decides)
        found = Future[Any]()
        found.set_result(Knowledge(former, planned, 1e-4, 'caution', verdict='ambiguous', discriminating=decides))
        return found

    campaign = Campaign(replace(CELL, tolerance=None), 50, None, work)
    planned = campaign.knowledge.planned
    touches = simulate_touches(CELL, TRUTH, default_plan(CELL, 10))
    for k in range(30):
        campaign.accept(SimpleNamespace(touches=touches.select(np.array([k])), start=1))
        assert campaign.poll() is None
    assert asked == [True] * 12 + [False] * 10


@pytest.mark.parametrize('grade', ['caution', 'unfit'])
def test_a_run_whose_touches_do_not_decide_ends_as_undecided(grade):
    undecided = 'place of disc_2 (93 %) or place of disc_1 (7 %); to tell the causes apart, measure the place of disc_2'

    def work(_: object, cell: Cell, touches: TouchSet, former: Planner, *rest: object) -> Future[Any]:
        found = Future[Any]()
        found.set_result(Knowledge(former, planned, 1e-4, grade, verdict='ambiguous', undecided=undecided))
        return found

    campaign = Campaign(CELL, 50, None, work)
    campaign.cell = replace(CELL, tolerance=5e-5)
    planned = campaign.knowledge.planned
    planned = planned._replace(uncertainty=planned.uncertainty._replace(least=6e-5))
    touches = simulate_touches(CELL, TRUTH, default_plan(CELL, 10))
    ends = []
    for k in range(30):
        campaign.accept(SimpleNamespace(touches=touches.select(np.array([k])), start=1))
        ends.append(campaign.poll())
    end = next(end for end in ends if end is not None)
    assert end == End(int(grade == 'unfit'), f'undecided: {undecided}')
    assert ends.index(end) >= 12


def test_travel_is_one_smooth_command_and_a_contact_is_streamed():
    one = rehearsal(replace(CELL, lift=LIFT))
    sent: list[tuple[str, Command]] = []
    while one.runner.campaign.accepted < 2:
        if (command := one.step()) is not None:
            sent.append((one.runner.status.phase, command))
    ways = [command for phase, command in sent if phase == 'travel']
    assert len(ways) in (2, 3), 'the third touch has begun'
    for way in ways[:2]:
        assert way.velocities.shape == way.positions.shape
        assert not way.velocities[-1].any()
        assert np.abs(np.diff(way.velocities, axis=0)).max() < 0.3  # rad/s between two points
    lift = ways[1].positions[:, 2]
    assert lift.max() == pytest.approx(LIFT.up)
    assert lift[-1] == LIFT.down
    contact = [command for phase, command in sent if phase in ('approach', 'press')]
    assert max(command.times[-1] for command in contact) <= AHEAD_OF_CONTACT + 1e-9


@pytest.mark.parametrize('is_known', [False, True])
def test_where_motions_are_not_streamed_there_are_few_and_none_leads_far_beyond_a_contact(is_known):
    known = Planner(replace(nominal_arm(CELL), model=ExtendedModel(TRUTH)), now=1e-4) if is_known else None
    one = rehearsal(replace(CELL, tolerance=None), most=2, planner=known)
    one.runner.robot.streams = False
    counts, commands = [0], 0
    while not one.runner.is_over:
        command = one.step()
        commands += command is not None
        if one.runner.campaign.accepted == len(counts):
            counts.append(commands)
        if command is not None and one.runner.status.phase == 'approach' and not is_known:
            motion = one.runner.robot.motion
            assert motion.sent <= max(motion.at, motion._slow[0]) + AHEAD_OF_CONTACT * motion.speed + 1e-9
    assert 'max_touches' in one.runner.end.reason
    assert not is_known or np.median(np.diff(counts)) <= 6
    assert one.plant.peak_force < CELL.touch.max_force


INACTIVE = 'active', False, True, 'does not follow'
NO_WRENCH = 'fault', Malfunction.SILENT_WRENCH, Malfunction.NONE, '/wrench is silent'
NO_JOINTS = 'fault', Malfunction.SILENT_JOINTS, Malfunction.NONE, '/joint_states is silent'


@pytest.mark.parametrize(
    ('how', 'phase', 'streams'),
    [
        pytest.param(INACTIVE, 'travel', True, id='inactive-travel'),
        pytest.param(INACTIVE, 'press', True, id='inactive-press'),
        pytest.param(NO_WRENCH, 'approach', True, id='no wrench-approach'),
        pytest.param(NO_WRENCH, 'press', False, id='no wrench-press'),
        pytest.param(NO_JOINTS, 'approach', False, id='no joints-approach'),
    ],
)
def test_what_passes_by_itself_is_waited_for(how, phase, streams):
    (what, wrong, well, says), one = how, rehearsal(patience=10.0)
    one.runner.robot.streams = streams
    until_phase(one, phase)
    target, accepted = one.runner.target, one.runner.campaign.accepted
    setattr(one.plant, what, wrong)
    began = one.time
    one.run(lambda at: at.runner.status.phase == 'waiting', 2.0)
    assert one.time - began < 1.0
    assert says in one.runner.status.text
    assert 'waiting for 10 s at most' in one.runner.status.text
    one.run(longest=0.3)
    check_stands(one)
    setattr(one.plant, what, well)
    one.run(lambda at: at.runner.status.phase == 'hold', 60.0)
    is_done = one.runner.campaign.accepted > accepted  # it has stood in contact for longer than a hold
    assert one.runner.target.place() == target.place() or (is_done and phase == 'press')
    accepted = one.runner.campaign.accepted
    one.run(lambda at: at.runner.campaign.accepted > accepted and at.runner.status.phase == 'travel', 60.0)
    assert (one.runner.campaign.accepted, one.runner.end) == (accepted + 1, None)
    assert one.plant.peak_force < 1.5 * CELL.touch.max_force


@pytest.mark.parametrize('cell', [CELL, WITH_BLOCK], ids=['discs', 'block'])
def test_from_every_place_of_a_way_another_one_leads_on(cell):
    """As where it was interrupted, also a little beside the way; but not from within an object."""
    one, found, changes = rehearsal(cell), list[tuple[Track, Any]](), False
    while not changes:  # of the elbow
        one.step()
        track = None if one.runner.robot.motion is None else one.runner.robot.motion.track
        if one.runner.status.phase == 'travel' and track is not None and all(each is not track for each, _ in found):
            found.append((track, one.runner.target))
            changes = bool(np.ptp(np.sign(track.places[:, 1])))
    planner, rng = nominal_planner(cell), np.random.default_rng(3)
    stretched = 0
    for track, target in found[-3:]:
        goal = planner.approach(target.plan)
        for at in np.linspace(0.0, track.length, 25):
            joints = track.place(at)[:2] + rng.uniform(-1e-3, 1e-3, 2)
            start, problem = clear_start(planner, joints)
            assert problem == ''
            stops = Waypoints(
                *(np.concatenate(parts) for parts in zip(start.select(slice(-1, None)), goal, strict=True))
            )
            assert np.isfinite(planner.roadmap.ways(stops).lengths[0, 1])
            stretched += np.hypot(*forward(cell.nominal, joints)) > planner.space.reach
    assert stretched >= 1
    inside = Waypoints(np.array([[-0.25, 0.30]]), np.array([1]))
    assert 'from disc_1): move it away' in clear_start(planner, planner.space.joints(inside)[0])[1]


def test_between_two_objects_the_tip_comes_no_nearer_to_either():
    planner = nominal_planner(CELL)
    gap = 2 * planner.space.clearance - 1e-3
    pair = (Disc('a', -0.05 - gap / 2, 0.4, 0.05), Disc('b', 0.05 + gap / 2, 0.4, 0.05))
    narrow = Planner(nominal_arm(replace(CELL, discs=pair)))
    tip = np.array([[2e-4, 0.4]])
    start, problem = clear_start(narrow, narrow.space.joints(Waypoints(tip, np.array([1])))[0])
    assert (problem, len(start.tip)) == ('', 1)
    along, across = np.array([0.0, 0.1]), np.array([1e-3, 0.0])
    leaves = [narrow.space.is_clear(tip, tip + step, leaves=True)[0] for step in (along, across)]
    assert leaves == [True, False] and not narrow.space.is_clear(tip, tip + along)[0]


@pytest.mark.parametrize('lift', [None, LIFT], ids=['round', 'over'])
@pytest.mark.parametrize('anew', [False, True], ids=['goes on', 'anew'])
def test_an_arm_that_was_stretched_when_it_was_interrupted_is_brought_on(lift, anew):
    one = rehearsal(replace(CELL, lift=lift), patience=10.0)
    one.run(lambda at: at.runner.status.phase == 'travel' and abs(at.plant._position[1] + TRUTH.theta2) < 0.05, 60.0)
    one.plant.active = False
    one.run(lambda at: at.runner.status.phase == 'waiting', 2.0)
    if anew:
        one.runner.stop('stopped')
        one.run(longest=2.0)
    one.plant.active = True
    if anew:
        begin_anew(one)
    one.run(lambda at: at.runner.status.phase == 'hold' or at.runner.end is not None, 60.0)
    assert (one.runner.status.phase, one.runner.end) == ('hold', None)


@pytest.mark.parametrize('moved', [False, True], ids=['stands', 'was moved'])
def test_a_touch_in_which_a_run_has_ended_is_retracted_by_the_next_one(moved):
    one = rehearsal()
    until_phase(one, 'press', 0.4)
    one.runner.fail('somebody else', may_retract=False)
    one.run(longest=1.0)
    assert one.plant.body.touched and one.runner.is_over
    if moved:
        q1, q2 = one.plant._position[:2]
        one.plant.command(one.plant.names, [1.0], [[q1 + 0.01, q2]])
        one.plant.step(one.time + 1.5)
    begin_anew(one)
    one.run(lambda at: at.runner.status.phase == 'hold' or at.runner.end is not None, 60.0)
    says = [status.text for _, status in one.history]
    assert ('retracting the touch of the former run' in says) is not moved
    assert one.plant.peak_force < CELL.touch.max_force
    assert (one.runner.status.phase, one.runner.campaign.accepted) == ('hold', 0)


def test_a_run_that_hears_no_joints_does_not_go_back_to_where_the_former_one_ended():
    one = rehearsal()
    until_phase(one, 'press', 0.4)
    one.runner.fail('somebody else', may_retract=False)
    one.run(longest=1.0)
    one.plant.fault = Malfunction.SILENT_JOINTS
    one.time += 60.0  # in which somebody moves it
    begin_anew(one)
    assert one.runner.obstacle(), 'a stop retracts nothing yet'
    commands = []
    while not one.runner.is_over:
        commands.append(one.step())
    assert not any(commands) and one.runner.is_in_contact and 'is silent' in one.runner.status.text


@pytest.mark.parametrize('streams', [True, False], ids=['streamed', 'few'])
def test_a_coarse_encoder_is_no_robot_that_stands(streams):
    one = rehearsal(most=1, resolution=7.7e-4)  # of 13 bits
    one.runner.robot.streams = streams
    one.run(longest=200.0)
    assert 'max_touches' in one.runner.end.reason
    assert one.runner.campaign.accepted == 1


def test_a_robot_that_runs_ahead_is_stopped():
    one = rehearsal(replace(CELL, lift=LIFT), patience=10.0)
    until_phase(one, 'travel')
    one.plant.scaling, one.plant._elapsed = 1.5, one.plant._elapsed + 0.1
    one.run(lambda at: at.runner.end is not None, 2.0)
    assert 'mm ahead on its way: it is faster than commanded (in travel)' in one.runner.status.text
    one.run(longest=0.3)
    check_stands(one)


def test_a_robot_that_went_on_while_nobody_listened_is_followed():
    one = rehearsal(replace(CELL, lift=LIFT))
    until_phase(one, 'travel')
    at = one.runner.robot.motion.at
    one.time = one.plant.step(one.time + 0.4).time  # as where this machine is busy
    one.run(longest=0.05)
    assert one.runner.robot.motion.at > at + 0.3 * one.runner.robot.motion.speed
    one.run(lambda at: at.runner.status.phase == 'approach', 20.0)
    assert one.runner.end is None


def test_a_busy_machine_that_hears_late_blames_nobody():
    """It stops for up to 0.3 s, again and again; what has come meanwhile is then heard ten messages a tick."""
    one = rehearsal(replace(CELL, tolerance=None), most=4, patience=10.0)
    rng, unheard, until = np.random.default_rng(1), deque[Reading](), 0.0
    while not one.runner.is_over:
        unheard.append(one.plant.step(one.time + one._period))
        one.time = one.plant.time
        if one.time >= until and rng.random() < 1.5 * one._period:
            until = one.time + rng.uniform(0.02, 0.3)
        if one.time >= until:
            for _ in range(min(10, len(unheard))):
                one.hear(unheard.popleft())
            one.answer()
    assert 'max_touches' in one.runner.end.reason
    assert one.plant.peak_force < CELL.touch.max_force


def test_a_streamed_motion_is_not_commanded_on_while_the_robot_is_behind():
    """A controller that scales the time by 0 goes on by one of its periods at each new message."""
    one = rehearsal(replace(CELL, tolerance=None), patience=20.0)
    until_phase(one, 'approach')
    one.plant.scaling, sent = 0.0, list[float]()
    while one.runner.status.phase != 'waiting':
        if one.step() is not None:
            sent.append(one.runner.robot.motion.at - one.runner.robot.near)
    motion = one.runner.robot.motion
    assert max(sent[:-1]) < 0.15 * motion.speed + 3e-4
    assert 'does not follow' in one.runner.status.text


@pytest.mark.parametrize('more', [0.05, 0.3])
def test_a_press_that_is_scaled_to_zero_does_not_creep_on(more):
    """The controller moves on by two of its periods at each new message, whatever the scaling."""
    one = rehearsal(replace(CELL, tolerance=None), most=9, patience=20.0)
    command = one.plant.command

    def creeping(*trajectory: Any) -> None:
        command(*trajectory)
        one.plant._elapsed = 0.008

    one.plant.command = creeping  # type: ignore[method-assign]
    until_phase(one, 'press', more)
    one.plant.scaling, began, accepted = 0.0, one.time, one.runner.campaign.accepted
    one.run(longest=0.3)
    before = one.plant._position[:2]
    one.run(lambda at: at.runner.status.phase == 'waiting', 2.0)
    assert 'does not follow (in press)' in one.runner.status.text
    assert one.time - began < 0.6
    assert one.plant._position[:2] == pytest.approx(before, abs=1e-4)
    one.plant.scaling = 1.0
    one.run(lambda at: at.runner.campaign.accepted > accepted, 30.0)
    assert one.runner.campaign.accepted > accepted


def test_a_robot_that_is_late_when_its_controller_stops_goes_on():
    one = rehearsal(patience=10.0)
    until_phase(one, 'travel', 0.4)
    one.plant.scaling = 0.0
    one.run(longest=0.12)  # more than the joints may be off where they are told to stand
    one.plant.active = False
    one.runner.fail('the controller aborts a trajectory', passes=True)
    one.run(longest=1.0)
    one.plant.active, one.plant.scaling = True, 1.0
    one.run(lambda at: at.runner.status.phase == 'approach' or at.runner.end is not None, 20.0)
    assert one.runner.status.phase == 'approach'


def test_a_way_begins_when_it_is_sent_though_planning_has_taken_long():
    one = rehearsal(replace(CELL, lift=LIFT), patience=10.0)
    while one.step() is None or one.runner.status.phase != 'travel' or one.time < 3.0:
        pass
    motion = one.runner.robot.motion
    one.runner.note(one.time + 2.4)  # sent so late
    halt = one.runner.tick(one.time + 2.41)
    one.runner.tick(one.time + 2.412)
    assert '/joint_states is silent for 2.41 s' in one.runner.status.text
    assert motion.at < 0.02 * CELL.touch.speed
    assert halt.positions[0] == pytest.approx(one.plant._position, abs=2e-3)


def test_a_halt_of_a_robot_that_is_not_heard_is_no_jump():
    """Its controller may have had none of the motion: as after a pause of the network."""
    one = rehearsal(replace(CELL, lift=LIFT), patience=10.0)
    until_phase(one, 'travel', 0.8)
    one.plant.scaling, one.plant.fault, halt = 0.0, Malfunction.SILENT_JOINTS, None
    while one.runner.status.phase != 'waiting':
        halt = one.step()
    moved = np.diff(forward(CELL.nominal, np.array([one.plant._position[:2], halt.positions[0, :2]])), axis=0)
    assert np.hypot(*moved[0]) > 0.06 * CELL.touch.speed
    assert np.hypot(*moved[0]) / halt.times[0] < 1.05 * CELL.touch.speed


def test_a_force_that_comes_while_it_waits_ends_the_run():
    one = rehearsal(patience=10.0)
    until_phase(one, 'travel')
    one.plant.active = False
    one.run(lambda at: at.runner.status.phase == 'waiting', 2.0)
    one.plant.fault, one.plant.active = Malfunction.FREE_FORCE, True
    before = one.plant._position[:2]
    one.run(lambda at: at.runner.end is not None, 5.0)
    assert 'a force of 30' in one.runner.status.text.replace('29.', '30.')
    assert 'where nothing must be touched' in one.runner.status.text
    one.run(longest=1.0)
    assert one.plant._position[:2] == pytest.approx(before, abs=1e-4)


def test_a_controller_that_refuses_is_asked_again_while_it_waits():
    one = rehearsal(patience=10.0)
    until_phase(one, 'travel')
    one.plant.active, sent = False, list[Command]()
    one.runner.fail('the controller rejects a trajectory', passes=True)
    for _ in range(375):
        if (command := one.step()) is not None:
            sent.append(command)
            one.runner.fail('the controller rejects a trajectory', passes=True)
    assert [status.phase for _, status in one.history][-1] == 'waiting'
    assert one.runner.status.phase == 'waiting', 'nothing is commanded that would move'
    assert 5 < len(sent) < 15
    assert all(np.abs(command.positions[-1, :2] - one.plant._position[:2]).max() < 1e-4 for command in sent[1:])
    one.plant.active = True
    one.run(lambda at: at.runner.status.phase == 'approach', 20.0)
    assert one.runner.status.phase == 'approach'


@pytest.mark.parametrize(('streams', 'scaling'), [(True, 0.2), (False, 0.2), (True, 0.0)])
def test_no_way_through_free_space_is_commanded_to_a_robot_that_is_still_in_contact(streams, scaling):
    one = rehearsal(patience=10.0)
    one.runner.robot.streams = streams
    until_phase(one, 'hold')
    one.plant.scaling, began = scaling, one.time
    while one.runner.status.phase in ('hold', 'retract'):
        command = one.step()
        assert command is None or not command.velocities.size or not one.plant.body.touched
    assert (one.runner.status.phase == 'waiting') == (scaling == 0.0)
    assert scaling or one.time - began < CELL.touch.hold + 1.0


def move_while_it_waits(one: Rehearsal, by: float, fault: Malfunction = Malfunction.SILENT_WRENCH) -> None:
    one.plant.fault = fault
    one.run(lambda at: at.runner.status.phase == 'waiting', 2.0)
    one.run(longest=0.5)
    here = one.plant._position[:2]
    one.plant.command(one.plant.names, [1.0], [[here[0] - by, here[1] + by]])
    one.run(longest=1.5)


@pytest.mark.parametrize(('phase', 'by'), [('plan', 0.03), ('travel', 0.1), ('paused', 0.03)])
def test_a_robot_that_was_moved_while_it_waits_does_not_go_on(phase, by):
    """On its way, or between two touches."""
    one = rehearsal(patience=10.0)
    if phase == 'plan':
        one.runner.campaign.choose = lambda *_: None  # as while a calibration is made
        one.run(lambda at: at.runner.status.phase == 'plan')
    else:
        until_phase(one, 'travel')
    if phase == 'paused':
        one.runner.pause()
        until_phase(one, 'paused')
    move_while_it_waits(one, by, Malfunction.SILENT_JOINTS if phase == 'paused' else Malfunction.SILENT_WRENCH)
    assert (one.runner.robot.motion is None) == (phase != 'travel')
    vars(one.runner.campaign).pop('choose', None)
    one.plant.fault = Malfunction.NONE
    one.run(lambda at: at.runner.end is not None, 5.0)
    assert 'mrad off its way' in one.runner.status.text or 'a force of' in one.runner.status.text
    check_stands(one, within=2e-3)


@pytest.mark.parametrize('ends', ['stop', 'patience'])
def test_a_robot_that_was_moved_while_it_waits_is_not_thrown_back(ends):
    one = rehearsal(patience=3.0)
    until_phase(one, 'travel')
    move_while_it_waits(one, 0.05)
    moved = one.plant._position[:2]
    if ends == 'stop':
        one.runner.stop('asked')
    one.run(lambda at: at.runner.is_over, 5.0)
    one.run(longest=0.5)
    assert one.plant._position[:2] == pytest.approx(moved, abs=2e-3)


def test_a_delay_that_the_first_messages_told_wrongly_is_forgotten_before_anything_moves():
    one = rehearsal()
    one.runner.senses._fastest = [-1.0, -1.0]  # a clock that was set
    one.run(lambda at: 'late' in at.runner.status.text, 1.0)
    assert one.runner.status.phase == 'idle' and 'late' in one.runner.status.text
    one.run(lambda at: at.runner.status.phase == 'travel', 3.0)
    assert one.runner.status.phase == 'travel' and one.runner.end is None


def test_a_halt_is_never_refused():
    commander = Commander(CELL, Senses(CELL))
    beyond = np.append(np.array(CELL.limits)[:, 1] + 1e-5, 0.0)
    points = np.array([0.05]), beyond[None]
    with pytest.raises(Fault, match='beyond the limits'):
        commander.command(beyond, points)
    halt = commander.command(beyond, points, is_halt=True)
    np.testing.assert_array_equal(halt.positions[-1][:2], beyond[:2])


@pytest.mark.parametrize('streams', [True, False], ids=['streamed', 'few'])
def test_a_controller_that_scales_the_time_is_late_which_is_no_fault(streams):
    one = rehearsal(replace(CELL, tolerance=None, lift=LIFT), most=1, rate=250.0)
    one.runner.robot.streams, one.plant.scaling = streams, 0.3
    one.run()
    assert 'max_touches' in one.runner.end.reason
    assert (one.runner.campaign.accepted, one.runner.campaign.failed) == (1, 0)
    assert one.plant.peak_force < CELL.touch.max_force


def test_a_busy_machine_does_not_press_on_without_forces():
    one = rehearsal()
    until_phase(one, 'approach')
    one.run(lambda at: at.plant.body.touched, 60.0)
    one.plant.fault, one._period = Malfunction.SILENT_WRENCH, 0.05
    one.run(lambda at: at.runner.end is not None, 5.0)
    assert '/wrench is silent' in one.runner.status.text
    assert one.plant.peak_force < CELL.touch.max_force


def test_a_retract_ends_half_a_millimetre_beside_its_place():
    one = rehearsal(patience=10.0)
    until_phase(one, 'approach', 0.1)
    one.plant.fault = Malfunction.SILENT_WRENCH
    one.run(lambda at: at.runner.status.phase == 'waiting', 2.0)
    one.plant.fault = Malfunction.NONE
    one.run(lambda at: at.runner.status.phase == 'retract', 3.0)
    track, command = one.runner.robot.motion.track, one.plant.command
    beside = np.subtract(*track.place(np.array([5e-4, 0.0])))[:2]
    one.plant.command = lambda names, times, places, *more: command(names, times, (places + beside).tolist(), *more)
    one.run(lambda at: at.runner.status.phase != 'retract', 10.0)
    assert one.runner.status.phase == 'judge'


def test_a_robot_that_is_driven_beyond_its_way_is_stopped():
    one = rehearsal(patience=10.0)
    until_phase(one, 'travel', 0.0)
    until_phase(one, 'approach', 0.03)  # far from the contact
    motion, command = one.runner.robot.motion, one.plant.command
    lengths = np.linspace(motion.at, motion.track.length, 50)[1:]
    command(one.plant.names, (lengths - motion.at) / 0.06, motion.track.place(lengths)[:, :2].tolist())
    one.plant.command = lambda *_: None
    one.run(lambda at: at.runner.end is not None, 5.0)
    assert 'ahead on its way' in one.runner.status.text
    assert one.plant.peak_force < CELL.touch.max_force


def test_a_stop_that_the_robot_does_not_obey_is_said():
    """As of a controller that is not active, and is commanded by messages, which it drops without a word."""
    one = rehearsal()
    until_phase(one, 'press', 0.4)
    one.plant.active = False
    assert not one.runner.obstacle(), 'nothing is known yet'
    one.runner.stop('stopped')
    one.run(longest=1.0)
    assert one.runner.is_over and one.runner.status.is_fault and one.plant.body.touched
    assert one.runner.status.text.startswith('stopped; not retracted: the robot stands ')
    assert one.runner.end == End(3, one.runner.status.text)


def test_a_retract_waits_for_the_robot():
    """Else it jumps when its controller is active again."""
    one = rehearsal(patience=30.0)
    until_phase(one, 'press', 0.1)
    one.plant.active = False
    one.run(lambda at: at.runner.status.phase == 'waiting', 2.0)
    one.run(longest=0.5)
    one.runner.stop('stopped')
    one.run(longest=1.0)
    one.fastest, one.plant.active = 0.0, True
    one.run(longest=2.0)
    assert one.runner.is_over
    assert one.fastest < 0.05

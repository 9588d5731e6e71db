"""The zero of the sensor turns with link 2: the weight of a tool that it does not know, or a zero that is turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from touches.scenes import CELL, feed, topics_of

from scara_kinetostatic.model.cell import SensorFrame, SensorSign
from scara_kinetostatic.model.parameters import PAPER_MEASURED
from scara_kinetostatic.running.robot import Senses
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams
from scara_kinetostatic.touches.contacts import TurningZero, find_turning_zero
from scara_kinetostatic.touches.detection import find_touches
from scara_kinetostatic.touches.online import OnlineDetector
from scara_kinetostatic.touches.streams import WrenchStream, as_signals

GRAVITY = (0.0, -9.81)
BASE, TOOL = SensorFrame
ON_OBJECT, ON_ROBOT = SensorSign
TRUTH = PAPER_MEASURED.replace(gravity=GRAVITY, s1=4.2, s2=1.1)


def upright(frame, sign=ON_OBJECT, weight=None):
    """The cell of the paper, upright."""
    nominal = CELL.nominal.replace(gravity=GRAVITY, s1=4.0, s2=1.0)
    return replace(CELL, nominal=nominal, sensor=CELL.sensor._replace(frame=frame, sign=sign, tool_weight=weight))


def simulated(cell, count=24, seed=0):
    """Without a tool and without a zero."""
    plan = default_plan(cell).select(np.linspace(0, 71, count).astype(int))
    return simulate_streams(cell, TRUTH, plan, seed=seed, sensors=SensorModel(bias=(0.0, 0.0)))


def with_tool(streams, cell, mass, zero=(0.0, 0.0), drift=0.0):
    """The recording of a sensor that carries a tool: its zero is constant on link 2, the weight in the base.

    The flange pushes the tool with F - m g; a sensor on the robot reads the opposite.
    """
    stamp = streams.wrench.stamp
    joints = np.column_stack([np.interp(stamp, streams.joints.stamp, q) for q in streams.joints.position.T])
    along = np.exp(1j * (joints.sum(axis=1) + TRUTH.theta1 + TRUTH.theta2))
    weight = -mass * complex(*GRAVITY) * (-1.0 if cell.sensor.sign is ON_ROBOT else 1.0)
    added = weight / along + complex(*zero) if cell.sensor.frame is TOOL else weight + complex(*zero) * along
    added += drift * np.linspace(0.0, 1.0, len(stamp))
    force = streams.wrench.force + np.column_stack([added.real, added.imag])
    return replace(streams, wrench=WrenchStream(stamp, force))


@pytest.fixture(scope='module', params=[(TOOL, ON_OBJECT), (TOOL, ON_ROBOT), (BASE, ON_OBJECT)], ids=str)
def recording(request):
    """A cell, its recording without a tool, and the touches in it."""
    cell = upright(*request.param)
    streams = simulated(cell)
    return cell, streams, find_touches(streams, cell)


@pytest.mark.parametrize('mass', [0.15, 0.4, 3.0])
def test_weight_of_a_tool_is_found_and_corrected(recording, mass):
    cell, streams, without = recording
    found = find_touches(with_tool(streams, cell, mass, (2.0, -1.0), drift=0.5), cell)
    assert found.found == len(found.touches) == 24
    np.testing.assert_allclose(found.touches.force, without.touches.force, rtol=0, atol=0.1)
    (remark,) = (text for text in found.warnings if 'corrected' in text)
    if cell.sensor.frame is TOOL:
        assert float(remark.rpartition(' ')[2]) == pytest.approx(mass, rel=0.05, abs=0.01)
        assert 'does not know a tool' in remark
    else:
        assert 'turns with link 2, by 2.2 N' in remark


def test_nothing_turns_bit_for_bit(recording):
    cell, streams, without = recording
    assert without.turning == TurningZero()
    level = replace(cell, nominal=CELL.nominal)
    assert find_turning_zero(as_signals(with_tool(streams, cell, 1.0), level), level) == TurningZero()
    assert not [text for text in without.warnings if 'tool' in text]


def test_driver_that_takes_off_too_much():
    cell = upright(TOOL)
    found = find_touches(with_tool(simulated(cell), cell, -0.3), cell)
    assert 'takes off too much for a tool of 0.3 kg' in found.warnings[0]


@pytest.mark.parametrize('sign', [ON_OBJECT, ON_ROBOT])
def test_stated_weight_is_taken(sign):
    cell = upright(TOOL, sign, 1.2)
    streams = simulated(cell, 8)
    without = find_touches(streams, upright(TOOL, sign, 0.0))
    heavy = with_tool(streams, cell, 1.2, (2.0, -1.0))
    found = find_touches(heavy, cell)
    assert found.found == len(found.touches) == 8
    np.testing.assert_allclose(found.touches.force, without.touches.force, rtol=0, atol=0.02)
    assert found.warnings == ()
    # the runner, and whoever tares: the weight is none of a touch
    senses = Senses(cell)
    for number, joints in enumerate(([0.3, 1.1], [0.3, 1.1], [0.3, 1.1], [1.3, 1.6])):
        senses.add_joints(0.1 * number, 0.1 * number, joints)
        for _ in range(3):
            senses.add_force(0.1 * number, 0.1 * number, cell.tool_pull(np.array(joints)) + np.array([2.0, -1.0]))
        if number == 2:
            senses.now = 0.2
            assert senses.tare() == pytest.approx(np.hypot(2.0, 1.0))
    assert senses.force == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize('weight', [None, 1.2])
def test_touches_are_found_while_they_are_made(weight):
    cell = upright(TOOL, weight=weight)
    heavy = with_tool(simulated(cell), cell, 1.2, (2.0, -1.0))
    detector = OnlineDetector(cell)
    answers = [answer for _, answer in feed(detector, topics_of(heavy))]
    touches = np.concatenate([answer.touches.force for answer in [*answers, detector.finish()]])
    known = slice(None if weight else 4, None)  # of the first touches the weight is not yet known well
    np.testing.assert_allclose(touches[known], find_touches(heavy, cell).touches.force[known], rtol=0, atol=0.2)

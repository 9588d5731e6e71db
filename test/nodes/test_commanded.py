"""The simulator as a robot that obeys `joint_trajectory`."""

from __future__ import annotations

from dataclasses import replace

import pytest
from geometry_msgs.msg import WrenchStamped
from nodes.waiting import Bench
from rcl_interfaces.msg import Log
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from scara_kinetostatic.model.cell import PAPER_CELL, Lift
from scara_kinetostatic.nodes.contact_simulator import ContactSimulator
from scara_kinetostatic.nodes.conversion import joint_trajectory

CELL = replace(PAPER_CELL, limits=((-2.6, 2.6), (-2.6, 2.6)), lift=Lift('joint3', 0.02, 0.0), hold={'joint4': 0.1})


class Cockpit(Bench):
    """Commands the robot, and hears where it is and what it says."""

    def __init__(self, node: ContactSimulator) -> None:
        super().__init__(node)
        self._out = self.robot.create_publisher(JointTrajectory, '/joint_trajectory', 10)
        self.states = self.hear(JointState, '/joint_states', 10)
        self.clock = self.hear(Clock, '/clock', 10)
        self.wrenches = self.hear(WrenchStamped, '/wrench', 10)
        self._log = self.hear(Log, '/rosout', 10)
        self.wait(lambda: self.states and self.wrenches and self._out.get_subscription_count())

    @property
    def at(self) -> list[float]:
        return list(self.states[-1].position)

    @property
    def force(self) -> list[float]:
        force = self.wrenches[-1].wrench.force
        return [force.x, force.y]

    def send(self, positions: list[float], names: tuple[str, ...] = ('joint4', 'joint3', 'joint2', 'joint1')) -> None:
        self._out.publish(joint_trajectory(names, [0.5], [positions]))

    def until_said(self, text: str) -> None:
        self.wait(lambda: any(text in line.msg for line in self._log))


@pytest.mark.parametrize('scene', ['', 'plain'])
def test_it_obeys_and_says_what_it_refuses(bench, cell_in, scene):
    """With the robot by its model, and in MuJoCo."""
    if scene:
        pytest.importorskip('mujoco')
    path = cell_in(CELL, sensor=CELL.sensor._replace(zero_service='/contact_simulator/zero'))
    arguments = ('-p', 'bias.x:=3.0', '-p', 'bias.y:=-2.0')
    given = {'commanded': True, 'scene': scene, 'publish_clock': True, 'time_factor': 5.0, 'overload': 50.0}
    b = bench(ContactSimulator, *arguments, on=Cockpit, cell=path, **given)
    assert b.force == pytest.approx([3.0, -2.0], abs=1.0)
    assert b.call('/contact_simulator/zero').message == 'the force is zero'
    b.wait(lambda: b.force == pytest.approx([0.0, 0.0], abs=1.0))

    assert list(b.states[-1].name) == ['joint1', 'joint2', 'joint3', 'joint4']
    q1, q2, *_ = begin = b.at
    b.send([0.1, 0.015, q2 - 0.05, q1 - 0.05])
    goal = [q1 - 0.05, q2 - 0.05, 0.015, 0.1]
    b.wait(lambda: b.at == pytest.approx(goal, abs=2e-4))
    b.send([0.1, 0.0, 5.0, q1])
    b.send([q2, q1], ('joint2', 'joint1'))
    for text in ('joint2 at 5 is beyond its limits', 'expected the joints joint1 joint2 joint3 joint4'):
        b.until_said(f'trajectory refused: {text}')
    assert b.at == pytest.approx(goal, abs=2e-4)
    assert b.call('/contact_simulator/reset').success
    assert b.set('fault', 'nonsense') and not b.set('fault', 'does_not_follow')
    b.send([0.1, 0.02, begin[1], begin[0]])
    heard = len(b.states)
    b.wait(lambda: len(b.states) > heard + 100)
    assert b.at == pytest.approx(goal, abs=2e-4)
    stamps, clock = [state.header.stamp.sec for state in b.states], [said.clock.sec for said in b.clock]
    assert stamps == sorted(stamps) and clock == sorted(clock)
    assert abs(clock[-1] - stamps[-1]) <= 1, 'the clock runs as the stamps do'

    if not scene:  # an overload
        assert not b.set('fault', '')
        b.send([0.1, 0.02, q2, q1 + 0.5])
        b.wait(lambda: b.at[0] > q1 + 0.4)
        b.send([0.1, 0.0, q2, q1 + 0.5])
        b.until_said('the drives have stopped: ')
        b.until_said('call ~/reset')

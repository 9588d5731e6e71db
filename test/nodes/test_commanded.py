"""The simulator as a robot that obeys `joint_trajectory`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from geometry_msgs.msg import WrenchStamped
from nodes.waiting import trigger
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from benchmark.cell_nodes import DemoClient
from scara_kinetostatic.model.cell import PAPER_CELL, Lift
from scara_kinetostatic.nodes.conversion import joint_trajectory

CELL = replace(PAPER_CELL, limits=((-2.6, 2.6), (-2.6, 2.6)), lift=Lift('joint3', 0.02, 0.0), hold={'joint4': 0.1})


class Cockpit:
    """Commands the robot, and hears where it is."""

    def __init__(self, client: DemoClient) -> None:
        self._client, node = client, client._node
        self.states: list[JointState] = []
        self.clock: list[float] = []
        self.forces: list[list[float]] = []
        node.create_subscription(JointState, '/joint_states', self.states.append, 10)
        node.create_subscription(Clock, '/clock', lambda said: self.clock.append(said.clock.sec), 10)
        node.create_subscription(
            WrenchStamped, '/wrench', lambda w: self.forces.append([w.wrench.force.x, w.wrench.force.y]), 10
        )
        self._out = node.create_publisher(JointTrajectory, '/joint_trajectory', 10)
        client.wait('the robot', lambda: bool(self.states) and self._out.get_subscription_count() > 0, 120.0)

    @property
    def at(self) -> list[float]:
        return list(self.states[-1].position)

    def send(self, positions: list[float], names: tuple[str, ...] = ('joint4', 'joint3', 'joint2', 'joint1')) -> None:
        self._out.publish(joint_trajectory(names, [0.5], [positions]))

    def wait(self, until: Callable[[], bool]) -> None:
        self._client.wait('the robot', until, 60.0)

    def set_fault(self, fault: str) -> Any:
        request = SetParameters.Request(parameters=[Parameter('fault', value=fault).to_parameter_msg()])
        return self._client.call('/contact_simulator/set_parameters', SetParameters, request, 60.0).results[0]


@pytest.mark.parametrize('scene', ['', 'plain'])
def test_it_obeys_and_says_what_it_refuses(processes, client, cell_in, scene):
    """With the robot by its model, and in MuJoCo."""
    if scene:
        pytest.importorskip('mujoco')
    path = cell_in(CELL, sensor=CELL.sensor._replace(zero_service='/contact_simulator/zero'))
    parameters = {'cell': path, 'commanded': True, 'scene': scene, 'publish_clock': True, 'time_factor': 5.0}
    processes.start('contact_simulator', parameters | {'bias.x': 3.0, 'bias.y': -2.0, 'overload': 50.0})
    cockpit, log = Cockpit(client), processes.log('contact_simulator')

    forces = cockpit.forces
    client.wait('the force', lambda: bool(forces), 120.0)
    assert forces[-1] == pytest.approx([3.0, -2.0], abs=1.0)
    assert trigger(client, '/contact_simulator/zero').message == 'the force is zero'
    client.wait('zero', lambda: forces[-1] == pytest.approx([0.0, 0.0], abs=1.0), 60.0)

    assert list(cockpit.states[-1].name) == ['joint1', 'joint2', 'joint3', 'joint4']
    q1, q2, *_ = begin = cockpit.at
    cockpit.send([0.1, 0.015, q2 - 0.05, q1 - 0.05])
    goal = [q1 - 0.05, q2 - 0.05, 0.015, 0.1]
    cockpit.wait(lambda: cockpit.at == pytest.approx(goal, abs=2e-4))
    cockpit.send([0.1, 0.0, 5.0, q1])
    cockpit.send([q2, q1], ('joint2', 'joint1'))
    for text in ('joint2 at 5 is beyond its limits', 'expected the joints joint1 joint2 joint3 joint4'):
        cockpit.wait(lambda: f'trajectory refused: {text}' in log.read_text())  # noqa: B023
    assert cockpit.at == pytest.approx(goal, abs=2e-4)
    assert trigger(client, '/contact_simulator/reset').success
    assert not cockpit.set_fault('nonsense').successful
    assert cockpit.set_fault('does_not_follow').successful
    cockpit.send([0.1, 0.02, begin[1], begin[0]])
    heard = len(cockpit.states)
    cockpit.wait(lambda: len(cockpit.states) > heard + 100)
    assert cockpit.at == pytest.approx(goal, abs=2e-4)
    stamps = [state.header.stamp.sec for state in cockpit.states]
    assert stamps == sorted(stamps) and cockpit.clock == sorted(cockpit.clock)
    assert abs(cockpit.clock[-1] - stamps[-1]) <= 1, 'the clock runs as the stamps do'

    if not scene:  # an overload
        assert cockpit.set_fault('').successful
        cockpit.send([0.1, 0.02, q2, q1 + 0.5])
        cockpit.wait(lambda: cockpit.at[0] > q1 + 0.4)
        cockpit.send([0.1, 0.0, q2, q1 + 0.5])
        for text in ('the drives have stopped: ', 'call ~/reset'):
            cockpit.wait(lambda: text in log.read_text())  # noqa: B023

"""What moves the robot: a controller that hears `joint_trajectory`, or a FollowJointTrajectory server.

As `joint_trajectory_controller` of ros2_control has them: every command replaces the one before, which then ends as
aborted; a goal that is not for an active controller, or not of its joints, is rejected. Its parameter `joints` is asked
for where it has one.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

from action_msgs.msg import GoalStatus, GoalStatusArray
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient, get_action_names_and_types
from rclpy.node import Node
from rclpy.qos import qos_profile_action_status_default
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectory

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.nodes.conversion import joint_trajectory
from scara_kinetostatic.running.commands import Command

_TYPE = 'control_msgs/action/FollowJointTrajectory'
_LASTING = ('INVALID_JOINTS', 'OLD_HEADER_TIMESTAMP', 'PATH_TOLERANCE_VIOLATED')
"""Errors of a result that do not pass by themselves."""
_DEACTIVATED = 'deactivat'
"""In what the controller says of a goal that it dropped as it was deactivated; of one in whose place another one came,
with the same code, it says something else.
"""


def follow_joint_trajectory(purpose: str, remedy: str) -> Any:
    """The type of the action.

    Args:
        purpose: the parameter that asks for it.
        remedy: what to do without it.

    Raises:
        InputError: `control_msgs` cannot be imported.
    """
    try:
        return import_module('control_msgs.action').FollowJointTrajectory
    except ImportError as error:
        raise InputError(purpose, 'control_msgs cannot be imported', f'install control_msgs, or {remedy}') from error


class Controller:
    """Commands the robot, and hears how that ends.

    Args:
        node: that commands.
        action: of the server; empty for messages on `joint_trajectory`.
        failed: called where a command failed, with the reason, one sentence, and whether it may pass by itself.

    Attributes:
        is_action: whether it is commanded by goals.
        error: largest difference of a joint from where the controller wants it, by its feedback, rad; None without.

    Raises:
        InputError: `control_msgs` cannot be imported.
    """

    def __init__(self, node: Node, action: str, failed: Callable[[str, bool], None]) -> None:
        self._node, self._failed = node, failed
        self._publisher = node.create_publisher(JointTrajectory, 'joint_trajectory', 10)
        self._client: ActionClient | None = None
        self._name = self._publisher.topic_name
        if action:
            self._kind = follow_joint_trajectory('action', 'leave action empty and command by joint_trajectory')
            self._client, self._name = ActionClient(node, self._kind, action), node.resolve_service_name(action)
        self.is_action, self._number = bool(action), 0
        self.error: float | None = None
        own = f'{self._name}'.rpartition('/')[0]
        self._topic = f'{own}/joint_trajectory' if action else self._name
        self._parameters = node.create_client(GetParameters, f'{own}/get_parameters')
        self._asked: Future | None = None
        self._foreign, self._goals = '', f'{own}/follow_joint_trajectory'
        if not action:
            status, quality = f'{self._goals}/_action/status', qos_profile_action_status_default
            node.create_subscription(GoalStatusArray, status, self._hear, quality)

    def absence(self) -> str:
        """That nobody moves the robot; empty where somebody does."""
        if self._client is None:
            heard = self._publisher.get_subscription_count() > 0
            return '' if heard else f'nobody hears {self._name}: start the controller, or remap the topic'
        if self._client.server_is_ready():
            return ''
        kinds = [kind for name, kinds in get_action_names_and_types(self._node) if name == self._name for kind in kinds]
        if kinds and _TYPE not in kinds:
            return f'the action {self._name} is a {" and ".join(kinds)}, expected {_TYPE}'
        return f'nobody serves the action {self._name}: start the controller, or set action'

    def problem(self, joints: tuple[str, ...]) -> str:
        """That somebody else commands as well, or that the controller has other joints; empty where all is well.

        Args:
            joints: that are commanded.
        """
        own = self._node.get_namespace(), self._node.get_name()
        found = self._node.get_publishers_info_by_topic(self._topic)
        others = [
            f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            for info in found
            if (info.node_namespace, info.node_name) != own
        ]
        if others or len(found) > 1:
            return f'another node publishes {self._topic}, {", ".join(others) or "of the same name"}: end it'
        if self._foreign and self._node.count_publishers(f'{self._goals}/_action/status'):
            return self._foreign
        if not self._parameters.service_is_ready():
            self._asked = None  # the next controller is asked anew
        elif self._asked is None:
            request = GetParameters.Request(names=['joints', 'allow_partial_joints_goal'])
            self._asked = self._parameters.call_async(request)
        values = self._asked.result().values if self._asked and self._asked.done() else []
        known = list(values[0].string_array_value) if values else []
        if known and (set(joints) - set(known) or (set(known) - set(joints) and not values[1].bool_value)):
            return (
                f'the controller of {self._name} moves {" ".join(known)}, the cell names {" ".join(joints)}: '
                f'correct robot.joint_names, robot.lift and robot.hold'
            )
        return ''

    def send(self, command: Command) -> None:
        """Sends a command, which replaces the former."""
        trajectory = joint_trajectory(command.names, *(part.tolist() for part in command[1:]))
        if self._client is None:
            self._publisher.publish(trajectory)
            return
        self._number += 1
        goal = self._kind.Goal(trajectory=trajectory)
        answer = self._client.send_goal_async(goal, feedback_callback=self._follow)
        answer.add_done_callback(partial(self._take_answer, self._number))

    def _hear(self, message: GoalStatusArray) -> None:
        """Of goals of the controller that is commanded by messages: each is somebody else's."""
        under_way = {GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING}
        is_commanded = any(goal.status in under_way for goal in message.status_list)
        self._foreign = f'somebody else sends goals to {self._goals}: end that' if is_commanded else ''
        if is_commanded:
            self._failed(self._foreign, False)

    def _follow(self, message: Any) -> None:
        self.error = max((abs(each) for each in message.feedback.error.positions), default=0.0)

    def _take_answer(self, number: int, future: Future) -> None:
        if future.exception() is not None:
            self._failed(f'the controller does not answer: {future.exception()}', True)
        elif future.result().accepted:
            future.result().get_result_async().add_done_callback(partial(self._take_result, number))
        elif number == self._number:
            self._failed('the controller rejects a trajectory: it is not active, or its log says why', True)

    def _take_result(self, number: int, future: Future) -> None:
        if future.exception() is not None:
            return  # the next goal tells
        status, result = future.result().status, future.result().result
        if number != self._number or status == GoalStatus.STATUS_SUCCEEDED:
            return
        if status == GoalStatus.STATUS_CANCELED:
            self._failed('somebody cancelled a trajectory', False)
            return
        names = ('INVALID_GOAL', *_LASTING, 'GOAL_TOLERANCE_VIOLATED')
        name = next((name for name in names if getattr(self._kind.Result, name) == result.error_code), 'no error code')
        text = f'the controller aborts a trajectory ({name}, {result.error_code}): {result.error_string}'
        is_dropped = name == 'INVALID_GOAL' and _DEACTIVATED not in result.error_string
        passes = not is_dropped and name not in ('no error code', *_LASTING)
        self._failed(text + is_dropped * ': somebody else commands the robot', passes)

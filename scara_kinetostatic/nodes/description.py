"""The URDF of a robot as a node such as `robot_state_publisher` publishes it, `std_msgs/msg/String`, latched."""

from __future__ import annotations

from time import monotonic

import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.nodes.streams import LATCHED

_PATIENCE = 10.0
"""How long a URDF is waited for, s."""


def heard_description(topic: str) -> str:
    """The text on a topic.

    Raises:
        InputError: the name is none of a topic, or nothing comes.
    """
    context, texts = Context(), list[str]()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node, executor = rclpy.create_node('cell', context=context), SingleThreadedExecutor(context=context)
        executor.add_node(node)
        try:
            node.create_subscription(String, topic, lambda message: texts.append(message.data), LATCHED)
        except InvalidTopicNameException as error:
            raise InputError(topic, 'is no name of a topic', 'write it as ros2 topic list does') from error
        end = monotonic() + _PATIENCE
        while not texts and monotonic() < end:
            executor.spin_once(timeout_sec=0.1)
        executor.shutdown()
    finally:
        context.try_shutdown()
    if not texts:
        remedy = 'start robot_state_publisher, or give the file by --urdf'
        raise InputError(topic, f'no robot description in {_PATIENCE:g} s', remedy)
    return texts[0]

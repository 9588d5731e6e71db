"""Compares the `frame_id` of the wrenches with the cell description, with the fixed transforms on `/tf_static`.

`tf2_msgs` is not needed: without it a `frame_id` is judged by its name alone.
"""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.nodes.conversion import frame_of
from scara_kinetostatic.nodes.wrench_frame import WrenchFrame

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None

_TOPIC = '/tf_static'
_FIXED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""As every node of ROS subscribes to fixed transforms."""


class FrameCheck:
    """Looks at the last wrench when it is asked.

    Args:
        node: on which to subscribe.
        stated: frame that the cell description states.

    Attributes:
        last: the last wrench as it came over the wire; empty before the first.
    """

    def __init__(self, node: Node, stated: SensorFrame) -> None:
        self.last = b''
        self._frame = WrenchFrame(stated)
        if TFMessage is None:
            node.get_logger().info('tf2_msgs is not installed: the frame_id of a wrench is judged by its name alone')
        else:
            node.create_subscription(TFMessage, _TOPIC, self.note, _FIXED)

    def note(self, message: Any) -> None:
        """Takes fixed transforms in, a `tf2_msgs/TFMessage`."""
        for item in message.transforms:
            turn = item.transform.rotation
            self._frame.add_fixed(item.header.frame_id, item.child_frame_id, (turn.x, turn.y, turn.z, turn.w))

    def complaint(self) -> str:
        """How the last wrench contradicts the cell description; empty if it does not."""
        return self._frame.complaint(frame_of(self.last)) if self.last else ''

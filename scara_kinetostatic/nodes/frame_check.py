"""What the `frame_id` of the wrenches says beside the cell description, by the fixed transforms on `/tf_static`.

`tf2_msgs` is not needed: without it a `frame_id` is judged by its name alone, and no force is turned.
"""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from scara_kinetostatic.bags.cdr import decode_transforms
from scara_kinetostatic.bags.messages import TF_STATIC
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.nodes.conversion import frame_of
from scara_kinetostatic.touches.streams import FixedTransform, WrenchFrame

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None

_FIXED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""As every node of ROS subscribes to fixed transforms."""
_MOST = 1000
"""Most messages that are kept: every transform once, some with others."""
Turn = list[list[float]]
"""Two rows of three."""


class FrameCheck:
    """Knows how wrenches are turned into the frame of the cell description.

    Args:
        node: on which to subscribe.
        stated: frame that the cell description states.
        changed: called with each message of fixed transforms that says something new, as it came, and whether wrenches
            like the last one are turned otherwise by it.

    Attributes:
        last: the last wrench as it came over the wire; empty before the first.
    """

    def __init__(self, node: Node, stated: SensorFrame, changed: Callable[[bytes, bool], None]) -> None:
        self.last = b''
        self._logger = node.get_logger()
        self._stated = stated
        self._frame = WrenchFrame(stated)
        self._changed = changed
        self._known: dict[tuple[str, ...], tuple[list[FixedTransform], bytes]] = {}
        self._turns: dict[str, Turn | None] = {}
        self._stated_last = ''
        if TFMessage is None:
            text = 'tf2_msgs is not installed: the frame_id of a wrench is judged by its name, and no force is turned'
            self._logger.info(text)
        else:
            node.create_subscription(TFMessage, TF_STATIC, self.note, _FIXED, raw=True)

    @property
    def messages(self) -> list[bytes]:
        """The fixed transforms as they came, one message for each set of frames."""
        return [message for _, message in self._known.values()]

    def note(self, message: bytes) -> None:
        """Takes fixed transforms in, a `tf2_msgs/TFMessage` as it came over the wire."""
        try:
            transforms = decode_transforms(message)
        except ValueError as error:
            self._logger.warning(str(error))
            return
        key = tuple(sorted(item.child for item in transforms))
        former = self._known.pop(key, None)
        if former is None and len(self._known) >= _MOST:
            return
        self._known[key] = (transforms, message)
        if former is not None and former[0] == transforms:
            return
        before = self.turn(self.last) if self.last else None
        for transform in transforms:
            self._frame.add(transform)
        self._turns = {}
        self._changed(message, bool(self.last) and self.turn(self.last) != before)

    def turn(self, wrench: bytes) -> Turn | None:
        """How a wrench is turned; None where it is taken as it comes.

        Args:
            wrench: as it came over the wire.
        """
        self.last = wrench
        if not self._known:
            return None
        frame_id = frame_of(wrench)
        if frame_id not in self._turns:
            self._turns = dict(list(self._turns.items())[-_MOST:])
            turn = self._frame.turn(frame_id)
            self._turns[frame_id] = None if turn is None else turn.tolist()
        return self._turns[frame_id]

    def news(self) -> str:
        """How forces are turned, in words, where that has changed since the last call; else empty."""
        former, self._stated_last = self._stated_last, self._frame.description(frame_of(self.last)) if self.last else ''
        return (self._stated_last or 'forces are not turned any more') if self._stated_last != former else ''

    def description(self) -> str:
        """How the last wrench is turned, in words."""
        if not self.last:
            return 'no wrench yet'
        frame_id = frame_of(self.last)
        return self._frame.description(frame_id) or f'{frame_id or "no frame_id"}: taken as {self._stated.value}'

    def complaint(self) -> str:
        """How the last wrench contradicts the cell description; empty if it does not."""
        return self._frame.complaint(frame_of(self.last)) if self.last else ''

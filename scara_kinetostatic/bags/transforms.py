"""The fixed transforms of a recording: the messages on `/tf_static`."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from scara_kinetostatic.touches.streams import FixedTransform

TF_STATIC = '/tf_static'
TF_MESSAGE = 'tf2_msgs/msg/TFMessage'


def decode_transforms(payload: bytes, encoding: str = 'cdr') -> list[FixedTransform]:
    """The transforms of a `tf2_msgs/msg/TFMessage`.

    Args:
        payload: the serialized message.
        encoding: `cdr` or `ros1`.

    Raises:
        ValueError: the bytes are no such message.
    """
    message: Any
    try:
        if encoding == 'ros1':
            message = _store(Stores.ROS1_NOETIC).deserialize_ros1(payload, TF_MESSAGE)
        else:
            message = _store(Stores.ROS2_JAZZY).deserialize_cdr(payload, TF_MESSAGE)
    except Exception as error:  # rosbags raises whatever the bytes lead to
        raise ValueError(f'{TF_STATIC}: the message is no {TF_MESSAGE}') from error
    found = []
    for item in message.transforms:
        turn = item.transform.rotation
        found.append(FixedTransform(item.header.frame_id, item.child_frame_id, (turn.x, turn.y, turn.z, turn.w)))
    return found


@lru_cache
def _store(kind: Stores) -> Typestore:
    return get_typestore(kind)

"""A touch as the collector judges it, and its message on `~/touch`.

The message is a `diagnostic_msgs/DiagnosticArray` with one status: a standard type that carries a level, a sentence and
values by name, and that every tool shows without the interfaces of this package. Its header stamp is the middle of the
hold by the clock of the two streams. Level OK: accepted; WARN: rejected or discarded, with the reason. Values, in SI
units, empty where unknown:

============= =========================================================================
`recording`   folder of the recording
`touch`       number of the touch in it, from 0
`accepted`    `true` or `false`
`discarded`   `true` or `false`: by `~/discard_last`
`reason`      why it is not accepted
`object`      the object touched
`frame`       of the force: that of the sensor, `base` or `tool`
`fx_N`        force on the object
`fy_N`        force on the object
`q1_rad`      joint angle
`q2_rad`      joint angle
`approach1`   motion of joint 1 in its last movement before the hold, rad; its sign is the direction of approach
`approach2`   that of joint 2
`press1`      the part of `approach1` in contact, rad
`press2`      that of `approach2`
============= =========================================================================
"""

from __future__ import annotations

from math import hypot
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.nodes.conversion import stamp_of
from scara_kinetostatic.touches.detection import DISCARDED, Detection


class JudgedTouch(NamedTuple):
    """One touch, accepted or not.

    Attributes:
        number: in the recording.
        stamp: middle of its hold, of the contact where there is none, ns by the clock of the streams.
        contact: begin and end of the contact, ns by the same clock.
        reason: why it is rejected; empty where it is accepted.
        object: name of the object touched; empty where unknown.
        force: on the object, in the frame of the sensor, (fx, fy), N; empty where unknown.
        joints: (q1, q2), rad; empty where unknown.
        approach: motion of each joint before the hold, then the part of it in contact, rad; empty where unknown.
        received: when the wrench of that stamp was received, ns; 0 where unknown.
    """

    number: int
    stamp: int
    contact: tuple[int, int]
    reason: str
    object: str = ''
    force: tuple[float, ...] = ()
    joints: tuple[float, ...] = ()
    approach: tuple[float, ...] = ()
    received: int = 0

    @property
    def line(self) -> str:
        """In one line, for the log."""
        if self.reason:
            return f'touch {self.number} rejected: {self.reason}'
        return f'touch {self.number}: {self.object}, {hypot(*self.force):.1f} N'

    def message(self, node: str, recording: str, frame: str) -> DiagnosticArray:
        """The message on `~/touch`.

        Args:
            node: full name of the node.
            recording: folder of the recording.
            frame: of the force.
        """
        force, joints = (pair or ('', '') for pair in (self.force, self.joints))
        values = {
            'recording': recording,
            'touch': self.number,
            'accepted': str(not self.reason).lower(),
            'discarded': str(self.reason == DISCARDED).lower(),
            'reason': self.reason,
            'object': self.object,
            'frame': frame,
            'fx_N': force[0],
            'fy_N': force[1],
            'q1_rad': joints[0],
            'q2_rad': joints[1],
            **dict(zip(('approach1', 'approach2', 'press1', 'press2'), self.approach or ('',) * 4, strict=True)),
        }
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if self.reason else DiagnosticStatus.OK,
            name=f'{node}: touch {self.number}',
            message=self.line,
            hardware_id='scara_kinetostatic',
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = stamp_of(self.stamp)
        return array


def judged_touches(detection: Detection, cell: Cell) -> list[JudgedTouch]:
    """The touches of a detection in the order of time."""
    held = detection.held
    places = {index: place for place, index in enumerate(held.index.tolist())}
    accepted = set(detection.touches.index.tolist())
    judged = []
    for episode in detection.episodes:
        begin, end, middle = (
            detection.start + round(1e9 * time) for time in (*episode.contact, 0.5 * sum(episode.hold))
        )
        touch = JudgedTouch(episode.index, middle, (begin, end), episode.reason)
        if (place := places.get(episode.index)) is not None:
            touch = touch._replace(
                object=cell.discs[int(held.disc[place])].name if episode.index in accepted else '',
                force=tuple(held.force[place].tolist()),
                joints=tuple(held.joints[place].tolist()),
                approach=(*held.approach[place].tolist(), *held.press[place].tolist()),
            )
        judged.append(touch)
    return judged

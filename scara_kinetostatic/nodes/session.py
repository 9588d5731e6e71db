"""A recording in progress: every message is written to the bag, every touch counted once the bag holds it durably.

The message on `~/touch` is a `diagnostic_msgs/DiagnosticArray` with one status: a standard type that carries a level, a
sentence and values by name, and that every tool shows without the interfaces of this package. Its header stamp is the
middle of the hold by the clock of the two streams. Level OK: accepted; WARN: rejected or discarded, with the reason.
Values, in SI units, empty where unknown:

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

import json
import shutil
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from math import hypot
from pathlib import Path
from time import monotonic
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from scara_kinetostatic.bags.writer import BagWriter, fresh_folder
from scara_kinetostatic.errors import OutputError, ScaraKinetostaticError, one_line
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.nodes.cell_node import CellNode
from scara_kinetostatic.nodes.conversion import TOUCH_NUMBERS, Sample, diagnostic, stamp_of
from scara_kinetostatic.nodes.streams import LATCHED_TOUCHES, CellStreams, Stream
from scara_kinetostatic.touches.clock import SECOND
from scara_kinetostatic.touches.detection import DISCARDED, Detection, no_touches
from scara_kinetostatic.touches.online import OnlineDetector

_LEAST_FREE = 1024
"""Of the disk, MiB."""
_MIB = _LEAST_FREE**2


class JudgedTouch(NamedTuple):
    """One touch, accepted or not.

    Attributes:
        number: in the recording.
        stamp: middle of its hold, of the contact where there is none, ns by the clock of the streams.
        reason: why it is rejected; empty where it is accepted.
        object: name of the object touched; empty where unknown.
        force: on the object, in the frame of the sensor, (fx, fy), N; empty where unknown.
        joints: (q1, q2), rad; empty where unknown.
        approach: motion of each joint before the hold, then the part of it in contact, rad; empty where unknown.
        received: when the wrench of that stamp was received, ns; 0 where unknown.
    """

    number: int
    stamp: int
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
        """The message on `~/touch`; see the docstring of the module.

        Args:
            node: full name of the node.
            recording: folder of the recording.
            frame: of the force.
        """
        numbers = *(self.joints or ('',) * 2), *(self.force or ('',) * 2), *(self.approach or ('',) * 4)
        values = {
            'recording': recording,
            'touch': self.number,
            'accepted': str(not self.reason).lower(),
            'discarded': str(self.reason == DISCARDED).lower(),
            'reason': self.reason,
            'object': self.object,
            'frame': frame,
            **dict(zip(TOUCH_NUMBERS, numbers, strict=True)),
        }
        name, level = f'{node}: touch {self.number}', DiagnosticStatus.WARN if self.reason else DiagnosticStatus.OK
        array = diagnostic(name, level, self.line, values, 'scara_kinetostatic')
        array.header.stamp = stamp_of(self.stamp)
        return array


def judged_touches(detection: Detection, cell: Cell) -> list[JudgedTouch]:
    """The touches of a detection in the order of time."""
    held = detection.held
    places = {index: place for place, index in enumerate(held.index.tolist())}
    judged = []
    for episode in detection.episodes:
        middle = detection.start + round(SECOND / 2 * sum(episode.hold))
        touch = JudgedTouch(episode.index, middle, episode.reason)
        if (place := places.get(episode.index)) is not None:
            touch = touch._replace(
                object='' if episode.reason else cell.discs[int(held.disc[place])].name,
                force=tuple(held.force[place].tolist()),
                joints=tuple(held.joints[place].tolist()),
                approach=(*held.approach[place].tolist(), *held.press[place].tolist()),
            )
        judged.append(touch)
    return judged


class Session:
    """Writes a bag and finds the touches in it.

    Args:
        parent: folder in which a new one is made.
        cell: the cell description, which travels in the bag.
        log_time: now, ns, by the clock that gives the messages their log time.
        streams: of the cell; their fixed transforms are recorded first.

    Attributes:
        folder: the bag.
        touches: touches found and durably recorded.
        rejected: the same of touches that were rejected or discarded.
        news: last touch, one line; empty before the first.
        latest: the touches reported last.

    Raises:
        OutputError: the folder cannot be made or written to; also in every method.
    """

    def __init__(self, parent: Path, cell: Cell, log_time: int, streams: CellStreams | None = None) -> None:
        self.touches = self.rejected = self._discarded = 0
        self.news = self._reason = ''
        topics = None if streams is None else streams.topics
        self.latest = Detection(no_touches())
        self._cell = cell
        self._writer = BagWriter(fresh_folder(parent, 'touches'), cell, log_time=log_time, topics=topics)
        self.folder = self._writer.folder
        self._detector = OnlineDetector(cell, topics=topics)
        self._accepted: deque[JudgedTouch] = deque(maxlen=LATCHED_TOUCHES.depth)
        self._secured, self._last_message, self._secured_at = True, monotonic(), monotonic()
        try:
            for message in streams.frame.messages if streams else ():
                self.take_transforms(message, log_time)
        except BaseException:
            self.abandon()
            raise

    def take(self, stream: Stream, message: bytes, log_time: int, samples: list[Sample]) -> None:
        """Takes a message in.

        Args:
            stream: where it came from.
            message: as it came, CDR.
            log_time: when it came, ns.
            samples: that it completes.
        """
        of_joints, writer, detector = stream is Stream.JOINTS, self._writer, self._detector
        (writer.write_joint_state if of_joints else writer.write_wrench)(message, log_time)
        self._secured, self._last_message = False, monotonic()
        add = detector.add_joint_state if of_joints else detector.add_wrench
        for sample in samples:
            add(sample.stamp_ns, (*sample[1:3], *sample.others), log_time - sample.age_ns)

    def take_transforms(self, message: bytes, log_time: int, anew: bool = False) -> list[JudgedTouch]:
        """Takes fixed transforms in.

        Args:
            message: as it came, CDR.
            log_time: when it came, ns.
            anew: whether the forces to come are turned otherwise than those before.

        Returns:
            The touches before, not yet reported.
        """
        self._writer.write_transforms(message, log_time)
        self._secured = False
        if not anew:
            return []
        found = self._secure(self._detector.finish())
        self._detector.restart()
        return found

    def poll(self) -> list[JudgedTouch]:
        """Looks for touches that have ended since the last call; the bag holds them when this returns.

        Also secures the end of streams that have fallen silent, so that a calibration now and one after `close` agree.

        Returns:
            The touches.
        """
        found = self._secure(self._detector.poll())
        now = monotonic()
        if not self._secured and (now - self._last_message > 1.0 or now - self._secured_at > 600.0):
            self._checkpoint()
        return found

    def discard_last(self, log_time: int) -> JudgedTouch | None:
        """Discards the last accepted touch that is not discarded yet; the bag says so when this returns.

        Args:
            log_time: now, ns.

        Returns:
            The touch with that reason; None where there is none.
        """
        if not self._accepted:
            return None
        touch = self._accepted.pop()._replace(reason=DISCARDED)
        which = {'touch': touch.number, 'stamp': touch.stamp, 'received': touch.received}
        self._writer.write_discard(json.dumps(which), log_time)
        self.touches, self.rejected, self._discarded = self.touches - 1, self.rejected + 1, self._discarded + 1
        self.news = touch.line
        return touch

    def close(self) -> list[JudgedTouch]:
        """Completes the bag; a touch still under way counts.

        Returns:
            The touches not yet reported.
        """
        try:
            return self._secure(self._detector.finish())
        finally:
            self._writer.close()

    def abandon(self) -> None:
        """Lets go of a bag that cannot be written to any more; what was secured stays."""
        with suppress(OutputError):
            self._writer.close()

    def details(self) -> dict[str, str]:
        """The figures of the recording by name."""
        return {
            'recording': str(self.folder),
            'touches': str(self.touches),
            'rejected': str(self.rejected),
            'last touch': self.news or 'none yet',
            'clock': self.clock_warning or 'header stamps',
            'disk free [MiB]': str(self._disk_free()),
        }

    def _disk_free(self) -> int:
        """MiB."""
        return shutil.disk_usage(self.folder).free // _MIB

    def disk_warning(self) -> str:
        """That less than `_LEAST_FREE` is left; empty if more is."""
        free = self._disk_free()
        return '' if free >= _LEAST_FREE else f'the disk of {self.folder.parent} has {free} MiB left: make room'

    @property
    def clock_warning(self) -> str:
        """What had to be corrected in the stamps to find touches; empty if nothing."""
        return self._detector.clock_warning

    def rejections(self) -> str:
        """How many of the touches are rejected and why, where they are many; else empty."""
        rejected = self.rejected - self._discarded
        total = self.touches + rejected
        if 5 * rejected <= total:
            return ''
        return f'{rejected} of {total} touches rejected, the last: {self._reason}'

    def _secure(self, new: Detection) -> list[JudgedTouch]:
        self.latest = new
        if not new.found:
            return []
        self._checkpoint()
        self.touches += len(new.touches)
        self.rejected += len(new.rejected)
        judged = [t._replace(received=self._detector.received(t.stamp)) for t in judged_touches(new, self._cell)]
        self._accepted += [touch for touch in judged if not touch.reason]
        self.news = judged[-1].line
        self._reason = next((each.reason for each in reversed(judged) if each.reason), self._reason)
        return judged

    def _checkpoint(self) -> None:
        self._writer.checkpoint()
        self._secured, self._secured_at = True, monotonic()


class RecordingNode(CellNode):
    """A node that records: what fails in the recording ends it, not the node."""

    _session: Session | None = None

    def _lost(self, reason: str) -> None:
        """Notes that the recording has failed; it is no more."""

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """What fails in the block ends the recording."""
        try:
            yield
        except (ScaraKinetostaticError, OSError) as error:
            if self._session is not None:
                self._session.abandon()
            self._session = None
            self._lost(one_line(str(error)))

    def _record(self, stream: Stream, message: bytes, received: int, samples: list[Sample]) -> None:
        """Takes a message in: all go into the bag, the usable ones to the touch detection, too."""
        if self._session is not None:
            if self.get_clock().ros_time_is_active:  # which stands still meanwhile
                samples = [sample._replace(age_ns=0) for sample in samples]
            with self._guarded():
                self._session.take(stream, message, self.log_time(received), samples)

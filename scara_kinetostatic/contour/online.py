"""The contour of an object while the tip slides along it.

The latest part of both streams is traced again and again, as a recording is (`trace_signals`). What lies farther back
along the path than `_SETTLED` does not change any more: it is joined to the outlines for good, and its samples are
dropped. So neither memory nor work grows with the length of a slide; of outlines, `MOST_NODES` nodes are kept.

The zero of the force is that of the latest free motion, or the one that `tare` took since; each contact has the zero of
the free motion right before it, as in a recording. A zero that was taken in contact, or that has drifted far, shows
itself where the tip then moves along the supposed force (`zero_if_free`).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from scara_kinetostatic.contour.contact import LARGEST_ZERO, LONGEST_SMOOTHING, force_zero, zero_if_free
from scara_kinetostatic.contour.joining import JoinedPasses, Outline
from scara_kinetostatic.contour.path import WINDOWS
from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.contour.trace import JumpError, trace_signals
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.cell import Sensor
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.touches.contacts import AFTER_CONTACT, find_contacts
from scara_kinetostatic.touches.online import StreamPair
from scara_kinetostatic.touches.signals import Signals, as_signals

MOST_NODES = 20_000
"""Nodes that are kept of all outlines, 10 m; beyond, the outline that was begun first is forgotten."""
SECOND = 1_000_000_000
_SOURCE = 'the slide'
_MOST = 300_000
"""Samples of a topic that are kept at most, whatever their stamps."""
_LONGEST = 20 * SECOND
"""Samples in contact are kept at most so long, ns, where the tip creeps or rests."""
_SETTLED = WINDOWS[0]
"""Farther back along the path than this, m, nothing changes any more."""
_NEVER = -(1 << 62)
"""Before all stamps, ns."""


class OnlineContour:
    """Traces the surface along which the tip slides, sample by sample. Not thread-safe.

    Args:
        arm: the calibrated arm.
        sensor: frame and sign of the force sensor; None: as the calibration's cell has them.
        tip_radius: m; None: as the calibration's cell has it.
        topics: names of joint states and wrenches, for messages; None: those of the cell.

    Attributes:
        arm: the calibrated arm.
        tip_radius: m.
        contour: what the last poll traced, the latest part of the slide; None without contact.
        zero: what the sensor reports without force, (2,), N; None as long as it is not known.
        forgotten: outlines that were forgotten as there were too many.
    """

    def __init__(
        self,
        arm: CalibratedArm,
        sensor: Sensor | None = None,
        tip_radius: float | None = None,
        topics: tuple[str, str] | None = None,
    ) -> None:
        self.arm, self._sensor = arm, sensor or arm.cell.sensor
        self.tip_radius = (arm.cell.tip_radius if tip_radius is None else tip_radius) or 0.0
        self._topics = topics or arm.cell.sensor.topics
        self.restart()
        self.clear()

    def restart(self) -> None:
        """Drops samples and zero, as where forces are turned otherwise from here on; the outlines stay."""
        self._pair = StreamPair(self._topics, _MOST, self._sensor.time_offset)
        self._clock_problem = ''
        self._until = _NEVER
        self.zero: Floats | None = None
        self.contour: Contour | None = None
        self._forget_problems()

    def clear(self) -> None:
        """Forgets the outlines; what comes begins new ones."""
        self._joined = self._shown = JoinedPasses()
        self._forget_problems()
        self._doubt = ''
        self._present = self.forgotten = 0
        self._until = max(self._until, self._pair.joints.now)

    def add_joint_state(self, stamp_ns: int, joints: Sequence[float], received: int) -> None:
        """One sample of q1, q2, rad, with its header stamp and when it was received, ns."""
        self._pair.joints.append(stamp_ns, received, joints)

    def add_wrench(self, stamp_ns: int, force: Sequence[float], received: int) -> None:
        """One sample of fx, fy as the sensor reports them, N, with its header stamp and when it was received, ns."""
        self._pair.wrench.append(stamp_ns, received, force)

    @property
    def outlines(self) -> tuple[Outline, ...]:
        """The outlines so far, in the order in which they were begun."""
        return self._shown.outlines

    @property
    def present(self) -> Outline | None:
        """The outline along which the tip slides, or slid last; None before the first."""
        outlines = self.outlines
        return outlines[self._present] if self._present < len(outlines) else None

    @property
    def now(self) -> int:
        """Stamp of the latest joint angles, ns."""
        return self._pair.joints.now

    @property
    def problem(self) -> str:
        """Why the last poll traced nothing although something is touched; a jump for a while, and until the outlines
        are forgotten that parts of them may be wrong.
        """
        event = self._event if self.now < self._happened + 30 * SECOND else ''
        return '; '.join(filter(None, (self._doubt, event, self._problem)))

    def _forget_problems(self) -> None:
        self._problem = self._event = ''
        self._happened = _NEVER

    @property
    def clock_problem(self) -> str:
        """What had to be corrected in the stamps; or empty."""
        return self._pair.problem or self._clock_problem

    def tare(self, span: int) -> Floats:
        """Takes the mean force of the last so many ns as zero, (2,), N; nothing must be touched.

        Raises:
            UnsupportedDataError: there is no force yet.
        """
        recent = self._pair.wrench.latest(span)
        if not len(recent):
            raise UnsupportedDataError('there is no force yet')
        self.zero = recent.mean(axis=0)
        return self.zero

    def poll(self) -> bool:
        """Traces what has come; whether the outlines have changed."""
        before, self._problem, self.contour = self._shown, '', None
        signals = self._signals()
        if signals is None:
            return False
        if self._find_zero(signals):
            touching = _is_touching(self._last_contact(signals), signals)
            try:
                self._trace(signals, touching)
                self._drop(self.now - (_LONGEST if touching else 3 * SECOND))
            except JumpError as jump:
                self._event, self._happened = f'{jump.what}; {jump.remedy}', self.now
                with suppress(JumpError):
                    self._trace(signals.stretch(-np.inf, jump.times[0]), touching=False)
                self._drop(signals.start + round(1e9 * jump.times[-1]))
        return self._shown is not before

    def _signals(self) -> Signals | None:
        """The samples that are kept, on one clock; None where there are too few."""
        if any(len(buffer.samples.stamp) < 2 for buffer in self._pair.buffers):
            return None
        streams = self._pair.streams(_SOURCE)
        if streams is None:
            if self._pair.is_refused:
                self._clock_problem = self._pair.problem
                self._pair = StreamPair(self._topics, _MOST, self._sensor.time_offset)
            else:
                self._problem = (
                    'the clocks of the topics seem to differ: nothing is traced until that is sure, for 15 s at most'
                )
            return None
        return as_signals(streams, self.arm.cell)

    def _last_contact(self, signals: Signals) -> float:
        """End of the last contact by the zero that is known, s; minus infinity where there is none."""
        ends = np.empty(0) if self.zero is None else find_contacts(signals, self.zero, LONGEST_SMOOTHING).end
        return float(ends[-1]) if len(ends) else -np.inf

    def _find_zero(self, signals: Signals) -> bool:
        """Follows the zero of the force; whether there is one.

        What comes after the last contact is free by the zero that is known; a light contact looks like a zero.
        """
        last = self._last_contact(signals)
        if self.zero is not None and _is_touching(last, signals):
            self._heal_zero(signals)
            return True
        try:
            self.zero = force_zero(signals.stretch(last + AFTER_CONTACT, np.inf), _SOURCE)
        except UnsupportedDataError as error:
            self._problem = '' if self.zero is not None else error.problem
        return self.zero is not None

    def _heal_zero(self, signals: Signals) -> None:
        """Corrects a zero that was taken in contact, or that has drifted, where nothing is touched."""
        assert self.zero is not None
        tip = forward(self.arm.model.parameters, signals.joints.value)
        found = zero_if_free(signals, self.zero, tip)
        if found is None:
            return
        wrong = float(np.hypot(*(found - self.zero)))
        self.zero = found
        if wrong > LARGEST_ZERO and self.outlines:
            self._doubt = (
                f'the zero of the force was wrong by {wrong:.1f} N, and so is what was traced with it: call clear'
            )

    def _trace(self, signals: Signals, touching: bool) -> None:
        """Traces the samples, joins what is new, and drops what is joined for good.

        Raises:
            JumpError: the tip jumps.
        """
        try:
            contour = trace_signals(signals, _SOURCE, self.arm, self._sensor, self.tip_radius, self.zero)
        except JumpError:
            raise
        except UnsupportedDataError as error:
            self._problem = error.problem if touching else ''
        else:
            self._join(contour, signals.start, self.now, touching)

    def _join(self, contour: Contour, start: int, now: int, touching: bool) -> None:
        """Joins the new points of a contour to the outlines, those for good that do not change any more."""
        stamps = start + np.round(1e9 * contour.time).astype(np.int64)
        last = np.flatnonzero(contour.passes == contour.passes.max())
        away = np.hypot(*(contour.surface[last] - contour.surface[-1]).T)
        settled = np.ones(len(contour), dtype=bool)
        if touching:
            self.contour, self.zero = contour, contour.zero
            settled[last[_after(away > _SETTLED) :]] = False
            settled |= stamps < now - _LONGEST // 2
        new = settled & (stamps > self._until)
        if new.any():
            self._present = self._add(self._joined, contour, new)
            self._until = int(stamps[new].max())
            self._forget()
        self._shown = self._joined.copy()
        rest = ~settled & (stamps > self._until)
        if rest.any():
            self._present = self._add(self._shown, contour, rest)
        # smoothing and the begin of a pass take some
        keep = int(stamps[last[max(_after(away > 2 * _SETTLED) - 1, 0)]]) - 3 * SECOND // 10
        self._drop(keep if touching else self._until)

    def _add(self, joined: JoinedPasses, contour: Contour, which: Mask) -> int:
        """Joins points, each part of a pass with some of that before it; number of the last outline."""
        present = self._present
        for number in np.unique(contour.passes[which]):
            own = np.flatnonzero(contour.passes == number)
            part = own[which[own]]
            before = own[own < part[0]]
            # m: by it two parts of a pass are found to be one
            before = before[np.hypot(*(contour.surface[before] - contour.surface[part[0]]).T) < 3e-3]
            if len(part) + len(before) > 1:
                present = joined.add(contour.stretch(np.concatenate([before, part])))
        return present

    def _forget(self) -> None:
        """Forgets the outlines that were begun first, where there are too many."""
        while self._joined.nodes > MOST_NODES:
            self._joined.drop_first()
            self.forgotten, self._present = self.forgotten + 1, max(self._present - 1, 0)

    def _drop(self, stamp: int) -> None:
        """Drops the samples before a stamp, ns."""
        for buffer in self._pair.buffers:
            buffer.drop_before(stamp)


def _is_touching(last: float, signals: Signals) -> bool:
    """Whether something is touched at the end of the samples.

    Args:
        last: end of the last contact, s.
        signals: the samples.
    """
    # s: a contact is over when the force has been back at its zero for so long
    return float(signals.wrench.time[-1]) - last < 0.25


def _after(mask: Mask) -> int:
    """The index after the last one where a mask is true, 0 where it is nowhere."""
    found = np.flatnonzero(mask)
    return int(found[-1]) + 1 if len(found) else 0

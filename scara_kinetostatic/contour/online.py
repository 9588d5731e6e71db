"""The contour of an object while the tip slides along it.

The latest part of both streams is traced again and again, as a recording is (`trace_signals`), and its passes are shown
joined to the outlines. When the tip leaves the object, or `_LONGEST_PATH` is exceeded, they are joined for good and
their samples dropped but for the last `_KEPT_PATH`, by which the next part is found to be of the same outline. So
neither memory nor work grows with the length of a slide.

The zero of the force is that of the latest free motion, or the one that `tare` took since; each contact has the zero of
the free motion right before it, as in a recording. A zero that was taken in contact, or that has drifted far, shows
itself where the tip then moves along the supposed force (`zero_if_free`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scara_kinetostatic.contour import trace
from scara_kinetostatic.contour.result import Contour, Parts, Polyline, add_pass, outlines_of
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Sensor, SensorSign
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.online import check_free
from scara_kinetostatic.model.parameters import MILLI
from scara_kinetostatic.touches.clock import SECOND
from scara_kinetostatic.touches.contacts import AFTER_CONTACT, find_contacts
from scara_kinetostatic.touches.online import StreamPair
from scara_kinetostatic.touches.streams import Signals, as_signals

_SOURCE = 'the slide'
_LONGEST = 20 * SECOND
"""Samples in contact are kept at most so long, ns, where the tip creeps or rests."""
_MOST_SAMPLES, _SHOWN = 300_000, 30 * SECOND
"""Samples of a topic that are kept; for how long an event is shown, ns."""
_LONGEST_PATH, _KEPT_PATH = 20 * MILLI, 2 * trace.WINDOWS[0]
"""Length of the path, m, from which on it is joined for good, and of its end that is traced again."""


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
    """

    def __init__(
        self,
        arm: CalibratedArm,
        sensor: Sensor | None = None,
        tip_radius: float | None = None,
        topics: tuple[str, str] | None = None,
    ) -> None:
        self.arm, self._sensor, self._topics = arm, sensor or arm.cell.sensor, topics or arm.cell.sensor.topics
        self.tip_radius = (arm.cell.tip_radius if tip_radius is None else tip_radius) or 0.0
        self._shown: Parts = ()
        self.restart()
        self.clear()

    def restart(self) -> None:
        """Drops samples and zero, as where forces are turned otherwise from here on; the outlines stay."""
        self._pair, self._joined = StreamPair(self._topics, _MOST_SAMPLES, self._sensor.time_offset), self._shown
        self.zero: Floats | None = None
        self.contour: Contour | None = None
        self._problem = self._event = self._clock_problem = ''
        self._until = 0

    def clear(self) -> None:
        """Forgets the outlines; what comes begins new ones."""
        self._joined = self._shown = ()
        self._problem = self._event = self._doubt = self._clock_problem = ''
        self._present = 0
        self._drop(self.now)

    def add_joint_state(self, stamp_ns: int, joints: Sequence[float], received: int) -> None:
        """One sample of q1, q2, rad, with its header stamp and when it was received, ns."""
        self._pair.joints.append(stamp_ns, received, joints)

    def add_wrench(self, stamp_ns: int, force: Sequence[float], received: int) -> None:
        """One sample of fx, fy as the sensor reports them, N, with its header stamp and when it was received, ns."""
        self._pair.wrench.append(stamp_ns, received, force)

    @property
    def outlines(self) -> tuple[Polyline, ...]:
        """The outlines so far, in the order in which they were begun."""
        return outlines_of(self._shown)

    @property
    def present(self) -> Polyline | None:
        """The outline along which the tip slides, or slid last; None before the first."""
        return next(iter(self.outlines[self._present :]), None)

    @property
    def now(self) -> int:
        """Stamp of the latest joint angles, ns."""
        return self._pair.joints.now

    @property
    def problem(self) -> str:
        """Why the last poll traced nothing although something is touched; for 30 s a jump, or forces that contradict
        the motion; and until the outlines are forgotten that parts of them may be wrong.
        """
        event = self._event if self.now < self._until else ''
        return '; '.join(filter(None, (self._doubt, event, self._problem)))

    @property
    def clock_problem(self) -> str:
        """What had to be corrected in the stamps; or empty."""
        return self._pair.problem or self._clock_problem

    def tare(self, span: int) -> Floats:
        """Takes the mean force of the last so many ns as zero, (2,), N; nothing must be touched.

        Raises:
            UnsupportedDataError: there is no force yet, or the tip presses against an object that is known.
        """
        if not len(recent := self._pair.wrench.latest(span)):
            raise UnsupportedDataError('there is no force yet')
        zero, sign = recent.mean(axis=0), -1.0 if self._sensor.sign is SensorSign.ON_ROBOT else 1.0
        if len(joints := self._pair.joints.latest(0)):
            check_free(self.arm, joints[-1:], sign * (zero[None] - (0.0 if self.zero is None else self.zero)))
        self.zero = zero
        return self.zero

    def poll(self) -> bool:
        """Traces what has come; whether the outlines have changed."""
        before, self._problem, self.contour = self._shown, '', None
        signals = self._signals()
        if signals is None or not self._find_zero(signals):
            return False
        last, touching = self._last_contact(signals)
        try:
            contour = trace.trace_signals(signals, _SOURCE, self.arm, self._sensor, self.tip_radius, self.zero)
        except trace.JumpError as jump:
            self._event, self._until = f'{jump.what}; {jump.remedy}', self.now + _SHOWN
            self._joined = self._shown
            self._drop(self.now)
        except UnsupportedDataError as error:
            self._problem = error.problem if touching else ''
            self._drop(self.now - (_LONGEST if touching else 3 * SECOND))
        else:
            if contour.contradiction:
                self._event, self._until = f'{contour.contradiction}; {trace.FRAME_OR_SIGN}', self.now + _SHOWN
            self._join(contour, signals, touching, last)
        return self._shown is not before

    def _signals(self) -> Signals | None:
        """The samples that are kept, on one clock; None where there are too few."""
        if any(len(buffer.samples.stamp) < 2 for buffer in self._pair.buffers):
            return None
        streams = self._pair.streams(_SOURCE)
        if streams is not None:
            self._clock_problem = ''
            return as_signals(streams, self.arm.cell)
        if self._pair.is_refused:
            self._clock_problem = self._pair.problem
            self._pair, self._joined = StreamPair(self._topics, _MOST_SAMPLES, self._sensor.time_offset), self._shown
        else:
            what = 'the clocks of the topics seem to differ'
            self._problem = f'{what}: nothing is traced until that is sure, for 15 s at most'
        return None

    def _last_contact(self, signals: Signals) -> tuple[float, bool]:
        """End of the last contact by the zero that is known, s, and whether it still lasts; minus infinity for none."""
        ends = np.empty(0) if self.zero is None else find_contacts(signals, self.zero, trace.LONGEST_SMOOTHING).end
        last = float(ends[-1]) if len(ends) else -np.inf
        # over when the force has been back at its zero for as long as it may be smoothed
        return last, float(signals.wrench.time[-1]) - last < trace.LONGEST_SMOOTHING

    def _find_zero(self, signals: Signals) -> bool:
        """Follows the zero of the force; whether there is one.

        What comes after the last contact is free by the zero that is known; a light contact looks like a zero.
        """
        last, touching = self._last_contact(signals)
        if self.zero is None or not touching:
            try:
                self.zero = trace.force_zero(signals.stretch(last + AFTER_CONTACT, np.inf), _SOURCE)
            except UnsupportedDataError as error:
                self._problem = '' if self.zero is not None else error.problem
            return self.zero is not None
        found = trace.zero_if_free(signals, self.zero, forward(self.arm.model.parameters, signals.joints.value))
        if found is not None:
            wrong, self.zero = float(np.hypot(*(found - self.zero))), found
            if wrong > trace.LARGEST_ZERO and self.outlines:
                what = f'the zero of the force was wrong by {wrong:.1f} N'
                self._doubt = f'{what}, and what was traced with it: call clear'
        return True

    def _join(self, contour: Contour, signals: Signals, touching: bool, last: float) -> None:
        """Joins the passes of a contour to the outlines, for good where the contact or the path is long past."""
        self._shown = self._joined
        for number in range(int(contour.passes.max()) + 1):
            self._shown, self._present = add_pass(self._shown, contour.stretch(contour.passes == number))
        if not touching:
            self._joined = self._shown
            self._drop(signals.start + round(SECOND * last))
            return
        self.contour, self.zero = contour, contour.zero
        step = np.hypot(*np.diff(contour.surface, axis=0).T)
        left = np.append(np.cumsum(step[::-1])[::-1], 0.0)  # path from each point to the last
        if left[0] > _LONGEST_PATH or signals.joints.time[-1] - contour.time[0] > _LONGEST / SECOND:
            self._joined = self._shown
            kept = contour.time[max(int((left > _KEPT_PATH).sum()) - 1, 0)]
            # s: smoothing and the begin of a pass take some
            self._drop(max(signals.start + round(SECOND * (kept - 0.3)), self.now - _LONGEST))

    def _drop(self, stamp: int) -> None:
        """Drops the samples before a stamp, ns."""
        for buffer in self._pair.buffers:
            buffer.drop_before(stamp)

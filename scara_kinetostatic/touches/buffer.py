"""The latest samples of topics that are still running, and the clock that both topics of a cell have in common."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.touches.arrivals import Samples
from scara_kinetostatic.touches.clock import Judgement, KnownClocks, judge_clocks

_SURE = 3_000_000_000
"""After less than this time the difference of the clocks may be that of the first delays, ns;"""
_SURE_IF_LATE = 15_000_000_000
"""after less than this where messages were received late all the time, ns."""


class SampleBuffer:
    """The latest samples of one topic in the order of arrival.

    They come into lists and go into arrays many at a time: one by one an array takes five times as long.

    Args:
        most: samples that are kept at most, whatever their stamps.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._times: list[int] = []
        self._pairs: list[float] = []
        self._room = _room(1024)
        self._first = self._last = self._seen = 0
        self._shift = 0
        self._by_log_time = False

    def append(self, stamp: int, log_time: int, value: Sequence[float]) -> None:
        """One sample with its header stamp and when it was received, ns."""
        self._times += (log_time if self._by_log_time else stamp, log_time)
        self._pairs.extend(value)
        if len(self._times) > self._most:
            self._store()

    @property
    def samples(self) -> Samples:
        """All that are kept."""
        if self._times:
            self._store()
        return _part(self._room, self._first, self._last)

    @property
    def now(self) -> int:
        """The latest stamp, ns; a single one that is far off does not count."""
        latest = sorted(self.samples.stamp[-7:].tolist())
        return int(latest[len(latest) // 2]) if latest else 0

    @property
    def received(self) -> int:
        """When the latest sample was received, ns; 0 where there is none."""
        times = self.samples.log_time
        return int(times[-1]) if len(times) else 0

    def fresh(self, before: int) -> Floats:
        """The values added since the last call, and so many before them, (k, 2); none where none were added."""
        values = self.samples.values
        begin = max(self._seen - self._first, 0)
        self._seen = self._last
        return values[max(begin - before, 0) if begin < len(values) else begin :]

    def latest(self, span: int) -> Floats:
        """The values of the last so many ns, at least one, (k, 2)."""
        stamps, _, values = self.samples
        recent = stamps[-2048:] > self.now - span
        return values[-2048:][recent] if recent.any() else values[-1:]

    def log_time_of(self, stamp: int) -> int:
        """When the sample was received whose stamp is nearest, ns."""
        samples = self.samples
        return int(samples.log_time[np.argmin(np.abs(samples.stamp - stamp))])

    def use_log_time(self) -> None:
        """Times of reception are the stamps from now on, those of the kept samples as well."""
        if self._by_log_time:
            return
        self.samples.stamp[:] = self.samples.log_time
        self._by_log_time, self._shift = True, 0

    def shift(self, by: int) -> None:
        """Adds to the stamps of the kept samples and of those to come, ns."""
        self.samples.stamp[:] += by
        self._shift += by

    def replace(self, samples: Samples) -> None:
        """Puts shifted samples in place of those kept; later ones are shifted like the last."""
        self._shift += int(samples.stamp[-1] - self.samples.stamp[-1])
        self._room = samples
        self._first, self._last = 0, len(samples.stamp)
        self._seen = self._last

    def clear(self) -> None:
        """Drops all samples; later ones are stamped as before."""
        self._store()
        self._first = self._seen = self._last

    def drop_before(self, stamp: int) -> None:
        """Drops the samples that came before the first one with this stamp or a later one."""
        stamps = self.samples.stamp
        if len(stamps) and stamps[0] < stamp:
            later = stamps >= stamp
            self._first += int(later.argmax()) if later.any() else len(later)

    def _store(self) -> None:
        """Moves what came into the arrays, and the oldest samples out of them if they are too many."""
        times = np.array(self._times, dtype=np.int64).reshape(-1, 2)
        new = Samples(times[:, 0] + self._shift, times[:, 1], np.array(self._pairs, dtype=float).reshape(-1, 2))
        self._times, self._pairs = [], []
        count = len(times)
        if self._last + count > len(self._room.stamp):
            self._first = max(self._first, self._last + count - self._most)
            self._make_room(count)
        for room, values in zip(self._room, new, strict=True):
            room[self._last : self._last + count] = values
        self._last += count

    def _make_room(self, count: int) -> None:
        """Moves the kept samples to the front of arrays of up to twice the length that is needed."""
        kept = _part(self._room, self._first, self._last)
        size = len(kept.stamp)
        self._room = _room(max(1024, 2 * (size + count)))
        for room, values in zip(self._room, kept, strict=True):
            room[:size] = values
        self._seen = max(self._seen - self._first, 0)
        self._first, self._last = 0, size


def _room(size: int) -> Samples:
    return Samples(np.empty(size, np.int64), np.empty(size, np.int64), np.empty((size, 2)))


def _part(samples: Samples, first: int, last: int) -> Samples:
    return Samples(samples.stamp[first:last], samples.log_time[first:last], samples.values[first:last])


class StreamPair:
    """The latest samples of joint angles and forces.

    Args:
        topics: their names, for messages.
        most: samples of a topic that are kept at most.

    Attributes:
        joints: joint angles, rad.
        wrench: forces as the sensor reports them, N.
        problem: what was corrected in the stamps the last time, or why they cannot be judged; or empty.
    """

    def __init__(self, topics: tuple[str, str], most: int) -> None:
        self._topics = topics
        self.joints, self.wrench = SampleBuffer(most), SampleBuffer(most)
        self.problem = self._said = ''
        self._known = KnownClocks()
        self._since: tuple[int, int] | None = None

    def restart(self) -> None:
        """Drops all samples; what is known of the clocks stays."""
        for buffer in self.buffers:
            buffer.clear()

    @property
    def buffers(self) -> tuple[SampleBuffer, SampleBuffer]:
        """Those of both topics."""
        return self.joints, self.wrench

    def judged(self) -> Judgement | None:
        """Both topics on one clock; None where there is none, or not yet: one topic stepped, the other will."""
        warnings: list[str] = []
        samples = (self.joints.samples, self.wrench.samples)
        self._since = self._since or (int(samples[1].log_time[0]), int(samples[1].stamp[0]))
        try:
            judged = judge_clocks('online', dict(zip(self._topics, samples, strict=True)), warnings, self._known)
        except RecordingError as error:
            self.problem = error.problem
            return None
        self._said = next((text for text in warnings if 'header.stamp' in text), '')
        return judged

    def is_sure(self, judged: Judgement, now: int = 0) -> bool:
        """Whether it may be relied upon: after a short time the lags may be those of first delays.

        Args:
            judged: what was found.
            now: on the clock of the reception, ns, where nothing may come any more; 0: when the last was received.
        """
        assert self._since is not None
        unchanged = judged.known[:2] == self._known[:2]
        if any(self._known.shifts) or (unchanged and (judged.on_time or judged.joined)):
            return True
        waited = max(self.wrench.received, now) - self._since[0]
        stamped = self.wrench.now - self._since[1]
        if judged.by_log_time:
            return judged.at_one_rate and waited > _SURE
        return max(waited, stamped) > (_SURE if judged.on_time else _SURE_IF_LATE)

    def moved(self, stamp: int, buffer: SampleBuffer, judged: Judgement) -> int:
        """A stamp of one of the buffers by the clock that was found valid, before `correct`, ns."""
        if judged.by_log_time:
            return stamp if self._known.by_log_time else buffer.log_time_of(stamp)
        return stamp + judged.shifts[self.buffers.index(buffer)]

    def correct(self, judged: Judgement) -> None:
        """Puts the kept samples, and those to come, on the clock that was found valid."""
        for buffer, shift, samples in zip(self.buffers, judged.shifts, judged.arrived.values(), strict=True):
            if judged.joined:
                buffer.replace(samples)
            elif judged.by_log_time:
                buffer.use_log_time()
            else:
                buffer.shift(shift)
        if not self._known.by_log_time:
            self.problem = self._said
        self._known = judged.known

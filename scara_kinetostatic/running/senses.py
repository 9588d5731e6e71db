"""What the runner hears of its robot: the latest joint angles and forces, and what is wrong with them.

The force is the median of the last three readings less the zero, which is taken anew while the tip stands free. All
times are of the runner's clock, s; stamps only tell whether messages come late.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import islice
from math import hypot

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.running.commands import Fault

SILENT = 0.1
"""Sensors that say nothing for so long are silent; messages that come so much later than the fastest ones, late; s."""
_FRESH = 0.05
"""The joints are where a reading so old had them, s, to stop there."""
TARE = 0.15
"""The zero of the force is the mean over so long, s."""
_DRIFT = 1e-4
"""By so much the clock of the stamps may fall behind from one message to the next, s."""
_FROZEN = 30
"""So many equal readings of a sensor whose readings vary are no measurement."""
_STANDING = 1e-4
"""A joint that turns by less in `TARE` stands, rad."""


class Senses:
    """Joint angles and forces.

    Args:
        cell: whose they are.

    Attributes:
        joints: Q, (2,), rad.
        lift: position of the lift, m; None where no message has it.
        stamp: of the last force, s.
        noise: standard deviation of a reading of the force while it stood free, N.
    """

    def __init__(self, cell: Cell) -> None:
        self._topics, self._lift = cell.sensor.topics, cell.lift
        self._joints: deque[tuple[float, float, float]] = deque(maxlen=1000)
        self._forces: deque[tuple[float, float, float]] = deque(maxlen=1000)
        self._fastest, self._delay = [np.inf, np.inf], [0.0, 0.0]
        self._late, self._excused_until = [0, 0], -np.inf
        self._refusal, self._moved = '', ''
        self.joints = np.full(2, np.nan)
        self.lift: float | None = None
        self._zero = np.zeros(2)
        self.noise, self.stamp = 0.0, 0.0
        self._frozen, self._varies = 0, False

    def add_joints(self, now: float, stamp: float, joints: Sequence[float], lift: float | None = None) -> None:
        """A reading of both joints, rad, and the lift, m, with its stamp, s."""
        self._note(0, now, stamp)
        self._moved = ''
        self._joints.append((now, joints[0], joints[1]))
        self.joints, self.lift = np.array(joints, dtype=float), lift

    def add_force(self, now: float, stamp: float, force: Sequence[float]) -> None:
        """A reading of the force as the sensor gives it, N, with its stamp, s."""
        self._note(1, now, stamp)
        same = bool(self._forces) and self._forces[-1][1:] == (force[0], force[1])
        self._frozen = self._frozen + 1 if same else 0
        self._forces.append((now, force[0], force[1]))
        self.stamp = stamp

    def refuse(self, refusal: str, *, moved: bool = False) -> None:
        """A message that cannot be used; the text says why, and `moved` whether because a held joint has moved."""
        self._refusal, self._moved = refusal, refusal if moved else ''

    def _note(self, which: int, now: float, stamp: float) -> None:
        self._fastest[which] = min(self._fastest[which] + _DRIFT, now - stamp)
        self._delay[which] = now - stamp - self._fastest[which]
        self._late[which] = self._late[which] + 1 if self._delay[which] > SILENT else 0

    def forget_delays(self) -> None:
        """Measures delays anew: before anything moves the first messages, or a clock that is set, tell wrong ones."""
        self._fastest, self._late = [np.inf, np.inf], [0, 0]

    def excuse(self, now: float) -> None:
        """For a moment messages may be missing or late: nobody has listened."""
        self._excused_until = now + SILENT

    @property
    def place(self) -> Floats:
        """Q, rad, and the lift, m, NaN where it is not known, (3,)."""
        return np.array([*self.joints, self.lift], dtype=float)

    @property
    def net_force(self) -> tuple[float, float]:
        """The force now, as reported, N; the median of three readings."""
        last = list(islice(reversed(self._forces), 3))
        if not last:
            return 0.0, 0.0
        x, y = (sorted(reading[k] for reading in last)[len(last) // 2] for k in (1, 2))
        return x - float(self._zero[0]), y - float(self._zero[1])

    @property
    def force(self) -> float:
        """Magnitude of the force now, N."""
        return hypot(*self.net_force)

    def problem(self, now: float) -> str:
        """What is wrong with the messages; empty if nothing."""
        most = 10 * SILENT if self.is_excused(now) else SILENT
        for which, readings in enumerate((self._joints, self._forces)):
            topic = self._topics[which]
            silent = now - readings[-1][0] if readings else np.inf
            if silent > most:
                lasting = f' for {silent:.2f} s' if readings else ''
                return f'{topic} is silent{lasting}' + (f': {self._refusal}' if self._refusal else '')
            if self._late[which] > 2 and most == SILENT:
                return f'{topic}: messages come {SILENT} s late'
        if self._moved:
            return f'a joint has moved that must not: {self._moved}'
        if self._lift is not None and self._joints and self.lift is None:
            return f'{self._topics[0]} has no position of {self._lift.joint} (robot.lift)'
        if self._varies and self._frozen > _FROZEN:
            return f'{self._topics[1]}: the same reading {self._frozen} times; the sensor is frozen'
        return ''

    def is_excused(self, now: float) -> bool:
        """Whether nobody has listened a moment ago."""
        return now <= self._excused_until

    def knows_joints(self, now: float, age: float = _FRESH) -> bool:
        """Whether the last joint state was measured no longer ago, s; by default so that the robot is still there."""
        return bool(self._joints) and now - self._joints[-1][0] + self._delay[0] <= age

    def knows_force(self, now: float) -> bool:
        """Whether the last reading of the force is not older than what counts as silence."""
        return bool(self._forces) and now - self._forces[-1][0] <= SILENT

    def check(self, now: float) -> None:
        """Check that both topics can be relied on.

        Raises:
            Fault: they cannot.
        """
        if text := self.problem(now):
            raise Fault(text, may_retract=not text.startswith(self._topics[0]), passes=not self._moved)

    def _latest(self, readings: deque[tuple[float, float, float]], now: float, span: float) -> Floats:
        found = list[tuple[float, ...]]()
        for reading in reversed(readings):
            if reading[0] < now - span and len(found) > 2:
                break
            found.append(reading[1:])
        return np.array(found).reshape(-1, 2)

    def mean_force(self, now: float, span: float) -> float:
        """Magnitude of the mean force of late, N."""
        latest = self._latest(self._forces, now, span)
        return float(np.hypot(*(latest.mean(axis=0) - self._zero))) if len(latest) else self.force

    def stands(self, now: float) -> bool:
        """Whether both joints stand."""
        latest = self._latest(self._joints, now, TARE)
        return len(latest) > 2 and bool(np.ptp(latest, axis=0).max() < _STANDING)

    def tare(self, now: float) -> float:
        """Takes the force of late as zero, and returns its magnitude before, N."""
        latest = self._latest(self._forces, now, TARE)
        before, self._zero = self._zero, latest.mean(axis=0)
        self.noise = max(float(latest.std(axis=0).max()), 0.9 * self.noise)
        self._varies = bool(np.diff(latest, axis=0).any(axis=1).mean() > 0.8)
        return float(np.hypot(*(self._zero - before)))

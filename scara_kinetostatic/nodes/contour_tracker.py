"""Node `contour_tracker`: the outline of an object of unknown shape while the tip slides along it.

What `scara-kinetostatic contour` works out of a recording, this node works out of the running streams: deflection and
backlash are taken out by the calibrated model, the radius of the tip along the normal of its path. On `~/path` is the
outline along which the tip slides or slid last, latched. What is farther back than 20 mm along the path does not change
any more.

The calibration is that of the parameter `calibration`, then each newer one that the calibrator publishes;
with another calibration the outlines begin anew. The zero of the force is that of the latest free motion; `~/tare`
takes the present force as zero. `~/clear` forgets the outlines. A jump of the tip, a tip that rests, a force without a
zero and whatever else cannot be traced is said on `/diagnostics`; the node stays up.
"""

from __future__ import annotations

from collections.abc import Sequence
from time import monotonic, time_ns

import numpy as np
from nav_msgs.msg import Path

from scara_kinetostatic.contour.online import OnlineContour
from scara_kinetostatic.contour.result import NO_RADIUS, Polyline, remarks_on
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.parameters import MICRO, MILLI
from scara_kinetostatic.nodes.cell_node import CellNode, Condition, FollowedArm
from scara_kinetostatic.nodes.conversion import Sample, force_text, path
from scara_kinetostatic.nodes.streams import LATCHED, CellStreams, Stream
from scara_kinetostatic.touches.clock import SECOND


class ContourTracker(CellNode):
    """Traces the surface along which the tip slides. One thread spins it.

    Raises:
        InputError: a parameter, the cell or the calibration is not valid.
    """

    rest = 0.005

    def __init__(self) -> None:
        super().__init__('contour_tracker')
        self._calibration = FollowedArm(self, self._use)
        self._cell = cell = self._calibration.cell
        self._radius, self._plane = self.value('tip_radius') or cell.tip_radius, self.plane_of(cell)
        self._online: OnlineContour | None = None
        self._next = self._felt = 0.0
        self._path = self.create_publisher(Path, '~/path', LATCHED)
        self._streams = CellStreams(self, cell, self._turned)
        self._streams.subscribe(self._take)
        self.serve('clear', self._clear)
        self.serve_tare(self._tare)
        self.every(self.value('period'), self._evaluate)
        self.publish_status('contour', self._report)
        self._calibration.start()

    def _use(self, arm: CalibratedArm) -> None:
        """Takes a calibration; with another one than before the outlines begin anew."""
        if self._online is not None and arm.created and arm.created == self._online.arm.created:
            return
        former = self._online
        self._online = OnlineContour(arm, self._cell.sensor, self._radius, self._cell.sensor.topics)
        self._online.zero = None if former is None else former.zero
        self._publish()

    def _turned(self, _: bytes, anew: bool) -> None:
        """Fixed transforms turn the forces otherwise from here on."""
        if anew and self._online is not None:
            self._online.restart()

    def _take(self, stream: Stream, _: bytes, received: int, samples: list[Sample]) -> None:
        if self._online is None:
            return
        for sample in samples:
            add = self._online.add_joint_state if stream is Stream.JOINTS else self._online.add_wrench
            add(sample.stamp_ns, sample[1:3], (received or time_ns()) - sample.age_ns)
            if stream is Stream.WRENCH:
                self._felt = monotonic()

    def _evaluate(self) -> None:
        """Traces what has come, and publishes what has changed."""
        began = monotonic()
        if self._online is None or began < self._next:
            return
        if self._online.poll():
            self._publish()
        self._next = began + 5 * (monotonic() - began)  # a pause of five times what it took

    def _publish(self) -> None:
        online = self._calibrated()
        present = online.present
        self._path.publish(path(online.now, self._plane, [] if present is None else _places(present)))

    def _clear(self) -> str:
        online = self._calibrated()
        number = len(online.outlines)
        online.clear()
        self._publish()
        return f'outlines forgotten: {number}'

    def _tare(self) -> Sequence[float]:
        if monotonic() - self._felt > 0.5:
            raise UnsupportedDataError('there is no force of the last 0.5 s')
        return self._calibrated().tare(SECOND // 2).tolist()

    def _calibrated(self) -> OnlineContour:
        """The contour.

        Raises:
            UnsupportedDataError: there is no calibration, and so no outline.
        """
        if self._online is None:
            raise UnsupportedDataError('there is no calibration yet')
        return self._online

    def _report(self) -> Condition:
        """The status: what is missing first."""
        complaints, values = self._streams.examine()
        online = self._online
        if online is None:
            return self._calibration.condition(complaints, values, '')
        complaints += [online.problem, online.clock_problem, '' if online.tip_radius else NO_RADIUS]
        if online.contour is not None:
            complaints += [*online.contour.warnings, *remarks_on(online.contour, online.arm)]
        return self._calibration.condition(complaints, values | _figures(online), 'tracing')


def _places(outline: Polyline) -> list[tuple[float, float, float]]:
    """The nodes of an outline, with the angle of the direction in which it is run through, the object on its left."""
    ring = outline.ring
    angle = np.arctan2(*np.gradient(ring, axis=0).T[::-1]) if len(ring) > 1 else np.zeros(len(ring))
    return [(float(x), float(y), float(yaw)) for (x, y), yaw in zip(ring, angle, strict=True)]


def _figures(online: OnlineContour) -> dict[str, str]:
    """What is being traced, in numbers."""
    contour, outline, zero = online.contour, online.present, online.zero
    figures = {
        'state': 'sliding' if contour is not None else 'not sliding',
        'outlines': str(len(online.outlines)),
        'zero of the force [N]': 'not known' if zero is None else force_text(zero.tolist()),
    }
    if outline is not None:
        figures |= {'outline': 'closed' if outline.closed else 'open', 'length [mm]': f'{outline.length / MILLI:.1f}'}
        figures['standard uncertainty [µm]'] = f'{np.median(outline.std) / MICRO:.2g}'
    if contour is not None:
        figures['coefficient of friction'] = f'{contour.friction.coefficient:.3f} ± {contour.friction.std:.3f}'
    return figures

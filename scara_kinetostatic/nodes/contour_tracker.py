"""Node `contour_tracker`: the outline of an object of unknown shape while the tip slides along it.

What `scara-kinetostatic contour` works out of a recording, this node works out of the running streams: deflection and
backlash are taken out by the calibrated model, the radius of the tip along the normal of its path. On `~/path` is the
outline along which the tip slides or slid last, on `~/markers` all outlines with their uncertainty, the known objects,
and the tip with its force; both are latched. What is farther back than 4 mm along the path does not change any more.

The calibration is that of the parameter `calibration`, and with `follow` each result that the calibrator publishes;
with another calibration the outlines begin anew. The zero of the force is that of the latest free motion; `~/tare`
takes the present force as zero. `~/clear` forgets the outlines. A jump of the tip, a tip that rests, a force without a
zero and whatever else cannot be traced is said on `/diagnostics`; the node stays up.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from time import monotonic, time_ns

import numpy as np
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Path
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from scara_kinetostatic.contour.joining import Outline
from scara_kinetostatic.contour.markers import known_markers, outline_markers, tip_markers
from scara_kinetostatic.contour.online import SECOND, OnlineContour
from scara_kinetostatic.contour.result import NO_RADIUS, remarks_on
from scara_kinetostatic.contour.trace import LARGEST_TIP
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.files.urdf import BASE_FRAME
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.nodes import declare
from scara_kinetostatic.nodes.conversion import UnusableMessageError, joint_sample, path, wrench_sample
from scara_kinetostatic.nodes.declare import Range
from scara_kinetostatic.nodes.diagnostics import Condition, DiagnosticsPublisher
from scara_kinetostatic.nodes.followed_calibration import FollowedCalibration
from scara_kinetostatic.nodes.frame_check import FrameCheck
from scara_kinetostatic.nodes.marker_messages import marker_array
from scara_kinetostatic.nodes.runtime import run
from scara_kinetostatic.nodes.stream_monitor import StreamMonitor
from scara_kinetostatic.nodes.stream_subscription import LATCHED, StreamSubscription

REST = 0.005
"""Between two callbacks, s: messages of 1 kHz are taken several at a time."""
PAUSE = 5.0
"""Between two evaluations at least, in times that the last one took."""
TARE_TIME = SECOND // 2
"""Over so long a time the zero of the force is averaged, ns."""
FORCE_SCALE = 0.002
"""Length of the arrow of a force, m/N."""


class ContourTracker(Node):
    """Traces the surface along which the tip slides. One thread spins it.

    Raises:
        InputError: a parameter, the cell or the calibration is not valid.
    """

    def __init__(self) -> None:
        super().__init__('contour_tracker')
        self._calibration = FollowedCalibration(self, self._use)
        self._cell = cell = self._calibration.cell
        radius = declare.number(
            self, 'tip_radius', 0.0, 'radius of the tip, m; 0: as the calibration has it', Range(0, LARGEST_TIP)
        )
        self._radius = radius or cell.tip_radius
        period = declare.number(self, 'period', 0.5, 'between two evaluations, s', Range(0.05, 10))
        magnified = 'magnification of the uncertainty in the markers; 0: not shown'
        declare.number(self, 'uncertainty_scale', 500.0, magnified, Range(0, 1e6), read_only=False)
        self._frame = declare.text(self, 'frame_prefix', '', 'before the names of frames') + BASE_FRAME
        self._online: OnlineContour | None = None
        self._next = 0.0
        self._check = FrameCheck(self, cell.sensor.frame, self._turned)
        self._path = self.create_publisher(Path, '~/path', LATCHED)
        self._markers = self.create_publisher(MarkerArray, '~/markers', LATCHED)
        topics = [self.resolve_topic_name(topic) for topic in cell.sensor[:2]]
        self._joints_heard = StreamMonitor(topics[0], with_joints=True)
        self._wrench_heard = StreamMonitor(topics[1])
        self._streams = (
            StreamSubscription(self, JointState, cell.sensor.joint_states, self._take_joints, self._joints_heard.lose),
            StreamSubscription(self, WrenchStamped, cell.sensor.wrench, self._take_wrench, self._wrench_heard.lose),
        )
        self.create_service(Trigger, '~/clear', self._clear)
        self.create_service(Trigger, '~/tare', self._tare)
        self.create_timer(period, self._evaluate, clock=Clock(clock_type=ClockType.STEADY_TIME))
        DiagnosticsPublisher(self, 'contour', self._report)
        self._calibration.start()

    def close(self) -> None:
        """Nothing to close."""

    def _use(self, arm: CalibratedArm) -> None:
        """Takes a calibration; with another one than before the outlines begin anew."""
        if self._online is not None and _is_same(arm, self._online.arm):
            return
        former = self._online
        if former is not None and former.outlines:
            self.get_logger().warning('another calibration: the outlines begin anew')
        self._online = OnlineContour(arm, self._cell.sensor, self._radius, self._cell.sensor.topics)
        self._online.zero = None if former is None else former.zero
        self._publish()

    def _turned(self, _: bytes, anew: bool) -> None:
        """Fixed transforms turn the forces otherwise from here on."""
        if anew and self._online is not None:
            self._online.restart()

    def _take_joints(self, message: bytes, received: int) -> None:
        try:
            sample = joint_sample(message, self._cell.joint_names)
        except UnusableMessageError as error:
            self._joints_heard.refuse(str(error))
            return
        self._joints_heard.accept(sample.stamp_ns, sample[1:])
        if self._online is not None:
            self._online.add_joint_state(sample.stamp_ns, sample[1:], received or time_ns())

    def _take_wrench(self, message: bytes, received: int) -> None:
        try:
            sample = wrench_sample(message, self._check.turn(message))
        except UnusableMessageError as error:
            self._wrench_heard.refuse(str(error))
            return
        self._wrench_heard.accept(sample.stamp_ns, sample[1:])
        if self._online is not None:
            self._online.add_wrench(sample.stamp_ns, sample[1:], received or time_ns())

    def _evaluate(self) -> None:
        """Traces what has come, and publishes what has changed."""
        began = monotonic()
        if self._online is None or began < self._next:
            return
        if self._online.poll(time_ns()):
            self._publish()
        self._next = began + PAUSE * (monotonic() - began)

    def _publish(self) -> None:
        online = self._online
        if online is None:
            return
        present = online.present
        self._path.publish(path(online.now, self._frame, [] if present is None else _places(present)))
        scale = float(self.get_parameter('uncertainty_scale').value)
        scene = known_markers(self._cell.discs, online.tip_radius) + outline_markers(online.outlines, scale)
        self._markers.publish(marker_array(scene + tip_markers(online.contour, FORCE_SCALE), self._frame))

    def _clear(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._online is None:
            response.message = 'there is no calibration yet, and no outline'
            return response
        number = len(self._online.outlines)
        self._online.clear()
        self._publish()
        response.success, response.message = True, f'outlines forgotten: {number}'
        self.get_logger().info(response.message)
        return response

    def _tare(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            if self._online is None:
                raise UnsupportedDataError('there is no calibration yet')
            x, y = self._online.tare(TARE_TIME).tolist()
            response.success, response.message = True, f'zero of the force: ({x:.4g}, {y:.4g}) N'
        except UnsupportedDataError as error:
            response.message = f'not tared: {error.problem}'
        self.get_logger().info(response.message)
        return response

    def _report(self) -> Condition:
        """The status: what is missing first."""
        values, complaints = dict[str, str](), [self._check.complaint()]
        for monitor, stream in zip((self._joints_heard, self._wrench_heard), self._streams, strict=True):
            monitor.publishers = [publisher.node_name for publisher in stream.publishers()]
            rate = monitor.rate()
            values |= monitor.details(rate)
            complaints += [monitor.complaint(rate, expected=True), monitor.mixture(), monitor.loss()]
        values['wrench frame'] = self._check.description()
        online = self._online
        if online is None:
            return self._calibration.condition(complaints, values, '')
        complaints += [online.problem, online.clock_problem, '' if self._radius else NO_RADIUS]
        if online.contour is not None:
            complaints += [*online.contour.warnings, *remarks_on(online.contour, online.arm)]
        if online.forgotten:
            complaints.append(f'{online.forgotten} outlines forgotten: there were too many; call ~/clear')
        return self._calibration.condition(complaints, values | _figures(online), 'tracing')


def _is_same(one: CalibratedArm, other: CalibratedArm) -> bool:
    """Whether two calibrations are the same."""
    same = one.created == other.created and one.model.names == other.model.names
    return same and np.array_equal(one.model.as_array(), other.model.as_array())


def _places(outline: Outline) -> list[tuple[float, float, float]]:
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
        'zero of the force [N]': 'not known' if zero is None else f'({zero[0]:.4g}, {zero[1]:.4g})',
    }
    if outline is not None:
        std = float(np.median(outline.std))
        figures |= {
            'outline': 'closed' if outline.closed else 'open',
            'length [mm]': f'{1e3 * outline.length:.1f}',
            'standard uncertainty, median [µm]': f'{1e6 * std:.1f}' if np.isfinite(std) else 'not known',
        }
    if contour is not None:
        friction = contour.friction
        figures |= {
            'force [N]': f'{np.hypot(*contour.force[-1]):.3g}',
            'coefficient of friction': f'{friction.coefficient:.3f} ± {friction.std:.3f}',
        }
    return figures


def main(args: Sequence[str] | None = None) -> int:
    """Runs the node; see `runtime.run` for the exit status."""
    return run(ContourTracker, args, rest=REST)


if __name__ == '__main__':
    sys.exit(main())

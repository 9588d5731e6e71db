"""Node `visualizer`: shows the cell in RViz or Foxglove.

Publishes `visualization_msgs/MarkerArray` in the frame of `robot.plane`, else `base_link`,
with `frame_prefix` before it: on `~/markers`,
latched, what changes with touches and results (objects, touches with their forces, residual forces magnified, what was
found, the touch to make next), on `~/arm` the nominal and the calibrated arm at the present joint angles. The URDF of
the nominal arm is on `robot_description`, latched; where the cell states the link that carries the tip
(`robot.plane.tip`), the robot has a URDF of its own, and this one is not published.

It hears the collector's `~/touch` and the calibrator's `~/result`; single touches of a result, with their residuals,
it reads from the file that the result names; without the file they are not shown, and that is said.
A result that the calibrator does not publish, as it is unfit, does not change the calibrated arm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from time import monotonic
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from scara_kinetostatic.errors import InputError, ScaraKinetostaticError
from scara_kinetostatic.files.calibration_file import parse_document
from scara_kinetostatic.files.urdf import CALIBRATED_COLOUR, NOMINAL_COLOUR, arm_urdf
from scara_kinetostatic.nodes import conversion
from scara_kinetostatic.nodes.cell_node import CellNode
from scara_kinetostatic.nodes.streams import LATCHED, LATCHED_TOUCHES, waiting
from scara_kinetostatic.report import markers
from scara_kinetostatic.report.markers import Scales, SeenTouch, estimated


class Visualizer(CellNode):
    """Shows what the other nodes find.

    Raises:
        CellError: the cell description cannot be read, or is not valid.
        ParameterError: a parameter is not valid.
    """

    rest = 0.01  # of joint states at 1 kHz only some are taken

    def __init__(self) -> None:
        super().__init__('visualizer')
        self._cell = self.cell_or_example()
        self._plane = self.plane_of(self._cell)
        self._joints: tuple[float, float] | None = None
        self._touches: dict[tuple[str, str], SeenTouch] = {}
        self._document: Mapping[str, Any] | None = None  # the last result
        self._calibrated: Mapping[str, Any] | None = None  # the last one that is in the calibrator's parameters
        self._changed = True
        self.add_post_set_parameters_callback(self._draw_again)
        self._next_scene = 0.0
        self._markers = self.create_publisher(MarkerArray, '~/markers', LATCHED)
        self._arm = self.create_publisher(MarkerArray, '~/arm', 1)
        self._description = self.create_publisher(String, 'robot_description', LATCHED)
        newest = QoSProfile(depth=4, reliability=ReliabilityPolicy.BEST_EFFORT)  # matches every publisher
        topic = self._cell.sensor.joint_states
        self._joint_states = self.create_subscription(JointState, topic, self._note_joints, newest, raw=True)
        self._reader = conversion.JointReader(self._cell.joint_names)
        self.create_subscription(DiagnosticArray, 'collector/touch', self._note_touch, LATCHED_TOUCHES)
        self.create_subscription(String, 'calibrator/result', self._note_result, LATCHED)
        self._next_touch: PoseStamped | None = None
        self._next_text = ''
        self.create_subscription(PoseStamped, 'touch_runner/next_touch', self._note_next, LATCHED)
        self.create_subscription(DiagnosticArray, 'touch_runner/state', self._note_state, LATCHED)
        if not self._cell.plane.tip:
            self._description.publish(String(data=arm_urdf('scara', self._cell, self._cell.nominal)))
        self.every(0.1, self._publish_arms)
        self.every(0.5, self._publish_scene)

    @property
    def _scales(self) -> Scales:
        return Scales(*(self.value(f'{name}_scale') for name in Scales._fields))

    def _draw_again(self, _: Sequence[Any]) -> None:
        self._changed = True

    def _note_joints(self, message: bytes) -> None:
        later = [other for other, _ in waiting(self._joint_states)]
        for each in (message, *later):  # of several publishers, each with a part of the joints
            with suppress(conversion.UnusableMessageError):  # the collector says so
                if sample := self._reader.sample(each):
                    q1, q2 = self._cell.angles(np.array(sample[1:3])).tolist()
                    self._joints = q1, q2

    def _note_touch(self, message: DiagnosticArray) -> None:
        for key, values in conversion.touches_in(message):
            touch = SeenTouch.from_values(values, self._cell.nominal)
            if touch is not None:
                self._touches[key] = touch
                self._changed = True
        while len(self._touches) > 1000:  # the latest are shown
            del self._touches[next(iter(self._touches))]

    def _note_result(self, message: String) -> None:
        try:
            document = said = parse_document(message.data, 'calibrator/result')
            try:
                document = conversion.stored_document(said)
            except InputError as error:
                self.get_logger().warning(f'residual forces are not shown: {error}')
            markers.result_markers(document, self._cell.discs, self._scales)  # tried before it is shown
            published = bool(said.get('published', True))
        except (ValueError, LookupError, TypeError, AttributeError, ScaraKinetostaticError) as error:
            self.get_logger().warning(f'calibrator/result cannot be shown: {type(error).__name__}: {error}')
            return
        self._document, self._changed = document, True
        if published:
            self._calibrated = document

    def _note_next(self, message: PoseStamped) -> None:
        self._next_touch, self._changed = message, True

    def _note_state(self, message: DiagnosticArray) -> None:
        text = '; '.join(status.message for status in message.status)
        self._changed |= text != self._next_text
        self._next_text = text

    def _publish_scene(self) -> None:
        began = monotonic()
        if not self._changed or began < self._next_scene:
            return
        discs, document = self._cell.discs, self._document
        parameters = self._cell.nominal if document is None else estimated(document)
        scene = markers.object_markers(discs)
        scene += markers.touch_markers(self._touches.values(), parameters, discs, self._scales)
        if self._next_touch is not None:
            x, y, angle = conversion.place_of(self._next_touch.pose, self._plane)
            scene += markers.next_markers((x, y), angle, self._next_text)
        if document is not None:
            scene += markers.result_markers(document, discs, self._scales)
        self._markers.publish(conversion.marker_array(scene, self._plane))
        self._changed = False
        self._next_scene = began + 20 * (monotonic() - began)  # many touches take a while

    def _publish_arms(self) -> None:
        if self._joints is None:
            return
        arms = markers.arm_markers('nominal', self._cell.nominal, self._joints, NOMINAL_COLOUR)
        if self._calibrated is not None:
            arms += markers.arm_markers('calibrated', estimated(self._calibrated), self._joints, CALIBRATED_COLOUR)
        self._arm.publish(conversion.marker_array(arms, self._plane))

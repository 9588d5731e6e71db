"""Node `visualizer`: shows the cell in RViz or Foxglove.

Publishes `visualization_msgs/MarkerArray` in the frame of `robot.plane`, else `base_link`, with `frame_prefix` before
it: on `~/markers`, latched, the objects and the touches with their forces, on `~/arm` the nominal and the calibrated
arm at the present joint angles, both rigid. A force F is an arrow of length `force_scale` ‖F‖ that ends where the tip
was.
With `publish_urdf` the URDF of the nominal arm is on `robot_description`, latched; beside a driver that topic is the
driver's. Where the cell states the link that carries the tip (`robot.plane.tip`), the robot has a URDF of its own, and
this one is not published.

It hears the collector's `~/touch` and the calibrator's `~/result`. A result that the calibrator does not publish, as it
is unfit, does not change the calibrated arm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.files.calibration_file import parse_document, read_arm
from scara_kinetostatic.files.urdf import CALIBRATED_COLOUR, NOMINAL_COLOUR, Colour, arm_urdf
from scara_kinetostatic.model.cell import Disc, Plane
from scara_kinetostatic.model.kinematics import forward, link_vectors, rotate
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.nodes import conversion
from scara_kinetostatic.nodes.cell_node import CellNode
from scara_kinetostatic.nodes.streams import LATCHED, LATCHED_TOUCHES, NEWEST, forget_oldest, waiting

_OBJECT: Colour = (0.90, 0.62, 0.0, 0.35)
_TOUCH: Colour = (0.0, 0.62, 0.45, 1.0)
_UNUSED: Colour = (0.85, 0.1, 0.1, 1.0)
_TEXT: Colour = (0.35, 0.35, 0.35, 1.0)
_LINK, _THIN, _DOT, _LETTERS = 0.012, 0.003, 0.008, 0.018
"""Widths of links and lines, diameter of a dot, height of a text, m."""


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
        self._touches: dict[tuple[str, str], Mapping[str, str]] = {}
        self._calibrated: Parameters | None = None
        self._changed = True
        self._markers = self.create_publisher(MarkerArray, '~/markers', LATCHED)
        self._arm = self.create_publisher(MarkerArray, '~/arm', 1)
        topic = self._cell.sensor.joint_states
        self._joint_states = self.create_subscription(JointState, topic, self._note_joints, NEWEST, raw=True)
        self._reader = conversion.JointReader(self._cell.joint_names)
        self.create_subscription(DiagnosticArray, 'collector/touch', self._note_touch, LATCHED_TOUCHES)
        self.create_subscription(String, 'calibrator/result', self._note_result, LATCHED)
        if self.value('publish_urdf') and not self._cell.plane.tip:
            description = self.create_publisher(String, 'robot_description', LATCHED)
            description.publish(String(data=arm_urdf('scara', self._cell, self._cell.nominal)))
        self.every(0.1, self._publish_arms)
        self.every(0.5, self._publish_scene)

    def _note_joints(self, message: bytes) -> None:
        later = [other for other, _ in waiting(self._joint_states)]
        for each in (message, *later):  # of several publishers, each with a part of the joints
            with suppress(conversion.UnusableMessageError):  # the collector says so
                for sample in self._reader.samples(each):
                    q1, q2 = self._cell.angles(np.array(sample[1:3])).tolist()
                    self._joints = q1, q2

    def _note_touch(self, message: DiagnosticArray) -> None:
        self._touches |= conversion.touches_in(message)
        self._changed = True
        forget_oldest(self._touches)

    def _note_result(self, message: String) -> None:
        try:
            document = parse_document(message.data, 'calibrator/result')
            arm = read_arm(document, 'calibrator/result')
        except ScaraKinetostaticError as error:
            self.get_logger().warning(f'calibrator/result cannot be shown: {error}')
            return
        if document.get('published', True):
            self._calibrated, self._changed = arm.model.parameters, True

    def _publish_scene(self) -> None:
        if not self._changed:
            return
        self._changed = False
        made = object_markers(self._cell.discs, self._plane)
        for values in self._touches.values():
            parameters = self._calibrated or self._cell.nominal
            made += touch_markers(values, parameters, self.value('force_scale'), self._plane)
        self._markers.publish(conversion.marker_array(made, self._plane))

    def _publish_arms(self) -> None:
        if self._joints is None:
            return
        made = []
        for group, parameters, colour in (
            ('nominal', self._cell.nominal, NOMINAL_COLOUR),
            ('calibrated', self._calibrated, CALIBRATED_COLOUR),
        ):
            if parameters is not None:
                base, links = np.array([[parameters.x0, parameters.y0]]), link_vectors(parameters, self._joints)
                line, width = np.cumsum([*base, *links], axis=0), (_LINK, 0.0, 0.0)
                made.append(conversion.marker(group, Marker.LINE_STRIP, line, self._plane, colour, width))
        self._arm.publish(conversion.marker_array(made, self._plane))


def object_markers(discs: Sequence[Disc | Outline], plane: Plane) -> list[Marker]:
    """The objects, discs to the tip's centre in contact and outlines with their sides, and their names."""
    made = []
    for disc in discs:
        if isinstance(disc, Outline):
            line = (*_OBJECT[:3], 1.0)
            made.append(conversion.marker('objects', Marker.LINE_STRIP, disc.shape(), plane, line, (_THIN, 0.0, 0.0)))
        else:
            size = 2 * disc.radius, 2 * disc.radius, _THIN
            made.append(conversion.marker('objects', Marker.CYLINDER, (disc.x, disc.y), plane, _OBJECT, size))
        at = disc.x, disc.y - disc.radius / 2
        made.append(conversion.marker('objects', Marker.TEXT_VIEW_FACING, at, plane, _TEXT, (0.0, 0.0, _LETTERS)))
        made[-1].text = disc.name
    return made


def touch_markers(values: Mapping[str, str], parameters: Parameters, scale: float, plane: Plane) -> list[Marker]:
    """A dot where the tip was, and the force as an arrow that ends there; a touch that is not used is a red dot.

    Args:
        values: of the collector's `~/touch`, by name; nothing is drawn where they do not say where the arm was.
        parameters: of the arm.
        scale: length of the arrow of a force, m/N.
        plane: of the arm.
    """
    try:
        q1, q2, *force = conversion.numbers_of(values)
    except (ValueError, LookupError):
        return []
    if not np.isfinite([q1, q2, *force]).all():
        return []
    tip = forward(parameters, (q1, q2))
    if values.get('accepted') != 'true':
        return [conversion.marker('rejected', Marker.SPHERE, tip, plane, _UNUSED, (1.5 * _DOT,) * 3)]
    turn = q1 + parameters.theta1 + q2 + parameters.theta2 if values.get('frame') == 'tool' else 0.0
    ends = [tip - scale * rotate(force, turn), tip]
    return [
        conversion.marker('touches', Marker.SPHERE, tip, plane, _TOUCH, (_DOT,) * 3),
        conversion.marker('forces', Marker.ARROW, ends, plane, _TOUCH, (_THIN, 3 * _THIN, 0.0)),  # of shaft and head
    ]

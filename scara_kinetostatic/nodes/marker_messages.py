"""Geometric primitives as `visualization_msgs/MarkerArray`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from scara_kinetostatic.report.markers import Primitive, Shape

_TYPES = {
    Shape.STRIP: Marker.LINE_STRIP,
    Shape.CYLINDER: Marker.CYLINDER,
    Shape.ARROW: Marker.ARROW,
    Shape.DOT: Marker.SPHERE,
    Shape.TEXT: Marker.TEXT_VIEW_FACING,
}
_HEAD = 3.0
"""Diameter of an arrow's head, in diameters of its shaft."""


def marker_array(primitives: Iterable[Primitive], frame: str) -> MarkerArray:
    """All primitives in a frame; those of earlier messages on the topic vanish.

    Stamps are 0, for the latest transform: what is shown does not depend on clocks.
    """
    array = MarkerArray(markers=[Marker(action=Marker.DELETEALL)])
    array.markers[0].header.frame_id = frame
    numbers: Counter[str] = Counter()
    for primitive in primitives:
        marker = _marker(primitive)
        marker.header.frame_id = frame
        marker.id = numbers[primitive.group]
        numbers[primitive.group] += 1
        array.markers.append(marker)
    return array


def _marker(primitive: Primitive) -> Marker:
    red, green, blue, opacity = primitive.colour
    marker = Marker(ns=primitive.group, type=_TYPES[primitive.shape], action=Marker.ADD, text=primitive.text)
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=opacity)
    marker.pose.orientation.w = 1.0
    marker.scale = _scale(primitive)
    points = [Point(x=x, y=y, z=z) for x, y, z in primitive.points]
    if primitive.shape in (Shape.STRIP, Shape.ARROW):
        marker.points = points
    else:
        marker.pose.position = points[0]
    return marker


def _scale(primitive: Primitive) -> Vector3:
    """What RViz takes each component for, by the type of the marker."""
    size = primitive.size
    if primitive.shape is Shape.STRIP:
        return Vector3(x=size)
    if primitive.shape is Shape.TEXT:
        return Vector3(z=size)
    if primitive.shape is Shape.ARROW:  # by tail and head; z = 0: length of the head as RViz takes it
        return Vector3(x=size, y=_HEAD * size)
    return Vector3(x=size, y=size, z=primitive.height or size)

"""What of a cell is to be seen in RViz or Foxglove, as geometric primitives in the base frame; no ROS in here.

Deflections and errors are micrometres and the cell is a metre, so lengths are magnified: a force F is an arrow of
`Scales.force` ‖F‖, a residual force one of `Scales.residual` ‖F‖, displacements of objects are drawn `Scales.error`
times as large. What is magnified says so in a text.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.files.urdf import Colour
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Disc
from scara_kinetostatic.model.kinematics import forward, link_vectors, rotate
from scara_kinetostatic.model.outline import Outline, boundary, surfaces_of
from scara_kinetostatic.model.parameters import NAMES, Parameters, quantity

FOUND: Colour = (0.84, 0.37, 0.0, 1.0)
UNUSED: Colour = (0.85, 0.1, 0.1, 1.0)
NEXT: Colour = (0.0, 0.45, 0.70, 1.0)
TEXT: Colour = (0.35, 0.35, 0.35, 1.0)
OBJECTS: tuple[tuple[float, float, float], ...] = (
    *((0.0, 0.62, 0.45), (0.90, 0.62, 0.0), (0.34, 0.71, 0.91)),
    *((0.95, 0.90, 0.25), (0.80, 0.47, 0.65), (0.84, 0.37, 0.0)),
)
"""Of Okabe and Ito, safe for the colour-blind."""
_LINK, _THIN, _DOT = 0.012, 0.003, 0.008
"""Widths of links and lines, diameter of a dot, m."""
_HEIGHT, _LETTERS = 0.02, 0.018
"""Height of an object and of a text, m."""
Shape = Literal['strip', 'cylinder', 'arrow', 'dot', 'text']
"""What a primitive is."""


@dataclass(frozen=True)
class Primitive:
    """One thing to draw.

    Attributes:
        group: what it belongs to, such as ``touches``; groups are shown and hidden together.
        shape: a strip has two points or more, an arrow tail and head, all others one.
        points: places in the base frame, (n, 3), m.
        colour: of all of it.
        size: width of a strip, diameter of a cylinder, an arrow's shaft or a dot, height of a text, m.
        height: of a cylinder, m.
        text: of a text.
    """

    group: str
    shape: Shape
    points: tuple[tuple[float, float, float], ...]
    colour: Colour
    size: float
    height: float = 0.0
    text: str = ''


class Scales(NamedTuple):
    """How large things are drawn.

    Attributes:
        force: length of the arrow of a force, m/N.
        residual: of a residual force, m/N.
        error: magnification of displacements of objects.
    """

    force: float = 0.002
    residual: float = 0.05
    error: float = 200.0


class SeenTouch(NamedTuple):
    """A touch as it was judged.

    Attributes:
        joints: q1, q2, rad.
        force: on the object, base frame, N.
        object: name of the object touched; empty where unknown.
        accepted: whether it is used.
    """

    joints: tuple[float, float]
    force: tuple[float, float]
    object: str
    accepted: bool

    @classmethod
    def from_values(cls, values: Mapping[str, str], parameters: Parameters) -> SeenTouch | None:
        """From the values of the collector's `~/touch`; None where they do not say where the arm was.

        Args:
            values: by name.
            parameters: of the arm, by which a force in the frame of the tool is turned.
        """
        try:
            first, second, x, y = (float(values[name]) for name in ('q1_rad', 'q2_rad', 'fx_N', 'fy_N'))
        except (ValueError, LookupError):
            return None
        if not np.isfinite([first, second, x, y]).all():
            return None
        if values.get('frame') == 'tool':
            x, y = rotate((x, y), first + parameters.theta1 + second + parameters.theta2).tolist()
        return cls((first, second), (x, y), values.get('object', ''), values.get('accepted') == 'true')


def object_markers(discs: Sequence[Disc | Outline]) -> list[Primitive]:
    """The objects, discs to the tip's centre in contact and outlines with their sides, and their names."""
    made = []
    for number, disc in enumerate(discs):
        colour = (*OBJECTS[number % len(OBJECTS)], 0.35)
        at = places([[disc.x, disc.y]], -_HEIGHT / 2)
        body = Primitive('objects', 'cylinder', at, colour, 2 * disc.radius, _HEIGHT)
        if isinstance(disc, Outline):
            body = Primitive('objects', 'strip', places(disc.shape()), (*colour[:3], 1.0), 2 * _THIN)
        made += [body, label('objects', (disc.x, disc.y - disc.radius / 2), disc.name, TEXT)]
    return made


def arm_markers(group: str, parameters: Parameters, joints: ArrayLike, colour: Colour) -> list[Primitive]:
    """The rigid arm at joint angles, (2,), rad: its links, shoulder, elbow and tip."""
    base = np.array([parameters.x0, parameters.y0])
    link1, link2 = link_vectors(parameters, joints)
    corners = places([base, base + link1, base + link1 + link2])
    dots = [Primitive(group, 'dot', (corner,), colour, 1.8 * _LINK) for corner in corners[:2]]
    return [Primitive(group, 'strip', corners, colour, _LINK), *dots]


def touch_markers(
    touches: Iterable[SeenTouch], parameters: Parameters, discs: Sequence[Disc | Outline], scales: Scales
) -> list[Primitive]:
    """A dot where the tip was, and the force as an arrow that ends there; touches that are not used are red dots."""
    numbers = {disc.name: number for number, disc in enumerate(discs)}
    made = []
    for touch in touches:
        tip = forward(parameters, touch.joints)
        colour = (*OBJECTS[numbers.get(touch.object, 0) % len(OBJECTS)], 1.0) if touch.accepted else UNUSED
        group = 'touches' if touch.accepted else 'rejected'
        made.append(Primitive(group, 'dot', places([tip]), colour, _DOT if touch.accepted else 1.5 * _DOT))
        if touch.accepted:
            tail = tip - scales.force * np.asarray(touch.force)
            made.append(Primitive('forces', 'arrow', places([tail, tip]), colour, _THIN))
    return made


def next_markers(contact: tuple[float, float], normal: float, text: str) -> list[Primitive]:
    """The touch to make next: an arrow along the approach, and what is said of it.

    Args:
        contact: of the tip, m.
        normal: angle of the outward normal there, rad.
        text: beside it.
    """
    x, y = contact
    far = x + 4 * _LETTERS * float(np.cos(normal)), y + 4 * _LETTERS * float(np.sin(normal))
    return [
        Primitive('next', 'arrow', places([far, contact], _HEIGHT), NEXT, 2 * _THIN),
        Primitive('next', 'dot', places([contact], _HEIGHT), NEXT, 1.5 * _DOT),
        label('next', far, text, NEXT),
    ]


def result_markers(document: Mapping[str, Any], discs: Sequence[Disc | Outline], scales: Scales) -> list[Primitive]:
    """What a calibration found: residual forces, and what is not as the cell description says.

    Args:
        document: as in `calibration.json`; single touches, `touches.fitted`, may be missing.
        discs: of the cell.
        scales: of the drawing.
    """
    parameters = estimated(document)
    found = [*document['diagnosis']['effects'], *document['diagnosis']['possible']]
    made = []
    for touch in document['touches'].get('fitted', ()):
        if touch['used']:
            tip = forward(parameters, touch['joints'])
            ends = places([tip, tip + scales.residual * np.asarray(touch['residual'])])
            made.append(Primitive('residuals', 'strip', ends, (*OBJECTS[4], 1.0), _THIN))
    by_name = {disc.name: disc for disc in discs}
    for effect in found:
        if effect['target'] in by_name:
            made += _displaced(by_name[effect['target']], effect['parameters'], scales.error)
    return made + _summary(document, found, discs, scales)


def estimated(document: Mapping[str, Any]) -> Parameters:
    """The parameters of a result."""
    return Parameters(**{name: document['parameters'][name]['value'] for name in NAMES})


def _displaced(disc: Disc | Outline, found: Mapping[str, Any], magnification: float) -> list[Primitive]:
    """The object where it really is, and magnified its outline and an arrow from where it was said to be."""
    names = ('x', 'y', 'angle', 'offset') if isinstance(disc, Outline) else ('x', 'y', 'radius')
    values = [found.get(name, {'value': 0.0})['value'] for name in names]
    if None in values or not any(values):
        return []
    if isinstance(disc, Outline):
        x, y, angle, offset = (magnification * value for value in values)
        really = disc.moved((x, y), float(np.clip(angle, -1.0, 1.0)))
        line = boundary(surfaces_of([really], float(np.clip(offset, -disc.radius / 4, disc.radius / 4))))
        line = line if disc.is_open else np.concatenate([line, line[:1]])
        return [Primitive('found', 'strip', places(line, _HEIGHT), FOUND, _THIN)]
    x, y, more = values
    centre, shift, flat = np.array([disc.x, disc.y]), np.array([x, y]), 0.002
    moved = centre + magnification * shift
    outline = moved + max(0.0, disc.radius + magnification * more) * _circle()
    at = places([centre + shift], flat)
    arrow = Primitive('found', 'arrow', places([centre, moved], _HEIGHT), FOUND, 2 * _THIN)
    return [
        Primitive('found', 'cylinder', at, (*FOUND[:3], 0.25), 2 * (disc.radius + more), flat),
        Primitive('found', 'strip', places(outline, _HEIGHT), FOUND, _THIN),
        *([arrow] if shift.any() else []),
    ]


def _summary(
    document: Mapping[str, Any], found: Sequence[Mapping[str, Any]], discs: Sequence[Disc | Outline], scales: Scales
) -> list[Primitive]:
    """Grade, verdict and effects in words, below everything."""
    lines = [f'{document["assessment"]["grade"]}; model: {document["diagnosis"]["verdict"]}']
    for effect in found:
        known = {name: item for name, item in effect['parameters'].items() if item['value'] is not None}
        values = ', '.join(f'{name} {quantity(item["value"], item["unit"])}' for name, item in known.items())
        target = f'[{effect["target"]}]' if effect['target'] else ''
        lines.append(f'{effect["name"]}{target}: {values}')
    shown = f'{1e3 * scales.residual:g} mm per N' if 'fitted' in document['touches'] else 'not shown, no file'
    lines.append(f'displacements × {scales.error:g}; residual forces {shown}')
    low = np.min([[disc.x - disc.radius, disc.y - disc.radius] for disc in discs], axis=0)
    middle = 0.5 * (low[0] + max(disc.x + disc.radius for disc in discs))
    return [
        label('summary', (middle, min(0.0, low[1]) - (4 + 1.6 * number) * _LETTERS), line, FOUND if found else TEXT)
        for number, line in enumerate(lines)
    ]


def label(group: str, place: tuple[float, float], text: str, colour: Colour) -> Primitive:
    """A text at a place."""
    return Primitive(group, 'text', places([place], _HEIGHT), colour, _LETTERS, text=text)


def _circle() -> Floats:
    """A closed circle of radius 1, (n, 2)."""
    angles = np.linspace(0, 2 * np.pi, 49)
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def places(points: ArrayLike, height: float = 0.0) -> tuple[tuple[float, float, float], ...]:
    """Places (n, 2) in the plane at a height."""
    return tuple((float(x), float(y), height) for x, y in np.asarray(points, dtype=float))

"""URDF: of the arm, as the cell description states it or as it was calibrated, and a robot as its own describes it.

The frames are those of (5), in the names of REP-103, REP-105 and ROS-Industrial: `base_link` is the frame in which the
objects are given, the tip is `tool0`. The offsets are in the origins of the joints, so that the joint angles which the
robot reports are those of the URDF:

    base_link --(x0, y0), theta1--> link1 --(l1, 0), theta2--> link2 --(l2, 0)--> tool0

A URDF is rigid: the tip is H(L̄, Q), without deflection and backlash.

**A robot as its URDF describes it**: links and joints, and where they are at given positions of the joints.

Of each link its inertia counts, of each joint what moves it. A joint that is not told stands at 0, one that mimics
another where that brings it.

The XML is read as `check_urdf` of ROS reads it, whose parser knows no namespaces, entities or schema: tags have to be
whole and to close in their order; of elements and attributes that are there twice the first counts. Each element keeps
its place in the text, for messages and for `files.robot_cell`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from html import unescape
from math import pi
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from markupsafe import Markup
from scipy.spatial.transform import Rotation

from scara_kinetostatic.errors import InputError, did_you_mean, one_line
from scara_kinetostatic.files.atomic import KIB, MIB, read_file, render
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import BASE_FRAME as BASE_FRAME
from scara_kinetostatic.model.cell import Cell, turned_limits
from scara_kinetostatic.model.parameters import Parameters

TOOL_FRAME = 'tool0'
"""Frame of the tip; x runs along link 2."""
NOMINAL_COLOUR = (*(0.55,) * 3, 0.6)
CALIBRATED_COLOUR = (0.0, 0.45, 0.70, 0.9)

Colour = tuple[float, float, float, float]


def comment(line: str) -> str:
    """A line that begins or ends no comment of XML or C, has no trigraph, and in CSV no cell that is a formula."""
    line = re.sub('-(?=-|$)', '- ', one_line(line))
    line = re.sub(r'(?<=/)(?=\*)|(?<=\*)(?=/)|(?<=\?)(?=\?)', ' ', line)
    return re.sub('([,;])(?=[-=+@])', r'\1 ', line)


def xacro(text: str) -> str:
    """A text in which xacro evaluates nothing but the dollar signs themselves."""
    return text.replace('$', "${'$'}")


def arm_urdf(name: str, cell: Cell, parameters: Parameters, colour: Colour = NOMINAL_COLOUR, comment: str = '') -> str:
    """The text of a URDF, from the template `arm.urdf.j2`.

    Args:
        name: of the robot.
        cell: names, directions and limits of q1 and q2 in `JointState`; their coupling: a joint that mimics q1 then
            turns q2 back; the lift; and the plane, in which the arm is.
        parameters: L̄.
        colour: red, green, blue, opacity, 0 to 1.
        comment: XML to stand before the robot.
    """
    return render(
        Path(__file__).with_name('arm.urdf.j2'),
        name=name,
        joints=cell.joint_names,
        back=-cell.coupling,
        axes=cell.direction,
        **place_of_arm(cell),
        p=parameters,
        colour=colour,
        quarter=pi / 2,
        comment=Markup(comment),
    )


def place_of_arm(cell: Cell) -> dict[str, Any]:
    """Where the arm of a cell stands and how far it moves, for a template: the robot's frame, that of the plane, the
    angles between; the limits of both readings, None where there are none; the lift.

    The reading of a coupled joint has those of its angle and the part of joint 1 together.
    """
    plane, lift = cell.plane, cell.lift
    limits = np.array(turned_limits(cell.limits, cell.direction) or np.zeros((2, 2)))
    limits[1] += np.sort(cell.coupling * limits[0])
    raised = lift and lift._asdict() | {'sense': 1 if lift.up > lift.down else -1, 'limits': sorted(lift[1:])}
    return {
        'plane': plane,
        'base': 'arm_plane' if plane.is_stated else plane.frame,
        'rpy': Rotation.from_matrix(plane.axes).as_euler('xyz').tolist(),
        'limits': limits.tolist() if cell.limits else (None, None),
        'lift': raised,
    }


MOST_BYTES = 16 * MIB
"""A larger file is no URDF."""
_DEEPEST = 100
"""Tags within each other: a URDF has five, what simulators add to it some ten."""
ATTRIBUTE = r"""([^\s<>/="']+)\s*=\s*("[^"]*"|'[^']*')"""
TOKEN = re.compile(
    r'<!--.*?-->|<!\[CDATA\[.*?\]\]>|<!(?!--)[^>]*>|<\?.*?\?>|</(?P<closes>[^\s<>]+)[^<>]*>|'
    rf"""<\s*(?P<tag>[^\s<>/="'!?]+)(?=[\s/>])(?:\s*{ATTRIBUTE})*\s*(?P<is_empty>/?)>""",
    re.DOTALL,
)
"""A comment, characters, a declaration, an instruction, an end tag or a start tag."""
_MIMIC = ('multiplier', (1.0,)), ('offset', (0.0,))
_TURNING = ('revolute', 'continuous')

Vector = tuple[float, ...]


class Joint:
    """A joint.

    Args:
        robot: whose it is.
        of: the element that describes it.

    Attributes:
        element: as given.
        name: of it.
        type: `revolute`, `continuous`, `prismatic`, `fixed` or another.
        parent: link on which it is.
        child: link that it moves.
        xyz: its place in the parent, (3,), m.
        rpy: roll, pitch and yaw there, (3,), rad.
        axis: in its own frame, (3,).
        limits: the lower and the upper one, rad or m; None where none are stated.
        mimics: the joint that brings it along, by a factor and an offset; empty where it is moved by itself.
        factor: of that.
        offset: of that, rad or m.

    Raises:
        InputError: something of it is missing, or no number.
    """

    def __init__(self, robot: RobotDescription, of: Element) -> None:
        self.element, self.name, self.type = of, robot.word(of, 'name'), robot.word(of, 'type')
        self.parent, self.child = (robot.word(of, 'link', tag) for tag in ('parent', 'child'))
        self.xyz, self.rpy = (robot.numbers(of, key, 'origin', (0.0,) * 3) for key in ('xyz', 'rpy'))
        axis = 'no axis' if self.type in ('fixed', 'floating') else 'axis'
        self.axis = robot.numbers(of, 'xyz', axis, (1.0, 0.0, 0.0))
        (low,), (high,) = (robot.numbers(of, key, 'limit', (0.0,)) for key in ('lower', 'upper'))
        self.limits = None if of.find('limit') is None else (low, high)
        self.mimics = '' if of.find('mimic') is None else robot.word(of, 'joint', 'mimic')
        (self.factor,), (self.offset,) = (robot.numbers(of, key, 'mimic', usual) for key, usual in _MIMIC)


class RobotDescription:
    """A robot.

    Args:
        content: of its URDF.
        where: the file or topic, for messages.

    Attributes:
        where: as given.
        text: of the URDF, every character of it.
        encoding: by which that becomes `content` again.
        starts: where the start tag of each element begins in the text.
        joints: by name.
        root: name of the link on which all others stand.
        inertias: of the links that have some: mass, kg, and its centre in the link, (3,), m.

    Raises:
        InputError: the text is no URDF, or a xacro, or its links make no tree.
    """

    def __init__(self, content: bytes, where: str) -> None:
        self.where = where
        self.text, self.encoding = _decoded(content)
        self.starts: dict[Element, int] = {}
        top = self._parsed()
        robot = top.find('robot')
        if robot is None:
            got = f'its root is <{top[0].tag}>' if len(top) else 'there is no tag in it'
            raise self.error(f'is no URDF: expected <robot>, {got}', 'give the URDF of the robot')
        for each in robot.iter():
            if each.tag.startswith('xacro:'):
                raise self._is_xacro(each, f'<{each.tag}>')
        links = [(self.word(each, 'name'), each) for each in robot.findall('link')]
        joints = [Joint(self, each) for each in robot.findall('joint')]
        self.joints = {joint.name: joint for joint in joints}
        self._links = dict(links)
        self._parents = {joint.child: joint for joint in joints}
        if len(self._parents) < len(joints):
            raise self.error('two of its joints have one child: a loop', 'describe the arm as a tree')
        if len(self.joints) < len(joints) or len(self._links) < len(links):
            raise self.error('two of its joints or links have one name', 'give each its own')
        if not links:
            raise self.error('there is no <link> in its <robot>', 'give the URDF of the robot')
        names = dict.fromkeys((*self._links, *(joint.parent for joint in joints)))
        roots = [name for name in names if name not in self._parents]
        if len(roots) != 1:
            remedy = 'describe a tree of links, without a loop'
            raise self.error(f'expected one link without a parent, got {" ".join(roots) or "none"}', remedy)
        self.root = roots[0]
        self.inertias: dict[str, tuple[float, Floats]] = {}
        for name, link in links:
            inertial = link.find('inertial')
            if inertial is not None and (mass := self.numbers(inertial, 'value', 'mass', (0.0,))[0]):
                self.inertias[name] = mass, np.array(self.numbers(inertial, 'xyz', 'origin', (0.0,) * 3))

    def _parsed(self) -> Element:
        """What contains the elements of the text that are in no other."""
        at, opened = 0, [Element('')]
        while (at := self.text.find('<', at)) >= 0:
            token, last = TOKEN.match(self.text, at), opened[-1]
            if token is None:
                raise self._error_at(at, f'expected a tag, got {self.text[at : at + 40].splitlines()[0]}')
            if (name := token['closes']) is not None:
                if name != last.tag:
                    end = f'</{last.tag}> of line {self._line(self.starts[last])}' if last.tag else 'no end'
                    raise self._error_at(at, f'</{name}> where {end} is expected')
                opened.pop()
            elif token['tag']:
                attributes = {key: unescape(value[1:-1]) for key, value in reversed(re.findall(ATTRIBUTE, token[0]))}
                element = SubElement(last, token['tag'], attributes)
                self.starts[element] = at
                opened += [] if token['is_empty'] else [element]
                if len(opened) > _DEEPEST:
                    raise self._error_at(at, f'more than {_DEEPEST} tags within each other')
            at = token.end()
        if len(opened) > 1:
            raise self._error_at(self.starts[opened[-1]], f'<{opened[-1].tag}> has no end')
        return opened[0]

    def word(self, of: Element, key: str, tag: str = '') -> str:
        """The value of an attribute of an element, or of its first child of a name.

        Raises:
            InputError: there is none, or it is one of a xacro.
        """
        element = of.find(tag) if tag else of
        text = None if element is None else element.get(key)
        if text is None:
            raise self._error_at(self.starts[of], f'a {of.tag} without {f"<{tag}> with " if tag else ""}{key}')
        if '${' in text or '$(' in text:
            raise self._is_xacro(of, f'{key}="{text}"')
        return text

    def numbers(self, of: Element, key: str, tag: str, usual: Vector) -> Vector:
        """The same as numbers, as many as usual; these where there are none.

        Raises:
            InputError: there are others.
        """
        element, values = of.find(tag), Vector()
        if element is None or element.get(key) is None:
            return usual
        text = self.word(element, key)
        with suppress(ValueError):
            values = tuple(map(float, text.split()))
        if len(values) != len(usual):
            expected = '3 numbers' if len(usual) > 1 else 'a number'
            raise self._error_at(self.starts[element], f'expected {expected}, got {key}="{text}" in <{tag}>')
        return values

    def _line(self, at: int) -> int:
        return self.text.count('\n', 0, at) + 1

    def _error_at(self, at: int, problem: str) -> InputError:
        return self.error(f'is no valid URDF: line {self._line(at)}: {problem}', 'correct it there')

    def _is_xacro(self, element: Element, what: str) -> InputError:
        problem = f'a xacro is a program, and line {self._line(self.starts[element])} has {what}'
        return self.error(problem, f'expand it: xacro {self.where} > expanded.urdf')

    def error(self, problem: str, remedy: str = '') -> InputError:
        """An error that names the file."""
        return InputError(self.where, problem, remedy)

    def joint(self, name: str) -> Joint:
        """A joint.

        Raises:
            InputError: there is none of that name.
        """
        if name not in self.joints:
            moving = [joint.name for joint in self.joints.values() if joint.type != 'fixed']
            raise self.error(f'there is no joint {name!r}', did_you_mean(name, moving, 'its joints are'))
        return self.joints[name]

    def turning(self, name: str) -> Joint:
        """A joint that turns and is moved by itself.

        Raises:
            InputError: it does not.
        """
        joint = self.joint(name)
        if joint.type not in _TURNING or joint.mimics:
            kind = f'mimics {joint.mimics}' if joint.mimics else f'is {joint.type}, not revolute'
            raise self.error(f'joint {name!r} {kind}', 'choose a joint that turns by itself')
        return joint

    def chain(self, link: str) -> list[Joint]:
        """The joints from the root to a link.

        Raises:
            InputError: there is no such link, or its joints go round in a loop.
        """
        if link not in self._links:
            raise self.error(f'there is no link {link!r}', did_you_mean(link, self._links, 'its links are'))
        found: list[Joint] = []
        while link in self._parents:
            found.insert(0, self._parents[link])
            link = found[0].parent
            if len(found) > len(self.joints):
                raise self.error(f'the joints above {link!r} go round in a loop', 'describe the arm as a tree')
        return found

    def frame(self, link: str, positions: Mapping[str, float]) -> Floats:
        """Where a link is in the root, (4, 4).

        Args:
            link: its name.
            positions: of joints by name, rad or m; 0 of those that are not there.
        """
        found = np.eye(4)
        for joint in self.chain(link):
            step = np.eye(4)
            step[:3, :3], step[:3, 3] = Rotation.from_euler('xyz', joint.rpy).as_matrix(), joint.xyz
            found = found @ step
            along = np.array(axis_of(joint)) * self._position(joint, positions)
            if joint.type in _TURNING:
                found[:3, :3] = found[:3, :3] @ Rotation.from_rotvec(along).as_matrix()
            elif joint.type == 'prismatic':
                found[:3, 3] += found[:3, :3] @ along
            if not np.isfinite(found).all():
                raise self.error(f'joint {joint.name!r} has no axis, or a number that is not finite', 'correct it')
        return found

    def _position(self, joint: Joint, positions: Mapping[str, float]) -> float:
        is_moved = joint.mimics in ('', joint.name)
        at = float(positions.get(joint.name if is_moved else joint.mimics, 0.0))
        return at if is_moved else at * joint.factor + joint.offset

    def masses_beyond(self, joint: str, positions: Mapping[str, float]) -> Iterator[tuple[str, tuple[float, Floats]]]:
        """Name, mass, kg, and centre in the root, (3,), m, of each link that a joint moves."""
        for name, (mass, center) in self.inertias.items():
            if mass < 0:
                raise self.error(f'the mass of link {name!r} is {mass:g} kg', 'correct the URDF')
            if any(each.name == joint for each in self.chain(name)):
                yield name, (mass, (self.frame(name, positions) @ [*center, 1.0])[:3])


def axis_of(joint: Joint) -> tuple[float, float, float]:
    """The axis of a joint in its own frame, of unit length."""
    axis = np.array(joint.axis)
    x, y, z = (axis / (np.linalg.norm(axis) or np.nan)).tolist()
    return x, y, z


def _decoded(content: bytes) -> tuple[str, str]:
    """The text of a file and its encoding: by its mark, as it declares, or UTF-8; else Latin-1, of any byte."""
    mark = {b'\xff\xfe': 'utf-16-le', b'\xfe\xff': 'utf-16-be'}.get(content[:2])
    declared = re.search(rb"""<\?xml[^>]*?encoding\s*=\s*["']([\w.-]+)""", content[:KIB])
    for encoding in (mark or (declared[1].decode() if declared else 'utf-8'), 'utf-8'):
        with suppress(LookupError, UnicodeError):
            if (text := content.decode(encoding)).encode(encoding) == content:
                return text, encoding
    return content.decode('latin-1'), 'latin-1'


def read_robot(path: Path) -> RobotDescription:
    """The robot of a URDF file.

    Raises:
        InputError: the file cannot be read, or is none, or a xacro.
    """
    if path.suffix == '.xacro':
        raise InputError(path, 'a xacro is a program', f'expand it: xacro {path} > robot.urdf')
    return RobotDescription(read_file(path, InputError, MOST_BYTES, 'URDF'), str(path))

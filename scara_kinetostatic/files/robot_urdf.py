"""A robot as its URDF describes it: links and joints, and where they are at given positions of the joints.

`urdfdom_py` of ROS reads the URDF; of each link its inertia counts, of each joint what moves it. A joint that is not
told stands at 0, one that mimics another where that brings it.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import redirect_stderr
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from scara_kinetostatic.errors import InputError, did_you_mean
from scara_kinetostatic.files.atomic import read_file
from scara_kinetostatic.model.arrays import Floats

MOST_BYTES = 16 * 1024**2
"""A larger file is no URDF."""
_KEPT = {'link': {'inertial'}, 'joint': {'parent', 'child', 'origin', 'axis', 'limit', 'mimic'}}
_TURNING = ('revolute', 'continuous')


class Robot:
    """A robot.

    Args:
        text: of its URDF.
        where: the file or topic, for messages.

    Attributes:
        where: as given.
        joints: of the library, by name: `type`, `parent`, `child`, `axis`, `limit`, `mimic`.
        root: name of the link on which all others stand.
        inertias: of the links that have some: mass, kg, and its centre in the link, (3,), m.

    Raises:
        InputError: the library is missing, or the text is no URDF, or its links make no tree.
    """

    def __init__(self, text: bytes, where: str) -> None:
        self.where = where
        robot = self._parsed(text)
        self.joints: dict[str, Any] = {joint.name: joint for joint in robot.joints}
        self._links: dict[str, Any] = {link.name: link for link in robot.links}
        self._parents: dict[str, Any] = {joint.child: joint for joint in robot.joints}
        if len(self._parents) < len(robot.joints):
            raise self.error('two of its joints have one child: a loop', 'describe the arm as a tree')
        if len(self.joints) < len(robot.joints) or len(self._links) < len(robot.links):
            raise self.error('two of its joints or links have one name', 'give each its own')
        links = dict.fromkeys((*self._links, *(joint.parent for joint in robot.joints)))
        roots = [name for name in links if name not in self._parents]
        if len(roots) != 1:
            remedy = 'describe a tree of links, without a loop'
            raise self.error(f'expected one link without a parent, got {" ".join(roots) or "none"}', remedy)
        self.root = roots[0]
        weighing = {name: link.inertial for name, link in self._links.items() if link.inertial and link.inertial.mass}
        self.inertias = {name: (float(i.mass), _matrix(i.origin)[:3, 3]) for name, i in weighing.items()}

    def _parsed(self, text: bytes) -> Any:
        from urdf_parser_py.urdf import URDF

        try:
            tree = ElementTree.fromstring(text)
            for parent, kept in [(tree, set(_KEPT)), *((child, _KEPT.get(child.tag, set())) for child in tree)]:
                for child in [child for child in parent if child.tag not in kept]:
                    parent.remove(child)
                if parent is not tree and len({child.tag for child in parent}) < len(parent):
                    raise ValueError(f'{parent.tag} {parent.get("name")!r} has one of its elements twice')
            with redirect_stderr(io.StringIO()):  # of attributes that it does not know
                return URDF.from_xml_string(ElementTree.tostring(tree))
        except Exception as error:  # whatever the library raises
            raise self.error(f'is no valid URDF: {error}', 'check_urdf FILE says more') from error

    def error(self, problem: str, remedy: str = '') -> InputError:
        """An error that names the file."""
        return InputError(self.where, problem, remedy)

    def joint(self, name: str) -> Any:
        """A joint.

        Raises:
            InputError: there is none of that name.
        """
        if name not in self.joints:
            moving = [joint.name for joint in self.joints.values() if joint.type != 'fixed']
            raise self.error(f'there is no joint {name!r}', did_you_mean(name, moving, 'its joints are'))
        return self.joints[name]

    def turning(self, name: str) -> Any:
        """A joint that turns and is moved by itself.

        Raises:
            InputError: it does not.
        """
        joint = self.joint(name)
        if joint.type not in _TURNING or joint.mimic:
            kind = f'mimics {joint.mimic.joint}' if joint.mimic else f'is {joint.type}, not revolute'
            raise self.error(f'joint {name!r} {kind}', 'choose a joint that turns by itself')
        return joint

    def chain(self, link: str) -> list[Any]:
        """The joints from the root to a link.

        Raises:
            InputError: there is no such link, or its joints go round in a loop.
        """
        if link not in self._links:
            raise self.error(f'there is no link {link!r}', did_you_mean(link, self._links, 'its links are'))
        found: list[Any] = []
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
            found = found @ _matrix(joint.origin)
            along = np.array(axis_of(joint)) * self._position(joint, positions)
            if joint.type in _TURNING:
                found[:3, :3] = found[:3, :3] @ Rotation.from_rotvec(along).as_matrix()
            elif joint.type == 'prismatic':
                found[:3, 3] += found[:3, :3] @ along
            if not np.isfinite(found).all():
                raise self.error(f'joint {joint.name!r} has no axis, or a number that is not finite', 'correct it')
        return found

    def _position(self, joint: Any, positions: Mapping[str, float]) -> float:
        mimic = joint.mimic
        if not mimic or mimic.joint == joint.name:
            return float(positions.get(joint.name, 0.0))
        of = float(positions.get(mimic.joint, 0.0))
        return of * (1.0 if mimic.multiplier is None else mimic.multiplier) + (mimic.offset or 0.0)

    def masses_beyond(self, joint: str, positions: Mapping[str, float]) -> Iterator[tuple[str, tuple[float, Floats]]]:
        """Name, mass, kg, and centre in the root, (3,), m, of each link that a joint moves."""
        for name, (mass, center) in self.inertias.items():
            if mass < 0:
                raise self.error(f'the mass of link {name!r} is {mass:g} kg', 'correct the URDF')
            if any(each.name == joint for each in self.chain(name)):
                yield name, (mass, (self.frame(name, positions) @ [*center, 1.0])[:3])


def axis_of(joint: Any) -> tuple[float, float, float]:
    """The axis of a joint in its own frame, of unit length."""
    axis = np.array(joint.axis or (1.0, 0.0, 0.0), dtype=float)
    x, y, z = (axis / (np.linalg.norm(axis) or np.nan)).tolist()
    return x, y, z


def _matrix(origin: Any) -> Floats:
    """An origin of the library as a transform, (4, 4)."""
    found = np.eye(4)
    if origin is not None:
        found[:3, :3] = Rotation.from_euler('xyz', origin.rpy or (0.0, 0.0, 0.0)).as_matrix()
        found[:3, 3] = origin.xyz or (0.0, 0.0, 0.0)
    return found


def read_robot(path: Path) -> Robot:
    """The robot of a URDF file.

    Raises:
        InputError: the file cannot be read, or is none.
    """
    return Robot(read_bytes(path), str(path))


def read_bytes(path: Path) -> bytes:
    """The content of a URDF file.

    Raises:
        InputError: it cannot be read, or is a xacro.
    """
    if path.suffix == '.xacro':
        raise InputError(path, 'a xacro is a program', f'expand it: xacro {path} > robot.urdf')
    return read_file(path, InputError, MOST_BYTES, 'URDF')

"""Robots of the package `example-robot-data` (PyPI) as upright cells, as the verb `cell --urdf` describes them.

Shoulder and elbow of the UR5 and of the Panda, whose hand is turned into the forearm's plane as in its usual pose, by
a right angle. In random places within reach stand three steel discs and a block.
"""

from __future__ import annotations

from importlib.metadata import files
from math import cos, pi, sin
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.files.calibration_file import nominal_arm
from scara_kinetostatic.files.cell_file import read_cell
from scara_kinetostatic.files.robot_cell import planar_arm, robot_cell
from scara_kinetostatic.files.urdf import read_robot
from scara_kinetostatic.model.cell import Cell, Disc, layout_problems
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.planning.next_touches import Planner

TIP_RADIUS = 0.005
"""m."""


class Source(NamedTuple):
    """What `cell --urdf` is told.

    Attributes:
        file: the end of its path in the package.
        joints: shoulder and elbow.
        tip: link.
        at: positions of other joints, rad.
    """

    file: str
    joints: tuple[str, str]
    tip: str
    at: dict[str, float]


SOURCES = {
    'ur5': Source('ur5_robot.urdf', ('shoulder_lift_joint', 'elbow_joint'), 'tool0', {}),
    'panda': Source(
        'panda_description/urdf/panda.urdf',
        ('panda_joint2', 'panda_joint4'),
        'panda_hand_tcp',
        {'panda_joint6': round(pi / 2, 4)},
    ),
}


def path_of(source: Source) -> Path:
    """The URDF.

    Raises:
        PackageNotFoundError: `example-robot-data` is not installed.
    """
    found = [file for file in files('example-robot-data') or () if file.as_posix().endswith(source.file)]
    return Path(str(found[0].locate()))


def masses_of(name: str) -> tuple[float, float]:
    """Of link 1 and link 2 with all they carry, kg."""
    source = SOURCES[name]
    robot = read_robot(path_of(source))
    others = {joint: source.at.get(joint, 0.0) for joint in robot.joints if joint not in source.joints}
    first, second = planar_arm(robot, source.joints, source.tip, others).mass
    return first - second, second


def urdf_cell(name: str, seed: int, known: float) -> Cell:
    """A cell of a robot, the first from a seed on all of whose objects can be touched.

    Args:
        name: of the robot.
        seed: of the places of the objects.
        known: standard uncertainty of the objects' places and radii, m.
    """
    source, random = SOURCES[name], np.random.default_rng([3103, seed])
    text, _ = robot_cell(read_robot(path_of(source)), source.joints, source.tip, source.at)
    stated = yaml.safe_load(text) | {'tip': {'radius': TIP_RADIUS}, 'noise': {'joint': 1e-5, 'force': 0.3}}
    links = [stated['robot']['nominal'][link] for link in ('l1', 'l2')]
    while True:
        objects = []
        for number in range(4):
            away, turn = random.uniform(0.45, 0.85) * sum(links), random.uniform(-0.8, pi + 0.8)
            x, y = away * cos(turn), away * sin(turn)
            item = {'name': f'disc_{number + 1}', 'center': [x, y], 'radius': random.uniform(0.03, 0.08)}
            key = 'radius'
            if number == 3:
                a, b, tilt = random.uniform(0.03, 0.08), random.uniform(0.03, 0.08), random.uniform(0.0, pi)
                corners = [complex(x, y) + complex(u * a, v * b) * complex(cos(tilt), sin(tilt)) for u, v in _AROUND]
                item, key = {'name': 'block', 'outline': [[each.real, each.imag] for each in corners]}, 'offset'
            objects.append(item | {'uncertainty': {'center': known, key: known}})
        cell = read_cell(stated | {'objects': objects}, source.file, check_layout=False)
        if layout_problems(cell, cell.centers, cell.radii + 0.03):
            continue
        try:
            reached = Planner(nominal_arm(cell)).candidates.plan.disc
        except ScaraKinetostaticError:
            continue
        if len(np.unique(reached)) == len(objects):
            return cell


_AROUND = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def displaced(cell: Cell, known: float, random: np.random.Generator) -> tuple[Disc | Outline, ...]:
    """The objects as they truly are: known to so much in place and, discs, in size, m."""
    found = list[Disc | Outline]()
    for disc in cell.discs:
        dx, dy, dr = (known * random.standard_normal(3)).tolist()
        if isinstance(disc, Disc):
            found.append(disc._replace(x=disc.x + dx, y=disc.y + dy, radius=disc.radius + dr))
        else:
            found.append(disc._replace(corners=tuple((x + dx, y + dy) for x, y in disc.corners)))
    return tuple(found)


def true_robot(cell: Cell, random: np.random.Generator) -> Parameters:
    """A robot 3 mm, 3 mrad and 0.3 mm off its nominal geometry and up to a fifth off its static moments."""
    off = random.standard_normal(6) * [3e-3, 3e-3, 3e-3, 3e-4, 3e-3, 3e-4]
    compliances, backlashes = 10 ** random.uniform(-5.3, -4.2, 3), random.uniform(0.5e-4, 3e-4, 3)
    moments = np.array([cell.nominal.s1, cell.nominal.s2]) * random.uniform(0.8, 1.2, 2)
    return cell.nominal.with_array([*(cell.nominal.as_array()[:6] + off), *compliances, *backlashes, *moments])

"""URDF of the arm, as the cell description states it or as it was calibrated.

The frames are those of (5), in the names of REP-103, REP-105 and ROS-Industrial: `base_link` is the frame in which the
objects are given, the tip is `tool0`. The offsets are in the origins of the joints, so that the joint angles which the
robot reports are those of the URDF:

    base_link --(x0, y0), theta1--> link1 --(l1, 0), theta2--> link2 --(l2, 0)--> tool0

A URDF is rigid: the tip is H(L̄, Q), without deflection and backlash.
"""

from __future__ import annotations

import re
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from scara_kinetostatic.errors import one_line
from scara_kinetostatic.model.cell import BASE_FRAME as BASE_FRAME
from scara_kinetostatic.model.cell import Cell, turned_limits
from scara_kinetostatic.model.parameters import Parameters

TOOL_FRAME = 'tool0'
"""Frame of the tip; x runs along link 2."""
NOMINAL_COLOUR = (0.55, 0.55, 0.55, 0.6)
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


def render(path: Path, *, escape: bool = True, **values: Any) -> str:
    """The text of a Jinja template with its values; one that is missing is an error.

    Args:
        path: the template; it may include others of its folder.
        escape: whether values are escaped as HTML and XML need it.
        values: by name.
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(path.parent),
        autoescape=escape,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(path.name).render(**values)


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
    from scipy.spatial.transform import Rotation

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

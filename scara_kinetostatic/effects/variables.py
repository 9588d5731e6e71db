"""The variables over which a residual can be plotted: what `Effect.plot_variable` names."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import ForceDependence, TouchState

STICKING = 0.1
"""A tip that comes within this angle of the normal sticks, as a usual coefficient of friction has it, rad."""


class PlotAxis(NamedTuple):
    """The x axis of a plot of residuals.

    Attributes:
        title: what it is, in words.
        unit: of the values; empty where they have none.
        values: one per touch, (n,).
    """

    title: str
    unit: str
    values: Floats


class Variable(NamedTuple):
    """A property of touches.

    Attributes:
        label: in words; ``{joint}`` stands for the joint's number.
        unit: of the values; empty where they have none.
        values: from touches and a joint, 0 or 1 or None, to values (n,). A variable of a joint takes joint 1 for
            None; the others do not depend on it.
        force_dependence: what of the force it depends on, as far as a fitted curve needs it.
    """

    label: str
    unit: str
    values: Callable[[TouchState, int | None], Floats]
    force_dependence: ForceDependence = ForceDependence.ALL

    def title(self, joint: int | None = None) -> str:
        """In words, of a joint where it is one of a joint."""
        return self.label.format(joint=(joint or 0) + 1)

    def axis(self, at: TouchState, joint: int | None = None) -> PlotAxis:
        """The variable at n touches, of a joint where it is one of a joint."""
        return PlotAxis(self.title(joint), self.unit, np.asarray(self.values(at, joint), dtype=float))


def slide(at: TouchState) -> Floats:
    """How far the last movement in contact drags the tip aside, (n,): +1 or -1, or between where the tip sticks.

    It is the part along t of the movement J ΔQ, divided by the whole movement and by `STICKING`, limited to ±1. Both
    the movement and t = R90 n are those of the rigid tip at the measured angles.
    """
    p = at.parameters
    links = at.joints + np.array([p.theta1, p.theta2])
    first, second = links[:, 0], links.sum(axis=1)
    x2, y2 = p.l2 * np.cos(second), p.l2 * np.sin(second)
    x1, y1 = p.l1 * np.cos(first) + x2, p.l1 * np.sin(first) + y2
    turn1, turn2 = at.metadata.press.T
    inward_x, inward_y = at.centers[:, 0] - p.x0 - x1, at.centers[:, 1] - p.y0 - y1
    if at.tangents is not None:
        t, outer = at.tangents, np.sign(at.radii)
        inward_x = np.where(t.any(axis=1), -t[:, 1], outer * inward_x)
        inward_y = np.where(t.any(axis=1), t[:, 0], outer * inward_y)
    move_x, move_y = -y1 * turn1 - y2 * turn2, x1 * turn1 + x2 * turn2
    size = np.hypot(inward_x, inward_y) * np.hypot(move_x, move_y)
    aside = (inward_x * move_y - inward_y * move_x) / np.where(size > 0, size, 1.0)
    return np.asarray(np.clip(aside / STICKING, -1.0, 1.0))


def _of_joint(pairs: Callable[[TouchState], Floats]) -> Callable[[TouchState, int | None], Floats]:
    """The joint's column of (n, 2)."""
    return lambda at, joint: pairs(at)[:, joint or 0]


def _angle(vectors: Floats) -> Floats:
    return np.asarray(np.arctan2(vectors[:, 1], vectors[:, 0]))


def _from_link2(at: TouchState) -> Floats:
    across = at.normal[:, 1] * at.link2[:, 0] - at.normal[:, 0] * at.link2[:, 1]
    return np.asarray(np.arctan2(across, (at.normal * at.link2).sum(axis=1)))


def _numbers(at: TouchState) -> Floats:
    """Place of each touch in the order of time."""
    order = at.metadata.order
    return np.zeros_like(at.magnitude) if order is None else order.astype(float)


_NONE, _DIRECTION = ForceDependence.NONE, ForceDependence.DIRECTION
VARIABLES = {
    'angle': Variable('angle of joint {joint}', 'rad', _of_joint(lambda at: at.joints), _NONE),
    'torque': Variable('torque of joint {joint}', 'Nm', _of_joint(lambda at: at.torques)),
    'link1_torque': Variable(
        'bending moment in the middle of link 1', 'Nm', lambda at, _: 0.5 * at.torques.sum(axis=1)
    ),
    'other_angle': Variable(
        'angle of the joint beside joint {joint}', 'rad', lambda at, joint: at.joints[:, 1 - (joint or 0)], _NONE
    ),
    'magnitude': Variable('force', 'N', lambda at, _: at.magnitude),
    'direction': Variable('direction of the force', 'rad', lambda at, _: _angle(at.normal), _DIRECTION),
    'direction_from_link2': Variable(
        'direction of the force from link 2', 'rad', lambda at, _: _from_link2(at), _DIRECTION
    ),
    'place': Variable('place on the disc', 'rad', lambda at, _: _angle(-at.normal)),
    'disc': Variable('number of the object', '', lambda at, _: at.metadata.disc.astype(float) + 1),
    'along_edge': Variable('place along the edge', 'm', lambda at, _: at.along_edge, _NONE),
    'time': Variable('time', 's', lambda at, _: at.metadata.time, _NONE),
    'touch': Variable('number of the touch', '', lambda at, _: _numbers(at)),
    'approach': Variable(
        'direction of approach of joint {joint}', '', _of_joint(lambda at: np.sign(at.metadata.approach))
    ),
    'slide': Variable('direction of the slide along the disc', '', lambda at, _: slide(at)),
}
"""By name; the keys are what `Effect.plot_variable` may be."""

"""What the residual can be looked at over: the closed set of variables that `Effect.betrays` names."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.effects.base import Floats
from scara_kinetostatic.effects.contact_friction import slide
from scara_kinetostatic.model.law import TouchState


class Variable(NamedTuple):
    """A property of touches.

    Attributes:
        label: in words, with the unit; ``{joint}`` stands for the joint's number.
        values: from touches and a joint, 0 or 1 or None, to values (n,). A variable of a joint takes joint 1 for
            None; the others do not look at it.
    """

    label: str
    values: Callable[[TouchState, int | None], Floats]

    def title(self, joint: int | None = None) -> str:
        """The label, the joint named."""
        return self.label.format(joint=(joint or 0) + 1)


def _of_joint(pairs: Callable[[TouchState], Floats]) -> Callable[[TouchState, int | None], Floats]:
    """The joint's column of (n, 2)."""
    return lambda at, joint: pairs(at)[:, joint or 0]


def _angle(vectors: Floats) -> Floats:
    return np.asarray(np.arctan2(vectors[:, 1], vectors[:, 0]))


def _middle(at: TouchState, _: int | None) -> Floats:
    return 0.5 * (at.torques[:, 0] + at.torques[:, 1])


def _from_link2(at: TouchState) -> Floats:
    along = (at.normal * at.link2).sum(axis=1)
    across = at.normal[:, 1] * at.link2[:, 0] - at.normal[:, 0] * at.link2[:, 1]
    return np.asarray(np.arctan2(across, along))


VARIABLES = MappingProxyType(
    {
        'angle': Variable('angle of joint {joint} (rad)', _of_joint(lambda at: at.joints)),
        'torque': Variable('torque of joint {joint} (Nm)', _of_joint(lambda at: at.torques)),
        'link1_torque': Variable('bending moment in the middle of link 1 (Nm)', _middle),
        'magnitude': Variable('force (N)', lambda at, _: at.magnitude),
        'direction': Variable('direction of the force (rad)', lambda at, _: _angle(at.normal)),
        'direction_from_link2': Variable('direction of the force from link 2 (rad)', lambda at, _: _from_link2(at)),
        'place': Variable('place on the disc (rad)', lambda at, _: _angle(-at.normal)),
        'disc': Variable('number of the disc', lambda at, _: at.metadata.disc.astype(float) + 1),
        'time': Variable('time (s)', lambda at, _: at.metadata.time),
        'approach': Variable(
            'sense in which joint {joint} came to rest', _of_joint(lambda at: np.sign(at.metadata.approach))
        ),
        'slide': Variable('sense in which the tip slid along the disc', lambda at, _: slide(at)),
    }
)
"""By name; the keys are what `Effect.betrays` may say."""

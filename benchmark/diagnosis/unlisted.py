"""Effects that no list of the package has, written as a user would write them.

A cable that pulls in proportion to the angle is here, too, to show that no touch can tell it from the gain of an
encoder: its δ2 = p2 k q2 is that of the gain -p2 k, exactly. One that pulls as k sin q2 is likewise a transmission
error of one cycle per turn. Only a torque of another form is new.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchmark.diagnosis.cells import Setup, SimulatedEffects, seed_of
from scara_kinetostatic.effects.base import DiscEffect, Effect, JointEffect
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import Parameter, TouchState

LARGEST_REST = 0.5
"""Of the angle at which a cable is slack, rad."""


@dataclass(frozen=True)
class OvalDisc(DiscEffect):
    """A disc that is oval: as seen from its centre its edge is at r + a cos 2ψ + b sin 2ψ, to first order.

    ψ is the direction of the outward normal ν and h(ψ) the support function, so that a frictionless contact is at
    S_c + h ν + h' ν⊥, exactly. With ν = -n and ν⊥ = -t that is d = (h - r) n + h' t; 2ψ is twice the angle of n.
    """

    name: ClassVar[str] = 'oval_disc'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('a', 'm', 1e-3, 'radius along x beyond the mean; as much less along y'),
        Parameter('b', 'm', 1e-3, 'radius at 45° beyond the mean'),
    )
    statement: ClassVar[str] = '{target} is oval'
    confounded_with: ClassVar[str] = 'nothing, if the disc is touched all round'
    identified_by: ClassVar[str] = 'touches all round the disc'
    plot_variable: ClassVar[str] = 'direction'

    def places(self, at: TouchState) -> tuple[Floats, ...]:
        """(h - r) n + h' t per unit of a and of b."""
        angle = 2 * np.arctan2(at.normal[:, 1], at.normal[:, 0])
        c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
        return c * at.normal - 2 * s * at.tangent, s * at.normal + 2 * c * at.tangent


@dataclass(frozen=True)
class Leak(JointEffect):
    """Joint 2 leaks into joint 1, as in a belt drive through the shoulder: δ1 = k q2."""

    name: ClassVar[str] = 'joint_leak'
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter('k', '1', 1e-2, 'angle of joint 1 per angle of joint 2'),)
    statement: ClassVar[str] = 'joint 2 turns joint 1'
    confounded_with: ClassVar[str] = 'nothing, if the elbow moves far'
    identified_by: ClassVar[str] = 'touches over the whole range of joint 2'
    plot_variable: ClassVar[str] = 'angle'

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        """The angle of joint 2."""
        return (at.joints[:, 1],)


@dataclass(frozen=True)
class Cable(JointEffect):
    """A cable across the elbow pulls the more the farther it is from where it is slack: δ2 = p2 k (q2 - rest)².

    Attributes:
        rest: where it is slack, rad.
        power: 2; 1 for a cable that is a linear spring.
    """

    rest: float = 0.0
    power: int = 2

    name: ClassVar[str] = 'cable'
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter('k', 'Nm/rad^power', 10.0, 'torque on joint 2'),)
    statement: ClassVar[str] = 'a cable pulls at {target}'
    confounded_with: ClassVar[str] = 'the gain of the encoder, if it is linear'
    identified_by: ClassVar[str] = 'touches over the whole range of joint 2'
    plot_variable: ClassVar[str] = 'angle'

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        """What a unit of k makes of joint 2."""
        return (at.parameters.p2 * (at.joints[:, 1] - self.rest) ** self.power,)


UNLISTED = ('oval_disc', 'joint_leak[joint1]', 'cable[joint2]', 'linear_cable[joint2]')
"""What `unlisted` can make; the last is an alias of ``encoder_gain[joint2]``."""
ALIAS_OF = {'linear_cable[joint2]': 'encoder_gain[joint2]'}


def unlisted(kind: str, setup: Setup, seed: int) -> SimulatedEffects:
    """One of `UNLISTED` in a random way, of plausible size."""
    random = np.random.default_rng([seed, seed_of(kind)])
    sign = random.choice([-1.0, 1.0])
    if kind == 'oval_disc':
        disc, angle = int(random.integers(len(setup.cell.discs))), random.uniform(0, 2 * np.pi)
        effect: Effect = OvalDisc.of(disc, setup.cell.discs[disc].name)
        return SimulatedEffects((effect,), (1e-3 * np.array([np.cos(angle), np.sin(angle)]),))
    if kind == 'joint_leak[joint1]':
        effect = Leak(target='joint1', joint=0)
    elif kind == 'cable[joint2]':
        effect = Cable(target='joint2', joint=1, rest=random.uniform(-LARGEST_REST, LARGEST_REST))
    else:
        effect = Cable(target='joint2', joint=1, power=1)
    return SimulatedEffects((effect,), (sign * np.array([p.scale for p in effect.parameters]),))

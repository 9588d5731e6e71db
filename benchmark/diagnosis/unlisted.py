"""Effects that no list of the package has, written as a user would write them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchmark.diagnosis.cells import Setup, SimulatedEffects, seed_of
from scara_kinetostatic.effects.base import DiscEffect, Effect, JointEffect, LinearEffect
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.extended_model import Parameter, Shift, TouchState


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


class StiffGripper(LinearEffect):
    """The gripper yields less along link 2 than across it, an alias of p_ee and p2: d = excess (F·v) v."""

    name: ClassVar[str] = 'stiff_gripper'
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter('excess', 'm/N', 1e-5, 'stiffness along link 2'),)
    statement: ClassVar[str] = 'the gripper is stiffer along link 2'
    confounded_with: ClassVar[str] = 'p_ee and p2, always'
    identified_by: ClassVar[str] = 'no touches'
    plot_variable: ClassVar[str] = 'direction_from_link2'

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        """The part of the force along link 2, along link 2."""
        return (Shift(place=(at.force * at.link2).sum(axis=1)[:, None] * at.link2),)


@dataclass(frozen=True)
class Ripple(JointEffect):
    """Joint 1 turns by what a pulley of joint 2 that is not round gives it: δ1 = k sin 2 q2."""

    name: ClassVar[str] = 'ripple'
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter('k', 'rad', 1e-3, 'largest angle'),)
    statement: ClassVar[str] = 'joint 2 turns joint 1 to and fro'
    confounded_with: ClassVar[str] = 'nothing, if the elbow moves far'
    identified_by: ClassVar[str] = 'touches over the whole range of joint 2'
    plot_variable: ClassVar[str] = 'other_angle'

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        """A wave over the angle of joint 2."""
        return (np.sin(2 * at.joints[:, 1]),)


@dataclass(frozen=True)
class UnevenCompliance(JointEffect):
    """The compliance of a joint depends on its angle, as that of a gear on the teeth in mesh: δ = k q c."""

    name: ClassVar[str] = 'uneven_compliance'
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter('k', '1/Nm', 1e-5, 'compliance per angle'),)
    statement: ClassVar[str] = 'the compliance of {target} depends on its angle'
    confounded_with: ClassVar[str] = 'the compliance of the joint, if its angle hardly varies'
    identified_by: ClassVar[str] = 'touches over the whole range of the joint'
    plot_variable: ClassVar[str] = 'angle'

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        """Angle times torque."""
        return (at.joints[:, self.joint] * at.torques[:, self.joint],)


UNLISTED = ('oval_disc', 'ripple[joint1]', 'uneven_compliance[joint1]', 'uneven_compliance[joint2]')
"""What `unlisted` can make."""


def unlisted(kind: str, setup: Setup, seed: int) -> SimulatedEffects:
    """One of `UNLISTED` in a random way, of plausible size."""
    random = np.random.default_rng([seed, seed_of(kind)])
    sign = random.choice([-1.0, 1.0])
    if kind == 'oval_disc':
        disc, angle = int(random.integers(len(setup.cell.discs))), random.uniform(0, 2 * np.pi)
        effect: Effect = OvalDisc.of(disc, setup.cell.discs[disc].name)
        return SimulatedEffects((effect,), (1e-3 * np.array([np.cos(angle), np.sin(angle)]),))
    (effect,) = (law.of(joint) for law in (Ripple, UnevenCompliance) for joint in (0, 1) if law.of(joint).label == kind)
    return SimulatedEffects((effect,), (sign * np.array([p.scale for p in effect.parameters]),))

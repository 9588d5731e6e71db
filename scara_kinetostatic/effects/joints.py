"""Linear errors of a joint: gain and drift of its encoder, the other joint's angle, a cable's torque, a compliance that
depends on the torque, hysteresis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scara_kinetostatic.effects.base import JointEffect
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import ForceDependence, Parameter, TouchState


@dataclass(frozen=True)
class EncoderGain(JointEffect):
    """The encoder reports q where the actuator is at (1 + gain) q: δ = -gain q.

    A torque on the joint that grows with its angle looks the same: a `CablePull` of a slope alone.
    """

    name = 'encoder_gain'
    parameters = (Parameter('gain', '1', 1e-2, 'true angle over reported, less 1', typical=1e-3),)
    statement = 'the encoder of {target} has a gain error'
    confounded_with = 'the offset of the joint, if its angle hardly varies; a torque that grows with it'
    identified_by = 'touches over the whole range of the joint, in both elbow postures'
    plot_variable = 'angle'
    force_dependence = ForceDependence.NONE

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (-at.joints[:, self.joint],)


@dataclass(frozen=True)
class JointCoupling(JointEffect):
    """The other joint turns this one, as a belt drive through it does: the actuator is at q_i + coupling q_j, so that
    δ_i = -coupling q_j.

    A ratio of the drives that the controller takes to be 0, or slightly wrong, leaks so. Its constant is the offset
    theta_i. Of joint 1 it turns the arm about the base by an angle that grows as the elbow bends. In one elbow posture
    that is a function of the reach alone, and l1, l2, theta1 and theta2 take up its constant and slope; in both it has
    opposite signs.
    """

    name = 'joint_coupling'
    parameters = (Parameter('coupling', '1', 1e-2, 'true angle of the joint per angle of the other', typical=1e-4),)
    statement = 'the angle of the other joint leaks into {target}'
    confounded_with = 'base, offsets and link lengths, if there is one elbow posture or the other joint hardly turns'
    identified_by = 'touches over the whole range of the other joint, in both elbow postures'
    plot_variable = 'other_angle'
    force_dependence = ForceDependence.NONE

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (-at.joints[:, 1 - self.joint],)


@dataclass(frozen=True)
class CablePull(JointEffect):
    """A cable or hose across the joint turns it by a torque τ that depends smoothly on its angle.

    The actuator holds only what the cable leaves, c - τ, so that q - q* = p (c - τ) + …, and

        δ = -p τ(q) = -(slope q + bend q² + twist q³).

    The touches show p τ, whatever p is: the torque is that over p. A constant τ turns the joint by an angle that is
    always the same: another offset theta, exactly. The slope alone is an `EncoderGain`, exactly, and is named so. A
    torque of k sin q, as of a weight, is a transmission error of one cycle per turn. That the flank of the backlash
    might change is left out.
    """

    name = 'cable_pull'
    parameters = (
        Parameter('slope', '1', 1e-3, 'compliance times torque, per angle', typical=4e-5),
        Parameter('bend', '1/rad', 1e-3, 'the same per square of the angle', typical=-6e-5),
        Parameter('twist', '1/rad^2', 1e-3, 'the same per cube of the angle', typical=3e-5),
    )
    statement = 'a cable pulls at {target}'
    confounded_with = (
        'encoder_gain of the joint, by its slope, and the offset, by a constant torque, **always**; '
        'transmission_error of one or two cycles per turn, if the joint hardly turns'
    )
    identified_by = 'touches over the whole range of the joint, in both elbow postures; or without the cable'
    plot_variable = 'angle'
    force_dependence = ForceDependence.NONE

    @property
    def special_cases(self) -> tuple[str, ...]:  # type: ignore[override]
        """A slope alone."""
        return (EncoderGain.of(self.joint).label,)

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        angle = at.joints[:, self.joint]
        return -angle, -(angle**2), -(angle**3)


@dataclass(frozen=True)
class JointHardening(JointEffect):
    """Beside p c the joint deflects by δ = -rate c³: it hardens for a positive rate, softens for a negative one.

    With rate > 0 the law turns round at c = √(p / 3 rate); it holds for torques below that. Up to there its trace stays
    small: the reduced chi-square rises by 0.03 to 0.06, by 0.4 at most. So simulations take a negative rate. The
    cube is the first term that a smooth spring has beside p c.
    """

    name = 'joint_hardening'
    statement = 'the compliance of {target} depends on the torque'
    confounded_with = 'compliance and backlash of the joint, if its torques are alike in size'
    identified_by = 'touches with torques on the joint from small to large, in three or more steps'
    plot_variable = 'torque'

    parameters = (
        Parameter(
            'rate', 'rad/(Nm)^3', 1e-6, 'by which the deflection falls short of p c, over c^3', typical=1e-9, sign=-1
        ),
    )

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (-(at.torques[:, self.joint] ** 3),)


@dataclass(frozen=True)
class JointHysteresis(JointEffect):
    """Coulomb friction in the transmission: the link lags the actuator by δ = width · direction of approach.

    The friction torque τ acts on the spring beside the load, so that width = p τ.
    """

    name = 'joint_hysteresis'
    parameters = (Parameter('width', 'rad', 1e-3, 'lag of the link, half the width of the loop', typical=1e-4, sign=1),)
    statement = '{target} has hysteresis beyond its backlash'
    confounded_with = 'the backlash of the joint, if it always moves on in the direction of its torque'
    identified_by = 'touches reached from both sides: preload every other touch'
    plot_variable = 'approach'
    force_dependence = ForceDependence.NONE

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (np.sign(at.metadata.approach[:, self.joint]),)


@dataclass(frozen=True)
class ZeroDrift(JointEffect):
    """The zero of a joint drifts with time t since the start of the recording: δ = -rate t.

    The true angle is q + rate t: it is as if the offset theta of the joint grew.
    """

    name = 'thermal_drift'
    parameters = (Parameter('rate', 'rad/s', 1e-5, 'growth of the true angle', typical=1e-6),)
    statement = 'the zero of {target} drifts with time'
    confounded_with = 'places, postures or forces that change in the same order as time goes on'
    identified_by = 'the same touches again later, after a warm-up and after a rest'
    plot_variable = 'time'
    force_dependence = ForceDependence.NONE

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (-at.metadata.time,)

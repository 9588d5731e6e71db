"""Linear errors of a joint: gain and drift of its encoder, a compliance that depends on the torque, hysteresis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scara_kinetostatic.effects.base import JointEffect
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import ForceDependence, Parameter, TouchState


@dataclass(frozen=True)
class EncoderGain(JointEffect):
    """The encoder reports q where the actuator is at (1 + gain) q: δ = -gain q.

    A torque on the joint that grows with its angle, as a cable or a spring makes it, looks the same.
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
class JointHardening(JointEffect):
    """Beside p c the joint deflects by δ = -rate c³: it hardens for a positive rate, softens for a negative one.

    With rate > 0 the law turns round at c = √(p / 3 rate); it holds for torques below that. Up to there its trace stays
    small: the reduced chi-square rises by 0.03 to 0.06, by 0.4 at most. So simulations take a negative rate.

    Attributes:
        power: of the torque, odd as a function; 3 is the first term that a smooth spring has beside p c.
    """

    power: float = 3

    name = 'joint_hardening'
    statement = 'the compliance of {target} depends on the torque'
    confounded_with = 'compliance and backlash of the joint, if its torques are alike in size'
    identified_by = 'touches with torques on the joint from small to large, in three or more steps'
    plot_variable = 'torque'

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """The rate; its plausible size is that of a milliradian at 10 Nm."""
        meaning = f'by which the deflection falls short of p c, over c^{self.power:g}'
        unit, size = f'rad/(Nm)^{self.power:g}', 10**self.power
        return (Parameter('rate', unit, 1e-3 / size, meaning, typical=1e-6 / size, sign=-1),)

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        torque = at.torques[:, self.joint]
        return (-np.sign(torque) * np.abs(torque) ** self.power,)

    def alternative_laws(self) -> tuple[JointHardening, ...]:
        # springs that are soft about zero, whose stiffness changes evenly, and that stiffen late
        return tuple(replace(self, power=power) for power in (0.5, 2, 5))


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

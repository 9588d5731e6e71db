"""Drift with time: links that grow as they warm up, joints whose zero drifts."""

from __future__ import annotations

from dataclasses import dataclass

from scara_kinetostatic.effects.base import JointEffect, LinearEffect, Parameter
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import ForceDependence, Shift, TouchState


@dataclass(frozen=True)
class LinkGrowth(LinearEffect):
    """Both links grow with time t since the start of the recording: d = rate t (l1 u + l2 v).

    u and v are the directions of the links; l1 and l2 are the lengths at the start.
    """

    name = 'thermal_drift'
    parameters = (Parameter('rate', '1/s', 1e-5, 'growth of the links, per length', typical=1e-6),)
    statement = 'the links grow with time'
    short_statement = 'links grow with time'
    confounded_with = 'places, postures or forces that change in the same order as time goes on'
    identified_by = 'the same touches again later, after a warm-up and after a rest'
    plot_variable = 'time'
    order = 18
    force_dependence = ForceDependence.NONE

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        reach = at.parameters.l1 * at.link1 + at.parameters.l2 * at.link2
        return (Shift(place=at.metadata.time[:, None] * reach),)


@dataclass(frozen=True)
class ZeroDrift(JointEffect):
    """The zero of a joint drifts with time t since the start of the recording: δ = -rate t.

    The true angle is q + rate t: it is as if the offset theta of the joint grew.
    """

    name = 'thermal_drift'
    parameters = (Parameter('rate', 'rad/s', 1e-5, 'growth of the true angle', typical=1e-6),)
    statement = 'the zero of {target} drifts with time'
    short_statement = 'zero of {target} drifts'
    confounded_with = 'places, postures or forces that change in the same order as time goes on'
    identified_by = 'the same touches again later, after a warm-up and after a rest'
    plot_variable = 'time'
    order = 19
    force_dependence = ForceDependence.NONE

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (-at.metadata.time,)

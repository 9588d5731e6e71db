"""A gripper whose compliance or backlash depends on the direction of the force."""

from __future__ import annotations

from dataclasses import dataclass

from scara_kinetostatic.effects.base import LinearEffect, Parameter
from scara_kinetostatic.model.effect_law import ForceDependence, Shift, TouchState
from scara_kinetostatic.model.kinematics import quarter_turn


@dataclass(frozen=True)
class AnisotropicGripper(LinearEffect):
    """The compliance of the gripper couples along and across link 2: d = -coupling (F·v w + F·w v), w = R90 v.

    v is the direction of link 2, the coupling is p12 = p21 of P in its frame. That P differs along and across,
    p11 - p22, cannot be identified: it is another p_ee and p2. So is all of P where the arm has
    one link angle only. The lever arms' change, of second order, is left out.
    """

    name = 'anisotropic_gripper'
    parameters = (
        Parameter(
            'coupling', 'm/N', 1e-5, 'p12 in the frame of link 2: yield across it per force along it', typical=1e-6
        ),
    )
    statement = 'the gripper also yields across the force'
    short_statement = 'gripper yields across the force'
    confounded_with = (
        'p_ee, p1 and p2, if the forces come from few directions relative to link 2; '
        'the difference p11 - p22 is always part of p_ee and p2'
    )
    identified_by = 'forces from all directions relative to link 2, in both elbow postures'
    plot_variable = 'direction_from_link2'
    order = 10

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        along = at.link2
        across = quarter_turn(along)
        f_along, f_across = ((at.force * axis).sum(axis=1)[:, None] for axis in (along, across))
        return (Shift(place=-(f_along * across + f_across * along)),)


@dataclass(frozen=True)
class AnisotropicBacklash(LinearEffect):
    """The gripper has more backlash in one direction than in another: d = -(a cos 2χ + b sin 2χ) n.

    χ is the angle of the force from link 2. That the tip slides aside in a gap that is not round only turns the
    force by some milliradians; it is left out.
    """

    name = 'anisotropic_backlash'
    parameters = (
        Parameter('a', 'm', 1e-3, 'backlash along link 2 beyond the mean; as much less across it', typical=4e-5),
        Parameter('b', 'm', 1e-3, 'backlash at 45° to link 2 beyond the mean', typical=-3e-5),
    )
    statement = 'the backlash of the gripper depends on the direction of the force'
    short_statement = 'backlash of the gripper depends on the direction'
    confounded_with = (
        'an anisotropic compliance of the gripper, and g_ee and g2, if there is one force level or few directions'
    )
    identified_by = 'forces from all directions relative to link 2, at several levels, small ones too'
    plot_variable = 'direction_from_link2'
    order = 11
    force_dependence = ForceDependence.DIRECTION

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        along = (at.normal * at.link2).sum(axis=1)
        across = at.normal[:, 1] * at.link2[:, 0] - at.normal[:, 0] * at.link2[:, 1]
        waves = along**2 - across**2, 2 * along * across
        return tuple(Shift(place=-wave[:, None] * at.normal) for wave in waves)

"""Arm, base, gripper and tip: links that bend or grow, a base that yields or is tilted, an anisotropic gripper, a tip
that is not round.

**A tip that is not round** has lobes over the direction of contact, seen from link 2, which carries the tip.
With χ the angle from link 2 to n, the outward normal of the tip where it touches, let the tip have the support function

    h(χ) = ρ + s(χ),   s = a cos kχ + b sin kχ,

ρ its mean radius, which a disc's radius r contains. The point of a convex outline under the normal n is h n + h' t from
its centre, t = R90 n. Put in place of ρ n it gives

    H(Q*) + (r + γ) n - S_c + d = 0,   d = s n + s' t.

The outline is convex while (k² - 1) √(a² + b²) < ρ.

Of order k = 1 this is d = a v + b w, v along and w across link 2: the tip elsewhere on link 2, another l2 and theta2,
exactly. Of order k = 2, an oval, the part s n is that of `AnisotropicBacklash` with the other sign. The part s' t
turns the force by s'/r only, 0.4 mrad for 20 µm on a disc of 0.1 m, below the noise of a hundred touches; so an oval
tip is named as that backlash, unless very small discs show the difference. Both predict the same.

Where the tip presses, H̄ is the centre of the round tip that would touch there; without a force that is the centre of
this one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import Effect, LinearEffect, at_joint
from scara_kinetostatic.effects.variables import VARIABLES
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import ForceDependence, Parameter, Shift, TouchState
from scara_kinetostatic.model.kinematics import quarter_turn


class AnisotropicGripper(LinearEffect):
    """The compliance of the gripper differs with the direction: d = -[[excess, coupling], [coupling, -excess]] F.

    That is in the frame of link 2, beside p_ee.
    To first order the excess along link 2 is another p_ee, and across it another p2 (-2 excess / l2²): no touch tells
    it, it has the size of the coupling by its prior alone. So is all of it where the arm has one link angle only. The
    lever arms' change, of second order, is left out.
    """

    name = 'anisotropic_gripper'
    parameters = (
        Parameter('coupling', 'm/N', 1e-5, 'p12: yield across link 2 per force along it', typical=1e-6),
        Parameter(
            'excess',
            'm/N',
            1e-5,
            'yield along link 2 beyond the mean, a part of p_ee and p2',
            typical=0.0,
            is_alias=True,
        ),
    )
    statement = 'the gripper also yields across the force'
    confounded_with = (
        'p_ee, p1 and p2, if the forces come from few directions relative to link 2; '
        'the excess along link 2 with p_ee and p2, always'
    )
    identified_by = 'forces from all directions relative to link 2, in both elbow postures'
    plot_variable = 'direction_from_link2'

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        along = at.link2
        across = quarter_turn(along)
        f_along, f_across = ((at.force * axis).sum(axis=1)[:, None] for axis in (along, across))
        parts = f_along * across + f_across * along, f_along * along - f_across * across
        return tuple(Shift(place=at.across_edges(-part)) for part in parts)


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
    statement = 'the backlash of the gripper depends on the direction of the force, or the tip is oval'
    confounded_with = (
        'an anisotropic compliance of the gripper, and g_ee and g2, if there is one force level or few directions'
    )
    identified_by = 'forces from all directions relative to link 2, at several levels, small ones too'
    plot_variable = 'direction_from_link2'
    force_dependence = ForceDependence.DIRECTION

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        along = (at.normal * at.link2).sum(axis=1)
        across = at.normal[:, 1] * at.link2[:, 0] - at.normal[:, 0] * at.link2[:, 1]
        waves = along**2 - across**2, 2 * along * across
        return tuple(Shift(place=-wave[:, None] * at.normal) for wave in waves)


@dataclass(frozen=True)
class LinkBending(LinearEffect):
    """A link is an elastic beam of bending stiffness EI, clamped at its joint; compliance k = l / EI.

    Its end is loaded across by P and by a moment M, which give it the deflection y and the slope φ:

        y / l = k (P l / 3 + M / 2),   φ = k (P l / 2 + M).

    *Link 1* ends in joint 2: M = c2, and P l1 = c1 - c2 since c1 is the moment at joint 1. Its chord turns by y / l1,
    and link 2 against the chord by φ - y / l1:

        δ1 = k (c1 / 3 + c2 / 6),   δ2 = k (c1 / 6 + c2 / 3).

    The parts c1 / 3 and c2 / 3 are another p1 and p2; only the coupling of the joints, c / 6, is independent of them.

    Where the link is no even beam, only the parts for c1 in δ1 and c2 in δ2 differ. A hinge at the part s of its
    length, an elastic flange or a soft section, gives

        δ1 = k' ((1 - s)² c1 + s (1 - s) c2),   δ2 = k' (s (1 - s) c1 + s² c2).

    *Link 2* ends in the tip: M = 0, P l2 = c2, and δ2 = k c2 / 3. That is another p2, exactly: it cannot be identified.

    Attributes:
        link: 0 or 1.
    """

    link: int = 0

    name = 'link_bending'
    parameters = (Parameter('compliance', 'rad/Nm', 1e-3, 'length over bending stiffness', typical=1e-5, sign=1),)
    statement = '{target} bends'
    confounded_with = (
        'p1 and p2, if the torques of the joints are nearly in proportion; bending of link 2 is always part of p2'
    )
    identified_by = 'touches in which the torques of the two joints differ much, also in sign'
    plot_variable = 'link1_torque'

    @classmethod
    def of(cls, link: int) -> LinkBending:
        """That of link 0 or 1."""
        return cls(target=f'link{link + 1}', link=link)

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return [cls.of(link) for link in (0, 1)]

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        c1, c2 = at.torques.T
        if self.link == 1:
            return (Shift(joints=at_joint(c2 / 3, 1)),)
        return (Shift(joints=np.array([c1 / 3 + c2 / 6, c1 / 6 + c2 / 3]).T),)


class BaseCompliance(LinearEffect):
    """The robot stands on springs: pushed by -F, its base moves by d = -C F.

    C is its compliance in the base frame:

        C = [[common + excess, coupling], [coupling, common - excess]].

    What is the same in all directions is another p_ee, exactly: no touch tells `common`, which has the size of the
    others by its prior alone. What turns the base about joint 1 is another p1.
    """

    name = 'base_compliance'
    parameters = (
        Parameter('excess', 'm/N', 1e-5, 'yield along x beyond the mean; as much less along y', typical=1e-6),
        Parameter('coupling', 'm/N', 1e-5, 'yield along y per force along x', typical=-2e-6),
        Parameter(
            'common', 'm/N', 1e-5, 'mean over all directions: no touch tells it from p_ee', typical=0.0, is_alias=True
        ),
    )
    statement = 'the base yields under the force'
    confounded_with = (
        'the compliances of gripper and joints, if the arm hardly turns; its mean over all directions with p_ee, always'
    )
    identified_by = 'forces in all directions of the base frame, with the arm turned many ways'
    plot_variable = 'direction'

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        x, y = at.force.T
        return tuple(Shift(place=at.across_edges(np.array(part).T)) for part in ((-x, y), (-y, -x), (-x, -y)))


@dataclass(frozen=True)
class BaseTilt(LinearEffect):
    """The part of gravity that lies in the plane of the arm loads the joints.

    With γ the acceleration in the plane (9.81 m/s² times the tilt), s1 the static moment along link 1 of the arm beyond
    joint 1 and s2 that along link 2 of the arm beyond joint 2 (kg m), M1 = s1 γ and M2 = s2 γ (Nm), u and v the
    directions of the links and a × b = a_x b_y - a_y b_x, gravity turns the joints by

        t1 = u × M1 + v × M2,   t2 = v × M2.

    The actuators hold only what it leaves, C - t, so q - q* = p (c - t) + …: δ_i = -p_i t_i. That the
    flank of the backlash might change as well is left out. M1 and M2 are
    taken as independent of each other, though both point downhill.

    The larger an arm, the stiffer its joints and the heavier its links: moments are plausible that turn a joint by
    1e-4 rad at its nominal compliance. An upright arm has none of this: its cell states `gravity`.

    Attributes:
        sizes: largest plausible moments of joint 1 and joint 2, Nm.
    """

    sizes: tuple[float, float] = (10.0, 10.0)

    name = 'base_tilt'
    _parameters: ClassVar = (
        Parameter('m1_x', 'Nm', 10.0, 'static moment along link 1 times gravity along x', typical=2.0),
        Parameter('m1_y', 'Nm', 10.0, 'static moment along link 1 times gravity along y', typical=-1.0),
        Parameter('m2_x', 'Nm', 10.0, 'static moment along link 2 times gravity along x', typical=0.8),
        Parameter('m2_y', 'Nm', 10.0, 'static moment along link 2 times gravity along y', typical=-0.4),
    )
    statement = 'the base is tilted or the arm stands upright, so that gravity loads the joints'
    confounded_with = (
        'a transmission error of joint 1 of one cycle per turn, which m1 alone exactly is; the base position and the '
        'offsets, if there is one elbow posture'
    )
    identified_by = 'touches all over the workspace in both elbow postures; a level shows the tilt itself'
    plot_variable = 'angle'
    force_dependence = ForceDependence.NONE
    scaled_by = ('p1', 'p2')

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        p = cell.nominal
        sizes = (1e-4 / p.p1 if p.p1 > 0 else 10.0, 1e-4 / p.p2 if p.p2 > 0 else 10.0)
        return [] if p.has_gravity else [cls(sizes=sizes)]

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """The moments, as large as the arm lets expect."""
        sizes = (self.sizes[0], self.sizes[0], self.sizes[1], self.sizes[1])
        return tuple(p._replace(scale=size) for p, size in zip(self._parameters, sizes, strict=True))

    def correction(self, values: Mapping[str, float]) -> str:
        return 'level the base; where the arm stands upright, state `gravity` in the cell description'

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        p1, p2 = -at.parameters.p1, -at.parameters.p2
        torques = [torque for x, y in (at.link1.T, at.link2.T) for torque in (-y, x)]  # link × M per unit of M_x, M_y
        slopes = np.array([[p1, 0.0], [p1, 0.0], [p1, p2], [p1, p2]])
        return tuple(Shift(joints=torque[:, None] * slope) for torque, slope in zip(torques, slopes, strict=True))


class LinkGrowth(LinearEffect):
    """Both links grow with time t since the start of the recording: d = rate t (l1 u + l2 v).

    u and v are the directions of the links; l1 and l2 are the lengths at the start.
    """

    name = 'thermal_drift'
    parameters = (Parameter('rate', '1/s', 1e-5, 'growth of the links, per length', typical=1e-6),)
    statement = 'the links grow with time'
    confounded_with = 'places, postures or forces that change in the same order as time goes on'
    identified_by = 'the same touches again later, after a warm-up and after a rest'
    plot_variable = 'time'
    force_dependence = ForceDependence.NONE

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        reach = at.parameters.l1 * at.link1 + at.parameters.l2 * at.link2
        return (Shift(place=at.across_edges(at.metadata.time[:, None] * reach)),)


@dataclass(frozen=True)
class TipShape(LinearEffect):
    """The radius of the tip has waves: d = s n + s' t, s = a cos kχ + b sin kχ, k = 2 (oval) to 5 lobes.

    χ is the angle of the force from link 2. k = 1 is another l2 and theta2. An oval tip is named `anisotropic_backlash`
    unless the discs are very small: their radial parts are the same with opposite signs, and predict the same.

    Attributes:
        lobes: k.
    """

    lobes: int = 2

    name = 'tip_shape'
    parameters = (
        Parameter('a', 'm', 1e-3, 'radius along link 2 beyond the mean', typical=4e-5),
        Parameter('b', 'm', 1e-3, 'the same at a quarter of a wave from link 2', typical=-3e-5),
    )
    statement = 'the tip is {target}, not round'
    confounded_with = (
        'l2 and theta2, of which one lobe is a part, **always**; anisotropic_backlash, if it is oval; each other, if '
        'the forces have few directions relative to link 2'
    )
    identified_by = (
        'forces from all directions relative to link 2, in both elbow postures; the same again with the tip turned in '
        'its holder shows that it is the tip'
    )
    plot_variable = 'direction_from_link2'
    force_dependence: ClassVar[ForceDependence] = ForceDependence.DIRECTION

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        shapes = ('oval', 'three-lobed', 'four-lobed', 'five-lobed')  # turned and ground pins have two to five lobes
        return [cls(target=shape, lobes=lobes) for lobes, shape in enumerate(shapes, 2)]

    @property
    def special_cases(self) -> tuple[str, ...]:  # type: ignore[override]
        """Of an oval tip the backlash with the same radial part."""
        return ('anisotropic_backlash',) if self.lobes == 2 else ()

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        angle = self.lobes * VARIABLES['direction_from_link2'].axis(at).values[:, None]
        cosine, sine, n, t = np.cos(angle), np.sin(angle), at.normal, self.lobes * at.tangent
        return tuple(Shift(place=at.across_edges(part)) for part in (cosine * n - sine * t, sine * n + cosine * t))

"""Arm, base, gripper, tip and force sensor: links that bend, a base that yields or is tilted, an anisotropic gripper, a
tip that is not round; zero offset, rotation, cross-talk and a gain that depends on the force.

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
from functools import cached_property, partial
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import (
    LENGTH,
    Effect,
    LinearEffect,
    SensorEffect,
    angle_from_link2,
    at_joint,
    moved,
)
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import ForceDependence, Parameter, Shift, TouchMetadata, TouchState
from scara_kinetostatic.model.kinematics import quarter_turn
from scara_kinetostatic.model.parameters import MICRO, MILLI

COMPLIANCE = 1e-5
"""Largest plausible error of a compliance, m/N."""
SHARE = 0.05
"""Largest plausible part of the force that the sensor reads across it, or too much."""
_alias = partial(Parameter, typical=0.0, is_alias=True)
_MOMENT = 10.0
"""Largest plausible moment by gravity of a joint without compliance, Nm."""


class AnisotropicGripper(LinearEffect):
    """The compliance of the gripper differs with the direction: d = -[[excess, coupling], [coupling, -excess]] F.

    That is in the frame of link 2, beside p_ee.
    To first order the excess along link 2 is another p_ee, and across it another p2 (-2 excess / l2²): no touch tells
    it, it has the size of the coupling by its prior alone. So is all of it where the arm has one link angle only. The
    lever arms' change, of second order, is left out.
    """

    name = 'anisotropic_gripper'
    parameters = (
        Parameter('coupling', 'm/N', COMPLIANCE, 'p12: yield across link 2 per force along it', typical=MICRO),
        _alias('excess', 'm/N', COMPLIANCE, 'yield along link 2 beyond the mean, a part of p_ee and p2'),
    )
    typical_size = 2e-7  # 8 µm at 40 N
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
        return moved(at, -(f_along * across + f_across * along), -(f_along * along - f_across * across))


class AnisotropicBacklash(LinearEffect):
    """The gripper has more backlash in one direction than in another: d = -(a cos 2χ + b sin 2χ) n.

    χ is the angle of the force from link 2. That the tip slides aside in a gap that is not round only turns the
    force by some milliradians; it is left out.
    """

    name = 'anisotropic_backlash'
    parameters = (
        Parameter('a', 'm', LENGTH, 'backlash along link 2 beyond the mean; as much less across it', typical=4e-5),
        Parameter('b', 'm', LENGTH, 'backlash at 45° to link 2 beyond the mean', typical=-3e-5),
    )
    typical_size = 3 * MICRO  # a fit of the gripper
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
    parameters = (Parameter('compliance', 'rad/Nm', MILLI, 'length over bending stiffness', typical=1e-5, sign=1),)
    typical_size = 4e-7  # a tube of aluminium
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
        first, second = at.torques.T / 3
        if self.link == 1:
            return (Shift(joints=at_joint(second, 1)),)
        return (Shift(joints=np.array([first + second / 2, first / 2 + second]).T),)


class BaseCompliance(LinearEffect):
    """The robot stands on springs: pushed by -F, its base moves by d = -C F.

    C is its compliance in the base frame:

        C = [[common + excess, coupling], [coupling, common - excess]].

    What is the same in all directions is another p_ee, exactly: no touch tells `common`, which has the size of the
    others by its prior alone. What turns the base about joint 1 is another p1.
    """

    name = 'base_compliance'
    parameters = (
        Parameter('excess', 'm/N', COMPLIANCE, 'yield along x beyond the mean; as much less along y', typical=MICRO),
        Parameter('coupling', 'm/N', COMPLIANCE, 'yield along y per force along x', typical=-2 * MICRO),
        _alias('common', 'm/N', COMPLIANCE, 'mean over all directions: no touch tells it from p_ee'),
    )
    typical_size = 1e-7  # 4 µm at 40 N: a steel frame
    statement = 'the base yields under the force'
    confounded_with = (
        'the compliances of gripper and joints, if the arm hardly turns; its mean over all directions with p_ee, always'
    )
    identified_by = 'forces in all directions of the base frame, with the arm turned many ways'
    plot_variable = 'direction'

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        x, y = at.force.T
        return moved(at, *(np.array(part).T for part in ((-x, y), (-y, -x), (-x, -y))))


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

    sizes: tuple[float, float] = (_MOMENT, _MOMENT)

    name = 'base_tilt'
    typical_size = 2e-2  # 5 kg, 0.2 m, levelled to 2 mrad
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
        first, second = (1e-4 / compliance if compliance > 0 else _MOMENT for compliance in (p.p1, p.p2))
        return [] if p.has_gravity else [cls(sizes=(first, second))]

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """The moments, as large as the arm lets expect."""
        found = list[Parameter]()
        for link, size, part in zip((1, 2), self.sizes, (1.0, 0.4), strict=True):
            for axis, typical in (('x', 2.0), ('y', -1.0)):
                meaning = f'static moment along link {link} times gravity along {axis}'
                found.append(Parameter(f'm{link}_{axis}', 'Nm', size, meaning, typical=part * typical))
        return tuple(found)

    def correction(self, values: Mapping[str, float]) -> str:
        return 'level the base; where the arm stands upright, state `gravity` in the cell description'

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        p1, p2 = -at.parameters.p1, -at.parameters.p2
        torques = [torque for x, y in (at.link1.T, at.link2.T) for torque in (-y, x)]  # link × M per unit of M_x, M_y
        slopes = np.array([[p1, 0.0], [p1, 0.0], [p1, p2], [p1, p2]])
        return tuple(Shift(joints=torque[:, None] * slope) for torque, slope in zip(torques, slopes, strict=True))


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
        AnisotropicBacklash.parameters[0]._replace(meaning='radius along link 2 beyond the mean'),
        AnisotropicBacklash.parameters[1]._replace(meaning='the same at a quarter of a wave from link 2'),
    )
    typical_size = 2 * MICRO  # a ground pin
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
        angle = self.lobes * angle_from_link2(at)[:, None]
        cosine, sine, n, t = np.cos(angle), np.sin(angle), at.normal, self.lobes * at.tangent
        return moved(at, cosine * n - sine * t, sine * n + cosine * t)


class SensorBias(SensorEffect):
    """The sensor reports F + b, b = (x, y) constant in its frame: what the tare before the touch left, e = b."""

    name = 'sensor_bias'
    parameters = (
        Parameter('x', 'N', 3.0, 'reported too much along x of the sensor', typical=1.0),
        Parameter('y', 'N', 3.0, 'reported too much along y of the sensor', typical=-0.7),
    )
    typical_size = 0.05  # drift of a strain-gauge sensor between tare and hold
    statement = 'the force sensor has a zero offset'
    confounded_with = 'the places of the discs, if each is touched from one side or with one force only'
    identified_by = 'touches from all sides of the discs, some of them with little force'
    plot_variable = 'direction'

    def sensor_error(self, force: Floats, values: Floats, metadata: TouchMetadata | None = None) -> Floats:
        return np.full(force.shape, values)


class SensorRotation(SensorEffect):
    """The sensor reports R(angle) F: e = (R(angle) - I) F."""

    name = 'sensor_rotation'
    parameters = (Parameter('angle', 'rad', SHARE, 'by which reported forces are turned', typical=SHARE),)
    typical_size = 2 * MILLI  # a flange with pins
    statement = 'the force sensor is rotated about its axis'
    confounded_with = 'contact friction, if the tip slides the same way in all touches'
    identified_by = 'touches that slide in both directions: preload every other touch'
    plot_variable = 'direction'
    declared_as = 'force_rotation'

    def sensor_error(self, force: Floats, values: Floats, metadata: TouchMetadata | None = None) -> Floats:
        c, s = np.cos(values[0]) - 1, np.sin(values[0])
        return np.array([c * force[:, 0] - s * force[:, 1], s * force[:, 0] + c * force[:, 1]]).T

    def sensor_error_derivative(
        self, force: Floats, values: Floats, metadata: TouchMetadata | None = None
    ) -> tuple[Floats, ...]:
        c, s = np.cos(values[0]), np.sin(values[0])
        return (np.array([-s * force[:, 0] - c * force[:, 1], c * force[:, 0] - s * force[:, 1]]).T,)


class SensorNonlinearity(SensorEffect):
    """The sensor reports (1 + rate · ‖F‖) F: its gain grows with the force, or falls, e = rate ‖F‖ F.

    A gain that is wrong alike at all forces scales all compliances and can never be identified.
    """

    name = 'sensor_nonlinearity'
    parameters = (
        Parameter('rate', '1/N', 3e-2, 'part of the force reported too much, per newton of it', typical=MILLI),
    )
    typical_size = 1e-4  # 0.4 % of 40 N
    statement = 'the gain of the force sensor depends on the force'
    confounded_with = (
        'the compliances, if all forces are alike; the law of the contact and the hardening of joints, if the force '
        'levels are few'
    )
    identified_by = 'touches at many force levels, from very small to large, at many places'
    plot_variable = 'magnitude'

    def sensor_error(self, force: Floats, values: Floats, metadata: TouchMetadata | None = None) -> Floats:
        return np.asarray(values[0] * (np.hypot(force[:, 0], force[:, 1])[:, None] * force))


class SensorCrossTalk(SensorEffect):
    """The sensor reports (I + A) F in its own frame, e = A F with A = [[gain/2, xy], [yx, -gain/2]].

    That is every 2×2 matrix but for a gain common to both axes, which is an exact alias: all compliances are smaller
    by it. A rotation by a small angle r is xy = -r, yx = r; where only that is there, it is called `sensor_rotation`.
    """

    name = 'sensor_cross_talk'
    parameters = (
        Parameter('gain', '1', SHARE, 'gain of x less that of y', typical=0.02),
        Parameter('xy', '1', SHARE, 'part of the force along y that is added to x', typical=0.015),
        Parameter('yx', '1', SHARE, 'part of the force along x that is added to y', typical=-0.01),
    )
    typical_size = 2 * MILLI  # calibrated six-axis sensors: 0.2 to 1 %
    statement = 'the force sensor has cross-talk or unequal gains'
    confounded_with = (
        'all compliances, by a gain common to both axes, **always**; sensor_rotation, if the forces have few '
        'directions in the frame of the sensor'
    )
    identified_by = 'forces from all directions in the frame of the sensor, slid in both directions'
    plot_variable = 'direction'
    special_cases = ('sensor_rotation',)

    def sensor_error(self, force: Floats, values: Floats, metadata: TouchMetadata | None = None) -> Floats:
        gain, xy, yx = values
        return np.asarray(force @ np.array([[gain / 2, yx], [xy, -gain / 2]]))

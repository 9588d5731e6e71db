"""What effects do, by other means than their formulas: signs and sizes."""

from __future__ import annotations

import numpy as np
import pytest
from effects.scenes import Scene, random_scene

from scara_kinetostatic.effects.base import STICKING, Effect, slide
from scara_kinetostatic.effects.joints import CablePull, EncoderGain, JointCoupling, JointHardening, JointHysteresis
from scara_kinetostatic.effects.objects import ContactCompliance, ContactFriction, ObjectPosition, ObjectRadius
from scara_kinetostatic.effects.robot import (
    AnisotropicBacklash,
    AnisotropicGripper,
    BaseCompliance,
    BaseTilt,
    LinkBending,
    SensorBias,
    SensorRotation,
    TipShape,
)
from scara_kinetostatic.effects.shift import LinkGrowth, ZeroDrift
from scara_kinetostatic.model.contact_force import Contact, contact
from scara_kinetostatic.model.extended_model import ExtendedModel, TouchMetadata
from scara_kinetostatic.model.kinematics import jacobian, quarter_turn

SCENE = random_scene(5, 150)
FIRST = SCENE.metadata.disc == 0


def with_effect(effect: Effect, *values: float, scene: Scene = SCENE, metadata: TouchMetadata | None = None) -> Contact:
    model = ExtendedModel(scene.parameters, (effect,), (values,))
    metadata = metadata or scene.metadata
    return contact(model, scene.joints, scene.poses.centers, scene.poses.radii, metadata=metadata)


def plain(scene: Scene = SCENE, **changes) -> Contact:
    """Without effect, joints, centres, radii or L̄ changed."""
    joints, centers = changes.pop('joints', scene.joints), changes.pop('centers', scene.poses.centers)
    radii = changes.pop('radii', scene.poses.radii)
    return contact(scene.parameters.replace(**changes), joints, centers, radii)


def assert_same(one: Contact, other: Contact, tolerance: float = 1e-8) -> None:
    """Equal forces where joints rest on the same flanks, which is nearly everywhere."""
    same = (one.state.mode1 == other.state.mode1) & (one.state.mode2 == other.state.mode2)
    assert same.mean() > 0.95
    assert np.hypot(*one.force.T).max() > 10
    np.testing.assert_allclose(one.force[same], other.force[same], rtol=0, atol=tolerance)


@pytest.mark.parametrize('joint', [0, 1])
def test_errors_of_a_joint_are_those_of_its_angle(joint):
    chosen = np.arange(2) == joint
    assert_same(with_effect(EncoderGain.of(joint), 1e-4), plain(joints=SCENE.joints * (1 + 1e-4 * chosen)))
    drifted = SCENE.joints + 1e-6 * SCENE.metadata.time[:, None] * chosen
    assert_same(with_effect(ZeroDrift.of(joint), 1e-6), plain(joints=drifted))
    leaked = SCENE.joints + 1e-4 * SCENE.joints[:, ::-1] * chosen
    assert_same(with_effect(JointCoupling.of(joint), 1e-4), plain(joints=leaked))


@pytest.mark.parametrize('joint', [0, 1])
def test_a_cable_turns_the_joint_by_the_compliance_times_its_torque(joint):
    """The joint gives way to the torque: q* = q - p (c - τ)."""
    compliance = (SCENE.parameters.p1, SCENE.parameters.p2)[joint]
    angle, chosen = SCENE.joints[:, joint], np.arange(2) == joint
    torque = 3.0 * angle - 4.0 * angle**2 + 2.0 * angle**3
    turned = SCENE.joints + compliance * torque[:, None] * chosen
    values = compliance * np.array([3.0, -4.0, 2.0])
    assert_same(with_effect(CablePull.of(joint), *values), plain(joints=turned))
    assert_same(with_effect(CablePull.of(joint), 6e-5, 0.0, 0.0), with_effect(EncoderGain.of(joint), 6e-5))


@pytest.mark.parametrize('lobes', [1, 2, 3, 5])
def test_the_outline_of_a_tip_with_lobes_touches_the_disc(lobes):
    """Of all points of the outline the nearest to the disc's centre is on the disc's edge."""
    mean, a, b, at = 5e-3, 6e-5, -4e-5, SCENE.touch_state
    place = TipShape(lobes=lobes).shift(at, np.array([a, b])).place
    center = at.centers - at.radii[:, None] * at.normal - place  # of the tip
    turn = np.linspace(-np.pi, np.pi, 20_001)
    wave = (a - 1j * b) * np.exp(1j * lobes * turn)  # its derivative is k times the same, a quarter turn on
    outline = (mean + wave.real - 1j * lobes * wave.imag) * np.exp(1j * turn)
    for k in range(0, len(center), 10):
        to_tip = (center[k] - at.centers[k]) @ (1, 1j)
        distance = np.abs(to_tip + outline * (at.link2[k] @ (1, 1j))).min()
        assert distance == pytest.approx(at.radii[k] - mean, abs=1e-9)


def test_one_lobe_is_the_tip_elsewhere_on_link_2():
    """It is another l2 and theta2, which the turn of link 2 by theta2 shows by its torques in second order only."""
    l2, size = SCENE.parameters.l2, 1e-5
    assert_same(with_effect(TipShape(lobes=1), size, 0.0), plain(l2=l2 + size), 0.02)
    assert_same(with_effect(TipShape(lobes=1), 0.0, size), plain(theta2=SCENE.parameters.theta2 + size / l2), 0.02)


def test_an_oval_tip_is_a_backlash_that_differs_along_and_across_link_2():
    at, values = SCENE.touch_state, np.array([4e-5, -3e-5])
    tip, gap = TipShape(lobes=2).shift(at, values).place, AnisotropicBacklash().shift(at, -values).place
    assert np.abs((tip * at.normal).sum(axis=1)).max() > 4e-5
    np.testing.assert_allclose((tip * at.normal).sum(axis=1), (gap * at.normal).sum(axis=1), rtol=0, atol=1e-15)


@pytest.mark.parametrize('joint', [0, 1])
def test_a_joint_that_moves_on_in_the_sense_of_its_torque_has_more_backlash(joint):
    torques = SCENE.touch_state.torques
    backlash = f'g{joint + 1}'
    more = {backlash: getattr(SCENE.parameters, backlash) + 1e-4}
    found = with_effect(JointHysteresis.of(joint), 1e-4, metadata=SCENE.metadata._replace(approach=torques))
    assert_same(found, plain(**more), 0.1)


@pytest.mark.parametrize('joint', [0, 1])
def test_a_hardened_joint_presses_harder(joint):
    """Links nearer to the measured angles mean a tip deeper in the disc."""
    before = plain()
    after = with_effect(JointHardening.of(joint), 1e-9)
    felt = np.abs(before.force[:, 0]) > 5
    assert np.mean(after.magnitude[felt] > before.magnitude[felt]) > 0.98
    softened = with_effect(JointHardening.of(joint), -1e-9)
    assert np.mean(softened.magnitude[felt] < before.magnitude[felt]) > 0.98


def test_bending_of_link_2_is_another_p2():
    assert_same(with_effect(LinkBending.of(1), 3e-5), plain(p2=SCENE.parameters.p2 + 1e-5))


def test_bending_of_link_1_is_that_of_a_beam():
    """Castigliano: the joints' deflections are the gradient of ½ k ∫ M² ds, with M linear from c1 to c2."""
    values, s = np.array([2e-5]), np.linspace(0, 1, 2001)
    at = SCENE.touch_state
    shift = LinkBending.of(0).shift(at, values).joints
    moment = at.torques[:, :1] * (1 - s) + at.torques[:, 1:] * s
    slopes = [(moment[:, 1:] + moment[:, :-1]) @ (part[1:] + part[:-1]) / (4 * (len(s) - 1)) for part in (1 - s, s)]
    np.testing.assert_allclose(shift, values[0] * np.stack(slopes, axis=-1), rtol=0, atol=1e-9)


def test_a_gripper_that_yields_aside():
    """P of the gripper in the frame of link 2 has p12 = p21, so that the work is -2 p12 F_v F_w."""
    at = SCENE.touch_state
    work = (AnisotropicGripper().shift(at, np.array([2e-6, 0.0])).place * at.force).sum(axis=1)
    along, across = ((at.force * axis).sum(axis=1) for axis in (at.link2, quarter_turn(at.link2)))
    np.testing.assert_allclose(work, -4e-6 * along * across, rtol=0, atol=1e-12)
    assert np.abs(with_effect(AnisotropicGripper(), 2e-6, 0.0).force - plain().force).max() > 1


def test_a_base_on_springs_moves_away_from_the_disc():
    moved = [with_effect(BaseCompliance(), e, 0.0, 0.0) for e in (0.0, 2e-6)]
    along_x = np.abs(moved[0].force[:, 0]) > 0.98 * moved[0].magnitude
    assert along_x.sum() > 5
    assert np.all(moved[1].magnitude[along_x] < moved[0].magnitude[along_x])
    work = BaseCompliance().shift(SCENE.touch_state, np.array([1e-6, 1e-6, 3e-6])).place
    x, y = SCENE.poses.force.T
    np.testing.assert_allclose((work * SCENE.poses.force).sum(axis=1), -1e-6 * (4 * x * x + 2 * y * y + 2 * x * y))


def test_gravity_draws_the_arm_downhill():
    """The work that gravity does as the joints give way to it is positive, each touch, each part."""
    values = np.array([3.0, -1.0, 1.5, -0.5])  # downhill is along (3, -1)
    at = SCENE.touch_state
    sag = -BaseTilt().shift(at, values).joints
    turn1, turn2 = sag[:, 0], sag.sum(axis=1)  # of link 1 and of link 2 in the base frame
    across1, across2 = (np.stack([-link[:, 1], link[:, 0]], axis=-1) for link in (at.link1, at.link2))
    work = turn1 * (across1 @ values[:2]) + turn2 * (across2 @ values[2:])
    assert np.all(work > 0)


def test_a_soft_disc_lets_the_tip_in():
    found = with_effect(ContactCompliance.of(0, 'disc_1'), 1e-5)
    pressed = found.magnitude > 0
    depth = SCENE.poses.radii - np.hypot(*(found.tip - SCENE.poses.centers).T)
    expected = np.where(FIRST, 1e-5 * np.cbrt(found.magnitude) ** 2, 0.0)
    np.testing.assert_allclose(depth[pressed], expected[pressed], rtol=0, atol=1e-12)


def test_a_disc_that_is_elsewhere_or_larger():
    moved = SCENE.poses.centers + FIRST[:, None] * np.array([3e-4, -2e-4])
    assert_same(with_effect(ObjectPosition.of(0, 'disc_1'), 3e-4, -2e-4), plain(centers=moved))
    assert_same(with_effect(ObjectRadius.of(0, 'disc_1'), 2e-4), plain(radii=SCENE.poses.radii + 2e-4 * FIRST))


def test_links_that_grow():
    p, scene = SCENE.parameters, SCENE._replace(metadata=SCENE.metadata._replace(time=np.full(150, 100.0)))
    assert_same(with_effect(LinkGrowth(), 1e-6, scene=scene), plain(l1=p.l1 * 1.0001, l2=p.l2 * 1.0001), 0.02)


def test_friction_drags_the_disc_along():
    """Away from sticking, the force leans by the angle of friction to the side to which the tip moves."""
    links, rng = SCENE.joints, np.random.default_rng(0)
    sideways = np.stack([-SCENE.poses.force[:, 1], SCENE.poses.force[:, 0]], axis=-1)
    sense = rng.choice([-1, 1], len(links))
    press = np.linalg.solve(jacobian(SCENE.parameters, links), (1e-5 * sense[:, None] * sideways)[..., None])[..., 0]
    found = with_effect(ContactFriction(), 0.15, metadata=SCENE.metadata._replace(press=press))
    to_center = SCENE.poses.centers - found.tip
    cross = to_center[:, 0] * found.force[:, 1] - to_center[:, 1] * found.force[:, 0]
    off_normal = np.arctan2(cross, (to_center * found.force).sum(axis=1))[found.magnitude > 0]
    assert len(off_normal) > 100
    np.testing.assert_allclose(off_normal, 0.15 * sense[found.magnitude > 0], rtol=0, atol=1e-9)


def test_friction_with_one_disc_is_that_with_all_in_its_touches_alone():
    every, one = with_effect(ContactFriction(), 0.1), with_effect(ContactFriction.of(0, 'disc_1'), 0.1)
    np.testing.assert_allclose(one.force[FIRST], every.force[FIRST], rtol=0, atol=1e-9)
    np.testing.assert_allclose(one.force[~FIRST], plain().force[~FIRST], rtol=0, atol=1e-9)
    assert np.abs(one.force - plain().force)[FIRST].max() > 1
    assert np.abs(one.force - every.force)[~FIRST].max() > 1


def test_where_the_movement_is_unknown_friction_with_one_disc_turns_the_force_to_one_side():
    at = SCENE._replace(metadata=SCENE.metadata._replace(press=np.zeros_like(SCENE.joints))).touch_state
    one = ContactFriction.of(0, 'disc_1').shift(at, np.array([-0.1])).place
    tangent = (one * at.tangent).sum(axis=1)
    np.testing.assert_allclose(
        tangent, np.where(at.metadata.disc == 0, np.sin(0.1) * at.radii, 0.0), rtol=0, atol=1e-12
    )
    assert not ContactFriction().shift(at, np.array([-0.1])).place.any()  # of all it is a turned sensor


def test_a_tip_pressed_along_the_normal_sticks():
    links = SCENE.joints
    aside = np.stack([-SCENE.poses.force[:, 1], SCENE.poses.force[:, 0]], axis=-1)
    for part in (0.0, 0.5, -0.5):
        move = SCENE.poses.force + part * STICKING * aside
        press = np.linalg.solve(jacobian(SCENE.parameters, links), 1e-5 * move[..., None])[..., 0]
        at = SCENE._replace(metadata=SCENE.metadata._replace(press=press)).touch_state
        np.testing.assert_allclose(slide(at), part, atol=0.1)
    still = SCENE._replace(metadata=SCENE.metadata._replace(press=np.zeros_like(links)))
    assert not slide(still.touch_state).any()


def test_friction_is_plotted_over_the_slide_by_which_it_is_judged():
    at = SCENE.touch_state
    np.testing.assert_array_equal(ContactFriction().plot_axis(at, np.array([0.1])).values, slide(at))


def test_the_sensor_turns_or_shifts_what_it_reports():
    force = np.array([[10.0, 0.0], [0.0, -20.0]])
    shifted = force + SensorBias().sensor_error(force, np.array([1.0, -2.0]))
    np.testing.assert_allclose(shifted, [[11.0, -2.0], [1.0, -22.0]])
    turned = force + SensorRotation().sensor_error(force, np.array([np.pi / 2]))
    np.testing.assert_allclose(turned, [[0.0, 10.0], [20.0, 0.0]], atol=1e-12)

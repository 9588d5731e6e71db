"""Undeclared effects are found, named, estimated, and no longer bias the parameters; see also benchmark.diagnosis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis.simulated import (
    CELL,
    NOISE,
    PLAN,
    UNKNOWN_NOISE,
    check_explained,
    check_parameters,
    deviations,
    effect,
    examined,
    named,
    simulate,
)

from benchmark import lone_flaws
from benchmark.common import NO_OTHERS
from benchmark.diagnosis.unlisted import OvalDisc, Ripple, StiffGripper
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.fit_point import force_residual
from scara_kinetostatic.calibration.held_out import held_out_force_error
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.diagnosis.advice import unknown_history
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.effects.objects import OffNormalForce
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.extended_model import ExtendedModel, TouchMetadata
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

SIZES = {
    'sensor_bias': (0.6, -0.4),
    'transmission_error[joint2]': (8e-5, 2.0, 2.7),
    'joint_hysteresis[joint1]': (4e-5,),
    'base_tilt': (6.0, -6.0, 4.0, 3.0),
    'contact_compliance[disc_2]': (3e-6,),
}


@pytest.mark.parametrize('label', SIZES)
def test_an_effect_is_named_and_estimated_and_its_bias_removed(label):
    before, found = examined(label, SIZES[label])
    check_explained(found, label, SIZES[label])
    assert found.p_value < 1e-6 < 0.01 < found.remaining_p_value
    assert found.extended.reduced_chi_square < before.reduced_chi_square
    assert found.extended.noise_source == 'given'
    assert 'too large' not in found.advice


def test_a_soft_contact_and_a_nonlinear_sensor_are_rivals():
    label, value = 'contact_compliance', 6e-5
    before, found = examined(label, (value,), given=False)
    assert found.verdict == 'ambiguous'
    (group,) = found.rivals
    assert {'contact_compliance', 'sensor_nonlinearity'} <= set(group)
    assert set(group) <= {'contact_compliance', 'sensor_nonlinearity', 'unnamed[along over force]'}
    (item,) = [item for item in found.found if item.effect.label == label]
    assert abs(item.values[0].value - value) < 4 * item.values[0].std
    assert np.abs(deviations(before)).max() > 20
    check_parameters(found)


def test_a_large_effect_is_no_unnamed_curve_and_no_noise():
    """A reduced chi-square of hundreds; the linear problem is far off."""
    before, found = examined('sensor_nonlinearity', (-8.8e-3,), seed=3)
    assert (found.verdict, named(found)) == ('explained', ['sensor_nonlinearity'])
    assert np.abs(deviations(before)).max() > 4
    check_parameters(found)
    assert found.extended.noise.joint < 2e-5


def test_an_effect_is_named_with_unknown_noise():
    before, found = examined('link_bending[link1]', (8e-5,), given=False)
    assert (found.verdict, named(found)) == ('explained', ['link_bending[link1]'])
    check_parameters(found)
    assert found.extended.noise.joint < 0.8 * before.noise.joint  # what passed for noise was the effect


def test_two_effects_are_both_named():
    both = simulate((effect('encoder_gain[joint1]'), (6e-5,)), (effect('object_radius[disc_2]'), (3e-5,)))
    found = diagnose(calibrate(both, CELL))
    assert set(named(found)) == {'encoder_gain[joint1]', 'object_radius[disc_2]'}
    check_parameters(found)


def test_an_alias_has_the_name_of_the_simpler_effect_and_the_parameters_are_right():
    check_explained(examined('cable_pull[joint2]', (8e-5, 0.0, 0.0))[1], 'encoder_gain[joint2]', (8e-5,))


def test_an_oval_tip_on_pins_is_told_from_a_backlash():
    """On discs of 5 mm the oval turns the force by 2 d / r."""
    pins = replace(CELL, discs=tuple(disc._replace(radius=0.005) for disc in CELL.discs))
    law, values = effect('tip_shape[oval]'), (6e-5, -4e-5)
    plan = default_plan(pins, per_disc=18, preload=0.3)
    touches = simulate_touches(pins, ExtendedModel(PAPER_ACTUAL, (law,), (values,)), plan, NOISE, 1)
    check_explained(diagnose(calibrate(touches, pins)), law.label, values)


def test_friction_with_the_only_disc_touched_has_the_name_of_the_disc_or_of_all():
    touches = simulate((effect('contact_friction[disc_2]'), (0.03,)))
    found = diagnose(calibrate(touches.select(touches.disc == 1), CELL))
    assert {item.effect.name for item in found.found} == {'contact_friction'}
    assert all(abs(item.values[0].value - 0.03) < 4 * item.values[0].std for item in found.found)


@pytest.mark.parametrize('coefficient', [-0.04, 0.04])
def test_friction_with_one_disc_is_named_where_the_movement_of_the_tip_is_unknown(coefficient):
    """As in a table without columns for it: the sign is that by which the touches are turned."""
    law, still = effect('contact_friction[disc_1]'), np.zeros((len(PLAN), 2))
    exact = simulate_touches(CELL, PAPER_ACTUAL, PLAN, Noise(0.0, 0.0)).replace(approach=still, press=still)
    turned = exact.force - force_residual(observe(exact, CELL), ExtendedModel(PAPER_ACTUAL, (law,), ((coefficient,),)))
    random = np.random.default_rng(3)
    joints, force = (random.normal(size, std) for size, std in ((exact.joints, 1e-5), (turned, 0.3)))
    found = diagnose(calibrate(exact.replace(joints=joints, force=force), CELL))
    check_explained(found, law.label, (coefficient,))
    assert 'do not say how the tip slid' in unknown_history(exact, found)


def test_discs_that_only_change_their_distance_are_rivals():
    """A disc moved away from another is, to first order, the other one moved and the base with it."""
    _, found = examined('object_position[disc_3]', (4e-5, -3e-5))
    assert found.verdict == 'ambiguous'
    assert any({'object_position[disc_3]', 'object_position[disc_1]'} <= set(group) for group in found.rivals)
    assert not any(item.in_every_model for item in found.found)
    check_parameters(found)


def test_exact_aliases_are_no_alarm():
    """A gripper stiffer along link 2 than across it is another p_ee and p2."""
    found = diagnose(calibrate(simulate((StiffGripper(), (3e-6,))), CELL))
    assert found.verdict == 'none'
    assert found.extended is None


def test_a_bending_link_2_is_never_accepted():
    before, found = examined('link_bending[link2]', (1e-5,))
    assert found.verdict == 'none'
    assert before.reduced_chi_square < 1.3
    assert [item.role for item in found.ranking if item.effect.label == 'link_bending[link2]'] == ['unidentifiable']


@pytest.mark.parametrize(
    ('law', 'values', 'where', 'given'),
    [
        (OvalDisc.of(0, 'disc_1'), (4e-5, -3e-5), 'the tip deviates along the force on disc_1', True),
        (Ripple.of(0), (1.5e-4,), 'joint 1 deviates by an angle, depending on the angle of joint 2', False),
    ],
)
def test_an_effect_outside_the_list_is_caught_described_and_corrected(law, values, where, given):
    data = simulate((law, values))
    cell = CELL if given else UNKNOWN_NOISE
    before = calibrate(data, cell)
    found = diagnose(before)
    assert found.verdict == 'unexplained'
    assert [item.effect.name for item in found.found] == ['unnamed']
    assert where in found.found[0].effect.description
    errors = [held_out_force_error(fit).force_error for fit in (before, found.extended, calibrate(data, cell, [law]))]
    assert errors[0] - errors[1] > 2 / 3 * (errors[0] - errors[2]) > 0


def test_a_user_s_own_effect_takes_part():
    law = Ripple.of(0)
    found = diagnose(calibrate(simulate((law, (1.5e-4,))), CELL), effects=(law, effect('encoder_gain[joint1]')))
    assert found.verdict == 'explained'
    assert named(found) == ['ripple[joint1]']


def test_names_that_vanish_in_the_mixed_model_are_none() -> None:
    """Displaced discs of wrong radius explained the linear problem, and nothing once all effects were in the fit."""
    found = lone_flaws.run_task(lone_flaws.Task('base_compliance', 10.0, 301))
    assert (found['verdict'], found['names']) == ('explained', ['base_compliance'])
    assert found['z'] < 3


DISC, WAVE = (effect('object_position[disc_2]'), (2e-4, 1e-4)), (effect('transmission_error[joint2]'), (2e-4, 2.0, 7.3))


def test_a_displaced_disc_friction_of_either_sense_and_a_wave_are_all_named():
    """The other two hide the friction in the base model; it shows in the fit with them."""
    touches, random = simulate(DISC, WAVE, seed=0), np.random.default_rng(0)
    robot = ExtendedModel(PAPER_ACTUAL, (DISC[0], WAVE[0], OffNormalForce()), (DISC[1], WAVE[1], ()))
    turned = contact(
        robot,
        touches.joints,
        CELL.centers[touches.disc],
        CELL.radii[touches.disc],
        CELL.gripper_sign,
        warm_start=touches.force,
        metadata=TouchMetadata.of(touches),
        off_normal=0.04 * random.standard_normal(len(touches)),
    )
    noisy = touches.replace(force=turned.force + NOISE.force_rms * random.standard_normal(touches.force.shape))
    found = diagnose(calibrate(noisy.select(turned.solved), CELL))
    assert found.verdict == 'explained'
    assert set(named(found)) == {'contact_friction', DISC[0].label, WAVE[0].label}
    check_parameters(found)


def test_a_large_effect_that_is_not_linear_is_begun_nearer():
    """A sensor whose gain falls by a third over the forces: the linear problem leads to where there is no contact."""
    exact = replace(CELL, uncertainty=NO_OTHERS)
    found = diagnose(calibrate(simulate((effect('sensor_nonlinearity'), (-5e-3,)), seed=1), exact))
    assert 'sensor_nonlinearity' in named(found)
    check_parameters(found)

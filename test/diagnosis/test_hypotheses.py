"""Bad touches, off-normal forces and effects are distinguished."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis.simulated import CELL, NOISE, UNKNOWN_NOISE, check_parameters, effect, named, simulate

from benchmark.diagnosis.cells import SETUPS
from benchmark.diagnosis.unlisted import UnevenCompliance
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.result import held_out_force_error
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.diagnosis.lack_of_fit import growing_p_value, off_normal_p_value
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.simulation.streams import simulate_touches


def off_normal_fit(off_normal_std: float, seed: int = 3):
    """Touches with off-normal angles of either sense and any size, as by static friction.

    The force is turned and the joints stay: to first order the tip of a touch does not feel it.
    """
    data = simulate(seed=seed)
    turned = rotate(data.force, off_normal_std * np.random.default_rng(seed).standard_normal(len(data)))
    return data.replace(force=turned)


@pytest.mark.parametrize('cell', [CELL, UNKNOWN_NOISE], ids=['noise known', 'noise unknown'])
def test_bad_touches_are_no_effect(cell):
    data = simulate(seed=2)
    random = np.random.default_rng(5)
    bad = random.permutation(len(data))[:10]
    force = data.force.copy()
    force[bad] += random.choice([-1, 1], (10, 2)) * random.uniform(8, 20, (10, 2))
    fit = calibrate(data.replace(force=force), cell)
    found = diagnose(fit)
    assert set(np.flatnonzero(~fit.used)) == set(bad)
    assert found.verdict == 'none'


def test_an_effect_that_made_few_touches_look_bad_is_found():
    """A disc that was touched eight times only, and stands elsewhere: the base model rejects its touches."""
    data = simulate((effect('object_position[disc_2]'), (3e-4, -2e-4)), seed=4)
    few = np.flatnonzero(data.disc == 1)[::5]
    kept = np.sort(np.concatenate([np.flatnonzero(data.disc != 1), few]))
    fit = calibrate(data.select(kept), CELL)
    assert (~fit.used).sum() >= 4
    found = diagnose(fit)
    assert [item.effect.label for item in found.found if item.in_every_model] == ['object_position[disc_2]']
    assert found.extended is not None
    assert found.extended.used.all()


def test_off_normal_angles_of_either_sense_are_friction():
    fit = calibrate(off_normal_fit(0.08), UNKNOWN_NOISE)
    assert off_normal_p_value(fit) < 1e-6
    found = diagnose(fit)
    assert (found.verdict, named(found)) == ('explained', ['contact_friction'])
    (angle,) = found.found[0].values
    assert angle.name == 'off_normal_angle'
    assert abs(angle.value - 0.08) < 4 * angle.std
    check_parameters(found)
    assert found.extended.noise.force == pytest.approx(NOISE.force, rel=0.6)


def test_the_score_test_of_off_normal_angles_is_calibrated():
    values = []
    for seed in range(20):
        fit = calibrate(simulate(seed=100 + seed), CELL if seed % 2 else UNKNOWN_NOISE)
        values.append(off_normal_p_value(fit))
    assert min(values) > 1e-4
    assert 0.25 < np.mean(np.array(values) < 0.5) < 0.75


def test_noise_that_grows_with_the_force_is_no_friction():
    data = simulate(seed=7)
    size = np.hypot(*data.force.T)[:, None]
    noisy = data.replace(force=data.force + 0.04 * size * np.random.default_rng(7).standard_normal((len(data), 2)))
    fit = calibrate(noisy, UNKNOWN_NOISE)
    assert growing_p_value(fit) < 1e-3 < off_normal_p_value(fit, beside_growing=True)
    found = diagnose(fit)
    assert not any(item.in_every_model and item.effect.name == 'contact_friction' for item in found.found)
    assert found.verdict == 'none'
    assert found.refitted is not None
    assert 0.03 < found.refitted.noise.growth < 0.05
    assert 'grows with the force' in found.advice


def test_what_is_found_predicts_the_forces():
    """The force has jumps over joint 1, which no effect has; a steep curve over the force follows them."""
    data = simulate(seed=3)
    data = data.replace(force=data.force * (1 + 0.03 * np.sign(np.sin(7 * data.joints[:, :1]))))
    calibration = calibrate(data, CELL)
    found = diagnose(calibration)
    assert found.verdict == 'unexplained'
    assert found.extended is None or found.extended.force_error < 1.1 * calibration.force_error


def test_a_curve_predicts_touches_that_it_was_not_fitted_to():
    """The compliance of a joint depends on its angle; a curve over the force passes through these touches alone."""
    setup, law, seed, rate = SETUPS['soft'], UnevenCompliance.of(1), 1694143591, -1.2136e-5
    robot = ExtendedModel(setup.truth, (law,), ((rate,),))
    calibration = calibrate(simulate_touches(setup.cell, robot, setup.plan, NOISE, seed), setup.cell)
    found = diagnose(calibration)
    assert found.verdict == 'unexplained'
    final = found.extended or found.refitted or calibration
    before = held_out_force_error(replace(calibration, used=final.used)).force_error
    assert held_out_force_error(final).force_error < 1.05 * before

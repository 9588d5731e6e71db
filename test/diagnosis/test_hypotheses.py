"""Bad touches, off-normal forces, noise that grows with the force and effects are distinguished."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import conclude_outcome
from diagnosis.simulated import CELL, MORE, NOISE, UNKNOWN_NOISE, check_parameters, deviations, effect, named, simulate

from benchmark.diagnosis.cells import SETUPS
from benchmark.diagnosis.unlisted import UnevenCompliance
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.fit_point import select
from scara_kinetostatic.calibration.held_out import held_out_force_error
from scara_kinetostatic.calibration.noise import off_normal_uncertainty
from scara_kinetostatic.diagnosis.advice import many_small
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.diagnosis.lack_of_fit import growing_p_value, off_normal_p_value
from scara_kinetostatic.diagnosis.result import Found, Value
from scara_kinetostatic.effects.objects import OffNormalForce
from scara_kinetostatic.files.cell_file import dump_cell, parse_cell
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.streams import simulate_touches


def off_normal_fit(off_normal_std: float, seed: int = 3):
    """Touches with off-normal angles of either sense and any size, as by static friction.

    The force is turned and the joints stay: to first order the tip of a touch does not feel it.
    """
    data = simulate(seed=seed)
    turned = rotate(data.force, off_normal_std * np.random.default_rng(seed).standard_normal(len(data)))
    return data.replace(force=turned)


def test_bad_touches_are_no_effect():
    data = simulate(seed=2)
    random = np.random.default_rng(5)
    bad = random.permutation(len(data))[:10]
    force = data.force.copy()
    force[bad] += random.choice([-1, 1], (10, 2)) * random.uniform(8, 20, (10, 2))
    fit = calibrate(data.replace(force=force), UNKNOWN_NOISE)
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
    outcome = conclude_outcome(off_normal_fit(0.08), UNKNOWN_NOISE)
    found = outcome.diagnosis
    assert off_normal_p_value(outcome.calibration) < 1e-6
    assert (found.verdict, named(found)) == ('explained', ['contact_friction'])
    (angle,) = found.found[0].values
    assert angle.name == 'off_normal_angle'
    assert abs(angle.value - 0.08) < 4 * angle.std
    check_parameters(found)
    assert found.extended.noise.force == pytest.approx(NOISE.force, rel=0.6)
    (shown,) = outcome.effect_residuals
    assert shown.y_label == 'off-normal angle of the force  [mrad]'
    np.testing.assert_array_equal(shown.before, shown.after)  # it is not corrected
    assert np.std(shown.before / 1e3) == pytest.approx(0.08, rel=0.2)
    assert np.sqrt(np.mean((shown.before / shown.std_before) ** 2)) > 3
    assert np.sqrt(np.mean((shown.after / shown.std_after) ** 2)) == pytest.approx(1, abs=0.25)


@pytest.mark.parametrize('cell', [CELL, UNKNOWN_NOISE])
def test_the_size_of_off_normal_angles_does_not_depend_on_where_it_begins(cell):
    data = off_normal_fit(0.08)
    sizes = [calibrate(data, cell, [OffNormalForce(begin)]).model.off_normal_std for begin in (0.01, 0.3)]
    assert sizes[0] == pytest.approx(sizes[1], rel=5e-3)
    assert sizes[0] == pytest.approx(0.08, rel=0.2)


def test_the_size_of_off_normal_angles_scatters_as_stated_where_noise_turns_the_force_as_well():
    sizes, stds = [], []
    for seed in range(20):
        fit = calibrate(off_normal_fit(0.02, seed), CELL, [OffNormalForce()])
        sizes.append(fit.model.off_normal_std)
        stds.append(off_normal_uncertainty(select(fit.projection, fit.used)))
    assert np.mean(sizes) == pytest.approx(0.02, rel=0.1)
    assert np.std(sizes) == pytest.approx(np.mean(stds), rel=0.4)  # 20 sizes: 0.16
    assert np.mean(stds) > 1.3 * 0.02 / np.sqrt(2 * len(fit.touches))


def test_the_score_test_of_off_normal_angles_is_calibrated():
    values = []
    for seed in range(12):
        fit = calibrate(simulate(seed=100 + seed), CELL if seed % 2 else UNKNOWN_NOISE)
        values.append(off_normal_p_value(fit))
    assert min(values) > 1e-4
    assert 0.25 < np.mean(np.array(values) < 0.5) < 0.75


def test_noise_that_grows_with_the_force_is_no_friction():
    data = simulate(seed=7, plan=MORE)
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
    assert f'noise: {{joint: {found.refitted.noise.joint:.1e}, ' in found.advice
    assert f'force_relative: {found.refitted.noise.growth:.2g}}}' in found.advice


def test_suspects_are_listed_from_two_standard_deviations_on():
    gain = effect('encoder_gain[joint1]')
    items = [
        Found(gain, (Value('gain', size, 1e-4, '1', 'too much'),), in_every_model=False, is_possible=True)
        for size in (-1.7e-4, -2.1e-4)
    ]
    assert 'suspected' not in many_small(0.01, items[:1])
    text = many_small(0.01, items)
    assert '−210 ppm' in text
    assert '170' not in text


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


GROWING = Noise(1e-5, 0.3, 0.015)
BY_AXIS = Noise((0.4e-5, 1.36e-5), (0.41, 0.103))
"""Levels four times apart, root mean square those of `NOISE`."""


def with_noise(noise, seed, *effects):
    laws, values = tuple(law for law, _ in effects), tuple(part for _, part in effects)
    return simulate_touches(CELL, ExtendedModel(PAPER_ACTUAL, laws, values), MORE, noise, seed)


def test_noise_that_grows_is_found_beside_stated_levels_and_said():
    fit = calibrate(with_noise(GROWING, 3), CELL)
    found = diagnose(fit)
    assert found.verdict == 'none'
    final = found.refitted
    assert final is not None
    assert final.noise[:2] == NOISE[:2]
    assert final.noise.growth == pytest.approx(0.015, rel=0.3)
    assert (fit.noise_source, final.noise_source) == ('given', 'estimated')
    assert np.abs(deviations(final)).max() < 4
    line = re.search(r'noise: \{.*?\}', found.advice)
    assert line is not None
    stated = parse_cell(dump_cell(replace(CELL, noise=None)) + line[0]).noise
    np.testing.assert_allclose(stated.levels, final.noise.levels, rtol=0.06)


def test_plain_noise_stays_plain():
    fit = calibrate(simulate(seed=21), UNKNOWN_NOISE)
    found = diagnose(fit)
    assert found.verdict == 'none'
    assert found.refitted.noise.levels == pytest.approx(fit.noise.levels, rel=0.15)
    assert fit.noise.is_plain


def test_what_is_stated_is_kept():
    stated = BY_AXIS._replace(force_relative=0.0)
    found = diagnose(calibrate(with_noise(BY_AXIS, 4), replace(CELL, noise=stated)))
    assert (found.verdict, found.refitted.noise) == ('none', stated)


def test_a_disc_of_another_radius_is_no_noise():
    law, values = effect('object_radius[disc_2]'), (6e-5,)
    fit = calibrate(simulate((law, values), seed=6), UNKNOWN_NOISE)
    found = diagnose(fit)
    assert named(found) == [law.label]
    assert found.extended.noise.growth == 0
    assert found.extended.noise.joint < 1.2 * fit.noise.joint

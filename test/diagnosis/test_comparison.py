"""Base model and extended model: errors on the same touches, bias, and residuals of effects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import GROWN, conclude_outcome
from diagnosis.simulated import CELL, effect, simulate

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.fit_point import project
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.model.cell import Noise, Uncertainty

FRICTION = 0.05
"""Coefficient."""


def test_chi_square_of_both_is_in_the_same_noise(unnamed: Outcome) -> None:
    given = unnamed.comparison
    assert (unnamed.calibration.used == unnamed.final.used).all()
    assert given.base.reduced_chi_square == pytest.approx(unnamed.calibration.reduced_chi_square, rel=1e-3)
    assert given.extended.reduced_chi_square == unnamed.final.reduced_chi_square
    louder = Noise(2 * unnamed.final.noise.joint, 2 * unnamed.final.noise.force)
    doubled = replace(unnamed, diagnosis=replace(unnamed.diagnosis, extended=replace(unnamed.final, noise=louder)))
    assert doubled.comparison.base.reduced_chi_square == pytest.approx(given.base.reduced_chi_square / 4, rel=0.05)


def test_what_is_trusted_beforehand_counts_as_measurements(grown: Outcome) -> None:
    cell = replace(CELL, uncertainty=Uncertainty(nominal={'l1': 1e-5, 'l2': 1e-5}))
    touches, law = simulate((effect('object_position[disc_2]'), (2e-4, 0.0))), effect('object_position[disc_2]')
    given = replace(grown, calibration=calibrate(touches, cell))
    extended = calibrate(touches, cell, [law])
    both = replace(given, diagnosis=replace(given.diagnosis, extended=extended)).comparison
    assert both.base.reduced_chi_square == pytest.approx(given.calibration.reduced_chi_square, rel=1e-3)


def test_both_are_compared_on_the_touches_of_the_final_model(grown: Outcome) -> None:
    assert grown.calibration.used.sum() < grown.final.used.sum(), 'touches that the base model rejects'
    lengths = np.hypot(*grown.calibration.residual[grown.final.used].T)
    assert grown.comparison.base.force_error == pytest.approx(lengths.mean(), rel=1e-12)
    assert grown.comparison.base.reduced_chi_square > grown.calibration.reduced_chi_square


def test_the_tip_left_out_is_that_of_a_fit_without_it(plain: Outcome) -> None:
    """The closed form against fits that really leave a touch out."""
    c = plain.calibration
    data = c.touches.select(c.used)
    misses = []
    for k in range(len(data)):
        fit = calibrate(data.select(np.arange(len(data)) != k), c.cell)
        point = project(observe(data.select(np.array([k])), c.cell), fit.model, c.noise)
        misses.append(point.linear.misclosure[0, 0])
    assert plain.comparison.extended.tip.held_out == pytest.approx(np.sqrt(np.mean(np.square(misses))), rel=0.05)


def test_noise_alone_explains_the_tip_of_the_right_model(grown: Outcome, ambiguous: Outcome, unnamed: Outcome) -> None:
    for outcome in (grown, ambiguous, unnamed):
        tip = outcome.comparison.extended.tip
        assert 0.6 * tip.noise < tip.fitted < tip.noise < 1.3 * tip.held_out


def test_biases_are_in_units_of_what_was_claimed(grown: Outcome, confounded: Outcome) -> None:
    rows = {row.name: row for row in grown.comparison.biases}
    assert max(abs(row.in_std) for row in rows.values()) > 3
    assert rows['l2'].shift == rows['l2'].base - rows['l2'].value
    none = {row.name: row for row in confounded.comparison.biases}
    assert np.isnan(none['l1'].in_std)
    assert np.isnan(none['p_ee'].in_std)
    assert none['x0'].in_std == 0


def test_the_tip_error_beside_a_displaced_disc_is_that_of_its_place(grown: Outcome) -> None:
    """A displaced circle keeps its normals: neither the error nor that by noise grows with the displacement."""
    law, tips = effect('object_position[disc_2]'), []
    for x in (2e-4, 5e-3):
        touches = simulate((law, (x, 0.0)))
        given = replace(grown, calibration=calibrate(touches, CELL))
        extended = calibrate(touches, CELL, [law])
        tips.append(replace(given, diagnosis=replace(given.diagnosis, extended=extended)).comparison.extended.tip)
    near, far = tips
    assert far.fitted == pytest.approx(near.fitted, rel=0.1)
    assert far.held_out == pytest.approx(near.held_out, rel=0.1)
    assert far.noise == pytest.approx(near.noise, rel=0.02)


def test_an_effect_residual_shows_the_effect_before_and_noise_after(grown: Outcome) -> None:
    (found,) = grown.effect_residuals
    assert found.x_label == 'number of the object'
    assert found.y_label == 'displacement along the contact normal  [µm]'
    assert set(found.x) == {1, 2, 3}
    assert 1e6 * GROWN / 4 < found.before[found.x == 2].mean() < 1e6 * GROWN
    assert np.sqrt(np.mean((found.after / found.std_after) ** 2)) < 1.3
    assert np.sqrt(np.mean(((found.before - found.expected) / found.std_before) ** 2)) < 1.5
    assert np.std(found.before) > 5 * np.std(found.after)


def test_friction_is_shown_across_the_contact_normal_over_the_slide_by_which_it_is_judged() -> None:
    """To first order friction displaces the contact by -r α s across the normal, with s the slide at L̄n."""
    touches = simulate((effect('contact_friction'), (FRICTION,)))
    (found,) = conclude_outcome(touches, CELL).effect_residuals
    assert found.y_label == 'displacement across the contact normal  [µm]'
    size = -1e6 * FRICTION * CELL.radii[found.disc] * found.x
    weight = found.std_after**-2
    off = size - np.average(size, weights=weight)
    for shown, limit in ((found.expected, 0.05), (found.before, 0.1)):
        assert (weight * off * shown).sum() / (weight * off**2).sum() == pytest.approx(1, abs=limit)
    assert np.sqrt(np.mean((found.after / found.std_after) ** 2)) == pytest.approx(1, abs=0.15)


def test_the_residual_of_a_curve_is_over_its_variable(unnamed: Outcome) -> None:
    (found,) = unnamed.effect_residuals
    assert found.x_label == 'angle of joint 2  [rad]'
    assert found.y_label == 'deviation of joint 1  [µrad]'
    assert np.corrcoef(found.before, found.expected)[0, 1] > 0.8


def test_a_result_is_read_only_short_in_print_and_compared_by_identity(grown: Outcome) -> None:
    final = grown.final
    arrays = final.std, final.covariance, final.effect_std, final.used, final.force, final.standardized
    for array in (*arrays, final.residual, final.nominal_residual):
        with pytest.raises(ValueError, match='read-only'):
            array[0] = 0
    assert final == final
    assert final != replace(final)
    assert grown != replace(grown)
    assert len({final, grown.calibration}) == 2
    for shown in (repr(final), repr(grown)):
        assert len(shown) < 250
        assert 'object_radius' in shown
    assert f'{final.used.sum()} of {len(final.touches)} touches' in repr(final)


def test_an_effect_found_alone_is_the_same_estimate_in_the_outcome_and_its_final_model(grown: Outcome) -> None:
    for label, values in grown.effects.items():
        assert values == grown.final.effects[label]
    (start,) = grown.final.start.effect_values
    moved = replace(grown.final, start=replace(grown.final.start, effect_values=(tuple(v + 1e-6 for v in start),)))
    other = replace(grown, diagnosis=replace(grown.diagnosis, extended=moved))
    assert other.effects == moved.effects

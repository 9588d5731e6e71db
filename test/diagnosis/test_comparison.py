"""Before and after: errors on the same touches, and where an effect shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import GROWN, OFF_NORMAL

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.prediction import observe
from scara_kinetostatic.calibration.projection import project
from scara_kinetostatic.diagnosis.comparison import biases, compare
from scara_kinetostatic.diagnosis.effect_residual import signature
from scara_kinetostatic.diagnosis.outcome import Outcome
from scara_kinetostatic.model.cell import Noise


def test_chi_square_of_both_is_in_the_same_noise(unnamed: Outcome) -> None:
    given = compare(unnamed)
    assert (unnamed.calibration.used == unnamed.final.used).all()
    assert given.alone.reduced_chi_square == pytest.approx(unnamed.calibration.reduced_chi_square, rel=1e-3)
    assert given.extended.reduced_chi_square == unnamed.final.reduced_chi_square
    louder = Noise(2 * unnamed.final.noise.joint, 2 * unnamed.final.noise.force)
    doubled = replace(unnamed, diagnosis=replace(unnamed.diagnosis, extended=replace(unnamed.final, noise=louder)))
    assert compare(doubled).alone.reduced_chi_square == pytest.approx(given.alone.reduced_chi_square / 4, rel=0.05)


def test_both_are_judged_on_the_touches_of_the_final_model(grown: Outcome) -> None:
    assert grown.calibration.used.sum() < grown.final.used.sum(), 'touches the twelve alone took for bad'
    lengths = np.hypot(*grown.calibration.residual[grown.final.used].T)
    assert compare(grown).alone.force_error == pytest.approx(lengths.mean(), rel=1e-12)
    assert compare(grown).alone.reduced_chi_square > grown.calibration.reduced_chi_square


def test_the_tip_left_out_is_that_of_a_fit_without_it(plain: Outcome) -> None:
    """The closed form against fits that really leave a touch out."""
    c = plain.calibration
    data = c.touches.select(c.used)
    misses = []
    for k in range(len(data)):
        fit = calibrate(data.select(np.arange(len(data)) != k), c.cell)
        point = project(observe(data.select(np.array([k])), c.cell), fit.parameters, c.noise)
        misses.append(point.linear.misclosure[0, 0])
    assert compare(plain).extended.tip.held_out == pytest.approx(np.sqrt(np.mean(np.square(misses))), rel=0.05)


def test_noise_alone_explains_the_tip_of_the_right_model(grown: Outcome, ambiguous: Outcome, unnamed: Outcome) -> None:
    for outcome in (grown, ambiguous, unnamed):
        tip = compare(outcome).extended.tip
        assert 0.6 * tip.noise < tip.fitted < tip.noise < 1.3 * tip.held_out


def test_bends_are_in_units_of_what_was_claimed(grown: Outcome, confounded: Outcome) -> None:
    rows = {row.name: row for row in biases(grown)}
    assert max(abs(row.in_std) for row in rows.values()) > 3
    assert rows['l2'].shift == rows['l2'].alone - rows['l2'].value
    none = {row.name: row for row in biases(confounded)}
    assert np.isnan(none['l1'].in_std)
    assert np.isnan(none['p_ee'].in_std)
    assert none['x0'].in_std == 0


def test_a_signature_shows_the_effect_before_and_noise_after(grown: Outcome) -> None:
    (item,) = grown.diagnosis.found
    found = signature(grown, item)
    assert found.over == 'number of the disc'
    assert found.what == 'place along the force  [µm]'
    assert set(found.x) == {1, 2, 3}
    assert 1e6 * GROWN / 4 < found.before[found.x == 2].mean() < 1e6 * GROWN
    assert np.sqrt(np.mean((found.after / found.spread_after) ** 2)) < 1.3
    assert np.sqrt(np.mean(((found.before - found.expected) / found.spread_before) ** 2)) < 1.5
    assert np.std(found.before) > 5 * np.std(found.after)


def test_the_signature_of_a_curve_is_over_its_variable(unnamed: Outcome) -> None:
    (item,) = unnamed.diagnosis.found
    found = signature(unnamed, item)
    assert found.over == 'the angle of joint 2  [°]'
    assert found.what == 'joint 1 deviates  [µrad]'
    assert np.corrcoef(found.before, found.expected)[0, 1] > 0.8


def test_a_lean_of_every_force_is_shown_as_it_is(rough: Outcome) -> None:
    (item,) = rough.diagnosis.found
    found = signature(rough, item)
    assert found.what == 'lean of the force  [mrad]'
    np.testing.assert_array_equal(found.before, found.after)
    assert np.std(found.before / 1e3) == pytest.approx(OFF_NORMAL, rel=0.2)
    assert np.sqrt(np.mean((found.before / found.spread_before) ** 2)) > 3
    assert np.sqrt(np.mean((found.after / found.spread_after) ** 2)) == pytest.approx(1, abs=0.25)

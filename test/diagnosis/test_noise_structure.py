"""Noise that grows with the force is found where the touches show it; what is stated is kept."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from diagnosis.simulated import CELL, NOISE, PLAN, UNKNOWN_NOISE, check_explained, deviations, effect, named, simulate

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.files.cell_file import dump_cell, parse_cell
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.streams import simulate_touches

GROWING = Noise(1e-5, 0.3, 0.015)
BY_AXIS = Noise((0.4e-5, 1.36e-5), (0.41, 0.103))
"""Levels four times apart, root mean square those of `NOISE`."""


def with_noise(noise, seed, *effects):
    laws, values = tuple(law for law, _ in effects), tuple(part for _, part in effects)
    return simulate_touches(CELL, ExtendedModel(PAPER_ACTUAL, laws, values), PLAN, noise, seed)


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


@pytest.mark.parametrize('cell', [CELL, UNKNOWN_NOISE], ids=['noise known', 'noise unknown'])
def test_plain_noise_stays_plain(cell):
    fit = calibrate(simulate(seed=21), cell)
    found = diagnose(fit)
    assert found.verdict == 'none'
    assert found.refitted.noise.levels == pytest.approx(fit.noise.levels, rel=0.15)
    assert fit.noise.is_plain


def test_what_is_stated_is_kept():
    stated = BY_AXIS._replace(force_relative=0.0)
    found = diagnose(calibrate(with_noise(BY_AXIS, 4), replace(CELL, noise=stated)))
    assert (found.verdict, found.refitted.noise) == ('none', stated)


def test_noise_that_grows_hides_no_disc_of_another_radius():
    law, values = effect('object_radius[disc_2]'), (6e-5,)
    check_explained(diagnose(calibrate(with_noise(GROWING, 5, (law, values)), UNKNOWN_NOISE)), law.label, values)


def test_a_disc_of_another_radius_is_no_noise():
    law, values = effect('object_radius[disc_2]'), (6e-5,)
    for cell in (CELL, UNKNOWN_NOISE):
        fit = calibrate(simulate((law, values), seed=6), cell)
        found = diagnose(fit)
        assert named(found) == [law.label]
        assert found.extended.noise.growth == 0
        assert found.extended.noise.joint < 1.2 * fit.noise.joint

"""Maps over the direction, isotropy, agreement of several values."""

from __future__ import annotations

import numpy as np
import pytest

from scara_kinetostatic.studies.dial_gauge.result import direction_map
from scara_kinetostatic.studies.dial_gauge.statistics import combine_estimates

DIRECTIONS = np.radians(np.arange(0, 360, 30))
DOF = np.full(12, 82.0)


def noisy(values: np.ndarray, std: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Values with noise, and what a run of 82 degrees of freedom says of their standard deviation."""
    return values + std * rng.standard_normal(len(values)), std * np.sqrt(rng.chisquare(82, len(values)) / 82)


@pytest.mark.parametrize(('power', 'major', 'minor', 'std'), [(1, 5e-5, 3e-5, 2e-7), (2, 2.05e-4, 5.49e-5, 1e-6)])
def test_ellipse_gives_back_its_principal_values(power, major, minor, std):
    axis, rng, z, p = 0.4, np.random.default_rng(0), [], []
    turned = DIRECTIONS - axis
    truth = (major**power * np.cos(turned) ** 2 + minor**power * np.sin(turned) ** 2) ** (1 / power)
    for _ in range(250):
        each = direction_map(DIRECTIONS, *noisy(truth, std, rng), DOF, power)
        assert each.ellipse is not None
        found = each.ellipse
        pairs = ((found.major, major), (found.minor, minor), (found.axis, axis), (found.at(1.0), None))
        truth_there = (major**power * np.cos(1 - axis) ** 2 + minor**power * np.sin(1 - axis) ** 2) ** (1 / power)
        z.append([(e.value - (truth_there if t is None else t)) / e.std for e, t in pairs])
        p.append((found.p_value, each.isotropy.p_value))
    assert np.sqrt((np.array(z) ** 2).mean(axis=0)) == pytest.approx(1, abs=0.1)
    assert np.mean(np.array(p)[:, 0] < 0.05) == pytest.approx(0.05, abs=0.042)
    assert np.array(p)[:, 1].max() < 1e-10


def test_isotropy_is_not_doubted_without_reason():
    rng = np.random.default_rng(2)
    p = [direction_map(DIRECTIONS, *noisy(np.full(12, 1e-4), 1e-6, rng), DOF, 2).isotropy.p_value for _ in range(600)]
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.027)


def test_what_is_no_ellipse_is_noticed():
    square = 1e-4 + 1e-5 * np.cos(4 * DIRECTIONS)
    found = direction_map(DIRECTIONS, *noisy(square, 1e-6, np.random.default_rng(1)), DOF, 2).ellipse
    assert found is not None
    assert found.p_value < 1e-6


def test_no_ellipse_from_two_axes_or_from_no_gap():
    two = np.radians([0, 90, 180, 270])
    assert direction_map(two, np.full(4, 1e-4), np.full(4, 1e-6), DOF[:4], 1).ellipse is None
    assert direction_map(DIRECTIONS, np.full(12, 1e-6), np.full(12, 1e-6), DOF, 2).ellipse is None


@pytest.mark.parametrize('shared', [True, False])
def test_agreement_with_few_degrees_of_freedom_raises_no_false_alarm(shared):
    rng, p = np.random.default_rng(3), []
    for _ in range(2000):
        scale = np.sqrt(rng.chisquare(8) / 8) if shared else np.sqrt(rng.chisquare(8, 6) / 8)
        p.append(
            combine_estimates(rng.standard_normal(6), np.ones(6) * scale, 8.0 if shared else np.full(6, 8.0)).p_value
        )
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.015)


def test_disagreement_is_measured_and_widens_the_mean():
    rng = np.random.default_rng(4)
    between, inside = [], []
    for _ in range(300):
        test = combine_estimates(3 * rng.standard_normal(10) + rng.standard_normal(10), np.ones(10), np.inf)
        between.append(test.between**2)
        inside.append(abs(test.mean) < 1.96 * test.std)
    assert np.mean(between) == pytest.approx(9, rel=0.1)
    assert np.mean(inside) > 0.88

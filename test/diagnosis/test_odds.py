"""The posterior odds against dense Gaussian likelihoods, and against the truth they are about."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy import stats

from scara_kinetostatic.calibration.tip_uncertainty import radius
from scara_kinetostatic.diagnosis.odds import (
    _TAUS,
    NUMBER,
    SCALE,
    SIZES,
    Form,
    OddsProblem,
    SizedSet,
    _gathered,
    components,
    posterior_odds,
)

ROWS, BASE = 40, 3


def simulated(effects: int, gross: dict[int, float], rng: np.random.Generator, small: float = 0.5, rows: int = ROWS):
    """J, X with two columns an effect, and the misclosures with some gross effects, of sizes in typical ones."""
    base = rng.standard_normal((rows, BASE))
    columns = 0.2 * (rng.standard_normal((rows, 2 * effects)) + base @ rng.standard_normal((BASE, 2 * effects)))
    values = small * rng.standard_normal(2 * effects)
    for k, size in gross.items():
        values[2 * k : 2 * k + 2] += size * rng.standard_normal(2)
    return base, columns, rng.standard_normal(rows) - columns @ values, values


def posed(base, columns, y, given: bool = True):
    """The linear problem with every effect as a small and as a gross one, and its forms."""
    problem = OddsProblem.of(
        base, np.concatenate([columns, columns], axis=1), y, np.zeros(columns.shape[1], dtype=bool), given, 0.0
    )
    return problem, [Form(f'effect {k}', np.array([2 * k, 2 * k + 1]), 1.0) for k in range(columns.shape[1] // 2)]


def test_probabilities_are_those_of_dense_likelihoods():
    """Every set of up to three of three effects, at every size: densities of y projected off J."""
    rng = np.random.default_rng(3)
    base, columns, y, _ = simulated(3, {1: 6.0}, rng)
    kept = np.linalg.svd(base)[0][:, BASE:]
    z, target = kept.T @ columns, kept.T @ y
    x = SIZES / SCALE
    of_size = np.log(x / (1 + x**2) / np.sum(x / (1 + x**2)))
    tau_prior = np.log(_TAUS / (1 + _TAUS**2) / np.sum(_TAUS / (1 + _TAUS**2)))
    logs: dict[frozenset[str], list[float]] = {}
    nu = len(target)
    for chosen in [(), (0,), (1,), (2,), (0, 1), (0, 2), (1, 2), (0, 1, 2)]:
        ways = (1, 3, 3, 1)[len(chosen)]
        for (tau, log_tau), sizes in product(
            zip(_TAUS, tau_prior, strict=True), product(range(len(SIZES)), repeat=len(chosen))
        ):
            cov = np.eye(nu) + tau**2 * z @ z.T
            for k, s in zip(chosen, sizes, strict=True):
                part = z[:, 2 * k : 2 * k + 2]
                cov += SIZES[s] ** 2 * part @ part.T
            square, log_det = target @ np.linalg.solve(cov, target), np.linalg.slogdet(cov)[1]
            free = -0.5 * nu * (np.log(square / nu) + 1) + 0.5 * np.log(np.pi / nu) - np.log(np.log(10.0))
            larger = np.log(0.05) + free if square > nu else -np.inf
            likelihood = np.logaddexp(np.log(0.95) - 0.5 * square, larger) - 0.5 * log_det
            prior = np.log(NUMBER[len(chosen)] / ways) + log_tau + sum(of_size[s] for s in sizes)
            logs.setdefault(frozenset(f'effect {k}' for k in chosen), []).append(likelihood + prior)
    total = np.logaddexp.reduce([one for part in logs.values() for one in part])
    expected = {labels: float(np.exp(np.logaddexp.reduce(part) - total)) for labels, part in logs.items()}
    problem, forms = posed(base, columns, y)
    found = posterior_odds(problem, forms)
    assert found.none == pytest.approx(expected[frozenset()], rel=1e-6)
    assert sum(found.probabilities.values()) == pytest.approx(1.0)
    without = {labels: p for labels, p in found.probabilities.items() if 'effect 1' not in labels}
    wanted = sum(p for labels, p in expected.items() if 'effect 1' not in labels)
    assert sum(without.values()) == pytest.approx(wanted, rel=1e-6)
    assert found.log_evidence == pytest.approx(total - 0.5 * problem.constant, abs=1e-6)


def test_values_by_a_set_are_those_of_the_penalised_least_squares():
    rng = np.random.default_rng(5)
    base, columns, y, values = simulated(4, {2: 20.0}, rng)
    problem, forms = posed(base, columns, y)
    odds = posterior_odds(problem, forms)
    label = frozenset(['effect 2'])
    part = odds.parts[label][0]
    lift = np.eye(BASE + 16)
    lift[BASE : BASE + 8, BASE + 8 :] = np.eye(8)  # a gross effect adds to the small one
    (found,) = components(problem, forms, odds.states, [[part]], lift[: BASE + 8])
    widths = np.full(8, odds.states[part.state].widths[0])
    widths[4:6] = np.hypot(widths[4:6], part.sizes[0])
    every = np.concatenate([base, columns], axis=1)
    normal = every.T @ every + np.diag(np.concatenate([np.zeros(BASE), 1 / widths**2]))
    np.testing.assert_allclose(found.mean, -np.linalg.solve(normal, every.T @ y), rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(normal), rtol=1e-7, atol=1e-10)
    off = (found.mean[BASE:] - values) / np.sqrt(np.diag(found.covariance)[BASE:])
    assert np.abs(off).max() < 4


@pytest.mark.parametrize('given', [True, False])
def test_what_is_stated_is_true_as_often(given):
    """Sizes and numbers from the priors: of inclusions above 95 % nine tenths are true at least, no false alarm."""
    rng = np.random.default_rng(11)
    stated, true, alarms = 0, 0, 0
    for _ in range(60):
        number = rng.choice(4, p=NUMBER)
        gross = {int(k): SCALE * abs(rng.standard_cauchy()) for k in rng.choice(12, number, replace=False)}
        base, columns, y, _ = simulated(12, gross, rng, small=float(np.exp(rng.uniform(-2, 0.5))), rows=100)
        odds = posterior_odds(*posed(base, columns, y, given))
        for label, probability in odds.inclusion.items():
            if probability > 0.95:
                stated += 1
                true += int(label.split()[1]) in gross
        alarms += not gross and odds.none < 0.05
    assert stated > 15
    assert true >= 0.9 * stated
    assert alarms == 0


def test_an_effect_that_is_not_seen_takes_nothing_from_one_that_is():
    rng = np.random.default_rng(2)
    base, columns, y, _ = simulated(10, {4: 40.0}, rng)
    odds = posterior_odds(*posed(base, columns, y))
    assert next(iter(odds.probabilities)) == frozenset(['effect 4'])
    assert odds.inclusion['effect 4'] > 0.99
    assert odds.probabilities[frozenset(['effect 4'])] > 0.9


def test_noise_that_is_stated_too_small_is_no_effect():
    """Twice the noise, without any effect: what is larger than stated is noise."""
    rng = np.random.default_rng(7)
    for _ in range(10):
        base, columns, y, _ = simulated(12, {}, rng, small=0.1, rows=100)
        assert posterior_odds(*posed(base, columns, 2 * y)).none > 0.3


def test_the_radius_of_a_mixture_holds_the_stated_part():
    rng = np.random.default_rng(1)
    q = np.array([0.6, 0.3, 0.1])
    means = 3 * rng.standard_normal((4, 3, 2))
    roots = rng.standard_normal((4, 3, 2, 2))
    found = radius(q, means, roots @ roots.swapaxes(-1, -2))
    for r, mean, root in zip(found, means, roots, strict=True):
        k = rng.choice(3, 100_000, p=q)
        places = mean[k] + np.einsum('nij,nj->ni', root[k], rng.standard_normal((len(k), 2)))
        assert np.mean(np.hypot(*places.T) <= r) == pytest.approx(0.95, abs=0.003)
    alone = radius(np.ones(1), np.zeros((1, 1, 2)), np.eye(2)[None, None])
    assert alone[0] == pytest.approx(stats.chi2(2).ppf(0.95) ** 0.5, rel=1e-4)


def inclusions_of_a_wave(size: float, seed: int) -> tuple[float, float]:
    """Of a wave that is at one of eight places, where small it may be at one as well, and where at all eight alone."""
    rng = np.random.default_rng(seed)
    base = rng.standard_normal((80, BASE))
    places, others = 0.6 * rng.standard_normal((80, 16)), 0.6 * rng.standard_normal((80, 24))
    y = rng.standard_normal(80) - places[:, :2] @ (size, -size) - others @ rng.standard_normal(24)
    columns = np.concatenate([places / 8**0.5, others, places, others], axis=1)
    problem = OddsProblem.of(base, columns, y, np.zeros(40, dtype=bool), True, 0.0)
    found = list[float]()
    for is_placed in (True, False):
        forms = [Form('wave', np.array([2 * k, 2 * k + 1]), 1 / 8, is_placed) for k in range(8)]
        forms += [Form(f'effect {k}', np.array([16 + 2 * k, 17 + 2 * k]), 1.0) for k in range(12)]
        found.append(posterior_odds(problem, forms).inclusion.get('wave', 0.0))
    return found[0], found[1]


def test_a_small_wave_at_one_place_is_not_gross():
    small = np.array([inclusions_of_a_wave(2.0, seed) for seed in range(6)])
    assert small[:, 0].max() < 0.5
    assert np.median(small[:, 1]) > 0.9, 'to a model in which it is small at all places alone'
    assert np.min([inclusions_of_a_wave(20.0, seed) for seed in range(6)]) > 0.99


def test_alike_effects_share_what_is_merged_in_the_same_way_in_every_run():
    """The order of a set of strings is another in each run of Python; eight ties by it would be right once in 256."""
    for number in range(8):
        one, other = f'{number} one', f'{number} other'
        parts = [SizedSet(-2.0, frozenset(labels), (), (), 0) for labels in ([], [one], [other], [one, other])]
        found = _gathered(parts, np.zeros(3), {one: 1.0, other: 1.0}, {}, {}, [], 0.0)
        assert found.merged[frozenset({other})] == [frozenset({other}), frozenset({one, other})]

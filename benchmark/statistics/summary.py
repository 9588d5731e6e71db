"""What runs come to: variances over the bound, coverage, optima, growth by outliers; and whether targets are met."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from benchmark.statistics.outliers import CASES, CLEAN, LARGE, LEFT_OUT, MIXED, OutlierRun
from benchmark.statistics.runs import NoiseRun, Scene, StartRun
from scara_kinetostatic.model.parameters import NAMES

Floats = NDArray[np.float64]

EFFICIENT = 1.08
"""Variance over the bound, at most."""
COVERED = (0.935, 0.965)
"""Part of the 95 % intervals that hold the truth, at least and at most."""
GROWTH = 0.20
"""Growth of a standard deviation by outliers, at most."""
LEVEL = 0.95
BINS = (0.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0)
"""Sizes of bad touches from which they are counted together, standard deviations."""


def noise_summary(runs: Sequence[NoiseRun], stage: Scene) -> dict[str, Any]:
    """Efficiency, bias and coverage.

    The ideal estimate of `bound` has the bound as its variance, exactly, and normal errors. How far it is
    from that on the noise of these runs is luck, and nearly the same luck as the estimates have: what is set against
    the ideal of the same noise is nearly free of sampling error.
    """
    error, std, ideal = (np.array([getattr(run, name) for run in runs]) for name in ('error', 'std', 'ideal'))
    number = len(runs)
    student = stats.t.ppf((1 + LEVEL) / 2, [run.freedoms for run in runs])[:, None]
    normal = stats.norm.ppf((1 + LEVEL) / 2)
    variance = error.var(axis=0, ddof=1)
    with np.errstate(invalid='ignore'):
        held = {'normal': np.abs(error) <= normal * std, 'student': np.abs(error) <= student * std}
    lucky = (np.abs(ideal) <= normal * stage.bound.std).astype(float) - LEVEL
    apart = held['normal'] - lucky
    return {
        'runs': number,
        'touches': len(stage.plan),
        'bound_std': named(stage.bound.std, 12),
        'variance_over_bound': named(variance / stage.bound.std**2),
        'sampling_error': float(np.sqrt(2 / (number - 1))),
        'variance_over_ideal_of_same_noise': named(variance / ideal.var(axis=0, ddof=1)),
        'bias_over_sigma': named(error.mean(axis=0) / stage.bound.std),
        'bias_sampling_error': float(1 / np.sqrt(number)),
        'stated_variance_over_bound': named((std**2).mean(axis=0) / stage.bound.std**2),
        'coverage': {
            kind: {**named(hit.mean(axis=0)), 'pooled': float(hit.mean())}
            for kind, hit in {**held, 'normal_of_same_noise': apart}.items()
        },
        'coverage_of_same_noise_sampling_error': named(apart.std(axis=0, ddof=1) / np.sqrt(number)),
        'freedoms': {'stated': runs[0].freedoms, 'of_the_stated_variance': _freedoms(std)},
        'coverage_sampling_error': float(np.sqrt(LEVEL * (1 - LEVEL) / number)),
        'good_touches_rejected': int(sum(run.rejected for run in runs)),
        'runs_with_confounded_parameters': int(np.isnan(std).any(axis=1).sum()),
        'noise_levels_mean': np.mean([run.levels for run in runs], axis=0).tolist(),
    }


def _freedoms(std: Floats) -> dict[str, float] | None:
    """Degrees of freedom of a chi-square that scatters as much as the stated variances; None where they do not."""
    relative = (std**2).std(axis=0, ddof=1) / (std**2).mean(axis=0)
    return named(2 / relative**2, 1) if (relative > 0.05).all() else None


def named(values: Floats, digits: int = 4) -> dict[str, float]:
    """By the names of the twelve."""
    return dict(zip(NAMES, np.round(values, digits).tolist(), strict=True))


def starts_summary(runs: Sequence[StartRun]) -> dict[str, Any]:
    """How many reached the same optimum."""
    reached = [run for run in runs if not run.error]
    return {
        'starts': len(runs),
        'same_optimum': sum(run.same for run in runs),
        'largest_relative_difference_of_cost': max((run.cost for run in reached), default=float('nan')),
        'largest_difference_of_a_parameter_in_sigma': max((run.value for run in reached), default=float('nan')),
        'iterations': {
            'median': float(np.median([run.iterations for run in reached])) if reached else None,
            'most': max((run.iterations for run in reached), default=0),
        },
        'errors': sorted({run.error for run in runs if run.error}),
    }


def outlier_summary(runs: Sequence[OutlierRun]) -> dict[str, Any]:
    """Growth and naming, case by case, and naming by the size of the bad touch."""
    cases = {label: _case(runs, label) for label in (LEFT_OUT, *CASES)}
    sizes = np.concatenate([run.sizes[label] for label in CASES for run in runs if label in run.named])
    hits = np.concatenate([run.named[label] for label in CASES for run in runs if label in run.named])
    return {
        'runs': len(runs),
        'bad_touches_in_each': len(runs[0].sizes[MIXED]),
        'good_touches_rejected_without_bad_ones': sum(run.lost.get(CLEAN, 0) for run in runs),
        'cases': cases,
        'named_by_size': _by_size(sizes, hits),
    }


def _by_size(sizes: Floats, hits: NDArray[np.bool_]) -> list[dict[str, Any]]:
    place, rows = np.digitize(sizes, BINS), []
    for number, least in enumerate(BINS, 1):
        most = BINS[number] if number < len(BINS) else None
        some = hits[place == number]
        rows.append({'least': least, 'most': most, 'bad': len(some), 'named': int(some.sum())})
    return rows


def _case(runs: Sequence[OutlierRun], label: str) -> dict[str, Any]:
    pairs = [(run.error[label], run.error[CLEAN]) for run in runs if label in run.error and CLEAN in run.error]
    bad, good = (np.array(part) for part in zip(*pairs, strict=True))
    growth = bad.std(axis=0, ddof=1) / good.std(axis=0, ddof=1) - 1
    summary = {
        'growth': named(growth),
        'growth_rms': float(np.sqrt(((1 + growth) ** 2).mean()) - 1),
        'growth_largest': float(growth.max()),
        'growth_largest_of': NAMES[int(growth.argmax())],
        'largest_error_in_sigma_of_good_runs': float((np.abs(bad) / good.std(axis=0, ddof=1)).max()),
        'good_touches_rejected': sum(run.lost.get(label, 0) for run in runs),
        'errors': sum(label in run.failed for run in runs),
    }
    if label in CASES:
        hits = np.concatenate([run.named[label] for run in runs if label in run.named])
        sizes = np.concatenate([run.sizes[label] for run in runs if label in run.named])
        finite = sizes[np.isfinite(sizes)]
        summary |= {
            'bad': len(hits),
            'named': int(hits.sum()),
            'smallest_size': float(sizes.min()) if len(finite) else None,
            'largest_size_not_named': float(sizes[~hits].max()) if not hits.all() else None,
        }
    return summary


def judge(summary: dict[str, Any]) -> list[tuple[str, bool]]:
    """Each target in words, and whether it is met."""
    verdicts = []
    for key, part in summary.get('efficiency', {}).items():
        for kind in ('bound', 'ideal_of_same_noise'):
            worst = max(part[f'variance_over_{kind}'].items(), key=lambda item: item[1])
            words = f'variance over {kind.replace("_", " ")} at most {EFFICIENT}, {key}: {worst[1]:.3f} ({worst[0]})'
            verdicts.append((words, worst[1] <= EFFICIENT))
    for key, part in summary.get('coverage', {}).items():
        for kind, added in (('normal', ''), ('normal_of_same_noise', ' without the luck of this noise')):
            rates = part['coverage'][kind].values()
            words = f'coverage {100 * COVERED[0]:.1f} to {100 * COVERED[1]:.1f} %{added}, {key}: '
            words += f'{100 * min(rates):.2f} to {100 * max(rates):.2f} %'
            verdicts.append((words, min(rates) >= COVERED[0] and max(rates) <= COVERED[1]))
    for key, part in summary.get('starts', {}).items():
        words = f'same optimum from all starts, {key}: {part["same_optimum"]} of {part["starts"]}'
        verdicts.append((words, part['same_optimum'] == part['starts']))
    for key, part in summary.get('outliers', {}).items():
        every = part['cases']
        for label in (*(kind.label for kind in LARGE), MIXED):
            case = every[label]
            words = f'{label}, {key}: named {case["named"]} of {case["bad"]}, growth at most {GROWTH:.0%}: '
            words += f'{case["growth_largest"]:+.1%} ({case["growth_largest_of"]})'
            met = case['named'] == case['bad'] and case['growth_largest'] < GROWTH and not case['errors']
            verdicts.append((words, met))
    return verdicts

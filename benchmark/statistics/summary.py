"""Figures of the runs: variances over the bound, coverage, optima, growth by outliers; their targets, as text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from benchmark.statistics.outliers import CASES, CLEAN, LARGE, LEFT_OUT, MIXED, OutlierRun
from benchmark.statistics.runs import (
    ANGLE_OFF,
    FACTOR_OFF,
    LENGTH_OFF,
    SAME_COST,
    SAME_VALUE,
    NoiseRun,
    Setup,
    StartRun,
)
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.parameters import NAMES

WIDTH = 36
EFFICIENT = 1.08
"""Variance over the bound, at most."""
COVERED = (0.935, 0.965)
"""Part of the 95 % intervals that hold the truth, at least and at most."""
GROWTH = 0.20
"""Growth of a standard deviation by outliers, at most."""
LEVEL = 0.95
BINS = (0.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0)
"""Sizes of bad touches from which they are counted together, standard deviations."""


def noise_summary(runs: Sequence[NoiseRun], setup: Setup) -> dict[str, Any]:
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
    lucky = (np.abs(ideal) <= normal * setup.bound.std).astype(float) - LEVEL
    apart = held['normal'] - lucky
    return {
        'runs': number,
        'touches': len(setup.plan),
        'bound_std': named(setup.bound.std, 12),
        'variance_over_bound': named(variance / setup.bound.std**2),
        'sampling_error': float(np.sqrt(2 / (number - 1))),
        'variance_over_ideal_of_same_noise': named(variance / ideal.var(axis=0, ddof=1)),
        'bias_over_sigma': named(error.mean(axis=0) / setup.bound.std),
        'bias_sampling_error': float(1 / np.sqrt(number)),
        'stated_variance_over_bound': named((std**2).mean(axis=0) / setup.bound.std**2),
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
    """By the names of the parameters."""
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
    cases = {label: _case_summary(runs, label) for label in (LEFT_OUT, *CASES)}
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


def _case_summary(runs: Sequence[OutlierRun], label: str) -> dict[str, Any]:
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


def check_targets(summary: dict[str, Any]) -> list[tuple[str, bool]]:
    """Each target as text, and whether it is met."""
    found = []
    for key, part in summary.get('efficiency', {}).items():
        for kind in ('bound', 'ideal_of_same_noise'):
            worst = max(part[f'variance_over_{kind}'].items(), key=lambda item: item[1])
            text = f'variance over {kind.replace("_", " ")} at most {EFFICIENT}, {key}: {worst[1]:.3f} ({worst[0]})'
            found.append((text, worst[1] <= EFFICIENT))
    for key, part in summary.get('coverage', {}).items():
        for kind, added in (('normal', ''), ('normal_of_same_noise', ' without the sampling error of this noise')):
            rates = part['coverage'][kind].values()
            text = f'coverage {100 * COVERED[0]:.1f} to {100 * COVERED[1]:.1f} %{added}, {key}: '
            text += f'{100 * min(rates):.2f} to {100 * max(rates):.2f} %'
            found.append((text, min(rates) >= COVERED[0] and max(rates) <= COVERED[1]))
    for key, part in summary.get('starts', {}).items():
        text = f'same optimum from all starts, {key}: {part["same_optimum"]} of {part["starts"]}'
        found.append((text, part['same_optimum'] == part['starts']))
    for key, part in summary.get('outliers', {}).items():
        every = part['cases']
        for label in (*(kind.label for kind in LARGE), MIXED):
            case = every[label]
            text = f'{label}, {key}: named {case["named"]} of {case["bad"]}, growth at most {GROWTH:.0%}: '
            text += f'{case["growth_largest"]:+.1%} ({case["growth_largest_of"]})'
            met = case['named'] == case['bad'] and case['growth_largest'] < GROWTH and not case['errors']
            found.append((text, met))
    return found


def tables(summary: dict[str, Any]) -> Iterator[str]:
    """Every line of the report."""
    yield 'All touches are simulated by the simulator of this package; none is measured.'
    yield from _efficiency(summary.get('efficiency', {}))
    yield from _coverage(summary.get('coverage', {}))
    yield from _starts(summary.get('starts', {}))
    yield from _outliers(summary.get('outliers', {}))
    yield from ('', 'Targets', '')
    for text, met in check_targets(summary):
        yield f'{"met   " if met else "MISSED"} {text}'


def _efficiency(parts: dict[str, Any]) -> Iterator[str]:
    if not parts:
        return
    yield from ('', 'Efficiency: variance of the estimates over the Cramér–Rao bound', '')
    yield 'bound: variance over the bound; same noise: over the variance of the ideal linear estimate of the very same'
    yield 'noise, free of sampling error; stated: mean stated variance over the bound; bias: mean error over sigma'
    for key, part in parts.items():
        yield from ('', f'{key}: {part["runs"]} runs of {part["touches"]} touches')
        yield f'sampling error {part["sampling_error"]:.3f} of bound, {part["bias_sampling_error"]:.3f} of bias'
        yield f'{"":8}{"bound":>9}{"same noise":>12}{"stated":>9}{"bias":>9}'
        columns = ('variance_over_bound', 'variance_over_ideal_of_same_noise', 'stated_variance_over_bound')
        for name in NAMES:
            first, second, third = (part[column][name] for column in columns)
            yield f'{name:8}{first:9.3f}{second:12.3f}{third:9.3f}{part["bias_over_sigma"][name]:+9.3f}'
        levels = part['noise_levels_mean']
        rejected = part['good_touches_rejected']
        yield f'good touches rejected: {rejected}; noise, mean: {levels[0]:.3g} rad, {levels[1]:.3g} N'
        if part['runs_with_confounded_parameters']:
            yield f'runs with confounded parameters: {part["runs_with_confounded_parameters"]}'


def _coverage(parts: dict[str, Any]) -> Iterator[str]:
    if not parts:
        return
    yield from ('', 'Coverage of 95 % intervals, %: value ± quantile times the stated standard deviation', '')
    yield 'quantiles: normal, 1.96; Student, with the degrees of freedom of the fit; same noise: normal, less what the'
    yield 'ideal estimate with the standard deviation of the bound, which covers 95 %, has beyond that on this noise'
    kinds = ('normal', 'student', 'normal_of_same_noise')
    yield f'{"":8}' + ''.join(f'{key:>32}' for key in parts)
    yield f'{"":8}' + f'{"normal":>12}{"Student":>9}{"same n.":>11}' * len(parts)
    for name in (*NAMES, 'pooled'):
        rates = [[100 * part['coverage'][kind][name] for kind in kinds] for part in parts.values()]
        yield f'{name:8}' + ''.join(f'{first:12.2f}{second:9.2f}{third:11.2f}' for first, second, third in rates)
    plain = 100 * max(part['coverage_sampling_error'] for part in parts.values())
    same = [100 * max(part['coverage_of_same_noise_sampling_error'].values()) for part in parts.values()]
    yield f'sampling error of one parameter {plain:.2f}; same noise at most ' + ', '.join(
        f'{each:.2f}' for each in same
    )
    for key, part in parts.items():
        scattered = part['freedoms']['of_the_stated_variance']
        if scattered:
            least, most = min(scattered.values()), max(scattered.values())
            yield f'{key}: stated variances scatter as with {least:.0f} to {most:.0f} degrees of freedom'


def _starts(parts: dict[str, Any]) -> Iterator[str]:
    if not parts:
        return
    yield from ('', 'Random starts: does the same optimum come out', '')
    yield f'lengths and base off by up to {1e3 * LENGTH_OFF:.0f} mm, offsets by {ANGLE_OFF:.4f} rad, compliances and'
    yield f'backlashes by a factor of up to {FACTOR_OFF:g}; same: cost to {SAME_COST:g}, values to {SAME_VALUE:g} sigma'
    for key, part in parts.items():
        steps = part['iterations']
        yield (
            f'{key:26} same optimum {part["same_optimum"]} of {part["starts"]}; largest difference: cost '
            f'{part["largest_relative_difference_of_cost"]:.1e}, parameter '
            f'{part["largest_difference_of_a_parameter_in_sigma"]:.1e} sigma; '
            f'iterations {steps["median"]:g}, at most {steps["most"]}'
        )
        yield from (f'  {error}' for error in part['errors'])


def _outliers(parts: dict[str, Any]) -> Iterator[str]:
    if not parts:
        return
    yield from ('', 'Outliers: one touch in ten is bad', '')
    yield 'growth: of the standard deviation of the estimates against as many good touches, rms and largest of'
    yield 'parameters; size: distance from the model in standard deviations; lost: good touches rejected'
    for key, part in parts.items():
        good = part['good_touches_rejected_without_bad_ones']
        bad = part['bad_touches_in_each']
        yield from ('', f'{key}: {part["runs"]} runs, {bad} bad in each; lost where none is bad: {good}')
        columns = f'{"growth":>8}{"largest":>9} of    {"named":>12}{"size from":>11}{"missed to":>11}{"lost":>6}'
        yield ' ' * WIDTH + columns
        for label, case in part['cases'].items():
            yield _case(label, case)
        rows = (f'{sizes_of(row)}: {row["named"]}/{row["bad"]}' for row in part['named_by_size'])
        yield 'named by size, all cases: ' + ', '.join(rows)


def _case(label: str, case: dict[str, Any]) -> str:
    naming = ''
    if 'bad' in case:
        smallest, missed = case['smallest_size'], case['largest_size_not_named']
        share = f'{case["named"]}/{case["bad"]}'
        naming = f'{share:>12}{_size(smallest):>11}{_size(missed, "none"):>11}'
    growth = f'{100 * case["growth_rms"]:7.1f}%{100 * case["growth_largest"]:8.1f}%'
    errors = f'  errors: {case["errors"]}' if case['errors'] else ''
    return f'{label:{WIDTH}}{growth} {case["growth_largest_of"]:6}{naming:34}{case["good_touches_rejected"]:6}{errors}'


def sizes_of(row: dict[str, Any]) -> str:
    """The sizes of a row, in standard deviations."""
    return f'{row["least"]:g}' + (f'–{row["most"]:g}' if row['most'] else '+')


def _size(value: float | None, without: str = '') -> str:
    return without if value is None else f'{value:.1f}'

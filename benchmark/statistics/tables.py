"""The outcome of `statistics` as text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from benchmark.statistics.runs import ANGLE_OFF, FACTOR_OFF, LENGTH_OFF, SAME_COST, SAME_VALUE
from benchmark.statistics.summary import judge
from scara_kinetostatic.model.parameters import NAMES

WIDTH = 36


def tables(summary: dict[str, Any]) -> Iterator[str]:
    """Every line of the report."""
    yield 'All touches are simulated by the simulator of this package; none is measured.'
    yield from _efficiency(summary.get('efficiency', {}))
    yield from _coverage(summary.get('coverage', {}))
    yield from _starts(summary.get('starts', {}))
    yield from _outliers(summary.get('outliers', {}))
    yield from ('', 'Targets', '')
    for words, met in judge(summary):
        yield f'{"met   " if met else "MISSED"} {words}'


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
    yield 'the twelve; size: distance from the model in standard deviations; lost: good touches rejected'
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

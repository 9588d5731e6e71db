"""The result of dial gauge experiments as sentences and tables, for a terminal and for the page."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.report.quantities import chance, decimals, p_equals
from scara_kinetostatic.report.table import NOT_DETERMINED, Table
from scara_kinetostatic.studies.dial_gauge.loop_analysis import Sense
from scara_kinetostatic.studies.dial_gauge.readings import GRIPPER
from scara_kinetostatic.studies.dial_gauge.result import DirectionMap, Part, PointAnalysis, Run
from scara_kinetostatic.studies.dial_gauge.statistics import FALSE_ALARM_LEVEL, CombinedEstimate, Estimate

TITLES = {'gripper': 'Gripper', 'joint1': 'Joint 1', 'joint2': 'Joint 2'}


def with_std(estimate: Estimate, factor: float = 1e6) -> str:
    """Value ± one standard deviation, with the digits that the latter allows; `factor`: displayed units per SI unit."""
    digits = decimals(estimate.std * factor)
    if digits is None:
        return f'{estimate.value * factor:.6g}'
    return f'{estimate.value * factor:.{digits}f} ± {estimate.std * factor:.{digits}f}'


def _short(value: float) -> str:
    """Two digits, without an exponent where it can be."""
    return f'{float(f"{value:.2g}"):g}'


def _test(test: CombinedEstimate) -> str:
    degrees = f'{test.degrees_of_freedom} degrees of freedom'
    return f'χ² = {test.chi_square:.1f} with {degrees}, {p_equals(test.p_value)}'


def summary_table(analysis: PointAnalysis) -> Table:
    """One row per part: compliance, gap, half gap."""
    rows = []
    for part in analysis.parts:
        unit = ('µm/N', 'µm') if part.name == GRIPPER else ('µrad/Nm', 'µrad')
        values = (with_std(part.compliance), unit[0], with_std(part.gap), with_std(part.half_gap), unit[1])
        rows.append((TITLES[part.name], str(len(part.runs)), *values))
    return Table(('part', 'runs', 'compliance', '', 'gap', 'half gap g', ''), ('',) * 7, tuple(rows))


def run_table(part: Part) -> Table:
    """One row per run."""
    unit = ('µm/N', 'µm') if part.name == GRIPPER else ('µrad/Nm', 'µrad')
    heading = ('direction', 'compliance', 'gap', 'half gap g', 'reading σ', 'rows', 'checks')
    rows = tuple(_run_row(run) for run in part.runs)
    return Table(heading, ('deg', unit[0], unit[1], unit[1], 'µm', '', ''), rows)


def _run_row(run: Run) -> tuple[str, ...]:
    direction = NOT_DETERMINED if np.isnan(run.direction) else f'{np.degrees(run.direction):.5g}'
    return (
        direction,
        with_std(run.compliance),
        with_std(run.gap),
        with_std(run.half_gap),
        f'{1e6 * run.fit.sigma:.2f}',
        f'{int(run.fit.used.sum())}',
        ', '.join(check.name.replace('_', ' ') for check in run.failed_checks) or 'ok',
    )


def map_sentences(part: Part) -> list[str]:
    """Whether compliance and gap are isotropic."""
    found = []
    for what, unit, each in (('compliance', 'µm/N', part.compliance_map), ('gap', 'µm', part.gap_map)):
        if each is not None:
            found.append(_map_sentence(what, unit, each))
    return found


def _map_sentence(what: str, unit: str, each: DirectionMap) -> str:
    test = each.isotropy
    numbers = _test(test)
    if test.p_value >= FALSE_ALARM_LEVEL:
        return f'The {what} is equal in all directions within its uncertainty ({numbers}).'
    text = f'The {what} depends on the direction ({numbers}): '
    text += f'{1e6 * each.value.min():.4g} … {1e6 * each.value.max():.4g} {unit}'
    if each.ellipse is not None:
        ellipse = each.ellipse
        axis = with_std(ellipse.axis, 180 / np.pi)
        fits = '' if np.isnan(ellipse.p_value) else f', p = {chance(ellipse.p_value)}'
        limits = f'{with_std(ellipse.minor)} to {with_std(ellipse.major)} {unit}'
        text += f'; ellipse from {limits}, largest at {axis} deg{fits}'
    return text + '.'


def reversal_table(sense: Sense) -> Table:
    """One row per reversal."""
    rows = tuple(
        (
            f'{each.time:.2f}',
            f'{1e3 * each.displacement:.2f}',
            f'{1e3 * each.speed:.1f}',
            with_std(each.gap),
            with_std(each.compliance, 1e9),
            with_std(each.unloading, 1e9),
            f'{each.samples[0]} + {each.samples[1]}',
        )
        for each in sense.reversals
    )
    heading = ('time', 'at', 'speed', 'gap', 'compliance', 'before the gap', 'samples')
    return Table(heading, ('s', 'mm', 'mm/s', 'µm', 'nm/N', 'nm/N', ''), rows)


def sense_sentences(sense: Sense) -> list[str]:
    """Mean, consistency, repeatability and definitional uncertainty of gap and compliance."""
    found = []
    for place, (what, unit, factor, test) in enumerate(
        (('gap', 'µm', 1e6, sense.gap), ('compliance', 'nm/N', 1e9, sense.compliance))
    ):
        if test is None:
            continue
        found.append(_agreement_sentence(what, unit, factor, test))
        extra = []
        if np.isfinite(sense.repeatability[place]):
            extra.append(f'repeatability at the same place {_short(factor * sense.repeatability[place])} {unit}')
        if np.isfinite(sense.definitional_uncertainty[place]):
            half = f'{_short(factor * sense.definitional_uncertainty[place])} {unit}'
            extra.append(f'definitional uncertainty ± {half} (choice of the straight part of the branches)')
        if extra:
            found.append(f'{what.capitalize()}: {", ".join(extra)}.')
    return found


def _agreement_sentence(what: str, unit: str, factor: float, test: CombinedEstimate) -> str:
    mean = f'{what.capitalize()} {with_std(Estimate(test.mean, test.std), factor)} {unit}'
    numbers = _test(test)
    if test.p_value >= FALSE_ALARM_LEVEL:
        return f'{mean}: the reversals are consistent ({numbers}).'
    between = f'{_short(factor * test.between)} {unit}'
    return f'{mean}: the reversals are inconsistent ({numbers}); standard deviation between them {between}.'


def level_sentence(sense: Sense) -> str:
    """Forces inside the gap and at the plateau."""
    return f'Force inside the gap {sense.level:.0f} N, at the plateau {sense.plateau:.0f} N.'

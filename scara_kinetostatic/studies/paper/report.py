"""Results of the reproduction: `paper.json`, and `paper.html` with figures and tables of the paper beside ours."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import MaxNLocator

from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, PAPER_NOMINAL, Parameters
from scara_kinetostatic.report import Block, Document, Figure, Note, Report, Section, Table, Verdict
from scara_kinetostatic.report.figure import FAINT, INK, LINE, PAPER, SERIES, as_svg, new_figure
from scara_kinetostatic.report.quantities import SCALES
from scara_kinetostatic.studies.loops.report import TITLES, dial_gauge_document, part_figures, summary_table
from scara_kinetostatic.studies.paper.study import (
    ESTIMATED,
    ESTIMATED_FROM_NOISE,
    FORCE,
    FORCE_ERROR,
    FORCE_ERROR_FROM_NOISE,
    NOISE,
    Reproduction,
    Run,
    determined_combination,
)


def paper_document(r: Reproduction) -> Document:
    """The document."""
    scatters = {}
    for name, scatter in r.monte_carlo.items():
        named = {key: _named(getattr(scatter, key)) for key in ('predicted', 'found')}
        scatters[name] = scatter._asdict() | named
    return {
        'schema': 'scara_kinetostatic/paper/1',
        'actual': PAPER_ACTUAL.as_dict(),
        'paper': {'estimated': ESTIMATED.as_dict(), 'estimated_from_noise': ESTIMATED_FROM_NOISE.as_dict()},
        'one_level': _run(r.exact),
        'three_levels': _run(r.exact_levels),
        'noisy': {'noise': {'joint': NOISE.joint_rms, 'force': NOISE.force_rms}, **_run(r.noisy)},
        'monte_carlo': scatters,
        'dial_gauge': dial_gauge_document(r.dial_gauge),
    }


def _run(run: Run) -> Document:
    found: Document = {
        name: {'parameters': fit.parameters.as_dict(), 'force_error': fit.force_error, 'iterations': fit.iterations}
        for name, fit in (('paper_algorithm', run.paper), ('weighted', run.weighted))
    }
    identifiability = run.weighted.identifiability
    found['paper_algorithm'] |= {'history': run.paper.history, 'rank': run.paper.rank}
    found['weighted'] |= {'rank': identifiability.rank, 'confounded': identifiability.confounded}
    return found


def _named(values: Any) -> dict[str, float]:
    return dict(zip(NAMES, np.asarray(values).tolist(), strict=True))


def trend_picture(r: Reproduction) -> Markup:
    """e_f over the iterations (figure 3), one force level and three."""
    figure, (axes,) = new_figure(920, 330)
    lines = (
        (r.exact.paper.history, SERIES[0], 'o', '-', 'one level, unilateral contact (10)'),
        (r.exact.paper.merit, SERIES[0], '', ':', 'the same, two-sided contact'),
        (r.exact_levels.paper.history, SERIES[1], 's', '-', 'three levels, unilateral contact'),
    )
    for values, colour, shape, dash, label in lines:
        shown = np.maximum(values, 1e-13)
        axes.plot(np.arange(len(shown)), shown, dash, marker=shape or None, ms=5, color=colour, label=label)
    axes.axhline(FORCE_ERROR, color=FAINT, lw=1, ls='--')
    axes.text(0.05, FORCE_ERROR * 1.6, f'the paper: {FORCE_ERROR:.3g} N at its end', color=FAINT)
    axes.set(yscale='log', xlabel='iteration', ylabel='force error $e_f$  [N]')
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(frameon=False, loc='lower left')
    axes.set_xlim(left=-0.2)
    return as_svg(figure, 'trend', 'force error over the iterations of the algorithm of the paper')


def unidentifiable_picture(r: Reproduction) -> Markup:
    """The plane of p_ee and g_ee: one force level determines only a linear combination."""
    figure, (axes,) = new_figure(450, 380)
    p = np.array([0.75e-5, 1.75e-5])
    truth = determined_combination(PAPER_ACTUAL.as_array())
    axes.plot(1e6 * p, 1e6 * (FORCE * p - truth), color=FAINT, lw=1)
    axes.annotate(
        '40 $p_{ee}$ − $g_{ee}$ = 345 µm', (13.4, 1e6 * (FORCE * 13.4e-6 - truth)), (13.2, 60), color=FAINT,
        arrowprops={'arrowstyle': '-', 'color': LINE},
    )  # fmt: skip
    points = (
        (PAPER_NOMINAL, 'nominal', FAINT, 'o', (6, -14)),
        (PAPER_ACTUAL, 'actual', INK, 'o', (-8, 10)),
        (ESTIMATED, 'paper, without noise', SERIES[1], 's', (8, -4)),
        (ESTIMATED_FROM_NOISE, 'paper, with noise', SERIES[1], '^', (-112, 2)),
        (r.exact.weighted.parameters, 'weighted, nearest to nominal', SERIES[0], 'D', (6, 8)),
    )
    for values, label, colour, shape, offset in points:
        x, y = 1e6 * values.p_ee, 1e6 * values.g_ee
        axes.plot([x], [y], shape, ms=6, color=colour, mec=PAPER, mew=0.6)
        axes.annotate(label, (x, y), offset, textcoords='offset points', color=colour, fontsize=11)
    axes.set(xlabel='$p_{ee}$  [µm/N]', ylabel='$g_{ee}$  [µm]', xlim=(7.5, 17.5), ylim=(-40, 340))
    return as_svg(figure, 'unidentifiable', 'estimates of p_ee and g_ee lie on one line')


def scatter_picture(r: Reproduction) -> Markup:
    """Standard deviation found over that predicted, parameter by parameter, both estimators."""
    figure, (axes,) = new_figure(920, 300)
    place, scatter = np.arange(len(NAMES)), r.monte_carlo
    error = 1 / np.sqrt(2 * (scatter['paper'].runs - 1))  # relative standard deviation of a standard deviation found
    axes.axhspan(1 - 2 * error, 1 + 2 * error, color=FAINT, alpha=0.15, lw=0)
    axes.axhline(1, color=FAINT, lw=0.9)
    paper, weighted = (SERIES[1], 's', -0.1, 'unweighted (the paper)'), (SERIES[0], 'o', 0.1, 'weighted')
    for item, (colour, shape, shift, label) in ((scatter['paper'], paper), (scatter['weighted'], weighted)):
        axes.plot(place + shift, item.found / item.predicted, shape, color=colour, ms=6, label=label)
    axes.set_xticks(place, NAMES)
    axes.set(ylabel='std found / predicted', ylim=(0.88, 1.12))
    axes.grid(visible=False, axis='x')
    axes.legend(frameon=False, loc='upper right', ncols=2)
    return as_svg(figure, 'scatter', 'standard deviation of the estimates found over that predicted')


def paper_report(r: Reproduction) -> Report:
    """The page: tables and figures of the paper beside those computed here."""
    reached = (
        'Without noise both estimators reach the true parameters to rounding error, '
        f'{r.exact.paper.force_error:.0e} N against {FORCE_ERROR:.1e} N in the paper. Where numbers differ, the reason '
        'is given with them.'
    )
    source = (
        'Reproduction of sections 4 and 5 of the paper. All data on this page are simulated; values that the paper '
        'prints are marked as printed.'
    )
    return Report(
        title='Kinetostatic calibration of a SCARA robot',
        source=source,
        answer=Verdict('Table 2, figure 3 and figure 4 are reproduced', 'good', (reached,)),
        blocks=(*_estimates(r), *_deviations(r), *_experiments(r)),
        footer='all numbers in full in paper.json',
    )


def _estimates(r: Reproduction) -> tuple[Section, ...]:
    cell = (
        'The cell of figure 3, 12 points on each of three discs, 40 N, no noise; the steps are those of equations (12) '
        'to (14), bounded and shortened as in section 4.3.'
    )
    trend = (
        'Of the printed curve only the last value is known as a number. Here the error is at rounding level after '
        f'{r.exact.paper.iterations} steps; in the paper it is 4.5e-5 N after about 30. The weighted estimate takes '
        f'{r.exact.weighted.iterations} iterations.'
    )
    start = (
        'At the nominal parameters the tip misses most discs by more than its whole deflection: there A = 0 and '
        '∂A/∂L̄ = 0, and (12) defines no step. The paper does not say how it starts. Here the touches, which are known '
        'to be contacts, are predicted with a two-sided contact (dotted), which equals A wherever the tip presses.'
    )
    printed = (PAPER_ACTUAL, ESTIMATED, ESTIMATED_FROM_NOISE)
    combinations = ', '.join(f'{1e6 * determined_combination(values.as_array()):.2f}' for values in printed)
    line = (
        f'With one force level the columns of J_L̄ for p_ee and g_ee are proportional, rank {r.exact.paper.rank}: all '
        'points of the line fit equally well. The three printed columns have '
        f'40 p_ee − g_ee = {combinations} µm. With three force levels the rank is 12, and all are determined.'
    )
    return (
        Section(
            'Figure 3: the force error over the iterations', (cell, Figure(partial(trend_picture, r), trend), start)
        ),
        Section('Table 2', (*_table_2(r), Figure(partial(unidentifiable_picture, r), line))),
    )


def _deviations(r: Reproduction) -> tuple[Section, ...]:
    scatter = r.monte_carlo['paper']
    low, high = scatter.force_error_range
    sets = (
        f'{scatter.runs} data sets at three force levels, each estimated by both algorithms. The prediction is '
        'J⁺ (Σ_F + A_Q Σ_Q A_Qᵀ) J⁺ᵀ for the paper’s unweighted estimator, and the Cramér–Rao bound for the weighted '
        'one.'
    )
    errors = (
        f'e_f of the paper’s estimator: mean {scatter.force_error:.2f} N, 95 % of the data sets between {low:.2f} and '
        f'{high:.2f} N; the paper states 1.25 to 1.35 N.'
    )
    found = Figure(partial(scatter_picture, r), 'Grey: two standard deviations of the sampling error.')
    return (Section('Are the standard deviations as predicted?', (sets, found, errors)),)


def _experiments(r: Reproduction) -> tuple[Section, ...]:
    simulated = (
        'Simulated with the values of figure 4(d) and the anisotropic backlash of figure 4(c), 2 µm gauge noise, loads '
        'up to 40 N in both senses, three cycles; analysed as the verb dial-gauge analyses measured readings.'
    )
    measured = Note(
        'Figure 4(d), measured by the authors: gripper 37.6 µm/N and 54.9 to 205 µm over the directions; joint 1 '
        '32.3 µrad/Nm and 264 µrad; joint 2 108 µrad/Nm and 268 µrad.'
    )
    own = (Section(TITLES[part.name], part_figures(part)) for part in r.dial_gauge.parts.values())
    experiments: tuple[Block, ...] = (simulated, summary_table(r.dial_gauge), measured, *own)
    return (Section('Section 5.2, figure 4: the dial gauge experiments', experiments),)


def _table_2(r: Reproduction) -> tuple[Table | Note, ...]:
    """Without noise and with it: one row per parameter and one for e_f."""
    one, three, noisy = r.exact, r.exact_levels, r.noisy
    columns: dict[str, tuple[Parameters, float | None]] = {
        'actual': (PAPER_ACTUAL, None),
        'printed': (ESTIMATED, FORCE_ERROR),
        '(12)–(14), one level': (one.paper.parameters, one.paper.force_error),
        'weighted, one level': (one.weighted.parameters, one.weighted.force_error),
        'weighted, three levels': (three.weighted.parameters, three.weighted.force_error),
        'printed, with noise': (ESTIMATED_FROM_NOISE, FORCE_ERROR_FROM_NOISE),
        '(12)–(14), with noise': (noisy.paper.parameters, noisy.paper.force_error),
        'weighted, with noise': (noisy.weighted.parameters, noisy.weighted.force_error),
    }
    rows = []
    for name, (unit, per_si) in list(SCALES.items())[: len(NAMES)]:
        shown = (f'{per_si * getattr(values, name):#.7g}' for values, _ in columns.values())
        rows.append((name, unit, *shown, f'{per_si * noisy.weighted.std_of(name):.2g}'))
    errors = ('' if error is None else f'{error:.3e}' for _, error in columns.values())
    note = (
        'With one force level only 40 p_ee − g_ee is determined. Two data sets with noise: the printed column, and one '
        f'simulated at three force levels (10, 20, 40 N) with σ_q = {1e6 * NOISE.joint_rms:.1f} µrad and '
        f'σ_f = {NOISE.force_rms:.2f} N.'
    )
    heading = ('parameter', 'unit', *columns, 'its std')
    return Table(heading, ('',) * len(heading), (*rows, ('e_f', 'N', *errors, ''))), Note(note)

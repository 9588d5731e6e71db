"""Results of the reproduction: `paper.json`, and `paper.html` with figures and tables of the paper beside ours."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import MaxNLocator

from scara_kinetostatic import __version__
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, PAPER_NOMINAL, UNITS, Parameters
from scara_kinetostatic.report.figure import FAINT, INK, LINE, PAPER, SERIES, as_svg, new_figure, style
from scara_kinetostatic.report.page import page_template
from scara_kinetostatic.report.table import Table
from scara_kinetostatic.studies.design import figures as design_figures
from scara_kinetostatic.studies.design import report as design_text
from scara_kinetostatic.studies.design.optimal_design import Design
from scara_kinetostatic.studies.dial_gauge.document import dial_gauge_document
from scara_kinetostatic.studies.dial_gauge.page import part_section
from scara_kinetostatic.studies.dial_gauge.text import summary_table
from scara_kinetostatic.studies.paper.monte_carlo import Scatter
from scara_kinetostatic.studies.paper.study import Reproduction
from scara_kinetostatic.studies.paper.table_2 import (
    ESTIMATED,
    ESTIMATED_FROM_NOISE,
    FORCE,
    FORCE_ERROR,
    FORCE_ERROR_FROM_NOISE,
    FORCE_ERROR_RANGE,
    Run,
    determined_combination,
    expected_force_error,
)


def paper_document(r: Reproduction) -> dict[str, Any]:
    """The document."""
    return {
        'schema': 'scara_kinetostatic/paper/1',
        'actual': PAPER_ACTUAL.as_dict(),
        'paper': {'estimated': ESTIMATED.as_dict(), 'estimated_from_noise': ESTIMATED_FROM_NOISE.as_dict()},
        'one_level': _run(r.exact),
        'three_levels': _run(r.exact_levels),
        'noise_of_table_2': [
            {
                'joint': study.noise.joint_rms,
                'force': study.noise.force_rms,
                'force_error': study.force_error,
                'force_error_std': study.force_error_std,
                'z': _named(study.z),
                'chi_square': study.chi_square,
                'degrees_of_freedom': study.rank,
            }
            for study in r.noises
        ],
        'noisy': {'noise': {'joint': r.noise.joint_rms, 'force': r.noise.force_rms}, **_run(r.noisy)},
        'monte_carlo': {'paper': _scatter(r.monte_carlo.paper), 'weighted': _scatter(r.monte_carlo.weighted)},
        'gripper': [
            {
                'part': part.name,
                'explained_by_base_model': part.explained,
                'std': part.std if np.isfinite(part.std) else None,
                'biases': part.biases,
            }
            for part in r.gripper
        ],
        'dial_gauge': dial_gauge_document(r.dial_gauge),
    }


def _run(run: Run) -> dict[str, Any]:
    paper, weighted = run.paper, run.weighted
    return {
        'paper_algorithm': {
            'parameters': paper.parameters.as_dict(),
            'force_error': paper.force_error,
            'iterations': paper.iterations,
            'history': list(paper.history),
            'rank': paper.rank,
        },
        'weighted': {
            'parameters': weighted.parameters.as_dict(),
            'force_error': weighted.force_error,
            'iterations': weighted.iterations,
            'rank': weighted.identifiability.rank,
            'confounded': [list(group) for group in weighted.identifiability.confounded],
        },
    }


def _scatter(scatter: Scatter) -> dict[str, Any]:
    return {
        'runs': scatter.runs,
        'predicted': _named(scatter.predicted),
        'found': _named(scatter.found),
        'bias': _named(scatter.bias),
        'force_error': scatter.force_error,
        'force_error_range': list(scatter.force_error_range),
    }


def _named(values: Any) -> dict[str, float]:
    return dict(zip(NAMES, np.asarray(values).tolist(), strict=True))


WIDTH, HALF = 920.0, 450.0
_SMALLEST = 1e-13


def trend_picture(r: Reproduction) -> Markup:
    """e_f over the iterations (figure 3), one force level and three."""
    figure, (axes,) = new_figure(WIDTH, 330)
    lines = (
        (r.exact.paper.history, SERIES[0], 'o', '-', 'one level, unilateral contact (10)'),
        (r.exact.paper.merit, SERIES[0], '', ':', 'the same, two-sided contact'),
        (r.exact_levels.paper.history, SERIES[1], 's', '-', 'three levels, unilateral contact'),
    )
    for values, colour, shape, dash, label in lines:
        shown = np.maximum(values, _SMALLEST)
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
    figure, (axes,) = new_figure(HALF, 380)
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


def noise_picture(r: Reproduction) -> Markup:
    """Noise of joints and forces for which e_f is that of the paper, one force level."""
    figure, (axes,) = new_figure(HALF, 380)
    ratios = np.concatenate([[0.0], np.logspace(-6.5, -2, 19), [1e3]])
    units = np.array([expected_force_error(r.one_level, Noise(ratio, 1.0))[0] for ratio in ratios])
    low, high = ((ratios * level / units, level / units) for level in FORCE_ERROR_RANGE)
    ring = [np.concatenate([a, b[::-1]]) for a, b in zip(low, high, strict=True)]
    axes.fill(1e6 * ring[0], ring[1], color=SERIES[0], alpha=0.25, lw=0)
    axes.annotate(
        '$e_f$ = 1.25 … 1.35 N', (1e6 * low[0][13], high[1][13]), (12, 0.35), color=SERIES[0],
        arrowprops={'arrowstyle': '-', 'color': LINE},
    )  # fmt: skip
    axes.plot([1e6 * r.noise.joint_rms], [r.noise.force_rms], 'o', color=SERIES[1], ms=6)
    axes.annotate('used', (1e6 * r.noise.joint_rms, r.noise.force_rms), (-42, -4), textcoords='offset points',
                  color=SERIES[1])  # fmt: skip
    axes.set(xlabel='noise of a joint angle  [µrad]', ylabel='noise of a force component  [N]')
    axes.set_xlim(0, 65)
    axes.set_ylim(0, 1.3)
    return as_svg(figure, 'noise', 'joint and force noise that lead to the force error of the paper')


def scatter_picture(r: Reproduction) -> Markup:
    """Standard deviation found over that predicted, parameter by parameter, both estimators."""
    figure, (axes,) = new_figure(WIDTH, 300)
    place = np.arange(len(NAMES))
    error = r.monte_carlo.weighted.sampling_error
    axes.axhspan(1 - 2 * error, 1 + 2 * error, color=FAINT, alpha=0.15, lw=0)
    axes.axhline(1, color=FAINT, lw=0.9)
    for item, colour, shape, shift, label in (
        (r.monte_carlo.paper, SERIES[1], 's', -0.1, 'unweighted (the paper)'),
        (r.monte_carlo.weighted, SERIES[0], 'o', 0.1, 'weighted'),
    ):
        axes.plot(place + shift, item.found / item.predicted, shape, color=colour, ms=6, label=label)
    axes.set_xticks(place, NAMES)
    axes.set(ylabel='std found / predicted', ylim=(0.88, 1.12))
    axes.grid(visible=False, axis='x')
    axes.legend(frameon=False, loc='upper right', ncols=2)
    return as_svg(figure, 'scatter', 'standard deviation of the estimates found over that predicted')


def efficiency_picture(r: Reproduction) -> Markup:
    """Standard deviation of the weighted over the unweighted estimate."""
    figure, (axes,) = new_figure(WIDTH, 230)
    place = np.arange(len(NAMES))
    predicted = r.monte_carlo.weighted.predicted / r.monte_carlo.paper.predicted
    axes.bar(place, predicted, width=0.55, color=SERIES[0], alpha=0.3, label='predicted')
    axes.plot(place, np.sqrt(r.monte_carlo.efficiency), 'o', color=SERIES[0], ms=6, label='found')
    axes.axhline(1, color=FAINT, lw=0.9)
    axes.set_xticks(place, NAMES)
    axes.set(ylabel='std weighted / unweighted', ylim=(0.6, 1.1))
    axes.grid(visible=False, axis='x')
    axes.legend(frameon=False, loc='upper right', ncols=2)
    return as_svg(figure, 'efficiency', 'standard deviation of the weighted over the unweighted estimate')


_TEMPLATE = Path(__file__).parent / 'page.html.j2'


class _Column(NamedTuple):
    """One column of table 2; `one_level` where only a combination of p_ee and g_ee is determined."""

    heading: str
    parameters: Parameters
    force_error: float | None = None
    one_level: bool = False


def html_text(r: Reproduction) -> str:
    """The page."""
    points = r.dial_gauge.points
    assert points is not None
    with style():
        pictures = {name: draw(r) for name, draw in _PICTURES.items()}
        design = _design(r.design) if r.design else None
        parts = [part_section(part) for part in points.parts]
    printed = (PAPER_ACTUAL, ESTIMATED, ESTIMATED_FROM_NOISE)
    return page_template(_TEMPLATE).render(
        r=r,
        version=__version__,
        pictures=pictures,
        without_noise=_without_noise(r),
        with_noise=_with_noise(r),
        noises=_noise_table(r),
        monte_carlo=_monte_carlo_table(r),
        gripper=_gripper_table(r),
        design=design,
        dial_gauge_summary=summary_table(points),
        dial_gauge_parts=parts,
        combinations=[f'{1e6 * determined_combination(p.as_array()):.2f}' for p in printed],
        force_error=FORCE_ERROR,
    )


def _table_2(columns: Sequence[_Column]) -> Table:
    """One row per parameter and one for e_f; in brackets what one force level does not determine."""
    rows = []
    for name in NAMES:
        texts = [f'{getattr(column.parameters, name):.6e}' for column in columns]
        shown = [
            f'({text})' if column.one_level and name in ('p_ee', 'g_ee') else text
            for text, column in zip(texts, columns, strict=True)
        ]
        rows.append((name, UNITS[name], *shown))
    errors = ('' if column.force_error is None else f'{column.force_error:.3e}' for column in columns)
    heading = ('parameter', 'unit', *(column.heading for column in columns))
    return Table(heading, ('',) * len(heading), (*rows, ('e_f', 'N', *errors)))


def _without_noise(r: Reproduction) -> Table:
    one, three = r.exact, r.exact_levels
    return _table_2(
        [
            _Column('actual', PAPER_ACTUAL),
            _Column('printed', ESTIMATED, FORCE_ERROR),
            _Column('(12)–(14), one level', one.paper.parameters, one.paper.force_error, one_level=True),
            _Column('weighted, one level', one.weighted.parameters, one.weighted.force_error, one_level=True),
            _Column('weighted, three levels', three.weighted.parameters, three.weighted.force_error),
        ]
    )


def _with_noise(r: Reproduction) -> Table:
    noisy = r.noisy
    table = _table_2(
        [
            _Column('actual', PAPER_ACTUAL),
            _Column('printed', ESTIMATED_FROM_NOISE, FORCE_ERROR_FROM_NOISE),
            _Column('(12)–(14)', noisy.paper.parameters, noisy.paper.force_error),
            _Column('weighted', noisy.weighted.parameters, noisy.weighted.force_error),
        ]
    )
    std = (f'{noisy.weighted.std_of(name):.1e}' for name in NAMES)
    rows = tuple((*row, text) for row, text in zip(table.rows, (*std, ''), strict=True))
    return Table((*table.heading, 'std'), (*table.units, ''), rows)


def _noise_table(r: Reproduction) -> Table:
    """σ_q, σ_f, e_f ± standard deviation, largest |z| of the paper's noisy column, its chi-square."""
    rows = tuple(
        (
            f'{1e6 * study.noise.joint_rms:.1f}',
            f'{study.noise.force_rms:.3f}',
            f'{study.force_error:.2f} ± {study.force_error_std:.2f}',
            f'{np.abs(study.z).max():.1f}',
            NAMES[int(np.abs(study.z).argmax())],
            f'{study.chi_square:.0f} / {study.rank}',
        )
        for study in r.noises
    )
    heading = ('σ_q', 'σ_f', 'e_f', 'largest single deviation', 'of', 'χ² / degrees of freedom')
    return Table(heading, ('µrad', 'N', 'N', 'σ', '', ''), rows)


def _monte_carlo_table(r: Reproduction) -> Table:
    """Standard deviations of both estimators, predicted and found, and the ratio of those found."""
    s = r.monte_carlo
    rows = tuple(
        (
            name,
            UNITS[name],
            *(f'{value:.3e}' for item in (s.paper, s.weighted) for value in (item.predicted[j], item.found[j])),
            f'{np.sqrt(s.efficiency[j]):.3f}',
        )
        for j, name in enumerate(NAMES)
    )
    heading = ('parameter', 'unit', 'unweighted: predicted', 'found', 'weighted: predicted', 'found', 'ratio found')
    return Table(heading, ('',) * len(heading), rows)


def _gripper_table(r: Reproduction) -> Table:
    """Identifiability of each part of P."""
    rows = tuple(
        (
            part.name,
            f'{100 * part.explained:.1f}',
            f'{part.std:.1e}' if np.isfinite(part.std) else 'not determined',
            ', '.join(f'{value:+.3g} in {name}' for name, value in part.biases.items()) or 'none',
        )
        for part in r.gripper
    )
    heading = ('part of P', 'explained by the twelve parameters', 'standard deviation', 'bias per unit, if ignored')
    return Table(heading, ('', '%', 'm/N', ''), rows)


def _design(design: Design) -> dict[str, Any]:
    """Headline, sentences and figures of the optimal design; the rest is in `design.html`."""
    sentences = [*design_text.set_sentences(design), *design_text.disc_sentences(design)]
    return {
        'headline': design_text.headline(design),
        'requirement': design_text.requirement(design),
        'sentences': sentences,
        'number': design_figures.number_picture(design),
        'tip': design_figures.tip_picture(design),
    }


_PICTURES = {
    'trend': trend_picture,
    'unidentifiable': unidentifiable_picture,
    'noise': noise_picture,
    'scatter': scatter_picture,
    'efficiency': efficiency_picture,
}

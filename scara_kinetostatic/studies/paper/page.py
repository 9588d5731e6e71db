"""`paper.html`: figures and tables of the paper beside the reproduced ones, with the reasons for differences."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic import __version__
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, UNITS, Parameters
from scara_kinetostatic.report.figure import style
from scara_kinetostatic.report.page import page_template
from scara_kinetostatic.report.table import Table
from scara_kinetostatic.studies.design import figures as design_figures
from scara_kinetostatic.studies.design import report as design_text
from scara_kinetostatic.studies.design.optimal_design import Design
from scara_kinetostatic.studies.dial_gauge.page import part_section
from scara_kinetostatic.studies.dial_gauge.text import summary_table
from scara_kinetostatic.studies.paper import figures
from scara_kinetostatic.studies.paper.study import Reproduction
from scara_kinetostatic.studies.paper.table_2 import (
    ESTIMATED,
    ESTIMATED_FROM_NOISE,
    FORCE_ERROR,
    FORCE_ERROR_FROM_NOISE,
    determined_combination,
)

NAME = 'paper.html'
_TEMPLATE = Path(__file__).parent / 'page.html.j2'
_PICTURES = ('trend', 'unidentifiable', 'noise', 'scatter', 'efficiency')


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
        pictures = {name: getattr(figures, f'{name}_picture')(r) for name in _PICTURES}
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

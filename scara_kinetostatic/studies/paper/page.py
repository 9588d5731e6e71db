"""`paper.html`: the paper's figures and tables beside ours, with the reason wherever they differ."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic import __version__
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, UNITS, Parameters
from scara_kinetostatic.render.figure import style
from scara_kinetostatic.render.page import page_template
from scara_kinetostatic.studies.design import figures as design_pictures
from scara_kinetostatic.studies.design import text as design_text
from scara_kinetostatic.studies.design.result import Design
from scara_kinetostatic.studies.dial_gauge import page as gauge_html
from scara_kinetostatic.studies.paper import figures as paper_pictures
from scara_kinetostatic.studies.paper.reproduction import Reproduction
from scara_kinetostatic.studies.paper.section_5_1 import (
    ESTIMATED,
    ESTIMATED_FROM_NOISE,
    FORCE_ERROR,
    FORCE_ERROR_FROM_NOISE,
    fixed_sum,
)

NAME = 'paper.html'
_TEMPLATE = Path(__file__).parent / 'page.html.j2'


class Column(NamedTuple):
    """One column of table 2; `one_level` where p_ee and g_ee are only one of many pairs."""

    parameters: Parameters
    force_error: float | None = None
    one_level: bool = False


PICTURES = ('trend', 'unidentifiable', 'noise', 'scatter', 'efficiency')


def html_text(r: Reproduction) -> str:
    """The page."""
    with style():
        pictures = {name: getattr(paper_pictures, f'{name}_picture')(r) for name in PICTURES}
    with style():
        question = _design(r.design) if r.design else None
    points = r.gauge.points
    assert points is not None
    with style():
        gauge = [gauge_html.part_section(part) for part in points.parts]
    return page_template(_TEMPLATE).render(
        r=r,
        version=__version__,
        pictures=pictures,
        without_noise=_without_noise(r),
        with_noise=_with_noise(r),
        noises=_noises(r),
        scatter=_scatter(r),
        gripper=_gripper(r),
        design=question,
        dial_gauge_summary=gauge_html.summary(points),
        gauge=gauge,
        sums=[f'{1e6 * fixed_sum(p.as_array()):.2f}' for p in (PAPER_ACTUAL, ESTIMATED, ESTIMATED_FROM_NOISE)],
        force_error=FORCE_ERROR,
    )


def _table2(columns: Sequence[Column]) -> list[list[str]]:
    """One row per parameter and one for e_f; in brackets what one force level does not determine."""
    rows = []
    for name in NAMES:
        texts = [f'{getattr(column.parameters, name):.6e}' for column in columns]
        shown = [
            f'({text})' if column.one_level and name in ('p_ee', 'g_ee') else text
            for text, column in zip(texts, columns, strict=True)
        ]
        rows.append([name, UNITS[name], *shown])
    return [
        *rows,
        ['e_f', 'N', *('' if column.force_error is None else f'{column.force_error:.3e}' for column in columns)],
    ]


def _without_noise(r: Reproduction) -> list[list[str]]:
    one, three = r.exact, r.exact_levels
    return _table2(
        [
            Column(PAPER_ACTUAL),
            Column(ESTIMATED, FORCE_ERROR),
            Column(one.paper.parameters, one.paper.force_error, one_level=True),
            Column(one.ours.parameters, one.ours.force_error, one_level=True),
            Column(three.ours.parameters, three.ours.force_error),
        ]
    )


def _with_noise(r: Reproduction) -> list[list[str]]:
    noisy = r.noisy
    rows = _table2(
        [
            Column(PAPER_ACTUAL),
            Column(ESTIMATED_FROM_NOISE, FORCE_ERROR_FROM_NOISE),
            Column(noisy.paper.parameters, noisy.paper.force_error),
            Column(noisy.ours.parameters, noisy.ours.force_error),
        ]
    )
    return [[*row, f'{noisy.ours.std_of(row[0]):.1e}' if row[0] in UNITS else ''] for row in rows]


def _noises(r: Reproduction) -> list[list[str]]:
    """σ_q, σ_f, e_f ± scatter, largest |z| of the paper's noisy column, its joint chi-square."""
    return [
        [
            f'{1e6 * study.noise.joint:.1f}',
            f'{study.noise.force:.3f}',
            f'{study.force_error:.2f} ± {study.force_error_std:.2f}',
            f'{np.abs(study.z).max():.1f} ({NAMES[int(np.abs(study.z).argmax())]})',
            f'{study.joint:.0f} / {study.rank}',
        ]
        for study in r.noises
    ]


def _scatter(r: Reproduction) -> list[list[str]]:
    """Per parameter: predicted and found, for both estimators, and the ratio of the standard deviations."""
    s = r.scatter
    return [
        [
            name,
            UNITS[name],
            *(f'{value:.3e}' for item in (s.paper, s.ours) for value in (item.predicted[j], item.found[j])),
            f'{np.sqrt(s.efficiency[j]):.3f}',
        ]
        for j, name in enumerate(NAMES)
    ]


def _gripper(r: Reproduction) -> list[dict[str, Any]]:
    """What of each part of P can be seen."""
    return [
        {
            'name': part.name,
            'hidden': f'{100 * part.hidden:.1f} %',
            'std': f'{part.std:.1e} m/N' if np.isfinite(part.std) else 'not visible',
            'absorbed': ', '.join(f'{value:+.3g} in {name}' for name, value in part.absorbed.items()) or 'nothing',
        }
        for part in r.gripper
    ]


def _design(design: Design) -> dict[str, Any]:
    """Headline, sentences and pictures of the design question; `design.html` holds the rest."""
    return {
        'headline': design_text.headline(design),
        'asked': design_text.asked(design),
        'sentences': [*design_text.choice_sentences(design.smallest, design), *design_text.disc_sentences(design)],
        'number': design_pictures.number_picture(design),
        'tip': design_pictures.tip_picture(design),
    }

"""`report.html`: one self-contained page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from scara_kinetostatic import __version__
from scara_kinetostatic.assessment.grade import Grade
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.report.figure import COLOURS, mark, style
from scara_kinetostatic.report.page import page_template
from scara_kinetostatic.report.quantities import PAGE_SCALES, count, unsigned_zero
from scara_kinetostatic.results import head, messages
from scara_kinetostatic.results.budget_table import parameter_budget, tip_budget, tip_sentences
from scara_kinetostatic.results.diagnosis_section import diagnosis_context
from scara_kinetostatic.results.figures import (
    cell_picture,
    correlation_picture,
    error_picture,
    quantile_picture,
    residual_picture,
)
from scara_kinetostatic.results.parameter_rows import parameter_rows
from scara_kinetostatic.results.tip_maps import maps_context

NAME = 'report.html'
_TEMPLATE = Path(__file__).parent / 'page.html.j2'


_LEVELS = {Grade.FIT: 'good', Grade.CAUTION: 'caution', Grade.UNFIT: 'bad'}
"""Colour of each grade, by the class of the stylesheet."""


def html_text(outcome: Outcome) -> str:
    """The page as HTML."""
    c, assessment = outcome.final, outcome.assessment
    with style():
        diagnosis = diagnosis_context(outcome)
        maps = maps_context(outcome)
        pictures = {
            'cell': cell_picture(c),
            'errors': error_picture(c),
            'residuals': residual_picture(c),
            'quantiles': quantile_picture(c),
            'correlations': correlation_picture(c),
            'uncertainty': maps.uncertainty,
            'deviation': maps.deviation,
        }
    determined, *combinations = (_plain(outcome, line) for line in messages.identifiability(outcome, PAGE_SCALES))
    return page_template(_TEMPLATE).render(
        outcome=outcome,
        c=c,
        version=__version__,
        entries=head.entries(outcome),
        recordings=head.recordings(outcome),
        answer=messages.ANSWERS[assessment.grade],
        level=_LEVELS[assessment.grade],
        reasons=[_plain(outcome, messages.sentence(text)) for text in assessment.reasons],
        actions=[_plain(outcome, messages.sentence(text)) for text in assessment.actions],
        numbers=head.numbers(outcome),
        verdict=messages.model_verdict(outcome),
        rows=parameter_rows(c, PAGE_SCALES),
        status={'estimated': '', 'fixed': 'fixed', 'confounded': 'not determined'},
        tip_budget=tip_budget(outcome),
        tip_sentences=tip_sentences(outcome),
        parameter_budget=parameter_budget(outcome),
        identifiability=[determined, *combinations],
        combinations=combinations,
        uncertainty_caption=maps.uncertainty_caption,
        deviation_caption=maps.deviation_caption,
        never_identifiable=messages.NEVER_IDENTIFIABLE,
        noise=messages.noise(outcome),
        fit_quality=messages.fit_quality(outcome),
        legend=_legend(c),
        used=int(c.used.sum()),
        iterations=count(c.iterations, 'solver iteration'),
        largest_force=f'{np.hypot(c.force[:, 0], c.force[:, 1]).max():.1f}',
        touches=_touches(c),
        pictures=pictures,
        **diagnosis,
    )


_BEFORE_UNIT = re.compile(r'(?<=\d) (?=(N|mm|µm|m|°|mrad|µrad|σ|%)(\b|\W|$))')


def _plain(outcome: Outcome, text: str) -> str:
    """A sentence of the page: parameters of effects by the plain name of the effect, numbers bound to their units."""
    for item in outcome.diagnosis.found:
        one = rf'{re.escape(item.effect.label)}\.\w+'
        parts = re.split(f'{one}(?:(?: and |, ){one})*', text)
        text = item.effect.title.join(parts)
    return _BEFORE_UNIT.sub('\u00a0', text)


def _legend(c: Calibration) -> list[tuple[str, str, str]]:
    """Sign, colour and name of each disc that was touched."""
    touched = sorted(set(c.touches.disc.tolist()))
    looks = [(mark(number), c.cell.discs[number].name) for number in touched]
    return [(look.sign, COLOURS[look.colour], name) for look, name in looks]


def _touches(c: Calibration) -> list[dict[str, Any]]:
    """The rows of the table of all touches."""
    t = c.touches
    magnitude = np.hypot(c.force[:, 0], c.force[:, 1])
    angle = np.degrees(np.arctan2(c.force[:, 1], c.force[:, 0]))
    residual = np.hypot(c.residual[:, 0], c.residual[:, 1])
    return [
        {
            'index': int(t.index[k]),
            'time': f'{t.time[k]:.1f}',
            'disc': c.cell.discs[t.disc[k]].name,
            'posture': 'left' if t.posture[k] > 0 else 'right',
            'force': f'{magnitude[k]:.2f}',
            'direction': unsigned_zero(f'{angle[k]:.1f}').replace('-', '−'),
            'residual': f'{residual[k]:.2f}',
            'distance': f'{c.standardized[k]:.1f}',
            'used': bool(c.used[k]),
        }
        for k in range(len(t))
    ]

"""`report.html`: one self-contained page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from scara_kinetostatic import __version__
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.render.figure import COLOURS, mark, style
from scara_kinetostatic.render.page import page_template
from scara_kinetostatic.render.quantities import count
from scara_kinetostatic.report import messages
from scara_kinetostatic.report.diagnosis_section import diagnosis_context
from scara_kinetostatic.report.figures import (
    cell_picture,
    correlation_picture,
    error_picture,
    quantile_picture,
    residual_picture,
)
from scara_kinetostatic.report.parameter_rows import STATUS, parameter_rows

NAME = 'report.html'
_TEMPLATE = Path(__file__).parent / 'page.html.j2'


def html_text(outcome: Outcome) -> str:
    """The page as HTML."""
    c = outcome.final
    with style():
        diagnosis = diagnosis_context(outcome)
        pictures = {
            'cell': cell_picture(c),
            'errors': error_picture(c),
            'residuals': residual_picture(c),
            'quantiles': quantile_picture(c),
            'correlations': correlation_picture(c),
        }
    return page_template(_TEMPLATE).render(
        outcome=outcome,
        c=c,
        version=__version__,
        verdict=messages.verdict(outcome),
        rows=parameter_rows(c),
        status=STATUS,
        facts=_facts(outcome),
        identifiability=messages.identifiability(outcome),
        never_identifiable=messages.NEVER_IDENTIFIABLE,
        noise=messages.noise(outcome),
        fit_quality=messages.fit_quality(outcome),
        legend=_legend(c),
        iterations=count(c.iterations, 'solver iteration'),
        largest_force=f'{np.hypot(c.force[:, 0], c.force[:, 1]).max():.1f}',
        touches=_touches(c),
        pictures=pictures,
        **diagnosis,
    )


def _facts(outcome: Outcome) -> list[tuple[str, str, str]]:
    """The four numbers at the top: value, unit, what it is."""
    c, compared = outcome.final, outcome.comparison
    base, extended = compared.base, compared.extended
    errors, held_out = [compared.nominal, base.force_error], [base.held_out]
    chi_square, steps = [base.reduced_chi_square], 'nominal → calibrated'
    if c is not outcome.calibration:
        errors, held_out = [*errors, extended.force_error], [*held_out, extended.held_out]
        chi_square, steps = [*chi_square, extended.reduced_chi_square], 'nominal → base model → extended'
    folds = outcome.extended_held_out.folds
    return [
        (' → '.join(f'{value:.3g}' for value in errors), 'N', f'mean force error, {steps}'),
        (' → '.join(f'{value:.3g}' for value in held_out), 'N', f'force error on held-out touches, {folds} folds'),
        (' → '.join(f'{value:.2f}' for value in chi_square), '', 'reduced chi-square, expected 1'),
        (f'{int(c.used.sum())} / {outcome.found}', '', 'touches used / found'),
    ]


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
            'direction': f'{angle[k]:.1f}',
            'residual': f'{residual[k]:.2f}',
            'distance': f'{c.standardized[k]:.1f}',
            'used': bool(c.used[k]),
        }
        for k in range(len(t))
    ]

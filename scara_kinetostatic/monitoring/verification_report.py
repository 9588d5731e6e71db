"""A verification as JSON, as text and as a page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from scara_kinetostatic import __version__
from scara_kinetostatic.model.quantity import quantity
from scara_kinetostatic.monitoring.acceptance import Outlying, Verification
from scara_kinetostatic.monitoring.comparison_report import explanation_document
from scara_kinetostatic.monitoring.hypotheses import change_title
from scara_kinetostatic.monitoring.page import LEVELS, Part, explanation_table, html_page
from scara_kinetostatic.monitoring.prediction_test import QUANTILE
from scara_kinetostatic.monitoring.sensitivity import POWER, Detectable
from scara_kinetostatic.render.figure import FAINT, INK, MICRO, WARN, as_svg, new_figure, style
from scara_kinetostatic.render.json_file import Document
from scara_kinetostatic.render.quantities import p_equals
from scara_kinetostatic.render.table import NOT_DETERMINED, Table
from scara_kinetostatic.report.document import utc
from scara_kinetostatic.report.messages import ANSWERS, sentence

_LISTED = 20
"""Outliers on the page."""
NAME, PAGE_NAME = 'verification.json', 'verification.html'
SCHEMA = 'scara_kinetostatic/verification/1'


def verification_document(v: Verification) -> Document:
    """All numbers; SI units."""
    return {
        'schema': SCHEMA,
        'version': __version__,
        'calibration': {'path': v.record.source, 'created': v.record.created, 'grade': v.record.arm.grade},
        'recordings': [
            {
                'path': item.path,
                'sha256': item.sha256,
                'start': None if item.start is None else utc(item.start),
                'part_of_calibration': item.path in v.seen,
            }
            for item in v.recordings
        ],
        'grade': v.assessment.grade.value,
        'reasons': list(v.assessment.reasons),
        'actions': list(v.assessment.actions),
        'tip_error': v.tip_error,
        'expected': v.expected,
        'nominal_tip_error': v.nominal_tip_error,
        'p_value': v.p_value,
        'without_outlying': {'p_value': v.others_p_value, 'tip_error': v.others_tip_error} if v.few_outlie else None,
        'chi_square': {
            'value': v.chi_square,
            'degrees_of_freedom': v.degrees_of_freedom,
            'quantile': v.quantile,
            'probability': QUANTILE,
        },
        'touches': {
            'used': v.touches,
            'of_the_calibration': v.repeated,
            'rejected': [{'index': item.index, 'reason': item.reason} for item in v.rejected],
            'outlying': [_outlying(item) for item in v.outlying],
            'index': v.numbers.tolist(),
            'tip_error': v.tip_errors.tolist(),
            'expected': v.expected_errors.tolist(),
        },
        'detectable': {d.name: _detectable(d) for d in v.detectable},
        'independent': not v.seen and not v.repeated,
        'part': explanation_document(v.ranking[0]) if v.ranking else None,
        'rivals': list(v.rivals),
        'remaining_p_value': v.remaining_p_value if v.ranking else None,
        'candidates': [explanation_document(item) for item in v.ranking],
        'warnings': list(v.warnings),
    }


def _detectable(item: Detectable) -> Document:
    seen = np.isfinite(item.change)
    return {'change': item.change if seen else None, 'unit': item.unit, 'tip': item.tip if seen else None}


def _outlying(item: Outlying) -> Document:
    return {'index': item.touch, **{name: getattr(item, name) for name in ('object', 'distance', 'tip_error')}}


def verification_text(v: Verification) -> str:
    """As text for a terminal."""
    a = v.assessment
    lines = [f'{ANSWERS[a.grade]}: {a.reasons[0]}.', *(f'  - {sentence(reason)}' for reason in a.reasons[1:])]
    lines += [f'  To do: {action}.' for action in a.actions]
    lines += ['', *summary_table(v).lines()[1:]]  # there is no heading
    if v.rivals:
        lines += ['', f'About as likely: {"; ".join(change_title(name) for name in v.rivals)}.']
    return '\n'.join([*lines, *(f'note: {warning}' for warning in v.warnings)])


def summary_table(v: Verification) -> Table:
    """The numbers of the verification."""
    rows = (
        ('touches', str(v.touches)),
        ('tip error, rms', quantity(v.tip_error, 'm')),
        ('expected from noise and uncertainty', quantity(v.expected, 'm')),
        ('with the nominal parameters', quantity(v.nominal_tip_error, 'm')),
        ('chi-square', f'{v.chi_square:.1f}, {v.degrees_of_freedom} degrees of freedom'),
        (f'its {100 * QUANTILE:.0f} % quantile', f'{v.quantile:.1f}'),
        ('p-value', p_equals(v.p_value).removeprefix('p = ').removeprefix('p ')),
        *((('largest change not seen', v.detectable[0].text),) if v.detectable else ()),
        *((('without the outliers', p_equals(v.others_p_value)),) if v.few_outlie else ()),
    )
    return Table(('', ''), ('', ''), rows)


def verification_page(v: Verification) -> str:
    """The page."""
    a = v.assessment
    texts = [*(sentence(reason) for reason in a.reasons[1:]), *(f'To do: {action}.' for action in a.actions)]
    tables = [('Numbers', summary_table(v), 'The error of the tip: distance of the predicted tip from the circle.')]
    if v.ranking:
        tables.append(('What may have changed', explanation_table(v.ranking, v.rivals), ''))
    if v.outlying:
        tables.append(_outlying_table(v.outlying))
    tables.append(('What these touches show', _detectable_table(v.detectable), _SHOWN_NOTE))
    caption = (
        'Error of the predicted tip along the contact normal; grey: two standard deviations expected. '
        'Red: outliers, which may be by the direction of the force.'
    )
    figures = ((_figure(v), caption),)
    part = Part('', f'{ANSWERS[a.grade]}: {a.reasons[0]}.', LEVELS[a.grade.value], tuple(texts), tuple(tables), figures)
    source = f'{v.record.source}, verified with {", ".join(item.path for item in v.recordings)}'
    return html_page('Verification of a calibration', source, [part], NAME)


_SHOWN_NOTE = (
    f'The smallest change of each parameter by itself that these touches show with {100 * POWER:.0f} % probability, '
    'and by how much it moves the tip at the touches of the calibration. Smaller changes may go unseen.'
)


def _detectable_table(found: Sequence[Detectable]) -> Table:
    rows = []
    for item in found:
        seen = np.isfinite(item.change)
        numbers = (quantity(item.change, item.unit), quantity(item.tip, 'm')) if seen else (NOT_DETERMINED,) * 2
        rows.append((item.name, *numbers))
    return Table(('parameter', 'change', 'tip, rms'), ('',) * 3, tuple(rows))


def _outlying_table(outlying: Sequence[Outlying]) -> tuple[str, Table, str]:
    """The outliers, those farthest from their prediction."""
    worst = sorted(sorted(outlying, key=lambda o: -o.distance)[:_LISTED])
    rows = tuple((str(o.touch), o.object, f'{o.distance:.1f}', f'{MICRO * o.tip_error:.0f}') for o in worst)
    note = f'The {_LISTED} farthest of {len(outlying)}.' if len(outlying) > _LISTED else ''
    return 'Outliers', Table(('touch', 'object', 'distance', 'tip'), ('', '', 'σ', 'µm'), rows), note


def _figure(v: Verification) -> Markup:
    """Error of the predicted tip, touch by touch, by their numbers in the recordings."""
    order = np.argsort(v.numbers, kind='stable')
    touches, errors, expected = v.numbers[order], MICRO * v.tip_errors[order], MICRO * v.expected_errors[order]
    outlies = np.isin(touches, [item.touch for item in v.outlying])
    with style():
        figure, (axes,) = new_figure(640, 260)
        axes.fill_between(touches, -2 * expected, 2 * expected, color=FAINT, alpha=0.2, linewidth=0, step='mid')
        axes.plot(touches[~outlies], errors[~outlies], 'o', color=INK, markersize=3)
        axes.plot(touches[outlies], errors[outlies], 'o', color=WARN, markersize=4)
        axes.set_xlabel('touch')
        axes.set_ylabel('error of the tip [µm]')
        return as_svg(figure, 'tip_error', 'error of the predicted tip, touch by touch')

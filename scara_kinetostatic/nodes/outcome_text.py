"""The outcome for ROS: one line of text, the values of a diagnostic status, the document on `~/result`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from scara_kinetostatic.assessment.grade import LIMITS
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.files.calibration_file import RESULT_SCHEMA as SCHEMA
from scara_kinetostatic.report.json_file import Document
from scara_kinetostatic.results.document import NAME
from scara_kinetostatic.results.tables import base_rank

_SHARED = (
    'created', 'recordings', 'warnings', 'cell', 'parameters', 'model', 'noise', 'force_error', 'held_out_force_error',
    'reduced_chi_square', 'tip_error', 'tip_uncertainty', 'assessment',
)  # fmt: skip
"""Keys that are those of `calibration.json`."""
_DIAGNOSIS = ('verdict', 'p_value', 'effects', 'possible', 'rivals', 'rival_effects', 'advice')
_MOST_WARNINGS = 3
"""So many warnings are in the line; all are in the log and on the topic."""


def one_line(outcome: Outcome) -> str:
    """Assessment, touches, force error before and after, goodness of fit, verdict, effects, in one line."""
    result, compared = outcome.final, outcome.comparison
    alone, extended = compared.base, compared.extended
    parts = [
        outcome.assessment.headline,
        f'{int(result.used.sum())} of {outcome.found} touches used{_of_recordings(outcome)}',
        f'force error {compared.nominal:.4g} N before, {alone.force_error:.4g} N after',
        f'reduced chi-square {alone.reduced_chi_square:.3g}',
    ]
    for group in result.identifiability.confounded:
        parts.append(f'confounded: {" ".join(group)}')
    parts.append(f'missing effects: {_verdict(outcome)}')
    if outcome.diagnosis.extended:
        parts.append(
            f'with them {extended.force_error:.4g} N, reduced chi-square {extended.reduced_chi_square:.3g}, '
            f'on touches not used {alone.held_out:.4g} N before, {extended.held_out:.4g} N after'
        )
    return '; '.join(parts)


def _of_recordings(outcome: Outcome) -> str:
    return f' from {len(outcome.sources)} recordings' if len(outcome.sources) > 1 else ''


def _verdict(outcome: Outcome) -> str:
    """The verdict and the effects behind it; rivals in brackets."""
    d = outcome.diagnosis
    found = [item.effect.label for item in d.found if item.is_found]
    possible = [f'possible: {item.effect.label}' for item in d.found if item.in_every_model and item.is_possible]
    open_ones = [f'one of ({", ".join(group)})' for group in d.rivals]
    checked = '' if outcome.final.degrees_of_freedom >= LIMITS.least_freedoms else ' (too few touches to check)'
    return ', '.join([d.verdict + checked, *found, *possible, *open_ones])


def details(outcome: Outcome) -> dict[str, str]:
    """The same figures by name."""
    result, compared = outcome.final, outcome.comparison
    alone, extended = compared.base, compared.extended
    found = outcome.diagnosis.found
    return {
        'assessment': outcome.assessment.grade.value,
        'reasons': '; '.join(outcome.assessment.reasons),
        'actions': '; '.join(outcome.assessment.actions) or 'none',
        'touches found': str(outcome.found),
        'touches used': str(int(result.used.sum())),
        'force error, nominal [N]': f'{compared.nominal:.6g}',
        'force error, calibrated [N]': f'{alone.force_error:.6g}',
        'force error, extended [N]': f'{extended.force_error:.6g}',
        'force error, held out [N]': f'{alone.held_out:.6g}',
        'force error, held out, extended [N]': f'{extended.held_out:.6g}',
        'reduced chi-square': f'{alone.reduced_chi_square:.6g}',
        'reduced chi-square, extended': f'{extended.reduced_chi_square:.6g}',
        'rank': str(base_rank(result)),
        'confounded': ', '.join(' '.join(group) for group in result.identifiability.confounded) or 'none',
        'verdict': outcome.diagnosis.verdict,
        'effects': ', '.join(item.effect.label for item in found if item.is_found) or 'none',
        'possible effects': ', '.join(item.effect.label for item in found if item.is_possible) or 'none',
        'rivals': '; '.join(', '.join(group) for group in outcome.diagnosis.rivals) or 'none',
        'warnings': '; '.join(outcome.warnings) or 'none',
        'sources': ', '.join(outcome.sources),
    }


def warnings_in_line(warnings: Sequence[str]) -> str:
    """The first warnings, and the number of the others; empty if there are none."""
    more = len(warnings) - _MOST_WARNINGS
    named = [*warnings[:_MOST_WARNINGS], *([f'{more} more'] if more > 0 else [])]
    return f'warnings: {"; ".join(named)}' if named else ''


def stored_document(folder: Path) -> Document | None:
    """`calibration.json` of a result; None where it cannot be read or is no such document."""
    try:
        document = json.loads((folder / NAME).read_text(encoding='utf-8'))
        summary(document)
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None
    return dict(document)


def summary(document: Document) -> Document:
    """What `~/result` carries of `calibration.json`: all but the single touches and the details of the diagnosis."""
    touches, found = document['touches'], document['identifiability']
    return {
        'schema': SCHEMA,
        **{key: document[key] for key in _SHARED},
        'touches': {key: touches[key] for key in ('found', 'used', 'rejected')},
        'identifiability': {key: found[key] for key in ('rank', 'confounded', 'advice')},
        'diagnosis': {key: document['diagnosis'][key] for key in _DIAGNOSIS},
    }

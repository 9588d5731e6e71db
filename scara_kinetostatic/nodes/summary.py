"""A calibration in one line, and as the values of a diagnostic status."""

from __future__ import annotations

from scara_kinetostatic.pipeline import Outcome


def one_line(outcome: Outcome) -> str:
    """What came out: touches, force error before and after, fit, what cannot be told apart, verdict."""
    result = outcome.calibration
    parts = [
        f'{int(result.used.sum())} of {outcome.found} touches used',
        f'force error {result.force_error_nominal:.4g} N before, {result.force_error:.4g} N after',
        f'reduced chi-square {result.reduced_chi_square:.3g}',
    ]
    for group in result.identifiability.confounded:
        parts.append(f'cannot be told apart: {" ".join(group)}')
    parts.append(f'missing effects: {outcome.diagnosis.verdict}')
    return '; '.join(parts)


def details(outcome: Outcome) -> dict[str, str]:
    """The same by name."""
    result = outcome.calibration
    return {
        'touches found': str(outcome.found),
        'touches used': str(int(result.used.sum())),
        'force error, nominal [N]': f'{result.force_error_nominal:.6g}',
        'force error, calibrated [N]': f'{result.force_error:.6g}',
        'force error, held out [N]': f'{outcome.held_out.force_error:.6g}',
        'reduced chi-square': f'{result.reduced_chi_square:.6g}',
        'rank': str(result.identifiability.rank),
        'confounded': ', '.join(' '.join(group) for group in result.identifiability.confounded) or 'none',
        'verdict': outcome.diagnosis.verdict,
        'sources': ', '.join(outcome.sources),
    }

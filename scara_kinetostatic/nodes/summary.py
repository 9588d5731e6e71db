"""A calibration in one line, and as the values of a diagnostic status."""

from __future__ import annotations

from scara_kinetostatic.diagnosis.outcome import Outcome
from scara_kinetostatic.report.parameter_rows import base_rank


def one_line(outcome: Outcome) -> str:
    """What came out: touches, force error before and after, fit, what cannot be told apart, verdict, effects."""
    result, compared = outcome.final, outcome.comparison
    alone, extended = compared.alone, compared.extended
    parts = [
        f'{int(result.used.sum())} of {outcome.found} touches used',
        f'force error {compared.nominal:.4g} N before, {alone.force_error:.4g} N after',
        f'reduced chi-square {alone.reduced_chi_square:.3g}',
    ]
    for group in result.identifiability.confounded:
        parts.append(f'cannot be told apart: {" ".join(group)}')
    parts.append(f'missing effects: {_verdict(outcome)}')
    if outcome.diagnosis.extended:
        parts.append(
            f'with them {extended.force_error:.4g} N, reduced chi-square {extended.reduced_chi_square:.3g}, '
            f'on touches not used {alone.held_out:.4g} N before, {extended.held_out:.4g} N after'
        )
    return '; '.join(parts)


def _verdict(outcome: Outcome) -> str:
    """The verdict and the effects behind it; rivals in brackets."""
    d = outcome.diagnosis
    in_every_model = [item.effect.label for item in d.found if item.in_every_model]
    open_ones = [f'one of ({", ".join(group)})' for group in d.rivals]
    return ', '.join([d.verdict, *in_every_model, *open_ones])


def details(outcome: Outcome) -> dict[str, str]:
    """The same by name."""
    result, compared = outcome.final, outcome.comparison
    alone, extended = compared.alone, compared.extended
    found = outcome.diagnosis.found
    return {
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
        'effects': ', '.join(item.effect.label for item in found if item.in_every_model) or 'none',
        'rivals': '; '.join(', '.join(group) for group in outcome.diagnosis.rivals) or 'none',
        'sources': ', '.join(outcome.sources),
    }

"""What `calibrate` prints, and `report.html`: may the result be used, the result, what is behind it."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime, timezone
from functools import partial

import numpy as np

from scara_kinetostatic.assessment.outcome import Outcome, stated_conformity
from scara_kinetostatic.report import (
    Block,
    Fact,
    Facts,
    Figure,
    Items,
    Note,
    Report,
    Section,
    Table,
    as_page,
    as_text,
    sentence,
)
from scara_kinetostatic.report.quantities import count, micrometres, p_equals, percentage
from scara_kinetostatic.results import messages

NAME = 'report.html'
MOST_REJECTED = 12
"""So many rejected touches are listed in the text."""


def text_report(outcome: Outcome) -> str:
    """Assessment, verdict, parameters, effects, errors, budget, rejected touches, for a terminal."""
    c = outcome.final
    facts = {
        'touches': f'{int(c.used.sum())} used of {outcome.found} found',
        'bias': messages.bias(outcome),
        'noise': messages.noise(outcome),
        'determined': ' '.join(messages.identifiability(outcome)),
    }
    blocks: list[Block | None] = [
        messages.verdict(outcome),
        messages.touches_that_decide(outcome),
        messages.parameter_table(c),
        Section('added to the base model', tuple(messages.effect_tables(outcome.diagnosis))),
        messages.error_table(outcome.comparison),
        Facts(tuple(Fact(name, text) for name, text in facts.items() if text)),
        ' '.join(messages.tip_sentences(outcome)),
        messages.tip_budget(outcome, most=5),
    ]
    if outcome.rejected:
        lines = _rejections(outcome)
        more = [f'and {len(lines) - MOST_REJECTED} more, see the report'] if len(lines) > MOST_REJECTED else []
        blocks.append(Items((*lines[:MOST_REJECTED], *more), f'Not used ({len(lines)}):'))
    blocks += [_warnings(outcome)]
    answer = messages.answer(outcome.assessment, c.cell.tolerance)
    return as_text(Report('Kinetostatic calibration', answer, _present(blocks)))


def _rejections(outcome: Outcome) -> list[str]:
    return [f'touch {item.index}: {item.reason}' for item in outcome.rejected]


def html_text(outcome: Outcome) -> str:
    """The page: the answer, the result, the diagnosis; in an appendix, folded, what they rest on."""
    c, extended = outcome.final, outcome.final is not outcome.calibration
    sign = c.cell.sensor.sign.value.replace('on_', 'on the ')
    sensor = f'force sensor: {c.cell.sensor.frame.value} frame, force {sign}'
    report = Report(
        title='Kinetostatic calibration',
        answer=messages.answer(outcome.assessment, c.cell.tolerance),
        head=_head(outcome),
        blocks=(
            Facts(numbers(outcome)),
            Section(
                'Parameters (extended model)' if extended else 'Parameters',
                (messages.parameter_table(c), *messages.identifiability(outcome)[1:]),
            ),
            *_present([_map(outcome)]),
            _diagnosis(outcome),
            Section('Appendix', ()),  # what the result rests on, folded; what the touches show of the effects is open
            *([_effects(outcome)] if extended else []),
            *_present([_budget(outcome), _errors(outcome), _limits(outcome)]),
            _noise(outcome),
            *_pictures(outcome),
            _touches(outcome),
        ),
        footer=f'{count(c.iterations, "solver iteration")}, {c.termination.name.lower()} · {sensor} · gripper sign '
        f'{c.cell.gripper_sign.value} · all numbers in full and in SI units in calibration.json, one row per touch in '
        'residuals.csv',
    )
    return as_page(report)


def _present(blocks: Iterable[Block | None]) -> tuple[Block, ...]:
    return tuple(block for block in blocks if block is not None and block != '')


def _warnings(outcome: Outcome) -> Items | None:
    return Items(tuple(outcome.warnings), 'About the recording:') if outcome.warnings else None


def _head(outcome: Outcome) -> tuple[tuple[str, str], ...]:
    """Date; what the cell description says of robot, cell, sensor and people; recordings with their checksums."""
    given = outcome.final.cell.identification.given()
    found = [('Date', _date(outcome.created)), *((name.capitalize().replace('_', ' '), given[name]) for name in given)]
    for item in outcome.recordings:
        start = '' if item.start is None else _date(item.start) if item.start.year > 2000 else 'simulated clock'
        found.append(('Recording', ', '.join(filter(None, (item.path, start, item.turned, f'SHA-256 {item.sha256}')))))
    return (*found, *((('Recording', path) for path in outcome.sources) if not outcome.recordings else ()))


def _date(time: datetime) -> str:
    return time.astimezone(timezone.utc).strftime('%Y-%m-%d %H:%M UTC')


def numbers(outcome: Outcome) -> tuple[Fact, Fact, Fact]:
    """Error of the tip before and after; its uncertainty against the tolerance; force error on held-out touches."""
    compared, final = outcome.comparison, outcome.comparison.extended
    change = f'{micrometres(compared.nominal_tip)} → {micrometres(final.tip.held_out)}'
    remark = 'rms distance from the touched surfaces: nominal → calibrated, each touch by a fit without it; '
    remark += f'{micrometres(final.tip.fitted)} µm in the fit, {micrometres(final.tip.noise)} µm is expected from noise'
    tip = Fact('Tip error, before → after', change, 'µm', remark)
    remark = f'touches not used in the fit, {count(outcome.extended_held_out.folds, "fold")}; '
    remark += f'{final.force_error:.3g} N in the fit, {compared.nominal:.3g} N with nominal parameters'
    held_out = Fact('Force error on held-out touches', f'{final.held_out:.3g}', 'N', remark)
    return tip, _uncertainty(outcome), held_out


def _uncertainty(outcome: Outcome) -> Fact:
    """The largest expanded uncertainty of the tip against the tolerance, and whether it conforms."""
    tip, found, tolerance = outcome.tip_uncertainty, outcome.conformity, outcome.final.cell.tolerance
    title = 'Tip uncertainty' if tolerance is None else 'Tip uncertainty against tolerance'
    allowed = 'no tolerance is stated' if tolerance is None else f'tolerance {micrometres(tolerance)} µm'
    if not np.isfinite(tip.worst):
        return Fact(title, 'not determined', '', f'by these touches; {allowed}')
    parts = [f'largest expanded uncertainty ({tip.coverage}) in the {outcome.final.cell.region.title}']
    if np.isfinite(tip.worst_touched):
        parts[0] += f', {micrometres(tip.worst_touched)} µm between the touches'
    if tip.undetermined > 0:
        parts.append(f'not determined in {percentage(tip.undetermined)} of it')
    if found is None or tolerance is None:
        return Fact(title, micrometres(tip.worst), 'µm', '; '.join([*parts, allowed]))
    parts.append(f'conformity {stated_conformity(outcome)}')
    return Fact(title, f'{micrometres(tip.worst)} of {micrometres(tolerance)}', 'µm', '; '.join(parts))


def _map(outcome: Outcome) -> Section | None:
    """Uncertainty of the tip, where the data determine it."""
    from scara_kinetostatic.results.figures import uncertainty_figures

    maps = uncertainty_figures(outcome)
    return Section('Uncertainty of the tip', (maps,)) if maps is not None else None


def _diagnosis(outcome: Outcome) -> Section:
    d = outcome.diagnosis
    blocks: list[Block] = [*_present([messages.verdict(outcome), messages.touches_that_decide(outcome)])]
    if outcome.final is not outcome.calibration:
        blocks += [table._replace(title=table.title.strip()) for table in messages.effect_tables(d)]
        these = 'this effect' if len(d.found) == 1 else 'these effects'
        adequate = f'With {these} in the model: {p_equals(d.remaining_p_value)} for “the extended model is adequate”.'
        blocks.append(f'{adequate} {sentence(messages.bias(outcome))}')
    return Section('Diagnosis', tuple(blocks))


def _effects(outcome: Outcome) -> Section:
    from scara_kinetostatic.results.figures import effect_picture

    found = outcome.diagnosis.found[:3]
    others = ' and the other possible causes' if outcome.diagnosis.rivals else ''
    figures = []
    for number, (item, residual) in enumerate(zip(found, outcome.effect_residuals, strict=False)):
        titles = ('without it', 'with it') if item.in_every_model else ('without the causes', 'with all causes')
        figures.append(Figure(partial(effect_picture, residual, f'effect{number}', titles), title=item.effect.title))
    caption = Note(
        f'The deviation by this effect, estimated from each touch alone. Left: residuals of the model without the '
        f'effect{others}; right: of the model with it. Grey bars: ± 1 σ of one touch. Points beyond the scale are '
        'drawn at its edge. Short dashes: what is expected of the effect after the other parameters have absorbed part '
        'of it. Filled: posture left, hollow: right.'
    )
    which = 'this effect' if len(found) == 1 else 'these effects'
    return Section(f'What the touches show of {which}', (*figures, caption))


def _budget(outcome: Outcome) -> Section | None:
    of_tip = messages.tip_budget(outcome)
    if of_tip is None:
        return None
    blocks = (
        ' '.join(messages.tip_sentences(outcome)),
        'Of the tip, where its uncertainty is largest, in its worst direction (standard uncertainties, k = 1; type A: '
        'from the touches, B: declared):',
        of_tip,
    )
    return Section('Uncertainty budget', blocks, folded=True)


def _errors(outcome: Outcome) -> Section:
    note = Note(
        'Force error: mean distance of measured and predicted force, e_f. Tip error: rms distance of the predicted tip '
        f'from the surface. Held out: touches not used in the fit, {outcome.extended_held_out.folds} folds '
        'for the force, one by one and to first order for the tip. All on the same touches and with the noise of the '
        'final model.'
    )
    return Section('Errors of the models', (messages.error_table(outcome.comparison), note), folded=True)


def _limits(outcome: Outcome) -> Section | None:
    """The physical effects that these touches cannot show."""
    ranking = outcome.diagnosis.ranking
    effects = [item.effect for item in ranking if item.role == 'unidentifiable' and item.effect.is_physical]
    cells = tuple((effect.title, effect.confounded_with, effect.identified_by) for effect in effects)
    table = Table(('effect', 'confounded with', 'identified by'), ('',) * 3, cells)
    title = f'Effects that these touches cannot identify: {len(effects)}'
    return Section(title, (table,), folded=True) if effects else None


def _noise(outcome: Outcome) -> Section:
    lines = [*messages.identifiability(outcome), f'Noise of one touch: {messages.noise(outcome)}.']
    never = (
        'Touches of this kind, whatever their number, cannot show an error common to all radii, a displacement of all '
        'discs together, a gain error of the force sensor, a gripper that is stiffer along link 2 than across it, or '
        'friction in a transmission that is always approached from the same side. They change g_ee, x0 and y0, all '
        'compliances, p_ee and p2, and a backlash.'
    )
    return Section('Identifiability and noise', (Items(tuple(lines)), never), folded=True)


def _pictures(outcome: Outcome) -> list[Section]:
    """The cell; the residuals."""
    from scara_kinetostatic.results import figures

    c = outcome.final
    cell = Figure(
        partial(figures.cell_picture, c),
        'View from above, base frame. Each line is the force of one touch, its head at the contact, its length '
        f'proportional to the force, the longest {np.hypot(*c.force.T).max():.1f} N. One arm of either posture is '
        'drawn in full (left solid, right dashed), the others faintly.',
    )
    residuals = Figure(
        partial(figures.residual_picture, c),
        'Measured less predicted force. If model and noise are right, the residuals scatter about zero without a '
        'pattern. Points beyond the scale are drawn at its edge.',
    )
    legend = figures.legend(c)
    return [Section('The cell', (legend, cell), folded=True), Section('Residuals', (legend, residuals), folded=True)]


def _touches(outcome: Outcome) -> Section:
    first: Block = f'All {outcome.found} touches were used.'
    if outcome.rejected:
        title = f'{len(outcome.rejected)} of {outcome.found} touches were not used:'
        first = Items(tuple(_rejections(outcome)), title)
    blocks = _present([first, _warnings(outcome), Note('residuals.csv has all touches, one row each.')])
    return Section(f'Touches: {outcome.final.used.sum()} used of {outcome.found} found', blocks, folded=True)

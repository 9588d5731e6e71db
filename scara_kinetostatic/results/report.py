"""What `calibrate` prints, and `report.html`: may the result be used, the result, what is behind it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from datetime import datetime, timezone
from functools import partial

import numpy as np

from scara_kinetostatic.assessment.grade import (
    Assessment,
    Grade,
    advice,
    rivals_in_words,
    sets_in_words,
    stated_conformity,
)
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.comparison import Comparison
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.model.parameters import DESCRIPTIONS, IN_MICRO, NAMES
from scara_kinetostatic.model.quantities import SCALES, count, micrometres, p_equals, percentage, shown, unsigned_zero
from scara_kinetostatic.report.page import (
    Block,
    Fact,
    Facts,
    Figure,
    Items,
    Level,
    Note,
    Report,
    Section,
    Table,
    Verdict,
    as_page,
    as_text,
    sentence,
)

NAME, _TITLE = 'report.html', 'Kinetostatic calibration'
MOST_REJECTED = 12
"""So many rejected touches are listed in the text."""


def text_report(outcome: Outcome) -> str:
    """Assessment, verdict, parameters, effects, errors, budget, rejected touches, for a terminal."""
    c = outcome.final
    facts = {
        'touches': f'{int(c.used.sum())} used of {outcome.found} found',
        'bias': bias(outcome),
        'earlier': earlier_calibration(outcome),
        'noise': stated_noise(outcome),
        'determined': ' '.join(identifiability(outcome)),
    }
    blocks: list[Block | None] = [
        verdict(outcome),
        touches_that_decide(outcome),
        parameter_table(c),
        Section('added to the base model', tuple(effect_tables(outcome.diagnosis))),
        error_table(outcome.comparison),
        Facts(tuple(Fact(name, text) for name, text in facts.items() if text)),
        ' '.join(tip_sentences(outcome)),
        tip_budget(outcome, most=5),
    ]
    if outcome.rejected:
        lines = _rejections(outcome)
        more = [f'and {len(lines) - MOST_REJECTED} more, see the report'] if len(lines) > MOST_REJECTED else []
        blocks.append(Items((*lines[:MOST_REJECTED], *more), f'Not used ({len(lines)}):'))
    blocks += [_warnings(outcome)]
    return as_text(Report(_TITLE, answer(outcome.assessment, c.cell.tolerance), _present(blocks)))


def _rejections(outcome: Outcome) -> list[str]:
    return [f'touch {item.index}: {item.reason}' for item in outcome.rejected]


def html_text(outcome: Outcome) -> str:
    """The page: the answer, the result, the diagnosis; in an appendix, folded, what they rest on."""
    from scara_kinetostatic.results.figures import uncertainty_figures

    c, extended = outcome.final, outcome.final is not outcome.calibration
    maps = uncertainty_figures(outcome)
    sign = c.cell.sensor.sign.value.replace('on_', 'on the ')
    sensor = f'force sensor: {c.cell.sensor.frame.value} frame, force {sign}'
    report = Report(
        title=_TITLE,
        answer=answer(outcome.assessment, c.cell.tolerance),
        head=_head(outcome),
        blocks=(
            Facts(numbers(outcome)),
            Section(
                'Parameters (extended model)' if extended else 'Parameters',
                (parameter_table(c), *identifiability(outcome)[1:]),
            ),
            *([Section('Uncertainty of the tip', (maps,))] if maps else []),
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
    found += [('Earlier calibration', earlier_calibration(outcome))] if outcome.earlier else []
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


def _diagnosis(outcome: Outcome) -> Section:
    d = outcome.diagnosis
    blocks: list[Block] = [*_present([verdict(outcome), touches_that_decide(outcome)])]
    if outcome.final is not outcome.calibration:
        blocks += [table._replace(title=table.title.strip()) for table in effect_tables(d)]
        these = 'this effect' if len(d.found) == 1 else 'these effects'
        adequate = f'With {these} in the model: {p_equals(d.remaining_p_value)} for “the extended model is adequate”.'
        blocks.append(f'{adequate} {sentence(bias(outcome))}')
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
    of_tip = tip_budget(outcome)
    if of_tip is None:
        return None
    blocks = (
        ' '.join(tip_sentences(outcome)),
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
    return Section('Errors of the models', (error_table(outcome.comparison), note), folded=True)


def _limits(outcome: Outcome) -> Section | None:
    """The physical effects that these touches cannot show."""
    ranking = outcome.diagnosis.ranking
    effects = [item.effect for item in ranking if item.role == 'unidentifiable' and item.effect.is_physical]
    cells = tuple((effect.title, effect.confounded_with, effect.identified_by) for effect in effects)
    table = Table(('effect', 'confounded with', 'identified by'), (), cells)
    title = f'Effects that these touches cannot identify: {len(effects)}'
    return Section(title, (table,), folded=True) if effects else None


def _noise(outcome: Outcome) -> Section:
    lines = [*identifiability(outcome), f'Noise of one touch: {stated_noise(outcome)}.']
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


def answer(a: Assessment, tolerance: float | None, checked: str = 'Fit for use') -> Verdict:
    """An assessment in words: the first thing in text and page."""
    fit = 'Fit for use' if tolerance else f'{checked}, no tolerance stated'
    words = {Grade.FIT: fit, Grade.CAUTION: 'To be used with caution', Grade.UNFIT: 'Not fit for use'}[a.grade]
    levels: dict[Grade, Level] = {Grade.FIT: 'good', Grade.CAUTION: 'caution', Grade.UNFIT: 'bad'}
    sentences = tuple(map(sentence, a.reasons[1:]))
    return Verdict(f'{words}: {a.reasons[0]}.', levels[a.grade], sentences, a.actions)


def verdict(outcome: Outcome) -> Verdict:
    """Whether the model is complete, and what was found; the assessment says whether to use the result."""
    level: Level
    d, p = outcome.diagnosis, p_equals(outcome.diagnosis.p_value)
    if outcome.earlier:
        headline = 'The touches contradict' if outcome.earlier.contradiction else 'The touches agree with'
        names = [item.effect.title for item in d.found]
        sentences = [f'It has {"; ".join(names)}.'] if names else []
        sentences += ['So few touches are not searched for new model errors.', f'Its verdict: {d.verdict}.']
        level = 'bad' if outcome.earlier.contradiction else 'good'
        return Verdict(f'{headline} the earlier calibration ({p}).', level, tuple(sentences))
    lack = f'The base model does not explain the touches ({p})'
    if d.verdict != 'none' and d.p_value >= 0.5:  # noise that was estimated covers the error
        lack = f'The base model explains the touches with more noise than any robot has (with that noise {p})'
    if d.verdict == 'none':
        level, headline = 'good', 'The base model explains these touches'
        c = outcome.calibration
        if d.has_small_errors:
            headline = 'The base model and small errors of usual kinds explain these touches'
        by_itself = f'{p_equals(c.p_value)} by itself' if c.noise_source == 'given' else 'to which the noise was fitted'
        chi_square = f'reduced chi-square {c.reduced_chi_square:.2f} of {c.degrees_of_freedom} degrees of freedom'
        sentences = [f'No model error detected ({p} for no gross error; {chi_square}, {by_itself}).']
    elif d.verdict == 'explained':
        level, headline = (
            'caution',
            f'Model error found and corrected: {"; ".join(i.effect.title for i in d.found if i.is_found)}',
        )
        sentences = [f'{lack}; extended by what was found it does.']
    elif d.verdict == 'ambiguous':
        level, headline = 'caution', 'Model error found, but these data cannot distinguish its possible causes'
        causes = '; '.join(rivals_in_words(d, group) for group in d.rivals)
        sentences = [
            f'{lack}. Possible causes: {causes}.',
            'The parameters are valid whichever is present; the size of a cause only if it is the true one.',
        ]
    else:
        curve = any(item.in_every_model and not item.effect.is_physical for item in d.found)
        rest = 'described by a fitted curve' if curve else 'only partly explained' if d.found else ''
        level, headline = 'bad', 'Model error found, cause unknown' + (f'; {rest}' if rest else '')
        names = [item.effect.title + (' (possible, not proved)' if item.is_possible else '') for item in d.found]
        sentences = [f'{lack}.', *([f'Added to the model: {", ".join(names)}.'] if names else [])]
        contained = 'The standard uncertainties contain what the catalogue knows, not what it lacks.'
        sentences.append(contained if outcome.final.has_undetected else 'Do not rely on the standard deviations.')
    likeliest = d.probabilities[0] if d.probabilities else None
    if likeliest and likeliest.probability < (0.99 if likeliest.effects else 0.9) and len(d.rivals) != 1:
        sentences.append(f'{sets_in_words(d)}.')
    sentences.append(f'Verdict: {d.verdict}.')
    return Verdict(f'{headline}.', level, (*sentences, *([sentence(d.advice)] if d.advice else [])))


def touches_that_decide(outcome: Outcome) -> Items | None:
    """Those that tell possible causes apart, with what is expected of them; None where there are none."""
    found = outcome.discrimination if outcome.diagnosis.is_undecided else None
    if found is None or not found.is_decisive:
        return None
    return Items(found.touches, f'Touches that decide between {found.causes}, the likeliest: {found.forecast}')


def bias(outcome: Outcome) -> str:
    """By how much the base model's parameters and tip are biased; empty where no model error was found."""
    if outcome.final is outcome.calibration:
        return ''
    rows = sorted((row for row in outcome.comparison.biases if row.is_significant), key=lambda row: -abs(row.in_std))
    # 3: so many biased parameters are named
    worst = ', '.join(f'{row.name} by {abs(row.in_std):.2g} σ' for row in rows[:3])
    tip = f'the tip by {micrometres(outcome.comparison.tip_bias)} µm (rms over the touches)'
    return f'ignoring it would bias {f"{worst} and " if worst else ""}{tip}'


def earlier_calibration(outcome: Outcome) -> str:
    """The calibration that was the prior, and what was freed; empty where there is none."""
    earlier = outcome.earlier
    if earlier is None:
        return ''
    freed = f'freed: {", ".join(earlier.freed)}' if earlier.freed else 'nothing freed'
    agree = 'contradict it' if earlier.contradiction else 'agree with it'
    return f'{earlier.path}, {freed}; the touches {agree} ({p_equals(earlier.p_value)})'


def stated_noise(outcome: Outcome) -> str:
    """Noise levels and their source."""
    n = outcome.final.noise
    joint, force = (
        ' and '.join(dict.fromkeys(f'{scale * level:.3g}' for level in levels))
        for scale, levels in ((IN_MICRO, n.joint_levels), (1.0, n.force_levels))
    )
    grown = f', in addition {percentage(n.growth, ".2g")} of the force' if n.growth else ''
    given = 'that of the earlier calibration' if outcome.earlier else 'given by the cell description'
    source = {'given': given, 'estimated': 'estimated from the residuals'}
    levels = f'{joint} µrad per joint and {force} N per force component{grown}'
    return f'{levels}, {source[outcome.final.noise_source]}'


def identifiability(outcome: Outcome) -> list[str]:
    """Which parameters the data determine; the assessment says which touches would determine the others."""
    c, found = outcome.final, outcome.final.identifiability
    free = sum(status != 'fixed' for status in c.status.values())
    known = sum(status == 'estimated' for status in c.status.values())
    rank = c.base_rank
    more = f', {rank} independent combinations of all' if rank != known else ''
    lines = [f'{known} of {free} free parameters are determined{more} (condition number {found.condition:.3g}).']
    for group in found.confounded:
        names = ['all twelve parameters', *(n for n in group if n not in NAMES)] if set(NAMES) <= set(group) else group
        lines.append(f'Not determined: {", ".join(names)}; other values fit as well.')
    for item in found.combinations:
        value = shown(item.value, item.std, item.unit).text
        lines.append(f'Only the combination {item.text} (factor in SI units) = {value} is determined.')
    return lines


def tip_sentences(outcome: Outcome) -> list[str]:
    """How uncertain the tip is, what dominates, and what to do about that."""
    tip = outcome.tip_uncertainty
    if tip.at is None or not math.isfinite(tip.worst):
        return ['The uncertainty of the tip is not determined by these touches.']
    largest = max(outcome.budget, key=lambda item: item.tip)
    share = largest.tip**2 / sum(item.tip**2 for item in outcome.budget)
    where = outcome.final.cell.region.title
    sizes = f'at most {micrometres(tip.worst)} µm, at {tip.at.title}, median {micrometres(tip.median)} µm.'
    return [
        f'Expanded uncertainty of the tip ({tip.coverage}) over the {where}: {sizes}',
        f'Largest contribution there: {largest.title}, {percentage(share)} of the variance.',
        f'To reduce it: {advice(outcome)}.',
    ]


def parameter_table(c: Calibration) -> Table:
    """The parameters of the base model with what they are, or why they have no value.

    A value has the digits that its uncertainty allows; one that the data do not determine is in brackets.
    """
    nominal, values, rows = c.cell.nominal.as_dict(), c.parameters.as_dict(), []
    why = {'fixed': 'fixed', 'confounded': 'not determined by these data'}
    for name in c.parameters.names:
        (unit, per_si), status = SCALES[name], c.status[name]
        found = shown(values[name], c.std_of(name), unit, {unit: SCALES[name]})
        text = f'({found.value})' if status == 'confounded' else unsigned_zero(f'{values[name] * per_si:.6g}')
        text = f'{found.value} ± {found.std}' if found.std else text
        start = unsigned_zero(f'{nominal[name] * per_si:.6g}')
        rows.append((name, start, text, unit, why.get(status, DESCRIPTIONS[name])))
    levels = {'estimated': '', 'fixed': 'faint', 'confounded': 'caution'}
    heading = ('', 'nominal', 'estimate ± 1 σ', '', '')
    return Table(heading, (), tuple(rows), levels=tuple(levels[c.status[name]] for name in c.parameters.names))


def effect_tables(d: Diagnosis) -> list[Table]:
    """Each effect of the extended model with its values; those of a fitted curve have no meaning by themselves."""
    tables = []
    for item in d.found:
        doubt = ' (possible, not proved)' if item.is_possible else ''
        if not item.in_every_model:
            is_rival = any(item.effect.label in group for group in d.rivals)
            doubt = ' (one of several possible causes)' if is_rival else ' (a small error, at one place)'
        title = item.effect.title + doubt
        rows: tuple[tuple[str, ...], ...] = ()
        if item.effect.is_physical:
            title += f'  {item.effect.label}'
            rows = tuple((f'    {v.name}', shown(v.value, v.std, v.unit).text, v.meaning) for v in item.values)
        tables.append(Table(('',) * 3, (), rows, title=f'  {title}'))
    return tables


def tip_budget(outcome: Outcome, most: int | None = None) -> Table | None:
    """Contributions to the tip where its uncertainty is largest, the largest first; None where it is not determined.

    Args:
        outcome: the result.
        most: so many are listed, the others together; None for all.
    """
    items = sorted(outcome.budget, key=lambda item: -item.tip)
    total = math.hypot(*(item.tip for item in items))
    if not total > 0 or not math.isfinite(total) or not math.isfinite(outcome.tip_uncertainty.worst):
        return None
    listed = []
    for item in items[:most]:
        declared = '' if item.declared is None else shown(item.declared, math.nan, item.unit).text
        listed.append((item.title, item.evaluation, declared, item.tip))
    if others := items[len(listed) :]:
        listed.append((f'{len(others)} others', '', '', math.hypot(*(item.tip for item in others))))
    listed.append(('combined standard uncertainty', '', '', total))
    rows = [(*words, micrometres(size), percentage((size / total) ** 2)) for *words, size in listed]
    heading = ('tip: source', 'type', 'declared', 'contribution', 'share of the variance')
    return Table(heading, ('', '', '', 'µm', ''), tuple(rows))


def error_table(compared: Comparison) -> Table:
    """Force and tip, fitted and held out, and chi-square, of the nominal, the base and the extended model."""
    tip = micrometres(compared.nominal_tip)
    rows: list[tuple[str, ...]] = [('nominal parameters', f'{compared.nominal:.3g}', '', tip, '', '')]
    sides = [('base model', compared.base), ('extended model', compared.extended)]
    for name, side in sides[: 1 if compared.base == compared.extended else 2]:
        tips = map(micrometres, (side.tip.fitted, side.tip.held_out))
        force = (f'{each:.3g}' for each in (side.force_error, side.held_out))
        rows.append((name, *force, *tips, f'{side.reduced_chi_square:.2f}'))
    rows.append(('expected from noise', '', '', micrometres(compared.extended.tip.noise), '', '1'))
    heading = ('', 'force error', 'held out', 'tip error', 'held out', 'reduced chi-square')
    return Table(heading, ('', 'N', 'N', 'µm', 'µm', ''), tuple(rows))

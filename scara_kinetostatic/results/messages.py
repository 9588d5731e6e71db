"""The outcome in sentences and tables; the terminal and the page say the same."""

from __future__ import annotations

import math

from scara_kinetostatic.assessment.grade import Assessment, Grade
from scara_kinetostatic.assessment.outcome import Outcome, advice, rivals_in_words, sets_in_words
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.comparison import Comparison
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.model.parameters import DESCRIPTIONS, NAMES
from scara_kinetostatic.report import Items, Level, Table, Verdict, sentence
from scara_kinetostatic.report.quantities import MICRO, SCALES, micrometres, p_equals, percentage, shown, unsigned_zero


def answer(a: Assessment, tolerance: float | None, checked: str = 'Fit for use') -> Verdict:
    """An assessment in words: the first thing in text and page."""
    fit = 'Fit for use' if tolerance else f'{checked}, no tolerance stated'
    words = {Grade.FIT: fit, Grade.CAUTION: 'To be used with caution', Grade.UNFIT: 'Not fit for use'}[a.grade]
    levels: dict[Grade, Level] = {Grade.FIT: 'good', Grade.CAUTION: 'caution', Grade.UNFIT: 'bad'}
    sentences = tuple(map(sentence, a.reasons[1:]))
    return Verdict(f'{words}: {a.reasons[0]}.', levels[a.grade], sentences, a.actions)


def verdict(outcome: Outcome) -> Verdict:
    """Whether the model is complete, and what was found; the assessment says whether to use the result."""
    d, p = outcome.diagnosis, p_equals(outcome.diagnosis.p_value)
    lack = f'The base model does not explain the touches ({p})'
    if d.verdict != 'none' and d.p_value >= 0.5:  # noise that was estimated covers the error
        lack = f'The base model explains the touches with more noise than any robot has (with that noise {p})'
    level: Level
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


def noise(outcome: Outcome) -> str:
    """Noise levels and their source."""
    n = outcome.final.noise
    joint, force = (
        ' and '.join(dict.fromkeys(f'{scale * level:.3g}' for level in levels))
        for scale, levels in ((MICRO, n.joint_levels), (1.0, n.force_levels))
    )
    grown = f', in addition {percentage(n.growth, ".2g")} of the force' if n.growth else ''
    source = {'given': 'given by the cell description', 'estimated': 'estimated from the residuals'}
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
    return Table(heading, ('',) * 5, tuple(rows), levels=tuple(levels[c.status[name]] for name in c.parameters.names))


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
        tables.append(Table(('',) * 3, ('',) * 3, rows, title=f'  {title}'))
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

"""The outcome of the study of the diagnosis, in tables."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

import numpy as np

from benchmark.diagnosis.record import (
    ALONE,
    NAMINGS,
    REQUIRED_REDUCTION,
    RIVALS,
    WITHIN,
    Record,
    correctly_named,
    error_reduction,
    failure,
    named_text,
    predicts_like_truth,
    unbiased,
)

Key = TypeVar('Key')

WIDTH = 29
REFERENCE_SIZE = 2.0
"""The size at which the targets of the diagnosis apply."""


def tables(records: Sequence[Record]) -> Iterator[str]:
    """Every line of the report."""
    done = [record for record in records if record.verdict]
    yield 'All touches are simulated by the simulator of this package; none is measured.'
    yield from clean_table([r for r in done if r.section == 'clean'])
    effects = [r for r in done if r.section == 'effects']
    if effects:
        yield from effect_table(effects)
        yield from confusion_table(effects)
    yield from pair_table([r for r in done if r.section == 'pairs'])
    yield from unlisted_table([r for r in done if r.section == 'unlisted'])
    yield from time_lines(done)
    yield from not_simulated(records)
    yield from failure_lines(records)
    yield from summary(done)


def clean_table(records: Sequence[Record]) -> Iterator[str]:
    """Verdicts without a detectable effect."""
    if not records:
        return
    yield from _title('No detectable effect: verdicts')
    for labels in dict.fromkeys(r.simulated for r in records):
        some = [r for r in records if r.simulated == labels]
        for group, part in _grouped(some, lambda r: f'{r.cell}, {r.noise}'):
            yield f'{(labels or ("clean",))[0]:{WIDTH}} {group:17} {_verdicts(part)}'
        alarms = sum(r.verdict != 'none' for r in some)
        yield f'{(labels or ("clean",))[0]:{WIDTH}} {"all":17} alarms {alarms} of {len(some)}, {_percent(alarms, some)}'


def effect_table(records: Sequence[Record]) -> Iterator[str]:
    """Naming and errors of each effect, size by size, then of all effects together."""
    yield from _title('One effect: how it is named, and errors (medians)')
    yield 'alone: named in every credible model; rivals: named among rivals; unnamed: an alarm without a name;'
    yield 'wrong: another one is named; none: no alarm; more: runs in which another one is named beside it'
    yield _head('effect', 'size')
    for (label, size), part in _grouped(records, lambda r: (r.simulated[0], r.size)):
        yield _row(f'{label:{WIDTH}} {size:4g}', part)
    yield ''
    for size, part in _grouped(records, lambda r: r.size):
        yield _row(f'{"all effects":{WIDTH}} {size:4g}', part)
        for group, some in _grouped(part, lambda r: f'{r.cell}, {r.noise}'):
            yield _row(f'  {group:{WIDTH - 2}} {size:4g}', some)
        yield f'  verdicts: {_verdicts(part)}'


def _head(first: str, second: str) -> str:
    naming = ' '.join(f'{name:>7}' for name in NAMINGS)
    return (
        f'{first:{WIDTH}} {second:>4} {"runs":>5} {naming} {"more":>5} | held-out N: before after (true) '
        f'{"<1.05":>5} | z: before after (true) {"<4":>5} | values {"<4":>4}'
    )


def _row(first: str, records: Sequence[Record]) -> str:
    counts = Counter(name for r in records for name in r.naming.values())
    naming = ' '.join(f'{counts[name]:7}' for name in NAMINGS)
    more = sum(bool(r.more) for r in records)
    held_out = [_median(r.held_out[k] for r in records) for k in range(3)]
    z = [_median(r.z[k] for r in records) for k in range(3)]
    values = [r.value_z for r in records if np.isfinite(r.value_z)]
    return (
        f'{first} {len(records):5} {naming} {more:5} | {held_out[0]:18.3f} {held_out[1]:5.3f} ({held_out[2]:5.3f}) '
        f'{_percent(sum(predicts_like_truth(r) for r in records), records):>5} | {z[0]:9.1f} {z[1]:5.1f} ({z[2]:4.1f}) '
        f'{_percent(sum(unbiased(r) for r in records), records):>5} | '
        f'{_percent(sum(value < WITHIN for value in values), values):>11}'
    )


def confusion_table(records: Sequence[Record]) -> Iterator[str]:
    """The effects named for each true effect, all sizes together."""
    yield from _title('Simulated effect: effects named, a|b rivals (all sizes)')
    for label, part in _grouped(records, lambda r: r.simulated[0]):
        yield f'{label:{WIDTH}} {_listed(Counter(map(named_text, part)), 8)}'
    sizes = [len(group) for r in records for group in r.rivals]
    if sizes:
        yield f'groups of rivals: {len(sizes)}, of {np.median(sizes):g} in the median, {max(sizes)} at most'


def pair_table(records: Sequence[Record]) -> Iterator[str]:
    """Two effects at once."""
    if not records:
        return
    yield from _title('Two effects at once, each of the size that by itself gives 2: both named, one, neither')
    groups = [*_grouped(records, lambda r: ' + '.join(r.simulated)), ('all pairs', list(records))]
    for label, part in groups:
        rights = Counter(sum(name in (ALONE, RIVALS) for name in r.naming.values()) for r in part)
        held_out = [_median(r.held_out[k] for r in part) for k in range(3)]
        yield (
            f'{label:54} {len(part):4} runs: {rights[2]:4} {rights[1]:4} {rights[0]:4}  more {sum(map(_more, part)):3}'
            f' | held-out {held_out[0]:.3f} {held_out[1]:.3f} ({held_out[2]:.3f})'
            f' | z < 4 {_percent(sum(unbiased(r) for r in part), part):>5} | {_verdicts(part)}'
        )
    both = sum(correctly_named(r) for r in records)
    yield f'both named: {both} of {len(records)}, {_percent(both, records)}'


def unlisted_table(records: Sequence[Record]) -> Iterator[str]:
    """Effects that the catalogue does not have."""
    if not records:
        return
    yield from _title('Effects outside the list: part of the possible reduction of the held-out error, verdicts')
    for (label, size), part in _grouped(records, lambda r: (r.simulated[0], r.size)):
        falls = [error_reduction(r) for r in part]
        enough = sum(fall >= REQUIRED_REDUCTION for fall in falls)
        yield (
            f'{label:{WIDTH}} {size:4g} {len(part):5} runs: reduction {_median(falls):5.2f} in the median, '
            f'{np.nanmin(falls):5.2f} at least, enough in {_percent(enough, part)} | '
            f'{_verdicts(part)} | {_listed(Counter(map(named_text, part)), 3)}'
        )
    silent, enough = (
        sum(r.verdict == 'none' for r in records),
        sum(error_reduction(r) >= REQUIRED_REDUCTION for r in records),
    )
    yield f'verdict none: {silent} of {len(records)}; reduced by two thirds: {enough}, {_percent(enough, records)}'


def time_lines(records: Sequence[Record]) -> Iterator[str]:
    """CPU time of a diagnosis."""
    if not records:
        return
    yield from _title('CPU time of a diagnosis of 108 touches, s')
    for section, part in [*_grouped(records, lambda r: r.section), ('all', list(records))]:
        times = np.array([r.cpu for r in part])
        slowest = part[int(np.argmax(times))]
        yield (
            f'{section:10} {len(part):5}: median {np.median(times):.2f}, 95 % below {np.quantile(times, 0.95):.2f}, '
            f'largest {times.max():.2f} ({" + ".join(slowest.simulated) or "clean"}, {slowest.cell}, '
            f'seed {slowest.seed}); below 2 s: {_percent(int((times < 2).sum()), part)}'
        )


def not_simulated(records: Sequence[Record]) -> Iterator[str]:
    """Effects that cannot be brought to a size."""
    missing = Counter((r.section, ' + '.join(r.simulated), r.size, r.cell, r.reason) for r in records if r.reason)
    if missing:
        yield from _title('Sizes that cannot be simulated')
        for (section, label, size, cell, reason), count in missing.items():
            yield f'{section:9} {label:{WIDTH}} {size:4g} {cell:6} {count:3} times: {reason}'


def summary(records: Sequence[Record]) -> Iterator[str]:
    """The main figures beside their targets."""
    yield from _title('Targets')
    of = {name: [r for r in records if r.section == name] for name in ('clean', 'effects', 'pairs', 'unlisted')}
    plain, aliases = ([r for r in of['clean'] if bool(r.simulated) is alias] for alias in (False, True))
    visible = [r for r in of['effects'] if r.size == REFERENCE_SIZE]
    all_effects = [*of['effects'], *of['pairs']]
    wanted = (
        ('false alarms', '<= 2 %', plain, lambda r: r.verdict != 'none'),
        ('exact aliases: verdict none', '100 %', aliases, lambda r: r.verdict == 'none'),
        (f'effect of size {REFERENCE_SIZE:g}: detected', '>= 98 %', visible, lambda r: r.verdict != 'none'),
        (f'effect of size {REFERENCE_SIZE:g}: named, alone or among rivals', '>= 95 %', visible, correctly_named),
        (
            f'effect of size {REFERENCE_SIZE:g}: held-out error within 5 % of the true model',
            '100 %',
            visible,
            predicts_like_truth,
        ),
        ('two effects: both named', '>= 85 %', of['pairs'], correctly_named),
        ('outside the list: detected', '100 %', of['unlisted'], lambda r: r.verdict != 'none'),
        (
            'outside the list: fallen by two thirds',
            '100 %',
            of['unlisted'],
            lambda r: error_reduction(r) >= REQUIRED_REDUCTION,
        ),
        (
            'effects and pairs that were found: the parameters of the base model within 4 std',
            '100 %',
            [r for r in all_effects if r.verdict != 'none'],
            unbiased,
        ),
        ('outside the list: the parameters of the base model within 4 std', '100 %', of['unlisted'], unbiased),
        ('CPU time below 2 s', '100 %', records, lambda r: r.cpu < 2.0),
    )
    for text, bound, some, holds in wanted:
        if some:
            count = sum(map(holds, some))
            yield f'{text:72} {count:5} of {len(some):5} {_percent(count, some):>7}   target {bound}'


def failure_lines(records: Sequence[Record]) -> Iterator[str]:
    """One line per recording that failed, to be repeated."""
    failed = [(r, reason) for r in records if (reason := failure(r))]
    if not failed:
        return
    yield from _title(f'{len(failed)} failures; each is repeated by python -m benchmark.diagnosis --seeds 1 and')
    for r, reason in failed:
        effect = f' --effect {shlex.quote(r.simulated[0])}' if r.simulated else ' --clean 1'
        also = f' (+ {r.simulated[1]})' if len(r.simulated) > 1 else ''
        named = named_text(r) if r.verdict else r.error
        yield (
            f'--only {r.section} --cell {r.cell} --noise {r.noise} --first {r.seed}{effect}{also}'
            f'{"" if np.isnan(r.size) else f", size {r.size:g}"}: {reason}; {r.verdict} {named}; '
            f'chi2 {r.chi_square:.2f}, p {r.p_value:.1g}, left {r.remaining:.1g}, held-out '
            f'{r.held_out[0]:.3f} {r.held_out[1]:.3f} ({r.held_out[2]:.3f}), z {r.z[0]:.1f} {r.z[1]:.1f} ({r.z[2]:.1f})'
        )


def _more(r: Record) -> bool:
    return bool(r.more)


def _title(text: str) -> list[str]:
    return ['', text, '-' * min(len(text), 120)]


def _grouped(records: Iterable[Record], key: Callable[[Record], Key]) -> Iterator[tuple[Key, list[Record]]]:
    groups: dict[Key, list[Record]] = {}
    for record in records:
        groups.setdefault(key(record), []).append(record)
    yield from groups.items()


def _verdicts(records: Sequence[Record]) -> str:
    return _listed(Counter(r.verdict for r in records), 4)


def _listed(counts: Counter[str], most: int) -> str:
    common = [f'{word} {count}' for word, count in counts.most_common(most)]
    rest = sum(count for _, count in counts.most_common()[most:])
    return ', '.join(common + ([f'others {rest}'] if rest else []))


def _median(values: Iterable[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.median(finite)) if finite else np.nan


def _percent(count: int, of: Sequence[object]) -> str:
    return f'{100 * count / len(of):.3g} %' if of else '-'

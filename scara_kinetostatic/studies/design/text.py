"""The design study in words and tables, for a terminal and for the page."""

from __future__ import annotations

import math

import numpy as np

from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.render.quantities import SCALES, count
from scara_kinetostatic.studies.design.document import best_place
from scara_kinetostatic.studies.design.result import Choice, Design
from scara_kinetostatic.studies.design.sensitivity import Row
from scara_kinetostatic.studies.dial_gauge.text import Table

TITLES = {
    'levels': 'Force levels',
    'postures': 'Postures of the elbow',
    'discs': 'Discs touched',
    'radius': 'Radius of the discs',
    'placed': 'Discs placed anew',
}
NONE = '–'
"""Where something is not determined."""
UNDETERMINED = (
    'the tip is not determined',
    'the tip is not determined: the whole robot may be turned about the centre of a single disc',
)


def micro(value: float, digits: int = 3) -> str:
    """A length in µm."""
    return f'{1e6 * value:#.{digits}g}'.rstrip('.') if math.isfinite(value) else NONE


def asked(design: Design) -> str:
    """What is asked, in words."""
    load = f'under {design.question.load:g} N in any direction' if design.question.under_load else 'free'
    return f'standard deviation of the tip ({load}) at most {micro(design.question.accuracy)} µm anywhere'


def headline(design: Design) -> str:
    """The answer in one line."""
    number = len(design.smallest.plan)
    return f'{count(number, "touch", "touches")} reach {micro(design.question.accuracy)} µm'


def choice_sentences(choice: Choice, design: Design) -> list[str]:
    """What the set gives and what speaks for it."""
    n, check = len(choice.plan), choice.check
    worst = 'after the loss of any one touch' if choice is design.spare else 'at the worst place'
    sentences = [f'{n} touches give {micro(choice.value)} µm {worst}. No set of fewer than {choice.least} can do it.']
    if choice.tried:
        fewer = max(choice.tried)
        reached = f'reaches {micro(choice.tried[fewer])} µm'
        if not math.isfinite(choice.tried[fewer]):
            reached = 'leaves a parameter undetermined'
        sentences.append(f'The best set of {fewer} touches that was found {reached}.')
    if choice is design.smallest:
        sentences.append(
            f'Leaving out any one touch gives {micro(check.without_each.min())} µm at best. Of {len(check.random)} '
            f'random sets of {n}, the best gives {micro(check.random[0])} µm, half of them more than '
            f'{micro(float(np.median(check.random)))} µm.'
        )
    lever = float(choice.row.prediction.leverage.max())
    sentences.append(
        f'The fit spends up to {100 * lever:.0f} % of a touch on itself'
        + ('; a bad reading there would go unnoticed.' if lever > 0.9 else '.')
    )
    sentences.append(f'Were the compliances half as large again, the tip would be {micro(check.softer)} µm off.')
    return sentences


def disc_sentences(design: Design) -> list[str]:
    """Where discs should stand."""
    sentences = []
    for placed in design.placed:
        if placed.row is None:
            continue
        places = ', '.join(f'({d.x:.3f}, {d.y:.3f}) m radius {d.radius:.3f} m' for d in placed.layout.discs)
        free = micro(placed.row.free.largest)
        found = (
            UNDETERMINED[len(placed.layout.discs) == 1]
            if free == NONE
            else f'{free} µm with {design.question.number} touches'
        )
        needed = f'; {placed.needed} touches reach the accuracy' if placed.needed else ''
        sentences.append(f'{count(len(placed.layout.discs), "disc")}: {places}: {found}{needed}.')
    place, one_more = best_place(design), design.map
    if place is not None:
        sentences.append(
            f'One more disc of radius {one_more.radius:.3f} m helps most at ({place[0]:.2f}, {place[1]:.2f}) m: with '
            f'{one_more.touches[1]} touches there, {micro(place[2])} µm instead of {micro(one_more.without)} µm with '
            f'as many more touches on the discs that are there.'
        )
    return sentences


def comparison(title: str, rows: list[Row]) -> Table:
    """One table of predictions."""
    heading = (title, 'rank', 'condition', 'O1', 'O2', 'O3', 'O4', 'O5', 'tip', 'rms', 'loaded', 'rms')
    units = ('', '', '', '', '', '', '', '', 'µm', 'µm', 'µm', 'µm')
    return Table(heading, units, tuple(_cells(row) for row in rows))


def _cells(row: Row) -> tuple[str, ...]:
    p = row.prediction
    tips = (row.free.largest, row.free.rms, row.loaded.largest, row.loaded.rms)
    indices = tuple(f'{value:.3g}' for value in p.indices)
    return (row.label, str(p.rank), f'{p.condition:.3g}', *indices, *(micro(value) for value in tips))


def parameter_table(design: Design) -> Table:
    """Predicted standard deviations of the twelve parameters: both sets, and touches spread evenly."""
    n = design.question.number
    every = next(row for row in reversed(design.tables['levels']))
    rows = [design.smallest.row, design.spare.row, every]
    heading = ('standard deviation', 'unit', 'smallest set', 'one to spare', f'{n} spread evenly')
    body = []
    for k, name in enumerate(NAMES):
        unit, per_si = SCALES[name]
        # lengths and angles of the geometry are known to micrometres
        if unit in ('mm', 'mrad'):
            unit, per_si = {'mm': 'µm', 'mrad': 'µrad'}[unit], 1e3 * per_si
        values = (row.prediction.std[k] * per_si for row in rows)
        body.append((name, unit, *(f'{value:.3g}' if math.isfinite(value) else 'not determined' for value in values)))
    return Table(heading, ('',) * 5, tuple(body))


def plan_table(choice: Choice, design: Design) -> Table:
    """The touches in their order."""
    plan, leverage = choice.plan, choice.row.prediction.leverage
    rows = tuple(
        (
            str(k),
            design.robot.cell.discs[plan.disc[k]].name,
            f'{np.degrees(plan.angle[k]):.0f}',
            'left' if plan.posture[k] > 0 else 'right',
            f'{plan.force[k]:g}',
            f'{100 * leverage[k]:.0f}',
            micro(choice.check.without_each[k]),
        )
        for k in range(len(plan))
    )
    return Table(('touch', 'disc', 'at', 'posture', 'force', 'leverage', 'without it'),
                 ('', '', 'deg', '', 'N', '%', 'µm'), rows)  # fmt: skip


def number_table(design: Design) -> Table:
    """Accuracy by the number of touches."""
    c = design.curve
    rows = tuple(
        (str(n), micro(a), micro(b), micro(r[1]), micro(low))
        for n, a, b, r, low in zip(c.number, c.chosen, c.spread, c.random, c.bound, strict=True)
    )
    return Table(('touches', 'chosen', 'spread evenly', 'random', 'no set below'), ('', 'µm', 'µm', 'µm', 'µm'), rows)


def tables(design: Design) -> dict[str, Table]:
    """The tables of what the accuracy depends on, in order."""
    placed = [placed.row for placed in design.placed if placed.row is not None]
    every = {**design.tables, 'placed': placed}
    return {name: comparison(TITLES[name], every[name]) for name in TITLES if every.get(name)}


def text(design: Design) -> str:
    """Everything for a terminal."""
    n = design.question.number
    parts = [
        f'{headline(design)}: {asked(design)}',
        '\n'.join(choice_sentences(design.smallest, design)),
        plain(plan_table(design.smallest, design)),
        'With one to spare: ' + '\n'.join(choice_sentences(design.spare, design)),
        plain(parameter_table(design)),
        'By the number of touches, largest standard deviation of the tip:\n' + plain(number_table(design)),
        f'{n} touches spread evenly; standard deviation of the tip, largest and rms over the workspace, free and under '
        f'{design.question.load:g} N; {NONE}: not determined',
        *(plain(table) for table in tables(design).values()),
        'Best places for discs\n' + '\n'.join(disc_sentences(design)),
    ]
    return '\n\n'.join(parts)


def plain(table: Table) -> str:
    """Aligned columns: text to the left, numbers to the right."""
    lines = [table.heading, *([table.units] if any(table.units) else []), *table.rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(table.heading))]
    right = [is_number(table, k) for k in range(len(widths))]
    return '\n'.join(
        '  '.join(
            cell.rjust(width) if aside else cell.ljust(width)
            for cell, width, aside in zip(line, widths, right, strict=True)
        ).rstrip()
        for line in lines
    )


def is_number(table: Table, column: int) -> bool:
    """Whether a column holds numbers, which are set to the right."""
    return all(row[column][:1].isdigit() or row[column] in (NONE, 'not determined') for row in table.rows)

"""The design as sentences and tables, for a terminal and for the page."""

from __future__ import annotations

import math

import numpy as np

from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.render.quantities import SCALES, count
from scara_kinetostatic.render.table import NOT_DETERMINED, Table
from scara_kinetostatic.studies.design.document import best_place
from scara_kinetostatic.studies.design.result import Design, DesignedSet
from scara_kinetostatic.studies.design.sensitivity import Row

_TITLES = {
    'levels': 'Force levels',
    'postures': 'Postures of the elbow',
    'discs': 'Discs touched',
    'radius': 'Radius of the discs',
    'placed': 'New layouts of discs',
}
_HIGH_LEVERAGE = 0.9
"""Leverage above which an error of a touch is hardly detected."""


def _micrometres(value: float, digits: int = 3) -> str:
    """A length in µm."""
    return f'{1e6 * value:#.{digits}g}'.rstrip('.') if math.isfinite(value) else NOT_DETERMINED


def requirement(design: Design) -> str:
    """The required accuracy in words."""
    load = f'under {design.requirements.load:g} N in any direction' if design.requirements.under_load else 'free'
    limit = _micrometres(design.requirements.accuracy)
    return f'standard deviation of the tip ({load}) at most {limit} µm over the workspace'


def headline(design: Design) -> str:
    """The result in one line."""
    number = len(design.smallest.plan)
    return f'{count(number, "touch", "touches")} reach {_micrometres(design.requirements.accuracy)} µm'


def set_sentences(designed: DesignedSet, design: Design) -> list[str]:
    """Accuracy and checks of a set, one sentence each."""
    n, check, um = len(designed.plan), designed.check, _micrometres
    where = 'after the loss of any one touch' if designed is design.spare else 'at the worst place of the workspace'
    sentences = [f'{n} touches give {um(designed.value)} µm {where}.']
    if designed.least > 0:
        sentences[0] += f' Lower bound for any set: {designed.least}.'
    if designed.tried:
        fewer = max(designed.tried)
        reached = f'gives {um(designed.tried[fewer])} µm'
        if not math.isfinite(designed.tried[fewer]):
            reached = 'does not determine all parameters'
        sentences.append(f'The best set of {fewer} touches found {reached}.')
    if designed is design.smallest:
        sentences.append(
            f'Without the touch that matters least: {um(check.without_each.min())} µm. {len(check.random)} random sets '
            f'of {n} touches: {um(check.random[0])} µm at best, {um(float(np.median(check.random)))} µm in the median.'
        )
    leverage = float(designed.row.prediction.leverage.max())
    sentences.append(
        f'Largest leverage of a touch: {100 * leverage:.0f} %'
        + (', an error in it would hardly be detected.' if leverage > _HIGH_LEVERAGE else '.')
    )
    sentences.append(f'With compliances 1.5 times as large: {um(check.more_compliant)} µm.')
    return sentences


def disc_sentences(design: Design) -> list[str]:
    """The best places for discs, one sentence per number of discs."""
    sentences = []
    for placed in design.placed:
        if placed.row is None:
            continue
        number = len(placed.layout.discs)
        places = ', '.join(f'({d.x:.3f}, {d.y:.3f}) m radius {d.radius:.3f} m' for d in placed.layout.discs)
        reached = f'{_micrometres(placed.row.free.largest)} µm with {design.requirements.number} touches'
        if not math.isfinite(placed.row.free.largest):
            alone = ': touches of one disc do not determine the rotation about its centre' if number == 1 else ''
            reached = f'the tip is not determined{alone}'
        needed = f'; {placed.needed} touches reach the accuracy' if placed.needed else ''
        sentences.append(f'{count(number, "disc")}: {places}: {reached}{needed}.')
    place, additional = best_place(design), design.additional_disc
    if place is not None:
        sentences.append(
            f'An additional disc of radius {additional.radius:.3f} m is best at ({place[0]:.2f}, {place[1]:.2f}) m: '
            f'{_micrometres(place[2])} µm with {additional.touches[1]} touches there, against '
            f'{_micrometres(additional.without)} µm with as many more touches on the discs of the cell.'
        )
    return sentences


def _prediction_table(title: str, rows: list[Row]) -> Table:
    """One row per prediction: rank, condition, observability indices, tip."""
    heading = (title, 'rank', 'condition', 'O1', 'O2', 'O3', 'O4', 'O5', 'tip', 'rms', 'loaded', 'rms')
    units = ('', '', '', '', '', '', '', '', 'µm', 'µm', 'µm', 'µm')
    return Table(heading, units, tuple(_cells(row) for row in rows))


def _cells(row: Row) -> tuple[str, ...]:
    p = row.prediction
    tips = (row.free.largest, row.free.rms, row.loaded.largest, row.loaded.rms)
    indices = tuple(f'{value:.3g}' for value in p.indices)
    return (row.label, str(p.rank), f'{p.condition:.3g}', *indices, *(_micrometres(value) for value in tips))


def parameter_table(design: Design) -> Table:
    """Predicted standard deviations of the twelve parameters: both sets, and touches evenly distributed."""
    n = design.requirements.number
    every = design.tables['levels'][-1]
    rows = [design.smallest.row, design.spare.row, every]
    heading = ('standard deviation', 'unit', 'smallest set', 'one to spare', f'{n} evenly distributed')
    body = []
    for k, name in enumerate(NAMES):
        unit, per_si = SCALES[name]
        if unit in ('mm', 'mrad'):  # uncertainties of the geometry are some micrometres and microradians
            unit, per_si = {'mm': 'µm', 'mrad': 'µrad'}[unit], 1e3 * per_si
        values = (row.prediction.std[k] * per_si for row in rows)
        body.append((name, unit, *(f'{value:.3g}' if math.isfinite(value) else 'not determined' for value in values)))
    return Table(heading, ('',) * 5, tuple(body))


def plan_table(designed: DesignedSet, design: Design) -> Table:
    """The touches in their order."""
    plan, leverage = designed.plan, designed.row.prediction.leverage
    rows = tuple(
        (
            str(k),
            design.robot.cell.discs[plan.disc[k]].name,
            f'{np.degrees(plan.angle[k]):.0f}',
            'left' if plan.posture[k] > 0 else 'right',
            f'{plan.force[k]:g}',
            f'{100 * leverage[k]:.0f}',
            _micrometres(designed.check.without_each[k]),
        )
        for k in range(len(plan))
    )
    return Table(('touch', 'disc', 'angle', 'posture', 'force', 'leverage', 'tip without it'),
                 ('', '', 'deg', '', 'N', '%', 'µm'), rows)  # fmt: skip


def number_table(design: Design) -> Table:
    """Accuracy by the number of touches."""
    c = design.curve
    rows = tuple(
        (str(number), *(_micrometres(value) for value in values))
        for number, *values in zip(c.number, c.chosen, c.even, c.random[:, 1], c.bound, strict=True)
    )
    heading = ('touches', 'best set found', 'evenly distributed', 'random (median)', 'lower bound')
    return Table(heading, ('', 'µm', 'µm', 'µm', 'µm'), rows)


def factor_tables(design: Design) -> list[Table]:
    """The tables of what the accuracy depends on."""
    placed = [placed.row for placed in design.placed if placed.row is not None]
    every = {**design.tables, 'placed': placed}
    return [_prediction_table(title, every[name]) for name, title in _TITLES.items() if every.get(name)]


def text(design: Design) -> str:
    """The whole result for a terminal."""
    n = design.requirements.number
    parts = [
        f'{headline(design)}: {requirement(design)}',
        '\n'.join(set_sentences(design.smallest, design)),
        plan_table(design.smallest, design).text(),
        'With one touch to spare: ' + '\n'.join(set_sentences(design.spare, design)),
        parameter_table(design).text(),
        'Largest standard deviation of the tip by the number of touches\n' + number_table(design).text(),
        f'{n} touches evenly distributed: standard deviation of the tip, largest and rms over the workspace, free and '
        f'under {design.requirements.load:g} N; {NOT_DETERMINED}: not determined',
        *(table.text() for table in factor_tables(design)),
        'Best places for discs\n' + '\n'.join(disc_sentences(design)),
    ]
    return '\n\n'.join(parts)

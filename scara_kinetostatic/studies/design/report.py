"""`design.json`: the optimal design as data, SI units; null where a quantity is not determined.

The design as sentences and tables, for a terminal and for the page.

The files of a design: `design.html`, one self-contained page, `design.json`, and two plans of touches.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from scara_kinetostatic import __version__
from scara_kinetostatic.model.cell import Cell, Disc
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.report.figure import COLOURS, mark, style
from scara_kinetostatic.report.json_file import json_text
from scara_kinetostatic.report.page import page_template
from scara_kinetostatic.report.quantities import SCALES, count
from scara_kinetostatic.report.table import NOT_DETERMINED, Table
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.simulation.plan_file import POSTURE_NAMES, dump_plan
from scara_kinetostatic.studies.design import figures
from scara_kinetostatic.studies.design.candidates import MOST_LEVERAGE, TOUCHES_PER_DISC
from scara_kinetostatic.studies.design.optimal_design import (
    USUAL_ACCURACY,
    AccuracySource,
    Design,
    DesignedSet,
    PlacedDiscs,
    contributions,
)
from scara_kinetostatic.studies.design.prediction import TipStd
from scara_kinetostatic.studies.design.search import COMPLIANCE_FACTOR, MOST_TOUCHES, NOISE_FACTOR
from scara_kinetostatic.studies.design.sensitivity import BAND, Row

SCHEMA = 'scara_kinetostatic/design/1'


def design_document(design: Design) -> dict[str, Any]:
    """Plain JSON values."""
    q, robot, curve, additional = design.requirements, design.robot, design.curve, design.additional_disc
    place = design.additional_disc.best
    return {
        'schema': SCHEMA,
        'requirements': {
            'accuracy': q.accuracy,
            'accuracy_source': q.accuracy_source.value,
            'of': 'loaded tip' if q.under_load else 'free tip',
            'levels': list(q.levels),
            'postures': [POSTURE_NAMES[posture] for posture in q.postures],
            'load': q.load,
            'region': [_number(value) for value in q.region],
            'touches_compared': q.number,
            'seed': q.seed,
        },
        'robot': {
            'parameters': robot.parameters.as_dict(),
            'noise': robot.noise.as_dict(),
            'noise_assumed': list(robot.assumed),
        },
        'declared_uncertainties': _declared(design),
        'recommended': {
            **_designed_set(design.recommended, design),
            'most_leverage': MOST_LEVERAGE,
            'touches_on_discs': {use.name: use.touches for use in design.discs},
        },
        'smallest': _designed_set(design.smallest, design),
        'by_number': {
            'touches': curve.number.tolist(),
            'chosen': _numbers(curve.chosen),
            'evenly_distributed': _numbers(curve.even),
            'random': {f'{100 * share:g} %': _numbers(curve.random[:, k]) for k, share in enumerate(BAND)},
            'lower_bound': _numbers(curve.bound),
        },
        'tables': {name: [_row(row) for row in rows] for name, rows in design.tables.items()},
        'placed': [_placed(placed) for placed in design.placed],
        'additional_disc': {
            'radius': additional.radius,
            'touches': list(additional.touches),
            'without': _number(additional.without),
            'best': None if place is None else {'center': list(place[:2]), 'tip': place[2]},
        },
    }


def _declared(design: Design) -> dict[str, Any] | None:
    """What the cell declares as uncertain, and what it leaves however many touches are made; None without any."""
    declared = design.robot.declared
    if declared is None and design.in_base_frame is None:
        return None
    sources = () if declared is None else declared.prior.sources
    plate = design.plate
    return {
        'sources': [{'source': source.label, 'declared': source.std, 'unit': source.unit} for source in sources],
        'least_possible': design.least_possible,
        'frame': 'base' if plate is None else f'plate {plate.name}',
        'tip_in_base_frame': None if design.in_base_frame is None else _number(design.in_base_frame),
    }


def _designed_set(designed: DesignedSet, design: Design) -> dict[str, Any]:
    check, prediction = designed.check, designed.row.prediction
    return {
        **_row(designed.row),
        'value': designed.value,
        'lower_bound': designed.least,
        'smaller_sets': {str(number): _number(value) for number, value in sorted(designed.tried.items())},
        'largest_leverage': float(prediction.leverage.max()),
        'leverage': _numbers(prediction.leverage),
        'without_each_touch': _numbers(check.without_each),
        'held_out_ratio': _number(check.held_out),
        'std_growth_by_loss': _numbers(check.growth),
        'random_sets': {'number': len(check.random), 'best': _number(check.random[0]),
                        'median': _number(float(np.median(check.random)))},
        'more_compliant': {'factor': COMPLIANCE_FACTOR, 'largest': _number(check.more_compliant)},
        'more_noise': {'factor': NOISE_FACTOR, 'joint': _number(check.more_joint_noise),
                       'force': _number(check.more_force_noise)},
        'contributions': {kind: _number(value) for kind, value in contributions(prediction, design.tip).items()},
        'plan': _plan(designed.plan, design.robot.cell),
    }  # fmt: skip


def _plan(plan: Plan, cell: Cell) -> list[dict[str, Any]]:
    rows = zip(plan.disc, np.degrees(plan.angle), plan.posture, plan.force, strict=True)
    return [
        {
            'disc': cell.discs[d].name,
            'angle_deg': round(float(a), 9),
            'posture': POSTURE_NAMES[int(s)],
            'force': float(f),
        }
        for d, a, s, f in rows
    ]


def _row(row: Row) -> dict[str, Any]:
    p = row.prediction
    return {
        'label': row.label,
        'touches': p.touches,
        'rank': p.rank,
        'confounded': [list(group) for group in p.confounded],
        'condition': _number(p.condition),
        'observability': {name.upper(): _number(value) for name, value in p.indices._asdict().items()},
        'tip_free': _tip(row.free),
        'tip_loaded': _tip(row.loaded),
        'std': {name: _number(value) for name, value in zip(NAMES, p.std, strict=True)},
    }


def _tip(tip: TipStd) -> dict[str, float | None]:
    return {'largest': _number(tip.largest), 'rms': _number(tip.rms)}


def _placed(placed: PlacedDiscs) -> dict[str, Any]:
    return {
        'discs': [_disc(disc) for disc in placed.layout.discs],
        'prediction': None if placed.row is None else _row(placed.row),
        'touches_needed': placed.needed,
    }


def _disc(disc: Disc) -> dict[str, Any]:
    return {'name': disc.name, 'center': [disc.x, disc.y], 'radius': disc.radius}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _numbers(values: Any) -> list[float | None]:
    return [_number(value) for value in values]


_TITLES = {
    'levels': 'Force levels',
    'postures': 'Postures of the elbow',
    'discs': 'Discs touched',
    'radius': 'Radius of the discs',
    'placed': 'New layouts of discs',
}
_NAMED_PART = 0.05
"""Smallest contribution that is named, in largest ones."""


def _micrometres(value: float, digits: int = 3) -> str:
    """A length in µm."""
    return f'{1e6 * value:#.{digits}g}'.rstrip('.') if math.isfinite(value) else NOT_DETERMINED


def requirement(design: Design) -> str:
    """The required accuracy in words."""
    load = f'under {design.requirements.load:g} N in any direction' if design.requirements.under_load else 'free'
    limit = _micrometres(design.requirements.accuracy)
    frame = f', in the frame of plate {design.plate.name}' if design.plate else ''
    return f'standard deviation of the tip ({load}) at most {limit} µm over the workspace{frame}'


def headline(design: Design) -> str:
    """The result in one line."""
    number, limit = len(design.recommended.plan), _micrometres(design.requirements.accuracy)
    return f'{count(number, "touch", "touches")} reach {limit} µm and check themselves'


def noise_sentences(design: Design) -> list[str]:
    """The noise of a touch and where it comes from, and how the result depends on it."""
    robot, check = design.robot, design.recommended.check
    said = {'joint': f'{robot.noise.joint_rms:.3g} rad', 'force': f'{robot.noise.force_rms:.3g} N'}
    grown = f', and {100 * robot.noise.growth:.3g} % of the force' if robot.noise.growth else ''
    of_touch = f'{said["joint"]} (joint), {said["force"]} (force){grown}'
    first = f'Noise of a touch: {of_touch}.'
    if robot.assumed:
        parts = ' and '.join(robot.assumed)
        first = (
            f'Noise of a touch is assumed: {of_touch}; the cell description does not state that of {parts}. '
            'Calibrate once, and state the noise that it estimates.'
        )
    um = _micrometres
    scaling = 'what noise contributes' if robot.declared else 'every standard deviation'
    return [
        first,
        f'{scaling[0].upper()}{scaling[1:]} is proportional to the noise, the number of touches for an accuracy to its '
        f'square. The recommended touches with twice the joint noise: {um(check.more_joint_noise)} µm, with twice the '
        f'force noise: {um(check.more_force_noise)} µm.',
    ]


def condition_sentences(design: Design) -> list[str]:
    """What was declared as uncertain, what it leaves, where the accuracy comes from, and discs that are not used."""
    q, um, sentences = design.requirements, _micrometres, []
    if q.accuracy_source is AccuracySource.TOLERANCE:
        sentences.append(f'{um(q.accuracy)} µm is half the tolerance of the tip, which holds for k = 2.')
    elif q.accuracy_source is AccuracySource.ATTAINABLE:
        sentences.append(
            f'No accuracy was required; {um(q.accuracy)} µm because the usual {um(USUAL_ACCURACY)} µm is out of reach.'
        )
    if design.robot.declared is not None:
        parts = contributions(design.recommended.row.prediction, design.tip)
        largest = sorted(parts.items(), key=lambda item: -item[1])
        said = ', '.join(f'{kind} {um(value)} µm' for kind, value in largest if value >= _NAMED_PART * largest[0][1])
        sentences += [
            f'Declared uncertainties count: {MOST_TOUCHES} touches, evenly distributed, would leave '
            f'{um(design.least_possible)} µm.',
            f'Contributions at the worst place with the recommended touches: {said}.',
        ]
    else:
        sentences.append('Discs and force sensor count as exactly known: the cell declares no uncertainty of them.')
    if design.plate is not None and design.in_base_frame is not None:
        sentences.append(
            f'All discs stand on plate {design.plate.name}, whose place no touch shows. The accuracy holds in its '
            f'frame; in the base frame the recommended touches give {1e3 * design.in_base_frame:.3g} mm.'
        )
    return sentences + _unused(design)


def _unused(design: Design) -> list[str]:
    """Why discs of the cell are not touched, or hardly."""
    sentences, number = [], len(design.recommended.plan)
    for use in design.discs:
        if use.touches >= TOUCHES_PER_DISC:
            continue
        said = (
            f'{use.name} is not used'
            if not use.touches
            else f'{use.name} has {count(use.touches, "touch", "touches")} only'
        )
        why = f'{number} touches are enough, and {TOUCHES_PER_DISC} on every disc would be more'
        if use.candidates < TOUCHES_PER_DISC:
            why = 'within reach there is no other touch of it whose line of force keeps clear of the joint axes'
        sentences.append(f'{said}: {why}.')
    return sentences


def set_sentences(designed: DesignedSet, design: Design) -> list[str]:
    """Accuracy and checks of a set, one sentence each."""
    return _recommended(designed, design) if designed is design.recommended else _smallest(designed, design)


def _recommended(designed: DesignedSet, design: Design) -> list[str]:
    n, check, um = len(designed.plan), designed.check, _micrometres
    sentences = [
        f'{n} touches give {um(design.tip_of(designed).largest)} µm at the worst place of the workspace, and '
        f'{um(designed.value)} µm after the loss of any one touch. Lower bound for any set that survives a loss: '
        f'{designed.least}.'
    ]
    if designed.tried:
        fewer = max(designed.tried)
        reached = f'gives {um(designed.tried[fewer])} µm after a loss'
        if not math.isfinite(designed.tried[fewer]):
            reached = 'does not check itself'
        sentences.append(f'The best set of {fewer} touches found {reached}.')
    sentences += [
        f'Every touch is checked by the others: largest leverage {100 * designed.row.prediction.leverage.max():.0f} %. '
        f'The loss of one makes the standard deviation of no parameter more than {check.growth.max():.2g} times as '
        f'large. Touches that a fit has not seen are predicted with {check.held_out:.2g} times its force error.',
        f'{len(check.random)} random sets of {n} touches: {um(check.random[0])} µm at best, '
        f'{um(float(np.median(check.random)))} µm in the median.',
        f'With compliances 1.5 times as large: {um(check.more_compliant)} µm.',
    ]
    return sentences


def _smallest(designed: DesignedSet, design: Design) -> list[str]:
    n, check, um = len(designed.plan), designed.check, _micrometres
    sentences = [
        f'{n} touches give {um(designed.value)} µm as long as none fails. Lower bound for any set: {designed.least}.'
    ]
    if designed.tried:
        fewer = max(designed.tried)
        reached = f'gives {um(designed.tried[fewer])} µm'
        if not math.isfinite(designed.tried[fewer]):
            reached = 'does not determine all parameters'
        sentences.append(f'The best set of {fewer} touches found {reached}.')
    sentences.append(
        f'Without the touch that matters most: {um(float(check.without_each.max()))} µm; without the one that matters '
        f'least: {um(float(check.without_each.min()))} µm.'
    )
    leverage = designed.row.prediction.leverage
    high = np.flatnonzero(leverage > MOST_LEVERAGE)
    unchecked = f'Largest leverage of a touch: {100 * leverage.max():.0f} %.'
    if len(high):
        listed = ' '.join(str(k) for k in high)
        unchecked += f' The others do not check touches {listed}: an error in one of them would hardly be detected.'
    return [*sentences, unchecked]


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
        needed = f'; the smallest set at all has {placed.needed} touches' if placed.needed else ''
        sentences.append(f'{count(number, "disc")}: {places}: {reached}{needed}.')
    place, additional = design.additional_disc.best, design.additional_disc
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
    rows = [design.recommended.row, design.smallest.row, every]
    heading = ('standard deviation', 'unit', 'recommended', 'smallest set', f'{n} evenly distributed')
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
        '\n'.join(noise_sentences(design)),
        f'{headline(design)}: {requirement(design)}',
        '\n'.join([*condition_sentences(design), *set_sentences(design.recommended, design)]),
        plan_table(design.recommended, design).text(),
        'The smallest set at all, not recommended: ' + '\n'.join(set_sentences(design.smallest, design)),
        parameter_table(design).text(),
        'Largest standard deviation of the tip by the number of touches\n' + number_table(design).text(),
        f'{n} touches evenly distributed: standard deviation of the tip, largest and rms over the workspace, free and '
        f'under {design.requirements.load:g} N; {NOT_DETERMINED}: not determined',
        *(table.text() for table in factor_tables(design)),
        'Best places for discs\n' + '\n'.join(disc_sentences(design)),
    ]
    return '\n\n'.join(parts)


PLAN, SMALLEST_PLAN = 'plan.yaml', 'plan_smallest.yaml'
_TEMPLATE = Path(__file__).parent / 'page.html.j2'


def html_text(design: Design) -> str:
    """The page."""
    with style():
        pictures = {
            'number': figures.number_picture(design),
            'without': figures.without_picture(design),
            'random': figures.random_picture(design),
            'tip': figures.tip_picture(design),
            'recommended': figures.plan_picture(design.recommended, design, 'recommended'),
            'smallest': figures.plan_picture(design.smallest, design, 'smallest'),
            'additional_disc': figures.additional_disc_picture(design),
            'placed': figures.placed_picture(design) if any(placed.row for placed in design.placed) else None,
        }
    discs = design.robot.cell.discs
    marks = [mark(number) for number in range(len(discs))]
    return page_template(_TEMPLATE).render(
        version=__version__,
        design=design,
        pictures=pictures,
        headline=headline(design),
        requirement=requirement(design),
        noise=noise_sentences(design),
        conditions=condition_sentences(design),
        recommended=set_sentences(design.recommended, design),
        smallest=set_sentences(design.smallest, design),
        places=disc_sentences(design),
        plan=plan_table(design.recommended, design),
        smallest_plan=plan_table(design.smallest, design),
        parameters=parameter_table(design),
        numbers=number_table(design),
        tables=factor_tables(design),
        legend=[(each.sign, COLOURS[each.colour], disc.name) for each, disc in zip(marks, discs, strict=True)],
    )


def design_files(design: Design) -> dict[str, str]:
    """The text of each file of a design by its name: both plans, the numbers, the page."""
    cell = design.robot.cell
    remarks = (*noise_sentences(design), *condition_sentences(design))
    return {
        PLAN: dump_plan(design.recommended.plan, cell, (*remarks, *set_sentences(design.recommended, design))),
        SMALLEST_PLAN: dump_plan(design.smallest.plan, cell, (*remarks, *set_sentences(design.smallest, design))),
        'design.json': json_text(design_document(design)),
        'design.html': html_text(design),
    }

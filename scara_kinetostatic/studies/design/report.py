"""The optimal design as JSON, for the terminal and as a page."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup

from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.report import (
    NOT_DETERMINED,
    Block,
    Figure,
    Legend,
    Note,
    Report,
    Section,
    Table,
    Verdict,
    as_page,
    json_text,
)
from scara_kinetostatic.report.figure import COLOURS, mark
from scara_kinetostatic.report.quantities import SCALES, count
from scara_kinetostatic.simulation.plan_file import POSTURE_NAMES, dump_plan
from scara_kinetostatic.studies.design import figures
from scara_kinetostatic.studies.design.candidates import MOST_LEVERAGE, TOUCHES_PER_DISC
from scara_kinetostatic.studies.design.optimal_design import USUAL_ACCURACY, AccuracySource, Design, contributions
from scara_kinetostatic.studies.design.search import COMPLIANCE_FACTOR, MOST_TOUCHES, NOISE_FACTOR
from scara_kinetostatic.studies.design.sensitivity import BAND, Row


def design_document(design: Design) -> dict[str, Any]:
    """`design.json`: SI units; None where a quantity is not determined."""
    q, robot, curve, additional = design.requirements, design.robot, design.curve, design.additional_disc
    place = additional.best
    return {
        'schema': 'scara_kinetostatic/design/1',
        'requirements': {
            'accuracy': q.accuracy,
            'accuracy_source': q.accuracy_source.value,
            'of': 'loaded tip' if q.under_load else 'free tip',
            'levels': q.levels,
            'postures': [POSTURE_NAMES[posture] for posture in q.postures],
            'load': q.load,
            'region': list(q.region),
            'touches_compared': q.number,
            'seed': q.seed,
        },
        'robot': {
            'parameters': robot.parameters.as_dict(),
            'noise': robot.noise.as_dict(),
            'noise_assumed': robot.assumed,
        },
        'declared_uncertainties': _declared(design),
        'recommended': _recommended(design),
        'by_number': {
            'touches': curve.number,
            'chosen': curve.chosen,
            'evenly_distributed': curve.even,
            'random': {f'{100 * share:g} %': curve.random[:, k] for k, share in enumerate(BAND)},
            'lower_bound': curve.bound,
        },
        'tables': {name: [_row(row) for row in rows] for name, rows in design.tables.items()},
        'placed': [
            {
                'discs': [
                    {'name': disc.name, 'center': (disc.x, disc.y), 'radius': disc.radius} for disc in layout.discs
                ],
                'prediction': None if row is None else _row(row),
            }
            for layout, row in design.placed
        ],
        'additional_disc': {
            'radius': additional.radius,
            'touches': additional.touches,
            'without': additional.without,
            'best': None if place is None else {'center': place[:2], 'tip': place[2]},
        },
    }


def _declared(design: Design) -> dict[str, Any] | None:
    """What the cell declares as uncertain, and what it leaves however many touches are made; None without any."""
    declared, plate = design.robot.declared, design.plate
    if declared is None and design.in_base_frame is None:
        return None
    sources = () if declared is None else declared.prior.sources
    return {
        'sources': [{'source': source.label, 'declared': source.std, 'unit': source.unit} for source in sources],
        'least_possible': design.least_possible,
        'frame': 'base' if plate is None else f'plate {plate.name}',
        'tip_in_base_frame': design.in_base_frame,
    }


def _recommended(design: Design) -> dict[str, Any]:
    """The recommended set with its checks."""
    designed, discs = design.recommended, design.robot.cell.discs
    check, prediction, plan = designed.check, designed.row.prediction, designed.plan
    touches = zip(plan.disc, np.degrees(plan.angle), plan.posture, plan.force, strict=True)
    return {
        **_row(designed.row),
        'value': designed.value,
        'lower_bound': designed.least,
        'smaller_sets': {str(number): value for number, value in sorted(designed.tried.items())},
        'largest_leverage': float(prediction.leverage.max()),
        'leverage': prediction.leverage,
        'without_each_touch': check.without_each,
        'held_out_ratio': check.held_out,
        'std_growth_by_loss': check.growth,
        'random_sets': {
            'number': len(check.random),
            'best': float(check.random[0]),
            'median': float(np.median(check.random)),
        },
        'more_compliant': {'factor': COMPLIANCE_FACTOR, 'largest': check.more_compliant},
        'more_noise': {'factor': NOISE_FACTOR, 'joint': check.more_joint_noise, 'force': check.more_force_noise},
        'contributions': contributions(prediction, design.tip),
        'plan': [
            {
                'disc': discs[disc].name,
                'angle_deg': round(float(angle), 9),
                'posture': POSTURE_NAMES[int(posture)],
                'force': float(force),
            }
            for disc, angle, posture, force in touches
        ],
        'most_leverage': MOST_LEVERAGE,
        'touches_on_discs': {use.name: use.touches for use in design.discs},
    }


def _row(row: Row) -> dict[str, Any]:
    p = row.prediction
    return {
        'label': row.label,
        'touches': p.touches,
        'rank': p.rank,
        'confounded': p.confounded,
        'condition': p.condition,
        'observability': {name.upper(): value for name, value in p.indices._asdict().items()},
        'tip_free': {'largest': row.free.largest, 'rms': row.free.rms},
        'tip_loaded': {'largest': row.loaded.largest, 'rms': row.loaded.rms},
        'std': dict(zip(NAMES, p.std.tolist(), strict=True)),
    }


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
        said = ', '.join(f'{kind} {um(value)} µm' for kind, value in largest if value >= 0.05 * largest[0][1])
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


def set_sentences(design: Design) -> list[str]:
    """Accuracy and checks of the recommended set, one sentence each."""
    designed, um = design.recommended, _micrometres
    n, check = len(designed.plan), designed.check
    sentences = [
        f'{n} touches give {um(design.tip_std.largest)} µm at the worst place of the workspace, and '
        f'{um(designed.value)} µm after the loss of any one touch. Lower bound for any set that survives a loss: '
        f'{designed.least}.'
    ]
    if designed.tried:
        fewer = max(designed.tried)
        reached = f'gives {um(designed.tried[fewer])} µm after a loss'
        if not math.isfinite(designed.tried[fewer]):
            reached = 'does not check itself'
        sentences.append(f'The best set of {fewer} touches found {reached}.')
    return [
        *sentences,
        f'Every touch is checked by the others: largest leverage {100 * designed.row.prediction.leverage.max():.0f} %. '
        f'The loss of one makes the standard deviation of no parameter more than {check.growth.max():.2g} times as '
        f'large. Touches that a fit has not seen are predicted with {check.held_out:.2g} times its force error.',
        f'{len(check.random)} random sets of {n} touches: {um(check.random[0])} µm at best, '
        f'{um(float(np.median(check.random)))} µm in the median.',
        f'With compliances 1.5 times as large: {um(check.more_compliant)} µm.',
    ]


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
        sentences.append(f'{count(number, "disc")}: {places}: {reached}.')
    place, additional = design.additional_disc.best, design.additional_disc
    if place is not None:
        sentences.append(
            f'An additional disc of radius {additional.radius:.3f} m is best at ({place[0]:.2f}, {place[1]:.2f}) m: '
            f'{_micrometres(place[2])} µm with {additional.touches[1]} touches there, against '
            f'{_micrometres(additional.without)} µm with as many more touches on the discs of the cell.'
        )
    return sentences


def parameter_table(design: Design) -> Table:
    """Predicted standard deviations of the twelve parameters: the recommended set, and touches evenly distributed."""
    rows = [design.recommended.row, design.tables['levels'][-1]]
    heading = ('standard deviation', 'unit', 'recommended', f'{design.requirements.number} evenly distributed')
    body = []
    for k, name in enumerate(NAMES):
        unit, per_si = SCALES[name]
        if unit in ('mm', 'mrad'):  # uncertainties of the geometry are some micrometres and microradians
            unit, per_si = {'mm': 'µm', 'mrad': 'µrad'}[unit], 1e3 * per_si
        values = (row.prediction.std[k] * per_si for row in rows)
        body.append((name, unit, *(f'{value:.3g}' if math.isfinite(value) else 'not determined' for value in values)))
    return Table(heading, ('',) * 4, tuple(body))


def plan_table(design: Design) -> Table:
    """The recommended touches in their order."""
    designed = design.recommended
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
    heading = ('touch', 'disc', 'angle', 'posture', 'force', 'leverage', 'tip without it')
    return Table(heading, ('', '', 'deg', '', 'N', '%', 'µm'), rows)


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
    """The tables of what the accuracy depends on, one row per prediction."""
    every = {
        'Force levels': design.tables['levels'],
        'Postures of the elbow': design.tables['postures'],
        'Discs touched': design.tables['discs'],
        'Radius of the discs': design.tables['radius'],
        'New layouts of discs': [placed.row for placed in design.placed if placed.row is not None],
    }
    heading = ('rank', 'condition', 'O1', 'O2', 'O3', 'O4', 'O5', 'tip', 'rms', 'loaded', 'rms')
    units = ('',) * 8 + ('µm',) * 4
    return [Table((title, *heading), units, tuple(map(_cells, rows))) for title, rows in every.items() if rows]


def _cells(row: Row) -> tuple[str, ...]:
    p = row.prediction
    tips = (row.free.largest, row.free.rms, row.loaded.largest, row.loaded.rms)
    indices = tuple(f'{value:.3g}' for value in p.indices)
    return (row.label, str(p.rank), f'{p.condition:.3g}', *indices, *map(_micrometres, tips))


def design_report(design: Design) -> Report:
    """The design for the terminal and for `design.html`."""
    q = design.requirements
    what = (
        f'{q.number} touches evenly distributed over all candidates: standard deviation of the tip, largest and rms '
        f'over workspace and postures, free and under {q.load:g} N in any direction; {NOT_DETERMINED}: not determined.'
    )
    indices = Note(
        'O1 to O5: observability indices of Borm and Menq, Driels and Pathre, Nahvi (two) and Sun and Hollerbach, of '
        'the Jacobian whitened by the noise and in units of each parameter’s plausible range. Larger is better.'
    )
    number = _picture(design, figures.number_picture, 'Dotted: lower bound for every set, repeated touches included.')
    return Report(
        title='Optimal design of a calibration',
        answer=Verdict(
            headline(design),
            'caution' if design.robot.assumed else 'good',
            (*noise_sentences(design), *set_sentences(design), *condition_sentences(design)),
        ),
        source=f'Required: {requirement(design)}.',
        blocks=(
            Section('The recommended touches', _touches(design)),
            Section('The parameters', (parameter_table(design),)),
            Section('Largest standard deviation of the tip by the number of touches', (number, number_table(design))),
            Section('What the accuracy depends on', (what, *factor_tables(design), indices)),
            Section('Best places for discs', (*disc_sentences(design), *_places(design))),
        ),
        footer='all numbers in full in design.json',
    )


def _picture(design: Design, draw: Callable[[Design], Markup], caption: str) -> Figure:
    return Figure(partial(draw, design), caption)


def _touches(design: Design) -> tuple[Block, ...]:
    """The recommended touches, as pictures and as a table."""
    marks = [(mark(number), disc.name) for number, disc in enumerate(design.robot.cell.discs)]
    legend = Legend((*((m.sign, COLOURS[m.colour], name) for m, name in marks), ('', '', 'hollow: posture right')))
    above = _picture(design, figures.plan_picture, 'From above; the length of a shaft is proportional to the force.')
    order = Note(
        'In the order of plan.yaml. Leverage: the share of a touch’s measurement that its own fitted value follows; at '
        '100 % no other touch checks it, and an error in it is not detected.'
    )
    tip = _picture(design, figures.tip_picture, 'Predicted standard deviation of the tip after a calibration.')
    return legend, above, plan_table(design), order, tip


def _places(design: Design) -> tuple[Figure, ...]:
    """Pictures of the best places for discs."""
    placed = f'For {design.requirements.number} touches evenly distributed; the rings are the reach of the arm.'
    radius, without = design.additional_disc.radius, 1e6 * design.additional_disc.without
    additional = (
        f'An additional disc of radius {radius:.3g} m: largest standard deviation of the tip by the place of its '
        f'centre; orange: the best place. With as many more touches on the discs of the cell instead: {without:.3g} µm.'
    )
    pictures = (_picture(design, figures.additional_disc_picture, additional),)
    if not any(layout.row for layout in design.placed):
        return pictures
    return (_picture(design, figures.placed_picture, placed), *pictures)


def design_files(design: Design) -> dict[str, str]:
    """The text of each file of a design by its name: the plan, the numbers, the page."""
    remarks = (*noise_sentences(design), *condition_sentences(design), *set_sentences(design))
    return {
        'plan.yaml': dump_plan(design.recommended.plan, design.robot.cell, remarks),
        'design.json': json_text(design_document(design)),
        'design.html': as_page(design_report(design)),
    }

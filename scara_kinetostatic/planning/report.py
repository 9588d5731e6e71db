"""The optimal design as JSON, for the terminal and as a page, with its figures.

These are the accuracy by the number of touches, and the set.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import FixedLocator, NullLocator

from scara_kinetostatic.model.parameters import IN_MICRO, MOMENTS, NAMES
from scara_kinetostatic.model.quantities import SCALES, count, micrometres, percentage
from scara_kinetostatic.planning.candidate_touches import MOST_TOUCHES
from scara_kinetostatic.planning.optimal_design import Design
from scara_kinetostatic.planning.prediction import Statement, tip_std
from scara_kinetostatic.report import figure as draw
from scara_kinetostatic.report.figure import SERIES, WARN
from scara_kinetostatic.report.page import Figure, Note, Report, Section, Table, Verdict
from scara_kinetostatic.simulation.plan import POSTURE_NAMES, dump_plan

_WIDTH = 920.0
_ABOUT_TOUCHES = (
    'In the order of plan.yaml. Every other touch of a disc and posture is pressed 30 % beyond its force and '
    'released to it (preload): friction and hysteresis are detectable only then. Decides: the share of a '
    'touch’s measurement that its own fitted value follows; at 100 % no other touch checks it, and an error in '
    'it is not detected.'
)
_HELPS = {
    'noise': 'repeat them',
    'object': 'measure the objects better, and declare it (objects: uncertainty)',
    'radius': 'measure the radii and that of the tip better, and declare it',
    '': 'where more is known of it than a typical size, state it (uncertainty: effects)',
}
"""What reduces the part of a source, by a word of it."""
_TICKS = np.outer(10.0 ** np.arange(3), (1, 1.5, 2, 3, 5, 7)).ravel().tolist()


def number_picture(design: Design) -> Markup:
    """Largest standard deviation of the tip over the number of touches: best and even."""
    figure, (axes,) = draw.new_figure(_WIDTH, 360)
    c, target = design.curve, IN_MICRO * design.accuracy
    axes.plot(c.touches, IN_MICRO * c.evenly_distributed, '--', color=SERIES[1], label='evenly distributed')
    axes.plot(c.touches, IN_MICRO * c.chosen, 'o-', color=SERIES[0], label='best set found')
    axes.axhline(target, color=WARN, lw=1.0, label='required')
    best = (len(design.plan), IN_MICRO * design.tip_std)
    axes.plot(*best, 'o', ms=11, mfc='none', mec=WARN)
    axes.annotate('recommended', best, (9, 7), textcoords='offset points', color=WARN)
    axes.set(xscale='log', yscale='log', xlabel='touches', ylabel='largest std of the tip  [µm]')
    for axis, ticks in ((axes.xaxis, c.touches.tolist()), (axes.yaxis, _TICKS)):
        axis.set(major_locator=FixedLocator(ticks), minor_locator=NullLocator())
        axis.set_major_formatter('{x:g}')
    axes.legend(frameon=False)
    return draw.as_svg(figure, 'number', 'largest standard deviation of the tip over the number of touches')


def design_document(design: Design) -> dict[str, Any]:
    """`design.json`: SI units; None where a quantity is not determined."""
    q, robot, declared = design.requirements, design.robot, design.robot.declared
    sources = () if declared is None else declared.prior.sources
    return {
        'schema': 'scara_kinetostatic/design/1',
        'requirements': {
            'accuracy': design.accuracy,
            'of': 'loaded tip' if q.under_load else 'free tip',
            'levels': q.levels,
            'postures': [POSTURE_NAMES[posture] for posture in q.postures],
            'load': q.load,
            'region': list(robot.cell.region),
        },
        'robot': {
            'parameters': robot.parameters.as_dict(),
            'noise': robot.noise.as_dict(),
            'noise_assumed': robot.assumed,
        },
        'declared_uncertainties': declared
        and {
            'sources': [{'source': source.label, 'declared': source.std, 'unit': source.unit} for source in sources],
            'least_possible': design.least_possible,
        },
        'recommended': _recommended(design),
        'expected': {'recommended': design.statement, 'touches': design.many[0], 'of_these': design.many[1]},
        'by_number': design.curve,
    }


def _recommended(design: Design) -> dict[str, Any]:
    """The recommended touches with their checks."""
    plan, discs, p = design.plan, design.robot.cell.discs, design.prediction
    touches = zip(plan.disc, np.degrees(plan.angle).round(9), plan.posture, plan.force, strict=True)
    free, loaded = (tip_std(tip, p) for tip in (design.tip[:, :1], design.tip[:, 1:]))
    return {
        'touches': p.touches,
        'rank': p.rank,
        'confounded': p.confounded,
        'tip_free': {'largest': free.max(), 'rms': np.sqrt(np.mean(free**2))},
        'tip_loaded': {'largest': loaded.max(), 'rms': np.sqrt(np.mean(loaded**2))},
        'std': dict(zip((NAMES + MOMENTS)[: len(p.std)], p.std.tolist(), strict=True)),
        'value': design.without_each.max(),
        'largest_leverage': p.leverage.max(),
        'leverage': p.leverage,
        'without_each_touch': design.without_each,
        'held_out_ratio': design.held_out,
        'contributions': design.contributions,
        'plan': [
            {'disc': discs[disc].name, 'angle_deg': angle, 'posture': POSTURE_NAMES[int(posture)], 'force': force}
            for disc, angle, posture, force in touches
        ],
    }


def noise_sentences(design: Design) -> list[str]:
    """The noise of a touch and where it comes from, and what the cell declares as uncertain."""
    robot, um = design.robot, micrometres
    growth = f', and {percentage(robot.noise.growth, ".3g")} of the force' if robot.noise.growth else ''
    of_touch = (
        f'{IN_MICRO * robot.noise.joint_rms:.3g} µrad per joint, {robot.noise.force_rms:.3g} N per component{growth}'
    )
    sentences = [f'Noise of a touch: {of_touch}.']
    if robot.assumed:
        sentences = [
            f'Noise of a touch is assumed: {of_touch}; the cell description does not state that of '
            f'{" and ".join(robot.assumed)}. Calibrate once, and state the noise that it estimates.'
        ]
    if robot.declared is None:
        what = 'discs and force sensor count as exactly known: the cell declares no uncertainty of them.'
        sentences.append(f'For the accuracy, {what}')
    else:
        parts = sorted(design.contributions.items(), key=lambda item: -item[1])
        said = ', '.join(f'{kind} {um(value)} µm' for kind, value in parts if value >= 0.05 * parts[0][1])
        sentences.append(
            f'Declared uncertainties count: {MOST_TOUCHES} touches, evenly distributed, would leave '
            f'{um(design.least_possible)} µm. At the worst place the recommended touches leave {said}.'
        )
    return sentences


def statement_sentences(statement: Statement, more: tuple[int, Statement]) -> list[str]:
    """What a calibration is expected to state, its largest sources, and whether more touches help; what helps else."""
    um, whole = micrometres, statement.expanded
    parts = ', '.join(f'{source} {um(2 * part)} µm' for source, part in [*statement.parts.items()][:3])
    number, (least, _) = more
    source, share = more[1].largest
    helps = next(action for word, action in _HELPS.items() if word in source)
    gain = 'More touches hardly help' if least > 0.9 * whole else 'More touches help'
    rest = f'{percentage(share)} of its variance is then from {source}: {helps}'
    return [
        f'A calibration with them is expected to state {um(whole)} µm (k = 2) at the worst place: errors too small '
        f'to be detected count, with typical sizes where nothing is declared. The largest parts (k = 2): {parts}.',
        f'{gain}: {number}, evenly distributed, would leave {um(least)} µm; {rest}.',
    ]


def set_sentences(design: Design) -> list[str]:
    """Accuracy and checks of the recommended set, one sentence each."""
    um = micrometres
    return [
        f'{len(design.plan)} touches give {um(design.tip_std)} µm at the worst place of the workspace, and '
        f'{um(design.without_each.max())} µm after the loss of any one touch.',
        'Every touch is checked by the others: none decides more of its own value than '
        f'{percentage(design.prediction.leverage.max())}. '
        f'Touches that a fit has not seen are predicted with {design.held_out:.2g} times its force error.',
    ]


def parameter_table(design: Design) -> Table:
    """Predicted standard deviations of the parameters with the recommended set."""
    body = []
    for name, std in zip(design.robot.parameters.names, design.prediction.std, strict=True):
        unit, per_si = SCALES[name]
        body.append((name, unit, f'{std * per_si:.3g}' if np.isfinite(std) else 'not determined'))
    return Table(('', 'unit', 'standard deviation'), ('',) * 3, tuple(body))


def plan_table(design: Design) -> Table:
    """The recommended touches in their order."""
    plan, discs = design.plan, design.robot.cell.discs
    columns = (
        ('touch', '', [str(k) for k in range(len(plan))]),
        ('disc', '', [discs[number].name for number in plan.disc]),
        ('angle', '°', [f'{angle:.0f}' for angle in np.degrees(plan.angle)]),
        ('posture', '', [POSTURE_NAMES[posture] for posture in plan.posture.tolist()]),
        ('force', 'N', [f'{force:g}' for force in plan.force]),
        ('decides', '%', [percentage(share).removesuffix(' %') for share in design.prediction.leverage]),
        ('tip without it', 'µm', list(map(micrometres, design.without_each))),
    )
    headings, units, cells = zip(*columns, strict=True)
    return Table(headings, units, tuple(zip(*cells, strict=True)))


def design_report(design: Design) -> Report:
    """The design for the terminal and for `design.html`."""
    number, accuracy = count(len(design.plan), 'touch', 'touches'), f'{micrometres(design.accuracy)} µm'
    load = f'under {design.requirements.load:g} N in any direction' if design.requirements.under_load else 'free'
    curve = Figure(partial(number_picture, design), 'Of the best set found, and of touches evenly distributed.')
    return Report(
        title='Optimal design of a calibration',
        answer=Verdict(
            f'{number} reach {accuracy} by their noise; a calibration is expected to state '
            f'{micrometres(design.statement.expanded)} µm (k = 2)',
            'caution' if design.robot.assumed or design.statement.expanded > 2 * design.accuracy else 'good',
            (*noise_sentences(design), *set_sentences(design), *statement_sentences(design.statement, design.many)),
        ),
        source=f'Required: standard deviation of the tip ({load}) at most {accuracy} over the workspace.',
        blocks=(
            Section('The recommended touches', (plan_table(design), Note(_ABOUT_TOUCHES))),
            Section('The parameters', (parameter_table(design),)),
            Section('Largest standard deviation of the tip by the number of touches', (curve,)),
        ),
        footer='all numbers in full in design.json',
    )


def plan_text(design: Design) -> str:
    """`plan.yaml`: the recommended touches, below what is to be known of them."""
    return dump_plan(design.plan, design.robot.cell, (*noise_sentences(design), *set_sentences(design)))

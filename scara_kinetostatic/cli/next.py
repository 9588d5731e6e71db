"""The touches to make next, and the program of the robot.

The touches that lower the uncertainty of the tip most, over the region of the
cell; without a recording the first ones, from the nominal model, whose contacts
may lie millimetres off. In the order of a short way, round the objects or over
them with a lift, within the limits of the joints. Says when it is enough: the
tolerance is reached, or more touches do not reach it, and then what limits.

Writes next.csv (the touches), plan.yaml (for simulate) and program.csv: every
step of the robot. Its hold lasts touch.hold of the cell.

--goal decide plans the touches that decide between causes that the recordings
do not distinguish, and says how likely the likeliest is expected to be then;
where touches hardly decide, what does.

--from plans the fewest touches that bring an earlier calibration up to date: the
tip as well known as before, and a slip of a joint that --free does not name shown.

Example:
  scara-kinetostatic next --cell cell.yaml --out first
  scara-kinetostatic next recording --cell cell.yaml --touches 6 --out more
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from scara_kinetostatic.cli.shared_arguments import FREE, note, out_option, print_result, progress, whole
from scara_kinetostatic.errors import CellError, ParameterError, UnsupportedDataError

if TYPE_CHECKING:
    from scara_kinetostatic.diagnosis.result import Diagnosis
    from scara_kinetostatic.model.cell import Cell
    from scara_kinetostatic.planning.next_touches import DecidingTouches, PlannedTouches, Planner


ARGUMENTS = (
    ('bags', 'BAG', Path, 'touches that were made: recordings, or touch tables (.csv)', {'nargs': '*'}),
    ('--cell', 'FILE', Path, 'cell description, with robot.limits', {'required': True}),
    ('--calibration', 'FILE', Path, 'calibration.json: its model; without a BAG its touches count, too'),
    ('--from', 'CALIBRATION.json', Path, 'plans the touches of `calibrate --from`', {'dest': 'earlier'}),
    FREE,
    ('--touches', 'N', whole(1), 'how many (default: 12, none where it is enough)'),
    ('--goal', '', ('accuracy', 'decide'), 'what for (default: accuracy)', {'default': 'accuracy'}),
    out_option(files='next.csv, plan.yaml, program.csv', required=True),
)


def run(args: argparse.Namespace) -> None:
    """Plans the touches.

    Raises:
        InputError: the cell, a recording or the calibration is wrong, or DIR cannot be written.
        UnsupportedDataError: no touch can be reached, the tolerance is out of reach, or nothing is to be decided.
    """
    from scara_kinetostatic.files.cell_file import load_cell
    from scara_kinetostatic.planning.next_touches import USUAL_NUMBER
    from scara_kinetostatic.planning.program import next_files

    cell = load_cell(args.cell)
    if cell.limits is None:
        problem = 'the limits of the joints are missing'
        raise CellError(f'{args.cell}: robot.limits', problem, 'add them: nothing is planned beyond')
    with progress() as show_progress:
        show_progress('touches made', 0.0)
        planner, found = _known(args, cell)
        show_progress('choosing touches', 0.5)
        number = args.touches or USUAL_NUMBER
        from_file = args.calibration is not None or args.earlier is not None
        decision = _decision(planner, found, number, from_file) if args.goal == 'decide' else None
        fewest = args.earlier and not args.touches
        planned = planner.fewest() if fewest else planner.accurate(number)
        planned = planner.discriminating(decision, number) if decision else planned
        files = next_files(planner, planned)
    if args.goal == 'accuracy' and not args.touches and not args.earlier and _is_enough(planner, planned):
        return
    text = _summary(planner, planned)
    if decision is not None:
        text += f'\npossible causes: {decision.outlook.causes}; the likeliest: {decision.outlook.forecast}'
    print_result(text, args.out, files)
    for text in planned.left_out:
        note(text)


def _decision(planner: Planner, found: Diagnosis | None, number: int, from_file: bool) -> DecidingTouches:
    """The touches that decide; `from_file`: the calibration was read, not made.

    Raises:
        UnsupportedDataError: nothing is to be decided, or no touches decide it.
    """
    if found is None:
        problem = '--goal decide: a calibration file does not tell what its possible causes predict'
        if not from_file:
            problem = '--goal decide: there is nothing to decide without recordings'
        raise UnsupportedDataError(problem, 'give BAG' + (' in place of --calibration' if from_file else ''))
    decision = planner.decision(number)
    if decision is None:
        what = f'--goal decide: nothing is to be decided: {found.verdict}'
        raise UnsupportedDataError(what, found.advice or 'leave out --goal decide')
    if not (outlook := decision.outlook).is_decisive:
        raise UnsupportedDataError(f'--goal decide: {outlook.causes}: {outlook.limits}', outlook.remedy)
    return decision


def _known(args: argparse.Namespace, cell: Cell) -> tuple[Planner, Diagnosis | None]:
    """What recordings and calibration say; the diagnosis of a calibration by the recordings."""
    from scara_kinetostatic.files.calibration_file import nominal_arm
    from scara_kinetostatic.planning.next_touches import Planner

    nominal = nominal_arm(cell)
    if not (args.earlier or args.calibration or args.bags):
        return Planner(nominal), None
    from scara_kinetostatic.files.atomic import check_different
    from scara_kinetostatic.model.parameters import NAMES
    from scara_kinetostatic.monitoring.record import CalibrationRecord, check_same_arm
    from scara_kinetostatic.pipeline import calibrate_touches, gather_touches

    if args.earlier:
        if args.bags or args.calibration:
            raise ParameterError('--from', 'plans for that calibration alone', 'leave out BAG and --calibration')
        from scara_kinetostatic.monitoring.update import freed_names, same_arm

        record = CalibrationRecord.load(args.earlier)
        freed = freed_names(args.free, record)
        same_arm(record, cell, freed, str(args.earlier), str(args.cell))
        return replace(record.planner(cell, record.touches), freed=freed), None
    if args.calibration:
        record = CalibrationRecord.load(args.calibration)
        check_same_arm(record.arm.cell, cell, str(args.calibration), str(args.cell))
        return record.planner(cell, gather_touches(args.bags, cell).touches if args.bags else record.touches), None
    check_different(args.bags)
    detection = gather_touches(args.bags, cell)
    try:
        outcome = calibrate_touches(detection, cell, sources=args.bags)
    except UnsupportedDataError as error:
        if len(detection.touches) >= len(NAMES):  # fewer need not allow a calibration yet
            raise
        note(f'planned from the nominal model: {error}')
        return Planner(nominal, touches=detection.touches), None
    if outcome.arm.grade == 'unfit':
        note(f'the calibration is unfit: {outcome.assessment.reasons[0]}')
    return Planner.of_outcome(outcome), outcome.diagnosis


def _is_enough(planner: Planner, planned: PlannedTouches) -> bool:
    """Whether no more touches are needed, or of use, which is said.

    Raises:
        UnsupportedDataError: the first touches, and all after them, would not reach the tolerance.
    """
    from scara_kinetostatic.model.quantities import quantity

    tolerance, found = planner.arm.cell.tolerance, planned.uncertainty
    if tolerance is None:
        return False
    if found.now is not None and found.now <= tolerance and planner.arm.grade != 'unfit':
        print(
            f'enough: the expanded uncertainty of the tip is at most {quantity(found.now, "m")} (95 %), '
            f'the tolerance {quantity(tolerance, "m")}; no touch was planned'
        )
        return True
    limit = found.beyond(tolerance)
    if not limit:
        return False
    remedy = 'reduce that, or allow a larger tolerance; --touches N plans touches all the same'
    if planner.rivals is not None:
        remedy += '; --goal decide says what decides between the possible causes'
    if planner.touches is None:
        raise UnsupportedDataError(limit, remedy)
    print(f'touches are not the limit: {limit}; {remedy}')
    return True


def _summary(planner: Planner, planned: PlannedTouches) -> str:
    """What was planned."""
    from collections import Counter
    from contextlib import suppress

    from scara_kinetostatic.model.quantities import quantity
    from scara_kinetostatic.planning.prediction import RobotModel, Statement
    from scara_kinetostatic.planning.report import statement_sentences

    cell, found = planner.arm.cell, planned.uncertainty
    counts = Counter(cell.discs[disc].name for disc in planned.plan.disc)
    where = ', '.join(f'{many} on {name}' for name, many in counts.items())
    clearance = f'{1e3 * planner.space.clearance:.1f} mm'
    stated = 'not determined' if found.now == float('inf') else quantity(found.now or 0.0, 'm')
    now = '' if found.now is None else f'now {stated}, '
    tolerance = '' if cell.tolerance is None else f'; tolerance {quantity(cell.tolerance, "m")}'
    predicted, more = found.planned, list[str]()
    if found.now is None:  # no calibration says yet how small the errors are that it does not detect
        robot = RobotModel.of(cell, planner.arm.model.parameters, planner.arm.noise)
        with suppress(UnsupportedDataError):  # so few touches allow none
            statement, many = Statement.of(robot, planned.plan), Statement.of_many(robot, planner.candidates.plan)
            predicted, more = statement.expanded, statement_sentences(statement, many)
    elif planner.freed is not None:
        slips = planner.smallest_slips(planned.chosen).items()
        more = [f'a slip of joint {name[-1]} by {quantity(size, "rad")} or more will show' for name, size in slips]
    elif found.planned > 0.9 * found.now:
        more = [f'these touches hardly reduce it: its largest part is {planner.limit}']
    return (
        f'{len(planned.plan)} touches: {where}; clearance {clearance}\n'
        f'expanded uncertainty of the tip (95 %): {now}predicted {quantity(predicted, "m")}{tolerance}'
        + ''.join(f'\n{text}' for text in more)
    )

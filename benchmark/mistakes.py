"""The mistakes that people make, at three sizes in two cells: what the first line of the answer says of each.

Touch tables, or recordings with ``--recordings``, are calibrated with a cell description or with readings that contain
one mistake. The first line is the message of the error or, where there is a result, the first reason of its assessment.

    python -m benchmark.mistakes [--recordings] [--only WORD] [--json FILE]
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmark.common import NO_OTHERS, dump_touch_table, parser, print_targets, save
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.files.touch_table import TouchTable
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Disc, Noise, Sensor, SensorFrame, SensorSign
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL, Parameters
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams, simulate_touches

NOISE = Noise(joint=1e-5, force=0.3)
SHORT_DISCS = (
    Disc('left', 0.20, 0.15, 0.030),
    Disc('back', -0.15, 0.22, 0.045),
    Disc('right', 0.05, -0.28, 0.030),
    Disc('far', -0.22, -0.15, 0.020),
)
SHORT_NOMINAL = PAPER_NOMINAL.replace(l1=0.25, l2=0.21, theta1=0.05)
TOOL_SENSOR = Sensor(frame=SensorFrame.TOOL, sign=SensorSign.ON_ROBOT)


class Setup(NamedTuple):
    """A cell and its robot."""

    name: str
    cell: Cell
    truth: Parameters


SETUPS = (
    Setup('paper', Cell(PAPER_NOMINAL, PAPER_DISCS, noise=NOISE, uncertainty=NO_OTHERS), PAPER_ACTUAL),
    Setup(
        'short arm',
        Cell(SHORT_NOMINAL, SHORT_DISCS, sensor=TOOL_SENSOR),
        PAPER_ACTUAL.replace(l1=0.2502, l2=0.2093, theta1=0.06),
    ),
)


class Case(NamedTuple):
    """A mistake of a size.

    Attributes:
        name: of the mistake.
        size: in words.
        expected: the first line holds one of these.
        cell: from the right cell to the stated one.
        joints: from the right angles to those given.
        force: the same of the forces.
        fixed: parameters held.
        named: whether a table names the objects.
        order: of the names that a table gives, place by place; None: right.
        per_disc: touches around each disc.
    """

    name: str
    size: str
    expected: tuple[str, ...]
    cell: Callable[[Cell], Cell] = lambda cell: cell
    joints: Callable[[Floats], Floats] = lambda q: q
    force: Callable[[Floats], Floats] = lambda f: f
    fixed: Mapping[str, float] = {}
    named: bool = False
    order: tuple[int, ...] | None = None
    per_disc: int = 8


def cases() -> Iterator[Case]:
    """All mistakes at three sizes."""
    for tip in (3, 5, 10):
        change = _radii(lambda r, tip=tip: r - 1e-3 * tip)
        yield Case('tip radius forgotten', f'{tip} mm', ('the radius of the tip is missing',), change)
    for short in (0.3, 1.0, 2.0):
        change = _radii(lambda r, short=short: r - 1e-3 * short)
        yield Case('all radii short', f'{short} mm', ('all radii are stated',), change)
    for tip in (0, 5, 8):
        change = _radii(lambda r, tip=tip: 2 * (r - 1e-3 * tip))
        yield Case('diameter for radius', f'tip {tip} mm', ('radius is the diameter of every disc',), change)
    for per in (4, 8, 12):
        yield from _exchanges(per)
    for i, j in ((0, 1), (1, 2), (0, 2)):
        radii = 'the radii of', 'the radii, or the centers, of', 'alike'
        yield Case(
            'radii swapped', f'{i + 1} and {j + 1}', radii, lambda cell, i=i, j=j: _swapped(cell, i, j, 'radius')
        )
        order = list(range(4))
        order[i], order[j] = j, i
        yield Case('discs swapped', f'{i + 1} and {j + 1}', ('are swapped',), named=True, order=tuple(order))
        yield Case(
            'centers swapped',
            f'{i + 1} and {j + 1}',
            ('are swapped', 'alike'),
            lambda cell, i=i, j=j: _swapped(cell, i, j, 'center'),
            named=True,
        )
    for per in (4, 8, 12):
        degrees = 'not in degrees', 'in degrees, not in rad'
        yield Case('joints in degrees', f'{per} a disc', degrees, joints=np.degrees, per_disc=per)
        yield Case('kilonewtons', f'{per} a disc', ('in kN, not in N',), force=lambda f: 1e-3 * f, per_disc=per)
    for name, value in (('x0', 2.5), ('g_ee', 0.095), ('l1', 330.2)):
        yield Case('--fix in mm', f'{name}={value:g}', ('in m, not mm', 'in m, not in mm'), fixed={name: value})


def _exchanges(per: int) -> Iterator[Case]:
    """Mistakes that have no size, with so many touches a disc."""
    size = f'{per} a disc'
    swap = lambda values: values[:, ::-1]  # noqa: E731
    discs = lambda cell: replace(cell, discs=tuple(d._replace(x=d.y, y=d.x) for d in cell.discs))  # noqa: E731
    one = lambda cell: replace(cell, discs=(_turned(cell.discs[0]), *cell.discs[1:]))  # noqa: E731
    yield Case('x and y of the discs swapped', size, ('x and y are swapped in the centers',), discs, per_disc=per)
    yield Case('x and y of one disc swapped', size, ('x and y are swapped in the center of',), one, per_disc=per)
    yield Case('x and y of the force swapped', size, ('x and y of the force are swapped',), force=swap, per_disc=per)
    yield Case('sign of the force', size, ('the sign of the',), force=lambda f: -f, per_disc=per)
    yield Case('frame of the force', size, ('frame',), force=None, per_disc=per)  # type: ignore[arg-type]
    yield Case('joints in the other order', size, ('in the wrong order',), joints=swap, per_disc=per)
    for sense, what in (((-1, 1), 'joint 1 turns'), ((1, -1), 'joint 2 turns'), ((-1, -1), 'both joints turn')):
        signs = np.array(sense)
        yield Case(f'{what} the other way', size, (what,), joints=lambda q, signs=signs: q * signs, per_disc=per)


def _radii(change: Callable[[float], float]) -> Callable[[Cell], Cell]:
    return lambda cell: replace(cell, discs=tuple(d._replace(radius=change(d.radius)) for d in cell.discs))


def _turned(disc: Disc) -> Disc:
    return disc._replace(x=disc.y, y=disc.x)


def _swapped(cell: Cell, i: int, j: int, what: str) -> Cell:
    discs, a, b = list(cell.discs), cell.discs[i], cell.discs[j]
    if what == 'radius':
        discs[i], discs[j] = a._replace(radius=b.radius), b._replace(radius=a.radius)
    else:
        discs[i], discs[j] = a._replace(x=b.x, y=b.y), b._replace(x=a.x, y=a.y)
    return replace(cell, discs=tuple(discs))


def first_line(setup: Setup, case: Case, folder: Path, recorded: bool) -> str:
    """What is said first of a mistake."""
    stated = case.cell(setup.cell)
    path = _recording(setup, case, folder) if recorded else _table(setup, case, folder)
    try:
        outcome = calibrate_recordings([path], stated, fixed=dict(case.fixed))
    except ScaraKinetostaticError as error:
        return str(error).replace(f'{folder}/', '')
    return f'{outcome.assessment.grade.value}: {outcome.assessment.reasons[0]}'


def _table(setup: Setup, case: Case, folder: Path) -> Path:
    cell = replace(setup.cell, sensor=Sensor())
    if case.force is None:
        cell = replace(cell, sensor=Sensor(frame=SensorFrame.TOOL))
    touches = simulate_touches(cell, setup.truth, default_plan(cell, case.per_disc), NOISE, seed=1)
    names = [disc.name for disc in cell.discs]
    order = case.order or range(len(names))
    given = tuple(names[order[d]] for d in touches.disc) if case.named else ('',) * len(touches)
    table = TouchTable(
        case.joints(touches.joints),
        touches.force if case.force is None else case.force(touches.force),
        given,
        touches.time,
        touches.approach,
        (),
        '',
    )
    path = folder / 'touches.csv'
    path.write_text(dump_touch_table(table), encoding='utf-8')
    return path


def _recording(setup: Setup, case: Case, folder: Path) -> Path:
    cell = setup.cell
    if case.force is None:
        other = SensorFrame.BASE if cell.sensor.frame is SensorFrame.TOOL else SensorFrame.TOOL
        cell = replace(cell, sensor=cell.sensor._replace(frame=other))
    streams = simulate_streams(cell, setup.truth, default_plan(cell, case.per_disc), seed=1)
    wrench = streams.wrench.force if case.force is None else case.force(streams.wrench.force)
    streams = replace(
        streams,
        joints=replace(streams.joints, position=case.joints(streams.joints.position)),
        wrench=replace(streams.wrench, force=wrench),
    )
    path = folder / 'recording.mcap'
    path.unlink(missing_ok=True)
    write_streams(path, streams, cell)
    return path


def main() -> int:
    """Prints the first line of every mistake, and whether it names it."""
    command = parser(__doc__)
    command.add_argument('--recordings', action='store_true', help='through recordings instead of touch tables')
    command.add_argument('--only', default='', metavar='WORD', help='mistakes whose names hold this')
    args = command.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for setup in SETUPS:
            for case in (case for case in cases() if args.only in case.name):
                if (args.recordings and case.named) or _is_nothing(setup, case):
                    continue
                line = first_line(setup, case, Path(folder), args.recordings)
                named = any(text in line for text in case.expected)
                rows.append({'cell': setup.name, 'mistake': case.name, 'size': case.size, 'named': named, 'line': line})
                print(f'{"      " if named else "MISSED"} {setup.name:9} {case.name}, {case.size}: {line}', flush=True)
    save(args.json, rows)
    number = sum(row['named'] for row in rows)
    return 0 if print_targets([(f'{number} of {len(rows)} named in the first line', number == len(rows))]) else 1


def _is_nothing(setup: Setup, case: Case) -> bool:
    """Whether a mistake changes nothing: discs of the same radius swapped."""
    unchanged = case.cell(setup.cell) == setup.cell
    return case.name == 'radii swapped' and unchanged


if __name__ == '__main__':
    raise SystemExit(main())

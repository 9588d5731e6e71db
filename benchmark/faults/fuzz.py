"""Mutated files of every format that the package reads: none may cost much, and none may show the inside.

    python -m benchmark.faults.fuzz [--files 10000] [--seed 0] [--json FILE]

Valid files, in turn of each format, get bits flipped, parts cut, repeated, overwritten and spliced from others, and
are read in this process. Exit status 1 if one takes more than 5 s, or the process 500 MB, or if anything is raised but
an error of this package with a message of one line. A file is made again from its number and the seed.
"""

from __future__ import annotations

import faulthandler
import random
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmark.common import CELL, parser, peak_memory, reset_peak_memory, save
from benchmark.faults.damage import mutated, mutated_yaml
from benchmark.faults.formats import CELL_FILE, forms, short_streams
from benchmark.faults.outcomes import FAILURES, Verdict, outcome_of
from scara_kinetostatic.bags.reader import embedded_cell, read_streams
from scara_kinetostatic.files.calibration_file import load_calibration
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.files.tables import POSES, STATES, PoseTable, load_pose_table, load_table, load_touch_table
from scara_kinetostatic.interface import diagnose, simulate
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.monitoring.history import History
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.results.document import load_result, write_results
from scara_kinetostatic.simulation.plan import load_plan
from scara_kinetostatic.studies.loops.dial_gauge import load_readings
from scara_kinetostatic.studies.loops.record import load_record
from scara_kinetostatic.touches.detection import find_touches

MEMORY = 500e6
STUCK = 60.0
"""After so long in one file, s, the whole run is given up; no signal reaches what hangs outside Python."""
ROOT = Path(__file__).parents[2]


class Kind(NamedTuple):
    """A format: its files by path, which of them is damaged, what is read, and how."""

    name: str
    files: dict[str, bytes]
    target: str
    root: str
    read: Callable[[Path], object]


def _recording(path: Path) -> None:
    embedded_cell(path)
    find_touches(read_streams(path, CELL), CELL)


def _text(name: str, content: str | bytes, read: Callable[[Path], object]) -> Kind:
    data = content.encode() if isinstance(content, str) else content
    return Kind(name, {name: data}, name, name, read)


def kinds(folder: Path) -> list[Kind]:
    """A valid file of every format."""
    recordings = forms(short_streams(), CELL)
    found = [Kind(form.name, dict(form.files), form.target, form.root, _recording) for form in recordings]
    written = write_results(diagnose(simulate(CELL, PAPER_ACTUAL), CELL), folder / 'result')
    document = written.document.read_bytes()
    history = folder / 'history.sqlite'
    record = CalibrationRecord.load(written.document)
    History(history, create=True).add([record], 'one')
    plan = ''.join(f'- {{disc: disc_1, angle_deg: {10 * k}, posture: left, force: 25}}\n' for k in range(4, 8))
    outline = '[[0.10, 0.30], [0.20, 0.30], [0.20, 0.40]]'
    slides = f'- {{slide: {{outline: {outline}, corner_radius: 0.01, closed: false}}, force: 10}}\n'
    touches = 'q1_rad,q2_rad,fx_N,fy_N,object,time_s\n' + '0.8,2.1,-9.8,-0.1,disc_1,1.5\n' * 20
    poses, states = 'x_m,y_m,fx_N,fy_N,elbow,note\n', 'q1_rad;q2_rad;fx_N;fy_N\n'
    readings = 'force_N,displacement_mm\n' + ''.join(f'{k},{0.01 * k}\n' for k in [*range(30), *range(30, -30, -1)])
    loading = b''.join((ROOT / 'bags' / 'panda' / 'loading.csv').read_bytes().splitlines(keepends=True)[:300])
    return [
        *found,
        _text('cell.yaml', CELL_FILE.read_bytes(), load_cell),
        _text('plan.yaml', plan, lambda path: load_plan(path, CELL)),
        _text('slides.yaml', slides, lambda path: load_plan(path, CELL)),
        _text('touches.csv', touches, load_touch_table),
        _text(
            'poses.csv', poses + '0.1,0.3,1,2,left,a\n' * 20, lambda path: _with_status(load_pose_table(path, POSES))
        ),
        _text('states.csv', states + '0,1;2,0;1;2\n' * 20, lambda path: _with_status(load_pose_table(path, STATES))),
        _text('calibration.json', document, load_calibration),
        _text('record.json', document, CalibrationRecord.load),
        _text('parameters.yaml', written.parameters.read_bytes(), load_result),
        _text('history.sqlite', history.read_bytes(), _history),
        _text('readings.csv', readings, lambda path: load_readings(load_table(path, 'force_N,displacement_mm'))),
        _text('loading.csv', loading, load_record),
    ]


def _with_status(table: PoseTable) -> str:
    return table.text_with({'status': np.zeros(len(table.cells))})


def _history(path: Path) -> None:
    """Lists, adds and removes, as the verb does."""
    History(path).entries()
    History(path, create=True).extract([1], remove=True)


def _outcome(kind: Kind, path: Path) -> tuple[float, str]:
    kind.read(path)
    return 0.0, ''


def main() -> int:
    """Mutates, reads, counts."""
    options_of = parser(__doc__)
    options_of.add_argument('--files', type=int, default=10_000)
    options_of.add_argument('--seed', type=int, default=0)
    options = options_of.parse_args()
    failures: list[str] = []
    verdicts: Counter[str] = Counter()
    slowest = largest = 0.0
    with tempfile.TemporaryDirectory(prefix='fuzz_') as text:
        folder = Path(text)
        known = kinds(folder)
        others = [content for kind in known for content in kind.files.values()]
        for number in range(options.files):
            kind, rng = known[number % len(known)], random.Random(f'{options.seed} {number}')
            content = kind.files[kind.target]
            is_yaml = kind.target.endswith('.yaml') and rng.random() < 0.5
            bad = mutated_yaml(content.decode(), rng) if is_yaml else mutated(content, rng.choice(others), rng)
            case = folder / 'case'
            shutil.rmtree(case, ignore_errors=True)
            for name, data in kind.files.items():
                (case / name).parent.mkdir(parents=True, exist_ok=True)
                (case / name).write_bytes(bad if name == kind.target else data)
            faulthandler.dump_traceback_later(STUCK, exit=True, file=sys.__stderr__)
            reset_peak_memory()
            outcome = outcome_of(partial(_outcome, kind, case / kind.root), case)
            peak = peak_memory()
            slowest, largest = max(slowest, outcome.seconds), max(largest, peak)
            verdicts['refused' if outcome.verdict is Verdict.REFUSED else 'read or failed'] += 1
            if outcome.verdict in FAILURES or peak > MEMORY or '\n' in outcome.message:
                what = f'{outcome.verdict.value}, {peak / 1e6:.0f} MB, {outcome.message}'
                failures.append(f'{kind.name} {number}: {what}')
                print(failures[-1][:400], flush=True)
    faulthandler.cancel_dump_traceback_later()
    print(
        f'{options.files} files of {len(known)} formats: {len(failures)} failures; slowest {slowest:.2f} s, '
        f'largest {largest / 1e6:.0f} MB; {dict(verdicts)}'
    )
    save(options.json, {'files': options.files, 'slowest': slowest, 'largest': largest, 'failures': failures})
    return 1 if failures else 0


if __name__ == '__main__':
    sys.exit(main())

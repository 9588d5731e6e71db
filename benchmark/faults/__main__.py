"""Damaged files, kills and full disks: does anything crash, hang, get executed, or get lost without a word.

    python -m benchmark.faults [--bags 10000] [--cells 10000] [--kills 100] [--disks 5] [--json FILE]

`--bags`: recordings in 15 forms are damaged byte by byte (bits flipped; bytes overwritten, inserted, deleted, taken
from elsewhere; lengths changed; ends cut off) and read, one in 50 of them calibrated from. `--cells`: the same with
cell files, as YAML as well. `--kills`: collectors under load are killed by SIGKILL. `--disks`: collectors record
until a disk is full. The damage is numbered, so every case can be had again. Kills and disks need ROS 2.

Exit status 1 if anything crashed, took over 5 s, was executed, or got lost; or if a form with checksums gave another
result without a warning. Forms without checksums cannot show a number that has become another one, nor can a cell file.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import os
import sys
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from benchmark.common import CELL
from benchmark.faults.formats import CELL_FILE, forms, short_streams
from benchmark.faults.outcomes import FAILURES, Outcome, Verdict, calibration_outcome, cell_outcome, reading_outcome
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams
from scara_kinetostatic.touches.detection import find_touches

CALIBRATED = 50
"""One recording in so many is calibrated from."""
STUCK = 60.0
"""After so long in one case, s, the whole run is given up; no signal reaches what hangs outside Python."""
SMALLEST_DISK, LARGEST_DISK = 300_000, 1_500_000


@dataclass
class Row:
    """What became of the files of one form.

    Attributes:
        form: its name.
        counts: how many met each verdict.
        slowest: longest time for one, s.
        shift: largest shift of a calibration without a warning, standard deviations.
        failures: number and message of those that failed.
    """

    form: str
    counts: dict[str, int] = field(default_factory=lambda: {verdict.value: 0 for verdict in Verdict})
    slowest: float = 0.0
    shift: float = 0.0
    failures: list[tuple[int, str]] = field(default_factory=list)

    def note(self, number: int, outcome_of: Outcome, *, failed: bool) -> None:
        """Takes in a case."""
        self.counts[outcome_of.verdict.value] += 1
        self.slowest = max(self.slowest, outcome_of.seconds)
        if failed:
            self.failures.append((number, f'{outcome_of.verdict.value}: {outcome_of.message}'))


def damage_recordings(number: int, folder: Path) -> Iterator[Row]:
    """Damages so many recordings and reads them; those of each form together."""
    short = short_streams()
    plan, sensors = default_plan(CELL, per_disc=6), SensorModel(joint_rate=40, wrench_rate=40)
    simulated = simulate_streams(CELL, PAPER_ACTUAL, plan, sensors=sensors)
    intact = calibrate(find_touches(simulated, CELL).touches, CELL)
    pairs = list(zip(forms(short, CELL), forms(simulated, CELL), strict=True))
    for place, (small, large) in enumerate(pairs):
        row = Row(small.name)
        for count in range(place, number, len(pairs)):
            faulthandler.dump_traceback_later(STUCK, exit=True)
            calibrated = count // len(pairs) % CALIBRATED == CALIBRATED - 1
            if calibrated:
                outcome_of = calibration_outcome(large, count, intact, folder)
                row.shift = max(row.shift, outcome_of.shift if outcome_of.verdict is Verdict.SILENT else 0.0)
            else:
                outcome_of = reading_outcome(small, count, short, CELL, folder)
            silent = small.protected and outcome_of.verdict is Verdict.SILENT
            row.note(count, outcome_of, failed=outcome_of.verdict in FAILURES or silent)
        yield row


def damage_cells(number: int, folder: Path) -> Iterator[Row]:
    """Damages so many cell files and reads them."""
    for name, text in (('cell file', CELL_FILE.read_text(encoding='utf-8')), ('cell file, compact', dump_cell(CELL))):
        row = Row(name)
        for count in range(number // 2):
            faulthandler.dump_traceback_later(STUCK, exit=True)
            outcome_of = cell_outcome(text, count, folder)
            row.note(count, outcome_of, failed=outcome_of.verdict in FAILURES)
        yield row


def print_rows(rows: Iterable[Row]) -> list[Row]:
    """The rows, each printed when it is complete."""
    kept = []
    for row in rows:
        counts = ', '.join(
            f'{row.counts[verdict.value]} {verdict.value}' for verdict in Verdict if row.counts[verdict.value]
        )
        shift = f', shift {row.shift:.3g} σ' if row.shift else ''
        print(f'{row.form}: {counts}; slowest {row.slowest:.2f} s{shift}', flush=True)
        for number, message in row.failures[:5]:
            print(f'  {number}: {message[:300]}')
        kept.append(row)
    faulthandler.cancel_dump_traceback_later()
    return kept


def live(kills: int, disks: int, folder: Path) -> list[dict[str, object]]:
    """Kills and full disks, each printed."""
    if not kills + disks:
        return []
    from benchmark.faults.kills import fill_disk, kill_collectors

    records: list[dict[str, object]] = []
    for size in np.linspace(SMALLEST_DISK, LARGEST_DISK, disks).round().astype(int).tolist():
        records.append(fill_disk(size, folder / str(size)))
        print('full disk:', records[-1], flush=True)
    for record in kill_collectors(kills, folder):
        records.append(record)
        print('killed:', record, flush=True)
    lost = sum(bool(record['lost'] or record['problems']) for record in records)
    reported, there = (sum(int(str(record[name])) for record in records) for name in ('reported', 'there'))
    print(f'{len(records)} ends: {reported} touches reported, {there} there; {lost} ends with a loss or a problem')
    return records


def main() -> int:
    """Run, print, save."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, number in (('bags', 10_000), ('cells', 10_000), ('kills', 100), ('disks', 5)):
        parser.add_argument(f'--{name}', type=int, default=number)
    parser.add_argument('--json', type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix='faults_') as name:
        folder, here = Path(name), Path.cwd()
        os.chdir(folder)  # what a file might have executed would leave its traces there
        rows = print_rows(damage_recordings(options.bags, folder / 'case')) if options.bags else []
        rows += print_rows(damage_cells(options.cells, folder / 'case')) if options.cells else []
        os.chdir(here)
        records = live(options.kills, options.disks, folder)
    if options.json:
        content = {'files': [asdict(row) for row in rows], 'ends': records}
        options.json.write_text(json.dumps(content, indent=2) + '\n', encoding='utf-8')
    failed = sum(len(row.failures) for row in rows) + sum(bool(r['lost'] or r['problems']) for r in records)
    print(f'{sum(sum(row.counts.values()) for row in rows)} damaged files, {len(records)} ends, {failed} failures')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())

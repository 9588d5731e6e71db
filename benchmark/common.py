"""What the benchmarks share: the paper's cell, options, JSON files, processes of one thread, time and memory."""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.calibration.joint_covariance import UndetectedErrors, joint_covariance
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.files.tables import EXAMPLE, TouchTable, csv_cell, csv_lines
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import OBJECT_POSITION, PAPER_DISCS, Cell, EffectSizes, Noise, SizeMode, Uncertainty
from scara_kinetostatic.model.outline import Outline, surfaces_of
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED, PAPER_NOMINAL
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.simulation.plan import Circle

NOISE = Noise(joint=1e-5, force=0.3)
EXACT = Noise(joint=0.0, force=0.0)
NO_OTHERS = Uncertainty(effects=EffectSizes(SizeMode.NONE, stated={OBJECT_POSITION: 0.0}))
"""Of simulated robots without undetected effects."""
CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=NOISE, uncertainty=NO_OTHERS)
"""The paper's cell."""
ROBOTS = {'table 2': PAPER_ACTUAL, 'figure 4(d)': PAPER_MEASURED}
NOISES = ('given', 'estimated')
"""Whether the cell description states the noise."""
LEAST_SECONDS = 2.0
"""A timed function is repeated for so long, within the limits below."""
LEAST_RUNS, MOST_RUNS = 3, 200
LONGEST_REPEATED = 20.0
"""A function that takes longer is timed once, s."""
_ONE_THREAD = dict.fromkeys(('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'), '1')
_STORED = ('joints', 'posture', 'index', 'order', 'time', 'approach', 'press', 'history')
"""Columns of a touch that a calibration file holds as they are."""
_Job = TypeVar('_Job')
_Result = TypeVar('_Result')


def record_of(calibration: Calibration) -> CalibrationRecord:
    """What monitoring needs of a calibration that nobody has assessed."""
    c, t = calibration, calibration.touches
    columns = {
        **{name: getattr(t, name) for name in _STORED},
        'force': c.force,
        'object': np.array([c.cell.discs[disc].name for disc in t.disc]),
        'used': c.used,
    }
    rows = zip(*(part.tolist() for part in columns.values()), strict=True)
    document = {
        'fit': {'degrees_of_freedom': c.degrees_of_freedom, 'enlargement': c.enlargement},
        'noise': {'source': c.noise_source},
        'parameters': {name: {'status': status} for name, status in c.status.items()},
        'covariance_with_cell': {'undetected': UndetectedErrors.of(c)._asdict()},
        'touches': {'fitted': [dict(zip(columns, row, strict=True)) for row in rows]},
    }
    return CalibrationRecord('calibration', document, c.arm, *joint_covariance(c))


def parser(description: str | None, *, json_file: bool = True, plot: bool = False) -> argparse.ArgumentParser:
    """A command-line parser with the options that many benchmarks have."""
    made = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    if json_file:
        made.add_argument('--json', type=Path, metavar='FILE', help='write the figures there')
    if plot:
        made.add_argument('--plot', type=Path, metavar='FILE', help='draw the figures there, SVG')
    return made


def save(path: Path | None, content: Any) -> None:
    """Writes a JSON file, NaN as null; nothing for None."""
    if path:
        text = json.dumps(json_value(content), indent=1, ensure_ascii=False, allow_nan=False)
        path.write_text(text + '\n', encoding='utf-8')


def print_and_save(path: Path | None, content: Mapping[str, Any]) -> None:
    """Prints the figures as JSON and writes them into a file."""
    print(json.dumps(content, indent=2, ensure_ascii=False))
    save(path, content)


def json_value(item: Any) -> Any:
    """The same content with null for what JSON has no number for."""
    if isinstance(item, Mapping):
        return {key: json_value(value) for key, value in item.items()}
    if isinstance(item, (list, tuple)):
        return [json_value(value) for value in item]
    return None if isinstance(item, float) and not math.isfinite(item) else item


def in_processes(
    function: Callable[[_Job], _Result], jobs: Sequence[_Job], number: int = 1, *, fresh: bool = False
) -> Iterator[_Result]:
    """The results of a function, job by job, worked in processes of one thread each; a single one may be this one.

    Args:
        function: at the top of a module other than a package's `__main__`, which a new process cannot import.
        jobs: its arguments.
        number: of processes.
        fresh: whether each job gets a process of its own.
    """
    if number == 1 and not fresh and os.environ.get('OMP_NUM_THREADS') == '1':
        yield from counted(map(function, jobs), len(jobs))
        return
    os.environ.update(_ONE_THREAD)  # before a process imports NumPy
    with multiprocessing.get_context('spawn').Pool(number, maxtasksperchild=1 if fresh else None) as pool:
        yield from counted(pool.imap(function, jobs), len(jobs))


def counted(items: Iterator[_Result], total: int) -> Iterator[_Result]:
    """The items, counted on a terminal."""
    for number, item in enumerate(items, 1):
        if sys.stderr.isatty():
            print(f'\r{number}/{total}', end='' if number < total else '\n', file=sys.stderr)
        yield item


def print_targets(targets: Sequence[tuple[str, bool]]) -> bool:
    """Prints each target and whether it is met; whether all are."""
    for text, met in targets:
        print(f'{"met   " if met else "MISSED"} {text}')
    return all(met for _, met in targets)


def repeat(run: Callable[[], object]) -> dict[str, Any]:
    """Processor time of several runs after one that does not count, s: median, quartiles, extremes."""
    begin = time.process_time()
    run()
    first = time.process_time() - begin
    wanted = int(np.clip(LEAST_SECONDS / max(first, 1e-9), LEAST_RUNS, MOST_RUNS))
    number = wanted if first < LONGEST_REPEATED else 1
    seconds = []
    for _ in range(number):
        begin = time.process_time()
        run()
        seconds.append(time.process_time() - begin)
    least, lower, median, upper, largest = np.quantile(seconds, [0, 0.25, 0.5, 0.75, 1]).tolist()
    return {'runs': number, 'median': median, 'quartiles': [lower, upper], 'extremes': [least, largest], 'first': first}


def reset_peak_memory() -> None:
    """Lets the peak of memory begin anew, where the system can do that."""
    with suppress(OSError):
        Path('/proc/self/clear_refs').write_text('5', encoding='ascii')


def peak_memory(process: int | str = 'self') -> int:
    """Peak resident memory of a process, bytes; 0 where the system does not state it."""
    try:
        status = Path(f'/proc/{process}/status').read_text(encoding='ascii')
    except OSError:
        return 0
    return next(1024 * int(line.split()[1]) for line in status.splitlines() if line.startswith('VmHWM'))


def machine() -> dict[str, Any]:
    """Processor, versions, and how busy the machine is."""
    lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines() if Path('/proc/cpuinfo').exists() else []
    model = next((line.split(':')[1].strip() for line in lines if line.startswith('model name')), platform.processor())
    return {
        'processor': model,
        'cores': os.cpu_count(),
        'load': [round(value, 1) for value in os.getloadavg()],
        'python': platform.python_version(),
        'numpy': np.__version__,
    }


@contextmanager
def svg_figure(path: Path, width: float, height: float) -> Iterator[Any]:
    """A Matplotlib figure that is saved as reproducible SVG in the end; sizes in inches."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({'svg.fonttype': 'none', 'svg.hashsalt': path.stem, 'font.size': 9}):
        figure = Figure(figsize=(width, height), layout='constrained')
        yield figure
        figure.savefig(path, format='svg', metadata={'Date': None})


def normal_error(outline: Outline | Circle, points: ArrayLike) -> Floats:
    """Distance of points from the surface along its normal, (k,), m, positive outside."""
    surfaces = surfaces_of([outline], 0.0) if isinstance(outline, Outline) else outline.surfaces(0.0)
    points, is_corner = np.asarray(points, dtype=float), surfaces.radii == 0
    found = np.empty(len(points))
    for first in range(0, len(points), 512):
        part = points[first : first + 512]
        # a sharp corner comes before the ends of its edges, which are as near
        nearest = (surfaces.distances(part) - 1e-12 * is_corner).argmin(axis=1)
        found[first : first + 512] = surfaces.gaps(part)[np.arange(len(part)), nearest]
    return found


def dump_touch_table(table: TouchTable) -> str:
    """A text that `load_touch_table` reads back, to the last bit; columns without any content are left out."""
    numbers = np.concatenate([table.joints, table.force], axis=1).T.tolist()
    columns = {name: [*map(repr, column)] for name, column in zip(EXAMPLE.split(','), numbers, strict=True)}
    if any(table.objects):
        columns['object'] = [csv_cell(name) for name in table.objects]
    if table.time.any():
        columns['time_s'] = [*map(repr, table.time.tolist())]
    if table.approach.any():
        columns |= {f'approach{k + 1}': [*map(repr, table.approach[:, k].tolist())] for k in (0, 1)}
    return csv_lines(columns)

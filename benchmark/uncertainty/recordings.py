"""Recordings of worlds drawn from their declared uncertainties, calibrated and diagnosed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2, ncx2

from benchmark.common import NOISES
from benchmark.diagnosis.cells import SETUPS
from benchmark.uncertainty.worlds import declared_setup, drawn
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.parameters import NAMES

DRAWN = ('small', 'large', 'plate')
DISPLACED = 10.0
"""Declared standard uncertainties by which an object is off."""
LEAST_RMS, LARGEST_RMS, LARGEST_Z = 0.9, 1.1, 5.0
LEAST_NONE, LEAST_NAMED = 0.98, 0.95
FALSE_ALARMS = 0.01
"""Of the best possible test of an object, for all objects together."""


class Task(NamedTuple):
    """Recordings that are made one after the other."""

    cell: str
    kind: str
    noise: str
    displaced: float
    seeds: range


def tasks(first: int, count: int, kinds: Sequence[str], at_once: int = 10) -> list[Task]:
    """All tasks: recordings `first` to `first + count` of every cell, kind and noise."""
    listed = []
    for cell in SETUPS:
        for kind in kinds:
            for noise in NOISES:
                for displaced in (0.0, DISPLACED):
                    parts = (
                        range(start, min(start + at_once, first + count))
                        for start in range(first, first + count, at_once)
                    )
                    listed += [Task(cell, kind, noise, displaced, part) for part in parts]
    return listed


def run_task(task: Task) -> list[dict[str, Any]]:
    """The recordings of a task."""
    return [_run(task, seed) for seed in task.seeds]


def run_fits(task: Task) -> list[dict[str, Any]]:
    """The recordings of a task that are calibrated and not diagnosed."""
    return [_fit(task, seed) for seed in task.seeds]


def _fit(task: Task, seed: int) -> dict[str, Any]:
    setup = declared_setup(task.cell, task.kind)
    _, robot, touches = drawn(setup, seed, task.cell, task.kind)
    base = calibrate(touches, setup.cell if task.noise == 'given' else replace(setup.cell, noise=None))
    z = (base.parameters.as_array() - robot.as_array()) / base.std
    return {**task._asdict(), 'seeds': seed, 'z': z.tolist()}


def _run(task: Task, seed: int) -> dict[str, Any]:
    setup = declared_setup(task.cell, task.kind)
    record: dict[str, Any] = {**task._asdict(), 'seeds': seed}
    begin = process_time()
    try:
        _, robot, touches = drawn(setup, seed, task.cell, task.kind, displaced=task.displaced)
        described = setup.cell if task.noise == 'given' else replace(setup.cell, noise=None)
        base = calibrate(touches, described)
        fitted = process_time()
        found = diagnose(base)
    except ScaraKinetostaticError as error:
        return record | {'error': str(error)}
    final = found.extended or base
    z = (final.parameters.as_array() - robot.as_array()) / final.std
    base_z = (base.parameters.as_array() - robot.as_array()) / base.std
    return record | {
        'verdict': found.verdict,
        'found': [item.effect.label for item in found.found],
        'rivals': [list(group) for group in found.rivals],
        'p_value': found.p_value,
        'z': z.tolist(),
        'base_z': base_z.tolist(),
        'chi_square': base.reduced_chi_square,
        'fit_seconds': fitted - begin,
        'seconds': process_time() - fitted,
        'best_power': _best_power(base, seed, task.displaced) if task.displaced else None,
    }


def _best_power(base: Calibration, seed: int, displaced: float) -> float:
    """The power of the chi-square test of the displaced object, averaged over the directions: no test that does not
    know which object it is does better at the same false alarms.
    """
    discs = base.cell.discs
    disc = discs[seed % len(discs)]
    with_object = calibrate(base.touches, base.cell, [find(base.cell, f'object_position[{disc.name}]')])
    angles = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    shift = displaced * disc.center_std * np.stack([np.cos(angles), np.sin(angles)])
    noncentrality = np.sum(shift * np.linalg.solve(with_object.covariance[-2:, -2:], shift), axis=0)
    return float(np.mean(ncx2.sf(chi2.isf(FALSE_ALARMS / len(discs), 2), 2, noncentrality)))


def is_named(record: dict[str, Any], discs: Sequence[str]) -> bool:
    """Whether the displaced object is found, alone or among named rivals."""
    label = f'object_position[{discs[record["seeds"] % len(discs)]}]'
    return label in record.get('found', ()) or any(label in group for group in record.get('rivals', ()))


def summarise_fits(records: Sequence[dict[str, Any]]) -> tuple[list[str], list[tuple[str, bool]]]:
    """A line for each cell, kind and noise; the targets."""
    lines, rms, largest = [], [1.0], 0.0
    for cell, kind, noise in dict.fromkeys((r['cell'], r['kind'], r['noise']) for r in records):
        z = np.array([r['z'] for r in records if (r['cell'], r['kind'], r['noise']) == (cell, kind, noise)])
        of_each = np.sqrt(np.nanmean(z**2, axis=0))
        rms += of_each.tolist()
        largest = max(largest, float(np.nanmax(np.abs(z))))
        lines.append(
            f'{cell:6} {kind:10} {noise:9} {len(z)} recordings, {_of_z(z, of_each)}, '
            f'without value {int(np.isnan(z).sum())}'
        )
    return lines, _targets_of_z(rms, largest)


def _of_z(z: Floats, of_each: Floats) -> str:
    return (
        f'rms z {of_each.min():.2f} ({NAMES[int(of_each.argmin())]}) to {of_each.max():.2f} '
        f'({NAMES[int(of_each.argmax())]}), largest {np.nanmax(np.abs(z)):.1f}'
    )


def _targets_of_z(rms: Sequence[float], largest: float) -> list[tuple[str, bool]]:
    return [
        (
            f'rms z of each parameter {LEAST_RMS} to {LARGEST_RMS}: {min(rms):.2f} to {max(rms):.2f}',
            min(rms) >= LEAST_RMS and max(rms) <= LARGEST_RMS,
        ),
        (f'none beyond {LARGEST_Z:g}: {largest:.1f}', largest <= LARGEST_Z),
    ]


def summarise(records: Sequence[dict[str, Any]]) -> tuple[list[str], list[tuple[str, bool]]]:
    """A line for each cell, kind and noise, and for what is displaced there; what is odd; the targets."""
    lines, odd = [], []
    rms, largest, none, named = [1.0], 0.0, [1.0], [1.0]
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for record in records:
        groups.setdefault((record['cell'], record['kind'], record['noise'], record['displaced']), []).append(record)
    for (cell, kind, noise, displaced), group in groups.items():
        name = f'{cell:6} {kind:10} {noise:9}'
        discs = [disc.name for disc in SETUPS[cell].cell.discs]
        if displaced:
            missed = [record for record in group if not is_named(record, discs)]
            named.append(1 - len(missed) / len(group))
            best = [record['best_power'] for record in group if record.get('best_power') is not None]
            known = f'; a test that knows which object finds {100 * np.mean(best):.0f} %' if best else ''
            lines.append(f'{name} displaced: named {len(group) - len(missed)} of {len(group)}{known}')
            odd += missed
            continue
        good = [record for record in group if 'error' not in record]
        z = np.array([record['z'] for record in good])
        of_each = np.sqrt(np.nanmean(z**2, axis=0))
        verdicts = dict(Counter(record.get('verdict', 'error') for record in group))
        rms += of_each.tolist()
        largest = max(largest, float(np.nanmax(np.abs(z))))
        none.append(verdicts.get('none', 0) / len(group))
        lines.append(
            f'{name} {verdicts}, {_of_z(z, of_each)}, '
            f'without value {int(np.isnan(z).sum())}, '
            f'{1e3 * np.mean([record["fit_seconds"] for record in good]):.0f} and '
            f'{1e3 * np.mean([record["seconds"] for record in good]):.0f} ms'
        )
        odd += [r for r in group if r.get('verdict') != 'none' or np.nanmax(np.abs(r['z'])) > LARGEST_Z]
    targets = [
        *_targets_of_z(rms, largest),
        (f'verdict none in {100 * LEAST_NONE:.0f} %: {100 * min(none):.1f} %', min(none) >= LEAST_NONE),
        (f'displaced object named in {100 * LEAST_NAMED:.0f} %: {100 * min(named):.1f} %', min(named) >= LEAST_NAMED),
    ]
    return lines + [_described(record) for record in odd], targets


def _described(record: dict[str, Any]) -> str:
    where = f'  {record["cell"]} {record["kind"]} {record["noise"]} {record["displaced"]:g} seed {record["seeds"]}'
    if 'error' in record:
        return f'{where}: {record["error"]}'
    return (
        f'{where}: {record["verdict"]} {record["found"]} {record["rivals"]} p = {record["p_value"]:.2g}, z up to '
        + (f'{np.nanmax(np.abs(record["z"])):.1f}')
    )

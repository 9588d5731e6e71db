"""One simulated recording, diagnosed and compared with the true effects."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from time import process_time
from typing import Any

import numpy as np

from benchmark.common import NOISES
from benchmark.diagnosis.cells import (
    NOISE,
    SETUPS,
    Setup,
    SimulatedEffects,
    Sized,
    at_sizes,
    random_effect,
    seed_of,
    simulate,
)
from benchmark.diagnosis.record import ALONE, NONE, RIVALS, UNNAMED, WRONG, Record
from benchmark.diagnosis.unlisted import UNLISTED, StiffGripper, unlisted
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.held_out import held_out_force_error
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue, find
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch import TouchSet

PAIRED = (
    'encoder_gain[joint1]',
    'transmission_error[joint2]',
    'object_position[disc_2]',
    'sensor_rotation',
    'base_compliance',
    'joint_hysteresis[joint1]',
)
PAIR_SIZE = 2.0
UNLISTED_SIZES = (2.0, 5.0)
ALIASES = ('link_bending[link2]', 'gripper along link 2')
"""Exact aliases of the base model's parameters."""
ALIAS_OF = {'tip_shape[oval]': 'anisotropic_backlash'}
"""Effects that are named as another one, whose prediction is the same."""


@dataclass(frozen=True)
class Task:
    """Recordings that are simulated one after the other: one effect, or pair, of one cell and seed, at all sizes."""

    section: str
    cell: str
    labels: tuple[str, ...]
    seed: int
    noises: tuple[str, ...] = NOISES
    sizes: tuple[float, ...] = ()


def run_task(task: Task) -> list[Record]:
    """All recordings of a task."""
    setup = SETUPS[task.cell]
    records = []
    for simulated, size, reason in _simulated_effects(task, setup):
        seed = seed_of(task.section, *task.labels, size, task.seed)
        blank = Record(task.section, task.cell, '', task.seed, task.labels, size, reason=reason)
        if simulated is None:
            records += [replace(blank, noise=noise) for noise in task.noises]
            continue
        blank.values = tuple(float(value) for part in simulated.values for value in part)
        try:
            touches = _touches(task, setup, simulated, seed)
        except ScaraKinetostaticError as error:
            records += [replace(blank, noise=noise, reason=str(error)) for noise in task.noises]
            continue
        records += [diagnosed(replace(blank, noise=noise), setup, simulated, touches) for noise in task.noises]
    return records


def _simulated_effects(task: Task, setup: Setup) -> Iterator[tuple[SimulatedEffects | None, float, str]]:
    """The effects of a task, size by size."""
    if task.section == 'clean':
        yield _alias(task, setup), np.nan, ''
        return
    ones = [_one(task.section, task.cell, label, task.seed) for label in task.labels]
    found = [_sized(task.cell, one.effects, tuple(map(tuple, one.values)), task.sizes) for one in ones]
    for items in zip(*found, strict=True):
        missing = [item.reason for item in items if item.simulated is None]
        combination = SimulatedEffects((), ())
        for item in items:
            combination = combination.combined(item.simulated or SimulatedEffects((), ()))
        yield (None if missing else combination), items[0].size, ', '.join(missing)


def _one(section: str, cell: str, label: str, seed: int) -> SimulatedEffects:
    setup = SETUPS[cell]
    return unlisted(label, setup, seed) if section == 'unlisted' else random_effect(find(setup.cell, label), seed)


@cache
def _sized(cell: str, effects: Any, values: Any, sizes: tuple[float, ...]) -> tuple[Sized, ...]:
    return tuple(at_sizes(SETUPS[cell], SimulatedEffects(effects, tuple(np.array(v) for v in values)), sizes))


def _alias(task: Task, setup: Setup) -> SimulatedEffects:
    """The bending of link 2 that adds a tenth to a whole of p2, if the task has it; else no effect."""
    if task.labels != ALIASES[:1]:
        return SimulatedEffects((), ())
    part = np.random.default_rng([task.seed, 1]).uniform(0.1, 1.0)
    return SimulatedEffects((find(setup.cell, ALIASES[0]),), (np.array([3 * part * setup.truth.p2]),))


def _touches(task: Task, setup: Setup, simulated: SimulatedEffects, seed: int) -> TouchSet:
    """The touches; a gripper that is stiffer along link 2 by a tenth to 0.8 of p_ee is none of the effects."""
    if task.labels != ALIASES[1:]:
        return simulate(setup, simulated, seed=seed)
    part = np.random.default_rng([task.seed, 2]).uniform(0.1, 0.8)
    stiffer = SimulatedEffects((StiffGripper(),), (np.array([part * setup.truth.p_ee]),))
    return simulate(setup, stiffer, seed=seed)


def diagnosed(record: Record, setup: Setup, simulated: SimulatedEffects, touches: TouchSet) -> Record:
    """A record filled with what the diagnosis of its touches says."""
    cell = setup.cell if record.noise == 'given' else replace(setup.cell, noise=None)
    try:
        before = calibrate(touches, cell)
        began = process_time()
        found = diagnose(before)
        record.cpu = process_time() - began
        before = found.refitted or before
        _record_naming(record, found, before)
        _record_errors(record, setup, cell, simulated, (before, found))
    except (ScaraKinetostaticError, ArithmeticError, ValueError, AssertionError, LookupError) as error:
        record.error = f'{type(error).__name__}: {error}'
    return record


def _record_naming(record: Record, found: Diagnosis, before: Calibration) -> None:
    """Notes the effects that were named."""
    record.verdict, record.p_value, record.remaining = found.verdict, found.p_value, found.remaining_p_value
    record.chi_square = before.reduced_chi_square
    record.named = tuple(item.effect.label for item in found.found if item.is_found)
    possible = [item.effect.label for item in found.found if item.is_possible]
    record.rivals = found.rivals
    expected = [ALIAS_OF.get(label, label) for label in record.simulated]
    naming: dict[str, str] = {}
    unnamed = all(not item.effect.is_physical for item in found.found if item.in_every_model) and not found.rivals
    for label, wanted in zip(record.simulated, expected, strict=True):
        if any(wanted in group for group in found.rivals):
            naming[label] = RIVALS
        elif wanted in record.named:
            naming[label] = ALONE
        else:
            naming[label] = NONE if found.verdict == 'none' else UNNAMED if unnamed or wanted in possible else WRONG
    record.naming = naming
    record.more = tuple(label for label in record.named if label not in expected)


def _record_errors(
    record: Record, setup: Setup, cell: Cell, simulated: SimulatedEffects, outcome: tuple[Calibration, Diagnosis]
) -> None:
    """Errors of the base model, of the extended and of the true model, on the touches that the true model uses."""
    before, found = outcome
    after, truth = found.extended or before, setup.truth
    if record.section == 'clean':
        record.z = _largest_z(before, truth), _largest_z(after, truth), np.nan
        return
    warm_start = WarmStart(simulated.robot(truth), NOISE, np.ones(len(before.touches), dtype=bool))
    true = calibrate(before.touches, cell, simulated.effects, warm_start=warm_start)
    three = before, after, true
    first, second, third = (held_out_force_error(replace(fit, used=true.used)).force_error for fit in three)
    record.held_out = first, second, third
    record.z = _largest_z(before, truth), _largest_z(after, truth), _largest_z(true, truth)
    record.value_z = _value_z(found, simulated)


def _largest_z(fit: Calibration, truth: Parameters) -> float:
    return float(np.nanmax(np.abs(fit.parameters.as_array() - truth.as_array()) / fit.std))


def _difference(effect: Effect, values: Floats, others: Floats) -> Floats:
    """`values` less `others`, (k,); of a wave a negative amplitude is half a turn of the phase."""
    if effect.name != 'transmission_error':
        return values - others
    turn = values[1] + (np.pi if values[0] < 0 else 0.0) - others[1]
    return np.array([abs(values[0]) - others[0], (turn + np.pi) % (2 * np.pi) - np.pi, values[2] - others[2]])


def _value_z(found: Diagnosis, simulated: SimulatedEffects) -> float:
    """Largest error of the values of effects that were found, in standard deviations; NaN if there is none."""
    largest = [np.nan]
    for effect, values in zip(simulated.effects, simulated.values, strict=True):
        for item in found.found:
            if item.effect.label != effect.label or len(item.values) != len(values):
                continue
            estimate, std = (np.array([getattr(row, name) for row in item.values]) for name in ('value', 'std'))
            largest += (np.abs(_difference(effect, estimate, values)) / np.where(std > 0, std, np.nan)).tolist()
    return float(np.nanmax(largest)) if np.isfinite(largest).any() else np.nan


def cases(section: str, cell: str) -> list[tuple[str, ...]]:
    """The effects of a section in a cell, one tuple per recording."""
    if section == 'clean':
        return [(), *((label,) for label in ALIASES)]
    if section == 'pairs':
        return [(a, b) for i, a in enumerate(PAIRED) for b in PAIRED[i + 1 :]]
    if section == 'unlisted':
        return [(kind,) for kind in UNLISTED]
    return [(effect.label,) for effect in catalogue(SETUPS[cell].cell) if effect.label != ALIASES[0]]

"""Outliers: bad touches among good ones, and the calibration with them.

One touch in ten is bad. Three kinds, each in realistic sizes:

- wrong touch: another disc is taken for the touched one;
- slipped touch: the tip sticks at an angle, so that the force has a tangential part of so many times its normal
  part, which bends the joints as well as it shows in the force;
- force spike: a force in a random direction is added to the reading.

The relevant size is not in newtons but the distance of the bad touch, free of noise, from what the model
allows, in standard deviations of a good one (`bound.size`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.common import CELL, NOISE
from benchmark.statistics.bound import size
from benchmark.statistics.runs import Setup, Task, described_cell, error_of, run_noise, run_starts, setup_of
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.streams import simulate_touches

SHARE = 0.1
WRONG, SLIPPED, SPIKE = 'wrong touch', 'slipped touch', 'force spike'


class Kind(NamedTuple):
    """Bad touches of one kind.

    Attributes:
        kind: one of three.
        least: of their size: tangential over normal force, or N; none for a wrong touch.
        most: of their size.
    """

    kind: str
    least: float = np.nan
    most: float = np.nan

    @property
    def label(self) -> str:
        """In words."""
        unit = ' N' if self.kind == SPIKE else ''
        return self.kind if np.isnan(self.least) else f'{self.kind}, {self.least:g} to {self.most:g}{unit}'


LARGE = (Kind(WRONG), Kind(SLIPPED, 0.3, 0.6), Kind(SPIKE, 5.0, 20.0))
SMALL = (Kind(SLIPPED, 0.05, 0.3), Kind(SPIKE, 1.0, 5.0))
MIXED = 'the three large kinds mixed'
CLEAN, LEFT_OUT = 'all good', 'bad touches left out by hand'
CASES = {**{kind.label: (kind,) for kind in (*LARGE, *SMALL)}, MIXED: LARGE}


@dataclass
class OutlierRun:
    """One recording, calibrated without bad touches, without those touches at all, and with each kind of them.

    Attributes:
        error: of the estimate, by case; (12,).
        sizes: of the bad touches, by case.
        named: which of these were rejected, by case.
        lost: number of good touches rejected, by case.
        failed: cases in which an error came instead.
    """

    error: dict[str, Floats] = field(default_factory=dict)
    sizes: dict[str, Floats] = field(default_factory=dict)
    named: dict[str, Mask] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)


def run_outliers(task: Task) -> list[OutlierRun]:
    """All cases on the same noise, run by run."""
    setup, cell = setup_of(task.robot, task.per_disc), described_cell(task.noise)
    runs = []
    for seed in task.seeds:
        good = simulate_touches(CELL, setup.truth, setup.plan, NOISE, seed)
        bad = np.sort(np.random.default_rng([seed, 2]).permutation(len(good))[: round(SHARE * len(good))])
        run, none = OutlierRun(), np.zeros(0, dtype=np.intp)
        variants = {CLEAN: (good, none), LEFT_OUT: (good.select(np.setdiff1d(np.arange(len(good)), bad)), none)}
        for label, kinds in CASES.items():
            exact = with_outliers(setup, bad, kinds, seed)
            run.sizes[label] = size(CELL, setup.truth, exact.select(bad), setup.exact.select(bad), NOISE)
            joints, force = good.joints - setup.exact.joints, good.force - setup.exact.force
            variants[label] = exact.replace(joints=exact.joints + joints, force=exact.force + force), bad
        for label, (touches, spoilt) in variants.items():
            try:
                _note(run, label, calibrate(touches, cell), setup, spoilt)
            except ScaraKinetostaticError as error:
                run.failed[label] = str(error)
        runs.append(run)
    return runs


def _note(run: OutlierRun, label: str, found: Calibration, setup: Setup, bad: NDArray[np.intp]) -> None:
    indices = [item.index for item in found.rejected]
    named = np.isin(bad, indices)
    run.error[label], run.named[label] = error_of(found, setup.truth), named
    run.lost[label] = len(indices) - int(named.sum())


def with_outliers(setup: Setup, bad: NDArray[np.intp], kinds: tuple[Kind, ...], seed: int) -> TouchSet:
    """The exact touches with some of them bad, the kinds in turn."""
    random = np.random.default_rng([seed, 3])
    touches = setup.exact
    for number, kind in enumerate(kinds):
        which = bad[number :: len(kinds)]
        amount = random.uniform(kind.least, kind.most, len(which)) if kind.kind != WRONG else np.zeros(len(which))
        if kind.kind == WRONG:
            disc = touches.disc.copy()
            disc[which] = (disc[which] + random.integers(1, len(CELL.discs), len(which))) % len(CELL.discs)
            touches = touches.replace(disc=disc)
        elif kind.kind == SPIKE:
            angle, force = random.uniform(0, 2 * np.pi, len(which)), touches.force.copy()
            force[which] += amount[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            touches = touches.replace(force=force)
        else:
            touches = _slipped(setup, touches, which, amount * random.choice([-1, 1], len(which)))
    return touches


def _slipped(setup: Setup, touches: TouchSet, which: NDArray[np.intp], amount: Floats) -> TouchSet:
    """Some touches with a tangential force of so many times the normal one, held by joints that feel it."""
    plan = setup.plan.select(which)
    inward = -plan.normal()
    tangent = np.stack([-inward[:, 1], inward[:, 0]], axis=1)
    joints, force = touches.joints.copy(), touches.force.copy()
    force[which] = plan.force[:, None] * (inward + amount[:, None] * tangent)
    turned, _ = inverse_kinetostatics(setup.truth, plan.contact(CELL), force[which], plan.posture, CELL.gripper_sign)
    before = joints[which]
    joints[which] = before + (turned - before + np.pi) % (2 * np.pi) - np.pi
    return touches.replace(joints=joints, force=force)


def run_task(task: Task) -> list[Any]:
    """All runs of a task of any section."""
    run = {'noise': run_noise, 'starts': run_starts, 'outliers': run_outliers}[task.section]
    return list(run(task))

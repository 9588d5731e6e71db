"""An arm that stands upright: scatter of the estimates over many recordings, recovery, error of the tip under load.

Simulated touches, at the end of a robot in MuJoCo. Usage: `python -m benchmark.gravity [RECORDINGS]`. With
`python -m benchmark.gravity RECORDINGS ur5|panda even|planned [FIRST]` the robots of a URDF (`benchmark.urdf`) make 72
touches, 20 robots in each cell: spread evenly, or as `plan --count 72` chooses them.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

import scara_kinetostatic as sk
from benchmark.engine_touches import simulate_touches
from benchmark.urdf import SOURCES, displaced, true_robot, urdf_cell
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.files.calibration_file import nominal_arm
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.cell import PAPER_DISCS
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.planning.next_touches import Planner
from scara_kinetostatic.simulation.mujoco import expected_parameters, scene_named
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.simulation.streams import simulate_touches as simulate_plan

KNOWN, TOUCHES = 3e-6, 72
"""Standard uncertainty of the objects of `benchmark.urdf`, m; touches of each recording there."""
GRAVITY = (0.0, -9.81)
ROBOTS = {
    '2 and 8 Nm': (sk.PAPER_ACTUAL, 8.0 / 9.81, 2.0 / 9.81),
    '6 and 20 Nm': (sk.PAPER_ACTUAL, 20.0 / 9.81, 6.0 / 9.81),
    'soft, 3 and 12 Nm': (sk.PAPER_MEASURED, 12.0 / 9.81, 3.0 / 9.81),
}
"""Parameters and static moments, kg m."""


def cell_of(s1: float, s2: float) -> sk.Cell:
    """The cell of the paper, upright; moments are stated a fifth too small."""
    nominal = sk.PAPER_NOMINAL.replace(s1=0.8 * s1, s2=0.8 * s2, gravity=GRAVITY)
    return sk.Cell(nominal, PAPER_DISCS, noise=sk.Noise(joint=1e-5, force=0.3))


def main(recordings: int) -> None:
    """Prints the figures."""
    for name, (robot, s1, s2) in ROBOTS.items():
        cell, truth = cell_of(s1, s2), robot.replace(s1=s1, s2=s2, gravity=GRAVITY)
        z, rejected, left_out, before, after = [], 0, 0, [], []
        random = np.random.default_rng(5)
        for seed in range(70000, 70000 + recordings):
            calibration = sk.calibrate(sk.simulate(cell, truth, seed=seed), cell)
            z.append([(calibration[n].value - getattr(truth, n)) / calibration[n].std for n in truth.names])
            rejected += int((~calibration.used).sum())
            left_out += len(calibration.rejected) - int((~calibration.used).sum())
            if seed < 70020:
                joints = np.array([random.uniform(0.3, 1.8, 200), random.uniform(0.6, 2.4, 200)]).T
                angle = random.uniform(-np.pi, np.pi, 200)
                force = random.uniform(20, 60, 200)[:, None] * np.array([np.cos(angle), np.sin(angle)]).T
                tip, _ = direct_kinetostatics(truth, joints, force)
                for errors, nominal in ((before, True), (after, False)):
                    found = Predictor(calibration.arm, nominal=nominal).locate(joints, force)
                    errors.extend(np.hypot(*(found.position - tip)[found.loaded].T))
        rms = np.sqrt(np.mean(np.square(z), axis=0))
        print(f'{name}: {recordings} recordings, {left_out} touches left out, {rejected} rejected; rms of z:')
        print('  ' + '  '.join(f'{n} {value:.2f}' for n, value in zip(truth.names, rms, strict=True)))
        print(f'  tip under load, rms: {1e6 * _rms(before):.0f} µm before, {1e6 * _rms(after):.1f} µm after')
        exact = _without_noise(cell, truth)
        found = sk.calibrate(exact, cell).parameters
        model = contact(found, exact.joints, cell.centers[exact.disc], cell.radii[exact.disc], warm_start=exact.force)
        off = np.abs(model.force - exact.force).max() / np.abs(exact.force).max()
        moments = ', '.join(f'{n} {getattr(found, n) / getattr(truth, n) - 1:.1e}' for n in ('s1', 's2'))
        print(f'  without noise: {moments} off, relative; force {off:.1e} of the largest')


def of_urdf(recordings: int, name: str, how: str, first: int) -> None:
    """Prints the figures of the robots of a URDF."""
    z, lost, refused, wrong = [], [], 0, list[str]()
    for seed in range(first, first + recordings):
        if seed == first or seed % 20 == 0:
            cell = urdf_cell(name, seed // 20, KNOWN)
            plan = Planner(nominal_arm(cell)).accurate(TOUCHES).plan if how == 'planned' else _even(cell)
        random = np.random.default_rng([33, seed])
        truth = true_robot(cell, random)
        true = replace(cell, discs=displaced(cell, KNOWN, random))
        try:
            found = sk.calibrate(simulate_plan(true, truth, plan, seed=seed), cell)
        except ScaraKinetostaticError as error:
            refused += 1
            wrong.append(f'{seed}: {error}')
            continue
        z.append((found.parameters.as_array() - truth.as_array()) / found.std)
        lost.append(len(found.rejected) / len(plan))
        if (worst := np.nanargmax(np.abs(z[-1]))) is not None and abs(z[-1][worst]) > 4.5:
            wrong.append(f'{seed}: {truth.names[worst]} {z[-1][worst]:.1f} standard deviations off')
    rms, most = np.sqrt(np.nanmean(np.square(z), axis=0)), np.nanmax(np.abs(z), axis=0)
    print(f'{name}, {how}: {recordings} recordings, {refused} refused, of {len(plan)} touches', end=' ')
    print(f'{100 * np.mean(lost):.0f} % left out (median {100 * np.median(lost):.0f}, at most {100 * max(lost):.0f})')
    for k, parameter in enumerate(truth.names):
        known = int(np.isfinite(np.array(z)[:, k]).sum())
        print(f'  {parameter:6s} z: rms {rms[k]:.2f}, at most {most[k]:.1f}, determined in {known}')
    print(*wrong, sep='\n')


def _even(cell: sk.Cell) -> Plan:
    plan = default_plan(cell, 18, (20.0, 40.0, 60.0))
    return plan.select(np.linspace(0, len(plan) - 1, TOUCHES).astype(int))


def engine(seed: int) -> None:
    """Prints how far a calibration of a robot in MuJoCo is off, in standard deviations."""
    cell, truth = cell_of(2.0, 0.7), sk.PAPER_ACTUAL.replace(s1=2.0, s2=0.7, gravity=GRAVITY)
    scene = replace(scene_named('plain'), parameters=truth)
    outcome = sk.diagnose(simulate_touches(scene, cell, default_plan(cell), seed=seed), cell)
    expected = expected_parameters(scene)
    z = {n: (outcome[n].value - getattr(expected, n)) / outcome.calibration[n].std for n in expected.names}
    worst = max(z, key=lambda name: abs(z[name]))
    print(f'MuJoCo, seed {seed}: verdict {outcome.verdict}, at most {abs(z[worst]):.1f} standard deviations ({worst})')


def _rms(errors: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def _without_noise(cell: sk.Cell, truth: sk.Parameters) -> sk.TouchSet:
    quiet = sk.Cell(cell.nominal, cell.discs, noise=sk.Noise(joint=1e-15, force=1e-12))
    return sk.simulate(quiet, truth, seed=0)


if __name__ == '__main__':
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    if len(sys.argv) > 2:
        if len(sys.argv) < 4 or sys.argv[2] not in SOURCES or sys.argv[3] not in ('even', 'planned'):
            sys.exit('usage: python -m benchmark.gravity [COUNT [ur5|panda even|planned [FIRST]]]')
        of_urdf(count, sys.argv[2], sys.argv[3], int(sys.argv[4]) if len(sys.argv) > 4 else 0)
        sys.exit()
    main(count)
    for seed in range(40, 40 + min(count, 5)):
        engine(seed)

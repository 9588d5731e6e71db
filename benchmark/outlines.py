"""Outlines: statistics of the parameters, errors of objects named, time; all simulated.

    python -m benchmark.outlines [--recordings N] [--named N] [--first SEED]

Cells of a square block, an L, an edge beside a disc, and a mixture; two robots. Of each: noise-free recovery, the root
mean square of (estimate - truth) / std over recordings, and the time beside that of discs.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter

import numpy as np

import scara_kinetostatic as sk
from scara_kinetostatic.files.cell_file import parse_cell
from scara_kinetostatic.model.cell import PAPER_CELL, Cell, Noise
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, Parameters
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.simulation.truth import parse_effect, with_effects

HEAD = """
robot:
  nominal: {x0: 0.0, y0: 0.0, theta1: 0.0, l1: 0.33, theta2: 0.0, l2: 0.33,
            p_ee: 1.0e-5, p1: 1.0e-5, p2: 1.0e-5, g_ee: 0.0, g1: 0.0, g2: 0.0}
tip: {radius: 0.005}
noise: {joint: 1.0e-5, force: 0.3}
"""
OBJECTS = {
    'block': 'outline: [[-0.06, 0.32], [0.06, 0.32], [0.06, 0.44], [-0.06, 0.44]], corner_radius: 0.002',
    'ell': 'outline: [[-0.30, 0.20], [-0.12, 0.20], [-0.12, 0.27], [-0.21, 0.27], [-0.21, 0.38], [-0.30, 0.38]], '
    'corner_radius: 0.008',
    'edge': 'outline: [[-0.40, 0.15], [-0.15, 0.45]], open: true',
    'disc': 'center: [0.22, 0.30], radius: 0.06',
    'second': 'outline: [[0.16, 0.16], [0.24, 0.12], [0.28, 0.20], [0.20, 0.24]], corner_radius: 0.003',
}
CELLS = {
    'block': ('block',),
    'L': ('ell',),
    'edge and disc': ('edge', 'disc'),
    'mixture': ('ell', 'block', 'disc'),
    'three outlines': ('ell', 'block', 'second'),
}
ROBOTS = {
    'paper': PAPER_ACTUAL,
    'soft': Parameters(-0.0031, 0.0016, 0.006, 0.3288, -0.005, 0.3317, 2e-5, 3e-5, 5e-5, 3e-5, 2e-4, 1e-4),
}
ERRORS = (
    'object_rotation[block]:angle=1e-3',
    'object_position[block]:x=1e-4,y=0',
    'object_offset[block]:offset=-2e-5',
    'edge_bow[block.2]:bow=2e-5',
    'edge_bow[ell.1]:bow=2e-5',
)
LEVELS = (10.0, 25.0, 40.0)
TOUCHES = 72


def cell_of(name: str) -> Cell:
    """A cell by its name."""
    return cell_with(**{item: OBJECTS[item] for item in CELLS[name]})


def cell_with(more: str = '', **objects: str) -> Cell:
    """A cell of objects by name, as a cell description has them, with further keys."""
    entries = ''.join(f'  - {{name: {name}, {text}}}\n' for name, text in objects.items())
    return parse_cell(f'{HEAD}{more}objects:\n{entries}')


def plan_of(cell: Cell):
    """About `TOUCHES` touches, half of them preloaded."""
    return default_plan(cell, TOUCHES // (2 * len(cell.discs)), LEVELS, preload=0.3)


def statistics(recordings: int, first: int) -> None:
    """Recovery, z and time of each cell and robot."""
    print('cell, robot: touches, of them on corners; largest noise-free error / 1e-6 deflection; rms z, worst; time')
    plan_of_discs = plan_of(PAPER_CELL)
    discs = simulate_touches(PAPER_CELL, PAPER_ACTUAL, plan_of_discs, None, first)
    for name in CELLS:
        cell = cell_of(name)
        plan = plan_of(cell)
        corners = int((~cell.surfaces.is_edge[plan.surface(cell)]).sum())
        for robot, truth in ROBOTS.items():
            exact = sk.calibrate(simulate_touches(cell, truth, plan, Noise(0, 0)), cell)
            off = np.abs(exact.parameters.as_array() - truth.as_array())
            lengths = [0, 1, 3, 5, 9]
            deflection = 40 * (truth.p_ee + 0.3**2 * truth.p1)
            z, times, reference = [], [], []
            for seed in range(first, first + recordings):
                touches = simulate_touches(cell, truth, plan, None, seed)
                c = sk.calibrate(touches, cell)
                times.append(timed(touches, cell))
                reference.append(timed(discs, PAPER_CELL))
                z.append([(c[n].value - getattr(truth, n)) / c[n].std for n in NAMES])
            rms = np.sqrt(np.mean(np.square(z), axis=0))
            print(
                f'{name}, {robot}: {len(plan)}, {corners}; {off[lengths].max() / (1e-6 * deflection):.1e}; '
                f'{np.sqrt(np.mean(np.square(z))):.3f}, {rms.min():.2f} to {rms.max():.2f}; '
                f'{np.min(times) / np.min(reference) / len(plan) * len(discs):.2f} times that of discs'
            )


def timed(touches, cell: Cell) -> float:
    """Seconds of the processor that a calibration takes."""
    begin = time.process_time()
    sk.calibrate(touches, cell)
    return time.process_time() - begin


def named(recordings: int, first: int) -> None:
    """Errors of a block beside an L and a disc, named, and false alarms."""
    cell = cell_of('mixture')
    plan = default_plan(cell, 24, LEVELS, preload=0.3)
    for text in ('', *ERRORS):
        counts = Counter()
        for seed in range(first, first + recordings):
            truth = with_effects(PAPER_ACTUAL, [parse_effect(text, cell)] if text else [])
            outcome = sk.diagnose(simulate_touches(cell, truth, plan, None, seed), cell)
            found = set(outcome.effects)
            label = text.split(':')[0]
            counts['named' if label in found else 'missed'] += bool(text)
            counts['alone'] += found == {label}
            counts['alarm'] += bool(found) and not text
        print(text or 'nothing', {key: f'{value} of {recordings}' for key, value in counts.items()})


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--recordings', type=int, default=200)
    parser.add_argument('--named', type=int, default=40)
    parser.add_argument('--first', type=int, default=1000)
    options = parser.parse_args()
    statistics(options.recordings, options.first)
    named(options.named, options.first)

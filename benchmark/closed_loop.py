"""A simulated robot that calibrates itself: how the uncertainty of the tip falls, beside its true error.

    python -m benchmark.closed_loop [--seed 0] [--tolerance 3e-5] [--json FILE] [--plot FILE]

The loop of `scara-kinetostatic demo`, on one clock and without ROS: the robot of table 2, 2.5 mm off its data sheet, in
the cell of figure 3, touches until the expanded uncertainty of the tip in the region is 30 µm. Every calibration is
that which the runner made. The error is the largest one of the calibrated tip, at 8 by 8 places of the region in both
elbow postures, without a force and under 40 N in 12 directions.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import FixedLocator, NullLocator

from benchmark.common import parser, print_and_save
from benchmark.rehearsal import Rehearsal
from benchmark.svg import svg_file
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics, inverse_kinetostatics
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, Parameters
from scara_kinetostatic.report.figure import FAINT, IN_MICRO, SERIES, WARN, as_svg, new_figure, style
from scara_kinetostatic.simulation.commanded import DEMO_CELL, ModelBody, Plant

FORCE = 40.0
"""Under which the error of the tip is judged, N."""


class Loop(NamedTuple):
    """One run.

    Attributes:
        touches: accepted when each calibration was made, (k,).
        uncertainty: the largest expanded one of the tip, (k,), m; infinite where it was not determined.
        error: the largest error of the tip, (k,), m.
        nominal_error: the same by the data sheet, m.
        tolerance: of the tip, m.
        figures: of the whole run.
    """

    touches: Floats
    uncertainty: Floats
    error: Floats
    nominal_error: float
    tolerance: float
    figures: dict[str, Any]


def largest_error(cell: Cell, parameters: Parameters) -> float:
    """Of the tip in the region by some parameters, m."""
    r = cell.region
    x, y = np.meshgrid(np.linspace(r.x_min, r.x_max, 8), np.linspace(r.y_min, r.y_max, 8))
    places = np.column_stack([x.ravel(), y.ravel()])
    turns = 2 * np.pi * np.arange(12) / 12
    forces = np.vstack([np.zeros((1, 2)), FORCE * np.column_stack([np.cos(turns), np.sin(turns)])])
    tips, loads = np.repeat(places, len(forces), axis=0), np.tile(forces, (len(places), 1))
    largest = 0.0
    for posture in (1, -1):
        side = np.full(len(tips), posture)
        joints = inverse_kinetostatics(PAPER_ACTUAL, tips, loads, side, cell.gripper_sign)[0]
        known = np.isfinite(joints).all(axis=1)
        found = direct_kinetostatics(parameters, joints[known], loads[known], cell.gripper_sign)[0]
        largest = max(largest, float(np.hypot(*(found - tips[known]).T).max()))
    return largest


def closed_loop(seed: int = 0, tolerance: float = 3e-5) -> Loop:
    """The run of one seed of the noise, until the tip is known to a tolerance, m."""
    cell = replace(DEMO_CELL, tolerance=tolerance)
    began, rows = time.monotonic(), list[tuple[float, float, float]]()
    plant = Plant(cell, ModelBody(cell, PAPER_ACTUAL), seed=seed)
    rehearsal = Rehearsal(cell, plant)
    campaign, known = rehearsal.runner.campaign, rehearsal.runner.campaign.knowledge

    def watch(_: Rehearsal) -> bool:
        nonlocal known
        if campaign.knowledge is not known:
            known = campaign.knowledge
            if known.now is not None:
                parameters = known.planner.arm.model.parameters
                rows.append((campaign.accepted, known.now, largest_error(cell, parameters)))
        return False

    rehearsal.runner.start()
    rehearsal.run(watch)
    end = rehearsal.runner.end
    touches, uncertainty, error = np.array(rows, dtype=float).T
    figures = {
        'why it ended': None if end is None else end.reason,
        'touches': campaign.accepted,
        'touches that failed': campaign.failed,
        'peak force, N': plant.peak_force,
        'contacts not planned': sum(meant != met for meant, met in rehearsal.contacts),
        'simulated s': rehearsal.time,
        'took s': time.monotonic() - began,
        'tip error by the data sheet, m': largest_error(cell, cell.nominal),
        'tip error at the end, m': float(error[-1]),
        'expanded uncertainty at the end, m': float(uncertainty[-1]),
    }
    return Loop(touches, uncertainty, error, figures['tip error by the data sheet, m'], tolerance, figures)


def loop_picture(loop: Loop) -> Markup:
    """Expanded uncertainty and error of the tip over the number of touches."""
    figure, (axes,) = new_figure(920, 320)
    tolerance = IN_MICRO * loop.tolerance
    known = np.isfinite(loop.uncertainty)
    axes.plot(
        loop.touches[known], IN_MICRO * loop.uncertainty[known], 'o-', color=SERIES[0], lw=1.6, ms=4.5,
        label='expanded uncertainty of the tip, as calibrated',
    )  # fmt: skip
    axes.plot(loop.touches, IN_MICRO * loop.error, 's', color=SERIES[1], ms=4, label='true error of the tip')
    axes.axhline(tolerance, color=WARN, lw=1.0, label=f'tolerance, {tolerance:.0f} µm')
    axes.axhline(IN_MICRO * loop.nominal_error, color=FAINT, lw=1.0, ls=(0, (5, 2.5)))
    axes.annotate(
        'by the data sheet', (0.5, IN_MICRO * loop.nominal_error), (0, -14), textcoords='offset points', color=FAINT
    )
    axes.set(
        yscale='log',
        xlabel='touches',
        ylabel='largest in the region  [µm]',
        xlim=(0, loop.touches[-1] + 1),
        ylim=(8, 8000),
    )
    axes.yaxis.set_major_locator(FixedLocator([10, 30, 100, 300, 1000, 3000]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(lambda value, _: f'{value:g}')
    axes.legend(frameon=False, loc='upper right', bbox_to_anchor=(1.0, 0.93))
    return as_svg(figure, 'closed_loop', 'uncertainty and error of the tip over the number of touches')


def main() -> int:
    """One run."""
    options_of = parser(__doc__, plot=True)
    options_of.add_argument('--seed', type=int, default=0)
    options_of.add_argument('--tolerance', type=float, default=3e-5, help='m')
    options = options_of.parse_args()
    loop = closed_loop(options.seed, options.tolerance)
    curve = {name: getattr(loop, name).tolist() for name in ('touches', 'uncertainty', 'error')}
    print_and_save(options.json, loop.figures | {'curve': curve})
    if options.plot:
        with style():
            options.plot.write_text(svg_file(loop_picture(loop)), encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())

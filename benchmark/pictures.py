"""The pictures of the README and the documentation, drawn from the code.

    python -m benchmark.pictures [--out docs/pictures] [--first N]

Every picture is that of a report, with the colours of its light page written in. All of them show data simulated by
this project; the first is that of the recording with which the README opens.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
from markupsafe import Markup

from benchmark.closed_loop import closed_loop, loop_picture
from benchmark.common import CELL, normal_error, parser
from benchmark.contour import CELL as CONTOUR_CELL
from benchmark.contour import MOVED_DISC, OBJECTS, calibrated, slide_along, surfaces_of
from benchmark.svg import svg_file
from scara_kinetostatic.bags.reader import embedded_cell
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.contour.trace import trace_contour
from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.planning import report as design_pictures
from scara_kinetostatic.planning.optimal_design import optimal_design
from scara_kinetostatic.planning.prediction import RobotModel
from scara_kinetostatic.report.figure import FAINT, SERIES, as_svg, new_figure, style
from scara_kinetostatic.results import figures
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.simulation.truth import parse_effect, with_effects
from scara_kinetostatic.studies.loops.dial_gauge import analyse_runs
from scara_kinetostatic.studies.loops.report import force_picture, map_picture
from scara_kinetostatic.studies.paper import report as paper_pictures
from scara_kinetostatic.studies.paper.study import reproduce, simulate_experiments

UNDECLARED = Path(__file__).parents[1] / 'bags' / 'undeclared_a.mcap'


def main() -> int:
    """Draw and write."""
    options_of = parser(__doc__, json_file=False)
    options_of.add_argument('--out', type=Path, default=Path('docs/pictures'))
    options_of.add_argument('--first', type=int, metavar='N', help='only the first ones')
    options = options_of.parse_args()
    out = options.out
    out.mkdir(parents=True, exist_ok=True)
    with style():
        for name, picture in islice(pictures(), options.first):
            (out / f'{name}.svg').write_text(svg_file(picture), encoding='utf-8')
            print(out / f'{name}.svg')
    return 0


def pictures() -> Iterator[tuple[str, Markup]]:
    """Name and SVG of each."""
    yield 'contour_errors', contour_errors()
    yield 'missing_effect', missing_effect()
    found = calibrate(simulate_touches(CELL, PAPER_ACTUAL, default_plan(CELL)), CELL)
    yield 'cell', figures.cell_picture(found)
    yield 'figure_3', paper_pictures.trend_picture(reproduce(2))
    design = optimal_design(RobotModel.of(CELL))
    yield 'number_of_touches', design_pictures.number_picture(design)
    gripper = analyse_runs(simulate_experiments())[0]['gripper']
    yield 'gripper_backlash', map_picture(gripper, 'gap', 'gap')
    yield 'gripper_force', force_picture(gripper.runs[0], 'force')
    yield 'closed_loop', loop_picture(closed_loop())


def contour_errors() -> Markup:
    """The error of the contour of an unknown disc, before and after calibration, compensation and diagnosis."""
    robot = with_effects(PAPER_ACTUAL, [parse_effect(MOVED_DISC, CONTOUR_CELL)])
    outcome = calibrated(robot, 0)
    outline = OBJECTS['disc']
    contour = trace_contour(slide_along(robot, outline, 15.0, 0), outcome.final.arm)
    surfaces = [*surfaces_of(contour, outcome.calibration.arm), contour.surface]
    errors = [normal_error(outline, surface) for surface in surfaces]
    true = contour.surface - errors[-1][:, None] * contour.normal
    return error_picture(true, contour.normal, errors)


def error_picture(surface: Floats, normal: Floats, errors: Sequence[Floats], magnified: float = 5.0) -> Markup:
    """Errors of the four models of `surfaces_of` on one slide whose true surface is known.

    Left: the outline with the errors magnified; right: the errors along the slide, on a linear scale up to 10 µm,
    beyond it logarithmic.

    Args:
        surface: true surface, (n, 2), m.
        normal: its outward normals, (n, 2).
        errors: of each model along the normal, outside positive, (n,), m, the largest first.
        magnified: factor of the errors on the left.
    """
    figure, (left, right) = new_figure(920, 360, columns=2, width_ratios=(0.74, 1.0))
    along = 1e3 * np.append(0.0, np.cumsum(np.hypot(*np.diff(surface, axis=0).T)))
    left.fill(*(1e3 * surface).T, color=FAINT, alpha=0.13, lw=0)
    labels = ('rigid, nominal', 'rigid, calibrated', 'deformable, calibrated', 'with the effect found')
    for label, error, colour in zip(labels, errors, (SERIES[1], SERIES[3], SERIES[4], SERIES[0]), strict=True):
        size = rms(error)
        said = f'{1e3 * size:.3g} mm' if size >= 1e-4 else f'{1e6 * size:.1f} µm'
        left.plot(*(1e3 * (surface + magnified * error[:, None] * normal)).T, color=colour, lw=1.3)
        right.plot(along, 1e3 * error, color=colour, lw=1.1, label=f'{label}: {said} rms')
    left.set(xlabel='x  [mm]', ylabel='y  [mm]', aspect='equal', adjustable='datalim')
    left.set_title(f'outline, errors × {magnified:g}')
    right.set_yscale('symlog', linthresh=1e-2)
    ticks = (-10, -1, -0.1, -0.01, 0, 0.01, 0.1, 1, 10)
    right.set_yticks(ticks, [f'{tick:g}'.replace('-', '−') for tick in ticks])
    right.minorticks_off()
    right.set_ylim(-10, 10)
    right.set(xlabel='distance along the surface  [mm]', ylabel='error along the normal  [mm]')
    right.legend(loc='lower center', bbox_to_anchor=(0.46, 1.0), frameon=False, ncols=2, columnspacing=1.4)
    return as_svg(figure, 'contour_errors', 'error of the surface by each model')


def missing_effect() -> Markup:
    """The deviation that each touch implies for an effect that is not declared, before and after the correction."""
    cell = embedded_cell(UNDECLARED)
    assert cell is not None
    outcome = calibrate_recordings([UNDECLARED], cell)
    (found,), (residual,) = outcome.diagnosis.found, outcome.effect_residuals
    titles = 'base model', f'with {found.effect.title}'
    return figures.effect_picture(residual, 'missing', titles)


if __name__ == '__main__':
    sys.exit(main())

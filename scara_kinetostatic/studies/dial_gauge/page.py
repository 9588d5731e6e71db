"""`dial_gauge.html`: one self-contained page with the tables and figures of dial gauge experiments."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scara_kinetostatic import __version__
from scara_kinetostatic.report.figure import style
from scara_kinetostatic.report.page import page_template
from scara_kinetostatic.studies.dial_gauge import figures, text
from scara_kinetostatic.studies.dial_gauge.analysis import DialGaugeAnalysis, LoopRecord, sense_name
from scara_kinetostatic.studies.dial_gauge.readings import GRIPPER
from scara_kinetostatic.studies.dial_gauge.result import Part, Run

NAME = 'dial_gauge.html'
_TEMPLATE = Path(__file__).parent / 'page.html.j2'
_MAP_CAPTION = 'With two standard deviations; dashed: mean; curve: {}.'
_STEP_CAPTION = (
    'Displacement less the elastic part, cycle by cycle: the backlash. Blue: positive force, orange: negative.'
)


def html_text(analysis: DialGaugeAnalysis) -> str:
    """The page."""
    points = analysis.points
    with style():
        parts = [part_section(part) for part in points.parts] if points else []
        loops = [_loop(record, f'loop{k}') for k, record in enumerate(analysis.loops)]
    return page_template(_TEMPLATE).render(
        version=__version__,
        sources=[*(points.sources if points else ()), *(record.source for record in analysis.loops)],
        warnings=analysis.warnings,
        summary=text.summary_table(points) if points else None,
        parts=parts,
        loops=loops,
    )


def part_section(part: Part) -> dict[str, Any]:
    """What a page shows of one part: title, sentences, pairs of pictures with captions, table."""
    pairs = []
    if part.compliance_map is not None and part.gap_map is not None:
        compliance = figures.map_picture(part.compliance_map, 'µm/N', 'compliance', f'{part.name}_compliance')
        gap = figures.map_picture(part.gap_map, 'µm', 'backlash (gap)', f'{part.name}_gap')
        pairs.append(
            [(compliance, _MAP_CAPTION.format('uᵀPu')), (gap, _MAP_CAPTION.format('width of an elliptical dead zone'))]
        )
    forces = [(figures.force_picture(run, f'{part.name}_force{k}'), _caption(run)) for k, run in _typical(part)]
    steps = (figures.step_picture(part, f'{part.name}_steps'), _STEP_CAPTION)
    return {
        'title': text.TITLES[part.name],
        'sentences': text.map_sentences(part),
        'pictures': [*pairs, [*forces, steps] if len(forces) == 1 else forces],
        'steps': None if len(forces) == 1 else steps,
        'table': text.run_table(part),
    }


def _typical(part: Part) -> list[tuple[int, Run]]:
    """The runs with the largest and the smallest gap."""
    order = sorted(range(len(part.runs)), key=lambda k: -part.runs[k].fit.gap.value)
    return [(k, part.runs[k]) for k in dict.fromkeys((order[0], order[-1]))]


def _caption(run: Run) -> str:
    where = f'{run.name}: ' if run.part == GRIPPER else ''
    unused = '; hollow: no load, not used' if not run.fit.used.all() else ''
    caption = f'{where}readings, straight lines, residuals{unused}.'
    return caption[0].upper() + caption[1:]


def _loop(record: LoopRecord, name: str) -> dict[str, Any]:
    return {
        'title': f'Loops: {record.source}',
        'loop': figures.loop_picture(record, f'{name}_record'),
        'reversals': figures.reversal_picture(record, f'{name}_reversals'),
        'senses': [
            {
                'title': f'Displacement {sense_name(sense)} after the reversal',
                'sentences': [text.level_sentence(sense), *text.sense_sentences(sense)],
                'table': text.reversal_table(sense),
            }
            for sense in record.analysis.senses
        ],
        'rejected': [f'{each.time:.2f} s: {each.reason}' for each in record.analysis.rejected],
    }

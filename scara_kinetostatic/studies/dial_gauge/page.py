"""`gauge.html`: one self-contained page with the tables and pictures of gauge experiments."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scara_kinetostatic import __version__
from scara_kinetostatic.render.figure import style
from scara_kinetostatic.render.page import page_template
from scara_kinetostatic.studies.dial_gauge import figures as pictures
from scara_kinetostatic.studies.dial_gauge import text as words
from scara_kinetostatic.studies.dial_gauge.analysis import DialGaugeStudy, LoopRecord, sense_name
from scara_kinetostatic.studies.dial_gauge.readings import GRIPPER
from scara_kinetostatic.studies.dial_gauge.result import DialGaugeAnalysis, Part, Run

NAME = 'gauge.html'
_TEMPLATE = Path(__file__).parent / 'page.html.j2'
MAPS = 'With two standard deviations; dashed: mean; curve: {}.'
STEPS = (
    'The elastic part taken off, cycle by cycle: what is left is the backlash. Blue: positive force, orange: negative.'
)


def html_text(study: DialGaugeStudy) -> str:
    """The page."""
    points = study.points
    with style():
        parts = [part_section(part) for part in points.parts] if points else []
        loops = [_loop(record, f'loop{k}') for k, record in enumerate(study.loops)]
    return page_template(_TEMPLATE).render(
        version=__version__,
        sources=[*(points.sources if points else ()), *(record.source for record in study.loops)],
        warnings=study.warnings,
        summary=summary(points) if points else None,
        parts=parts,
        loops=loops,
    )


def summary(points: DialGaugeAnalysis) -> dict[str, Any]:
    """The table of compliances and backlashes of all parts."""
    return _table(words.summary_table(points))


def _table(table: words.Table) -> dict[str, Any]:
    return {'columns': list(zip(table.heading, table.units, strict=True)), 'rows': table.rows}


def part_section(part: Part) -> dict[str, Any]:
    """What a page shows of one part: title, sentences, pairs of pictures with captions, table."""
    pairs = []
    if part.compliance_map is not None and part.gap_map is not None:
        compliance = pictures.map_picture(part.compliance_map, 'µm/N', 'compliance', f'{part.name}_compliance')
        gap = pictures.map_picture(part.gap_map, 'µm', 'backlash (gap)', f'{part.name}_gap')
        pairs.append([(compliance, MAPS.format('uᵀPu')), (gap, MAPS.format('width of an ellipse of free play'))])
    forces = [(pictures.force_picture(run, f'{part.name}_force{k}'), _caption(run)) for k, run in _typical(part)]
    steps = (pictures.step_picture(part, f'{part.name}_steps'), STEPS)
    return {
        'title': words.TITLES[part.name],
        'sentences': words.map_sentences(part),
        'pictures': [*pairs, [*forces, steps] if len(forces) == 1 else forces],
        'steps': None if len(forces) == 1 else steps,
        'table': _table(words.run_table(part)),
    }


def _typical(part: Part) -> list[tuple[int, Run]]:
    """The runs with the largest and the smallest gap."""
    order = sorted(range(len(part.runs)), key=lambda k: -part.runs[k].fit.gap.value)
    return [(k, part.runs[k]) for k in dict.fromkeys((order[0], order[-1]))]


def _caption(run: Run) -> str:
    where = f'{run.name}: ' if run.part == GRIPPER else ''
    unused = '; hollow: no load, not used' if not run.fit.used.all() else ''
    return f'{where}readings, straight lines, residuals{unused}.'


def _loop(record: LoopRecord, name: str) -> dict[str, Any]:
    return {
        'title': f'Loops: {record.source}',
        'loop': pictures.loop_picture(record, f'{name}_record'),
        'reversals': pictures.reversal_picture(record, f'{name}_reversals'),
        'senses': [
            {
                'title': f'Displacement {sense_name(sense)} after the reversal',
                'sentences': [words.level_sentence(sense), *words.sense_sentences(sense)],
                'table': _table(words.reversal_table(sense)),
            }
            for sense in record.analysis.senses
        ],
        'rejected': [f'{each.time:.2f} s: {each.reason}' for each in record.analysis.rejected],
    }

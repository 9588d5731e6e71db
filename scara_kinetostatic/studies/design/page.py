"""The files of a design: `design.html`, one self-contained page, `design.json`, and two plans of touches."""

from __future__ import annotations

from pathlib import Path

from scara_kinetostatic import __version__
from scara_kinetostatic.render.figure import COLOURS, mark, style
from scara_kinetostatic.render.json_file import json_text
from scara_kinetostatic.render.page import page_template
from scara_kinetostatic.simulation.plan_file import dump_plan
from scara_kinetostatic.studies.design import document, figures, text
from scara_kinetostatic.studies.design.result import Design

NAME = 'design.html'
PLAN, SMALLEST_PLAN = 'plan.yaml', 'plan_smallest.yaml'
_TEMPLATE = Path(__file__).parent / 'page.html.j2'


def html_text(design: Design) -> str:
    """The page."""
    with style():
        pictures = {
            'number': figures.number_picture(design),
            'without': figures.without_picture(design),
            'random': figures.random_picture(design),
            'tip': figures.tip_picture(design),
            'recommended': figures.plan_picture(design.recommended, design, 'recommended'),
            'smallest': figures.plan_picture(design.smallest, design, 'smallest'),
            'additional_disc': figures.additional_disc_picture(design),
            'placed': figures.placed_picture(design) if any(placed.row for placed in design.placed) else None,
        }
    discs = design.robot.cell.discs
    marks = [mark(number) for number in range(len(discs))]
    return page_template(_TEMPLATE).render(
        version=__version__,
        design=design,
        pictures=pictures,
        headline=text.headline(design),
        requirement=text.requirement(design),
        noise=text.noise_sentences(design),
        conditions=text.condition_sentences(design),
        recommended=text.set_sentences(design.recommended, design),
        smallest=text.set_sentences(design.smallest, design),
        places=text.disc_sentences(design),
        plan=text.plan_table(design.recommended, design),
        smallest_plan=text.plan_table(design.smallest, design),
        parameters=text.parameter_table(design),
        numbers=text.number_table(design),
        tables=text.factor_tables(design),
        legend=[(each.sign, COLOURS[each.colour], disc.name) for each, disc in zip(marks, discs, strict=True)],
    )


def design_files(design: Design) -> dict[str, str]:
    """The text of each file of a design by its name: both plans, the numbers, the page."""
    cell = design.robot.cell
    remarks = (*text.noise_sentences(design), *text.condition_sentences(design))
    return {
        PLAN: dump_plan(design.recommended.plan, cell, (*remarks, *text.set_sentences(design.recommended, design))),
        SMALLEST_PLAN: dump_plan(design.smallest.plan, cell, (*remarks, *text.set_sentences(design.smallest, design))),
        document.NAME: json_text(document.design_document(design)),
        NAME: html_text(design),
    }

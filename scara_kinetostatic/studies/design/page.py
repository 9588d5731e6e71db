"""`design.html`: one self-contained page with the optimal design."""

from __future__ import annotations

from pathlib import Path

from scara_kinetostatic import __version__
from scara_kinetostatic.render.figure import COLOURS, mark, style
from scara_kinetostatic.render.page import page_template
from scara_kinetostatic.studies.design import figures, text
from scara_kinetostatic.studies.design.result import Design

NAME = 'design.html'
_TEMPLATE = Path(__file__).parent / 'page.html.j2'


def html_text(design: Design) -> str:
    """The page."""
    with style():
        pictures = {
            'number': figures.number_picture(design),
            'without': figures.without_picture(design),
            'random': figures.random_picture(design),
            'tip': figures.tip_picture(design),
            'smallest': figures.plan_picture(design.smallest, design, 'smallest'),
            'spare': figures.plan_picture(design.spare, design, 'spare'),
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
        smallest=text.set_sentences(design.smallest, design),
        spare=text.set_sentences(design.spare, design),
        places=text.disc_sentences(design),
        plan=text.plan_table(design.smallest, design),
        spare_plan=text.plan_table(design.spare, design),
        parameters=text.parameter_table(design),
        numbers=text.number_table(design),
        tables=text.factor_tables(design),
        legend=[(each.sign, COLOURS[each.colour], disc.name) for each, disc in zip(marks, discs, strict=True)],
    )

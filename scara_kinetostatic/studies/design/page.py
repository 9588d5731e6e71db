"""`design.html`: one self-contained page with the answer to the design question."""

from __future__ import annotations

from pathlib import Path

from scara_kinetostatic import __version__
from scara_kinetostatic.render.figure import COLOURS, mark, style
from scara_kinetostatic.render.page import page_template
from scara_kinetostatic.studies.design import figures as pictures
from scara_kinetostatic.studies.design import text as words
from scara_kinetostatic.studies.design.result import Design

NAME = 'design.html'
_TEMPLATE = Path(__file__).parent / 'page.html.j2'


def html_text(design: Design) -> str:
    """The page."""
    with style():
        drawn = {
            'number': pictures.number_picture(design),
            'without': pictures.without_picture(design),
            'random': pictures.random_picture(design),
            'tip': pictures.tip_picture(design),
            'smallest': pictures.plan_picture(design.smallest, design, 'smallest'),
            'spare': pictures.plan_picture(design.spare, design, 'spare'),
            'one_more': pictures.one_more_picture(design),
            'placed': pictures.placed_picture(design) if any(placed.row for placed in design.placed) else None,
        }
    discs = design.robot.cell.discs
    looks = [mark(number) for number in range(len(discs))]
    return page_template(_TEMPLATE).render(
        version=__version__,
        design=design,
        pictures=drawn,
        headline=words.headline(design),
        asked=words.asked(design),
        smallest=words.choice_sentences(design.smallest, design),
        spare=words.choice_sentences(design.spare, design),
        places=words.disc_sentences(design),
        plan=words.plan_table(design.smallest, design),
        spare_plan=words.plan_table(design.spare, design),
        parameters=words.parameter_table(design),
        numbers=words.number_table(design),
        tables=words.tables(design),
        is_number=words.is_number,
        legend=[(look.sign, COLOURS[look.colour], disc.name) for look, disc in zip(looks, discs, strict=True)],
    )

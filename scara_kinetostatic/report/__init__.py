"""How results are shown: one form of a report, one way to the terminal, one to a page, one to JSON, for every verb.

A verb makes a `Report` from its result; figures are drawn when the page is made, so that text alone draws none:

    from functools import partial

    from scara_kinetostatic.report import Figure, Note, Report, Section, Table, Verdict, as_page, as_text, json_text

    def drift_report(drift: Drift) -> Report:
        return Report(
            title='Drift of a calibration',
            answer=Verdict('The arm has not changed', 'good', ('No parameter moved by more than its uncertainty.',)),
            source='monday.mcap, tuesday.mcap',
            blocks=(
                'A paragraph, on the terminal and on the page.',
                Section('Parameters', (Table(('name', 'change'), ('', 'mm'), rows), Note('± is one std. deviation'))),
                Section('Over time', (Figure(partial(drift_picture, drift), 'Change of each parameter.'),)),
            ),
            remarks=drift.warnings,
            footer='all numbers in full in drift.json',
        )

    print(as_text(report))            # no figures, no notes; a section with nothing left is left out
    page = as_page(report)            # one file of HTML
    text = json_text({'schema': 'scara_kinetostatic/drift/1', 'parameters': drift.parameters})

`json_text` takes dataclasses, named tuples, arrays, enums and times as they are, and writes null for a number that is
not finite. A block for one of the two alone is in ``Section('', (…), shown='page')`` or ``'terminal'``; one that few
need is ``folded``. Values become text by `quantities.shown`; pictures SVG by `figure.as_svg`.
"""

from __future__ import annotations

from scara_kinetostatic.report.content import Block as Block
from scara_kinetostatic.report.content import Fact as Fact
from scara_kinetostatic.report.content import Facts as Facts
from scara_kinetostatic.report.content import Figure as Figure
from scara_kinetostatic.report.content import Figures as Figures
from scara_kinetostatic.report.content import Items as Items
from scara_kinetostatic.report.content import Legend as Legend
from scara_kinetostatic.report.content import Level as Level
from scara_kinetostatic.report.content import Note as Note
from scara_kinetostatic.report.content import Report as Report
from scara_kinetostatic.report.content import Section as Section
from scara_kinetostatic.report.content import Verdict as Verdict
from scara_kinetostatic.report.json_file import Document as Document
from scara_kinetostatic.report.json_file import json_text as json_text
from scara_kinetostatic.report.json_file import plain as plain
from scara_kinetostatic.report.json_file import utc as utc
from scara_kinetostatic.report.table import NOT_DETERMINED as NOT_DETERMINED
from scara_kinetostatic.report.table import Table as Table
from scara_kinetostatic.report.text import as_page as as_page
from scara_kinetostatic.report.text import as_text as as_text
from scara_kinetostatic.report.text import sentence as sentence

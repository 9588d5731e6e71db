"""`report.html`: one self-contained page."""

from __future__ import annotations

import html as markup

from scara_kinetostatic.pipeline import Outcome
from scara_kinetostatic.report.document import Document
from scara_kinetostatic.report.json_file import json_text

NAME = 'report.html'


def html_text(outcome: Outcome, document: Document) -> str:
    """The page."""
    text = markup.escape(json_text(document))
    return f'<!DOCTYPE html><meta charset="utf-8"><title>Calibration</title><pre>{text}</pre>\n'

"""`calibration.json`: the document as text."""

from __future__ import annotations

import json

from scara_kinetostatic.report.document import Document

NAME = 'calibration.json'


def json_text(document: Document) -> str:
    """The document as JSON that every reader accepts.

    Raises:
        ValueError: a number in it is not finite.
    """
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + '\n'

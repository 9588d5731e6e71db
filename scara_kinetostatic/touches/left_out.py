"""Touches and recordings that the user leaves out of a calibration, and how they are written.

``5`` and ``10-14`` are touches by their numbers in the result, ``touches_1`` is a recording by the name of its file or
folder, ``touches_1:5`` and ``touches_1:10-14`` are touches by their numbers in that recording.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.touches.detection import Detection

REASON = 'left out on request'
_WHERE = 'touches left out'
_ENTRY = re.compile(r'(?:(?P<recording>.+):)?(?P<first>\d{1,9})(?:-(?P<last>\d{1,9}))?')


class LeftOut(NamedTuple):
    """One entry of the list.

    Attributes:
        text: as written.
        recording: name of a recording; empty for touches by their numbers in the result.
        numbers: of the touches; None for a whole recording.
    """

    text: str
    recording: str
    numbers: range | None

    def names(self, path: str | Path) -> bool:
        """Whether the entry names that recording."""
        return self.recording in (Path(path).name, Path(path).stem, str(path))


def parse_left_out(texts: Sequence[str], where: str) -> tuple[LeftOut, ...]:
    """The entries of a list.

    Args:
        texts: one for each entry.
        where: the option or parameter, for messages.

    Raises:
        ParameterError: a range of touches ends before it begins.
    """
    entries = []
    for text in (text.strip() for text in texts):
        match = _ENTRY.fullmatch(text)
        if match is None:
            entries.append(LeftOut(text, text, None))
            continue
        first, last = int(match['first']), int(match['last'] or match['first'])
        if last < first:
            raise ParameterError(where, f'{text}: expected a range of touches such as 10-14', 'write the smaller first')
        entries.append(LeftOut(text, match['recording'] or '', range(first, last + 1)))
    return tuple(entries)


def kept_recordings(paths: Sequence[str | Path], entries: Sequence[LeftOut]) -> list[str | Path]:
    """The recordings that are not left out as a whole.

    Raises:
        ParameterError: an entry names none of the recordings, or none of them is kept.
    """
    for entry in entries:
        if entry.recording and not any(map(entry.names, paths)):
            problem = f'{entry.recording!r} is none of the recordings {", ".join(Path(path).name for path in paths)}'
            raise ParameterError(_WHERE, problem, 'write touches as 5 or 10-14, or with their recording as NAME:5')
    kept = [path for path in paths if not any(entry.numbers is None and entry.names(path) for entry in entries)]
    if not kept:
        raise ParameterError(_WHERE, 'every recording is', 'keep one')
    return kept


def leave_out(detection: Detection, paths: Sequence[str | Path], entries: Sequence[LeftOut]) -> Detection:
    """The detection with the touches of the entries among the rejected ones.

    Args:
        detection: of the recordings in `paths`, the touches numbered on from one to the next.
        paths: the recordings that are kept.
        entries: those of recordings that are left out have no effect.

    Raises:
        ParameterError: there is no touch of such a number.
    """
    numbers: set[int] = set()
    edges = [*detection.first_touches, detection.found]
    for entry in entries:
        spans = [(0, detection.found)]
        if entry.recording:
            spans = [(a, b) for path, a, b in zip(paths, edges, edges[1:], strict=False) if entry.names(path)]
        for first, end in spans if entry.numbers is not None else ():
            assert entry.numbers is not None
            if first + entry.numbers[-1] >= end:
                problem = f'{entry.text}: the touches are numbered from 0 to {end - first - 1}'
                raise ParameterError(_WHERE, problem, 'take the numbers from the report')
            numbers.update(first + number for number in entry.numbers)
    return detection.without(numbers, REASON) if numbers else detection

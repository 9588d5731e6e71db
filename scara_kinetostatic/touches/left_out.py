"""Touches and recordings that the user leaves out of a calibration, and how they are written.

``5`` and ``10-14`` are touches by their numbers in the result, ``touches_1`` is a recording by the name of its file or
folder, ``touches_1:5`` and ``touches_1:10-14`` are touches by their numbers in that recording. Of recordings with the
same name in several folders, ``monday/touches_1`` is one.
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
        named, parts = Path(self.recording).parts, Path(path).parts
        return named == parts[-len(named) :] or self.recording == Path(path).stem


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
        match = re.fullmatch(r'(?:(?P<recording>.+):)?(?P<first>\d{1,9})(?:-(?P<last>\d{1,9}))?', text)
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
        ParameterError: an entry names none of the recordings, or several; none of them is kept; or touches are given by
            their numbers in the result although a recording before them is left out, which changes these numbers.
    """
    for entry in entries:
        named = [str(path) for path in paths if entry.recording and entry.names(path)]
        if entry.recording and not named:
            problem = f'{entry.recording!r} is none of the recordings {", ".join(Path(path).name for path in paths)}'
            raise ParameterError(_WHERE, problem, 'write touches as 5 or 10-14, or with their recording as NAME:5')
        if len(named) > 1:
            problem = f'{entry.recording!r} is the name of several recordings: {", ".join(named)}'
            raise ParameterError(_WHERE, problem, 'write the folder before the name, or the whole name of the file')
    whole = [entry for entry in entries if entry.numbers is None]
    kept = [path for path in paths if not any(entry.names(path) for entry in whole)]
    if not kept:
        raise ParameterError(_WHERE, 'every recording is', 'keep one')
    for entry in entries if kept != list(paths[: len(kept)]) else ():
        if entry.numbers is not None and not entry.recording:  # the numbers are not those the user has seen
            problem = f'{entry.text} counts the touches of a recording that is left out as well'
            raise ParameterError(_WHERE, problem, 'write touches with their recording, as NAME:5')
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
                count = end - first
                known = f'the touches are numbered from 0 to {count - 1}' if count else 'there are no touches'
                problem = f'{entry.text}: {known}'
                raise ParameterError(_WHERE, problem, 'take the numbers from the report')
            numbers.update(first + number for number in entry.numbers)
    return detection.without(numbers, REASON) if numbers else detection

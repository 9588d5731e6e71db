"""Touches and recordings that the user leaves out of a calibration, and how they are written.

``5`` and ``10-14``, or both as ``5,10-14``, are touches by their numbers in the result, ``touches_1`` is a recording by
the name of its file or folder. Of recordings with the same name in several folders, ``monday/touches_1`` is one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.touches.detection import Detection

REASON = 'left out on request'
_WHERE = 'touches left out'
LeftOut = str | range
"""The name of a recording, or touches by their numbers in the result."""


def parse_left_out(texts: Sequence[str], where: str) -> tuple[LeftOut, ...]:
    """The entries of a list.

    Args:
        texts: one for each entry.
        where: the option or parameter, for messages.

    Raises:
        ParameterError: a range of touches ends before it begins.
    """
    entries = list[LeftOut]()
    for text in (text.strip() for text in texts):
        matches = [re.fullmatch(r'\s*(\d{1,9})(?:-(\d{1,9}))?\s*', part) for part in text.split(',')]
        found = [range(int(match[1]), int(match[2] or match[1]) + 1) for match in matches if match]
        if not all(found):
            raise ParameterError(where, f'{text}: expected a range of touches such as 10-14', 'write the smaller first')
        entries += found if all(matches) else [text]
    return tuple(entries)


def kept_recordings(paths: Sequence[str | Path], entries: Sequence[LeftOut]) -> list[str | Path]:
    """The recordings that are not left out.

    Raises:
        ParameterError: an entry names none of the recordings, or several; none of them is kept; or touches are left
            out, too: their numbers are those with the recording.
    """
    kept = list(paths)
    for name in (entry for entry in entries if isinstance(entry, str)):
        named = [path for path in paths if _names(name, Path(path))]
        if len(named) != 1:
            problem = f'{name!r} is {"the name of several" if named else "none"} of the recordings '
            remedy = 'write a recording with its folder, and touches as 5 or 10-14'
            raise ParameterError(_WHERE, problem + ', '.join(map(str, named or paths)), remedy)
        kept = [path for path in kept if path != named[0]]
    if not kept:
        raise ParameterError(_WHERE, 'every recording is', 'keep one')
    if len(kept) < len(paths) and any(isinstance(entry, range) for entry in entries):
        problem = 'without a recording the touches have other numbers'
        raise ParameterError(_WHERE, problem, 'leave the recording out first, and take them from that result')
    return kept


def _names(name: str, path: Path) -> bool:
    """Whether a name is that of a recording."""
    parts = Path(name).parts
    return parts == path.parts[-len(parts) :] or name == path.stem


def leave_out(detection: Detection, entries: Sequence[LeftOut]) -> Detection:
    """The detection with the touches of the entries among the rejected ones.

    Raises:
        ParameterError: there is no touch of such a number.
    """
    numbers = set[int]()
    for entry in (entry for entry in entries if isinstance(entry, range)):
        if entry[-1] >= detection.found:
            problem = f'there is no touch {entry[-1]} among {detection.found}, which are numbered from 0'
            raise ParameterError(_WHERE, problem, 'take the numbers from the report')
        numbers.update(entry)
    return detection.without(numbers, REASON) if numbers else detection

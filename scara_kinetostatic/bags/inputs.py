"""The cell description of several recordings: the one that all contain, and those that differ from the one in use."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from pathlib import Path

from scara_kinetostatic.bags.reader import embedded_cell
from scara_kinetostatic.errors import InputError, RecordingError
from scara_kinetostatic.files.tables import is_touch_table
from scara_kinetostatic.model.cell import Cell, different_parts


def recorded_cell(paths: Sequence[Path], option: str) -> Cell:
    """The cell description that all recordings contain.

    Args:
        paths: recordings, and touch tables, which contain none.
        option: how the user names a cell description instead, such as ``--cell``.

    Raises:
        RecordingError: a recording has no cell description or another one than the first, or all are tables.
        CellError: it is not valid.
    """
    cells = {path: embedded_cell(path) for path in paths if not is_touch_table(path)}
    if not cells:
        raise RecordingError(paths[0], 'a table contains no cell description', f'give one by {option}')
    first = next(iter(cells))
    for path, cell in cells.items():
        if cell is None:
            raise RecordingError(path, 'contains no cell description', f'give one by {option}')
        if cell != cells[first]:
            raise RecordingError(path, f'contains another cell description than {first}', f'choose one by {option}')
    common = cells[first]
    assert common is not None
    return common


def other_descriptions(cell: Cell, paths: Sequence[Path], option: str, without: Collection[str] = ()) -> list[str]:
    """One sentence for each recording that contains another cell description than the one in use.

    Args:
        cell: in use.
        paths: recordings and touch tables.
        option: what named it, such as ``--cell``.
        without: parts in which they may differ.
    """
    sentences = []
    for path in (path for path in paths if not is_touch_table(path)):
        with suppress(InputError):  # an invalid one may be the reason to name another
            recorded = embedded_cell(path)
            keys = [] if recorded is None else [k for k in different_parts(cell, recorded) if k not in without]
            if keys:
                sentences.append(
                    f'{path} contains another cell description ({", ".join(keys)}); that of {option} is used'
                )
    return sentences

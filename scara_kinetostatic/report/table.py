"""Tables of text, and how they are set on a terminal."""

from __future__ import annotations

import re
from typing import NamedTuple

NOT_DETERMINED = '–'
"""Stands where a quantity is not determined."""
_NUMBER = re.compile(
    rf'(below |[<>≤≥] ?)?[-−+±(]?\d[\d.e+−±\-/…%() ]*|{NOT_DETERMINED}|not determined|nothing|[-−]?inf|nan'
)
_STD = ' ± '


class Table(NamedTuple):
    """A table, all text.

    Attributes:
        heading: one word or phrase per column.
        units: of the columns, empty where there is none.
        rows: one cell per column; in a row with fewer cells the last one extends over the columns that remain.
        title: above it; empty for none.
        levels: of each row ``good``, ``caution``, ``bad``, ``faint`` or nothing; the colour on a page. Empty if no
            row has one.
    """

    heading: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    title: str = ''
    levels: tuple[str, ...] = ()

    def is_number(self, column: int) -> bool:
        """Whether a column holds numbers only; these are set to the right."""
        cells = [row[column] for row in self.rows if self._is_single(row, column) and row[column]]
        return bool(cells) and all(_NUMBER.fullmatch(cell) for cell in cells)

    def lines(self) -> list[str]:
        """The table as aligned lines: heading, units if there are any, rows.

        Text is set to the left, numbers to the right, a value with its standard deviation at the ±.
        """
        above = (line for line in (self.heading, self.units) if any(line))
        lines = [list(line) for line in (*above, *self.rows)]
        for column in range(len(self.heading)):
            own = [line for line in lines if self._is_single(line, column)]
            for line, cell in zip(own, _padded([line[column] for line in own], self.is_number(column)), strict=True):
                line[column] = cell
        return ['  '.join(line).rstrip() for line in lines]

    def text(self) -> str:
        """The same lines as one text."""
        return '\n'.join(self.lines())

    def _is_single(self, row: tuple[str, ...] | list[str], column: int) -> bool:
        """Whether a row has a cell for this column alone."""
        return column < len(row) - (len(row) < len(self.heading))


def _padded(cells: list[str], number: bool) -> list[str]:
    """The cells of one column at equal width."""
    if number and any(_STD in cell for cell in cells):
        parts = [cell.partition(_STD) for cell in cells]
        before = max(len(value) for value, _, _ in parts)
        cells = [f'{value:>{before}}{sign}{std}' for value, sign, std in parts]
        number = False
    width = max((len(cell) for cell in cells), default=0)
    return [cell.rjust(width) if number else cell.ljust(width) for cell in cells]

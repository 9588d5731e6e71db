"""The recordings with an effect that nothing in them declares, made from their truth files.

``python -m pipeline.undeclared FOLDER`` (with ``test`` and the package on the path) makes all three there, as
`scara-kinetostatic simulate` does; the one effect that the package does not know is registered first.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

from simulation.oval_disc import OvalDisc

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.bags.reader import embedded_cell
from scara_kinetostatic.cli.main import main
from scara_kinetostatic.effects.registry import register, unregister
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.simulation.truth import load_truth

BAGS = Path(__file__).parents[2] / 'bags'
TRUTH = Path(__file__).parent / 'truth'
COMMON = '--per-disc 18 --preload 0.3 --joint-rate 20 --wrench-rate 25 --compression zstd'


class Undeclared(NamedTuple):
    """A recording, by name, and the further options it was made with."""

    name: str
    options: str = ''


ALL = (
    Undeclared('undeclared_a', '--seed 101'),
    Undeclared('undeclared_b', f'--seed 102 --plain --cell {BAGS / "measured.yaml"}'),
    Undeclared('undeclared_c', '--seed 103'),
)


@contextmanager
def oval_discs_listed() -> Iterator[None]:
    """A context in which the catalogue contains oval discs, too."""

    def oval_discs(cell: Cell) -> list[OvalDisc]:
        return [OvalDisc.of(number, disc.name) for number, disc in enumerate(cell.discs)]

    register(oval_discs)
    try:
        yield
    finally:
        unregister(oval_discs)


def true_robot(name: str, cell: Cell) -> ExtendedModel:
    """The true robot of a recording, from its truth file."""
    with oval_discs_listed():
        return load_truth(TRUTH / f'{name}.yaml', cell)


def path_of(name: str) -> Path:
    """A recording."""
    return BAGS / f'{name}.mcap'


def cell_of(name: str) -> Cell:
    """The cell in it, or the one beside it."""
    return embedded_cell(path_of(name)) or load_cell(BAGS / 'measured.yaml')


@cache
def outcome_of(name: str, estimated: bool = False) -> Outcome:
    """The calibration of a recording, made without the truth; with its noise estimated."""
    cell = cell_of(name)
    return calibrate_recordings([path_of(name)], replace(cell, noise=None) if estimated else cell)


def make(recording: Undeclared, folder: Path) -> Path:
    """Make one of the recordings in a folder."""
    out = folder / f'{recording.name}.mcap'
    options = [*COMMON.split(), *recording.options.split(), '--truth', str(TRUTH / f'{recording.name}.yaml')]
    with oval_discs_listed():
        if main(['simulate', '--out', str(out), *options]):
            raise SystemExit(1)
    return out


if __name__ == '__main__':
    for one in ALL:
        make(one, Path(sys.argv[1]))

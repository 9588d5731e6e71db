"""Files that the examples of the Python interface name."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

import scara_kinetostatic as sk
from benchmark.common import dump_touch_table
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.cli.main import main
from scara_kinetostatic.files.tables import TouchTable
from scara_kinetostatic.pipeline import calibrate_recordings

ROOT = Path(__file__).parents[2]
EFFECT = 'object_radius[disc_2]:radius=6e-5'


@pytest.fixture(scope='session')
def example_files(tmp_path_factory) -> Path:
    """A folder with the cell, a table of touches and a recording of the same robot."""
    folder = tmp_path_factory.mktemp('examples')
    (folder / 'cell.yaml').write_text((ROOT / 'config' / 'cell.yaml').read_text() + 'tip: {radius: 0.005}\n')
    cell = sk.load_cell(folder / 'cell.yaml')
    touches = sk.simulate(cell, sk.PAPER_ACTUAL, effects=[EFFECT], seed=1)
    names = tuple(cell.discs[number].name for number in touches.disc)
    table = TouchTable(touches.joints, touches.force, names, touches.time, touches.approach, (), '')
    (folder / 'touches.csv').write_text(dump_touch_table(table), encoding='utf-8')
    recording = ['--out', str(folder / 'recording.mcap'), '--cell', str(folder / 'cell.yaml'), '--effect', EFFECT]
    assert main(['simulate', *recording, '--joint-rate', '20', '--wrench-rate', '25', '--preload', '0.3']) == 0
    plan = folder / 'slides.yaml'
    plan.write_text('- {slide: {center: [0.2, 0.3], radius: 0.03}, force: 15, friction: 0.1, speed: 0.04, to: 1.05}\n')
    slide = ['--out', str(folder / 'slide.mcap'), '--cell', str(folder / 'cell.yaml'), '--plan', str(plan)]
    assert main(['simulate', *slide]) == 0
    return folder


@pytest.fixture(scope='session')
def calibrated() -> Callable[..., Outcome]:
    """`calibrate_recordings`, once for all examples: their files are the same."""
    outcomes: dict[str, Outcome] = {}

    def calibrate(paths: list[str], cell: sk.Cell, fixed: None = None) -> Outcome:
        if str(paths) not in outcomes:
            outcomes[str(paths)] = calibrate_recordings(paths, cell, fixed=fixed)
        return outcomes[str(paths)]

    return calibrate


@pytest.fixture
def in_example_files(example_files, tmp_path, monkeypatch) -> Path:
    """A fresh copy of the files as the working directory."""
    place = tmp_path / 'work'
    shutil.copytree(example_files, place)
    monkeypatch.chdir(place)
    return place

"""Recordings and cells for the command, and a way to run it."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.command import Result, Run
from conftest import page_left_out

from scara_kinetostatic import pipeline
from scara_kinetostatic.cli.main import main
from scara_kinetostatic.diagnosis.result import Diagnosis

CELL = """\
robot:
  joint_names: [joint1, joint2]
  nominal: {x0: 0, y0: 0, theta1: 0, l1: 0.33, theta2: 0, l2: 0.33,
            p_ee: 1e-5, p1: 1e-5, p2: 1e-5, g_ee: 0, g1: 0, g2: 0}
objects:
  - {name: disc_1, center: [-0.25, 0.30], radius: 0.15, uncertainty: {center: 3.0e-6, radius: 2.0e-6}}
  - {name: disc_2, center: [0.20, 0.40], radius: 0.05, uncertainty: {center: 3.0e-6, radius: 2.0e-6}}
  - {name: disc_3, center: [0.05, 0.25], radius: 0.08, uncertainty: {center: 3.0e-6, radius: 2.0e-6}}
sensor: {joint_states: /joint_states, wrench: /wrench, frame: base, sign: on_object}
noise: {joint: 1.0e-5, force: 0.3}
"""
SLOW = ('--joint-rate', '40', '--wrench-rate', '40')
"""Sensors of a recording that is soon made and read."""


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs the command in this process, in a folder of its own."""
    monkeypatch.chdir(tmp_path)

    def command(*arguments: object) -> Result:
        status = main([str(argument) for argument in arguments])
        return Result(status, *capsys.readouterr())

    return command


@pytest.fixture
def undiagnosed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The diagnosis, which takes most of the rest of the time, finds nothing."""
    monkeypatch.setattr(pipeline, 'diagnose', lambda _: Diagnosis('none', 0.5))


@pytest.fixture(scope='session')
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `cell.yaml`, `good` (36 touches), `plain` (without cell), `few` (3 touches)."""
    folder = tmp_path_factory.mktemp('recordings')
    (folder / 'cell.yaml').write_text(CELL)
    (folder / 'few.yaml').write_text(
        ''.join(f'- {{disc: disc_{n}, angle_deg: -80, posture: left, force: 20}}\n' for n in (1, 2, 3))
    )
    assert main(['simulate', '--out', str(folder / 'good'), '--per-disc', '6', *SLOW]) == 0
    assert main(['simulate', '--out', str(folder / 'plain'), '--per-disc', '6', '--plain', '--seed', '1', *SLOW]) == 0
    assert main(['simulate', '--out', str(folder / 'few'), '--plan', str(folder / 'few.yaml'), *SLOW]) == 0
    return folder


@pytest.fixture(scope='session')
def results(recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders `a` and `b`: calibrations of `good` and `plain`, two recordings of one robot."""
    folder = tmp_path_factory.mktemp('results')
    cell = ['--cell', str(recordings / 'cell.yaml')]
    for name, out in (('good', 'a'), ('plain', 'b')):
        with page_left_out():
            assert main(['calibrate', str(recordings / name), *cell, '--out', str(folder / out)]) == 0
    return folder

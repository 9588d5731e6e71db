"""Recordings of the engine: streams, truth, the command."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from mujoco_cell.conftest import CELL
from mujoco_cell.engine_recordings import ALL, BAGS, SENSORS, EngineRecording
from mujoco_cell.engine_recordings import TRUTH as TRUTHS

from benchmark.engine_touches import as_touches, simulate_touches
from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.cli import mujoco
from scara_kinetostatic.cli.main import main
from scara_kinetostatic.model.cell import Cell, Noise, SensorFrame, SensorSign
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.mujoco import (
    SimulatedMotion,
    TouchController,
    as_streams,
    preload_plan,
    simulate_streams,
    truth_of_scene,
)
from scara_kinetostatic.simulation.mujoco.engine import SCENES, scene_named
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.simulation.streams import SensorModel
from scara_kinetostatic.touches.detection import find_touches

EXACT = Noise(0.0, 0.0)


@pytest.fixture(scope='module')
def with_friction(few: Plan) -> SimulatedMotion:
    return TouchController(scene_named('contact_friction'), CELL, few).run()


@pytest.mark.parametrize(
    'cell',
    [CELL, replace(CELL, sensor=CELL.sensor._replace(frame=SensorFrame.TOOL, sign=SensorSign.ON_ROBOT))],
    ids=['base', 'tool'],
)
def test_touches_found_in_the_streams_are_those_played(few: Plan, with_friction: SimulatedMotion, cell: Cell) -> None:
    motion = with_friction
    streams = as_streams(motion, scene_named('contact_friction'), cell, SensorModel(touch_noise=EXACT), 1)
    expected, detection = as_touches(motion, cell, few), find_touches(streams, cell)
    assert detection.found == len(few)
    assert not detection.rejected
    assert np.array_equal(detection.touches.disc, few.disc)
    assert np.array_equal(detection.touches.posture, few.posture)
    assert np.abs(detection.touches.joints - expected.joints).max() < 2e-6
    assert np.abs(detection.touches.force - expected.force).max() < 0.06
    found, moved = (np.stack([one.approach, one.press]) for one in (detection.touches, expected))
    sure = np.abs(moved) > 1e-4
    assert sure.any(axis=2).all()
    assert np.array_equal(np.sign(found)[sure], np.sign(moved)[sure])


def test_a_joint_that_crosses_its_backlash_under_load_is_not_at_rest() -> None:
    """Gravity keeps the joints of a tilted arm from crossing it at once; the force stands still while they do."""
    some = preload_plan(CELL).select(np.arange(4, 9))
    detection = find_touches(simulate_streams(scene_named('tilted_base'), CELL, some, seed=1), CELL)
    assert detection.found == len(some)


@pytest.mark.parametrize('one', ALL, ids=lambda one: one.scene)
def test_recordings_kept_with_the_project_are_what_the_engine_plays(one: EngineRecording) -> None:
    kept = find_touches(read_streams(BAGS / f'{one.name}.mcap', one.cell), one.cell).touches
    count, unit = 1, np.random.default_rng([one.seed, 0]).standard_normal((2, len(kept), 2))
    errors = SENSORS.touch_errors(one.cell, unit, kept.force)
    motion = simulate_touches(one.robot, one.cell, one.plan.select(np.arange(count)), noise=EXACT)
    assert np.abs(kept.joints[:count] - errors[0][:count] - motion.joints).max() < 2e-5
    force = kept.force[:count] - errors[1][:count]
    size = np.linalg.norm(motion.force, axis=1)
    assert np.abs(np.linalg.norm(force, axis=1) - size).max() < 0.25
    # where a tip sticks depends on the last digit of the movement: within the cone of friction, on any machine
    leeway = 0.25 + one.robot.contact_friction * size
    assert np.all(np.abs(force - motion.force) < leeway[:, None])
    assert np.array_equal(kept.disc, one.plan.disc)
    text = (TRUTHS / f'{one.name}.yaml').read_text(encoding='utf-8')
    made = truth_of_scene(one.robot, one.cell, one.seed)
    assert {**yaml.safe_load(text), 'engine': ''} == {**made, 'engine': ''}


@pytest.mark.parametrize('name', SCENES)
def test_truth_names_what_was_built(name: str) -> None:
    truth = truth_of_scene(scene_named(name), CELL)
    assert truth['built'] == {key: value for key, value in PAPER_ACTUAL.as_dict().items() if key in truth['built']}
    assert len(truth['built']) == len(truth['expected']) == 12
    assert bool(truth['effects']) == (name != 'plain')
    assert all(np.isfinite(value) for effect in truth['effects'] for value in effect['parameters'].values())


def test_a_base_on_springs_shows_in_the_gripper() -> None:
    scene = scene_named('base_on_springs')
    truth = truth_of_scene(scene, CELL)
    assert truth['expected']['p_ee'] == pytest.approx(PAPER_ACTUAL.p_ee + np.mean(scene.base_compliance))
    assert truth['effects'][0]['parameters']['excess'] == pytest.approx(2.5e-6)


def test_command_writes_recording_and_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(['mujoco', 'made', '--scene', 'two', '--seed', '4', '--per-disc', '1']) == 0
    assert (tmp_path / 'made' / 'made_0.mcap').is_file()
    truth = yaml.safe_load((tmp_path / 'made.truth.yaml').read_text())
    assert [effect['name'] for effect in truth['effects']] == ['contact_friction', 'base_compliance']
    assert truth['seed'] == 4
    assert find_touches(read_streams(tmp_path / 'made', CELL), CELL).found == 6
    assert b'contact_friction' not in (tmp_path / 'made' / 'made_0.mcap').read_bytes()
    assert main(['mujoco', 'made', '--scene', 'two']) == 2
    assert 'exists already' in capsys.readouterr().err


def test_names_in_the_help_are_those_of_the_scenes() -> None:
    assert all(name in str(mujoco.__doc__) for name in SCENES)


def test_without_the_engine_the_command_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, 'mujoco', None)
    assert main(['mujoco', 'made']) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    assert "mujoco: not installed; pip install 'mujoco>=3.13'" in error
    assert list(tmp_path.iterdir()) == []

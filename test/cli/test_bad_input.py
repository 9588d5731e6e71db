"""Whatever is wrong: the right exit status, one line that names it, nothing half-written."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli.command import Run
from cli.command import refused as check

from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.touches.streams import Streams

pytestmark = pytest.mark.usefixtures('without_page')


def nothing_new(folder: Path, *known: str) -> None:
    assert {path.name for path in folder.iterdir()} == set(known)


CELL_CHANGES = {
    'negative radius': ('radius: 0.05', 'radius: -0.05', 'radius'),
    'unreachable disc': ('center: [0.20, 0.40]', 'center: [2.0, 0.40]', 'disc_2'),
    'unknown key': ('sensor: {', 'sensor: {freme: base, ', 'freme'),
    'parameter missing': ('l1: 0.33, ', '', 'l1'),
    'no YAML': ('robot:', 'robot: [', 'YAML'),
    'no discs': ('objects:', 'objects: []\nothers:', 'cell.yaml'),
    'noise in mN': ('force: 0.3', 'force: 300', 'noise.force: expected 1e-12 to 100 N'),
    'noise in degrees': ('joint: 1.0e-5', 'joint: 0.1', 'noise.joint'),
    'a name without end': ('name: disc_2', f'name: {1000 * "d"}', 'at most 200 characters'),
}
"""Others in `files/test_cell_file.py`."""


@pytest.mark.parametrize('what', CELL_CHANGES)
def test_senseless_cell(run: Run, recordings: Path, tmp_path: Path, what: str) -> None:
    old, new, word = CELL_CHANGES[what]
    text = (recordings / 'cell.yaml').read_text()
    assert old in text
    (tmp_path / 'cell.yaml').write_text(text.replace(old, new, 1))
    for verb in ('calibrate', 'inspect'):
        check(run(verb, recordings / 'good', '--cell', 'cell.yaml'), 2, 'cell.yaml', word)
    nothing_new(tmp_path, 'cell.yaml')


@pytest.mark.parametrize(('content', 'word'), [(None, 'no such file'), (b'\xff\xfe\x00', 'UTF-8'), (b'', 'cell.yaml')])
def test_unreadable_cell(run: Run, recordings: Path, tmp_path: Path, content: bytes | None, word: str) -> None:
    if content is not None:
        (tmp_path / 'cell.yaml').write_bytes(content)
    check(run('calibrate', recordings / 'good', '--cell', 'cell.yaml'), 2, 'cell.yaml', word)
    check(run('simulate', '--out', 'x', '--cell', 'cell.yaml'), 2, 'cell.yaml', word)
    assert not (tmp_path / 'x').exists()


def test_recording_without_the_topics(run: Run, recordings: Path, tmp_path: Path) -> None:
    text = (recordings / 'cell.yaml').read_text()
    (tmp_path / 'topic.yaml').write_text(text.replace('/wrench', '/ft_sensor'))
    (tmp_path / 'kind.yaml').write_text(text.replace('wrench: /wrench', 'wrench: /joint_states'))
    (tmp_path / 'names.yaml').write_text(text.replace('joint1, joint2', 'shoulder, elbow'))
    check(run('calibrate', recordings / 'good', '--cell', 'topic.yaml'), 2, 'good', '/ft_sensor', '/wrench')
    check(run('calibrate', recordings / 'good', '--cell', 'kind.yaml'), 2, '/joint_states')
    check(run('calibrate', recordings / 'good', '--cell', 'names.yaml'), 2, 'shoulder', 'joint1')
    nothing_new(tmp_path, 'topic.yaml', 'kind.yaml', 'names.yaml')


def test_no_recording_at_all(run: Run, tmp_path: Path) -> None:
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'empty.mcap').touch()
    (tmp_path / 'text.bag').write_text('no bag')
    for name in ('missing', 'empty', 'empty.mcap', 'text.bag'):
        check(run('calibrate', name), 2, name)
        check(run('inspect', name), 2, name)
    nothing_new(tmp_path, 'empty', 'empty.mcap', 'text.bag')


@pytest.mark.parametrize('part', [0.0005, 0.5])
def test_truncated_recording(run: Run, recordings: Path, tmp_path: Path, part: float) -> None:
    (source,) = (recordings / 'good').glob('*.mcap')
    content = source.read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(content[: int(part * len(content))])
    result = run('calibrate', 'cut.mcap', '--cell', recordings / 'cell.yaml')
    if part < 0.01:
        check(result, 2, 'cut.mcap')
        nothing_new(tmp_path, 'cut.mcap')
    else:  # what is there is used, and the loss is told
        assert result.status == 0
        assert 'About the recording' in result.out


def test_corrupted_recording(run: Run, recordings: Path, tmp_path: Path) -> None:
    (source,) = (recordings / 'good').glob('*.mcap')
    content = bytearray(source.read_bytes())
    content[64:] = np.random.default_rng(0).integers(0, 256, len(content) - 64, dtype=np.uint8).tobytes()
    (tmp_path / 'noise.mcap').write_bytes(content)
    check(run('calibrate', 'noise.mcap', '--cell', recordings / 'cell.yaml'), 2, 'noise.mcap')


def _changed(recordings: Path, folder: Path, **changes: object) -> Path:
    """The good recording with other joint angles or forces."""
    cell = load_cell(recordings / 'cell.yaml')
    streams = read_streams(recordings / 'good', cell)
    parts = {
        'joints': replace(streams.joints, position=changes.get('position', streams.joints.position)),
        'wrench': replace(streams.wrench, force=changes.get('force', streams.wrench.force)),
    }
    write_streams(folder / 'changed', Streams('changed', **parts), cell)
    return folder / 'changed'


@pytest.fixture
def streams(recordings: Path) -> Streams:
    return read_streams(recordings / 'good', load_cell(recordings / 'cell.yaml'))


def test_nothing_but_nan(run: Run, recordings: Path, tmp_path: Path, streams: Streams) -> None:
    bag = _changed(recordings, tmp_path, position=np.full_like(streams.joints.position, np.nan))
    check(run('calibrate', bag), 2, 'changed', '/joint_states')
    nothing_new(tmp_path, 'changed')


def test_no_contact(run: Run, recordings: Path, tmp_path: Path, streams: Streams) -> None:
    quiet = np.random.default_rng(0).normal(0.5, 0.05, streams.wrench.force.shape)
    bag = _changed(recordings, tmp_path, force=quiet)
    check(run('calibrate', bag), 3, 'changed', 'no contact')
    assert 'no contact' in run('inspect', bag).out
    nothing_new(tmp_path, 'changed')


def test_too_few_touches(run: Run, recordings: Path, tmp_path: Path) -> None:
    check(run('calibrate', recordings / 'few'), 3, 'few: 3 touches', '12 parameters')
    nothing_new(tmp_path)


@pytest.mark.parametrize(('key', 'right', 'wrong'), [('sign', 'on_object', 'on_robot'), ('frame', 'base', 'tool')])
def test_wrong_sensor(run: Run, recordings: Path, tmp_path: Path, key: str, right: str, wrong: str) -> None:
    text = (recordings / 'cell.yaml').read_text()
    (tmp_path / 'cell.yaml').write_text(text.replace(f'{key}: {right}', f'{key}: {wrong}'))
    other = {'sign': 'frame', 'frame': 'sign'}[key]
    result = run('calibrate', recordings / 'good', '--cell', 'cell.yaml')
    check(result, 2, f'cell.yaml: sensor.{key}: the', f'set sensor.{key} to {right}')
    assert f'sensor.{other}' not in result.err


def test_cell_missing_or_contradictory(run: Run, recordings: Path, tmp_path: Path) -> None:
    check(run('calibrate', recordings / 'plain'), 2, 'plain', '--cell')
    check(run('inspect', recordings / 'plain'), 2, 'plain', '--cell')
    assert run('simulate', '--out', 'tool', '--frame', 'tool', '--plan', recordings / 'few.yaml').status == 0
    check(run('calibrate', recordings / 'good', 'tool'), 2, 'tool', '--cell')
    check(run('calibrate', recordings / 'good', recordings / '.' / 'good'), 2, 'twice')


@pytest.mark.parametrize('place', ['taken', 'taken/deeper', '/proc/nowhere', 300 * 'n'])
def test_place_that_cannot_be_written(run: Run, recordings: Path, tmp_path: Path, place: str) -> None:
    (tmp_path / 'taken').write_text('mine')
    result = run('calibrate', recordings / 'good', '--out', place)
    check(result, 2, place, 'cannot be written')
    result = run('simulate', '--out', place, '--plan', recordings / 'few.yaml')
    check(result, 2, place)
    assert (tmp_path / 'taken').read_text() == 'mine'
    nothing_new(tmp_path, 'taken')


def test_a_failed_calibration_leaves_a_former_result(run: Run, recordings: Path, tmp_path: Path) -> None:
    assert run('calibrate', recordings / 'good', '--out', 'result').status == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / 'result').iterdir()}
    assert run('calibrate', recordings / 'few', '--out', 'result').status == 3
    assert {path.name: path.read_bytes() for path in (tmp_path / 'result').iterdir()} == before


def test_simulate_never_overwrites(run: Run, recordings: Path, tmp_path: Path) -> None:
    shutil.copytree(recordings / 'few', tmp_path / 'few')
    before = sorted(path.name for path in (tmp_path / 'few').iterdir())
    check(run('simulate', '--out', 'few', '--plan', recordings / 'few.yaml'), 2, 'few', 'exists')
    assert sorted(path.name for path in (tmp_path / 'few').iterdir()) == before


@pytest.mark.parametrize(
    ('option', 'text', 'word'),
    [
        ('--plan', '- {disc: disc_9, angle_deg: 0, posture: left, force: 10}', 'disc_9'),
        ('--plan', '- {disc: disc_1, angle_deg: 0, posture: up, force: 10}', 'posture'),
        ('--plan', '- {disc: disc_1, angle_deg: 0, posture: left, force: -10}', 'force'),
        ('--plan', 'disc_1', 'list'),
        ('--truth', 'l1: 0.3', 'missing'),
        ('--truth', '[1, 2]', 'expected a mapping'),
        ('--truth', 'x0: 0\nl9: 3', 'l9'),
        ('--truth', ': :', 'YAML'),
    ],
)
def test_senseless_plan_or_truth(run: Run, tmp_path: Path, option: str, text: str, word: str) -> None:
    (tmp_path / 'file.yaml').write_text(text)
    check(run('simulate', '--out', 'x', option, 'file.yaml'), 2, 'file.yaml', word)
    check(run('simulate', '--out', 'x', option, 'nowhere.yaml'), 2, 'nowhere.yaml')
    nothing_new(tmp_path, 'file.yaml')


@pytest.mark.parametrize(
    ('arguments', 'word'),
    [
        ((), 'VERB'),
        (('fly',), 'fly'),
        (('calibrate',), 'BAG'),
        (('calibrate', 'a', '--speed'), '--speed'),
        (('calibrate', 'a', '--fix', 'l3'), 'l3'),
        (('calibrate', 'a', '--fix', 'l1=long'), 'l1'),
        (('calibrate', 'a', '--fix', 'l1=nan'), 'l1'),
        (('calibrate', 'a', '--fix', 'l1=330'), '--fix l1=330: expected at most 100 m'),
        (('calibrate', 'a', '--fix', 'l1=330'), 'lengths are in m, not mm'),
        (('calibrate', 'a', '--fix', 'g1=16'), 'angles are in rad, not degrees'),
        (('calibrate', 'a', '--fix', 'p1=10'), '--fix p1=10: expected at most 1 rad/Nm'),
        (('--bogus',), '--bogus'),
        (('calibrat', 'a'), "did you mean 'calibrate'?"),
        (('simulate',), '--out'),
        (('simulate', '--out', 'x', '--seed', '-1'), '--seed'),
        (('simulate', '--out', 'x', '--levels', '0'), '--levels'),
        (('simulate', '--out', 'x', '--per-disc', '2.5'), '--per-disc'),
        (('simulate', '--out', 'x', '--noise-force', 'inf'), '--noise-force'),
        (('simulate', '--out', 'x', '--plan', 'p', '--per-disc', '3'), '--per-disc'),
        (('simulate', '--out', 'x', '--plan', 'p', '--preload', '0.3'), '--preload'),
        (('simulate', '--out', 'x', '--preload', '-0.3'), '--preload'),
        (('simulate', '--out', 'x', '--preload', '30'), 'preload: expected 0 to 5'),
        (('simulate', '--out', 'x', '--frame', 'world'), '--frame'),
    ],
)
def test_wrong_command_line(run: Run, tmp_path: Path, arguments: tuple[str, ...], word: str) -> None:
    check(run(*arguments), 2, word)
    nothing_new(tmp_path)

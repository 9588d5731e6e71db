"""Whatever is wrong: the right exit status, one line that names it, nothing half-written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli.command import refused as check

from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.files.cell_file import load_cell

pytestmark = pytest.mark.usefixtures('without_page', 'undiagnosed')


def nothing_new(folder: Path, *known: str) -> None:
    assert {path.name for path in folder.iterdir()} == set(known)


@pytest.mark.parametrize(
    ('old', 'new', 'word'),
    [
        ('radius: 0.05', 'radius: -0.05', 'radius'),
        ('robot:', 'robot: [', 'YAML'),
        ('sign: on_object', 'sign: on_robot', 'cell.yaml: sensor.sign: the'),
    ],
)
def test_a_wrong_cell(run, recordings, tmp_path, old, new, word):
    """Others in `files/test_cell_file.py` and `assessment/test_mistakes.py`."""
    text = (recordings / 'cell.yaml').read_text()
    (tmp_path / 'cell.yaml').write_text(text.replace(old, new, 1))
    check(run('calibrate', recordings / 'good', '--cell', 'cell.yaml'), 2, 'cell.yaml', word)
    if new != 'sign: on_robot':
        check(run('inspect', recordings / 'good', '--cell', 'cell.yaml'), 2, 'cell.yaml', word)
        check(run('simulate', '--out', 'x', '--cell', 'cell.yaml'), 2, 'cell.yaml', word)
    nothing_new(tmp_path, 'cell.yaml')


def test_no_recording_at_all(run, tmp_path):
    """Others in `bags/test_problems.py`."""
    for verb in ('calibrate', 'inspect'):
        check(run(verb, 'missing'), 2, 'missing')
    nothing_new(tmp_path)


def test_what_is_left_of_a_recording_is_used_and_the_loss_is_said(run, recordings, tmp_path):
    (source,) = (recordings / 'good').glob('*.mcap')
    content = source.read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(content[: len(content) // 2])
    result = run('calibrate', 'cut.mcap', '--cell', recordings / 'cell.yaml')
    assert result.status == 0
    assert 'About the recording' in result.out


def test_no_contact(run, recordings, tmp_path):
    cell = load_cell(recordings / 'cell.yaml')
    streams = read_streams(recordings / 'good', cell)
    quiet = np.random.default_rng(0).normal(0.5, 0.05, streams.wrench.force.shape)
    write_streams(tmp_path / 'quiet', replace(streams, wrench=replace(streams.wrench, force=quiet)), cell)
    check(run('calibrate', 'quiet'), 3, 'quiet', 'no contact')
    assert 'no contact' in run('inspect', 'quiet').out
    nothing_new(tmp_path, 'quiet')


def test_too_few_touches(run, recordings, tmp_path):
    check(run('calibrate', recordings / 'few'), 3, 'few: 3 touches', '12 parameters')
    nothing_new(tmp_path)


def test_cell_missing_or_contradictory(run, recordings, tmp_path):
    check(run('calibrate', recordings / 'plain'), 2, 'plain', '--cell')
    check(run('inspect', recordings / 'plain'), 2, 'plain', '--cell')
    Path('tool.yaml').write_text((recordings / 'cell.yaml').read_text().replace('frame: base', 'frame: tool'))
    assert run('simulate', '--out', 'tool', '--cell', 'tool.yaml', '--plan', recordings / 'few.yaml').status == 0
    check(run('calibrate', recordings / 'good', 'tool'), 2, 'tool', '--cell')
    check(run('calibrate', recordings / 'good', recordings / '.' / 'good'), 2, 'twice')


@pytest.mark.parametrize('place', ['taken', '/proc/nowhere'])
def test_place_that_cannot_be_written(run, recordings, tmp_path, place):
    (tmp_path / 'taken').write_text('mine')
    check(run('calibrate', recordings / 'good', '--out', place), 2, place, 'cannot be written')
    check(run('simulate', '--out', place, '--plan', recordings / 'few.yaml'), 2, place)
    assert (tmp_path / 'taken').read_text() == 'mine'
    nothing_new(tmp_path, 'taken')


@pytest.mark.parametrize(
    ('arguments', 'word'),
    [
        ((), 'VERB'),
        (('fly',), 'fly'),
        (('calibrate', 'a', '--fix', 'l3'), 'l3'),
        (('simulate', '--out', 'x', '--levels', '0'), '--levels'),
        (('simulate', '--out', 'x', '--per-disc', '2.5'), '--per-disc'),
        (('simulate', '--out', 'x', '--noise-force', 'inf'), '--noise-force'),
        (('simulate', '--out', 'x', '--plan', 'p', '--per-disc', '3'), '--per-disc'),
        (('simulate', '--out', 'x', '--plan', 'p', '--preload', '0.3'), '--preload'),
        (('simulate', '--out', 'x', '--preload', '30'), 'preload: expected 0 to 5'),
        (('simulate', '--out', 'x', '--plan', 'nowhere.yaml'), 'nowhere.yaml'),
        (('simulate', '--out', 'x', '--truth', 'nowhere.yaml'), 'nowhere.yaml'),
    ],
)
def test_wrong_command_line(run, tmp_path, arguments, word):
    check(run(*arguments), 2, word)
    nothing_new(tmp_path)

"""The command as a whole: help, versions, interruptions, errors nobody foresaw."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from scara_kinetostatic import __version__
from scara_kinetostatic.cli import simulate
from scara_kinetostatic.cli.main import VERBS, main

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, '-m', 'scara_kinetostatic.cli.main']
ENVIRONMENT = {**os.environ, 'PYTHONPATH': str(ROOT)}


VERB_NAMES = tuple(verb.replace('_', '-') for verbs in VERBS.values() for verb in verbs)


@pytest.mark.parametrize('verb', VERB_NAMES)
def test_help_teaches(run, verb):
    result = run(verb, '--help')
    assert (result.status, result.err) == (0, '')
    assert f'scara-kinetostatic {verb}' in result.out
    for word in ('usage:', '--out' if verb != 'inspect' else 'BAG'):
        assert word in result.out, f'{verb}: its help has no {word}; a verb that writes nothing is an exception here'


def test_help_of_the_command(run):
    result = run('--help')
    assert result.status == 0
    for word in (*VERB_NAMES, 'exit status', '2  the command or an input is wrong', '3  the data cannot'):
        assert word in result.out
    assert run('--version').out == f'scara-kinetostatic {__version__}\n'


def test_help_is_quick_and_loads_little():
    code = (
        'import sys; from scara_kinetostatic.cli.main import main; main(["--help"])\n'
        "heavy = ('scipy', 'matplotlib', 'rosbags', 'mcap', 'rclpy', 'rich', 'jinja2')\n"
        'sys.exit(10 if any(name in sys.modules for name in heavy) else 0)'
    )
    assert subprocess.run([sys.executable, '-c', code], cwd=ROOT, capture_output=True, check=False).returncode == 0


def test_an_error_nobody_foresaw_is_one_line(run, monkeypatch):
    def fails(args: object) -> int:
        raise ZeroDivisionError('by\nzero')

    monkeypatch.setattr(simulate, 'run', fails)
    result = run('simulate', '--out', 'x')
    assert result.status == 1
    assert result.err.count('\n') == 1
    assert 'internal error, ZeroDivisionError: by zero' in result.err
    assert 'Traceback' in run('--debug', 'simulate', '--out', 'x').err


def test_what_fails_as_it_is_terminated_is_no_bug(run, monkeypatch):
    def ends(_: object) -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            raise ValueError('closed in the middle of a call')

    monkeypatch.setattr(simulate, 'run', ends)
    result = run('simulate', '--out', 'x')
    assert (result.status, result.err) == (143, 'scara-kinetostatic: terminated\n')


def test_interrupted(tmp_path):
    command = [*COMMAND, 'simulate', '--out', 'x', '--per-disc', '400']
    process = subprocess.Popen(command, cwd=tmp_path, env=ENVIRONMENT, stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 30
    while not list(tmp_path.iterdir()) and time.monotonic() < end:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    # Python itself ends by the signal where it struck inside `exec`; a shell sees 130 all the same
    assert process.returncode in (130, -signal.SIGINT)
    assert err.count('\n') == 1
    assert list(tmp_path.iterdir()) == []


def inspected(recordings: Path, stdout: object) -> tuple[int, str]:
    """Status and stderr of a verb that prints there."""
    command = [*COMMAND, 'inspect', str(recordings / 'few')]
    process = subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, env=ENVIRONMENT, check=False, text=True)  # type: ignore[call-overload]
    return process.returncode, process.stderr


def test_a_reader_that_goes_away(recordings):
    read, write = os.pipe()
    os.close(read)
    assert inspected(recordings, write) == (141, '')
    os.close(write)


def test_a_terminal_without_signs(recordings, monkeypatch):
    printed = io.BytesIO()
    monkeypatch.setattr(sys, 'stdout', io.TextIOWrapper(printed, 'ascii'))
    assert main(['inspect', str(recordings / 'few')]) == 0
    assert b'?' in printed.getvalue()


def test_stdout_that_cannot_be_written(recordings):
    with Path('/dev/full').open('w') as full:
        status, said = inspected(recordings, full)
    assert (status, said.count('\n')) == (2, 1)
    assert said.startswith('scara-kinetostatic: stdout cannot be written: ')


def test_closed_streams_stop_nothing(recordings, tmp_path):
    command = [*COMMAND, 'simulate', '--plan', str(recordings / 'few.yaml'), '--out', str(tmp_path / 'bag')]
    process = subprocess.run(['sh', '-c', 'exec "$@" >&- 2>&-', 'sh', *command], env=ENVIRONMENT, check=False)
    assert process.returncode == 0
    assert (tmp_path / 'bag').is_dir()

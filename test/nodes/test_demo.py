from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from time import monotonic, sleep

import pytest
from nodes.waiting import WAIT

from scara_kinetostatic.cli import demo
from scara_kinetostatic.cli.main import build_parser, main
from scara_kinetostatic.errors import CellError, InputError, OutputError
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.nodes.cell_node import PARAMETERS
from scara_kinetostatic.simulation.commanded import DEMO_CELL, ModelBody

MOST = 10
"""Touches after which the runner ends."""


def parse(*arguments: str) -> Namespace:
    return build_parser().parse_args(['demo', *arguments])


def descendants(process: int) -> set[int]:
    found = {int(pid) for pid in Path(f'/proc/{process}/task/{process}/children').read_text().split()}
    return found.union(*map(descendants, found))


def test_the_robot_calibrates_itself(tmp_path, capsys, monkeypatch):
    """It touches by itself until it is told that it is enough, and the truth is found."""
    monkeypatch.setattr(ModelBody, 'tick', 0.008)  # one step for each message
    monkeypatch.setitem(PARAMETERS['touch_runner']['max_touches'], 'default', MOST)
    (tmp_path / 'cell.yaml').write_text(dump_cell(replace(DEMO_CELL, tolerance=1e-4)))
    demo.run(parse('--out', str(tmp_path), '--seed', '3', '--cell', str(tmp_path / 'cell.yaml')))
    printed = capsys.readouterr().out
    end = r'^(\d+) touches \(max_touches\) give an expanded uncertainty of the tip of .+, the tolerance is 100 µm'
    (made,) = re.findall(end, printed, re.MULTILINE)
    assert MOST <= int(made) < MOST + 3
    rows = dict(re.findall(rf'^({"|".join(NAMES)}) .* (-?[0-9.]+)  \S+$', printed, re.MULTILINE))
    assert list(rows) == list(NAMES)
    assert all(abs(float(z)) < 4.5 for z in rows.values()), printed
    touches = [int(number) for number in re.findall(r'^ *(\d+) .* N: ', printed, re.MULTILINE)]
    assert touches == sorted(set(touches)) and touches[-1] == int(made)
    for name in ('recording', 'report'):
        (place,) = re.findall(rf'^{name}: +(.+)$', printed, re.MULTILINE)
        assert Path(place).exists()


def test_a_signal_ends_everything(tmp_path):
    end = monotonic() + WAIT
    command = [sys.executable, '-m', 'scara_kinetostatic.cli.main', 'demo', '--out', str(tmp_path)]
    environment = os.environ | {'PYTHONUNBUFFERED': '1'}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment) as process:
        assert process.stdout is not None
        while b'disc_' not in (line := process.stdout.readline()):
            assert line and monotonic() < end
        others = descendants(process.pid)
        assert others
        process.send_signal(signal.SIGTERM)
        assert process.wait(WAIT) == 143
    while any(Path(f'/proc/{each}').exists() for each in others):
        assert monotonic() < end
        sleep(0.1)
    (state,) = tmp_path.rglob('*.mcap*')
    assert state.stat().st_size > 0


@pytest.mark.parametrize(
    ('arguments', 'error', 'says'),
    [
        (('--time-factor', '1e6'), InputError, 'parameter time_factor'),
        (('--cell', 'cell.yaml'), CellError, r'robot\.limits'),
        (('--out', 'cell.yaml/demo'), OutputError, 'demo'),
    ],
)
def test_what_is_wrong_is_named(tmp_path, monkeypatch, arguments, error, says):
    monkeypatch.chdir(tmp_path)
    Path('cell.yaml').write_text(dump_cell(PAPER_CELL))
    with pytest.raises(error, match=says):
        demo.run(parse('--out', 'here', *arguments))


def test_without_ros_the_remedy_is_told(tmp_path, monkeypatch, capsys):
    for module in [name for name in sys.modules if name.split('.')[0] == 'rclpy' or '.nodes' in name]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, 'rclpy', None)
    assert main(['demo', '--out', str(tmp_path)]) == 2
    assert re.search(r'rclpy: not installed; source .* pip install .*\[ros\]', capsys.readouterr().err)
    assert list(tmp_path.iterdir()) == []

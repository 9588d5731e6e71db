from __future__ import annotations

import re
import signal
import subprocess
import sys
from argparse import Namespace
from pathlib import Path
from time import monotonic

import pytest
from nodes.waiting import WAIT

from scara_kinetostatic.cli import demo
from scara_kinetostatic.cli.main import build_parser
from scara_kinetostatic.errors import InputError, OutputError
from scara_kinetostatic.model.parameters import NAMES


def parse(*arguments: str) -> Namespace:
    return build_parser().parse_args(['demo', *arguments])


def children(process: int) -> set[int]:
    return {int(pid) for pid in Path(f'/proc/{process}/task/{process}/children').read_text().split()}


def test_the_whole_cell_finds_the_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert demo.run(parse('--out', str(tmp_path), '--time-factor', '25')) == 0
    printed = capsys.readouterr().out
    rows = dict(re.findall(rf'^({"|".join(NAMES)}) .* (-?[0-9.]+)  \S+$', printed, re.MULTILINE))
    assert list(rows) == list(NAMES)
    assert all(abs(float(z)) < 4 for z in rows.values()), printed
    for name in ('recording', 'report'):
        (place,) = re.findall(rf'^{name}: +(.+)$', printed, re.MULTILINE)
        assert Path(place).exists()


def test_a_signal_ends_the_nodes_as_well(tmp_path: Path) -> None:
    end = monotonic() + WAIT
    command = [sys.executable, '-m', 'scara_kinetostatic.cli.main', 'demo', '--out', str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        while b'touching' not in (line := process.stdout.readline()):
            assert line and monotonic() < end
        nodes = children(process.pid)
        assert len(nodes) == 3
        process.send_signal(signal.SIGTERM)
        assert process.wait(WAIT) == 143
    assert not any(Path(f'/proc/{node}').exists() for node in nodes)


def test_a_node_that_does_not_start_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'contact_simulator: the node ended with status 2: .*time_factor'):
        demo.run(parse('--out', str(tmp_path), '--time-factor', '1e6'))


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / 'demo').write_text('in the way')
    with pytest.raises(OutputError, match='demo'):
        demo.run(parse('--out', str(tmp_path / 'demo')))


def test_without_ros_the_remedy_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in [name for name in sys.modules if name.split('.')[0] == 'rclpy' or '.nodes' in name]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, 'rclpy', None)
    with pytest.raises(InputError, match=r'pip install .*\[ros\]'):
        demo.run(parse('--out', str(tmp_path)))
    assert list(tmp_path.iterdir()) == []

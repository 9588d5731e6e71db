"""The collector killed at random moments, and on a disk that gets full: reported touches against those in the bag."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic

from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import Trigger

from benchmark.cell_nodes import DemoClient, NodeProcesses
from scara_kinetostatic.bags.reader import embedded_cell, read_streams
from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.nodes.demo import THIS_MACHINE, own_domain
from scara_kinetostatic.touches.detection import find_touches

LONGEST_WAIT = 60.0
"""Longest wait for anything, s."""
LIFE = (0.3, 9.0)
"""Shortest and longest life of a collector, from the start of its process, s."""
LOAD = {'loop': True, 'time_factor': 10.0, 'joint_rate': 200.0, 'wrench_rate': 200.0}
"""The simulator: 2000 messages per second on each topic, some four touches per second."""


def kill_collectors(number: int, folder: Path) -> Iterator[dict[str, object]]:
    """Kills so many collectors by SIGKILL, one after the other, while a simulator publishes.

    Each in a ROS domain of its own: the middleware takes long to forget a process that is killed, and meanwhile others
    are late to hear of each other.

    Yields:
        For each what it had reported and what is there.
    """
    rng = random.Random(number)
    for count in range(number):
        life, output = rng.uniform(*LIFE), folder / f'bags_{count}'
        with (
            own_domain() as domain,
            NodeProcesses(domain, folder / 'logs') as nodes,
            DemoClient(domain, lambda: None) as client,
        ):
            nodes.start('contact_simulator', LOAD)
            pid = nodes.start('collector', {'output': output, 'autostart': True})
            _spin_for(client, life)
            os.kill(pid, signal.SIGKILL)
            _spin_for(client, 0.2)  # what was under way
            yield {'life': round(life, 2), **examine(output, client.touches)}
        shutil.rmtree(output, ignore_errors=True)


def fill_disk(size: int, folder: Path) -> dict[str, object]:
    """Lets a collector record until the disk is full, and then once more when there is room.

    The disk is a file system in memory that only the collector sees.

    Args:
        size: of the disk, bytes.
        folder: for all the rest.

    Returns:
        What the collector had reported, what is there, and what it says.

    Raises:
        OSError: this machine lets nobody mount one.
    """
    disk = folder / 'disk'
    disk.mkdir(parents=True)
    with (
        own_domain() as domain,
        NodeProcesses(domain, folder / 'logs') as simulator,
        DemoClient(domain, simulator.check) as client,
        _on_small_disk(disk, size, domain, folder / 'logs' / 'collector.log') as pid,
    ):
        message: list[str] = []
        client._node.create_subscription(DiagnosticArray, '/diagnostics', lambda array: _note(array, message), 10)
        simulator.start('contact_simulator', LOAD)
        client.wait('the end of the disk', lambda: any('recording failed' in text for text in message), LONGEST_WAIT)
        inside = Path(f'/proc/{pid}/root{disk}')
        shutil.copytree(inside, folder / 'copy')
        result = examine(folder / 'copy', client.touches)
        answer = client.call('/collector/stop', Trigger, Trigger.Request(), LONGEST_WAIT)
        for item in inside.iterdir():
            shutil.rmtree(item)
        again = client.call('/collector/start', Trigger, Trigger.Request(), LONGEST_WAIT)
        return {'size': size, **result, 'said': answer.message, 'records again when there is room': again.success}


def examine(output: Path, reported: int) -> dict[str, object]:
    """Opens whatever a collector left: everything that its metadata state must be there, undamaged.

    Args:
        output: folder of its recordings.
        reported: touches it has reported.
    """
    bags = [bag for bag in output.glob('*') if not bag.name.startswith('.')]
    touches, problems = 0, []
    for bag in bags:
        try:
            if embedded_cell(bag) != PAPER_CELL:
                problems.append('another cell')
            streams = read_streams(bag, PAPER_CELL)
            problems += [text for text in streams.warnings if 'more messages' in text or 'damaged' in text]
            touches += len(find_touches(streams, PAPER_CELL).touches)
        except RecordingError as error:
            if reported or 'has no topic' not in str(error):
                problems.append(str(error))
        except Exception as error:  # whatever a reader stumbles over is a failure
            problems.append(f'{type(error).__name__}: {error}')
    return {
        'reported': reported,
        'there': touches,
        'recordings': len(bags),
        'lost': max(0, reported - touches),
        'problems': problems,
    }


def _spin_for(client: DemoClient, seconds: float) -> None:
    end = monotonic() + seconds
    while (left := end - monotonic()) > 0:
        client._executor.spin_once(timeout_sec=left)


def _note(array: DiagnosticArray, message: list[str]) -> None:
    message.extend(status.message for status in array.status)


@contextmanager
def _on_small_disk(disk: Path, size: int, domain: int, log: Path) -> Iterator[int]:
    """A collector that records to a small file system of its own; gives the process id."""
    mount = f'mount -t tmpfs -o size={size} none "$1"'
    isolate = ['unshare', '--mount'] if os.geteuid() == 0 else ['unshare', '--map-root-user', '--mount']
    if subprocess.run([*isolate, 'sh', '-c', mount, 'sh', str(disk)], check=False).returncode:
        raise OSError('no file system can be mounted here')
    code = 'import sys; from scara_kinetostatic.nodes import executables; sys.exit(executables.collector())'
    collector = 'exec "$2" -c "$3" --ros-args -p autostart:=true -p output:="$1"'
    command = [*isolate, 'sh', '-c', f'{mount} && {collector}', 'sh', str(disk), sys.executable, code]
    environment = os.environ | THIS_MACHINE | {'ROS_DOMAIN_ID': str(domain)}
    with log.open('wb') as stream, subprocess.Popen(command, env=environment, stdout=stream, stderr=stream) as process:
        try:
            yield process.pid
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(LONGEST_WAIT)

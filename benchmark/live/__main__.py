"""The collector under load, both topics at 1 kHz: is anything lost, what does it cost, do the services answer.

    python -m benchmark.live [--seconds 600] [--rate 1000] [--json FILE]

A publisher repeats a simulated cell, the collector records it. Meanwhile every second `~/start` of
the collector is called (which answers that it records already), and every 30 s the calibrator calibrates from what
is there. In the end the bag is read and compared with what was published. Needs ROS 2.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import monotonic

import numpy as np
from std_srvs.srv import Trigger

from benchmark.cell_nodes import DemoClient, NodeProcesses
from benchmark.common import parser, print_and_save
from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.nodes.demo import THIS_MACHINE, own_domain
from scara_kinetostatic.touches.detection import find_touches

LONGEST_WAIT = 60.0
"""Longest wait for an answer, s."""
CALIBRATE_EVERY = 30.0
ASK_EVERY = 1.0


def run(seconds: float, rate: float, folder: Path) -> dict[str, object]:
    """Publishes, records, compares.

    Args:
        seconds: duration.
        rate: messages per second on each topic.
        folder: for the recording.

    Returns:
        The figures by name.
    """
    command = [sys.executable, '-m', 'benchmark.live.publisher', '--seconds', str(seconds), '--rate', str(rate)]
    with own_domain() as domain, NodeProcesses(domain, folder / 'logs') as nodes:
        environment = os.environ | THIS_MACHINE | {'ROS_DOMAIN_ID': str(domain)}
        collector = nodes.start('collector', {'output': folder / 'bags', 'autostart': True})
        nodes.start('calibrator', {'output': folder / 'results'})
        with (
            DemoClient(domain, nodes.check) as client,
            subprocess.Popen(
                command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            ) as publisher,
        ):
            assert publisher.stdin is not None
            assert publisher.stdout is not None
            client.wait('the collector', lambda: bool(client.recording), LONGEST_WAIT)
            assert publisher.stdout.readline() == 'ready\n'
            publisher.stdin.write('go\n')
            publisher.stdin.flush()
            figures = _ask(client, seconds, collector)
            published, largest_delay = publisher.stdout.readline().split()
            stopped = client.call('/collector/stop', Trigger, Trigger.Request(), LONGEST_WAIT)
            publisher.stdin.write('end\n')
        figures |= {
            'published of each topic': int(published),
            'largest delay of the publisher [s]': float(largest_delay),
        }
        return figures | _compare(Path(client.recording), int(published)) | {'collector says': stopped.message}


def _ask(client: DemoClient, seconds: float, collector: int) -> dict[str, object]:
    """Calls the services meanwhile, and measures."""
    for service in ('/collector/start', '/calibrator/calibrate'):
        client.call(service, Trigger, Trigger.Request(), LONGEST_WAIT)
    begun, used = monotonic(), _cpu(collector)
    asked, calibrated = begun, begun
    answers: list[float] = []
    calibrations: list[tuple[bool, float]] = []
    while (now := monotonic()) < begun + seconds - 2 * ASK_EVERY:
        if now - calibrated > CALIBRATE_EVERY:
            answer = client.call('/calibrator/calibrate', Trigger, Trigger.Request(), LONGEST_WAIT)
            calibrations.append((answer.success, monotonic() - now))
            calibrated = now
        elif now - asked > ASK_EVERY:
            client.call('/collector/start', Trigger, Trigger.Request(), LONGEST_WAIT)
            answers.append(monotonic() - now)
            asked = now
        else:
            client._executor.spin_once(timeout_sec=0.1)
    return {
        'CPU of the collector [% of one core]': round(100 * (_cpu(collector) - used) / (monotonic() - begun), 1),
        'memory of the collector [MiB]': _memory(collector),
        'answers of ~/start': len(answers),
        'median answer [s]': round(float(np.median(answers)), 4),
        'slowest answer [s]': round(max(answers), 4),
        'calibrations meanwhile': len(calibrations),
        'of them successful': sum(success for success, _ in calibrations),
        'slowest calibration [s]': round(max((time for _, time in calibrations), default=0.0), 2),
    }


def _compare(bag: Path, published: int) -> dict[str, object]:
    """Whether every message that was published stands in the bag, once."""
    streams = read_streams(bag, PAPER_CELL)
    found = {'joint states': streams.joints.stamp, 'wrenches': streams.wrench.stamp}
    return {
        **{f'lost {name}': published - len(np.unique(stamp)) for name, stamp in found.items()},
        'touches in the bag': find_touches(streams, PAPER_CELL).found,
        'warnings': list(streams.warnings),
    }


def _cpu(process: int) -> float:
    """Time that a process has used, s."""
    fields = Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def _memory(process: int) -> int:
    """Largest memory a process has used, MiB."""
    status = Path(f'/proc/{process}/status').read_text().split('\n')
    return next(int(line.split()[1]) // 1024 for line in status if line.startswith('VmHWM'))


def main() -> int:
    """Run, print, save."""
    options_of = parser(__doc__)
    options_of.add_argument('--seconds', type=float, default=600.0)
    options_of.add_argument('--rate', type=float, default=1000.0)
    options = options_of.parse_args()
    with tempfile.TemporaryDirectory(prefix='live_') as folder:
        figures = run(options.seconds, options.rate, Path(folder))
    print_and_save(options.json, figures)
    return 1 if figures['lost joint states'] or figures['lost wrenches'] else 0


if __name__ == '__main__':
    sys.exit(main())

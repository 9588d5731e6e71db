"""What goes wrong while `touch_runner` moves the simulated robot, over ROS: nodes in processes of their own.

    python -m benchmark.runner_faults [--only FAULT:PHASE ...] [--json FILE]

Each fault of the simulator, a second publisher of `joint_trajectory` and `kill -9` of the runner, while it travels,
approaches and presses. Reported, by simulated time: until the robot stands or has turned back (where its joints are
silent or do not obey: until it is told to stop), until `~/state` says why, the largest force on it afterwards, and
whether the recording has all touches that were counted.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from benchmark.cell_nodes import DemoClient, NodeProcesses
from benchmark.common import parser, print_and_save
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.nodes.demo import own_domain
from scara_kinetostatic.nodes.streams import LATCHED
from scara_kinetostatic.pipeline import gather_touches
from scara_kinetostatic.simulation.commanded import DEMO_CELL, Malfunction

CELL = replace(DEMO_CELL, lift=None, tolerance=None, hold={'joint4': 0.0})
PHASES = ('travel', 'approach', 'press')
KILL, SECOND = 'kill', 'second_publisher'
FAULTS = (
    *(fault.value for fault in Malfunction if fault not in (Malfunction.NONE, Malfunction.LIFT_STUCK)),
    SECOND,
    KILL,
)
BY_COMMAND = (Malfunction.SILENT_JOINTS.value, Malfunction.MOVED.value)
STANDS = 2e-3
"""A joint that turns more slowly stands, rad/s."""


class Cell:
    """The nodes, and what they say: joint states (s, rad), forces (s, N), states (s, phase, sentence, accepted) and
    commands to stop (s).
    """

    def __init__(self, folder: Path, nodes: NodeProcesses, client: DemoClient) -> None:
        self.client, self._nodes = client, nodes
        path = folder / 'cell.yaml'
        path.write_text(dump_cell(CELL), encoding='utf-8')
        rates = {'joint_rate': 250.0, 'wrench_rate': 250.0}
        nodes.start('contact_simulator', {'cell': path, 'commanded': True, 'publish_clock': True, **rates})
        own = {'cell': path, 'output': folder / 'out', 'autostart': True, 'use_sim_time': True}
        self.runner = nodes.start('touch_runner', own)
        self.joints: list[tuple[float, list[float]]] = []
        self.forces: list[tuple[float, float]] = []
        self.states: list[tuple[float, str, str, int]] = []
        self.stops: list[float] = []
        node = client._node
        node.create_subscription(JointTrajectory, '/joint_trajectory', self._commanded, 1000)
        node.create_subscription(JointState, '/joint_states', self._joints, 1000)
        node.create_subscription(WrenchStamped, '/wrench', self._force, 1000)
        node.create_subscription(DiagnosticArray, '/touch_runner/state', self._state, LATCHED)

    @staticmethod
    def _time(message: Any) -> float:
        return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)

    def _commanded(self, message: JointTrajectory) -> None:
        if len(message.points) == 1:
            self.stops.append(self.now)

    def _joints(self, message: JointState) -> None:
        self.joints.append((self._time(message), list(message.position)[:2]))

    def _force(self, message: WrenchStamped) -> None:
        self.forces.append((self._time(message), float(np.hypot(message.wrench.force.x, message.wrench.force.y))))

    def _state(self, message: DiagnosticArray) -> None:
        (status,) = message.status
        values = {item.key: item.value for item in status.values}
        self.states.append((self._time(message), values['phase'], status.message, int(values.get('accepted') or 0)))

    @property
    def now(self) -> float:
        """Simulated time, s."""
        return max(self.joints[-1][0] if self.joints else 0.0, self.forces[-1][0] if self.forces else 0.0)

    def wait(self, seconds: float) -> None:
        """Lets simulated time pass."""
        end = self.now + seconds
        self.client.wait('simulated time', lambda: self.now >= end, 300.0)

    def begin(self, fault: str) -> None:
        """Makes it go wrong."""
        if fault == KILL:
            os.kill(self.runner, signal.SIGKILL)
            self._nodes._running.pop('touch_runner').wait()
        elif fault == SECOND:
            self.client._node.create_publisher(JointTrajectory, '/joint_trajectory', 10)
        else:
            request = SetParameters.Request(parameters=[Parameter('fault', value=fault).to_parameter_msg()])
            (result,) = self.client.call('/contact_simulator/set_parameters', SetParameters, request, 60.0).results
            if not result.successful:
                raise ScaraKinetostaticError(result.reason)


def run(fault: str, phase: str) -> dict[str, object]:
    """One fault in one phase."""
    with (
        own_domain() as domain,
        tempfile.TemporaryDirectory() as name,
        NodeProcesses(domain, Path(name) / 'logs') as nodes,
    ):
        folder = Path(name)
        with DemoClient(domain, nodes.check) as client:
            cell = Cell(folder, nodes, client)
            seen = lambda: bool(cell.states) and cell.states[-1][1] == phase and cell.states[-1][3] >= 1  # noqa: E731
            client.wait(phase, lambda: seen() or (bool(cell.states) and cell.states[-1][1] == 'stopped'), 300.0)
            if not seen():
                return {'fault': fault, 'phase': phase, 'failed': f'stopped before: {cell.states[-1][2]}'}
            cell.wait(0.3)
            began, accepted = cell.now, cell.states[-1][3]
            before = [position for time, position in cell.joints if time > began - 0.1]
            heading = np.subtract(before[-1], before[0])
            cell.begin(fault)
            cell.wait(4.0)
            said = [(time, text) for time, at, text, _ in cell.states if at == 'stopped']
            times = np.array([time for time, _ in cell.joints])
            speed = np.diff([position for _, position in cell.joints], axis=0) / np.diff(times)[:, None]
            halted = (np.abs(speed).max(axis=1) < STANDS) | (speed @ heading < 0)
            later = times[1:] >= began
            stands = times[1:][later & halted]
            if fault in BY_COMMAND:
                stands = [time for time in cell.stops if time >= began]
            (bag,) = (folder / 'out').iterdir()
            zero = np.median([force for _, force in cell.forces])
            peak = max((force for time, force in cell.forces if time >= began), default=0.0)
            kept = len(gather_touches([bag], CELL).touches)
    return {
        'fault': fault,
        'phase': phase,
        'stands_s': float(stands[0] - began) if len(stands) else None,
        'said_s': float(said[0][0] - began) if said else None,
        'says': said[0][1] if said else None,
        'peak_N': float(peak - zero),
        'counted': accepted,
        'recorded': kept,
    }


def main() -> int:
    """Runs the faults."""
    options_of = parser(__doc__)
    options_of.add_argument('--only', nargs='+', metavar='FAULT:PHASE', default=None)
    options = options_of.parse_args()
    cases = [(fault, phase) for fault in FAULTS for phase in PHASES]
    if options.only:
        cases = [tuple(text.split(':', 1)) for text in options.only]
    rows = []
    for fault, phase in cases:
        try:
            row = run(fault, phase)
        except ScaraKinetostaticError as error:
            row = {'fault': fault, 'phase': phase, 'failed': str(error)}
        print(row, flush=True)
        rows.append(row)
    print_and_save(options.json, {'rows': rows})
    done = [row for row in rows if 'failed' not in row]
    good = len(done) == len(rows) and all(row['recorded'] >= row['counted'] for row in done)
    return 0 if good and all(row['said_s'] is not None or row['fault'] == KILL for row in done) else 1


if __name__ == '__main__':
    sys.exit(main())

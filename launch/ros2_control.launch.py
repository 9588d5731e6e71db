"""The touch runner on a robot that ros2_control moves: `cell.launch.py` with other defaults.

`ros2 launch scara_kinetostatic ros2_control.launch.py cell:=/path/to/cell.yaml`; the driver of the robot with its
controllers, as `config/ros2_control.yaml` has them, is started by its own launch file. With `use_action:=true` the
controller gets goals, as few as safety needs, instead of messages. `ros2 service call /touch_runner/start
std_srvs/srv/Trigger` begins.
"""

from __future__ import annotations

import runpy
from pathlib import Path

from launch import LaunchDescription

ONE = runpy.run_path(str(Path(__file__).with_name('cell.launch.py')))
OTHERS = dict.fromkeys(('simulate', 'record', 'calibrate', 'show'), 'false')


def generate_launch_description() -> LaunchDescription:
    """The runner alone, and its controller."""
    description: LaunchDescription = ONE['cell_description'](
        cell=None, run='true', controller='/joint_trajectory_controller', **OTHERS
    )
    return description

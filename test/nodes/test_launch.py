"""The launch file, with stand-ins for `launch`, which is not on PyPI."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

FILE = Path(__file__).parents[2] / 'launch' / 'cell.launch.py'
MODULES = {
    'launch': ('LaunchContext', 'LaunchDescription'),
    'launch.actions': ('DeclareLaunchArgument', 'OpaqueFunction'),
    'launch.conditions': ('IfCondition',),
    'launch.substitutions': ('LaunchConfiguration', 'PathJoinSubstitution'),
    'launch_ros': (),
    'launch_ros.actions': ('Node',),
    'launch_ros.parameter_descriptions': ('ParameterValue',),
    'launch_ros.substitutions': ('FindPackageShare',),
}


class StandIn:
    """Keeps what it was made with."""

    def __init__(self, *args: Any, **given: Any) -> None:
        self.args, self.given = args, given

    def perform(self, context: dict[str, str]) -> str:
        return context[self.args[0]]


@pytest.fixture
def launch_file(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    for name, classes in MODULES.items():
        module = ModuleType(name)
        vars(module).update({each: type(each, (StandIn,), {}) for each in classes})
        monkeypatch.setitem(sys.modules, name, module)
    return runpy.run_path(str(FILE))


def test_a_real_robot_needs_its_cell_description(launch_file: dict[str, Any]) -> None:
    (actions,) = launch_file['generate_launch_description']().args
    (check,) = (action.given['function'] for action in actions if 'function' in action.given)
    for simulate, cell in (('true', ''), ('true', 'cell.yaml'), ('false', 'cell.yaml')):
        assert not check({'simulate': simulate, 'cell': cell})
    with pytest.raises(RuntimeError, match='simulate:=false needs the cell description'):
        check({'simulate': 'false', 'cell': ' '})

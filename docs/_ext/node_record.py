"""What each node declares when it starts, as JSON: parameters, topics, services. Needs no ROS.

    PYTHONPATH=. python docs/_ext/node_record.py

The nodes are created as ever, but `rclpy` and the message packages are replaced by recording stand-ins.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

REPLACED = (
    'rclpy', 'rcl_interfaces', 'action_msgs', 'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'rosgraph_msgs',
    'sensor_msgs', 'std_msgs', 'std_srvs', 'nav_msgs', 'trajectory_msgs', 'visualization_msgs', 'tf2_msgs',
    'ament_index_python', 'launch', 'launch_ros',
)  # fmt: skip
NODES = {
    'contact_simulator': 'ContactSimulator',
    'collector': 'Collector',
    'calibrator': 'Calibrator',
    'visualizer': 'Visualizer',
    'monitor': 'Monitor',
    'compensator': 'Compensator',
    'contour_tracker': 'ContourTracker',
    'touch_runner': 'TouchRunner',
}


SWITCHED_ON = ('publish_urdf',)
"""Parameters by which a node has an interface more, which is listed, too."""


class _Open(type):
    """A class of which every attribute exists."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith('__'):
            raise AttributeError(name)
        made = _Open(name, (StandIn,), {'__module__': f'{cls.__module__}.{cls.__name__}'})
        setattr(cls, name, made)
        return made


class StandIn(metaclass=_Open):
    """An object that takes any arguments and has any attribute."""

    def __init__(self, *args: Any, **given: Any) -> None:
        self.__dict__.update(given)

    def __getattr__(self, name: str) -> Any:
        if name.startswith('__'):
            raise AttributeError(name)
        return StandIn()

    def __call__(self, *args: Any, **given: Any) -> StandIn:
        return StandIn()


class Finder:
    """Finds a stand-in for every module of the replaced packages."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        """The specification of a stand-in, None for other modules."""
        return ModuleSpec(name, Finder(), is_package=True) if name.split('.')[0] in REPLACED else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """The module: every name in it is a class."""
        module = ModuleType(spec.name)
        made: dict[str, Any] = {}

        def attribute(name: str) -> Any:
            if name.startswith('__'):
                raise AttributeError(name)
            return made.setdefault(name, _Open(name, (StandIn,), {'__module__': spec.name}))

        module.__getattr__ = attribute  # type: ignore[method-assign]
        return module

    def exec_module(self, module: ModuleType) -> None:
        """The node's base class records what is declared."""
        if module.__name__ == 'rclpy.node':
            module.Node = Recorder  # type: ignore[attr-defined]


class Recorder(StandIn):
    """In the place of `rclpy.node.Node`."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.parameters: dict[str, dict[str, Any]] = {}
        self.interfaces: list[dict[str, str]] = []
        self._parameter_overrides: dict[str, Any] = {}
        self._values: dict[str, Any] = {}

    def declare_parameter(self, name: str, value: Any, descriptor: Any) -> StandIn:
        """Records a parameter and gives its default value."""
        given = descriptor.__dict__
        ranges = given.get('floating_point_range') or given.get('integer_range')
        result = isinstance(value, type)  # declared by type alone
        self.parameters[name] = {
            'default': None if result else value,
            'description': given.get('description', ''),
            'read_only': bool(given.get('read_only', False)),
            'range': [ranges[0].from_value, ranges[0].to_value] if ranges else None,
            'result': result,
        }
        self._values[name] = None if result else True if name in SWITCHED_ON else value
        return StandIn(value=value)

    def get_name(self) -> str:
        """The node's name."""
        return self.name

    def has_parameter(self, name: str) -> bool:
        """Whether it is declared and has a value."""
        return self._values.get(name) is not None

    def get_parameter(self, name: str) -> StandIn:
        """The default value."""
        return StandIn(value=self._values[name])

    def create_publisher(self, kind: type, topic: str, *_: Any, **__: Any) -> StandIn:
        """Records a topic."""
        return self._interface('publishes', kind, topic)

    def create_subscription(self, kind: type, topic: str, *_: Any, **__: Any) -> StandIn:
        """Records a topic."""
        return self._interface('subscribes', kind, topic)

    def create_client(self, kind: type, name: str, *_: Any, **__: Any) -> StandIn:
        """Records a service."""
        return self._interface('calls', kind, name)

    def create_service(self, kind: type, name: str, *_: Any, **__: Any) -> StandIn:
        """Records a service."""
        return self._interface('service', kind, name)

    def _interface(self, role: str, kind: type, name: str) -> StandIn:
        full = f'{kind.__module__.replace(".", "/")}/{kind.__name__}'
        self.interfaces.append({'role': role, 'name': name, 'type': full})
        return StandIn()


def record() -> dict[str, Any]:
    """What each node declares."""
    sys.meta_path.insert(0, Finder())  # type: ignore[arg-type]
    found = {}
    for name, kind in NODES.items():
        module = import_module(f'scara_kinetostatic.nodes.{name}')
        node = getattr(module, kind)()
        for full in getattr(module, '_RESULT', ()):  # there only once there is a result
            node._declare_result(full)
        found[name] = {
            'doc': (module.__doc__ or '').strip(),
            'parameters': node.parameters,
            'interfaces': node.interfaces,
        }
    return found


if __name__ == '__main__':
    json.dump(record(), sys.stdout, indent=1)

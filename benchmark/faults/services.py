"""Nodes under calls and parameters made to hurt: every call is answered, and no node ends.

    python -m benchmark.faults.services [--calls 100] [--values 33] [--nodes NAME...] [--json FILE]

Each node runs in a process of its own. So many calls of each of its services are sent at once, by one client, and so
many again by ten; all have to be answered within 12 s. Then values of 30 kinds are given to each of its parameters,
and its services are called after each. Exit status 1 if a call is not answered or a node ends. Needs ROS 2.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import ListParameters, SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from benchmark.cell_nodes import NodeProcesses
from benchmark.common import CELL, parser, save
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.nodes.demo import own_domain

NODES = (
    'calibrator',
    'collector',
    'compensator',
    'contact_simulator',
    'contour_tracker',
    'monitor',
    'touch_runner',
    'visualizer',
)
SECONDS = 12.0
START_UP = 40.0


def _value(**field: Any) -> ParameterValue:
    kinds = {
        'bool_value': ParameterType.PARAMETER_BOOL,
        'integer_value': ParameterType.PARAMETER_INTEGER,
        'double_value': ParameterType.PARAMETER_DOUBLE,
        'string_value': ParameterType.PARAMETER_STRING,
        'string_array_value': ParameterType.PARAMETER_STRING_ARRAY,
        'byte_array_value': ParameterType.PARAMETER_BYTE_ARRAY,
    }
    return ParameterValue(type=kinds[next(iter(field))], **field)


TEXTS = (
    '', 'x' * 300, 'x' * 100_000, '/' * 5000 + 'proc', '/proc/self/mem', '/dev/full', '/dev/null/a', '/usr/../proc/1',
    '~nobody_there', 'a\x00b', 'a\nb', '\u202e', '../' * 200 + 'proc/x', '$(touch canary)', '{}', '//proc/share',
    '/proc', '%s%n', '\U0001f600' * 80, '-',
)  # fmt: skip
"""Twenty kinds of texts."""
VALUES = (
    *(_value(string_value=text) for text in TEXTS),
    *(_value(double_value=value) for value in (float('nan'), float('inf'), -1.0, 0.0, 1e308)),
    *(_value(integer_value=value) for value in (-(2**63), 2**63 - 1)),
    _value(bool_value=True),
    *(_value(string_array_value=list(texts)) for texts in ((), TEXTS[:9], ['a'] * 10_000)),
    _value(byte_array_value=[b'\xff'] * 100),
    ParameterValue(),
)


def _type(name: str) -> Any:
    package, _, kind = name.split('/')
    return getattr(import_module(f'{package}.srv'), kind)


def _is_own(service: str, node: str) -> bool:
    """Whether a service is one of the node; that of type descriptions is made by `rcl`, which keeps ten calls."""
    return service.startswith(f'/{node}/') and not service.endswith('/get_type_description')


class Caller:
    """A node that calls services.

    Args:
        domain: of ROS.
    """

    def __init__(self, domain: int) -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node('caller', context=self._context, start_parameter_services=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._clients: dict[str, Any] = {}

    def close(self) -> None:
        """Ends the node."""
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def spin(self, until: Callable[[], object], seconds: float) -> bool:
        """Spins until something is true; whether it came true in time."""
        end = time.monotonic() + seconds
        while not until():
            if time.monotonic() > end:
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True

    def services(self, name: str) -> dict[str, Any]:
        """The services of a node and their types."""
        found = self.node.get_service_names_and_types()
        return {service: _type(types[0]) for service, types in found if _is_own(service, name)}

    def flood(self, service: str, kind: Any, calls: int, clients: int) -> tuple[int, float]:
        """Calls a service many times at once; how many are answered, and after how many seconds the last."""
        made = [self.node.create_client(kind, service, qos_profile=QoSProfile(depth=1000)) for _ in range(clients)]
        for client in made:
            client.wait_for_service(timeout_sec=START_UP)
        self.spin(lambda: False, 1.0)  # until the node has met the clients, too
        began = time.monotonic()
        futures = [made[number % clients].call_async(kind.Request()) for number in range(calls)]
        self.spin(lambda: all(future.done() for future in futures), SECONDS)
        answered, seconds = sum(future.done() for future in futures), time.monotonic() - began
        for client in made:
            self.node.destroy_client(client)
        return answered, seconds

    def call(self, service: str, kind: Any, request: Any) -> Any:
        """The answer of one call; None where there is none in time. A first call may come before the node knows us."""
        if service not in self._clients:
            client = self._clients[service] = self.node.create_client(kind, service)
            client.wait_for_service(timeout_sec=START_UP)
            self.spin(lambda: False, 0.5)
        futures = [self._clients[service].call_async(request)]
        for _ in range(2):
            if self.spin(lambda: any(future.done() for future in futures), SECONDS):
                return next(future.result() for future in futures if future.done())
            futures.append(self._clients[service].call_async(request))
        return None


def flooded(caller: Caller, name: str, calls: int) -> Iterable[dict[str, Any]]:
    """The floods of each service of a node."""
    for service, kind in sorted(caller.services(name).items()):
        for clients in (1, min(10, calls)):
            answered, seconds = caller.flood(service, kind, calls, clients)
            yield {'service': service, 'clients': clients, 'answered': answered, 'seconds': round(seconds, 1)}


def poisoned(caller: Caller, name: str, nodes: NodeProcesses, values: Sequence[ParameterValue]) -> int:
    """Gives each parameter each value and calls the Trigger services; how many values were given."""
    listed = caller.call(f'/{name}/list_parameters', ListParameters, ListParameters.Request()).result.names
    triggers = [service for service, kind in caller.services(name).items() if kind is Trigger]
    own = [parameter for parameter in listed if '.' not in parameter]
    for value in values:
        for parameter in own:
            request = SetParameters.Request(parameters=[Parameter(name=parameter, value=value)])
            if caller.call(f'/{name}/set_parameters', SetParameters, request) is None:
                raise RuntimeError(f'{name}: no answer on setting {parameter}')
        for service in triggers:
            if caller.call(service, Trigger, Trigger.Request()) is None:
                raise RuntimeError(f'{service}: no answer after {value.string_value[:40]!r}')
        nodes.check()
    return len(values) * len(own)


def main() -> int:
    """Runs the nodes one by one."""
    options_of = parser(__doc__)
    options_of.add_argument('--calls', type=int, default=100)
    options_of.add_argument('--nodes', nargs='*', default=NODES, metavar='NAME')
    options_of.add_argument('--values', type=int, default=len(VALUES), help='so many of the kinds of values')
    options = options_of.parse_args()
    here, records = Path.cwd(), list[dict[str, Any]]()
    for name in options.nodes:
        with tempfile.TemporaryDirectory(prefix='services_') as text, own_domain() as domain:
            folder = Path(text)
            os.chdir(folder)  # for relative paths among the values
            (folder / 'cell.yaml').write_text(dump_cell(CELL))
            with NodeProcesses(domain, folder / 'logs') as nodes:
                nodes.start(name, {} if name in ('calibrator', 'monitor') else {'cell': folder / 'cell.yaml'})
                caller = Caller(domain)
                try:
                    caller.spin(partial(caller.services, name), START_UP)
                    caller.spin(lambda: False, 2.0)
                    for record in flooded(caller, name, options.calls):
                        records.append(record)
                        print(record, flush=True)
                    nodes.check()
                    given = poisoned(caller, name, nodes, VALUES[: options.values])
                    print(f'{name}: {given} values given, the node runs', flush=True)
                finally:
                    caller.close()
    lost = sum(options.calls - record['answered'] for record in records)
    os.chdir(here)
    print(f'{len(records)} floods of {options.calls} calls: {lost} calls without an answer within {SECONDS:g} s')
    save(options.json, {'floods': records, 'lost': lost})
    return 1 if lost else 0


if __name__ == '__main__':
    sys.exit(main())

"""Nodes on this machine as processes, and a node that watches them and calls their services; for tests, too."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from time import monotonic
from typing import Any

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_msgs.msg import Bool, String, UInt32

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.nodes.demo import THIS_MACHINE, ros_value
from scara_kinetostatic.nodes.streams import LATCHED

START_UP = 120.0
"""Longest wait for the nodes to find each other, s; far more than an idle machine needs."""


class NodeProcesses(AbstractContextManager['NodeProcesses']):
    """Nodes of this package in a ROS domain of their own, this machine only. A context manager.

    Args:
        domain: ROS domain.
        logs: folder for what each node prints, made if need be.
    """

    def __init__(self, domain: int, logs: Path) -> None:
        self._environment = os.environ | THIS_MACHINE | {'ROS_DOMAIN_ID': str(domain), 'PYTHONUNBUFFERED': '1'}
        self._logs = logs
        logs.mkdir(parents=True, exist_ok=True)
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, name: str, parameters: Mapping[str, object], namespace: str = '') -> int:
        """Starts a node.

        Args:
            name: of the node and of its module.
            parameters: ROS parameters by name.
            namespace: of the node, without slashes at its ends.

        Returns:
            Its process id.
        """
        arguments = [part for key, value in parameters.items() for part in ('-p', f'{key}:={ros_value(value)}')]
        code = f'import sys; from scara_kinetostatic.nodes import executables; sys.exit(executables.{name}())'
        command = [sys.executable, '-c', code, '--ros-args', *arguments]
        command += ['-r', f'__ns:=/{namespace}'] if namespace else []
        name = '_'.join(filter(None, (*namespace.split('/'), name)))
        with self.log(name).open('wb') as log:
            process = subprocess.Popen(
                command,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C reaches this process alone, which ends the nodes.
            )
        self._running[name] = process
        return process.pid

    def log(self, name: str) -> Path:
        """Where a node's output goes."""
        return self._logs / f'{name}.log'

    def check(self) -> None:
        """Whether all nodes are still there.

        Raises:
            InputError: one has ended; with the last line it printed.
        """
        for name, process in self._running.items():
            if process.poll() is not None:
                lines = self.log(name).read_text(errors='replace').split('\n')
                last = next((line for line in reversed(lines) if line.strip()), 'no output')
                raise InputError(
                    name, f'the node ended with status {process.returncode}: {last}', f'see {self.log(name)}'
                )

    def stop(self) -> dict[str, int]:
        """Ends all nodes as Ctrl-C does, by SIGKILL those that do not end in time.

        Returns:
            Exit status of each.
        """
        for process in self._running.values():
            process.send_signal(signal.SIGINT)
        for process in self._running.values():
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        statuses = {name: process.returncode for name, process in self._running.items()}
        self._running.clear()
        return statuses


class DemoClient(AbstractContextManager['DemoClient']):
    """A node that watches the cell and calls its services. A context manager.

    From here on this process looks for other nodes on this machine only.

    Args:
        domain: ROS domain of the cell.
        check: raises if a node of the cell is gone; called while waiting.
    """

    def __init__(self, domain: int, check: Callable[[], None]) -> None:
        self._check = check
        os.environ.update(THIS_MACHINE)
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node('demo', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._clients: dict[str, Client] = {}
        self.recording = ''
        self.touches = 0
        self.finished = False
        for kind, topic, name in (
            (String, '/collector/recording', 'recording'),
            (UInt32, '/collector/touches', 'touches'),
            (Bool, '/contact_simulator/finished', 'finished'),
        ):
            self._node.create_subscription(kind, topic, lambda said, name=name: setattr(self, name, said.data), LATCHED)

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def wait(self, what: str, until: Callable[[], bool], timeout: float) -> None:
        """Waits for a condition.

        Raises:
            InputError: it did not come true in time, or a node is gone.
        """
        end = monotonic() + timeout
        while not until():
            self._check()
            if monotonic() > end:
                raise InputError('demo', f'waited {timeout:.0f} s for {what}', 'is the machine overloaded?')
            self._executor.spin_once(timeout_sec=0.01)

    def call(self, service: str, service_type: type, request: Any, timeout: float) -> Any:
        """Calls a service and gives its answer.

        Raises:
            InputError: there was none in time.
        """
        client = self._clients.get(service) or self._meet(service, service_type)
        future: Future = client.call_async(request)
        self.wait(f'an answer of {service}', future.done, timeout)
        return future.result()

    def _meet(self, service: str, service_type: type) -> Client:
        """Makes a client that the service has discovered.

        A service may be discovered before its node has discovered the client; its answer is then lost. Endpoints are
        discovered in the order in which they were made. So another service of the node is called, through a client
        made after this one, until it answers.
        """
        client = self._clients[service] = self._node.create_client(service_type, service)
        self.wait(f'the service {service}', client.service_is_ready, START_UP)
        probe = self._node.create_client(GetParameters, f'{service.rpartition("/")[0]}/get_parameters')
        asked: list[tuple[float, Future]] = []

        def answered() -> bool:
            if probe.service_is_ready() and (not asked or monotonic() > asked[-1][0] + 2.0):
                asked.append((monotonic(), probe.call_async(GetParameters.Request())))
            return any(future.done() for _, future in asked)

        self.wait(f'an answer of the node with {service}', answered, START_UP)
        self._node.destroy_client(probe)
        return client

"""The nodes as processes of their own, for a program that starts and ends a whole cell."""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

from scara_kinetostatic.errors import InputError

SHUTDOWN_TIME = 10.0
"""Longest wait for a node to end after the signal, s."""
THIS_MACHINE = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
"""Environment of nodes that look for others on this machine only."""
DOMAINS = range(1, 100)
"""ROS domains whose ports lie below those that Linux hands out."""


class NodeProcesses:
    """Nodes of this package in a ROS domain of their own, this machine only. A context manager.

    Args:
        domain: ROS domain.
        logs: folder for what each node prints, made if need be.
    """

    def __init__(self, domain: int, logs: Path) -> None:
        self._environment = os.environ | THIS_MACHINE | {'ROS_DOMAIN_ID': str(domain), 'PYTHONUNBUFFERED': '1'}
        self._logs = logs
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> NodeProcesses:
        self._logs.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.stop()

    def start(
        self, name: str, parameters: Mapping[str, object], namespace: str = '', remaps: Mapping[str, str] | None = None
    ) -> int:
        """Starts a node.

        Args:
            name: of the node and of its module.
            parameters: ROS parameters by name.
            namespace: of the node, without slashes at its ends.
            remaps: new names of topics by their names.

        Returns:
            Its process id.
        """
        arguments = [part for key, value in parameters.items() for part in ('-p', f'{key}:={_yaml(value)}')]
        code = f'import sys; from scara_kinetostatic.nodes import executables; sys.exit(executables.{name}())'
        command = [sys.executable, '-c', code, '--ros-args', *arguments]
        rules = {**({'__ns': f'/{namespace}'} if namespace else {}), **(remaps or {})}
        command += [part for old, new in rules.items() for part in ('-r', f'{old}:={new}')]
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
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        try:
            return {name: process.wait(SHUTDOWN_TIME) for name, process in self._running.items()}
        except subprocess.TimeoutExpired:
            return {name: process.returncode for name, process in self._running.items()}
        finally:
            for process in self._running.values():
                if process.poll() is None:
                    process.kill()
                    process.wait()
            self._running.clear()


def free_domain() -> int:
    """A ROS domain that no process on this machine uses, chosen at random."""
    domains = random.sample(DOMAINS, len(DOMAINS))
    return next((domain for domain in domains if _is_free(domain)), domains[0])


def _is_free(domain: int) -> bool:
    """Whether the discovery port of the domain (DDSI-RTPS: 7400 + 250 d) is free."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(('', 7400 + 250 * domain))
        except OSError:
            return False
    return True


def _yaml(value: object) -> str:
    """A value as ROS reads it from the command line: strings in quotes, numbers and switches plain."""
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, (int, float)) else "'" + str(value).replace("'", "''") + "'"

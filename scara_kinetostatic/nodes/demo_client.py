"""What it takes to start nodes on this machine alone: a free domain, the environment, values as arguments."""

from __future__ import annotations

import random
import socket

THIS_MACHINE = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
"""Environment of nodes that look for others on this machine only."""


def free_domain() -> int:
    """A ROS domain that no process on this machine uses, chosen at random."""
    domains = random.sample(range(1, 100), 99)  # their ports lie below those that Linux hands out
    return next((domain for domain in domains if is_free(domain)), domains[0])


def is_free(domain: int) -> bool:
    """Whether the discovery port of the domain (DDSI-RTPS: 7400 + 250 d) is free."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(('', 7400 + 250 * domain))
        except OSError:
            return False
    return True


def ros_value(value: object) -> str:
    """A value as ROS reads it from the command line: strings in quotes, numbers and switches plain."""
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, (int, float)) else "'" + str(value).replace("'", "''") + "'"

"""Which nodes a parameter file of ROS is for: a section whose name matches none is passed over without a word."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml


def sections_of(file: str | Path) -> list[str]:
    """Full names of the nodes, with their wildcards, for which a file has sections; none where it is no such file."""
    try:
        return list(_sections(yaml.safe_load(Path(file).read_text(encoding='utf-8')), ''))
    except (OSError, ValueError, yaml.YAMLError):  # rcl says what is wrong with it
        return []


def _sections(tree: Any, name: str) -> Iterator[str]:
    for key, value in tree.items() if isinstance(tree, dict) else ():
        if key == 'ros__parameters':
            yield name
        else:
            yield from _sections(value, f'{name}/{str(key).strip("/")}')


def is_for(section: str, node: str) -> bool:
    """Whether a section is for a node, by their full names; `*` stands for one name, `**` for any number of them."""
    pattern = re.escape(section).replace(r'/\*\*', r'(/\w+)*').replace(r'/\*', r'/\w+')
    return re.fullmatch(pattern, node) is not None

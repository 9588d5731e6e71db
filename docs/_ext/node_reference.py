"""The tables of the node reference, made from what the nodes declare when they start."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

from command_reference import escape
from common import PACKAGE, MarkdownDirective, code, table
from sphinx.application import Sphinx


@cache
def nodes_declared() -> dict[str, Any]:
    """What `node_record.py` finds, in a process of its own."""
    script = Path(__file__).with_name('node_record.py')
    places = {'PYTHONPATH': os.pathsep.join([str(PACKAGE.parent), os.environ.get('PYTHONPATH', '')])}
    command = [sys.executable, str(script)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **places})
    if done.returncode:
        raise RuntimeError(f'{script.name} failed:\n{done.stderr}')
    return dict(json.loads(done.stdout))


class NodeInterfaces(MarkdownDirective):
    """The topics and services of a node."""

    made_from = 'nodes'

    def markdown(self) -> str:
        found = nodes_declared()[self.arguments[0]]['interfaces']
        rows = dict.fromkeys((code(one['name']), one['role'], code(one['type'])) for one in found)
        return table(('name', 'role', 'type'), rows)


class NodeParameters(MarkdownDirective):
    """The parameters of a node; those that are results are named by their beginning only."""

    made_from = 'nodes'

    def markdown(self) -> str:
        rows = []
        for name, one in nodes_declared()[self.arguments[0]]['parameters'].items():
            if not one['result']:
                meaning = one['description'] + ('' if one['read_only'] else '; may be set at runtime')
                rows.append((code(name), escape(meaning), default(one), limits(one)))
        return table(('parameter', 'meaning', 'default', 'range'), rows)


def default(one: dict[str, Any]) -> str:
    """The default value of a parameter."""
    value = one['default'] if one['default'] != [''] else []  # ROS cannot declare an empty list
    return code(f'{value:.6g}' if isinstance(value, float) else json.dumps(value))


def limits(one: dict[str, Any]) -> str:
    """The range of a number."""
    return '{:.4g} … {:.4g}'.format(*one['range']).replace(' ', '\u00a0') if one['range'] else ''


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the directives."""
    app.add_directive('node-interfaces', NodeInterfaces)
    app.add_directive('node-parameters', NodeParameters)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}

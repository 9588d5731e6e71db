"""The reference pages are made from the code: what their generators find is what there is."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from functools import cache
from typing import Any
from xml.etree import ElementTree

import pytest
from docs.examples import DOCS, ROOT

import scara_kinetostatic as sk
from benchmark.figures import FIGURES, with_figures
from scara_kinetostatic.effects import catalogue
from scara_kinetostatic.model.parameters import NAMES, UNITS

NODES = (
    'contact_simulator', 'collector', 'calibrator', 'compensator', 'contour_tracker', 'monitor', 'touch_runner',
    'visualizer',
)  # fmt: skip
COMMON = {'parameter_events', 'rosout', 'clock'}
"""Topics that every node has."""
OWN_SERVICES = {
    '~/describe_parameters', '~/get_parameter_types', '~/get_parameters', '~/get_type_description',
    '~/list_parameters', '~/set_parameters', '~/set_parameters_atomically',
}  # fmt: skip
"""Services that every node has."""


@cache
def declared() -> dict[str, Any]:
    """What the generator of the node reference finds, without ROS."""
    command = [sys.executable, str(DOCS / '_ext' / 'node_record.py')]
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    return dict(json.loads(subprocess.run(command, env=environment, capture_output=True, check=True).stdout))


@pytest.mark.parametrize('node', NODES)
def test_topics_and_services_are_those_of_the_policy(node: str) -> None:
    """The tests of the nodes compare the policy with the running node."""
    policy = ElementTree.parse(ROOT / 'config' / 'sros2' / 'nodes.policy.xml')
    (profile,) = policy.iterfind(f".//profile[@node='{node}']")
    allowed = {
        'publishes': {str(t.text).lstrip('/') for t in profile.iterfind("topics[@publish='ALLOW']/topic")} - COMMON,
        'subscribes': {str(t.text).lstrip('/') for t in profile.iterfind("topics[@subscribe='ALLOW']/topic")} - COMMON,
        'service': {s.text for s in profile.iterfind("services[@reply='ALLOW']/service")} - OWN_SERVICES,
        'calls': {s.text for s in profile.iterfind("services[@request='ALLOW']/service")},
    }
    found: dict[str, set[str]] = {role: set() for role in allowed}
    for one in declared()[node]['interfaces']:
        found[one['role']].add(one['name'].lstrip('/'))
    assert found == allowed


def test_parameters_are_described() -> None:
    for node in NODES:
        for name, one in declared()[node]['parameters'].items():
            assert one['description'], f'{node}: {name}'
    assert {f'truth.{name}' for name in NAMES} <= set(declared()['contact_simulator']['parameters'])
    results = {name for name, one in declared()['calibrator']['parameters'].items() if one['result']}
    numbers = {f'{group}.{name}' for group in ('calibrated', 'calibrated_std') for name in UNITS}
    assert results == numbers


def test_every_effect_has_its_row_of_identification() -> None:
    page = (DOCS / 'effects' / 'index.md').read_text(encoding='utf-8')
    for effect in catalogue(sk.load_cell(ROOT / 'config' / 'cell.yaml')):
        assert f'| `{effect.name}' in page, effect.name


def test_every_node_and_public_name_has_its_place() -> None:
    nodes = (DOCS / 'reference' / 'nodes.md').read_text(encoding='utf-8')
    assert all(f'{{node-parameters}} {node}' in nodes for node in NODES)
    assert '{python-reference}' in (DOCS / 'reference' / 'python.md').read_text(encoding='utf-8')


def test_figures_are_stated_to_be_of_the_version_at_hand() -> None:
    """A page that states with which version it was measured states this one."""
    texts = [path.read_text(encoding='utf-8') for path in (ROOT / 'README.md', *sorted(DOCS.rglob('*.md')))]
    stated = [version for text in texts for version in re.findall(r'\bwith version (\d[\w.]*\d)', text)]
    assert stated and set(stated) == {sk.__version__}
    assert re.search(rf'measured with version {re.escape(sk.__version__)}\b', (DOCS / 'figures.md').read_text('utf-8'))


def test_every_figure_that_is_measured_by_the_command_has_its_row() -> None:
    """The page has a row for each figure of `benchmark.figures`, which writes there."""
    page = (DOCS / 'figures.md').read_text('utf-8')
    for command, figures in FIGURES.items():
        written = with_figures(page, command, [f'figure {k}' for k in range(len(figures))], 'abc')
        assert re.findall(r'\| figure (\d) \|[^|]+\| abc \|', written) == [str(k) for k in range(len(figures))]

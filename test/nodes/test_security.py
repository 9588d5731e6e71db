"""The policy for SROS 2 allows each node the topics and services that it has, and nothing else."""

from __future__ import annotations

import re
from functools import partial
from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rclpy.node import Node

from scara_kinetostatic.nodes import executables
from scara_kinetostatic.nodes.streams import TFMessage

ROOT = Path(__file__).parents[2]
POLICIES = ROOT / 'config' / 'sros2'
KINDS = {
    name: getattr(import_module(f'scara_kinetostatic.nodes.{one.args[0]}'), one.args[1])
    for name, one in vars(executables).items()
    if isinstance(one, partial)
}
RULES = {
    ('topics', 'publish'): Node.get_publisher_names_and_types_by_node,
    ('topics', 'subscribe'): Node.get_subscriber_names_and_types_by_node,
    ('services', 'reply'): Node.get_service_names_and_types_by_node,
    ('services', 'request'): Node.get_client_names_and_types_by_node,
}
"""What a policy can allow, and how a node is asked what it does."""


EDIT = re.compile(r's\|([^|]+)\|([^|]+)\|')


def policy_text(file: str, namespace: str = '') -> str:
    """A policy, for a namespace edited as the page says."""
    text = (POLICIES / file).read_text()
    if not namespace:
        return text
    page = (ROOT / 'docs' / 'how_to' / 'security.md').read_text(encoding='utf-8')
    edits = EDIT.findall(page)
    assert len(edits) == 2
    for old, new in edits:
        text = text.replace(old, new)
    return text


def allowed(file: str, node: str, namespace: str = '') -> dict[tuple[str, str], set[str]]:
    """The full names that a policy allows a node, by rule."""
    policy = ElementTree.fromstring(policy_text(file, namespace).encode())
    assert (policy.tag, policy.attrib) == ('policy', {'version': '0.2.0'})
    (profile,) = policy.iterfind(f"enclaves/enclave/profiles/profile[@node='{node}']")
    assert profile.attrib['ns'] == (namespace or '/')
    names: dict[tuple[str, str], set[str]] = {rule: set() for rule in RULES}
    for group in profile:
        ((verb, qualifier),) = group.attrib.items()
        assert qualifier == 'ALLOW'
        names[group.tag, verb] |= {_resolved(str(item.text), node, namespace) for item in group}
    return names


def _resolved(name: str, node: str, namespace: str) -> str:
    """As sros2 does it."""
    if name.startswith('/'):
        return name
    return f'{namespace}/{node}{name[1:]}' if name.startswith('~') else f'{namespace}/{name}'


@pytest.mark.parametrize('name', KINDS)
def test_a_node_may_do_what_it_does_and_nothing_else(bench, name):
    enclave = f'/scara_kinetostatic/left/{name}'
    node = bench(KINDS[name], '--enclave', enclave, '-r', '__ns:=/left', use_sim_time=True, publish_urdf=True).node
    assert (name, '/left', enclave) in node.get_node_names_and_namespaces_with_enclaves()
    has = {rule: {topic for topic, _ in ask(node, name, '/left')} for rule, ask in RULES.items()}
    if name in ('collector', 'contour_tracker', 'touch_runner', 'compensator') and TFMessage is None:
        has['topics', 'subscribe'].add('/tf_static')
    assert allowed('nodes.policy.xml', name, '/left') == has
    plain = {rule: {re.sub('^/left/', '/', topic) for topic in topics} for rule, topics in has.items()}
    assert allowed('nodes.policy.xml', name) == plain
    assert f'<enclave path="{enclave}">' in policy_text('nodes.policy.xml', '/left')


def test_every_node_has_an_enclave_of_its_own_and_the_launch_file_names_it():
    policy = ElementTree.parse(POLICIES / 'nodes.policy.xml').getroot()
    enclaves = {enclave.attrib['path']: enclave for enclave in policy.iterfind('enclaves/enclave')}
    assert set(enclaves) == {f'/scara_kinetostatic/{name}' for name in KINDS}
    for path, enclave in enclaves.items():
        assert [profile.attrib['node'] for profile in enclave.iterfind('profiles/profile')] == [path.rpartition('/')[2]]
    assert "'enclaves': ('/scara_kinetostatic'," in (ROOT / 'launch/cell.launch.py').read_text()


@pytest.mark.parametrize('namespace', ['', '/left'])
def test_the_operator_may_call_and_hear_what_there_is(namespace):
    nodes = [allowed('nodes.policy.xml', name, namespace) for name in KINDS]
    operator = allowed('operator.policy.xml', '_ros2cli', namespace)
    assert operator['services', 'request'] == set().union(*(node['services', 'reply'] for node in nodes))
    assert operator['topics', 'subscribe'] <= set().union(*(node['topics', 'publish'] for node in nodes))
    wanted = f'{namespace}/compensator/compensate'
    assert operator['topics', 'publish'] == {'/parameter_events', '/rosout', wanted}
    assert all(name.startswith('/_ros2cli*/') for name in operator['services', 'reply'])

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from time import monotonic, sleep

import pytest
import rclpy
import yaml
from builtin_interfaces.msg import Time
from nodes.waiting import WAIT
from rcl_interfaces.srv import GetParameters
from rosgraph_msgs.msg import Clock

from scara_kinetostatic.files.yaml_file import node_sections
from scara_kinetostatic.nodes import cell_node
from scara_kinetostatic.nodes.collector import Collector
from scara_kinetostatic.nodes.contact_simulator import ContactSimulator
from scara_kinetostatic.nodes.demo import THIS_MACHINE, is_free, own_domain
from scara_kinetostatic.nodes.runtime import say_what_is_unused

NODES = ('contact_simulator', 'collector', 'calibrator')


def test_nodes_end_well_on_signals(processes, client, tmp_path):
    processes.start('calibrator', {})
    processes.start('collector', {'autostart': True, 'output': tmp_path / 'bags'})
    processes.start('contact_simulator', {'wait_for_subscribers': 1, 'time_factor': 20.0})
    client.call('/calibrator/get_parameters', GetParameters, GetParameters.Request(), WAIT)
    client.wait('a touch', lambda: client.touches > 0, WAIT)
    running = dict(processes._running)
    end = monotonic() + WAIT
    while any(process.poll() is None for process in running.values()) and monotonic() < end:
        for process, number in zip(running.values(), (signal.SIGINT, signal.SIGTERM, signal.SIGINT), strict=True):
            process.send_signal(number)  # an impatient user, until the very end
        sleep(0.02)
    assert {name: process.wait(WAIT) for name, process in running.items()} == dict.fromkeys(NODES, 0)
    for name in NODES:
        assert 'Traceback' not in processes.log(name).read_text()
    (bag,) = (tmp_path / 'bags').iterdir()
    files = {path.name for path in bag.iterdir()} - {'metadata.yaml'}
    assert files
    assert all(re.fullmatch(rf'{bag.name}_\d+(-\d+)?\.mcap', name) for name in files), files  # merged ones, too
    stated = yaml.safe_load((bag / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert set(stated['relative_file_paths']) == files


INTERRUPTED = """
import os, signal, sys

class Interrupt:
    def find_spec(self, name, *_):
        if name == {module!r}:
            os.kill(os.getpid(), {number})
            print('still there')

sys.meta_path.insert(0, Interrupt())
"""
START = 'import sys; from scara_kinetostatic.nodes import executables; sys.exit(executables.{name}())'


@pytest.mark.parametrize(('name', 'number'), [('contact_simulator', signal.SIGINT), ('compensator', signal.SIGTERM)])
def test_a_signal_while_a_node_is_imported_ends_it_without_a_word(name, number):
    code = INTERRUPTED.format(number=int(number), module='rclpy') + START.format(name=name)
    ended = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=WAIT)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, '', '')


def test_a_domain_in_which_a_node_discovers_this_machine_alone_is_not_free(monkeypatch):
    for name, value in THIS_MACHINE.items():
        monkeypatch.setenv(name, value)
    with own_domain() as domain:
        rclpy.init(domain_id=domain)
        node = ContactSimulator()
    try:
        assert not is_free(domain)
    finally:
        node.close()
        node.destroy_node()
        rclpy.try_shutdown()


def test_a_domain_that_one_has_is_kept_from_others_before_anything_runs_in_it():
    with own_domain() as domain:
        assert not is_free(domain)
    assert is_free(domain)


@pytest.mark.parametrize(('given', 'line'), [
    (['-p', 'cell:={wrong}'], '{wrong}'),
    (['--params-file', '/no/file.yaml'], '/no/file.yaml: there is no such file; check the path'),
])  # fmt: skip
def test_a_wrong_cell_or_parameter_file_is_one_line_and_status_2(given, line, tmp_path, domain):
    wrong = tmp_path / 'cell.yaml'
    wrong.write_text('robot: {}')
    ended = subprocess.run(
        [
            sys.executable,
            '-c',
            START.format(name='collector'),
            '--ros-args',
            *(part.format(wrong=wrong) for part in given),
        ],
        env=os.environ | {'ROS_DOMAIN_ID': str(domain)},
        capture_output=True,
        text=True,
        timeout=WAIT,
    )
    assert ended.returncode == 2
    assert len(ended.stderr.splitlines()) == 1
    assert line.format(wrong=wrong) in ended.stderr


SAID = {
    'calibrator: {ros__parameters: {output: x}}': '{file}: nothing in it is for /left/collector; it has /calibrator',
    '/left: {collector: {ros__parameters: {autostart: false}}}': '',
    '/**/collector: {ros__parameters: {output: !!str 5}}': '',
    '/**/collector: {ros__parameters: {autostart: false}}': '',
    '/*/collector: {ros__parameters: {autostart: false}}': '',
    '/left/collector: {ros__parameters: {autostrat: true}}':
        "parameter autostrat: no node has it; did you mean 'autostart'?",
    '/**: {ros__parameters: {speed: 0.1, calibrated.l1: 0.3, calibration.rank: 13}}': '',  # of other nodes, a result
}  # fmt: skip


@pytest.mark.parametrize('text', SAID)
def test_parameters_that_nothing_takes_are_said(bench, tmp_path, capfd, text):
    file = tmp_path / 'own.yaml'
    file.write_text(text)
    node = bench(Collector, '--params-file', str(file), '-r', '__ns:=/left').node
    capfd.readouterr()
    say_what_is_unused(node, {str(file): node_sections(file)})
    said = capfd.readouterr().err
    assert SAID[text].format(file=file) in said
    assert len(said.splitlines()) == bool(SAID[text])


def test_a_clock_that_is_silent_or_stands_still_is_said(bench, capfd, monkeypatch):
    monkeypatch.setitem(cell_node.LASTING, 'throttle_duration_sec', 0.0)
    b, said = bench(Collector, use_sim_time=True), ''
    clock = b.robot.create_publisher(Clock, '/clock', 10)

    def has(text):
        nonlocal said
        said += capfd.readouterr().err
        return text in said

    b.wait(lambda: has('use_sim_time is true, and /clock is silent: start what publishes it'))
    b.wait(lambda: b.node.now(), lambda: clock.publish(Clock(clock=Time(sec=3))))
    b.wait(lambda: has('use_sim_time is true, and /clock stands still'))

from __future__ import annotations

from dataclasses import replace

import numpy as np
from rcl_interfaces.msg import ParameterDescriptor
from sensor_msgs.msg import JointState

from scara_kinetostatic.contour.trace import LARGEST_TIP
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.model.cell import PAPER_CELL, Lift
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, UNITS
from scara_kinetostatic.nodes.cell_node import PARAMETERS
from scara_kinetostatic.nodes.contact_simulator import ContactSimulator, Playback
from scara_kinetostatic.running.campaign import FIRST
from scara_kinetostatic.simulation.commanded import Malfunction, PlantSettings
from scara_kinetostatic.simulation.mujoco import SCENES
from scara_kinetostatic.simulation.plan import load_plan
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams
from scara_kinetostatic.simulation.truth import deviating_robot
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

STREAMS = Streams(
    source='test',
    joints=JointStream(np.array([0, 10, 20]) * 1_000_000, np.array([[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]])),
    wrench=WrenchStream(np.array([5, 15]) * 1_000_000, np.array([[6.0, 7.0], [8.0, 9.0]])),
)


def test_playback_hands_out_both_streams_in_the_order_of_time():
    playback = Playback(STREAMS, start=100)
    early = list(playback.advance(0.012))
    assert early == [(False, (100, 0.0, 1.0)), (True, (5_000_100, 6.0, 7.0)), (False, (10_000_100, 2.0, 3.0))]
    assert list(playback.advance(0.012)) == []
    assert list(playback.advance(0.001)) == [], 'time does not run back'
    assert not playback.finished
    assert len(list(playback.advance(1.0))) == 2
    assert playback.finished
    assert playback.end == 20_000_100


def test_parameters_have_descriptions_and_ranges(bench):
    simulator = bench(ContactSimulator, wait_for_subscribers=1).node
    own = [name for name in simulator._parameters if name not in ('use_sim_time', 'start_type_description_service')]
    descriptors: list[ParameterDescriptor] = simulator.describe_parameters(own)
    assert len(own) >= 25
    assert simulator._truth.effects == ()
    for descriptor in descriptors:
        assert descriptor.description, descriptor.name
        if descriptor.type in (2, 3):
            assert descriptor.integer_range or descriptor.floating_point_range, descriptor.name
    changeable = {descriptor.name for descriptor in descriptors if not descriptor.read_only}
    assert changeable == {'time_factor', 'loop', 'fault', 'scaling', 'active'}
    assert [simulator.get_parameter(f'truth.{name}').value for name in PAPER_ACTUAL.as_dict()] == list(
        PAPER_ACTUAL.as_array()
    )


def test_stated_defaults_and_ranges_are_those_of_what_they_set():
    stated, usual, drives = PARAMETERS['contact_simulator'], SensorModel(), PlantSettings()
    expected = {
        'noise.joint_sample': usual.joint_noise,
        'noise.force_sample': usual.force_noise,
        'bias.x': usual.bias[0],
        'bias.y': usual.bias[1],
        'joint_rate': usual.joint_rate,
        'wrench_rate': usual.wrench_rate,
        'lag': drives.lag,
        'speed_limit': drives.speed,
        'overload': drives.overload,
    }
    assert {name: stated[name]['default'] for name in expected} == expected
    assert ', '.join(SCENES) in stated['scene']['meaning']
    assert ', '.join(fault.value for fault in Malfunction if fault.value) in stated['fault']['meaning']
    assert {name.removeprefix('truth.') for name in stated if name.startswith('truth.')} == set(UNITS)
    assert PARAMETERS['contour_tracker']['tip_radius']['range'][1] == LARGEST_TIP
    assert PARAMETERS['touch_runner']['max_touches']['range'][0] == FIRST


def test_effects_are_played(bench):
    texts = "['object_radius[disc_2]:radius=6e-5', 'sensor_bias:x=1.0,y=-0.5']"
    node = bench(ContactSimulator, '-p', f'effects:={texts}').node
    assert [effect.label for effect in node._truth.effects] == ['object_radius[disc_2]', 'sensor_bias']
    assert node._truth.effect_values == ((6e-5,), (1.0, -0.5))
    assert node._truth.parameters == PAPER_ACTUAL


def test_a_plan_of_slides(bench, tmp_path):
    plan = tmp_path / 'slides.yaml'
    plan.write_text('- {slide: {center: [0.2, 0.3], radius: 0.03}, force: 15, speed: 0.05}\n')
    node = bench(ContactSimulator, plan=plan, wait_for_subscribers=1).node
    expected = simulate_streams(PAPER_CELL, deviating_robot(PAPER_CELL.nominal), load_plan(plan, PAPER_CELL), start=0)
    assert node._playback.end == max(expected.joints.stamp[-1], expected.wrench.stamp[-1])


def test_lift_and_held_joints_are_played(bench, tmp_path):
    path = tmp_path / 'cell.yaml'
    path.write_text(dump_cell(replace(PAPER_CELL, lift=Lift('joint3', 0.02, 0.01), hold={'joint4': 0.4})))
    cell = bench(ContactSimulator, cell=path)
    heard = cell.hear(JointState, 'joint_states', 10)
    cell.wait(lambda: heard)
    assert list(heard[0].name) == ['joint1', 'joint2', 'joint3', 'joint4'] and list(heard[0].position[2:]) == [
        0.01,
        0.4,
    ]

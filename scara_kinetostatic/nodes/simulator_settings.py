"""The parameters of the contact simulator: declared, checked, converted into the inputs of the simulation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from math import tau
from typing import TypeVar

from rclpy.node import Node

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import Cell, SensorFrame, SensorSign
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import DESCRIPTIONS, UNITS, Parameters
from scara_kinetostatic.nodes import declare
from scara_kinetostatic.nodes.declare import Range, cell_or_example
from scara_kinetostatic.simulation.plan import LARGEST_PRELOAD, Plan, default_plan
from scara_kinetostatic.simulation.plan_file import holds_slides, load_plan, load_slides
from scara_kinetostatic.simulation.sensors import TYPICAL_NOISE, SensorModel
from scara_kinetostatic.simulation.slides import Slide
from scara_kinetostatic.simulation.truth import deviating_robot, parse_effect, with_effects

_TRUTH_RANGES = {
    'x0': Range(-100.0, 100.0), 'y0': Range(-100.0, 100.0),
    'theta1': Range(-tau, tau), 'l1': Range(1e-3, 100.0), 'theta2': Range(-tau, tau), 'l2': Range(1e-3, 100.0),
    'p_ee': Range(0.0, 1e-2), 'p1': Range(0.0, 1e-2), 'p2': Range(0.0, 1e-2),
    'g_ee': Range(0.0, 1e-2), 'g1': Range(0.0, 0.1), 'g2': Range(0.0, 0.1),
}  # fmt: skip
_RATES = Range(1.0, 2000.0)
"""Messages per second."""
_E = TypeVar('_E', bound=Enum)


@dataclass(frozen=True)
class SimulatorSettings:
    """Inputs of the simulation.

    Attributes:
        cell: with the frame and the sign that the simulated sensor really has.
        plan: the touches, or slides along objects.
        truth: the simulated robot, with its effects.
        sensors: noise, bias and rates.
        seed: of all random numbers.
        wait_for_subscribers: subscribers that both topics need before the simulation starts.
    """

    cell: Cell
    plan: Plan | tuple[Slide, ...]
    truth: ExtendedModel
    sensors: SensorModel
    seed: int
    wait_for_subscribers: int


def declare_simulator(node: Node) -> SimulatorSettings:
    """Declares all parameters except those that may change while the node runs.

    Raises:
        InputError: the cell or the plan cannot be read, or a value or an effect is not valid.
    """
    cell = _cell(node)
    return SimulatorSettings(
        cell=cell,
        plan=_plan(node, cell),
        truth=_with_effects(node, cell),
        sensors=_sensors(node, cell),
        seed=declare.whole(node, 'seed', 0, 'seed of the noise', Range(0, 2**31 - 1)),
        wait_for_subscribers=declare.whole(
            node,
            'wait_for_subscribers',
            0,
            'subscribers that both topics need before the simulation starts',
            Range(0, 100),
        ),
    )


def _cell(node: Node) -> Cell:
    cell = cell_or_example(node)
    frame = declare.text(node, 'frame', '', 'frame of the sensor, base or tool; empty: as the cell says')
    sign = declare.text(node, 'sign', '', 'sign of the sensor, on_object or on_robot; empty: as the cell says')
    sensor = cell.sensor._replace(
        frame=_choice('frame', frame, cell.sensor.frame, SensorFrame),
        sign=_choice('sign', sign, cell.sensor.sign, SensorSign),
    )
    return replace(cell, sensor=sensor)


def _plan(node: Node, cell: Cell) -> Plan | tuple[Slide, ...]:
    """The touches, or the slides."""
    meaning = 'plan of touches, or of slides along objects (YAML file); empty: touches over all discs of the cell'
    file = declare.text(node, 'plan', '', meaning)
    meaning = 'preload of every other touch: force beyond that of the hold, over it; with a plan: 0'
    preload = declare.number(node, 'preload', 0.0, meaning, Range(0.0, LARGEST_PRELOAD))
    if file and preload > 0:
        raise ParameterError('parameter preload', 'a plan defines all touches', 'leave out preload or plan')
    if file and holds_slides(file):
        return load_slides(file, cell)
    return load_plan(file, cell) if file else default_plan(cell, preload=preload)


def _choice(name: str, value: str, default: _E, choices: type[_E]) -> _E:
    try:
        return choices(value) if value else default
    except ValueError:
        expected = ' or '.join(str(choice.value) for choice in choices)
        raise ParameterError(f'parameter {name}', f'expected {expected}, got {value!r}') from None


def _with_effects(node: Node, cell: Cell) -> ExtendedModel:
    """The simulated robot, with its effects."""
    how = "effects of the simulated robot, each as 'name[target]:parameter=value,parameter=value', SI units"
    chosen = [parse_effect(text, cell) for text in declare.texts(node, 'effects', how)]
    return with_effects(_truth(node, cell.nominal), chosen)


def _truth(node: Node, nominal: Parameters) -> Parameters:
    """The true parameters; by default they deviate from the nominal ones as in table 2."""
    values = {
        name: declare.number(
            node, f'truth.{name}', default, f'true {DESCRIPTIONS[name]}, {UNITS[name]}', _TRUTH_RANGES[name]
        )
        for name, default in deviating_robot(nominal).as_dict().items()
    }
    return Parameters(**values)


def _sensors(node: Node, cell: Cell) -> SensorModel:
    usual = SensorModel()
    noise = cell.noise or TYPICAL_NOISE
    angle, force, bias = Range(0, 0.1), Range(0, 100), Range(-100, 100)

    def number(name: str, default: float, description: str, bounds: Range) -> float:
        return declare.number(node, name, default, description, bounds)

    return SensorModel(
        touch_noise=noise.with_rms(
            number('noise.joint', noise.joint_rms, 'repeatability of a joint angle from touch to touch, rad', angle),
            number('noise.force', noise.force_rms, 'repeatability of the force from touch to touch, N', force),
        ),
        joint_noise=number('noise.joint_sample', usual.joint_noise, 'white noise of the joint samples, rad', angle),
        force_noise=number('noise.force_sample', usual.force_noise, 'white noise of the force samples, N', force),
        bias=(
            number('bias.x', usual.bias[0], 'bias of the force sensor along x, N', bias),
            number('bias.y', usual.bias[1], 'bias of the force sensor along y, N', bias),
        ),
        joint_rate=number('joint_rate', usual.joint_rate, 'joint states per simulated second, Hz', _RATES),
        wrench_rate=number('wrench_rate', usual.wrench_rate, 'wrenches per simulated second, Hz', _RATES),
    )

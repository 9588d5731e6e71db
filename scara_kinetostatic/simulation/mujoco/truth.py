"""True parameters and effects of a scene, as data; for tests and studies alone."""

from __future__ import annotations

from typing import Any

import yaml

from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import UNITS, Parameters
from scara_kinetostatic.simulation.mujoco.engine import load_engine
from scara_kinetostatic.simulation.mujoco.scene import Scene

SCHEMA = 'scara_kinetostatic/physics_truth/1'


def truth_of_scene(scene: Scene, cell: Cell, seed: int = 0) -> dict[str, Any]:
    """Engine, scene, true parameters, the parameters that touches can identify, effects.

    Args:
        scene: the true robot.
        cell: names the discs.
        seed: of the noise.

    Raises:
        InputError: MuJoCo is not installed.
    """
    return {
        'schema': SCHEMA,
        'engine': f'MuJoCo {load_engine().__version__}',
        'scene': scene.name,
        'seed': seed,
        'built': _by_name(scene.parameters),
        'expected': _by_name(expected_parameters(scene)),
        'effects': built_effects(scene, cell),
    }


def truth_text(truth: dict[str, Any]) -> str:
    """The truth as YAML."""
    return yaml.safe_dump(truth, sort_keys=False, default_flow_style=None, width=120)


def _by_name(parameters: Parameters) -> dict[str, float]:
    """The parameters by name."""
    values = parameters.as_dict()
    return {name: values[name] for name in UNITS}


def expected_parameters(scene: Scene) -> Parameters:
    """The parameters L̄ that touches identify.

    The mean compliance of the base in x and y is confounded with p_ee. A spring with friction beside it slips as a
    whole: it is compliance of the slip, not of the joint.
    """
    p = scene.parameters
    p1, p2 = (
        0.0 if friction else spring for spring, friction in zip((p.p1, p.p2), scene.winding_friction, strict=True)
    )
    return p.replace(p_ee=p.p_ee + 0.5 * sum(scene.base_compliance), p1=p1, p2=p2)


def built_effects(scene: Scene, cell: Cell) -> list[dict[str, Any]]:
    """The effects of the scene: name, target and values, SI units."""
    effects = []

    def add(name: str, target: str | None, **values: float) -> None:
        effects.append({'name': name, 'target': target, 'parameters': {key: float(v) for key, v in values.items()}})

    if scene.contact_friction:
        add('contact_friction', None, coefficient=scene.contact_friction)
    for number, compliance in enumerate((scene.parameters.p1, scene.parameters.p2)):
        target = f'joint{number + 1}'
        if scene.bearing_friction[number]:
            torque = scene.bearing_friction[number]
            add('joint_hysteresis', target, width=compliance * torque, bearing_torque=torque)
        if scene.winding_friction[number]:
            add('joint_slip', target, compliance=compliance, slip_torque=scene.winding_friction[number])
        if scene.slip_compliance[number]:
            slip = scene.slip_compliance[number], scene.slip_torque[number]
            add('joint_slip', target, **dict(zip(('compliance', 'slip_torque'), slip, strict=True)))
    displaced = scene.displaced_disc(cell)
    if displaced is not None:
        add('object_position', cell.discs[displaced].name, x=scene.displacement[0], y=scene.displacement[1])
    if any(scene.base_compliance):
        along_x, along_y = scene.base_compliance
        add('base_compliance', None, excess=0.5 * (along_x - along_y), coupling=0.0)
    if scene.link_compliance:
        add('link_bending', 'link1', compliance=scene.link_compliance)
    padded = scene.padded_discs(cell)
    if padded:
        everywhere = len(padded) == len(cell.discs)
        add(
            'contact_compliance',
            None if everywhere else cell.discs[padded[0]].name,
            stiffness=scene.pad[0],
            depth=scene.pad[1],
        )
    if any(scene.tilt):
        add('base_tilt', None, tilt_x=scene.tilt[0], tilt_y=scene.tilt[1])
    if scene.cable:
        add('cable', 'joint2', stiffness=scene.cable)
    return effects

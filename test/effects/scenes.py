"""Effects at plausible sizes, and touches at which to try them."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from calibration.studies import CELL, EXACT
from model.helpers import Poses, random_poses

from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.contact_force import free_state
from scara_kinetostatic.model.extended_model import ExtendedModel, TouchMetadata, TouchState
from scara_kinetostatic.model.flanks import State
from scara_kinetostatic.model.kinematics import GripperSign, inverse
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.model.touch_equations import ContactProblem
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

EFFECTS = catalogue(CELL)
LABELS = [effect.label for effect in EFFECTS]
KINDS = tuple({(type(effect), type(getattr(effect, 'effect', None))): effect for effect in EFFECTS}.values())
"""Of each kind the one of the last joint or disc."""
KIND_LABELS = [effect.label for effect in KINDS]


class Scene(NamedTuple):
    """Random loaded touches."""

    poses: Poses
    joints: np.ndarray
    state: State
    metadata: TouchMetadata
    parameters: Parameters

    @property
    def contact_problem(self) -> ContactProblem:
        return ContactProblem(self.joints, self.poses.centers, self.poses.radii, GripperSign.PHYSICAL, self.metadata)

    @property
    def touch_state(self) -> TouchState:
        return self.contact_problem.touch_state(self.parameters, self.state)


def with_effect(effect: Effect, robot: Parameters = PAPER_ACTUAL) -> ExtendedModel:
    """A robot with an effect of a size that would matter."""
    return ExtendedModel(robot, (effect,), (tuple(plausible(effect)),))


def plausible(effect: Effect) -> np.ndarray:
    """Values of an effect's parameters, of a size that would matter."""
    return np.array(
        [p.scale / 10 if p.is_alias else size for p, size in zip(effect.parameters, effect.typical, strict=True)]
    )


def random_scene(seed: int, n: int = 200, parameters: Parameters = PAPER_ACTUAL) -> Scene:
    poses = random_poses(seed, n, parameters)
    rng = np.random.default_rng(seed)
    metadata = TouchMetadata(
        disc=rng.integers(0, len(CELL.discs), n),
        time=rng.uniform(0, 300, n),
        approach=rng.choice([-1.0, 1.0], (n, 2)) * rng.uniform(1e-4, 1e-3, (n, 2)),
        posture=poses.posture,
        press=rng.choice([-1.0, 1.0], (n, 2)) * rng.uniform(1e-4, 1e-3, (n, 2)),
        history=np.concatenate([rng.uniform(-2.5, 2.5, (n, 5, 2)), rng.uniform(-40, 40, (n, 5, 2))], axis=2),
        order=rng.permutation(n),
    )
    joints, _ = inverse_kinetostatics(parameters, poses.tip, poses.force, poses.posture)
    links = inverse(parameters, poses.tip, poses.posture)
    free = free_state(parameters, links, poses.centers)
    return Scene(poses, joints, free._replace(magnitude=np.hypot(*poses.force.T)), metadata, parameters)


def exact_touches(parameters: Parameters, plan: Plan, cell: Cell = CELL) -> TouchSet:
    """Those of a robot without effects, with their movement in contact: from no force, or down from the preload."""
    touches = simulate_touches(cell, parameters, plan, EXACT)
    before = np.where(plan.preload > 0, 1 + plan.preload, 1e-9)
    start, end = (
        inverse_kinetostatics(
            parameters, plan.contact(cell), -(part * plan.force)[:, None] * plan.normal(), plan.posture
        )[0]
        for part in (before, np.ones(len(plan)))
    )
    return touches.replace(press=end - start)


def press(effect: Effect, values: np.ndarray, parameters: Parameters = PAPER_ACTUAL, cell: Cell = CELL) -> TouchSet:
    """108 exact touches or more of a robot with an effect; every other touch is pressed beyond its force first, by two
    parts in turn.
    """
    plan = default_plan(cell, per_disc=20, preload=0.3)
    preload = plan.preload.copy()
    preload[preload > 0] = np.resize((0.3, 1.0), np.count_nonzero(preload))
    model = ExtendedModel(parameters, (effect,), (tuple(values),))
    return simulate_touches(cell, model, replace(plan, preload=preload), EXACT)

"""A(Q, L̄) with each effect: it is solved, the equations hold, and its derivatives are right."""

from __future__ import annotations

import numpy as np
import pytest
from effects.scenes import EFFECTS, LABELS, Scene, plausible, random_scene
from model.helpers import ROBOTS, STEPS

from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.model.contact import Contact, contact, contact_derivatives
from scara_kinetostatic.model.extended import extended_equations
from scara_kinetostatic.model.extension import Extension
from scara_kinetostatic.model.parameters import Parameters

NEGLECTED = 2e-3
"""What A_L̄ and A_Q leave out, as a part of them: that a shift depends on the link angles and on Q."""
BY_COMPLIANCE = {'base_tilt': 0.3}
"""The same for a shift that is in proportion to p1 and p2."""


def solve(effect: Effect, scene: Scene, parameters: Parameters, joints: np.ndarray, warm_start=None) -> Contact:
    extension = Extension((effect,), scene.metadata)
    return contact(
        parameters, joints, scene.poses.centers, scene.poses.radii, extension=extension, warm_start=warm_start
    )


def same_flanks(*found: Contact) -> np.ndarray:
    """Where several solutions rest on the same flanks, and press."""
    first = found[0].state
    equal = [(first.mode1 == one.state.mode1) & (first.mode2 == one.state.mode2) for one in found]
    return np.all(equal, axis=0) & np.all([one.magnitude > 2 for one in found], axis=0)


@pytest.mark.parametrize('effect', EFFECTS, ids=LABELS)
def test_every_touch_is_solved(effect):
    for robot in ROBOTS:
        scene, values = random_scene(3, 200, robot), plausible(effect)
        parameters = robot.replace(extra=tuple(values))
        found = solve(effect, scene, parameters, scene.joints)
        assert found.solved.all()
        pressed = found.magnitude > 0
        assert pressed.mean() > 0.7
        e = extended_equations(parameters, scene.contact_problem(effect), found.state)
        residual = np.array([e.normal, e.tangent, e.rows.row1, e.rows.row2])[:, pressed]
        assert np.abs(residual).max() < 1e-12


@pytest.mark.parametrize('effect', EFFECTS, ids=LABELS)
def test_derivatives_of_the_force(effect):
    scene, values = random_scene(4, 120), plausible(effect)
    parameters = scene.parameters.replace(extra=tuple(values))
    found = solve(effect, scene, parameters, scene.joints)
    extension = Extension((effect,), scene.metadata)
    given = contact_derivatives(
        parameters, scene.joints, scene.poses.centers, scene.poses.radii, found, extension=extension
    )
    whole = parameters.as_array()
    for k, step in enumerate(np.concatenate([STEPS, 1e-3 * np.abs(values)])):
        change = step * (np.arange(len(whole)) == k)
        pair = [
            solve(effect, scene, Parameters.from_array(whole + sign * change), scene.joints, found.force)
            for sign in (1, -1)
        ]
        allowed = NEGLECTED if k >= 12 else BY_COMPLIANCE.get(effect.name, NEGLECTED)
        compare(given.parameters[:, :, k], pair, found, step, allowed)
    for k in (0, 1):
        change = 1e-6 * (np.arange(2) == k)
        pair = [solve(effect, scene, parameters, scene.joints + sign * change, found.force) for sign in (1, -1)]
        compare(given.joints[:, :, k], pair, found, 1e-6, NEGLECTED)


def compare(given: np.ndarray, pair: list[Contact], found: Contact, step: float, allowed: float) -> None:
    """Derivative against difference; the typical touch, as near a toggle the force may turn at once."""
    good = same_flanks(found, *pair)
    assert good.mean() > 0.6
    numeric = (pair[0].force - pair[1].force)[good] / (2 * step)
    size = np.sqrt((numeric**2).mean())
    error = np.sqrt(((given[good] - numeric) ** 2).mean())
    assert error <= allowed * size

"""A(Q, L̄) with each effect: it is solved, the equations hold, and its derivatives are right."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from effects.scenes import KIND_LABELS, KINDS, Scene, plausible, random_scene, with_effect
from model.helpers import ROBOTS, STEPS

from scara_kinetostatic.effects.objects import EdgeBow
from scara_kinetostatic.model.contact_force import Contact, contact
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.touch_derivatives import contact_derivatives
from scara_kinetostatic.model.touch_equations import extended_equations

NEGLECTED = 2e-3
"""What A_L̄ and A_Q leave out, as a part of them: that a shift depends on the link angles and on Q."""
BY_COMPLIANCE = {'base_tilt': 0.3}
"""The same for a shift that is in proportion to p1 and p2."""


def solve(scene: Scene, model: ExtendedModel, joints: np.ndarray, warm_start=None) -> Contact:
    discs = scene.poses.centers, scene.poses.radii
    return contact(model, joints, *discs, metadata=scene.metadata, warm_start=warm_start)


def same_flanks(*found: Contact) -> np.ndarray:
    """Where several solutions rest on the same flanks, and press."""
    first = found[0].state
    equal = [(first.mode1 == one.state.mode1) & (first.mode2 == one.state.mode2) for one in found]
    return np.all(equal, axis=0) & np.all([one.magnitude > 2 for one in found], axis=0)


@pytest.mark.parametrize('effect', KINDS, ids=KIND_LABELS)
def test_every_touch_is_solved(effect):
    robot = ROBOTS[KINDS.index(effect) % 2]
    scene, model = random_scene(3, 200, robot), with_effect(effect, robot)
    found = solve(scene, model, scene.joints)
    assert found.solved.all()
    pressed = found.magnitude > 0
    assert pressed.mean() > 0.7
    e = extended_equations(model, scene.contact_problem, found.state)
    residual = np.array([e.h.real, e.h.imag, *e.rows.row])[:, pressed]
    assert np.abs(residual).max() < 1e-12


@pytest.mark.parametrize('effect', KINDS, ids=KIND_LABELS)
def test_derivatives_of_the_force(effect):
    scene = random_scene(4, 80)
    model = with_effect(effect, scene.parameters)
    found = solve(scene, model, scene.joints)
    given = contact_derivatives(model, found)
    whole = model.as_array()
    for k, step in enumerate(np.concatenate([STEPS, 1e-3 * np.abs(plausible(effect))])):
        change = step * (np.arange(len(whole)) == k)
        pair = [solve(scene, model.with_array(whole + sign * change), scene.joints, found.force) for sign in (1, -1)]
        allowed = NEGLECTED if k >= 12 else BY_COMPLIANCE.get(effect.name, NEGLECTED)
        compare(given.parameters[:, :, k], pair, found, step, allowed)
    for k in (0, 1):
        change = 1e-6 * (np.arange(2) == k)
        pair = [solve(scene, model, scene.joints + sign * change, found.force) for sign in (1, -1)]
        compare(given.joints[:, :, k], pair, found, 1e-6, NEGLECTED)


def compare(given: np.ndarray, pair: list[Contact], found: Contact, step: float, allowed: float) -> None:
    """Derivative against difference; the typical touch, as near a toggle the force may turn at once."""
    good = same_flanks(found, *pair)
    assert good.mean() > 0.6
    numeric = (pair[0].force - pair[1].force)[good] / (2 * step)
    size = np.sqrt((numeric**2).mean())
    error = np.sqrt(((given[good] - numeric) ** 2).mean())
    assert error <= allowed * size


def test_the_middle_of_a_bowed_edge_stands_out_and_its_ends_do_not():
    """Along the normal 1 - (s/h)², along the tangent by the slope 2 s/h² at the centre of the tip, r from the edge."""
    s, half, radius = np.array([-0.1, -0.05, 0.0, 0.1]), 0.1, 0.005
    tangents, none = np.tile([0.6, 0.8], (4, 1)), np.zeros((4, 2))
    at = SimpleNamespace(tangents=tangents, normal=none, along_edge=s, radii=np.full(4, radius))
    (place,) = EdgeBow('block.1', half=half).places(at)
    np.testing.assert_allclose((place * [-0.8, 0.6]).sum(axis=1), [0.0, 0.75, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose((place * tangents).sum(axis=1), 2 * s / half**2 * radius, atol=1e-12)

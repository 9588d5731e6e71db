"""Every effect's derivatives against differences, at random touches."""

from __future__ import annotations

import numpy as np
import pytest
from effects.scenes import EFFECTS, KIND_LABELS, KINDS, LABELS, plausible, random_scene, with_effect
from model.helpers import ROBOTS, assert_derivative

from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.objects import ContactFriction, OffNormalForce
from scara_kinetostatic.effects.unnamed import empirical_effects
from scara_kinetostatic.model.arrays import pairs
from scara_kinetostatic.model.contact_force import solve_links
from scara_kinetostatic.model.extended_model import ExtendedModel, ForceDependence
from scara_kinetostatic.model.flanks import State
from scara_kinetostatic.model.parameters import NAMES, P1, P2, P_EE
from scara_kinetostatic.model.touch_derivatives import all_derivatives
from scara_kinetostatic.model.touch_equations import ContactProblem, extended_equations


def check(effect: Effect, seed: int, robot: int) -> None:
    """The one check of an effect's derivatives that all go through: `shift` and `reading` by its parameters."""
    scene, values = random_scene(seed, 60, ROBOTS[robot]), plausible(effect)
    at, steps = scene.touch_state, 1e-4 * np.abs(values)
    parts = effect.derivative(at, values)
    assert len(parts) == len(values) == len(effect.parameters)
    for where in ('joints', 'place'):
        given = [getattr(part, where) for part in parts]
        if getattr(effect.shift(at, values), where) is None:
            assert all(part is None for part in given)
            continue
        analytic = np.stack([np.zeros_like(at.joints) if part is None else part for part in given], axis=-1)
        assert_derivative(lambda x, where=where: getattr(effect.shift(at, x), where), values, analytic, steps)
    sensor_error = effect.sensor_error_derivative(at.force, values)
    if effect.sensor_error(at.force, values) is None:
        assert not sensor_error
    else:
        assert_derivative(lambda x: effect.sensor_error(at.force, x), values, np.stack(sensor_error, axis=-1), steps)


@pytest.mark.parametrize('effect', EFFECTS, ids=LABELS)
def test_derivatives(effect):
    for robot in (0, 1):
        check(effect, seed=robot, robot=robot)


def test_derivatives_of_friction_whose_slide_follows_the_estimate():
    check(ContactFriction(), seed=2, robot=0)


def test_at_its_start_an_effect_does_nothing():
    at = random_scene(1, 20).touch_state
    for effect in EFFECTS:
        start = np.array(effect.start)
        for part in (*effect.shift(at, start), effect.sensor_error(at.force, start)):
            assert part is None or not part.any(), effect.label


def converged_state(model: ExtendedModel, contact_problem: ContactProblem, state: State, frozen: bool) -> State:
    """The state whose link angles go with the joint angles."""
    for _ in range(5):
        state = solve_links(model, contact_problem, state, frozen)[0]
    return state


@pytest.mark.parametrize('effect', KINDS, ids=KIND_LABELS)
def test_what_a_compliance_scales_is_in_its_derivative(effect):
    scene = random_scene(3, 60)
    contact_problem, whole = scene.contact_problem, with_effect(effect, scene.parameters)
    state = converged_state(whole, contact_problem, scene.state, frozen=False)
    given = all_derivatives(whole, contact_problem, state, extended_equations(whole, contact_problem, state))
    for place in (P_EE, P1, P2):
        name, step = NAMES[place], 1e-3 * getattr(whole.parameters, NAMES[place])
        robots = (whole.replace(**{name: getattr(whole.parameters, name) + sign * step}) for sign in (1, -1))
        up, down = (
            extended_equations(robot, contact_problem, converged_state(robot, contact_problem, state, frozen=True))
            for robot in robots
        )
        found = pairs(up.h - down.h) / (2 * step)
        # what the turn of the force does to the effect is of second order
        assert np.abs(found - given[:, :, place]).max() < 0.01 * np.abs(given[:, :, place]).max()


def changes(effect: Effect, **change: np.ndarray) -> bool:
    """Whether a change of the state of touches changes the shift of an effect at all."""
    scene, values = random_scene(4, 60), 1e-3 * np.ones(len(effect.parameters))
    values = values if effect.name == 'unnamed' else plausible(effect)
    state = scene.state._replace(**{name: getattr(scene.state, name) + by for name, by in change.items()})
    before, after = (
        effect.shift(scene.contact_problem.touch_state(scene.parameters, s), values) for s in (scene.state, state)
    )
    return any(not np.array_equal(a, b) for a, b in zip(before, after, strict=True) if a is not None)


CURVES = tuple(empirical_effects(random_scene(4, 60).touch_state, ['disc_1', 'disc_2', 'disc_3']))


@pytest.mark.parametrize('effect', (*EFFECTS, *CURVES), ids=lambda effect: effect.label)
def test_what_an_effect_says_of_the_force_is_what_its_shift_depends_on(effect):
    by_magnitude, by_direction = changes(effect, magnitude=3.0), changes(effect, direction=0.2)
    needed = (
        ForceDependence.ALL if by_magnitude else ForceDependence.DIRECTION if by_direction else ForceDependence.NONE
    )
    assert effect.force_dependence == needed


def test_a_random_off_normal_angle_does_not_depend_on_the_magnitude():
    scene, effect = random_scene(4, 60), OffNormalForce()
    problem = scene.contact_problem._replace(off_normal=np.linspace(-0.1, 0.1, 60))
    more = scene.state._replace(magnitude=scene.state.magnitude + 3.0)
    before, after = (effect.shift(problem.touch_state(scene.parameters, s), np.empty(0)) for s in (scene.state, more))
    assert effect.force_dependence == ForceDependence.DIRECTION
    np.testing.assert_array_equal(before.place, after.place)

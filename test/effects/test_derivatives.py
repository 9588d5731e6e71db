"""Every effect's derivatives against differences, at random touches."""

from __future__ import annotations

import numpy as np
import pytest
from effects.scenes import EFFECTS, LABELS, plausible, random_scene, with_effect
from model.helpers import ROBOTS, assert_derivative

from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.contact_friction import ContactFriction
from scara_kinetostatic.model.contact_state import State
from scara_kinetostatic.model.extended_equations import (
    ContactProblem,
    all_derivatives,
    extended_equations,
    extended_link_angles,
)
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import NAMES, P1, P2, P_EE


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


@pytest.mark.parametrize('robot', [0, 1])
@pytest.mark.parametrize('effect', EFFECTS, ids=LABELS)
def test_derivatives(effect, robot):
    check(effect, seed=robot, robot=robot)


def test_derivatives_of_friction_whose_slide_follows_the_estimate():
    check(ContactFriction(), seed=2, robot=0)


def converged_state(model: ExtendedModel, contact_problem: ContactProblem, state: State, frozen: bool) -> State:
    """The state whose link angles go with the joint angles."""
    for _ in range(5):
        state = extended_link_angles(model, contact_problem, state, frozen)
    return state


@pytest.mark.parametrize('effect', EFFECTS, ids=LABELS)
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
        found = np.stack([up.normal - down.normal, up.tangent - down.tangent], axis=-1) / (2 * step)
        # what the turn of the force does to the effect is of second order
        assert np.abs(found - given[:, :, place]).max() < 0.01 * np.abs(given[:, :, place]).max()


@pytest.mark.parametrize('effect', EFFECTS, ids=LABELS)
def test_at_its_start_an_effect_does_nothing(effect):
    scene, start = random_scene(1, 20), np.array(effect.start)
    at = scene.touch_state
    for part in effect.shift(at, start):
        assert part is None or not part.any()
    sensor_error = effect.sensor_error(at.force, start)
    assert sensor_error is None or not sensor_error.any()

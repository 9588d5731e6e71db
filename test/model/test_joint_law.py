"""The law of an elastic part with backlash (6): its slope, its inverse, and the rows that Newton's method takes."""

import numpy as np
import pytest

from scara_kinetostatic.model.cell import GripperSign, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.gravity import pull_of
from scara_kinetostatic.model.joint_law import beyond_gap, deflection, place_in_band, rounded_sign
from scara_kinetostatic.model.kinetostatics import Force, Law, inverse_of_rows
from scara_kinetostatic.model.parameters import PAPER_MEASURED

LOADS = np.random.default_rng(41).normal(size=200)
COMPLIANCE, GAP, STEP = 3e-5, 2e-4, 1e-6


@pytest.mark.parametrize('width', [0.05, 0.5, 3.0])
def test_the_place_in_a_band_has_the_slope_that_is_given(width):
    """By finite differences; one load after the other gives what all together give."""
    clear = LOADS[np.abs(np.abs(LOADS) - width) > 2 * STEP]
    place, slope = place_in_band(clear, width)
    numeric = (place_in_band(clear + STEP, width)[0] - place_in_band(clear - STEP, width)[0]) / (2 * STEP)
    np.testing.assert_allclose(slope, numeric, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(np.array([place_in_band(load, width) for load in clear.tolist()]).T, [place, slope])
    beyond = np.abs(clear) >= width
    np.testing.assert_array_equal(place[beyond], np.sign(clear[beyond]))
    assert np.abs(place - rounded_sign(clear, width)).max() <= 1 - np.sqrt(0.5) + 1e-12


def test_the_law_solved_for_the_load_gives_the_load_back():
    deflected = deflection(COMPLIANCE, GAP, LOADS, np.sign(LOADS))
    np.testing.assert_allclose(beyond_gap(deflected, GAP) / COMPLIANCE, LOADS, rtol=1e-9)
    floating = deflection(COMPLIANCE, GAP, 0.0, np.linspace(-1.0, 1.0, 9))
    np.testing.assert_allclose(beyond_gap(floating, GAP), 0.0, atol=1e-18)


@pytest.mark.parametrize('gravity', [(0.0, 0.0), (0.4, -9.7)])
def test_newtons_matrix_is_the_inverse_of_the_derivative_of_the_rows(gravity):
    """In the dead bands and beyond, by finite differences over both link angles."""
    rng = np.random.default_rng(42)
    robot = PAPER_MEASURED.replace(s1=2.1, s2=0.7, phi1=0.1, phi2=-0.2, gravity=gravity)
    law = Law(ExtendedModel(robot), GripperSign.PHYSICAL, Noise(joint=1e-5, force=0.3), (0.05, 0.02))
    links = np.stack([rng.uniform(-3, 3, 300), rng.choice([-1, 1], 300) * rng.uniform(0.3, 2.8, 300)])
    force = Force.of(rng.normal(size=(300, 2)) * rng.choice([1.0, 30.0], 300)[:, None], law.noise)

    def rows(links):
        at = law.loading(links[0] + robot.theta1, links.sum(axis=0) + robot.theta1 + robot.theta2, force)
        torques, places = np.array([at.c1, at.c2]), np.array([at.s1, at.s2])
        return at, links + deflection(robot.joint_compliances, robot.joint_backlashes, torques, places)

    at, _ = rows(links)
    places = np.abs([at.s1, at.s2])
    assert (places < 1).any() and (places == 1).any()
    ahead, behind = (
        np.array([rows(links + sign * STEP * unit)[1] for unit in np.eye(2)[:, :, None]]) for sign in (1, -1)
    )
    derivative = ((ahead - behind) / (2 * STEP)).transpose(2, 1, 0)
    # the width of a band is taken as given: it changes with the arm, and matters where the sign is not known
    known = (places == 1).all(axis=0)
    inverse = np.array(inverse_of_rows(at, force)).T.reshape(-1, 2, 2)
    product = inverse @ derivative
    np.testing.assert_allclose(product[known], np.broadcast_to(np.eye(2), product[known].shape), atol=1e-8)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(2), product.shape), atol=0.03)


def test_what_gravity_takes_from_the_torques_per_angle_is_their_derivative():
    robot = PAPER_MEASURED.replace(s1=2.1, s2=0.7, phi1=0.1, phi2=-0.2, gravity=(0.4, -9.7))
    angles = np.random.default_rng(43).uniform(-3, 3, (2, 50))

    def torque(shift1, shift2):
        pull = pull_of(robot, np.exp(1j * (angles[0] + shift1)), np.exp(1j * (angles[1] + shift1 + shift2)))
        return np.array(pull.torque), np.array(pull.turn)

    _, turn = torque(0.0, 0.0)
    of_first, of_second = (
        (torque(*unit)[0] - torque(*-unit)[0]) / (2 * STEP) for unit in (np.array([STEP, 0.0]), np.array([0.0, STEP]))
    )
    np.testing.assert_allclose(of_first, -turn, atol=1e-7)
    np.testing.assert_allclose(of_second, -turn[[1, 1]], atol=1e-7)

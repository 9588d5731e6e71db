"""The plane of the arm in the robot's frame, and moments whose centres of mass are beside the links."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scara_kinetostatic.errors import CellError
from scara_kinetostatic.files.cell_file import dump_cell, parse_cell
from scara_kinetostatic.model.cell import PAPER_CELL, Cell, Plane, Sensor, SensorFrame
from scara_kinetostatic.model.joint_law import joint_torques

PLANE = Plane('base_link', (0.1, -0.2, 0.3), (0.0, 0.6, 0.8), (1.0, 0.0, 0.0), 'tool0')
UPRIGHT = PAPER_CELL.nominal.replace(gravity=(1.0, -9.0), s1=4.0, s2=1.5, phi1=0.2, phi2=-0.7)
CELL = replace(
    PAPER_CELL,
    nominal=UPRIGHT,
    plane=PLANE,
    direction=(1, -1),
    limits=((-1.0, 2.0), (-2.5, -0.5)),
    sensor=Sensor(frame=SensorFrame.TOOL, axes=((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0))),
)


@pytest.mark.parametrize('cell', [CELL, replace(CELL, sensor=Sensor(rotation=-1.2))])
def test_a_description_survives_the_file(cell: Cell) -> None:
    text = dump_cell(cell)
    assert parse_cell(text) == cell
    assert 'joint2: [0.5, 2.5]' in text, 'limits are those of the readings'


def test_places_go_to_the_robot_and_back() -> None:
    places = np.random.default_rng(0).uniform(-1, 1, (5, 2))
    there = PLANE.in_robot(places)
    np.testing.assert_allclose(there[0], np.array(PLANE.origin) + places[0] @ (PLANE.x, PLANE.y), atol=1e-15)
    np.testing.assert_allclose(PLANE.in_plane(there), np.hstack([places, np.zeros((5, 1))]), atol=1e-15)
    assert np.linalg.det(PLANE.axes) == pytest.approx(1) and not Plane().is_stated and PLANE.is_stated


def test_torques_of_gravity_are_the_slope_of_the_height_of_the_centres() -> None:
    """c = ∂V/∂q with V = -g · (s1 R(phi1) e1 + s2 R(phi2) e2)."""
    p, step = UPRIGHT, 1e-5

    def height(q: np.ndarray) -> float:
        first, second = q[0] + p.theta1, q[0] + p.theta1 + q[1] + p.theta2
        lever = p.s1 * np.exp(1j * (first + p.phi1)) + p.s2 * np.exp(1j * (second + p.phi2))
        return float(-(p.gravity[0] * lever.real + p.gravity[1] * lever.imag))

    for q in np.random.default_rng(1).uniform(-3, 3, (20, 2)):
        slope = [(height(q + step * turn) - height(q - step * turn)) / (2 * step) for turn in np.eye(2)]
        found = joint_torques(p, q[None], np.zeros((1, 2)))[0]
        np.testing.assert_allclose(found, slope, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ('part', 'line', 'words'),
    [
        ('robot', 'direction: [1, 2]', '.direction.joint 2: expected 1 or -1, got 2'),
        ('robot', 'direction: [true, 1]', '.direction.joint 1: expected a number, got True'),
        ('robot', 'direction: -1', r'.direction: expected \[joint 1, joint 2\], got -1'),
        ('robot', 'plane: {frame: b, origin: [0, 0, 0], x: [1, 0, 0], y: [0, 2, 0]}', 'length 1, got 1 and 2'),
        ('robot', 'plane: {frame: b, origin: [0, 0, 0], x: [1, 0, 0], y: [0.6, 0.8, 0]}', 'x and y at right angles'),
        ('robot', 'plane: {frame: b, origin: [0, 0], x: [1, 0, 0], y: [0, 1, 0]}', r'origin: expected \[x, y, z\]'),
        ('robot', 'plane: {origin: [0, 0, 0], x: [1, 0, 0], y: [0, 1, 0]}', "the key 'frame' is missing"),
        ('sensor', 'rotation: 90', '.rotation: expected -6.3 to 6.3 rad, got 90; it is in rad'),
        ('sensor', 'axes: {x: [1, 0, 0], y: [0, 0, 1]}', 'those of link 2 in the sensor; set frame to tool'),
    ],
)
def test_a_wrong_key_is_one_line(part: str, line: str, words: str) -> None:
    text = dump_cell(PAPER_CELL).replace(f'{part}:\n', f'{part}:\n  {line}\n')
    with pytest.raises(CellError, match=rf'{part}.*{words}') as caught:
        parse_cell(text)
    assert '\n' not in str(caught.value)

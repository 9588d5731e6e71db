"""Where the plane of the arm lies in the frame of the robot.

The model is planar. A robot publishes poses and hears them in a frame of its own: a place (x, y) of the model is
origin + x e_x + y e_y there, and the angles count about e_x × e_y. Without a stated plane both are the same.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats

BASE_FRAME = 'base_link'
"""Frame in which the objects are given, where no plane is stated."""


class Plane(NamedTuple):
    """The plane of the arm.

    Attributes:
        frame: name of the robot's frame.
        origin: of the plane in it, m.
        x: its x axis there, a unit vector.
        y: its y axis there, a unit vector.
        tip: link of the robot that carries the tip; empty where it is not stated.
    """

    frame: str = BASE_FRAME
    origin: tuple[float, ...] = (0.0, 0.0, 0.0)
    x: tuple[float, ...] = (1.0, 0.0, 0.0)
    y: tuple[float, ...] = (0.0, 1.0, 0.0)
    tip: str = ''

    @property
    def is_stated(self) -> bool:
        """Whether it is another one than the usual."""
        return self != Plane()

    @property
    def axes(self) -> Floats:
        """The rotation of the plane in the robot's frame: its axes x, y and normal as columns, (3, 3)."""
        return np.stack([self.x, self.y, np.cross(self.x, self.y)], axis=1)

    def in_robot(self, places: Floats) -> Floats:
        """Places in the plane, (…, 2), or with a height above it, (…, 3), in the robot's frame, (…, 3), m."""
        return np.asarray(self.origin + places @ self.axes.T[: places.shape[-1]])

    def in_plane(self, places: Floats) -> Floats:
        """The inverse: x, y and height of places in the robot's frame, (…, 3), m."""
        return np.asarray((places - np.array(self.origin)) @ self.axes)

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """X, y, z and w of its rotation."""
        return _quaternion(self)


@lru_cache(maxsize=16)
def _quaternion(plane: Plane) -> tuple[float, float, float, float]:
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(plane.axes).as_quat().tolist()
    return x, y, z, w


def axes_problem(x: tuple[float, ...], y: tuple[float, ...]) -> str:
    """Why two vectors are not the axes of a plane; empty where they are."""
    lengths, product = np.linalg.norm([x, y], axis=1), float(np.dot(x, y))
    if not np.allclose(lengths, 1.0, rtol=0, atol=1e-6):
        return f'expected x and y of length 1, got {lengths[0]:.6g} and {lengths[1]:.6g}'
    return '' if abs(product) < 1e-6 else f'expected x and y at right angles, got a product of {product:.3g}'

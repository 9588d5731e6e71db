"""One pose of an arm under load in plain floats: the equations of `loading` and `equilibrium` for `online`."""

from __future__ import annotations

from math import cos, hypot, sin
from typing import NamedTuple

from scara_kinetostatic.compensation.loading import SIGN_KNOWN, STEEPEST
from scara_kinetostatic.model.parameters import Parameters


class HeldForce(NamedTuple):
    """The measured force, and the one that the dead bands follow."""

    x: float
    y: float
    size: float
    std: float
    held_x: float
    held_y: float
    place: float
    nx: float
    ny: float


class PoseLoad(NamedTuple):
    """As `Loading`, of one pose."""

    x1: float
    y1: float
    x2: float
    y2: float
    c1: float
    c2: float
    s1: float
    s2: float
    k1: float
    k2: float


class InverseRows(NamedTuple):
    """M⁻¹."""

    i11: float
    i12: float
    i21: float
    i22: float


def load_at(p: Parameters, first: float, second: float, force: HeldForce) -> PoseLoad:
    """The torques of a pose, and its places in the dead bands.

    Args:
        p: the parameters.
        first: angle of link 1, rad.
        second: of link 2.
        force: on the object.
    """
    x1, y1, x2, y2 = p.l1 * cos(first), p.l1 * sin(first), p.l2 * cos(second), p.l2 * sin(second)
    c2 = x2 * force.y - y2 * force.x
    h2 = x2 * force.held_y - y2 * force.held_x
    h1 = x1 * force.held_y - y1 * force.held_x + h2
    own, known = STEEPEST * (p.l1 + p.l2) * force.size, SIGN_KNOWN * force.std
    b1, b2 = known * hypot(x1 + x2, y1 + y2) + abs(p.g1) * own, known * p.l2 + abs(p.g2) * own
    k1, k2 = p.p1 + (p.g1 / b1 if -b1 < h1 < b1 else 0.0), p.p2 + (p.g2 / b2 if -b2 < h2 < b2 else 0.0)
    s1, s2 = min(max(h1 / b1, -1.0), 1.0), min(max(h2 / b2, -1.0), 1.0)
    return PoseLoad(x1, y1, x2, y2, x1 * force.y - y1 * force.x + c2, c2, s1, s2, k1, k2)


def turned(load: PoseLoad, first: float, second: float) -> PoseLoad:
    """The arm with its links turned by tiny angles, rad."""
    x1, y1, x2, y2 = load[:4]
    return load._replace(x1=x1 - y1 * first, y1=y1 + x1 * first, x2=x2 - y2 * second, y2=y2 + x2 * second)


def inverse_rows(load: PoseLoad, force: HeldForce) -> InverseRows:
    """M⁻¹, as `equilibrium.inverse_of_rows`."""
    c22 = -(force.x * load.x2 + force.y * load.y2)
    c11 = c22 - (force.x * load.x1 + force.y * load.y1)
    m11, m12, m21, m22 = 1.0 + load.k1 * c11, load.k1 * c22, load.k2 * c22, 1.0 + load.k2 * c22
    scale = 1.0 / (m11 * m22 - m12 * m21)
    return InverseRows(m22 * scale, -m12 * scale, -m21 * scale, m11 * scale)

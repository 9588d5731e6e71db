"""Association: the disc that a touch belongs to and the elbow posture, by the nominal model.

A frictionless force F on disc d puts the tip at c_d - r_d F/|F|. The nominal tip
H(L_n, Q) misses that place by

    m_d = H(L_n, Q) - (c_d - r_d F/|F|).

The disc with the smallest |m_d| is the touched one. The nominal geometry may be wrong by 20 mm and 3°, so that misses
of some centimetres are usual. Where there are enough touches, the model is first fitted to them, coarsely and robustly
(`assessment.mistakes`); the remaining misses distinguish a known disc from an unknown object.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.assessment.mistakes import coarse_parameters
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.kinematics import forward, posture, quarter_turn
from scara_kinetostatic.model.outline import PER_ANGLE
from scara_kinetostatic.model.parameters import Parameters


class Settings:
    """What belongs to a disc.

    Attributes:
        largest_miss_nominal: a touch belongs to a disc if its miss with the nominal geometry is at most this, m.
        largest_miss_fitted: the same with the fitted model, m; or `miss_medians` times the median miss, where
            that is more.
        miss_medians: see there.
        fewest_for_fit: touches needed for the fit.
        inner_corner: a rejected touch at most so far from both edges of an inner corner is taken for one of both, m.
        largest_friction_angle: accepted angle between the force and the normal of the disc (friction, noise), rad.
    """

    largest_miss_nominal: float = 0.08
    largest_miss_fitted: float = 0.03
    miss_medians: float = 6.0
    fewest_for_fit: int = 8
    inner_corner: float = 0.01
    largest_friction_angle: float = 0.35


class Association(NamedTuple):
    """Discs and postures of n touches.

    Attributes:
        disc: index of the nearest disc, (n,).
        posture: +1 or -1, (n,).
        miss: |m| of that disc, less what an oblique force explains (`Settings.largest_friction_angle`), (n,), m.
        known: whether the touch belongs to the disc, (n,).
        both: whether it is in an inner corner, into which the tip does not reach, (n,).
    """

    disc: Indices
    posture: Indices
    miss: Floats
    known: Mask
    both: Mask

    def reason(self, number: int, cell: Cell) -> str:
        """Why a touch that is not known is rejected."""
        nearest = cell.discs[int(self.disc[number])].name
        if self.both[number]:
            return f'in an inner corner of {nearest!r} the tip touches both edges: touch it farther from the corner'
        return f'no object there; the nearest, {nearest!r}, is {1e3 * self.miss[number]:.0f} mm away'


def associate(joints: Floats, force: Floats, cell: Cell) -> Association:
    """Discs and postures of n touches.

    Args:
        joints: Q, (n, 2), rad.
        force: F on the object, in the frame of the sensor, (n, 2), N.
        cell: nominal parameters, discs, frame of the sensor.
    """
    fitted, used = coarse_parameters(joints, force, cell), cell.nominal
    disc, miss = _nearest_disc(cell.nominal, joints, force, cell)
    known = miss <= Settings.largest_miss_nominal
    fitted_disc, fitted_miss = _nearest_disc(fitted, joints, force, cell)
    close = fitted_miss <= Settings.largest_miss_fitted
    if np.sum(close) >= max(Settings.fewest_for_fit, len(joints) / 2):
        disc, miss, used = fitted_disc, fitted_miss, fitted
        known = miss <= max(Settings.largest_miss_fitted, Settings.miss_medians * float(np.median(miss)))
    both = cell.surfaces.touch_both(forward(used, joints), Settings.inner_corner)
    return Association(disc, posture(cell.nominal, joints), miss, known, both)


def _misses(parameters: Parameters, joints: Floats, force: Floats, cell: Cell) -> tuple[Floats, Floats]:
    """m_d of every touch and disc, (n, m, 2), m, and F/|F| in the base frame, (n, 2)."""
    force = cell.sensor.frame.to_base(force, joints, parameters)
    unit = force / np.maximum(np.linalg.norm(force, axis=1), 1e-300)[:, None]
    if cell.has_outlines:
        return cell.surfaces.misses(forward(parameters, joints), unit, PER_ANGLE), unit
    place = cell.centers[None] - cell.radii[None, :, None] * unit[:, None]
    return forward(parameters, joints)[:, None] - place, unit


def _nearest_disc(parameters: Parameters, joints: Floats, force: Floats, cell: Cell) -> tuple[Indices, Floats]:
    """The disc with the smallest miss, (n,), and that miss less what an oblique force explains, (n,), m."""
    misses, unit = _misses(parameters, joints, force, cell)
    surface = np.argmin(np.linalg.norm(misses, axis=2), axis=1)
    miss = misses[np.arange(len(surface)), surface]
    radial = np.sum(miss * unit, axis=1)
    tangential = np.abs(np.sum(miss * quarter_turn(unit), axis=1))
    lever = np.where(cell.surfaces.halves < np.pi, PER_ANGLE, cell.surfaces.radii)[surface]
    miss = np.hypot(radial, np.maximum(tangential - Settings.largest_friction_angle * lever, 0.0))
    return cell.surfaces.object[surface], miss

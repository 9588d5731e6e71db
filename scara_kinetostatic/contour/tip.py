"""The centre of the tip in contact, by H̄ of a calibrated arm, with what its place depends on."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arm import CalibratedArm, Predictor, force_on_object
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Sensor, SensorSign
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.kinematics import posture
from scara_kinetostatic.model.online import motion_senses
from scara_kinetostatic.model.tip import (
    Force,
    Jacobian,
    Spread,
    band_covariance,
    by_noise,
    measurement_covariance,
    tip_derivative,
    tip_under_load,
    with_dead_bands,
)


def measured_force(arm: CalibratedArm, sensor: Sensor, joints: Floats, reported: Floats) -> Floats:
    """F on the object in the base frame, (n, 2), N, from what the sensor reports less its zero.

    Args:
        arm: with the errors of the sensor that were found.
        sensor: its frame and sign.
        joints: Q, (n, 2), rad.
        reported: (n, 2), N.
    """
    turned = -reported if sensor.sign is SensorSign.ON_ROBOT else reported
    arm = replace(arm, cell=replace(arm.cell, sensor=sensor))
    return force_on_object(arm, turned, joints, metadata_of(arm, joints))


def metadata_of(arm: CalibratedArm, joints: Floats) -> TouchMetadata:
    """What is known of poses that follow each other besides Q and F: posture and motion; they are after all touches.

    A model that changes with time is taken as at the end of the calibration, `Predictor.assumptions`.
    """
    plain = TouchMetadata.plain(len(joints))._replace(posture=posture(arm.model.parameters, joints))
    predictor = Predictor(arm)
    if predictor.depends_on_time:
        plain = plain._replace(time=np.full(len(joints), arm.used.duration))
    return plain._replace(approach=motion_senses(joints)) if predictor.effects_of('approach') else plain


class TipPlaces(NamedTuple):
    """Centre of the tip in n poses under load.

    Attributes:
        center: S, (n, 2), m; NaN where it was not found.
        by_model: ∂S/∂(values of the model), (n, 2, 12 + k).
        systematic: covariance of S by the calibration, (n, 2, 2), m²; NaN where the data do not determine it, or a
            joint is in a dead band of undetermined size.
        noise: covariance by the noise of joint angles and force and by the place of joints in their dead bands,
            (n, 2, 2), m².
        by_noise: change by one standard deviation of the noise of q1, q2, F_x and F_y, (n, 2, 4), m.
    """

    center: Floats
    by_model: Floats
    systematic: Floats
    noise: Floats
    by_noise: Floats


def tip_places(arm: CalibratedArm, joints: Floats, force: Floats, force_noise: float = 0.0) -> TipPlaces:
    """S with its uncertainty for the calibrated model.

    Args:
        arm: the calibrated arm.
        joints: Q, (n, 2), rad.
        force: F on the object, base frame, (n, 2), N.
        force_noise: standard deviation of a component of the force besides the noise of a touch, N.
    """
    first, second = np.hypot(arm.noise.force_levels, force_noise).tolist()
    arm = replace(arm, noise=arm.noise._replace(force=(first, second)))
    law, f = Predictor(arm).law, Force.of(force, arm.noise)
    found = tip_under_load(law, joints, f, metadata_of(arm, joints))
    jacobian = Jacobian.at(found, f)
    by_model = tip_derivative(law, found, f, jacobian)
    spread = Spread.of(arm.covariance, arm.undetermined)
    gaps = spread.gaps(law.model.parameters)
    noise = measurement_covariance(law, found, f, jacobian).plus(band_covariance(gaps, found, f, jacobian))
    systematic = spread.tip(by_model)
    known = np.isfinite(with_dead_bands(systematic, spread, law, found, f).xx)
    covariance = np.where(known[:, None, None], systematic.matrices, np.nan)
    loadings = by_noise(law, found, f, jacobian)
    return TipPlaces(found.tip, by_model.transpose(2, 1, 0), covariance, noise.matrices, loadings)

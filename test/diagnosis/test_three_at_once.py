"""A displaced disc, friction of either sense and a wave of the transmission, all at once."""

from __future__ import annotations

import numpy as np
from diagnosis.simulated import CELL, NOISE, calibrate, deviations, diagnose, effect, simulate

from scara_kinetostatic.effects.contact_friction import OffNormalForce
from scara_kinetostatic.model.contact import contact
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL

DISC, WAVE = (effect('object_position[disc_2]'), (2e-4, 1e-4)), (effect('transmission_error[joint2]'), (2e-4, 2.0, 7.3))


def test_all_three_are_named():
    """The other two hide the friction in the base model; it shows in the fit with them."""
    touches, random = simulate(DISC, WAVE, seed=0), np.random.default_rng(0)
    robot = ExtendedModel(PAPER_ACTUAL, (DISC[0], WAVE[0], OffNormalForce()), (DISC[1], WAVE[1], ()))
    turned = contact(
        robot,
        touches.joints,
        CELL.centers[touches.disc],
        CELL.radii[touches.disc],
        CELL.gripper,
        warm_start=touches.force,
        metadata=TouchMetadata.of(touches),
        off_normal=0.04 * random.standard_normal(len(touches)),
    )
    noisy = touches.replace(force=turned.force + NOISE.force_rms * random.standard_normal(touches.force.shape))
    found = diagnose(calibrate(noisy.select(turned.solved), CELL))
    assert found.verdict == 'explained'
    assert {item.effect.label for item in found.found} == {'contact_friction', DISC[0].label, WAVE[0].label}
    assert found.extended is not None
    assert np.abs(deviations(found.extended)).max() < 4

"""The frequency of a wave: where others fit equally well, the standard deviations cover them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from diagnosis.simulated import CELL, calibrate, deviations, effect, examined, simulate

from scara_kinetostatic.diagnosis.alternatives import cover_alternatives
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.diagnosis.refit import Effort
from scara_kinetostatic.effects.base import JointEffect
from scara_kinetostatic.effects.contact_friction import OffNormalForce
from scara_kinetostatic.model.effect_law import Parameter
from scara_kinetostatic.model.extended_model import ExtendedModel

WAVE = 'transmission_error[joint2]'


@pytest.mark.parametrize('phase', [0.4, 2.6])
def test_a_slow_wave_that_looks_like_one_of_twice_the_frequency(phase):
    fit, found = examined(WAVE, (1.6e-4, phase, 1.5), seed=7)
    assert found.extended is not None
    assert [item.effect.label for item in found.found if item.in_every_model] == [WAVE]
    _, _, cycles = found.found[0].values
    assert abs(cycles.value - 1.5) < 2 * cycles.std
    assert np.abs(deviations(fit)).max() > 20
    assert np.abs(deviations(found.extended)).max() < 4
    assert f'{WAVE} fits equally well with' in found.advice


def test_one_frequency_alone_keeps_its_standard_deviation():
    _, found = examined(WAVE, (8e-5, 0.4, 31.0))
    assert found.extended is not None
    assert cover_alternatives(found.extended, [], [item.effect.label for item in found.found], Effort())[1] == []
    _, _, cycles = found.found[0].values
    assert abs(cycles.value - 31.0) < 4 * cycles.std
    assert cycles.std < 0.1
    assert 'fits equally well with' not in found.advice


def test_without_a_wave_there_is_nothing_to_fit():
    _, found = examined('encoder_gain[joint2]', (8e-5,))
    assert found.extended is not None
    assert cover_alternatives(found.extended, [], [item.effect.label for item in found.found], Effort())[1] == []


@dataclass(frozen=True)
class Cable(JointEffect):
    """A spring across the elbow whose force grows with the square of the angle."""

    name: ClassVar[str] = 'cable'
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter('k', 'Nm/rad^2', 1.0, 'torque on joint 2'),)
    statement: ClassVar[str] = 'a cable pulls at joint 2'
    confounded_with: ClassVar[str] = 'the gain of the encoder'
    identified_by: ClassVar[str] = 'the whole range of the joint'
    plot_variable: ClassVar[str] = 'angle'

    def angles(self, at):
        return (at.parameters.p2 * (at.joints[:, 1] - 0.3) ** 2,)


@pytest.mark.parametrize('stiffness', [-1.8, 3.5])
def test_a_cable_is_never_identified_as_a_wave(stiffness):
    fit = calibrate(simulate((Cable(target='joint2', joint=1), (stiffness,))), CELL)
    found = diagnose(fit)
    assert found.verdict in ('explained', 'ambiguous')
    assert not [item for item in found.found if item.effect.label == WAVE and item.in_every_model]
    assert any(item.effect.label == 'cable_pull[joint2]' for item in found.found)
    assert found.extended is not None
    assert np.abs(deviations(fit)).max() > 10
    assert np.abs(deviations(found.extended)).max() < 4


def test_the_grid_parameter_of_a_wave_is_one_of_its_parameters():
    assert effect(WAVE).grid_parameter in [parameter.name for parameter in effect(WAVE).parameters]


def test_other_frequencies_are_fitted_beside_friction_of_either_sense():
    """Random off-normal angles have no column: they stay as they are while the frequency of the wave is varied."""
    wave, friction = effect(WAVE), OffNormalForce()
    touches = simulate((wave, (8e-5, 0.4, 31.0)))
    start = ExtendedModel(CELL.nominal, (friction, wave), ((), (8e-5, 0.4, 31.0)))
    extended = calibrate(touches, CELL, start=start)
    for other in cover_alternatives(extended, [], [WAVE], Effort())[1]:
        assert other.model.effects == extended.model.effects

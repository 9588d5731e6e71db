"""The law of an effect is not known: the standard deviations cover alternative laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis.simulated import CELL, PLAN, calibrate, deviations, effect

from scara_kinetostatic.diagnosis.alternatives import cover_alternatives, widened_by_constants
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.diagnosis.linear_problem import pose_problem
from scara_kinetostatic.diagnosis.refit import Effort
from scara_kinetostatic.effects.joints import JointHardening
from scara_kinetostatic.effects.objects import ContactCompliance
from scara_kinetostatic.effects.robot import LinkBending
from scara_kinetostatic.effects.unnamed import Unnamed
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import G_EE, P1, P_EE, PAPER_ACTUAL, THETA2
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.streams import simulate_touches


def simulate_law(law: object, *values: float, seed: int = 3) -> TouchSet:
    return simulate_touches(CELL, ExtendedModel(PAPER_ACTUAL, (law,), (values,)), PLAN, CELL.noise, seed)


@pytest.mark.parametrize(('exponent', 'value'), [(0.4, 2e-4), (0.5, 1.2e-4), (0.8, 5e-5)])
def test_a_contact_of_another_law_biases_no_parameter_beyond_its_std(exponent, value):
    fit = calibrate(simulate_law(ContactCompliance(exponent=exponent), value), CELL)
    found = diagnose(fit)
    assert 'contact_compliance' in [item.effect.label for item in found.found]
    assert {label for group in found.rivals for label in group} <= {'contact_compliance', 'sensor_nonlinearity'}
    assert found.extended is not None
    as_hertz = calibrate(fit.touches, CELL, [ContactCompliance()])
    assert np.abs(deviations(as_hertz)[[P_EE, G_EE]]).max() > 4
    assert np.abs(deviations(found.extended)).max() < 4


def test_a_joint_that_softens_with_the_square_of_the_torque():
    fit = calibrate(simulate_law(JointHardening(target='joint1', joint=0, power=2), -1.5e-6), CELL)
    found = diagnose(fit)
    assert [item.effect.label for item in found.found if item.in_every_model] == ['joint_hardening[joint1]']
    assert found.extended is not None
    assert abs(deviations(found.extended)[P1]) < 4


def test_every_law_that_fits_lies_within_a_standard_deviation():
    laws = (effect('contact_compliance'),)
    extended = calibrate(simulate_law(laws[0], 6e-5), CELL, laws)
    wide, _ = cover_alternatives(extended, [], (), Effort())
    for other in laws[0].alternative_laws():
        form = calibrate(extended.touches, CELL, [other])
        off = form.parameters.as_array() - extended.parameters.as_array()
        assert np.all(np.abs(off) <= wide.std * (1 + 1e-6))
    assert wide.std[P_EE] > 5 * extended.std[P_EE]
    assert wide.std[P1] < 1.5 * extended.std[P1]


def test_a_law_that_fits_worse_is_no_alternative():
    laws = (effect('contact_compliance[disc_2]'),)
    extended = calibrate(simulate_law(laws[0], 4e-5), CELL, laws)
    wide, others = cover_alternatives(extended, [], (), Effort())
    assert others == []
    np.testing.assert_array_equal(wide.covariance, extended.covariance)


@pytest.mark.parametrize('hinge', [0.25, 0.5, 0.75])
def test_a_link_that_bends_at_one_place(hinge):
    fit = calibrate(simulate_law(LinkBending(target='link1', hinge=hinge), 2e-4), CELL)
    found = diagnose(fit)
    assert [item.effect.label for item in found.found if item.in_every_model] == ['link_bending[link1]']
    assert found.extended is not None
    as_beam = calibrate(fit.touches, CELL, [effect('link_bending[link1]')])
    assert np.abs(deviations(as_beam)).max() > 4
    assert np.abs(deviations(found.extended)).max() < 4


def test_the_undetermined_constant_of_a_curve_widens_one_parameter():
    kink = Unnamed(None, 'joint2', 'q2', 0.0, 2.0, powers=3)
    extended = calibrate(simulate_law(effect('encoder_gain[joint2]'), 0.0), CELL, [kink])
    rival = replace(extended, model=ExtendedModel(extended.parameters, (kink,), ((3e-4, 0.0, 0.0),)))
    wide = widened_by_constants(extended, [rival])
    slope = kink.functions(pose_problem(rival).touch_state)[0]
    size = 3e-4 * np.sqrt(np.mean(slope**2))
    assert wide.std[THETA2] == pytest.approx(np.hypot(extended.std[THETA2], size))
    others = np.arange(12) != THETA2
    np.testing.assert_array_equal(wide.std[others], extended.std[others])
    assert widened_by_constants(extended, []).std[THETA2] == extended.std[THETA2]

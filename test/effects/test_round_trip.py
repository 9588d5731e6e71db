"""Exact touches of a robot with an effect give it back."""

from __future__ import annotations

import numpy as np
import pytest
from calibration.studies import CELL
from effects.scenes import KINDS, plausible, press
from model.helpers import ROBOTS

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.effects.robot import LinkBending
from scara_kinetostatic.model.extended_model import ExtendedModel

SEEN = [effect for effect in (*KINDS, LinkBending.of(0)) if effect.label != 'link_bending[link2]']


def known_start(effect):
    """Nominal values; of a wave or a slip those that a search over its grid leads to, of a shift its moment."""
    found = {'transmission_error': (8e-5, 0.4, 7.2), 'joint_slip': (8e-6, 2.2), 'load_friction': (8e-6, 0.22)}
    values = found.get(effect.name, effect.start)
    if effect.is_stepwise:
        values = (*values[:-1], effect.typical[-1])
    return ExtendedModel(CELL.nominal, (effect,), (values,))


@pytest.mark.parametrize('effect', SEEN, ids=[effect.label for effect in SEEN])
def test_exact_touches_give_the_effect_and_the_twelve_back(effect):
    robot, is_alias = ROBOTS[SEEN.index(effect) % 2], np.array([p.is_alias for p in effect.parameters])
    values = np.where(is_alias, 0.0, plausible(effect))
    found = calibrate(press(effect, values, robot), CELL, start=known_start(effect))
    assert found.used.all()
    assert found.identifiability.rank == 12 + len(values) - effect.is_stepwise - is_alias.sum()
    np.testing.assert_allclose(found.model.effect_arrays[0], values, rtol=1e-6)
    np.testing.assert_allclose(found.parameters.as_array(), robot.as_array(), rtol=0, atol=1e-9)
    assert found.force_error < 1e-6


def test_bending_of_link_2_is_called_confounded_with_p2():
    effect = LinkBending.of(1)
    found = calibrate(press(effect, plausible(effect)), CELL, [effect])
    assert found.identifiability.rank == 12
    assert found.identifiability.confounded == (('p2', 'link_bending[link2].compliance'),)
    compliance = found.effects[effect.label]['compliance'].value
    assert found['p2'].value + compliance / 3 == pytest.approx(1.1e-5 + 1e-5 / 3, rel=1e-6)
    assert found.force_error < 1e-6

"""The runner at a block: ways round it, contacts with its edges and corners, the result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from running.test_runner import CELL, TRUTH, rehearsal

from scara_kinetostatic.model.cell import Disc, EffectSizes, SizeMode, Uncertainty
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.planning.motion import Space

BLOCK = Outline('block', ((-0.02, 0.30), (0.08, 0.30), (0.08, 0.40), (-0.02, 0.40)), 0.002)
NONE_ELSE = Uncertainty(effects=EffectSizes(SizeMode.NONE))
WITH_BLOCK = replace(
    CELL, discs=(Disc('disc_1', -0.25, 0.30, 0.12), BLOCK), tip_radius=0.005, tolerance=2e-4, uncertainty=NONE_ELSE
)


def test_the_tip_keeps_clear_of_a_block():
    space = Space(WITH_BLOCK, WITH_BLOCK.nominal, 0.012)
    begin = np.array([[0.2, 0.35], [0.2, 0.42], [0.03, 0.35], [0.2, 0.414]])
    end = np.array([[-0.08, 0.35], [-0.08, 0.42], [0.03, 0.36], [-0.08, 0.414]])
    assert space.is_clear(begin, end).tolist() == [False, True, False, False]
    assert space.is_clear(begin[2:3], end[2:3], but=np.array([1]))[0]
    assert space.object_at(np.array([0.03, 0.35])) == 'block'
    assert space.object_at(np.array([0.09, 0.35])) == 'block'
    assert space.object_at(np.array([0.13, 0.35])) == ''


def test_a_run_at_a_block_reaches_its_tolerance():
    one = rehearsal(WITH_BLOCK, rate=125.0)
    one.run()
    end, campaign = one.runner.end, one.runner.campaign
    assert end is not None
    assert (end.status, end.reason.partition(':')[0]) == (0, 'enough')
    assert all(meant == met for meant, met in one.contacts)
    outcome = calibrate_touches(TouchSet.concatenate(campaign.touches), WITH_BLOCK)
    assert outcome.verdict == 'none'
    std = np.array([outcome[name].std for name in NAMES])
    off = np.array([outcome[name].value for name in NAMES]) - TRUTH.as_array()
    assert np.abs(off / std).max() < 4.5

"""What was assumed of undeclared places, and what the nominal values say of the tip."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import scara_kinetostatic as sk
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.uncertainty_budget import assumed_places, nominal_uncertainty
from scara_kinetostatic.model.cell import PAPER_CELL, PAPER_DISCS, ArmClass, Disc, EffectSizes, SizeMode, Uncertainty
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

BARE = replace(PAPER_CELL, discs=PAPER_DISCS)
TWO = (Disc('left', -0.15, 0.22, 0.05), Disc('right', 0.16, 0.25, 0.04))
CELLS = {'paper': BARE, 'small': replace(BARE, nominal=PAPER_NOMINAL.replace(l1=0.25, l2=0.2), discs=TWO)}


@cache
def outcome(name: str, center_std: float = 0.0, sizes: SizeMode = SizeMode.ESTIMATED) -> Outcome:
    """Of the same touches, however well the places of the discs are known."""
    cell = CELLS[name]
    true = PAPER_ACTUAL.replace(l1=cell.nominal.l1 + 2e-4, l2=cell.nominal.l2 - 2e-4)
    touches = simulate_touches(cell, true, default_plan(cell, 8), seed=4)
    discs = tuple(disc._replace(center_std=center_std) for disc in cell.discs)
    return sk.diagnose(touches, replace(cell, discs=discs, uncertainty=Uncertainty(effects=EffectSizes(sizes))))


def contribution(c: Calibration, name: str) -> float:
    """Of undetected errors of places to the standard uncertainty of a parameter, m."""
    (part,) = (part.covariance for part in c.contributions if part.label == 'undetected[object_position]')
    return float(np.sqrt(part[NAMES.index(name), NAMES.index(name)]))


@pytest.mark.parametrize('name', CELLS)
def test_a_displacement_common_to_all_discs_is_in_x0_and_y0(name: str) -> None:
    c = outcome(name, sizes=SizeMode.TYPICAL).final
    common = 1e-5 / len(c.cell.discs) ** 0.5
    for parameter in ('x0', 'y0'):
        assert common < contribution(c, parameter) < 3 * common


@pytest.mark.parametrize('name', CELLS)
@pytest.mark.parametrize('sizes', [SizeMode.TYPICAL, SizeMode.ESTIMATED])
def test_three_times_as_much_is_what_a_fit_with_it_declared_states(name: str, sizes: SizeMode) -> None:
    found = outcome(name, sizes=sizes)
    again = outcome(name, 3e-5, sizes).tip_uncertainty.worst
    assert found.assumed is not None
    assert found.assumed.if_three_times == pytest.approx(again, rel=0.1)
    assert found.assumed.if_three_times > 1.3 * found.tip_uncertainty.worst


def test_what_is_assumed_is_that_of_the_class_of_the_arm() -> None:
    c = outcome('paper').final
    sizes = EffectSizes(arm=ArmClass.DESKTOP)
    desktop = assumed_places(replace(c, cell=replace(BARE, uncertainty=Uncertainty(effects=sizes))))
    industrial = assumed_places(c)
    assert industrial and desktop and (industrial.objects, desktop.objects) == (1e-5, 5e-5)
    assert desktop.if_three_times > industrial.if_three_times
    assert assumed_places(outcome('paper', 3e-6).final) is None


def test_the_nominal_arm_is_as_far_off_as_declared_or_as_it_has_moved() -> None:
    c = outcome('paper').final
    at = outcome('paper').tip_uncertainty.at
    assert at is not None
    moved = nominal_uncertainty(c, at)
    assert 2e-3 < moved < 6e-3
    offsets = dict.fromkeys(NAMES, 1e-9) | {'x0': 1e-3, 'y0': 1e-3}
    known = replace(c, cell=replace(BARE, uncertainty=Uncertainty(nominal=offsets)))
    assert nominal_uncertainty(known, at) == pytest.approx(2e-3, rel=1e-3)
    lengths = replace(c, cell=replace(BARE, uncertainty=Uncertainty(nominal={'l1': 1e-3, 'l2': 1e-3})))
    assert nominal_uncertainty(lengths, at) > np.hypot(2e-3, 1e-3)

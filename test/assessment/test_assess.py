"""What makes a result unfit, what asks for caution, and what does not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from scara_kinetostatic.assessment.evidence import Discrimination, leverages
from scara_kinetostatic.assessment.grade import Assessment, Grade, Remark
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.diagnosis.result import Diagnosis, Found
from scara_kinetostatic.effects.objects import ObjectRadius
from scara_kinetostatic.model.cell import (
    PAPER_CELL,
    PAPER_DISCS,
    Cell,
    Disc,
    EffectSizes,
    Plate,
    Region,
    SizeMode,
    Uncertainty,
)
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.model.quantities import quantity
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.results.document import as_document
from scara_kinetostatic.results.report import html_text, text_report
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

NOISE = PAPER_CELL.noise
BARE = replace(PAPER_CELL, discs=PAPER_DISCS)
PLAN = default_plan(PAPER_CELL, 8)


def touch(plan: Plan = PLAN, cell: Cell = PAPER_CELL, seed: int = 1) -> TouchSet:
    assert NOISE
    return simulate_touches(cell, ExtendedModel(PAPER_ACTUAL), plan, NOISE, seed)


def restated(number: int, **by: float) -> Cell:
    discs = list(PAPER_CELL.discs)
    discs[number] = discs[number]._replace(**{k: getattr(discs[number], k) + v for k, v in by.items()})
    return replace(PAPER_CELL, discs=tuple(discs))


@cache
def good() -> Outcome:
    return calibrate_touches(touch(), PAPER_CELL)


def test_a_good_result_is_fit_and_says_what_it_was_judged_without() -> None:
    found = good().assessment
    assert found.grade is Grade.FIT
    known = quantity(good().tip_uncertainty.worst, 'm')
    assert found.reasons[0].startswith(f'the tip is known to {known} or better (k = 2), from 48 touches, each')
    assert [action.partition(',')[0] for action in found.actions] == [
        'state the accuracy that you need in the cell description'
    ]
    assert found.reasons[-1] == 'the cell description declares no tolerance'
    assert good().assumed is None


def test_what_is_declared_is_not_missing() -> None:
    discs = tuple(disc._replace(center_std=1e-5) for disc in PAPER_CELL.discs)
    found = calibrate_touches(touch(), replace(PAPER_CELL, discs=discs, tolerance=1e-3)).assessment
    assert (found.grade, found.actions) == (Grade.FIT, ())
    assert 'declares' not in ' '.join(found.reasons)


def test_undeclared_places_are_at_most_caution_and_what_was_assumed_comes_first() -> None:
    found = calibrate_touches(touch(), BARE)
    assumed = found.assumed
    assert assumed and assumed.objects == 1e-5 and found.assessment.grade is Grade.CAUTION
    now, then = (quantity(size, 'm') for size in (found.tip_uncertainty.worst, assumed.if_three_times))
    first = 'the places of the objects are not declared: 10 µm are assumed; with three times as much the tip would be '
    assert found.assessment.headline == f'caution: {first}known to {then} instead of {now}'
    assert ' '.join(text_report(found).split()).startswith(f'To be used with caution: {first}')
    assert first in ' '.join(html_text(found).split())
    stated = as_document(found)['tip_uncertainty']['assumed']
    assert stated == {'objects': 1e-5, 'if_three_times': assumed.if_three_times}
    assert 'assumed' not in as_document(good())['tip_uncertainty']
    tolerated = replace(found, calibration=replace(found.calibration, cell=replace(BARE, tolerance=1e-3)))
    assert 'conformity shown for the assumed places of objects' in ' '.join(tolerated.assessment.reasons)


def test_places_that_count_as_exact_are_said_too() -> None:
    cell = replace(BARE, uncertainty=Uncertainty(effects=EffectSizes(SizeMode.NONE)))
    found = calibrate_touches(touch(), cell)
    assert found.assumed == (0.0, found.tip_uncertainty.worst)
    assert found.assessment.headline.startswith(
        'caution: the places of the objects are not declared and count as exact'
    )


@pytest.mark.parametrize(
    ('change', 'undeclared'),
    [
        ({}, ('disc_1', 'disc_2', 'disc_3')),
        ({'discs': (PAPER_CELL.discs[0], *PAPER_DISCS[1:])}, ('disc_2', 'disc_3')),
        ({'discs': tuple(disc._replace(radius_std=1e-6) for disc in PAPER_DISCS)}, ('disc_1', 'disc_2', 'disc_3')),
        (
            {
                'discs': (PAPER_DISCS[0], *(disc._replace(plate='a') for disc in PAPER_DISCS[1:])),
                'plates': (Plate('a', 0.0, 0.3, 1e-5),),
            },
            ('disc_1',),
        ),
        ({'uncertainty': Uncertainty(effects=EffectSizes(stated={'object_position': 0.0}))}, ()),
        (
            {'uncertainty': Uncertainty(effects=EffectSizes(stated={'object_position[disc_2]': 1e-5}))},
            ('disc_1', 'disc_3'),
        ),
    ],
)
def test_a_place_is_declared_by_the_object_its_plate_or_the_effect(change: Any, undeclared: tuple[str, ...]) -> None:
    assert replace(BARE, **change).undeclared_places == undeclared


def test_a_tip_known_less_than_by_the_data_sheet_is_not_fit() -> None:
    uncertainty = Uncertainty(nominal=dict.fromkeys(PAPER_NOMINAL.names, 1e-7))
    cell = replace(PAPER_CELL, nominal=PAPER_ACTUAL, uncertainty=uncertainty)
    found = replace(good(), calibration=replace(good().calibration, cell=cell)).assessment
    assert found.grade is Grade.CAUTION
    assert 'only, by the nominal values, as declared, to ' in found.reasons[0]
    near = replace(PAPER_CELL, nominal=good().calibration.parameters)
    found = replace(good(), calibration=replace(good().calibration, cell=near)).assessment
    assert found.reasons[0].endswith(
        'only, and differs from that of the nominal arm by 0 µm at most: the touches tell less than the data sheet'
    )
    tolerated = replace(good(), calibration=replace(good().calibration, cell=replace(near, tolerance=1e-3)))
    assert tolerated.assessment.grade is Grade.FIT


def test_objects_of_unknown_place_tell_less_than_the_nominal_arm() -> None:
    cell = replace(BARE, discs=tuple(disc._replace(center_std=2e-3) for disc in PAPER_DISCS))
    touches = simulate_touches(BARE, PAPER_NOMINAL.replace(l1=0.3305, x0=4e-4), PLAN, NOISE, seed=3)
    found = calibrate_touches(touches, cell)
    assert found.tip_uncertainty.worst > 2e-3
    assert found.assessment.grade is Grade.CAUTION
    assert found.assessment.reasons[0].endswith('the touches tell less than the data sheet')


def test_eight_touches_check_nothing() -> None:
    some = np.sort(np.random.default_rng(3).choice(len(PLAN), 8, replace=False))
    found = calibrate_touches(touch(PLAN.select(some)), PAPER_CELL).assessment
    assert found.grade is Grade.UNFIT
    reasons = ' '.join(found.reasons)
    assert 'touches that the fit has not seen are predicted with' in reasons
    assert '8 of 8 touches are not checked by the others' in reasons
    assert found.actions[0].startswith('record more touches')


def test_one_force_level_and_one_posture_are_an_extrapolation() -> None:
    found = calibrate_touches(touch(default_plan(PAPER_CELL, 8, levels=(40.0,))), PAPER_CELL).assessment
    assert found.grade is Grade.CAUTION
    assert found.reasons[0].startswith('the touches do not determine p_ee, g_ee each by itself')
    found = calibrate_touches(touch(default_plan(PAPER_CELL, 16, postures=(1,))), PAPER_CELL).assessment
    assert found.grade is Grade.CAUTION
    assert 'with the elbow right the result is an extrapolation' in found.reasons[0]


def test_only_poses_within_the_limits_count() -> None:
    cell = replace(PAPER_CELL, region=Region(-0.35, 0.35, 0.2, 0.55), limits=((-0.5, 2.0), (-2.2, 2.2)))
    plan = default_plan(cell, 30)
    found = calibrate_touches(touch(plan.select(plan.posture < 0), cell), cell).assessment
    assert any('and 7' in text and '% of the places of the region that the arm can' in text for text in found.reasons)
    other = replace(cell, limits=((-0.5, 2.0), (0.0, 2.2)))
    found = calibrate_touches(touch(default_plan(other, 30), other), other).assessment
    assert not any('elbow' in text for text in (*found.reasons, *found.actions))


def test_touches_that_would_not_help_are_not_advised() -> None:
    effects = [ObjectRadius.of(0, 'disc_1'), ObjectRadius.of(1, 'disc_2')]
    rivals = (tuple(effect.label for effect in effects),)
    d = Diagnosis('ambiguous', 1e-9, tuple(Found(effect, (), False) for effect in effects), rivals)
    odds = (((effects[0].label,), 0.97), ((effects[1].label,), 0.03))
    outlook = Discrimination(odds, ('disc_1 at 30°, left, 20 N',) * 12, 0.97, 0.999, 200, 1.0, ())
    actions = replace(good(), diagnosis=d, discriminate=lambda _: outlook).assessment.actions
    decides = 'to tell the causes apart, make the touches of `next --goal decide`: 12 touches: 97 → 99.9 %'
    assert actions[0] == decides
    outlook = outlook._replace(expected=0.971, limit=0.98, remedies=('measure the radius of disc_1 to 5.0 µm',))
    actions = replace(good(), diagnosis=d, discriminate=lambda _: outlook).assessment.actions
    assert actions[0].startswith('to tell the causes apart, measure the radius of disc_1 to 5.0 µm; touches hardly')
    assert '12 touches: 97 → 97 %, 200 end at 98 %' in actions[0]
    assert outlook.causes == 'radius of disc_1 (97 %) or radius of disc_2 (3 %)'


def test_one_disc_does_not_tell_where_the_tip_is() -> None:
    cell = replace(PAPER_CELL, discs=PAPER_CELL.discs[:1])
    found = calibrate_touches(touch(default_plan(cell, 16), cell), cell).assessment
    assert found.grade is Grade.UNFIT
    assert 'nor where the tip is' in found.reasons[0]


def test_touches_rejected_in_a_row_are_beyond_chance() -> None:
    used = np.ones(48, dtype=bool)
    used[20:25] = False
    found = replace(good(), calibration=replace(good().calibration, used=used)).assessment
    assert found.grade is Grade.CAUTION
    assert '5 of 5 rejected touches are touch 20 to 24' in found.reasons[0]
    used = np.roll(used, 23)
    found = replace(good(), calibration=replace(good().calibration, used=used)).assessment
    assert found.grade is Grade.UNFIT
    assert 'the result is that of before' in found.reasons[0]
    used = np.arange(48) % 7 != 0
    found = replace(good(), calibration=replace(good().calibration, used=used)).assessment
    assert found.reasons[0].startswith(
        '7 of 48 touches disagree with the others and are not used; so many are rarely single'
    )
    assert not any('?' in line for line in (*found.reasons, *found.actions))


def test_a_leverage_is_what_a_touch_moves_its_own_prediction() -> None:
    c = calibrate(touch(), BARE)
    found = leverages(c)
    assert found.shape == (48,)
    assert np.all((found > 0) & (found < 1))
    declared = replace(BARE, discs=tuple(disc._replace(center_std=1e-9) for disc in BARE.discs))
    np.testing.assert_allclose(leverages(calibrate(touch(), declared)), found, rtol=1e-3)


def test_the_gravest_reason_comes_first() -> None:
    remarks = [Remark(Grade.CAUTION, 'b', 'x'), Remark(Grade.UNFIT, 'a', 'y'), Remark(Grade.FIT, 'c', 'x')]
    found = Assessment.of(remarks, ['note'])
    assert (found.grade, found.reasons, found.actions) == (Grade.UNFIT, ('a', 'b', 'c', 'note'), ('y', 'x'))
    assert found.headline == 'unfit: a'


def test_touches_close_together_are_an_extrapolation() -> None:
    cell = replace(PAPER_CELL, discs=(Disc('a', 0.30, 0.30, 0.03), Disc('b', 0.38, 0.30, 0.03)))
    reasons = calibrate_touches(touch(default_plan(cell, 18), cell), cell).assessment.reasons
    assert any('the touches cover a small part of the workspace' in reason for reason in reasons)

"""The tip's expanded uncertainty against a tolerance, and what is advised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import scara_kinetostatic as sk
from scara_kinetostatic.assessment.evidence import Conformity, Decision, conformity
from scara_kinetostatic.assessment.grade import advice
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.observations import RIVALS
from scara_kinetostatic.calibration.result import Calibration, Contribution
from scara_kinetostatic.calibration.tip_uncertainty import tip_uncertainty
from scara_kinetostatic.calibration.uncertainty_budget import Item
from scara_kinetostatic.diagnosis.result import Found
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.model.cell import PAPER_CELL as PAPER
from scara_kinetostatic.model.cell import PAPER_DISCS, EffectSizes, SizeMode, Uncertainty
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.results.report import numbers, text_report

PAPER_CELL = replace(PAPER, discs=PAPER_DISCS, uncertainty=Uncertainty(effects=EffectSizes(SizeMode.NONE)))
CELL = replace(PAPER_CELL, discs=tuple(disc._replace(center_std=1.5e-5) for disc in PAPER_CELL.discs))


@pytest.fixture(scope='module')
def outcome() -> Outcome:
    return calibrate_touches(sk.simulate(CELL, PAPER_ACTUAL, seed=2), CELL)


@pytest.fixture(scope='module')
def estimated() -> Calibration:
    cell = replace(PAPER_CELL, noise=None)
    return calibrate(sk.simulate(cell, PAPER_ACTUAL, seed=2), cell)


def with_tolerance(outcome: Outcome, tolerance: float) -> Outcome:
    c = outcome.final
    return replace(outcome, calibration=replace(c, cell=replace(c.cell, tolerance=tolerance)))


def test_limits_that_leave_little_are_a_note(outcome: Outcome) -> None:
    c = outcome.final
    cell = replace(c.cell, limits=((0.4, 0.8), (0.6, 1.1)))
    found = replace(outcome, calibration=replace(c, cell=cell)).assessment
    said = '% of the workspace within reach: the uncertainty of the tip is that of these places'
    assert 'robot.limits leave 1 %' in found.reasons[-1] and found.reasons[-1].endswith(said)
    assert not any('robot.limits' in reason for reason in outcome.assessment.reasons)


def test_a_tolerance_that_is_kept_everywhere_is_fit(outcome: Outcome) -> None:
    found = with_tolerance(outcome, 1.01 * outcome.tip_uncertainty.worst)
    assert found.assessment.grade.value == 'fit'
    assert 'conformity shown (ISO 14253-1)' in ' '.join(found.assessment.reasons)


def test_conformity_is_not_stated_beside_a_model_error_of_unknown_cause(outcome: Outcome) -> None:
    kept = with_tolerance(outcome, 1.01 * outcome.tip_uncertainty.worst)
    found = replace(kept, diagnosis=replace(kept.diagnosis, verdict='unexplained'))
    reasons = ' '.join(found.assessment.reasons)
    assert 'conformity cannot be stated: the cause of a model error is unknown' in reasons
    assert 'cannot be stated' in numbers(found)[1].remark
    assert numbers(kept)[1].remark.endswith('conformity shown (ISO 14253-1)')


def test_without_declared_uncertainties_noise_alone_conforms() -> None:
    found = calibrate_touches(sk.simulate(PAPER_CELL, PAPER_ACTUAL, seed=2), replace(PAPER_CELL, tolerance=1e-3))
    reasons = ' '.join(found.assessment.reasons)
    assert 'conformity shown as far as noise goes: no uncertainties of discs and sensor are declared' in reasons
    assert 'ISO 14253-1' not in reasons
    assert 'as far as noise goes' in numbers(found)[1].remark


def test_residuals_above_the_stated_noise_make_the_uncertainty_a_range(outcome: Outcome) -> None:
    tip = outcome.tip_uncertainty
    at_limit = with_tolerance(outcome, tip.worst)
    c = at_limit.calibration
    larger = replace(c, chi_square=1.5 * c.degrees_of_freedom)
    reasons = replace(at_limit, calibration=larger).assessment.reasons
    assert any('is too near to decide' in reason for reason in reasons)


def test_beyond_only_far_from_the_touches_is_caution(outcome: Outcome) -> None:
    tip = outcome.tip_uncertainty
    assert tip.worst_touched < tip.median < tip.worst
    found = with_tolerance(outcome, 1.05 * tip.median)
    assert found.assessment.grade.value == 'caution'
    assert 'wherever the joint angles are between those of the touches' in found.assessment.reasons[0]


def test_beyond_between_the_touches_is_unfit(outcome: Outcome) -> None:
    found = with_tolerance(outcome, 0.9 * outcome.tip_uncertainty.worst_touched)
    assert found.assessment.grade.value == 'unfit'
    assert found.assessment.actions[0].startswith('determine the place of disc_1')


def test_where_credible_models_dominate_they_are_to_be_told_apart(outcome: Outcome) -> None:
    c = outcome.final
    scatter = Contribution(RIVALS, None, '', 10 * c.covariance)
    wide = c.changed(added=(*c.added, scatter))
    found = with_tolerance(replace(outcome, calibration=wide), outcome.tip_uncertainty.worst)
    assert found.assessment.actions[0].startswith('tell the possible causes apart')


def test_an_estimated_noise_has_a_guard_band_and_a_stated_one_none(outcome: Outcome, estimated: Calibration) -> None:
    found, worst = conformity_at(outcome.final, 1e-4), outcome.tip_uncertainty.worst
    assert found.low == pytest.approx(worst) == pytest.approx(found.high)
    worst = tip_uncertainty(estimated).worst
    found = conformity_at(estimated, worst)
    assert found.decision is Decision.UNDECIDED
    # 90 % of chi-square with 132 degrees of freedom is between 106.3 and 159.8
    assert (found.low / worst, found.high / worst) == pytest.approx((0.909, 1.114), abs=2e-3)
    assert conformity_at(estimated, 1.12 * worst).decision is Decision.CONFORMS
    assert conformity_at(estimated, 0.9 * worst).decision is Decision.DOES_NOT_CONFORM


def conformity_at(c: Calibration, tolerance: float) -> Conformity:
    c = replace(c, cell=replace(c.cell, tolerance=tolerance))
    found = conformity(c, tip_uncertainty(c))
    assert found is not None
    return found


def test_the_text_says_what_dominates_and_what_would_help(outcome: Outcome) -> None:
    text = ' '.join(text_report(outcome).split())
    assert 'Largest contribution there: place of disc_' in text
    assert 'To reduce it: determine the place of disc_1, disc_2, disc_3 more accurately' in text


@pytest.mark.parametrize(
    ('labels', 'text'),
    [
        (('object_position[disc_2]',), 'determine the place of disc_2 more accurately'),
        (('object_radius[a]', 'object_radius[b]'), 'determine the radius of a, b more accurately'),
        (('force_gain',), 'determine the gain of the force sensor more accurately'),
        (('nominal[l1]',), 'determine the nominal value of l1 more accurately'),
        (('undetected[base_tilt]',), 'record more touches'),
        (('undetected[assumed_places]',), 'measure the places of the objects and declare'),
        (('value[joint_slip[joint1].slip_torque]',), 'record recorded touches, preloaded and partly unloaded'),
    ],
)
def test_what_to_do_is_about_the_kind_that_contributes_most(outcome: Outcome, labels: list[str], text: str) -> None:
    effect = Found(find(CELL, 'joint_slip[joint1]'), (), True)
    found = replace(outcome, diagnosis=replace(outcome.diagnosis, found=(effect,)))
    small, one = Item('noise', None, '', np.zeros(12), 1.1e-5), Item('', 1e-5, 'm', np.zeros(12), 1e-5)
    size = one.tip if len(labels) > 1 else 2 * one.tip
    vars(found)['budget'] = (small, *(one._replace(label=label, tip=size) for label in labels))
    assert advice(found).startswith(text)

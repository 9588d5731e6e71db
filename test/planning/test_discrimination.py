"""The touches that decide between sets of effects, what is foreseen of them, and what decides where none do."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from diagnosis.simulated import CELL, NOISE, effect

from scara_kinetostatic.diagnosis.search import FOUND
from scara_kinetostatic.files.calibration_file import nominal_arm
from scara_kinetostatic.model.extended_model import ExtendedModel, TouchMetadata
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.planning.candidate_touches import choose
from scara_kinetostatic.planning.discrimination import Rivals
from scara_kinetostatic.planning.next_touches import Planner
from scara_kinetostatic.planning.prediction import RobotModel, exact_plan
from scara_kinetostatic.results.report import html_text, text_report
from scara_kinetostatic.running.campaign import calibrated
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

LIMITED = replace(CELL, limits=((-2.6, 2.6), (-2.6, 2.6)))
KNOWN = replace(LIMITED, noise=NOISE, discs=tuple(d._replace(center_std=3e-6, radius_std=2e-6) for d in CELL.discs))


def outcome_of(cell, label, values, plan, seed):
    truth = ExtendedModel(PAPER_ACTUAL, (effect(label),), (values,))
    return calibrate_touches(simulate_touches(cell, truth, plan, NOISE, seed), cell)


@pytest.fixture(scope='module')
def gain():
    """One posture: a gain of an encoder is like a transmission error."""
    plan = default_plan(LIMITED, per_disc=12, preload=0.3, postures=(1,))
    return outcome_of(LIMITED, 'encoder_gain[joint1]', (4e-4,), plan, 3)


@pytest.fixture(scope='module')
def displaced():
    """Discs alone: one of them displaced is nearly another one and the base."""
    return outcome_of(KNOWN, 'object_position[disc_2]', (9e-5, -6e-5), default_plan(KNOWN, per_disc=5), 1)


@pytest.fixture
def normal():
    """Three sets of five values, without a robot."""
    random = np.random.default_rng(1)
    roots = random.normal(size=(3, 5, 5))
    probability, change = np.array([0.6, 0.3, 0.1]), random.normal(size=(3, 5))
    return Rivals(RobotModel.of(CELL), (('a',), ('b',), ()), probability, 1.0, change, roots @ roots.swapaxes(1, 2))


def bound(rivals, rows):
    """Sum of the Bhattacharyya coefficients of all touches together."""
    h, total = rows.reshape(-1, rows.shape[-1]), 0.0
    every = h @ rivals.covariance @ h.T + np.eye(len(h))
    for i, j in combinations(range(len(every)), 2):
        both, off = (every[i] + every[j]) / 2, h @ (rivals.change[j] - rivals.change[i])
        logs = [np.linalg.slogdet(one)[1] for one in (both, every[i], every[j])]
        distance = off @ np.linalg.solve(both, off) / 8 + (logs[0] - (logs[1] + logs[2]) / 2) / 2
        total += np.sqrt(rivals.probability[i] * rivals.probability[j]) * np.exp(-distance)
    return total


def test_each_touch_lowers_the_bound_of_all_together_most(normal):
    rows = 0.3 * np.random.default_rng(2).normal(size=(12, 2, 5))
    chosen = normal.choose(rows, 4)
    for number in range(4):
        others = [k for k in range(12) if k not in chosen[:number]]
        bounds = [bound(normal, rows[[*chosen[:number], k]]) for k in others]
        assert others[int(np.argmin(bounds))] == chosen[number]
    assert sorted(normal.choose(rows, 99)) == list(range(12))


def test_the_forecast_goes_from_what_is_known_to_certainty(normal):
    rows = np.random.default_rng(3).normal(size=(4, 5))
    assert normal.forecast(0.0 * rows) == (pytest.approx(0.6), 0.0)
    same = normal._replace(covariance=normal.covariance[:1].repeat(3, axis=0))
    outlook = [
        same.forecast(np.linalg.cholesky(np.linalg.inv(same.covariance[0])).T * size) for size in (0.0, 0.5, 1e3)
    ]
    assert outlook[0].probability < outlook[1].probability <= outlook[2].probability + 1e-9
    sharp = same._replace(covariance=1e-6 * same.covariance)
    assert sharp.forecast(1e3 * rows) == (pytest.approx(1.0), pytest.approx(1.0))
    # more rows than values say what their information says
    many = np.random.default_rng(4).normal(size=(9, 5))
    triangle = np.linalg.qr(many, mode='r')
    assert normal.forecast(many).probability == pytest.approx(normal.forecast(triangle).probability, abs=1e-12)


def test_columns_of_planned_touches_are_those_of_the_calibration(displaced):
    final = displaced.final
    plan = default_plan(KNOWN, per_disc=5)
    rivals = Rivals.of(final)
    as_made = TouchMetadata.of(final.touches, KNOWN.sensor.frame)
    rows, made = exact_plan(rivals.robot, plan, as_made).point.whitened.jacobian, final.projection.whitened.jacobian
    assert rows.shape == made.shape
    assert rows.shape[2] == rivals.change.shape[1]
    sizes = np.linalg.norm(rows, axis=(0, 1)) * np.linalg.norm(made, axis=(0, 1))
    assert ((rows * made).sum(axis=(0, 1)) > 0.97 * sizes)[sizes > 1e-2].all()  # a slide is not exactly as planned


def test_touches_that_decide_tell_more_than_those_for_accuracy(gain):
    assert gain.verdict == 'ambiguous'
    planner = Planner.of_outcome(gain)
    rivals, decision = planner.rivals, planner.decision()
    accurate = rivals.share * rivals.forecast(planner._rows[choose(planner.candidates, 12)]).probability
    assert decision.outlook.is_decisive
    assert 1 - decision.outlook.expected < 0.8 * (1 - accurate) < 0.8 * (1 - decision.outlook.now)
    assert decision.outlook.limit > decision.outlook.expected - 0.01
    planned = planner.discriminating(decision, 4)
    assert len(planned.plan) == 4
    first = planner.candidates.plan.select(np.array(decision.chosen[:4])).titles(LIMITED)
    assert sorted(planned.plan.titles(LIMITED)) == sorted(first) == sorted(decision.outlook.touches[:4])


def test_report_and_plan_say_the_same(gain):
    outlook, decision = gain.discrimination, Planner.of_outcome(gain).decision()
    assert outlook == decision.outlook
    assert any(outlook.forecast in action for action in gain.assessment.actions)
    for text in (text_report(gain), html_text(gain)):
        assert outlook.touches[0] in text and outlook.forecast in text


def test_a_run_makes_them(gain):
    found = calibrated(LIMITED, gain.final.touches, Planner(nominal_arm(LIMITED)), (), True)
    assert found.discriminating
    assert sorted(found.planned.plan.titles(LIMITED)) == sorted(gain.discrimination.touches[:4])
    assert found.undecided.startswith('encoder_gain[joint1] (')


def test_nothing_is_to_be_decided_where_one_set_is_likely_enough(gain):
    planner = Planner.of_outcome(gain)
    rivals = planner.rivals
    sure = np.where(np.arange(len(rivals.labels)) == 0, 0.97, 0.03 / (len(rivals.labels) - 1))
    assert replace(planner, rivals=rivals._replace(probability=sure)).decision() is None


def test_the_choice_is_all_that_the_other_sources_do_not_explain(displaced):
    """The radius of a mixture is not twice the root of the sum of squares: what is beyond that is no noise."""
    planner, tip = Planner.of_outcome(displaced), displaced.tip_uncertainty
    others = [2 * item.tip for item in displaced.budget if item.label != 'rivals']
    assert np.hypot(planner.choice, np.linalg.norm(others)) == pytest.approx(tip.worst)
    noise = [2 * i.tip for i in displaced.budget if not i.label.startswith(('rivals', 'undetected', 'value'))]
    apart = planner.choice**2 + planner.undetected**2
    assert tip.worst**2 - apart == pytest.approx(float(np.square(noise).sum()))
    assert planner.accurate(4).uncertainty.least < np.linalg.norm(others) + planner.choice / 2


def test_between_discs_alone_touches_hardly_decide_and_it_is_said_what_does(displaced):
    assert displaced.verdict == 'ambiguous'
    outlook = displaced.discrimination
    assert not outlook.is_decisive
    assert outlook.remedies[0].startswith('measure the place of disc_')
    assert any(outlook.limits in action and outlook.remedies[0] in action for action in displaced.assessment.actions)
    rivals = Rivals.of(displaced.final)
    places = [effect(f'object_position[{disc.name}]') for disc in KNOWN.discs]
    rows = np.concatenate([rivals._sizes(one) for one in places])
    size = rivals._needed(rows)
    assert 1e-6 < size < 1e-4
    assert rivals.forecast(rows / size).probability >= FOUND > rivals.forecast(rows / (2.6 * size)).probability

"""The study of the diagnosis plays what it says, and judges as it says."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.diagnosis.cells import NOISE, SETUPS, TOUCHES, at_sizes, chi_square_increase, random_effect, simulate
from benchmark.diagnosis.record import ALONE, Record, error_reduction, failure
from benchmark.diagnosis.runs import NOISES, Task, cases, run_task
from benchmark.diagnosis.tables import tables
from benchmark.diagnosis.unlisted import unlisted
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.model.kinematics import forward

PAPER, SOFT = SETUPS['paper'], SETUPS['soft']


def test_both_cells_have_all_touches() -> None:
    for setup in SETUPS.values():
        assert len(setup.plan) == TOUCHES
        assert len(np.unique(setup.plan.disc)) == len(setup.cell.discs)
        assert setup.plan.preload.any()


def test_a_size_is_the_reduced_chi_square_of_the_twelve() -> None:
    one = random_effect(find(SOFT.cell, 'sensor_bias'), seed=3)
    (found,) = at_sizes(SOFT, one, (2.0,))
    assert found.simulated is not None
    assert 1 + chi_square_increase(SOFT, found.simulated) == pytest.approx(2.0, abs=0.05)
    fits = [calibrate(simulate(SOFT, found.simulated, NOISE, seed), SOFT.cell).reduced_chi_square for seed in range(6)]
    assert np.mean(fits) == pytest.approx(2.0, abs=0.15)


def test_an_alias_of_the_twelve_has_no_size() -> None:
    (found,) = at_sizes(PAPER, random_effect(find(PAPER.cell, 'link_bending[link2]'), seed=0), (1.3,))
    assert found.simulated is None
    assert 'plausible sizes' in found.reason


def test_a_frequency_is_kept_when_the_effect_grows() -> None:
    one = random_effect(find(PAPER.cell, 'transmission_error[joint2]'), seed=5)
    grown = one.scaled(3.0)
    np.testing.assert_allclose(grown.values[0], one.values[0] * (3.0, 1.0, 1.0))


def test_the_oval_disc_is_touched_where_its_normal_is() -> None:
    """The edge lies at r + a cos 2ψ + b sin 2ψ to first order, and its tangent is across the force."""
    size = 1e-4
    oval = unlisted('oval_disc', PAPER, seed=2).scaled(size / 1e-3)
    disc = oval.effects[0].disc  # type: ignore[attr-defined]
    a, b = oval.values[0]
    rigid = PAPER._replace(truth=PAPER.truth.replace(p1=1e-9, p2=1e-9, p_ee=1e-9, g_ee=0.0, g1=0.0, g2=0.0))
    touches = simulate(rigid, oval, type(NOISE)(0.0, 0.0))
    on_it = touches.select(touches.disc == disc)
    angle = np.arctan2(-on_it.force[:, 1], -on_it.force[:, 0])
    away = forward(rigid.truth, on_it.joints) - PAPER.cell.centers[disc]
    out, aside = np.array([np.cos(angle), np.sin(angle)]).T, np.array([-np.sin(angle), np.cos(angle)]).T
    support = PAPER.cell.radii[disc] + a * np.cos(2 * angle) + b * np.sin(2 * angle)
    turned = 2 * (b * np.cos(2 * angle) - a * np.sin(2 * angle))
    np.testing.assert_allclose((away * out).sum(axis=1), support, atol=1e-3 * size)
    np.testing.assert_allclose((away * aside).sum(axis=1), turned, atol=1e-3 * size)


def test_a_task_gives_a_record_per_size_and_noise_that_the_tables_take() -> None:
    records = run_task(Task('effects', 'paper', ('encoder_gain[joint1]',), 0, sizes=(2.0,)))
    assert [(r.size, r.noise) for r in records] == [(2.0, noise) for noise in NOISES]
    assert all(r.naming == {'encoder_gain[joint1]': ALONE} for r in records)
    assert all(r.held_out[0] > 1.2 * r.held_out[2] for r in records)
    assert not any(map(failure, records))
    text = '\n'.join(tables(records))
    assert 'failures' not in text
    (line,) = (line for line in text.splitlines() if 'named, alone or among rivals' in line)
    assert line.split()[-7:-3] == ['2', '100', '%', 'target']


def test_a_failure_says_what_is_wrong() -> None:
    wrong = Record('effects', 'paper', 'given', 7, ('sensor_bias',), 2.0, verdict='none')
    wrong.naming = {'sensor_bias': 'none'}
    wrong.held_out, wrong.z = (0.6, 0.6, 0.4), (9.0, 9.0, 1.0)
    assert failure(wrong) == 'misnamed, held-out, z > 4'
    assert error_reduction(wrong) == 0.0
    assert '--first 7 --effect sensor_bias, size 2: misnamed' in '\n'.join(tables([wrong]))


def test_the_cases_of_every_section() -> None:
    assert len(cases('pairs', 'paper')) == 15
    assert ('link_bending[link2]',) not in cases('effects', 'soft')
    assert ('object_radius[disc_4]',) in cases('effects', 'soft')
    assert () in cases('clean', 'paper')

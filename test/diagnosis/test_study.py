"""The study of the diagnosis plays what it says, and judges as it says."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.diagnosis.cells import NOISE, SETUPS, at_sizes, chi_square_increase, random_effect, simulate
from benchmark.diagnosis.record import ALONE, Record, error_reduction, failure
from benchmark.diagnosis.runs import NOISES, Task, run_task
from benchmark.diagnosis.tables import tables
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.effects.registry import find

PAPER, SOFT = SETUPS['paper'], SETUPS['soft']


def test_a_size_is_the_reduced_chi_square_of_the_twelve() -> None:
    one = random_effect(find(SOFT.cell, 'sensor_bias'), seed=3)
    (found,) = at_sizes(SOFT, one, (2.0,))
    assert found.simulated is not None
    assert 1 + chi_square_increase(SOFT, found.simulated) == pytest.approx(2.0, abs=0.05)
    fits = [calibrate(simulate(SOFT, found.simulated, NOISE, seed), SOFT.cell).reduced_chi_square for seed in range(6)]
    assert np.mean(fits) == pytest.approx(2.0, abs=0.15)


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

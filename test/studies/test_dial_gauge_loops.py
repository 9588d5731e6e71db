"""Continuous loops: gap and slope at every reversal of a synthetic record of the measured ones' form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from studies.gauge_table import COMPLIANCE, GAP, SLIP, UNLOADING, dump_record, record, some

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.files.columns import parse_table
from scara_kinetostatic.studies.loops.dial_gauge import analyse_loops, analyse_tables
from scara_kinetostatic.studies.loops.record import GaugeTable, Record, table_readings


def test_gap_and_slope_come_back_at_every_reversal():
    found = analyse_loops(record())
    assert sum(len(sense.reversals) for sense in found.senses) >= 12
    assert {sense.name: sense.sense for sense in found.senses} == {'rising': 1, 'falling': -1}
    for sense in found.senses:
        assert sense.gap.p_value > 1e-3
        assert sense.gap_force == pytest.approx(0, abs=30)
        assert sense.slip_force == pytest.approx(sense.sense * SLIP, rel=0.01)
        assert max(sense.gap.definitional_uncertainty, sense.compliance.definitional_uncertainty) < 1e-5
        for each in sense.reversals:
            assert each.gap.value == pytest.approx(GAP, abs=max(5 * each.gap.std, 2e-6))
            assert each.compliance.value == pytest.approx(COMPLIANCE, rel=5e-3)
            assert each.unloading_compliance.value == pytest.approx(UNLOADING, rel=5e-3)
            assert each.crossings[0] == pytest.approx(SLIP * UNLOADING, rel=0.01)


def test_errors_agree_with_the_stated_standard_deviations():
    z, p = [], []
    for seed in range(6):
        for each in analyse_loops(record(seed=seed, noise=(1e-5, 2.0))).senses:
            z += [(r.gap.value - GAP) / r.gap.std for r in each.reversals]
            z += [(r.compliance.value - COMPLIANCE) / r.compliance.std for r in each.reversals]
            p.append(each.gap.p_value)
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1, abs=0.14)
    assert min(p) > 1e-4


def test_zero_of_the_force_sensor_does_not_matter():
    for sense in analyse_loops(record(offset=-400.0)).senses:
        assert sense.gap_force == pytest.approx(-400, abs=30)
        assert sense.gap.value == pytest.approx(GAP, abs=5e-6)


def test_reversals_that_disagree_widen_the_mean_and_are_reported():
    """The gap depends on the speed."""
    found = analyse_tables([GaugeTable((), record(lag=-0.02, noise=(5e-6, 2.0)))])
    for sense in found.loops[0].senses:
        assert sense.gap.p_value < 1e-6
        assert sense.gap.between_std > 5e-5
        assert sense.gap.std > sense.gap.between_std / np.sqrt(len(sense.reversals)) * 0.9
    assert sum('the reversals are inconsistent in gap' in warning for warning in found.warnings) == 2
    assert analyse_tables([GaugeTable((), record(noise=(5e-6, 2.0)))]).warnings == ()


def test_a_reversal_without_slip_before_it_is_left_out_with_its_reason():
    given = record()
    turn = given.time[np.argmax(np.where(given.time < 1, given.response, -1))]
    weak = np.where(given.time < turn + 0.2, np.minimum(given.load, 0.3 * SLIP), given.load)
    found = analyse_loops(replace(given, load=weak))
    assert found.rejected[0].time == pytest.approx(turn, abs=0.02)
    assert 'no full loop' in found.rejected[0].reason
    assert min(each.time for sense in found.senses for each in sense.reversals) > turn + 0.5


def test_records_that_are_no_loops_are_refused():
    given, steps = record(), np.arange(50.0)
    text = 'time_s,force_N,displacement_mm\n0,1,1\n1,2,2\n1,3,3\n'
    with pytest.raises(UnsupportedDataError, match=r'a\.csv: the time does not rise'):
        table_readings(parse_table(text, 'a.csv', ''))
    for bad, message in (
        (Record('readings', steps, steps, steps, 'N'), 'readings: no two reversals'),
        (some(given, slice(None, None, 40)), 'no two reversals of a sense have a gap'),
        (some(given, (given.time > 4.4) & (given.time < 7.6)), 'too few reversals of its sense'),
    ):
        with pytest.raises(UnsupportedDataError, match=message):
            analyse_loops(bad)


def test_tables_are_told_apart_by_their_columns():
    steps = [1, 2, 3, 2, 1, -1, -2, -3, -2, -1]
    points = 'time_s,cycle,force_N,displacement_um\n'
    points += ''.join(f'{k},1,{f},{10 * f + (10 if f > 0 else -10)}\n' for k, f in enumerate(steps))
    tables = [table_readings(parse_table(text, 'a.csv', '')) for text in (points, dump_record(record()))]
    both = analyse_tables(tables)
    assert (list(both.parts), len(both.loops)) == (['gripper'], 1)

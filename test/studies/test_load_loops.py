"""Loops that a load drives: friction in parallel found, law (6) sufficient only where that was tested, bad input."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.report import as_text
from scara_kinetostatic.studies.loops.record import LOAD, Record, RecordPath, load_record, what_drives
from scara_kinetostatic.studies.loops.report import hysteresis_document, hysteresis_report, verdict
from scara_kinetostatic.studies.loops.selection import Selection, Study, analyse, predict_records, select_model

C, MU, COMPLIANCE, HALF_GAP = 2.0, 0.3, 3e-3, 15e-3
GEAR = {'friction': C, 'friction_ratio': MU, 'compliance': COMPLIANCE, 'half_gap': HALF_GAP}
LOOPS = (4.0, 4.0, 4.0, 25.0, 25.0, 25.0)


def elastic(load: np.ndarray, c: float, mu: float) -> np.ndarray:
    """What friction leaves to the spring, one sample after the other, from |τ - τ_e| ≤ c + μ |τ_e|, bisected."""
    output, here = [], 0.0
    for each in load.tolist():
        low, high = (here, each) if each > here else (each, here)
        if abs(each - here) > c + mu * abs(here):
            for _ in range(50):
                middle = (low + high) / 2
                slips = abs(each - middle) > c + mu * abs(middle)
                low, high = (middle, high) if slips == (each > here) else (low, middle)
            here = (low + high) / 2
        output.append(here)
    return np.array(output)


def gear(seed: int = 0, c: float = C, mu: float = MU, noise: float = 3e-4) -> Record:
    """Small loops, then large ones."""
    corners = [0.0, *(sign * size for size in LOOPS for sign in (1, -1)), 0.0]
    load = np.concatenate([np.linspace(*ends, 80)[:-1] for ends in pairwise(corners)])
    random = np.random.default_rng(seed)
    spring = elastic(load, c, mu) if c else load
    gap = spring / np.hypot(spring, 0.5) if c else np.sign(load)
    angle = 0.1 + COMPLIANCE * spring + HALF_GAP * gap + noise * random.standard_normal(len(load))
    return Record(f'{seed}.csv', 0.06 * np.arange(len(load)), load, angle, driven_by=LOAD)


def rested(one: Record, samples: int = 200) -> Record:
    """The same after a rest."""
    random = np.random.default_rng(9)
    still = one.response[0] + 3e-4 * random.standard_normal(samples)
    load = np.concatenate([np.zeros(samples), one.load])
    return replace(one, time=0.06 * np.arange(len(load)), load=load, response=np.concatenate([still, one.response]))


@pytest.fixture(scope='module')
def analysis() -> Selection:
    return select_model(Study([gear()]))


def test_friction_that_grows_with_the_load_is_found(analysis: Selection) -> None:
    assert (analysis.verdict, analysis.final.law.name) == ('explained', 'load_friction')
    assert analysis.final.held_out_rms < 0.05 * analysis.before.held_out_rms
    assert analysis.final.held_out_rms < 2 * 3e-4
    found = analysis.final.parameters
    for name, true in GEAR.items():
        assert found[name].value == pytest.approx(true, rel=0.05)
        assert found[name].std > 0


def test_law_6_is_sufficient_for_loops_of_law_6() -> None:
    found = select_model(Study([gear(1, 0.0)]))
    assert (found.verdict, found.selected) == ('none', None)
    assert found.detectable < 0.5
    assert re.search(r'Each test would have found \d+ % of its square', ' '.join(verdict(found).sentences))


def test_a_smaller_error_is_never_called_no_better(analysis: Selection) -> None:
    """Nor is law (6) sufficient beside it, whatever the tests say."""
    candidates = tuple(each._replace(accepted=False) for each in analysis.candidates)
    assert any(map(analysis.is_clearly_smaller, candidates))
    undecided = analysis._replace(verdict='undecided', selected=None, rivals=(), candidates=candidates)
    found = verdict(undecided)
    assert found.headline == 'These records do not show whether law (6) is sufficient'
    assert 'friction in parallel that grows with the load' in ' '.join(found.sentences)


def test_another_record_is_predicted_after_its_first_third(analysis: Selection) -> None:
    other = gear(2)
    (found,) = predict_records(analysis, [other])
    assert found.after_rms < 1e-3 < found.before_rms
    document = hysteresis_document([analysis], [found])
    assert document['predicted'][0]['from_s'] == other.time[len(other) // 3]
    later = other.response + np.where(np.arange(len(other)) < len(other) // 3, 0.0, 1e-3)
    (moved,) = predict_records(analysis, [replace(other, response=later)])
    assert (moved.after.state, moved.after.zero) == (found.after.state, found.after.zero)


def test_what_is_refused() -> None:
    one = gear()
    ramp = replace(one, load=np.linspace(0.0, 25.0, len(one)), response=np.linspace(0.0, 0.1, len(one)))
    swapped = replace(one, load=one.response, response=one.load)
    ahead = 'the angle runs ahead of the torque, as if the joint gave out energy; check whether the two columns'
    for record, message in ((ramp, 'reverses 0 times; loops need 5 reversals'), (swapped, f'0.csv: {ahead}')):
        with pytest.raises(UnsupportedDataError, match=message):
            RecordPath(record)


def test_records_in_loops_and_from_rest_are_taken_together() -> None:
    records, place = [gear(seed) for seed in range(3)], 0
    records[place] = rested(records[place])
    assert [each.is_at_rest_first for each in records] == [k == place for k in range(3)]
    (found,) = analyse(records, what_drives(records))
    assert (found.verdict, found.final.law.name) == ('explained', 'load_friction')
    for name, true in GEAR.items():
        assert found.final.parameters[name].value == pytest.approx(true, rel=0.05)
    assert max(each.after_rms for each in found.judged) < 2 * 3e-4
    for each in found.dependence_before:
        assert [bool(np.isnan(p)) for p in each.p_value_by_record] == [k == place for k in range(3)]
    said = ' '.join(as_text(hysteresis_report([found])).split())
    assert 'Of a record that begins at rest: after the unloading' in said
    alone = Study(records[1:]).candidate(found.final.law)
    assert found.final.along[2].state == pytest.approx(alone.along[1].state, abs=0.02)


def test_a_column_of_commands_says_what_drives(tmp_path: Path) -> None:
    one = gear()
    rows = [f'{t:.3f},{q:.6f},{tau:.4f},{tau:.4f}' for t, q, tau in zip(one.time, one.response, one.load, strict=True)]
    for heading, driven in (('commanded_Nm', 'load'), ('commanded_rad', 'motion'), ('other_s2', 'motion')):
        path = tmp_path / f'{heading}.csv'
        path.write_text('\n'.join([f'time_s,angle_rad,torque_Nm,{heading}', *rows]), encoding='utf-8')
        assert what_drives([load_record(path)]) == driven

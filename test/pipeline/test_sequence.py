"""Several recordings: what shifted between them is sought in the order of time, however they are given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration.studies import CELL as BARE

from scara_kinetostatic.assessment.grade import unusable
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.diagnosis.mixed_model import HEAVY_TAILS, fit_mixed
from scara_kinetostatic.diagnosis.search import identify
from scara_kinetostatic.diagnosis.weighing import weigh
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.model.cell import MEASURED_DISCS
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.pipeline import calibrate_recordings, gather_touches
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import START, simulate_streams, simulate_touches
from scara_kinetostatic.touches.detection import Detection, Episode, no_touches, order_in_time

CELL = replace(BARE, discs=MEASURED_DISCS)
LATER = replace(PAPER_ACTUAL, x0=PAPER_ACTUAL.x0 + 1.5e-4)


def recorded(start: int, last: float, found: int = 10) -> Detection:
    return Detection(no_touches(), start=start, episodes=found * (Episode(0, (1.0, last), (1.0, last)),))


@pytest.mark.parametrize(
    ('starts', 'sequence'),
    [((2e12, 1e12), [1, 0]), ((1e12, 2e12), [0, 1]), ((1e12, 1.05e12), None), ((0, 1e12), None)],
    ids=['the other way round', 'in turn', 'overlapping', 'unknown'],
)
def test_the_sequence_is_that_of_the_starts(starts, sequence):
    parts = [recorded(int(starts[0]), 100.0, 10), recorded(int(starts[1]), 100.0, 5)]
    found = order_in_time(parts)
    assert (None if found is None else found.tolist()) == sequence


def test_recordings_are_ordered_by_their_starts(tmp_path):
    plan = default_plan(CELL, per_disc=8)
    a, b = tmp_path / 'a', tmp_path / 'b'
    write_streams(a, simulate_streams(CELL, PAPER_ACTUAL, plan, seed=1), CELL)
    write_streams(b, simulate_streams(CELL, LATER, plan, seed=2, start=START + 3600 * 10**9), CELL)
    one, touches = (gather_touches(paths, CELL).touches for paths in ([a, b], [b, a]))
    assert np.array_equal(one.joints, touches.joints[np.argsort(touches.order)])
    other = calibrate_recordings([b, a], CELL)
    assert [item.effect.label for item in other.diagnosis.found] == ['shift[base]']
    assert abs(other['x0'].value - LATER.x0) < 4 * other['x0'].std
    assert [str(item.path) for item in other.recordings] == [str(b), str(a)]
    assert not any('order' in text for text in other.warnings)
    assert 'between recording 2 and 1: corrected' in other.assessment.reasons[0]


def write_tables(tmp_path):
    """The base has moved between the first and the second."""
    for seed, name, robot in ((3, 'a', PAPER_ACTUAL), (4, 'b', LATER)):
        touches = simulate_touches(CELL, robot, default_plan(CELL, per_disc=8), CELL.noise, seed)
        rows = np.hstack([touches.joints, touches.force]).tolist()
        lines = ['q1_rad,q2_rad,fx_N,fy_N', *(','.join(map(str, row)) for row in rows)]
        (tmp_path / f'{name}.csv').write_text('\n'.join(lines))
    return [tmp_path / 'a.csv', tmp_path / 'b.csv']


def test_a_likelier_set_without_a_curve_is_found_where_one_with_it_settles(tmp_path):
    touches, used = gather_touches(write_tables(tmp_path), CELL).touches, np.arange(96) != 42
    base, known = calibrate(touches, CELL).changed(used=used), catalogue(CELL)
    found = identify(base, known, weigh(fit_mixed(base, known, freedoms=HEAVY_TAILS), known))
    assert [effect.label for effect in found.named] == ['shift[base]']


def test_a_recording_that_is_bad_alone_is_named(tmp_path):
    first, second = write_tables(tmp_path)
    head, *rows = second.read_text().split('\n')
    weak = [f'{row.rsplit(",", 2)[0]},0.01,0.02' for row in rows[: len(rows) // 2]]
    second.write_text('\n'.join([head, *weak, *rows[len(weak) :]]))
    remarks = [str(remark) for remark in unusable(calibrate_recordings([first, second], CELL))]
    assert len(remarks) == 1
    assert f'in recording 2 {len(weak)} of {len(rows)} touches found are not used' in remarks[0]


def test_tables_do_not_tell_their_order_and_it_is_said(tmp_path):
    paths = write_tables(tmp_path)
    assert not gather_touches(paths, CELL).sequence_known
    assert gather_touches(paths[:1], CELL).sequence_known
    found = calibrate_recordings(paths, CELL)
    assert found.warnings[-1].startswith("the recordings' order in time is not known, that of the command is taken")
    assert 'in the order given, as that in time is not known: corrected' in found.assessment.reasons[0]

"""Touches and recordings that the user leaves out."""

from __future__ import annotations

import numpy as np
import pytest

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.model.parameters import PAPER_MEASURED
from scara_kinetostatic.model.touch import Rejection
from scara_kinetostatic.pipeline import REASON, kept_recordings, leave_out, parse_left_out
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.touches.detection import Detection


@pytest.fixture(scope='module')
def detection() -> Detection:
    """20 touches, of which touch 12 is rejected."""
    touches = simulate_touches(PAPER_CELL, PAPER_MEASURED, default_plan(PAPER_CELL))
    touches = touches.select(np.isin(touches.index, [*range(12), *range(13, 20)]))
    return Detection.of(touches, [Rejection(12, 'slides')])


@pytest.mark.parametrize(
    ('entries', 'numbers'),
    [([], []), (['3', ' 5-7 '], [3, 5, 6, 7]), (['19', '11-12'], [11, 19]), (['5,10-11', ' 3 , 7'], [3, 5, 7, 10, 11])],
)
def test_touches_by_number(detection, entries, numbers):
    left = leave_out(detection, parse_left_out(entries, '--leave-out'))
    assert [item.index for item in left.rejected if item.reason == REASON] == numbers
    assert Rejection(12, 'slides') in left.rejected
    assert left.touches.index.tolist() == [n for n in detection.touches.index if n not in numbers]
    assert left.found == 20


def test_recordings_by_name():
    paths = ['may/touches', 'june/touches', 'tuesday.mcap', 'touches.csv']
    for texts, kept in (
        (['3'], paths),
        (['tuesday'], [*paths[:2], paths[3]]),
        (['june/touches', 'touches.csv'], paths[::2]),
    ):
        assert kept_recordings(paths, parse_left_out(texts, 'x')) == kept


@pytest.mark.parametrize(
    ('entries', 'message'),
    [
        (['wednesday'], "'wednesday' is none of the recordings bags/monday, bags/tuesday.mcap, june/monday"),
        (['tuesday:3'], "'tuesday:3' is none of the recordings .*and touches as 5 or 10-14"),
        (['-3'], "'-3' is none of the recordings"),
        (['monday'], "'monday' is the name of several of the recordings bags/monday, june/monday"),
        (['20'], 'there is no touch 20 among 20'),
        (['7-5'], '7-5: expected a range'),
        (['3,7-5'], '3,7-5: expected a range'),
        (['3,tuesday'], "'3,tuesday' is none of the recordings .*and touches as 5 or 10-14"),
        (['tuesday', '3'], 'without a recording the touches have other numbers'),
        (['bags/monday', 'tuesday', 'june/monday'], 'every recording'),
    ],
)
def test_entries_that_cannot_be_left_out_are_refused(detection, entries, message):
    with pytest.raises(ParameterError, match=message):
        parsed = parse_left_out(entries, '--leave-out')
        kept_recordings(['bags/monday', 'bags/tuesday.mcap', 'june/monday'], parsed)
        leave_out(detection, parsed)

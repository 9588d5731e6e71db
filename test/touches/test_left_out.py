"""Touches and recordings that the user leaves out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.model.parameters import PAPER_MEASURED
from scara_kinetostatic.model.touch import Rejection
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.touches.detection import Detection
from scara_kinetostatic.touches.left_out import REASON, kept_recordings, leave_out, parse_left_out

PATHS = ['bags/monday', 'bags/tuesday.mcap']


@pytest.fixture(scope='module')
def detection() -> Detection:
    """Two recordings of 10 touches each, of which touch 12 is rejected."""
    touches = simulate_touches(PAPER_CELL, PAPER_MEASURED, default_plan(PAPER_CELL))
    touches = touches.select(np.isin(np.arange(len(touches)), [*range(12), *range(13, 20)]))
    touches = touches.replace(index=np.array([*range(12), *range(13, 20)]))
    return replace(Detection.of(touches, [Rejection(12, 'slides')]), first_touches=(0, 10))


@pytest.mark.parametrize(
    ('entries', 'numbers'),
    [
        ([], []),
        (['3', ' 5-7 '], [3, 5, 6, 7]),
        (['tuesday:0', 'tuesday.mcap:3-4', 'bags/monday:9'], [9, 10, 13, 14]),
        (['19', '11-12'], [11, 19]),
    ],
)
def test_touches_by_number(detection, entries, numbers):
    left = leave_out(detection, PATHS, parse_left_out(entries, '--leave-out'))
    assert [item.index for item in left.rejected if item.reason == REASON] == numbers
    assert Rejection(12, 'slides') in left.rejected
    assert left.touches.index.tolist() == [n for n in detection.touches.index if n not in numbers]
    assert left.found == 20


def test_recordings_by_name():
    for texts, kept in ((['monday', 'tuesday:3'], PATHS[1:]), (['tuesday:3'], PATHS), (['tuesday', '3'], PATHS[:1])):
        assert kept_recordings(PATHS, parse_left_out(texts, 'x')) == kept
    for texts, problem in (
        (['monday', '3'], '3 counts the touches of a recording that is left out as well'),
        (['monday', 'tuesday'], 'every recording'),
    ):
        with pytest.raises(ParameterError, match=problem):
            kept_recordings(PATHS, parse_left_out(texts, 'x'))


@pytest.mark.parametrize(
    ('entry', 'message'),
    [
        ('wednesday', "'wednesday' is none of the recordings monday, tuesday.mcap"),
        ('wednesday:3', "'wednesday' is none of the recordings"),
        ('20', '20: the touches are numbered from 0 to 19'),
        ('monday:8-10', 'monday:8-10: the touches are numbered from 0 to 9'),
        ('7-5', '7-5: expected a range'),
        ('-3', "'-3' is none of the recordings"),
    ],
)
def test_entries_that_name_nothing_are_refused(detection, entry, message):
    with pytest.raises(ParameterError, match=message):
        entries = parse_left_out([entry], '--leave-out')
        leave_out(detection, kept_recordings(PATHS, entries), entries)


def test_recordings_of_one_name_are_told_apart_by_their_folders():
    paths = ['may/touches', 'june/touches', 'touches.csv']
    for text in ('touches', 'touches:3'):
        with pytest.raises(ParameterError, match="'touches' is the name of several recordings: may/touches, june"):
            kept_recordings(paths, parse_left_out([text], 'x'))
    assert kept_recordings(paths, parse_left_out(['june/touches', 'touches.csv:1'], 'x')) == [paths[0], paths[2]]

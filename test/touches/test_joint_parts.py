"""Joint states of which each message has some of the joints."""

from __future__ import annotations

from math import isnan, nan

import pytest

from scara_kinetostatic.touches.streams import JointParts, UnjoinedError

MS = 1_000_000
T0 = 1_700_000_000_000_000_000


def test_messages_with_both_angles_stay_as_they_came():
    join = JointParts(('joint1', 'joint2'))
    for stamp in (5, 5, 0, 3):
        assert join.add(stamp, 7, [0.1, 0.2]) == (stamp, 7, [0.1, 0.2])


@pytest.mark.parametrize('values', [[0.1, nan], [nan, 0.2]])
def test_one_angle_alone_is_refused(values):
    with pytest.raises(UnjoinedError, match='joint1 and joint2 are not in one message'):
        JointParts(('joint1', 'joint2')).add(T0, T0, values)


def test_other_joints_count_as_they_were_last_heard_for_a_second():
    join = JointParts(('joint1', 'joint2', 'lift'))
    first = join.add(T0, T0, [0.1, 0.2, nan])
    assert first is not None
    assert isnan(first[2][2])
    assert join.add(T0, T0, [nan, nan, 0.02]) is None
    for ms, known in ((500, True), (1000, True), (1001, False)):
        both = join.add(T0, T0 + ms * MS, [0.1, 0.2, nan])
        assert both is not None
        assert isnan(both[2][2]) != known
    assert join.add(T0, T0 + 1002 * MS, [nan, nan, 0.03]) is None
    assert join.add(T0, T0 + 1003 * MS, [0.1, 0.2, nan]) == (T0, T0 + 1003 * MS, [0.1, 0.2, 0.03])

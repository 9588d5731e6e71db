"""Joint states of which each message has some of the joints."""

from __future__ import annotations

from math import isnan, nan

import numpy as np
import pytest

from scara_kinetostatic.touches.streams import JointParts, UnjoinedError

NAMES = ('joint1', 'joint2')
MS = 1_000_000
T0 = 1_700_000_000_000_000_000


def angle(joint: int, time: int) -> float:
    """A steady motion, which interpolation gives back."""
    return (0.3 + joint) * 1e-9 * (time - T0)


def part(joint: int, time: int) -> list[float]:
    return [angle(joint, time) if k == joint else nan for k in range(2)]


def joined(times: list[tuple[int, int]]) -> list[tuple[int, int, list[float]]]:
    """The samples of messages, each of a joint and with a stamp, in the order of their stamps."""
    join = JointParts(NAMES)
    found = [join.add(time, time + MS, part(joint, time)) for joint, time in sorted(times, key=lambda item: item[1])]
    return [sample for sample in found if sample is not None]


@pytest.mark.parametrize('periods', [(2, 2), (2, 10), (9, 2), (7, 3)])
def test_both_angles_are_of_one_time_and_as_many_as_of_the_slower_joint(periods):
    stamps = [[T0 + (k * period + joint) * MS for k in range(1000 // period)] for joint, period in enumerate(periods)]
    found = joined([(joint, time) for joint in (0, 1) for time in stamps[joint]])
    for time, _, values in found:
        np.testing.assert_allclose(values, [angle(joint, time) for joint in (0, 1)], atol=1e-12)
    times = [time for time, *_ in found]
    assert np.all(np.diff(times) > 0)
    assert set(times) <= {time for each in stamps for time in each}
    assert min(map(len, stamps)) - 2 <= len(found) <= min(map(len, stamps))


def test_messages_with_both_angles_stay_as_they_came():
    join = JointParts(NAMES)
    for stamp in (5, 5, 0, 3):
        assert join.add(stamp, 7, [0.1, 0.2]) == (stamp, 7, [0.1, 0.2])


def test_without_stamps_the_times_of_reception_count():
    join = JointParts(NAMES)
    found = [join.add(0, time, part(k % 2, time)) for k, time in enumerate(range(T0, T0 + 20 * MS, MS))]
    samples = [sample for sample in found if sample]
    assert len(samples) == 9
    assert {stamp for stamp, *_ in samples} == {0}
    for _, received, values in samples:  # dated by when the earlier of the two was received
        np.testing.assert_allclose(values, [angle(joint, received) for joint in (0, 1)], atol=1e-12)


def test_other_joints_count_as_they_were_last_heard():
    join = JointParts((*NAMES, 'lift'))
    first = join.add(T0, T0, [0.1, 0.2, nan])
    assert first is not None
    assert isnan(first[2][2])
    assert join.add(T0 + 1, T0 + 1, [nan, nan, 0.02]) is None
    assert join.add(T0 + 2, T0 + 2, [0.1, 0.2, nan]) == (T0 + 2, T0 + 2, [0.1, 0.2, 0.02])


def test_another_joint_that_fell_silent_is_unknown_after_a_second():
    join = JointParts((*NAMES, 'lift'))
    join.add(T0, T0, [nan, nan, 0.02])
    for ms, known in ((500, True), (1000, True), (1001, False)):
        both = join.add(T0, T0 + ms * MS, [0.1, 0.2, nan])
        assert both is not None
        assert isnan(both[2][2]) != known
    join.add(T0, T0 + 1002 * MS, [nan, nan, 0.03])
    assert join.add(T0, T0 + 1003 * MS, [0.1, 0.2, nan]) == (T0, T0 + 1003 * MS, [0.1, 0.2, 0.03])


def test_a_silent_joint_is_named_and_its_silence_is_not_bridged():
    join, found = JointParts(NAMES), []
    heard_again = T0 + 3000 * MS
    for time in range(T0, heard_again + 500 * MS, 2 * MS):
        if not T0 + 500 * MS <= time < heard_again:
            found.append(join.add(time + MS, time + MS, part(1, time + MS)))
        if T0 + 1499 * MS < time < heard_again:
            with pytest.raises(UnjoinedError, match='joint2 is silent'):
                join.add(time, time, part(0, time))
        else:
            found.append(join.add(time, time, part(0, time)))
    times = np.array([sample[0] for sample in found if sample])
    assert not np.any((times > T0 + 502 * MS) & (times < heard_again - 2 * MS))
    assert np.sum(times >= heard_again) > 240


def test_stamps_of_one_joint_alone_are_said():
    join = JointParts(NAMES)
    assert join.add(T0, T0 + MS, part(0, T0)) is None
    for time in (T0 + 2 * MS, T0 + 4 * MS):
        with pytest.raises(UnjoinedError, match='joint2 is not stamped, joint1 is'):
            join.add(0, time, part(1, time))
        with pytest.raises(UnjoinedError, match='joint2 is not stamped, joint1 is'):
            join.add(time + MS, time + MS, part(0, time + MS))


def test_clocks_that_differ_are_said():
    join = JointParts(NAMES)
    join.add(T0, T0, part(0, T0))
    with pytest.raises(UnjoinedError, match=r'the clocks of joint1 and joint2 differ by 0.5 s, or one comes late'):
        join.add(T0 + 501 * MS, T0 + MS, part(1, T0))


def test_a_clock_that_was_set_back_begins_anew():
    join = JointParts(NAMES)
    for begin in (T0, T0 - 10_000 * MS):
        found = []
        for k in range(20):
            time = begin + k * MS
            try:
                found.append(join.add(time, T0 + k * MS, part(k % 2, time)))
            except UnjoinedError as error:
                assert k < 2
                assert 'do not increase' in str(error) or 'differ' in str(error)
        assert len([sample for sample in found if sample]) >= 7

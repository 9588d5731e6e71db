"""Joint states of which each message has some of the joints are brought to common times."""

from __future__ import annotations

from math import isnan, nan

import numpy as np
import pytest

from scara_kinetostatic.touches.clock import JointParts, Samples
from scara_kinetostatic.touches.streams import alternate

NAMES = ('joint1', 'joint2')
MS = 1_000_000
T0 = 1_700_000_000_000_000_000
Row = tuple[int, int, list[float]]


def angle(joint: int, time: int) -> float:
    """A steady motion, which interpolation gives back."""
    return (0.3 + joint) * 1e-9 * (time - T0)


def part(joint: int, time: int, late: int = MS) -> Row:
    return time, time + late, [angle(joint, time) if k == joint else nan for k in range(2)]


def rows(messages: list[Row]) -> Samples:
    stamp, received, values = zip(*messages, strict=True)
    return Samples(np.array(stamp), np.array(received), np.array(values))


def one_by_one(join: JointParts, messages: list[Row]) -> tuple[list[Row], dict[str, int]]:
    found, problems = [], dict[str, int]()
    for message in messages:
        samples, said = join.add(rows([message]))
        found += list(zip(*(column.tolist() for column in samples), strict=True))
        problems = {why: problems.get(why, 0) + said.get(why, 0) for why in problems | said}
    return found, problems


def joined(messages: list[Row], names: tuple[str, ...] = NAMES) -> tuple[list[Row], dict[str, int]]:
    """What they give one by one, which is what they give all at once."""
    found, problems = one_by_one(JointParts(names), messages)
    together, said = JointParts(names).add(rows(messages))
    np.testing.assert_array_equal(together.stamp, [stamp for stamp, *_ in found])
    np.testing.assert_array_equal(together.log_time, [received for _, received, _ in found])
    np.testing.assert_allclose(together.values, np.array([v for *_, v in found]).reshape(-1, len(names)), atol=1e-15)
    assert said == problems
    return found, problems


def stepwise(periods: tuple[int, int], span: int = 1000) -> list[Row]:
    """Each joint at a period, ms, in the order of the stamps."""
    return sorted(part(j, T0 + (at + 3 * j) * MS) for j in (0, 1) for at in range(0, span, periods[j]))


def test_messages_with_both_angles_stay_as_they_came():
    found, problems = joined([(stamp, 7 + k, [0.1, 0.2]) for k, stamp in enumerate((5, 5, 0, 3))])
    assert [stamp for stamp, *_ in found] == [5, 5, 0, 3]
    assert not problems


@pytest.mark.parametrize('periods', [(2, 2), (10, 10), (2, 10), (9, 2), (10, 16), (1, 20)])
def test_both_angles_are_of_one_time_and_as_many_as_of_the_slower_joint(periods):
    found, problems = joined(stepwise(periods))
    for time, received, values in found:
        np.testing.assert_allclose(values, [angle(0, time), angle(1, time)], atol=1e-9)
        assert received == time + MS  # when the message of this stamp came
    assert np.all(np.diff([time for time, *_ in found]) > 0)
    assert 1000 // max(periods) - 3 <= len(found) <= 1000 // max(periods) + 1
    assert not problems


@pytest.mark.parametrize('size', [7, 40])
def test_messages_that_come_in_bursts_are_not_lost(size):
    """As where a recorder takes what has come of one publisher after the other."""
    parts = stepwise((2, 2))
    each = [[row for row in parts if isnan(row[2][1 - k])] for k in (0, 1)]
    bursts = [row for at in range(0, 500, size) for column in each for row in column[at : at + size]]
    found, problems = joined([(stamp, T0 + k, values) for k, (stamp, _, values) in enumerate(bursts)])
    assert len(found) > 480
    for time, _, values in found:
        np.testing.assert_allclose(values, [angle(0, time), angle(1, time)], atol=1e-9)
    assert not problems


def test_messages_with_both_angles_between_parts():
    parts = stepwise((8, 8))
    whole = [(t, t + MS, [angle(0, t), angle(1, t)]) for t in range(T0 + MS, T0 + 1000 * MS, 100 * MS)]
    found, problems = joined(sorted([*parts, *whole]))
    assert {time for time, *_ in whole} <= {time for time, *_ in found}
    assert len(found) > 120
    for time, _, values in found:
        np.testing.assert_allclose(values, [angle(0, time), angle(1, time)], atol=1e-9)
    assert not problems


def test_messages_that_come_twice_give_each_sample_once_or_again():
    found, _ = joined([row for row in stepwise((10, 10)) for _ in range(2)])
    for time, _, values in found:
        np.testing.assert_allclose(values, [angle(0, time), angle(1, time)], atol=1e-9)
    assert len({time for time, *_ in found}) >= 97


@pytest.mark.parametrize('unset', [(0,), (1,), (0, 1)])
def test_where_a_joint_is_not_stamped_the_times_of_reception_count(unset):
    messages = [(0 if j in unset else t, t + MS, v) for t, _, v in stepwise((10, 16)) for j in [int(isnan(v[0]))]]
    found, problems = joined(messages)
    for stamp, received, values in found[1:]:
        assert stamp == 0
        np.testing.assert_allclose(values, [angle(0, received - MS), angle(1, received - MS)], atol=1e-9)
    assert len(found) > 58
    assert not problems


def test_a_silent_joint_is_named_and_its_silence_is_not_bridged():
    messages = [row for row in stepwise((2, 2), 3500) if isnan(row[2][1]) or not 500 <= (row[0] - T0) // MS < 3000]
    found, problems = joined(messages)
    assert list(problems) == ['joint2 is silent']
    assert problems['joint2 is silent'] == pytest.approx(750, abs=2)
    times = np.array([time - T0 for time, *_ in found]) // MS
    assert not np.any((times > 510) & (times < 2990))
    assert np.sum(times >= 2990) > 240
    assert JointParts(NAMES).awaited == 'joint1 and joint2'


def test_a_joint_that_never_speaks_is_named():
    join = JointParts(NAMES)
    _, problems = one_by_one(join, [part(0, T0 + 10 * k * MS) for k in range(300)])
    assert problems == {'joint2 is silent': 199}
    assert join.awaited == 'joint2'


@pytest.mark.parametrize('apart', [700 * MS, 86_400_000 * MS])
def test_clocks_that_differ_are_named(apart):
    messages = [(t + apart * isnan(v[0]), r, v) for t, r, v in stepwise((10, 10))]
    found, problems = joined(messages)
    assert not found
    assert len(problems) == 1
    assert f'the clocks of joint1 and joint2 differ by {apart / 1e9:.1g} s, or one comes late' in problems


def test_a_simulated_clock_may_run_slower():
    found, problems = joined([(T0 + (t - T0) // 100, t, v) for t, _, v in stepwise((300, 300), 9000)])
    assert len(found) == 29
    assert not problems


def test_a_clock_that_is_set_back_stays_visible():
    """Which `clock` refuses."""
    messages = [(t - 5000 * MS * (t > T0 + 500 * MS), r, v) for t, r, v in stepwise((10, 10))]
    together, _ = JointParts(NAMES).add(rows(messages))
    assert np.diff(together.stamp).min() < -4900 * MS


def test_other_joints_count_as_they_were_last_heard_for_a_second():
    lift = [(T0, T0, [0.1, 0.2, nan]), (T0, T0, [nan, nan, 0.02])]
    lift += [(T0 + ms * MS, T0 + ms * MS, [0.1, 0.2, nan]) for ms in (500, 1000, 1001)]
    lift += [(T0, T0 + 1002 * MS, [nan, nan, 0.03]), (T0, T0 + 1003 * MS, [0.1, 0.2, nan])]
    found, problems = one_by_one(JointParts((*NAMES, 'lift')), lift)
    np.testing.assert_array_equal([values[2] for *_, values in found], [nan, 0.02, 0.02, nan, 0.03])
    assert not problems
    together, _ = JointParts((*NAMES, 'lift')).add(rows(lift))
    np.testing.assert_array_equal(together.values[:, 2], [nan, 0.02, 0.02, nan, 0.03])


TIME = np.arange(1000) / 1000.0


def motion(phase: float) -> np.ndarray:
    return np.column_stack([np.sin(TIME + phase), 0.5 * np.cos(1.3 * TIME + phase)])


@pytest.mark.parametrize('burst', [1, 3, 10])
def test_two_motions_in_turn_alternate(burst):
    first = (np.arange(1000) // burst) % 2 == 0
    assert alternate(np.where(first[:, None], motion(0.0), motion(0.3)))


@pytest.mark.parametrize('seed', range(3))
def test_noise_steps_and_oscillations_of_one_robot_do_not(seed):
    noise = np.random.default_rng(seed).normal(size=(1000, 2))
    for one in (noise, noise[:100], motion(0.0) + 1e-4 * noise, 1e-3 * np.round(noise / 2)):
        assert not alternate(one)
    assert not alternate(0.1 * np.sin(2 * np.pi * 8 * TIME)[:, None] * [1.0, 0.5])

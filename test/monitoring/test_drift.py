"""The drift monitor: innovations, alarms, names, bad touches, slow changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from monitoring.simulated import DECLARED, TRUTH, moved, record_of, std_of, touches_of

from scara_kinetostatic.monitoring import drift
from scara_kinetostatic.monitoring.drift import LARGEST_RESIDUAL, DriftMonitor, alarm_line
from scara_kinetostatic.monitoring.record import CalibrationRecord


def test_innovations_are_standard_and_raise_nothing(record: CalibrationRecord) -> None:
    squares, monitor = [], DriftMonitor(record)
    monitor.add(touches_of(DECLARED, 4, moved(l1=1e-4)).select(np.arange(20)))
    assert monitor.alarm is not None
    for seed in (1, 2):
        monitor.reset()
        assert monitor.alarm is None and monitor.count == 0
        touches = touches_of(DECLARED, seed, count=8)
        for k in range(len(touches)):
            assert monitor.add(touches.select([k])) is None
            squares.append(monitor.last_distance**2)
    assert abs(np.mean(squares) - 2) < 4 * 2 / len(squares) ** 0.5
    assert monitor.count == 48


@pytest.mark.parametrize('name', ['l1', 'g1', 'theta1', 'object_position[disc_2]'])
@pytest.mark.parametrize('before', [0, 30])
def test_a_change_is_raised_and_named(record: CalibrationRecord, name: str, before: int) -> None:
    monitor = DriftMonitor(record)
    if before:
        assert monitor.add(touches_of(DECLARED, 3).select(np.arange(before))) is None
    if hasattr(TRUTH, name):
        after = touches_of(DECLARED, 4, moved(**{name: 5 * std_of(record, name)}))
    else:
        after = touches_of(DECLARED, 4, effects=('object_position[disc_2]:x=1e-4,y=0',))
    alarm = monitor.add(after.select(np.arange(20)))
    assert alarm is not None
    assert name in (alarm.best.name, *alarm.rivals)
    assert abs(alarm.since - before) <= 6
    if name == 'object_position[disc_2]':
        assert abs(alarm.best.change[0] - 1e-4) < 5 * alarm.best.std[0]
    assert before < alarm.touch < before + 20


@pytest.mark.parametrize('off', [1e-4, 3e-4])
def test_one_bad_touch_is_no_drift(record: CalibrationRecord, off: float) -> None:
    distances = []
    for seed in (1, 104):
        monitor, touches = DriftMonitor(record), touches_of(DECLARED, seed)
        for k in range(18):
            touch = touches.select([k])
            if k == 10:
                touch = replace(touch, joints=touch.joints + np.array([off, -off]))
            assert monitor.add(touch) is None, seed
            if k == 10:
                distances.append(monitor.last_distance)
    assert max(distances) > 2 * LARGEST_RESIDUAL


def test_a_creep_slower_than_the_window_is_seen(record: CalibrationRecord) -> None:
    monitor, alarm = DriftMonitor(record), None
    for k in range(4):
        alarm = monitor.add(touches_of(DECLARED, 10 + k, moved(l1=4e-6 * k)).select(np.arange(48))) or alarm
    assert alarm is not None
    assert 'l1' in (alarm.best.name, *alarm.rivals)


def test_what_no_single_part_explains_has_no_name(record: CalibrationRecord) -> None:
    for change in ({'x0': 3e-3}, {'theta2': 1e-2}, {'l1': 1e-3, 'theta2': 2e-3, 'p1': TRUTH.p1}):
        alarm = DriftMonitor(record).add(touches_of(DECLARED, 4, moved(**change)).select(np.arange(36)))
        assert alarm is not None and alarm.is_explained == (len(change) == 1)
    assert 'no single part explains it' in alarm_line(alarm, None)
    one, bad = DriftMonitor(record), touches_of(DECLARED, 4, moved(l1=1e-3)).select(np.arange(36))
    joints = bad.joints.copy()
    joints[7] += 1e-2
    alarm = one.add(replace(bad, joints=joints))
    assert alarm is not None and alarm.is_explained and 'link 1 changed its length' in alarm_line(alarm, None)


def test_a_bad_touch_long_ago_has_no_part_in_a_name(record: CalibrationRecord, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drift, 'MEMORY', 100)
    monitor = DriftMonitor(record)
    changed = [touches_of(DECLARED, 100 + k, moved(l1=2e-5)) for k in range(2)]
    for number, touches in enumerate(changed):
        joints = touches.joints.copy()
        joints[7] += 5e-2 * (number == 0)
        measured = monitor.measure(replace(touches, joints=joints))
        for k in range(len(touches)):
            last = number == len(changed) - 1 and k == len(touches) - 1
            alarm = monitor.add_measured(measured.select(slice(k, k + 1)), int(touches.disc[k]), named=last)
    assert monitor.count > drift.MEMORY
    assert alarm is not None and alarm.best.name == 'l1' and alarm.touch < 100
    assert abs(alarm.best.change[0] - 2e-5) < 4 * alarm.best.std[0]


def test_estimated_noise_raises_the_threshold() -> None:
    """The fewer touches have estimated it, the more."""
    cell = replace(DECLARED, noise=None)
    few, many = (DriftMonitor(record_of(cell, 0, count=count)).threshold for count in (6, 24))
    assert 20 < many < few < 30

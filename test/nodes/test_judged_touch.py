"""What is published about each touch."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.model.parameters import PAPER_MEASURED
from scara_kinetostatic.nodes.session import judged_touches
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.detection import DISCARDED, Detection, Episode, find_touches, no_touches


def values(message: DiagnosticArray) -> dict[str, str]:
    (status,) = message.status
    return {item.key: item.value for item in status.values}


def test_accepted_rejected_and_discarded_touches_say_so():
    plan = default_plan(PAPER_CELL).select(np.arange(4))
    streams = simulate_streams(PAPER_CELL, PAPER_MEASURED, plan, seed=1)
    detection = find_touches(streams, PAPER_CELL)
    first, *_, last = judged_touches(detection, PAPER_CELL)
    message = first.message('/a/collector', '/bags/one', 'base')
    told = values(message)
    assert message.status[0].level == DiagnosticStatus.OK
    assert message.status[0].name == '/a/collector: touch 0'
    assert (told['accepted'], told['discarded'], told['reason']) == ('true', 'false', '')
    assert (told['object'], told['touch'], told['recording']) == (PAPER_CELL.discs[plan.disc[0]].name, '0', '/bags/one')
    touch = detection.touches
    assert [float(told[key]) for key in ('fx_N', 'fy_N', 'q1_rad', 'q2_rad')] == [*touch.force[0], *touch.joints[0]]
    stamp = 1e-9 * (message.header.stamp.sec * 10**9 + message.header.stamp.nanosec - detection.start)
    assert detection.episodes[0].contact[0] < stamp < detection.episodes[0].contact[1]

    discarded = last._replace(reason=DISCARDED).message('/a/collector', '/bags/one', 'base')
    assert (values(discarded)['accepted'], values(discarded)['discarded']) == ('false', 'true')
    rejected = last._replace(reason='it slips').message('/a/collector', '/bags/one', 'base')
    assert rejected.status[0].level == DiagnosticStatus.WARN
    assert (values(rejected)['accepted'], values(rejected)['reason']) == ('false', 'it slips')


def test_a_contact_without_a_hold_has_no_numbers():
    episode = Episode(0, (1.0, 2.0), (1.0, 2.0), 'held for 0.05 s')
    (touch,) = judged_touches(Detection(no_touches(), episodes=(episode,), start=10**9), PAPER_CELL)
    told = values(touch.message('/collector', 'r', 'base'))
    assert touch.stamp == 2_500_000_000
    assert (told['accepted'], told['reason']) == ('false', 'held for 0.05 s')
    assert told['fx_N'] == told['q1_rad'] == told['object'] == ''

"""The calibrator guides a hand: the next touch, its reason, the uncertainty that falls; nothing without limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import atan2
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nodes.waiting import Bench

from scara_kinetostatic.model.cell import PAPER_CELL, Cell, EffectSizes, Region, SizeMode, Uncertainty
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.nodes.calibrator import Calibrator
from scara_kinetostatic.nodes.cell_node import OK, WARN
from scara_kinetostatic.nodes.session import JudgedTouch
from scara_kinetostatic.nodes.streams import LATCHED_TOUCHES
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

CELL = replace(
    PAPER_CELL,
    limits=((-2.6, 2.6), (-2.6, 2.6)),
    region=Region(-0.35, 0.35, 0.2, 0.55),
    tolerance=4e-4,
    uncertainty=Uncertainty(effects=EffectSizes(SizeMode.NONE)),
)


class Hand(Bench):
    """Makes the touches that the calibrator asks for, as the collector would report them."""

    cell: Cell

    def __init__(self, node: Calibrator) -> None:
        super().__init__(node)
        self.poses = self.hear(PoseStamped, 'calibrator/next_touch')
        self.states: list[Any] = []
        self.on(DiagnosticArray, 'calibrator/state', lambda array: self.states.extend(array.status))
        self.report = self.robot.create_publisher(DiagnosticArray, 'collector/touch', LATCHED_TOUCHES)
        self.made = 0

    @property
    def values(self) -> dict[str, str]:
        return {item.key: item.value for item in self.states[-1].values}

    def wanted(self) -> Plan:
        """The touch that is asked for."""
        names, values, text = [disc.name for disc in self.cell.discs], self.values, self.states[-1].message
        side = 1 if ', left, ' in text else -1
        angle = np.radians(float(values['angle_deg']))
        return Plan([names.index(values['object'])], [angle], [side], [float(values['force_N'])])

    def touch(self, accepted: bool = True) -> None:
        """Makes it, and waits for the next."""
        plan, number, said = self.wanted(), self.made, len(self.states)
        made = simulate_touches(self.cell, PAPER_ACTUAL, plan, seed=number)
        values = made.force[0].tolist(), made.joints[0].tolist(), (*made.approach[0], *made.press[0])
        name = self.cell.discs[int(plan.disc[0])].name
        judged = JudgedTouch(number, 10**9 * (number + 1), '' if accepted else 'slipped', name, *map(tuple, values))
        self.report.publish(judged.message('/collector', '/bags/hand', 'base'))
        self.made += accepted
        self.wait(lambda: len(self.states) > said)


@pytest.fixture
def hand(bench: Callable[..., Any], cell_in: Callable[..., Any]) -> Callable[[Cell], Hand]:
    def make(cell: Cell) -> Hand:
        made: Hand = bench(Calibrator, on=Hand, cell=cell_in(cell))
        made.cell = cell
        return made

    return make


def test_a_hand_is_guided_until_a_calibration_is_accurate_enough(hand):
    h = hand(CELL)
    h.wait(lambda: h.poses and h.states)
    falling = [float(h.values['tip_uncertainty_m'])]
    for number in (1, 2, 3):
        status, plan, pose = h.states[-1], h.wanted(), h.poses[-1].pose
        disc = CELL.discs[int(plan.disc[0])]
        degrees, force = np.degrees(plan.angle[0]) % 360, plan.force[0]
        side = 'left' if plan.posture[0] > 0 else 'right'
        assert status.level == OK
        assert status.message.startswith(f'next: {disc.name} at {degrees:.0f}°, {side}, {force:.0f} N, it ')
        assert 'tolerance 400 µm' in status.message
        assert h.poses[-1].header.frame_id == 'base_link'
        away = np.array([pose.position.x - disc.x, pose.position.y - disc.y])
        assert np.hypot(*away) == pytest.approx(disc.radius)
        x_axis = 2 * atan2(pose.orientation.z, pose.orientation.w)
        np.testing.assert_allclose([np.cos(x_axis), np.sin(x_axis)], away / disc.radius, atol=1e-9)
        h.touch()
        falling.append(float(h.values['tip_uncertainty_m']))
        assert sum(int(part.split()[-1]) for part in h.values['touches'].split(', ')) == number
        if number == 2:  # one that is rejected changes nothing
            h.touch(accepted=False)
            assert float(h.values['tip_uncertainty_m']) == falling[-1]
    assert falling == sorted(falling, reverse=True)
    touches, said = simulate_touches(CELL, PAPER_ACTUAL, default_plan(CELL), seed=1), len(h.states)
    outcome = calibrate_touches(touches, CELL)
    h.node._guidance.use(CalibrationRecord.of_outcome(outcome))
    h.wait(lambda: len(h.states) > said)
    assert h.states[-1].message.startswith('enough touches: ')
    assert float(h.values['tip_uncertainty_m']) == pytest.approx(outcome.tip_uncertainty.worst, rel=0.5)
    h.wait(lambda: not h.poses[-1].header.frame_id)


def test_a_cell_in_which_nothing_can_be_touched_is_said(hand):
    h = hand(replace(CELL, limits=((-2.6, -2.5), (-2.6, 2.6))))
    h.wait(lambda: h.states)
    assert h.states[-1].level == WARN
    assert h.states[-1].message.startswith('no touch can be planned: no touch can be reached: ')
    assert not h.poses


def test_no_guidance_without_limits(hand):
    h = hand(PAPER_CELL)
    h.wait(lambda: len(h.statuses) > 1)
    assert h.value('next touch') == 'none: a cell with limits is needed'
    assert not h.poses and not h.states

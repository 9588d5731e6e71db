"""What of the effects the default plan can show."""

from __future__ import annotations

import pytest
from effects.observability import least_new, visibility
from model.helpers import ROBOTS

ALIASES = ('link_bending[link2].compliance', 'base_compliance.common', 'anisotropic_gripper.excess')
"""What is a part of L̄ to first order."""


@pytest.mark.parametrize('robot', ROBOTS)
def test_all_effects_show_but_the_aliases(robot):
    for item in visibility(robot):
        if item.label in ALIASES:
            assert item.new < 1e-3
        else:
            assert item.new > 0.015, item
            assert item.doubling < item.scale, item


@pytest.mark.parametrize('robot', ROBOTS)
def test_no_combination_of_the_parameters_of_an_effect_is_a_part_of_the_arm(robot):
    """One that is belongs into `Parameter.is_alias`."""
    for label, new in least_new(robot, ALIASES).items():
        assert new > 0.015, label


def test_hysteresis_shows_by_approaches_from_both_sides():
    alike, both = ({v.label: v.new for v in visibility(ROBOTS[0], preload=press)} for press in (0.0, 0.3))
    for joint in (1, 2):
        label = f'joint_hysteresis[joint{joint}].width'
        assert alike[label] < 0.5
        assert both[label] > 0.95


def test_a_coupling_of_the_joints_and_the_slope_of_a_cable_show_by_both_postures():
    one, both = ({v.label: v.new for v in visibility(ROBOTS[0], both_postures=some)} for some in (False, True))
    for label in ('joint_coupling[joint1].coupling', 'joint_coupling[joint2].coupling', 'cable_pull[joint2].slope'):
        assert one[label] < 0.3 * both[label]
    for label in ('tip_shape[three-lobed].a', 'contact_friction[disc_1].coefficient'):
        assert one[label] > 0.9

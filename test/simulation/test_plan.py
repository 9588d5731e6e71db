"""Plans mix what must be mixed, keep to the reach and say what is wrong with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scara_kinetostatic.errors import CellError, InputError, ParameterError
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Disc
from scara_kinetostatic.model.kinematics import inverse
from scara_kinetostatic.model.parameters import PAPER_NOMINAL
from scara_kinetostatic.simulation.plan import (
    CLEARANCE,
    LIMIT_MARGIN,
    REACH_MARGIN,
    Plan,
    PlanError,
    default_plan,
    dump_plan,
    load_plan,
    parse_plan,
)

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS)


def test_default_plan_of_the_paper_cell():
    plan = default_plan(CELL)
    assert len(plan) == 72
    for disc in range(3):
        for posture in (1, -1):
            here = (plan.disc == disc) & (plan.posture == posture)
            angles = np.sort(np.rad2deg(plan.angle[here]))
            np.testing.assert_allclose(angles, 30.0 * np.arange(12), atol=1e-9)
            assert np.unique(plan.force[here], return_counts=True)[1].tolist() == [4, 4, 4]


def test_levels_do_not_follow_order_or_direction():
    plan = default_plan(CELL)
    level = plan.force - plan.force.mean()
    for other in (np.arange(len(plan)), np.cos(plan.angle), np.sin(plan.angle), plan.posture, plan.disc):
        assert abs(np.corrcoef(level, other)[0, 1]) < 0.2
    for one in (np.cos(plan.angle), np.sin(plan.angle), plan.disc):
        assert abs(np.corrcoef(np.arange(len(plan)), one)[0, 1]) < 0.25


def test_points_out_of_reach_are_left_out():
    far = replace(CELL, discs=(Disc('far', 0.5, 0.3, 0.1), Disc('near', 0.12, 0.0, 0.08)))
    plan = default_plan(far)
    assert 0 < np.sum(plan.disc == 0) < 24
    assert 0 < np.sum(plan.disc == 1) < 24
    away = np.linalg.norm(plan.contact(far), axis=1)
    assert np.all(away <= 0.66 - REACH_MARGIN)
    clear = plan.contact(far) + CLEARANCE * plan.normal()
    assert np.all(np.isfinite(inverse(far.nominal, clear, plan.posture)))


def test_points_behind_another_disc_are_left_out():
    close = replace(CELL, discs=(Disc('one', 0.2, 0.3, 0.05), Disc('two', 0.31, 0.3, 0.05)))
    plan = default_plan(close)
    assert not np.any((plan.disc == 0) & (np.abs(plan.angle) < 0.1))
    assert not np.any((plan.disc == 1) & (np.abs(plan.angle - np.pi) < 0.1))


def test_touches_beyond_the_limits_are_left_out():
    cell = replace(CELL, limits=((-0.5, 2.0), (-2.2, 2.2)))
    plan, free = default_plan(cell, per_disc=24), default_plan(CELL, per_disc=24)
    for distance in (0.0, CLEARANCE):
        tip = plan.contact(cell) + distance * plan.normal()
        assert cell.can_take(inverse(cell.nominal, tip, plan.posture), LIMIT_MARGIN).all()
    assert 40 < len(plan) < 0.6 * len(free)
    possible = cell.can_take(inverse(cell.nominal, free.contact(cell), free.posture))
    with pytest.raises(PlanError, match=r'touch 0: the arm does not reach it .*robot\.limits'):
        parse_plan(dump_plan(free.select(~possible), cell), cell)
    with pytest.raises(CellError, match=r'disc_1: no point of the disc is within reach .* robot\.limits'):
        default_plan(replace(CELL, limits=((0.0, 0.8), (0.0, 0.8))))


@pytest.mark.parametrize('levels', [(40.0,), (10.0, 40.0), (10.0, 25.0, 40.0), (10.0, 20.0, 30.0, 40.0)])
def test_every_other_touch_is_preloaded(levels):
    plain, plan = default_plan(CELL, levels=levels), default_plan(CELL, levels=levels, preload=0.3)
    assert not plain.preload.any()
    np.testing.assert_array_equal(plan.force, plain.force)
    beyond = plan.preload > 0
    assert np.all(plan.preload[beyond] == 0.3)
    assert beyond.mean() == 0.5
    for kinds in (plan.disc, plan.posture, plan.force, plan.angle):
        shares = [beyond[kinds == kind].mean() for kind in np.unique(kinds)]
        np.testing.assert_allclose(shares, 0.5, atol=0.17)
    for disc in range(3):
        here = plan.disc == disc
        assert [beyond[here & (plan.posture == side)].mean() for side in (1, -1)] == [0.5, 0.5]
    assert abs(np.corrcoef(beyond, np.arange(len(plan)))[0, 1]) < 0.1


def test_preload_goes_with_the_touch():
    plan = default_plan(CELL, preload=0.3)
    np.testing.assert_array_equal(plan.select(plan.preload > 0).preload, np.full(36, 0.3))
    text = dump_plan(plan, CELL)
    assert text.count('preload: 0.3') == 36
    np.testing.assert_array_equal(parse_plan(text, CELL).preload, plan.preload)
    assert 'preload' not in dump_plan(default_plan(CELL), CELL)


@pytest.mark.parametrize(
    'change',
    [
        {'posture': [0]},
        {'force': [0.0]},
        {'force': [1.0, 2.0]},
        {'angle': [np.nan]},
        {'preload': [-0.1]},
        {'preload': [5.1]},
    ],
)
def test_senseless_plan(change):
    with pytest.raises(ParameterError, match=next(iter(change))):
        Plan(**{'disc': [0], 'angle': [0.0], 'posture': [1], 'force': [10.0], **change})


def test_plan_file(tmp_path):
    path = tmp_path / 'plan.yaml'
    path.write_text(
        '- {disc: disc_2, angle_deg: 90, posture: left, force: 12.5}\n'
        '- {disc: disc_1, angle_deg: -45, posture: -1, force: 40}\n'
    )
    plan = load_plan(path, CELL)
    assert plan.disc.tolist() == [1, 0]
    assert plan.posture.tolist() == [1, -1]
    np.testing.assert_allclose(plan.angle, np.deg2rad([90.0, -45.0]))
    np.testing.assert_allclose(plan.force, [12.5, 40.0])


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('disc: disc_1', 'expected a list with one touch or slide'),
        ('- {disc: disc_1, angle_deg: 0, posture: left}', "touch 0: the key 'force' is missing"),
        (
            '- {disc: disc_9, angle_deg: 0, posture: left, force: 1}',
            "touch 0: disc: the cell has no disc 'disc_9'; did you mean",
        ),
        ('- {disc: disc_1, angle_deg: 0, posture: up, force: 1}', 'touch 0: posture: expected left'),
        (
            '- {disc: disc_1, angle_deg: 0, posture: left, force: -3}',
            'touch 0: force: expected above 0, at most 10000 N, got -3',
        ),
        ('- {disc: disc_1, angle_deg: 0, posture: left, force: 3, preload: -1}', 'preload: expected 0 to 5'),
    ],
)
def test_wrong_plan_file(tmp_path, text, problem):
    path = tmp_path / 'plan.yaml'
    path.write_text(text)
    with pytest.raises(InputError, match=problem) as raised:
        load_plan(path, CELL)
    assert str(path) in str(raised.value)
    assert '\n' not in str(raised.value)

"""Uncertainty of the tip, and its budget."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import scara_kinetostatic as sk
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import (
    COVERAGE_FACTOR,
    Poses,
    tip_covariance,
    tip_derivative,
    tip_uncertainty,
    workspace,
)
from scara_kinetostatic.calibration.uncertainty_budget import uncertainty_budget
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import PAPER_CELL, Cell, Plate, Region, Uncertainty
from scara_kinetostatic.model.extended_model import TouchMetadata
from scara_kinetostatic.model.kinematics import forward, inverse
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL

Limits = tuple[tuple[float, float], tuple[float, float]]
MEASURED = replace(
    PAPER_CELL,
    discs=tuple(disc._replace(center_std=1.5e-5, radius_std=5e-6) for disc in PAPER_CELL.discs),
    uncertainty=Uncertainty(radius=2e-6, force_gain=0.005, force_rotation=1e-3, nominal={'l1': 1e-3}),
    plates=(Plate('a', 0.0, 0.3, 1e-4, 1e-4),),
)


def fitted(cell: Cell, seed: int = 3) -> Calibration:
    return calibrate(sk.simulate(cell, PAPER_ACTUAL, seed=seed), cell)


@pytest.fixture(scope='module')
def measured() -> Calibration:
    return fitted(MEASURED)


def random_poses(count: int) -> Poses:
    random = np.random.default_rng(5)
    posture = random.choice([1, -1], count)
    joints = np.column_stack([random.uniform(-3, 3, count), posture * random.uniform(0.4, 2.6, count)])
    return Poses(joints, posture, random.normal(scale=25.0, size=(count, 2)))


def test_twelve_directions_of_the_force_hold_the_worst_of_all(measured: Calibration) -> None:
    area = workspace(measured)
    joints, posture, force = (each.reshape(len(area.touched), 13, -1)[::40] for each in area.poses)
    assert not force[:, 0].any()
    angles = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    every = np.hypot(*force[0, 1]) * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    count = len(joints)
    poses = Poses(joints[:, 0].repeat(360, axis=0), posture[:, 0, 0].repeat(360), np.tile(every, (count, 1)))
    variances = np.linalg.eigvalsh(tip_covariance(tip_derivative(measured, poses), measured.covariance))[:, -1]
    ratio = np.sqrt(area.variances(measured.covariance)[::40].max(axis=1) / variances.reshape(count, 360).max(axis=1))
    assert ratio.min() > 0.9 and ratio.max() < 1.01 and np.median(ratio) > 0.95


@pytest.mark.parametrize('effect', ['', 'base_compliance', 'transmission_error[joint2]', 'object_radius[disc_2]'])
def test_derivative_of_the_tip_agrees_with_differences(measured: Calibration, effect: str) -> None:
    c, poses = measured, random_poses(40)
    if effect:
        c = replace(c, model=c.model.with_effects([find(c.cell, effect)]))
        sizes = [1e-2 * scale for scale in c.model.effect_scales]
        c = replace(c, model=c.model.with_array([*c.parameters.as_array(), *sizes]))
    found, values = tip_derivative(c, poses), c.model.as_array()
    metadata = TouchMetadata.plain(40)._replace(posture=poses.posture)
    for k, name in enumerate(c.model.names):
        step = 1e-3 * (np.arange(len(values)) == k) * (c.model.effect_scales[k - 12] if k >= 12 else 1e-3)
        ends = [
            direct_kinetostatics(c.model.with_array(values + sign * step), *poses[::2], metadata=metadata)[0]
            for sign in (1, -1)
        ]
        wanted = (ends[0] - ends[1]) / (2 * step[k])
        assert np.abs(found[..., k] - wanted).max() <= 0.02 * np.abs(wanted).max() + 1e-12, name


def test_variances_of_the_budget_add_up(measured: Calibration) -> None:
    tip = tip_uncertainty(measured)
    items = uncertainty_budget(measured, tip)
    squares = np.sum([item.parameters**2 for item in items], axis=0)
    assert squares == pytest.approx(measured.std**2, rel=1e-9)
    assert sum(item.tip**2 for item in items) == pytest.approx((tip.worst / COVERAGE_FACTOR) ** 2, rel=1e-9)
    assert [item.evaluation for item in items] == ['A', *'B' * (len(items) - 1)]
    assert [item.declared for item in items if item.label == 'force_gain'] == [0.005]


def test_the_worst_place_is_as_uncertain_as_a_prediction_there(measured: Calibration) -> None:
    tip = tip_uncertainty(measured)
    assert tip.at is not None
    found = sk.locate(measured, tip.at.joints, tip.at.force)
    std = np.sqrt(tip.at.direction @ found.covariance[0] @ tip.at.direction)
    assert COVERAGE_FACTOR * std == pytest.approx(tip.worst, rel=0.01)
    assert tip.at.tip == pytest.approx(forward(measured.parameters, tip.at.joints))


def test_the_workspace_is_mapped(measured: Calibration) -> None:
    tip = tip_uncertainty(measured)
    assert [each.posture for each in tip.maps] == [1, -1]
    expanded = np.stack([each.expanded for each in tip.maps])
    assert np.nanmax(expanded) == tip.worst
    assert np.nanmedian(expanded) == tip.median
    touched = np.stack([each.touched for each in tip.maps])
    assert 0.05 < touched.sum() / np.isfinite(expanded).sum() < 0.5
    assert tip.worst_touched == np.nanmax(expanded[touched]) < tip.worst
    assert tip.undetermined == 0


def test_a_region_bounds_it_and_its_maps(measured: Calibration) -> None:
    everywhere = tip_uncertainty(measured)
    assert everywhere.at is not None
    region = Region(-0.1, 0.3, 0.2, 0.5)
    assert not region.holds(everywhere.at.tip)  # behind the robot or far beyond the touches
    tip = tip_uncertainty(replace(measured, cell=replace(measured.cell, region=region)))
    assert tip.at is not None
    assert region.holds(tip.at.tip.round(9))
    assert tip.worst < everywhere.worst
    for each in tip.maps:
        assert (each.x[0], each.x[-1], each.y[0], each.y[-1]) == tuple(region)
    with pytest.raises(ParameterError, match='within reach'):
        workspace(replace(measured, cell=replace(measured.cell, region=Region(2.0, 3.0, 2.0, 3.0))))


LIMITS = ((-0.5, 2.0), (-2.2, 2.2))
REGION = Region(-0.35, 0.35, 0.2, 0.55)


def test_it_is_over_poses_within_the_limits(measured: Calibration) -> None:
    free = tip_uncertainty(replace(measured, cell=replace(measured.cell, region=REGION)))
    assert free.at is not None
    assert free.alone == (0, 0)
    c = replace(measured, cell=replace(measured.cell, region=REGION, limits=LIMITS))
    assert not c.cell.can_take(free.at.joints)
    area, tip = workspace(c), tip_uncertainty(c)
    assert c.cell.can_take(area.poses.joints).all()
    assert tip.at is not None
    assert c.cell.can_take(tip.at.joints)
    assert tip.worst < free.worst
    left, right = (np.isfinite(each.expanded) for each in tip.maps)
    for every, each in zip(free.maps, (left, right), strict=True):
        joints = inverse(c.parameters, np.stack(np.meshgrid(every.x, every.y), axis=-1), every.posture)
        np.testing.assert_array_equal(each, np.isfinite(every.expanded) & c.cell.can_take(joints))
    places = (left | right).sum()
    assert tip.alone == pytest.approx(((left & ~right).sum() / places, (right & ~left).sum() / places))
    assert tip.alone[0] > 0.5 > 0.01 > tip.alone[1]


def test_an_elbow_without_touches_counts_where_the_limits_ask_for_it() -> None:
    cell = replace(PAPER_CELL, region=REGION)
    touches = sk.simulate(cell, PAPER_ACTUAL, per_disc=24)
    right = calibrate(touches.select(touches.posture == -1), cell)
    limited = replace(right, cell=replace(cell, limits=LIMITS))
    tip, other = tip_uncertainty(limited), tip_uncertainty(right)
    assert [each.posture for each in other.maps] == [-1]
    alone, own = tip.maps
    assert (alone.posture, own.posture, bool(alone.touched.any())) == (1, -1, False)
    assert not (np.isfinite(alone.expanded) & np.isfinite(own.expanded)).any()
    counted = np.isfinite(alone.expanded) | np.isfinite(own.expanded)
    assert np.isfinite(alone.expanded).sum() / counted.sum() == pytest.approx(tip.alone[0])


def test_limits_that_leave_nothing_are_a_mistake(measured: Calibration) -> None:
    cell = replace(measured.cell, region=REGION, limits=((2.5, 2.6), (2.0, 2.2)))
    with pytest.raises(ParameterError, match=r'robot\.limits: they leave 0 % of the region within reach; correct them'):
        workspace(replace(measured, cell=cell))


@pytest.mark.parametrize('region', [REGION, Region()])
def test_what_narrow_limits_leave_is_the_workspace(measured: Calibration, region: Region) -> None:
    """The grid is that of the little that is left, the part that it is is stated."""
    c = replace(measured, cell=replace(measured.cell, region=region, limits=((0.4, 0.8), (0.6, 1.1))))
    area, tip = workspace(c), tip_uncertainty(c)
    assert c.cell.can_take(area.poses.joints).all()
    assert region.holds(forward(c.parameters, area.poses.joints).round(9)).all()
    assert area.reached.any(axis=0).sum() > 200
    square = 0.33**2 * 0.4 * (np.cos(0.6) - np.cos(1.1)) / (np.pi * (0.985 * 0.66) ** 2)
    assert 0 < tip.share < 0.1 and (region == REGION or tip.share == pytest.approx(square, rel=0.3))
    assert tip.at is not None and c.cell.can_take(tip.at.joints)


def test_where_the_tip_is_not_determined_nothing_is_stated() -> None:
    touches = sk.simulate(PAPER_CELL, PAPER_ACTUAL, per_disc=24)
    c = calibrate(touches.select(touches.disc == 0), PAPER_CELL)
    assert 'confounded' in c.status.values()
    tip = tip_uncertainty(c)
    assert tip.undetermined == 1
    assert tip.at is None
    assert np.isnan([tip.median, tip.worst, tip.worst_touched]).all()
    budget = uncertainty_budget(c, tip)
    assert np.isnan(budget[0].tip)
    for name, status in c.status.items():
        assert (status == 'confounded') == bool(np.isnan(budget[0].parameters[NAMES.index(name)]))

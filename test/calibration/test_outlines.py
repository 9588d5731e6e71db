"""Calibration by touches of outlines: recovery, statistics, declared errors, effects, what is not determined."""

from dataclasses import replace

import numpy as np
import pytest

import scara_kinetostatic as sk
from benchmark.outlines import OBJECTS, cell_of, cell_with, plan_of
from scara_kinetostatic.assessment.mistakes import check_touches
from scara_kinetostatic.calibration.fit_point import force_residual
from scara_kinetostatic.calibration.gauss_helmert import linearise
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.effects.objects import ContactFriction, OffNormalForce
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, Parameters
from scara_kinetostatic.simulation.commanded import ModelBody
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.simulation.truth import parse_effect, with_effects
from scara_kinetostatic.touches.detection import associate

ELL, BLOCK, EDGE, DISC = (OBJECTS[name] for name in ('ell', 'block', 'edge', 'disc'))
TRUTH = Parameters(0.0025, -0.002, 0.004, 0.3312, -0.003, 0.3285, 1.3e-5, 2e-5, 3e-5, 5e-5, 1e-4, 1.5e-4)


CELLS = {name: cell_of(name) for name in ('block', 'L', 'edge and disc', 'mixture')}
PENTAGON = 'outline: [[0.06, 0.25], [0.14, 0.31], [0.11, 0.40], [0.01, 0.40], [-0.02, 0.31]], corner_radius: 0.002'
CELLS['pentagon and disc'] = cell_with(pentagon=PENTAGON, disc='center: [-0.25, 0.30], radius: 0.06')


@pytest.mark.parametrize('name', CELLS)
def test_exact_touches_give_back_the_robot(name):
    cell = CELLS[name]
    plan = default_plan(cell, 24, preload=0.3)
    assert (~cell.surfaces.is_edge[plan.surface(cell)]).sum() >= 8
    c = sk.calibrate(simulate_touches(cell, TRUTH, plan, Noise(0, 0)), cell)
    assert c.touches.surface.tolist() == plan.surface(cell).tolist()
    np.testing.assert_allclose(c.parameters.as_array(), TRUTH.as_array(), atol=1e-12)
    if name == 'edge and disc':  # a force passes an axis by less than a millimetre
        c = sk.calibrate(simulate_touches(cell, PAPER_ACTUAL, plan_of(cell), Noise(0, 0)), cell)
        np.testing.assert_allclose(c.parameters.as_array(), PAPER_ACTUAL.as_array(), atol=1e-12)


def test_a_touch_starts_on_a_wrong_edge_and_is_put_right():
    cell = CELLS['mixture']
    plan = default_plan(cell, 36)
    touches = simulate_touches(cell, TRUTH, plan, None, 3)
    assert (observe(touches, cell).surface != plan.surface(cell)).any()
    c = sk.calibrate(touches, cell)
    assert (c.touches.surface == plan.surface(cell)).all()
    assert not c.rejected


def _sharp():
    """The cell of the L with a sharp inner corner, and a disc."""
    return cell_with(ell=ELL.replace('corner_radius: 0.008', 'corner_radius: 0.001'), disc=DISC)


def test_an_inner_corner_sharper_than_the_tip_gives_back_the_robot():
    cell = _sharp()
    plan = default_plan(cell, 48, preload=0.3)
    one, other = cell.surfaces.inner_corners
    assert {*one.tolist(), *other.tolist()} <= {*plan.surface(cell).tolist()}, 'both edges are touched'
    assert not cell.surfaces.touch_both(plan.contact(cell), 5e-3).any()
    c = sk.calibrate(simulate_touches(cell, TRUTH, plan, Noise(0, 0)), cell)
    np.testing.assert_allclose(c.parameters.as_array(), TRUTH.as_array(), atol=1e-12)
    assert not c.rejected


def test_touches_of_both_edges_of_an_inner_corner_are_left_out_with_the_reason():
    cell = _sharp()
    touches = simulate_touches(cell, TRUTH, default_plan(cell, 24, preload=0.3), None, 1)
    one, other = (edges[0] for edges in cell.surfaces.inner_corners)
    corner = cell.surfaces.at(np.ones(len(cell.surfaces.radii)))[0][one]
    normals = cell.surfaces.normals[[one, other]]
    shares = np.array([[1.0, 0.2], [0.5, 0.5], [0.1, 1.0]])
    force = -30.0 * shares @ normals
    joints = inverse_kinetostatics(TRUTH, np.tile(corner, (3, 1)), force, np.ones(3, dtype=int), cell.gripper_sign)[0]
    both = np.vstack([touches.joints, joints]), np.vstack([touches.force, force])
    found = associate(*both, cell)
    assert np.flatnonzero(~found.known).tolist() == [len(touches) + 1]
    assert found.reason(len(touches) + 1, cell).startswith("in an inner corner of 'ell' the tip touches both edges")
    known = sk.make_touches(both[0][found.known], both[1][found.known], cell)
    c = sk.calibrate(known, cell)
    assert [each.index for each in c.rejected] == [len(touches), len(touches) + 1]
    assert {each.reason for each in c.rejected} == {'between two edges of ell: touch it farther from the corner'}
    alone = sk.calibrate(touches, cell)
    np.testing.assert_allclose(c.parameters.as_array(), alone.parameters.as_array(), atol=1e-9)


def test_touches_that_alternate_between_surfaces_are_refused(monkeypatch):
    cell = CELLS['block']
    touches = simulate_touches(cell, TRUTH, default_plan(cell, 12), None, 1)
    monkeypatch.setattr('scara_kinetostatic.calibration.calibrate.fitted_surfaces', lambda o, *_: o.surface ^ 1)
    with pytest.raises(UnsupportedDataError, match=r'do not settle on the edges|too much alike'):
        sk.calibrate(touches, cell)


def z_scores(c):
    return [(c[name].value - getattr(TRUTH, name)) / c[name].std for name in NAMES]


@pytest.mark.parametrize('name', ['mixture', 'edge and disc'])
def test_estimates_scatter_as_their_standard_deviations_say(name):
    cell = CELLS[name]
    plan = default_plan(cell, 12, preload=0.3)
    z = [z_scores(sk.calibrate(simulate_touches(cell, TRUTH, plan, None, seed), cell)) for seed in range(20)]
    assert 0.85 < np.sqrt(np.mean(np.square(z))) < 1.15


def test_declared_errors_of_outlines_are_in_the_uncertainty():
    stated = ', uncertainty: {center: 3.0e-5, angle: 3.0e-4, offset: 2.0e-5}'
    more = 'plates: [{name: a, origin: [0.0, 0.3], uncertainty: {center: 1.0e-4, angle: 1.0e-3}}]\n'
    more += 'uncertainty: {radius: 5.0e-6, effects: none}\n'
    cell = cell_with(more, ell=f'{ELL}{stated}, plate: a', block=BLOCK + stated, disc=DISC)
    z = []
    for seed in range(20):
        touches = sk.simulate(cell, TRUTH, seed=seed, drawn=seed)
        c = sk.calibrate(touches, cell)
        z.append(z_scores(c))
    assert 0.85 < np.sqrt(np.mean(np.square(z))) < 1.15
    plain = sk.calibrate(touches, replace(cell, discs=CELLS['mixture'].discs, plates=()))
    assert c['x0'].std > 2 * plain['x0'].std


def test_errors_by_cell_description_are_those_of_differences():
    stated = ', uncertainty: {center: 3.0e-5, angle: 3.0e-4, offset: 2.0e-5}'
    cell = cell_with(
        'plates: [{name: a, origin: [0.0, 0.3], uncertainty: {angle: 1.0e-3}}]\n', ell=f'{ELL}{stated}, plate: a'
    )
    touches = simulate_touches(cell, TRUTH, default_plan(cell, 24), Noise(0, 0))
    c = sk.calibrate(touches, cell)
    o, adjusted = observe(c.touches, cell, c.errors), c.projection.adjusted
    by_errors = linearise(o, c.model, adjusted).by_errors
    for k in range(len(c.errors)):
        step = 1e-2 * np.eye(len(c.errors))[k]
        up, down = (linearise(o.with_errors(c.errors + s), c.model, adjusted).misclosure for s in (step, -step))
        np.testing.assert_allclose((up - down) / 2e-2, by_errors[:, :, k], atol=1e-3 * np.abs(by_errors[:, :, k]).max())


BLOCK_ERRORS = {
    'object_rotation[block]': ('angle', 1e-3),
    'object_offset[block]': ('offset', -3e-5),
    'edge_bow[block.2]': ('bow', 4e-5),
}


@pytest.mark.parametrize('label', BLOCK_ERRORS)
def test_errors_of_a_block_are_estimated_and_one_that_is_unknown_is_named(label):
    cell, (name, value) = CELLS['mixture'], BLOCK_ERRORS[label]
    law = find(cell, label)
    truth = ExtendedModel(TRUTH, (law,), ((value,),))
    touches = simulate_touches(cell, truth, default_plan(cell, 24, preload=0.3), None, 4)
    if name == 'bow':
        found = sk.diagnose(touches, cell).effects
        assert set(found) == {label}
    else:
        found = sk.calibrate(touches, cell, [law]).effects
    assert abs(found[label][name].value - value) < 4 * found[label][name].std < abs(value)


def test_a_rotated_block_is_one_whose_corners_are_rotated():
    cell = CELLS['mixture']
    turned = replace(cell, discs=(cell.discs[0], cell.discs[1].moved((0.0, 0.0), 1e-3), cell.discs[2]))
    plan = default_plan(cell, 24)
    touches = simulate_touches(turned, TRUTH, plan, Noise(0, 0))
    effect = parse_effect('object_rotation[block]:angle=1e-3', cell).effect
    c = sk.calibrate(touches, cell, [effect])
    assert c.model.values['object_rotation[block]']['angle'] == pytest.approx(1e-3, abs=1e-6)
    assert c.force_error < 1e-2


def test_a_bowed_edge_is_an_arc_of_a_large_circle():
    cell, s, bow = CELLS['L'], CELLS['L'].surfaces, 4e-5
    bowed = parse_effect(f'edge_bow[ell.4]:bow={bow}', cell)
    edge, model = bowed.effect.surface, with_effects(TRUTH, [bowed])
    assert s.tangents[edge].tolist() == [0.0, 1.0]
    assert bowed.effect.title == 'edge 4 of ell is not straight'
    plan = default_plan(cell, 100)
    touches, on_edge = simulate_touches(cell, model, plan, Noise(0, 0)), plan.surface(cell) == edge
    assert on_edge.sum() >= 10
    large = (s.halves[edge] ** 2 + bow**2) / (2 * bow)
    center = s.centers[edge] + (s.radii[edge] + bow - cell.tip_radius - large) * s.normals[edge]
    count = int(on_edge.sum())
    found = contact(
        TRUTH, touches.joints[on_edge], np.tile(center, (count, 1)), np.full(count, large + cell.tip_radius)
    )
    np.testing.assert_allclose(found.force, touches.force[on_edge], atol=1e-2)  # N; without the slope 0.06 N off
    c = sk.calibrate(touches, cell, [bowed.effect])
    assert c.model.values[bowed.effect.label]['bow'] == pytest.approx(bow, abs=1e-9)
    body = ModelBody(cell, model)
    body.begin(tuple(touches.joints[on_edge][0] + (0.0, 0.1)), 0.0)
    body.advance(1.0, tuple(touches.joints[on_edge][0]), 0.0)
    np.testing.assert_allclose(body.force, touches.force[on_edge][0], atol=1e-6)


def test_friction_on_edges_and_corners_is_estimated():
    cell = CELLS['mixture']
    effect = parse_effect('contact_friction:coefficient=0.1', cell)
    plan = default_plan(cell, 24, preload=0.3)
    touches = simulate_touches(cell, with_effects(TRUTH, [effect]), plan, Noise(0, 0))
    c = sk.calibrate(touches, cell, start=ExtendedModel(cell.nominal, (effect.effect,), ((0.0,),)))
    assert c.model.values['contact_friction']['coefficient'] == pytest.approx(0.1, abs=1e-6)
    np.testing.assert_allclose(c.parameters.as_array(), TRUTH.as_array(), atol=1e-8)
    by_angles = ExtendedModel(c.parameters, (OffNormalForce(),), ((),))
    np.testing.assert_allclose(force_residual(observe(c.touches, cell), by_angles), 0.0, atol=1e-4)


def test_friction_on_a_corner_is_found_however_far_off_the_nominal_arm_is():
    """Off by half the radius of the tip on a sharp corner, it would have the tip slide the other way."""
    cell = replace(CELLS['mixture'], nominal=PAPER_ACTUAL.replace(x0=-0.001, y0=0.002, theta1=0.006))
    truth = ExtendedModel(TRUTH, (ContactFriction(),), ((0.05,),))
    touches = simulate_touches(cell, truth, default_plan(cell, 24, preload=0.3), None, 2)
    c = sk.calibrate(touches, cell, [find(cell, 'contact_friction')])
    assert c.used.mean() > 0.98
    assert c.model.values['contact_friction']['coefficient'] == pytest.approx(0.05, abs=2e-3)


PARALLEL = {
    'a': 'outline: [[0.3, 0.3], [-0.3, 0.3]], open: true',
    'b': 'outline: [[-0.3, 0.45], [0.3, 0.45]], open: true',
}


@pytest.mark.parametrize(('objects', 'is_free'), [({'edge': EDGE}, True), (PARALLEL, True), ({'block': BLOCK}, False)])
def test_the_base_is_not_determined_along_edges_that_are_all_parallel(objects, is_free):
    cell = cell_with(**objects)
    c = sk.calibrate(simulate_touches(cell, TRUTH, default_plan(cell, 48, preload=0.3), None, 1), cell)
    named = {name for group in c.identifiability.confounded for name in group}
    assert bool({'x0', 'y0'} & named) == is_free == (c.identifiability.rank < 12)


def test_a_block_turned_by_90_degrees_is_refused():
    cell, touches = CELLS['mixture'], sk.simulate(CELLS['mixture'], TRUTH, seed=2)
    turned = replace(cell, discs=(cell.discs[0].moved((0.0, 0.0), np.pi / 2), *cell.discs[1:]))
    with pytest.raises(UnsupportedDataError, match='check the places of the objects'):
        sk.diagnose(touches, turned)


def _upright(cell, **moments):
    """The cell with gravity, its nominal moments 20 % low, and the robot in it."""
    gravity = {'gravity': (0.0, -9.81)}
    low = {name: 0.8 * value for name, value in moments.items()}
    return replace(cell, nominal=cell.nominal.replace(**gravity, **low)), TRUTH.replace(**gravity, **moments)


def test_under_gravity_one_block_alone_is_refused_unless_the_moments_are_held():
    cell, truth = _upright(CELLS['block'], s1=2.0, s2=0.6)
    touches = sk.simulate(cell, truth, seed=1, per_disc=36)
    with pytest.raises(UnsupportedDataError, match='under gravity touches of one outline alone'):
        sk.calibrate(touches, cell)
    held = sk.calibrate(touches, cell, fixed={'s1': 2.0, 's2': 0.6})
    assert max(abs(held[n].value - getattr(truth, n)) / held[n].std for n in NAMES) < 4.5


def test_inner_corners_are_touched_under_gravity():
    cell, truth = _upright(CELLS['L'], s1=2.0, s2=0.6)
    plan, surfaces = default_plan(cell, 100), cell.surfaces
    touches, at = simulate_touches(cell, truth, plan, Noise(0, 0)), plan.surface(cell)
    assert (surfaces.radii[at] < 0).any()
    places = surfaces.centers[at], surfaces.radii[at]
    found = contact(truth, touches.joints, *places, cell.gripper_sign, tangents=surfaces.tangents[at])
    inner = surfaces.radii[at] < 0
    np.testing.assert_allclose(found.force[inner], touches.force[inner], atol=1e-6)


def test_a_wrong_tip_is_named():
    second = 'outline: [[0.22, 0.20], [0.30, 0.16], [0.34, 0.24], [0.26, 0.28]], corner_radius: 0.003'
    cell = cell_with(block=BLOCK, second=second, disc='center: [0.25, 0.36], radius: 0.06')
    touches = sk.simulate(cell, TRUTH, seed=2)
    assert check_touches(touches, cell).found is None
    for radius, words in ((1e-4, 'the radius of the tip is missing'), (0.01, 'is its diameter')):
        found = check_touches(touches, replace(cell, tip_radius=radius)).found
        assert found is not None and words in found.statement

"""Outlines: geometry, equations of edges and corners, refusals."""

import numpy as np
import pytest

from scara_kinetostatic.errors import CellError
from scara_kinetostatic.files.cell_file import dump_cell, parse_cell
from scara_kinetostatic.model.cell import Disc
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.flanks import State
from scara_kinetostatic.model.kinematics import GripperSign
from scara_kinetostatic.model.outline import Outline, boundary, outline_problem, surfaces_of
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch_derivatives import all_derivatives
from scara_kinetostatic.model.touch_equations import ContactProblem, Edges, extended_equations

SQUARE = Outline('square', ((0.0, 0.3), (0.1, 0.3), (0.1, 0.4), (0.0, 0.4)), 0.002)
ELL = Outline('ell', ((0.0, 0.0), (0.2, 0.0), (0.2, 0.07), (0.08, 0.07), (0.08, 0.18), (0.0, 0.18)), 0.008)
BAR = Outline('bar', ((0.3, 0.0), (0.3, 0.1), (0.2, 0.2)), is_open=True)
ARM = Parameters(0.002, -0.001, 0.01, 0.33, -0.02, 0.32, 1.3e-5, 2e-5, 3e-5, 5e-5, 1e-4, 1.5e-4)
TIP = 0.005
CELL = """
robot:
  nominal: {{x0: 0.0, y0: 0.0, theta1: 0.0, l1: 0.33, theta2: 0.0, l2: 0.33,
            p_ee: 1.0e-5, p1: 1.0e-5, p2: 1.0e-5, g_ee: 0.0, g1: 0.0, g2: 0.0}}
tip: {{radius: 0.005}}
objects:
{}
"""
BLOCK = '  - {name: block, outline: [[0.1, 0.3], [0.2, 0.3], [0.2, 0.4], [0.1, 0.4]]}'


@pytest.mark.parametrize('outline', [SQUARE, ELL, SQUARE._replace(is_open=True), ELL._replace(corner_radius=0.02)])
def test_the_grown_outline_is_tangent_continuous_and_a_tip_away(outline):
    surfaces = surfaces_of([outline], TIP)
    ones = np.ones(len(surfaces.radii))
    (begin, into), (end, out) = surfaces.at(-ones), surfaces.at(ones)
    count = len(ones) - outline.is_open
    np.testing.assert_allclose(end[:count], np.roll(begin, -1, axis=0)[:count], atol=1e-12)
    np.testing.assert_allclose(out[:count], np.roll(into, -1, axis=0)[:count], atol=1e-12)
    bare = surfaces_of([outline], 0.0)
    for part in (-0.7, 0.0, 0.4):
        place, _ = surfaces.at(part * ones)
        np.testing.assert_allclose(bare.distances(place).min(axis=1), TIP, atol=1e-12)
        np.testing.assert_allclose(surfaces.distances(place).min(axis=1), 0.0, atol=1e-12)


@pytest.mark.parametrize('radius', [0.0, 0.003, TIP])
@pytest.mark.parametrize('is_open', [False, True])
def test_an_inner_corner_sharper_than_the_tip_is_where_two_edges_meet(radius, is_open):
    outline = ELL._replace(corner_radius=radius, is_open=is_open)
    assert outline_problem(outline, TIP) is None
    surfaces = surfaces_of([SQUARE, outline, BAR], TIP)
    (one,), (other,) = surfaces.inner_corners
    assert surfaces.object[one] == surfaces.object[other] == 1
    corner = surfaces.at(np.ones(len(surfaces.radii)))[0][one]
    np.testing.assert_allclose(corner, [0.08 + TIP, 0.07 + TIP], atol=1e-12)
    np.testing.assert_allclose(surfaces.at(-np.ones(len(surfaces.radii)))[0][other], corner, atol=1e-12)
    assert surfaces.is_edge[[one, other]].all()
    line = boundary(surfaces.select(surfaces.object == 1))
    np.testing.assert_allclose(surfaces_of([outline], 0.0).distances(line).min(axis=1), TIP, atol=1e-12)
    near = np.array([[0.0, 0.0], [4e-4, -4e-4], [0.0, 2e-3], [2e-3, 0.0]]) + corner
    assert surfaces.touch_both(near, 1e-3).tolist() == [True, True, False, False]
    assert not surfaces_of([SQUARE, ELL], TIP).touch_both(near, 1e-3).any()


def test_a_whole_turn_goes_once_round():
    surfaces = surfaces_of([SQUARE, ELL], TIP)
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    for number in (0, 1):
        which, part = surfaces.places(np.full(400, number), angle)
        place = surfaces.select(which).at(part)[0]
        assert set(which.tolist()) == set(np.flatnonzero(surfaces.object == number).tolist())
        line = boundary(surfaces.select(surfaces.object == number))
        assert np.hypot(*(place[:, None] - line).transpose(2, 0, 1)).min(axis=1).max() < 1e-3
        assert (np.diff(which) >= 0).all()


def test_the_place_of_a_touch_is_found_again():
    surfaces, random = surfaces_of([Disc('disc', 0.5, 0.0, 0.1), SQUARE, ELL], TIP), np.random.default_rng(3)
    number, angle = random.integers(0, 3, 300), random.uniform(-np.pi, np.pi, 300)
    which, part = surfaces.places(number, angle)
    place, normal = surfaces.select(which).at(part)
    again, part = surfaces.places(number, surfaces.angles(number, place, -normal))
    assert (again == which).all()
    off = np.hypot(*(surfaces.select(again).at(part)[0] - place).T)
    assert off[number == 0].max() < 1e-12
    assert off.max() < 1e-3


def test_a_touch_is_nearest_to_its_own_edge_or_corner():
    surfaces, random = surfaces_of([SQUARE, ELL], TIP), np.random.default_rng(1)
    which = random.integers(0, len(surfaces.radii), 300)
    place, normal = surfaces.select(which).at(random.uniform(-0.9, 0.9, 300))
    size = np.hypot(*surfaces.misses(place, -normal, 0.1).transpose(2, 0, 1))
    assert (size.argmin(axis=1) == which).all()
    np.testing.assert_allclose(size.min(axis=1), 0.0, atol=1e-12)


def _touched(outline):
    """Joint angles pressed into each surface of an outline, and the problem."""
    surfaces = surfaces_of([outline], TIP)
    place, normal = surfaces.at(np.linspace(-0.6, 0.5, len(surfaces.radii)))
    from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics

    force = -np.linspace(8.0, 40.0, len(normal))[:, None] * normal
    joints = inverse_kinetostatics(ARM, place, force, np.ones(len(normal), dtype=int))[0]
    return surfaces, joints, force, place


@pytest.mark.parametrize('outline', [SQUARE, Outline('e', tuple((x + 0.1, y + 0.25) for x, y in ELL.corners), 0.008)])
def test_contact_is_the_inverse_of_the_press(outline):
    surfaces, joints, force, place = _touched(outline)
    found = contact(ARM, joints, surfaces.centers, surfaces.radii, tangents=surfaces.tangents, warm_start=force)
    assert found.solved.all()
    np.testing.assert_allclose(found.force, force, atol=1e-7)
    np.testing.assert_allclose(found.tip, place, atol=1e-12)


def test_no_force_before_an_edge():
    surfaces, joints, force, _ = _touched(SQUARE)
    outward = -force / np.hypot(*force.T)[:, None]
    away = surfaces.centers + 0.002 * outward
    moved = contact(ARM, joints, surfaces.centers - 0.002 * outward, surfaces.radii, tangents=surfaces.tangents)
    assert not moved.force.any()
    pressed = contact(ARM, joints, away, surfaces.radii, tangents=surfaces.tangents, warm_start=force)
    assert (pressed.magnitude > np.hypot(*force.T)).all()


def test_derivatives_at_edges_are_those_of_differences():
    surfaces, joints, _, _ = _touched(SQUARE)
    model, edges = ExtendedModel(ARM), Edges.of(surfaces.tangents, surfaces.radii)
    problem = ContactProblem(joints, surfaces.centers, surfaces.radii, GripperSign.PHYSICAL, edges=edges)
    found = contact(ARM, joints, surfaces.centers, surfaces.radii, tangents=surfaces.tangents)
    state = found.state
    h = all_derivatives(model, problem, state, extended_equations(model, problem, state))

    def residual(values, state):
        e = extended_equations(model.with_array(values), problem, state)
        return e.h * e.rows.arm.normal

    values = ARM.as_array()
    for k in range(12):
        step = np.zeros(12)
        step[k] = 1e-6 * (1e-3 if 6 <= k <= 8 else 1.0)
        difference = (residual(values + step, state) - residual(values - step, state)) / (2 * step[k])
        seen = difference * np.exp(-1j * state.direction)
        np.testing.assert_allclose(seen.real, h[:, 0, k], rtol=1e-5, atol=1e-7)
        np.testing.assert_allclose(seen.imag, h[:, 1, k], rtol=1e-5, atol=1e-7)
    e = extended_equations(model, problem, state)
    for number, size in ((2, 1e-4), (3, 1e-6)):
        up, down = (State(*(part + sign * size * (j == number) for j, part in enumerate(state))) for sign in (1, -1))
        difference = (residual(values, up) - residual(values, down)) / (2 * size)
        np.testing.assert_allclose(difference * np.exp(-1j * state.direction), e.h_by[number - 2], rtol=1e-4, atol=1e-9)


def test_displacements_at_edges_add_up():
    surfaces, joints, _, _ = _touched(SQUARE)
    edges = Edges.of(surfaces.tangents, surfaces.radii)
    problem = ContactProblem(joints, surfaces.centers, surfaces.radii, GripperSign.PHYSICAL, edges=edges)
    first, second = np.random.default_rng(0).normal(0, 1e-4, (2, len(joints), 2))
    one, two = problem.shifted_by(None, first + second), problem.shifted_by(None, first).shifted_by(None, second)
    np.testing.assert_allclose(two.edges.aside, one.edges.aside, atol=1e-18)
    assert np.abs(one.edges.aside).max() > 1e-5
    np.testing.assert_array_equal(two.shifted_by(1e-3, None).edges.aside, two.edges.aside)


@pytest.mark.parametrize(
    ('entry', 'words'),
    [
        ('outline: [[0.1, 0.4], [0.2, 0.4], [0.2, 0.3], [0.1, 0.3]]', 'clockwise'),
        ('outline: [[0.1, 0.3], [0.2, 0.4], [0.2, 0.3], [0.1, 0.4]]', 'crosses itself'),
        ('outline: [[0.1, 0.3], [0.2, 0.3], [0.2, 0.4], [0.1, 0.4]], corner_radius: 0.06', 'larger than edge'),
        (
            'outline: [[0.1, 0.3], [0.2, 0.3], [0.2, 0.4], [0.154, 0.4], [0.154, 0.35], [0.146, 0.35], [0.146, 0.4], '
            '[0.1, 0.4]]',
            'the tip of 0.005 m does not fit between its sides',
        ),
        ('outline: [[0.1, 0.3], [0.1, 0.3], [0.2, 0.4]]', 'twice'),
        ('outline: [[0.1, 0.3], [0.2, 0.3]]', '3 to 50 corners'),
        ('outline: [[100.0, 300.0], [200.0, 300.0], [200.0, 400.0]]', 'm'),
        ('outline: [[0.1, 0.3], [0.2, 0.3], [0.2, 0.4]], radius: 0.1', "unknown key 'radius'"),
        ('outline: [[0.1, 0.3], [0.2, 0.3]], open: 1', 'true or false'),
        ('outline: [[2.1, 2.3], [2.2, 2.3], [2.2, 2.4]]', 'out of reach'),
        ('outline: [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]]', 'covers the base'),
    ],
)
def test_refused_outlines(entry, words):
    with pytest.raises(CellError) as error:
        parse_cell(CELL.format(f'  - {{name: block, {entry}}}'))
    assert words in str(error.value)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(
    ('other', 'words'),
    [
        ('  - {name: disc, center: [0.23, 0.35], radius: 0.03}', 'overlap'),
        ('  - {name: disc, center: [0.15, 0.35], radius: 0.03}', 'overlap'),
        ('  - {name: two, outline: [[0.205, 0.3], [0.3, 0.3], [0.3, 0.4]]}', 'overlap'),
        ('  - {name: two, outline: [[0.12, 0.32], [0.18, 0.32], [0.18, 0.38]]}', 'overlap'),
        ('  - {name: two, outline: [[0.0, 0.5], [0.15, 0.35], [0.4, 0.1]], open: true}', "'block' and 'two'"),
        ('  - {name: two, outline: [[0.23, 0.3], [0.3, 0.3], [0.3, 0.4]]}', ''),  # their circles overlap
    ],
)
def test_objects_that_overlap_are_refused(other, words):
    if words:
        with pytest.raises(CellError, match=words):
            parse_cell(CELL.format(f'{BLOCK}\n{other}'))
    else:
        assert len(parse_cell(CELL.format(f'{BLOCK}\n{other}')).discs) == 2


def test_open_edges_that_cross_are_refused_and_those_that_meet_are_not():
    edge = '  - {{name: {}, outline: [[{}, 0.3], [{}, {}]], open: true}}'.format
    with pytest.raises(CellError, match="'a' and 'b' cross"):
        parse_cell(CELL.format(edge('a', -0.3, 0.3, 0.3) + '\n' + edge('b', 0.0, 0.02, 0.5).replace('0.3]', '0.1]')))
    assert len(parse_cell(CELL.format(edge('a', -0.3, 0.0, 0.3) + '\n' + edge('b', 0.0, 0.0, 0.1))).discs) == 2


def test_without_a_tip_an_outline_is_refused():
    with pytest.raises(CellError, match="tip: its radius is needed for the outline of 'block'"):
        parse_cell(CELL.format(BLOCK).replace('tip: {radius: 0.005}\n', ''))


def test_a_narrow_slot_is_refused():
    corners = ((0, 0), (0.1, 0), (0.1, 0.1), (0.056, 0.1), (0.056, 0.02), (0.044, 0.02), (0.044, 0.1), (0, 0.1))
    assert outline_problem(Outline('u', corners, 0.0055), 0.005) is None
    wedge = ((0, 0), (0.1, 0), (0.1, 0.1), (0.0515, 0.1), (0.056, 0.02), (0.044, 0.02), (0.0485, 0.1), (0, 0.1))
    assert 'does not fit' in outline_problem(Outline('u', wedge, 0.0051), 0.005)[0]


def test_cell_files_round_trip():
    entry = (
        '  - {name: block, outline: [[0.1, 0.3], [0.2, 0.3], [0.2, 0.4], [0.1, 0.4]], corner_radius: 0.002, '
        'uncertainty: {center: 1.5e-5, angle: 1.0e-4, offset: 5.0e-6}}\n'
        '  - {name: edge, outline: [[-0.4, 0.15], [-0.15, 0.45]], open: true}\n'
        '  - {name: disc, center: [0.0, 0.45], radius: 0.03}'
    )
    cell = parse_cell(CELL.format(entry))
    assert parse_cell(dump_cell(cell)) == cell
    assert [cell.discs[0].center_std, cell.discs[0].angle_std, cell.discs[0].radius_std] == [1.5e-5, 1e-4, 5e-6]

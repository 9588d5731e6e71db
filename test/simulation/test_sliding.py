"""The simulated slide is on the outline, obeys model and friction all along, and its plan is read to the letter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmark.common import normal_error
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics, inverse_kinetostatics
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED, PAPER_NOMINAL
from scara_kinetostatic.simulation.motion import CROSSING, SlidePhase, SlidingMotion, TipPath
from scara_kinetostatic.simulation.plan import Circle, PlanError, Slide, load_plan, polygon
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(1e-5, 0.3), tip_radius=0.005)
SQUARE = ((0.10, 0.30), (0.20, 0.30), (0.20, 0.40), (0.10, 0.40))
SLIDES = (
    Slide(Circle((0.2, 0.4), 0.045), 15, 0.1, 0.1, end=1.05),
    Slide(Circle((-0.2, 0.35), 0.05), 20, 0.2, 0.1, -1, 1.0, 0.0),
    Slide(polygon(SQUARE), 10, 0.1, 0.1, end=1.02),
)


@pytest.mark.parametrize(
    ('slide', 'truth'),
    zip(SLIDES, [PAPER_ACTUAL, PAPER_MEASURED, PAPER_MEASURED], strict=True),
    ids=['disc', 'backwards', 'sharp square'],
)
def test_contact_obeys_model_and_friction(slide, truth):
    motion = SlidingMotion(CELL, truth, (slide,))
    time = np.linspace(0, motion.duration, 20_000)
    state = motion.state_at(time)
    assert np.abs(np.diff(state.joints, axis=0)).max() < 8.0 * (time[1] - time[0])
    sliding = state.phase == SlidePhase.SLIDE
    joints, force = state.joints[sliding], state.force[sliding]
    tip, torques = direct_kinetostatics(truth, joints, force)
    beyond = (np.abs(torques) > CROSSING * np.hypot(*force.T)[:, None]).all(axis=1)
    assert beyond.mean() > 0.8
    np.testing.assert_allclose(normal_error(slide.outline, tip[beyond]), CELL.tip_radius, atol=5e-8)
    again = inverse_kinetostatics(truth, tip, force, slide.posture)[0]
    turned = (joints - again + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(turned[beyond]).max() < 1e-12
    angles = np.arctan2(*np.diff(tip, axis=0).T[::-1])
    off = np.angle(np.exp(1j * (np.arctan2(force[:-1, 1], force[:-1, 0]) - angles)))
    sense = np.sign(slide.end - slide.begin)  # counter-clockwise the object is on the left, where the force points to
    moving = np.flatnonzero(beyond[:-1] & beyond[1:])[200:-200]
    np.testing.assert_allclose(off[moving], sense * np.arctan2(1.0, slide.friction), atol=6e-3)


def test_outlines_have_their_lengths():
    assert TipPath(Circle((0, 0), 0.04), 0.01).length == pytest.approx(2 * np.pi * 0.05)
    square = 0.4 + 2 * np.pi * 0.005
    assert TipPath(polygon(SQUARE), 0.005).length == pytest.approx(square)
    assert TipPath(polygon(SQUARE, 0.01), 0.005).length == pytest.approx(0.4 - 8 * 0.01 + 2 * np.pi * 0.015)
    hollow = polygon([[0, 0], [0.1, 0], [0.1, -0.1]], 0.02, closed=False)
    assert TipPath(hollow, 0.005).length == pytest.approx(0.2 - 2 * 0.02 + np.pi / 2 * 0.015)
    with pytest.raises(ParameterError, match='narrower than the tip'):
        TipPath(polygon([[0, 0], [0.1, 0], [0.1, -0.1]], closed=False), 0.005)
    with pytest.raises(ParameterError, match='clockwise'):
        polygon(SQUARE[::-1])
    with pytest.raises(ParameterError, match='larger than edge 0 allows'):
        polygon(SQUARE, 0.06)


@pytest.mark.parametrize('outline', [polygon(SQUARE), polygon(SQUARE[:2], closed=False)], ids=['closed', 'open'])
def test_the_end_of_an_outline_is_not_its_begin(outline):
    track = TipPath(outline, 0.005)
    places, normals = track.at(track.length * np.array([0.0, 0.3, 1.0, 1.3]))
    np.testing.assert_allclose(places[0], np.add(SQUARE[0], (0.0, -0.005)), atol=1e-12)
    if outline.is_closed:
        np.testing.assert_allclose(places[2:], places[:2], atol=1e-12)
        np.testing.assert_allclose(track.at(np.array([-0.7 * track.length]))[0], places[1:2], atol=1e-12)
    else:
        np.testing.assert_allclose(places[2:], np.add([SQUARE[1]] * 2, (0.0, -0.005)), atol=1e-12)
    np.testing.assert_allclose(np.hypot(*normals.T), 1.0)
    assert np.hypot(*np.diff(track.at(np.linspace(0, track.length, 10_000))[0], axis=0).T).max() < 1e-4


def test_streams_repeat_with_the_seed_and_have_the_noise_of_the_cell():
    slide = Slide(Circle((0.2, 0.4), 0.045), 15, 0.1, 0.02, end=0.5)
    streams = [simulate_streams(CELL, PAPER_ACTUAL, (slide,), seed=seed) for seed in (0, 0, 1)]
    np.testing.assert_array_equal(streams[0].joints.position, streams[1].joints.position)
    motion = SlidingMotion(CELL, PAPER_ACTUAL, (slide,), seed=1)
    start = streams[2].joints.stamp[0] // 10**9 * 10**9
    state = motion.state_at(1e-9 * (streams[2].joints.stamp - start))
    errors = streams[2].joints.position - state.joints
    assert 0.4e-5 < np.std(errors[state.phase == SlidePhase.SLIDE]) < 2e-5
    ideal = simulate_streams(CELL, PAPER_ACTUAL, (slide,), sensors=SensorModel.ideal(), seed=1)
    state = motion.state_at(1e-9 * (ideal.wrench.stamp - start))
    np.testing.assert_allclose(ideal.wrench.force, state.force, atol=1e-12)


def test_plan_of_slides(tmp_path):
    plan = tmp_path / 'slides.yaml'
    plan.write_text(
        '- {slide: disc_1, force: 15, friction: 0.1}\n'
        '- {slide: {center: [0.2, 0.35], radius: 0.06}, from: 1, to: 0, posture: right}\n'
        '- {slide: {outline: [[0.1, 0.3], [0.2, 0.3]], closed: false}, speed: 0.03}\n'
    )
    first, second, third = load_plan(plan, CELL)
    assert first == Slide(Circle((-0.25, 0.3), 0.15 - 0.005), 15, 0.1)
    assert second == Slide(Circle((0.2, 0.35), 0.06), posture=-1, begin=1.0, end=0.0)
    assert third == Slide(polygon([[0.1, 0.3], [0.2, 0.3]], closed=False), speed=0.03)


@pytest.mark.parametrize(
    ('entry', 'message'),
    [
        ('{slide: disc_9}', 'the cell has no disc'),
        ('{slide: {center: [0, 0]}}', "slide: the key 'radius' is missing"),
        ('{slide: {radius: 0.1}}', "'center' is missing"),
        ('{slide: {center: [0, 0], radius: -1}}', 'radius: expected above 0'),
        ('{slide: disc_1, speed: -1}', 'above 0'),
        ('{slide: disc_1, fricton: 0.1}', "unknown key 'fricton'; did you mean 'friction'"),
        ('{slide: {outline: [[0, 0], [1, 0]]}}', 'expected 3 corners or more'),
        ('{slide: {outline: [[0, 0], [1, 0]], closed: false}, to: 2}', 'from 0 to 1'),
    ],
)
def test_wrong_plans_are_refused(tmp_path, entry, message):
    plan = tmp_path / 'slides.yaml'
    plan.write_text(f'- {entry}\n')
    with pytest.raises(PlanError, match=message):
        load_plan(plan, CELL)


def test_an_object_out_of_reach_is_refused():
    with pytest.raises(UnsupportedDataError, match='does not reach'):
        SlidingMotion(CELL, PAPER_ACTUAL, (Slide(Circle((0.6, 0.6), 0.05)),))
    with pytest.raises(UnsupportedDataError, match='no slide'):
        SlidingMotion(replace(CELL, tip_radius=None), PAPER_ACTUAL, ())

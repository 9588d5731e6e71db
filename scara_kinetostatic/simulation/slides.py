"""Slides of the tip along the outline of an object: the motion, and its recording as the sensors report it.

The outline consists of straight edges and arcs, or is an ellipse. The object is on the left of the direction of travel
along it, the tip slides on the right: a closed outline is counter-clockwise. The centre of the tip is on the outline
grown by the tip's radius (`model.outline`): at a sharp corner the surface stays while the normal turns, so that the
centre moves on an arc around the corner.

The repeatability of a touch (`cell.noise`) is here an error of the same size that changes slowly along the slide
(`SlideTiming.variation_time`); its force part grows and falls with the force, as in a touch. White noise, zero, frame,
sign, resolution and stamps are those of `SensorModel`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Indices, pairs
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import as_model
from scara_kinetostatic.model.kinematics import quarter_turn, wrap
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.outline import Outline, Surfaces, outline_problem, surfaces_of
from scara_kinetostatic.simulation.plan import check_numbers
from scara_kinetostatic.simulation.streams import (
    FIRST_FORCE,
    START,
    CellState,
    Phase,
    Robot,
    SensorModel,
    minimum_jerk,
    recorded,
    sensor_angle,
)
from scara_kinetostatic.touches.streams import Streams

ARCS = 720
"""Arcs of which an ellipse is made: some nm off it; along it the tip jumps by some 20 nm from one to the next."""


@dataclass(frozen=True)
class Ellipse:
    """The outline of an ellipse or of a disc.

    Attributes:
        center: (x, y), m.
        semi_axes: m.
        rotation: of the first semi-axis from x, rad.
    """

    center: tuple[float, float]
    semi_axes: tuple[float, float]
    rotation: float = 0.0

    @property
    def is_closed(self) -> bool:
        """That it is."""
        return True

    def surfaces(self, tip_radius: float) -> Surfaces:
        """Where the centre of the tip is in contact: arcs of its circles of curvature, whose normals turn evenly."""
        half, (a, b), turn = np.pi / ARCS, self.semi_axes, np.exp(1j * self.rotation)
        normal = np.exp(1j * half * (2 * np.arange(ARCS) + 1))
        reach = np.hypot(a * normal.real, b * normal.imag)
        place = (a**2 * normal.real + 1j * b**2 * normal.imag) / reach
        radius = (a * b) ** 2 / reach**3
        center = complex(*self.center) + turn * (place - radius * normal)
        object, half_angles = np.zeros(ARCS, dtype=np.intp), np.full(ARCS, half)
        return Surfaces(
            object, pairs(center), radius + tip_radius, np.zeros((ARCS, 2)), pairs(turn * normal), half_angles
        )


def circle(center: tuple[float, float], radius: float) -> Ellipse:
    """The outline of a disc."""
    return ellipse(center, (radius, radius))


def ellipse(center: tuple[float, float], semi_axes: tuple[float, float], rotation: float = 0.0) -> Ellipse:
    """The outline of an ellipse, its first semi-axis turned by an angle in rad."""
    if not min(semi_axes) > 0:
        raise ParameterError('outline', f'expected a radius above 0 m, got {min(semi_axes):g}')
    return Ellipse(center, semi_axes, rotation)


def polygon(corners: ArrayLike, corner_radius: float = 0.0, closed: bool = True) -> Outline:
    """The outline of straight edges, its corners rounded.

    Args:
        corners: (k, 2), m, the object on the left.
        corner_radius: 0 for sharp corners, m.
        closed: whether an edge leads from the last corner to the first.

    Raises:
        ParameterError: too few corners, two at one place, or an edge too short for the roundings of its corners.
    """
    outline = Outline('', tuple((float(x), float(y)) for x, y in np.asarray(corners)), corner_radius, not closed)
    if problem := outline_problem(outline, 0.0):
        raise ParameterError('outline', *problem)
    return outline


class Track:
    """The path of the tip's centre along an outline.

    Args:
        outline: of the surface; anything with `surfaces` and `is_closed`, as `Ellipse` has them.
        tip_radius: m.

    Attributes:
        length: of the whole path, m.

    Raises:
        ParameterError: an inner corner is narrower than the tip.
    """

    def __init__(self, outline: Outline | Ellipse, tip_radius: float) -> None:
        self._is_closed = outline.is_closed
        s = surfaces_of([outline], tip_radius) if isinstance(outline, Outline) else outline.surfaces(tip_radius)
        if len(s.inner_corners[0]):
            raise ParameterError(
                'outline', 'an inner corner is narrower than the tip', f'round it by {tip_radius:g} m or more'
            )
        self._ends = np.cumsum(2 * s.halves * np.where(s.is_edge, 1.0, np.abs(s.radii)))
        self._surfaces, self.length = s, float(self._ends[-1])

    def at(self, travelled: Floats) -> tuple[Floats, Floats]:
        """Centre of the tip, m, and outward normal of the surface, (k, 2) each, after lengths of the path, (k,), m.

        A closed outline goes on behind its end.
        """
        along = np.mod(travelled, self.length) if self._is_closed else np.clip(travelled, 0.0, self.length)
        row = np.minimum(np.searchsorted(self._ends, along, side='right'), len(self._ends) - 1)
        begin = np.append(0.0, self._ends)[row]
        part = 2.0 * (along - begin) / np.maximum(self._ends[row] - begin, 1e-12) - 1.0
        return self._surfaces.select(row).at(part)


@dataclass(frozen=True)
class Slide:
    """One pass of the tip along an object.

    Attributes:
        outline: of the object's surface.
        force: the normal force that the controller holds, N.
        friction: coefficient of Coulomb friction μ between tip and object.
        speed: of the tip's centre along the outline, m/s.
        posture: elbow posture, +1 or -1.
        begin: where it begins, in lengths of the outline.
        end: where it ends; less than `begin` to slide backwards, more than one length apart to go round.

    Raises:
        ParameterError: a value that makes no sense.
    """

    outline: Outline | Ellipse
    force: float = 15.0
    friction: float = 0.0
    speed: float = 0.02
    posture: int = 1
    begin: float = 0.0
    end: float = 1.0

    def __post_init__(self) -> None:
        check_numbers('slide', self, zero=('friction',), signed=('posture', 'begin', 'end'))
        if not 0 <= self.friction <= 2:
            raise ParameterError('slide: friction', f'expected 0 to 2, got {self.friction:g}')
        if abs(self.posture) != 1:
            raise ParameterError('slide: posture', f'expected +1 or -1, got {self.posture}')
        if self.begin == self.end:
            raise ParameterError('slide: end', 'is where the slide begins', 'let it end elsewhere')
        if not self.outline.is_closed and not all(0 <= place <= 1 for place in (self.begin, self.end)):
            raise ParameterError('slide: end', 'an open outline is slid along from 0 to 1')


@dataclass(frozen=True)
class SlideTiming:
    """Durations of the parts of a slide, s, and the behaviour of the force controller.

    Attributes:
        travel: between two slides.
        pause: at rest, free, before the approach and after the retraction.
        approach: from the free pose to the object, and back.
        press: from no force to the normal force, and back.
        stick: from no tangential force to that of sliding, while the tip stands, and back.
        start: from rest to the speed, and back.
        clearance: distance of the free pose from the object, m.
        force_variation: standard deviation of the normal force that the controller holds, relative.
        variation_time: time over which this deviation and the errors of the sensors change, s.
    """

    travel: float = 1.5
    pause: float = 0.4
    approach: float = 0.4
    press: float = 0.3
    stick: float = 0.15
    start: float = 0.2
    clearance: float = 0.01
    force_variation: float = 0.02
    variation_time: float = 0.5

    def __post_init__(self) -> None:
        check_numbers('timing', self, zero=('force_variation',))


SlidePhase = IntEnum('SlidePhase', 'TRAVEL PAUSE APPROACH PRESS STICK SLIDE STOP RELEASE RETRACT REST', start=0)
"""Of a slide."""
CROSSING = 2e-3
"""Lever arm of the force within which a joint crosses its backlash, m."""


class SlideState(NamedTuple):
    """The state at k times.

    Attributes:
        joints: actuator angles Q, (k, 2), rad.
        force: force of the tip on the object, base frame, (k, 2), N.
        tip: centre of the tip, (k, 2), m; between two slides, where the third axis is lifted, NaN.
        slide: number of the slide, (k,).
        phase: which `SlidePhase`, (k,).
    """

    joints: Floats
    force: Floats
    tip: Floats
    slide: Indices
    phase: Indices


class SlidingMotion:
    """The motion through several slides.

    Args:
        cell: sign of the gripper's law; its tip has the tip's radius.
        truth: the simulated robot, with its effects.
        slides: one after the other.
        timing: how long the phases last.
        seed: of the variation of the normal force.

    Attributes:
        duration: of the whole motion, s.
        tip_radius: m; 0 where the cell does not state it.

    Raises:
        UnsupportedDataError: there is no slide, or the simulated robot does not reach one.
        ParameterError: an outline is too narrow for the tip.
    """

    def __init__(
        self, cell: Cell, truth: Robot, slides: tuple[Slide, ...], timing: SlideTiming | None = None, seed: int = 0
    ) -> None:
        if not slides:
            raise UnsupportedDataError('there is no slide', 'plan at least one')
        self.cell, self.model, self.slides = cell, as_model(truth), slides
        self.timing, self.tip_radius = timing or SlideTiming(), cell.tip_radius or 0.0
        self._tracks = [Track(slide.outline, self.tip_radius) for slide in slides]
        random = np.random.default_rng([seed, 2])
        self._variation = [SlowNoise(random, 1, self.timing.variation_time) for _ in slides]
        self._knots = self._schedule()
        self.duration = float(self._knots[-1, -1])
        self._paths = [self._path(number) for number in range(len(slides))]
        # joint angles where each slide's travel ends and the next one's begins, (m, 2, 2), rad
        ends = np.array([self._states(k, knots[[SlidePhase.PAUSE, -1]])[0] for k, knots in enumerate(self._knots[:-1])])
        home = ends[[0, -1], [0, 1]] + (0.25, -0.15)
        self._stations = np.concatenate([home[:1], ends.reshape(-1, 2), home[1:]])

    def _schedule(self) -> Floats:
        """Begins of the phases of each slide, and the end of the last phase, (m, 11), s; a last row: the way home."""
        t, rows, begin = self.timing, [], 0.0
        for slide, track in zip(self.slides, self._tracks, strict=True):
            sliding = abs(slide.end - slide.begin) * track.length / slide.speed + t.start
            spans = (t.travel, t.pause, t.approach, t.press, t.stick, sliding, t.stick, t.press, t.approach, t.pause)
            rows.append(begin + np.append(0.0, np.cumsum(spans)))
            begin = float(rows[-1][-1])
        rows.append(np.full(len(SlidePhase) + 1, begin + t.travel))
        rows[-1][0] = begin
        return np.array(rows)

    def state_at(self, time: Floats) -> SlideState:
        """The state at times in s since the start, (k,); before it and past the end the arm rests."""
        time = np.clip(np.asarray(time, dtype=float), 0.0, self.duration)
        slide = np.clip(np.searchsorted(self._knots[:, 0], time, side='right') - 1, 0, len(self.slides))
        phase = (self._knots[slide, 1:-1] <= time[:, None]).sum(axis=1)
        phase[slide == len(self.slides)] = SlidePhase.TRAVEL
        joints, force = np.empty((len(time), 2)), np.zeros((len(time), 2))
        tip = np.full((len(time), 2), np.nan)
        travelling = phase == SlidePhase.TRAVEL
        to = slide[travelling]
        begin, end = self._stations[2 * to], self._stations[2 * to + 1]
        part = minimum_jerk((time[travelling] - self._knots[to, 0]) / self.timing.travel)
        joints[travelling] = begin + part[:, None] * (end - begin)
        for number in range(len(self.slides)):
            here = np.flatnonzero((slide == number) & ~travelling)
            joints[here], tip[here], force[here] = self._states(number, time[here])
        return SlideState(joints, force, tip, slide.clip(max=len(self.slides) - 1), phase)

    def _states(self, number: int, time: Floats) -> tuple[Floats, Floats, Floats]:
        """Joint angles, rad, tip, m, and force, N, at times within a slide, (k, 2) each.

        The angles are Ḡ, each joint crossing its backlash within `CROSSING`, near the path of the slide. The force is
        F = N (-n + μ τ t); 0+ along -n in the free motion.
        """
        slide, track, t = self.slides[number], self._tracks[number], self.timing
        knots = self._knots[number]

        def part(phase: int) -> Floats:
            """How much of a phase has passed, 0 to 1, by the time law."""
            span = knots[phase + 1] - knots[phase]
            return minimum_jerk(np.clip((time - knots[phase]) / span, 0.0, 1.0))

        sense = np.sign(slide.end - slide.begin)
        begin, end = knots[[SlidePhase.SLIDE, SlidePhase.STOP]]
        distance = _distance(np.clip(time - begin, 0.0, None), end - begin, slide.speed, t.start)
        travelled = slide.begin * track.length + sense * distance
        center, normal = track.at(travelled)
        steady = part(SlidePhase.STICK) - part(SlidePhase.STOP)
        variation = t.force_variation * self._variation[number].at(time)[:, 0].clip(-3, 3)
        clearance = t.clearance * (1.0 - part(SlidePhase.APPROACH) + part(SlidePhase.RETRACT))
        normal_force = slide.force * (part(SlidePhase.PRESS) - part(SlidePhase.RELEASE)) * (1.0 + steady * variation)
        friction = (slide.friction * steady)[:, None] * (sense * quarter_turn(normal))
        force = np.maximum(normal_force, FIRST_FORCE)[:, None] * (friction - normal)
        tip = center + clearance[:, None] * normal
        places, path = self._paths[number]
        near = np.column_stack([np.interp(travelled, places, column) for column in path.T])
        joints = near + wrap(self._poses(number, tip, force) - near)
        return joints, tip, np.where(normal_force[:, None] > 0, force, 0.0)

    def _poses(self, number: int, tip: Floats, force: Floats) -> Floats:
        p, posture = self.model.parameters, self.slides[number].posture
        joints, torques = inverse_kinetostatics(self.model, tip, force, np.full(len(tip), posture), self.cell.gripper)
        arm = torques / np.hypot(*force.T)[:, None]
        return np.asarray(joints + (p.g1, p.g2) * (np.clip(arm / CROSSING, -1.0, 1.0) - np.sign(torques)))

    def _path(self, number: int) -> tuple[Floats, Floats]:
        """Lengths travelled, increasing, and the joint angles there, without a jump of a turn."""
        slide, track = self.slides[number], self._tracks[number]
        travelled = np.linspace(min(slide.begin, slide.end), max(slide.begin, slide.end), 721) * track.length
        center, normal = track.at(travelled)
        tips = center, center + self.timing.clearance * normal
        poses = [self._poses(number, tip, -slide.force * normal) for tip in tips]
        lost = ~self.cell.can_take(np.array(poses)).all(axis=0)
        if lost.any():
            x, y = center[lost][0]
            problem = f'slide {number}: the simulated robot does not reach it around ({x:.3f}, {y:.3f}) m'
            remedy = 'place the object elsewhere, slide along a part of it, or correct robot.limits'
            raise UnsupportedDataError(problem, remedy)
        path = np.unwrap(poses[0], axis=0)
        if np.abs(np.diff(path, axis=0)).max() > 0.5:
            raise ParameterError(f'slide {number}', 'it passes a stretched or folded arm', 'place the object elsewhere')
        return travelled, path


def _distance(time: Floats, span: float, speed: float, start: float) -> Floats:
    """Distance after a time of a motion of constant speed that starts and stops with constant acceleration, (k,), m."""
    start = min(start, span / 2)
    time = np.minimum(time, span)
    rest = span - time
    gone = np.where(time < start, time**2 / (2 * start), time - start / 2)
    return np.asarray(speed * np.where(rest < start, span - start - rest**2 / (2 * start), gone))


class SlowNoise:
    """Random numbers of variance 1 that change slowly with time: normal, with the correlation exp(-t²/(2 T²)).

    Args:
        random: source.
        columns: independent ones.
        duration: T, s.
    """

    def __init__(self, random: np.random.Generator, columns: int, duration: float) -> None:
        waves = 48  # of which they are made
        shape = waves, columns
        self._frequency = random.standard_normal(shape) / duration
        self._phase = random.uniform(0, 2 * np.pi, shape)
        self._size = random.rayleigh(1.0, shape) / np.sqrt(waves)

    def at(self, time: Floats) -> Floats:
        """Their values at times in s, (k, columns)."""
        waves = np.cos(time[:, None, None] * self._frequency + self._phase)
        return np.asarray((self._size * waves).sum(axis=1))


def simulate_slides(
    cell: Cell,
    truth: Robot,
    slides: Sequence[Slide],
    *,
    timing: SlideTiming | None = None,
    sensors: SensorModel | None = None,
    seed: int = 0,
    start: int = START,
) -> Streams:
    """Both streams of one pass through several slides.

    Args:
        cell: sensor, noise of a touch, radius of the tip.
        truth: the simulated robot: its parameters, or the model with its effects.
        slides: one after the other.
        timing: how long their parts last.
        sensors: noise, bias and rates.
        seed: of all random numbers.
        start: stamp of the start, ns.

    Raises:
        UnsupportedDataError: there is no slide, or the simulated robot does not reach one.
        ParameterError: an outline is too narrow for the tip.
    """
    motion = SlidingMotion(cell, truth, tuple(slides), timing, seed)
    return sensed(motion, cell, sensors or SensorModel(), seed, start)


def sensed(motion: SlidingMotion, cell: Cell, sensors: SensorModel, seed: int, start: int = START) -> Streams:
    """What the sensors report of a motion; the other arguments are those of `simulate_slides`."""
    errors = SlowNoise(np.random.default_rng([seed, 0]), 4, motion.timing.variation_time)

    def at(time: Floats) -> tuple[CellState, Floats, Floats]:
        """The state at times, each instant as the hold of a touch of its own, the force over that of the slide."""
        state, unit = motion.state_at(time), errors.at(time)
        angle = sensor_angle(cell, motion.model.parameters, state.joints)
        both_errors = sensors.touch_errors(cell, np.stack([unit[:, :2], unit[:, 2:]]), state.force, angle)
        planned = np.array([slide.force for slide in motion.slides])[state.slide]
        relative_force = np.minimum(np.hypot(*state.force.T) / planned, 1.0)
        touch, hold = np.arange(len(planned)), np.full(len(planned), Phase.HOLD)
        return CellState(state.joints, state.force, touch, hold, np.ones(len(touch)), relative_force), *both_errors

    return recorded('simulation', cell, motion.model, sensors, motion.duration, at, seed, start)

"""Slides of the tip along the outline of an object: the motion, and its recording as the sensors report it.

The outline consists of straight edges and arcs, or is a circle. The object is on the left of the direction of travel
along it, the tip slides on the right: a closed outline is counter-clockwise. The centre of the tip is on the outline
grown by the tip's radius (`model.outline`): at a sharp corner the surface stays while the normal turns, so that the
centre moves on an arc around the corner.

The repeatability of a touch (`cell.noise`) is here an error of the same size that changes slowly along the slide
(`SlideTiming.variation_time`); its force part grows and falls with the force, as in a touch. White noise, zero, frame,
sign, resolution and stamps are those of `SensorModel`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Disc
from scara_kinetostatic.model.extended_model import as_model
from scara_kinetostatic.model.kinematics import quarter_turn, wrap
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.outline import Outline, Surfaces, outline_problem, surfaces_of
from scara_kinetostatic.simulation.motion import FIRST_FORCE, CellState, Course, Moments, Motion, Robot
from scara_kinetostatic.simulation.plan import check_numbers


@dataclass(frozen=True)
class Circle:
    """The outline of a disc.

    Attributes:
        center: (x, y), m.
        radius: of its surface, m.
    """

    center: tuple[float, float]
    radius: float

    @property
    def is_closed(self) -> bool:
        """That it is."""
        return True

    def surfaces(self, tip_radius: float) -> Surfaces:
        """Where the centre of the tip is in contact."""
        return surfaces_of([Disc('', *self.center, self.radius + tip_radius)], None)


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
        outline: of the surface; anything with `surfaces` and `is_closed`, as `Circle` has them.
        tip_radius: m.

    Attributes:
        length: of the whole path, m.

    Raises:
        ParameterError: an inner corner is narrower than the tip.
    """

    def __init__(self, outline: Outline | Circle, tip_radius: float) -> None:
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

    outline: Outline | Circle
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


class SlidingMotion(Motion):
    """The motion through several slides.

    Args:
        cell: sign of the gripper's law; its tip has the tip's radius.
        truth: the simulated robot, with its effects.
        slides: one after the other.
        timing: how long the phases last.
        seed: of the variation of the normal force.

    Attributes:
        knots: start of every phase, (m, 10), s.
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
        self.cell, self.model, self.slides, self.count = cell, as_model(truth), slides, len(slides)
        t = self.timing = timing or SlideTiming()
        self.tip_radius = cell.tip_radius or 0.0
        self._tracks = [Track(slide.outline, self.tip_radius) for slide in slides]
        random = np.random.default_rng([seed, 2])
        self._variation = [SlowNoise(random, 1, t.variation_time) for _ in slides]
        self._paths = [self._path(number) for number in range(len(slides))]
        ends, durations = [], []
        for number, (slide, track) in enumerate(zip(slides, self._tracks, strict=True)):
            travelled = np.array([slide.begin, slide.end]) * track.length
            center, normal = track.at(travelled)
            ends.append(self._joints(number, travelled, center + t.clearance * normal, -FIRST_FORCE * normal))
            sliding = abs(slide.end - slide.begin) * track.length / slide.speed + t.start
            durations.append((t.pause, t.approach, t.press, t.stick, sliding, t.stick, t.press, t.approach, t.pause))
        self._course = Course(np.array(ends), np.array(durations), t.travel)
        self.knots, self.duration = self._course.knots, self._course.duration

    def state_at(self, time: ArrayLike) -> CellState:
        """The state at times in s since the start, (k,); before it and past the end the arm rests."""
        at, time = self._course.at(time), np.asarray(time, dtype=float)
        joints, force, slide = at.joints, np.zeros((len(time), 2)), at.contact.clip(max=self.count - 1)
        for number in range(self.count):
            here = np.flatnonzero((slide == number) & (at.phase != SlidePhase.TRAVEL))
            joints[here], force[here] = self._contact_at(number, at.select(here), time[here])
        relative_force = np.minimum(np.hypot(*force.T) / np.array([each.force for each in self.slides])[slide], 1.0)
        return CellState(joints, force, slide, at.phase, at.progress, relative_force)

    def errors_at(self, time: Floats, state: CellState, seed: int) -> Floats:
        """Errors of joint angles and force at k moments, in standard deviations, (2, k, 2): they change slowly."""
        return slow_errors(time, self.timing.variation_time, seed)

    def _contact_at(self, number: int, at: Moments, time: Floats) -> tuple[Floats, Floats]:
        """Joint angles, rad, and force, N, at moments and times within a slide, (k, 2) each.

        The angles are Ḡ, each joint crossing its backlash within `CROSSING`, near the path of the slide. The force is
        F = N (-n + μ τ t); 0+ along -n in the free motion.
        """
        slide, track, t = self.slides[number], self._tracks[number], self.timing
        begin, end = self.knots[number, [SlidePhase.SLIDE, SlidePhase.STOP]]
        sense = np.sign(slide.end - slide.begin)
        distance = _distance(np.clip(time - begin, 0.0, None), end - begin, slide.speed, t.start)
        travelled = slide.begin * track.length + sense * distance
        center, normal = track.at(travelled)
        steady = at.part(SlidePhase.STICK) - at.part(SlidePhase.STOP)
        variation = t.force_variation * self._variation[number].at(time)[:, 0].clip(-3, 3)
        clearance = t.clearance * (1.0 - at.part(SlidePhase.APPROACH) + at.part(SlidePhase.RETRACT))
        pressed = at.part(SlidePhase.PRESS) - at.part(SlidePhase.RELEASE)
        normal_force = slide.force * pressed * (1.0 + steady * variation)
        friction = (slide.friction * steady)[:, None] * (sense * quarter_turn(normal))
        force = np.maximum(normal_force, FIRST_FORCE)[:, None] * (friction - normal)
        joints = self._joints(number, travelled, center + clearance[:, None] * normal, force)
        return joints, np.where(normal_force[:, None] > 0, force, 0.0)

    def _joints(self, number: int, travelled: Floats, tip: Floats, force: Floats) -> Floats:
        """Joint angles of a slide for places of the tip and forces, (k, 2), rad, near the path of the slide."""
        places, path = self._paths[number]
        near = np.column_stack([np.interp(travelled, places, column) for column in path.T])
        return np.asarray(near + wrap(self._poses(number, tip, force) - near))

    def _poses(self, number: int, tip: Floats, force: Floats) -> Floats:
        p, posture = self.model.parameters, self.slides[number].posture
        joints, torques = inverse_kinetostatics(
            self.model, tip, force, np.full(len(tip), posture), self.cell.gripper_sign
        )
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


def slow_errors(time: Floats, duration: float, seed: int) -> Floats:
    """Errors of joint angles and force at times, s, in standard deviations, (2, k, 2), correlated over a duration."""
    return SlowNoise(np.random.default_rng([seed, 0]), 4, duration).at(time).reshape(-1, 2, 2).transpose(1, 0, 2)

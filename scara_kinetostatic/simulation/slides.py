"""Slides of the tip along the outline of an object: the motion, and its recording as the sensors report it.

The outline consists of straight edges, arcs of circles and of ellipses, one after the other. The object is on the left
of the direction of travel along it, the tip slides on the right: a closed outline is counter-clockwise. With n the
outward normal and r the radius of the tip, the centre of the tip is at S = P + r n. At a sharp corner P stays while n
turns, so that S moves on an arc around the corner.

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
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import as_model
from scara_kinetostatic.model.kinematics import quarter_turn, wrap
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.outline import Outline as KnownOutline
from scara_kinetostatic.model.outline import edges_of
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

SAMPLES = 4000
"""Places along a piece at which lengths and distances are worked out."""


class Edge(NamedTuple):
    """A straight edge.

    Attributes:
        begin: (x, y), m.
        end: (x, y), m.
    """

    begin: tuple[float, float]
    end: tuple[float, float]

    def at(self, part: Floats) -> tuple[Floats, Floats]:
        """Places at parts 0 to 1 of it, (k,), and outward unit vectors there: (k, 2) each, m."""
        begin, along = np.array(self.begin), np.subtract(self.end, self.begin)
        normal = np.array([along[1], -along[0]]) / np.hypot(*along)
        return begin + part[:, None] * along, np.broadcast_to(normal, (len(part), 2))


class Arc(NamedTuple):
    """An arc of a circle or of an ellipse.

    Attributes:
        center: (x, y), m.
        semi_axes: of the ellipse, m; equal ones of a circle may be zero (a sharp corner) or negative (hollow).
        rotation: of the first semi-axis from x, rad.
        begin: angle of the parametric form where it begins, rad.
        end: where it ends, rad; less than `begin` for a hollow arc.
    """

    center: tuple[float, float]
    semi_axes: tuple[float, float]
    rotation: float
    begin: float
    end: float

    def at(self, part: Floats) -> tuple[Floats, Floats]:
        """Places at parts 0 to 1 of it, (k,), and outward unit vectors there: (k, 2) each, m."""
        angle = self.begin + part * (self.end - self.begin)
        c, s, (a, b) = np.cos(angle), np.sin(angle), self.semi_axes
        normal = np.column_stack([c, s] if a == b else [b * c, a * s])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        along = np.cos(self.rotation), np.sin(self.rotation)
        turn = np.array([along, (-along[1], along[0])])
        return np.column_stack([a * c, b * s]) @ turn + self.center, normal @ turn


@dataclass(frozen=True)
class Outline:
    """The outline of an object.

    Attributes:
        pieces: one after the other.
        closed: whether the last one ends where the first one begins.
    """

    pieces: tuple[Edge | Arc, ...]
    closed: bool

    def at(self, place: Floats) -> tuple[Floats, Floats]:
        """The surface, (k, 2), m, and its outward unit vectors, (k, 2), at places (k,): number and part of the piece.

        Those of a closed outline repeat.
        """
        count = len(self.pieces)
        place = np.mod(place, count) if self.closed else np.clip(place, 0.0, count)
        number = np.minimum(place.astype(np.intp), count - 1)
        point, normal = np.empty((len(place), 2)), np.empty((len(place), 2))
        for k, piece in enumerate(self.pieces):
            here = number == k
            point[here], normal[here] = piece.at(place[here] - k)
        return point, normal


class Track(NamedTuple):
    """The path of the tip's centre along an outline.

    Attributes:
        places: on the outline, (k,); see `Outline.at`.
        travelled: length of the path up to each, (k,), m.
    """

    places: Floats
    travelled: Floats

    @classmethod
    def along(cls, outline: Outline, tip_radius: float) -> Track:
        """The path on the right of an outline.

        Raises:
            ParameterError: a hollow arc is narrower than the tip.
        """
        for piece in outline.pieces:
            if isinstance(piece, Arc) and piece.end < piece.begin and -piece.semi_axes[0] < tip_radius:
                problem = f'a hollow corner of radius {abs(piece.semi_axes[0]):g} m is narrower than the tip'
                raise ParameterError('outline', problem, f'give it the radius {tip_radius:g} m or more')
        places = np.arange(len(outline.pieces) * SAMPLES + 1) / SAMPLES
        point, normal = outline.at(places * (1 - 1e-15))
        steps = np.diff(point + tip_radius * normal, axis=0)
        return cls(places, np.append(0.0, np.cumsum(np.hypot(*steps.T))))

    @property
    def length(self) -> float:
        """Of the whole path, m."""
        return float(self.travelled[-1])

    def place(self, travelled: Floats) -> Floats:
        """The places after lengths of the path, (k,), m; a closed outline goes on behind its end."""
        # the end belongs to its turn: that of an open one is not its begin
        turns = np.ceil(travelled / self.length) - 1
        within = np.interp(travelled - turns * self.length, self.travelled, self.places)
        return np.asarray(turns * self.places[-1] + within)


def circle(center: tuple[float, float], radius: float) -> Outline:
    """The outline of a disc."""
    return ellipse(center, (radius, radius))


def ellipse(center: tuple[float, float], semi_axes: tuple[float, float], rotation: float = 0.0) -> Outline:
    """The outline of an ellipse, its first semi-axis turned by an angle in rad."""
    if not min(semi_axes) > 0:
        raise ParameterError('outline', f'expected a radius above 0 m, got {min(semi_axes):g}')
    return Outline((Arc(center, semi_axes, rotation, 0.0, 2 * np.pi),), closed=True)


def polygon(corners: ArrayLike, corner_radius: float = 0.0, closed: bool = True) -> Outline:
    """The outline of straight edges, its corners rounded.

    Args:
        corners: (k, 2), m, the object on the left.
        corner_radius: 0 for sharp corners, m.
        closed: whether an edge leads from the last corner to the first.

    Raises:
        ParameterError: too few corners, two at one place, or an edge too short for the roundings of its corners.
    """
    points = np.asarray(corners, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < (3 if closed else 2):
        raise ParameterError('outline', f'expected {3 if closed else 2} or more corners [x, y], got {len(points)}')
    places = tuple((float(x), float(y)) for x, y in points)
    point, along, lengths, turns, cut = edges_of(KnownOutline('', places, corner_radius, not closed))
    if not lengths.all():
        raise ParameterError('outline', 'two corners after each other are at the same place')
    if turns[1:].sum() < 0 and closed:
        raise ParameterError('outline', 'the corners are clockwise', 'list them counter-clockwise')
    if np.any(cut[:-1] + cut[1:] > lengths):
        raise ParameterError('outline', f'an edge is too short for corners of radius {corner_radius:g} m')
    pieces: list[Edge | Arc] = []
    for k, direction in enumerate(along):
        begin, foot = point[k] + cut[k] * direction, point[k] + (lengths[k] - cut[k + 1]) * direction
        pieces.append(Edge((begin.real, begin.imag), (foot.real, foot.imag)))
        if turn := float(turns[k + 1]):
            radius, angle = np.sign(turn) * corner_radius, np.angle(-1j * direction)
            center = foot + 1j * radius * direction
            pieces.append(Arc((center.real, center.imag), (radius, radius), 0.0, angle, angle + turn))
    return Outline(tuple(pieces), closed)


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

    outline: Outline
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
        if not self.outline.closed and not all(0 <= place <= 1 for place in (self.begin, self.end)):
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
        self._tracks = [Track.along(slide.outline, self.tip_radius) for slide in slides]
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
        point, normal = slide.outline.at(track.place(travelled))
        steady = part(SlidePhase.STICK) - part(SlidePhase.STOP)
        variation = t.force_variation * self._variation[number].at(time)[:, 0].clip(-3, 3)
        clearance = t.clearance * (1.0 - part(SlidePhase.APPROACH) + part(SlidePhase.RETRACT))
        normal_force = slide.force * (part(SlidePhase.PRESS) - part(SlidePhase.RELEASE)) * (1.0 + steady * variation)
        friction = (slide.friction * steady)[:, None] * (sense * quarter_turn(normal))
        force = np.maximum(normal_force, FIRST_FORCE)[:, None] * (friction - normal)
        tip = point + (self.tip_radius + clearance)[:, None] * normal
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
        point, normal = slide.outline.at(track.place(travelled))
        distances = (self.tip_radius, self.tip_radius + self.timing.clearance)
        poses = [self._poses(number, point + distance * normal, -slide.force * normal) for distance in distances]
        lost = ~self.cell.can_take(np.array(poses)).all(axis=0)
        if lost.any():
            x, y = point[lost][0]
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

"""A slide: the tip is pressed against an object, slides along its outline, and is lifted off."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.simulation.sliding.outline import Outline

LARGEST_FRICTION = 2.0
"""Largest coefficient of friction."""


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
        for item in fields(self)[1:]:
            if not isfinite(getattr(self, item.name)):
                raise ParameterError(f'slide: {item.name}', f'expected a finite number, got {getattr(self, item.name)}')
        for name in ('force', 'speed'):
            if not getattr(self, name) > 0:
                raise ParameterError(f'slide: {name}', f'expected a number above 0, got {getattr(self, name):g}')
        if not 0 <= self.friction <= LARGEST_FRICTION:
            raise ParameterError('slide: friction', f'expected 0 to {LARGEST_FRICTION:g}, got {self.friction:g}')
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
        for item in fields(self):
            value = getattr(self, item.name)
            if not isfinite(value) or value < 0 or (value == 0 and item.name != 'force_variation'):
                raise ParameterError(f'timing: {item.name}', f'expected a value above 0, got {value}')

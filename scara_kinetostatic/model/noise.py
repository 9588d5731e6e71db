"""The noise of one touch: of each joint, of each axis of the force sensor, and a part that grows with the force."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats

Level: TypeAlias = float | tuple[float, float]
"""A standard deviation of both axes, or one of each."""


class Noise(NamedTuple):
    """Repeatability of one touch, one standard deviation.

    The variance of a component of the force is σ_axis² + (force_relative ‖F‖)².

    Attributes:
        joint: of the joint angles, rad; a pair for joint 1 and joint 2.
        force: of a component of the force, N; a pair for x and y of the sensor's frame.
        force_relative: what is added in proportion to the force; None for not known: taken as 0, and estimated where
            the touches ask for it.

    Example:
        >>> import scara_kinetostatic as sk
        >>> sk.Noise(joint=1e-5, force=0.3).force_levels
        (0.3, 0.3)
        >>> sk.Noise(joint=(1e-5, 2e-5), force=0.3, force_relative=0.01).is_plain
        False
    """

    joint: Level
    force: Level
    force_relative: float | None = None

    @property
    def joint_levels(self) -> tuple[float, float]:
        """Of joint 1 and joint 2, rad."""
        return _pair(self.joint)

    @property
    def force_levels(self) -> tuple[float, float]:
        """Of x and y in the sensor's frame without the part that grows, N."""
        return _pair(self.force)

    @property
    def joint_rms(self) -> float:
        """Root mean square over the joints, rad."""
        return _rms(self.joint)

    @property
    def force_rms(self) -> float:
        """Root mean square over the axes of the force without the part that grows, N."""
        return _rms(self.force)

    @property
    def growth(self) -> float:
        """`force_relative`, 0 where it is not known."""
        return self.force_relative or 0.0

    @property
    def is_plain(self) -> bool:
        """Whether both joints, and all components of every force, are alike."""
        return not self.growth and len({*self.joint_levels}) == 1 and len({*self.force_levels}) == 1

    @property
    def levels(self) -> tuple[float, ...]:
        """Of both joints, of both axes of the force, and of the part that grows, (5,)."""
        return (*self.joint_levels, *self.force_levels, self.growth)

    def as_dict(self, *, as_stated: bool = False) -> dict[str, float | list[float]]:
        """As in a file: one number where both axes are alike, the part that grows where it is known.

        Args:
            as_stated: whether two equal levels stay two.
        """
        found = {'joint': _entry(self.joint, as_stated), 'force': _entry(self.force, as_stated)}
        return found if self.force_relative is None else found | {'force_relative': self.force_relative}

    def force_at(self, magnitude: float) -> float:
        """Standard deviation of a component of a force of some magnitude, rms over the axes, N."""
        return float(np.hypot(self.force_rms, self.growth * magnitude)) if self.growth else self.force_rms

    def scaled(self, factor: float) -> Noise:
        """All of it times a factor."""
        grown = None if self.force_relative is None else factor * self.force_relative
        return Noise(_scaled(self.joint, factor), _scaled(self.force, factor), grown)

    def with_rms(self, joint: float, force: float) -> Noise:
        """The same ratios of the axes and the same growth, with other levels."""
        return Noise(_with_rms(self.joint, joint), _with_rms(self.force, force), self.force_relative)

    @property
    def in_pairs(self) -> Noise:
        """The same with levels of both axes as a tuple, where they were given as a list or an array."""
        return self._replace(joint=_level(self.joint), force=_level(self.force))

    def check(self) -> None:
        """Whether it can be that of a measurement.

        Raises:
            ParameterError: a level is not above 0, or the part that grows is negative.
        """
        shaped = all(np.shape(level) in ((), (2,)) for level in (self.joint, self.force))
        if not shaped or not all(np.isfinite(level) and level > 0 for level in self.levels[:4]):
            problem = f'expected two levels above 0, or pairs of them, got {(self.joint, self.force)}'
            raise ParameterError('noise', problem, 'or leave it out')
        if not (np.isfinite(self.growth) and self.growth >= 0):
            problem = f'expected 0 or more, got {self.force_relative}'
            raise ParameterError('noise.force_relative', problem, 'or leave it out to have it estimated')


class ForceCovariance(NamedTuple):
    """Covariance of the forces of n touches along and across each of them: the entries 11, 21, 22, (n,) each, N²."""

    along: Floats
    crossed: Floats
    across: Floats

    def side(self, side: int) -> tuple[Floats, Floats]:
        """One column: 0 for along the force, 1 for across it."""
        return (self.along, self.crossed) if side == 0 else (self.crossed, self.across)


def force_covariance(noise: Noise, force: Floats) -> ForceCovariance:
    """Covariance of forces in components along and across them: R diag(σ_x², σ_y²) Rᵀ + (g ‖F‖)² I.

    Args:
        noise: of a touch.
        force: F in the sensor's frame, (n, 2), N.
    """
    x, y = force[:, 0], force[:, 1]
    square_x, square_y = x * x, y * y
    square = square_x + square_y
    by_x, by_y = (level**2 for level in noise.force_levels)
    grown = noise.growth**2 * square
    along = (by_x * square_x + by_y * square_y) / square + grown
    across = (by_x * square_y + by_y * square_x) / square + grown
    return ForceCovariance(along, (by_y - by_x) * x * y / square, across)


def _entry(level: Level, as_stated: bool) -> float | list[float]:
    first, second = _pair(level)
    is_one = not isinstance(level, tuple) if as_stated else first == second
    return first if is_one else [first, second]


def _level(level: Level) -> Level:
    return level if isinstance(level, tuple) or not np.shape(level) else (float(level[0]), float(level[1]))


def _pair(level: Level) -> tuple[float, float]:
    if isinstance(level, (int, float)):
        return level, level
    first, second = level
    return first, second


def _rms(level: Level) -> float:
    first, second = _pair(level)
    return float(np.sqrt((first**2 + second**2) / 2)) if first != second else first


def _scaled(level: Level, factor: float) -> Level:
    return factor * level if isinstance(level, (int, float)) else (factor * level[0], factor * level[1])


def _with_rms(level: Level, rms: float) -> Level:
    if isinstance(level, (int, float)):
        return rms
    before = _rms(level)
    return level if before == rms else rms if before == 0 else _scaled(level, rms / before)

"""The plan of a recording: disc, place, elbow posture and force of each touch.

The default plan is balanced: neighbouring points of a disc and the two postures of a point get different force levels,
and consecutive touches lie on different discs and sides, so that a drift in time or a force level is not confounded
with a direction, disc or posture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import gcd
from typing import Any

import numpy as np

from scara_kinetostatic.errors import CellError, ParameterError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.kinematics import inverse
from scara_kinetostatic.model.kinetostatics import drag
from scara_kinetostatic.model.outline import Outline, boundary, inside
from scara_kinetostatic.model.parameters import Parameters

REACH_MARGIN = 0.03
"""Distance of the tip from the stretched and from the folded arm, m: the true arm may be shorter."""
LIMIT_MARGIN = 0.02
"""Distance of every planned joint angle from its limits, rad: what an error of the model changes in a contact."""
BASE_MARGIN = 0.08
"""Distance of the tip from the first axis, m."""
CLEARANCE = 0.018
"""Distance of the free pose from the disc, m; see `simulation.motion`."""
LARGEST_PRELOAD = 5.0
"""Largest preload, over the force of the hold."""


def check_numbers(where: str, holder: Any, *, zero: Sequence[str] = (), signed: Sequence[str] = ()) -> None:
    """Whether the numbers of a dataclass, single or in tuples, are finite and above 0.

    Args:
        where: what they are of, for the message.
        holder: the dataclass.
        zero: names of those that may be 0.
        signed: names of those that may have any finite value.

    Raises:
        ParameterError: one of them is not.
    """
    for item in fields(holder):
        value = getattr(holder, item.name)
        value = value.levels if isinstance(value, Noise) else value
        if not isinstance(value, (int, float, tuple)) or isinstance(value, Outline):
            continue
        array = np.asarray(value, dtype=float)
        least = -np.inf if item.name in signed else 0.0
        if not np.all(np.isfinite(array) & (array >= least) & ((array != least) | (item.name in zero))):
            wanted = 'a finite value' + (f' {"of 0 or more" if item.name in zero else "above 0"}' if least == 0 else '')
            raise ParameterError(f'{where}: {item.name}', f'expected {wanted}, got {value}')


@dataclass(frozen=True)
class Plan:
    """m touches in the order of time, as read-only arrays.

    Attributes:
        disc: index of the disc in the cell, (m,).
        angle: place on the disc: direction from its centre to the contact, (m,), rad; on an outline the place along
            it, of which a whole turn is once round (`Surfaces.places`).
        posture: elbow posture, +1 or -1, (m,).
        force: force of the hold, (m,), N.
        preload: part of that force by which the press goes beyond it before it eases down to
            the hold, so that the joints come to it from the other side, (m,); default 0.

    Raises:
        ParameterError: shapes that do not fit, a posture other than +1 or -1, a force not above 0,
            a preload below 0 or above `LARGEST_PRELOAD`.
    """

    disc: Indices
    angle: Floats
    posture: Indices
    force: Floats
    preload: Floats = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            value = np.zeros(len(self.disc)) if value is None else value
            array = np.array(value, dtype=np.intp if item.name in ('disc', 'posture') else float)
            if array.shape != (len(self.disc),):
                raise ParameterError(f'plan: {item.name}', f'expected shape {(len(self.disc),)}, got {array.shape}')
            array.flags.writeable = False
            object.__setattr__(self, item.name, array)
        if not np.all(np.abs(self.posture) == 1):
            raise ParameterError('plan: posture', 'expected +1 or -1')
        if not np.all(np.isfinite(self.force) & (self.force > 0)):
            raise ParameterError('plan: force', 'expected forces above 0 N')
        if not np.all(np.isfinite(self.angle)):
            raise ParameterError('plan: angle', 'expected finite angles')
        if not np.all((self.preload >= 0) & (self.preload <= LARGEST_PRELOAD)):
            raise ParameterError('plan: preload', f'expected 0 to {LARGEST_PRELOAD:g} of the force')

    def __len__(self) -> int:
        return len(self.disc)

    def surface(self, cell: Cell) -> Indices:
        """Number of the touched edge or arc among `Cell.surfaces`, (m,)."""
        return cell.surfaces.places(self.disc, self.angle)[0] if cell.has_outlines else self.disc

    def normal(self, cell: Cell | None = None) -> Floats:
        """Outward normal of the object at each contact, (m, 2); without a cell that of discs."""
        round_disc = np.column_stack([np.cos(self.angle), np.sin(self.angle)])
        if cell is None or not cell.has_outlines:
            return round_disc
        surface, part = cell.surfaces.places(self.disc, self.angle)
        return cell.surfaces.select(surface).at(part)[1]

    def direction(self, cell: Cell) -> Floats:
        """Angle of the outward normal, (m,), rad."""
        return np.arctan2(*self.normal(cell).T[::-1]) if cell.has_outlines else self.angle

    def contact(self, cell: Cell) -> Floats:
        """Where the tip touches, (m, 2), m, base frame."""
        if not cell.has_outlines:
            return cell.centers[self.disc] + cell.radii[self.disc, None] * self.normal()
        surface, part = cell.surfaces.places(self.disc, self.angle)
        return cell.surfaces.select(surface).at(part)[0]

    @property
    def aside(self) -> Floats:
        """Angle at which each press drags the tip aside, (m,), rad: see `kinetostatics.drag`.

        In `simulate` the tip stays where it is.
        """
        return drag(self.angle, self.posture)

    def titles(self, cell: Cell) -> list[str]:
        """Each touch in words: ``disc_1 at 30°, left, 25 N``."""
        places = zip(self.disc.tolist(), np.degrees(self.angle) % 360, self.posture, self.force, strict=True)
        return [
            f'{cell.discs[disc].name} at {angle:.0f}°, {"left" if side > 0 else "right"}, {force:.0f} N'
            for disc, angle, side, force in places
        ]

    def select(self, which: Mask | Indices) -> Plan:
        """The touches that a mask or an array of positions picks."""
        return Plan(**{item.name: getattr(self, item.name)[which] for item in fields(self)})

    @classmethod
    def joined(cls, plans: Sequence[Plan]) -> Plan:
        """The touches of several plans, in turn."""
        return cls(**{item.name: np.concatenate([getattr(plan, item.name) for plan in plans]) for item in fields(cls)})


def default_plan(
    cell: Cell,
    per_disc: int = 12,
    levels: Sequence[float] = (10.0, 25.0, 40.0),
    postures: Sequence[int] = (1, -1),
    preload: float = 0.0,
) -> Plan:
    """Evenly spaced points around every disc, each in every posture, the force levels in turn.

    The preload alternates from point to point: half of the touches have it, on every disc, in every posture and at
    every level.

    Points that the nominal arm reaches only nearly stretched, nearly folded or
    close to its base or the limits of its joints are left out, and those before which another disc stands.

    Args:
        cell: the cell; its nominal parameters decide on the reach.
        per_disc: points around each disc.
        levels: force levels, N.
        postures: elbow postures, +1 or -1.
        preload: part of its force by which every other touch is first pressed beyond it.

    Raises:
        CellError: a disc has no point within reach.
        ParameterError: no points, levels or postures, or values out of range.
    """
    if per_disc < 1 or not len(levels) or not len(postures):
        raise ParameterError('plan', 'expected at least one point per disc, one force level and one posture')
    counts = per_disc, len(cell.discs), len(postures)
    step, disc, side = (axis.ravel() for axis in np.indices(counts))
    point = step * _stride(per_disc) % per_disc
    # on an outline half a step on: a place where an edge begins is of no use
    half = np.array([0.5 * isinstance(item, Outline) for item in cell.discs])
    # in turn around every disc, and alike often with each of the levels
    turn = point + disc + (side if len(levels) % 2 else point // len(levels))
    plan = Plan(
        disc=disc,
        angle=2.0 * np.pi * (point + half[disc]) / per_disc,
        posture=np.array(postures)[side],
        force=np.array(levels, dtype=float)[(point + disc + side) % len(levels)],
        preload=np.where(turn % 2 == 1, preload, 0.0),
    )
    tips = [plan.contact(cell) + distance * plan.normal(cell) for distance in (0.0, CLEARANCE)]
    poses = inverse(cell.nominal, tips, plan.posture)
    reachable = within_reach(cell, plan) & cell.can_take(poses, LIMIT_MARGIN).all(axis=0)
    for number, described in enumerate(cell.discs):
        if not np.any(reachable & (plan.disc == number)):
            problem = f'no point of the disc is within reach with a margin of {REACH_MARGIN * 1e3:.0f} mm'
            remedy = 'move the disc, or correct its centre and radius, the link lengths or robot.limits'
            raise CellError(f'objects: {described.name}', problem, remedy)
    return plan.select(reachable)


def reach(nominal: Parameters) -> tuple[float, float]:
    """Smallest and largest distance of the tip from the base, with margins, m."""
    return max(abs(nominal.l1 - nominal.l2) + REACH_MARGIN, BASE_MARGIN), nominal.l1 + nominal.l2 - REACH_MARGIN


def within_reach(cell: Cell, plan: Plan) -> Mask:
    """Which touches the nominal arm reaches with a margin, free of the other discs, (m,)."""
    nominal, (folded, stretched) = cell.nominal, reach(cell.nominal)
    reachable = np.ones(len(plan), dtype=bool)
    for distance in (0.0, CLEARANCE):
        tip = plan.contact(cell) + distance * plan.normal(cell)
        radius = np.hypot(tip[:, 0] - nominal.x0, tip[:, 1] - nominal.y0)
        reachable &= (radius >= folded) & (radius <= stretched)
        apart = np.linalg.norm(tip[:, None] - cell.centers[None], axis=2) - cell.radii
        apart[np.arange(len(plan)), plan.disc] = np.inf
        for number in (k for k, disc in enumerate(cell.discs) if isinstance(disc, Outline)):
            surfaces = cell.surfaces.select(cell.surfaces.object == number)
            apart[:, number] = surfaces.distances(tip).min(axis=1)
            own = (plan.disc == number) & (apart[:, number] >= distance - 1e-9)
            apart[own, number] = np.inf
            if cell.discs[number].is_closed:
                apart[inside(boundary(surfaces), tip) & ~own, number] = -np.inf
        reachable &= apart.min(axis=1) > CLEARANCE / 2
    return reachable


def _stride(count: int) -> int:
    """A step near the golden section of the circle that visits each of `count` points once."""
    start = max(1, round(0.382 * count))
    return next(stride for stride in range(start, start + count + 1) if gcd(stride, count) == 1)

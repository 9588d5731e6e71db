"""What a simulated robot is to do: touches, or slides along objects; a plan as a file.

The default plan is balanced: neighbouring points of a disc and the two postures of a point get different force levels,
and consecutive touches lie on different discs and sides, so that a drift in time or a force level is not confounded
with a direction, disc or posture.

**Files.** A YAML list, one touch or one slide per entry, in the order of time.
```yaml
- {disc: disc_1, angle_deg: 30, posture: left, force: 25}
- {disc: disc_2, angle_deg: -90, posture: right, force: 40, preload: 0.3}
```
`angle_deg` is the direction from the disc's centre to the contact in the base frame, degrees from x;
`posture` is `left` (sin(q2 + theta2) > 0, the elbow on the right of the line from the base
to the tip, the fore-arm bent to the left), `right`, +1 or -1; `force` in N; `preload`,
which may be left out, is the part of the force by which the press first goes beyond it.

```yaml
- {slide: disc_2, force: 15, friction: 0.1}                                 # a disc of the cell
- {slide: {center: [0.20, 0.35], radius: 0.06}, force: 15, posture: left}   # a disc that is not in the cell
- {slide: {center: [-0.20, 0.35], radius: 0.05}, force: 20, from: 0, to: 1.05}
- {slide: {outline: [[0.10, 0.30], [0.20, 0.30], [0.20, 0.40]], corner_radius: 0.01, closed: false}, force: 10}
```
Outlines are those of the surface, the tip's radius is the cell's (`tip: {radius}`); the radius of a disc of the cell
contains it. Corners are counter-clockwise, the tip slides outside, on the right of an open line. `from` and `to` are in
lengths of the outline: of a closed one 0 to 1 is one turn, `to: 1.05` overlaps, `from: 1` `to: 0` slides clockwise.
`force` is the normal force in N, `friction` the coefficient, `speed` that of the tip in m/s; all but `slide` may be
left out.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import gcd
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.errors import CellError, InputError, ParameterError, did_you_mean
from scara_kinetostatic.files.yaml_file import MappingReader, Within, parse_yaml, read_text, shown
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Cell, Disc, Noise
from scara_kinetostatic.model.kinematics import inverse
from scara_kinetostatic.model.kinetostatics import drag
from scara_kinetostatic.model.outline import Outline, Surfaces, boundary, inside, outline_problem, surfaces_of
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.quantities import quantity

REACH_MARGIN = 0.03
"""Distance of the tip from the stretched and from the folded arm, m: the true arm may be shorter."""
LIMIT_MARGIN = 0.02
"""Distance of every planned joint angle from its limits, rad: what an error of the model changes in a contact."""
BASE_MARGIN = 0.08
"""Distance of the tip from the first axis, m."""
CLEARANCE = 0.018
"""Distance of the free pose from the disc, m; see `simulation.motion`."""
ROUNDING = 1e-9
"""Two lengths, angles or times that differ by less are the same, m, rad or s."""
PER_DISC = 12
"""Points around a disc."""
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
    per_disc: int = PER_DISC,
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
            problem = f'no point of the disc is within reach with a margin of {quantity(REACH_MARGIN, "m")}'
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
            own = (plan.disc == number) & (apart[:, number] >= distance - ROUNDING)
            apart[own, number] = np.inf
            if cell.discs[number].is_closed:
                apart[inside(boundary(surfaces), tip) & ~own, number] = -np.inf
        reachable &= apart.min(axis=1) > CLEARANCE / 2
    return reachable


def _stride(count: int) -> int:
    """A step near the golden section of the circle that visits each of `count` points once."""
    start = max(1, round(0.382 * count))
    return next(stride for stride in range(start, start + count + 1) if gcd(stride, count) == 1)


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


POSTURES = {'left': 1, 'right': -1, 1: 1, -1: -1}
POSTURE_NAMES = {1: 'left', -1: 'right'}
_SLIDE_VALUES = {'force': 'force', 'friction': 'friction', 'speed': 'speed', 'from': 'begin', 'to': 'end'}
"""Fields of a slide by key."""
_FORCE = Within(0.0, 10_000.0, positive=True, unit='N')
_RADIUS = Within(0.0, 10.0, positive=True, unit='m')
_PRELOAD = Within(0.0, LARGEST_PRELOAD, unit='of the force')


class PlanError(InputError):
    """A plan that cannot be read or is not valid."""


def load_plan(path: str | Path, cell: Cell) -> Plan | tuple[Slide, ...]:
    """Read a plan of touches, or one of slides, whose first entry has the key `slide`.

    Args:
        path: the file.
        cell: its discs, tip and nominal arm.

    Raises:
        PlanError: the file cannot be read, or an entry is not valid or out of reach.
    """
    return parse_plan(read_text(path, PlanError), cell, path)


def parse_plan(text: str, cell: Cell, where: str | Path = 'plan') -> Plan | tuple[Slide, ...]:
    """The plan that a YAML text holds; see `load_plan`."""
    data = parse_yaml(text, where, PlanError)
    if not isinstance(data, list) or not data:
        raise PlanError(where, 'expected a list with one touch or slide per entry', 'see docs/reference/formats.md')
    required: tuple[str, ...]
    optional: tuple[str, ...]
    if slides := isinstance(data[0], dict) and 'slide' in data[0]:
        what, required, optional = 'slide', ('slide',), (*_SLIDE_VALUES, 'posture')
    else:
        what, required, optional = 'touch', ('disc', 'angle_deg', 'posture', 'force'), ('preload',)
    entries = [
        MappingReader(PlanError, f'{where}: {what} {k}', '', entry, required, optional) for k, entry in enumerate(data)
    ]
    return tuple(_slide(entry, cell) for entry in entries) if slides else _touches(entries, cell, where)


def _touches(entries: list[MappingReader], cell: Cell, where: str | Path) -> Plan:
    rows = []
    names = [disc.name for disc in cell.discs]
    for entry in entries:
        name, preload = entry.word('disc'), entry.optional('preload', within=_PRELOAD)
        if name not in names:
            raise entry.error('disc', f'the cell has no disc {name!r}', did_you_mean(name, names, 'its discs are'))
        angle, force = math.radians(entry.number('angle_deg')), entry.number('force', within=_FORCE)
        rows.append((names.index(name), angle, _posture(entry), force, preload or 0.0))
    plan = Plan(*(np.array(column) for column in zip(*rows, strict=True)))
    possible = cell.can_take(inverse(cell.nominal, plan.contact(cell), plan.posture))
    lost = np.flatnonzero(~(within_reach(cell, plan) & possible))
    if len(lost):
        problem = f'the arm does not reach it with a margin of {quantity(REACH_MARGIN, "m")}'
        remedy = 'choose another angle_deg or posture, or correct robot.limits'
        raise PlanError(f'{where}: touch {lost[0]}', f'{problem}, or another disc stands before it', remedy)
    return plan


def _posture(entry: MappingReader) -> int:
    given = entry.data.get('posture', 'left')
    if type(given) not in (int, str) or given not in POSTURES:
        raise entry.error('posture', f'expected left, right, 1 or -1, got {shown(given)}')
    return POSTURES[given]


def dump_plan(plan: Plan, cell: Cell, remarks: tuple[str, ...] = ()) -> str:
    """The plan as YAML, one touch per line, in the order of time.

    Args:
        plan: the touches.
        cell: names the discs.
        remarks: lines of comment at the top.
    """
    lines = [f'# {" ".join(remark.split())}' for remark in remarks]
    columns = (plan.disc, plan.angle, plan.posture, plan.force, plan.preload)
    for disc, angle, posture, force, preload in zip(*columns, strict=True):
        # a string of JSON is one of YAML, whatever the name holds
        name = json.dumps(cell.discs[disc].name, ensure_ascii=False)
        values = f'posture: {POSTURE_NAMES[int(posture)]}, force: {_decimal(force)}'
        values += f', preload: {_decimal(preload)}' if preload > 0 else ''
        lines.append(f'- {{disc: {name}, angle_deg: {_decimal(np.degrees(angle))}, {values}}}')
    return '\n'.join(lines) + '\n'


def _decimal(value: float) -> str:
    return np.format_float_positional(round(float(value), 9), trim='-')


def _slide(entry: MappingReader, cell: Cell) -> Slide:
    values = {name: entry.number(key) for key, name in _SLIDE_VALUES.items() if key in entry.data}
    if 'force' in values:
        entry.number('force', within=_FORCE)
    try:
        return Slide(_outline(entry, cell), posture=_posture(entry), **values)
    except ParameterError as error:
        raise entry.error('', error.problem, error.remedy) from error


def _outline(entry: MappingReader, cell: Cell) -> Outline | Circle:
    """The outline under the key `slide`: of a disc of the cell, by its name, of another disc, or of corners."""
    given = entry.data['slide']
    if isinstance(given, str):
        discs = {disc.name: disc for disc in cell.discs}
        if given not in discs:
            raise entry.error('slide', f'the cell has no disc {given!r}', did_you_mean(given, discs, 'its discs are'))
        disc = discs[given]
        if isinstance(disc, Outline):
            return disc
        if (radius := disc.radius - (cell.tip_radius or 0.0)) <= 0:
            raise entry.error('slide', f'{given!r} is smaller than the tip', 'correct its radius, or tip.radius')
        return Circle((disc.x, disc.y), radius)
    if not (isinstance(given, dict) and 'outline' in given):
        shape = entry.section('slide', ('center', 'radius'))
        return Circle(_pair(shape, 'center'), shape.number('radius', within=_RADIUS))
    shape = entry.section('slide', ('outline',), ('corner_radius', 'closed'))
    corners, closed = shape.data['outline'], shape.data.get('closed', True)
    if not isinstance(corners, list):
        raise shape.error('outline', f'expected a list of corners [x, y], got {shown(corners)}')
    if not isinstance(closed, bool):
        raise shape.error('closed', f'expected true or false, got {shown(closed)}')
    points = shape.vector('outline', list(map(str, range(len(corners)))), _pair)
    return polygon(points, shape.optional('corner_radius') or 0.0, closed)


def _pair(shape: MappingReader, name: str) -> tuple[float, float]:
    x, y = shape.vector(name, ('x', 'y'))
    return x, y

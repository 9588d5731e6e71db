"""What n touches measured and where: the data of the adjustment, with what is known beforehand.

**Declared errors** of the cell description, within their uncertainties, are nuisance parameters with a prior.
The true places of the discs, their radii, gain and rotation of the force sensor differ from the stated ones by unknown
errors that are the same in all touches. Each is a parameter of the fit, in units of its declared standard uncertainty,
so that its prior is the standard normal distribution: the fit minimises

    Σ_touches wᵀ V⁻¹ w + Σ_k e_k² + Σ_j ((L_j - L_n,j) / u_j)²,

the last sum over the nominal values that are trusted (`Cell.uncertainty.nominal`). What is an exact alias, such as an
error of all radii and g_ee, is thereby as uncertain as it was declared. Nothing is needed for it besides.

With e the errors, R(·) a rotation and s the stated values, a disc on a plate with origin o has the centre
o + t + R(ω) (s + δ - o) and the radius s + ρ + ρ_common; the force is R(-β) F_reported / (1 + γ).

To first order and with w whitened to w + J ΔL + N e, e is eliminated (`gaussian.linear_model.Marginal`): the
covariance is then I + N Nᵀ.

Sources: GUM (JCGM 100:2008), 4.3 (type B) and F.1.2.4 (correlation by a common error); Mikhail and Ackermann,
Observations and Least Squares (1976), on parameters observed directly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.effects.unnamed import Column, Undetected, derivatives
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import EVERY, Complexes, Floats, Indices, as_complex, pairs, pick
from scara_kinetostatic.model.cell import Cell, Disc, SensorFrame
from scara_kinetostatic.model.extended_model import EffectLaw, TouchMetadata, TouchState
from scara_kinetostatic.model.kinematics import GripperSign, forward, rotate
from scara_kinetostatic.model.outline import PER_ANGLE, Outline, Surfaces
from scara_kinetostatic.model.parameters import UNITS
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.model.touch_equations import ContactProblem, Edges


class Source(NamedTuple):
    """A source of uncertainty that the cell description declares.

    Attributes:
        label: ``object_position[disc_1]``, ``object_radius[disc_1]``, ``plate_position[a]``, ``plate_angle[a]``,
            ``radius`` (common to all), ``force_gain``, ``force_rotation``, ``nominal[l1]``, and so on.
        std: its standard uncertainty; of a place that of each coordinate.
        unit: of `std`; ``1`` for a pure number.
        components: how many errors it is: 2 for a place, else 1.
    """

    label: str
    std: float
    unit: str
    components: int = 1


@dataclass(frozen=True, eq=False)
class DeclaredErrors:
    """The errors e of a cell description, (m,), in units of their standard uncertainties, and what they do.

    Attributes:
        cell: as stated.
        sources: of the errors, in their order.
    """

    cell: Cell
    sources: tuple[Source, ...]

    @classmethod
    def of(cls, cell: Cell) -> DeclaredErrors | None:
        """The declared errors of a cell; None where everything counts as exactly known."""
        u = cell.uncertainty
        sources = [
            *(Source(f'object_position[{d.name}]', d.center_std, 'm', 2) for d in cell.discs),
            *(Source(f'{_size(d)}[{d.name}]', d.radius_std, 'm') for d in cell.discs),
            *(Source(f'object_rotation[{d.name}]', d.angle_std, 'rad') for d in cell.discs),
            *(Source(f'plate_position[{p.name}]', p.center_std, 'm', 2) for p in cell.plates),
            *(Source(f'plate_angle[{p.name}]', p.angle_std, 'rad') for p in cell.plates),
            Source('radius', u.radius, 'm'),
            Source('force_gain', u.force_gain, '1'),
            Source('force_rotation', u.force_rotation, 'rad'),
        ]
        stated = tuple(source for source in sources if source.std > 0)
        return cls(cell, stated) if stated or u.nominal else None

    @cached_property
    def count(self) -> int:
        """How many errors there are, m."""
        return sum(source.components for source in self.sources)

    @property
    def names(self) -> tuple[str, ...]:
        """Of each error: ``object_position[disc_1].x``, ``object_radius[disc_1]``, and so on."""
        pairs = ((s.label, ('.x', '.y') if s.components > 1 else ('',)) for s in self.sources)
        return tuple(label + ending for label, endings in pairs for ending in endings)

    @cached_property
    def units(self) -> Floats:
        """The standard uncertainty of each error, (m,), in its unit."""
        return np.repeat([s.std for s in self.sources], [s.components for s in self.sources])

    @cached_property
    def places(self) -> dict[str, Indices]:
        """Positions of the errors of each source, by label."""
        ends = np.cumsum([source.components for source in self.sources]).tolist()
        return {s.label: np.arange(end - s.components, end) for s, end in zip(self.sources, ends, strict=True)}

    def _changes(self, label: str) -> Complexes:
        """What each error changes of a source, (m,), in its unit; of a place x + iy; zeros where it is not declared."""
        found = np.zeros(self.count, dtype=complex)
        if label in self.places:
            place = self.places[label]
            found[place] = self.units[place] * np.array([1, 1j])[: len(place)]
        return found

    @cached_property
    def _by_surface(self) -> _BySurface:
        discs, plates = self.cell.discs, {plate.name: plate for plate in self.cell.plates}
        changes = self._changes
        of_discs = _BySurface(
            np.array([complex(plates[d.plate].x, plates[d.plate].y) if d.plate else 0j for d in discs]),
            np.array([complex(d.x, d.y) for d in discs]),
            np.array([changes(f'object_position[{d.name}]') for d in discs]),
            np.array([changes(f'plate_position[{d.plate}]') for d in discs]),
            np.array([changes(f'plate_angle[{d.plate}]').real for d in discs]),
            np.array([(changes(f'{_size(d)}[{d.name}]') + changes('radius')).real for d in discs]),
            np.array([changes(f'object_rotation[{d.name}]').real for d in discs]),
        )
        return pick(of_discs, self.cell.surfaces.object)

    def _arms(self, errors: Floats) -> tuple[Complexes, Complexes, Complexes]:
        """Of each surface, (D,), complex: the unit vector of its plate, and the vectors to its centre from the origin
        of the plate and from the reference point of the object, all turned, m.
        """
        d = self._by_surface
        plate = np.exp(1j * (d.angle @ errors))
        own = plate * np.exp(1j * (d.turn @ errors)) * (as_complex(self.cell.surfaces.centers) - d.reference)
        return plate, plate * (d.reference - d.origin + d.own @ errors) + own, own

    def centers(self, errors: Floats) -> Floats:
        """Centres of the surfaces, those of discs in turn, (D, 2), m."""
        d = self._by_surface
        return pairs(d.origin + d.carried @ errors + self._arms(errors)[1])

    def radii(self, errors: Floats) -> Floats:
        """Their radii, (D,), m."""
        return np.asarray(self.cell.surfaces.radii + self._by_surface.radius @ errors)

    def tangents(self, errors: Floats) -> Floats:
        """Unit vectors along the straight edges, (D, 2); zero of arcs."""
        return rotate(self.cell.surfaces.tangents, self.rotation @ errors)

    @cached_property
    def rotation(self) -> Floats:
        """Rotation of each surface by the errors, (D, m), rad."""
        return self._by_surface.angle + self._by_surface.turn

    def sensor(self, errors: Floats) -> tuple[float, float]:
        """Errors of the force sensor's gain, relative, and rotation, rad."""
        gain, angle = self._changes('force_gain'), self._changes('force_rotation')
        return float(gain.real @ errors), float(angle.real @ errors)

    def true_force(self, reported: Floats, errors: Floats) -> Floats:
        """Reported forces (n, 2) in N without the errors of gain and rotation."""
        gain, angle = self.sensor(errors)
        return reported if gain == 0 and angle == 0 else rotate(reported, -angle) / (1 + gain)

    def by_disc(self, errors: Floats) -> tuple[Floats, Floats]:
        """Derivatives of the centres, (D, 2, m), and of the radii, (D, m), by the errors, m."""
        d, (plate, arm, own) = self._by_surface, (part[:, None] for part in self._arms(errors))
        by_centers = d.carried + plate * d.own + 1j * (arm * d.angle + own * d.turn)
        return np.stack([by_centers.real, by_centers.imag], axis=1), d.radius

    def by_force(self, errors: Floats) -> tuple[Floats, Floats]:
        """Relative change of a force along itself, and across, by the errors, (m,) each."""
        gain, _ = self.sensor(errors)
        return -self._changes('force_gain').real / (1 + gain), -self._changes('force_rotation').real

    @cached_property
    def prior(self) -> Prior:
        """The prior of errors and trusted nominal values."""
        nominal = self.cell.uncertainty.nominal
        trusted = [name for name in self.cell.nominal.names if name in nominal]
        mean = np.array([getattr(self.cell.nominal, name) for name in trusted])
        stds = np.array([nominal[name] for name in trusted])
        trusted_sources = [Source(f'nominal[{name}]', nominal[name], UNITS[name]) for name in trusted]
        return Prior(
            sources=(*trusted_sources, *self.sources),
            trusted=np.array([self.cell.nominal.names.index(name) for name in trusted], dtype=np.intp),
            mean=mean,
            std=stds,
            errors=self.count,
        )


class _BySurface(NamedTuple):
    """What each unit error does to each of D surfaces; zero where it has nothing to do with it.

    Attributes:
        origin: of its plate, (D,), complex, m; zero where there is none.
        reference: reference point of its object, (D,), complex, m.
        own: displacement on the plate, (D, m), complex, m.
        carried: displacement of the plate, (D, m), complex, m.
        angle: rotation of the plate, (D, m), rad.
        radius: change of the radius, (D, m), m.
        turn: rotation about the reference point, (D, m), rad.
    """

    origin: Complexes
    reference: Complexes
    own: Complexes
    carried: Complexes
    angle: Floats
    radius: Floats
    turn: Floats


def _size(disc: Disc | Outline) -> str:
    """The kind of error by which an object is larger than stated."""
    return 'object_offset' if isinstance(disc, Outline) else 'object_radius'


class Prior(NamedTuple):
    """What is known before the fit: rows of a least-squares problem in all values of the model and the errors.

    Attributes:
        sources: of the rows; a place has two rows.
        trusted: positions of the values of the model that are known, such as trusted nominal values, (p,).
        mean: these values, (p,), in their units.
        std: their standard uncertainties, (p,).
        errors: how many errors there are, m.
    """

    sources: tuple[Source, ...]
    trusted: Indices
    mean: Floats
    std: Floats
    errors: int

    def rows(self, values: int) -> Floats:
        """Derivatives of the residuals by all values of a model and the errors, (p + m, values + m)."""
        rows = np.zeros((len(self.trusted) + self.errors, values + self.errors))
        rows[np.arange(len(self.trusted)), self.trusted] = self._weights
        rows[len(self.trusted) :, values:] = np.eye(self.errors)
        return rows

    @property
    def _weights(self) -> Floats:
        """Of the known values, (p,): the size of an effect that a fit rules out may be estimated as 0."""
        return np.asarray(1 / np.maximum(self.std, 1e-30))

    def by_source(self) -> list[tuple[Source, Indices]]:
        """The sources with the positions of their rows; those of one label are one."""
        ends = np.cumsum([source.components for source in self.sources]).tolist()
        found = dict[str, tuple[Source, list[int]]]()
        for source, end in zip(self.sources, ends, strict=True):
            found.setdefault(source.label, (source, []))[1].extend(range(end - source.components, end))
        return [(source, np.array(rows, dtype=np.intp)) for source, rows in found.values()]

    def with_more(self, values: Prior, errors: Sequence[Source]) -> Prior:
        """With further values of the model, and further errors at the end, that are known beforehand."""
        own = len(self.trusted)
        return Prior(
            sources=(*self.sources[:own], *values.sources, *self.sources[own:], *errors),
            trusted=np.concatenate([self.trusted, values.trusted]),
            mean=np.concatenate([self.mean, values.mean]),
            std=np.concatenate([self.std, values.std]),
            errors=self.errors + len(errors),
        )

    def residual(self, values: Floats, errors: Floats) -> Floats:
        """Residuals, (p + m,), in standard uncertainties."""
        return np.concatenate([(values[self.trusted] - self.mean) * self._weights, errors])


EARLIER = 'earlier_calibration'
"""Label of what the earlier calibration contributes that is the prior of another one."""


class JointPrior(NamedTuple):
    """What an earlier calibration says of all values of the model and the declared errors: rows as those of `Prior`.

    Attributes:
        mean: of all, (v + m,), the errors in their standard uncertainties.
        root: W with WᵀW the inverse of their covariance, (r, v + m); zero columns where a value is exactly known.
        errors: how many errors there are, m.
    """

    mean: Floats
    root: Floats
    errors: int

    @classmethod
    def of(cls, mean: Floats, covariance: Floats, scale: Floats, errors: int) -> JointPrior:
        """That of a covariance, (v + m, v + m), and plausible sizes of the values, (v + m,).

        A combination that is known better than a part `_EXACT` of the plausible sizes counts as known so well.
        """
        free = np.flatnonzero(np.diag(covariance) > 0)
        unit = scale[free]
        values, vectors = np.linalg.eigh(covariance[np.ix_(free, free)] / np.outer(unit, unit))
        root = np.zeros((len(free), len(mean)))
        root[:, free] = (vectors / np.sqrt(np.maximum(values, _EXACT**2))).T / unit
        return cls(mean, root, errors)

    def rows(self, values: int) -> Floats:
        """Derivatives of the residuals by all values of a model and the errors, (r, values + m)."""
        assert self.root.shape[1] == values + self.errors
        return self.root

    def residual(self, values: Floats, errors: Floats) -> Floats:
        """Residuals, (r,), in standard uncertainties."""
        return np.asarray(self.root @ (np.concatenate([values, errors]) - self.mean))

    def by_source(self) -> list[tuple[Source, Indices]]:
        """All rows are of one source."""
        return [(Source(EARLIER, np.nan, ''), np.arange(len(self.root)))]


_EXACT = 1e-6
_NOTHING_KNOWN = Prior((), np.zeros(0, dtype=np.intp), np.zeros(0), np.zeros(0), 0)


def known_beforehand(
    declared: DeclaredErrors | None, random: RandomEffects | None, known: Prior | JointPrior | None
) -> Prior | JointPrior | None:
    """All that is known beforehand of errors, random effects and the values of effects; None for nothing."""
    if isinstance(known, JointPrior):  # it contains the declared errors, and there are no random effects
        return known
    prior = None if declared is None else declared.prior
    if random is None and known is None:
        return prior
    return (prior or _NOTHING_KNOWN).with_more(known or _NOTHING_KNOWN, () if random is None else random.sources)


UNDETECTED = 'undetected'
"""What undetected effects of a name contribute has the label ``undetected[name]``."""

RIVALS = 'rivals'
"""Label of what the choice between rival effects contributes."""

VALUE = 'value'
"""Kind of the label of what the choice of a value on a grid contributes, ``value[name]``."""

LARGE_EFFECT = f'{UNDETECTED}[large_effect]'
"""Label of what a single large effect contributes that the touches neither show nor exclude."""

ASSUMED_PLACES = f'{UNDETECTED}[assumed_places]'
"""Label of what errors of undeclared places of the size assumed add to those that the touches show."""


class RandomEffects(NamedTuple):
    """Every error of the catalogue that was not found: it is in the fit all the same, with a prior.

    Each is a sum of columns, its derivatives by its amplitudes (`effects.unnamed`), taken where the n touches are
    and held: they are small. The value u of a column has the prior N(0, 1) in units of its size, and shifts each touch
    by δ u, d u and e u, as the effect itself does. It is an error like the declared ones, at the end of their vector.

    Attributes:
        columns: what they are, k of them, those of the robot first.
        size: prior standard deviation of each, (k,), in its unit.
        changes: δ, rad, d, m, and e, N, in the sensor's frame, by one standard deviation of each, two
            components each, (n, 6, k).
        stated: declared standard deviations by label or name of the effect.
    """

    columns: tuple[Column, ...]
    size: Floats
    changes: Floats
    stated: dict[str, float]

    @classmethod
    def at(
        cls, columns: Sequence[Column], size: Floats, at: TouchState, force: Floats, stated: dict[str, float]
    ) -> RandomEffects:
        """Columns of some sizes at touches with true forces in the sensor's frame (n, 2), N."""
        changes = np.zeros((len(force), 6, len(columns)))
        errors = {c[:2]: c.effect.sensor_error_derivative(force, np.array(c.values), at.metadata) for c in columns}
        for number, (column, shift) in enumerate(zip(columns, derivatives(columns, at), strict=True)):
            error = errors[column[:2]]
            for kind, part in enumerate((*shift, error[column.parameter] if error else None)):
                if part is not None:
                    changes[:, 2 * kind : 2 * kind + 2, number] = part
        changes *= size
        return cls(tuple(columns), size, changes, stated)

    def resized(self, factor: Floats) -> RandomEffects:
        """The same with sizes larger by factors (k,)."""
        return self._replace(size=factor * self.size, changes=factor * self.changes)

    def select(self, which: Any) -> RandomEffects:
        """At the touches that a mask, a slice or an array of positions picks."""
        return self._replace(changes=self.changes[which])

    def stated_size(self, column: Column) -> float:
        """The declared standard deviation of its effect; NaN where none is declared."""
        return self.stated.get(column.effect.label, self.stated.get(column.effect.name, np.nan))

    @property
    def of_robot(self) -> int:
        """How many columns move the robot."""
        return sum(column.moves_robot for column in self.columns)

    @property
    def sources(self) -> tuple[Source, ...]:
        """One for each column; those of effects of one name have one label."""
        return tuple(
            Source(f'{UNDETECTED}[{c.effect.name}]', self.stated_size(c), c.effect.parameters[c.parameter].unit)
            for c in self.columns
        )

    def effects(self, cell: Cell) -> tuple[EffectLaw, ...]:
        """Those of the robot as effects of the model (`Undetected`)."""
        return Undetected.of(cell, self.columns[: self.of_robot])


NO_ERRORS = np.zeros(0)
NO_ERRORS.setflags(write=False)


class Observations(NamedTuple):
    """What n touches measured and where: the data of the adjustment.

    Attributes:
        joints: Q, (n, 2), rad.
        force: F on the object in the sensor's frame, (n, 2), N.
        centers: centre of each touch's disc, (n, 2), m.
        radii: its radius, (n,), m.
        frame: the sensor's frame.
        gripper: the form of (7).
        metadata: what effects need to know besides; None where there are no effects.
        declared: the errors of the cell description within their uncertainties; None where all is exactly known.
        errors: their values, then those of the random effects, (m + k,), for which force, centres and radii here are
            corrected.
        reported: force as the sensor reported it, (n, 2), N; None without such errors.
        tangents: unit vectors along straight edges, (n, 2), zero on arcs; None for discs alone.
        random: the random effects; None for none.
        known: what is known beforehand of the values of effects, or by an earlier calibration; None for nothing.
        shift: δ, rad, and d, m, of the random effects with their values, (n, 2) each; None where they are zero.
    """

    joints: Floats
    force: Floats
    centers: Floats
    radii: Floats
    frame: SensorFrame
    gripper: GripperSign
    metadata: TouchMetadata | None = None
    declared: DeclaredErrors | None = None
    errors: Floats = NO_ERRORS
    reported: Floats | None = None
    tangents: Floats | None = None
    random: RandomEffects | None = None
    known: Prior | JointPrior | None = None
    shift: tuple[Floats, Floats] | None = None

    @property
    def prior(self) -> Prior | JointPrior | None:
        """All that is known beforehand; None for nothing."""
        return known_beforehand(self.declared, self.random, self.known)

    def with_errors(self, errors: Floats) -> Observations:
        """The same touches in a cell with these declared errors, and these values of random effects, (m + k,)."""
        if self.reported is None:
            return self
        if self.declared is None:
            force, changed = self.reported, self
        else:
            own, surface = errors[: self.declared.count], self.surface
            force = self.declared.true_force(self.reported, own)
            changed = self._replace(
                centers=self.declared.centers(own)[surface],
                radii=self.declared.radii(own)[surface],
                tangents=None if self.tangents is None else self.declared.tangents(own)[surface],
            )
        shift = None
        if self.random is not None:
            joints, place, sensor = np.split(self.random.changes @ self.random_values(errors), 3, axis=1)
            force, shift = force - sensor, (joints, place)
        return changed._replace(force=force, errors=errors, shift=shift)

    def random_values(self, errors: Floats) -> Floats:
        """The values of the random effects among all errors, (k,)."""
        return errors[0 if self.declared is None else self.declared.count :]

    @property
    def surface(self) -> Indices:
        """Number of the touched surface in the cell, (n,); there are metadata."""
        assert self.metadata is not None and self.metadata.surface is not None
        return self.metadata.surface

    def on_surfaces(self, surfaces: Surfaces, which: Indices) -> Observations:
        """The same touches of other surfaces of a cell, as stated, by their numbers (n,); there are metadata."""
        assert self.metadata is not None
        metadata, centers, radii = self.metadata._replace(surface=which), surfaces.centers, surfaces.radii
        tangents = surfaces.tangents[which]
        return self._replace(metadata=metadata, centers=centers[which], radii=radii[which], tangents=tangents)

    def select(self, which: Any) -> Observations:
        """The touches that a mask, a slice or an array of positions picks."""
        if which is EVERY:
            return self
        random = None if self.random is None else self.random.select(which)
        of_all: dict[str, Any] = {'errors': self.errors, 'known': self.known, 'random': random}
        without: dict[str, Any] = dict.fromkeys(of_all)
        return pick(self._replace(**without), which)._replace(**of_all)

    @property
    def edges(self) -> Edges | None:
        """Which touches are of a straight edge; None for arcs alone."""
        return Edges.of(self.tangents, self.radii)

    def contact_problem(self, joints: Floats, off_normal: Floats | None = None) -> ContactProblem:
        """The touches at joint angles (n, 2), rad, and off-normal angles (n,), rad, as the equations take them."""
        problem = ContactProblem(joints, self.centers, self.radii, self.gripper, self.metadata, off_normal, self.edges)
        return problem if self.shift is None else problem.shifted_by(*self.shift)._replace(off_normal=off_normal)


def observe(
    touches: TouchSet,
    cell: Cell,
    errors: Floats | None = None,
    random: RandomEffects | None = None,
    known: Prior | JointPrior | None = None,
    declared: DeclaredErrors | None = None,
) -> Observations:
    """The touches as the adjustment takes them.

    Args:
        touches: what was measured.
        cell: the cell as stated.
        errors: its declared errors (`Calibration.errors`) and the values of the random effects, (m + k,); None for
            none.
        random: the random effects at the touches; None for none.
        known: what is known beforehand of the values of effects; None for nothing.
        declared: those of the cell, where they are at hand.

    Raises:
        ParameterError: a touch names a disc that the cell does not have.
    """
    if len(touches) and not (touches.disc.min() >= 0 and touches.disc.max() < len(cell.discs)):
        raise ParameterError('touches: disc', f'expected 0 to {len(cell.discs) - 1}, the discs of the cell')
    declared, surfaces = declared or DeclaredErrors.of(cell), cell.surfaces
    surface = _touched_surfaces(cell, touches) if cell.has_outlines else touches.disc
    count = (0 if declared is None else declared.count) + (0 if random is None else len(random.columns))
    stated = Observations(
        touches.joints,
        touches.force,
        surfaces.centers[surface],
        surfaces.radii[surface],
        cell.sensor.frame,
        cell.gripper_sign,
        TouchMetadata.of(touches, cell.sensor.frame)._replace(surface=surface),
        declared,
        np.zeros(count) if count else NO_ERRORS,
        None if declared is None and random is None else touches.force,
        surfaces.tangents[surface] if cell.has_outlines else None,
        random,
        known,
    )
    return stated if errors is None else stated.with_errors(errors)


def _touched_surfaces(cell: Cell, touches: TouchSet) -> Indices:
    """Numbers of the touched surfaces among `Cell.surfaces`, (n,), by the nominal arm where they are not known.

    Edges and corners are tangent-continuous: where a touch lies a distance δ beyond the end of its edge, a corner of
    radius r is δ²/2r away from it. So a first choice by nominal place and direction of the force is good enough for a
    fit, and the place of the tip by the fit decides (`Surfaces.settled`).
    """
    p, todo, found, force = cell.nominal, touches.surface < 0, touches.surface.copy(), touches.force
    if todo.any():
        force = cell.sensor.frame.to_base(force, touches.joints, p)
        tips = forward(p, touches.joints[todo])
        unit = force[todo] / np.maximum(np.hypot(*force[todo].T), 1e-300)[:, None]
        misses = cell.surfaces.misses(tips, unit, PER_ANGLE)
        size = np.where(unit.any(axis=1)[:, None], np.hypot(*misses.transpose(2, 0, 1)), cell.surfaces.distances(tips))
        found[todo] = cell.surfaces.nearest(size, touches.disc[todo])
    return found

"""Errors of the cell description within their declared uncertainties: nuisance parameters with a prior.

The true places of the discs, their radii, gain and rotation of the force sensor differ from the stated ones by unknown
errors that are the same in all touches. Each is a parameter of the fit, in units of its declared standard uncertainty,
so that its prior is the standard normal distribution: the fit minimises

    Σ_touches wᵀ V⁻¹ w + Σ_k e_k² + Σ_j ((L_j - L_n,j) / u_j)²,

the last sum over the nominal values that are trusted (`Cell.uncertainty.nominal`). What is an exact alias, such as an
error of all radii and g_ee, is thereby as uncertain as it was declared. Nothing is needed for it besides.

With e the errors, R(·) a rotation and s the stated values, a disc on a plate with origin o has the centre
o + t + R(ω) (s + δ - o) and the radius s + ρ + ρ_common; the force is R(-β) F_reported / (1 + γ).

To first order and with w whitened to w + J ΔL + N e, e is eliminated (`Marginal`): its covariance is then I + N Nᵀ.

Sources: GUM (JCGM 100:2008), 4.3 (type B) and F.1.2.4 (correlation by a common error); Mikhail and Ackermann,
Observations and Least Squares (1976), on parameters observed directly.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import NAMES, UNITS


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
            *(Source(f'object_radius[{d.name}]', d.radius_std, 'm') for d in cell.discs),
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

    @property
    def units(self) -> Floats:
        """The standard uncertainty of each error, (m,), in its unit."""
        return np.repeat([s.std for s in self.sources], [s.components for s in self.sources])

    @cached_property
    def places(self) -> dict[str, Indices]:
        """Positions of the errors of each source, by label."""
        ends = np.cumsum([source.components for source in self.sources]).tolist()
        return {s.label: np.arange(end - s.components, end) for s, end in zip(self.sources, ends, strict=True)}

    def _size(self, label: str, errors: Floats) -> float:
        """The error of one source in its unit, zero where it is not declared."""
        return float(errors[self.places[label][0]] * self._std[label]) if label in self.places else 0.0

    @cached_property
    def _std(self) -> dict[str, float]:
        return {source.label: source.std for source in self.sources}

    @cached_property
    def _by_disc(self) -> _ByDisc:
        discs, plates = self.cell.discs, {plate.name: plate for plate in self.cell.plates}
        own, carried = np.zeros((2, len(discs), 2, self.count))
        angle, radius = np.zeros((2, len(discs), self.count))
        parts: list[tuple[str, Floats]] = []
        for number, disc in enumerate(discs):
            parts += [
                (f'object_position[{disc.name}]', own[number]),
                (f'plate_position[{disc.plate}]', carried[number]),
                (f'plate_angle[{disc.plate}]', angle[number]),
                (f'object_radius[{disc.name}]', radius[number]),
                ('radius', radius[number]),
            ]
        for label, part in parts:
            if label in self.places:
                part[..., self.places[label]] = self._std[label] * (np.eye(2) if part.ndim == 2 else 1.0)
        origins = [(plates[disc.plate].x, plates[disc.plate].y) if disc.plate else (0.0, 0.0) for disc in discs]
        return _ByDisc(np.array(origins), own, carried, angle, radius)

    def centers(self, errors: Floats) -> Floats:
        """Centres of the discs, (D, 2), m."""
        if self._is_linear:
            return np.asarray(self.cell.centers + self._unturned @ errors)
        d, (cosine, sine) = self._by_disc, self._turns(errors)
        return d.origin + d.carried @ errors + _turned(cosine, sine, self._from_origin(errors))

    @cached_property
    def _is_linear(self) -> bool:
        """Whether no plate's rotation is uncertain."""
        return not self._by_disc.angle.any()

    @cached_property
    def _unturned(self) -> Floats:
        """Derivatives of the centres where no plate is turned, (D, 2, m), m."""
        return self._by_disc.own + self._by_disc.carried

    def radii(self, errors: Floats) -> Floats:
        """Radii of the discs, (D,), m."""
        return np.asarray(self.cell.radii + self._by_disc.radius @ errors)

    def _turns(self, errors: Floats) -> tuple[Floats, Floats]:
        """Cosine and sine of the rotation of each disc's plate, (D,)."""
        angle = self._by_disc.angle @ errors
        return np.cos(angle), np.sin(angle)

    def _from_origin(self, errors: Floats) -> Floats:
        """Centres relative to the origins of the plates before these are turned, (D, 2), m."""
        return np.asarray(self.cell.centers - self._by_disc.origin + self._by_disc.own @ errors)

    def sensor(self, errors: Floats) -> tuple[float, float]:
        """Errors of the force sensor's gain, relative, and rotation, rad."""
        return self._size('force_gain', errors), self._size('force_rotation', errors)

    def true_force(self, reported: Floats, errors: Floats) -> Floats:
        """Reported forces (n, 2) in N without the errors of gain and rotation."""
        gain, angle = self.sensor(errors)
        if gain == 0 and angle == 0:
            return reported
        c, s = np.cos(angle) / (1 + gain), np.sin(angle) / (1 + gain)
        return np.asarray(reported @ np.array([[c, -s], [s, c]]))

    def by_disc(self, errors: Floats) -> tuple[Floats, Floats]:
        """Derivatives of the centres, (D, 2, m), and of the radii, (D, m), by the errors, m."""
        d = self._by_disc
        if self._is_linear:
            return self._unturned, d.radius
        cosine, sine = self._turns(errors)
        turned = _turned(cosine[:, None], sine[:, None], d.own.swapaxes(1, 2)).swapaxes(1, 2)
        arm = _turned(cosine, sine, self._from_origin(errors))
        across = np.stack([-arm[:, 1], arm[:, 0]], axis=1)
        return turned + d.carried + across[:, :, None] * d.angle[:, None, :], d.radius

    def by_force(self, errors: Floats) -> tuple[Floats, Floats]:
        """Relative change of a force along itself, and across, by the errors, (m,) each."""
        along, across = np.zeros(self.count), np.zeros(self.count)
        if 'force_gain' in self.places:
            gain = self._size('force_gain', errors)
            along[self.places['force_gain']] = -self._std['force_gain'] / (1 + gain)
        if 'force_rotation' in self.places:
            across[self.places['force_rotation']] = -self._std['force_rotation']
        return along, across

    @cached_property
    def prior(self) -> Prior:
        """The prior of errors and trusted nominal values."""
        nominal = self.cell.uncertainty.nominal
        trusted = [name for name in NAMES if name in nominal]
        mean = np.array([getattr(self.cell.nominal, name) for name in trusted])
        stds = np.array([nominal[name] for name in trusted])
        trusted_sources = [Source(f'nominal[{name}]', nominal[name], UNITS[name]) for name in trusted]
        return Prior(
            sources=(*trusted_sources, *self.sources),
            trusted=np.array([NAMES.index(name) for name in trusted], dtype=np.intp),
            mean=mean,
            std=stds,
            errors=self.count,
        )


def without_sources(cell: Cell, labels: Set[str]) -> Cell:
    """The cell with some sources of uncertainty taken as exactly known: what is held at a value is no unknown error.

    Args:
        cell: as stated.
        labels: of sources; others are ignored.
    """
    if not labels:
        return cell
    discs, plates = list(cell.discs), list(cell.plates)
    for k, disc in enumerate(discs):
        if f'object_position[{disc.name}]' in labels:
            discs[k] = discs[k]._replace(center_std=0.0)
        if f'object_radius[{disc.name}]' in labels:
            discs[k] = discs[k]._replace(radius_std=0.0)
    for k, plate in enumerate(plates):
        if f'plate_position[{plate.name}]' in labels:
            plates[k] = plates[k]._replace(center_std=0.0)
        if f'plate_angle[{plate.name}]' in labels:
            plates[k] = plates[k]._replace(angle_std=0.0)
    u = cell.uncertainty
    uncertainty = replace(
        u,
        radius=0.0 if 'radius' in labels else u.radius,
        force_gain=0.0 if 'force_gain' in labels else u.force_gain,
        force_rotation=0.0 if 'force_rotation' in labels else u.force_rotation,
    )
    return replace(cell, discs=tuple(discs), plates=tuple(plates), uncertainty=uncertainty)


class _ByDisc(NamedTuple):
    """What each unit error does to each of D discs; zero where it has nothing to do with it.

    Attributes:
        origin: of its plate, (D, 2), m; zero where there is none.
        own: displacement on the plate, (D, 2, m), m.
        carried: displacement of the plate, (D, 2, m), m.
        angle: rotation of the plate, (D, m), rad.
        radius: change of the radius, (D, m), m.
    """

    origin: Floats
    own: Floats
    carried: Floats
    angle: Floats
    radius: Floats


def _turned(cosine: Floats, sine: Floats, vectors: Floats) -> Floats:
    """Vectors (…, 2) turned by angles."""
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


class Prior(NamedTuple):
    """What is known before the fit: rows of a least-squares problem in all values of the model and the errors.

    Attributes:
        sources: of the rows; a place has two rows.
        trusted: positions of the trusted nominal values, (p,).
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
        rows[np.arange(len(self.trusted)), self.trusted] = 1 / self.std
        rows[len(self.trusted) :, values:] = np.eye(self.errors)
        return rows

    def by_source(self) -> list[tuple[Source, Indices]]:
        """The sources with the positions of their rows."""
        ends = np.cumsum([source.components for source in self.sources]).tolist()
        return [(s, np.arange(end - s.components, end)) for s, end in zip(self.sources, ends, strict=True)]

    def residual(self, values: Floats, errors: Floats) -> Floats:
        """Residuals, (p + m,), in standard uncertainties."""
        return np.concatenate([(values[self.trusted] - self.mean) / self.std, errors])


class Marginal(NamedTuple):
    """M = (I + N Nᵀ)^(-1/2): whitened rows, once more whitened for what unknown errors add to their covariance.

    Attributes:
        basis: orthonormal basis of the columns of N, (2n, r).
        shrink: eigenvalues of M in it less 1, (r,).
    """

    basis: Floats
    shrink: Floats

    @classmethod
    def of(cls, columns: Floats | None, rows: int) -> Marginal:
        """M of N, (2n, m), in units of the standard uncertainties; the identity where N is None."""
        if columns is None or not columns.shape[1]:
            return cls(np.zeros((rows, 0)), np.zeros(0))
        basis, singular, _ = np.linalg.svd(columns, full_matrices=False)
        return cls(basis, 1 / np.sqrt(1 + singular**2) - 1)

    def apply(self, rows: Floats) -> Floats:
        """M times a vector (2n,) or columns (2n, k)."""
        if not self.shrink.size:
            return rows
        return np.asarray(rows + (self.basis * self.shrink) @ (self.basis.T @ rows))

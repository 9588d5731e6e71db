"""What n touches measured and where: the data of the adjustment."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.calibration.declared_errors import DeclaredErrors, Prior, RandomEffects, known_beforehand
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import EVERY, Floats, Indices, pick
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.contact import ContactProblem, Edges
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.kinematics import GripperSign, forward
from scara_kinetostatic.model.outline import PER_ANGLE, Surfaces
from scara_kinetostatic.model.touch import TouchSet

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
        known: what is known beforehand of the values of effects; None for nothing.
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
    known: Prior | None = None

    @property
    def prior(self) -> Prior | None:
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
        if self.random is not None:
            force = force - self.random.changes[2] @ self.random_values(errors)
        return changed._replace(force=force, errors=errors)

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
        if self.random is None:
            return problem
        joints, place = self.random.changes[:2] @ self.random_values(self.errors)
        return problem.shifted_by(joints, place)._replace(off_normal=off_normal)


def observe(
    touches: TouchSet,
    cell: Cell,
    errors: Floats | None = None,
    random: RandomEffects | None = None,
    known: Prior | None = None,
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

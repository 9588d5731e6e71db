"""The force that comes of commanded joint angles where the robot has effects beyond the twelve parameters.

The controller knows the twelve alone: it commands Ḡ(S, F) without effects. What force that gives is up to the
physics, F = A(Q, L̄) with the effects. A controller that presses until the sensor shows a force aims
deeper, or less deep, than the twelve say; by how much is found here at two levels, a light one and that of the hold,
and is linear in the force between them and beyond.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.contact import Contact, contact
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.simulation.plan import Plan

Floats = NDArray[np.float64]
Index = NDArray[np.intp]

LIGHT = 0.05
"""The beginning of a contact is looked for under this part of the force of the hold."""
NEAR_ENOUGH = 1e-3
"""Error of a force at which the search for a depth ends, as a part of it."""
LARGEST_ERROR = 0.02
"""A hold under a force farther than this from the planned one, as a part of it, is none."""
PASSES = 30
LARGEST_STEP = 2e-3
"""By which the aim is deepened at once, m."""
SOFTEST = 20.0
"""The robot with effects may be softer than without by this factor, or stiffer by its inverse."""


@dataclass(frozen=True)
class Loading:
    """The touches of a plan under load.

    Attributes:
        cell: discs, gripper.
        truth: the simulated robot.
        plan: the m touches.
        tags: what effects ask of each touch besides.
    """

    cell: Cell
    truth: ExtendedModel
    plan: Plan
    metadata: TouchMetadata

    def contact(self, touch: Index, joints: Floats, warm_start: Floats, tension: bool = False) -> Contact:
        """A(Q, L̄) at k moments of touches.

        Args:
            touch: number of the touch, (k,).
            joints: commanded Q, (k, 2), rad.
            near: where there are several equilibria, the one nearest to this force is taken, (k, 2), N.
            tension: as in `model.contact.contact`.
        """
        disc = self.plan.disc[touch]
        return contact(
            self.truth,
            joints,
            self.cell.centers[disc],
            self.cell.radii[disc],
            self.cell.gripper,
            tension=tension,
            warm_start=warm_start,
            metadata=self.metadata.select(touch),
        )

    def along(self, touch: Index, joints: Floats, warm_start: Floats) -> Floats:
        """Force on the object at k moments in the order of time, (k, 2), N; zero outside contact.

        At a moment whose equilibrium is not found the force lies between those before and after.
        """
        found = self.contact(touch, joints, warm_start)
        force, at = found.force.copy(), np.arange(len(touch))
        if not found.solved.all() and found.solved.any():
            for axis in (0, 1):
                force[:, axis] = np.interp(at, at[found.solved], force[found.solved, axis])
        return force

    def depths(
        self, command: Callable[[Floats], Floats], level: float, softness: Floats, start: Floats | None = None
    ) -> Floats:
        """How much deeper than by the twelve alone each touch is aimed, (m,), m; by secants.

        Args:
            command: from depths (m,), m, to the Q commanded under the level, (m, 2), rad.
            level: part of the force of the hold that is wanted.
            softness: depth per force of the robot without effects, (m,), m/N.
            start: where the search begins, (m,), m.
        """
        wanted = level * self.plan.force
        warm_start = -wanted[:, None] * self.plan.normal()
        depth = np.zeros(len(self.plan)) if start is None else start.copy()
        slope, todo = softness.copy(), np.arange(len(self.plan))
        before = np.full((2, len(self.plan)), np.nan)
        for _ in range(PASSES):
            force = self.contact(todo, command(depth)[todo], warm_start[todo], tension=True).magnitude
            off = np.abs(wanted[todo] - force) > NEAR_ENOUGH * wanted[todo]
            todo, force = todo[off], force[off]
            if not len(todo):
                break
            step, rise = depth[todo] - before[0, todo], force - before[1, todo]
            known = np.abs(rise) > 1e-9  # false in the first pass
            bounds = softness[todo] / SOFTEST, softness[todo] * SOFTEST
            slope[todo[known]] = np.clip(step / np.where(known, rise, 1.0), *bounds)[known]
            before[:, todo] = depth[todo], force
            depth[todo] += np.clip(slope[todo] * (wanted[todo] - force), -LARGEST_STEP, LARGEST_STEP)
        return depth

    def held(self, joints: Floats) -> Floats:
        """Force on the object in each hold, (m, 2), N.

        Args:
            joints: Q in each hold, (m, 2), rad.

        Raises:
            UnsupportedDataError: a touch has no equilibrium, or not the force that is planned.
        """
        planned = -self.plan.force[:, None] * self.plan.normal()
        found = self.contact(np.arange(len(self.plan)), joints, planned)
        off = ~(np.abs(found.magnitude - self.plan.force) <= LARGEST_ERROR * self.plan.force) | ~found.solved
        if off.any():
            first = int(np.argmax(off))
            name = self.cell.discs[self.plan.disc[first]].name
            got = f'it comes to {found.magnitude[first]:.3g} N' if found.solved[first] else 'there is no equilibrium'
            raise UnsupportedDataError(
                f'the simulated robot cannot hold touch {first} of the plan, on {name!r}, '
                f'under {self.plan.force[first]:g} N: {got}',
                'leave the touch out, or simulate smaller effects',
            )
        return found.force

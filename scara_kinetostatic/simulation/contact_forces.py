"""Contact forces of a robot with effects under commanded joint angles.

The simulated controller uses the base model: it commands Ḡ(S, F) without effects. The force that results is
F = A(Q, L̄) with the effects. A controller that presses until the sensor shows a force therefore commands a point
deeper, or less deep, than the base model gives. This depth is solved for at two forces, a light one and that of the
hold, and is linear in the force between them and beyond.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.contact import Contact, contact
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.touch import padded_history
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.simulation.trajectory import EASE, HOLD, Histories

Index = NDArray[np.intp]

LIGHT_FORCE = 0.05
"""The light force, over that of the hold."""
FORCE_TOLERANCE = 1e-3
"""Relative error of the force at which the iteration for a depth ends."""
LARGEST_FORCE_ERROR = 0.02
"""Largest relative error of the force of a hold; beyond it the touch is refused."""
LARGEST_FORCE_ERROR_AT_KINKS = 0.1
"""The same for a robot with a law that has kinks, where the commanded joints need not settle. The force is that of the
joints as commanded, whatever the plan says.
"""
MOST_ITERATIONS = 30
LARGEST_STEP = 2e-3
"""Largest change of a depth in one iteration, m."""
LARGEST_COMPLIANCE_RATIO = 20.0
"""Largest compliance of the robot with effects over that without; the smallest is its inverse."""


@dataclass(frozen=True)
class ContactForces:
    """The contact forces of the touches of a plan.

    Attributes:
        cell: discs, gripper.
        truth: the simulated robot.
        plan: the m touches.
        metadata: what effects need to know of each touch in its hold besides.
        histories: the load before each stage of the touches, where it is known.
    """

    cell: Cell
    truth: ExtendedModel
    plan: Plan
    metadata: TouchMetadata
    histories: Histories | None = None

    def contact(
        self,
        touch: Index,
        joints: Floats,
        warm_start: Floats,
        tension: bool = False,
        metadata: TouchMetadata | None = None,
    ) -> Contact:
        """A(Q, L̄) at k moments of touches.

        Args:
            touch: number of the touch, (k,).
            joints: commanded Q, (k, 2), rad.
            warm_start: of several equilibria, the one nearest to this force is taken, (k, 2), N.
            tension: as in `model.contact.contact`.
            metadata: of the moments; None: those of the holds.
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
            metadata=self.metadata.select(touch) if metadata is None else metadata,
        )

    def force_over_time(self, touch: Index, joints: Floats, warm_start: Floats, phase: Index) -> Floats:
        """Force on the object at k moments in the order of time, (k, 2), N; zero outside contact.

        Where no equilibrium is found the force is interpolated in time.
        """
        metadata = self.metadata.select(touch)
        if self.histories is not None:
            stages = [part[touch] for part in self.histories]
            longest = max(part.shape[1] for part in stages)
            stages = [padded_history(part, joints, longest) for part in stages]
            before, after = (phase < EASE)[:, None, None], (phase > HOLD)[:, None, None]
            metadata = metadata._replace(history=np.where(before, stages[0], np.where(after, stages[2], stages[1])))
        found = self.contact(touch, joints, warm_start, metadata=metadata)
        force, at = found.force.copy(), np.arange(len(touch))
        if not found.solved.all() and found.solved.any():
            for axis in (0, 1):
                force[:, axis] = np.interp(at, at[found.solved], force[found.solved, axis])
        return force

    def command_depths(
        self,
        command: Callable[[Floats], Floats],
        relative_force: float,
        compliance: Floats,
        start: Floats | None = None,
    ) -> Floats:
        """Depths at which the force is reached, beyond those of the base model, (m,), m; by the secant method.

        Args:
            command: from depths (m,), m, to the Q commanded under the level, (m, 2), rad.
            relative_force: part of the force of the hold that is wanted.
            compliance: depth per force of the robot without effects, (m,), m/N.
            start: first depths, (m,), m.
        """
        wanted = relative_force * self.plan.force
        warm_start = -wanted[:, None] * self.plan.normal()
        depth = np.zeros(len(self.plan)) if start is None else start.copy()
        slope, todo = compliance.copy(), np.arange(len(self.plan))
        before = np.full((2, len(self.plan)), np.nan)
        for _ in range(MOST_ITERATIONS):
            force = self.contact(todo, command(depth)[todo], warm_start[todo], tension=True).magnitude
            off = np.abs(wanted[todo] - force) > FORCE_TOLERANCE * wanted[todo]
            todo, force = todo[off], force[off]
            if not len(todo):
                break
            step, rise = depth[todo] - before[0, todo], force - before[1, todo]
            known = np.abs(rise) > 1e-9  # false in the first pass
            bounds = compliance[todo] / LARGEST_COMPLIANCE_RATIO, compliance[todo] * LARGEST_COMPLIANCE_RATIO
            slope[todo[known]] = np.clip(step / np.where(known, rise, 1.0), *bounds)[known]
            before[:, todo] = depth[todo], force
            depth[todo] += np.clip(slope[todo] * (wanted[todo] - force), -LARGEST_STEP, LARGEST_STEP)
        return depth

    def peak_force(self, joints: Floats, histories: Histories) -> Floats:
        """Largest force on the object in each touch, (m, 2), N, for its joints (m, 2), rad.

        The planned one where no equilibrium is found.
        """
        beyond = (1.0 + self.plan.preload) * self.plan.force
        every, planned = np.arange(len(self.plan)), -beyond[:, None] * self.plan.normal()
        found = self.contact(every, joints, planned, metadata=self.metadata._replace(history=histories.press))
        return np.where(found.solved[:, None], found.force, planned)

    def with_histories(self, histories: Histories) -> ContactForces:
        """The same touches with other loads before them."""
        return replace(self, metadata=self.metadata._replace(history=histories.hold), histories=histories)

    def in_hold(self, joints: Floats) -> Contact:
        """A(Q, L̄) in each hold, for its joints (m, 2), rad."""
        return self.contact(np.arange(len(self.plan)), joints, -self.plan.force[:, None] * self.plan.normal())

    def off_plan(self, found: Contact, tolerance: float = LARGEST_FORCE_ERROR) -> Mask:
        """Which touches have no equilibrium, or not the force that is planned but for a relative error, (m,)."""
        return ~(np.abs(found.magnitude - self.plan.force) <= tolerance * self.plan.force) | ~found.solved

    def hold_force(self, joints: Floats) -> Floats:
        """Force on the object in each hold, (m, 2), N.

        Args:
            joints: Q in each hold, (m, 2), rad.

        Raises:
            UnsupportedDataError: a touch has no equilibrium, or not the force that is planned.
        """
        found = self.in_hold(joints)
        is_smooth = all(effect.is_smooth for effect in self.truth.effects)
        off = self.off_plan(found, LARGEST_FORCE_ERROR if is_smooth else LARGEST_FORCE_ERROR_AT_KINKS)
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

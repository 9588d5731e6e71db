"""A world as it may be, given a cell description: its errors drawn from their declared uncertainties.

The discs stand where their places, their plates and their declared uncertainties may put them, the force sensor has a
gain and a rotation, trusted nominal values have errors. A robot that touches the discs of such a world makes touches as
a real one does (JCGM 101, 6.4: all errors normal).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.declared_errors import DeclaredErrors
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch import TouchSet


class World(NamedTuple):
    """What a cell description describes, up to its declared uncertainties.

    Attributes:
        described: the cell description.
        cell: the same with the discs as they are.
        errors: declared errors in units of their standard uncertainties, (m,).
        nominal_errors: of the trusted nominal values, by name, in their units.
    """

    described: Cell
    cell: Cell
    errors: Floats
    nominal_errors: dict[str, float]

    @classmethod
    def of(cls, described: Cell, errors: Floats | None, nominal_errors: dict[str, float] | None = None) -> World:
        """The world with given errors, (m,), in standard uncertainties; None for exactly the one described."""
        declared = DeclaredErrors.of(described)
        if declared is None or errors is None:
            return cls(described, described, np.zeros(0), {})
        places = zip(described.discs, declared.centers(errors), declared.radii(errors), strict=True)
        discs = tuple(disc._replace(x=float(x), y=float(y), radius=float(radius)) for disc, (x, y), radius in places)
        return cls(described, replace(described, discs=discs), errors, nominal_errors or {})

    @classmethod
    def draw(cls, described: Cell, random: np.random.Generator) -> World:
        """A world with all errors drawn from normal distributions."""
        declared = DeclaredErrors.of(described)
        errors = random.standard_normal(0 if declared is None else declared.count)
        stds = described.uncertainty.nominal
        return cls.of(described, errors, {name: float(std * random.standard_normal()) for name, std in stds.items()})

    def robot(self, parameters: Parameters) -> Parameters:
        """A robot whose trusted values are off the nominal ones by their errors, and the others as given."""
        nominal = self.described.nominal.as_dict()
        return parameters.replace(**{name: nominal[name] + error for name, error in self.nominal_errors.items()})

    def reported(self, touches: TouchSet) -> TouchSet:
        """Touches as the force sensor of this world reports them: with its errors of gain and rotation."""
        declared = DeclaredErrors.of(self.described)
        if declared is None or not len(self.errors):
            return touches
        # true = A reported, with A the same for all forces
        matrix = declared.true_force(np.eye(2), self.errors)
        return replace(touches, force=np.linalg.solve(matrix.T, touches.force.T).T)

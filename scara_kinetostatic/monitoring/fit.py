"""The fit of a calibration again, linearised: how its estimates answer to its touches and to errors of the cell.

The joint covariance of a record also holds what the choice among credible models contributes. The estimates themselves
are those of one model, and follow their data by that model alone: x = Ĉ Jᵀ r, with Ĉ = (JᵀJ + Λ)⁻¹ and Λ the prior
information of declared errors and trusted nominal values.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.declared_errors import DeclaredErrors
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.monitoring.linear import State, measure
from scara_kinetostatic.monitoring.record import CalibrationRecord

_DETERMINED = 1e-9
"""Information on a combination of values, in the largest of all, below which it was not determined."""


class Fit(NamedTuple):
    """The linearised fit.

    Attributes:
        state: what may be off.
        jacobian: J of the touches of the calibration, in units of the scale of the state, (2n, p).
        knowledge: Ĉ in the same units, (p, p): zero for what was held, exactly known or not determined.
    """

    state: State
    jacobian: Floats
    knowledge: Floats

    @classmethod
    def of(cls, record: CalibrationRecord, held: Indices | None = None) -> Fit:
        """That of a calibration; `held` are places of values that count as held, besides those that were."""
        state = State.of(record).of_stored_forces()
        jacobian = measure(record.touches, record, state).jacobian.reshape(-1, len(state.names))
        prior = _prior_information(record, state)
        prior[[NAMES.index(name) for name in record.fixed]] = np.inf
        prior[[record.place(name) for name in record.arm.model.held]] = np.inf
        prior[[] if held is None else held] = np.inf
        free = np.flatnonzero(np.isfinite(prior))
        rows = jacobian[:, free]
        values, vectors = np.linalg.eigh(rows.T @ rows + np.diag(prior[free]))
        kept = values > _DETERMINED * float(values.max(initial=1e-12))
        knowledge = np.zeros((len(prior), len(prior)))
        knowledge[np.ix_(free, free)] = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
        return cls(state, jacobian, knowledge)

    @property
    def by_errors(self) -> Floats:
        """Change of the estimates by true errors of all that is in the state, Ĉ JᵀJ, (p, p)."""
        return self.knowledge @ (self.jacobian.T @ self.jacobian)

    def by_standard_error(self, place: int, std: float, enlargement: float) -> Floats:
        """Change of the estimates where what is stated of a value or error is off by its std, SI, (p,)."""
        return self.state.scale * self.knowledge[:, place] * self.state.scale[place] / (std * np.sqrt(enlargement))


def _prior_information(record: CalibrationRecord, state: State) -> Floats:
    """Λ, (p,): that of declared errors and trusted values; infinite for errors that are not declared."""
    total, prior = len(record.arm.model.names), np.full(len(state.names), np.inf)
    prior[:total] = 0.0
    stated = {NAMES.index(name): std for name, std in record.arm.cell.uncertainty.nominal.items()}
    declared = DeclaredErrors.of(record.arm.cell)
    for name, std in zip(declared.names, declared.units.tolist(), strict=True) if declared else ():
        prior[state.error_place(name)] = 0.0
        stated[state.error_place(name)] = std
    for place, std in stated.items():
        prior[place] += (state.scale[place] / std) ** 2 / record.enlargement
    return prior

"""The changes that a fit may make, and what is known of them beforehand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.declared_errors import Prior
from scara_kinetostatic.calibration.fit_point import Point
from scara_kinetostatic.calibration.observations import Observations
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.extended_model import ExtendedModel


class Subspace(NamedTuple):
    """Which changes of the model the fit may make: all its values together are origin + basis y.

    Attributes:
        origin: (12 + k,), in the order of `ExtendedModel.names`.
        basis: (12 + k, m); its columns carry the scale of each change.
    """

    origin: Floats
    basis: Floats

    @classmethod
    def of_free(cls, model: ExtendedModel, free: Indices, scales: Floats) -> Subspace:
        """All changes of the values at some positions, (m,); the others stay as in a model."""
        basis = np.zeros((len(scales), len(free)))
        basis[free, np.arange(len(free))] = scales[free]
        return cls(model.as_array(), basis)

    def without(self, directions: Floats) -> Subspace:
        """The subspace without orthonormal directions, (m, d), of y: along those the model stays at the origin."""
        m, d = directions.shape
        complement = np.linalg.qr(np.concatenate([directions, np.eye(m)], axis=1))[0][:, d:m]
        return self._replace(basis=self.basis @ complement)

    def project(self, model: ExtendedModel) -> ExtendedModel:
        """The nearest model that the subspace holds, in scaled terms."""
        y = np.linalg.lstsq(self.basis, model.as_array() - self.origin, rcond=None)[0]
        return model.with_array(self.origin + self.basis @ y)

    def with_errors(self, count: int) -> Floats:
        """The basis beside that of as many declared errors, which are always free, (12 + k + count, m + count)."""
        if not count:
            return self.basis
        values, changes = self.basis.shape
        basis = np.zeros((values + count, changes + count))
        basis[:values, :changes], basis[values:, changes:] = self.basis, np.eye(count)
        return basis


class ActivePrior(NamedTuple):
    """The rows of the prior that a subspace does not leave constant.

    Attributes:
        prior: of the cell.
        active: which of its rows, (p + m,).
        rows: derivatives of the residuals by all values of the model and the errors, (p, 12 + k + m).
    """

    prior: Prior
    active: Mask
    rows: Floats

    @classmethod
    def of(cls, observations: Observations, subspace: Subspace) -> ActivePrior | None:
        """The prior of touches; None where everything counts as exactly known."""
        if observations.declared is None:
            return None
        prior = observations.declared.prior
        rows = prior.rows(len(subspace.origin))
        active = np.abs(rows @ subspace.with_errors(prior.errors)).max(axis=1, initial=0.0) > 0
        return cls(prior, np.asarray(active), rows[active])

    def residual(self, point: Point) -> Floats:
        """Residuals at a point, (p,), in standard uncertainties."""
        return self.prior.residual(point.model.as_array(), point.errors)[self.active]

    def system(self, point: Point) -> Floats:
        """The rows [J, -r] at a point."""
        return np.concatenate([self.rows, -self.residual(point)[:, None]], axis=1)

    def cost(self, point: Point) -> float:
        """Sum of the squared residuals."""
        return float((self.residual(point) ** 2).sum())

"""Gaussian knowledge of a state x ~ N(m, C), and what measurements r = J (x - m₀) + ε, ε ~ N(0, I), add to it.

From P = Σ JᵀJ and u = Σ Jᵀr of some measurements (`Information`) follow, without an inverse of C, which may be
singular,

    posterior after them:               C' = (I + C P)⁻¹ C,    m' = m + C' (u - P m),
    information on a change d since:    b = (I + P C)⁻¹ (u - P m),    Λ = (I + P C)⁻¹ P,
    likelihood ratio of d along D:      T = bᵀD (Dᵀ Λ D)⁻¹ Dᵀb  ~ χ² of rank D if nothing has changed.

Sources: Willsky and Jones, IEEE Trans. Automatic Control 21 (1976) 108 (generalised likelihood ratio of a jump); Kalman
filter in information form, Bar-Shalom, Li and Kirubarajan (2001).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.gaussian.linear_model import blocks
from scara_kinetostatic.model.arrays import Floats, Indices

_NOTHING = 1e-9
"""Part of the largest information below which nothing is known of a direction."""


class Information(NamedTuple):
    """What measurements say of a state, or of a change of it.

    Attributes:
        matrix: P, (p, p); of a change Λ, the covariance of the score if there is none.
        score: u, (p,).
    """

    matrix: Floats
    score: Floats

    @classmethod
    def of(cls, rows: Floats, residual: Floats, weight: Floats | float = 1.0) -> Information:
        """That of measurements together, of J (n, d, p) and r (n, d); `weight` of each, (n,)."""
        flat = rows.reshape(-1, rows.shape[-1])
        weighted = (rows * np.reshape(weight, (-1, 1, 1))).reshape(flat.shape)
        return cls(weighted.T @ flat, weighted.T @ residual.ravel())

    def plus(self, other: Information, faded: float = 1.0) -> Information:
        """With further measurements; the earlier ones are multiplied by `faded`."""
        return Information(faded * self.matrix + other.matrix, faded * self.score + other.score)

    def beside(self, columns: Floats) -> Information:
        """What is independent of changes along columns, (p, k)."""
        along = self.matrix @ columns
        inverse = np.linalg.pinv(columns.T @ along, rcond=_NOTHING, hermitian=True)
        matrix = self.matrix - along @ inverse @ along.T
        return Information((matrix + matrix.T) / 2, self.score - along @ inverse @ (columns.T @ self.score))

    def ratio(self, places: Sequence[int] | Indices) -> Ratio:
        """Of a change of some values; directions of which nothing is known do not count."""
        where = list(places)
        values, vectors = np.linalg.eigh(self.matrix[np.ix_(where, where)])
        kept = values > _NOTHING * max(float(values.max(initial=0.0)), 1e-12)
        root = vectors[:, kept] / np.sqrt(values[kept])
        change, std = root @ (root.T @ self.score[where]), np.linalg.norm(root, axis=1)
        std[np.linalg.norm(vectors[:, ~kept], axis=1) > std] = np.nan  # by its plausible size, one unit
        size_std = float(np.linalg.norm(change @ root) / max(float(np.linalg.norm(change)), 1e-300))
        return Ratio(float(self.score[where] @ change), int(kept.sum()), change, std, size_std)

    def largest_single(self, places: Sequence[int]) -> float:
        """The largest likelihood ratio of a change of a single value."""
        score, variance = self.score[list(places)], np.diag(self.matrix)[list(places)]
        known = variance > _NOTHING * np.diag(self.matrix).max(initial=0.0)
        return float((score[known] ** 2 / variance[known]).max(initial=0.0))


class Ratio(NamedTuple):
    """Likelihood ratio of a change of k values.

    Attributes:
        statistic: T.
        freedoms: its degrees of freedom.
        change: estimate, (k,).
        std: of the change, (k,); NaN where the measurements do not determine it.
        size_std: of the size of the change, along it.
    """

    statistic: float
    freedoms: int
    change: Floats
    std: Floats
    size_std: float


class Gaussian(NamedTuple):
    """What is known of a state.

    Attributes:
        mean: m, (p,).
        covariance: C, (p, p); may be singular.
    """

    mean: Floats
    covariance: Floats

    def spread(self, rows: Floats) -> Floats:
        """Covariance I + J C Jᵀ of measurements with J (n, d, p), (n, d, d)."""
        return np.eye(rows.shape[1]) + blocks(rows, self.covariance)

    def chi_squares(self, rows: Floats, residual: Floats) -> Floats:
        """Squared distance of each measurement, r (n, d), from its prediction, (n,)."""
        off = residual - rows @ self.mean
        return np.asarray((off * np.linalg.solve(self.spread(rows), off[:, :, None])[:, :, 0]).sum(axis=1))

    def chi_square(self, rows: Floats, residual: Floats) -> float:
        """Squared distance of all measurements together: rᵀr - uᵀ (I + C P)⁻¹ C u."""
        off = residual - rows @ self.mean
        matrix, score = Information.of(rows, off)
        gained = np.linalg.solve(np.eye(len(score)) + self.covariance @ matrix, self.covariance @ score)
        return float((off**2).sum() - score @ gained)

    def conditioned(self, rows: Floats, off: Floats) -> Gaussian:
        """After one measurement with J (d, p) that is off its prediction by (d,)."""
        spread = self.spread(rows[None])[0]
        gain = np.linalg.solve(spread, rows @ self.covariance).T
        covariance = self.covariance - gain @ spread @ gain.T
        return Gaussian(self.mean + gain @ off, (covariance + covariance.T) / 2)

    def change(self, found: Information) -> Information:
        """What measurements say of a change of the state since."""
        size = len(found.score)
        off = found.score - found.matrix @ self.mean
        right = np.concatenate([found.matrix, off[:, None]], axis=1)
        solved = np.linalg.solve(np.eye(size) + found.matrix @ self.covariance, right)
        return Information((solved[:, :size] + solved[:, :size].T) / 2, solved[:, size])

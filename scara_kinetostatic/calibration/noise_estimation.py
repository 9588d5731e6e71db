"""The two noise levels estimated from the residuals: variance components by REML.

The covariance of a misclosure is V = σ_q² V_q + σ_f² V_f with known V_q = h_Q h_Qᵀ
and V_f = h_F h_Fᵀ. Restricted maximum likelihood finds both levels from the residuals of the fit,
accounting for the parameters fitted. One round solves

    Σ_l tr(P V_k P V_l) σ_l² = rᵀ V⁻¹ V_k V⁻¹ r,   P = V⁻¹ - V⁻¹ J C Jᵀ V⁻¹,

and rounds are repeated with the fit until it converges. The two are well separated: along the
force both act, across it the force's noise alone.

Source: Förstner's and Helmert's variance component estimation; Koch, Parameter
Estimation and Hypothesis Testing in Linear Models (1999), section 3.6.
"""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.calibration.whitening import Linearisation, Whitened, outer
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Noise

_LEAST_NOISE = Noise(joint=1e-8, force=1e-5)
"""The least that a noise level is taken to be: joint readings may repeat to the last bit, and below this
the weights would be those of rounding errors."""
_LARGEST_CHANGE = 10.0
_LEAST_SHARE = 0.5
_FEWEST_FREEDOMS = 10
"""With fewer degrees of freedom the ratio of the two levels is kept and only their size estimated."""


def estimate_noise(linear: Linearisation, whitened: Whitened, covariance: Floats, noise: Noise) -> Noise:
    """One round of REML at a fit.

    Args:
        linear: the equations of the used touches.
        whitened: the same, whitened with `noise`.
        covariance: C of the parameters in the scale of `whitened.derivative`, (12, 12).
        noise: the levels so far.

    Returns:
        The levels that the residuals call for, each within a factor of 10 of before.
    """
    parts = [whiten_matrix(outer(b), whitened.root) for b in (linear.by_joints, linear.by_force)]
    if linear.by_off_normal is not None:  # of known size
        parts.append(whiten_matrix(outer(linear.by_off_normal[:, :, None]), whitened.root))
    r, jacobian = whitened.residual, whitened.derivative
    freedoms = r.size - int(np.linalg.matrix_rank(covariance))
    factor = np.sqrt(float((r**2).sum()) / max(freedoms, 1))
    same_ratio = _bounded(noise, Noise(noise.joint * factor, noise.force * factor))
    if freedoms < _FEWEST_FREEDOMS:
        return same_ratio
    weighted = [np.einsum('nij,njk->nik', part, jacobian) for part in parts]
    normals = [np.einsum('nik,nil->kl', jacobian, w) @ covariance for w in weighted]
    matrix, vector = np.empty((2, len(parts))), np.empty(2)
    for k in range(2):
        vector[k] = np.einsum('ni,nij,nj->', r, parts[k], r)
        for j in range(len(parts)):
            crossed = np.einsum('nik,nil->kl', weighted[k], weighted[j]) @ covariance
            matrix[k, j] = (
                np.einsum('nij,nij->', parts[k], parts[j]) - 2 * np.trace(crossed) + np.trace(normals[k] @ normals[j])
            )
    matrix, vector = matrix[:, :2], vector - matrix[:, 2:].sum(axis=1)
    scale = np.array(noise) ** 2
    if np.linalg.eigvalsh(matrix * np.outer(scale, scale)).min() <= 0:  # the two act alike: no telling them apart
        return same_ratio
    variances = _distinguishable(matrix, vector)
    return _bounded(noise, Noise(*np.sqrt(variances).tolist()))


def _distinguishable(matrix: Floats, vector: Floats) -> Floats:
    """Solve for two variances, neither smaller than what the residuals could distinguish from zero.

    An estimate at or below zero says that a noise does not show, not that there is none: a weight
    without bound would make sigmas too small. Such a variance is set to `_LEAST_SHARE` of its own
    standard deviation, and the other is solved for.
    """
    solution = np.asarray(np.linalg.solve(matrix, vector), dtype=float)
    least = _LEAST_SHARE * np.sqrt(2 * np.diag(np.linalg.inv(matrix)))
    if (solution >= least).all():
        return solution
    hidden = int(np.argmin(solution / least))
    other = 1 - hidden
    solution[hidden] = least[hidden]
    solution[other] = max((vector[other] - matrix[other, hidden] * least[hidden]) / matrix[other, other], least[other])
    return solution


def _bounded(old: Noise, new: Noise) -> Noise:
    return Noise(
        *(
            max(floor, min(max(after, before / _LARGEST_CHANGE), before * _LARGEST_CHANGE))
            for before, after, floor in zip(old, new, _LEAST_NOISE, strict=True)
        )
    )


def whiten_matrix(entries: Floats, root: tuple[Floats, Floats, Floats]) -> Floats:
    """L⁻¹ V L⁻ᵀ for symmetric (n, 3) entries 11, 21, 22, as (n, 2, 2)."""
    l11, l21, l22 = root
    v11, v21, v22 = np.moveaxis(entries, -1, 0)
    a11 = v11 / l11**2
    a21 = (v21 - l21 * v11 / l11) / (l11 * l22)
    a22 = (v22 - 2 * l21 * v21 / l11 + (l21 / l11) ** 2 * v11) / l22**2
    return np.stack([np.stack([a11, a21], axis=-1), np.stack([a21, a22], axis=-1)], axis=-2)

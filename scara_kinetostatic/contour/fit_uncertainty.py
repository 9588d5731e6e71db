"""Standard uncertainties of the parameters of a shape through measured points.

With e = A a for the residuals e along the normal and the parameters a, the covariance of a has three parts:

- by the calibration, A⁺ D Σ Dᵀ A⁺ᵀ, common to all points;
- by noise that changes along the slide, τ σ² (AᵀA)⁻¹ with σ the noise of a point and τ the number of neighbouring
  points whose errors are alike, from the correlation of the residuals along the passes;
- by noise that changes more slowly. The noise of a touch is a repeatability: how fast it changes along a slide is not
  known. The part κ of it that the residuals do not show, 1 - rms(e)² / mean(σ²), may be constant or change as slowly as
  the shape does, which then takes it up: κ Σ A⁺ (b bᵀ ∘ R) A⁺ᵀ over the measured quantities, with b the change of the
  points by one standard deviation and R = exp(-(Δt / T)² / 2), T the one of `_SLOW` for which it is largest.
"""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, rms
from scara_kinetostatic.model.tip import DEPENDS

_SLOW = (0.25, 0.5, 1.0, np.inf)
"""Times over which errors that residuals do not show may change, as parts of the time of the points."""
_GROUPS = 100
"""Groups of neighbouring points for which these are worked out."""


def parameter_stds(contour: Contour, arm: CalibratedArm, points: Mask, design: Floats, residual: Floats) -> Floats:
    """Standard uncertainties of the parameters of a fit with a design matrix, (k,); NaN where one is not determined."""
    inverse = np.linalg.pinv(design)
    by_model = inverse @ contour.by_model[points]
    systematic = np.einsum('ij,jk,ik->i', by_model, arm.covariance, by_model)
    free = ((by_model @ arm.undetermined) ** 2).sum(axis=1)
    systematic[free > DEPENDS**2 * systematic] = np.nan
    common = arm.cell.uncertainty.radius * inverse.sum(axis=1)
    slow = _slow_noise(np.asarray(inverse, dtype=np.float64), contour, points, residual)
    alike = _correlated_points(residual, contour.passes[points])
    changing = alike * np.einsum('ij,j,ij->i', inverse, contour.std_noise[points] ** 2, inverse)
    return np.asarray(np.sqrt(systematic + common**2 + changing + slow))


def _slow_noise(inverse: Floats, contour: Contour, points: Mask, residual: Floats) -> Floats:
    """Variances of the parameters by the noise that residuals do not show, (k,)."""
    by_noise, std, time = contour.by_noise[points], contour.std_noise[points], contour.time[points]
    hidden = min(max(1.0 - rms(residual) ** 2 / max(float((std**2).mean()), 1e-30), 0.0), 1.0)
    size = np.maximum(np.linalg.norm(by_noise, axis=1), 1e-30)
    loading = by_noise * (std / size)[:, None]
    group = np.arange(len(time)) * min(_GROUPS, len(time)) // len(time)
    count = np.bincount(group)
    terms = (inverse.T[:, :, None] * loading[:, None, :]).reshape(len(time), -1)
    sums = np.add.reduceat(terms, np.searchsorted(group, np.arange(len(count))))
    sums = sums.reshape(len(count), len(inverse), -1)
    middle = np.bincount(group, time) / count
    lag = (middle[:, None] - middle) / max(float(np.ptp(time)), 1e-9)
    alike = [np.exp(-0.5 * (lag / part) ** 2) for part in _SLOW]
    variances = [np.einsum('gkc,gh,hkc->k', sums, matrix, sums) for matrix in alike]
    return np.asarray(hidden * np.max(variances, axis=0))


def _correlated_points(residual: Floats, passes: Indices) -> float:
    """1 + 2 Σ ρ_k over the lags up to the first whose correlation ρ_k is not above 0, at least 1."""
    total, square = np.zeros(0), 0.0
    for number in np.unique(passes):
        part = residual[passes == number]
        lags = np.correlate(part, part, 'full')[len(part) - 1 :] if len(part) < 4000 else _by_fft(part)
        size = max(len(total), len(lags))
        total = np.pad(total, (0, size - len(total))) + np.pad(lags, (0, size - len(lags)))
        square += float(lags[0])
    if not square > 0:
        return 1.0
    correlation = total[1:] / square
    negative = np.flatnonzero(correlation <= 0)
    end = int(negative[0]) if len(negative) else len(correlation)
    return float(1.0 + 2.0 * correlation[:end].sum())


def _by_fft(values: Floats) -> Floats:
    """Sums of products of values a lag apart, for every lag."""
    size = 2 ** int(np.ceil(np.log2(2 * len(values))))
    spectrum = np.abs(np.fft.rfft(values, size)) ** 2
    return np.asarray(np.fft.irfft(spectrum, size)[: len(values)])

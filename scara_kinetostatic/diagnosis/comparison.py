"""The twelve parameters alone beside the extended model: errors in N and at the tip, fitted and held out.

Both are judged on the same touches, those that the extended model uses, and by the same noise, that of the extended
model. Where nothing was found the two are one.

**Error of the tip.** At the measured Q and F a model places the tip; its distance from the circle is h of
`model.equations` along the circle's normal, which is the force's unless friction turns it. The error is its root mean
square over the touches, linearised so that the noise in the direction of F, which alone would put the tip
r (σ_f/f)²/2 off, does not count. Held out means here that each touch is predicted by a fit without it, to first
order: (I - H_k)⁻¹ e_k, H_k its block of the projection on the fit's columns.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.gauss_helmert import Observations
from scara_kinetostatic.calibration.prediction import force_error, observe
from scara_kinetostatic.calibration.projection import project
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Point
from scara_kinetostatic.diagnosis.linear_problem import orthonormal
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import NAMES

Floats = NDArray[np.float64]

LEAST_KEPT = 1e-6


class TipError(NamedTuple):
    """Root mean squares over the touches, m.

    Attributes:
        fitted: distance of the predicted tip from the circle it touches.
        held_out: the same of touches left out of the fit one by one, to first order.
        noise: what the noise of joints and force alone gives.
    """

    fitted: float
    held_out: float
    noise: float


class Side(NamedTuple):
    """How good one model is.

    Attributes:
        force_error: e_f (10) over the used touches, N.
        held_out: e_f on touches not used in the fit, N.
        reduced_chi_square: 1 where model and noise are right.
        tip: error of the tip.
    """

    force_error: float
    held_out: float
    reduced_chi_square: float
    tip: TipError


class Bias(NamedTuple):
    """How far a missing effect had bent one parameter.

    Attributes:
        name: of the parameter.
        alone: estimate of the twelve parameters alone.
        alone_std: its standard deviation; NaN where there is none.
        value: estimate of the extended model.
        std: its standard deviation.
        shift: `alone` less `value`.
        in_std: the same in units of `alone_std`; NaN where either fit has no standard deviation.
    """

    name: str
    alone: float
    alone_std: float
    value: float
    std: float
    shift: float
    in_std: float

    @property
    def sure(self) -> bool:
        """Whether the shift is more than the standard deviation of the extended model; rivals may leave that wide."""
        return bool(np.isfinite(self.in_std)) and abs(self.shift) > self.std


class Comparison(NamedTuple):
    """Before and after.

    Attributes:
        nominal: e_f with the nominal parameters, N.
        alone: the twelve parameters alone.
        extended: with what was found; the same where nothing was.
        moved: displacement of the tip H(L̄, Q) by the bias of base, offsets and link lengths: root mean square over the
            touches, m.
        moved_most: the largest such displacement, m.
        biases: of the base model's parameters, in the order of `NAMES`.
    """

    nominal: float
    alone: Side
    extended: Side
    moved: float
    moved_most: float
    biases: tuple[Bias, ...]


def compare(alone: Calibration, final: Calibration, held_out: float, final_held_out: float) -> Comparison:
    """Compare the base model and the final one on the touches that the final one uses.

    Args:
        alone: the base model.
        final: the extended model; `alone` itself where nothing was found.
        held_out: force error of `alone` on touches not used in the fit, N.
        final_held_out: the same of `final`.
    """
    before = replace(alone, used=final.used)
    extended = _side(final, final, final_held_out)
    unlike = final is not alone
    joints = final.touches.joints[final.used]
    moved = np.linalg.norm(forward(alone.parameters, joints) - forward(final.parameters, joints), axis=1)
    return Comparison(
        nominal=force_error(alone.nominal_residual[final.used]),
        alone=_side(before, final, held_out) if unlike else extended,
        extended=extended,
        moved=float(np.sqrt(np.mean(moved**2))),
        moved_most=float(moved.max()),
        biases=tuple(_bias(name, alone, final) for name in NAMES),
    )


def _side(c: Calibration, final: Calibration, held_out: float) -> Side:
    """One model in the noise of the final one."""
    n = int(c.used.sum())
    observations = observe(c.touches.select(c.used), c.cell)
    point = project(observations, c.model, final.noise)
    base = orthonormal((point.whitened.derivative @ c.subspace.basis).reshape(2 * n, -1))
    chi_square = c.chi_square if c is final else float(point.distance.sum())
    across_circle = _whitened_normal(observations, point)
    tip = TipError(
        _rms((point.whitened.residual * across_circle).sum(axis=1)),
        _rms((_left_out(base, point.whitened.residual) * across_circle).sum(axis=1)),
        _rms(across_circle.ravel()) * 2**0.5,
    )
    return Side(force_error(c.residual[c.used]), held_out, chi_square / (2 * n - c.subspace.basis.shape[1]), tip)


def _whitened_normal(observations: Observations, point: Point) -> Floats:
    """Rᵀm, with m from the tip to the centre of the circle and R the root that whitens h: r·Rᵀm is h·m, (n, 2), m."""
    normal = np.zeros((len(point.distance), 2))
    normal[:, 0] = observations.radii
    if point.model.effects:
        at = observations.contact_problem(point.adjusted.joints, point.adjusted.off_normal).touch_state(
            point.parameters, point.adjusted.state
        )
        place = point.model.shift(at)[1] - point.model.shift(at, robot_only=True)[1]
        normal += np.stack([(place * at.normal).sum(axis=1), (place * at.tangent).sum(axis=1)], axis=-1)
    first, second = (normal / np.linalg.norm(normal, axis=1)[:, None]).T
    l11, l21, l22 = point.whitened.root
    return np.stack([l11 * first + l21 * second, l22 * second], axis=-1)


def _left_out(base: Floats, residual: Floats) -> Floats:
    """Whitened residuals (n, 2), each as a fit without that touch would leave it, to first order."""
    rows = base.reshape(-1, 2, base.shape[1])
    kept = np.eye(2) - np.einsum('nik,njk->nij', rows, rows)
    values, vectors = np.linalg.eigh(kept)
    turned = np.einsum('nij,ni->nj', vectors, residual) / np.maximum(values, LEAST_KEPT)
    return np.asarray(np.einsum('nij,nj->ni', vectors, turned))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _bias(name: str, alone: Calibration, final: Calibration) -> Bias:
    """What the missing effects made of one parameter of the base model."""
    before, after = getattr(alone.parameters, name), getattr(final.parameters, name)
    std, final_std = alone.std_of(name), final.std_of(name)
    in_std = (before - after) / std if std > 0 and np.isfinite(final_std) else np.nan
    return Bias(name, before, std, after, final_std, before - after, float(in_std))

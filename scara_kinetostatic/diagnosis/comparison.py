"""Comparison of the base model with the extended model: errors of force and tip, fitted and held out; bias.

Both are evaluated on the same touches, those that the extended model uses, and with the same noise, that of the
extended model. Where nothing was found the two are one.

**Error of the tip.** At the measured Q and F a model predicts the tip; its distance from the circle of contact is h of
`model.touch_equations` along the circle's normal, which is the force's unless friction turns it. The error is its root
mean square over the touches, linearised, so that the noise in the direction of F, which would displace the tip
by r (σ_f/f)²/2, does not count. Held out means here that each touch is predicted by a fit without it, to first
order: (I - H_k)⁻¹ e_k, with H_k its block of the projection on the fit's columns.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.fit_point import Point, augmented
from scara_kinetostatic.calibration.observations import Observations
from scara_kinetostatic.calibration.prediction import base_force, force_error, observe
from scara_kinetostatic.calibration.projection import project
from scara_kinetostatic.calibration.propagation import tip_under_force
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.linear_problem import orthonormal
from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import NAMES

_LEAST_EIGENVALUE = 1e-6
"""Of I - H_k; less is that of a touch which alone determines a parameter."""


class TipError(NamedTuple):
    """Root mean squares over the touches, m.

    Attributes:
        fitted: distance of the predicted tip from the circle it touches.
        held_out: the same of touches left out of the fit one by one, to first order.
        noise: expected from the noise of joints and force alone.
    """

    fitted: float
    held_out: float
    noise: float


class ModelErrors(NamedTuple):
    """The errors of one model.

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
    """Bias of one parameter of the base model by the effects that it lacks.

    Attributes:
        name: of the parameter.
        base: estimate of the base model.
        base_std: its standard deviation; NaN where there is none.
        value: estimate of the extended model.
        std: its standard deviation.
        shift: the bias, `base` less `value`.
        in_std: the same in units of `base_std`; NaN where either fit has no standard deviation.
    """

    name: str
    base: float
    base_std: float
    value: float
    std: float
    shift: float
    in_std: float

    @property
    def is_significant(self) -> bool:
        """Whether the bias exceeds the standard deviation of the extended model, which rivals may have widened."""
        return bool(np.isfinite(self.in_std)) and abs(self.shift) > self.std


class Comparison(NamedTuple):
    """The errors of the nominal, the base and the extended model, and the bias of the base model.

    Attributes:
        nominal: e_f with the nominal parameters, N.
        nominal_tip: root mean square over the touches of the distance of the tip from the circle it touches, as the
            nominal parameters predict it, m.
        base: the base model.
        extended: the extended model; the same where nothing was found.
        tip_bias: displacement of the tip H(L̄, Q) by the bias of base, offsets and link lengths: root mean square over
            the touches, m.
        largest_tip_bias: the largest such displacement, m.
        biases: of the base model's parameters, in the order of `NAMES`.
    """

    nominal: float
    nominal_tip: float
    base: ModelErrors
    extended: ModelErrors
    tip_bias: float
    largest_tip_bias: float
    biases: tuple[Bias, ...]


def compare(base: Calibration, final: Calibration, held_out: float, final_held_out: float) -> Comparison:
    """Compare the base model and the final one on the touches that the final one uses.

    Args:
        base: the base model.
        final: the extended model; `base` itself where nothing was found.
        held_out: force error of `base` on touches not used in the fit, N.
        final_held_out: the same of `final`.
    """
    before = replace(base, used=final.used)
    extended = _errors(final, final, final_held_out)
    joints = final.touches.joints[final.used]
    moved = np.linalg.norm(forward(base.parameters, joints) - forward(final.parameters, joints), axis=1)
    return Comparison(
        nominal=force_error(base.nominal_residual[final.used]),
        nominal_tip=_nominal_tip(final),
        base=extended if final is base else _errors(before, final, held_out),
        extended=extended,
        tip_bias=float(np.sqrt(np.mean(moved**2))),
        largest_tip_bias=float(moved.max()),
        biases=tuple(_bias(name, base, final) for name in NAMES),
    )


def _nominal_tip(c: Calibration) -> float:
    """Root mean square of the distance of H̄(L̄n, Q, F) from the circle of contact over the used touches, m."""
    o, nominal = observe(c.touches.select(c.used), c.cell), ExtendedModel(c.cell.nominal)
    tip, _ = tip_under_force(nominal, o.joints, base_force(o, nominal), o.gripper)
    return rms(np.linalg.norm(tip - o.centers, axis=1) - o.radii)


def _errors(c: Calibration, final: Calibration, held_out: float) -> ModelErrors:
    """One model in the noise of the final one."""
    n = int(c.used.sum())
    observations = observe(c.touches.select(c.used), c.cell, c.errors)
    point = project(observations, c.model, final.noise)
    base = orthonormal(augmented(point, (point.whitened.derivative @ c.subspace.basis).reshape(2 * n, -1)))[: 2 * n]
    chi_square = c.chi_square if c is final else float(point.distance.sum()) + c.prior_cost
    freedoms = 2 * n + c.trusted - c.subspace.basis.shape[1]
    across_circle = whitened_normal(observations, point)
    tip = TipError(
        rms((point.whitened.residual * across_circle).sum(axis=1)),
        rms((_left_out(base, point.whitened.residual) * across_circle).sum(axis=1)),
        rms(across_circle.ravel()) * 2**0.5,
    )
    return ModelErrors(force_error(c.residual[c.used]), held_out, chi_square / freedoms, tip)


def whitened_normal(observations: Observations, point: Point) -> Floats:
    """Rᵀm, with m the contact normal and R the root that whitens h: r·Rᵀm is h·m, (n, 2), m."""
    contact_problem = observations.contact_problem(point.adjusted.joints, point.adjusted.off_normal)
    at = contact_problem.touch_state(point.parameters, point.adjusted.state)
    normal = point.model.contact_normal(at)
    first, second = (normal * at.normal).sum(axis=1), (normal * at.tangent).sum(axis=1)
    l11, l21, l22 = point.whitened.root
    return np.stack([l11 * first + l21 * second, l22 * second], axis=-1)


def _left_out(base: Floats, residual: Floats) -> Floats:
    """Whitened residuals (n, 2), each as a fit without that touch would leave it, to first order."""
    rows = base.reshape(-1, 2, base.shape[1])
    kept = np.eye(2) - np.einsum('nik,njk->nij', rows, rows)
    values, vectors = np.linalg.eigh(kept)
    turned = np.einsum('nij,ni->nj', vectors, residual) / np.maximum(values, _LEAST_EIGENVALUE)
    return np.asarray(np.einsum('nij,nj->ni', vectors, turned))


def _bias(name: str, base: Calibration, final: Calibration) -> Bias:
    """The bias of one parameter."""
    before, after = getattr(base.parameters, name), getattr(final.parameters, name)
    std, final_std = base.std_of(name), final.std_of(name)
    in_std = (before - after) / std if std > 0 and np.isfinite(final_std) else np.nan
    return Bias(name, before, std, after, final_std, before - after, float(in_std))

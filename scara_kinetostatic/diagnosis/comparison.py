"""Comparison of the base model with the extended model: errors of force and tip, fitted and held out; bias.

Both are evaluated on the same touches, those that the extended model uses, and with the same noise, that of the
extended model. Where nothing was found the two are one.

**Error of the tip.** At the measured Q and F a model predicts the tip; its distance from the circle of contact is h of
`model.contact_force` along the circle's normal, which is the force's unless friction turns it. The error is its root
mean square over the touches, linearised, so that the noise in the direction of F, which would displace the tip
by r (σ_f/f)²/2, does not count. Held out means here that each touch is predicted by a fit without it, to first
order: (I - H_k)⁻¹ e_k, with H_k its block of the projection on the fit's columns.

**The residual of an effect** is the deviation that each touch shows, over the effect's variable, before and after.
An effect moves joints, moves the place of the contact, or is an error of the force sensor. With the whitened column u
of a unit of that deviation (`diagnosis.linear_problem`) and the whitened residual r of a touch, the deviation estimated
from that touch alone is -u·r / u·u, with standard deviation 1/|u|. A displacement is taken along and across the contact
normal, which friction turns away from the direction of the force. After: r of the extended model. Before, without the
effect and its rivals: r - (I - B Bᵀ) X θ, with X the columns of what is taken out and B an orthonormal basis of those
that stay. The second term is the part of the deviation that is expected before.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.fit_point import Point, augmented, base_force, force_error, project
from scara_kinetostatic.calibration.observations import JointPrior, Observations, observe
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import ActivePrior
from scara_kinetostatic.diagnosis.linear_problem import LinearProblem, pose_problem
from scara_kinetostatic.diagnosis.result import Found
from scara_kinetostatic.effects.base import Trial, at_joint
from scara_kinetostatic.gaussian.linear_model import left_out, orthonormal
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.arrays import Floats, Mask, pick, rms
from scara_kinetostatic.model.extended_model import ExtendedModel, Shift, TouchMetadata
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics


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
    """

    name: str
    base: float
    base_std: float
    value: float
    std: float

    @property
    def shift(self) -> float:
        """The bias."""
        return self.base - self.value

    @property
    def in_std(self) -> float:
        """The same in units of `base_std`; NaN where either fit has no standard deviation."""
        return self.shift / self.base_std if self.base_std > 0 and np.isfinite(self.std) else np.nan

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
        biases: of the base model's parameters, in the order of `Parameters.names`.
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
    before = base.changed(used=final.used)
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
        biases=tuple(Bias(name, *base[name][:2], *final[name][:2]) for name in final.parameters.names),
    )


def _nominal_tip(c: Calibration) -> float:
    """Root mean square of the distance of H̄(L̄n, Q, F) from the circle of contact over the used touches, m."""
    o, nominal = observe(c.touches.select(c.used), c.cell), ExtendedModel(c.cell.nominal)
    tip, _ = direct_kinetostatics(nominal, o.joints, base_force(o, nominal), o.gripper)
    away = np.linalg.norm(tip - o.centers, axis=1)
    if o.tangents is not None:
        t, off = o.tangents, tip - o.centers
        away = np.where(t.any(axis=1), off[:, 0] * t[:, 1] - off[:, 1] * t[:, 0], np.sign(o.radii) * away)
    return rms(away - o.radii)


def _errors(c: Calibration, final: Calibration, held_out: float) -> ModelErrors:
    """One model in the noise of the final one."""
    n = int(c.used.sum())
    observations = c.observe(c.used)
    point = project(observations, c.model, final.noise)
    if isinstance(c.known, JointPrior):
        basis = c.subspace.with_errors(c.known.errors)
        rows = [(point.whitened.jacobian @ basis).reshape(2 * n, -1), c.known.rows(len(c.model.names)) @ basis]
        base = orthonormal(np.concatenate(rows))[: 2 * n]
    else:
        changes = (point.whitened.derivative @ c.subspace.basis).reshape(2 * n, -1)
        base = orthonormal(augmented(point, changes))[: 2 * n]
    chi_square = c.chi_square if c is final else float(point.distance.sum()) + c.prior_cost
    freedoms = c.degrees_of_freedom if c is final else 2 * n + c.trusted - c.subspace.basis.shape[1]
    across_circle = whitened_normal(observations, point)
    tip = TipError(
        rms((point.whitened.residual * across_circle).sum(axis=1)),
        rms((left_out(base.reshape(n, 2, -1), point.whitened.residual) * across_circle).sum(axis=1)),
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


class LeftOut(NamedTuple):
    """Distance of the predicted tip from the circles of objects that the fit has not seen, root mean squares.

    Attributes:
        error: of the touches, m; NaN where too few are left to determine what all of them do.
        stated: its standard uncertainty: that of the calibration, what fewer touches add to it, and noise, m.
    """

    error: float
    stated: float


def objects_left_out(c: Calibration) -> LeftOut:
    """Each object predicted without its touches: a check that takes no model of what is undetected.

    To first order: without these touches the values move by -C' J'ᵀ r', and the distances at them by J of that.
    """
    touches, rank = c.touches.select(c.used), c.subspace.basis.shape[1]
    observations = c.observe(c.used)
    point = project(observations, c.model, c.noise)
    basis = c.subspace.with_errors(len(observations.errors))
    rows, residual = point.whitened.jacobian @ basis, point.whitened.residual
    prior = ActivePrior.of(observations, c.subspace)
    known = np.zeros((0, basis.shape[1])) if prior is None else prior.rows @ basis
    across = whitened_normal(observations, point)
    tip = Predictor(c.arm).locate(touches.joints, c.force[c.used], TouchMetadata.of(touches)).covariance
    normal = c.force[c.used] / np.hypot(*c.force[c.used].T)[:, None]
    stated = np.einsum('ni,nij,nj->n', normal, tip, normal) + c.enlargement * (across**2).sum(axis=1)
    every = np.linalg.pinv(known.T @ known + np.einsum('nik,nil->kl', rows, rows))
    errors, variances = [], []
    for disc in np.unique(touches.disc):
        out = touches.disc == disc
        kept = rows[~out].reshape(-1, basis.shape[1])
        system = np.concatenate([kept, known])
        if 2 * len(kept) < 3 * rank or np.linalg.matrix_rank(system) < rank:
            return LeftOut(np.nan, np.nan)
        fewer = np.linalg.pinv(system.T @ system)
        moved = residual[out] - rows[out] @ (fewer @ (kept.T @ residual[~out].ravel()))
        along = np.einsum('nik,ni->nk', rows[out], across[out])
        errors.append((moved * across[out]).sum(axis=1))
        variances.append(stated[out] + c.enlargement * np.einsum('nk,kl,nl->n', along, fewer - every, along))
    return LeftOut(rms(np.concatenate(errors)), float(np.sqrt(np.mean(np.concatenate(variances)))))


class EffectResidual(NamedTuple):
    """The deviation by one effect that each of n touches shows, with its standard uncertainty.

    Attributes:
        x_label: the variable, with unit.
        y_label: the deviation, with unit; the unit of all deviations here.
        x: the variable, (n,).
        before: deviation estimated from each touch without the effect and its rivals, (n,).
        after: the same with the extended model.
        expected: the part of `before` that the extended model predicts.
        std_before: standard deviation of one touch without the effect, (n,).
        std_after: the same with it; larger for an effect that is a scatter.
        disc: number of the disc, (n,).
        posture: +1 or -1, (n,).
    """

    x_label: str
    y_label: str
    x: Floats
    before: Floats
    after: Floats
    expected: Floats
    std_before: Floats
    std_after: Floats
    disc: NDArray[np.intp]
    posture: NDArray[np.intp]


_Columns = tuple[Floats, Floats, Floats, Floats, Floats]


def effect_residuals(final: Calibration, found: Sequence[Found]) -> tuple[EffectResidual, ...]:
    """The residual of each effect of the extended model, in the order of `found`.

    Args:
        final: the extended model.
        found: its effects.
    """
    problem, residuals = pose_problem(final), []
    for item in found:
        show = _off_normal_angle if item.effect.off_normal_std else _deviation
        y_label, kept, columns = show(problem, found, item)
        axis = item.effect.plot_axis(problem.touch_state, np.array([v.value for v in item.values]))
        metadata = problem.touch_state.metadata
        x_label = axis.title + (f'  [{axis.unit}]' if axis.unit else '')
        shown = EffectResidual(x_label, y_label, axis.values, *columns, metadata.disc, metadata.posture)
        residuals.append(pick(shown, kept))
    return tuple(residuals)


def _deviation(problem: LinearProblem, found: Sequence[Found], item: Found) -> tuple[str, Mask, _Columns]:
    """The label, the touches to show, (n,), and the columns of `EffectResidual` from `before` to `std_after`."""
    label, per_si, unit = _largest_channel(problem, item)
    weight = np.linalg.norm(unit, axis=1)
    acts = item.effect.acts_on(problem.touch_state)
    # touches much less sensitive to the deviation than the median one say nothing of it
    kept = acts & (weight > (np.median(weight[acts]) if acts.any() else 0.0) / 4.0)
    left, taken_out = problem.point.whitened.residual, _taken_out(problem, found, item)
    scale = np.maximum((unit**2).sum(axis=1), 1e-300)
    before, after, expected = (
        -per_si * (unit * residual).sum(axis=1) / scale for residual in (left + taken_out, left, taken_out)
    )
    std = per_si / np.maximum(weight, 1e-300)
    return label, kept, (before, after, expected, std, std)


def _taken_out(problem: LinearProblem, found: Sequence[Found], item: Found) -> Floats:
    """Change of the residual where an effect and its rivals are left out, (n, 2)."""
    final = problem.calibration
    columns = problem.point.whitened.derivative[:, :, final.model.base_count :].reshape(len(problem.left), -1)
    parts = final.model.effect_arrays
    amplitudes = [effect.amplitudes(part) for effect, part in zip(final.model.effects, parts, strict=True)]
    out = {f.effect.label: f.effect == item.effect or not (f.in_every_model or item.in_every_model) for f in found}
    sizes = [len(part) for part in parts]
    # Effects that are held are in neither.
    gone = np.repeat([out.get(effect.label, False) for effect in final.model.effects], sizes)
    kept = np.repeat([not out.get(effect.label, True) for effect in final.model.effects], sizes)
    fitted = np.concatenate([problem.jacobian, columns[:, kept]], axis=1)
    basis = orthonormal(augmented(problem.point, fitted))
    lost = np.zeros(len(basis))
    lost[: len(columns)] = columns[:, gone] @ np.concatenate(amplitudes)[gone]
    return (basis @ (basis.T @ lost) - lost)[: len(columns)].reshape(-1, 2)


def _off_normal_angle(problem: LinearProblem, found: Sequence[Found], item: Found) -> tuple[str, Mask, _Columns]:
    """The off-normal angle of each force: its standard deviation is that of noise alone, or of noise and friction."""
    radii, linear, (_, l21, l22) = problem.touch_state.radii, problem.point.linear, problem.point.whitened.root
    assert linear.by_off_normal is not None
    angle, variance = -1e3 * linear.misclosure[:, 1] / radii, l21**2 + l22**2
    noise, std = (1e3 * np.sqrt(v) / radii for v in (variance - linear.by_off_normal[:, 1] ** 2, variance))
    columns = angle, angle, np.zeros_like(angle), noise, std
    return 'off-normal angle of the force  [mrad]', np.ones(len(radii), dtype=bool), columns


def _largest_channel(problem: LinearProblem, item: Found) -> tuple[str, float, Floats]:
    """The way in which an effect acts most on the touches: the deviation with the unit shown, that unit per SI unit,
    and the whitened column of one SI unit, (n, 2).
    """
    at, values = problem.touch_state, np.array([v.value for v in item.values])
    amplitudes, shifts = item.effect.amplitudes(values), item.effect.derivative(at, values)
    errors = item.effect.sensor_error_derivative(problem.force, values, at.metadata)
    joints, place, error = (
        sum((a * part for a, part in zip(amplitudes, parts, strict=False) if part is not None), np.zeros((1, 2)))
        for parts in ([shift.joints for shift in shifts], [shift.place for shift in shifts], errors)
    )
    normal = problem.point.model.contact_normal(at)
    along = problem.force / np.hypot(problem.force[:, 0], problem.force[:, 1])[:, None]
    # label, unit shown per SI unit, what the effect does, direction in which it is shown, one SI unit of it
    rows: list[tuple[str, float, Floats, Floats, Trial]] = []
    for joint in (0, 1):
        unit = at_joint(np.ones(len(along)), joint)
        rows.append((f'deviation of joint {joint + 1}  [µrad]', 1e6, joints, unit, Trial((Shift(unit),))))
    for side, turn in (('along', np.eye(2)), ('across', np.array([[0.0, 1.0], [-1.0, 0.0]]))):
        unit, force = normal @ turn, along @ turn
        rows.append((f'displacement {side} the contact normal  [µm]', 1e6, place, unit, Trial((Shift(place=unit),))))
        rows.append((f'sensor error {side} the force  [N]', 1.0, error, force, Trial((Shift(),), (force,))))
    columns = [problem.changes(trial).reshape(-1, 2) for *_, trial in rows]
    sizes = [
        np.linalg.norm((r[2] * r[3]).sum(axis=1)[:, None] * column) for r, column in zip(rows, columns, strict=True)
    ]
    largest = int(np.argmax(sizes))
    return *rows[largest][:2], columns[largest]

"""Comparison of the base model with the extended model: errors of force and tip, fitted and held out; bias.

Both are evaluated on the same touches, those that the extended model uses, and with the same noise, that of the
extended model. Where nothing was found the two are one.

**Error of the tip.** At the measured Q and F a model predicts the tip; its distance from the circle of contact is h of
`model.touch_equations` along the circle's normal, which is the force's unless friction turns it. The error is its root
mean square over the touches, linearised, so that the noise in the direction of F, which would displace the tip
by r (σ_f/f)²/2, does not count. Held out means here that each touch is predicted by a fit without it, to first
order: (I - H_k)⁻¹ e_k, with H_k its block of the projection on the fit's columns.

**The residual of an effect** is the deviation that each touch shows, over the effect's variable, before and after.
An effect moves joints, moves the place of the contact, or is an error of the force sensor. With the whitened column u
of a unit of that deviation (`diagnosis.linear_problem`) and the whitened residual r of a touch, the deviation estimated
from that touch alone is -u·r / u·u, with standard deviation 1/|u|. A displacement is taken along and across the contact
normal, which friction turns away from the direction of the force. After: r of the extended model. Before: r of the
model without the effect and its rivals. Where nothing else was found, that is the base model; else it
is r - (I - B Bᵀ) X θ, with X the columns of what is taken out and B an orthonormal basis of those that stay. The second
term is the part of the deviation that is expected before.

**Discrimination of rivals**: touches at which their predictions of the force, each fitted to the data, differ most.
From a pool of touches all around the discs, in both elbow postures, at three force levels, pressed to the force or
preloaded beyond it and unloaded to it, those are chosen at which the predictions differ most in standard
deviations of a measured force, Σ_F + A_Q Σ_Q A_Qᵀ: the criterion of T-optimality (Atkinson and Fedorov,
Biometrika 62 (1975) 57).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.fit_point import Point, augmented, base_force, force_error, project
from scara_kinetostatic.calibration.observations import Observations, observe
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.linear_problem import Problem, orthonormal, pose_problem
from scara_kinetostatic.diagnosis.result import DiscriminatingTouch, Found
from scara_kinetostatic.effects.base import at_joint
from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.model.cell import Noise, SensorFrame
from scara_kinetostatic.model.contact import contact, contact_derivatives
from scara_kinetostatic.model.effect_law import Shift, TouchState
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics, inverse_kinetostatics
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.model.touch import LATER, TouchSet


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
    tip, _ = direct_kinetostatics(nominal, o.joints, base_force(o, nominal), o.gripper)
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
    # less is that of a touch which alone determines a parameter
    turned = np.einsum('nij,ni->nj', vectors, residual) / np.maximum(values, 1e-6)
    return np.asarray(np.einsum('nij,nj->ni', vectors, turned))


def _bias(name: str, base: Calibration, final: Calibration) -> Bias:
    """The bias of one parameter."""
    before, after = getattr(base.parameters, name), getattr(final.parameters, name)
    std, final_std = base.std_of(name), final.std_of(name)
    in_std = (before - after) / std if std > 0 and np.isfinite(final_std) else np.nan
    return Bias(name, before, std, after, final_std, before - after, float(in_std))


class _Channel(NamedTuple):
    """One way in which an effect acts on a touch.

    Attributes:
        label: the deviation, with the unit shown.
        per_si: that unit.
        shift: of one SI unit, as the equations take it.
        sensor_error: the same as an error of the sensor, (n, 2).
        size: deviation of each touch by the effect to first order, (n,), SI.
    """

    label: str
    per_si: float
    shift: Shift
    sensor_error: Floats | None
    size: Floats


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


def effect_residuals(alone: Calibration, final: Calibration, found: Sequence[Found]) -> tuple[EffectResidual, ...]:
    """The residual of each effect of the extended model, in the order of `found`.

    Args:
        alone: the base model.
        final: the extended model.
        found: its effects.
    """
    models = _Models(alone, final, tuple(found))
    return tuple(
        _off_normal_residual(models, item) if item.effect.off_normal_std else _residual(models, item) for item in found
    )


@dataclass(frozen=True)
class _Models:
    """The base model and the extended model, each as a linear problem of the same touches and noise."""

    alone: Calibration
    final: Calibration
    found: tuple[Found, ...]

    @cached_property
    def before(self) -> Problem:
        return pose_problem(replace(self.alone, used=self.final.used, noise=self.final.noise))

    @cached_property
    def after(self) -> Problem:
        return pose_problem(self.final)


def _residual(models: _Models, item: Found) -> EffectResidual:
    problem = models.after
    channels = _channels(problem, item)
    which = int(np.argmax([float(np.linalg.norm(_moved(problem, each))) for each in channels]))
    channel = channels[which]
    unit = problem.change(channel.shift, channel.sensor_error).reshape(-1, 2)
    weight = np.linalg.norm(unit, axis=1)
    acts = item.effect.acts_on(problem.touch_state)
    # touches much less sensitive to the deviation than the median one say nothing of it
    kept = acts & (weight > (np.median(weight[acts]) if acts.any() else 0.0) / 4.0)
    x_label, x = _variable(problem, item)
    metadata, left = problem.touch_state.metadata, problem.point.whitened.residual
    taken_out, is_only_effect = _taken_out(models, item)
    before = left + taken_out
    old = unit
    if is_only_effect:
        there = _channels(models.before, item)[which]
        alone = models.before
        before = alone.refitted(alone.point.whitened.residual.ravel(), alone.point.errors)
        old = alone.change(there.shift, there.sensor_error).reshape(-1, 2)

    def deviation(column: Floats, residual: Floats) -> Floats:
        scale = np.maximum((column**2).sum(axis=1), 1e-300)
        return np.asarray(-channel.per_si * (column * residual.reshape(-1, 2)).sum(axis=1) / scale)[kept]

    return EffectResidual(
        x_label=x_label,
        y_label=channel.label,
        x=x[kept],
        before=deviation(old, before),
        after=deviation(unit, left),
        expected=deviation(unit, taken_out),
        std_before=channel.per_si / np.linalg.norm(old, axis=1)[kept],
        std_after=channel.per_si / weight[kept],
        disc=metadata.disc[kept],
        posture=metadata.posture[kept],
    )


def _taken_out(models: _Models, item: Found) -> tuple[Floats, bool]:
    """Change of the residual where an effect and its rivals are left out, (n, 2); whether nothing else was found."""
    final, problem = models.final, models.after
    columns = problem.point.whitened.derivative[:, :, len(NAMES) :].reshape(len(problem.left), -1)
    parts = final.model.effect_arrays
    amplitudes = [effect.amplitudes(part) for effect, part in zip(final.model.effects, parts, strict=True)]
    out = [other.effect == item.effect or not (other.in_every_model or item.in_every_model) for other in models.found]
    gone = np.repeat(out, [len(part) for part in parts])
    lost = columns[:, gone] @ np.concatenate(amplitudes)[gone]
    left = problem.refitted(lost, beside=None if gone.all() else columns[:, ~gone])
    return -left.reshape(-1, 2), bool(gone.all())


def _off_normal_residual(models: _Models, item: Found) -> EffectResidual:
    """The off-normal angle of each force: its standard deviation is that of noise alone, or of noise and friction."""
    problem = models.before
    radii, metadata = problem.touch_state.radii, problem.touch_state.metadata
    angle = -1e3 * problem.point.linear.misclosure[:, 1] / radii
    _, l21, l22 = problem.point.whitened.root
    noise = 1e3 * np.hypot(l21, l22) / radii
    x_label, x = _variable(models.after, item)
    return EffectResidual(
        x_label=x_label,
        y_label='off-normal angle of the force  [mrad]',
        x=x,
        before=angle,
        after=angle,
        expected=np.zeros_like(angle),
        std_before=noise,
        std_after=np.hypot(noise, 1e3 * item.effect.off_normal_std),
        disc=metadata.disc,
        posture=metadata.posture,
    )


def _moved(problem: Problem, channel: _Channel) -> Floats:
    column = problem.change(channel.shift, channel.sensor_error).reshape(-1, 2)
    return np.asarray(channel.size[:, None] * column)


def _channels(problem: Problem, item: Found) -> list[_Channel]:
    at, values = problem.touch_state, np.array([v.value for v in item.values])
    joints, place, sensor_error = _first_order(item, at, problem.force, values)
    channels = []
    if joints is not None:
        for joint in (0, 1):
            unit = Shift(joints=at_joint(np.ones(len(joints)), joint))
            channels.append(_Channel(f'deviation of joint {joint + 1}  [µrad]', 1e6, unit, None, joints[:, joint]))
    if place is not None:
        normal = problem.point.model.contact_normal(at)
        for side, direction in (('along', normal), ('across', np.stack([-normal[:, 1], normal[:, 0]], axis=-1))):
            size = (place * direction).sum(axis=1)
            label = f'displacement {side} the contact normal  [µm]'
            channels.append(_Channel(label, 1e6, Shift(place=direction), None, size))
    if sensor_error is not None:
        along = problem.force / np.hypot(problem.force[:, 0], problem.force[:, 1])[:, None]
        for side, direction in (('along', along), ('across', np.stack([-along[:, 1], along[:, 0]], axis=-1))):
            size = (sensor_error * direction).sum(axis=1)
            channels.append(_Channel(f'sensor error {side} the force  [N]', 1.0, Shift(), direction, size))
    return channels


def _first_order(item: Found, at: TouchState, force: Floats, values: Floats) -> list[Floats | None]:
    """δ, d and e of an effect, (n, 2) each, to first order: amplitudes times derivatives, as `_taken_out` has them."""
    amplitudes = item.effect.amplitudes(values)
    shifts = item.effect.derivative(at, values)
    parts: list[Sequence[Floats | None]] = [
        [shift.joints for shift in shifts],
        [shift.place for shift in shifts],
        item.effect.sensor_error_derivative(force, values, at.metadata),
    ]
    return [_sum(amplitudes, part) for part in parts]


def _sum(amplitudes: Floats, parts: Sequence[Floats | None]) -> Floats | None:
    terms = [a * part for a, part in zip(amplitudes, parts, strict=False) if part is not None]
    return np.asarray(np.sum(terms, axis=0)) if terms else None


def _variable(problem: Problem, item: Found) -> tuple[str, Floats]:
    """The variable over which an effect is shown: its name with unit, and its values, (n,)."""
    axis = item.effect.plot_axis(problem.touch_state, np.array([v.value for v in item.values]))
    return axis.title + (f'  [{axis.unit}]' if axis.unit else ''), axis.values


_DIRECTIONS = 24
"""Touches of the pool around each disc."""


def discriminating_touches(
    calibration: Calibration, rivals: Sequence[Calibration], most: int = 4
) -> tuple[DiscriminatingTouch, ...]:
    """The touches that discriminate best between fitted rivals, one per disc and side.

    Args:
        calibration: the base model; its touches give the force levels.
        rivals: the same touches fitted with each rival, two or more.
        most: how many touches at most.
    """
    pool, angle, is_unloaded = _pool(calibration)
    difference, in_std = np.zeros(len(pool)), np.zeros(len(pool))
    for one, other in combinations([_predict(pool, rival) for rival in rivals], 2):
        distance, std = _difference(one, other)
        larger = distance / std > in_std
        difference, in_std = np.where(larger, distance, difference), np.where(larger, distance / std, in_std)
    chosen: list[int] = []
    for k in np.argsort(-in_std):
        # of two touches on a disc with less than 60° between them one is enough
        is_near = any(pool.disc[k] == pool.disc[j] and np.cos(angle[k] - angle[j]) > 0.5 for j in chosen)
        if in_std[k] >= 2.0 and not is_near and len(chosen) < most:
            chosen.append(int(k))
    magnitude = np.hypot(*pool.force.T)
    names = [disc.name for disc in calibration.cell.discs]
    return tuple(
        DiscriminatingTouch(
            names[pool.disc[k]],
            float(angle[k]),
            int(pool.posture[k]),
            float(magnitude[k]),
            bool(is_unloaded[k]),
            float(difference[k]),
            float(in_std[k]),
        )
        for k in chosen
    )


class _Predicted(NamedTuple):
    """The forces that a fit predicts for touches.

    Attributes:
        force: F, (n, 2), N; NaN where the model reaches none.
        by_joints: ∂F/∂Q, (n, 2, 2).
        noise: σ_q and σ_f of the fit.
    """

    force: Floats
    by_joints: Floats
    noise: Noise


def _predict(pool: TouchSet, fit: Calibration) -> _Predicted:
    o, model = observe(pool, replace(fit.cell, sensor=fit.cell.sensor._replace(frame=SensorFrame.BASE))), fit.model
    found = contact(model, o.joints, o.centers, o.radii, o.gripper, warm_start=pool.force, metadata=o.metadata)
    reached = (found.solved & (found.magnitude > 0))[:, None]
    by_joints = contact_derivatives(model, o.joints, o.centers, o.radii, found, o.gripper, o.metadata).joints
    return _Predicted(np.where(reached, found.force, np.nan), by_joints, fit.noise)


def _difference(one: _Predicted, other: _Predicted) -> tuple[Floats, Floats]:
    """The distance of two predictions, N, and its standard deviation, (n,) each."""
    difference = one.force - other.force
    distance = np.nan_to_num(np.hypot(difference[:, 0], difference[:, 1]))
    along = np.nan_to_num(difference / np.maximum(distance, 1e-12)[:, None])
    turned = np.einsum('nij,ni->nj', one.by_joints, along)
    return distance, np.sqrt(_force_variance(one) + ((one.noise.joint_levels * turned) ** 2).sum(axis=1))


def _force_variance(predicted: _Predicted) -> Floats | float:
    """Variance of a component of each force, rms over the axes, N²."""
    noise = predicted.noise
    grown = noise.growth**2 * np.nan_to_num(predicted.force**2).sum(axis=1) if noise.growth else 0.0
    return noise.force_rms**2 + grown


def _pool(calibration: Calibration) -> tuple[TouchSet, Floats, NDArray[np.bool_]]:
    """Touches to choose from, their places on the discs, and whether they are unloaded to their force.

    Their forces, in the history too, are in the base frame, whatever that of the sensor is.
    """
    cell, p = calibration.cell, calibration.parameters
    magnitude = np.hypot(*calibration.force.T)
    levels = np.unique(np.round(np.quantile(magnitude, (0.05, 0.5, 0.95)), 0))
    disc, direction, posture, level, is_unloaded = (
        axis.ravel()
        for axis in np.meshgrid(
            np.arange(len(cell.discs)), np.arange(_DIRECTIONS), (1, -1), levels, (False, True), indexing='ij'
        )
    )
    angle = 2 * np.pi * direction / _DIRECTIONS
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    tip = cell.centers[disc] + cell.radii[disc, None] * outward
    reach = np.hypot(tip[:, 0] - p.x0, tip[:, 1] - p.y0)
    length = p.l1 + p.l2
    reachable = (reach < 0.95 * length) & (reach > (1 - 0.95) * length + abs(p.l1 - p.l2))
    parts = [array[reachable] for array in (disc, angle, posture, level, is_unloaded, tip, outward)]
    disc, angle, posture, level, is_unloaded, tip, outward = parts

    def pressed(force: Floats) -> Floats:
        return inverse_kinetostatics(p, tip, -force[:, None] * outward, posture, cell.gripper)[0]

    joints = pressed(level)
    # unloaded touches are preloaded by 30 % beyond the force, others begin with 1 mN
    before = np.where(is_unloaded, (1 + 0.3) * level, 1e-3)
    motion = joints - pressed(before)
    motion = (motion + np.pi) % (2 * np.pi) - np.pi
    peak = np.where(is_unloaded, before, 0.0)[:, None] * -outward
    pool = TouchSet(
        joints=joints,
        force=-level[:, None] * outward,
        disc=disc,
        posture=posture,
        time=np.full(len(disc), float(calibration.touches.time.max())),
        approach=motion,
        press=motion,
        history=np.concatenate([joints - motion, peak], axis=1)[:, None],
        order=np.full(len(disc), LATER),
    )
    return pool, angle, is_unloaded

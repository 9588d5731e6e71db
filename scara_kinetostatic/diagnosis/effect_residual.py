"""The residual of an effect: the deviation that each touch shows, over the effect's variable, before and after.

An effect moves joints, moves the place of the contact, or is an error of the force sensor. With the whitened column u
of a unit of that deviation (`diagnosis.linear_problem`) and the whitened residual r of a touch, the deviation estimated
from that touch alone is -u·r / u·u, with standard deviation 1/|u|. A displacement is taken along and across the contact
normal, which friction turns away from the direction of the force. After: r of the extended model. Before: r of the
model without the effect and its rivals. Where nothing else was found, that is the base model; else it
is r - (I - B Bᵀ) X θ, with X the columns of what is taken out and B an orthonormal basis of those that stay. The second
term is the part of the deviation that is expected before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.linear_problem import Problem, pose_problem
from scara_kinetostatic.diagnosis.result import Found
from scara_kinetostatic.effects.base import at_joint
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import Shift, TouchState
from scara_kinetostatic.model.parameters import NAMES

_UNCLEAR = 4.0
"""A touch whose sensitivity |u| to the deviation is so many times smaller than the median one of those on which the
effect acts is left out."""


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
    kept = acts & (weight > (np.median(weight[acts]) if acts.any() else 0.0) / _UNCLEAR)
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
        item.effect.sensor_error_of_touches_derivative(force, values, at.metadata),
    ]
    return [_sum(amplitudes, part) for part in parts]


def _sum(amplitudes: Floats, parts: Sequence[Floats | None]) -> Floats | None:
    terms = [a * part for a, part in zip(amplitudes, parts, strict=False) if part is not None]
    return np.asarray(np.sum(terms, axis=0)) if terms else None


def _variable(problem: Problem, item: Found) -> tuple[str, Floats]:
    """The variable over which an effect is shown: its name with unit, and its values, (n,)."""
    axis = item.effect.plot_axis(problem.touch_state, np.array([v.value for v in item.values]))
    return axis.title + (f'  [{axis.unit}]' if axis.unit else ''), axis.values

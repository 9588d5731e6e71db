"""Fits of the extended model, and the penalised deviance by which fits of the same touches are compared.

Fits may differ in their effects and in the touches that they reject: an effect can make a few touches look bad, such as
a displaced disc of which there are few, or a gain that matters at long reach only. So a rejected touch has a penalty,
too, the squared distance d² beyond which touches are rejected. Over all touches,

    D = Σ_used d² / s² + Σ_declared e² / s² + Σ_rejected d²_rejection + Σ ln det V + penalty of the effects,

and the smaller D is the likelier model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np

from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.outliers import FALSE_REJECTIONS
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.candidates import Candidate
from scara_kinetostatic.diagnosis.effort import Effort
from scara_kinetostatic.diagnosis.linear_problem import Problem
from scara_kinetostatic.diagnosis.thresholds import INDEPENDENT_PART
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import Parameters

_LEAST_SHARE = 0.03
"""Part of the estimated noise with which a fit with effects begins at least."""


def start_from(problem: Problem, members: Sequence[Candidate]) -> tuple[ExtendedModel, float]:
    """The extended model that fits the linear problem best, to start from.

    Args:
        problem: the touches.
        members: the effects.

    Returns:
        The model, and the ratio of the noise with these effects to that without: noise estimated without them contains
        them.
    """
    columns = [problem.columns(member.trial) for member in members]
    together = np.concatenate(columns, axis=1)
    scale = np.linalg.norm(together, axis=0)
    scale[scale == 0] = 1.0
    together = (together - problem.base @ (problem.base.T @ together)) / scale
    found = -np.linalg.lstsq(together, problem.left, rcond=INDEPENDENT_PART)[0] / scale
    freedoms = problem.freedoms, max(problem.freedoms - together.shape[1], 1)
    sizes = problem.left, problem.left + together @ (scale * found)
    before, after = (float(rest @ rest) / number for rest, number in zip(sizes, freedoms, strict=True))
    share = float(np.sqrt(min(after / before, 1.0))) if before > 0 else 1.0
    ends = np.cumsum([part.shape[1] for part in columns])
    values = [
        member.trial.values(found[end - part.shape[1] : end])
        for member, part, end in zip(members, columns, ends, strict=True)
    ]
    moved = problem.without_effects + problem.response @ np.concatenate(columns, axis=1) @ found
    base = Parameters.from_array(problem.point.parameters.as_array() + moved)
    effects = tuple(member.effect for member in members)
    return ExtendedModel(base, effects, tuple(tuple(part) for part in values)), max(share, _LEAST_SHARE)


def fit_with(
    calibration: Calibration, latest: Calibration, problem: Problem, members: Sequence[Candidate], effort: Effort
) -> Calibration:
    """The touches of a calibration fitted with effects.

    Args:
        calibration: the base model; effects that it has stay.
        latest: the fit at which the problem was posed.
        problem: the linear problem in which the effects were found.
        members: the effects.
        effort: of the diagnosis.
    """
    start, share = start_from(problem, members)
    kept = calibration.model
    start = ExtendedModel(
        start.parameters, (*kept.effects, *start.effects), (*kept.effect_values, *start.effect_values)
    )
    share = share if latest.noise_source == 'estimated' else 1.0
    used = np.isin(calibration.touches.index, latest.touches.index[latest.used])  # with other noise others are left out
    warm_start = WarmStart(start, latest.noise.scaled(share), used, latest.errors)
    found = effort.fit(
        calibration.touches, calibration.cell, start.effects, fixed=calibration.fixed, warm_start=warm_start
    )
    return with_rejections_of(found, calibration)


def with_rejections_of(found: Calibration, before: Calibration) -> Calibration:
    """A new fit of the touches of another, with the touches that were rejected before any fit."""
    places = set(before.touches.index.tolist())
    left_out = [item for item in before.rejected if item.index not in places]
    return replace(found, rejected=tuple(sorted((*left_out, *found.rejected), key=lambda item: item.index)))


def penalised_deviance(calibration: Calibration, penalty: float, scale: float) -> float:
    """D above, up to a constant of the touches.

    Args:
        calibration: with or without effects.
        penalty: of its effects.
        scale: s², the variance in units of which squared distances are counted.
    """
    c = calibration
    l11, _, l22 = c.projection.whitened.root
    rejection = -2 * np.log(FALSE_REJECTIONS / len(c.touches))
    distance = np.where(c.used, c.projection.distance / scale, rejection)
    return float(np.sum(distance + 2 * np.log(l11 * l22))) + c.prior_cost / scale + penalty


class FittedEffect(NamedTuple):
    """An effect of an extended model with its estimates.

    Attributes:
        effect: the effect.
        values: of its parameters, (k,).
        std: their standard deviations, (k,).
    """

    effect: Effect
    values: Floats
    std: Floats


def fitted_effects(calibration: Calibration) -> list[FittedEffect]:
    """The effects of a calibration with their estimates."""
    model = calibration.model
    rows = zip(model.effects, model.effect_arrays, calibration.effect_stds, strict=True)
    return [FittedEffect(cast('Effect', effect), values, std) for effect, values, std in rows]

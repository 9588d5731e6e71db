"""The calibration fitted anew with effects in the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.candidates import Candidate
from scara_kinetostatic.diagnosis.linear_problem import Problem
from scara_kinetostatic.diagnosis.thresholds import INDEPENDENT_PART
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import Parameters

Floats = NDArray[np.float64]

LEAST_SHARE = 0.03
"""Part of an estimated noise that a fit with effects begins with at least."""


def start_from(problem: Problem, members: Sequence[Candidate]) -> tuple[ExtendedModel, float]:
    """The model with these effects that fits the linear problem best.

    With it goes the part of the noise that these effects leave over: where it was estimated without them, they are
    in it.
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
    moved = problem.without + problem.response @ np.concatenate(columns, axis=1) @ found
    base = Parameters.from_array(problem.point.parameters.as_array() + moved)
    effects = tuple(member.effect for member in members)
    return ExtendedModel(base, effects, tuple(tuple(part) for part in values)), max(share, LEAST_SHARE)


def fit_with(
    calibration: Calibration, latest: Calibration, problem: Problem, members: Sequence[Candidate]
) -> Calibration:
    """The touches of a calibration fitted with effects.

    Args:
        calibration: that of the twelve parameters; effects that it has stay.
        latest: the fit at which the problem was posed.
        problem: where the effects were found.
        members: the effects.
    """
    start, share = start_from(problem, members)
    kept = calibration.model
    start = ExtendedModel(
        start.parameters, (*kept.effects, *start.effects), (*kept.effect_values, *start.effect_values)
    )
    share = share if latest.noise_source == 'estimated' else 1.0
    warm_start = WarmStart(start, Noise(share * latest.noise.joint, share * latest.noise.force), latest.used)
    found = calibrate(
        calibration.touches, calibration.cell, start.effects, fixed=calibration.fixed, warm_start=warm_start
    )
    return with_left_out(found, calibration)


def with_left_out(found: Calibration, before: Calibration) -> Calibration:
    """A new fit of touches with the rejections of those that never came to a fit."""
    places = set(before.touches.index.tolist())
    left_out = [item for item in before.rejected if item.index not in places]
    return replace(found, rejected=tuple(sorted((*left_out, *found.rejected), key=lambda item: item.index)))


def effect_values(calibration: Calibration) -> list[tuple[Floats, Floats]]:
    """Values and standard deviations of the parameters of each effect of a calibration."""
    return list(zip(calibration.model.effect_arrays, calibration.effect_stds, strict=True))

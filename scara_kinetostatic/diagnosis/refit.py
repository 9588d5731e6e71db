"""The fits of one diagnosis: their solver steps, counted and bounded, and the penalised deviance of each.

**Effort.** Most touches need a few hundred steps. Where several large effects act at once, many sets of effects are
fitted, and many of these fits do not converge. Beyond a number of steps what could still be fitted is left out, and
the diagnosis then says so: its names are no more than suspicions. The bound is of steps, not of time: the same touches
have the same diagnosis on every machine. A step takes the longer the more effects the model has; the unit is one with
two.

**Penalised deviance.** Fits may differ in their effects and in the touches that they reject: an effect can make a few
touches look bad, such as a displaced disc of which there are few, or a gain that matters at long reach only. So a
rejected touch has a penalty, too, the squared distance d² beyond which touches are rejected. Over all touches,

    D = Σ_used d² / s² + Σ_declared e² / s² + Σ_rejected d²_rejection + Σ ln det V + penalty of the effects,

and the smaller D is the likelier model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import FALSE_REJECTIONS, WarmStart
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.candidates import Candidate
from scara_kinetostatic.diagnosis.linear_problem import INDEPENDENT_PART, Problem
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.effect_law import EffectLaw
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.touch import TouchSet


class Effort:
    """The fits of one diagnosis, as many as a bound on their solver steps allows.

    Attributes:
        most: steps before optional fits are left out.
        steps: steps so far, in those of a model with two effects.
        has_left_out: whether something was left out.
    """

    def __init__(self, most: float = 720.0) -> None:
        self.most = most
        self.steps = 0.0
        self.has_left_out = False

    def allows(self) -> bool:
        """Whether something more may be fitted; where not, it counts as left out."""
        self.has_left_out |= self.steps >= self.most
        return self.steps < self.most

    def fit(self, touches: TouchSet, cell: Cell, effects: Sequence[EffectLaw] = (), **options: Any) -> Calibration:
        """`calibrate` with its steps counted; one that raises counts as 20.

        Raises:
            UnsupportedDataError: as `calibrate`, or the fit leaves touches out that do not settle on an edge.
        """
        steps = 20.0
        try:
            found = calibrate(touches, cell, effects, **options)
            steps = found.iterations * (0.5 + 0.25 * len(effects))  # in proportion to the time that they take
            if len(found.touches) < len(touches):
                raise UnsupportedDataError('touches do not settle on an edge', 'touch farther from the corners')
        finally:
            self.steps += steps
        return found


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
    base = problem.point.parameters.with_array(problem.point.parameters.as_array() + moved)
    effects = tuple(member.effect for member in members)
    return ExtendedModel(base, effects, tuple(tuple(part) for part in values)), max(share, 0.03)


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


class Rival(NamedTuple):
    """The touches fitted with one credible set of effects by itself.

    Attributes:
        fit: the model.
        weight: its evidence over that of the best one, exp(-Δ/2) with the difference Δ of the penalised deviances; 1
            where sizes are not estimated.
    """

    fit: Calibration
    weight: float


def fit_again(
    c: Calibration,
    fit: Callable[..., Calibration],
    *,
    model: ExtendedModel | None = None,
    noise: Noise | None = None,
    cell: Cell | None = None,
    **options: Any,
) -> Calibration | None:
    """A calibration fitted anew, close to where it is; None where the touches have no such fit.

    Args:
        c: the calibration.
        fit: `calibrate`, or `Effort.fit`.
        model: to start from, with the effects to fit; that of the calibration by default.
        noise: to start from; likewise.
        cell: another description of the cell; likewise.
        options: `errors` of the warm start, and further arguments of the fit.
    """
    model, errors = model or c.model, options.pop('errors', c.errors)
    warm_start = WarmStart(model, noise or c.noise, c.used, errors)
    try:
        return fit(c.touches, cell or c.cell, model.effects, fixed=c.fixed, warm_start=warm_start, **options)
    except UnsupportedDataError:
        return None


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

"""The form of a law is an assumption: what the twelve become under other forms, just as plausible.

A contact that yields by f^(2/3) and one that yields by f^(1/2) fit a few force levels alike, and differ in what they
leave to p_ee and g_ee. Which of the two it is the touches cannot say, so the standard deviations must hold for both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import Near
from scara_kinetostatic.calibration.solution import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.contest import CREDIBLE
from scara_kinetostatic.diagnosis.evidence import story
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.extension import split
from scara_kinetostatic.model.parameters import NAMES


def fit_other_forms(extended: Calibration) -> list[Calibration]:
    """The touches of an extended model fitted with every other form of each of its effects that fits them as well.

    Args:
        extended: the fit with effects.
    """
    scale = max(1.0, extended.reduced_chi_square)
    most = story(extended, 0.0, scale) + CREDIBLE
    fits = []
    for place, effect in enumerate(extended.cell.effects):
        for other in effect.other_forms() if isinstance(effect, Effect) else ():
            fit = _with_form(extended, place, other)
            if fit is not None and story(fit, 0.0, scale) < most:
                fits.append(fit)
    return fits


def _with_form(extended: Calibration, place: int, other: Effect) -> Calibration | None:
    c = extended
    effects = (*c.cell.effects[:place], other, *c.cell.effects[place + 1 :])
    values = split(c.cell.effects, c.parameters)
    values[place] = np.array(other.start)
    near = Near(c.parameters.replace(extra=tuple(np.concatenate(values))), c.noise, c.used)
    try:
        fit = calibrate(c.touches, replace(c.cell, effects=effects), fixed=c.fixed, near=near)
    except UnsupportedDataError:
        return None
    return fit if fit.termination is Termination.CONVERGED else None


def widened(extended: Calibration, others: Sequence[Calibration]) -> Calibration:
    """The extended model with sigmas of the twelve that hold for other fits as well: their scatter is added."""
    if not others:
        return extended
    count = len(NAMES)
    off = np.array([other.parameters.as_array()[:count] - extended.parameters.as_array()[:count] for other in others])
    covariance = extended.covariance.copy()
    covariance[:count, :count] += off.T @ off / len(off)
    std = np.where(extended.std > 0, np.sqrt(np.diag(covariance)[:count]), extended.std)
    return replace(extended, covariance=covariance, std=std)

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
from scara_kinetostatic.model.law import Law
from scara_kinetostatic.model.parameters import NAMES, Parameters


def fit_other_forms(extended: Calibration) -> list[Calibration]:
    """The touches of an extended model fitted with every other form of each of its effects that fits them as well.

    Args:
        extended: the fit with effects.
    """
    laws, variants = extended.cell.effects, []
    for place, effect in enumerate(laws):
        for other in effect.other_forms() if isinstance(effect, Effect) else ():
            values = split(laws, extended.parameters)
            values[place] = np.array(other.start)
            start = extended.parameters.replace(extra=tuple(np.concatenate(values)))
            variants.append(((*laws[:place], other, *laws[place + 1 :]), start))
    return fit_variants(extended, variants)


def fit_variants(
    extended: Calibration, variants: Sequence[tuple[tuple[Law, ...], Parameters]]
) -> list[Calibration]:
    """The touches of an extended model fitted with other effects, or from elsewhere, where that fits them as well.

    Args:
        extended: the fit with effects.
        variants: effects of the cell, and L̄ with their parameters to start from.
    """
    scale = max(1.0, extended.reduced_chi_square)
    most = story(extended, 0.0, scale) + CREDIBLE
    fits = [_with_variant(extended, *variant) for variant in variants]
    return [fit for fit in fits if fit is not None and story(fit, 0.0, scale) < most]


def _with_variant(extended: Calibration, effects: tuple[Law, ...], start: Parameters) -> Calibration | None:
    c = extended
    near = Near(start, c.noise, c.used)
    try:
        fit = calibrate(c.touches, replace(c.cell, effects=effects), fixed=c.fixed, near=near)
    except UnsupportedDataError:
        return None
    return fit if fit.termination is Termination.CONVERGED else None


def widened(extended: Calibration, others: Sequence[Calibration]) -> Calibration:
    """The extended model with sigmas that hold for other fits as well: their scatter is added.

    To those of the twelve; and to those of the effects where all have the same.
    """
    if not others:
        return extended
    alike = all(other.cell.effects == extended.cell.effects for other in others)
    count = len(extended.covariance) if alike else len(NAMES)
    off = np.array([other.parameters.as_array()[:count] - extended.parameters.as_array()[:count] for other in others])
    covariance = extended.covariance.copy()
    covariance[:count, :count] += off.T @ off / len(off)
    std = np.sqrt(np.diag(covariance))
    known = np.concatenate([extended.std, extended.extra_std])
    std = np.where(known > 0, std, known)
    return replace(extended, covariance=covariance, std=std[: len(NAMES)], extra_std=std[len(NAMES) :])

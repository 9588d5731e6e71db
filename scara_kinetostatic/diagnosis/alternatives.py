"""The form of a law is an assumption: what the twelve become under other forms, just as plausible.

A contact that yields by f^(2/3) and one that yields by f^(1/2) fit a few force levels alike, and differ in what they
leave to p_ee and g_ee. Which of the two it is the touches cannot say, so the standard deviations must hold for both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.evidence import penalised_deviance
from scara_kinetostatic.diagnosis.linear_problem import pose_problem
from scara_kinetostatic.diagnosis.thresholds import CREDIBLE
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.unnamed import Unnamed
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import G1, G2, G_EE, NAMES, P1, P2, P_EE, THETA1, THETA2

ZEROS = {'joint1': THETA1, 'joint2': THETA2, 'along': G_EE}
"""Which of the twelve a constant in a channel of an unnamed curve is."""
STIFF = np.array([P_EE, P1, P2, G_EE, G1, G2])
SIGNIFICANT = 3.0
"""Standard deviations below zero from which on a compliance or a backlash is none."""


def fit_alternative_laws(extended: Calibration) -> list[Calibration]:
    """The touches of an extended model fitted with every other form of each of its effects that fits them as well.

    Args:
        extended: the fit with effects.
    """
    model, variants = extended.model, []
    for place, effect in enumerate(model.effects):
        for other in effect.alternative_laws() if isinstance(effect, Effect) else ():
            effects, values = list(model.effects), list(model.effect_values)
            effects[place], values[place] = other, other.start
            variants.append(ExtendedModel(model.parameters, tuple(effects), tuple(values)))
    return fit_variants(extended, variants)


def fit_variants(extended: Calibration, variants: Sequence[ExtendedModel]) -> list[Calibration]:
    """The touches of an extended model fitted with other effects, or from elsewhere, where that fits them as well.

    Args:
        extended: the fit with effects.
        variants: the models to start from.
    """
    scale = max(1.0, extended.reduced_chi_square)
    most = penalised_deviance(extended, 0.0, scale) + CREDIBLE
    fits = [_with_variant(extended, variant) for variant in variants]
    return [fit for fit in fits if fit is not None and _is_physical(fit) and penalised_deviance(fit, 0.0, scale) < most]


def _with_variant(extended: Calibration, start: ExtendedModel) -> Calibration | None:
    c = extended
    warm_start = WarmStart(start, c.noise, c.used)
    try:
        fit = calibrate(c.touches, c.cell, start.effects, fixed=c.fixed, warm_start=warm_start)
    except UnsupportedDataError:
        return None
    return fit if fit.termination is Termination.CONVERGED else None


def _is_physical(fit: Calibration) -> bool:
    """Whether no compliance and no backlash is significantly negative: no robot is like that."""
    values, std = fit.parameters.as_array()[STIFF], fit.std[STIFF]
    return not np.any(values < -SIGNIFICANT * std)


def widened_for_each(extended: Calibration, others: Sequence[Calibration]) -> Calibration:
    """The extended model with sigmas within one of which each other fit lies, the farthest first."""
    count = len(NAMES)

    def far(other: Calibration) -> float:
        off = other.parameters.as_array() - extended.parameters.as_array()
        return float(np.nanmax(np.abs(off) / np.where(extended.std > 0, extended.std, np.inf), initial=0.0))

    wide = extended
    for other in sorted(others, key=far, reverse=True):
        off = np.abs(other.model.as_array() - extended.model.as_array())
        alike = other.model.effects == extended.model.effects
        std = np.concatenate([wide.std, wide.effect_std])
        beyond = off > np.where(std > 0, std, np.inf)
        if beyond[: len(std) if alike else count].any():
            wide = widened(wide, [other])
    return wide


def widened(extended: Calibration, others: Sequence[Calibration]) -> Calibration:
    """The extended model with sigmas that hold for other fits as well: their scatter is added.

    To those of the twelve; and to those of the effects where all have the same.
    """
    if not others:
        return extended
    alike = all(other.model.effects == extended.model.effects for other in others)
    count = len(extended.covariance) if alike else len(NAMES)
    off = np.array([other.model.as_array()[:count] - extended.model.as_array()[:count] for other in others])
    covariance = extended.covariance.copy()
    covariance[:count, :count] += off.T @ off / len(off)
    std = np.sqrt(np.diag(covariance))
    known = np.concatenate([extended.std, extended.effect_std])
    std = np.where(known > 0, std, known)
    return replace(extended, covariance=covariance, std=std[: len(NAMES)], effect_std=std[len(NAMES) :])


def with_free_zeros(extended: Calibration, fits: Sequence[Calibration]) -> Calibration:
    """The extended model with sigmas that allow for the zero of curves without a name.

    A curve over anything may be raised by a constant: an unknown deviation of a joint moves its offset, one along the
    force the backlash of the gripper. How large that constant is nobody knows; the curve itself tells the scale.

    Args:
        extended: the fit with effects.
        fits: it and those of rivals.
    """
    covariance = extended.covariance.copy()
    for name, place in ZEROS.items():
        known = extended.std[place] > 0
        size = max((rms for fit in fits for rms in _curve_sizes(fit, name)), default=0.0)
        covariance[place, place] += size**2 if known else 0.0
    std = np.where(extended.std > 0, np.sqrt(np.diag(covariance)[: len(NAMES)]), extended.std)
    return replace(extended, covariance=covariance, std=std)


def _curve_sizes(fit: Calibration, channel: str) -> list[float]:
    """Root mean square over the touches of each curve without a name that acts in a channel, on all discs."""
    pairs = list(zip(fit.model.effects, fit.model.effect_arrays, strict=True))
    curves = [(e, v) for e, v in pairs if isinstance(e, Unnamed) and e.channel == channel and e.disc < 0]
    if not curves:
        return []
    at = pose_problem(fit).touch_state
    return [float(np.sqrt(np.mean((np.stack(e.functions(at), axis=-1) @ v) ** 2))) for e, v in curves]

"""Three ways to explain the same touches; the likeliest is told.

Residuals that are too large may come from an effect that acts alike in all touches (`search`), from friction that
lets each force lean by an angle of its own (`leaning`), or from bad touches, some of which an effect
may have made look bad. Each way is followed to its end and judged by one sum, see `evidence.story`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import USUAL_NOISE
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.advice import implausible_noise
from scara_kinetostatic.diagnosis.contact_angle import fit_with_off_normal, growing_p_value, off_normal_p_value
from scara_kinetostatic.diagnosis.evidence import penalised_deviance
from scara_kinetostatic.diagnosis.search import Search, search
from scara_kinetostatic.diagnosis.thresholds import CREDIBLE, FRICTION_SIGNIFICANCE
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.off_normal_force import OffNormalForce
from scara_kinetostatic.effects.unnamed import Unnamed
from scara_kinetostatic.errors import UnsupportedDataError

SUSPICIOUS = 1
"""Rejected touches from which on they are asked whether an effect explains them."""


class Selection(NamedTuple):
    """The likeliest story.

    Attributes:
        found: what was found; None if nothing is missing.
        lead: by how much its sum is below that of the twelve parameters alone.
    """

    found: Search | None
    lead: float


def select_hypothesis(calibration: Calibration, known: Sequence[Effect], alarm: bool, off_normal: bool) -> Selection:
    """Find what the twelve parameters lack, if they lack anything.

    Args:
        calibration: of the twelve parameters.
        known: the catalogue.
        alarm: whether something is wrong for sure.
        leans: whether forces lean by more than their noise.
    """
    c = calibration
    ways: list[Search] = []
    if alarm:
        ways.append(search(c, known))
    taken_back = any(way.extended and way.extended.used.all() for way in ways)
    if (~c.used).sum() >= SUSPICIOUS and not taken_back:
        ways.append(search(c, known, replace(c, used=np.ones(len(c.touches), dtype=bool))))
    if alarm and c.noise_source == 'estimated' and not any(way.extended for way in ways):
        ways += _with_usual_noise(c, known)
    if off_normal and not any(way.extended and _is_radial(way.extended) for way in ways):
        ways += _with_off_normal_forces(c, known)
    converged = [way for way in ways if way.extended is not None]
    if not converged:
        return Selection(ways[0] if alarm else None, 0.0)
    fits = [c, *(way.extended for way in converged if way.extended)]
    scale = max(1.0, min(fit.reduced_chi_square for fit in fits))
    sums = [penalised_deviance(way.extended, way.penalty, scale) for way in converged if way.extended]
    lead = penalised_deviance(c, 0.0, scale) - min(sums)
    if lead < CREDIBLE:
        return Selection(ways[0]._replace(extended=None, in_every_model=(), rivals=()) if alarm else None, 0.0)
    return Selection(converged[int(np.argmin(sums))], lead)


def _with_usual_noise(calibration: Calibration, known: Sequence[Effect]) -> list[Search]:
    """The way of an error so large that it passed for noise: it is looked for as if the noise were the usual one."""
    c = calibration
    try:
        begin = calibrate(c.touches, replace(c.cell, noise=USUAL_NOISE), fixed=c.fixed)
    except UnsupportedDataError:
        return []
    return [search(c, known, begin)]


def _with_off_normal_forces(calibration: Calibration, known: Sequence[Effect]) -> list[Search]:
    """The way of friction: each force leans by an angle of its own, and other effects beside."""
    others = [effect for effect in known if effect.name != OffNormalForce.name]
    try:
        off_normal_fit = fit_with_off_normal(calibration)
        found = search(off_normal_fit, others)
        extended = found.extended
        if extended is not None and len(extended.model.effects) > 1:
            extended = fit_with_off_normal(extended)
    except UnsupportedDataError:
        return []
    if extended is None or extended.termination is not Termination.CONVERGED:
        return []
    if not _is_surely_off_normal(extended):
        return []
    penalty = float(np.log(len(calibration.touches)) + 2 * np.log(len(known)))
    return [
        found._replace(
            extended=extended,
            penalty=found.penalty + penalty,
            in_every_model=(OffNormalForce.name, *found.in_every_model),
        )
    ]


def _is_radial(extended: Calibration) -> bool:
    """Whether an extended model fits without a curve that has no name, and no force leans in it."""
    c = extended
    if any(isinstance(effect, Unnamed) for effect in c.model.effects):
        return False
    if c.noise_source == 'estimated':
        fits = not implausible_noise(c)
    else:
        fits = bool(chdtrc(c.degrees_of_freedom, c.chi_square) > FRICTION_SIGNIFICANCE)
    return fits and off_normal_p_value(c) > FRICTION_SIGNIFICANCE


def _is_surely_off_normal(extended: Calibration) -> bool:
    """Whether, beside the other effects of an extended model, the lean is no noise that grows with the force.

    The test is made at the extended model: a fit without the lean may be far off, as all touches then pull at it.
    Where noise that grows shows beside the lean, too, the lean has to be the clearer by far.
    """
    others = tuple(effect for effect in extended.model.effects if not isinstance(effect, OffNormalForce))
    without = replace(extended, model=extended.model.with_effects(others))
    off_normal, growing = off_normal_p_value(without, beside_growing=True), growing_p_value(extended)
    return off_normal < FRICTION_SIGNIFICANCE * (growing if growing < FRICTION_SIGNIFICANCE else 1.0)

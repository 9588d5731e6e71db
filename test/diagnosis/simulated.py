"""Touches of a simulated robot with effects that are unknown to its calibration."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from calibration.studies import CELL, NOISE

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

UNKNOWN_NOISE = replace(CELL, noise=None)
PLAN = default_plan(CELL, per_disc=12, preload=0.3)
"""72 touches, every other one preloaded beyond its force."""
MORE = default_plan(CELL, per_disc=18, preload=0.3)
"""108 of them."""


def effect(label: str) -> Effect:
    return find(CELL, label)


def simulate(
    *effects: tuple[Effect, tuple[float, ...]], truth: Parameters = PAPER_ACTUAL, seed: int = 1, plan: Plan = PLAN
) -> TouchSet:
    """Touches of a robot with effects, each with its values."""
    laws, values = tuple(law for law, _ in effects), tuple(part for _, part in effects)
    return simulate_touches(CELL, ExtendedModel(truth, laws, values), plan, NOISE, seed)


@cache
def examined(label: str, values: tuple[float, ...], given: bool = True, seed: int = 1) -> tuple[Calibration, Diagnosis]:
    """The base model fitted to a robot with one effect, and the diagnosis."""
    found = calibrate(simulate((effect(label), values), seed=seed), CELL if given else UNKNOWN_NOISE)
    return found, diagnose(found)


def deviations(calibration: Calibration, truth: Parameters = PAPER_ACTUAL) -> np.ndarray:
    """The base parameters less the truth, in standard deviations."""
    return (calibration.parameters.as_array() - truth.as_array()) / calibration.std


def named(found: Diagnosis) -> list[str]:
    """Labels of what is named."""
    return [item.effect.label for item in found.found]


def check_explained(found: Diagnosis, label: str, values: tuple[float, ...], truth: Parameters = PAPER_ACTUAL) -> None:
    """It names this effect alone, and effect and base parameters are right within their uncertainties."""
    assert (found.verdict, named(found)) == ('explained', [label])
    for value, true in zip(found.found[0].values, values, strict=True):
        assert abs(value.value - true) < 4 * value.std
    check_parameters(found, truth)


def check_parameters(found: Diagnosis, truth: Parameters = PAPER_ACTUAL) -> None:
    """The base parameters of the extended model are right within their uncertainties."""
    assert found.extended is not None
    assert np.abs(deviations(found.extended, truth)).max() < 4

"""The verdict on the twelve-parameter model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from scara_kinetostatic.calibration.solution import Calibration
from scara_kinetostatic.diagnosis.structure import Trace, find_traces

LARGEST_JOINT_NOISE = 2e-4
"""Estimated repeatability of a joint beyond which it is an error of the model, rad."""
LARGEST_ERROR_SHARE = 0.2
"""The same for the force error as a part of the force."""
SIGNIFICANCE = 0.01
"""Chance of a false alarm that is accepted."""


@dataclass(frozen=True)
class Diagnosis:
    """Whether the model is enough, and what is behind it if not.

    Attributes:
        verdict: ``none`` (nothing is missing), ``explained``, ``ambiguous`` or ``unexplained``.
        p_value: of "the twelve-parameter model is enough", all tests taken together.
        effects: what was found and added to the model.
        rivals: effects that the data cannot tell apart.
        traces: what the residual depends on, significant ones only.
        advice: what to do next, in words; empty if nothing.
    """

    verdict: str
    p_value: float
    effects: tuple[dict[str, Any], ...] = ()
    rivals: tuple[tuple[str, ...], ...] = ()
    traces: tuple[Trace, ...] = ()
    advice: str = ''


def diagnose(calibration: Calibration) -> Diagnosis:
    """Test whether anything is left in the residual.

    The p-value is Bonferroni's over all tests: the F-tests of `find_traces`, and, where the
    noise was given, chi-square of the residual against it. It assumes Gaussian noise and
    independent touches.
    """
    c = calibration
    traces = find_traces(c)
    size = float(stats.chi2.sf(c.chi_square, c.degrees_of_freedom)) if c.noise_source == 'given' else 1.0
    tests = len(traces) + (c.noise_source == 'given')
    smallest = min([size, *(trace.p_value for trace in traces)])
    p_value = min(1.0, smallest * max(tests, 1))
    found = tuple(trace for trace in traces if trace.p_value * tests < SIGNIFICANCE)
    incredible = _incredible(c)
    if incredible:
        return Diagnosis('unexplained', p_value, traces=found, advice=incredible)
    if p_value >= SIGNIFICANCE:
        return Diagnosis('none', p_value, advice=_too_quiet(c))
    return Diagnosis('unexplained', p_value, traces=found, advice=_advice(c, found))


def _incredible(c: Calibration) -> str:
    """Why estimated noise cannot be noise; empty if it can. A gross error of the model passes for noise otherwise."""
    if c.noise_source == 'given':
        return ''
    share = c.force_error / float(np.hypot(c.force[:, 0], c.force[:, 1]).mean())
    if c.noise.joint <= LARGEST_JOINT_NOISE and share <= LARGEST_ERROR_SHARE:
        return ''
    return (
        f'the touches miss the model by {c.force_error:.2g} N, {100 * share:.0f} % of the force, as if the joints '
        f'repeated to {c.noise.joint:.1e} rad only: no noise is like that; check the places and radii of '
        'the discs, the fixed parameters, and whether a joint lost its zero'
    )


def _advice(c: Calibration, found: tuple[Trace, ...]) -> str:
    if not found:
        return (
            f'the residuals are {c.reduced_chi_square**0.5:.2g} times as large as the stated noise, without a pattern: '
            'the noise is stated too small, or touches repeat worse than assumed; '
            'leave the noise out of the cell file to have it estimated'
        )
    names = '; '.join(trace.name for trace in found[:3])
    return (
        f'the residual depends on {names}: the robot does something that the twelve parameters do not describe, '
        'and they are bent by it; do not trust them to their standard deviations'
    )


def _too_quiet(c: Calibration) -> str:
    if c.noise_source == 'given' and stats.chi2.cdf(c.chi_square, c.degrees_of_freedom) < 1e-3:
        return (
            f'the residuals are {c.reduced_chi_square**0.5:.2g} times the stated noise: it is stated too large, '
            'and so are the standard deviations; leave the noise out of the cell file to have it estimated'
        )
    return ''

"""Trusted nominal values (`Cell.uncertainty.nominal`) against what the touches say of them.

A trusted value L_n is a row of the fit, of standard uncertainty u. Without this row the touches give L̂' with σ, and

    t = (L̂' - L_n) / sqrt(u² + σ²)

is standard normal if the value is right. It follows from the fit with the row by downdating: with the row's residual
r = (L̂ - L_n)/u and its leverage h = C/u², C the variance of L̂, t = r/sqrt(1 - h). Where the noise is estimated, it is
that of a fit without any of these rows: a wrong one makes the noise larger until it is believed.

Source: Belsley, Kuh and Welsch, Regression Diagnostics (1980), section 2.1 (studentised residuals).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import NAMES

_LEAST_CHECKED = 1e-9
"""Least part 1 - h of a trusted value that the touches check: below it they say nothing of it."""


class Contradiction(NamedTuple):
    """The test of one trusted nominal value.

    Attributes:
        name: of the parameter.
        off: the trusted value less that of the touches, in its unit.
        std: its declared standard uncertainty.
        deviation: |t|.
        p_value: of "it is right", Bonferroni-corrected over all that are trusted.
    """

    name: str
    off: float
    std: float
    deviation: float
    p_value: float


def contradictions(c: Calibration) -> tuple[Contradiction, ...]:
    """The tests of all trusted nominal values that the touches check, the worst first."""
    names = [name for name in NAMES if name in c.cell.uncertainty.nominal and name not in c.fixed]
    if not names:
        return ()
    fit, freedoms = _with_noise_of_free(c)
    tests = [test for name in names if (test := _test(fit, name, freedoms, len(names))) is not None]
    return tuple(sorted(tests, key=lambda test: (test.p_value, -test.deviation)))


def _test(fit: Calibration, name: str, freedoms: float, count: int) -> Contradiction | None:
    place, u = NAMES.index(name), fit.cell.uncertainty.nominal[name]
    variance = float(fit.covariance_with_errors[place, place]) / fit.enlargement
    checked = 1 - variance / u**2
    if checked < _LEAST_CHECKED:
        return None
    off = getattr(fit.cell.nominal, name) - getattr(fit.parameters, name)
    deviation = abs(off) / u / np.sqrt(checked)
    p_value = 2 * float(special.ndtr(-deviation) if np.isinf(freedoms) else special.stdtr(freedoms, -deviation))
    return Contradiction(name, off / checked, u, float(deviation), min(1.0, count * p_value))


def _with_noise_of_free(c: Calibration) -> tuple[Calibration, float]:
    """The fit with noise that no trusted value has made larger, and the degrees of freedom of this noise."""
    if c.noise_source == 'given':
        return c, np.inf
    free = _refitted(c, _trusting(c.cell, {}))
    fit = None if free is None else _refitted(c, replace(c.cell, noise=free.noise))
    if free is None or fit is None:
        return c, max(c.degrees_of_freedom, 1)
    return fit, max(free.degrees_of_freedom, 1)


def without_trust(c: Calibration, name: str) -> Calibration | None:
    """The same fit without one trusted nominal value; None where it has none."""
    kept = {other: std for other, std in c.cell.uncertainty.nominal.items() if other != name}
    return _refitted(c, _trusting(c.cell, kept))


def _trusting(cell: Cell, nominal: dict[str, float]) -> Cell:
    return replace(cell, uncertainty=replace(cell.uncertainty, nominal=nominal))


def _refitted(c: Calibration, cell: Cell) -> Calibration | None:
    """The same fit in another description of the cell; from the start where a warm start does not converge."""
    effects = c.model.effects
    warm = WarmStart(c.model, cell.noise or c.noise, c.used, c.errors)
    for warm_start in (warm, None):
        try:
            fit = calibrate(c.touches, cell, effects, fixed=c.fixed, warm_start=warm_start)
        except UnsupportedDataError:
            continue
        if fit.termination is Termination.CONVERGED and len(fit.errors) == len(c.errors):
            return fit
    return None


def shares(c: Calibration) -> int:
    """Among how many kinds of tests of what is declared their half of the false alarms is divided."""
    return int(len(c.errors) > 0) + int(c.trusted > 0)

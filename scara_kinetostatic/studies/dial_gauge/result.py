"""Result of the point-by-point experiments, run by run and part by part, and the warnings that go with it.

Compliance or gap over the direction: a test of isotropy, and the ellipse with its principal values.

The compliance along u of the general gripper (7) is uᵀPu; the gap of an elliptical dead zone is √(uᵀWu). Both are even
functions of the direction with two orthogonal principal axes,

    q(φ) = major cos²(φ - axis) + minor sin²(φ - axis),     q the compliance, or the square of the gap.

A gauge along u measures the symmetric part of P only; displacements across u (p12 - p21) are not measured.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import stats

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.dial_gauge.readings import GRIPPER, DialGaugeReadings
from scara_kinetostatic.studies.dial_gauge.run_fit import Check, RunFit
from scara_kinetostatic.studies.dial_gauge.statistics import CombinedEstimate, Estimate, combine_estimates

_FEWEST_AXES = 3
"""Axes needed for the three coefficients of an ellipse."""
_CLEAR = 4.0
"""Smallest gap, in standard deviations, whose square is used."""


class Ellipse(NamedTuple):
    """Principal values over the direction.

    Attributes:
        major: the largest.
        minor: the smallest.
        axis: direction of the largest, rad, in [0, π); its std is infinite where both are equal.
        chi_square: of the values about the ellipse.
        degrees_of_freedom: number of values less three.
        p_value: of the ellipse as a sufficient description; NaN without degrees of freedom.
        coefficients: m, a, b of q = m + a cos 2φ + b sin 2φ.
        covariance: of the coefficients, (3, 3).
        power: 1 if q is the value, 2 if it is the square.
    """

    major: Estimate
    minor: Estimate
    axis: Estimate
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    coefficients: Floats
    covariance: Floats
    power: int

    def at(self, direction: float) -> Estimate:
        """The value along a direction, rad."""
        row = np.array([1.0, np.cos(2 * direction), np.sin(2 * direction)])
        q, std = float(row @ self.coefficients), float(np.sqrt(row @ self.covariance @ row))
        return Estimate(q, std) if self.power == 1 else Estimate(float(np.sqrt(max(q, 0.0))), _root_std(q, std))


class DirectionMap(NamedTuple):
    """One quantity over the direction.

    Attributes:
        direction: rad, (n,).
        value: (n,).
        std: (n,).
        mean: unweighted mean over the directions, as in the paper.
        isotropy: test of equal values in all directions.
        ellipse: None for fewer than three axes, or where a gap is not significantly above 0.
    """

    direction: Floats
    value: Floats
    std: Floats
    mean: Estimate
    isotropy: CombinedEstimate
    ellipse: Ellipse | None


def direction_map(direction: Floats, value: Floats, std: Floats, dof: Floats, power: int) -> DirectionMap:
    """The map of one quantity.

    Args:
        direction: rad, (n,), n of 2 or more.
        value: (n,).
        std: (n,).
        dof: degrees of freedom of each std, (n,).
        power: 1 for a compliance, 2 for a gap.
    """
    mean = Estimate(float(value.mean()), float(np.sqrt((std**2).sum())) / len(value))
    ellipse = _fit_ellipse(direction, value, std, dof, power)
    return DirectionMap(direction, value, std, mean, combine_estimates(value, std, dof), ellipse)


def _fit_ellipse(direction: Floats, value: Floats, std: Floats, dof: Floats, power: int) -> Ellipse | None:
    """Principal values by weighted least squares; see `direction_map`, `Ellipse`."""
    axes = len(np.unique(np.round(np.mod(direction, np.pi), 3) % np.round(np.pi, 3)))
    if axes < _FEWEST_AXES or (power == 2 and np.any(value < _CLEAR * std)):
        return None
    q = value**power
    if power == 2:
        q = q - std**2  # the square of a noisy value is too large by its variance
    design = np.stack([np.ones_like(direction), np.cos(2 * direction), np.sin(2 * direction)], axis=1)
    q_std = std if power == 1 else 2 * value * std
    for _ in range(3):  # weights from the fitted values, which are less noisy than the measured ones
        coefficients, covariance = _weighted(design, q, q_std)
        fitted = design @ coefficients
        if power == 2:
            q_std = 2 * np.sqrt(np.maximum(fitted, (0.1 * value) ** 2)) * std
    chi_square = float((((q - fitted) / q_std) ** 2).sum())
    left = len(value) - 3
    p_value = float(stats.f.sf(chi_square / left, left, float(np.sum(dof)))) if left > 0 else np.nan
    ends = _principal(coefficients, covariance, power)
    return Ellipse(*ends, chi_square, left, p_value, coefficients, covariance, power)


def _weighted(design: Floats, q: Floats, std: Floats) -> tuple[Floats, Floats]:
    basis, triangle = np.linalg.qr(design / std[:, None])
    inverse = np.linalg.inv(triangle)
    return inverse @ (basis.T @ (q / std)), inverse @ inverse.T


def _principal(coefficients: Floats, covariance: Floats, power: int) -> tuple[Estimate, Estimate, Estimate]:
    mean, a, b = coefficients
    radius = float(np.hypot(a, b))
    unit = np.array([a, b]) / radius if radius > 0 else np.array([1.0, 0.0])
    ends = []
    for sign in (1.0, -1.0):
        row = np.array([1.0, *(sign * unit)])
        q, std = mean + sign * radius, float(np.sqrt(row @ covariance @ row))
        ends.append(Estimate(float(q), std) if power == 1 else Estimate(float(np.sqrt(max(q, 0.0))), _root_std(q, std)))
    across = np.array([0.0, -unit[1], unit[0]])
    turn = float(np.sqrt(across @ covariance @ across)) / (2 * radius) if radius > 0 else np.inf
    return ends[0], ends[1], Estimate(float(np.mod(np.arctan2(b, a) / 2, np.pi)), turn)


def _root_std(q: float, std: float) -> float:
    return std / (2 * float(np.sqrt(q))) if q > std else float(np.sqrt(std))


class Run(NamedTuple):
    """Result of one run.

    Attributes:
        part: one of `PARTS`.
        gauge_at: where the gauge was.
        source: name of its file.
        direction: rad, NaN if none is given.
        lever: m, NaN for the gripper.
        readings: its rows.
        fit: slope and gap at the gauge, m/N and m.
        compliance: of the part, m/N or rad/Nm.
        gap: of the part, m or rad.
        failed_checks: tests that fail.
        outliers: rows far from their line.
        note: remark on the gripper's contribution.
    """

    part: str
    gauge_at: str
    source: str
    direction: float
    lever: float
    readings: DialGaugeReadings
    fit: RunFit
    compliance: Estimate
    gap: Estimate
    failed_checks: tuple[Check, ...] = ()
    outliers: tuple[int, ...] = ()
    note: str = ''

    @property
    def name(self) -> str:
        """Its name in messages."""
        return part_label(self.part, self.direction)

    @property
    def half_gap(self) -> Estimate:
        """The g of (6) and (7)."""
        return Estimate(self.gap.value / 2, self.gap.std / 2)


class Part(NamedTuple):
    """Result of one part, from all its runs.

    Attributes:
        name: one of `PARTS`.
        runs: in the order of the readings.
        compliance: m/N or rad/Nm; over the directions their mean.
        gap: m or rad; over the directions their mean.
        compliance_map: over the direction, for a gripper with two directions or more.
        gap_map: likewise.
    """

    name: str
    runs: tuple[Run, ...]
    compliance: Estimate
    gap: Estimate
    compliance_map: DirectionMap | None
    gap_map: DirectionMap | None

    @property
    def half_gap(self) -> Estimate:
        """The g of (6) and (7)."""
        return Estimate(self.gap.value / 2, self.gap.std / 2)

    @property
    def units(self) -> tuple[str, str]:
        """Units of compliance and gap."""
        return ('m/N', 'm') if self.name == GRIPPER else ('rad/Nm', 'rad')


class PointAnalysis(NamedTuple):
    """Result of all point-by-point experiments.

    Attributes:
        parts: those measured, in the order of `PARTS`.
        warnings: one sentence each.
        sources: names of the files.
    """

    parts: tuple[Part, ...]
    warnings: tuple[str, ...]
    sources: tuple[str, ...]

    def part(self, name: str) -> Part:
        """One of the parts.

        Raises:
            ParameterError: it was not measured.
        """
        for part in self.parts:
            if part.name == name:
                return part
        raise ParameterError(name, 'was not measured', f'there is {", ".join(part.name for part in self.parts)}')


def part_label(part: str, direction: float) -> str:
    """Name of a part in messages, with the direction (rad, NaN for none) in which it was loaded."""
    return part if np.isnan(direction) else f'{part} at {np.degrees(direction):g} deg'


_PLAUSIBLE = (1e-8, 1e-2)
"""Range of compliances of robots, m/N; outside it a unit is probably wrong."""
_MEANING = {
    'slope_difference': 'the slopes of the two senses differ by {value:.3g} ± {std:.2g} µm/N',
    'hysteresis': 'the displacement is {value:.3g} ± {std:.2g} µm larger while the load is removed: friction or creep',
    'curvature': 'the lines deviate from straight by {value:.3g} ± {std:.2g} µm: the compliance depends on the load',
    'zero_drift': "the gauge's zero drifts by {value:.3g} ± {std:.2g} µm per cycle; "
    'half of a steady drift is contained in the gap',
    'gap_repeatability': 'the gap varies by {value:.3g} µm (one standard deviation) between cycles; '
    'its uncertainty includes this',
    'slope_repeatability': 'the slope varies by {value:.3g} µm/N (one standard deviation) between cycles; '
    'its uncertainty includes this',
}


def run_warnings(run: Run) -> list[str]:
    """Warnings about one run, one sentence each."""
    found = [
        f'{run.name}: {_MEANING[check.name].format(value=1e6 * check.value, std=1e6 * check.std)}'
        for check in run.failed_checks
    ]
    if run.outliers:
        lines = [str(line) for line in run.readings.line[list(run.outliers)].tolist() if line]
        where = f'line{"s" * (len(lines) > 1)} {", ".join(lines)}' if lines else f'{len(run.outliers)} rows'
        found.append(f'{run.source}: {where}: far from the straight line of {run.name}; check for a typing error')
    if not _PLAUSIBLE[0] < run.fit.compliance.value < _PLAUSIBLE[1]:
        found.append(f'{run.name}: a compliance of {run.fit.compliance.value:.2g} m/N; are the units and signs right?')
    if run.gap.value < -4 * run.gap.std:
        found.append(f'{run.name}: the gap is negative; is the displacement positive along the positive force?')
    return found + [f'{run.name}: {run.note}'] * bool(run.note)


def part_warnings(parts: tuple[Part, ...], level: float) -> list[str]:
    """Warnings about the runs of each part together; `level` is the significance level of each test."""
    found = []
    for part in parts:
        maps = (('compliance', part.compliance_map), ('gap', part.gap_map))
        for what, each in maps:
            if each is not None and each.ellipse is not None and each.ellipse.p_value < level:
                chance = f'p = {each.ellipse.p_value:.2g}'
                found.append(f'{part.name}: the {what} over the direction is not an ellipse ({chance})')
        if len(part.runs) > 1 and part.compliance_map is None:
            found += _disagreements(part, level)
    return found


def _disagreements(part: Part, level: float) -> list[str]:
    """Warnings about inconsistent runs of a part without a direction map."""
    dof = np.array([run.fit.degrees_of_freedom for run in part.runs], dtype=float)
    quantities = {'compliance': [run.compliance for run in part.runs], 'gap': [run.gap for run in part.runs]}
    found = []
    for what, estimates in quantities.items():
        values = np.array(estimates)
        test = combine_estimates(values[:, 0], values[:, 1], dof)
        if test.p_value < level:
            found.append(f'{part.name}: the runs are inconsistent in {what} (p = {test.p_value:.2g})')
    return found

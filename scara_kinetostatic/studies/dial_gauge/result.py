"""Result of the point-by-point experiments, run by run and part by part, and the warnings that go with it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.studies.dial_gauge.directions import DirectionMap
from scara_kinetostatic.studies.dial_gauge.readings import GRIPPER, DialGaugeReadings
from scara_kinetostatic.studies.dial_gauge.run_checks import Check
from scara_kinetostatic.studies.dial_gauge.run_fit import RunFit
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate, combine_estimates


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

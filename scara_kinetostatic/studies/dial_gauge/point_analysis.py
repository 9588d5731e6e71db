"""Compliance and backlash from loads applied point by point, the experiments of section 5.2.

Rows are sorted into runs (one part, one place of the gauge, one direction, one file); each run gives a compliance and a
gap (`run_fit`). For a joint with lever l, torque F l and Δq = ΔS / l:

    p = slope / l²  [rad/Nm],      gap = jump / l  [rad].

A gauge at the end-effector measures joint and gripper in series; both dead zones add. Where the gripper was measured in
the same experiment, its displacement along that direction is subtracted, and its variance added.

**Gap and half gap.** Section 5.2 calls the jump of ΔS at F = 0 the backlash, "whose value is the ΔS gap itself"; g in
(6) and (7) is half of it, since q - q* jumps from +g to -g. By its wording, figure 4(d) lists gaps. (Table 2 has 2.9e-4
rad for g1 and g2, near the gaps 2.64e-4 and 2.68e-4; the paper calls its values "reasonable but arbitrary".) Both are
reported here.
"""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.studies.dial_gauge.readings import GRIPPER, PARTS, TIP, DialGaugeReadings
from scara_kinetostatic.studies.dial_gauge.result import (
    Part,
    PointAnalysis,
    Run,
    direction_map,
    part_label,
    part_warnings,
    run_warnings,
)
from scara_kinetostatic.studies.dial_gauge.run_fit import ZERO_BAND, fit_run
from scara_kinetostatic.studies.dial_gauge.statistics import FALSE_ALARM_LEVEL, Estimate, combine_estimates

_SAME_AXIS = np.radians(0.5)
"""Directions closer than this are the same, rad."""


def analyse_points(readings: DialGaugeReadings, zero_band: float = ZERO_BAND) -> PointAnalysis:
    """Compliance and backlash of every part in the readings.

    Args:
        readings: of one or more experiments.
        zero_band: share of the largest load of a run up to which a load counts as none.

    Raises:
        ParameterError: the rows of a joint have no lever.
        UnsupportedDataError: a run has no reversal, or too few rows.
    """
    runs = [_run(rows, zero_band) for rows in _split_runs(readings)]
    gripper = _part(GRIPPER, [run for run in runs if run.part == GRIPPER])
    level = FALSE_ALARM_LEVEL / sum(len(run.fit.checks) + 2 for run in runs)
    runs = [_with_failed_checks(_without_gripper(run, gripper), level) for run in runs]
    parts = tuple(part for name in PARTS if (part := _part(name, [run for run in runs if run.part == name])))
    warnings = (*readings.notes, *(text for run in runs for text in run_warnings(run)), *part_warnings(parts, level))
    return PointAnalysis(parts, warnings, readings.sources)


def _split_runs(readings: DialGaugeReadings) -> list[DialGaugeReadings]:
    """The rows of each run, in the order in which the runs begin.

    Raises:
        ParameterError: a row of a joint has no lever.
    """
    joint = readings.part != GRIPPER
    missing = np.flatnonzero(joint & np.isnan(readings.lever))
    if len(missing):
        where = readings.sources[readings.source[missing[0]]]
        line = f': line {readings.line[missing[0]]}' if readings.line[missing[0]] else ''
        raise ParameterError(f'{where}{line}', 'a joint needs its lever', 'add a column lever_m, or give --lever')
    keys = np.stack(
        [
            readings.source,
            np.unique(readings.part, return_inverse=True)[1].reshape(-1),
            readings.gauge_at == TIP,
            np.round(np.nan_to_num(readings.direction, nan=-1e3), 6),
            np.where(joint, np.round(readings.lever, 9), 0.0),
        ],
        axis=1,
    )
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return [readings.select(number.reshape(-1) == run) for run in np.argsort(first)]


def _run(rows: DialGaugeReadings, zero_band: float) -> Run:
    part, source = str(rows.part[0]), rows.sources[int(rows.source[0])]
    lever = float(rows.lever[0]) if part != GRIPPER else np.nan
    direction = float(rows.direction[0])
    try:
        fit = fit_run(rows, zero_band)
    except UnsupportedDataError as error:
        raise UnsupportedDataError(f'{source}: {part_label(part, direction)}: {error.problem}', error.remedy) from error
    run = Run(part, str(rows.gauge_at[0]), source, direction, lever, rows, fit, fit.compliance, fit.gap)
    return _scaled(run, fit.compliance, fit.gap)


def _scaled(run: Run, compliance: Estimate, gap: Estimate) -> Run:
    """The run with compliance and gap of the part, from those at the gauge."""
    arm = 1.0 if run.part == GRIPPER else run.lever
    return run._replace(
        compliance=Estimate(compliance.value / arm**2, compliance.std / arm**2),
        gap=Estimate(gap.value / arm, gap.std / arm),
    )


def _without_gripper(run: Run, gripper: Part | None) -> Run:
    """A joint's run less the gripper's contribution, if the gauge was at the tip."""
    if run.part == GRIPPER or run.gauge_at != TIP:
        return run
    found = _gripper_along(run.direction, gripper)
    if found is None:
        return run._replace(note='the gauge was at the tip: compliance and gap include those of the gripper')
    joint = [
        Estimate(series.value - gripper_own.value, float(np.hypot(series.std, gripper_own.std)))
        for series, gripper_own in zip((run.fit.compliance, run.fit.gap), found, strict=True)
    ]
    return _scaled(run, *joint)._replace(note='the gripper along this direction was subtracted')


def _gripper_along(direction: float, gripper: Part | None) -> tuple[Estimate, Estimate] | None:
    """Compliance and gap of the gripper along a direction: measured there, or from the ellipse; None if unknown."""
    if gripper is None or np.isnan(direction):
        return None
    turns = [abs((run.direction - direction + np.pi / 2) % np.pi - np.pi / 2) < _SAME_AXIS for run in gripper.runs]
    there = [run for run, same in zip(gripper.runs, turns, strict=True) if same]
    if there:
        return _mean([run.compliance for run in there]), _mean([run.gap for run in there])
    maps = gripper.compliance_map, gripper.gap_map
    ellipses = [each.ellipse for each in maps if each is not None and each.ellipse is not None]
    if len(ellipses) < 2 or any(ellipse.p_value < FALSE_ALARM_LEVEL for ellipse in ellipses):
        return None
    return ellipses[0].at(direction), ellipses[1].at(direction)


def _mean(estimates: list[Estimate]) -> Estimate:
    values, std = np.array(estimates).T
    return Estimate(float(values.mean()), float(np.sqrt((std**2).sum())) / len(values))


def _part(name: str, runs: list[Run]) -> Part | None:
    if not runs:
        return None
    compliance, gap = np.array([run.compliance for run in runs]), np.array([run.gap for run in runs])
    dof = np.array([run.fit.degrees_of_freedom for run in runs], dtype=float)
    if len(runs) == 1:
        return Part(name, tuple(runs), Estimate(*compliance[0]), Estimate(*gap[0]), None, None)
    direction = np.array([run.direction for run in runs])
    if name == GRIPPER and np.all(np.isfinite(direction)) and len(np.unique(direction)) > 1:
        maps = (
            direction_map(direction, compliance[:, 0], compliance[:, 1], dof, power=1),
            direction_map(direction, gap[:, 0], gap[:, 1], dof, power=2),
        )
        return Part(name, tuple(runs), maps[0].mean, maps[1].mean, *maps)
    first, second = (combine_estimates(each[:, 0], each[:, 1], dof, FALSE_ALARM_LEVEL) for each in (compliance, gap))
    return Part(name, tuple(runs), Estimate(first.mean, first.std), Estimate(second.mean, second.std), None, None)


def _with_failed_checks(run: Run, level: float) -> Run:
    """The run with its failed checks and outliers; `level` is the share of each test in `FALSE_ALARM_LEVEL`."""
    return run._replace(
        failed_checks=tuple(check for check in run.fit.checks if check.p_value < level),
        outliers=tuple(np.flatnonzero(run.fit.row_p < level / run.fit.used.sum()).tolist()),
    )

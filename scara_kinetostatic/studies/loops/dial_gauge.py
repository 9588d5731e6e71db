"""Compliance and backlash from tables of gauge readings, loads point by point; continuous loops are for `hysteresis`.

**Fit of a run.** A pass is one sense of load in one cycle: loads applied, then removed. The model of a run is

    ΔS = a_cs + p_s F + e,      e ~ N(0, σ²),

an intercept for every pass (c: cycle, s: sense), since the gauge may be set anew, and a slope for each sense. The
compliance is the weighted mean of the two slopes; the gap is the mean over the cycles of a_c+ - a_c-, the distance of
the two lines of a cycle at zero force. σ is estimated from the residuals of all passes of the run together.

Rows without load contain no information about the gap: inside the backlash the part may be anywhere. They are shown,
but not used.

The resolution of the gauge limits the uncertainty where the part repeats better: σ is at least resolution / √12, and
where it is below 0.38 times the resolution, the same load gives the same rounding error, so that only rows with
different loads count as independent. The resolution is estimated from the readings.

Each check of the model has its own p-value. Where the cycles scatter more than the readings within them (p < 1 %), the
variance between the cycles is added to that of the result.

- slope_difference: slope of the positive less that of the negative sense;
- hysteresis: displacement while the load is removed less that while it is applied, at the same load;
- curvature: deviation of the lines from their chords, positive where the displacement grows faster than the load;
- zero_drift: drift of the gauge's zero per cycle; if it is steady, half of it is contained in the gap;
- gap_repeatability, slope_repeatability: standard deviation between the cycles beyond that of the readings.

**Parts.** Each run of loads applied point by point, the experiments of section 5.2, gives a compliance and a gap. For
a joint with lever l, torque F l and Δq = ΔS / l:

    p = slope / l²  [rad/Nm],      gap = jump / l  [rad].

A gauge at the end-effector measures joint and gripper in series; both dead zones add. Where the gripper was measured
along the same direction in the same experiment, its displacement is subtracted, and its variance added.

**Gap and half gap.** Section 5.2 calls the jump of ΔS at F = 0 the backlash, "whose value is the ΔS gap itself"; g in
(6) and (7) is half of it, since q - q* jumps from +g to -g. By its wording, figure 4(d) lists gaps. (Sheet 2 has 2.9e-4
rad for g1 and g2, near the gaps 2.64e-4 and 2.68e-4; the paper calls its values "reasonable but arbitrary".) Both are
reported.

**Over the direction.** Compliance and gap of a gripper along several directions are tested for isotropy. A gauge along
u measures uᵀPu alone, of the general gripper (7).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from scara_kinetostatic.errors import ParameterError, RecordingError, UnsupportedDataError
from scara_kinetostatic.files import tables
from scara_kinetostatic.files.tables import Field, Sheet, one_of
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, read_only
from scara_kinetostatic.model.parameters import IN_MICRO
from scara_kinetostatic.studies.loops.record import LARGEST, LEVEL
from scara_kinetostatic.studies.loops.selection import UncertainValue

GRIPPER, JOINT1, JOINT2 = 'gripper', 'joint1', 'joint2'
PARTS = (GRIPPER, JOINT1, JOINT2)
"""The loaded part: the gripper with both joints locked, or one joint with the other locked."""
TIP, LINK = 'tip', 'link'
"""Where the dial gauge touches: the end-effector, or the end of link 2, where the gripper does not contribute."""


@dataclass(frozen=True)
class Readings:
    """Rows of one run, in the order in which they were taken: one part, one place of the gauge, one direction.

    Attributes:
        force: load along the direction, of either sign, (n,), N.
        displacement: of the point that the gauge touches, positive along the positive force, (n,), m.
        cycle: number of the load cycle, (n,); NaN where none is given.
        line: of the file, (n,), from 1.
        part: one of `PARTS`.
        gauge_at: `TIP` or `LINK`; if empty the `TIP` for a gripper, the `LINK` for a joint.
        direction: of the positive load, rad; NaN if none is given.
        lever: arm of the load about the joint, m; NaN for the gripper.
        source: name of the file.
    """

    force: Floats
    displacement: Floats
    cycle: Floats = field(default_factory=lambda: np.array(math.nan))
    line: Indices = field(default_factory=lambda: np.array(0))
    part: str = GRIPPER
    gauge_at: str = ''
    direction: float = math.nan
    lever: float = math.nan
    source: str = 'readings'

    def __post_init__(self) -> None:
        for name in ('force', 'displacement', 'cycle', 'line'):
            array = np.array(np.broadcast_to(getattr(self, name), np.shape(self.force)))
            object.__setattr__(self, name, read_only(array))
        if not self.gauge_at:
            object.__setattr__(self, 'gauge_at', TIP if self.part == GRIPPER else LINK)

    def __len__(self) -> int:
        return len(self.force)

    @property
    def name(self) -> str:
        """What was loaded, for messages."""
        part = self.part.replace('joint', 'joint ')
        return part if math.isnan(self.direction) else f'{part} at {math.degrees(self.direction):g}°'


class GaugeTable(NamedTuple):
    """What a table holds: its runs in the order in which they begin; remarks."""

    runs: tuple[Readings, ...]
    notes: tuple[str, ...] = ()


COLUMNS = (
    Field('force', ('force', 'load', 'f'), tables.FORCE, True, largest=LARGEST['N']),
    Field(
        'displacement', ('displacement', 'deflection', 'gauge', 'ds', 'δs'), tables.LENGTH, True,
        largest=LARGEST['m'],
    ),
    Field(
        'direction', ('direction', 'angle'), tables.ANGLE, blank=True,
        largest=4 * math.pi + 1e-9, hint='give an angle within two turns',
    ),
    Field('lever', ('lever', 'arm'), tables.LENGTH, blank=True, largest=10.0, positive=True),
    Field('time', ('time', 't'), tables.TIME, blank=True, largest=LARGEST['s']),
    Field('cycle', ('cycle',), blank=True, largest=1e6),
    Field(
        'part', ('part', 'joint'), blank=True,
        parse=one_of({GRIPPER: GRIPPER, 'joint1': JOINT1, 'joint2': JOINT2, '1': JOINT1, '2': JOINT2}),
    ),
    Field('gauge_at', ('gauge_at',), blank=True, parse=one_of({TIP: TIP, LINK: LINK})),
)  # fmt: skip


def load_readings(table: Sheet, **defaults: str | float) -> GaugeTable:
    """The readings in a table.

    Args:
        table: the file.
        defaults: by name of an optional column, the value where it is missing, or a cell of it is empty; SI.

    Raises:
        ParameterError: the rows of a joint have no lever.
        RecordingError: a column or a row of it is wrong, or it is a continuous record.
    """
    places = table.find(COLUMNS)
    values = table.read(places)
    cells: dict[str, list[Any]] = {name: list(several) for name, several in values.items()}
    absent = {**dict.fromkeys(('direction', 'lever', 'time', 'cycle'), math.nan), 'part': GRIPPER, 'gauge_at': ''}
    for name, default in (absent | defaults).items():
        given = cells.get(name, [None] * len(table.rows))
        cells[name] = [default if cell is None or cell != cell else cell for cell in given]  # NaN is an empty one
    notes = tuple(f'{table.source}: {note}' for note in table.unused(places))
    if not np.isnan(cells['time']).any() and np.isnan(cells['cycle'] + cells['direction']).all():
        problem = 'a continuous record: it has a time and neither cycle nor direction'
        raise RecordingError(table.source, problem, 'give it to the verb hysteresis, or leave the time out')
    cells['line'] = [line for line, _ in table.rows]
    rows: dict[tuple[str, ...], list[int]] = {}
    for k, part in enumerate(cells['part']):
        if part == GRIPPER:
            cells['lever'][k] = math.nan
        elif math.isnan(cells['lever'][k]):
            remedy = 'add a column lever_m, or give --lever'
            raise ParameterError(f'{table.source}: line {cells["line"][k]}', 'a joint needs its lever', remedy)
        turn, lever = round(cells['direction'][k], 6), round(cells['lever'][k], 9)
        rows.setdefault((part, cells['gauge_at'][k], str(turn), str(lever)), []).append(k)
    runs = []
    for own in rows.values():
        found: dict[str, Any] = {name: cells[name][own[0]] for name in ('part', 'gauge_at', 'direction', 'lever')}
        found |= {name: np.array(cells[name])[own] for name in ('force', 'displacement', 'cycle', 'line')}
        runs.append(Readings(**found, source=table.source))
    return GaugeTable(tuple(runs), notes)


def mean(estimates: Sequence[UncertainValue]) -> UncertainValue:
    """The unweighted mean of independent estimates."""
    values, std, units = zip(*estimates, strict=True)
    return UncertainValue(float(np.mean(values)), float(np.linalg.norm(std)) / len(values), units[0])


class LeastSquares(NamedTuple):
    """A least-squares fit y = X β + e.

    Attributes:
        beta: coefficients β, (k,).
        basis: orthonormal basis Q of the columns of X, (n, k).
        inverse: R⁻¹ of X = Q R, (k, k).
        residual: (n,).
        sigma: standard deviation of y; at least `floor`.
        floor: smallest standard deviation that the arithmetic or the resolution allows.
        dof: degrees of freedom.
    """

    beta: Floats
    basis: Floats
    inverse: Floats
    residual: Floats
    sigma: float
    floor: float
    dof: int

    def of(self, row: Floats, unit: str) -> UncertainValue:
        """A linear function of the coefficients, `row` (k,), with its standard deviation."""
        return UncertainValue(float(row @ self.beta), self.sigma * float(np.linalg.norm(row @ self.inverse)), unit)


def least_squares(design: Floats, values: Floats, where: str = 'readings') -> LeastSquares:
    """Least squares of values y, (n,), with a design X, (n, k); `where` is for messages.

    Raises:
        UnsupportedDataError: linearly dependent columns.
    """
    scale, dof = np.linalg.norm(design, axis=0), len(values) - design.shape[1]
    basis, triangle = np.linalg.qr(design / scale)
    if np.abs(np.diag(triangle)).min() < 1e-8:
        problem = f'{where}: one sense of the load has a single level'
        raise UnsupportedDataError(problem, 'take two or more loads in each sense')
    inverse, along = np.linalg.inv(triangle) / scale[:, None], basis.T @ values
    residual = values - basis @ along
    floor = 1e-9 * float(np.abs(values).max())  # below it residuals are rounding errors of the arithmetic
    sigma = max(float(np.sqrt(residual @ residual / max(dof, 1))), floor)
    return LeastSquares(inverse @ along, basis, inverse, residual, sigma, floor, dof)


def find_resolution(displacement: Floats) -> float:
    """Resolution of the gauge: the largest of 1, 2, 5 × 10ⁿ m of which all readings are multiples; 0 if below 10 nm."""
    for step in (digit * 10.0**exponent for exponent in range(-3, -9, -1) for digit in (5, 2, 1)):
        if np.all(np.abs(displacement / step - np.round(displacement / step)) < 1e-5):
            return step
    return 0.0


class CombinedEstimate(NamedTuple):
    """Weighted mean of several estimates of one quantity, and a test of their consistency.

    Attributes:
        estimate: weighted mean; where the estimates are inconsistent its std includes the variance between them.
        p_value: of consistency; takes into account that the standard deviations are estimates themselves.
    """

    estimate: UncertainValue
    p_value: float


def combine_estimates(estimates: Sequence[UncertainValue], dof: Floats) -> CombinedEstimate:
    """Weighted mean and test of consistency of several estimates, that of Welch (1951).

    Estimates are inconsistent below a p-value of 1 %; then the variance between them (DerSimonian and Laird, 1986) is
    added to their own.

    Args:
        estimates: n of 2 or more.
        dof: degrees of freedom of each standard deviation, (n,).
    """
    values, std = (np.array([each[k] for each in estimates]) for k in (0, 1))
    count, weight = len(values), 1 / std**2
    centre = float(np.average(values, weights=weight))
    chi_square = float(weight @ (values - centre) ** 2)
    unevenness = float((((1 - weight / weight.sum()) ** 2) / dof).sum())
    ratio = chi_square / (count - 1) / (1 + 2 * (count - 2) / (count**2 - 1) * unevenness)
    p_value = float(stats.f.sf(ratio, count - 1, (count**2 - 1) / (3 * unevenness)))
    surplus = max(chi_square - (count - 1), 0.0)
    between = surplus / float(weight.sum() - (weight @ weight) / weight.sum())
    if p_value < LEVEL:
        weight = 1 / (std**2 + between)
        centre = float(np.average(values, weights=weight))
    return CombinedEstimate(UncertainValue(centre, float(1 / np.sqrt(weight.sum())), estimates[0].unit), p_value)


ZERO_BAND = 0.02
"""Share of the largest load of a run up to which a load counts as none."""


class RunCheck(NamedTuple):
    """One test of a run.

    Attributes:
        name: see the module.
        value: estimate of the deviation.
        std: its standard deviation; NaN for the repeatabilities.
        unit: m or m/N.
        p_value: of no deviation.
    """

    name: str
    value: float
    std: float
    unit: str
    p_value: float


class RunFit(NamedTuple):
    """Result of one run.

    Attributes:
        compliance: slope, m/N.
        gap: jump of ΔS at zero force, m; half of it is g of (6) and (7).
        slopes: of the negative and the positive sense, m/N.
        sigma: standard deviation of a reading, from the residuals, m.
        resolution: of the gauge as estimated from the readings, m; 0 where they show none.
        degrees_of_freedom: of sigma.
        used: rows used, (n,).
        lines: sense, intercept (m), slope (m/N) of each pass, (k, 3).
        cycle_gaps: gap of each cycle, (c,), m.
        residual: (n,), m, NaN where not used.
        checks: tests that the run allows.
        row_p: p-value of each row's residual, (n,), 1 where not used.
    """

    compliance: UncertainValue
    gap: UncertainValue
    slopes: tuple[UncertainValue, UncertainValue]
    sigma: float
    resolution: float
    degrees_of_freedom: int
    used: Mask
    lines: Floats
    cycle_gaps: Floats
    residual: Floats
    checks: tuple[RunCheck, ...]
    row_p: Floats


def find_passes(readings: Readings) -> tuple[Indices, Floats, Floats]:
    """The pass to which each row belongs.

    Args:
        readings: one run, in order.

    Returns:
        Pass of each row, (n,), -1 where there is no load; cycle (k,) and sense (k,) of each pass. Without
        a column of cycles a pass ends where the sense changes, and two passes make a cycle.
    """
    force = readings.force
    loaded = np.flatnonzero(np.abs(force) > ZERO_BAND * np.abs(force).max(initial=0.0))
    sense, cycle = np.sign(force[loaded]), readings.cycle[loaded]
    if np.any(np.isnan(cycle)):
        cycle = np.cumsum(np.diff(sense, prepend=sense[:1]) != 0) // 2
    keys, number = np.unique(np.stack([cycle, -sense], axis=1), axis=0, return_inverse=True)
    passes = np.full(len(force), -1, dtype=np.intp)
    passes[loaded] = number.reshape(-1)
    return passes, keys[:, 0], -keys[:, 1]


def fit_run(readings: Readings) -> RunFit:
    """Slopes and gap of one run.

    Args:
        readings: rows of one run, in order.

    Raises:
        UnsupportedDataError: loads in one sense only, too few rows, or one load only; the run is named.
    """
    passes, cycle, sense = find_passes(readings)
    used, count = passes >= 0, len(sense)
    complete = [number for number in np.unique(cycle) if np.count_nonzero(cycle == number) == 2]
    where = f'{readings.source}: {readings.name}'
    if not complete:
        lacking = 'there is no reversal of the load' if count else 'there is no load'
        raise UnsupportedDataError(f'{where}: {lacking}', 'load and unload in both senses, in the same cycle')
    force, displacement, passes = readings.force[used], readings.displacement[used], passes[used]
    positive = sense[passes] > 0
    design = np.column_stack([passes[:, None] == np.arange(count), force * ~positive, force * positive])
    if len(force) <= count + 2:
        problem = f'{where}: {len(force)} rows under load are too few, this run needs {count + 3} or more'
        raise UnsupportedDataError(problem, 'take more loads in each sense')
    solution, resolution = least_squares(design, displacement, where), find_resolution(readings.displacement)
    sigma = max(solution.sigma, resolution / np.sqrt(12))
    if solution.sigma < 0.38 * resolution:
        least = sigma * float(np.sqrt(len(force) / len(np.unique(np.abs(force)))))
        solution = solution._replace(sigma=least, floor=least)
    # linear functions of the coefficients, which are the intercepts, the negative and the positive slope
    unit = np.eye(count + 2)
    slopes = solution.of(unit[-2], 'm/N'), solution.of(unit[-1], 'm/N')
    weight = np.array([slopes[0].std, slopes[1].std]) ** -2  # the two slopes are independent
    gaps = np.array([[*np.where(cycle == number, sense, 0), 0, 0] for number in complete], dtype=float)
    checks = {each.name: each for each in _checks(solution, force, displacement, passes, sense, gaps)}
    residual, row_p = np.full(len(used), np.nan), np.ones(len(used))
    residual[used], row_p[used] = solution.residual, _row_p_values(solution)
    compliance = solution.of(weight @ unit[-2:] / weight.sum(), 'm/N')
    compliance = compliance.plus(0.0, _between(checks.get('slope_repeatability'), count))
    gap = solution.of(gaps.mean(axis=0), 'm').plus(0.0, _between(checks.get('gap_repeatability'), len(gaps)))
    lines = np.stack([sense, solution.beta[:count], np.where(sense > 0, slopes[1].value, slopes[0].value)], axis=1)
    own = compliance, gap, slopes, sigma, resolution, solution.dof
    return RunFit(*own, used, lines, gaps @ solution.beta, residual, tuple(checks.values()), row_p)


def _between(repeatability: RunCheck | None, count: int) -> float:
    """What the scatter between cycles adds to the std of a mean, where it is more than that of the readings."""
    if repeatability is None or repeatability.p_value >= LEVEL:
        return 0.0
    return repeatability.value / float(np.sqrt(count))


def _checks(
    solution: LeastSquares, force: Floats, displacement: Floats, passes: Indices, sense: Floats, gaps: Floats
) -> Iterator[RunCheck]:
    """The checks that a run allows.

    A check has directions d_k, (n,) each: it estimates d_kᵀ ΔS, which are zero in the model but for the noise. Those
    within the columns of X are linear functions of the coefficients, the others are at right angles to X.

    Args:
        solution: the fit.
        force: of the rows used, (n,), N.
        displacement: likewise, m.
        passes: likewise, number of the pass.
        sense: of each pass, (k,).
        gaps: coefficients of the gap of each cycle, (c, k + 2).
    """
    size, within = np.abs(force), solution.basis @ solution.inverse.T  # maps coefficients to directions
    cycles = np.arange(len(gaps)) - (len(gaps) - 1) / 2
    branch, slopes = np.zeros(len(force)), []
    for number, sign in enumerate(sense):
        rows = np.flatnonzero(passes == number)
        top = np.flatnonzero(size[rows] >= size[rows].max() * (1 - 1e-6))
        branch[rows[: top[0]]], branch[rows[top[-1] + 1 :]] = -0.5, 0.5
        own = np.where(passes == number, force - force[rows].mean(), 0.0)
        if own @ own > 1e-12 * (force[rows] @ force[rows]):  # a pass with a single load has no slope
            slopes.append(own / (own @ own) - within[:, -1 if sign > 0 else -2])
    is_in_both = np.any(branch < 0) and np.any(branch > 0)
    directions: dict[str, tuple[str, list[Floats]]] = {
        'slope_difference': ('m/N', [within[:, -1] - within[:, -2]]),
        'hysteresis': ('m', _beyond(solution, np.sign(force) * branch * is_in_both, 1.0)),
        'curvature': ('m', _beyond(solution, np.sign(force) * force**2, float(np.ptp(size)) ** 2 / 4)),
        # of the mean of both lines, with the number of the cycle
        'zero_drift': ('m', [within @ (cycles @ np.abs(gaps)) / 2 / (cycles @ cycles)] if len(gaps) > 1 else []),
        'gap_repeatability': ('m', list((gaps - gaps.mean(axis=0)) @ within.T)),
        'slope_repeatability': ('m/N', slopes),
    }
    for name, (unit, several) in directions.items():
        check = _check(name, unit, np.array(several).T, solution, displacement) if several else None
        if check:
            yield check


def _beyond(solution: LeastSquares, column: Floats, factor: float) -> list[Floats]:
    """The direction of `factor` times the coefficient of an additional column, (n,); none within those of X."""
    new = column - solution.basis @ (solution.basis.T @ column)
    return [factor * new / (new @ new)] if new @ new > 1e-8 * (column @ column) else []


def _check(name: str, unit: str, directions: Floats, solution: LeastSquares, values: Floats) -> RunCheck | None:
    """F-test of directions, (n, m); of one direction with its estimate, of several what they scatter beyond the noise.

    None where they or the residual have no degrees of freedom.
    """
    left, sizes, _ = np.linalg.svd(directions, full_matrices=False)
    along = left[:, sizes > 1e-6 * np.linalg.norm(directions, axis=0).max()]
    rank = along.shape[1]
    rest = solution.residual - along @ (along.T @ solution.residual)
    is_within = np.linalg.norm(solution.basis.T @ along) > 0.5
    dof = solution.dof - (0 if is_within else rank)
    if not rank or dof < 1:
        return None
    sigma = solution.sigma if is_within else max(float(np.sqrt(rest @ rest / dof)), solution.floor)
    ratio = float(np.sum((along.T @ values) ** 2)) / rank / sigma**2
    p_value, size = float(stats.f.sf(ratio, rank, dof)), sigma * float(np.linalg.norm(directions)) / np.sqrt(rank)
    if directions.shape[1] == 1:
        return RunCheck(name, float(directions[:, 0] @ values), size, unit, p_value)
    return RunCheck(name, size * float(np.sqrt(max(ratio - 1, 0.0))), np.nan, unit, p_value)


def _row_p_values(solution: LeastSquares) -> Floats:
    """p-value of each row from its externally studentised residual, (n,); 1 with too few degrees of freedom."""
    if solution.dof < 3:
        return np.ones(len(solution.residual))
    free, dof = np.maximum(1 - (solution.basis**2).sum(axis=1), 1e-12), solution.dof
    standard = solution.residual / solution.sigma / np.sqrt(free)
    student = standard * np.sqrt((dof - 1) / np.maximum(dof - standard**2, 1e-12))
    return 2 * stats.t.sf(np.abs(student), dof - 1)


class Run(NamedTuple):
    """Result of one run.

    Attributes:
        readings: its rows.
        fit: slope and gap at the gauge, m/N and m.
        compliance: of the part, m/N or rad/Nm.
        gap: of the part, m or rad.
        failed_checks: tests that fail.
        outliers: rows far from their line.
        note: remark on the gripper's contribution.
    """

    readings: Readings
    fit: RunFit
    compliance: UncertainValue
    gap: UncertainValue
    failed_checks: tuple[RunCheck, ...]
    outliers: tuple[int, ...]
    note: str


class Part(NamedTuple):
    """Result of one part, from all its runs.

    Attributes:
        name: one of `PARTS`.
        runs: in the order of the readings.
        compliance: m/N or rad/Nm; mean over the directions as in the paper, else weighted.
        gap: m or rad; likewise.
        combined: compliance and gap of two runs or more, by name; over the directions its test is that of isotropy.
        over_direction: whether it is a gripper along two directions or more.
    """

    name: str
    runs: tuple[Run, ...]
    compliance: UncertainValue
    gap: UncertainValue
    combined: dict[str, CombinedEstimate]
    over_direction: bool = False


class DialGaugeAnalysis(NamedTuple):
    """Every part in the runs, by name, in the order of `PARTS`; warnings, one sentence each."""

    parts: dict[str, Part]
    warnings: tuple[str, ...]


def analyse_runs(readings: Sequence[Readings]) -> DialGaugeAnalysis:
    """Compliance and backlash from runs.

    Raises:
        UnsupportedDataError: a run has no reversal, or too few rows; it is named.
    """
    fits = [(each, fit_run(each)) for each in readings]
    level = LEVEL / sum(len(fit.checks) + 2 for _, fit in fits)
    grippers = [(each, fit) for each, fit in fits if each.part == GRIPPER]
    runs = [_run(each, fit, grippers, level) for each, fit in fits]
    by_part = {name: tuple(run for run in runs if run.readings.part == name) for name in PARTS}
    parts = {name: _combine(name, own) for name, own in by_part.items() if own}
    warnings = [text for run in runs for text in _run_warnings(run)]
    for part in parts.values():
        for what, each in part.combined.items():
            if each.p_value < level and not part.over_direction:
                warnings.append(f'{part.name}: the runs are inconsistent in {what} (p = {each.p_value:.2g})')
    return DialGaugeAnalysis(parts, tuple(warnings))


def _run(readings: Readings, fit: RunFit, grippers: Sequence[tuple[Readings, RunFit]], level: float) -> Run:
    """What a run says of its part; checks fail below a level.

    A joint's run is without the gripper's contribution where the gauge was at the tip and the gripper was measured
    along the same direction, within 0.5°.
    """
    compliance, gap, note = fit.compliance, fit.gap, ''
    if readings.part != GRIPPER and readings.gauge_at == TIP:
        turns = [(each.direction - readings.direction + np.pi / 2) % np.pi - np.pi / 2 for each, _ in grippers]
        there = [own for (_, own), turn in zip(grippers, turns, strict=True) if abs(turn) < np.radians(0.5)]
        note = 'the gauge was at the tip: compliance and gap include those of the gripper'
        if there:
            one, other = mean([own.compliance for own in there]), mean([own.gap for own in there])
            compliance, gap = compliance.plus(-one.value, one.std), gap.plus(-other.value, other.std)
            note = 'the gripper along this direction was subtracted'
    if readings.part != GRIPPER:
        compliance, gap = compliance.over(readings.lever**2, 'rad/Nm'), gap.over(readings.lever, 'rad')
    failed = tuple(check for check in fit.checks if check.p_value < level)
    outliers = tuple(np.flatnonzero(fit.row_p < level / fit.used.sum()).tolist())
    return Run(readings, fit, compliance, gap, failed, outliers, note)


def _combine(name: str, runs: tuple[Run, ...]) -> Part:
    """A part from its runs: over the directions the mean, otherwise the weighted mean."""
    if len(runs) == 1:
        return Part(name, runs, runs[0].compliance, runs[0].gap, {})
    several = {'compliance': [run.compliance for run in runs], 'gap': [run.gap for run in runs]}
    dof = np.array([run.fit.degrees_of_freedom for run in runs], dtype=float)
    combined = {what: combine_estimates(each, dof) for what, each in several.items()}
    direction = np.array([run.readings.direction for run in runs])
    if name != GRIPPER or np.any(np.isnan(direction)) or len(np.unique(direction)) < 2:
        return Part(name, runs, combined['compliance'].estimate, combined['gap'].estimate, combined)
    return Part(name, runs, mean(several['compliance']), mean(several['gap']), combined, over_direction=True)


def _run_warnings(run: Run) -> list[str]:
    """Warnings about one run, one sentence each."""
    name, found = run.readings.name, []
    for check in run.failed_checks:
        size = f'{IN_MICRO * check.value:.3g} ± {IN_MICRO * check.std:.2g} µ{check.unit}'.replace(' ± nan', '')
        found.append(f'{name}: {check.name.replace("_", " ")} of {size} (p = {check.p_value:.2g})')
    if run.outliers:
        where = f'{run.readings.source}: line {", ".join(map(str, run.readings.line[list(run.outliers)]))}'
        found.append(f'{where}: far from the straight line of {name}; check for a typing error')
    if not 1e-8 < run.fit.compliance.value < 1e-2:  # m/N, of robots; outside it a unit is probably wrong
        found.append(f'{name}: a compliance of {run.fit.compliance.value:.2g} m/N; are the units and signs right?')
    if run.gap.value < -4 * run.gap.std:
        found.append(f'{name}: the gap is negative; is the displacement positive along the positive force?')
    return found + [f'{name}: {run.note}'] * bool(run.note)

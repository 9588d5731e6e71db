"""Measured records of a robot arm under load: what law (6) leaves, and what slip with memory predicts.

    python -m benchmark.measured_data [--joints 2 3 4 5 6] [--out docs/pictures] [--nested] [--json FILE]
    python -m benchmark.measured_data --alarms 200

The records are those in `bags/panda`. Three tables are printed, all errors rms of the joint angle after the unloading:

- each pose predicted with the parameters of the other records, by joint, with verdict and p-value; the law is selected
  on all records, with `--nested` anew for every pose, on the others alone;
- the later half of `loading.csv`, from its own earlier half, and from the poses with only its zero and its state of
  friction from the earlier half;
- the same for the tip of the arm that joints 2 and 4 make in a plane, by H̄.

`--out` draws two pictures. `--alarms` simulates records of law (6) instead, along the measured loads, with the noise of
the measured angles at rest, and counts those for which law (6) is called not sufficient.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup

from benchmark.common import parser, save
from benchmark.svg import svg_file
from scara_kinetostatic.files.tables import load_table
from scara_kinetostatic.model.arrays import Floats, Mask, rms
from scara_kinetostatic.model.joint_law import joint_deflection
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.quantities import p_equals
from scara_kinetostatic.report.figure import INK, LINE, SERIES, Margins, as_svg, new_figure, style
from scara_kinetostatic.studies.loops.fit import FitSamples, FittedLaw, PredictedRecord, fit_law, predict
from scara_kinetostatic.studies.loops.laws import LOAD_BACKLASH, LOAD_LAWS, RecordLaw
from scara_kinetostatic.studies.loops.record import LEVEL, Record, RecordPath, load_record
from scara_kinetostatic.studies.loops.selection import (
    Selection,
    Study,
    TestedLaw,
    p_independent,
    predict_records,
    select_model,
)

FOLDER = Path(__file__).parents[1] / 'bags' / 'panda'
LOADING = 'loading.csv'
ARM = (2, 4)
"""The joints of the plane."""
_MARGINS = Margins(left=60, right=10, bottom=46, top=24)


def read(joint: int) -> list[Record]:
    """All records of a joint, the poses first."""
    names = [*sorted(path.name for path in FOLDER.glob('pose_*.csv')), LOADING]
    columns = f'q{joint}_rad', f'tau{joint}_from_force_Nm'
    return [load_record(FOLDER / name, *columns) for name in names]


class Poses(NamedTuple):
    """Each pose of a joint predicted from the other records.

    Attributes:
        joint: its number.
        analysis: of all records.
        before: rms error of law (6) after the unloading, all poses, rad.
        own_zero: the same with the zero that fits the pose best up to the unloading, rad.
        after: the same by the laws selected, rad.
        by_pose: both of each pose, rad.
        laws: selected for each pose.
    """

    joint: int
    analysis: Selection
    before: float
    own_zero: float
    after: float
    by_pose: dict[str, tuple[float, float]]
    laws: tuple[str, ...]


def poses(joint: int, nested: bool = False, with_long: bool = True) -> Poses:
    """Each pose of a joint predicted from the other records, law (6) and the law selected.

    Args:
        joint: its number.
        nested: select the law anew for each pose.
        with_long: whether the long record is among the others.
    """
    records = read(joint) if with_long else read(joint)[:-1]
    analysis = select_model(Study(records))
    residuals: tuple[list[Floats], list[Floats], list[Floats]] = ([], [], [])
    by_pose: dict[str, tuple[float, float]] = {}
    laws: list[str] = []
    for number, record in enumerate(each for each in records if each.name != LOADING):
        if nested:
            others = select_model(Study([each for each in records if each is not record]))
            found = predict_records(others, [record])[0]
            pair, law = (found.before, found.after), (others.selected or others.before).law.name
        else:
            chosen = analysis.selected or analysis.before
            pair, law = (analysis.before.held_out[number], chosen.held_out[number]), chosen.law.name
        before, after = (each.residual[record.judged_from :] for each in pair)
        own_zero = before - pair[0].residual[: record.judged_from].mean()
        by_pose[record.name] = (rms(before), rms(after))
        laws.append(law)
        for several, each in zip(residuals, (before, own_zero, after), strict=True):
            several.append(each)
    pooled = [rms(np.concatenate(several)) for several in residuals]
    return Poses(joint, analysis, pooled[0], pooled[1], pooled[2], by_pose, tuple(laws))


class Half(NamedTuple):
    """The later half of the long record of a joint, three predictions along all of it."""

    path: RecordPath
    before: PredictedRecord
    own: PredictedRecord
    carried: PredictedRecord

    @property
    def errors(self) -> tuple[float, float, float]:
        """Rms error of the later half, rad: law (6), slip from the earlier half, slip with the poses' parameters."""
        later = ~self.path.earlier
        before, own, carried = (rms(each.residual[later]) for each in (self.before, self.own, self.carried))
        return before, own, carried


def later_half(joint: int) -> tuple[Half, FittedLaw]:
    """The later half of the long record from the earlier one, and law (6) as fitted there."""
    *others, record = read(joint)
    alone, poses_alone = Study([record]), Study(others)
    (path,), (block,) = alone.paths, alone.blocks
    slip = next(law for law in LOAD_LAWS if law.name == 'slip')
    before, own = (_fit(law, alone, [block.earlier]) for law in (LOAD_BACKLASH, slip))
    carried = _fit(slip, poses_alone, [np.ones(len(each.time), dtype=bool) for each in poses_alone.blocks])
    return Half(path, *(predict(each, path, path.earlier) for each in (before, own, carried))), before


def _fit(law: RecordLaw, study: Study, rows: Sequence[Mask]) -> FittedLaw:
    return fit_law([FitSamples(law, path, which, study.size) for path, which in zip(study.blocks, rows, strict=True)])


class Arm(NamedTuple):
    """Joints 2 and 4 as an arm in a plane.

    Attributes:
        link_1: from axis 2 to axis 4, m.
        link_2: from axis 4 to the sensor, m.
        angle: from link 1 to link 2 in the pose of the record, rad.
        sense: of axis 4 relative to axis 2, -1 for antiparallel ones.
        tilt: angle between the axes, rad.
    """

    link_1: float
    link_2: float
    angle: float
    sense: float
    tilt: float


def planar_arm() -> Arm:
    """The arm, from the record itself: the torques are τ = z·(r × F + M), linear in the wrench with z and z × r."""
    path = FOLDER / LOADING
    rows = load_table(path, 'time_s')
    table = np.array([[float(cell) for cell in cells] for _, cells in rows.rows])
    column = {name: table[:, place] for place, name in enumerate(rows.heading)}
    wrench = np.stack([column[name] for name in ('Fx_N', 'Fy_N', 'Fz_N', 'Mx_Nm', 'My_Nm', 'Mz_Nm')], axis=1)
    arms = []
    for joint in ARM:
        row = np.linalg.lstsq(wrench, column[f'tau{joint}_from_force_Nm'], rcond=None)[0]
        axis = row[3:] / np.linalg.norm(row[3:])
        arms.append((axis, np.cross(row[:3], axis)))
    (axis, whole), (other, link_2) = arms
    link_1 = whole - link_2
    link_1, link_2 = (each - axis * (axis @ each) for each in (link_1, link_2))
    tilt = float(np.arccos(min(abs(axis @ other), 1.0)))
    angle = float(np.arctan2(axis @ np.cross(link_1, link_2), link_1 @ link_2))
    return Arm(float(np.linalg.norm(link_1)), float(np.linalg.norm(link_2)), angle, float(np.sign(axis @ other)), tilt)


class Tip(NamedTuple):
    """Displacement of the tip from its place at rest, (n, 2) each, m: measured and predicted; its errors, m."""

    time: Floats
    measured: Floats
    before: Floats
    own: Floats
    carried: Floats
    later: Mask

    @property
    def errors(self) -> tuple[float, float, float]:
        """Rms distance from the measured place in the later half, m."""
        found = [np.hypot(*(each - self.measured)[self.later].T) for each in (self.before, self.own, self.carried)]
        return rms(found[0]), rms(found[1]), rms(found[2])


def tip_displacement(halves: Sequence[Half], laws: Sequence[FittedLaw]) -> Tip:
    """The tip of the arm in the plane under the measured torques, by H̄ with law (6) and by the links with slip."""
    arm = planar_arm()
    turns = np.array([1.0, arm.sense])
    directions = np.array([half.path.direction for half in halves])
    torques = -directions * turns * np.stack([half.path.driver for half in halves], axis=1)
    values = [law.values for law in laws]
    robot = Parameters(
        x0=0.0, y0=0.0, theta1=0.0, l1=arm.link_1, theta2=arm.angle, l2=arm.link_2, p_ee=0.0,
        p1=values[0]['compliance'], p2=values[1]['compliance'],
        g_ee=0.0, g1=values[0]['half_gap'], g2=values[1]['half_gap'],
    )  # fmt: skip
    rest = np.array([half.before.zero for half in halves])

    def moved(angles: Floats) -> Floats:
        return np.asarray(forward(robot, turns * (angles - rest)) - forward(robot, np.zeros(2)))

    angles = np.stack([half.path.driven for half in halves], axis=1)
    own, carried = (
        angles - np.stack([each.residual for each in several], axis=1)
        for several in ([half.own for half in halves], [half.carried for half in halves])
    )
    before = forward(robot, -joint_deflection(robot, torques)) - forward(robot, np.zeros(2))
    return Tip(halves[0].path.time, moved(angles), before, moved(own), moved(carried), ~halves[0].path.earlier)


def pose_picture(found: Poses, record: int) -> Markup:
    """Angle over time in one pose: measured, law (6), and the law selected, both without this pose."""
    analysis, each = found.analysis, found.analysis.study.records[record]
    response = each.response_change
    figure, (axes,) = new_figure(520.0, 300.0, margins=_MARGINS)
    axes.axvspan(each.time[each.judged_from], each.time[-1], color=LINE, lw=0, alpha=0.5)
    axes.plot(each.time, 1e3 * response, color=INK, lw=0.9, label='measured')
    chosen = analysis.selected or analysis.before
    for candidate, colour, label in ((analysis.before, SERIES[1], 'law (6)'), (chosen, SERIES[0], chosen.law.title)):
        predicted = response - candidate.held_out[record].residual
        axes.plot(each.time, 1e3 * predicted, color=colour, lw=1.4, label=label)
    axes.set(xlabel='time  [s]', ylabel='angle  [mrad]', title=f'joint {found.joint}, {each.name}')
    axes.set_xlim(each.time[0], each.time[-1])
    axes.legend(loc='upper left', frameon=False)
    return as_svg(
        figure,
        'panda_pose',
        f'Angle of joint {found.joint} under a load that comes on and goes, measured and predicted',
    )


def tip_picture(tip: Tip) -> Markup:
    """Distance of the tip from its place at rest over time."""
    figure, (axes,) = new_figure(520.0, 300.0, margins=_MARGINS)
    first = tip.time[tip.later][0]
    axes.axvspan(first, tip.time[-1], color=LINE, lw=0, alpha=0.5)
    lines = (
        (tip.measured, INK, 'measured joints'),
        (tip.before, SERIES[1], 'law (6)'),
        (tip.own, SERIES[2], 'slip, from the earlier half'),
        (tip.carried, SERIES[0], 'slip, parameters of the poses'),
    )
    for displacement, colour, label in lines:
        axes.plot(tip.time, 1e3 * np.hypot(*displacement.T), color=colour, lw=1.2, label=label)
    axes.set(xlabel='time  [s]', ylabel='displacement of the tip  [mm]', title='joints 2 and 4, loading.csv')
    axes.set_xlim(tip.time[0], tip.time[-1])
    axes.legend(loc='lower center', frameon=False)
    return as_svg(figure, 'panda_tip', 'Displacement of the tip of a two-joint arm over time, measured and predicted')


def false_alarms(count: int, form: str, seed: int) -> int:
    """Number of simulated sets of eight records, and of single ones, for which law (6) is called not sufficient.

    Args:
        count: of sets; every other one is a single record.
        form: without a gap, with one ('sign'), or with one in which the unloaded joint keeps its place ('gap').
        seed: of the noise, and of compliance and gap.
    """
    random = np.random.default_rng(seed)
    measured = {joint: read(joint) for joint in (2, 3, 4, 5, 6)}
    alarms = 0
    for number in range(count):
        records = measured[(2, 3, 4, 5, 6)[number % 5]]
        if number % 2:
            records = [records[random.integers(len(records))]]
        compliance, half_gap = random.uniform(7e-5, 2e-4), random.uniform(1e-5, 1e-4)
        simulated = []
        for each in records:
            path = RecordPath(each)
            sign = {'none': np.zeros_like(path.driver), 'sign': path.sign(None), 'gap': path.last_sign(8.0, 0.0)}[form]
            exact = compliance * each.load + half_gap * sign
            noise = random.normal(0.0, each.response[each.rest].std(ddof=1), len(each))
            simulated.append(Record(each.source, each.time, each.load, exact + noise))
        alarms += p_independent(Study(simulated).law6()[1]) < LEVEL / 2
    return alarms


def fitted(analysis: Selection) -> str:
    """Residuals of the fits of all laws to all records."""
    samples = sum(len(RecordPath(record, in_blocks=True).time) for record in analysis.study.records)
    several = (analysis.before, *analysis.candidates)
    return ', '.join(f'{each.law.name} {1e3 * (each.whole.square / samples) ** 0.5:.4f}' for each in several)


def describe(candidate: TestedLaw | None) -> str:
    """Its form, or what is said without one."""
    return candidate.law.title if candidate else 'no law named'


def main() -> int:
    """Print, draw, write."""
    options_of = parser(__doc__)
    options_of.add_argument('--joints', type=int, nargs='+', default=[2, 3, 4, 5, 6], choices=range(2, 8), metavar='J')
    options_of.add_argument('--out', type=Path, metavar='DIR', help='draw the pictures there')
    options_of.add_argument('--nested', action='store_true', help='select the law anew for every pose')
    options_of.add_argument('--alarms', type=int, metavar='N', help='simulate N sets of records of law (6) instead')
    options = options_of.parse_args()
    if options.alarms:
        for seed, form in enumerate(('none', 'sign', 'gap')):
            print(
                f'gap: {form}, called not sufficient: {false_alarms(options.alarms, form, seed)} of {options.alarms}',
                flush=True,
            )
        return 0
    began = time.perf_counter()
    found = [poses(joint, options.nested) for joint in options.joints]
    print('each pose predicted from the other records, rms after the unloading, mrad')
    print('law (6), with the zero that fits best -> law selected; p that law (6), that the law selected is sufficient')
    for each in found:
        analysis = each.analysis
        rivals = ''.join(f', or {rival.law.title}' for rival in analysis.rivals)
        named = f'{analysis.verdict}: {describe(analysis.selected)}{rivals}'
        errors = f'{1e3 * each.before:.3f}, {1e3 * each.own_zero:.3f} -> {1e3 * each.after:.3f}'
        chances = f'{p_equals(analysis.p_value)}, {p_equals(analysis.p_after)}'
        print(f'  joint {each.joint}   {errors}   {chances}   {named}')
        print(f'    rms residual of the fit to all records: {fitted(each.analysis)}')
    for joint in ARM:
        print(f'  joint {joint}, without {LOADING}: {1e3 * poses(joint, with_long=False).after:.3f}')
    halves = {joint: later_half(joint) for joint in (2, 4, 6)}
    print(
        'later half of loading.csv, rms, mrad: law (6), slip from the earlier half, slip with parameters of the poses'
    )
    for joint, (half, _) in halves.items():
        print(f'  joint {joint}   ' + '   '.join(f'{1e3 * error:.3f}' for error in half.errors))
    tip = tip_displacement([halves[joint][0] for joint in ARM], [halves[joint][1] for joint in ARM])
    arm = planar_arm()
    links = f'{arm.link_1:.3f} and {arm.link_2:.3f} m at {np.degrees(arm.angle):.0f}°'
    print(f'arm of joints 2 and 4: links of {links}, axes antiparallel within {np.degrees(arm.tilt):.1f}°')
    largest, remains = (1e3 * np.hypot(*part.T) for part in (tip.measured, tip.measured[-80:]))
    print(f'tip, joints 2 and 4: moves by up to {largest.max():.2f} mm and keeps {remains.mean():.2f} mm')
    print('  rms distance, later half, mm: ' + '   '.join(f'{1e3 * error:.3f}' for error in tip.errors))
    if options.out:
        joint_2 = next((each for each in found if each.joint == 2), found[0])
        with style():
            for name, picture in (
                ('panda_pose', pose_picture(joint_2, _shown(joint_2))),
                ('panda_tip', tip_picture(tip)),
            ):
                (options.out / f'{name}.svg').write_text(svg_file(picture), encoding='utf-8')
                print(options.out / f'{name}.svg')
    print(f'{time.perf_counter() - began:.0f} s')
    save(options.json, _content(found, halves, tip))
    return 0


def _shown(found: Poses) -> int:
    """The pose in which law (6) errs most."""
    return int(np.argmax([before for before, _ in found.by_pose.values()]))


def _content(found: Sequence[Poses], halves: dict[int, tuple[Half, FittedLaw]], tip: Tip) -> dict[str, Any]:
    names = ('before', 'own', 'carried')
    return {
        'poses': [
            {
                'joint': each.joint,
                'before': each.before,
                'before_own_zero': each.own_zero,
                'after': each.after,
                'by_pose': each.by_pose,
                'laws': each.laws,
                'verdict': each.analysis.verdict,
                'p_value': each.analysis.p_value,
                'law': each.analysis.selected and each.analysis.selected.law.name,
                'rivals': [rival.law.name for rival in each.analysis.rivals],
            }
            for each in found
        ],
        'later_half': {joint: dict(zip(names, half.errors, strict=True)) for joint, (half, _) in halves.items()},
        'tip': dict(zip(names, tip.errors, strict=True)),
    }


if __name__ == '__main__':
    sys.exit(main())

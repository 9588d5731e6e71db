"""Measured torque ramps of real gears with large backlash: what law (6) leaves, and what friction in parallel predicts.

    python -m benchmark.measured_gears [--only NAME…] [--out docs/pictures] [--jobs 2] [--json FILE]
    python -m benchmark.measured_gears --simulate N [--jobs 2]

The records are those in `bags/cycloidal`. Printed are, all errors rms of the angle:

- of each record the verdict, and its later half (loops 101 and 102) predicted from the earlier one, by law (6), with
  constant friction, with friction that grows with the load, and by the law selected;
- each place of a mechanism predicted from the other two, zero and state of friction from the first third;
- the parameters of each record, and their change with preload, running in, temperature and place. The scatter of a
  parameter from one measurement to the next is that of the records which were repeated on the same day.

`--out` draws two pictures. `--simulate` simulates records along the measured torques instead, with the sampling and the
noise of the measured ones: N of law (6), and how often it is called not sufficient; N with friction c + μ |τ_e|, and
how often c and μ are found within two standard deviations.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from scipy import stats

from benchmark.common import in_processes, parser, save
from benchmark.svg import svg_file
from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.model.quantities import p_equals
from scara_kinetostatic.report.figure import INK, SERIES, Margins, as_svg, new_figure, style
from scara_kinetostatic.studies.loops.fit import FitSamples, fit_law, predict
from scara_kinetostatic.studies.loops.laws import LOAD_BACKLASH, LOAD_LAWS
from scara_kinetostatic.studies.loops.record import Record, RecordPath, load_record
from scara_kinetostatic.studies.loops.selection import NONE, UNDECIDED, Study, TestedLaw, select_model

FOLDER = Path(__file__).parents[1] / 'bags' / 'cycloidal'
LAWS = {law.name: law for law in (LOAD_BACKLASH, *LOAD_LAWS)}
BEFORE, CONSTANT, GROWING = 'backlash', 'friction', 'load_friction'
MECHANISMS = ('base910_unr_init', 'base_init', 'base_runin', 'conic_onyx_init', 'split_onyx_init')
PLACES = '1', '5', '6'
REPEATED = ('base_init1', 'base_init5', 'base910_unr_init1')
"""Measured again on the same day."""
PARAMETERS = {'half_gap': ('half gap', 'mrad', 1e3), 'compliance': ('compliance', 'mrad/Nm', 1e3),
              'friction': ('friction c', 'Nm', 1.0), 'friction_ratio': ('growth μ', '', 1.0)}  # fmt: skip
CHANGES = (
    ('running in, places 1, 5, 6', ('base_init1', 'base_init5', 'base_init6'),
     ('base_runin1', 'base_runin5', 'base_runin6')),
    ('preload 1 to 12 steps (split)', ('split_onyx_1pre5',), ('split_onyx_12pre5',)),
    ('preload 1 to 4 steps (conic)', ('conic_onyx_1pre5',), ('conic_onyx_4pre5',)),
    ('cold (base, 910)', ('base910_unr_init5',), ('base910_unr_cold5',)),
    ('PC-CF to 910, places 1, 5, 6', ('base_init1', 'base_init5', 'base_init6'),
     ('base910_unr_init1', 'base910_unr_init5', 'base910_unr_init6')),
)  # fmt: skip
"""What changed, the records before and after."""


class Found(NamedTuple):
    """What one record shows: errors of the later half by law, rad; parameters of friction that grows with the load."""

    name: str
    verdict: str
    law: str
    rivals: tuple[str, ...]
    p_value: float
    detectable: float
    errors: dict[str, float]
    parameters: dict[str, tuple[float, float]]


def read(name: str) -> Record:
    """A record."""
    return load_record(FOLDER / f'{name}.csv')


def examine(name: str) -> Found:
    """One record by itself."""
    study = Study([read(name)])
    selection = select_model(study)
    errors = {each.law.name: each.held_out_rms for each in (selection.before, *selection.candidates)}
    errors = {law: errors[law] for law in (BEFORE, CONSTANT, GROWING)} | {'selected': selection.final.held_out_rms}
    growing = next(each for each in selection.candidates if each.law.name == GROWING)
    parameters = {key: (value, std) for key, (value, std) in _parameters(study.with_std(growing)).items()}
    rivals = tuple(each.law.name for each in selection.rivals)
    law = selection.final.law.name
    return Found(name, selection.verdict, law, rivals, selection.p_value, selection.detectable, errors, parameters)


def _parameters(candidate: TestedLaw) -> dict[str, tuple[float, float]]:
    return {key: (each.value, each.std) for key, each in candidate.parameters.items()}


def predicted_place(place: tuple[str, str]) -> dict[str, float]:
    """Sums of squares after the first third of one place of a mechanism, by law, and number of samples."""
    mechanism, tested = place
    study = Study([read(mechanism + other) for other in PLACES if other != tested])
    path = RecordPath(read(mechanism + tested), direction=study.direction)
    found = {'samples': float((~path.known).sum())}
    for law in (BEFORE, CONSTANT, GROWING):
        blocks = [FitSamples(LAWS[law], each, np.ones(len(each.time), dtype=bool), study.size) for each in study.blocks]
        residual = predict(fit_law(blocks), path, path.known).residual[~path.known]
        found[law] = float(residual @ residual)
    return found


def simulate(seed: int, law: str) -> tuple[Record, dict[str, float]]:
    """A record along a measured torque: law (6), or friction that grows with the load, with the noise of the angle.

    The noise is white, as large as that of the measured angle from sample to sample.
    """
    random = np.random.default_rng([seed, law == GROWING])
    names = sorted(each.stem for each in FOLDER.glob('*.csv'))
    record = read(names[random.integers(len(names))])
    path = RecordPath(record)
    values = {'compliance': random.uniform(1e-3, 5e-3), 'half_gap': random.uniform(5e-3, 3e-2),
              'friction': random.uniform(1.5, 4.5), 'friction_ratio': random.uniform(0.15, 0.5),
              'rounding': random.uniform(0.3, 3.0), 'state': random.uniform(-1.0, 1.0)}  # fmt: skip
    amplitudes = np.array([values['compliance'], values['half_gap']])
    exact = np.column_stack([path.driver, path.sign(None)]) if law == BEFORE else LAWS[law].basis(path, values)
    noise = random.normal(0.0, record.noise(record.response), len(record))
    return replace(record, source=f'{seed}: {values}', response=exact @ amplitudes + noise), values


def simulated(seed: int, law: str) -> dict[str, Any]:
    """Verdict on a simulated record; errors of c and μ in standard deviations where they are in it."""
    record, values = simulate(seed, law)
    study = Study([record])
    selection = select_model(study)
    found: dict[str, Any] = {'seed': seed, 'verdict': selection.verdict, 'law': selection.final.law.name}
    if law == GROWING:
        growing = next(each for each in selection.candidates if each.law.name == GROWING)
        for key, (value, std) in _parameters(study.with_std(growing)).items():
            found[key] = (value - values[key]) / std if std > 0 else np.inf
    return found


def change(
    found: dict[str, Found], key: str, before: Sequence[str], after: Sequence[str]
) -> tuple[float, float, float]:
    """Mean change of a parameter, its standard uncertainty, and the p-value of none.

    The uncertainty is that of the repeated records: half the mean square of their differences, one degree of freedom
    each; or, where that is larger, that of the fits.
    """
    repeats = [found[f'{name}_again'].parameters[key][0] - found[name].parameters[key][0] for name in REPEATED]
    size = [found[b].parameters[key][0] - found[a].parameters[key][0] for a, b in zip(before, after, strict=True)]
    fits = [found[name].parameters[key][1] ** 2 for name in (*before, *after)]
    variance = max(float(np.mean(np.square(repeats))), sum(fits) / len(before)) / len(before)
    mean, std = float(np.mean(size)), float(np.sqrt(variance))
    return mean, std, float(2 * stats.t.sf(abs(mean) / std, len(repeats)))


def pooled(found: Sequence[Found], law: str) -> float:
    """Rms over records, rad."""
    return rms(np.array([each.errors[law] for each in found]))


def print_records(found: Sequence[Found]) -> None:
    """The first table."""
    print('loops 101 and 102 predicted from the earlier half, rms, mrad')
    print('law (6), constant friction, friction that grows with the load, law selected; verdict; p of law (6)')
    for each in found:
        errors = '  '.join(f'{1e3 * error:5.1f}' for error in each.errors.values())
        named = '|'.join([each.law, *each.rivals])
        print(f'  {each.name:24} {errors}   {each.verdict}: {named}   {p_equals(each.p_value)}')
    totals = {law: pooled(found, law) for law in (BEFORE, CONSTANT, GROWING, 'selected')}
    print('  pooled                   ' + '  '.join(f'{1e3 * total:5.2f}' for total in totals.values()))
    share, gain = totals['selected'] / totals[BEFORE], totals[GROWING] / totals[CONSTANT]
    print(f'  law selected over law (6): {share:.3f}; growing over constant friction: {gain:.3f}')


def print_places(jobs: int) -> dict[str, dict[str, float]]:
    """The second table."""
    places = [(mechanism, place) for mechanism in MECHANISMS for place in PLACES]
    several = list(in_processes(predicted_place, places, jobs))
    print('each place from the other two of its mechanism, rms, mrad: law (6), constant friction, growing; ratio')
    found = {}
    for name, members in [(m, [m]) for m in MECHANISMS] + [('all', list(MECHANISMS))]:
        some = [each for (mechanism, _), each in zip(places, several, strict=True) if mechanism in members]
        samples = sum(each['samples'] for each in some)
        errors = {law: float(np.sqrt(sum(each[law] for each in some) / samples)) for law in (BEFORE, CONSTANT, GROWING)}
        listed = '  '.join(f'{1e3 * error:5.2f}' for error in errors.values())
        print(f'  {name:18} {listed}   {errors[GROWING] / errors[BEFORE]:.3f}')
        found[name] = errors
    return found


def print_parameters(found: dict[str, Found]) -> None:
    """The third table."""
    print(
        'friction that grows with the load: ' + ', '.join(f'{name} [{unit}]' for name, unit, _ in PARAMETERS.values())
    )
    for name, each in found.items():
        cells = [f'{per * each.parameters[key][0]:7.2f} ± {per * each.parameters[key][1]:4.2f}'
                 for key, (_, _, per) in PARAMETERS.items()]  # fmt: skip
        print(f'  {name:24}' + '  '.join(cells))
    for title, before, after in CHANGES:
        if set(before) | set(after) | {f'{name}_again' for name in REPEATED} | set(REPEATED) <= set(found):
            print(f'  {title}')
            for key, (name, unit, per) in PARAMETERS.items():
                mean, std, p = change(found, key, before, after)
                print(f'    {name:12} {per * mean:+7.2f} ± {per * std:4.2f} {unit:8} {p_equals(p)}')


def loop_picture(name: str) -> Markup:
    """Angle over torque of the later half of a record: measured, law (6), the law with friction."""
    study = Study([read(name)])
    (path,), (block,) = study.paths, study.blocks
    later = ~path.earlier
    figure, (axes,) = new_figure(520.0, 320.0, margins=_MARGINS)
    axes.plot(path.driver[later], 1e3 * path.driven[later], color=INK, lw=0.9, label='measured')
    for law, colour, label in ((BEFORE, SERIES[1], 'law (6)'), (GROWING, SERIES[0], 'friction grows with the load')):
        fitted = fit_law([FitSamples(LAWS[law], block, block.earlier, study.size)])
        residual = predict(fitted, path, path.earlier).residual
        axes.plot(path.driver[later], 1e3 * (path.driven - residual)[later], color=colour, lw=1.3, label=label)
    axes.set(xlabel='torque  [Nm]', ylabel='angle  [mrad]', title=f'{name}, loops 101 and 102, from the earlier ones')
    axes.legend(loc='upper left', frameon=False)
    return as_svg(figure, 'gear_loop', 'Angle over torque of a gear with backlash, measured and predicted')


def preload_picture(found: dict[str, Found]) -> Markup:
    """Half gap and friction over the steps of preload of the split mechanism."""
    steps = {0: 'split_onyx_init5', 1: 'split_onyx_1pre5', 4: 'split_onyx_4pre5', 8: 'split_onyx_8pre5',
             12: 'split_onyx_12pre5'}  # fmt: skip
    figure, several = new_figure(520.0, 260.0, columns=2, margins=_MARGINS)
    for axes, key in zip(several, ('half_gap', 'friction'), strict=True):
        name, unit, per = PARAMETERS[key]
        values, std = (per * np.array([found[each].parameters[key][k] for each in steps.values()]) for k in (0, 1))
        axes.errorbar(list(steps), values, std, color=SERIES[0], marker='o', ms=4, lw=1.0, capsize=3)
        axes.set(xlabel='steps of preload', ylabel=f'{name}  [{unit}]', ylim=(0, None))
    return as_svg(figure, 'gear_preload', 'Half gap and friction of a gear over its preload')


_MARGINS = Margins(left=60, right=10, bottom=46, top=24)


def print_simulated(count: int, jobs: int) -> dict[str, Any]:
    """Alarms on law (6), and c and μ found."""
    plain = list(in_processes(partial(simulated, law=BEFORE), range(count), jobs))
    verdicts = [each['verdict'] for each in plain]
    alarms = sum(each not in (NONE, UNDECIDED) for each in verdicts)
    print(f'law (6) simulated: {alarms} alarms in {count}, sufficient {verdicts.count(NONE)}, undecided '
          f'{verdicts.count(UNDECIDED)}')  # fmt: skip
    growing = list(in_processes(partial(simulated, law=GROWING), range(count), jobs))
    for key in ('friction', 'friction_ratio'):
        inside: Floats = np.abs([each[key] for each in growing])
        print(f'{key}: within 2 standard deviations in {np.mean(inside < 2):.0%} of {count}')
    print(f'called sufficient: {sum(each["verdict"] == NONE for each in growing)}')
    return {'law6': plain, 'growing': growing}


def main() -> int:
    """Print, draw, write."""
    options_of = parser(__doc__)
    options_of.add_argument('--only', nargs='+', metavar='NAME', help='these records alone')
    options_of.add_argument('--out', type=Path, metavar='DIR', help='draw the pictures there')
    options_of.add_argument('--simulate', type=int, metavar='N', help='simulate N records of each kind instead')
    options_of.add_argument('--jobs', type=int, default=2, help='processes (default: 2)')
    options = options_of.parse_args()
    began = time.perf_counter()
    if options.simulate:
        save(options.json, print_simulated(options.simulate, options.jobs))
        return 0
    names = options.only or sorted(each.stem for each in FOLDER.glob('*.csv'))
    found = {each.name: each for each in in_processes(examine, names, options.jobs)}
    print_records(list(found.values()))
    print_parameters(found)
    places = {} if options.only else print_places(options.jobs)
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        with style():
            pictures = {'gear_loop': loop_picture('split_onyx_1pre5'), 'gear_preload': preload_picture(found)}
            for name, picture in pictures.items():
                (options.out / f'{name}.svg').write_text(svg_file(picture), encoding='utf-8')
    print(f'{time.perf_counter() - began:.0f} s')
    save(options.json, {'records': [each._asdict() for each in found.values()], 'places': places})
    return 0


if __name__ == '__main__':
    sys.exit(main())

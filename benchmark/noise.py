"""Noise that is not plain: it grows with the force, differs from axis to axis, has heavy tails.

    python -m benchmark.noise [--number 200] [--first 0] [--only growing] [--json FILE]

Touches of two cells without any model error are simulated with such noise, and diagnosed as the command does it. The
noise of the cell description is

- plain: the two levels alone, for axes that differ their root mean square;
- full: all that was simulated (not of Student's t, which no description states);
- estimated: none.

Student's t with 4 degrees of freedom is simulated with the stated levels as its standard deviation, and, separately,
as its scale: then its standard deviation is 1.41 times the stated one.

Reported: false alarms (a verdict other than none), the z-score of each parameter of the base model (error / standard
uncertainty), root mean square over the recordings, and how often noise that grows with the force was noticed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace

import numpy as np

from benchmark.common import counted, parser, print_targets, save
from benchmark.diagnosis.cells import NOISE, SETUPS, Setup, seed_of
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.streams import simulate_touches

RATIO = 4.0
"""Of the levels of two axes."""
GROWTH = 0.01
FREEDOMS = 4
LEAST_Z, LARGEST_Z = 0.85, 1.15
MOST_ALARMS = 0.02
DESCRIBED = ('plain', 'full', 'estimated')


def _axes(rms: float) -> tuple[float, float]:
    """Two levels in the ratio, of a root mean square."""
    least = rms * np.sqrt(2 / (1 + RATIO**2))
    return float(least), float(RATIO * least)


NOISES = {
    'none': NOISE,
    'growing': NOISE._replace(force_relative=GROWTH),
    'joint axes': NOISE._replace(joint=_axes(NOISE.joint_rms)),
    'force axes': NOISE._replace(force=_axes(NOISE.force_rms)),
    'all axes': Noise(_axes(NOISE.joint_rms), _axes(NOISE.force_rms)),
}
HEAVY = {'student, std': float(np.sqrt(FREEDOMS / (FREEDOMS - 2))), 'student, scale': 1.0}
"""By what Student's t is divided before it is multiplied by the levels."""


@dataclass
class Recording:
    """What the diagnosis of one recording says.

    Attributes:
        simulated: the noise, by name.
        described: what of it the cell description states.
        cell: its name.
        seed: of the noise.
        verdict: of the diagnosis.
        found: effects found, by label.
        z: error over standard uncertainty of each parameter.
        noise: as the final model has it.
        rejected: touches left out.
    """

    simulated: str
    described: str
    cell: str
    seed: int
    verdict: str
    found: list[str]
    z: list[float]
    noise: dict[str, float | list[float]]
    rejected: int


def touches(setup: Setup, simulated: str, seed: int) -> TouchSet:
    """The touches of a cell with a noise."""
    number = seed_of('noise', simulated, seed)
    if simulated in NOISES:
        return simulate_touches(setup.cell, setup.truth, setup.plan, NOISES[simulated], number)
    exact = simulate_touches(setup.cell, setup.truth, setup.plan, Noise(0.0, 0.0))
    unit = np.random.default_rng(number).standard_t(FREEDOMS, (2, len(exact), 2)) / HEAVY[simulated]
    joints, force = exact.joints + NOISE.joint_rms * unit[0], exact.force + NOISE.force_rms * unit[1]
    return exact.replace(joints=joints, force=force)


def run(simulated: str, described: str, cell: str, seed: int) -> Recording:
    """One recording simulated and diagnosed."""
    setup = SETUPS[cell]
    noise = {'plain': NOISE, 'full': NOISES.get(simulated, NOISE), 'estimated': None}[described]
    base = calibrate(touches(setup, simulated, seed), replace(setup.cell, noise=noise))
    diagnosis = diagnose(base)
    final = diagnosis.extended or diagnosis.refitted or base
    z = (final.parameters.as_array() - setup.truth.as_array()) / final.std
    labels = [item.effect.label for item in diagnosis.found]
    rejected = int((~final.used).sum())
    return Recording(
        simulated, described, cell, seed, diagnosis.verdict, labels, z.tolist(), final.noise.as_dict(), rejected
    )


def runs(number: int, first: int, only: str | None) -> Iterator[Recording]:
    """All recordings, half of them of each cell."""
    for simulated in [only] if only else [*NOISES, *HEAVY]:
        for described in DESCRIBED:
            if described == 'full' and (simulated in HEAVY or simulated == 'none'):
                continue
            for k in range(number):
                yield run(simulated, described, list(SETUPS)[k % len(SETUPS)], first + k)


def summary(recordings: list[Recording]) -> list[dict[str, object]]:
    """One row per noise and description."""
    rows: list[dict[str, object]] = []
    for simulated, described in dict.fromkeys((r.simulated, r.described) for r in recordings):
        part = [r for r in recordings if (r.simulated, r.described) == (simulated, described)]
        z = np.array([r.z for r in part])
        rms = np.sqrt(np.nanmean(z**2, axis=0))
        rows.append(
            {
                'simulated': simulated,
                'described': described,
                'recordings': len(part),
                'alarms': sum(r.verdict != 'none' for r in part),
                'z': float(np.sqrt(np.nanmean(z**2))),
                'least_z': float(rms.min()),
                'largest_z': float(rms.max()),
                'beyond_5': int((np.abs(z) > 5).sum()),
                'noticed': sum(bool(r.noise.get('force_relative')) for r in part) if described != 'full' else None,
                'rejected': sum(r.rejected for r in part) / len(part),
            }
        )
    return rows


def show(rows: list[dict[str, object]]) -> bool:
    """Prints the table and the targets; whether all are met."""
    columns: dict[str, Callable[[object], str]] = {
        'simulated': lambda v: f'{v:16}',
        'described': lambda v: f'{v:10}',
        'recordings': lambda v: f'{v:10}',
        'alarms': lambda v: f'{v:6}',
        'z': lambda v: f'{v:5.2f}',
        'least_z': lambda v: f'{v:7.2f}',
        'largest_z': lambda v: f'{v:9.2f}',
        'beyond_5': lambda v: f'{v:8}',
        'noticed': lambda v: f'{"" if v is None else v!s:>7}',
        'rejected': lambda v: f'{v:8.2f}',
    }
    print(' | '.join(f'{name:>{len(form(0))}}' for name, form in columns.items()))
    targets = []
    for row in rows:
        print(' | '.join(form(row[name]) for name, form in columns.items()))
        alarms, number, z = row['alarms'], row['recordings'], row['z']
        assert isinstance(alarms, int)
        assert isinstance(number, int)
        assert isinstance(z, float)
        name = f'{row["simulated"]}, {row["described"]}'
        targets.append((f'{name}: false alarms at most {100 * MOST_ALARMS:g} %', alarms <= MOST_ALARMS * number))
        targets.append((f'{name}: rms of z {LEAST_Z} to {LARGEST_Z}', LEAST_Z <= z <= LARGEST_Z))
    return print_targets(targets)


def main() -> int:
    """The command."""
    made = parser(__doc__)
    made.add_argument('--number', type=int, default=200, help='recordings of each noise and description')
    made.add_argument('--first', type=int, default=0, help='first seed')
    made.add_argument('--only', choices=[*NOISES, *HEAVY], help='one noise alone')
    options = made.parse_args()
    count = len([options.only] if options.only else [*NOISES, *HEAVY])
    recordings = list(counted(runs(options.number, options.first, options.only), 3 * count * options.number))
    rows = summary(recordings)
    met = show(rows)
    save(options.json, {'rows': rows, 'recordings': [asdict(r) for r in recordings]})
    return 0 if met else 1


if __name__ == '__main__':
    raise SystemExit(main())

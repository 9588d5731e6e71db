"""Slip with memory in a joint: named, and corrected as well as the true model does; false alarms.

    python -m benchmark.joint_slip [--effect NAME] [--seeds N] [--first N] [--clean N] [--cells NAME…] [--streams N]
                                   [--jobs N] [--json FILE]

All recordings are simulated, by this package's own simulator: 108 touches, every other one preloaded by 0.3 of its
force, in two cells, one of them with the links and the compliance of a Franka Panda. One joint in turn slips, in two
sizes: 100 to 190 µrad/Nm beyond 0.5 to 2.2 Nm, as measured on such an arm; and with a slip torque from the same range,
the compliance that doubles the reduced chi-square. `--streams` does as many of each from whole recordings, whose
touches and load histories are found in the streams.

With `--effect load_friction` the friction is a part of 0.1 to 0.4 of the load that it carries, and the preloads take
turns from 0.15 to 1.0: one alone does not show both parameters of this effect.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from benchmark.common import NO_OTHERS, in_processes, parser, print_targets, save
from benchmark.diagnosis.cells import SETUPS, TOUCHES, Setup, SimulatedEffects, at_sizes, seed_of, simulate
from benchmark.diagnosis.record import Record, correctly_named, named_text, predicts_like_truth, unbiased
from benchmark.diagnosis.runs import diagnosed
from scara_kinetostatic.effects.joints import JointSlip, LoadFriction
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.cell import Cell, Disc, Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.detection import find_touches

MEASURED, DOUBLED = SIZES = ('as measured', 'doubles chi-square')
COMPLIANCES = 1.0e-4, 1.9e-4
"""rad/Nm, as on a Panda's joints."""
EFFECTS = {'joint_slip': (JointSlip, (0.5, 2.2)), 'load_friction': (LoadFriction, (0.1, 0.4))}
"""Each with the range of its friction: Nm, as on a Panda's joints; a part of the load, as in printed gears."""
PRELOADS = 0.15, 0.3, 0.6, 1.0
"""Of friction that grows with the load, in turn."""
LEAST_NAMED = 0.95
PRELOAD = 0.3

_PANDA = PAPER_NOMINAL.replace(l1=0.3266, l2=0.538, p_ee=2e-5, p1=8e-5, p2=8e-5)
_PANDA_DISCS = (
    Disc('left', 0.10, 0.52, 0.08), Disc('front', 0.55, 0.05, 0.07), Disc('right', 0.05, -0.50, 0.09),
)  # fmt: skip
_SHORT = PAPER_NOMINAL.replace(l1=0.28, l2=0.24)
_SHORT_DISCS = (
    Disc('a', 0.22, 0.24, 0.05), Disc('b', -0.20, 0.22, 0.07), Disc('c', -0.12, -0.28, 0.06),
    Disc('d', 0.30, -0.12, 0.05),
)  # fmt: skip


def _panda() -> Setup:
    """Links and compliance of joints 2 and 4 of a Panda, forces as it is made for."""
    cell = Cell(_PANDA, _PANDA_DISCS, noise=Noise(joint=1e-5, force=0.1), uncertainty=NO_OTHERS)
    truth = _PANDA.replace(
        x0=1e-3, y0=-2e-3, theta1=2e-3, l1=0.3263, theta2=-1e-3, l2=0.5384, p_ee=2.4e-5, p1=8.6e-5, p2=7.7e-5,
        g_ee=6e-5, g1=2e-4, g2=1.5e-4,
    )  # fmt: skip
    plan = default_plan(cell, 20, levels=(4.0, 10.0, 20.0), preload=PRELOAD)
    return Setup(cell, truth, plan.select(np.arange(TOUCHES)))


def _short() -> Setup:
    """A stiffer arm with shorter links among four discs."""
    cell = Cell(_SHORT, _SHORT_DISCS, noise=Noise(joint=1e-5, force=0.3), uncertainty=NO_OTHERS)
    truth = PAPER_ACTUAL.replace(x0=-1e-3, y0=1e-3, l1=0.2803, l2=0.2396, p1=2.2e-5, p2=3.1e-5, g1=1.5e-4, g2=2.2e-4)
    plan = default_plan(cell, 20, levels=(8.0, 18.0, 35.0), preload=PRELOAD)
    return Setup(cell, truth, plan.select(np.arange(TOUCHES)))


CELLS = {'panda': _panda, 'short': _short, **{name: (lambda setup=setup: setup) for name, setup in SETUPS.items()}}
"""The two cells of the figures, and those of `benchmark.diagnosis`."""


@dataclass(frozen=True)
class Job:
    """One recording, or with no size one without effect."""

    cell: str
    size: str
    seed: int
    noise: str = 'given'
    from_streams: bool = False
    effect: str = 'joint_slip'

    @property
    def setup(self) -> Setup:
        """The cell with its touches."""
        setup = CELLS[self.cell]()
        if self.effect == 'joint_slip':
            return setup
        plan = setup.plan
        preload = np.resize(PRELOADS, np.count_nonzero(plan.preload))
        several = plan.preload.copy()
        several[several > 0] = preload
        return setup._replace(plan=replace(plan, preload=several))


def run_job(job: Job) -> Record:
    """Its record."""
    setup = job.setup
    section = 'effects' if job.size else 'clean'
    blank = Record(section, job.cell, job.noise, job.seed)
    simulated, reason = _slip(setup, job) if job.size else (SimulatedEffects((), ()), '')
    if reason:
        blank.reason = reason
        return blank
    blank.simulated, blank.size = simulated.labels, 2.0 if job.size == DOUBLED else np.nan
    blank.values = tuple(float(value) for part in simulated.values for value in part)
    try:
        touches = _touches(setup, simulated, job)
    except ScaraKinetostaticError as error:
        blank.reason = str(error)
        return blank
    return diagnosed(blank, setup, simulated, touches)


def _slip(setup: Setup, job: Job) -> tuple[SimulatedEffects, str]:
    """A random slip of one joint, at the size asked for, or why there is none."""
    random = np.random.default_rng([job.seed, seed_of(job.cell, job.size)])
    kind, friction = EFFECTS[job.effect]
    values = np.array([random.uniform(*COMPLIANCES), random.uniform(*friction)])
    one = SimulatedEffects((kind.of(job.seed % 2),), (values,))
    if job.size == MEASURED:
        return one, ''
    (sized,) = at_sizes(setup, one, (2.0,))
    return sized.simulated or one, sized.reason


def _touches(setup: Setup, simulated: SimulatedEffects, job: Job) -> TouchSet:
    seed = seed_of('slip', job.cell, job.size, job.seed)
    assert setup.cell.noise is not None
    if not job.from_streams:
        return simulate(setup, simulated, setup.cell.noise, seed)
    return find_touches(
        simulate_streams(setup.cell, simulated.robot(setup.truth), setup.plan, seed=seed), setup.cell
    ).touches


def lines(records: Sequence[tuple[Job, Record]]) -> list[str]:
    """A line for each cell and size, and one for each record that misses something."""
    out = []
    for cell in dict.fromkeys(job.cell for job, _ in records):
        for size in dict.fromkeys(job.size for job, _ in records if job.cell == cell):
            some = [(job, record) for job, record in records if (job.cell, job.size) == (cell, size)]
            out += _lines_of(f'{cell}, {size or "clean"}', some)
    return out


def _lines_of(title: str, records: Sequence[tuple[Job, Record]]) -> list[str]:
    made = [r for _, r in records if r.verdict]
    out = [f'{title}: {len(made)} of {len(records)}']
    if made and made[0].section == 'clean':
        alarms = [r for r in made if r.verdict != 'none']
        out[0] += f', {len(alarms)} false alarms'
        return out + [f'    seed {r.seed}: {r.verdict} {named_text(r)}' for r in alarms]
    missed = [(r, ' '.join(_misses(r))) for _, r in records if not r.verdict or _misses(r)]
    if made:
        ratio = np.array([r.held_out[1] / r.held_out[2] for r in made])
        before = np.median([r.held_out[0] / r.held_out[2] for r in made])
        out[0] += (
            f', reduced chi-square {np.median([r.chi_square for r in made]):.1f}, named '
            f'{np.mean([correctly_named(r) for r in made]):.0%} (alone '
            f'{np.mean(["alone" in r.naming.values() for r in made]):.0%}), held-out error {before:.2f} before, '
            f'{np.median(ratio):.3f} after ({ratio.max():.3f} at most), largest z {max(r.z[1] for r in made):.1f}'
        )
    return out + [f'    seed {r.seed}: {text} {r.reason or r.error or named_text(r)} {r.values}' for r, text in missed]


def _misses(r: Record) -> list[str]:
    """What a record misses."""
    checks = {'name': correctly_named(r), 'held-out': predicts_like_truth(r), 'z': unbiased(r)}
    return [f'{name} missed' for name, met in checks.items() if not met]


def targets(records: Sequence[tuple[Job, Record]]) -> list[tuple[str, bool]]:
    """The targets, for each cell and size."""
    found = []
    for cell in dict.fromkeys(job.cell for job, _ in records):
        for size in SIZES:
            some = [r for job, r in records if (job.cell, job.size) == (cell, size)]
            if some:
                named = float(np.mean([bool(r.verdict) and correctly_named(r) for r in some]))
                found += [
                    (f'{cell}, {size}: named in {named:.0%} (at least {LEAST_NAMED:.0%})', named >= LEAST_NAMED),
                    (f'{cell}, {size}: held-out error within 5 % in all', all(map(predicts_like_truth, some))),
                    (f'{cell}, {size}: parameters within 4 standard deviations in all', all(map(unbiased, some))),
                ]
    return found


def parse() -> argparse.Namespace:
    """The options."""
    options = parser(__doc__)
    options.add_argument('--effect', choices=list(EFFECTS), default='joint_slip', help='(default: joint_slip)')
    options.add_argument('--seeds', type=int, default=50, help='recordings of each cell and size (default: 50)')
    options.add_argument('--first', type=int, default=0, help='the first seed (default: 0)')
    options.add_argument('--clean', type=int, default=200, help='recordings without effect, in all (default: 200)')
    options.add_argument('--cells', nargs='+', choices=list(CELLS), default=['panda', 'short'])
    options.add_argument('--streams', type=int, default=0, help='from whole recordings, of each (default: 0)')
    options.add_argument('--jobs', type=int, default=1, help='processes (default: 1)')
    return options.parse_args()


def jobs_of(options: argparse.Namespace) -> list[Job]:
    """The recordings to simulate."""
    found, effect = [], options.effect
    for cell in options.cells:
        seeds = range(options.first, options.first + options.seeds)
        found += [Job(cell, size, seed, effect=effect) for size in SIZES for seed in seeds]
        streamed = range(options.first, options.first + options.streams)
        found += [Job(cell, size, seed, from_streams=True, effect=effect) for size in SIZES for seed in streamed]
        clean = range(options.first, options.first + options.clean // len(options.cells))
        found += [Job(cell, '', seed, effect=effect) for seed in clean]
    return found


def main() -> int:
    """Run, print, save."""
    options = parse()
    listed = jobs_of(options)
    records = list(zip(listed, in_processes(run_job, listed, options.jobs), strict=True))
    print('\n'.join(lines(records)))
    met = print_targets(targets(records))
    save(options.json, [{**asdict(job), **asdict(record)} for job, record in records])
    return 0 if met else 1


if __name__ == '__main__':
    sys.exit(main())

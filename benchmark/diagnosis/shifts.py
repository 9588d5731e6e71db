"""Something that shifts at a moment, and cross-talk of the force sensor: names, bias, moments.

    python -m benchmark.diagnosis.shifts [--first N] [--count N] [--clean N] [--cell NAME] [--effect LABEL]
                                         [--json FILE]

Each shift, and cross-talk, in a random way at the size that doubles the reduced chi-square of the base model,
`count` recordings of 108 touches in each of two cells, the noise given. Rows: named alone or among rivals, recordings
in which a base parameter is 4 standard deviations off or more, moments more than 3 touches off. Of a disc only its
own touches count, as the others do not show it. `clean` recordings have no effect: the false alarms are counted.
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from time import process_time

import numpy as np

from benchmark.common import parser, save
from benchmark.diagnosis.cells import SETUPS, SimulatedEffects, at_sizes, random_effect, seed_of, simulate
from benchmark.diagnosis.record import WITHIN
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.effects.registry import catalogue, find
from scara_kinetostatic.errors import ScaraKinetostaticError

KINDS = ('shift', 'sensor_cross_talk')
DOUBLING = 2.0
NEAR = 3.0
"""Touches by which a moment may be off."""


@dataclass
class Row:
    """One recording.

    Attributes:
        cell: name in `SETUPS`.
        label: of the effect; empty for none.
        seed: of its direction, its moment, and the noise.
        verdict: of the diagnosis; `error` where there is none.
        named: ``alone``, ``rivals`` or ``missed``.
        found: what was named, as text.
        z: largest error of a base parameter, standard deviations.
        moment_error: touches that the effect acts on between the true and the stated moment; NaN where none is stated.
        cpu: of the diagnosis, s.
    """

    cell: str
    label: str
    seed: int
    verdict: str = ''
    named: str = 'missed'
    found: str = ''
    z: float = np.nan
    moment_error: float = np.nan
    cpu: float = np.nan


def run(cell: str, label: str, seed: int) -> Row:
    """Simulate and diagnose one recording; an empty label is one without an effect."""
    setup, row = SETUPS[cell], Row(cell, label, seed)
    simulated: SimulatedEffects | None = SimulatedEffects((), ())
    if label:
        one = random_effect(find(setup.cell, label), seed)
        (sized,) = at_sizes(setup, one, (DOUBLING,))
        simulated = sized.simulated
    if simulated is None:
        row.verdict = 'not simulated'
        return row
    try:
        fit = calibrate(simulate(setup, simulated, seed=seed_of('shifts', label, seed)), setup.cell)
        began = process_time()
        found = diagnose(fit)
        row.cpu = process_time() - began
    except ScaraKinetostaticError as error:
        row.verdict, row.found = 'error', str(error)
        return row
    row.verdict = found.verdict
    certain = [item.effect.label for item in found.found if item.is_found]
    row.found = ' + '.join([*certain, *('|'.join(group) for group in found.rivals)])
    if label in certain:
        row.named = 'alone'
    elif any(label in group for group in found.rivals):
        row.named = 'rivals'
    after = found.extended or fit
    row.z = float(np.nanmax(np.abs(after.parameters.as_array() - setup.truth.as_array()) / after.std))
    stated = [v.value for item in found.found if item.effect.is_stepwise for v in item.values if v.name == 'moment']
    if stated and simulated.effects[0].is_stepwise:
        truth, value = float(simulated.values[0][-1]), stated[0]
        names = [disc.name for disc in setup.cell.discs]
        own = fit.touches.disc == names.index(label[6:-1]) if 'disc' in label else np.ones(len(fit.touches), dtype=bool)
        between = (fit.touches.order > min(truth, value)) & (fit.touches.order < max(truth, value))
        row.moment_error = float(np.sum(between & own))
    return row


def lines(rows: list[Row]) -> list[str]:
    """The table."""
    text = [
        f'{"cell":6s} {"effect":20s} {"n":>4s} {"alone":>6s} {"rivals":>6s} {"missed":>6s} {"z>4":>4s} {"moment":>6s}'
    ]
    for cell, label in dict.fromkeys((row.cell, row.label) for row in rows if row.label):
        same = [row for row in rows if (row.cell, row.label) == (cell, label)]
        counts = [sum(row.named == name for row in same) for name in ('alone', 'rivals', 'missed')]
        off = sum(row.z >= WITHIN for row in same), sum(row.moment_error > NEAR for row in same)
        numbers = [len(same), *counts, *off]
        text.append(
            f'{cell:6s} {label:20s} ' + ' '.join(f'{n:{w}d}' for n, w in zip(numbers, (4, 6, 6, 6, 4, 6), strict=True))
        )
    clean = [row for row in rows if not row.label]
    if clean:
        alarms = [row for row in clean if row.verdict != 'none']
        text.append(f'{len(alarms)} false alarms in {len(clean)} recordings without an effect')
        text += [f'  {row.cell} {row.seed}: {row.verdict} {row.found}' for row in alarms]
    text += [
        f'  {row.cell} {row.label} {row.seed}: {row.verdict} {row.found}; z {row.z:.1f}, moment {row.moment_error:g}'
        for row in rows
        if row.label and (row.named == 'missed' or row.z >= WITHIN or row.moment_error > NEAR)
    ]
    return text


def main() -> int:
    """Run, print, save."""
    options = parser(__doc__)
    options.add_argument('--first', type=int, default=0, help='the first seed (default: 0)')
    options.add_argument('--count', type=int, default=40, help='recordings of each effect and cell (default: 40)')
    options.add_argument('--clean', type=int, default=1000, help='recordings without an effect (default: 1000)')
    options.add_argument('--cell', choices=list(SETUPS))
    options.add_argument('--effect', metavar='LABEL', help='only this one')
    chosen = options.parse_args()
    cells = [chosen.cell] if chosen.cell else list(SETUPS)
    rows = []
    for seed in range(chosen.first, chosen.first + chosen.count):
        for cell in cells:
            known = [effect.label for effect in catalogue(SETUPS[cell].cell) if effect.name in KINDS]
            rows += [run(cell, label, seed) for label in known if chosen.effect in (None, label)]
        save(chosen.json, [asdict(row) for row in rows])
    for number in range(chosen.clean):
        rows.append(run(cells[number % len(cells)], '', chosen.first + number // len(cells)))
        if number % 50 == 49:
            save(chosen.json, [asdict(row) for row in rows])
    save(chosen.json, [asdict(row) for row in rows])
    print('\n'.join(lines(rows)))
    return 0


if __name__ == '__main__':
    sys.exit(main())

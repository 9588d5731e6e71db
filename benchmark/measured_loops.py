"""Measured force–displacement loops: whether the reversals of each loop agree, and if not, why.

    python -m benchmark.measured_loops FOLDER [--json FILE]

FOLDER holds CSV files with the columns time_s, displacement_m, force_N. For the gap and the
compliance of every reversal, by loop and by sense, four scatters are set side by side:

- reading: what the noise of the readings, from the stretch where nothing moves, would make;
- line: what the residuals of the straight lines give, the stated uncertainty;
- sampling: the slowest reversal's curve, read at the very places where the others were sampled;
- repeat: among reversals at the same place;

and the scatter found, its variance component beyond `line`, and its trend over the speed in the gap.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from scara_kinetostatic.studies.dial_gauge.analysis import sense_name
from scara_kinetostatic.studies.dial_gauge.loop_analysis import LoopAnalysis, Sense, analyse_loops, find_sweeps
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings, load_readings
from scara_kinetostatic.studies.dial_gauge.statistics import combine_estimates

_QUANTITIES = {'gap': (1e6, 'µm'), 'compliance': (1e9, 'nm/N')}


def replayed(readings: DialGaugeReadings, analysis: LoopAnalysis) -> dict[int, tuple[float, float]]:
    """Scatter of gap and compliance, by sense, if every reversal followed the curve of the slowest one."""
    force = np.array(readings.force)
    sweeps = find_sweeps(readings.time, readings.displacement, readings.force)
    for sense in analysis.senses:
        slowest = min(sense.reversals, key=lambda each: each.speed).time
        used = {each.time for each in sense.reversals}
        pattern = next(sweep for sweep in sweeps if sweep.time[0] == slowest)
        end = int(np.argmax(pattern.force >= 0.75 * abs(sense.plateau)))
        distance, keep = np.unique(np.maximum.accumulate(pattern.distance[: end + 1]), return_index=True)
        curve = PchipInterpolator(distance, pattern.force[: end + 1][keep])
        for sweep in (sweep for sweep in sweeps if float(sweep.time[0]) in used):
            start = int(np.searchsorted(readings.time, sweep.time[0]))
            rows = np.flatnonzero(sweep.distance <= distance[-1])
            force[start + rows] = sense.sense * curve(np.clip(sweep.distance[rows], 0, distance[-1]))
    again = analyse_loops(readings.time, readings.displacement, force)
    return {sense.sense: (scatter(sense, 'gap'), scatter(sense, 'compliance')) for sense in again.senses}


def scatter(sense: Sense, name: str) -> float:
    """Standard deviation among the reversals."""
    return float(np.std([getattr(each, name).value for each in sense.reversals], ddof=1))


def examine(path: Path) -> list[dict[str, object]]:
    """One record per sense and quantity of a file."""
    readings = load_readings(path)
    analysis = analyse_loops(readings.time, readings.displacement, readings.force)
    sampling = replayed(readings, analysis)
    records = []
    for sense in analysis.senses:
        for place, (name, (factor, unit)) in enumerate(_QUANTITIES.items()):
            values, line = np.array([getattr(each, name) for each in sense.reversals]).T
            slope = float(np.mean([each.compliance.value for each in sense.reversals]))
            one = float(np.hypot(analysis.noise[0], slope * analysis.noise[1]))
            reading = line * one / np.array(sense.sigma).mean()
            test, bare = getattr(sense, name), combine_estimates(values, reading, np.inf)
            trend = next(each for each in sense.trends if each.quantity == name and each.variable == 'speed')
            zero_drift = next(each for each in sense.trends if each.quantity == name and each.variable == 'time')
            records.append(
                {
                    'file': path.name,
                    'sense': sense_name(sense),
                    'quantity': name,
                    'unit': unit,
                    'reversals': len(values),
                    'mean': factor * test.mean,
                    'std': factor * test.std,
                    'definition': factor * sense.definitional_uncertainty[place],
                    'scatter': factor * scatter(sense, name),
                    'reading': factor * float(np.sqrt((reading**2).mean())),
                    'line': factor * float(np.sqrt((line**2).mean())),
                    'sampling': factor * sampling[sense.sense][place],
                    'repeat': factor * sense.repeatability[place],
                    'p_line': test.p_value,
                    'between_line': factor * test.between,
                    'p_reading': bare.p_value,
                    'between_reading': factor * bare.between,
                    'per_mm_s': 1e-3 * factor * trend.slope.value,
                    'per_mm_s_std': 1e-3 * factor * trend.slope.std,
                    'p_speed': trend.p_value,
                    'left_after_speed': factor * trend.left,
                    'p_time': zero_drift.p_value,
                }
            )
    return records


def table(records: list[dict[str, object]]) -> str:
    """The records, one line each."""
    columns = (
        ('file', '16'), ('sense', '8'), ('quantity', '11'), ('unit', '5'), ('mean', '7.0f'), ('std', '5.0f'),
        ('definition', '11.0f'), ('reading', '8.2f'), ('line', '6.1f'), ('sampling', '9.1f'), ('repeat', '7.1f'),
        ('scatter', '8.1f'), ('p_line', '8.2g'), ('between_line', '13.1f'), ('between_reading', '16.1f'),
        ('per_mm_s', '9.2f'), ('p_speed', '8.1g'), ('left_after_speed', '17.1f'), ('p_time', '7.1g'),
    )  # fmt: skip
    lines = [' '.join(f'{name:>{form.split(".")[0]}}' for name, form in columns)]
    lines += [' '.join(f'{record[name]:>{form}}' for name, form in columns) for record in records]
    return '\n'.join(lines)


def main() -> int:
    """Runs the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('folder', type=Path)
    parser.add_argument('--json', type=Path, help='write the records there')
    args = parser.parse_args()
    records = [record for path in sorted(args.folder.glob('*.csv')) for record in examine(path)]
    if not records:
        parser.error(f'{args.folder}: no CSV file in it')
    print(table(records))
    if args.json:
        args.json.write_text(json.dumps(records, indent=2, ensure_ascii=False) + '\n', encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())

"""The fit beside its peers: this package, SciPy, CasADi with IPOPT, on the same touches, in one run, on one core.

    python -m benchmark.peers [--touches N …] [--json FILE] [--plot FILE]

Each contender solves each number of touches in a process of its own. Times are processor times of one thread: median
and quartiles of several runs; the preparation of a contender is stated apart. `contenders` describes each.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.common import in_processes, machine, parser, save, svg_figure
from benchmark.peers.contenders import measure

TOUCHES = (36, 360, 3600, 36_000, 360_000, 1_000_000)
MOST = {'casadi angles': 3600, 'casadi forces': 3600, 'scipy': 36, 'scipy scalars': 3600}
"""Largest number of touches for contenders that beyond it take minutes or many gigabytes."""
OURS = ('package', 'minimisation')
COLOURS = {
    'package': '#0b6e99',
    'minimisation': '#56b4e9',
    'casadi angles': '#d55e00',
    'casadi forces': '#e69f00',
    'scipy': '#666666',
    'scipy scalars': '#aaaaaa',
}


def compare(numbers: list[int], contenders: list[str]) -> list[dict[str, Any]]:
    """All contenders on all numbers of touches."""
    jobs = [(name, count) for count in numbers for name in contenders if count <= MOST.get(name, count)]
    records = []
    for record in in_processes(measure, jobs, fresh=True):
        records.append(record)
        print(line(record), flush=True)
    return records


def line(record: dict[str, Any]) -> str:
    """One record as text."""
    lower, upper = (1e3 * value for value in record['quartiles'])
    build = f', build {1e3 * record["build"]:.0f} ms' if record['build'] else ''
    return (
        f'{record["touches"]:>8} touches  {record["contender"]:<14} {1e3 * record["median"]:10.2f} ms '
        f'({lower:.2f} … {upper:.2f}, {record["runs"]} runs){build}, {record["iterations"]} iterations, '
        f'peak {record["peak"] / 2**20:.0f} MiB{"" if record["success"] else ", NOT CONVERGED"}'
    )


def summarise(records: list[dict[str, Any]]) -> dict[str, Any]:
    """How many times faster than each peer, how far the optima lie apart, exponent of time over touches."""
    found = {(record['contender'], record['touches']): record for record in records}
    summary: dict[str, Any] = {'faster': {}, 'slope': {}, 'difference': {}}
    for (name, count), record in found.items():
        if name in OURS:
            continue
        for own in OURS:
            if (own, count) in found:
                ratio = record['median'] / found[own, count]['median']
                summary['faster'][f'{own} against {name}, {count} touches'] = round(ratio, 2)
        if ('minimisation', count) in found:
            values, ours = np.array(record['values']), np.array(found['minimisation', count]['values'])
            summary['difference'][f'{name}, {count} touches'] = float(np.abs(values - ours).max())
    for own in OURS:
        large = [(count, found[own, count]['median']) for _, count in found if (own, count) in found and count >= 1000]
        large = sorted(set(large))
        if len(large) > 1:
            counts, seconds = np.log(np.array(large)).T
            summary['slope'][own] = round(float(np.polyfit(counts, seconds, 1)[0]), 3)
    return summary


def draw(records: list[dict[str, Any]], path: Path) -> None:
    """Median time of each contender over the number of touches, with the quartiles; both axes logarithmic."""
    with svg_figure(path, 6.4, 4.0) as figure:
        axes = figure.add_subplot()
        for name in dict.fromkeys(record['contender'] for record in records):
            rows = sorted((r for r in records if r['contender'] == name), key=lambda record: int(record['touches']))
            touches, median = [r['touches'] for r in rows], np.array([r['median'] for r in rows])
            error = np.abs(np.array([r['quartiles'] for r in rows]) - median[:, None]).T
            axes.errorbar(touches, median, error, marker='o', ms=4, lw=1.2, color=COLOURS[name], label=name)
        axes.set(xscale='log', yscale='log', xlabel='touches', ylabel='processor time, s')
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)


def main() -> int:
    """Runs the benchmark."""
    options_of = parser(__doc__, plot=True)
    options_of.add_argument('--touches', type=int, nargs='+', default=list(TOUCHES))
    options_of.add_argument('--contenders', nargs='+', default=[*OURS, *MOST], choices=[*OURS, *MOST])
    options = options_of.parse_args()
    before = machine()
    records = compare(options.touches, options.contenders)
    figures = {'before': before, 'after': machine(), 'summary': summarise(records)}
    print(json.dumps(figures, indent=2, ensure_ascii=False))
    save(options.json, {**figures, 'records': records})
    if options.plot:
        draw(records, options.plot)
    return 0


if __name__ == '__main__':
    sys.exit(main())

"""The fit against its peers: this package, SciPy, CasADi with IPOPT, on the same touches, in one run, on one core.

    python -m benchmark.peers [--touches N …] [--json FILE] [--plot FILE]

Each contender solves each number of touches in a process of its own. Times are processor times of one thread: the
median of several runs, its quartiles beside it; what a contender prepares beforehand is stated apart. What each one
does is said in `peers_solvers`.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.peers_timing import ONE_CORE, forget_peak, machine, peak_memory, repeat

TOUCHES = (36, 360, 3600, 36_000, 360_000, 1_000_000)
MOST = {'casadi angles': 3600, 'casadi forces': 3600, 'scipy': 36, 'scipy scalars': 3600}
"""Touches beyond which a contender takes minutes or memory that nobody would spend."""
OURS = ('package', 'minimisation')


def measure(job: tuple[str, int]) -> dict[str, Any]:
    """Time one contender on one number of touches; runs in a process of its own."""
    from benchmark.peers_problem import draw
    from benchmark.peers_solvers import CONTENDERS

    warnings.simplefilter('ignore', RuntimeWarning)  # of fsolve, about touches on the way
    name, count = job
    ready = CONTENDERS[name](draw(count))
    forget_peak()
    answer = ready.solve()
    record = {'contender': name, 'touches': count, 'build': ready.build, **repeat(ready.solve)}
    values = answer.values.tolist()
    return {
        **record,
        'peak': peak_memory(),
        'iterations': answer.iterations,
        'success': answer.success,
        'values': values,
    }


def compare(numbers: list[int], contenders: list[str]) -> list[dict[str, Any]]:
    """All contenders on all numbers of touches."""
    jobs = [(name, count) for count in numbers for name in contenders if count <= MOST.get(name, count)]
    os.environ.update(ONE_CORE)
    records = []
    with multiprocessing.get_context('spawn').Pool(1, maxtasksperchild=1) as pool:
        for record in pool.imap(measure, jobs):
            records.append(record)
            print(line(record), flush=True)
    return records


def line(record: dict[str, Any]) -> str:
    """One record in words."""
    lower, upper = (1e3 * value for value in record['quartiles'])
    build = f', build {1e3 * record["build"]:.0f} ms' if record['build'] else ''
    return (
        f'{record["touches"]:>8} touches  {record["contender"]:<14} {1e3 * record["median"]:10.2f} ms '
        f'({lower:.2f} … {upper:.2f}, {record["runs"]} runs){build}, {record["iterations"]} iterations, '
        f'peak {record["peak"] / 2**20:.0f} MiB{"" if record["success"] else ", NOT CONVERGED"}'
    )


def summarise(records: list[dict[str, Any]]) -> dict[str, Any]:
    """How many times faster than each peer, how far the optima lie apart, and how time grows with touches."""
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


def main() -> int:
    """Run, print, save, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--touches', type=int, nargs='+', default=list(TOUCHES))
    parser.add_argument('--contenders', nargs='+', default=[*OURS, *MOST], choices=[*OURS, *MOST])
    parser.add_argument('--json', type=Path)
    parser.add_argument('--plot', type=Path, help='SVG')
    options = parser.parse_args()
    before = machine()
    records = compare(options.touches, options.contenders)
    result = {'before': before, 'after': machine(), 'summary': summarise(records), 'records': records}
    print(json.dumps({key: result[key] for key in ('before', 'after', 'summary')}, indent=2, ensure_ascii=False))
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + '\n', encoding='utf-8')
    if options.plot:
        from benchmark.peers_picture import draw_times

        draw_times(records, options.plot)
    return 0


if __name__ == '__main__':
    sys.exit(main())

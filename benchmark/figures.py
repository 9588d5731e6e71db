"""Measures figures of docs/figures.md and writes them into the page, with the commit that they were measured at.

    python -m benchmark.figures [COMMAND...] [--out DIR]

A row is found by its command, as `peers` or `drift --only changes` without `benchmark.`; without arguments all of
`FIGURES` are measured, which takes hours. Refused where the checkout has changes that are not committed. The other rows
state what their commands print.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.common import parser
from benchmark.statistics.outliers import LARGE
from scara_kinetostatic.model.parameters import NAMES

ROOT = Path(__file__).parents[1]
PAGE = ROOT / 'docs' / 'figures.md'


def main() -> int:
    """Measure, write."""
    options = parser(__doc__, json_file=False)
    options.add_argument('commands', nargs='*', metavar='COMMAND', help='these alone')
    options.add_argument('--out', type=Path, metavar='DIR', help='keep the JSON files there')
    given = options.parse_args()
    if unknown := set(given.commands) - set(FIGURES):
        sys.exit(f'expected commands of {", ".join(FIGURES)}, got {", ".join(sorted(unknown))}')
    if _git('status', '--porcelain'):
        sys.exit('the checkout has changes: commit them first, as the page states the commit')
    commit = _git('rev-parse', '--short=8', 'HEAD')
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.out or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for command in given.commands or FIGURES:
            file = folder / f'{re.sub("[^a-z0-9]+", "_", command)}.json'
            arguments = [sys.executable, '-m', f'benchmark.{command.split()[0]}', *command.split()[1:]]
            done = subprocess.run([*arguments, '--json', str(file)], cwd=ROOT, check=False, stdout=subprocess.DEVNULL)
            if done.returncode not in (0, 1):  # 1: a target was missed; the figure says by how much
                sys.exit(f'{command} ended with {done.returncode}')
            found = json.loads(file.read_text(encoding='utf-8'))
            figures = [figure(found) for figure in FIGURES[command]]
            PAGE.write_text(with_figures(PAGE.read_text(encoding='utf-8'), command, figures, commit), encoding='utf-8')
            print(command, *figures, sep='\n  ')
    return 0


def with_figures(page: str, command: str, figures: Iterable[str], commit: str) -> str:
    """The page with figures in the rows of a command, in their order.

    Raises:
        ValueError: the page has another number of such rows.
    """
    row = re.compile(rf'^(\| [^|]+ \| `benchmark\.{re.escape(command)}` \|)[^|]*\|([^|]*\|)[^|]*\|$', re.MULTILINE)
    left = list(figures)
    if len(row.findall(page)) != len(left):
        raise ValueError(f'expected {len(left)} rows of `benchmark.{command}` in {PAGE}, got {len(row.findall(page))}')
    return row.sub(lambda found: f'{found[1]} {left.pop(0)} |{found[2]} {commit} |', page)


def _git(*arguments: str) -> str:
    return subprocess.run(['git', *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def _span(values: Iterable[float], form: str, unit: str = '') -> str:
    """From the smallest to the largest."""
    listed = sorted(values)
    ends = dict.fromkeys(format(value, form) for value in (listed[0], listed[-1]))
    return ' to '.join(ends) + unit


def _rms_of_z(records: Sequence[Any], *by: str) -> list[float]:
    """Of each parameter in each group of records."""
    groups: dict[tuple[Any, ...], list[Any]] = {}
    for record in records:
        groups.setdefault(tuple(record[key] for key in by), []).append(record['z'])
    of_each = [np.sqrt(np.nanmean(np.array(z, dtype=float) ** 2, axis=0)) for z in groups.values()]
    return np.concatenate(of_each).tolist()


def _variances(found: Any) -> str:
    cases = found['efficiency'].values()
    most = max(value for case in cases for value in case['variance_over_bound'].values())
    return f'at most {most:.3f} (sampling error {100 * max(case["sampling_error"] for case in cases):.1f} %)'


def _intervals(found: Any) -> str:
    shares = (100 * case['coverage']['normal'][name] for case in found['coverage'].values() for name in NAMES)
    return f'contain the truth in {_span(shares, ".1f", " %")}'


def _outliers(found: Any) -> str:
    cases = [setup['cases'][kind.label] for setup in found['outliers'].values() for kind in LARGE]
    named, bad = (sum(case[key] for case in cases) for key in ('named', 'bad'))
    growth = max(case['growth_rms'] for case in cases)
    return f'{named} of {bad} named; standard deviations grow by at most {100 * growth:.0f} % (rms of the parameters)'


def _peers(found: Any) -> str:
    def seconds(touches: int, prefix: str) -> str:
        rows = [row for row in found['records'] if row['touches'] == touches and row['contender'].startswith(prefix)]
        milliseconds = [1e3 * row['median'] for row in rows]
        return _span(milliseconds, '.1f' if max(milliseconds) < 20 else '.0f', ' ms')

    return '; '.join(
        f'{n} touches: {seconds(n, "package")} with all checks, CasADi and IPOPT {seconds(n, "casadi")}, SciPy '
        f'{seconds(n, "scipy")}'
        for n in (36, 3600)
    )


def _fits(found: Any) -> str:
    rms, most = _rms_of_z(found, 'cell', 'kind', 'noise'), max(abs(z) for row in found for z in row['z'] if z)
    return f'rms {_span(rms, ".2f")} for each parameter, at most {most:.1f}'


def _population(found: Any) -> str:
    rows: dict[tuple[Any, ...], list[Any]] = {}
    for record in found:
        if 'failure' not in record:
            rows.setdefault((record['kind'], record['factor'], record['declared']), []).append(record)
    held, known = (
        [100 * np.mean([of(record)['coverage'] for record in row]) for row in rows.values()]
        for of in (lambda record: record, lambda record: record['bound'])
    )
    ratios = [float(np.median([record['ratio'] for record in row])) for row in rows.values()]
    worst = max(record['error'] for row in rows.values() for record in row)
    return (
        f'holds in {_span(held, ".0f", " %")} of the places, by row ({_span(known, ".0f", " %")} with the true sizes '
        f'known); {_span(ratios, ".2f")} (medians of the rows); the worst of {len(found)} robots '
        f'{1e3 * worst:.2f} mm off (median of its places)'
    )


def _lone_flaws(found: Any) -> str:
    shown = [record for record in found if record.get('shows')]
    named, within = sum(record['named'] for record in shown), sum(record['z'] <= 5 for record in shown)
    return f'the touches of {len(shown)} show it: {named} named, {within} within 5 standard uncertainties'


def _noise(found: Any) -> str:
    alarms, rows = sum(row['alarms'] for row in found['rows']), found['rows']
    plural = '' if alarms == 1 else 's'
    return f'{alarms} false alarm{plural}; errors {_span((row["z"] for row in rows), ".2f")} standard deviations (rms)'


def _compensation(found: Any) -> str:
    shares = (100 * share for case in found['coverage'].values() for share in case.values())
    return f'coverage of 1.96 standard uncertainties {_span(shares, ".1f", " %")}'


def _changes(found: Any) -> str:
    rows = found['changes, declared']
    least = min(rows, key=lambda name: float(rows[name]['raised']))
    others = _span((100 * row['raised'] for name, row in rows.items() if name != least), '.0f', ' %')
    raised, bound = (100 * rows[least][key] for key in ('raised', 'bound'))
    return (
        f'{others} within 20 touches, but for `{least}` ({raised:.1f} %; no method could show more than {bound:.0f} %)'
    )


def _alarms(found: Any) -> str:
    return f'at most {max(row["per 1000"] for row in found.values()):.2f} in 1000 touches'


def _p_values(found: Any) -> str:
    shares, uniform = ([row[key] for row in found.values()] for key in ('below 0.01', 'KS p-value'))
    below = _span((100 * share for share in shares), '.1f', ' %')
    return f'{below} below 0.01; uniform (Kolmogorov–Smirnov): p at least {min(uniform):.2g} in {len(uniform)} cases'


def _reading(found: Any) -> str:
    times = {row['reader']: f'{float(np.median(row["processor_seconds"])):.2g} s' for row in found['records']}
    same = found['summary']['same arrays, to the last bit']
    listed = ', '.join(f'`{reader}` {time}' for reader, time in times.items() if reader != 'package')
    return f'{times["package"]}; {listed}; {"the same" if same else "DIFFERENT"} arrays'


def _hostile(found: Any) -> str:
    seconds, memory = (max(row[key] for row in found.values()) for key in ('seconds', 'megabytes'))
    return f'{len(found)} files: at most {seconds:.1f} s, {memory:.0f} MB'


def _fuzz(found: Any) -> str:
    failures = len(found['failures'])
    return f'{failures} failures; at most {found["slowest"]:.1f} s, {found["largest"] / 1e6:.0f} MB'


def _export(found: Any) -> str:
    return f'the tip of H(L̄, Q) to {max(found.values()):.0e} m'


Figure = Callable[[Any], str]
FIGURES: dict[str, tuple[Figure, ...]] = {
    'statistics': (_variances, _intervals, _outliers),
    'peers': (_peers,),
    'uncertainty --show fits --first 46000 --count 800': (_fits,),
    'population --robots 6 --first 70001': (_population,),
    'compensation': (_compensation,),
    'lone_flaws --first 640': (_lone_flaws,),
    'noise --only growing --number 67 --first 20000': (_noise,),
    'drift --only changes': (_changes,),
    'drift --only alarms bad': (_alarms,),
    'drift --only compare verify': (_p_values,),
    'reading': (_reading,),
    'faults.hostile': (_hostile,),
    'faults.fuzz': (_fuzz,),
    'export': (_export,),
}
"""By the command without `benchmark.`: its rows in their order on the page."""

if __name__ == '__main__':
    sys.exit(main())

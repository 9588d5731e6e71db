"""Timing one contender in a process of its own: processor time of several runs, peak memory, what the machine did."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

LEAST_SECONDS = 2.0
"""Runs are repeated for so long, within the limits below."""
LEAST_RUNS, MOST_RUNS = 3, 200
ONE_CORE = dict.fromkeys(('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'), '1')


def repeat(run: Callable[[], object]) -> dict[str, Any]:
    """Processor time of several runs after one that does not count, s: median, quartiles, extremes."""
    begin = time.process_time()
    run()
    first = time.process_time() - begin
    number = int(np.clip(LEAST_SECONDS / max(first, 1e-9), LEAST_RUNS, MOST_RUNS)) if first < 20 else 1
    seconds = []
    for _ in range(number):
        begin = time.process_time()
        run()
        seconds.append(time.process_time() - begin)
    least, lower, median, upper, largest = np.quantile(seconds, [0, 0.25, 0.5, 0.75, 1]).tolist()
    return {
        'runs': number,
        'median': median,
        'quartiles': [lower, upper],
        'extremes': [least, largest],
        'first': first,
    }


def forget_peak() -> None:
    """Let the peak of memory begin anew, where the system can do that."""
    with suppress(OSError):
        Path('/proc/self/clear_refs').write_text('5', encoding='ascii')


def peak_memory() -> int:
    """Peak resident memory of this process, bytes; 0 where the system does not tell."""
    try:
        status = Path('/proc/self/status').read_text(encoding='ascii')
    except OSError:
        return 0
    return next(1024 * int(line.split()[1]) for line in status.splitlines() if line.startswith('VmHWM'))


def machine() -> dict[str, Any]:
    """What it ran on, and how busy that was."""
    lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines() if Path('/proc/cpuinfo').exists() else []
    model = next((line.split(':')[1].strip() for line in lines if line.startswith('model name')), platform.processor())
    return {
        'processor': model,
        'cores': os.cpu_count(),
        'load': [round(value, 1) for value in os.getloadavg()],
        'python': platform.python_version(),
        'numpy': np.__version__,
    }

"""Two cells side by side, each in a namespace of its own: the pattern for any number of them.

`ros2 launch scara_kinetostatic two_cells.launch.py` simulates both. For real ones `simulate:=false left_cell:=…
right_cell:=…`; topics that the cell descriptions name without a leading slash are in the namespace of their cell. The
arguments are those of `cell.launch.py`: what belongs to one robot has `left_` or `right_` before its name, folders get
a folder of each cell.
"""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction

ONE = runpy.run_path(str(Path(__file__).with_name('cell.launch.py')))
NAMES = ('left', 'right')
OWN = ('cell', 'preload', 'calibration', 'recording', 'plan', 'effects', 'seed')
"""Arguments that each cell has for itself."""


COMMON = [name for name in ONE['ARGUMENTS'] if name not in (*OWN, 'namespace')]


def generate_launch_description() -> LaunchDescription:
    """Both cells."""
    own = [each for k, name in enumerate(NAMES) for each in ONE['declared'](OWN, f'{name}_', seed=str(k))]
    return LaunchDescription([*own, *ONE['declared'](COMMON, recordings='recordings'), OpaqueFunction(function=_start)])


def _start(context: LaunchContext) -> list[Any]:
    """Both, with folders apart.

    Raises:
        RuntimeError: what belongs to one cell is given to both; the launch ends with this line.
    """
    given, shared = context.launch_configurations, ONE['values_in'](context)
    for name in OWN:
        if name in given:
            raise RuntimeError(
                f'{name} belongs to one cell: give {" and ".join(f"{each}_{name}:=…" for each in NAMES)}'
            )
    if shared['namespace']:
        raise RuntimeError(f'namespace: the cells are in {" and ".join(NAMES)}; leave it out')
    cells = []
    for name in NAMES:
        own = {each: given[f'{name}_{each}'] for each in OWN}
        folders = {each: f'{shared[each]}/{name}' for each in ('recordings', 'output', 'enclaves') if shared[each]}
        cells.append(ONE['CellNodes'](shared | own | folders | {'namespace': name}))
    names = [*COMMON, *(f'{name}_{each}' for name in NAMES for each in OWN)]
    started: list[Any] = ONE['actions_of'](context, *cells, names=names)
    return started

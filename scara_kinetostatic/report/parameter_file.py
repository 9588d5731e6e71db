"""`calibration.yaml`: the result as ROS parameters, for `--params-file`.

The names are those of the node `calibrator`: `calibrated.<name>` and `calibrated_std.<name>`. A standard deviation
that the data do not determine is `.nan`.
"""

from __future__ import annotations

import math

from scara_kinetostatic.calibration.solution import Calibration
from scara_kinetostatic.model.parameters import DESCRIPTIONS, NAMES, UNITS
from scara_kinetostatic.pipeline import Outcome

NAME = 'calibration.yaml'


def parameter_text(outcome: Outcome) -> str:
    """The ROS parameter file."""
    c = outcome.calibration
    lines = [
        '# Result of a kinetostatic calibration, SI units. Load it into a node by',
        '#   ros2 run PACKAGE NODE --ros-args --params-file calibration.yaml',
        *(f'# from {_comment(source)}' for source in outcome.sources),
        '/**:',
        '  ros__parameters:',
        '    calibrated:',
        *(f'      {name}: {_real(value)}  # {_meaning(name, c)}' for name, value in c.parameters.as_dict().items()),
        '    calibrated_std:',
        *(f'      {name}: {_real(c.std_of(name))}' for name in NAMES),
    ]
    return '\n'.join(lines) + '\n'


def _meaning(name: str, c: Calibration) -> str:
    status = {
        'estimated': '',
        'fixed': '; held at this value',
        'confounded': '; these data do not determine it',
    }
    return f'{UNITS[name]}, {DESCRIPTIONS[name]}{status[c.status[name]]}'


def _comment(text: str) -> str:
    """On one line, whatever the name of a file may hold."""
    return ''.join(character if character.isprintable() else '?' for character in text)


def _real(value: float) -> str:
    """A number that every YAML reader takes for a real one: with a point, even before an exponent."""
    if math.isnan(value):
        return '.nan'
    text = repr(float(value))
    if 'e' in text and '.' not in text:
        return text.replace('e', '.0e')
    return text

"""`calibration.yaml`: the result as ROS parameters, for `--params-file`.

The names are those of the node `calibrator`: `calibrated.<name>` and `calibrated_std.<name>`, and for what was
found beyond the twelve `effects.<name>.<target>.<parameter>` and `effects_std…`. A standard deviation that the
data do not determine is `.nan`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import groupby

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.outcome import Outcome
from scara_kinetostatic.model.parameters import DESCRIPTIONS, NAMES, UNITS
from scara_kinetostatic.report.effect_parameters import DEVIATION, VALUE, EffectParameter, effect_parameters

NAME = 'calibration.yaml'


def parameter_text(outcome: Outcome) -> str:
    """The ROS parameter file."""
    c, effects = outcome.final, effect_parameters(outcome.diagnosis.found)
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
        *_effects(VALUE, effects, lambda item: f'{_real(item.value)}  # {_comment(f"{item.unit}, {item.meaning}")}'),
        *_effects(DEVIATION, effects, lambda item: _real(item.std)),
    ]
    return '\n'.join(lines) + '\n'


def _effects(group: str, items: Sequence[EffectParameter], text: Callable[[EffectParameter], str]) -> list[str]:
    """The branch of the tree with one number per parameter of an effect; nothing where there is none."""
    lines = [f'    {group}:'] if items else []
    for name, same in groupby(sorted(items, key=lambda item: item.path[0]), lambda item: item.path[0]):
        lines.append(f'      {_key(name)}:')
        for target, members in groupby(same, lambda item: item.path[1]):
            lines.append(f'        {_key(target)}:')
            lines += [f'          {_key(item.path[2])}: {text(item)}' for item in members]
    return lines


def _key(word: str) -> str:
    """A key that no YAML reader takes for a number or a truth value."""
    plain = word[:1].isalpha() and word.lower() not in ('y', 'n', 'yes', 'no', 'on', 'off', 'true', 'false', 'null')
    return word if plain else f'"{word}"'


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

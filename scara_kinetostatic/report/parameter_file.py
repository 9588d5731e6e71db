"""`calibration.yaml`: the result as ROS parameters, for `--params-file`.

The names are those of the node `calibrator`: `calibrated.<name>` and `calibrated_std.<name>`, and for the effects
that were found `effects.<name>.<target>.<parameter>` and `effects_std…`. An effect without a target has `all` there, a
fitted curve its channel and variable; whatever is not a letter, a digit or `_` becomes `_`. A standard deviation that
the data do not determine is `.nan`. `calibration.<name>` says what they are made from and worth (`facts`); a list
without entries is left out, as it has no type in ROS.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.result import Found
from scara_kinetostatic.model.parameters import DESCRIPTIONS, NAMES, UNITS
from scara_kinetostatic.report.facts import FACTS, GROUP, Value, facts

NAME = 'calibration.yaml'
EFFECTS, EFFECTS_STD = 'effects', 'effects_std'
_NOT_ALLOWED = re.compile(r'[^A-Za-z0-9_]+')


class EffectParameter(NamedTuple):
    """One parameter of one effect.

    Attributes:
        path: name of the effect, target, name of the parameter; unique.
        value: estimate.
        std: standard deviation; NaN where the data do not determine it.
        unit: of both.
        meaning: in a few words.
    """

    path: tuple[str, str, str]
    value: float
    std: float
    unit: str
    meaning: str


def effect_parameters(found: Sequence[Found]) -> list[EffectParameter]:
    """All parameters of the effects found, effect by effect."""
    rows: list[EffectParameter] = []
    taken: set[tuple[str, str]] = set()
    for item in found:
        name, target = _word(item.effect.name), _word(item.effect.subject)
        number, place = 1, (name, target)
        while place in taken:
            number += 1
            place = (name, f'{target}_{number}')
        taken.add(place)
        doubt = ' (possible, not proved)' if item.is_possible else ''
        rows += [
            EffectParameter((*place, _word(v.name)), v.value, v.std, v.unit, v.meaning + doubt) for v in item.values
        ]
    return rows


def _word(text: str) -> str:
    return _NOT_ALLOWED.sub('_', text)


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
        *_effects(EFFECTS, effects, lambda item: f'{_real(item.value)}  # {_comment(f"{item.unit}, {item.meaning}")}'),
        *_effects(EFFECTS_STD, effects, lambda item: _real(item.std)),
        f'    {GROUP}:',
        *_facts(facts(outcome)),
    ]
    return '\n'.join(lines) + '\n'


def _facts(values: Mapping[str, Value]) -> list[str]:
    """The branch of the tree that says what the result is made from and worth; no lists without entries."""
    lines = []
    given = {name: value for name, value in values.items() if value != []}
    for head, names in groupby(given, lambda name: name.rpartition('.')[0]):
        lines += [f'      {head}:'] if head else []
        for name in names:
            indent = '        ' if head else '      '
            comment = f'  # {FACTS[name].meaning}' if isinstance(given[name], (int, float)) else ''
            lines.append(f'{indent}{name.rpartition(".")[2]}: {_plain(given[name])}{comment}')
    return lines


def _plain(value: Value) -> str:
    """Any value of a ROS parameter in YAML."""
    if isinstance(value, list):
        return f'[{", ".join(map(_plain, value))}]'
    if isinstance(value, str):
        return json.dumps(_comment(value), ensure_ascii=False)
    return _real(value) if isinstance(value, float) else str(value)


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
    if not math.isfinite(value):
        return '.nan'
    text = repr(float(value))
    if 'e' in text and '.' not in text:
        return text.replace('e', '.0e')
    return text

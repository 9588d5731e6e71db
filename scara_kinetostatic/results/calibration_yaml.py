"""`calibration.yaml`: the result as ROS parameters, for `--params-file`.

The names are those of the node `calibrator`: `calibrated.<name>` and `calibrated_std.<name>`, and for the effects
that were found `effects.<name>.<target>.<parameter>` and `effects_std…`. An effect without a target has `all` there, a
fitted curve its channel and variable; whatever is not a letter, a digit or `_` becomes `_`. A standard deviation that
the data do not determine is `.nan`. `calibration.<name>` says what they are made from and worth (`facts`); a list
without entries is left out, as it has no type in ROS. What the numbers mean stands above them, as comments.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from scara_kinetostatic.assessment.outcome import Outcome, rivals_in_words
from scara_kinetostatic.diagnosis.result import Found, Value
from scara_kinetostatic.errors import ParameterError, one_line
from scara_kinetostatic.files.yaml_file import dump_yaml, parse_yaml, read_text
from scara_kinetostatic.model.parameters import DESCRIPTIONS, MOMENTS, NAMES, UNITS
from scara_kinetostatic.report.json_file import utc

NAME = 'calibration.yaml'
EFFECTS, EFFECTS_STD = 'effects', 'effects_std'


def effect_parameters(found: Sequence[Found]) -> dict[tuple[str, str, str], Value]:
    """All parameters of the effects found: value by name of the effect, target and name, which are unique."""
    values: dict[tuple[str, str, str], Value] = {}
    taken: set[tuple[str, str]] = set()
    for item in found:
        name, target = _word(item.effect.name), _word(item.effect.label.partition('[')[2][:-1] or 'all')
        places = ((name, f'{target}_{number}' if number > 1 else target) for number in count(1))
        taken.add(place := next(place for place in places if place not in taken))
        values |= {(*place, _word(value.name)): value for value in item.values}
    return values


def _word(text: str) -> str:
    return re.sub(r'[^A-Za-z0-9_]+', '_', text)


class StoredResult(NamedTuple):
    """What a parameter file of a result holds.

    Attributes:
        values: the parameters in the order of `Parameters.names`.
        deviations: their standard deviations; NaN where there is none.
        facts: what the result is made from and worth, by the names of `FACTS`; as far as the file says so.
    """

    values: list[float]
    deviations: list[float]
    facts: dict[str, Stated]


def load_result(path: str | Path) -> StoredResult:
    """Read a parameter file of a result.

    Raises:
        ParameterError: it cannot be read, or is no such file.
    """
    tree = parse_yaml(read_text(path, ParameterError), path, ParameterError)
    try:
        given = tree['/**']['ros__parameters']
        names = (*NAMES, *(name for name in MOMENTS if name in given['calibrated']))
        values = [given['calibrated'][name] for name in names]
        if not all(map(math.isfinite, values)):
            raise ValueError(values)
        return StoredResult(
            values=list(map(float, values)),
            deviations=[float(given['calibrated_std'][name]) for name in names],
            facts=_stored_facts(given.get(GROUP)),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        remedy = f'expected what calibrate writes as {NAME}'
        raise ParameterError(path, 'is no result of a calibration', remedy) from error


def _stored_facts(group: Mapping[str, Any] | None) -> dict[str, Stated]:
    """The facts; a list that the file leaves out has no entries. None where the file has none of them."""
    found: dict[str, Stated] = {}
    for name, fact in FACTS.items() if group is not None else ():
        value: Any = group
        for key in name.split('.'):
            value = value.get(key) if isinstance(value, Mapping) else None
        if value is not None or fact.kind is list:
            found[name] = fact.kind([] if value is None else value)
    return found


def parameter_text(outcome: Outcome) -> str:
    """The ROS parameter file."""
    c, found = outcome.final, outcome.diagnosis.found
    named: dict[str, Any] = {f'calibrated.{name}': value for name, value in c.parameters.as_dict().items()}
    named |= {f'calibrated_std.{name}': c.std_of(name) for name in c.parameters.names}
    of_effects = effect_parameters(found)
    named |= {'.'.join((EFFECTS, *path)): value.value for path, value in of_effects.items()}
    named |= {'.'.join((EFFECTS_STD, *path)): value.std for path, value in of_effects.items()}
    named |= {f'{GROUP}.{name}': value for name, value in facts(outcome).items() if value != []}
    status = {'estimated': '', 'fixed': '; held at this value', 'confounded': '; these data do not determine it'}
    comments = [
        'Result of a kinetostatic calibration, SI units. Load it into a node by',
        '  ros2 run PACKAGE NODE --ros-args --params-file calibration.yaml',
        *(f'from {source}' for source in outcome.sources),
        *(f'{name}: {UNITS[name]}, {DESCRIPTIONS[name]}{status[c.status[name]]}' for name in c.parameters.names),
        *(f'{item.effect.label}.{v.name}: {v.unit}, {v.meaning}' for item in found for v in item.values),
        *(f'{GROUP}.{name}: {fact.meaning}' for name, fact in FACTS.items()),
    ]
    tree: dict[str, Any] = {}
    for full, value in named.items():
        *path, last = full.split('.')
        branch = tree
        for part in path:
            branch = branch.setdefault(part, {})
        branch[last] = value
    above = ''.join(f'# {one_line(text)}\n' for text in comments)
    return above + dump_yaml({'/**': {'ros__parameters': tree}})


GROUP = 'calibration'
Stated = str | int | float | list[str]
"""As ROS parameters have it."""


class Described(NamedTuple):
    """One of the values: its type, and its meaning in a few words."""

    kind: type
    meaning: str


FACTS = {
    'assessment': Described(str, 'may the result be used: fit, caution or unfit'),
    'reasons': Described(list, 'of the assessment, the gravest first'),
    'actions': Described(list, 'what to do, in the order of the reasons'),
    'verdict': Described(str, 'is the model complete: none, explained, ambiguous or unexplained'),
    'effects': Described(list, 'effects found'),
    'possible_effects': Described(list, 'effects of a model that is still incomplete'),
    'rivals': Described(list, 'groups of effects that the touches do not tell apart, each with commas'),
    'possible_causes': Described(list, 'the same in words, with their probabilities'),
    'rank': Described(int, 'how many combinations of the 12 parameters are determined'),
    'confounded': Described(list, 'groups of parameters that the touches do not separate, each with blanks'),
    'touches.found': Described(int, 'touches in the recordings'),
    'touches.used': Described(int, 'touches that the result is made from'),
    'force_error.nominal': Described(float, 'force error before, N'),
    'held_out_force_error.extended': Described(float, 'the same after, on touches not used in the fit, N'),
    'tip_uncertainty': Described(float, 'largest expanded uncertainty of the tip in the workspace (95 %), m'),
    'warnings': Described(list, 'irregularities of the recordings'),
    'recordings': Described(list, 'the recordings and touch tables'),
    'created': Described(str, 'when the result was calculated, UTC'),
}
"""By the part of the parameter's name after `calibration.`."""


def facts(outcome: Outcome) -> dict[str, Stated]:
    """The values of a result by the names of `FACTS`."""
    d, compared = outcome.diagnosis, outcome.comparison
    values: dict[str, Any] = {
        'assessment': outcome.assessment.grade.value,
        'reasons': outcome.assessment.reasons,
        'actions': outcome.assessment.actions,
        'verdict': outcome.verdict,
        'effects': [item.effect.label for item in d.found if item.is_found],
        'possible_effects': [item.effect.label for item in d.found if item.in_every_model and item.is_possible],
        'rivals': [', '.join(group) for group in d.rivals],
        'possible_causes': [rivals_in_words(d, group) for group in d.rivals],
        'rank': outcome.final.base_rank,
        'confounded': [' '.join(group) for group in outcome.final.identifiability.confounded],
        'touches.found': outcome.found,
        'touches.used': outcome.final.used.sum(),
        'force_error.nominal': compared.nominal,
        'held_out_force_error.extended': compared.extended.held_out,
        'tip_uncertainty': outcome.tip_uncertainty.worst,
        'warnings': outcome.warnings,
        'recordings': outcome.sources,
        'created': utc(outcome.created),
    }
    return {name: fact.kind(values[name]) for name, fact in FACTS.items()}

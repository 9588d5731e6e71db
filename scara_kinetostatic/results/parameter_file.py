"""`calibration.yaml`: the result as ROS parameters, for `--params-file`.

The names are those of the node `calibrator`: `calibrated.<name>` and `calibrated_std.<name>`, and for the effects
that were found `effects.<name>.<target>.<parameter>` and `effects_std…`. An effect without a target has `all` there, a
fitted curve its channel and variable; whatever is not a letter, a digit or `_` becomes `_`. A standard deviation that
the data do not determine is `.nan`. `calibration.<name>` says what they are made from and worth (`facts`); a list
without entries is left out, as it has no type in ROS. What the numbers mean stands above them, as comments.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.diagnosis.result import Found
from scara_kinetostatic.errors import ParameterError, one_line
from scara_kinetostatic.files.calibration_file import arm_document
from scara_kinetostatic.files.yaml_file import dump_yaml, parse_yaml, read_text
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.parameters import DESCRIPTIONS, MOMENTS, NAMES, UNITS
from scara_kinetostatic.report.json_file import utc
from scara_kinetostatic.results.tables import base_rank

NAME = 'calibration.yaml'
EFFECTS, EFFECTS_STD = 'effects', 'effects_std'


class EffectParameter(NamedTuple):
    """One parameter of one effect.

    Attributes:
        path: name of the effect, target, name of the parameter; unique.
        value: estimate.
        std: standard deviation; NaN where the data do not determine it.
    """

    path: tuple[str, str, str]
    value: float
    std: float


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
        rows += [EffectParameter((*place, _word(v.name)), v.value, v.std) for v in item.values]
    return rows


def _word(text: str) -> str:
    return re.sub(r'[^A-Za-z0-9_]+', '_', text)


class StoredResult(NamedTuple):
    """What a parameter file of a result holds.

    Attributes:
        values: the parameters in the order of `Parameters.names`.
        deviations: their standard deviations; NaN where there is none.
        effects: the parameters of the effects; their units are not in the file.
        facts: what the result is made from and worth, by the names of `FACTS`; as far as the file says so.
    """

    values: list[float]
    deviations: list[float]
    effects: list[EffectParameter]
    facts: dict[str, Value]


def load_result(path: str | Path) -> StoredResult:
    """Read a parameter file of a result.

    Raises:
        ParameterError: it cannot be read, or is no such file.
    """
    tree = parse_yaml(read_text(path, ParameterError), path, ParameterError)
    try:
        given = tree['/**']['ros__parameters']
        names = (*NAMES, *(name for name in MOMENTS if name in given['calibrated']))
        return StoredResult(
            values=[_finite(given['calibrated'][name]) for name in names],
            deviations=[float(given['calibrated_std'][name]) for name in names],
            effects=_stored_effects(given.get(EFFECTS, {}), given.get(EFFECTS_STD, {})),
            facts=_stored_facts(given.get(GROUP)),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ParameterError(
            path, 'is no result of a calibration', f'expected what calibrate writes as {NAME}'
        ) from error


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError(value)
    return float(value)


def _stored_effects(values: Mapping[str, Any], deviations: Mapping[str, Any]) -> list[EffectParameter]:
    return [
        EffectParameter((name, target, key), float(value), float(deviations[name][target][key]))
        for name, targets in values.items()
        for target, parameters in targets.items()
        for key, value in parameters.items()
    ]


def _stored_facts(group: Mapping[str, Any] | None) -> dict[str, Value]:
    """The facts; a list that the file leaves out has no entries. None where the file has none of them."""
    if group is None:
        return {}
    found: dict[str, Value] = {}
    for name, fact in FACTS.items():
        value: Any = group
        for key in name.split('.'):
            value = value.get(key) if isinstance(value, Mapping) else None
        if value is not None or fact.kind is list:
            found[name] = fact.kind(value or []) if fact.kind is list else fact.kind(value)
    return found


def parameter_text(outcome: Outcome) -> str:
    """The ROS parameter file."""
    c, effects = outcome.final, effect_parameters(outcome.diagnosis.found)
    tree: dict[str, Any] = {
        'calibrated': c.parameters.as_dict(),
        'calibrated_std': {name: c.std_of(name) for name in c.parameters.names},
        **_tree((f'{EFFECTS}.{".".join(item.path)}', item.value) for item in effects),
        **_tree((f'{EFFECTS_STD}.{".".join(item.path)}', item.std) for item in effects),
        **_tree((f'{GROUP}.{name}', value) for name, value in facts(outcome).items() if value != []),
    }
    status = {'estimated': '', 'fixed': '; held at this value', 'confounded': '; these data do not determine it'}
    comments = [
        'Result of a kinetostatic calibration, SI units. Load it into a node by',
        '  ros2 run PACKAGE NODE --ros-args --params-file calibration.yaml',
        *(f'from {source}' for source in outcome.sources),
        *(f'{name}: {UNITS[name]}, {DESCRIPTIONS[name]}{status[c.status[name]]}' for name in c.parameters.names),
        *(
            f'{item.effect.label}.{v.name}: {v.unit}, {v.meaning}'
            for item in outcome.diagnosis.found
            for v in item.values
        ),
        *(f'{GROUP}.{name}: {fact.meaning}' for name, fact in FACTS.items()),
    ]
    above = ''.join(f'# {one_line(text)}\n' for text in comments)
    return above + dump_yaml({'/**': {'ros__parameters': tree}})


def _tree(values: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Nested mappings of values whose names have points."""
    tree: dict[str, Any] = {}
    for name, value in values:
        *path, last = name.split('.')
        branch = tree
        for part in path:
            branch = branch.setdefault(part, {})
        branch[last] = value
    return tree


GROUP = 'calibration'
Value = str | int | float | list[str]
"""As ROS parameters have it."""


class Fact(NamedTuple):
    """One of the values.

    Attributes:
        kind: its type.
        meaning: in a few words.
        of: from the outcome to the value.
    """

    kind: type
    meaning: str
    of: Callable[[Outcome], Value]


FACTS = {
    'assessment': Fact(str, 'may the result be used: fit, caution or unfit', lambda o: o.assessment.grade.value),
    'reasons': Fact(list, 'of the assessment, the gravest first', lambda o: list(o.assessment.reasons)),
    'actions': Fact(list, 'what to do, in the order of the reasons', lambda o: list(o.assessment.actions)),
    'verdict': Fact(str, 'is the model complete: none, explained, ambiguous or unexplained', lambda o: o.verdict),
    'effects': Fact(
        list, 'effects found', lambda o: [item.effect.label for item in o.diagnosis.found if item.is_found]
    ),
    'possible_effects': Fact(
        list,
        'effects of a model that is still incomplete',
        lambda o: [item.effect.label for item in o.diagnosis.found if item.in_every_model and item.is_possible],
    ),
    'rivals': Fact(
        list,
        'groups of effects that the touches do not tell apart, each with commas',
        lambda o: [', '.join(group) for group in o.diagnosis.rivals],
    ),
    'rank': Fact(int, 'how many combinations of the 12 parameters are determined', lambda o: base_rank(o.final)),
    'confounded': Fact(
        list,
        'groups of parameters that the touches do not separate, each with blanks',
        lambda o: [' '.join(group) for group in o.final.identifiability.confounded],
    ),
    'touches.found': Fact(int, 'touches in the recordings', lambda o: o.found),
    'touches.used': Fact(int, 'touches that the result is made from', lambda o: int(o.final.used.sum())),
    'touches.rejected': Fact(int, 'touches that were rejected', lambda o: len(o.rejected)),
    'force_error.nominal': Fact(float, 'force error before, N', lambda o: o.comparison.nominal),
    'force_error.calibrated': Fact(float, 'force error of the base model, N', lambda o: o.comparison.base.force_error),
    'force_error.extended': Fact(
        float, 'force error of the extended model, N', lambda o: o.comparison.extended.force_error
    ),
    'held_out_force_error.calibrated': Fact(
        float, 'the same of the base model on touches not used in the fit, N', lambda o: o.comparison.base.held_out
    ),
    'held_out_force_error.extended': Fact(
        float,
        'the same of the extended model on touches not used in the fit, N',
        lambda o: o.comparison.extended.held_out,
    ),
    'reduced_chi_square.calibrated': Fact(
        float, 'reduced chi-square of the base model', lambda o: o.comparison.base.reduced_chi_square
    ),
    'reduced_chi_square.extended': Fact(
        float, 'reduced chi-square of the extended model', lambda o: o.comparison.extended.reduced_chi_square
    ),
    'tip_uncertainty': Fact(
        float, 'largest expanded uncertainty of the tip in the workspace (k = 2), m', lambda o: o.tip_uncertainty.worst
    ),
    'warnings': Fact(list, 'irregularities of the recordings', lambda o: list(o.warnings)),
    'recordings': Fact(list, 'the recordings and touch tables', lambda o: list(o.sources)),
    'created': Fact(str, 'when the result was calculated, UTC', lambda o: utc(o.created)),
    'model': Fact(str, 'the calibrated model with its covariance, for the node compensator: JSON', lambda o: _model(o)),
}
"""By the part of the parameter's name after `calibration.`."""


def _model(outcome: Outcome) -> str:
    return json.dumps(arm_document(CalibratedArm.of_outcome(outcome)), ensure_ascii=False, separators=(',', ':'))


def facts(outcome: Outcome) -> dict[str, Value]:
    """The values of a result by the names of `FACTS`."""
    return {name: fact.kind(fact.of(outcome)) for name, fact in FACTS.items()}

"""What a simulated robot really is, as a file: its parameters and effects. Never part of a recording.

```yaml
parameters: {x0: 2.5e-3, …}          # all twelve
effects:                             # may be left out
- {name: object_radius, target: disc_2, parameters: {radius: 6.0e-5}}
```
The twelve by name without more around them do as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.files.yaml_text import parse_yaml, read_text
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED, PAPER_NOMINAL, Parameters
from scara_kinetostatic.simulation.chosen_effects import Chosen, choose

SCHEMA = 'scara_kinetostatic/truth/1'
HOW = 'write parameters: {x0: 0.0025, ...} with all twelve, and effects: [{name: ..., target: ..., parameters: ...}]'


class Truth(NamedTuple):
    """A robot to be simulated: the twelve parameters, and its effects."""

    parameters: Parameters
    effects: tuple[Chosen, ...] = ()


def truth_named(what: str | Path, cell: Cell) -> Truth:
    """A truth by name.

    Args:
        what: ``paper`` (table 2) or ``measured`` (figure 4d), as deviations from the nominal parameters of the cell, or
            a file for `load_truth`.
        cell: that is simulated.

    Raises:
        ParameterError: the file cannot be read or is invalid.
    """
    published = {'paper': PAPER_ACTUAL, 'measured': PAPER_MEASURED}.get(str(what))
    if published is None:
        return load_truth(what, cell)
    if cell.nominal == PAPER_NOMINAL:
        return Truth(published)
    deviation = published.as_array() - PAPER_NOMINAL.as_array()
    return Truth(Parameters.from_array(cell.nominal.as_array() + deviation))


def load_truth(path: str | Path, cell: Cell) -> Truth:
    """Read a truth.

    Args:
        path: the file.
        cell: that has the joints and discs of the effects.

    Raises:
        ParameterError: the file cannot be read, or says something senseless.
    """
    where = str(path)
    data = parse_yaml(read_text(path, ParameterError), path, ParameterError)
    if not isinstance(data, dict):
        raise ParameterError(where, 'expected the twelve parameters by name', 'write x0: 0.0025 and so on')
    if 'parameters' not in data:
        data = {'parameters': data}
    unknown = [key for key in data if key not in ('schema', 'seed', 'parameters', 'effects')]
    if unknown:
        raise ParameterError(where, f'unknown key {unknown[0]!r}', HOW)
    base, listed = data['parameters'], data.get('effects') or []
    if not isinstance(base, dict) or not isinstance(listed, list):
        raise ParameterError(where, 'expected parameters by name and a list of effects', HOW)
    parameters = Parameters.from_mapping(base, where)
    parameters.check_physical(where)
    return Truth(parameters, tuple(_effect(item, cell, where) for item in listed))


def _effect(item: Any, cell: Cell, where: str) -> Chosen:
    if not isinstance(item, dict) or not {'name'} <= set(item) <= {'name', 'target', 'parameters'}:
        raise ParameterError(where, 'effects: expected name, target and parameters', HOW)
    effect = find(cell, f'{item["name"]}[{item["target"]}]' if item.get('target') else str(item['name']))
    values = item.get('parameters') or {}
    if not isinstance(values, dict) or not all(type(value) in (int, float) for value in values.values()):
        raise ParameterError(where, f'{effect.label}: expected its parameters by name, as numbers', HOW)
    return choose(effect, values, f'{where}: {effect.label}')


def truth_text(parameters: Parameters, effects: Sequence[Chosen] = (), seed: int = 0) -> str:
    """The YAML text of a truth; `load_truth` gives it back, the seed aside."""
    listed = [
        {
            'name': item.effect.name,
            'target': item.effect.target,
            'parameters': {p.name: value for p, value in zip(item.effect.parameters, item.values, strict=True)},
        }
        for item in effects
    ]
    truth = {'schema': SCHEMA, 'seed': seed, 'parameters': parameters.as_dict(), 'effects': listed}
    return yaml.safe_dump(truth, sort_keys=False, default_flow_style=None, width=120)

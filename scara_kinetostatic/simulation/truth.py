"""The true parameters and effects of a simulated robot: by name, as text, as a file. Never part of a recording.

Effects are written ``name[target]:parameter=value,…``. A truth file:

```yaml
parameters: {x0: 2.5e-3, …}          # all twelve
effects:                             # may be left out
- {name: object_radius, target: disc_2, parameters: {radius: 6.0e-5}}
```
A file that holds nothing but the base model's parameters by name is accepted as well.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import yaml

from scara_kinetostatic.calibration.observations import DeclaredErrors
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.files.yaml_file import MappingReader, parse_yaml, read_text
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Disc
from scara_kinetostatic.model.extended_model import ExtendedModel, as_model
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, PAPER_MEASURED, PAPER_NOMINAL, Parameters
from scara_kinetostatic.model.touch import TouchSet

PAPER_ROBOTS = {'paper': PAPER_ACTUAL, 'measured': PAPER_MEASURED}
"""Robots by name: L̄a of table 2 and the compliances and backlashes of figure 4(d)."""


class TrueEffect(NamedTuple):
    """An effect of a simulated robot.

    Attributes:
        effect: the effect.
        values: of its parameters, in their order and units.
    """

    effect: Effect
    values: tuple[float, ...]


def parse_effect(text: str, cell: Cell) -> TrueEffect:
    """The effect that a text describes, such as ``object_radius[disc_2]:radius=6e-5``.

    Args:
        text: label of the effect, then each of its parameters once, SI units; without an alias it is 0.
        cell: that has the joints and discs.

    Raises:
        ParameterError: no such effect, or not exactly its parameters; the message lists the possible ones.
    """
    where = f'effect {text!r}'
    label, _, listed = text.rpartition(':') if ':' in text else (text, '', '')
    effect = find(cell, label.strip())
    names = [parameter.name for parameter in effect.parameters]
    items = [item.partition('=') for item in listed.split(',') if item.strip()]
    given = [name.strip() for name, _, _ in items]
    unstated = [p.name for p in effect.parameters if p.is_alias and p.name not in given]
    if sorted([*given, *unstated]) != sorted(names):
        raise ParameterError(where, f'expected {", ".join(names)} once each', parameter_list(effect))
    try:
        values = {name: float(value) for name, (_, _, value) in zip(given, items, strict=True)}
    except ValueError as error:
        raise ParameterError(where, f'expected parameter=value: {error}', parameter_list(effect)) from None
    if not all(isfinite(value) for value in values.values()):
        raise ParameterError(where, 'expected finite numbers', parameter_list(effect))
    return TrueEffect(effect, tuple(values.get(name, 0.0) for name in names))


def parameter_list(effect: Effect) -> str:
    """Name, unit and meaning of the parameters of an effect, as text."""
    listed = ', '.join(f'{p.name} ({p.unit}; {p.meaning})' for p in effect.parameters)
    return f'the parameters of {effect.label} are {listed}' if listed else f'{effect.label} has no parameters'


def with_effects(truth: ExtendedModel | Parameters, effects: Iterable[TrueEffect]) -> ExtendedModel:
    """The robot with further effects.

    Raises:
        ParameterError: the robot would have an effect twice.
    """
    model = as_model(truth)
    both = [*zip(model.effects, model.effect_values, strict=True), *effects]
    labels = [effect.label for effect, _ in both]
    for label in labels:
        if labels.count(label) > 1:
            raise ParameterError(f'effect {label!r}', 'is given twice', 'give it once')
    return ExtendedModel(model.parameters, tuple(one for one, _ in both), tuple(values for _, values in both))


def truth_named(what: str, cell: Cell) -> ExtendedModel:
    """The robot that a name of `PAPER_ROBOTS` or a truth file states.

    Args:
        what: ``paper`` or ``measured``: deviating from the nominal parameters of the cell as the robot of the paper
            does from its own; otherwise the path of a file.
        cell: nominal parameters, joints and discs.

    Raises:
        ParameterError: the file cannot be read, or its content is not valid.
    """
    if what not in PAPER_ROBOTS:
        return load_truth(what, cell)
    return ExtendedModel(deviating_robot(cell.nominal, PAPER_ROBOTS[what]))


def deviating_robot(nominal: Parameters, robot: Parameters = PAPER_ACTUAL) -> Parameters:
    """A robot that deviates from its nominal parameters as a robot of the paper does from its own."""
    if nominal == PAPER_NOMINAL:
        return robot
    values = nominal.as_array()
    values[: len(NAMES)] += robot.as_array() - PAPER_NOMINAL.as_array()
    return nominal.with_array(values)


def load_truth(path: str | Path, cell: Cell) -> ExtendedModel:
    """Reads a truth file.

    Args:
        path: the file.
        cell: that has the joints and discs of the effects.

    Raises:
        ParameterError: the file cannot be read, or its content is not valid.
    """
    data = parse_yaml(read_text(path, ParameterError), path, ParameterError)
    if isinstance(data, dict) and 'parameters' not in data:
        data = {'parameters': data}
    top = MappingReader(ParameterError, str(path), '', data, ('parameters',), ('schema', 'seed', 'effects'))
    n, given = cell.nominal, dict(top.section('parameters', cell.nominal.names).data)
    moments = {name: given.pop(name) for name in cell.nominal.names[len(NAMES) :]}
    parameters = Parameters.from_mapping(given, str(path))
    parameters = parameters.replace(**moments, gravity=n.gravity, phi1=n.phi1, phi2=n.phi2)
    parameters.check_physical(str(path))
    effects = []
    for entry in top.items('effects', 'effects', ('name',), ('target', 'parameters')) if data.get('effects') else []:
        name, target = entry.word('name'), entry.data.get('target')
        effect = find(cell, f'{name}[{target}]' if target else name)
        needed, aliases = ([p.name for p in effect.parameters if p.is_alias == alias] for alias in (False, True))
        values = entry.section('parameters', needed, aliases)
        stated = (values.number(p.name) if p.name in values.data else 0.0 for p in effect.parameters)
        effects.append(TrueEffect(effect, tuple(stated)))
    return with_effects(parameters, effects)


def truth_text(truth: ExtendedModel | Parameters, seed: int = 0) -> str:
    """The text of a truth file; `load_truth` reads it, without the seed."""
    model = as_model(truth)
    listed = [
        {'name': effect.name, 'target': effect.target, 'parameters': model.values[effect.label]}
        for effect in cast('tuple[Effect, ...]', model.effects)
    ]
    return dump(
        {
            'schema': 'scara_kinetostatic/truth/1',
            'seed': seed,
            'parameters': model.parameters.as_dict(),
            'effects': listed,
        }
    )


def dump(truth: dict[str, Any]) -> str:
    """A truth as YAML."""
    return yaml.safe_dump(truth, sort_keys=False, default_flow_style=None, width=120)


class World(NamedTuple):
    """What a cell description describes, up to its declared uncertainties.

    Attributes:
        described: the cell description.
        cell: the same with the discs as they are.
        errors: declared errors in units of their standard uncertainties, (m,).
        nominal_errors: of the trusted nominal values, by name, in their units.
    """

    described: Cell
    cell: Cell
    errors: Floats
    nominal_errors: dict[str, float]

    @classmethod
    def of(cls, described: Cell, errors: Floats | None, nominal_errors: dict[str, float] | None = None) -> World:
        """The world with given errors, (m,), in standard uncertainties; None for exactly the one described."""
        declared = DeclaredErrors.of(described)
        if declared is None or errors is None:
            return cls(described, described, np.zeros(0), {})
        _, first = np.unique(described.surfaces.object, return_index=True)
        centers, radii, discs = declared.centers(errors), declared.radii(errors), list[Disc | Outline]()
        for disc, k in zip(described.discs, first, strict=True):
            (x, y), radius = centers[k], radii[k]
            if isinstance(disc, Outline):
                angle = float(declared.rotation[k] @ errors)
                reference = np.array([disc.x, disc.y])
                shift = (x, y) - rotate(described.surfaces.centers[k] - reference, angle) - reference
                offset = float(radius - described.surfaces.radii[k])
                discs.append(disc.moved(shift, angle)._replace(offset=offset))
            else:
                discs.append(disc._replace(x=float(x), y=float(y), radius=float(radius)))
        return cls(described, replace(described, discs=tuple(discs)), errors, nominal_errors or {})

    @classmethod
    def draw(cls, described: Cell, random: np.random.Generator) -> World:
        """A world with all errors drawn from normal distributions."""
        declared = DeclaredErrors.of(described)
        errors = random.standard_normal(0 if declared is None else declared.count)
        stds = described.uncertainty.nominal
        return cls.of(described, errors, {name: float(std * random.standard_normal()) for name, std in stds.items()})

    def robot(self, parameters: Parameters) -> Parameters:
        """A robot whose trusted values are off the nominal ones by their errors, and the others as given."""
        nominal = self.described.nominal.as_dict()
        return parameters.replace(**{name: nominal[name] + error for name, error in self.nominal_errors.items()})

    def reported(self, touches: TouchSet) -> TouchSet:
        """Touches as the force sensor of this world reports them: with its errors of gain and rotation."""
        declared = DeclaredErrors.of(self.described)
        if declared is None or not len(self.errors):
            return touches
        # true = A reported, with A the same for all forces
        matrix = declared.true_force(np.eye(2), self.errors)
        return replace(touches, force=np.linalg.solve(matrix.T, touches.force.T).T)

"""The effects that a simulated robot is to have, as the user names them: ``name[target]:parameter=value,…``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import isfinite
from typing import NamedTuple

from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import Parameters


class Chosen(NamedTuple):
    """An effect to be played.

    Attributes:
        effect: the effect.
        values: of its parameters, in their order.
    """

    effect: Effect
    values: tuple[float, ...]


def parse_effect(text: str, cell: Cell) -> Chosen:
    """The effect that a text names, such as ``object_radius[disc_2]:radius=6e-5``.

    Args:
        text: label of the effect, then each of its parameters once, SI units.
        cell: that has the joints and discs.

    Raises:
        ParameterError: no such effect, or not exactly its parameters; the message lists what there is.
    """
    where = f'effect {text!r}'
    label, _, listed = text.rpartition(':') if ':' in text else (text, '', '')
    effect = find(cell, label.strip())
    given: dict[str, float] = {}
    for item in (part.strip() for part in listed.split(',') if part.strip()):
        name, _, value = (part.strip() for part in item.partition('='))
        if name in given:
            raise ParameterError(where, f'{name!r} is given twice', wanted(effect))
        try:
            given[name] = float(value)
        except ValueError:
            raise ParameterError(where, f'expected parameter=value, got {item!r}', wanted(effect)) from None
    return choose(effect, given, where)


def choose(effect: Effect, given: Mapping[str, float], where: str) -> Chosen:
    """An effect with values by name.

    Args:
        effect: the effect.
        given: each parameter once.
        where: for messages.

    Raises:
        ParameterError: a parameter is missing or unknown, or no finite number.
    """
    names = [parameter.name for parameter in effect.parameters]
    for name in given:
        if name not in names:
            raise ParameterError(where, f'unknown parameter {name!r}', wanted(effect))
    for name in names:
        if name not in given:
            raise ParameterError(where, f'parameter {name!r} is missing', wanted(effect))
        if not isfinite(given[name]):
            raise ParameterError(where, f'{name}: expected a finite number, got {given[name]}', wanted(effect))
    return Chosen(effect, tuple(float(given[name]) for name in names))


def wanted(effect: Effect) -> str:
    """What is to be given of an effect."""
    listed = ', '.join(f'{p.name} ({p.unit}; {p.meaning})' for p in effect.parameters)
    return f'the parameters of {effect.label} are {listed}' if listed else f'{effect.label} has no parameters'


def with_effects(truth: Parameters, chosen: Iterable[Chosen]) -> ExtendedModel:
    """The robot with effects.

    Raises:
        ParameterError: an effect is chosen twice.
    """
    chosen = tuple(chosen)
    labels = [item.effect.label for item in chosen]
    for label in labels:
        if labels.count(label) > 1:
            raise ParameterError(f'effect {label!r}', 'is given twice', 'give it once')
    return ExtendedModel(truth, tuple(item.effect for item in chosen), tuple(item.values for item in chosen))

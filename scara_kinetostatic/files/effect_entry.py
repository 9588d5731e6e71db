"""An effect as plain JSON values and back: label, name, class, and the fields of the class.

Only effects of the catalogue of the cell, the other laws that these may follow, and what a diagnosis adds by itself are
made again: a file never names a module to import.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.off_normal_force import OffNormalForce
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.effects.unnamed import Unnamed
from scara_kinetostatic.errors import CalibrationFileError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import EffectLaw

_NOT_IN_CATALOGUE = (Unnamed(), OffNormalForce())
"""What a diagnosis finds beside the catalogue."""


def effect_entry(effect: EffectLaw) -> dict[str, Any]:
    """The effect as plain JSON values; what its cell determines, such as a reference, is left out."""
    assert isinstance(effect, Effect)
    stored = {name: list(value) if isinstance(value, tuple) else value for name, value in _plain_fields(effect).items()}
    return {'label': effect.label, 'name': effect.name, 'class': type(effect).__name__, 'fields': stored}


def read_effect(entry: Mapping[str, Any], cell: Cell, where: str | Path) -> Effect:
    """The effect of an entry.

    Args:
        entry: as `effect_entry` gives it.
        cell: the cell that the effect is of.
        where: the file, for messages.

    Raises:
        CalibrationFileError: no installed package has such an effect.
        ValueError, TypeError, KeyError: the entry is damaged.
    """
    label, stored = str(entry['label']), dict(entry['fields'])
    for known in (*catalogue(cell), *_NOT_IN_CATALOGUE):
        if (known.name, type(known).__name__) == (entry['name'], entry['class']):
            effect = replace(known, **_checked(known, stored))
            if effect.label == label and (known in _NOT_IN_CATALOGUE or known.label == label):
                return effect
    problem = f'the effect {label!r} of this calibration is not known here'
    raise CalibrationFileError(where, problem, 'install the package that it comes from, or calibrate again')


def _plain_fields(effect: Effect) -> dict[str, Any]:
    """The fields that JSON can hold, by name."""
    values = {item.name: getattr(effect, item.name) for item in fields(effect)}
    return {name: v for name, v in values.items() if v is None or isinstance(v, (str, int, float, tuple))}


def _checked(effect: Effect, stored: Mapping[str, Any]) -> dict[str, Any]:
    """Stored fields for an effect of a class, lists as tuples.

    Raises:
        ValueError: a field is unknown, or of another type.
    """
    values = {name: tuple(value) if isinstance(value, list) else value for name, value in stored.items()}
    own = {item.name: getattr(effect, item.name) for item in fields(effect)}
    for name, value in values.items():
        if name not in own or not _is_like(value, own[name]):
            raise ValueError(f'effect {effect.label}: {name} is {value!r:.40}')
    return values


def _is_like(value: object, example: object) -> bool:
    """Whether a value may stand for another one: one number for another, or anything plain for nothing."""
    if example is None or value is None:
        return value is None or isinstance(value, (str, int, float))
    if isinstance(example, (int, float)):
        return isinstance(value, (int, float)) and not isinstance(value, bool)
    return type(value) is type(example)

"""Parameters held at a value: as text, checked, and those of effects with the effects that they belong to."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import ParameterError, did_you_mean
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import NAMES, UNITS, Parameters, implausible_size


class _Unit(NamedTuple):
    """Units in which a parameter may have been given by mistake.

    Attributes:
        farthest: from the nominal value, in its SI unit, that a value may be.
        factors: to the SI unit, with what to say.
    """

    farthest: float
    factors: tuple[tuple[float, str], ...]


_LENGTH = _Unit(0.1, ((1e-3, 'lengths are in m, not mm'),))
_ANGLE = _Unit(0.35, ((float(np.deg2rad(1.0)), 'angles are in rad, not degrees'),))
_GAP = _Unit(0.02, ((1e-3, 'lengths are in m, not mm'), (1e-6, 'lengths are in m, not µm')))
_GAP_ANGLE = _Unit(0.05, ((1e-3, 'angles are in rad, not mrad'), (1e-6, 'angles are in rad, not µrad')))
_GRIPPER = _Unit(2e-3, ((1e-3, 'compliances are in m/N, not mm/N'), (1e-6, 'compliances are in m/N, not µm/N')))
_JOINT = _Unit(0.02, ((1e-3, 'compliances are in rad/Nm, not mrad/Nm'), (1e-6, 'in rad/Nm, not µrad/Nm')))
_UNITS = {
    **dict.fromkeys(('x0', 'y0', 'l1', 'l2'), _LENGTH),
    **dict.fromkeys(('theta1', 'theta2'), _ANGLE),
    'p_ee': _GRIPPER,
    **dict.fromkeys(('p1', 'p2'), _JOINT),
    'g_ee': _GAP,
    **dict.fromkeys(('g1', 'g2'), _GAP_ANGLE),
}


def parse_fixed(text: str, where: str = 'fixed') -> tuple[str, float | None]:
    """Name and value of a text such as ``l1=0.3302`` or ``object_radius[disc_2].radius=0``; None without a value.

    Raises:
        ParameterError: no such parameter, or no number.
    """
    name, sign, value = (part.strip() for part in text.partition('='))
    if '.' not in name and name not in NAMES:
        remedy = did_you_mean(name, NAMES)
        effect = '' if '[' not in name else ', and of an effect such as object_radius[disc_2].radius'
        raise ParameterError(f'{where} {name}', f'expected the name of a parameter{effect}', remedy)
    if not sign:
        return name, None
    try:
        number = float(value)
    except ValueError:
        raise ParameterError(f'{where} {name}', f'expected a number, got {value!r}') from None
    if not np.isfinite(number):
        raise ParameterError(f'{where} {name}', f'expected a finite number, got {value}')
    implausible = implausible_size(number, UNITS.get(name, ''))
    if implausible:
        raise ParameterError(f'{where} {name}={value}', *implausible)
    return name, number


def fixed_values(texts: Iterable[str], nominal: Parameters, where: str = 'fixed') -> dict[str, float]:
    """Values by name of texts; without a value the nominal one, and 0 for a parameter of an effect.

    Raises:
        ParameterError: one of them is wrong.
    """
    values = nominal.as_dict()
    pairs = (parse_fixed(text, where) for text in texts)
    return {name: values.get(name, 0.0) if value is None else value for name, value in pairs}


def check_units(fixed: Mapping[str, float], nominal: Parameters) -> None:
    """Check that no value is in another unit: far from the nominal one, and near it if it were in mm, say.

    Raises:
        ParameterError: one is.
    """
    for name, unit in _UNITS.items():
        off = abs(fixed.get(name, getattr(nominal, name)) - getattr(nominal, name))
        for factor, remedy in unit.factors if off > unit.farthest else ():
            value = factor * fixed[name]
            if abs(value - getattr(nominal, name)) <= unit.farthest:
                problem = f'is {off:.3g} {UNITS[name]} from its nominal value'
                raise ParameterError(f'fixed parameter {name}={fixed[name]:g}', problem, f'{remedy}: give {value:g}')


def fixed_effects(fixed: Mapping[str, float], cell: Cell) -> tuple[Effect, ...]:
    """The effects whose parameters are held, all of each.

    Args:
        fixed: values by name; of effects such as ``object_radius[disc_2].radius``.
        cell: that has the joints and discs.

    Raises:
        ParameterError: no such effect or parameter, or not all parameters of an effect.
    """
    labels = dict.fromkeys(name.rpartition('.')[0] for name in fixed if '.' in name)
    return tuple(_fixed_effect(label, fixed, cell) for label in labels)


def _fixed_effect(label: str, fixed: Mapping[str, float], cell: Cell) -> Effect:
    effect = find(cell, label)
    names = [f'{label}.{p.name}' for p in effect.parameters]
    for name in (name for name in fixed if name.rpartition('.')[0] == label and name not in names):
        raise ParameterError(f'fixed parameter {name}', 'no such parameter', did_you_mean(name, names))
    missing = [name for name in names if name not in fixed]
    if missing:
        problem = f'{missing[0]} is free: an effect is held by all of its parameters'
        raise ParameterError(f'fixed parameters of {label}', problem, f'give {" and ".join(names)}')
    if any(fixed[name] for name in names) and not effect.is_plausible(np.array([fixed[name] for name in names])):
        raise ParameterError(f'fixed parameters of {label}', 'expected plausible values', 'give them in SI units')
    return effect

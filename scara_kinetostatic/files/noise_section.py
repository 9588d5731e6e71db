"""The key `noise` of the cell description: one number per kind or axis, and a part that grows with the force."""

from __future__ import annotations

from scara_kinetostatic.files.yaml_section import Section
from scara_kinetostatic.model.cell import Level, Noise

_PLAUSIBLE = {'joint': (1e-15, 1e-2, 'rad'), 'force': (1e-12, 100.0, 'N')}
"""Smallest and largest noise of one touch that is accepted, and its unit."""
_AXES = {'joint': ('joint 1', 'joint 2'), 'force': ('x', 'y')}
_LARGEST_RELATIVE = 0.2
"""Largest part that grows with the force: beyond it, no force is measured."""


def parse_noise(top: Section) -> Noise | None:
    """The noise that a cell description gives; None where it gives none.

    Raises:
        CellError: a level is no number or pair of numbers, or not plausible.
    """
    if top.data.get('noise') is None:
        return None
    section = top.section('noise', (), ('joint', 'force', 'force_relative'))
    missing = [key for key in ('joint', 'force') if section.data.get(key) is None]
    if missing:
        problem = f'{" and ".join(missing)} {"is" if len(missing) == 1 else "are"} missing'
        remedy = 'joint and force are given together or not at all; leave out noise to have both estimated'
        raise section.error('', problem, f'{remedy}; force_relative may be left out')
    return Noise(_level(section, 'joint'), _level(section, 'force'), _relative(section))


def _level(section: Section, key: str) -> Level:
    """One number, or one per axis."""
    least, most, unit = _PLAUSIBLE[key]
    if not isinstance(section.data[key], list):
        levels = [section.positive(key, 'rad' if unit == 'rad' else '')]
    else:
        levels = list(section.vector(key, _AXES[key], 'rad' if unit == 'rad' else ''))
    for value in levels:
        if not least <= value <= most:
            problem = f'expected {least:g} to {most:g} {unit}, got {value:g}'
            raise section.error(key, problem, 'give the repeatability of one touch, or leave out noise')
    return levels[0] if len(levels) == 1 else (levels[0], levels[1])


def _relative(section: Section) -> float | None:
    """The part that grows with the force; None where it is to be estimated if the touches ask for it."""
    if section.data.get('force_relative') is None:
        return None
    value = section.not_negative('force_relative')
    if value > _LARGEST_RELATIVE:
        problem = f'expected 0 to {_LARGEST_RELATIVE:g}, got {value:g}'
        raise section.error('force_relative', problem, 'give it as a part of the force: 0.01 for 1 %')
    return value

"""The parameters of effects by name, as the parameter file and the node have them.

`effects.<name>.<target>.<parameter>`, and `effects_std` for the standard deviations. Where an effect has no
target, `all` stands for it; where it has no name, the target says what deviates over what. Whatever is not a letter, a
digit or `_` becomes `_`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from scara_kinetostatic.diagnosis.result import Found
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.unnamed import Unnamed

VALUE, DEVIATION = 'effects', 'effects_std'
EVERYWHERE = 'all'
_OTHERS = re.compile(r'[^A-Za-z0-9_]+')


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
        name, target = _word(item.effect.name), _target(item.effect)
        number, place = 1, (name, target)
        while place in taken:
            number += 1
            place = (name, f'{target}_{number}')
        taken.add(place)
        rows += [EffectParameter((*place, _word(v.name)), v.value, v.std, v.unit, v.meaning) for v in item.values]
    return rows


def _target(effect: Effect) -> str:
    if isinstance(effect, Unnamed):
        return _word(f'{effect.channel}_over_{effect.variable}{f"_of_{effect.target}" if effect.target else ""}')
    return _word(effect.target) if effect.target else EVERYWHERE


def _word(text: str) -> str:
    return _OTHERS.sub('_', text)

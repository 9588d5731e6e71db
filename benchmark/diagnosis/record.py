"""What is kept of one simulated recording, and whether it is as it should be."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

ALONE, RIVALS, UNNAMED, WRONG, NONE = NAMINGS = ('alone', 'rivals', 'unnamed', 'wrong', 'none')
NEAR_TRUE = 1.05
"""A held-out error of so many times that of the true model is as good."""
WITHIN = 4.0
"""Standard deviations by which an estimate may be off."""
FALLEN = 2 / 3
"""Part by which the held-out error must fall, of what is possible."""


@dataclass
class Record:
    """What came of one recording.

    Attributes:
        section: of the study.
        cell: name in `SETUPS`.
        noise: ``given`` or ``estimated``.
        seed: of the direction of the effects and, with their labels and sizes, of the noise.
        played: what, as in `everything`: labels of effects, one of `UNLISTED`, one of `BENT`; empty for nothing.
        size: reduced chi-square that each effect brings about by itself; NaN for none.
        values: of all parameters of the effects.
        why: there is no recording; empty if there is one.
        error: that came instead of a diagnosis.
        chi_square: reduced, of the twelve parameters, bad touches apart.
        verdict: of the diagnosis.
        p_value: of the twelve parameters alone.
        remaining: p-value of the extended model.
        named: what was found for sure.
        rivals: what could not be told apart.
        naming: of each effect played: alone, rivals, unnamed, wrong, none.
        more: named for sure, and not played.
        held: force error on held-out touches of the twelve, of the extended and of the true model, N.
        z: largest error of the twelve in standard deviations, of the same three.
        value_z: the same of the values of effects that were named rightly.
        cpu: time of the diagnosis, s.
    """

    section: str
    cell: str
    noise: str
    seed: int
    played: tuple[str, ...] = ()
    size: float = np.nan
    values: tuple[float, ...] = ()
    why: str = ''
    error: str = ''
    chi_square: float = np.nan
    verdict: str = ''
    p_value: float = np.nan
    remaining: float = np.nan
    named: tuple[str, ...] = ()
    rivals: tuple[tuple[str, ...], ...] = ()
    naming: dict[str, str] = field(default_factory=dict)
    more: tuple[str, ...] = ()
    held: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    z: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    value_z: float = np.nan
    cpu: float = np.nan

    def as_dict(self) -> dict[str, Any]:
        """For a JSON file."""
        return {key: _plain(value) for key, value in asdict(self).items()}


def _plain(value: Any) -> Any:
    """The same with null for NaN, which JSON does not have."""
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def failure(r: Record) -> str:
    """What is wrong with a record; empty if nothing."""
    if r.error:
        return 'error'
    if not r.verdict:
        return ''
    reasons = []
    if r.section == 'clean' and r.verdict != 'none':
        reasons.append('false alarm')
    if r.section == 'unlisted':
        reasons += ['not detected'] if r.verdict == 'none' else []
        reasons += [f'fell by {fallen(r):.2f}'] if not fallen(r) >= FALLEN else []
        reasons += ['z > 4'] if not unbent(r) else []
    elif r.played and r.section != 'clean':
        small = r.size < 2.0 and r.verdict == 'none'
        reasons += ['misnamed'] if not right(r) and not small else []
        reasons += ['held-out'] if not as_good(r) and not small else []
        reasons += ['z > 4'] if not unbent(r) and not small else []
        reasons += [f'value off by {r.value_z:.1f} std'] if r.value_z >= WITHIN else []
    return ', '.join(reasons)


def right(r: Record) -> bool:
    """Whether all effects were named, alone or among rivals."""
    return all(name in (ALONE, RIVALS) for name in r.naming.values())


def as_good(r: Record) -> bool:
    """Whether the extended model predicts as the true one does."""
    return r.held[1] <= NEAR_TRUE * r.held[2]


def unbent(r: Record) -> bool:
    """Whether the twelve of the extended model are right."""
    return r.z[1] < WITHIN


def fallen(r: Record) -> float:
    """Part of the possible fall of the held-out error."""
    return (r.held[0] - r.held[1]) / (r.held[0] - r.held[2])


def words(r: Record) -> str:
    """What was named."""
    return ' + '.join([*r.named, *('|'.join(sorted(group)) for group in r.rivals)]) or r.verdict

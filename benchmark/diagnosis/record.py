"""The record of one simulated recording, and its checks against the targets."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

ALONE, RIVALS, UNNAMED, WRONG, NONE = NAMINGS = ('alone', 'rivals', 'unnamed', 'wrong', 'none')
LARGEST_ERROR_RATIO = 1.05
"""Largest held-out error over that of the true model."""
WITHIN = 4.0
"""Largest error of an estimate, standard deviations."""
REQUIRED_REDUCTION = 2 / 3
"""Required part of the possible reduction of the held-out error."""


@dataclass
class Record:
    """The results of one recording.

    Attributes:
        section: of the study.
        cell: name in `SETUPS`.
        noise: ``given`` or ``estimated``.
        seed: of the direction of the effects and, with their labels and sizes, of the noise.
        simulated: what, as in `everything`: labels of effects, one of `UNLISTED`, one of `BENT`; empty for nothing.
        size: reduced chi-square that each effect brings about by itself; NaN for none.
        values: of all parameters of the effects.
        reason: why there is no recording; empty if there is one.
        error: that came instead of a diagnosis.
        chi_square: reduced, of the base model, bad touches apart.
        verdict: of the diagnosis.
        p_value: of the base model.
        remaining: p-value of the extended model.
        named: effects stated as found.
        rivals: groups of rivals.
        naming: of each true effect: alone, rivals, unnamed, wrong, none.
        more: in every credible model, but not simulated.
        held_out: force error on held-out touches of the base, of the extended and of the true model, N.
        z: largest error of L̄ in standard deviations, in the same three.
        value_z: the same of the values of effects that were named rightly.
        cpu: time of the diagnosis, s.
    """

    section: str
    cell: str
    noise: str
    seed: int
    simulated: tuple[str, ...] = ()
    size: float = np.nan
    values: tuple[float, ...] = ()
    reason: str = ''
    error: str = ''
    chi_square: float = np.nan
    verdict: str = ''
    p_value: float = np.nan
    remaining: float = np.nan
    named: tuple[str, ...] = ()
    rivals: tuple[tuple[str, ...], ...] = ()
    naming: dict[str, str] = field(default_factory=dict)
    more: tuple[str, ...] = ()
    held_out: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    z: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    value_z: float = np.nan
    cpu: float = np.nan


def failure(r: Record) -> str:
    """The targets that a record misses; empty if none."""
    if r.error:
        return 'error'
    if not r.verdict:
        return ''
    reasons = []
    if r.section == 'clean' and r.verdict != 'none':
        reasons.append('false alarm')
    if r.section == 'unlisted':
        reasons += ['not detected'] if r.verdict == 'none' else []
        reasons += [f'reduced by {error_reduction(r):.2f}'] if not error_reduction(r) >= REQUIRED_REDUCTION else []
        reasons += ['z > 4'] if not unbiased(r) else []
    elif r.simulated and r.section != 'clean':
        small = r.size < 2.0 and r.verdict == 'none'
        reasons += ['misnamed'] if not correctly_named(r) and not small else []
        reasons += ['held-out'] if not predicts_like_truth(r) and not small else []
        reasons += ['z > 4'] if not unbiased(r) and not small else []
        reasons += [f'value off by {r.value_z:.1f} std'] if r.value_z >= WITHIN else []
    return ', '.join(reasons)


def correctly_named(r: Record) -> bool:
    """Whether all effects were named, alone or among rivals."""
    return all(name in (ALONE, RIVALS) for name in r.naming.values())


def predicts_like_truth(r: Record) -> bool:
    """Whether the extended model predicts as the true one does."""
    return r.held_out[1] <= LARGEST_ERROR_RATIO * r.held_out[2]


def unbiased(r: Record) -> bool:
    """Whether L̄ of the extended model is free of bias."""
    return r.z[1] < WITHIN


def error_reduction(r: Record) -> float:
    """Achieved part of the possible reduction of the held-out error."""
    return (r.held_out[0] - r.held_out[1]) / (r.held_out[0] - r.held_out[2])


def named_text(r: Record) -> str:
    """The effects named, as text."""
    return ' + '.join([*r.named, *('|'.join(sorted(group)) for group in r.rivals)]) or r.verdict

"""Messages of a diagnosis: the lack of fit, what touches to record next, and the noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

from scara_kinetostatic.calibration.noise import reading_noise
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR
from scara_kinetostatic.diagnosis.candidates import Moment
from scara_kinetostatic.diagnosis.linear_problem import STRICT_SIGNIFICANCE
from scara_kinetostatic.diagnosis.result import Contradiction, Dependence, Diagnosis, Found
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.model.parameters import UNITS
from scara_kinetostatic.model.quantities import quantity
from scara_kinetostatic.model.touch import TouchSet

_MOST_NAMES = 4


def joined(*texts: str) -> str:
    """Sentences as one text, without a capital at its beginning; empty ones are left out."""
    first, *others = [text for text in texts if text] or ['']
    return '. '.join([first, *(text[0].upper() + text[1:] for text in others)])


def contradicted(test: Contradiction) -> str:
    """A trusted nominal value that the touches contradict, in words."""
    unit = UNITS[test.name]
    return (
        f'the nominal value of {test.name}, which is trusted to {quantity(test.std, unit)}, is '
        f'{quantity(abs(test.off), unit)} ({abs(test.off) / test.std:.2g} times its uncertainty) off'
    )


def of_contradicted(tests: Sequence[Contradiction]) -> str:
    """Message where trusted nominal values were left out of the fit."""
    what = '; '.join(contradicted(test) for test in tests)
    return f'{what}: the result is without it; correct it in the cell file, or leave it out of uncertainty.nominal'


def unexplained(c: Calibration, dependences: Sequence[Dependence]) -> str:
    """Message where the base model does not fit and no effect explains why.

    Args:
        c: the base model.
        dependences: what its residual depends on.
    """
    if dependences:
        return (
            f'the residual is correlated with {_first_names(dependences)}: a model error that biases the parameters; '
            'their standard deviations do not cover it'
        )
    if c.noise_source == 'estimated':
        return (
            'the off-normal angle of the forces, or the residual, is not distributed like noise, without a pattern: '
            'a few bad touches, or contact friction too small to be identified; record more touches'
        )
    return (
        f'the residuals are {c.reduced_chi_square**0.5:.2g} times as large as the stated noise, without a pattern: '
        'the noise is stated too small, or touches repeat worse than assumed; '
        'leave the noise out of the cell file to have it estimated'
    )


def many_small(p_value: float, suspected: Sequence[Found]) -> str:
    """Message where the base model is incomplete, but no error stands out of the others, with what is known of those
    that are estimated beyond their typical size, and with 95 % are not zero.
    """
    text = (
        f'the base model alone does not explain the touches (p = {p_value:.1g}); small errors of usual kinds do, none '
        'of which stands out: they are in the estimate and in its uncertainty'
    )
    known = []
    for item in suspected:
        value = max(item.values, key=lambda one: abs(one.value) / one.std)
        if abs(value.value) < COVERAGE_FACTOR * value.std:
            continue
        size, std = quantity(abs(value.value), value.unit), quantity(value.std, value.unit)
        known.append(f'{item.effect.title} ({value.meaning}: {"−" * (value.value < 0)}{size} ± {std})')
    return joined(text, f'suspected, beyond their typical size: {"; ".join(known[:_MOST_NAMES])}' if known else '')


def fixed_parameters(c: Calibration) -> str:
    """Message where parameters are fixed and a model error was found."""
    if not c.fixed:
        return ''
    names = ', '.join(c.fixed)
    return f'fixed parameters: {names}; a wrong value appears as an effect that does not exist: estimate them, too'


def moments(found: Sequence[Found], known: Sequence[Moment]) -> str:
    """Between which touches something shifted; of a rival, where that is if it is the one."""
    certain = {item.effect.label for item in found if item.is_found}
    named = [(moment.effect.label, moment.text) for moment in known if moment.text]
    return joined(*(text if label in certain else f'if it is {label}, {text}' for label, text in named))


def open_questions(
    verdict: str, found: Sequence[Found], rivals: Sequence[Sequence[str]], remaining: Sequence[Dependence]
) -> str:
    """What the extended model leaves open: rivals, fitted curves, lack of fit.

    Args:
        verdict: of the diagnosis.
        found: the effects of the extended model.
        rivals: labels of effects that the touches cannot distinguish.
        remaining: what the residual of the extended model depends on.
    """
    return joined(
        *(f'these touches cannot distinguish {_enumerated(group)}' for group in rivals if len(group) > 1),
        *(f'these touches do not show whether there is {group[0]}' for group in rivals if len(group) == 1),
        *(_about_curve(item) for item in found if not item.effect.is_physical),
        _remaining(verdict, found, remaining),
    )


def _about_curve(item: Found) -> str:
    """Message on a fitted curve of the extended model."""
    if not item.in_every_model:
        return f'{item.effect.label} is a fitted curve for an effect outside the catalogue: {item.effect.description}'
    return (
        f'no effect of the catalogue explains the model error: {item.effect.description}; it is corrected by a fitted '
        f'curve. To identify it, record {item.effect.identified_by}'
    )


def _remaining(verdict: str, found: Sequence[Found], remaining: Sequence[Dependence]) -> str:
    """The lack of fit of the extended model, if any."""
    if verdict != 'unexplained':
        return ''
    possible = [item.effect.title for item in found if item.is_possible]
    added = f'; what was added, {_enumerated(possible)}, ' if possible else ''
    doubt = f'{added}is possible but not proved: what is missing may be the cause' if possible else ''
    if remaining:
        return f'a significant lack of fit remains: the residual is correlated with {_first_names(remaining)}{doubt}'
    if all(item.effect.is_physical for item in found):
        return f'the residuals remain larger than the stated noise, without a pattern{doubt}'
    return f'the model is not complete without a fitted curve{doubt}' if possible else ''


def unknown_history(touches: TouchSet, found: Diagnosis) -> str:
    """Message where slip with memory may be the cause and cannot be examined, as the load before each touch is unknown;
    where there is friction, and the movement of the tip is.

    Args:
        touches: those of the calibration.
        found: the diagnosis: a lack of fit remains, or an effect depends on the direction of approach.
    """
    if any(item.effect.plot_variable == 'slide' for item in found.found) and not touches.press.any():
        return (
            'the touches do not say how the tip slid: friction is taken to turn the force of all touches of a disc to '
            'one side, counter-clockwise above 0, clockwise below'
        )
    by_approach = any(item.effect.plot_variable == 'approach' for item in found.found)
    if touches.history.shape[1] or not (by_approach or found.verdict == 'unexplained'):
        return ''
    return (
        'the touches do not say how the load came and went before each of them, so slip with memory in a joint was not '
        'examined: calibrate the recording itself, if there is one'
    )


def premises(found: Diagnosis) -> str:
    """What the effects found suppose that the touches do not show; empty if nothing."""
    supposed = {item.effect.premise: item.effect.name for item in found.found if item.effect.premise}
    return '. '.join(f'{name} holds if {premise}' for premise, name in supposed.items())


def _first_names(dependences: Sequence[Dependence]) -> str:
    return '; '.join(dependence.name for dependence in dependences[:3])


def _enumerated(labels: Sequence[str]) -> str:
    """The first few of many, in words."""
    left = len(labels) - _MOST_NAMES
    parts = [*labels[:_MOST_NAMES], *([f'{left} other{"s" if left > 1 else ""}'] if left > 0 else [])]
    return f'{", ".join(parts[:-1])} and {parts[-1]}' if len(parts) > 1 else parts[0]


def of_steps(c: Calibration) -> bool:
    """Whether the noise of the joints is that of the steps of their readings, by a factor of 1.5."""
    return c.noise.joint_rms <= 1.5 * rms(reading_noise(c.cell, c.touches.joints))


def implausible_noise(c: Calibration) -> tuple[str, str] | None:
    """Why estimated noise is too large to be noise, such as a gross model error makes it, and what to do; else None."""
    if c.cell.noise is not None or of_steps(c):
        return None
    share = c.force_error / float(np.hypot(c.force[:, 0], c.force[:, 1]).mean())
    if c.noise.joint_rms <= 2e-4 and share <= 0.2:
        return None
    problem = (
        f'the force error is {c.force_error:.2g} N, {100 * share:.0f} % of the force, which as noise would be a joint '
        f'repeatability of {c.noise.joint_rms:.1e} rad: this is a model error'
    )
    action = 'check the positions and radii of the discs, the fixed parameters, and whether a joint lost its zero'
    return problem, action


def large_noise(c: Calibration) -> str:
    """Message where estimated noise is large but plausible."""
    # most robots repeat better
    if c.cell.noise is not None or c.noise.joint_rms <= 5e-5 or of_steps(c):
        return ''
    return (
        f'the estimated joint repeatability is {c.noise.joint_rms:.1e} rad; if the robot repeats better, a model error '
        'is counted as noise here: give the noise in the cell file if it is known'
    )


def noise_found(c: Calibration) -> str:
    """The noise that the touches have shown to grow with the force, where the cell description does not state it."""
    if not c.noise.growth or (c.cell.noise is not None and c.cell.noise.force_relative is not None):
        return ''
    entries = {key: _rounded(value) for key, value in c.noise.as_dict().items()}
    line = ', '.join(f'{key}: {value}' for key, value in entries.items())
    return (
        f'the noise of the touches grows with the force, by {100 * c.noise.growth:.2g} % of it (estimated, and used '
        f'for all standard deviations); if that is so, state it in the cell file: noise: {{{line}}}'
    )


def _rounded(value: float | list[float]) -> str:
    """Two digits, as YAML."""
    if isinstance(value, list):
        return f'[{", ".join(map(_rounded, value))}]'
    return f'{value:.1e}' if value < 1e-3 else f'{value:.2g}'


def has_small_residuals(c: Calibration) -> bool:
    """Whether the residuals are significantly smaller than the noise."""
    return bool(special.chdtr(c.degrees_of_freedom, c.chi_square) < STRICT_SIGNIFICANCE)


def overstated_noise(c: Calibration) -> str:
    """Message where the residuals are significantly smaller than the stated noise."""
    if c.noise_source != 'given' or not has_small_residuals(c):
        return ''
    return (
        f'the residuals are {c.reduced_chi_square**0.5:.2g} times the stated noise: it is stated too large, and so '
        'are the standard deviations of the base model; effects were tested with the noise estimated from the touches. '
        'Leave the noise out of the cell file to have it estimated'
    )

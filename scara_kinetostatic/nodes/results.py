"""The results of a calibration in ROS: parameters of the node, one line of text, values of a diagnostic status.

The parameters `calibrated.<name>` and `calibrated_std.<name>` exist once there is a result, from a calibration or from
a parameter file of an earlier one, and the node alone changes them. Those of effects exist as long as the last
calibration has found them: `effects.<name>.<target>.<parameter>` and `effects_std…`.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.parameters import DESCRIPTIONS, NAMES, UNITS
from scara_kinetostatic.report import parameter_file
from scara_kinetostatic.report.parameter_file import EffectParameter
from scara_kinetostatic.report.parameter_rows import base_rank

VALUE = 'calibrated'
DEVIATION = 'calibrated_std'
DECLARED = {
    **{f'{VALUE}.{name}': f'{DESCRIPTIONS[name]}, {UNITS[name]}' for name in NAMES},
    **{f'{DEVIATION}.{name}': f'{DESCRIPTIONS[name]}, standard deviation, {UNITS[name]}' for name in NAMES},
}
"""Names and descriptions: first the values, then their standard deviations, each in the order of `NAMES`."""
EFFECTS = (f'{parameter_file.EFFECTS}.', f'{parameter_file.EFFECTS_STD}.')
"""How the names of effects' parameters begin."""


class ResultParameters:
    """Holds the parameters of the node and guards them.

    In `rclpy` not even its own node may change a parameter declared read-only. So these are ordinary ones with a
    callback that accepts what the thread of `publish` sets, and rejects the rest.

    Args:
        node: whose parameters they are. Values given at its start (`--params-file`) are taken over.

    Raises:
        InvalidParameterTypeException: such a value is not a real number.
        ParameterError: a parameter of the base model is not finite.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._writer: int | None = None
        for full, description in DECLARED.items():
            self._declare(full, description)
            given = node.get_parameter_or(full)
            if given.type_ == Parameter.Type.NOT_SET:
                node.undeclare_parameter(full)
            elif full.startswith(f'{VALUE}.') and not np.isfinite(given.value):
                raise ParameterError(f'parameter {full}', f'expected a finite number, got {given.value}')
        self._effects = [full for full in node._parameter_overrides if full.startswith(EFFECTS)]
        for full in self._effects:
            self._declare(full, 'of an effect')
        node.add_on_set_parameters_callback(self._guard)

    def publish(self, values: ArrayLike, deviations: ArrayLike, effects: Sequence[EffectParameter] = ()) -> None:
        """Sets all of them at once; those of effects that are no longer found are removed.

        Args:
            values: those of the base model in the order of `NAMES`.
            deviations: their standard deviations; NaN where there is none.
            effects: those of the effects found.
        """
        numbers = np.concatenate([np.asarray(values), np.asarray(deviations)]).tolist()
        named = dict(zip(DECLARED, numbers, strict=True))
        described = dict(DECLARED)
        for item in effects:
            for start, number in zip(EFFECTS, (item.value, item.std), strict=True):
                full = start + '.'.join(item.path)
                named[full], described[full] = number, f'{item.meaning}, {item.unit}'
        self._writer = threading.get_ident()
        try:
            self._remove([full for full in self._effects if full not in named])
            for full in named:
                if not self._node.has_parameter(full):
                    self._declare(full, described[full])
            self._effects = [full for full in named if full not in DECLARED]
            self._node.set_parameters_atomically(
                [Parameter(full, Parameter.Type.DOUBLE, number) for full, number in named.items()]
            )
        finally:
            self._writer = None

    def _remove(self, names: Sequence[str]) -> None:
        for full in names:
            if self._node.has_parameter(full):
                self._node.undeclare_parameter(full)

    def _declare(self, full: str, description: str) -> None:
        descriptor = ParameterDescriptor(
            description=description, additional_constraints='read-only, the result of ~/calibrate'
        )
        self._node.declare_parameter(full, Parameter.Type.DOUBLE, descriptor)

    def _guard(self, parameters: list[Parameter]) -> SetParametersResult:
        taken = [p.name for p in parameters if p.name in DECLARED or p.name.startswith(EFFECTS)]
        if taken and self._writer != threading.get_ident():
            return SetParametersResult(
                successful=False, reason=f'{taken[0]} is read-only, the result of a calibration; call ~/calibrate'
            )
        return SetParametersResult(successful=True)


def one_line(outcome: Outcome) -> str:
    """Assessment, touches, force error before and after, goodness of fit, verdict, effects, in one line."""
    result, compared = outcome.final, outcome.comparison
    alone, extended = compared.base, compared.extended
    parts = [
        outcome.assessment.headline,
        f'{int(result.used.sum())} of {outcome.found} touches used',
        f'force error {compared.nominal:.4g} N before, {alone.force_error:.4g} N after',
        f'reduced chi-square {alone.reduced_chi_square:.3g}',
    ]
    for group in result.identifiability.confounded:
        parts.append(f'confounded: {" ".join(group)}')
    parts.append(f'missing effects: {_verdict(outcome)}')
    if outcome.diagnosis.extended:
        parts.append(
            f'with them {extended.force_error:.4g} N, reduced chi-square {extended.reduced_chi_square:.3g}, '
            f'on touches not used {alone.held_out:.4g} N before, {extended.held_out:.4g} N after'
        )
    return '; '.join(parts)


def _verdict(outcome: Outcome) -> str:
    """The verdict and the effects behind it; rivals in brackets."""
    d = outcome.diagnosis
    found = [item.effect.label for item in d.found if item.is_found]
    possible = [f'possible: {item.effect.label}' for item in d.found if item.in_every_model and item.is_possible]
    open_ones = [f'one of ({", ".join(group)})' for group in d.rivals]
    return ', '.join([d.verdict, *found, *possible, *open_ones])


def details(outcome: Outcome) -> dict[str, str]:
    """The same figures by name."""
    result, compared = outcome.final, outcome.comparison
    alone, extended = compared.base, compared.extended
    found = outcome.diagnosis.found
    return {
        'assessment': outcome.assessment.grade.value,
        'reasons': '; '.join(outcome.assessment.reasons),
        'actions': '; '.join(outcome.assessment.actions) or 'none',
        'touches found': str(outcome.found),
        'touches used': str(int(result.used.sum())),
        'force error, nominal [N]': f'{compared.nominal:.6g}',
        'force error, calibrated [N]': f'{alone.force_error:.6g}',
        'force error, extended [N]': f'{extended.force_error:.6g}',
        'force error, held out [N]': f'{alone.held_out:.6g}',
        'force error, held out, extended [N]': f'{extended.held_out:.6g}',
        'reduced chi-square': f'{alone.reduced_chi_square:.6g}',
        'reduced chi-square, extended': f'{extended.reduced_chi_square:.6g}',
        'rank': str(base_rank(result)),
        'confounded': ', '.join(' '.join(group) for group in result.identifiability.confounded) or 'none',
        'verdict': outcome.diagnosis.verdict,
        'effects': ', '.join(item.effect.label for item in found if item.is_found) or 'none',
        'possible effects': ', '.join(item.effect.label for item in found if item.is_possible) or 'none',
        'rivals': '; '.join(', '.join(group) for group in outcome.diagnosis.rivals) or 'none',
        'sources': ', '.join(outcome.sources),
    }

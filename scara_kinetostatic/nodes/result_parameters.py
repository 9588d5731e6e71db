"""The results of a calibration as parameters of the node.

The parameters `calibrated.<name>`, `calibrated_std.<name>` and `calibration.<name>` exist once there is a result, from
a calibration or from a parameter file of an earlier one, and the node alone changes them. Those of effects exist as
long as the last calibration has found them: `effects.<name>.<target>.<parameter>` and `effects_std…`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.parameters import DESCRIPTIONS, NAMES, UNITS
from scara_kinetostatic.results import parameter_file
from scara_kinetostatic.results.facts import FACTS, GROUP, Value
from scara_kinetostatic.results.parameter_file import EffectParameter

VALUE = 'calibrated'
DEVIATION = 'calibrated_std'
NUMBERS = {
    **{f'{VALUE}.{name}': f'{DESCRIPTIONS[name]}, {UNITS[name]}' for name in NAMES},
    **{f'{DEVIATION}.{name}': f'{DESCRIPTIONS[name]}, standard deviation, {UNITS[name]}' for name in NAMES},
}
"""Names and descriptions: first the values, then their standard deviations, each in the order of `NAMES`."""
EFFECTS = (f'{parameter_file.EFFECTS}.', f'{parameter_file.EFFECTS_STD}.')
"""How the names of effects' parameters begin."""
_TYPES = {
    str: Parameter.Type.STRING,
    int: Parameter.Type.INTEGER,
    float: Parameter.Type.DOUBLE,
    list: Parameter.Type.STRING_ARRAY,
}
_DECLARED = {
    **{name: (Parameter.Type.DOUBLE, meaning) for name, meaning in NUMBERS.items()},
    **{f'{GROUP}.{name}': (_TYPES[fact.kind], fact.meaning) for name, fact in FACTS.items()},
}


class ResultParameters:
    """Holds the parameters of the node and guards them.

    In `rclpy` not even its own node may change a parameter declared read-only. So these are ordinary ones with a
    callback that accepts what `publish` sets, and rejects the rest.

    Args:
        node: whose parameters they are. One thread spins it. Values given at its start (`--params-file`) are taken
            over.

    Raises:
        InvalidParameterTypeException: such a value has another type.
        ParameterError: a parameter of the base model is not finite.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._writing = False
        for full, (kind, description) in _DECLARED.items():
            self._declare(full, kind, description)
            given = node.get_parameter_or(full)
            if given.type_ == Parameter.Type.NOT_SET:
                node.undeclare_parameter(full)
            elif full.startswith(f'{VALUE}.') and not np.isfinite(given.value):
                raise ParameterError(f'parameter {full}', f'expected a finite number, got {given.value}')
        self._effects = [full for full in node._parameter_overrides if full.startswith(EFFECTS)]
        for full in self._effects:
            self._declare(full, Parameter.Type.DOUBLE, 'of an effect')
        node.add_on_set_parameters_callback(self._guard)

    @property
    def exist(self) -> bool:
        """Whether there is a result."""
        return bool(self._node.has_parameter(f'{VALUE}.{NAMES[0]}'))

    def fact(self, name: str) -> Value | None:
        """What the present result is made from or worth; None where it does not say so."""
        full = f'{GROUP}.{name}'
        return self._node.get_parameter(full).value if self._node.has_parameter(full) else None

    def publish(
        self,
        values: ArrayLike,
        deviations: ArrayLike,
        effects: Sequence[EffectParameter] = (),
        facts: Mapping[str, Value] | None = None,
    ) -> None:
        """Sets all of them at once; those of effects that are no longer found are removed.

        Args:
            values: those of the base model in the order of `NAMES`.
            deviations: their standard deviations; NaN where there is none.
            effects: those of the effects found.
            facts: what the result is made from and worth, by the names of `FACTS`.
        """
        numbers = np.concatenate([np.asarray(values), np.asarray(deviations)]).tolist()
        described = dict(_DECLARED)
        named: dict[str, Value] = dict(zip(NUMBERS, numbers, strict=True))
        named |= {f'{GROUP}.{name}': value for name, value in (facts or {}).items()}
        for item in effects:
            for start, number in zip(EFFECTS, (item.value, item.std), strict=True):
                full = start + '.'.join(item.path)
                named[full], described[full] = number, (Parameter.Type.DOUBLE, f'{item.meaning}, {item.unit}')
        self._writing = True
        try:
            self._remove([full for full in (*self._effects, *_DECLARED) if full not in named])
            for full in named:
                if not self._node.has_parameter(full):
                    self._declare(full, *described[full])
            self._effects = [full for full in named if full not in _DECLARED]
            self._node.set_parameters_atomically(
                [Parameter(full, described[full][0], value) for full, value in named.items()]
            )
        finally:
            self._writing = False

    def _remove(self, names: Sequence[str]) -> None:
        for full in names:
            if self._node.has_parameter(full):
                self._node.undeclare_parameter(full)

    def _declare(self, full: str, kind: Parameter.Type, description: str) -> None:
        descriptor = ParameterDescriptor(
            description=description, additional_constraints='read-only, the result of ~/calibrate'
        )
        self._node.declare_parameter(full, kind, descriptor)

    def _guard(self, parameters: list[Parameter]) -> SetParametersResult:
        taken = [p.name for p in parameters if p.name in _DECLARED or p.name.startswith(EFFECTS)]
        if taken and not self._writing:
            return SetParametersResult(
                successful=False, reason=f'{taken[0]} is read-only, the result of a calibration; call ~/calibrate'
            )
        return SetParametersResult(successful=True)

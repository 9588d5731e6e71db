"""The results of a calibration as parameters of the node: `calibrated.<name>` and `calibrated_std.<name>`.

They are there once there is a result, from a calibration or from a parameter
file of an earlier one, and the node alone changes them.
"""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import ArrayLike
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from scara_kinetostatic.model.parameters import DESCRIPTIONS, NAMES, UNITS

VALUE = 'calibrated'
DEVIATION = 'calibrated_std'
DECLARED = {
    **{f'{VALUE}.{name}': f'{DESCRIPTIONS[name]}, {UNITS[name]}' for name in NAMES},
    **{f'{DEVIATION}.{name}': f'{DESCRIPTIONS[name]}, standard deviation, {UNITS[name]}' for name in NAMES},
}
"""Names and descriptions: first the values, then their standard deviations, each in the order of `NAMES`."""


class ResultParameters:
    """Holds the parameters of the node and guards them.

    `rclpy` lets no one change a parameter declared read-only, its own node
    included. So these are ordinary ones with a guard that lets pass what the
    thread of `publish` sets, and rejects the rest.

    Args:
        node: whose parameters they are. Values given at its start (`--params-file`) are taken over.

    Raises:
        InvalidParameterTypeException: such a value is not a real number.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._writer: int | None = None
        for full in DECLARED:
            self._declare(full)
            if node.get_parameter_or(full).type_ == Parameter.Type.NOT_SET:
                node.undeclare_parameter(full)
        node.add_on_set_parameters_callback(self._guard)

    def publish(self, values: ArrayLike, deviations: ArrayLike) -> None:
        """Sets all of them at once.

        Args:
            values: the twelve parameters in the order of `NAMES`.
            deviations: their standard deviations; NaN where there is none.
        """
        numbers = np.concatenate([np.asarray(values), np.asarray(deviations)]).tolist()
        parameters = [
            Parameter(full, Parameter.Type.DOUBLE, number) for full, number in zip(DECLARED, numbers, strict=True)
        ]
        self._writer = threading.get_ident()
        try:
            for full in DECLARED:
                if not self._node.has_parameter(full):
                    self._declare(full)
            self._node.set_parameters_atomically(parameters)
        finally:
            self._writer = None

    def _declare(self, full: str) -> None:
        descriptor = ParameterDescriptor(
            description=DECLARED[full], additional_constraints='read-only, the result of ~/calibrate'
        )
        self._node.declare_parameter(full, Parameter.Type.DOUBLE, descriptor)

    def _guard(self, parameters: list[Parameter]) -> SetParametersResult:
        taken = [parameter.name for parameter in parameters if parameter.name in DECLARED]
        if taken and self._writer != threading.get_ident():
            return SetParametersResult(
                successful=False, reason=f'{taken[0]} is read-only, the result of a calibration; call ~/calibrate'
            )
        return SetParametersResult(successful=True)

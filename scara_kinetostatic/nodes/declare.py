"""Declaring ROS parameters: each with a description, a range where it is a number, and whether it may change.

All functions raise `ParameterError` if the node was started with a value that is not valid.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.model.cell import PAPER_CELL, Cell

_KINDS = {
    str: 'a string',
    list: 'a list of strings',
    bool: 'true or false',
    float: 'a number with a decimal point',
    int: 'a whole number',
}


T = TypeVar('T')


class Range(NamedTuple):
    """Smallest and largest value a parameter may take."""

    low: float
    high: float


def parameter(
    node: Node, name: str, default: T, description: str, bounds: Range | None = None, *, read_only: bool = True
) -> T:
    """Declares a parameter of the type of its default, and gives its value.

    Args:
        node: whose parameter it is.
        name: of the parameter.
        default: text, switch, number with a decimal point, whole number or list of texts.
        description: one line.
        bounds: of a number.
        read_only: whether it is set at the start alone.
    """
    descriptor = ParameterDescriptor(description=description, read_only=read_only)
    if bounds and isinstance(default, float):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(bounds.low), to_value=float(bounds.high))
        ]
    elif bounds:
        descriptor.integer_range = [IntegerRange(from_value=int(bounds.low), to_value=int(bounds.high), step=1)]
    given = [''] if default == [] else default  # an empty list has no type in ROS
    try:
        value: Any = node.declare_parameter(name, given, descriptor).value
    except InvalidParameterTypeException as error:
        raise ParameterError(f'parameter {name}', f'expected {_KINDS[type(default)]} ({error})') from error
    except InvalidParameterValueException as error:
        raise ParameterError(f'parameter {name}', str(error)) from error
    kind: Any = type(default)
    return kind(filter(str.strip, value) if kind is list else value)


def place(name: str, path: str) -> Path:
    """The file or folder that a parameter names; `~` is the home of the user.

    Raises:
        ParameterError: the home of an unknown user, say.
    """
    if not path.isprintable():
        raise ParameterError(f'parameter {name}', f'{path!r} holds control characters', 'give a plain path')
    try:
        return Path(path).expanduser()
    except RuntimeError as error:
        raise ParameterError(f'parameter {name}', f'{path!r}: {error}', 'write the path out') from error


def cell_or_example(node: Node, example: Cell = PAPER_CELL) -> Cell:
    """Declares the parameter `cell` and reads the file that it names; the example cell if it is empty.

    Raises:
        CellError: the file cannot be read, or its content is not valid.
    """
    path = parameter(node, 'cell', '', 'cell description (YAML file); empty: the example cell of figure 3')
    if path:
        return load_cell(place('cell', path))
    node.get_logger().warning('no cell given, taking the example cell of figure 3; set the parameter cell')
    return example

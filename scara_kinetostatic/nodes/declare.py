"""Declaring ROS parameters: each with a description, a range where it is a number, and whether it may change.

All functions raise `ParameterError` if the node was started with a value that is not valid.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

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


class Range(NamedTuple):
    """Smallest and largest value a parameter may take."""

    low: float
    high: float


def text(node: Node, name: str, default: str, description: str, *, read_only: bool = True) -> str:
    """Declares a parameter that is a string, and gives its value."""
    descriptor = ParameterDescriptor(description=description, read_only=read_only)
    return str(_declare(node, name, default, descriptor))


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


def texts(node: Node, name: str, description: str, *, read_only: bool = True) -> list[str]:
    """Declares a parameter that is a list of strings, and gives those that are not empty; by default there are none."""
    descriptor = ParameterDescriptor(description=description, read_only=read_only)
    # an empty list has no type in ROS
    return [str(text) for text in _declare(node, name, [''], descriptor) if str(text).strip()]


def switch(node: Node, name: str, default: bool, description: str, *, read_only: bool = True) -> bool:
    """Declares a parameter that is true or false, and gives its value."""
    descriptor = ParameterDescriptor(description=description, read_only=read_only)
    return bool(_declare(node, name, default, descriptor))


def number(node: Node, name: str, default: float, description: str, bounds: Range, *, read_only: bool = True) -> float:
    """Declares a parameter that is a real number, and gives its value."""
    span = FloatingPointRange(from_value=float(bounds.low), to_value=float(bounds.high))
    descriptor = ParameterDescriptor(description=description, read_only=read_only, floating_point_range=[span])
    return float(_declare(node, name, float(default), descriptor))


def whole(node: Node, name: str, default: int, description: str, bounds: Range, *, read_only: bool = True) -> int:
    """Declares a parameter that is a whole number, and gives its value."""
    span = IntegerRange(from_value=int(bounds.low), to_value=int(bounds.high), step=1)
    descriptor = ParameterDescriptor(description=description, read_only=read_only, integer_range=[span])
    return int(_declare(node, name, int(default), descriptor))


def cell_or_example(node: Node) -> Cell:
    """Declares the parameter `cell` and reads the file that it names; the example cell if it is empty.

    Raises:
        CellError: the file cannot be read, or its content is not valid.
    """
    path = text(node, 'cell', '', 'cell description (YAML file); empty: the example cell of figure 3')
    if path:
        return load_cell(place('cell', path))
    node.get_logger().warning('no cell given, taking the example cell of figure 3; set the parameter cell')
    return PAPER_CELL


def _declare(node: Node, name: str, default: Any, descriptor: ParameterDescriptor) -> Any:
    try:
        return node.declare_parameter(name, default, descriptor).value
    except InvalidParameterTypeException as error:
        raise ParameterError(f'parameter {name}', f'expected {_KINDS[type(default)]} ({error})') from error
    except InvalidParameterValueException as error:
        raise ParameterError(f'parameter {name}', str(error)) from error

"""Declaring ROS parameters: each with a description, a range where it is a number, and whether it may change."""

from __future__ import annotations

from typing import NamedTuple

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node


class Range(NamedTuple):
    """Smallest and largest value a parameter may take."""

    low: float
    high: float


def text(node: Node, name: str, default: str, description: str, *, read_only: bool = True) -> str:
    """Declares a parameter that is a string, and gives its value."""
    descriptor = ParameterDescriptor(description=description, read_only=read_only)
    return str(node.declare_parameter(name, default, descriptor).value)


def switch(node: Node, name: str, default: bool, description: str, *, read_only: bool = True) -> bool:
    """Declares a parameter that is true or false, and gives its value."""
    descriptor = ParameterDescriptor(description=description, read_only=read_only)
    return bool(node.declare_parameter(name, default, descriptor).value)


def number(
    node: Node, name: str, default: float, description: str, bounds: Range, *, read_only: bool = True
) -> float:
    """Declares a parameter that is a real number, and gives its value."""
    span = FloatingPointRange(from_value=float(bounds.low), to_value=float(bounds.high))
    descriptor = ParameterDescriptor(description=description, read_only=read_only, floating_point_range=[span])
    return float(node.declare_parameter(name, float(default), descriptor).value)


def whole(node: Node, name: str, default: int, description: str, bounds: Range, *, read_only: bool = True) -> int:
    """Declares a parameter that is a whole number, and gives its value."""
    span = IntegerRange(from_value=int(bounds.low), to_value=int(bounds.high), step=1)
    descriptor = ParameterDescriptor(description=description, read_only=read_only, integer_range=[span])
    return int(node.declare_parameter(name, int(default), descriptor).value)

"""Physical effects that the base model lacks, by what they are of; `registry` lists them.

To write one, derive from `JointEffect`, `DiscEffect`, `SensorEffect`, `LinearEffect` or `Effect`.
"""

from scara_kinetostatic.effects.base import (
    VARIABLES,
    DiscEffect,
    Effect,
    JointEffect,
    LinearEffect,
    PlotAxis,
    SensorEffect,
    Trial,
    at_joint,
)
from scara_kinetostatic.effects.registry import catalogue, find, register, unregister
from scara_kinetostatic.effects.unnamed import empirical_effects
from scara_kinetostatic.model.effect_law import ForceDependence, Parameter, Shift, TouchState

__all__ = [
    'VARIABLES',
    'DiscEffect',
    'Effect',
    'ForceDependence',
    'JointEffect',
    'LinearEffect',
    'Parameter',
    'PlotAxis',
    'SensorEffect',
    'Shift',
    'TouchState',
    'Trial',
    'at_joint',
    'catalogue',
    'empirical_effects',
    'find',
    'register',
    'unregister',
]

"""The list of effects: those built in, instantiated for a cell, and those that a user adds.

One of your own is in every catalogue after ``register(lambda cell: [MyEffect()])``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from scara_kinetostatic.effects.anisotropic_backlash import AnisotropicBacklash
from scara_kinetostatic.effects.anisotropic_gripper import AnisotropicGripper
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.base_compliance import BaseCompliance
from scara_kinetostatic.effects.base_tilt import BaseTilt
from scara_kinetostatic.effects.contact_compliance import ContactCompliance
from scara_kinetostatic.effects.contact_friction import ContactFriction
from scara_kinetostatic.effects.encoder_gain import EncoderGain
from scara_kinetostatic.effects.joint_hardening import JointHardening
from scara_kinetostatic.effects.joint_hysteresis import JointHysteresis
from scara_kinetostatic.effects.link_bending import LinkBending
from scara_kinetostatic.effects.object_position import ObjectPosition
from scara_kinetostatic.effects.object_radius import ObjectRadius
from scara_kinetostatic.effects.sensor_bias import SensorBias
from scara_kinetostatic.effects.sensor_nonlinearity import SensorNonlinearity
from scara_kinetostatic.effects.sensor_rotation import SensorRotation
from scara_kinetostatic.effects.thermal_drift import LinkGrowth, ZeroDrift
from scara_kinetostatic.effects.transmission_error import TransmissionError
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import Cell

Factory = Callable[[Cell], Iterable[Effect]]
"""From a cell to the effects of a kind that it may have."""


def each_joint(of: Callable[[int], Effect]) -> Factory:
    """One effect for each joint, or link."""
    return lambda cell: [of(joint) for joint in (0, 1)]


def each_disc(of: Callable[[int, str], Effect]) -> Factory:
    """One effect for each disc."""
    return lambda cell: [of(number, disc.name) for number, disc in enumerate(cell.discs)]


def each_of_several_discs(of: Callable[[int, str], Effect]) -> Factory:
    """One effect for each disc where there are two or more: of one, it is that of all."""
    return lambda cell: each_disc(of)(cell) if len(cell.discs) > 1 else []


BUILT_IN: tuple[Factory, ...] = (
    lambda cell: [ContactFriction(reference=cell.nominal)],
    lambda cell: [SensorRotation()],
    lambda cell: [SensorBias()],
    lambda cell: [SensorNonlinearity()],
    each_joint(EncoderGain.of),
    each_joint(TransmissionError.of),
    each_joint(JointHardening.of),
    each_joint(JointHysteresis.of),
    lambda cell: [AnisotropicGripper()],
    lambda cell: [AnisotropicBacklash()],
    each_joint(LinkBending.of),
    lambda cell: [BaseCompliance()],
    lambda cell: [BaseTilt()],
    lambda cell: [ContactCompliance()],
    each_of_several_discs(ContactCompliance.of),
    each_disc(ObjectPosition.of),
    each_disc(ObjectRadius.of),
    lambda cell: [LinkGrowth()],
    each_joint(ZeroDrift.of),
)
"""What comes with the package."""
_registered: list[Factory] = []


def register(factory: Factory) -> Factory:
    """Add effects of one's own to every catalogue from now on; the same factory counts once.

    Args:
        factory: from a cell to effects.

    Returns:
        The factory, so that this can stand above it as a decorator.
    """
    if factory not in _registered:
        _registered.append(factory)
    return factory


def unregister(factory: Factory) -> None:
    """Take back what `register` added; nothing happens if it did not."""
    if factory in _registered:
        _registered.remove(factory)


def catalogue(cell: Cell) -> tuple[Effect, ...]:
    """All effects that a cell may have: those built in, then those registered.

    Raises:
        ParameterError: two effects have the same label.
    """
    effects = tuple(effect for factory in (*BUILT_IN, *_registered) for effect in factory(cell))
    labels = set[str]()
    for effect in effects:
        if effect.label in labels:
            raise ParameterError(
                f'effect {effect.label!r}', 'there are two of this name', 'give one another name or target'
            )
        labels.add(effect.label)
    return effects


def find(cell: Cell, label: str) -> Effect:
    """The effect with a label, ``name`` or ``name[target]``.

    Raises:
        ParameterError: there is none; the message lists the labels.
    """
    effects = {effect.label: effect for effect in catalogue(cell)}
    if label not in effects:
        raise ParameterError(f'effect {label!r}', 'no such effect', f'the effects of this cell are {" ".join(effects)}')
    return effects[label]

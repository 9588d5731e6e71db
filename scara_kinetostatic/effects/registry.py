"""The catalogue of effects: those of this package, those of other packages, and those registered by a program.

Three sources, in this order:

- **Built in**: the classes of `joints`, `objects`, `robot` and `shift`, each by its `Effect.instances`.
- **Entry points** of the group ``scara_kinetostatic.effects``: an installed package offers effects to the command, the
  nodes and every program, without a change here. In its ``pyproject.toml``::

      [project.entry-points."scara_kinetostatic.effects"]
      stiffness_ripple = "stiffness_ripple:StiffnessRipple"

  The value is a class derived from `Effect`, whose `Effect.instances` say for which joints or discs of a cell it is
  there, or a function from a cell to effects. An entry that cannot be loaded, offers something else, uses a label
  that is taken, or cannot be evaluated at a few touches, is left out with one warning that names its package.
- `register`: the same for one process, as in a notebook or a test.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from inspect import isclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.effects import joints, objects, robot
from scara_kinetostatic.effects import shift as _shift
from scara_kinetostatic.effects.base import ANGLE, Effect
from scara_kinetostatic.errors import ParameterError, did_you_mean, expect
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import ForceDependence, Shift, TouchMetadata, TouchState
from scara_kinetostatic.model.joint_law import joint_torques
from scara_kinetostatic.model.kinematics import forward, link_vectors
from scara_kinetostatic.model.touch import LATER

Factory = Callable[[Cell], Iterable[Effect]]
"""From a cell to the effects of a kind that it may have."""
Offer = TypeVar('Offer', bound=Factory | type[Effect])

GROUP = 'scara_kinetostatic.effects'
"""Entry points of this group offer effects."""
ORDER = """
contact_friction sensor_rotation sensor_bias sensor_nonlinearity encoder_gain joint_coupling cable_pull
transmission_error joint_hardening joint_hysteresis joint_slip load_friction anisotropic_gripper anisotropic_backlash
tip_shape link_bending base_compliance base_tilt contact_compliance object_position object_radius thermal_drift
sensor_cross_talk shift plate_position object_rotation object_offset edge_bow
"""
"""In which results list the kinds of this package; one that is not named here follows after these."""
BUILT_IN: tuple[type[Effect], ...] = tuple(
    sorted(
        (
            kind
            for module in (joints, objects, robot, _shift)
            for kind in vars(module).values()
            if isclass(kind) and issubclass(kind, Effect) and kind.__module__ == module.__name__
        ),
        key=lambda kind: [*ORDER.split(), kind.name].index(kind.name),
    )
)
"""The kinds of this package."""
_LARGEST = 0.1
"""Shift of a typical effect, m or rad, beyond which it forgets that a touch may be one to come."""
_registered: list[Factory | type[Effect]] = []


def register(offered: Offer) -> Offer:
    """Add effects to every catalogue of this process from now on; the same offer counts once.

    Args:
        offered: a class derived from `Effect`, or a function from a cell to effects, such as ``MyEffect.instances``.

    Returns:
        The argument, so that this can stand above it as a decorator.

    Raises:
        ParameterError: it is neither.

    Example:
        >>> import scara_kinetostatic as sk
        >>> from scara_kinetostatic.effects.joints import EncoderGain
        >>> offered = sk.register(lambda cell: [EncoderGain(target='belt', joint=1)])
        >>> sk.catalogue(sk.load_cell('cell.yaml'))[-1].label
        'encoder_gain[belt]'
        >>> from scara_kinetostatic.effects import unregister
        >>> unregister(offered)
    """
    _as_factory(offered)
    if offered not in _registered:
        _registered.append(offered)
    return offered


def unregister(offered: Factory | type[Effect]) -> None:
    """Take back what `register` added; nothing happens if it did not."""
    if offered in _registered:
        _registered.remove(offered)


def catalogue(cell: Cell) -> tuple[Effect, ...]:
    """All effects that a cell may have: built in, of other packages, registered.

    Raises:
        ParameterError: a registered effect has a label that is taken.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> [effect.label for effect in sk.catalogue(cell)][4:7]
        ['sensor_rotation', 'sensor_bias', 'sensor_nonlinearity']
    """
    expect(cell, Cell, 'cell', "read it by load_cell('cell.yaml')")
    effects = dict[str, Effect]()
    for kind in BUILT_IN:
        effects |= {effect.label: effect for effect in kind.instances(cell)}
    for point in _entry_points():
        effects |= _of_entry_point(point, cell, effects)
    for effect in (effect for offered in _registered for effect in _as_factory(offered)(cell)):
        if effect.label in effects:
            raise ParameterError(
                f'effect {effect.label!r}', 'there are two of this name', 'give one another name or target'
            )
        effects[effect.label] = effect
    return tuple(effects.values())


def find(cell: Cell, label: str) -> Effect:
    """The effect with a label, ``name`` or ``name[target]``.

    Raises:
        ParameterError: there is none; the message names the possible targets, or a similar label.
    """
    effects = {effect.label: effect for effect in catalogue(cell)}
    if label in effects:
        return effects[label]
    name = label.partition('[')[0]
    same = [effect.label for effect in effects.values() if effect.name == name]
    if same:
        remedy = f'give {" or ".join(same[:5])}'
        raise ParameterError(f'effect {label!r}', f'{name} has no such target in this cell', remedy)
    remedy = did_you_mean(name, (effect.name for effect in effects.values()), 'the effects are')
    raise ParameterError(f'effect {label!r}', 'no such effect', remedy)


@cache
def _entry_points() -> tuple[EntryPoint, ...]:
    """Those of installed packages that offer effects, by package and name."""
    return tuple(sorted(entry_points(group=GROUP), key=lambda point: (_package(point), point.name)))


def _of_entry_point(point: EntryPoint, cell: Cell, taken: dict[str, Effect]) -> dict[str, Effect]:
    """The effects of an entry point by label; none, with a warning, where something is wrong with them."""
    try:
        found: dict[str, Effect] = {}
        for effect in _as_factory(point.load())(cell):
            if not isinstance(effect, Effect):
                raise TypeError(f'expected effects, got {effect!r:.80}')
            if effect.label in taken or effect.label in found:
                raise ValueError(f'the label {effect.label!r} is taken')
            evaluate_once(effect, cell)
            found[effect.label] = effect
    except (KeyboardInterrupt, MemoryError):
        raise
    except BaseException as error:  # of the code of others, SystemExit included
        _warn(f'{_package(point)}: the effect {point.name!r} ({point.value})', f'{type(error).__name__}: {error}')
        return {}
    return found


def _as_factory(offered: object) -> Factory:
    """A class of effect as the function that lists its instances, a function as it is.

    Raises:
        ParameterError: it is neither.
    """
    if isclass(offered) and issubclass(offered, Effect):
        return offered.instances
    if isclass(offered) or not callable(offered):
        wanted = 'a class derived from Effect or a function from a cell to effects'
        raise ParameterError('effects', f'expected {wanted}, got {offered!r:.80}')
    return offered


@cache
def _warn(where: str, problem: str) -> None:
    """One line, once per process."""
    text = f'{where} cannot be used: {problem}; it is left out'
    logging.getLogger('scara_kinetostatic').warning('%s', ' '.join(text.split()))


def _package(point: EntryPoint) -> str:
    """The distribution of an entry point, such as ``stiffness-ripple 1.0``."""
    return f'{point.dist.name} {point.dist.version}' if point.dist is not None else 'an unknown package'


def evaluate_once(effect: Effect, cell: Cell) -> None:
    """Evaluate shift, derivatives, trials and plot variable of an effect at a few touches with its typical values.

    Args:
        effect: the effect.
        cell: the cell.

    Raises:
        ValueError: an array has the wrong shape or a value that is not finite; names it.
        Exception: whatever the effect raises.
    """
    at, values = _some_touches(cell), np.array(effect.typical)
    n, k = len(at.joints), len(values)
    with np.errstate(all='ignore'):
        shift = effect.shift(at, values)
        _check_shifts('shift', [shift], 1, n)
        _check_shifts('derivative', effect.derivative(at, values), k, n)
        larger = _some_touches(cell, factor=2.0), ForceDependence.ALL, 'magnitude'
        turned = _some_touches(cell, turn=1.0), ForceDependence.DIRECTION, 'direction'
        for state, needed, what in (larger, turned):
            other = effect.shift(state, values)
            changed = any(a is not None and (b is None or (a != b).any()) for a, b in zip(shift, other, strict=True))
            if effect.force_dependence < needed and changed:
                stated = effect.force_dependence.name
                raise ValueError(f'force_dependence: {stated} is stated, but the shift depends on the {what}')
        error = effect.sensor_error(at.force, values)
        if error is not None:
            _check_array('sensor_error', error, (n, 2))
            errors = effect.sensor_error_derivative(at.force, values)
            _check_array('sensor_error_derivative', errors, (k, n, 2))
        _check_array('amplitudes', effect.amplitudes(values), values.shape)
        for trial in effect.trials(at, at.force):
            _check_shifts('trials', trial.columns, len(trial.columns), n)
        later = effect.shift(at._replace(metadata=at.metadata._replace(order=np.full(n, LATER))), values)
        _check_shifts('shift of touches to come', [later], 1, n)
        if any(part is not None and np.abs(part).max() > _LARGEST for part in later):
            raise ValueError(f'shift of touches to come (order {LATER}): larger than {_LARGEST} m or rad')
        _check_array('acts_on', effect.acts_on(at), (n,))
        _check_array('plot_axis', effect.plot_axis(at, values).values, (n,))


def _some_touches(cell: Cell, factor: float = 1.0, turn: float = 0.0) -> TouchState:
    """Two touches of each disc in both postures, at random angles, forces and times.

    The forces are `factor` times as large and turned by `turn`, rad.
    """
    n, random, p = 4 * max(len(cell.discs), 1), np.random.default_rng(0), cell.nominal
    number, posture = np.arange(n), np.resize((1, -1), n)
    joints = random.uniform(0.5, 2.0, (n, 2)) * np.stack([np.ones(n), posture], axis=-1)
    angle = random.uniform(0.0, 2 * np.pi, n) + turn
    force = factor * random.uniform(10.0, 40.0, (n, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    approach = ANGLE * random.uniform(-1.0, 1.0, (n, 2))
    metadata = TouchMetadata(number // 4, np.asarray(60.0 * number), approach, posture, approach, order=number)
    links, torques = link_vectors(p, joints), joint_torques(p, joints, force)
    return TouchState.of_poses(p, joints, force, torques, links, forward(p, joints), metadata)


def _check_shifts(method: str, shifts: Sequence[Shift], count: int, n: int) -> None:
    if len(shifts) != count:
        raise ValueError(f'{method}: expected {count}, one per parameter, got {len(shifts)}')
    for part in (part for shift in shifts for part in shift if part is not None):
        _check_array(method, part, (n, 2))


def _check_array(method: str, values: ArrayLike, shape: tuple[int, ...]) -> None:
    if np.shape(values) != shape:
        raise ValueError(f'{method}: expected the shape {shape}, got {np.shape(values)}')
    if not np.isfinite(values).all():
        raise ValueError(f'{method}: expected finite values')

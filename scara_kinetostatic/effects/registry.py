"""The catalogue of effects: those of this package, those of other packages, and those registered by a program.

Three sources, in this order:

- **Built in**: every class in a module beside this one that names itself, in the order of `Effect.order`. A file more
  is an effect more.
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

import difflib
import logging
import pkgutil
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from inspect import isclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.errors import ParameterError, expect
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.contact import ContactProblem
from scara_kinetostatic.model.effect_law import ForceDependence, Shift, TouchMetadata, TouchState
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.touch_equations import State

Factory = Callable[[Cell], Iterable[Effect]]
"""From a cell to the effects of a kind that it may have."""
Offer = TypeVar('Offer', bound=Factory | type[Effect])
Result = TypeVar('Result')

GROUP = 'scara_kinetostatic.effects'
"""Entry points of this group offer effects."""
_EXPECTED = 'expected a class derived from Effect or a function from a cell to effects'
_LOG = logging.getLogger('scara_kinetostatic')
_registered: list[Factory | type[Effect]] = []


class _Plugin(NamedTuple):
    """What an entry point offers, and how messages name it."""

    where: str
    factory: Factory


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
        >>> from scara_kinetostatic.effects.encoder_gain import EncoderGain
        >>> offered = sk.register(lambda cell: [EncoderGain(target='belt', joint=1)])
        >>> sk.catalogue(sk.load_cell('cell.yaml'))[-1].label
        'encoder_gain[belt]'
        >>> from scara_kinetostatic.effects import unregister
        >>> unregister(offered)
    """
    if _as_factory(offered) is None:
        raise ParameterError('register', f'{_EXPECTED}, got {offered!r:.80}')
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
        >>> [effect.label for effect in sk.catalogue(cell)][:4]
        ['contact_friction', 'sensor_rotation', 'sensor_bias', 'sensor_nonlinearity']
    """
    expect(cell, Cell, 'cell', "read it by load_cell('cell.yaml')")
    effects = {effect.label: effect for kind in built_in() for effect in kind.instances(cell)}
    for plugin in _plugins():
        effects |= _offered(plugin, cell, effects)
    factories = (_as_factory(offered) for offered in _registered)
    for effect in (effect for factory in factories if factory for effect in factory(cell)):
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
    name, bracket, target = label.partition('[')
    same = [effect.label for effect in effects.values() if effect.name == name]
    if same and not bracket:
        raise ParameterError(f'effect {label!r}', f'{name} needs a target', f'give {" or ".join(same)}')
    if same == [name]:
        raise ParameterError(f'effect {label!r}', f'{name} has no target', f'give {name}')
    if same:
        problem = f'{name} has no target {target.removesuffix("]")!r} in this cell'
        # where there are few targets all are named
        close = difflib.get_close_matches(label, same, 1, cutoff=0.8) if len(same) > 3 else []
        if close:
            raise ParameterError(f'effect {label!r}', problem, f'did you mean {close[0]}?')
        raise ParameterError(f'effect {label!r}', problem, f'give {" or ".join(same)}')
    close = difflib.get_close_matches(name, dict.fromkeys(effect.name for effect in effects.values()), 1)
    known = [effect.label for effect in effects.values() if effect.name in close]
    remedy = f'did you mean {" or ".join(known)}? ' if known else ''
    raise ParameterError(f'effect {label!r}', 'no such effect', f'{remedy}simulate --list-effects lists all')


@cache
def built_in() -> tuple[type[Effect], ...]:
    """The classes of this package that name themselves, in the order of the catalogue."""
    package = __name__.rpartition('.')[0]
    places = import_module(package).__path__
    modules = [import_module(f'{package}.{module.name}') for module in pkgutil.iter_modules(places)]
    kinds = [
        kind
        for module in modules
        for kind in vars(module).values()
        if isclass(kind) and issubclass(kind, Effect) and 'name' in vars(kind) and kind.__module__ == module.__name__
    ]
    return tuple(sorted(kinds, key=lambda kind: (kind.order, kind.__module__, kind.__name__)))


@cache
def _plugins() -> tuple[_Plugin, ...]:
    """What the entry points offer, by package and name; those that cannot be loaded are left out with a warning."""
    points = sorted(entry_points(group=GROUP), key=lambda point: (_package(point), point.name))
    return tuple(plugin for point in points for plugin in _loaded(point))


def _loaded(point: EntryPoint) -> Iterator[_Plugin]:
    where = f'{_package(point)}: the effect {point.name!r} ({point.value})'
    offered, failure = _guarded(point.load)
    factory = _as_factory(offered)
    if failure:
        _warn(where, f'cannot be loaded: {failure}')
    elif factory is None:
        _warn(where, f'{_EXPECTED}, got {offered!r:.80}')
    else:
        yield _Plugin(where, factory)


def _as_factory(offered: object) -> Factory | None:
    """A class of effect as the function that lists its instances, a function as it is, anything else as None."""
    if isclass(offered):
        return offered.instances if issubclass(offered, Effect) else None
    return offered if callable(offered) else None


def _offered(plugin: _Plugin, cell: Cell, taken: dict[str, Effect]) -> dict[str, Effect]:
    """The effects of an entry point by label; none, with a warning, where something is wrong with them."""
    effects, failure = _guarded(lambda: _evaluated(plugin.factory, cell))
    if effects is None:
        _warn(plugin.where, f'cannot be used: {failure}')
        return {}
    found = {effect.label: effect for effect in effects}
    twice = [label for label in found if label in taken]
    if twice or len(found) < len(effects):
        _warn(plugin.where, f'uses the label {(twice or list(found))[0]!r}, which is taken')
        return {}
    return found


def _evaluated(factory: Factory, cell: Cell) -> list[Effect]:
    """The effects of a factory, each of which can be evaluated.

    Raises:
        TypeError: something else is among them.
        Exception: whatever evaluating them raises.
    """
    effects = list(factory(cell))
    for effect in effects:
        if not isinstance(effect, Effect):
            raise TypeError(f'expected effects, got {effect!r:.80}')
        evaluate_once(effect, cell)
    return effects


def _guarded(call: Callable[[], Result]) -> tuple[Result | None, str]:
    """What the code of others returns, or None and what it raised, SystemExit included."""
    try:
        return call(), ''
    except (KeyboardInterrupt, MemoryError):
        raise
    except BaseException as error:
        return None, f'{type(error).__name__}: {error}'


@cache
def _warn(where: str, problem: str) -> None:
    """One line, once per process."""
    _LOG.warning('%s', ' '.join(f'{where} {problem}; it is left out'.split()))


def _package(point: EntryPoint) -> str:
    """The distribution of an entry point, such as ``stiffness-ripple 1.0``."""
    return f'{point.dist.name} {point.dist.version}' if point.dist is not None else 'an unknown package'


_TOUCHES = 7
"""Of the evaluation: a number that no shape of an effect is by chance."""


def evaluate_once(effect: Effect, cell: Cell) -> None:
    """Evaluate shift, derivatives, trials and plot variable of an effect at a few touches with its typical values.

    Args:
        effect: the effect.
        cell: the cell.

    Raises:
        ValueError: an array has the wrong shape or a value that is not finite; names it.
        Exception: whatever the effect raises.
    """
    contact_problem, state = _some_touches(cell)
    at = contact_problem.touch_state(cell.nominal, state)
    values, force = np.array(effect.typical), at.force
    with np.errstate(all='ignore'):
        _check_shift('shift', effect.shift(at, values), at)
        _check_shifts('derivative', effect.derivative(at, values), len(values), at)
        stronger, turned = (
            contact_problem.touch_state(cell.nominal, other)
            for other in (
                state._replace(magnitude=state.magnitude + 1.0),
                state._replace(direction=state.direction + 0.1),
            )
        )
        _check_independence(effect, values, at, stronger, ForceDependence.ALL, 'magnitude')
        _check_independence(effect, values, at, turned, ForceDependence.DIRECTION, 'direction')
        error = effect.sensor_error(force, values)
        if error is not None:
            _check_array('sensor_error', error, force.shape)
            _check_errors('sensor_error_derivative', effect.sensor_error_derivative(force, values), len(values), at)
        _check_array('amplitudes', effect.amplitudes(values), values.shape)
        for trial in effect.trials(at, force):
            _check_shifts('trials', trial.columns, len(trial.columns), at)
            if trial.sensor_errors:
                _check_errors('trials', trial.sensor_errors, len(trial.columns), at)
        _check_array('acts_on', effect.acts_on(at), at.magnitude.shape)
        _check_array('plot_axis', effect.plot_axis(at, values).values, at.magnitude.shape)


def _check_independence(
    effect: Effect, values: Floats, at: TouchState, other: TouchState, needed: ForceDependence, what: str
) -> None:
    """That touches with another force have the same shift where the effect says so."""
    if effect.force_dependence >= needed:
        return
    for before, after in zip(effect.shift(at, values), effect.shift(other, values), strict=True):
        if before is not None and (after is None or not np.array_equal(before, after)):
            stated = effect.force_dependence.name
            raise ValueError(f'force_dependence: {stated} is stated, but the shift depends on the {what} of the force')


def _some_touches(cell: Cell) -> tuple[ContactProblem, State]:
    """Touches of all discs in both postures, at different angles, forces and times."""
    number = np.arange(_TOUCHES)
    disc, posture, k = number % len(cell.discs), 1 - 2 * (number % 2), number.astype(float)
    sense = posture.astype(float)
    joints = np.stack([0.3 + 0.2 * k, sense * (1.0 + 0.15 * k)], axis=-1)
    direction = np.asarray(0.5 + 0.8 * k)
    normal = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    radii = cell.radii[disc]
    centers = forward(cell.nominal, joints) + radii[:, None] * normal
    approach = np.asarray(1e-4 * np.stack([sense, -sense], axis=-1))
    metadata = TouchMetadata(disc, np.asarray(60.0 * k), approach, posture, approach, order=number)
    state = State(joints[:, 0], joints[:, 1], np.asarray(10.0 + 5.0 * k), direction, *np.ones((2, _TOUCHES)))
    return ContactProblem(joints, centers, radii, cell.gripper, metadata), state


def _check_shifts(method: str, shifts: tuple[Shift, ...], count: int, at: TouchState) -> None:
    _check_count(method, len(shifts), count)
    for shift in shifts:
        _check_shift(method, shift, at)


def _check_shift(method: str, shift: Shift, at: TouchState) -> None:
    for part in (shift.joints, shift.place):
        if part is not None:
            _check_array(method, part, at.joints.shape)


def _check_errors(method: str, errors: tuple[Floats, ...], count: int, at: TouchState) -> None:
    _check_count(method, len(errors), count)
    for error in errors:
        _check_array(method, error, at.joints.shape)


def _check_count(method: str, got: int, count: int) -> None:
    if got != count:
        raise ValueError(f'{method}: expected {count}, one per parameter, got {got}')


def _check_array(method: str, values: ArrayLike, shape: tuple[int, ...]) -> None:
    if np.shape(values) != shape:
        raise ValueError(f'{method}: at {_TOUCHES} touches expected the shape {shape}, got {np.shape(values)}')
    if not np.isfinite(values).all():
        raise ValueError(f'{method}: expected finite values')

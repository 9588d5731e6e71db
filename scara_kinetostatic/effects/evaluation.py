"""Whether an effect of others can be evaluated: all its methods at a few touches of a cell, before a fit needs them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.contact import ContactProblem
from scara_kinetostatic.model.effect_law import ForceDependence, Shift, TouchMetadata, TouchState
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.touch_equations import State

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

"""From touches to L̄."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.build_result import build_result
from scara_kinetostatic.calibration.estimate import WarmStart, check_number, estimate
from scara_kinetostatic.calibration.plausibility import check_plausible
from scara_kinetostatic.calibration.prediction import observe
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.model.touch import Rejection, TouchSet

Floats = NDArray[np.float64]

FAINTEST = 3.0
"""A force below so many standard deviations of its noise has no direction to speak of."""
NO_FORCE = 1e-6
"""The same where the noise is not known, N."""


def calibrate(
    touches: TouchSet, cell: Cell, *, fixed: Mapping[str, float] | None = None, warm_start: WarmStart | None = None
) -> Calibration:
    """Estimate L̄ from touches.

    Args:
        touches: what the sensor measured, in the sensor's frame.
        cell: the cell; its noise, if given, is taken as true; the parameters of its effects are estimated
            along with the twelve.
        fixed: parameters to hold, by name, at these values.
        near: an earlier fit of the same touches, without those it left out; saves the search.

    Returns:
        The calibration. Parameters that the data cannot tell apart are held, together,
        as near to their nominal values as the data allow, and marked ``confounded``. Touches with
        hardly any force, and readings that come twice, are rejected before the fit: they are
        in `rejected`, not in `touches`.

    Raises:
        ParameterError: `fixed` names no parameter, gives a senseless value, or leaves nothing free; a
            touch names no disc of the cell.
        UnsupportedDataError: too few touches for the free parameters, touches so much
            alike that they determine less than half of them, or a fit that runs away.
        CellError: the forces contradict the cell's sensor sign or frame.
    """
    fixed = dict(fixed or {})
    start = _start(cell, fixed)
    names = [*NAMES, *('effect' for _ in start.extra)]
    free = np.array([j for j, name in enumerate(names) if name not in fixed], dtype=np.intp)
    touches, left_out = _leave_out(touches, cell)
    check_number(len(touches), len(free), [item.reason for item in left_out])
    observations = observe(touches, cell)
    check_plausible(observations, cell)
    try:
        found = estimate(observations, cell, start, free, warm_start)
    except np.linalg.LinAlgError as error:
        problem = 'the fit ran away to where the model is not defined'
        raise UnsupportedDataError(problem, 'check the nominal values, the discs and the sensor in the cell') from error
    return build_result(touches, cell, start, fixed, observations, found, left_out)


def _start(cell: Cell, fixed: Mapping[str, float]) -> Parameters:
    for name in fixed:
        if name not in NAMES:
            raise ParameterError(f'fixed parameter {name!r}', 'no such parameter', f'the names are {" ".join(NAMES)}')
    if len(fixed) == len(NAMES):
        raise ParameterError('fixed parameters', 'all twelve are fixed', 'leave one free at least')
    start = cell.nominal.replace(**fixed)
    if not start.extra:
        start = start.replace(extra=tuple(value for law in cell.effects for value in law.start))
    start.check_physical('fixed parameters' if fixed else 'nominal')
    return start


def _leave_out(touches: TouchSet, cell: Cell) -> tuple[TouchSet, list[Rejection]]:
    """Take out touches without a force and readings that repeat an earlier one to the last bit."""
    reasons: dict[int, str] = {}
    magnitude = np.hypot(touches.force[:, 0], touches.force[:, 1])
    least = FAINTEST * cell.noise.force if cell.noise else NO_FORCE
    for k in np.flatnonzero(magnitude <= least):
        noise = f' of {cell.noise.force:.2g} N' if cell.noise else ''
        reasons[int(k)] = f'presses with {magnitude[k]:.2g} N only: its direction is noise{noise}'
    earlier = _earlier_twins(np.concatenate([touches.joints, touches.force], axis=1))
    for k in np.flatnonzero(earlier != np.arange(len(touches))):
        reasons.setdefault(int(k), f'the same reading as touch {touches.index[earlier[k]]}, to the last bit')
    if not reasons:
        return touches, []
    kept = np.ones(len(touches), dtype=bool)
    kept[list(reasons)] = False
    return touches.select(kept), [Rejection(int(touches.index[k]), reason) for k, reason in sorted(reasons.items())]


def _earlier_twins(rows: Floats) -> NDArray[np.intp]:
    """For each row the first one that is the same to the last bit, itself if there is none before, (n,)."""
    if len(np.unique(rows[:, 0])) == len(rows):  # as nearly always
        return np.arange(len(rows))
    _, first, which = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return np.asarray(first[which.ravel()])

"""The joint covariance of all values of a calibration and the declared errors, and what of it undetected effects make:
by it later touches on the same objects are judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.observations import ASSUMED_PLACES, LARGE_EFFECT, DeclaredErrors
from scara_kinetostatic.calibration.result import Calibration, of_full_model
from scara_kinetostatic.model.arrays import Floats, Indices


class UndetectedErrors(NamedTuple):
    """By how much undetected effects move the estimates: the same robot has them at every calibration.

    Attributes:
        rows: names of what they move, the values of the model and the declared errors, (v,).
        columns: the effects as texts (`Column.text`), (u,).
        of_robot: whether each moves the robot, (u,); else it is of objects or sensor.
        size: standard deviation of each, in its unit, (u,).
        matrix: changes of the estimates by one standard deviation of each, (v, u), SI.
    """

    rows: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    of_robot: tuple[bool, ...] = ()
    size: Floats = np.zeros(0)
    matrix: Floats = np.zeros((0, 0))

    @classmethod
    def of(cls, c: Calibration) -> UndetectedErrors:
        """Those of a calibration."""
        if c.random is None:
            return cls()
        names, every, scale = _of_model_and_cell(c)
        first = len(c.model.names) + len(c.errors)
        moved = scale[:, None] * c.covariance_with_errors[every, first:] / c.enlargement**0.5
        texts, of_robot = zip(*((column.text, column.moves_robot) for column in c.random.columns), strict=True)
        return cls(names, texts, of_robot, c.random.size, moved)

    def of_cell(self) -> UndetectedErrors:
        """Those of objects and sensor alone."""
        own = np.equal(self.of_robot, False)
        columns = tuple(column for column, is_own in zip(self.columns, own, strict=True) if is_own)
        return UndetectedErrors(self.rows, columns, (False,) * len(columns), self.size[own], self.matrix[:, own])

    def at(self, names: Sequence[str]) -> Floats:
        """The rows of some values, zero for those that it lacks, (n, u)."""
        place = {name: k for k, name in reversed(list(enumerate(self.rows)))}  # an effect before an error of its name
        found = np.zeros((len(names), len(self.columns)))
        for k, name in enumerate(names):
            if name in place:
                found[k] = self.matrix[place[name]]
        return found

    def of_all(self, count: int) -> Floats:
        """The matrix for all values of `joint_covariance`, (count, u); older files have those of the model alone."""
        return np.pad(self.matrix, ((0, count - len(self.rows)), (0, 0)))


def joint_covariance(calibration: Calibration) -> tuple[tuple[str, ...], Floats, Floats]:
    """What a later prediction of touches on the same objects needs; without a large effect, and what is assumed of
    undeclared places, which stay as they are.

    Returns:
        Names of the values of the model, then of the declared errors (`DeclaredErrors.names`), all values,
        (12 + k + m,), and their covariance, (12 + k + m, 12 + k + m); SI units.
    """
    c, size = calibration, len(calibration.covariance)
    names, every, scale = _of_model_and_cell(c)
    stays = LARGE_EFFECT, ASSUMED_PLACES
    matrix = scale[:, None] * c.covariance_with_errors[np.ix_(every, every)] * scale
    matrix[:size, :size] = c.covariance - sum(p.covariance for p in c.contributions if p.label in stays)
    values = np.concatenate([c.full_model.as_array(), scale[len(scale) - len(c.errors) :] * c.errors])
    return names, values, matrix


def _of_model_and_cell(c: Calibration) -> tuple[tuple[str, ...], Indices, Floats]:
    """Names, places in `covariance_with_errors` and units of the values of `full_model` and the declared errors."""
    declared, (kept, scale) = DeclaredErrors.of(c.cell), of_full_model(c)
    names, units = (declared.names, declared.units) if declared else ((), np.zeros(0))
    every = np.concatenate([kept, len(c.model.names) + np.arange(len(names))])
    return (*c.full_model.names, *names), every, np.concatenate([scale, units])

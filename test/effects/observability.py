"""What of each effect the touches can show beside the base model.

``python -m effects.observability`` (with ``test`` and the package on the path) prints the table.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any, NamedTuple

import numpy as np
from calibration.studies import CELL, NOISE
from effects.scenes import exact_touches

from scara_kinetostatic.calibration.fit_point import project
from scara_kinetostatic.calibration.gauss_helmert import linearise, whiten_by
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED, Parameters
from scara_kinetostatic.simulation.plan import default_plan

FREQUENCIES = (1.0, 2.0, 7.3, 100.0)
"""Of a transmission error, cycles per turn."""
FRICTION = {'joint_slip': (0.5, 1.0, 2.0, 4.0), 'load_friction': (0.05, 0.1, 0.2, 0.4)}
"""Of a joint that slips, Nm; of friction that grows with the load, a ratio."""


class Visibility(NamedTuple):
    """How far one parameter of an effect shows.

    Attributes:
        label: effect and parameter.
        new: part of its whitened column that the base model does not explain, 0 to 1.
        doubling: its value at which it alone doubles the reduced chi-square, in its unit.
        scale: its plausible size.
        unit: its unit.
    """

    label: str
    new: float
    doubling: float
    scale: float
    unit: str


def columns(
    robot: Parameters, per_disc: int = 18, preload: float = 0.3, both_postures: bool = True
) -> Iterator[tuple[Effect, str, int, Floats, Floats]]:
    """Of every parameter of every effect its label, its number, its whitened column, and what is new of that.

    For exact touches of the default plan, or its left elbow posture, and the usual noise.
    """
    plan = default_plan(CELL, per_disc=per_disc, preload=preload)
    plan = plan if both_postures else plan.select(plan.posture > 0)
    touches = exact_touches(robot, plan)
    observations = observe(touches, CELL)
    point = project(observations, ExtendedModel(robot), NOISE)
    base = np.linalg.qr(point.whitened.derivative.reshape(2 * len(touches), -1))[0]
    for effect in catalogue(CELL):
        for name, values, k in _cases(effect):
            linear = linearise(observations, ExtendedModel(robot, (effect,), (values,)), point.adjusted)
            column = whiten_by(linear.derivative[:, :, 12 + k : 13 + k], point.whitened.root).ravel()
            yield effect, name, k, column, column - base @ (base.T @ column)


def visibility(robot: Parameters, **plan: Any) -> list[Visibility]:
    """Of every parameter of every effect, for touches as in `columns`."""
    found = []
    for effect, name, k, column, rest in columns(robot, **plan):
        left, about = np.linalg.norm(rest), effect.parameters[k]
        doubling = np.sqrt(len(column) - 12) / left if left > 0 else np.inf
        found.append(Visibility(name, left / np.linalg.norm(column), doubling, about.scale, about.unit))
    return found


def least_new(robot: Parameters, aliases: Collection[str]) -> dict[str, float]:
    """Of every effect the least part that is new of any combination of its parameters, without some: near 0 where one
    more of them is a part of the base model.
    """
    parts = dict[str, list[tuple[Floats, Floats]]]()
    for effect, name, _, column, rest in columns(robot):
        if name not in aliases:
            form = name if effect.grid_parameter else effect.label
            parts.setdefault(form, []).append((column, rest))
    found = {}
    for form, pairs in parts.items():
        unit, rest = (
            np.stack(each, axis=1) / [np.linalg.norm(column) for column, _ in pairs]
            for each in zip(*pairs, strict=True)
        )
        mixture = np.linalg.svd(rest)[2][-1]
        found[form] = float(np.linalg.norm(rest @ mixture) / np.linalg.norm(unit @ mixture))
    return found


def _cases(effect: Effect) -> Iterator[tuple[str, tuple[float, ...], int]]:
    """Label, values and position of each parameter; of a wave, its cosine and its sine at several frequencies."""
    if effect.name == 'transmission_error':
        for cycles in FREQUENCIES:
            for wave, phase in (('cos', 0.0), ('sin', np.pi / 2)):
                yield f'{effect.label} {wave} {cycles:g}', (0.0, phase, cycles), 0
    elif effect.name in FRICTION:
        for friction in FRICTION[effect.name]:
            yield f'{effect.label} {friction:g} {effect.parameters[1].unit}', (0.0, friction), 0
    else:
        values = effect.typical if effect.is_stepwise else effect.start
        for k, parameter in enumerate(effect.parameters):
            if not (effect.is_stepwise and k == effect.grid_parameter_index):
                yield f'{effect.label}.{parameter.name}', values, k


def main() -> None:
    actual, measured = (visibility(robot) for robot in (PAPER_ACTUAL, PAPER_MEASURED))
    print(f'{"new beside the base; size that doubles chi-square":46s}   table 2            figure 4(d)       scale')
    for a, b in zip(actual, measured, strict=True):
        print(f'{a.label:46s} {a.new:7.3f} {a.doubling:9.1e}  {b.new:7.3f} {b.doubling:9.1e}  {a.scale:.0e} {a.unit}')


if __name__ == '__main__':
    main()

"""Identifiability of the general gripper of (7) beside the twelve parameters.

P = p_ee I + E in the frame of link 2. E has three parts besides the isotropic one: a larger compliance across link 2
than along it (p22 - p11), principal axes that are rotated (p12 + p21), and a part that does not conserve energy (p12 -
p21). A displacement across link 2 proportional to the force across it is also caused by a compliance of joint 2: p22 -
p11 is an exact alias of l2² p2 (and half of it of p_ee). The other parts have no alias.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.fit_point import project
from scara_kinetostatic.calibration.gauss_helmert import place_force, whiten_by
from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.model.touch_equations import excess_derivative, touch_equations

_PARTS = {
    'p22 - p11': np.array([-0.5, 0.0, 0.0, 0.5]),
    'p12 + p21': np.array([0.0, 0.5, 0.5, 0.0]),
    'p12 - p21': np.array([0.0, 0.5, -0.5, 0.0]),
}
"""The parts of E by name: contribution of one unit to the entries 11, 12, 21, 22."""
_PROBE = 1e-5
"""Size of a part, m/N, for which the bias of the parameters is evaluated."""
_NOTICEABLE = 0.01
"""Bias, as a share of the plausible range, from which a parameter is listed."""
_ALIAS = 1 - 1e-12
"""Explained share from which the part is an exact alias; the rest is rounding."""


class Part(NamedTuple):
    """Identifiability of one part of the general gripper by a set of touches.

    Attributes:
        name: such as ``p22 - p11``.
        explained: share of its effect on the touches that the twelve parameters reproduce, 0 to 1.
        std: standard deviation with which the touches determine it beside the twelve parameters, m/N; infinite
            for an exact alias.
        biases: bias of each parameter if the part is not modelled, per m/N of it.
    """

    name: str
    explained: float
    std: float
    biases: dict[str, float]


def observable_parts(touches: TouchSet, cell: Cell, parameters: Parameters, noise: Noise) -> tuple[Part, ...]:
    """Identifiability of each part of E.

    Args:
        touches: exact or measured; only their places count.
        cell: the cell.
        parameters: L̄ at which the equations are linearised.
        noise: of one touch.
    """
    observations = observe(touches, cell)
    point = project(observations, ExtendedModel(parameters), noise)
    a = point.adjusted
    state = place_force(observations, point.model, a.joints, a.force, a.state)
    o = observations
    equations = touch_equations(parameters, a.joints, o.centers, o.radii, state, o.gripper)
    entries = whiten_by(excess_derivative(state, equations, o.gripper), point.whitened.root)
    base = (point.whitened.derivative * SCALES).reshape(-1, len(NAMES))
    return tuple(_look(name, (entries @ weights).ravel(), base) for name, weights in _PARTS.items())


def _look(name: str, trace: Floats, base: Floats) -> Part:
    found = np.linalg.lstsq(base, trace, rcond=1e-10)[0]
    left = trace - base @ found
    unidentifiable = float(np.linalg.norm(left))
    share = 1 - (unidentifiable / float(np.linalg.norm(trace))) ** 2
    noticeable = np.abs(found) * _PROBE > _NOTICEABLE
    return Part(
        name,
        share,
        1 / unidentifiable if share < _ALIAS else float('inf'),
        {parameter: float(found[j] * SCALES[j]) for j, parameter in enumerate(NAMES) if noticeable[j]},
    )

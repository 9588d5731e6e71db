"""What touches can show of the general gripper of (7), and what hides in the twelve parameters.

P = p_ee I + E in the frame of link 2. E has three parts besides the isotropic one: a gripper that is
softer across link 2 than along it (p22 - p11), one whose axes are turned (p12 + p21), and one that does not
conserve energy (p12 - p21). A displacement across link 2 in proportion to the force across it is
what a softer joint 2 does as well: p22 - p11 is an exact alias of l2² p2 (and half of it of p_ee). The
others have no such twin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.gauss_helmert import place_force
from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.calibration.prediction import observe
from scara_kinetostatic.calibration.projection import project
from scara_kinetostatic.calibration.whitening import whiten_by
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.equations import excess_derivative, touch_equations
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.model.touch import TouchSet

Floats = NDArray[np.float64]

PARTS = {
    'p22 - p11': np.array([-0.5, 0.0, 0.0, 0.5]),
    'p12 + p21': np.array([0.0, 0.5, 0.5, 0.0]),
    'p12 - p21': np.array([0.0, 0.5, -0.5, 0.0]),
}
"""The parts of E by name, each as what one unit of it adds to the entries 11, 12, 21, 22."""
NOTICEABLE = 0.01
"""A parameter takes part in hiding if it would change by more than this part of its plausible range per 1e-5 m/N."""
PROBE = 1e-5
ALIAS = 1 - 1e-12
"""Hidden share beyond which only rounding is left."""


class Part(NamedTuple):
    """One part of the general gripper before a set of touches.

    Attributes:
        name: such as ``p22 - p11``.
        hidden: share of its trace in the touches that the twelve parameters reproduce, 0 to 1.
        std: standard deviation with which the touches would determine it beside the
            twelve, m/N; infinite where it is an exact alias.
        absorbed: by how much each parameter that hides it would be off, per m/N of it.
    """

    name: str
    hidden: float
    std: float
    absorbed: dict[str, float]


def see_parts(touches: TouchSet, cell: Cell, parameters: Parameters, noise: Noise) -> tuple[Part, ...]:
    """What a set of touches shows of each part of E.

    Args:
        touches: exact or measured; only where they are counts.
        cell: the cell.
        parameters: L̄ at which to look.
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
    return tuple(_look(name, (entries @ weights).ravel(), base) for name, weights in PARTS.items())


def _look(name: str, trace: Floats, base: Floats) -> Part:
    found = np.linalg.lstsq(base, trace, rcond=1e-10)[0]
    left = trace - base @ found
    unidentifiable = float(np.linalg.norm(left))
    share = 1 - (unidentifiable / float(np.linalg.norm(trace))) ** 2
    noticeable = np.abs(found) * PROBE > NOTICEABLE
    return Part(
        name,
        share,
        1 / unidentifiable if share < ALIAS else float('inf'),
        {parameter: float(found[j] * SCALES[j]) for j, parameter in enumerate(NAMES) if noticeable[j]},
    )

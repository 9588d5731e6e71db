"""The usual observability indices of robot calibration, from the singular values of the Jacobian.

The Jacobian is whitened by the noise of a touch, its columns are in units of the
plausible range of each parameter (`calibration.identifiability.SCALES`): without units, all indices but O1 compare
apples with pears. With singular values σ1 ≥ … ≥ σL of m touches,

    O1 = (σ1 ⋯ σL)^(1/L) / √m        Borm and Menq, Int. J. Robotics Research 10 (1991) 51: volume of the ellipsoid
    O2 = σL / σ1                     Driels and Pathre, J. Robotic Systems 7 (1990) 921: inverse condition number
    O3 = σL                          Nahvi, Hollerbach and Hayward, ICRA 1994, 984: the worst direction
    O4 = σL² / σ1                    Nahvi and Hollerbach, ICRA 1996, 994: noise amplification
    O5 = 1 / (1/σ1 + … + 1/σL)       Sun and Hollerbach, ICRA 2008, 831: mean uncertainty

Larger is better. Where the rank is less than 12, L counts what is seen and the indices are of that alone. They
rank sets of touches of one cell; none of them knows what the robot is for, which the standard deviation of
the tip does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Indices(NamedTuple):
    """O1 to O5; see the module."""

    o1: float
    o2: float
    o3: float
    o4: float
    o5: float


def observability(values: NDArray[np.float64], touches: int) -> Indices:
    """The five indices.

    Args:
        values: singular values of the scaled, whitened Jacobian, (L,), in any order.
        touches: m.
    """
    if not len(values) or not values.min() > 0:
        return Indices(0.0, 0.0, 0.0, 0.0, 0.0)
    largest, smallest = float(values.max()), float(values.min())
    return Indices(
        o1=float(np.exp(np.log(values).mean()) / np.sqrt(touches)),
        o2=smallest / largest,
        o3=smallest,
        o4=smallest**2 / largest,
        o5=float(1 / (1 / values).sum()),
    )

"""The result of a calibration, frozen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.identifiability import Identifiability
from scara_kinetostatic.calibration.prediction import force_error, force_residual, observe
from scara_kinetostatic.calibration.solver import Subspace, Termination
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.model.touch import Rejection, TouchSet

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Calibration:
    """L̄ with its uncertainty, and every touch with its part in it.

    Attributes:
        cell: the cell it is about.
        fixed: parameters that were held at a given value.
        subspace: the changes of L̄ that the fit could make: without what is fixed or unseen.
        start: L̄n, the nominal values, where the fit began; fixed parameters at theirs.
        parameters: L̄.
        covariance: of the twelve and, behind them, the parameters of the cell's effects, (12 + k, 12 + k), in
            their units; zero rows where fixed, and no statement about what is confounded.
        std: standard deviations of the twelve, (12,): 0 where fixed, NaN where confounded.
        extra_std: the same of the effects' parameters, (k,).
        status: by name, ``estimated``, ``fixed`` or ``confounded``.
        touches: all touches, used or not.
        used: which took part in the fit, (n,).
        rejected: the others, with the reason.
        noise: σ_q in rad and σ_f in N of one touch.
        noise_source: ``given`` or ``estimated``.
        force: measured force on the object in the base frame, (n, 2), N.
        standardized: Mahalanobis distance of each touch from what the model says, (n,).
        chi_square: sum of squared distances of the used touches.
        degrees_of_freedom: two per used touch less the parameters seen.
        identifiability: what the data show and what not.
        iterations: solver steps, all stages together.
        termination: how the last stage ended.
        history: cost after each step of the last stage.
    """

    cell: Cell
    fixed: Mapping[str, float]
    subspace: Subspace
    start: Parameters
    parameters: Parameters
    covariance: Floats
    std: Floats
    extra_std: Floats
    status: Mapping[str, str]
    touches: TouchSet
    used: NDArray[np.bool_]
    rejected: tuple[Rejection, ...]
    noise: Noise
    noise_source: str
    force: Floats
    standardized: Floats
    chi_square: float
    degrees_of_freedom: int
    identifiability: Identifiability
    iterations: int
    termination: Termination
    history: tuple[float, ...]

    @cached_property
    def residual(self) -> Floats:
        """F - A(Q, L̄), (n, 2), N."""
        return force_residual(observe(self.touches, self.cell), self.parameters)

    @cached_property
    def nominal_residual(self) -> Floats:
        """F - A(Q, L̄n), (n, 2), N."""
        return force_residual(observe(self.touches, self.cell), self.start)

    @property
    def force_error(self) -> float:
        """e_f (10) over the used touches, N."""
        return force_error(self.residual[self.used])

    @property
    def force_error_nominal(self) -> float:
        """The same with L̄n."""
        return force_error(self.nominal_residual[self.used])

    @property
    def reduced_chi_square(self) -> float:
        """Chi-square per degree of freedom: 1 where model and noise are right."""
        return self.chi_square / self.degrees_of_freedom

    def std_of(self, name: str) -> float:
        """Standard deviation of one parameter by name, in its unit."""
        return float(self.std[NAMES.index(name)])

"""The estimator of the paper, section 4.3: pseudo-inverse steps on A(Q, L̄), unweighted (12)–(14).

    L̄_k = L̄_{k-1} + J_L̄⁺ ΔF,   ΔF = F - A(Q, L̄_{k-1}),   J_L̄ = ∂A/∂L̄

with the paper's two modifications: a step is shortened until the error index decreases, and its length is bounded.

**Additions to the paper's text.** At L̄n the tip misses most discs by more than its whole deflection: there A = 0 N and
∂A/∂L̄ = 0, and no step is defined. The touches are known to be contacts; they are therefore predicted with a two-sided
contact (`contact(..., tension=True)`), which equals A wherever the tip presses. The pseudo-inverse depends on the units
of the parameters: the columns are scaled by the plausible ranges, and singular values below a relative `cutoff` are
set to zero.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.fit_point import base_force, force_error, force_residual
from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.contact import contact, contact_derivatives
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch import TouchSet

MOST_STEPS = 30


class PaperFit(NamedTuple):
    """Result of the paper's algorithm.

    Attributes:
        parameters: the last L̄.
        force_error: e_f (10) there, unilateral contact, N.
        history: e_f at every iterate, the start first, unilateral contact, N.
        merit: the same with the two-sided contact, which the steps decrease.
        rank: number of singular values used in the last step.
    """

    parameters: Parameters
    force_error: float
    history: tuple[float, ...]
    merit: tuple[float, ...]
    rank: int

    @property
    def iterations(self) -> int:
        """Number of steps."""
        return len(self.merit) - 1


class _Iterate(NamedTuple):
    parameters: Parameters
    residual: Floats
    jacobian: Floats
    merit: float


def paper_calibrate(touches: TouchSet, cell: Cell) -> PaperFit:
    """The paper's algorithm on a set of touches.

    Args:
        touches: Q and F; the sensor in the base frame, as in the paper.
        cell: discs and sign of (7).

    Raises:
        ParameterError: the sensor is in the tool frame, which the paper does not consider.
    """
    if cell.sensor.frame is not SensorFrame.BASE:
        raise ParameterError('sensor.frame', 'the algorithm of the paper takes forces in the base frame')
    observations = observe(touches, cell)
    measured = base_force(observations, ExtendedModel(cell.nominal))

    def visit(parameters: Parameters) -> _Iterate:
        o = observations
        with np.errstate(all='ignore'):
            found = contact(parameters, o.joints, o.centers, o.radii, o.gripper, tension=True, warm_start=measured)
            jacobian = contact_derivatives(parameters, o.joints, o.centers, o.radii, found, o.gripper).parameters
        residual = measured - found.force
        return _Iterate(parameters, residual, jacobian, force_error(residual))

    at = visit(cell.nominal)
    visited, rank = [at], 0
    while len(visited) <= MOST_STEPS:
        step, rank = _pseudo_inverse_step(at)
        better = _lower(visit, at, step)
        if better is None:
            break
        gain, at = at.merit - better.merit, better
        visited.append(at)
        if gain < 1e-12:  # N
            break
    history = tuple(force_error(force_residual(observations, ExtendedModel(item.parameters))) for item in visited)
    return PaperFit(at.parameters, history[-1], history, tuple(item.merit for item in visited), rank)


def _pseudo_inverse_step(at: _Iterate, cutoff: float = 1e-7, longest_step: float = 1.0) -> tuple[Floats, int]:
    """The step J⁺ ΔF (13) in scaled parameters, shortened to the bound, and the rank used."""
    jacobian = (at.jacobian * SCALES).reshape(-1, len(SCALES))
    u, values, vt = np.linalg.svd(jacobian, full_matrices=False)
    rank = int((values > cutoff * values[0]).sum())
    scaled = vt[:rank].T @ ((u.T @ at.residual.ravel())[:rank] / values[:rank])
    longest = float(np.abs(scaled).max())
    return SCALES * scaled * min(1.0, longest_step / max(longest, 1e-300)), rank


def _lower(visit, at: _Iterate, step: Floats) -> _Iterate | None:  # type: ignore[no-untyped-def]
    """The first of the step, its half, its quarter, … that decreases the error index; None if none does."""
    for halving in range(13):
        trial = visit(Parameters.from_array(at.parameters.as_array() + 2.0**-halving * step))
        if trial.merit < at.merit:
            return trial
    return None

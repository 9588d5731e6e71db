"""The contact of the tip with discs: A(Q, L̄) (9) (11), unilateral, and its derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.cell import GripperSign
from scara_kinetostatic.model.contact_state import State, free_state
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.equilibrium import nearest_equilibrium, solve_state
from scara_kinetostatic.model.extended_equations import ContactProblem, all_derivatives, extended_equations
from scara_kinetostatic.model.extended_model import ExtendedModel, as_model
from scara_kinetostatic.model.gripper import Gripper, as_gripper
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import THETA1, THETA2, Parameters

_NEGATIVE_BACKLASH = 1e-3
"""How far outside the disc the rigid tip may be for a force to be possible at all, m."""


class Contact(NamedTuple):
    """The contact of n touches with their discs.

    Attributes:
        force: F on the object, base frame, (n, 2), N; zero without contact.
        magnitude: f, (n,), N; negative where the tip would have to pull
            (only with `tension`).
        tip: S, (n, 2), m.
        links: Q*, (n, 2), rad.
        state: the solution, with the modes of both joints.
        solved: whether Newton's method converged, (n,).
    """

    force: Floats
    magnitude: Floats
    tip: Floats
    links: Floats
    state: State
    solved: Mask


def contact(
    model: ExtendedModel | Parameters,
    joints: ArrayLike,
    centers: ArrayLike,
    radii: ArrayLike,
    gripper: Gripper | GripperSign = GripperSign.PHYSICAL,
    tension: bool = False,
    warm_start: ArrayLike | None = None,
    metadata: TouchMetadata | None = None,
    off_normal: Floats | None = None,
) -> Contact:
    """A(Q, L̄) for touches whose disc is known.

    Args:
        model: the extended model, or L̄ of the base model alone.
        joints: Q, (n, 2), rad.
        centers: centre of each touch's disc, (n, 2), m.
        radii: its radius, (n,), m.
        gripper: the form of (7); a bare sign is the isotropic gripper.
        tension: let the tip pull at the disc where it does not reach it (a smooth
            continuation for fitting), instead of no force as (9) has it.
        warm_start: a force per touch, (n, 2), N; where there are several equilibria, the one
            closest to it is taken.
        metadata: what effects need to know of each touch; by default `TouchMetadata.plain`.
        off_normal: off-normal angle of the force in each touch, (n,), rad, where an effect lets it differ from touch
            to touch.

    Returns:
        Force, tip and link angles. Without contact the force is zero, the joints
        are in the middle of their dead bands and the tip is at H(L, Q).
    """
    model = as_model(model)
    parameters = model.parameters
    contact_problem = _contact_problem(model, joints, centers, radii, gripper, metadata)._replace(off_normal=off_normal)
    state, solved = solve_state(model, contact_problem)
    if warm_start is not None:
        state = nearest_equilibrium(model, contact_problem, state, np.asarray(warm_start))
    if not tension:
        shifted = contact_problem.shifted(model, state)
        free = free_state(parameters, shifted.joints, shifted.centers)
        touching = solved & (state.magnitude > 0)
        if contact_problem.gripper.sign is GripperSign.PHYSICAL:
            touching &= _reaches(parameters, free, shifted.centers, contact_problem.radii)
        zero = free._replace(mode1=np.zeros_like(free.mode1), mode2=np.zeros_like(free.mode2))
        state = zero.replace_where(touching, state)
    return _as_contact(model, contact_problem, state, solved)


def _contact_problem(
    model: ExtendedModel,
    joints: ArrayLike,
    centers: ArrayLike,
    radii: ArrayLike,
    gripper: Gripper | GripperSign,
    metadata: TouchMetadata | None,
) -> ContactProblem:
    joints = np.atleast_2d(np.asarray(joints, dtype=float))
    centers = np.broadcast_to(np.asarray(centers, dtype=float), joints.shape)
    radii = np.broadcast_to(np.asarray(radii, dtype=float), joints.shape[:1])
    if metadata is None and model.effects:
        metadata = TouchMetadata.plain(len(joints))
    return ContactProblem(joints, centers, radii, as_gripper(gripper), metadata)


def _reaches(parameters: Parameters, free: State, centers: Floats, radii: Floats) -> Mask:
    """Whether the rigid tip H(L, Q) is inside the disc, (n,): only then can there be a force (section 4.2).

    `_NEGATIVE_BACKLASH` allows for backlashes that noise has made negative.
    """
    tip = forward(parameters, np.stack([free.link1, free.link2], axis=-1))
    return np.hypot(tip[:, 0] - centers[:, 0], tip[:, 1] - centers[:, 1]) < radii + _NEGATIVE_BACKLASH


def _as_contact(model: ExtendedModel, contact_problem: ContactProblem, state: State, solved: Mask) -> Contact:
    discs = contact_problem.centers
    if model.effects:
        at = contact_problem.touch_state(model.parameters, state)
        discs = discs - model.object_shift(at)
    unit = np.stack([np.cos(state.direction), np.sin(state.direction)], axis=-1)
    links = np.stack([state.link1, state.link2], axis=-1)
    rigid = forward(model.parameters, links)
    loaded = (state.magnitude != 0)[:, None]
    tip = np.where(loaded, discs - contact_problem.radii[:, None] * unit, rigid)
    return Contact(state.magnitude[:, None] * unit, state.magnitude, tip, links, state, solved)


def contact_force(
    parameters: Parameters,
    joints: ArrayLike,
    centers: ArrayLike,
    radii: ArrayLike,
    gripper: Gripper | GripperSign = GripperSign.PHYSICAL,
) -> Floats:
    """A(Q, L̄) over several discs: the force on the disc that the arm presses, zero where it presses none.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        centers: centres of all discs, (m, 2), m.
        radii: their radii, (m,), m.
        gripper: the form of (7); a bare sign is the isotropic gripper.

    Returns:
        F on the object, base frame, (n, 2), N. Discs do not overlap, so at most one is pressed.
    """
    joints = np.atleast_2d(np.asarray(joints, dtype=float))
    force, magnitude = np.zeros_like(joints), np.zeros(len(joints))
    for center, radius in zip(np.asarray(centers), np.asarray(radii), strict=True):
        other = contact(parameters, joints, center, radius, gripper)
        stronger = other.magnitude > magnitude
        force = np.where(stronger[:, None], other.force, force)
        magnitude = np.where(stronger, other.magnitude, magnitude)
    return force


class ContactDerivatives(NamedTuple):
    """Derivatives of A(Q, L̄) at n touches; zero without contact.

    Attributes:
        joints: A_Q, (n, 2, 2), N/rad.
        parameters: A_L̄ = J_L̄ (12), (n, 2, 12 + k), N per unit of the parameter, in the order of `ExtendedModel.names`.
    """

    joints: Floats
    parameters: Floats


def contact_derivatives(
    model: ExtendedModel | Parameters,
    joints: ArrayLike,
    centers: ArrayLike,
    radii: ArrayLike,
    found: Contact,
    gripper: Gripper | GripperSign = GripperSign.PHYSICAL,
    metadata: TouchMetadata | None = None,
) -> ContactDerivatives:
    """∂A/∂Q and ∂A/∂L̄ by the implicit function theorem: h_F dF = -h_Q dQ - h_L̄ dL̄.

    Args:
        model: the extended model, or L̄ of the base model alone.
        joints: Q, (n, 2), rad.
        centers: centre of each touch's disc, (n, 2), m.
        radii: its radius, (n,), m.
        found: what `contact` returned for the same arguments.
        gripper: the form of (7); a bare sign is the isotropic gripper.
        metadata: as in `contact`.
    """
    model = as_model(model)
    contact_problem, state = _contact_problem(model, joints, centers, radii, gripper, metadata), found.state
    loaded = (state.magnitude != 0).astype(float)
    state = state._replace(
        mode1=np.where(loaded == 0, 1, state.mode1), mode2=np.where(loaded == 0, 1, state.mode2)
    )  # an unloaded touch has derivative zero; any flank keeps the algebra regular
    e = extended_equations(model, contact_problem, state)
    h_l = all_derivatives(model, contact_problem, state, e)
    det = e.normal_f * e.tangent_d - e.normal_d * e.tangent_f
    with np.errstate(divide='ignore', invalid='ignore'):
        f_h = np.stack([e.tangent_d, -e.normal_d], axis=-1) / det[:, None]
        d_h = np.stack([-e.tangent_f, e.normal_f], axis=-1) / det[:, None]
    n = np.stack([e.rows.arm.nx, e.rows.arm.ny], axis=-1)
    t = np.stack([-e.rows.arm.ny, e.rows.arm.nx], axis=-1)
    # the force per metre of residual, (n, 2, 2)
    stiffness = n[:, :, None] * f_h[:, None, :] + (state.magnitude[:, None] * t)[:, :, None] * d_h[:, None, :]
    stiffness = np.where(loaded[:, None, None] > 0, -stiffness, 0.0)
    h_q = h_l[:, :, [THETA1, THETA2]]
    return ContactDerivatives(stiffness @ h_q, stiffness @ h_l)

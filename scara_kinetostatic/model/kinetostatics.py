"""The deformable robot: direct and inverse kinetostatics H̄ and Ḡ (4), from (6), (7) and (8).

The law of the joints is in `model.joint_law`, the derivatives of the tip by the parameters in `model.tip`.

**Effects.** With effects (`extended_model`) the law of the joints (6) becomes q - q* = p c + g sign(c) + δ and the tip
is at S = H(Q*) + (S - S*) + d. What an effect does to the object or to the force sensor is no part of H̄ and Ḡ. As δ
and d depend on the pose itself, it is found by fixed-point iteration.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel, as_model
from scara_kinetostatic.model.kinematics import GripperSign
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.tip import Force, Law, joints_under_load
from scara_kinetostatic.model.touch_equations import State, step_links


def tip_yield(parameters: Parameters, joints: Floats, force: Floats) -> Floats:
    """How far arm and gripper yield to a force at the tip, (n, 2), m: C F, C that of (4) with (7), without backlash.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        force: F on the object, (n, 2), N.
    """
    p, turns = parameters, kinematics.jacobian(parameters, joints)
    angles = np.array([p.p1, p.p2]) * np.einsum('nij,ni->nj', turns, force)
    return np.asarray(p.p_ee * force + np.einsum('nij,nj->ni', turns, angles))


def press_aside(parameters: Parameters, joints: Floats, force: Floats, aside: ArrayLike) -> Floats:
    """ΔQ of a press that adds a force along the normal, and drags the tip aside, (n, 2), rad.

    J ΔQ is along C R(a) F: a tip that friction held would press at the angle a from the normal; where the angle of
    friction is smaller, it slides. If need be it is turned until the angle from F is a, too; its slope is at most
    `STEEPEST`. With a = 0 the tip stays where it is.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        force: F on the object, along the normal, (n, 2), N, not 0.
        aside: a, (n,), rad.
    """
    held = tip_yield(parameters, joints, kinematics.rotate(force, aside))
    square, across = (force**2).sum(axis=1), kinematics.quarter_turn(force)
    along, side = (held * force).sum(axis=1), np.sign(aside)
    slope = np.where(along > 0, (held * across).sum(axis=1) / np.where(along > 0, along, 1.0), side * STEEPEST)
    slope = np.where(side == 0, slope, side * np.clip(side * slope, np.tan(np.abs(aside)), STEEPEST))
    along = (tip_yield(parameters, joints, force) * force).sum(axis=1) / square
    moved = along[:, None] * (force + slope[:, None] * across)
    return np.asarray(np.linalg.solve(kinematics.jacobian(parameters, joints), moved[..., None])[..., 0])


DRAG = 0.5
"""Angle from the normal at which a press drags the tip aside, rad. With 0.4 friction of 0.15 and the gap of the gripper
still hold the tip in one of 24 touches in the physics engine, with 0.5 in none.
"""


STEEPEST = 2.0
"""Largest way aside over that along the normal. With 1.5 a tip that is held presses at less than 0.15 rad from the
normal in 6 % of the touches of soft arms, with 2 in none.
"""


def drag(angle: Floats, posture: ArrayLike) -> Floats:
    """Angle at which touches drag the tip aside, (n,), rad: `DRAG` to either side in turn.

    The tip then slides, and friction has its whole force, whatever the tip did before.

    Args:
        angle: place around the object, (n,), rad; the side changes every 15°.
        posture: elbow posture, +1 or -1, (n,); the other one has the other side.
    """
    # a quarter of a step off the places that are planned, on discs and, half a step on, on outlines
    turn = np.floor(np.asarray(angle) / (np.pi / 12) + 0.25) + (np.asarray(posture) > 0)
    return np.where(turn % 2 == 0, DRAG, -DRAG)


def inverse_kinetostatics(
    model: ExtendedModel | Parameters,
    tip: ArrayLike,
    force: ArrayLike,
    posture: ArrayLike,
    gripper: GripperSign = GripperSign.PHYSICAL,
    metadata: TouchMetadata | None = None,
) -> tuple[Floats, Floats]:
    """Ḡ: the actuator angles and torques that hold a tip at a place under a force (4).

    Args:
        model: the extended model, or L̄ of the base model alone.
        tip: S, (n, 2), m.
        force: F on the object, base frame, (n, 2), N; where a torque is zero the joint is in the middle of its dead
            band.
        posture: +1 or -1, the sign of sin(q2* + theta2), (n,) or one for all.
        gripper: the form of (7).
        metadata: what effects need to know of each pose; by default `TouchMetadata.plain`. Effects on the object
            are no part of this.

    Returns:
        Q, (n, 2), rad, NaN where the place is out of reach, and C, (n, 2), Nm.
    """
    place, load = np.broadcast_arrays(np.atleast_2d(tip), np.atleast_2d(force))
    law, known = Law(as_model(model), gripper), metadata or TouchMetadata.plain(len(place))
    with np.errstate(invalid='ignore'):
        found = joints_under_load(law, place, Force.of(load), np.asarray(posture), known)
    return found.joints, np.array([found.loading.c1, found.loading.c2]).T


def direct_kinetostatics(
    model: ExtendedModel | Parameters,
    joints: Floats,
    force: Floats,
    gripper: GripperSign = GripperSign.PHYSICAL,
    metadata: TouchMetadata | None = None,
) -> tuple[Floats, Floats]:
    """H̄: the tip's place and the torques from what sensors measure, actuator angles and the force, by law (6).

    Where a link is nearly in line with a force that compresses it, law (6) has several solutions. Use of a calibration,
    where nothing may jump, is `tip`.

    Args:
        model: the extended model, or L̄ of the base model alone.
        joints: Q, (n, 2), rad.
        force: F on the object, base frame, (n, 2), N; where it is zero the joints are in the middle of their dead
            bands.
        gripper: the form of (7).
        metadata: what effects need to know of each pose; by default `TouchMetadata.plain`.

    Returns:
        S, (n, 2), m, and C, (n, 2), Nm.
    """
    law, load, known = Law(as_model(model), gripper), Force.of(force), metadata
    p = law.model.parameters
    pressed = (np.any(force != 0, axis=1) | p.has_gravity)[:, None]
    known = TouchMetadata.plain(len(force)) if known is None else known
    turn = moved = np.zeros(np.shape(joints))
    for _ in range(60):
        links = np.where(pressed, _links(p, joints - turn, force), joints - turn)
        first = links[:, 0] + p.theta1
        at = law.loading(first, first + links[:, 1] + p.theta2, load)
        if not law.model.effects:
            break
        before, (turn, moved) = (turn, moved), law.shift(law.touch_state(joints, at, load, known), load.place)
        if not np.any(np.abs([turn - before[0], moved - before[1]]) > 1e-15):
            break
    return np.array(at.tip(p)).T + moved, np.array([at.c1, at.c2]).T


def _links(parameters: Parameters, joints: Floats, force: Floats) -> Floats:
    """Q* of joints under a force, (n, 2), by Newton's method.

    Where a link is nearly in line with a force that compresses it, the floating joint is unstable, and the flanks
    alternate from one start: then the others are tried.
    """
    links, settled = _links_from((1.0, 1.0), parameters, joints, force)
    wrong = np.flatnonzero(~settled)
    for start in ((-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)):
        if not len(wrong):
            break
        found, settled = _links_from(start, parameters, joints[wrong], force[wrong])
        links[wrong[settled]] = found[settled]
        wrong = wrong[~settled]
    return links


def _links_from(
    start: tuple[float, float], parameters: Parameters, joints: Floats, force: Floats
) -> tuple[Floats, Mask]:
    """Q* from flanks to start on, (n, 2), and whether links and flanks agree, (n,)."""
    magnitude, direction = np.hypot(force[:, 0], force[:, 1]), np.arctan2(force[:, 1], force[:, 0])
    flanks = (np.full(len(joints), each) for each in start)
    state = State(joints[:, 0], joints[:, 1], magnitude, direction, *flanks)
    for _ in range(20):  # three or four suffice
        before, (state, arm) = state, step_links(parameters, joints, state)
        if ((state.mode1 != before.mode1) | (state.mode2 != before.mode2)).any():
            state, _ = step_links(parameters, joints, state, arm=arm)
        if not np.any(_change(state, before) > 1e-15):
            break
    further, _ = step_links(parameters, joints, state)
    settled = (_change(state, further) < 1e-12) & (state.mode1 == further.mode1) & (state.mode2 == further.mode2)
    return np.stack([state.link1, state.link2], axis=-1), np.asarray(settled)


def _change(one: State, other: State) -> Floats:
    """The larger change of both link angles, (n,), rad."""
    return np.asarray(np.maximum(np.abs(one.link1 - other.link1), np.abs(one.link2 - other.link2)))

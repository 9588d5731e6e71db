"""Expanded uncertainty of the tip over the workspace (GUM, JCGM 100, 5.2 and 6.2).

The tip that the calibrated model gives for joint angles Q and a force F has the covariance J Σ Jᵀ with J = ∂S/∂L̄ at
fixed Q and F and Σ the covariance of the calibration. Its standard uncertainty is that in the worst direction, the root
of the largest eigenvalue. From (5) to (8), with Q* = Q - p c - g sign(c), column by column

    ∂S/∂(x0, y0) = I,          ∂S/∂theta_i = J_i,         ∂S/∂l_i = the unit vector of link i,
    ∂S/∂p_i = -J_i c_i,        ∂S/∂g_i = -J_i sign(c_i),  ∂S/∂p_ee = ∓F,   ∂S/∂g_ee = -F/‖F‖,

J_i the columns of J (2) at Q*. What these leave out, the change of the torques along with the parameters, is smaller by
the deflection over the length of the arm, about one part in a thousand. An effect with the shift δ of the joints and d
of the tip adds d - J δ.

The **workspace** is where the calibrated arm reaches in the elbow postures that were touched, all round, up to
`NEARLY_STRETCHED` of its length: without load, and under the mean force of the touches in 12 directions, of which the
worst counts; where the cell has a region or limits of the joints, the poses that are in them, and where these ask for
a posture that was not touched, that as well. J is bounded everywhere: H̄ needs no inverse, unlike Ḡ where the arm is
stretched. Places whose joint angles are not between those of the touches are extrapolated; the map says which.

**Several possible causes** (`Calibration.alternatives`) make the tip a mixture of normal distributions, one for each
set of effects, by their probabilities. U is then the radius about its mean that holds the tip with `LEVEL` (JCGM 101,
7.7), under the force with the largest variance at each place. The probability that one of them, turned into its axes,
is within r is an integral along the longer one, by Gauss and Legendre:

    P = ∫_(-r)^r N(x; m_x, s_x) [Φ((√(r² - x²) - m_y)/s_y) - Φ((-√(r² - x²) - m_y)/s_y)] dx.

The play of a joint without load is not part of it: this is a property of the arm, not of the calibration.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr

from scara_kinetostatic.calibration.result import Calibration, of_full_model
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, as_complex
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import TouchMetadata, TouchState
from scara_kinetostatic.model.gravity import pull_of_links
from scara_kinetostatic.model.joint_law import joint_deflection, joint_torques
from scara_kinetostatic.model.kinematics import (
    LoadedJoints,
    forward,
    inverse,
    jacobian,
    link_vectors,
    tip_by_parameters,
    wrap,
)
from scara_kinetostatic.model.kinetostatics import with_effects
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.quantities import percentage

COVERAGE_FACTOR = 2.0
"""k of the expanded uncertainty U = k u: about 95 % of a normal distribution."""
NEARLY_STRETCHED = 0.985
"""Of the arm's length: the workspace ends there, and as near to where the arm is folded."""
LEVEL = 0.95
"""Coverage probability of the radius of a mixture."""
_FAR = 8.0
"""Standard deviations beyond which a normal distribution has nothing."""
POSTURES = (1, -1)
"""Of the elbow: left and right."""
LEAST_WITHIN = 0.1
"""Of the touches: limits of the joints that leave fewer are a mistake; of the places within reach: that is said."""


class Poses(NamedTuple):
    """Poses of the arm.

    Attributes:
        joints: Q, (n, 2), rad.
        posture: +1 or -1, (n,).
        force: F on the object, base frame, (n, 2), N.
    """

    joints: Floats
    posture: Indices
    force: Floats


class UncertaintyMap(NamedTuple):
    """Expanded uncertainty of the tip in one elbow posture, on a grid of its places.

    Attributes:
        posture: +1 for left, -1 for right.
        x: of the columns, (k,), m.
        y: of the rows, (m,), m.
        expanded: U, the largest of all forces, (m, k), m; NaN where the arm does not reach or U is not determined.
        touched: whether the joint angles are between those of the touches, (m, k); elsewhere it is extrapolated.
    """

    posture: int
    x: Floats
    y: Floats
    expanded: Floats
    touched: Mask


class WorstPose(NamedTuple):
    """Where the uncertainty of the tip is largest.

    Attributes:
        tip: place of the tip, (2,), m.
        joints: Q, (2,), rad.
        posture: +1 or -1.
        force: F on the object, (2,), N.
        direction: of the largest uncertainty, a unit vector, (2,).
        gradient: change of the tip along it by each value of the model, (12 + k,).
    """

    tip: Floats
    joints: Floats
    posture: int
    force: Floats
    direction: Floats
    gradient: Floats

    @property
    def title(self) -> str:
        """The place in words: ``x 161 mm, y −607 mm``."""
        x, y = (f'{round(1e3 * value)} mm'.replace('-', '−') for value in self.tip)
        return f'x {x}, y {y}'


class TipUncertainty(NamedTuple):
    """Expanded uncertainty of the tip over the workspace.

    Attributes:
        coverage: what it is, in words: ``k = 2`` or, over several possible causes, ``95 %``.
        median: over the places of the workspace, m; NaN where the data do not determine it.
        worst: the largest, of the places where it is determined, m.
        at: where that is; None where nothing is determined.
        median_touched: the median where the joint angles are between those of the touches, m.
        worst_touched: the largest there, m.
        undetermined: part of the places where the data do not determine it, 0 to 1.
        maps: of each posture.
        alone: part of the places that the limits of the joints leave to the left posture alone, and to the right one.
        share: part of the region within reach that these limits leave, 0 to 1.
    """

    coverage: str
    median: float
    worst: float
    at: WorstPose | None
    median_touched: float
    worst_touched: float
    undetermined: float
    maps: tuple[UncertaintyMap, ...]
    alone: tuple[float, float]
    share: float


class Workspace(NamedTuple):
    """The poses of the workspace, and how the tip changes there with the values of the model.

    Attributes:
        x: of the columns of the grid, (k,), m.
        y: of its rows, (m,), m.
        reached: which places of the grid count in each of `POSTURES`, (2, m, k).
        alone: part of the places that the limits of the joints leave to each of them alone.
        share: part of the region within reach that these leave, 0 to 1.
        poses: P places posture by posture, each under all forces: (P · forces,).
        touched: whether a place is between the touches, (P,).
        derivative: of the tip by the values of the model, (P · forces, 2, 12 + k).
        dependent: change of the tip by what is undetermined, (P · forces,), m.
    """

    x: Floats
    y: Floats
    reached: Mask
    alone: tuple[float, float]
    share: float
    poses: Poses
    touched: Mask
    derivative: Floats
    dependent: Floats

    def variances(self, covariance: Floats) -> Floats:
        """In the worst direction, place by place and force by force, (P, forces), m²; NaN where undetermined."""
        every = tip_covariance(self.derivative, covariance)
        half, off = (every[:, 0, 0] - every[:, 1, 1]) / 2, every[:, 0, 1]
        mean = (every[:, 0, 0] + every[:, 1, 1]) / 2
        undetermined = self.dependent > np.sqrt(2 * mean)  # by plausible ranges more than by a standard uncertainty
        return np.where(undetermined, np.nan, mean + np.hypot(half, off)).reshape(len(self.touched), -1)


def tip_covariance(derivative: Floats, covariance: Floats) -> Floats:
    """J Σ Jᵀ of n poses, (n, 2, 2), m²."""
    moved = (derivative.reshape(-1, derivative.shape[-1]) @ covariance).reshape(derivative.shape)  # one product
    xx, xy = np.einsum('nk,nik->in', moved[:, 0], derivative)
    yy = np.einsum('nk,nk->n', moved[:, 1], derivative[:, 1])
    return np.array([[xx, xy], [xy, yy]]).transpose(2, 0, 1)


def tip_derivative(c: Calibration, poses: Poses) -> Floats:
    """∂S/∂(values of the model) at fixed joint angles and forces, (n, 2, 12 + k)."""
    p, force = c.parameters, poses.force
    links = poses.joints - joint_deflection(p, joint_torques(p, poses.joints, force))
    torques = joint_torques(p, links, force)
    at, pull = LoadedJoints(torque=tuple(torques.T), sense=tuple(np.sign(torques).T)), pull_of_links(p, links)
    if pull is not None:
        at = at._replace(pull=((p.p1, p.p2), tuple(pull.per_moment)))
    base = tip_by_parameters(p, links, force, c.cell.gripper_sign.factor, at)
    if not c.full_model.effects:
        return base
    metadata = TouchMetadata.plain(len(links))._replace(posture=poses.posture)
    vectors, rigid = link_vectors(p, links), forward(p, links)
    state = TouchState.of_poses(p, poses.joints, force, torques, vectors, rigid, metadata)
    return with_effects(base, c.full_model, jacobian(p, links), np.ones(len(links)), state)


class RegionGrid(NamedTuple):
    """A grid of the workspace.

    Attributes:
        x: of its columns, (count,), m.
        y: of its rows, (count,), m.
        places: of them, (count, count, 2), m.
        possible: which of them are in the region, and within the limits of the joints in each of `POSTURES`,
            (2, count, count).
        share: part of the region within reach that the limits of the joints leave, 0 to 1.
    """

    x: Floats
    y: Floats
    places: Floats
    possible: Mask
    share: float


def region_grid(p: Parameters, cell: Cell, count: int = 33) -> RegionGrid:
    """The grid of the workspace; where the limits of the joints leave little of it, that of what they leave.

    Raises:
        ParameterError: no place of the region is within reach, or none within the limits.
    """
    length, shortest = p.l1 + p.l2, abs(p.l1 - p.l2)
    reach, base = NEARLY_STRETCHED * length, np.array([p.x0, p.y0])

    def within(low: Floats, high: Floats) -> RegionGrid:
        x, y = np.linspace(low, high, count).T
        grid = np.stack(np.meshgrid(x, y), axis=-1)
        away = np.hypot(grid[..., 0] - p.x0, grid[..., 1] - p.y0)
        reached = (away <= reach * (1 + 1e-9)) & (away >= shortest + (1 - NEARLY_STRETCHED) * length)
        reached &= cell.region.holds(grid)
        if not reached.any():
            raise ParameterError('region', 'no place in it is within reach of the arm', 'give x and y limits in m')
        possible = np.array([reached & cell.can_take(inverse(p, grid, side)) for side in POSTURES])
        return RegionGrid(x, y, grid, possible, float(possible.any(axis=0).sum() / reached.sum()))

    low, high = np.maximum(base - reach, cell.region[::2]), np.minimum(base + reach, cell.region[1::2])
    found = within(low, high)
    if not found.share:
        problem = f'they leave 0 % of the {cell.region.title} within reach'
        raise ParameterError('robot.limits', problem, 'correct them (rad), or the region')
    if found.share < LEAST_WITHIN:
        some, step = found.places[found.possible.any(axis=0)], (high - low) / (count - 1)
        box = np.maximum(low, some.min(axis=0) - step), np.minimum(high, some.max(axis=0) + step)
        found = within(*box)._replace(share=found.share)
    return found


def workspace(c: Calibration) -> Workspace:
    """The workspace of a calibrated arm.

    Raises:
        ParameterError: as `region_grid`.
    """
    p, touches = c.parameters, c.touches.select(c.used)
    x, y, grid, possible, share = region_grid(p, c.cell)
    alone = possible & ~possible[::-1]
    reached = possible & (np.isin(POSTURES, touches.posture)[:, None, None] | alone)
    joints = np.concatenate([inverse(p, grid[at], side) for side, at in zip(POSTURES, reached, strict=True)])
    posture = np.repeat(POSTURES, reached.sum(axis=(1, 2)))
    touched = np.concatenate(
        [_is_between(joints[posture == sign], touches.joints[touches.posture == sign]) for sign in POSTURES]
    )
    forces = _forces(c, joints)
    each = np.arange(len(joints)).repeat(forces.shape[1])
    poses = Poses(joints[each], posture[each], forces.reshape(-1, 2))
    derivative = tip_derivative(c, poses)
    dependent = np.linalg.norm(derivative @ c.undetermined, axis=(1, 2))
    left, right = (alone.sum(axis=(1, 2)) / possible.any(axis=0).sum()).tolist()
    return Workspace(x, y, reached, (left, right), share, poses, touched, derivative, dependent)


def _forces(c: Calibration, joints: Floats) -> Floats:
    """No force, and the mean force of the used touches in 12 directions of each pose, (P, 13, 2), N.

    A torque changes its sense, and the tip jumps by the backlash, where the force passes through the axis of the joint:
    both sides of these directions, as near as the noise of the force leaves the sense known (4 σ), and the middles
    between them.
    """
    mean = float(np.hypot(*c.force[c.used].T).mean())
    link_1, link_2 = link_vectors(c.parameters, joints)
    first, second = (np.arctan2(arm[:, 1], arm[:, 0]) for arm in (link_1 + link_2, link_2))
    between, aside = np.mod(second - first, np.pi), np.full(len(joints), 4 * max(c.noise.force_levels) / mean)
    middles = between / 2, (between + np.pi) / 2
    half = first + np.stack([aside, np.pi - aside, between - aside, between + aside, *middles])
    angles = np.concatenate([half, half + np.pi]).T
    return mean * np.pad(np.stack([np.cos(angles), np.sin(angles)], axis=-1), ((0, 0), (1, 0), (0, 0)))


def _is_between(joints: Floats, touched: Floats) -> Mask:
    """Whether joint angles, (n, 2), are in the convex hull of those of touches, (m, 2); none where m is below 3.

    The corners are found in the order of x and back (A. M. Andrew, Information Processing Letters 9 (1979) 216).
    """
    centre = touched.sum(axis=0) / max(len(touched), 1)
    places, points, corners = as_complex(wrap(joints - centre)), as_complex(wrap(touched - centre)), list[complex]()
    for ordered in (np.unique(points), np.unique(points)[::-1]):
        side = list[complex]()
        for point in ordered.tolist():
            while len(side) > 1 and _turn(side[-1] - side[-2], point - side[-1]) <= 0:
                side.pop()
            side.append(point)
        corners += side[:-1]
    if len(corners) < 3:
        return np.zeros(len(joints), dtype=bool)
    edges = zip(corners, [*corners[1:], corners[0]], strict=True)
    return np.all([_turn(end - begin, places - begin) >= 0 for begin, end in edges], axis=0)


def _turn(one: complex, other: Any) -> Any:
    """Sine of the angle from one vector to others, times both lengths."""
    return (one.conjugate() * other).imag


def tip_uncertainty(c: Calibration) -> TipUncertainty:
    """Expanded uncertainty of the tip over the workspace of a calibration."""
    area = workspace(c)
    variances = area.variances(c.covariance)
    expanded = COVERAGE_FACTOR * np.sqrt(variances.max(axis=1))
    if c.alternatives:
        largest = np.arange(len(expanded)), np.nan_to_num(variances).argmax(axis=1)
        worst = area.derivative.reshape(*variances.shape, 2, -1)[largest]
        expanded = np.where(np.isfinite(expanded), _mixture_radius(c, worst), np.nan)
    known = np.isfinite(expanded)
    values, touched = np.full(area.reached.shape, np.nan), np.zeros(area.reached.shape, dtype=bool)
    values[area.reached], touched[area.reached] = expanded, area.touched
    maps = zip(POSTURES, values, touched, area.reached, strict=True)
    return TipUncertainty(
        coverage=percentage(LEVEL) if c.alternatives else f'k = {COVERAGE_FACTOR:g}',
        median=_statistic(np.median, expanded[known]),
        worst=_statistic(np.max, expanded[known]),
        at=_worst_pose(c, area, variances, expanded),
        median_touched=_statistic(np.median, expanded[known & area.touched]),
        worst_touched=_statistic(np.max, expanded[known & area.touched]),
        undetermined=float(np.mean(~known)),
        maps=tuple(UncertaintyMap(side, area.x, area.y, u, near) for side, u, near, some in maps if some.any()),
        alone=area.alone,
        share=area.share,
    )


def _mixture_radius(c: Calibration, derivative: Floats) -> Floats:
    """Radius about the mean of the alternatives that holds the tip with `LEVEL`, (n,), m.

    Args:
        c: the calibration, at the mean of its alternatives.
        derivative: of the tip by the values of the model at n poses, (n, 2, 12 + k).
    """
    (kept, sizes), weight = of_full_model(c), np.array([item.probability for item in c.alternatives])
    off = np.array([sizes * item.change[kept] for item in c.alternatives])
    own = np.array([sizes[:, None] * item.covariance[np.ix_(kept, kept)] * sizes for item in c.alternatives])
    more = c.covariance - np.tensordot(weight, own, 1) - off.T @ (weight[:, None] * off)  # what all have in common
    means = np.moveaxis(derivative @ off.T, -1, 1)
    return radius(weight, means, np.stack([tip_covariance(derivative, one + more) for one in own], axis=1))


def radius(probabilities: Floats, means: Floats, covariances: Floats) -> Floats:
    """Radii about the origin that hold mixtures of plane normal distributions with `LEVEL`, (n,).

    Args:
        probabilities: of the components, (k,).
        means: (n, k, 2).
        covariances: (n, k, 2, 2).
    """
    values, axes = np.linalg.eigh(covariances)
    std = np.sqrt(np.maximum(values, 1e-300))
    mean = (axes.swapaxes(-1, -2) @ means[..., None])[..., 0]
    nodes, weights = np.polynomial.legendre.leggauss(24)
    low, high = np.zeros(len(means)), (np.linalg.norm(means, axis=-1) + _FAR * std[..., 1]).max(axis=1)
    for _ in range(20):
        middle = (low + high) / 2
        r = middle[:, None]
        ends = np.maximum(-r, mean[..., 1] - _FAR * std[..., 1]), np.minimum(r, mean[..., 1] + _FAR * std[..., 1])
        half = np.maximum(ends[1] - ends[0], 0) / 2
        x = ((ends[0] + ends[1]) / 2)[..., None] + half[..., None] * nodes
        y = np.sqrt(np.maximum(r[..., None] ** 2 - x**2, 0))
        across, off, s = std[..., :1], mean[..., :1], std[..., 1:]
        density = np.exp(-0.5 * ((x - mean[..., 1:]) / s) ** 2) / (s * np.sqrt(2 * np.pi))
        within = density * (ndtr((y - off) / across) - ndtr((-y - off) / across))
        is_less = (half * (within @ weights)) @ probabilities < LEVEL
        low, high = np.where(is_less, middle, low), np.where(is_less, high, middle)
    return np.asarray(high)


def _statistic(function: Callable[[Floats], Any], values: Floats) -> float:
    return float(function(values)) if len(values) else float('nan')


def _worst_pose(c: Calibration, area: Workspace, variances: Floats, expanded: Floats) -> WorstPose | None:
    """That with the largest uncertainty, of the places where it is determined under all forces."""
    if not np.isfinite(expanded).any():
        return None
    place = int(np.nanargmax(expanded))
    number = place * variances.shape[1] + int(np.argmax(variances[place]))
    derivative = area.derivative[number]
    direction = np.linalg.eigh(derivative @ c.covariance @ derivative.T)[1][:, -1]
    joints = area.poses.joints[number]
    return WorstPose(
        tip=forward(c.parameters, joints),
        joints=joints,
        posture=int(area.poses.posture[number]),
        force=area.poses.force[number],
        direction=direction,
        gradient=direction @ derivative,
    )

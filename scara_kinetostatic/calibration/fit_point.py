"""A model with all touches linearised at it: what a step of the solver starts from, and where it leads.

`project` adjusts touches to a given model: how far each is from what the model allows. `force_residual` is F - A(Q, L̄),
`force_error` the index e_f (10).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.gauss_helmert import (
    Adjusted,
    Linearisation,
    Whitened,
    adjust,
    as_measured,
    as_radial,
    first_guess,
    linearise,
    squared_distance,
    whiten,
)
from scara_kinetostatic.calibration.observations import NO_ERRORS, Observations
from scara_kinetostatic.gaussian.linear_model import Marginal
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, pick, put
from scara_kinetostatic.model.cell import Cell, Noise, force_covariance
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.extended_model import ExtendedModel, true_force
from scara_kinetostatic.model.flanks import Arm
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.kinetostatics import Force, Law
from scara_kinetostatic.model.parameters import Parameters


def unfitted(point: Point, level: Floats | None = None) -> tuple[Marginal, Floats]:
    """M of the declared errors and random effects, and the whitened residual without them, M (w - N e), (2n,).

    Args:
        point: the fit.
        level: the random effects count in M with sizes larger by this, (r,); None for 1.
    """
    w, rows = point.whitened, point.whitened.residual.size
    if w.by_errors is None:
        return Marginal.of(None, rows), w.residual.ravel()
    columns = w.by_errors.reshape(rows, -1)
    larger = np.ones(columns.shape[1])
    if level is not None and len(level):
        larger[-len(level) :] = level
    marginal = Marginal.of(columns * larger, rows)
    return marginal, marginal.apply(w.residual.ravel() - columns @ point.errors)


def augmented(point: Point, columns: Floats) -> Floats:
    """Whitened columns (2n, k) beside those of the declared errors, with the rows of their prior, (2n + m, m + k)."""
    w = point.whitened
    if w.by_errors is None:
        return columns
    m = w.by_errors.shape[2]
    beside = np.concatenate([w.by_errors.reshape(len(columns), -1), columns], axis=1)
    return np.concatenate([beside, np.eye(m, beside.shape[1])])


class Stage(NamedTuple):
    """What one run minimises, and to what tolerance.

    Attributes:
        adjusts: whether observations are adjusted or taken as measured.
        robust: Cauchy's loss instead of the sum of squares.
        tolerance: a step that moves all predictions together by fewer standard deviations than this ends the run.
        per_touch: the same for the root mean square over the touches; the larger bound counts. The last stage has to
            be exact, the others need not be, unless there are effects, which may be far from linear. A run ends, too,
            at a step that is negligible (`solver`).
        damping: least damping. With 1, a direction of L̄ whose whole plausible range hardly shows in the data (singular
            value below 1) is not changed before its identifiability has been examined.
    """

    adjusts: bool
    robust: bool
    tolerance: float
    per_touch: float
    damping: float


COARSE = Stage(adjusts=False, robust=True, tolerance=0.3, per_touch=0.3, damping=1.0)
ROBUST = Stage(adjusts=True, robust=True, tolerance=1e-2, per_touch=0.1, damping=1.0)
FINAL = Stage(adjusts=True, robust=False, tolerance=1e-6, per_touch=0.0, damping=0.0)


_ROUNDS = 3
"""In which touches are adjusted to a given model at most: those that do not alternate settle in as many, mostly."""


class Point(NamedTuple):
    """The adjustment evaluated at one model.

    Attributes:
        model: the model.
        adjusted: where its equations are linearised.
        linear: the equations there.
        whitened: the same in units of standard deviations.
        distance: squared Mahalanobis distance of each touch, (n,).
        errors: declared errors of the cell description, (m,).
    """

    model: ExtendedModel
    adjusted: Adjusted
    linear: Linearisation
    whitened: Whitened
    distance: Floats
    errors: Floats = NO_ERRORS

    def changed(self, change: Floats) -> tuple[ExtendedModel, Floats]:
        """Model and declared errors after a change of all values, (12 + k + m,)."""
        values = self.model.as_array()
        return self.model.with_array(values + change[: len(values)]), self.errors + change[len(values) :]

    def with_noise(self, noise: Noise) -> Point:
        """The same point, whitened with another noise."""
        (l11, l21, l22), (first, second) = self.whitened.root, self.whitened.residual.T
        misclosure = np.array([l11 * first, l21 * first + l22 * second]).T
        whitened = whiten(self.linear._replace(misclosure=misclosure), noise)
        return self._replace(whitened=whitened, distance=squared_distance(whitened))

    @property
    def parameters(self) -> Parameters:
        """L̄."""
        return self.model.parameters


def evaluate(
    observations: Observations,
    model: ExtendedModel,
    adjusted: Adjusted,
    noise: Noise,
    stage: Stage = FINAL,
    arm: Arm | None = None,
) -> Point:
    """The adjustment linearised and whitened at a model; `arm` saves work where that of the adjusted state is known."""
    linear = linearise(observations, model, adjusted, arm)
    extra: Floats | float = 0.0
    if not stage.adjusts:  # the error of the measured direction of the force, in V11, m²
        force = observations.force
        extra = (observations.radii * force_covariance(noise, force).across / (force**2).sum(axis=-1)) ** 2
    whitened = whiten(linear, noise, extra)
    return Point(model, adjusted, linear, whitened, squared_distance(whitened), observations.errors)


def last_step(point: Point, change: Floats) -> Point:
    """The point after a step so short that it is taken to first order, without evaluating anew."""
    model, errors = point.changed(change)
    w = point.whitened
    whitened = w._replace(residual=w.residual + w.jacobian @ change)
    return point._replace(model=model, whitened=whitened, distance=squared_distance(whitened), errors=errors)


def moved(observations: Observations, point: Point, change: Floats, noise: Noise, stage: Stage, frozen: bool) -> Point:
    """The point after a step, evaluated anew.

    Args:
        observations: the touches.
        point: before.
        change: of all values of the model and the declared errors, (12 + k + m,).
        noise: σ_q and σ_f.
        stage: which run this is.
        frozen: whether every joint stays on its flank.
    """
    model, errors = point.changed(change)
    observations, adjusted = observations.with_errors(errors), point.adjusted
    with np.errstate(all='ignore'):
        if stage.adjusts:
            adjusted, arm = adjust(observations, model, adjusted, point.linear, point.whitened, change, frozen)
        else:
            adjusted, arm = as_measured(observations, model, adjusted.state)
        return evaluate(observations, model, adjusted, noise, stage, arm)


def select(point: Point, which: Mask | Indices | slice) -> Point:
    """The touches of a point that a mask, an array of positions or a slice picks."""
    return Point(point.model, *pick(point[1:5], which), point.errors)


def project(observations: Observations, model: ExtendedModel, noise: Noise, near: Point | None = None) -> Point:
    """Adjust the observations alone, L̄ held: the nearest point of the model to each touch. A round leaves some 1e-4 of
    the change of the one before.

    Args:
        observations: any touches, good or bad.
        model: the model.
        noise: σ_q and σ_f, the measure of distance.
        near: the same touches adjusted to a model close to this one, to begin at; None to begin without.
    """
    with np.errstate(all='ignore'):
        radial, point = as_radial(observations, model, first_guess(observations, model).state), near
        if point is None or len(point.errors) > len(observations.errors):  # its errors are no longer there
            near, point = None, evaluate(observations, model, radial, noise)
        values = dict(zip(model.names, model.as_array().tolist(), strict=True))
        names = zip(point.model.names, point.model.as_array().tolist(), strict=True)
        errors = observations.errors[: len(point.errors)] - point.errors
        step = np.concatenate([[values.get(name, value) - value for name, value in names], errors])
        some, part, at = observations, point, np.arange(len(observations.joints))  # the touches that still move
        found = list[tuple[Indices, Point]]()
        for _ in range(_ROUNDS):
            before, expected = part, last_step(part, step).distance
            adjusted, arm = adjust(some, model, part.adjusted, part.linear, part.whitened, step)
            part = evaluate(some, model, adjusted, noise, arm=arm)
            found.append((at, part))
            moving = np.flatnonzero(~(np.abs(part.distance - expected) <= 1e-3 * (1 + part.distance)))
            if not len(moving):
                break
            count = part.whitened.derivative.shape[2] + len(part.errors)
            step, at, before = np.zeros(count), at[moving], select(before, moving)
            some, part = some.select(moving), select(part, moving)
        point = Point(model, *put(found[0][1][1:5], *((which, new[1:5]) for which, new in found[1:])), part.errors)
        if len(moving):  # near a kink of the model one may alternate; what still converges changes less than it counts
            point = _nearer(point, before, at)
        if near is None:
            return point
        if not np.isfinite(point.distance).all():
            return project(observations, model, noise)
        here, there = point.adjusted.state, radial.state
        other = np.flatnonzero((here.mode1 != there.mode1) | (here.mode2 != there.mode2))
        if not len(other):
            return point
        return _nearer(point, project(observations.select(other), model, noise), other)  # one place on each flank


def _nearer(point: Point, other: Point, at: Indices) -> Point:
    """A point with some touches, (m,), adjusted otherwise, where this brings them nearer."""
    nearer = (other.distance < point.distance[at]) | np.isnan(point.distance[at])
    changed = (at[nearer], select(other, nearer)[1:5])
    return Point(point.model, *put(point[1:5], changed), point.errors) if nearer.any() else point


def base_force(observations: Observations, model: ExtendedModel) -> Floats:
    """The measured forces in the base frame, (n, 2), N; the tool frame turns with q1 + theta1 + q2 + theta2.

    Errors of the sensor, if the model has such effects, are corrected.
    """
    force = true_force(model, observations.force, observations.metadata)
    return observations.frame.to_base(force, observations.joints, model.parameters)


def fitted_tips(observations: Observations, point: Point) -> Floats:
    """The places of the tips at a point of all touches, (n, 2), m."""
    state, p = point.adjusted.state, point.parameters
    unit = np.array([np.cos(state.direction), np.sin(state.direction)]).T
    tips = forward(p, np.array([state.link1, state.link2]).T)
    return np.asarray(tips + unit * observations.gripper.stretch(p, state.magnitude)[:, None])


def fitted_surfaces(observations: Observations, cell: Cell, point: Point) -> Indices:
    """Numbers of the surfaces on which a point of all touches has their tips, (n,)."""
    force, metadata = base_force(observations, point.model), observations.metadata
    assert metadata is not None
    tips = fitted_tips(observations, point)
    return cell.surfaces.settled(tips, force / np.hypot(*force.T)[:, None], metadata.disc)


def force_residual(observations: Observations, model: ExtendedModel) -> Floats:
    """F - A(Q, L̄) with the contact unilateral, as (10) takes it, (n, 2), N."""
    o, measured = observations, base_force(observations, model)
    off_normal = _measured_off_normal(o, model) if model.off_normal_std else None
    at, known = o.contact_problem(o.joints), o.metadata
    found = contact(model, *at[:4], warm_start=measured, metadata=known, off_normal=off_normal, edges=at.edges)
    return measured - found.force


def _measured_off_normal(observations: Observations, model: ExtendedModel) -> Floats:
    """Off-normal angle of each measured force, (n,), rad."""
    o = observations
    state = first_guess(o, model).state
    force = base_force(o, model)
    tip = forward(model.parameters, np.stack([state.link1, state.link2], axis=-1))
    inward = (
        o.contact_problem(o.joints)
        .shifted(model, state)
        .inward(tip + np.array(Law(model, o.gripper).offset(Force.of(force))).T)
    )
    across = inward[:, 0] * force[:, 1] - inward[:, 1] * force[:, 0]
    return np.asarray(np.arctan2(across, (inward * force).sum(axis=1)))


def force_error(residual: Floats) -> float:
    """e_f (10): the mean length of the residuals, N."""
    return float(np.hypot(residual[:, 0], residual[:, 1]).mean())

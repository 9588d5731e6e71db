"""The robot for which touches are designed: its cell, what is expected of it, and the noise of a touch.

Predicted covariance of L̄ for a plan of touches, before any touch is made.

The conditions of the touches are linearised where they hold exactly, at Q = Ḡ(S, F) of the expected robot, and whitened
by the noise of a touch. The Jacobian is the one from which the calibration works out its covariance, by the same
functions (`calibration.gauss_helmert`), and directions that the calibration would report as unidentifiable are left out
here as well: a prediction has the rank and the confounded groups of the fit that it predicts.

**Declared uncertainties** of the cell description enter as in the fit (`calibration.observations`): with J and N the
whitened derivatives by L̄ and by the declared errors, and P the rows of the prior, the covariance of both is
([J N]ᵀ[J N] + PᵀP)⁻¹, and that of L̄ is its block. Touches do not make an error smaller that all of them share: with
declared uncertainties the variance does not go with one over the number of touches.

Predicted standard deviation of the tip over the workspace, free and under load.

With the covariance C of L̄, that of the tip is T C Tᵀ, T being its derivative with respect to L̄ at the measured joint
angles and under the force: that of S in (4) with (6) and (7). The standard deviation at a place is √trace(T C Tᵀ).
Places and loads are those for which a calibration states its uncertainty (`calibration.tip_uncertainty`), on a coarser
grid.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.fit_point import Point, evaluate
from scara_kinetostatic.calibration.gauss_helmert import Adjusted
from scara_kinetostatic.calibration.identifiability import group_names, scales_of, unidentifiable_directions
from scara_kinetostatic.calibration.observations import UNDETECTED, DeclaredErrors, Observations, RandomEffects
from scara_kinetostatic.calibration.solver import ActivePrior, Subspace
from scara_kinetostatic.calibration.tip_uncertainty import POSTURES, region_grid, tip_uncertainty
from scara_kinetostatic.calibration.uncertainty_budget import NOISE, uncertainty_budget
from scara_kinetostatic.diagnosis.mixed_model import fit_mixed
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.effects.unnamed import Column
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.gaussian import least_squares
from scara_kinetostatic.gaussian.linear_model import leverage
from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel, TouchMetadata, reported_force
from scara_kinetostatic.model.flanks import State, has_no_sure_sign
from scara_kinetostatic.model.joint_law import joint_deflection
from scara_kinetostatic.model.kinetostatics import (
    Force,
    Law,
    inverse_kinetostatics,
    inverse_of_rows,
    press_aside,
    tip_by_joints,
    tip_by_values,
    tip_under_load,
)
from scara_kinetostatic.model.parameters import MICRO, Parameters
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.simulation.streams import TYPICAL_NOISE, in_sensor_frame, simulate_touches

MANY = 108
"""Touches that are many."""


@dataclass(frozen=True)
class RobotModel:
    """The robot that a design is made for.

    Attributes:
        cell: discs, sensor, nominal parameters, and how well they are known.
        parameters: expected L̄; geometry, compliances and backlashes all enter the prediction.
        noise: repeatability of one touch, one standard deviation, rad and N.
        assumed: parts of the noise that nobody has stated, ``joint`` or ``force``: typical values stand for them.
        effects: effects that are estimated along with L̄.
        effect_values: their values, as in `ExtendedModel`.
        effect_sizes: plausible size of each of these values, (k,), in its unit: their prior.
        random: columns of effects too small to be detected, errors beside the declared ones.
        random_sizes: the standard deviation of each, (r,), in its unit.
        time: when touches are made, after those of the calibration, s.
    """

    cell: Cell
    parameters: Parameters
    noise: Noise
    assumed: tuple[str, ...] = ()
    effects: tuple[Effect, ...] = ()
    effect_values: tuple[tuple[float, ...], ...] = ()
    effect_sizes: tuple[float, ...] = ()
    random: tuple[Column, ...] = ()
    random_sizes: tuple[float, ...] = ()
    time: float = 0.0

    @classmethod
    def of(cls, cell: Cell, parameters: Parameters | None = None, noise: Noise | None = None) -> RobotModel:
        """The robot of a cell.

        Args:
            cell: the cell.
            parameters: expected L̄; by default the nominal parameters.
            noise: by default that of the cell, or typical noise, marked as assumed, if the cell states none.
        """
        stated = noise or cell.noise
        return cls(cell, parameters or cell.nominal, stated or TYPICAL_NOISE, () if stated else ('joint', 'force'))

    @cached_property
    def model(self) -> ExtendedModel:
        """L̄ and the effects."""
        return ExtendedModel(self.parameters, self.effects, self.effect_values)

    @property
    def scales(self) -> Floats:
        """Plausible ranges of L̄, (12,), or (14,) under gravity."""
        return scales_of(ExtendedModel(self.parameters))

    @cached_property
    def declared(self) -> DeclaredErrors | None:
        """What the cell description declares as uncertain; None where everything counts as exactly known."""
        return DeclaredErrors.of(self.cell)

    @cached_property
    def all_scales(self) -> Floats:
        """Units of all values and the declared errors, (12 + k + m,); values of effects in their plausible sizes."""
        errors = 0 if self.declared is None else self.declared.count
        return np.concatenate([self.scales, self.effect_sizes, np.ones(errors)])

    @cached_property
    def declared_rows(self) -> Floats:
        """The rows of the prior of what is declared, in these units, (p, 12 + k + m)."""
        if self.declared is None:
            return np.zeros((0, len(self.all_scales)))
        return self.declared.prior.rows(len(self.all_scales) - self.declared.count) * self.all_scales


@dataclass(frozen=True)
class Prediction:
    """Predicted uncertainty of L̄.

    Attributes:
        touches: number of touches that it holds for.
        covariance: of L̄ over the identifiable directions, (12, 12), or (14, 14) under gravity, SI units.
        std: standard deviations, (12,), SI units; NaN where confounded.
        motions: directions of L̄ that the touches do not determine, (12, d), SI units, of plausible size.
        confounded: groups of parameters of which only combinations are determined, by name.
        leverage: largest eigenvalue of each touch's block of the hat matrix, (m,), 0 to 1; at 1 no other touch checks
            it, and an error in it is not detected.
        together: of L̄ and what the cell declares as uncertain, (12 + m, 12 + m).
    """

    touches: int
    covariance: Floats
    std: Floats
    motions: Floats
    confounded: tuple[tuple[str, ...], ...]
    leverage: Floats
    together: Floats
    declared: DeclaredErrors | None

    @property
    def rank(self) -> int:
        """Number of independent combinations of the base model's parameters that are identifiable."""
        return len(self.std) - self.motions.shape[1]

    def contributions(self, tip: Floats) -> dict[str, float]:
        """Those to the covariance."""
        return contributions(self.together, len(self.std), self.declared, tip)


def is_size(effect: Effect) -> Mask:
    """Which of an effect's values are its size, the others its form, (k,)."""
    return np.asarray(effect.amplitudes(np.ones(len(effect.parameters))) != 0)


class Statement(NamedTuple):
    """What a calibration is expected to state of the tip at the worst place of its workspace.

    Attributes:
        expanded: uncertainty (k = 2), m.
        parts: standard uncertainty by each kind of source, in words, the largest first, m.
    """

    expanded: float
    parts: dict[str, float]

    @property
    def largest(self) -> tuple[str, float]:
        """The largest source, and its part of the variance, 0 to 1."""
        source, part = next(iter(self.parts.items()))
        return source, part**2 / sum(each**2 for each in self.parts.values())

    @classmethod
    def of(cls, robot: RobotModel, plan: Plan) -> Statement:
        """With the touches of a plan, by the functions by which a calibration states it.

        The touches are exact. The errors of the arm that are too small to be detected count, and those of objects of
        which nothing is declared, with their typical sizes or those that the cell states.

        Raises:
            UnsupportedDataError: the touches do not allow a calibration.
        """
        cell = replace(robot.cell, noise=robot.noise)
        before = calibrate(simulate_touches(cell, robot.parameters, plan, Noise(0.0, 0.0)), cell)
        fit = fit_mixed(before, catalogue(cell), expected=True).fit
        tip, squares = tip_uncertainty(fit), defaultdict[str, float](float)
        for item in uncertainty_budget(fit, tip):
            squares[item.title if item.kind in (NOISE, UNDETECTED) else item.kind.replace('_', ' ')] += item.tip**2
        ordered = sorted(squares.items(), key=lambda pair: -pair[1])
        return cls(tip.worst, {source: float(np.sqrt(square)) for source, square in ordered})

    @classmethod
    def of_many(cls, robot: RobotModel, every: Plan, number: int = MANY) -> tuple[int, Statement]:
        """How many touches, evenly distributed over all that can be made, are many, and what is expected with them."""
        at = np.linspace(0, len(every) - 1, min(number, len(every))).round().astype(np.intp)
        return len(at), cls.of(robot, every.select(at))


class ExactTouches(NamedTuple):
    """Touches without noise.

    Attributes:
        observations: what would be measured.
        point: the linearised conditions there.
        arms: distance of each line of force from both joint axes, (m, 2), m; under gravity the torque of each joint
            over the force, 0 where its sign is not sure.
    """

    observations: Observations
    point: Point
    arms: Floats


def exact_plan(robot: RobotModel, plan: Plan, metadata: TouchMetadata | None = None) -> ExactTouches:
    """The touches of a plan without noise, with the derivatives by effects and by what the cell declares as uncertain.

    Args:
        robot: the robot.
        plan: the touches.
        metadata: what effects need to know of them; None for touches that drag the tip aside, from no force or back
            from the preload, each of relaxed joints.

    Raises:
        UnsupportedDataError: the robot cannot reach a touch.
    """
    p, cell, declared = robot.parameters, robot.cell, robot.declared
    surface, surfaces = plan.surface(cell), cell.surfaces
    pressed = -plan.force[:, None] * plan.normal(cell)
    joints, torques = inverse_kinetostatics(p, plan.contact(cell), pressed, plan.posture, cell.gripper_sign)
    if not np.isfinite(joints).all():
        lost = int(np.flatnonzero(~np.isfinite(joints).all(axis=1))[0])
        raise UnsupportedDataError(f'the robot cannot reach touch {lost} of the plan', 'leave it out, or move its disc')
    links, modes = joints - joint_deflection(p, torques), np.sign(torques)
    measured = in_sensor_frame(cell, p, joints, pressed)
    direction = np.arctan2(pressed[:, 1], pressed[:, 0])
    state = State(links[:, 0], links[:, 1], plan.force, direction, modes[:, 0], modes[:, 1])
    observations = Observations(
        joints, measured, surfaces.centers[surface], surfaces.radii[surface], cell.sensor.frame, cell.gripper_sign
    )
    if cell.has_outlines:
        observations = observations._replace(tangents=surfaces.tangents[surface])
    if robot.effects or robot.random or declared is not None:
        peak, plain = (1 + plan.preload[:, None]) * pressed, TouchMetadata.plain(len(joints))
        eased = plan.preload > 0
        added = pressed - np.where(eased[:, None], peak, 0.0)
        motion = press_aside(p, joints, added, np.where(eased, -plan.aside, plan.aside))
        loaded = np.concatenate([joints - motion, eased[:, None] * peak], axis=1)[:, None]
        plain = plain._replace(disc=plan.disc, posture=plan.posture, approach=motion, press=motion, history=loaded)
        metadata = (metadata or plain._replace(time=np.full(len(joints), robot.time)))._replace(surface=surface)
        true, measured = measured, reported_force(robot.model, measured, metadata)
        observations = observations._replace(metadata=metadata, force=measured)
        if robot.random:
            at = observations.contact_problem(joints).touch_state(p, state)
            random = RandomEffects.at(robot.random, np.array(robot.random_sizes), at, true, {})
            observations = observations._replace(random=random)
        count = (0 if declared is None else declared.count) + len(robot.random)
        if count:
            observations = observations._replace(declared=declared, errors=np.zeros(count), reported=measured)
    point = evaluate(observations, robot.model, Adjusted(joints, measured, state), robot.noise)
    arms = np.where(has_no_sure_sign(p, torques.T).T, 0.0, np.abs(torques)) / plan.force[:, None]
    return ExactTouches(observations, point, arms)


def predict(robot: RobotModel, plan: Plan, number: int | None = None) -> Prediction:
    """The uncertainty of a calibration with the touches of a plan.

    Args:
        robot: the robot.
        plan: the touches.
        number: predict for this number of touches, evenly distributed over those of the plan; None: for the plan as it
            is.

    Raises:
        UnsupportedDataError: the robot cannot reach a touch.
    """
    observations, point, _ = exact_plan(robot, plan)
    count = len(robot.parameters.names)
    parameters = np.arange(count)
    unidentifiable = unidentifiable_directions(observations, point, parameters, robot.noise)
    subspace = Subspace.of_free(point.model, parameters, robot.scales).without(unidentifiable)
    lifted, prior = subspace.with_errors(len(point.errors)), ActivePrior.of(observations, subspace)
    root = np.sqrt(1.0 if number is None else number / len(plan))
    w, known = point.whitened, None if prior is None else prior.system(point)
    system = least_squares.compress(root * w.jacobian, w.residual, basis=lifted, prior=known)
    covariance = lifted @ least_squares.covariance(system) @ lifted.T
    own = covariance[:count, :count]
    groups = group_names(unidentifiable, parameters, ExtendedModel(robot.parameters))
    std = np.sqrt(np.diag(own))
    std[[name in {member for group in groups for member in group} for name in robot.parameters.names]] = np.nan
    return Prediction(
        touches=number or len(plan),
        covariance=own,
        std=std,
        motions=robot.scales[:, None] * unidentifiable,
        confounded=groups,
        leverage=leverage(w.jacobian, covariance),
        together=covariance,
        declared=robot.declared,
    )


def contributions(covariance: Floats, count: int, declared: DeclaredErrors | None, tip: Floats) -> dict[str, float]:
    """What noise and each kind of declared uncertainty contribute to the tip at its worst place, m, by their names.

    Their squares add up to the square of the whole. The places of all discs, ``object_position``, are one kind, and so
    on as in the budget of a calibration. A source with the rows R of the prior contributes C RᵀR C to the covariance C.

    Args:
        covariance: C of the values of the model and the declared errors.
        count: number of the values.
        declared: what the cell declares as uncertain.
        tip: over the workspace, as of `tip_in_use`.
    """
    own = covariance[:count, :count]
    place = np.einsum('gdik,kl,gdil->gd', tip, own, tip, optimize=True)
    worst = tip[np.unravel_index(int(np.argmax(place)), place.shape)]
    found: defaultdict[str, float] = defaultdict(float)
    if declared is not None:
        moved = worst @ covariance[:count] @ declared.prior.rows(count).T
        for source, rows in declared.prior.by_source():
            found[source.label.split('[')[0]] += float((moved[:, rows] ** 2).sum())
    found['noise'] = max(0.0, float(place.max()) - sum(found.values()))
    return {kind: float(np.sqrt(variance)) for kind, variance in found.items()}


def tip_in_use(robot: RobotModel, load: float, count: int = 17, directions: int = 12) -> Floats:
    """The tip without and under a load: T = dS/d(L̄ and the effects' values) at given Q, F; see `model.kinetostatics`.

    Args:
        robot: the robot.
        load: magnitude of the force on the object, N.
        count: of columns and rows of the grid (`region_grid`).
        directions: of the load, evenly around.

    Returns:
        (g, 1 + directions, 2, 12 + k): of the possible poses, posture left first, without a load and under it.

    Raises:
        ParameterError: as `region_grid`.
    """
    _, _, grid, possible, _ = region_grid(robot.parameters, robot.cell, count)
    angle = 2 * np.pi * (np.arange(directions) + 0.5) / directions
    forces = np.concatenate([np.zeros((1, 2)), load * np.stack([np.cos(angle), np.sin(angle)], axis=-1)])
    side, row, column = np.nonzero(possible)
    places, sides = np.repeat(grid[row, column], len(forces), axis=0), np.repeat(np.array(POSTURES)[side], len(forces))
    law, force = Law(robot.model, robot.cell.gripper_sign), Force.of(np.tile(forces, (len(side), 1)))
    links = kinematics.inverse(robot.parameters, places, sides)
    found = tip_under_load(law, links, force, TouchMetadata.plain(len(places))._replace(posture=sides))
    turns = tip_by_joints(found.loading, inverse_of_rows(found.loading, force))
    derivative = tip_by_values(law, turns, found.loading, force, found.state)
    return derivative.reshape(-1, len(forces), *derivative.shape[1:])


def tip_std(tip: Floats, prediction: Prediction) -> Floats:
    """The tip's standard deviation from a predicted covariance of L̄, infinite where it is not determined.

    Args:
        tip: as of `tip_in_use`, or some of its loads.
        prediction: with the covariance.

    Returns:
        Of each pose and load, (g, d), m.
    """
    variance = np.einsum('gdik,kl,gdil->gd', tip, prediction.covariance, tip, optimize=True)
    if prediction.motions.size:
        motion = np.abs(tip @ prediction.motions).max(axis=(2, 3))
        variance = np.where(motion > MICRO, np.inf, variance)  # m, well below any accuracy that is asked for
    return np.asarray(np.sqrt(variance))

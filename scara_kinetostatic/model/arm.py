"""A calibrated arm in use: the tip under load (H̄) and the joint angles that compensate it (Ḡ), with uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, read_only
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.extended_model import EffectLaw, ExtendedModel, TouchMetadata, true_force
from scara_kinetostatic.model.kinematics import posture as posture_of
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.kinetostatics import (
    SIGN_KNOWN,
    Equilibrium,
    Force,
    Law,
    Spread,
    inverse_of_rows,
    joints_under_load,
    tip_by_joints,
    tip_by_noise,
    tip_under_load,
)
from scara_kinetostatic.model.parameters import NAMES

_RESERVATIONS = {
    'unfit': 'the calibration is unfit for use; its calibration.json says why (assessment.reasons)',
    'ambiguous': 'a model error has several possible causes: their mean is used, the uncertainty contains the choice',
    'unexplained': 'the calibration has a model error of unknown cause; the uncertainty does not cover it',
}
"""What is to be known of a calibration by its grade and its verdict."""


class UsedRange(NamedTuple):
    """What the touches of a calibration cover: beyond it, the model is extrapolated.

    Attributes:
        lowest_force: smallest ‖F‖ of the touches used, N.
        highest_force: largest, N.
        duration: time from the first touch to the last, s.
        postures: elbow postures that were touched, +1 left and -1 right.
    """

    lowest_force: float
    highest_force: float
    duration: float
    postures: tuple[int, ...]

    def joined(self, other: UsedRange) -> UsedRange:
        """What either covers."""
        return UsedRange(
            min(self.lowest_force, other.lowest_force),
            max(self.highest_force, other.highest_force),
            max(self.duration, other.duration),
            tuple(side for side in (1, -1) if side in self.postures + other.postures),
        )


class SensorErrors(NamedTuple):
    """Errors of the force sensor that the calibration estimated within their declared uncertainty.

    Attributes:
        gain: relative; the sensor reports (1 + gain) times the force.
        rotation: the sensor reports the force turned by this angle, rad.
    """

    gain: float = 0.0
    rotation: float = 0.0


@dataclass(frozen=True, eq=False, repr=False)
class CalibratedArm:
    """A calibrated arm, `arm` of a `Calibration` or an `Outcome`, or read from a file of it (`files.calibration_file`).

    Attributes:
        cell: what was known before; its `nominal` are the parameters of the nominal arm.
        model: the calibrated model with the effects that were found, and with undetected ones as `Undetected`.
        covariance: of all values of the model, (12 + k, 12 + k), in the order of `model.names`: noise and all that was
            declared; zero rows where fixed.
        undetermined: directions of the values that the touches do not determine, each by its plausible range,
            (12 + k, u).
        noise: of one touch.
        sensor: estimated errors of the force sensor.
        used: what the touches cover.
        grade: ``fit``, ``caution`` or ``unfit``; empty where it was not assessed.
        verdict: whether the model is complete: ``none``, ``explained``, ``ambiguous`` or ``unexplained``; empty where
            it was not examined.
        created: when the calibration was calculated, UTC, as in `calibration.json`; empty where unknown.

    Raises:
        ParameterError: an array has another shape than the model asks for, or a number is not finite.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> arm = sk.diagnose('touches.csv', cell).arm
        >>> arm.grade, arm.verdict, arm.used.postures
        ('fit', 'explained', (1, -1))
        >>> sk.locate(arm, [0.8, 2.1], [-20.0, 0.0]).position.round(4)
        array([[-0.0867,  0.3136]])
    """

    cell: Cell
    model: ExtendedModel
    covariance: Floats
    undetermined: Floats
    noise: Noise
    sensor: SensorErrors
    used: UsedRange
    grade: str = ''
    verdict: str = ''
    created: str = ''

    def __post_init__(self) -> None:
        size = len(self.model.names)
        for name, shape in (('covariance', (size, size)), ('undetermined', (size, self.undetermined.shape[-1]))):
            array = getattr(self, name)
            if array.shape != shape or not np.isfinite(array).all():
                raise ParameterError(name, f'expected finite numbers of shape {shape}, got shape {array.shape}')
            object.__setattr__(self, name, read_only(array))
        self.noise.check()

    def __repr__(self) -> str:
        effects = ' '.join(effect.label for effect in self.effects) or 'none'
        return f'<CalibratedArm: {self.grade or "not assessed"}, effects: {effects}>'

    @property
    def effects(self) -> tuple[EffectLaw, ...]:
        """The effects that were found."""
        return tuple(effect for effect in self.model.effects if not effect.is_undetected)

    @cached_property
    def spread(self) -> Spread:
        """The covariance of the values, made ready."""
        return Spread.of(self.covariance, self.undetermined, self.model.parameters)

    @property
    def reservations(self) -> tuple[str, ...]:
        """What is to be known before the calibration is used, one sentence each: it is unfit, its model incomplete."""
        return tuple(_RESERVATIONS[word] for word in (self.grade, self.verdict) if word in _RESERVATIONS)

    @property
    def nominal(self) -> ExtendedModel:
        """The nominal model, without effects."""
        return ExtendedModel(self.cell.nominal)


def force_on_object(
    arm: CalibratedArm, reported: Floats, joints: Floats, metadata: TouchMetadata | None = None
) -> Floats:
    """F in the base frame, (n, 2), N; NaN where no true force gives what was reported.

    Args:
        arm: with the errors of its sensor: those within declared uncertainties, and effects.
        reported: on the object, in the sensor's frame, (n, 2), N.
        joints: Q, (n, 2), rad.
        metadata: of the poses; None for nothing known.
    """
    turned = rotate(reported, np.full(len(reported), -arm.sensor.rotation)) / (1 + arm.sensor.gain)
    force = true_force(arm.model, turned, metadata)
    return arm.cell.sensor.frame.to_base(force, joints, arm.model.parameters)


def in_sensor_frame(arm: CalibratedArm, force: Floats, joints: Floats) -> Floats:
    """Forces (n, 2) in the base frame, in that of the sensor."""
    return arm.cell.sensor.frame.from_base(force, joints, arm.model.parameters)


CHUNK = 4096
"""Poses that are worked out together: their derivatives fit into the cache."""
STATUSES = ('ok', 'unloaded', 'extrapolated', 'undetermined', 'out_of_reach', 'beyond_limits')
"""Of a pose; the gravest that applies, which is the last."""


class TipPosition(NamedTuple):
    """Places of the tip with their uncertainty.

    Attributes:
        position: S in the base frame, (n, 2), m; NaN where it could not be found.
        covariance: by the uncertainty of the calibration, (n, 2, 2), m²; NaN where the data do not determine it.
            Where not `loaded`, it contains the place in the dead band, g²/3 in its middle.
        loaded: whether the force and both joint torques exceed three times their standard uncertainty, (n,); where not,
            the backlash concerned is crossed continuously, and is in the middle of its dead band at zero.
        status: of each, (n,): the last that applies of ``ok``, ``unloaded``, ``extrapolated`` (a force or an elbow
            posture that no touch had, or a time outside theirs where the model depends on time), ``undetermined`` (no
            covariance).

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> tip = sk.locate(sk.diagnose('touches.csv', cell), [[0.8, 2.1]] * 2, [[-20.0, 0.0], [0.0, 0.0]])
        >>> tip.std.shape, tip.loaded.tolist(), tip.status.tolist()
        ((2, 2), [True, False], ['ok', 'unloaded'])
    """

    position: Floats
    covariance: Floats
    loaded: Mask
    status: NDArray[Any]

    @property
    def std(self) -> Floats:
        """Standard uncertainty of x and y, (n, 2), m."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


class JointAngles(NamedTuple):
    """Compensated joint angles with their uncertainty.

    Attributes:
        joints: Q, (n, 2), rad, in the turn of the limits; NaN where the place is out of reach.
        torques: of the actuators, C, (n, 2), Nm.
        covariance: of Q by the uncertainty of the calibration, (n, 2, 2), rad²; NaN where the data do not determine
            it. Where not `loaded`, it contains the place in the dead band, g²/3 in its middle.
        loaded: whether the force and both joint torques exceed three times their standard uncertainty, (n,); where not,
            the backlash concerned is crossed continuously, and is in the middle of its dead band at zero.
        status: of each, (n,): as that of `TipPosition`, ``out_of_reach`` (no angles), and ``beyond_limits`` of the
            joints, where the cell states some.
        std_normal: standard uncertainty of the tip's place at these joint angles along the force, (n,), m; without a
            force that in the worst direction.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> outcome = sk.diagnose('touches.csv', cell)
        >>> angles = sk.compensate(outcome, [[0.3, 0.2], [0.9, 0.0]], [0.0, 30.0], elbow='right')
        >>> angles.std.shape, angles.status.tolist()
        ((2, 2), ['ok', 'out_of_reach'])
    """

    joints: Floats
    torques: Floats
    covariance: Floats
    loaded: Mask
    status: NDArray[Any]
    std_normal: Floats

    @property
    def std(self) -> Floats:
        """Standard uncertainty of both angles, (n, 2), rad."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


@dataclass(frozen=True, eq=False)
class Predictor:
    """H̄ and Ḡ of a calibrated arm, or of its nominal one.

    Attributes:
        arm: the arm.
        nominal: whether to take the nominal parameters, without effects and without a statement of uncertainty.
        rigid: whether to leave out all deflection: the arm without a force.
    """

    arm: CalibratedArm
    nominal: bool = False
    rigid: bool = False

    @cached_property
    def law(self) -> Law:
        """The law of the arm."""
        model = self.arm.nominal if self.nominal else self.arm.model
        if self.rigid:
            model = model.replace(p_ee=0.0, p1=0.0, p2=0.0, g_ee=0.0, g1=0.0, g2=0.0)
        gravity_std = (0.0, 0.0)
        if (p := model.parameters).has_gravity and not self.nominal:
            of_s1, of_s2 = np.sqrt(np.diag(self.arm.covariance)[len(NAMES) : len(p.names)]) * np.hypot(*p.gravity)
            gravity_std = (float(of_s1 + of_s2), float(of_s2))
        return Law(model, self.arm.cell.gripper_sign, self.arm.noise, gravity_std)

    @cached_property
    def _spread(self) -> Spread | None:
        """Of the values; None where nothing is stated."""
        if self.nominal:
            return None
        arm, p = self.arm, self.law.model.parameters
        return Spread.of(arm.covariance, arm.undetermined, p) if self.rigid else arm.spread

    def locate(
        self, joints: Floats, force: Floats, metadata: TouchMetadata | None = None, *, measured: bool = False
    ) -> TipPosition:
        """H̄: where the tip is.

        Args:
            joints: Q, (n, 2), rad.
            force: true one on the object, base frame, (n, 2), N.
            metadata: of the poses; None for nothing known.
            measured: whether joints and force are one measurement, whose noise is part of the covariance.
        """
        sides = posture_of(self.law.model.parameters, joints)
        metadata = _plain(sides) if metadata is None else metadata

        def some(rows: slice) -> TipPosition:
            f = Force.of(0.0 * force[rows] if self.rigid else force[rows], self.arm.noise)
            found = tip_under_load(self.law, joints[rows], f, metadata.select(rows))
            jacobian, spread = self._tip_spread(found, f)
            if measured:
                by_noise = tip_by_noise(self.law, jacobian, found.loading, f)
                spread = spread + by_noise @ by_noise.swapaxes(1, 2)
            loaded, status = self._status(found, f, spread, metadata.select(rows), sides[rows])
            return TipPosition(found.tip, spread, loaded, status)

        return TipPosition(*_in_chunks(some, len(joints)))

    def compensate(
        self, tip: Floats, force: Floats, posture: Indices, metadata: TouchMetadata | None = None
    ) -> JointAngles:
        """Ḡ: the joint angles that bring the tip to a place under a force.

        Args:
            tip: S, (n, 2), m.
            force: true one on the object, base frame, (n, 2), N.
            posture: +1 or -1, (n,).
            metadata: of the poses; None for nothing known.
        """
        metadata = _plain(posture) if metadata is None else metadata

        def some(rows: slice) -> JointAngles:
            f = Force.of(force[rows], self.arm.noise)
            found = joints_under_load(self.law, tip[rows], f, posture[rows], metadata.select(rows))
            jacobian, spread = self._tip_spread(found, f)
            with np.errstate(divide='ignore', invalid='ignore'):
                (a, b), (c, d) = jacobian.transpose(1, 2, 0)
                by_tip = (np.array([[d, -b], [-c, a]]) / (a * d - b * c)).transpose(2, 0, 1)
                covariance = by_tip @ spread @ by_tip.swapaxes(1, 2)
                (xx, xy), (_, yy) = spread.transpose(1, 2, 0)
                along = xx * f.nx**2 + yy * f.ny**2 + 2 * xy * f.nx * f.ny
                largest = (xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)
                normal = np.sqrt(np.where(f.size > 0, along, largest))
            torques = np.array([found.loading.c1, found.loading.c2]).T
            loaded, status = self._status(found, f, spread, metadata.select(rows), posture[rows])
            joints = self.arm.cell.in_turn(found.joints)
            beyond = np.isfinite(joints[:, 0]) & ~self.arm.cell.can_take(joints)
            status = np.where(beyond, STATUSES[-1], status)
            return JointAngles(joints, torques, covariance, loaded, status, normal)

        return JointAngles(*_in_chunks(some, len(tip)))

    def _tip_spread(self, found: Equilibrium, force: Force) -> tuple[Floats, Floats]:
        """G, and the covariance of the tip at Q and F, (n, 2, 2) each; NaN where nothing is stated."""
        jacobian = tip_by_joints(found.loading, inverse_of_rows(found.loading, force))
        if self._spread is None:
            return jacobian, np.full((len(force.x), 2, 2), np.nan)
        return jacobian, self._spread.of_poses(self.law, jacobian, found.loading, force, found.state)

    def _status(
        self, found: Equilibrium, force: Force, spread: Floats, metadata: TouchMetadata, posture: Indices
    ) -> tuple[Mask, NDArray[Any]]:
        """Whether no dead band is being crossed, and the status, (n,) each."""
        used, loaded = self.arm.used, np.asarray(self.rigid | ~(found.loading.in_band | (force.place < 1)))
        beyond = force.size > used.highest_force + SIGN_KNOWN * force.std
        beyond |= ~np.isin(posture, used.postures)
        if self.depends_on_time:
            beyond |= (metadata.time < 0) | (metadata.time > used.duration)
        undetermined = ~np.isfinite(spread[:, 0, 0] + spread[:, 1, 1])
        if self.nominal:
            beyond = undetermined = np.zeros_like(loaded)
        cases = np.isnan(found.joints[:, 0]), undetermined | np.isnan(found.tip[:, 0]), beyond, ~loaded
        return loaded, np.select(cases, STATUSES[-2:0:-1], STATUSES[0])

    @cached_property
    def depends_on_time(self) -> bool:
        """Whether the place of the tip depends on time."""
        return bool(self.effects_of('time'))

    @cached_property
    def assumptions(self) -> str:
        """What is taken of what no stream of joint angles and forces says; empty if nothing is."""
        found = []
        if effects := self.effects_of('time'):
            found.append(f'{", ".join(effects)}: as at the end of the calibration')
        if effects := self.effects_of('history'):
            found.append(f'{", ".join(effects)}: no load before')
        return '; '.join(found)

    def effects_of(self, name: str) -> list[str]:
        """The labels of the effects in the model that depend on ``time``, ``approach`` or ``history``."""
        model, law, force = self.law.model.acting, self.law, Force.of(np.array([[20.0, 30.0]]), self.law.noise)
        probe, still = np.array([[0.4, 1.1]]), TouchMetadata.plain(1)
        other = {
            'time': still._replace(time=np.ones(1)),
            'approach': still._replace(approach=np.ones((1, 2))),
            'history': still._replace(history=np.array([[[*probe[0], 2e3, 3e3]]])),
        }[name]
        found = []
        for effect, values in zip(model.effects, model.effect_values, strict=True):
            if effect.is_undetected:  # too small to ask for it
                continue
            alone = replace(law, model=ExtendedModel(model.parameters, (effect,), (values,)))
            one, two = (tip_under_load(alone, probe, force, at).tip for at in (still, other))
            found += [] if np.array_equal(one, two) else [effect.label]
        return found


def _plain(posture: Indices) -> TouchMetadata:
    return TouchMetadata.plain(len(posture))._replace(posture=posture)


def _in_chunks(some: Callable[[slice], tuple[Any, ...]], n: int) -> Iterator[Any]:
    """The arrays that `some` works out for n poses, chunk after chunk."""
    parts = list[tuple[Any, ...]]()
    for first in range(0, max(n, 1), CHUNK):
        parts.append(some(slice(first, first + CHUNK)))
    return (np.concatenate(column) for column in zip(*parts, strict=True))

"""Physical effects, what they read of a touch and what they change, and the extended model: the base model of twelve
parameters and effects, with the values of all of them.

**An effect** enters the equations of a touch (`touch_equations`) in one of three places:

- **joints** δ: q - q* = p c + g sign(c) + δ, an error of the encoder, the transmission or the spring;
- **place** d: the equation of the circle becomes H(Q*) + (r + γ) n - S_c + d = 0, a further displacement of the
  tip, or one of the disc, of its radius or of the point of contact;
- **sensor error** e: the sensor reports F + e.

An `EffectLaw`, the base of all effects, gives these three as functions of the state of a touch and of the parameters of
the effect.

**Errors of the force sensor.** The sensor reports F + e(F), in its own frame. The equations of a touch hold for the
true force F, the adjustment varies the reported one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from itertools import accumulate
from math import isfinite
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, along_and_across, pick
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch import TouchSet, torque_phasors


class Parameter(NamedTuple):
    """A parameter of an effect.

    Attributes:
        name: as in the results.
        unit: SI; ``1`` for a pure number.
        scale: largest plausible size; the fit is scaled by it.
        meaning: in a few words.
        start: where the estimation begins.
        typical: a value that matters, for examples and tests; None for a tenth of the scale.
        sign: +1 or -1 where only one sign is physical or can be simulated, else 0.
        is_alias: whether it is exactly a part of L̄: no touch tells it, so a fit without priors holds it; where nobody
            states it, it is 0.
    """

    name: str
    unit: str
    scale: float
    meaning: str
    start: float = 0.0
    typical: float | None = None
    sign: int = 0
    is_alias: bool = False


class TouchMetadata(NamedTuple):
    """What is known of n touches besides Q and F.

    Attributes:
        disc: index of the touched disc, (n,).
        time: middle of the hold, (n,), s.
        approach: each joint's motion in the last movement before the hold, (n, 2), rad.
        posture: +1 or -1, (n,).
        press: the part of `approach` in contact, (n, 2), rad.
        history: the load before each hold, (n, K, 4), as in `TouchSet`, in `frame`; None where nothing is known.
        frame: that of the forces of `history` and `force`.
        force: F of the hold as measured with the history, (n, 2), N; None where that is not known.
        order: place in the order of time, over all recordings, (n,); `LATER` or None for touches after all others.
        surface: number of the touched edge or corner among the surfaces of the cell, (n,); None or -1: not known.
    """

    disc: Indices
    time: Floats
    approach: Floats
    posture: Indices
    press: Floats
    history: Floats | None = None
    frame: SensorFrame = SensorFrame.BASE
    force: Floats | None = None
    order: Indices | None = None
    surface: Indices | None = None

    @classmethod
    def plain(cls, n: int) -> TouchMetadata:
        """Of n touches of which nothing else is known: disc 0, time 0, no motion, posture +1, after all others."""
        still = np.zeros((n, 2))
        return cls(np.zeros(n, dtype=np.intp), np.zeros(n), still, np.ones(n, dtype=np.intp), still)

    @classmethod
    def of(cls, touches: TouchSet, frame: SensorFrame = SensorFrame.BASE) -> TouchMetadata:
        """The metadata of touches, whose forces are in a frame."""
        history = touches.history if touches.history.shape[1] else None
        t = touches
        return cls(t.disc, t.time, t.approach, t.posture, t.press, history, frame, t.force, t.order, t.surface)

    def select(self, which: Mask | Indices | slice) -> TouchMetadata:
        """The touches that a mask, a slice or an array of positions picks."""
        return pick(self, which)


class _TouchState(NamedTuple):
    parameters: Parameters
    joints: Floats
    force: Floats
    magnitude: Floats
    normal: Floats
    torques: Floats
    link1: Floats
    link2: Floats
    centers: Floats
    radii: Floats
    metadata: TouchMetadata
    off_normal: Floats
    tangents: Floats | None = None


class TouchState(_TouchState):
    """All that an effect may depend on, at n touches. What it works out it keeps.

    Attributes:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        force: F on the object, base frame, (n, 2), N.
        magnitude: f, (n,), N; negative in the continuation to a tip that pulls.
        normal: n, the direction of the force, (n, 2).
        torques: C, (n, 2), Nm.
        link1: direction of link 1 in the base frame, a unit vector, (n, 2).
        link2: the same of link 2.
        centers: centre of the touched disc, (n, 2), m.
        radii: its radius, (n,), m.
        metadata: disc, time, approach, posture, press.
        off_normal: angle from the normal of the disc to the force where it differs from touch to touch, (n,), rad.
        tangents: unit vector along the straight edge that is touched, (n, 2), zero on arcs; None for arcs alone.
    """

    @classmethod
    def of_poses(
        cls,
        parameters: Parameters,
        joints: Floats,
        force: Floats,
        torques: Floats,
        links: tuple[Floats, Floats],
        tip: Floats,
        metadata: TouchMetadata,
    ) -> TouchState:
        """Poses under a force as if each touched a disc of 0.1 m, its normal along the force.

        Args:
            parameters: L̄.
            joints: Q, (n, 2), rad.
            force: F on the object, base frame, (n, 2), N.
            torques: C, (n, 2), Nm.
            links: both links as vectors in the base frame, (n, 2) each, m.
            tip: S, (n, 2), m.
            metadata: of the poses.
        """
        magnitude, radii, still = np.hypot(*force.T), np.full(len(force), 0.1), np.zeros(len(force))
        normal = np.where(magnitude[:, None] > 0, force, (1.0, 0.0)) / np.where(magnitude > 0, magnitude, 1.0)[:, None]
        link1, link2 = links[0] / parameters.l1, links[1] / parameters.l2
        centers = tip + radii[:, None] * normal
        return cls(parameters, joints, force, magnitude, normal, torques, link1, link2, centers, radii, metadata, still)

    @property
    def tangent(self) -> Floats:
        """T = R90 n, (n, 2)."""
        return np.array([-self.normal[:, 1], self.normal[:, 0]]).T

    @property
    def along_edge(self) -> Floats:
        """Place of the rigid tip along the straight edge from its middle, (n,), m; 0 on an arc."""
        if self.tangents is None:
            return np.zeros(len(self.radii))
        p = self.parameters
        off = p.l1 * self.link1 + p.l2 * self.link2 + (p.x0, p.y0) - self.centers
        return np.asarray((off * self.tangents).sum(axis=1))

    def across_edges(self, vectors: Floats) -> Floats:
        """Displacements (n, 2) as they count as `Shift.place`: along a straight edge the object has no place."""
        if self.tangents is None:
            return vectors
        return np.asarray(vectors - (vectors * self.tangents).sum(axis=1)[:, None] * self.tangents)

    @cached_property
    def history_torques(self) -> tuple[Floats, Floats]:
        """C of each joint at the turning points of the load before the hold, (n, K), Nm; K = 0 where none are known.

        An error of the force that is in all of a touch is in its preload and in its hold alike. So the forces of a
        preload are those measured, turned and stretched as the force of the hold here is from the measured one.
        """
        m = self.metadata
        if m.history is None:
            return (nothing := np.empty((len(self.joints), 0))), nothing
        first, second = torque_phasors(self.parameters, m.history, m.frame)
        if m.force is None:
            return first.imag, second.imag
        force = self.force[:, 0] + 1j * self.force[:, 1]
        if m.frame is SensorFrame.TOOL:
            force = force * (self.link2[:, 0] - 1j * self.link2[:, 1])
        known = m.force.any(axis=1)
        ratio = np.where(known, force, 1.0) / np.where(known, m.force[:, 0] + 1j * m.force[:, 1], 1.0)
        # distance from the joint angles of the hold within which a point of the history is of the same touch, rad
        near1, near2 = (np.abs(m.history[:, :, k] - self.joints[:, k, None]) < 0.02 for k in (0, 1))
        turned = np.where(near1 & near2, ratio[:, None], 1.0)
        return (first * turned).imag, (second * turned).imag


class Shift(NamedTuple):
    """What an effect adds to the equations of n touches; None for nothing.

    Attributes:
        joints: δ, (n, 2), rad.
        place: d, base frame, (n, 2), m; of a displacement the part `TouchState.across_edges`: what is along a straight
            edge turns its normal, by d/r.
    """

    joints: Floats | None = None
    place: Floats | None = None


class ForceDependence(IntEnum):
    """What of the force of a touch the shift of an effect depends on, the least first.

    The torques depend on both, the directions of the links, the disc and all metadata on neither.
    """

    NONE = 0
    """On nothing: the shift is the same under any force."""
    DIRECTION = 1
    """On its direction φ, or its off-normal angle, but not on its magnitude f."""
    ALL = 2
    """On its magnitude as well."""


class EffectLaw(ABC):
    """What the model needs of an effect.

    Attributes:
        parameters: what is to be estimated.
        on_object: whether `Shift.place` belongs to the object rather than to the robot: then it is no part of H̄ and Ḡ.
        force_dependence: what of the force of a touch the shift depends on; unless stated, on all of it. Where it is
            less, fits are faster.
        is_smooth: whether the shift has a derivative everywhere, over the state of a touch and over the parameters.
        grid_parameter: the parameter that is searched on a grid, such as a frequency; empty if there is none.
        is_stepwise: whether it changes in steps along `grid_parameter`: a fit holds it at the best trial, and its
            uncertainty is that of the choice among the trials.
        is_undetected: whether it stands for errors too small to be named.
        scaled_by: names of those parameters of L̄, such as ``p1``, that the shift is proportional to.
    """

    parameters: ClassVar[tuple[Parameter, ...]]
    on_object: ClassVar[bool] = False
    force_dependence: ClassVar[ForceDependence] = ForceDependence.ALL
    is_smooth: ClassVar[bool] = True
    grid_parameter: ClassVar[str] = ''
    is_stepwise: ClassVar[bool] = False
    is_undetected: ClassVar[bool] = False
    scaled_by: ClassVar[tuple[str, ...]] = ()

    @property
    @abstractmethod
    def label(self) -> str:
        """Name and target, such as ``encoder_gain[joint1]``."""

    @property
    def off_normal_std(self) -> float:
        """Standard deviation of the off-normal angle of the force, if the effect lets it differ from touch to touch,
        rad.
        """
        return 0.0

    def with_off_normal_std(self, std: float) -> EffectLaw:
        """The same effect with another `off_normal_std`; itself where it has none."""
        return self

    @abstractmethod
    def shift(self, at: TouchState, values: Floats) -> Shift:
        """δ and d at n touches for values (k,) of the parameters."""

    @abstractmethod
    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        """The derivatives of `shift`, one per parameter."""

    def amplitudes(self, values: Floats) -> Floats:
        """The values (k,), zero where they are the form of the effect, such as a phase, rather than its size: what its
        derivatives, times these, add up to is the effect to first order.
        """
        return values

    def sensor_error(self, force: Floats, values: Floats, metadata: TouchMetadata | None = None) -> Floats | None:
        """The error e for true forces (n, 2) in the sensor's frame, N; None unless the effect is one of the sensor.

        `metadata` is that of the touches; None where nothing is known of them.
        """
        return None

    def sensor_error_derivative(
        self, force: Floats, values: Floats, metadata: TouchMetadata | None = None
    ) -> tuple[Floats, ...]:
        """The derivatives of `sensor_error`, one per parameter; empty for effects that do not change it."""
        return ()


@dataclass(frozen=True)
class ExtendedModel:
    """The base model and the effects that extend it, with their values.

    Solvers take all values as one vector, `as_array`: L̄ in the order of `NAMES`, then the parameters of the effects,
    effect by effect (`names`).

    Attributes:
        parameters: L̄, the values of the base model.
        effects: the effects; none for the base model alone.
        effect_values: of each effect, the values of its parameters in their order and units.

    Raises:
        ParameterError: not one finite value for each parameter of each effect.
    """

    parameters: Parameters
    effects: tuple[EffectLaw, ...] = ()
    effect_values: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        if not (self.effects or self.effect_values):
            return
        object.__setattr__(self, 'effects', tuple(self.effects))
        values = tuple(tuple(float(value) for value in part) for part in self.effect_values)
        object.__setattr__(self, 'effect_values', values)
        wanted = [len(effect.parameters) for effect in self.effects]
        if [len(part) for part in values] != wanted:
            problem = f'expected {wanted} values, effect by effect, got {[len(part) for part in values]}'
            raise ParameterError('effects', problem, 'give one per parameter')
        if not all(isfinite(value) for part in values for value in part):
            raise ParameterError('effects', f'expected finite values, got {values}')

    @classmethod
    def at_start(cls, parameters: Parameters, effects: Iterable[EffectLaw] = ()) -> ExtendedModel:
        """L̄ and effects with the values at which their estimation begins."""
        effects = tuple(effects)
        return cls(parameters, effects, tuple(tuple(p.start for p in effect.parameters) for effect in effects))

    @property
    def values(self) -> dict[str, dict[str, float]]:
        """Values of the effects' parameters by label and name: ``values['encoder_gain[joint1]']['gain']``."""
        pairs = zip(self.effects, self.effect_values, strict=True)
        return {
            effect.label: {p.name: value for p, value in zip(effect.parameters, part, strict=True)}
            for effect, part in pairs
        }

    @cached_property
    def acting(self) -> ExtendedModel:
        """The model without undetected effects of value zero, which move nothing and are uncertain only."""
        some = [k for k, e in enumerate(self.effects) if not e.is_undetected or any(self.effect_values[k])]
        if len(some) == len(self.effects):
            return self
        return ExtendedModel(
            self.parameters, tuple(self.effects[k] for k in some), tuple(self.effect_values[k] for k in some)
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each value of `as_array`: those of L̄, then such as ``encoder_gain[joint1].gain``."""
        return self.parameters.names + tuple(
            f'{effect.label}.{p.name}' for effect in self.effects for p in effect.parameters
        )

    @property
    def base_count(self) -> int:
        """Number of values before those of the effects: 12, or 14 where gravity loads the joints."""
        return len(self.parameters.names)

    @property
    def effect_scales(self) -> Floats:
        """Plausible size of each parameter of the effects, (k,), in its unit."""
        return np.array([p.scale for effect in self.effects for p in effect.parameters])

    def as_array(self) -> Floats:
        """All values in the order of `names`, (12 + k,)."""
        base = self.parameters.as_array()
        return np.concatenate([base, *self.effect_arrays]) if self.effects else base

    def with_array(self, values: ArrayLike) -> ExtendedModel:
        """The same effects with other values, (12 + k,) in the order of `names`."""
        vector = np.asarray(values, dtype=float)
        count = self.base_count
        base = self.parameters.with_array(vector[:count])
        if not self.effects:
            return ExtendedModel(base)
        return ExtendedModel(base, self.effects, tuple(tuple(part.tolist()) for part in self.split(vector[count:])))

    def split(self, values: Floats) -> list[Floats]:
        """One value per parameter of the effects, (k,), as one array per effect."""
        if not self.effects:
            return []
        ends = list(accumulate(len(effect.parameters) for effect in self.effects[:-1]))
        return [values[first:end] for first, end in zip([0, *ends], [*ends, len(values)], strict=True)]

    def with_effects(self, effects: Iterable[EffectLaw]) -> ExtendedModel:
        """L̄ with other effects: those that this model has, too, with their values here, the others at their start."""
        own = zip(self.effects, self.effect_values, strict=True)
        known = {(effect.label, effect.parameters): values for effect, values in own}
        other = ExtendedModel.at_start(self.parameters, effects)
        pairs = zip(other.effects, other.effect_values, strict=True)
        values = tuple(known.get((effect.label, effect.parameters), start) for effect, start in pairs)
        return replace(other, effect_values=values)

    def replace(self, **changes: float) -> ExtendedModel:
        """The same with some values of L̄ changed, by name."""
        return replace(self, parameters=self.parameters.replace(**changes))

    @cached_property
    def effect_arrays(self) -> tuple[Floats, ...]:
        """`effect_values` as arrays, (k_i,) each."""
        return tuple(np.array(part) for part in self.effect_values)

    @cached_property
    def pairs(self) -> tuple[tuple[EffectLaw, Floats], ...]:
        """Each effect with its values."""
        return tuple(zip(self.effects, self.effect_arrays, strict=True))

    @property
    def held(self) -> frozenset[str]:
        """Those of `names` along which the model changes in steps: a fit holds them where it begins."""
        return frozenset(f'{effect.label}.{effect.grid_parameter}' for effect in self.effects if effect.is_stepwise)

    @property
    def aliases(self) -> frozenset[str]:
        """Those of `names` that are exactly a part of L̄: a fit without priors holds them where it begins."""
        return frozenset(f'{effect.label}.{p.name}' for effect in self.effects for p in effect.parameters if p.is_alias)

    @property
    def off_normal_std(self) -> float:
        """Standard deviation of the off-normal angle of the force, rad; 0 where no effect has one."""
        return max((effect.off_normal_std for effect in self.effects), default=0.0)

    def with_off_normal_std(self, std: float) -> ExtendedModel:
        """The model with another standard deviation of the off-normal angle, rad; itself where no effect has one."""
        if std == self.off_normal_std:
            return self
        return replace(self, effects=tuple(effect.with_off_normal_std(std) for effect in self.effects))

    @cached_property
    def has_sensor_error(self) -> bool:
        """Whether any effect is an error of the sensor."""
        return any(effect.sensor_error(np.ones((1, 2)), values) is not None for effect, values in self.pairs)

    @property
    def force_dependence(self) -> ForceDependence:
        """What of the force the shift of any effect depends on."""
        return max((effect.force_dependence for effect in self.effects), default=ForceDependence.NONE)

    def difference(self, up: TouchState, down: TouchState, step: Floats | float, least: ForceDependence) -> Shift:
        """What δ and d differ by in two states of the same touches, per `step`; None for what no effect adds to.

        Args:
            up: the touches in one state.
            down: in the other.
            step: one for all touches, or (n, 1).
            least: effects that depend on less of the force are left out: they are the same in both states.
        """
        depending = [pair for pair in self.pairs if pair[0].force_dependence >= least]
        return _per_step(sum_of_shifts(up, depending), sum_of_shifts(down, depending), step)

    def object_shift(self, at: TouchState) -> Floats:
        """The displacements d by effects on the object, (n, 2), m."""
        place = sum_of_shifts(at, (pair for pair in self.pairs if pair[0].on_object)).place
        return np.zeros(at.joints.shape) if place is None else place

    def contact_normal(self, at: TouchState) -> Floats:
        """Unit vector m from the tip to the centre of the circle of contact, (n, 2), base frame.

        m is along r n + d, with d by the effects on the object that depend on the force: it is the direction n of the
        force unless friction turns the force. One that displaces the whole object leaves its normals as they are.
        """
        turning = [pair for pair in self.pairs if pair[0].on_object and pair[0].force_dependence > ForceDependence.NONE]
        place = sum_of_shifts(at, turning).place
        inward = at.radii[:, None] * at.normal + (0.0 if place is None else place)
        size = np.linalg.norm(inward, axis=1)
        return np.asarray(inward / (size if at.tangents is None else np.copysign(size, at.radii))[:, None])

    def shift_by_robot(self, at: TouchState) -> dict[str, Shift]:
        """The derivatives of δ and d by the parameters of L̄ that scale them, by name; central differences."""
        found, step = {}, 1e-6  # of the parameter, in its unit; the shift is linear in it
        for name in dict.fromkeys(name for effect in self.effects for name in effect.scaled_by):
            value = getattr(at.parameters, name)
            scaled = [pair for pair in self.pairs if name in pair[0].scaled_by]
            changed = (at.parameters.replace(**{name: value + change}) for change in (step, -step))
            up, down = (sum_of_shifts(at._replace(parameters=p), scaled) for p in changed)
            found[name] = _per_step(up, down, 2 * step)
        return found


def sum_of_shifts(at: TouchState, pairs: Iterable[tuple[EffectLaw, Floats]]) -> Shift:
    """δ and d of effects with their values, None for what none adds to."""
    joints, place = None, None
    for effect, values in pairs:
        part = effect.shift(at, values)
        if part.joints is not None:
            joints = part.joints if joints is None else joints + part.joints
        if part.place is not None:
            place = part.place if place is None else place + part.place
    return Shift(joints, place)


def _per_step(up: Shift, down: Shift, step: Floats | float) -> Shift:
    pairs = zip(up, down, strict=True)
    return Shift(*(None if a is None or b is None else (a - b) / step for a, b in pairs))


def as_model(model: ExtendedModel | Parameters) -> ExtendedModel:
    """Bare parameters are the base model without effects."""
    return model if isinstance(model, ExtendedModel) else ExtendedModel(model)


def reported_force(model: ExtendedModel, force: Floats, metadata: TouchMetadata | None = None) -> Floats:
    """F + e(F) for true forces (n, 2) in the sensor's frame, N; `metadata` is that of the touches."""
    reported = force
    for effect, values in model.pairs:
        error = effect.sensor_error(force, values, metadata)
        reported = reported if error is None else reported + error
    return reported


def true_force(model: ExtendedModel, reported: Floats, metadata: TouchMetadata | None = None) -> Floats:
    """The true forces behind reported ones, (n, 2), N, in the sensor's frame; NaN where there is none.

    By Newton's method, whose derivative stays for as long as the error falls fast.
    """
    if not (model.effects and model.has_sensor_error):
        return reported
    force, most = reported, np.fmax.reduce(np.abs(reported), axis=None, initial=0.0)
    inverse, before = None, np.inf
    with np.errstate(all='ignore'):
        # Newton steps at most
        for _ in range(12):
            off = reported_force(model, force, metadata) - reported
            error = np.fmax.reduce(np.abs(off), axis=None)  # of those touches whose force is a number
            # error of the force that a true force gives, as a part of the largest one, at which the iteration ends
            if not error > 1e-15 * most:
                break
            # the derivative is worked out anew where a step leaves more than this part of the error
            if inverse is None or error > 0.1 * before:
                inverse = _true_by_reported(model, force, metadata)
            force, before = force - _times(inverse, off), error
        # error, as a part of the largest force, beyond which there is no true force
        return np.where(np.abs(off) <= 1e-9 * most, force, np.nan)


def sensor_derivatives(
    model: ExtendedModel, reported: Floats, true: Floats, by_true: Floats, metadata: TouchMetadata | None = None
) -> tuple[Floats, Floats]:
    """Derivatives of h by the reported force, (n, 2, 2), and by the parameters of the effects through the sensor error,
    (n, 2, k).

    The true force behind a reported one changes by -∂F/∂(reported F) ∂e.

    Args:
        model: with k parameters of effects.
        reported: forces, (n, 2), N.
        true: those behind them, (n, 2), N.
        by_true: ∂h by the true force, along and across it, (n, 2, 2); that by the reported one likewise.
        metadata: of the touches.
    """
    matrix = _true_by_reported(model, true, metadata)
    x, y = (reported / np.hypot(reported[:, 0], reported[:, 1])[:, None]).T
    units = np.array([x, y]).T, np.array([-y, x]).T
    by_reported = by_true @ np.stack([along_and_across(_times(matrix, unit), true) for unit in units], axis=-1)
    columns, first = np.zeros((len(true), 2, len(model.effect_scales))), 0
    for effect, values in model.pairs:
        for k, error in enumerate(effect.sensor_error_derivative(true, values, metadata), first):
            columns[:, :, k] = -_times(by_reported, along_and_across(error, reported))
        first += len(values)
    return by_reported, columns


def _times(matrices: Floats, vectors: Floats) -> Floats:
    """Matrices (n, 2, 2) times vectors (n, 2), touch by touch."""
    return np.asarray(np.einsum('nij,nj->ni', matrices, vectors))


def _true_by_reported(model: ExtendedModel, force: Floats, metadata: TouchMetadata | None) -> Floats:
    """∂F/∂(reported F) at true forces (n, 2), (n, 2, 2): the inverse of what central differences give."""
    # step of the central difference over a force, as a part of it (of 1 N at least)
    step = 1e-5 * np.maximum(np.hypot(force[:, 0], force[:, 1]), 1.0)[:, None]
    columns = list[Floats]()
    for unit in np.eye(2):
        up, down = (reported_force(model, force + change * unit, metadata) for change in (step, -step))
        columns.append(((up - down) / (2 * step)).T)
    (a, c), (b, d) = columns
    return (np.array([[d, -b], [-c, a]]) / (a * d - b * c)).transpose(2, 0, 1)

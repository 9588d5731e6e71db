"""Errors of a joint: gain of its encoder, the other joint's angle, a cable's torque, a compliance that
depends on the torque, hysteresis; a periodic error of its transmission; slip with memory. The law (6) itself is
`model.joint_law`.

**Slip** is a second spring behind friction, constant or growing with the load that it carries:
δ = compliance · P(C), with P the play operator (`model.play_operator`) over the torque C. Its state depends on
the turning points of C alone, `TouchSet.history`.

**The two are not the same, nor are they another together with `joint_hysteresis`.** By constant friction of half width
r, a joint that was pressed up to C_m > 2 r and let go keeps compliance · r, whatever C_m was, and stands still while
the torque comes down by 2 r. By friction of a part μ it keeps nothing, and stands still down to C_m (1 - μ) / (1 + μ):
the lag grows with the load. `joint_hysteresis` is the limit of the first for r → 0 at a constant compliance · r: a lag
of one size. No sum of these has a lag in proportion to the load it began at, so two preloads tell them apart.

**What touches show of friction that grows with the load.** Loaded from rest, P = C / (1 + μ): another compliance. Let
down from (1 + β) C, P = min((1 + β) C / (1 + μ), C / (1 - μ)). Both are in proportion to C, so that with one preload β
compliance, μ and p are confounded. Two preloads, one below and one above 2 μ / (1 - μ), determine them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from scara_kinetostatic.effects.base import ANGLE, FINER, EffectOfJoint, Grid, JointEffect, PlotAxis, Trial
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.extended_model import ForceDependence, Parameter, Shift, TouchState
from scara_kinetostatic.model.kinematics import wrap
from scara_kinetostatic.model.parameters import MICRO, NANO
from scara_kinetostatic.model.play_operator import LARGEST_RATIO, play_operator

_GAIN = 1e-2
"""Largest plausible error of the angle of a joint per angle, its own or the other's."""


class EncoderGain(JointEffect):
    """The encoder reports q where the actuator is at (1 + gain) q: δ = -gain q.

    A torque on the joint that grows with its angle looks the same: a `CablePull` of a slope alone.
    """

    name = 'encoder_gain'
    parameters = (Parameter('gain', '1', _GAIN, 'true angle over reported, less 1'),)
    typical_size = 2e-5  # belt or cable across the joint
    statement = 'the encoder of {target} has a gain error'
    confounded_with = 'the offset of the joint, if its angle hardly varies; a torque that grows with it'
    identified_by = 'touches over the whole range of the joint, in both elbow postures'
    plot_variable = 'angle'
    force_dependence = ForceDependence.NONE

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (-at.joints[:, self.joint],)


class JointCoupling(JointEffect):
    """The other joint turns this one, as a belt drive through it does: the actuator is at q_i + coupling q_j, so that
    δ_i = -coupling q_j.

    A ratio of the drives that the controller takes to be 0, or slightly wrong, leaks so. Its constant is the offset
    theta_i. Of joint 1 it turns the arm about the base by an angle that grows as the elbow bends. In one elbow posture
    that is a function of the reach alone, and l1, l2, theta1 and theta2 take up its constant and slope; in both it has
    opposite signs.
    """

    name = 'joint_coupling'
    parameters = (Parameter('coupling', '1', _GAIN, 'true angle of the joint per angle of the other', typical=1e-4),)
    typical_size = EncoderGain.typical_size  # belt of joint 2 through the shoulder
    statement = 'the angle of the other joint leaks into {target}'
    confounded_with = 'base, offsets and link lengths, if there is one elbow posture or the other joint hardly turns'
    identified_by = 'touches over the whole range of the other joint, in both elbow postures'
    plot_variable = 'other_angle'
    force_dependence = ForceDependence.NONE

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (-at.joints[:, 1 - self.joint],)


class CablePull(JointEffect):
    """A cable or hose across the joint turns it by a torque τ that depends smoothly on its angle.

    The actuator holds only what the cable leaves, c - τ, so that q - q* = p (c - τ) + …, and

        δ = -p τ(q) = -(slope q + bend q² + twist q³).

    The touches show p τ, whatever p is: the torque is that over p. A constant τ turns the joint by an angle that is
    always the same: another offset theta, exactly. The slope alone is an `EncoderGain`, exactly, and is named so. A
    torque of k sin q, as of a weight, is a transmission error of one cycle per turn. That the flank of the backlash
    might change is left out.
    """

    name = 'cable_pull'
    parameters = (
        Parameter('slope', '1', ANGLE, 'compliance times torque, per angle', typical=4e-5),
        Parameter('bend', '1/rad', ANGLE, 'change of the slope with the angle', typical=-6e-5),
        Parameter('twist', '1/rad^2', ANGLE, 'change of the slope with the square of the angle', typical=3e-5),
    )
    typical_size = (5e-6, 2.5e-6, 8e-7)  # a soft hose: a smooth curve of 5 µrad at 1 rad, by its Taylor series
    statement = 'a cable pulls at {target}'
    confounded_with = (
        'encoder_gain of the joint, by its slope, and the offset, by a constant torque, **always**; '
        'transmission_error of one or two cycles per turn, if the joint hardly turns'
    )
    identified_by = 'touches over the whole range of the joint, in both elbow postures; or without the cable'
    plot_variable = 'angle'
    force_dependence = ForceDependence.NONE

    @property
    def special_cases(self) -> tuple[str, ...]:  # type: ignore[override]
        """A slope alone."""
        return (EncoderGain.of(self.joint).label,)

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        angle = at.joints[:, self.joint]
        return -angle, -(angle**2), -(angle**3)


class JointHardening(JointEffect):
    """Beside p c the joint deflects by δ = -rate c³: it hardens for a positive rate, softens for a negative one.

    With rate > 0 the law turns round at c = √(p / 3 rate); it holds for torques below that. Up to there its trace stays
    small: the reduced chi-square rises by 0.03 to 0.06, by 0.4 at most. So simulations take a negative rate. The
    cube is the first term that a smooth spring has beside p c.
    """

    name = 'joint_hardening'
    statement = 'the compliance of {target} depends on the torque'
    confounded_with = 'compliance and backlash of the joint, if its torques are alike in size'
    identified_by = 'touches with torques on the joint from small to large, in three or more steps'
    plot_variable = 'torque'
    parameters = (
        Parameter(
            'rate', 'rad/(Nm)^3', MICRO, 'by which the deflection falls short of p c, over c^3', typical=NANO, sign=-1
        ),
    )
    typical_size = 2 * NANO  # 2 µrad at 10 Nm

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (-(at.torques[:, self.joint] ** 3),)


class JointHysteresis(JointEffect):
    """Coulomb friction in the transmission: the link lags the actuator by δ = width · direction of approach.

    The friction torque τ acts on the spring beside the load, so that width = p τ.
    """

    name = 'joint_hysteresis'
    parameters = (Parameter('width', 'rad', ANGLE, 'lag of the link, half the width of the loop', sign=1),)
    typical_size = 1e-5  # 2 arcsec
    statement = '{target} has hysteresis beyond its backlash'
    confounded_with = 'the backlash of the joint, if it always moves on in the direction of its torque'
    identified_by = 'touches reached from both sides: preload every other touch'
    plot_variable = 'approach'
    force_dependence = ForceDependence.NONE

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (np.sign(at.metadata.approach[:, self.joint]),)


LOWEST, HIGHEST = 1.0, 120.0
"""Frequencies of the trials, cycles per turn of the joint."""
_TYPICAL_CYCLES = (1.0, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0)


class TransmissionError(EffectOfJoint):
    """A wave of the gear, the coupling or the encoder: δ = amplitude · cos(cycles · q - phase)."""

    name = 'transmission_error'
    parameters = (
        Parameter('amplitude', 'rad', ANGLE, 'largest error of the angle'),
        Parameter('phase', 'rad', 1.0, 'cycles times the angle at which the error is largest', typical=0.7),
        Parameter('cycles', '1/turn', 1.0, 'waves per turn of the joint', LOWEST, 7.3),
    )
    # 4 arcsec: what its compensation, or an encoder at the output, leaves of a gear; the gear alone: 1.5e-4 rad or
    # more, peak to peak (Harmonic Drive, catalogue CSF/CSG, positioning accuracy)
    typical_size = 2e-5
    statement = 'the transmission of {target} has a periodic error'
    confounded_with = (
        'x0, y0, the offsets and the link lengths, if there are few cycles per turn and one elbow posture only; '
        'other frequencies, if the angles are evenly spaced'
    )
    identified_by = 'touches at many different angles of the joint, unevenly spaced, in both elbow postures'
    plot_variable = 'angle'
    force_dependence = ForceDependence.NONE
    grid_parameter = 'cycles'

    def shift(self, at: TouchState, values: Floats) -> Shift:
        amplitude, phase, cycles = values
        return self.turned(amplitude * np.cos(cycles * at.joints[:, self.joint] - phase))[0]

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        amplitude, phase, cycles = values
        angle = at.joints[:, self.joint]
        wave, turned = np.cos(cycles * angle - phase), amplitude * np.sin(cycles * angle - phase)
        return self.turned(wave, turned, -angle * turned)

    def amplitudes(self, values: Floats) -> Floats:
        """Its amplitude alone."""
        return np.array([values[0], 0.0, 0.0])

    def is_plausible(self, values: Floats) -> bool:
        """Less than one wave per turn is a curve, not a wave; 10 % beyond the grid count as on it."""
        return bool(0.9 * LOWEST < values[2] < HIGHEST / 0.9)

    def trials(self, at: TouchState, force: Floats) -> Sequence[Trial]:
        """One per frequency of a grid: a cosine and a sine."""
        angle = at.joints[:, self.joint]
        return self._at(angle, frequencies(angle))

    def usual_trials(self, at: TouchState) -> Sequence[Trial]:
        """Once and twice a turn: eccentric and oval wheels."""
        return self._at(at.joints[:, self.joint], np.array(_TYPICAL_CYCLES[:2]))

    def forms(self, at: TouchState) -> Sequence[Floats]:
        """A cosine and a sine of each of some frequencies: eccentric, oval and bent wheels, teeth."""
        return [np.array([0.0, phase, cycles]) for cycles in _TYPICAL_CYCLES for phase in (0.0, np.pi / 2)]

    def finer(self, at: TouchState, trial: Trial, width: float) -> Sequence[Trial]:
        """Frequencies about that of a trial, `width` steps of the grid on both sides."""
        angle = at.joints[:, self.joint]
        grid = frequencies(angle)
        step = grid[1] - grid[0] if len(grid) > 1 else 0.0
        places = trial.place + step * np.linspace(-width, width, FINER)
        return self._at(angle, np.maximum(places, LOWEST))

    def plot_axis(self, at: TouchState, values: Floats) -> PlotAxis:
        """The phase of the wave."""
        _, phase, cycles = values
        angle = wrap(cycles * at.joints[:, self.joint] - phase)
        return PlotAxis(f'phase of the wave, {cycles:.4g} per turn of joint {self.joint + 1}', '°', np.degrees(angle))

    def _at(self, angle: Floats, cycles: Floats) -> Sequence[Trial]:
        """A trial for each frequency."""
        phase = np.multiply.outer(cycles, angle)
        still = np.ones(len(angle))
        return Grid(
            cycles, np.stack([np.cos(phase), np.sin(phase)], axis=1), Trial(self.turned(still, still)), _as_wave
        )


def frequencies(angle: Floats) -> Floats:
    """The frequencies to try for a joint's angles (n,), rad: a grid over which no wave is lost, cycles per turn."""
    span, std = float(np.ptp(angle)), float(np.std(angle))
    if std == 0.0 or not span < 1e3:  # the angles of a fit that diverges have no waves
        return np.array([LOWEST])
    # a wave half a step off a frequency of the grid keeps 1 - (0.75/2)² = 86 % of its power or more, as the phases
    # along the angles differ by 0.75/2 at one standard deviation; at most half of 2π/span
    step = min(0.75 / std, np.pi / span)
    return np.linspace(LOWEST, HIGHEST, int(np.ceil((HIGHEST - LOWEST) / step)) + 1)


def _as_wave(coefficients: Floats, cycles: float) -> Floats:
    """Amplitude, phase and cycles of the wave with given parts of cosine and sine."""
    cosine, sine = coefficients
    return np.array([np.hypot(cosine, sine), np.arctan2(sine, cosine), cycles])


class JointSlip(EffectOfJoint):
    """A second spring behind friction: δ = compliance · P_r(C), P_r the play of half width r = `slip_torque`.

    A spring and a Coulomb slider side by side, in series with the spring of the joint: up to the slip torque the slider
    holds, beyond it the spring gives way by C - r. When the load goes off, the slider holds until the torque has come
    down by 2 r, so that a deflection of up to compliance · r stays for the next touch. The state follows from the
    torques of the whole recording up to the hold (`TouchSet.history`), from the relaxed state.
    """

    name = 'joint_slip'
    parameters = (
        Parameter('compliance', 'rad/Nm', 3e-4, 'of the part that slips', typical=1e-5, sign=1),
        Parameter('slip_torque', 'Nm', 3.0, 'up to which friction holds it', 1.0, typical=2.0, sign=1),
    )
    typical_size = 5e-7  # a tenth of a stiff joint
    statement = '{target} slips under load and keeps a part of its deflection'
    confounded_with = (
        'compliance and backlash of the joint, if every touch is loaded from zero beyond twice the slip torque; '
        'joint_hysteresis, if every torque that turns round changes by more than that'
    )
    identified_by = (
        'recorded touches, preloaded and partly unloaded, with torques of both signs from below the slip torque '
        'to far above it'
    )
    plot_variable = 'torque'
    grid_parameter = 'slip_torque'
    is_smooth = False
    premise = (
        'the arm travels and approaches so slowly that the torques of its inertia stay far below the slip torque: they '
        'move the friction, too, and no force sensor shows them'
    )

    def shift(self, at: TouchState, values: Floats) -> Shift:
        return self.turned(values[0] * self._slipped(*self._loads(at), self._folded(values[1])[0])[0])[0]

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        friction, sense = self._folded(values[1])
        slipped, by_friction = self._slipped(*self._loads(at), friction)
        return self.turned(slipped, values[0] * sense * by_friction)

    def amplitudes(self, values: Floats) -> Floats:
        """Its compliance alone."""
        return np.array([values[0], 0.0])

    def is_plausible(self, values: Floats) -> bool:
        """A spring gives way to the load, friction resists the motion."""
        return bool(values[0] > 0 and values[1] > 0)

    def trials(self, at: TouchState, force: Floats) -> Sequence[Trial]:
        """One per value of a grid of the friction; without a history it cannot be told from the base model."""
        history, load = self._loads(at)
        if not history.shape[1]:
            return (Trial(self.turned(np.zeros(len(load))), values=partial(np.append, values=1.0)),)
        return self._at(history, load, self._grid(load))

    def finer(self, at: TouchState, trial: Trial, width: float) -> Sequence[Trial]:
        """Values about that of a trial, `width` steps of the grid on both sides, none beyond it."""
        history, load = self._loads(at)
        grid = self._grid(load)
        places = trial.place * (grid[1] / grid[0]) ** np.linspace(-width, width, FINER)
        return self._at(history, load, np.clip(places, grid[0], grid[-1]))

    def forms(self, at: TouchState) -> Sequence[Floats]:
        """With half of a typical friction more, and less."""
        friction = self.typical[1]
        return np.array([0.0, friction / 2]), np.array([0.0, 1.5 * friction])

    def _at(self, history: Floats, load: Floats, friction: Floats) -> Sequence[Trial]:
        """A trial for each value of the friction."""
        slipped, _ = self._slipped(history, load, friction[:, None])
        return Grid(friction, slipped[:, None], Trial(self.turned(np.ones(len(load)))))

    def _loads(self, at: TouchState) -> tuple[Floats, Floats]:
        """Torques of the joint before the hold, (n, K), and in it, (n,), Nm."""
        return at.history_torques[self.joint], at.torques[:, self.joint]

    def _slipped(self, history: Floats, load: Floats, friction: Floats | float) -> tuple[Floats, Floats]:
        """The play for one value of the friction, or for (t, 1) at once, and its derivative by it."""
        return play_operator(history, load, friction)[:2]

    def _folded(self, friction: float) -> tuple[float, float]:
        """The friction that a value stands for, and its derivative: a step of a fit beyond a limit is sent back."""
        return abs(friction), np.sign(friction)

    def _grid(self, load: Floats) -> Floats:
        """Slip torques up to the torque that nine touches of ten do not exceed.

        With a larger one few touches would move the play, with a very small one it is a spring with friction.
        Neighbours on the grid resemble each other.
        """
        return np.quantile(np.abs(load), 0.9) * np.geomspace(0.01, 0.9, 12)


_RATIO = 0.2
"""Usual friction of a gear over its load."""


class LoadFriction(JointSlip):
    """A second spring behind friction that grows with its load: δ = compliance (1 + μ) P(C), |C - P| ≤ μ |P|.

    The compliance is that of the joint loaded from rest, where P = C / (1 + μ); μ is `friction_ratio`. In these two a
    touch that friction holds after its preload depends on the compliance alone.

    So act gears whose friction is that of the flanks they press together. Loaded from rest the joint only has another
    compliance. When the torque comes down, the spring holds its load until friction reverses; without load nothing
    remains.
    """

    name = 'load_friction'
    parameters = (
        JointSlip.parameters[0]._replace(meaning='of the part behind friction, loaded from rest'),
        Parameter('friction_ratio', '1', 0.6, 'friction over the load of that part', _RATIO, typical=_RATIO, sign=1),
    )
    statement = '{target} has friction that grows with its load'
    confounded_with = (
        'the compliance of the joint, if every touch is loaded from rest; its parameters with each other and with that '
        'compliance, if all preloads are the same part of the force'
    )
    identified_by = 'recorded touches, preloaded by several parts of their force and partly unloaded'
    grid_parameter = 'friction_ratio'
    premise = (
        'the arm travels and approaches so slowly that the torques of its inertia stay far below those of the touches: '
        'they move the friction, too, and no force sensor shows them'
    )

    def is_plausible(self, values: Floats) -> bool:
        return bool(values[0] > 0 and 0 < values[1] < LARGEST_RATIO)

    def _slipped(self, history: Floats, load: Floats, friction: Floats | float) -> tuple[Floats, Floats]:
        value, _, by_ratio = play_operator(history, load, 0.0, friction)
        return (1 + friction) * value, (1 + friction) * by_ratio + value

    def _folded(self, friction: float) -> tuple[float, float]:
        beyond = (friction + LARGEST_RATIO) % (2 * LARGEST_RATIO) - LARGEST_RATIO
        return abs(beyond), np.sign(beyond)

    def _grid(self, load: Floats) -> Floats:
        return np.geomspace(0.1, 0.8, 16)

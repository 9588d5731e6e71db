"""Slip with memory in a joint: a second spring behind friction, constant or growing with the load that it carries.

δ = compliance · P(C), with P the play operator (`model.play_operator`) over the torque C. Its state depends on the
turning points of C alone, `TouchSet.history`.

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
from dataclasses import dataclass
from functools import partial

import numpy as np

from scara_kinetostatic.effects.base import EffectOfJoint, Trial
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import Parameter, Shift, TouchState
from scara_kinetostatic.model.play_operator import LARGEST_RATIO, PlayState, play_operator


@dataclass(frozen=True)
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
    diverges_with_alias = True
    is_smooth = False
    premise = (
        'the arm travels and approaches so slowly that the torques of its inertia stay far below the slip torque: they '
        'move the friction, too, and no force sensor shows them'
    )

    def shift(self, at: TouchState, values: Floats) -> Shift:
        return self.turned(values[0] * self._slipped(*self._loads(at), self._folded(values[1])[0]).value)[0]

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        friction, sense = self._folded(values[1])
        state = self._slipped(*self._loads(at), friction)
        return self.turned(state.value, values[0] * sense * self._by_friction(state))

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
        places = trial.place * (grid[1] / grid[0]) ** np.linspace(-width, width, 13)
        return self._at(history, load, np.clip(places, grid[0], grid[-1]))

    def forms(self, at: TouchState) -> Sequence[Floats]:
        """With half of a typical friction more, and less."""
        friction = self.typical[1]
        return np.array([0.0, friction / 2]), np.array([0.0, 1.5 * friction])

    def _at(self, history: Floats, load: Floats, friction: Floats) -> Sequence[Trial]:
        """A trial for each value of the friction."""
        return [
            Trial(self.turned(slipped), values=partial(np.append, values=place), place=place)
            for slipped, place in zip(
                self._slipped(history, load, friction[:, None]).value, friction.tolist(), strict=True
            )
        ]

    def _loads(self, at: TouchState) -> tuple[Floats, Floats]:
        """Torques of the joint before the hold, (n, K), and in it, (n,), Nm."""
        return at.history_torques(self.joint), at.torques[:, self.joint]

    def _slipped(self, history: Floats, load: Floats, friction: Floats | float) -> PlayState:
        """The play for one value of the friction, or for (t, 1) at once."""
        return play_operator(history, load, friction)

    def _by_friction(self, state: PlayState) -> Floats:
        return state.by_half_width

    def _folded(self, friction: float) -> tuple[float, float]:
        """The friction that a value stands for, and its derivative: a step of a fit beyond a limit is sent back."""
        return abs(friction), np.sign(friction)

    def _grid(self, load: Floats) -> Floats:
        """Slip torques up to the torque that nine touches of ten do not exceed.

        With a larger one few touches would move the play, with a very small one it is a spring with friction.
        Neighbours on the grid resemble each other.
        """
        return np.quantile(np.abs(load), 0.9) * np.geomspace(0.01, 0.9, 12)


@dataclass(frozen=True)
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
        Parameter('compliance', 'rad/Nm', 3e-4, 'of the part behind friction, loaded from rest', typical=1e-5, sign=1),
        Parameter('friction_ratio', '1', 0.6, 'friction over the load of that part', 0.2, typical=0.2, sign=1),
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

    def _slipped(self, history: Floats, load: Floats, friction: Floats | float) -> PlayState:
        value, _, by_ratio = play_operator(history, load, 0.0, friction)
        return PlayState((1 + friction) * value, value, (1 + friction) * by_ratio + value)

    def _by_friction(self, state: PlayState) -> Floats:
        return state.by_ratio

    def _folded(self, friction: float) -> tuple[float, float]:
        beyond = (friction + LARGEST_RATIO) % (2 * LARGEST_RATIO) - LARGEST_RATIO
        return abs(beyond), np.sign(beyond)

    def _grid(self, load: Floats) -> Floats:
        return np.geomspace(0.1, 0.8, 16)

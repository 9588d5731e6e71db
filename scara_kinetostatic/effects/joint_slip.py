"""Slip with memory in a joint: a play operator over the torque.

A play of half width r follows a torque C only where C drives it: p ← min(max(p, C - r), C + r). Its state depends on
the turning points of C alone, `TouchSet.history`.

Source: Brokate and Sprekels, Hysteresis and Phase Transitions (1996), section 2.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from scara_kinetostatic.effects.base import EffectOfJoint, Trial
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import Parameter, Shift, TouchState


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
        compliance, slip_torque = values
        return self.turned(compliance * play_operator(*self._loads(at), abs(slip_torque))[0])[0]

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        compliance, slip_torque = values
        value, by_slip_torque = play_operator(*self._loads(at), abs(slip_torque))
        by_slip_torque = by_slip_torque * np.sign(slip_torque)  # a step of a fit beyond 0 is sent back
        return self.turned(value, compliance * by_slip_torque)

    def amplitudes(self, values: Floats) -> Floats:
        """Its compliance alone."""
        return np.array([values[0], 0.0])

    def is_plausible(self, values: Floats) -> bool:
        """A spring gives way to the load, friction resists the motion."""
        return bool(values[0] > 0 and values[1] > 0)

    def trials(self, at: TouchState, force: Floats) -> Sequence[Trial]:
        """One per slip torque of a grid; without a history it cannot be told from the base model."""
        history, load = self._loads(at)
        if not history.shape[1]:
            return (Trial(self.turned(np.zeros(len(load))), values=partial(np.append, values=1.0)),)
        # neighbours on the grid resemble each other: the play of one explains most of that of the next. It reaches up
        # to the torque that nine touches of ten do not exceed: with a larger one few touches would move the play, with
        # a very small one it is a spring with friction
        torques = np.quantile(np.abs(load), 0.9) * np.geomspace(0.01, 0.9, 12)
        lags, _ = play_operator(history, load, torques[:, None])
        return [
            Trial(self.turned(lag), values=partial(np.append, values=torque), place=torque)
            for lag, torque in zip(lags, torques.tolist(), strict=True)
        ]

    def forms(self, at: TouchState) -> Sequence[Floats]:
        """A small and a large slip torque."""
        return np.array([0.0, 1.0]), np.array([0.0, 3.0])

    def _loads(self, at: TouchState) -> tuple[Floats, Floats]:
        """Torques of the joint before the hold, (n, K), and in it, (n,), Nm."""
        return at.history_torques(self.joint), at.torques[:, self.joint]


def play_operator(history: Floats, load: Floats, half_width: Floats | float) -> tuple[Floats, Floats]:
    """The play of half width r that rested at 0, driven through a history to a load.

    Args:
        history: turning points of the load, the oldest first, (n, K).
        load: the load at last, (n,).
        half_width: r > 0, one, or (t, 1) for t plays at once.

    Returns:
        P_r, of the unit of the load, and ∂P_r/∂r: -1 where it follows a rising load, +1 a falling one, 0 where it has
        never moved. Of every load, (n,); of t plays, (t, n).
    """
    width = np.maximum(half_width, 0.0)
    value = by_half_width = np.zeros(np.broadcast_shapes(np.shape(width), load.shape))
    for turn in (*history.T, load):
        low, high = turn - width, turn + width
        by_half_width = np.where(value < low, -1.0, np.where(value > high, 1.0, by_half_width))
        value = np.minimum(np.maximum(value, low), high)
    return value, by_half_width

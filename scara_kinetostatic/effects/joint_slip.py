"""Slip with memory in a joint."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from scara_kinetostatic.effects.base import Effect, Parameter, Trial, at_joint
from scara_kinetostatic.effects.variables import VARIABLES, PlotAxis
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import Shift, TouchState
from scara_kinetostatic.model.load_history import play_operator, play_value

GRID = 12
"""Slip torques that are tried. Neighbours resemble each other: the play of one explains most of that of the next."""
_SMALLEST, _LARGEST = 0.01, 0.9
"""The slip torques tried, over the torque that nine touches of ten do not exceed in load or preload. With a smaller one
the play is a spring with friction, with a larger one few touches would move it."""


@dataclass(frozen=True)
class JointSlip(Effect):
    """A second spring behind friction: δ = compliance · P_r(C), P_r the play of half width r = `slip_torque`.

    A spring and a Coulomb slider side by side, in series with the spring of the joint: up to the slip torque the slider
    holds, beyond it the spring gives way by C - r. When the load goes off, the slider holds until the torque has come
    down by 2 r, so that a deflection of up to compliance · r stays for the next touch. The state follows from the
    torques of the whole recording up to the hold (`TouchSet.history`), from the relaxed state.

    Attributes:
        joint: 0 or 1.
    """

    joint: int = 0

    name = 'joint_slip'
    parameters = (
        Parameter('compliance', 'rad/Nm', 3e-4, 'of the part that slips', typical=1e-5, sign=1),
        Parameter('slip_torque', 'Nm', 3.0, 'up to which friction holds it', 1.0, typical=2.0, sign=1),
    )
    statement = '{target} slips under load and keeps a part of its deflection'
    short_statement = 'slip in {target}'
    confounded_with = (
        'compliance and backlash of the joint, if every touch is loaded from zero beyond twice the slip torque; '
        'joint_hysteresis, if every torque that turns round changes by more than that'
    )
    identified_by = (
        'recorded touches, preloaded and partly unloaded, with torques of both signs from below the slip torque '
        'to far above it'
    )
    plot_variable = 'torque'
    order = 9
    grid_parameter = 'slip_torque'
    diverges_with_alias = True
    is_smooth = False
    premise = (
        'the arm travels and approaches so slowly that the torques of its inertia stay far below the slip torque: they '
        'move the friction, too, and no force sensor shows them'
    )

    @classmethod
    def of(cls, joint: int) -> JointSlip:
        """That of joint 0 or 1."""
        return cls(target=f'joint{joint + 1}', joint=joint)

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return [cls.of(joint) for joint in (0, 1)]

    def shift(self, at: TouchState, values: Floats) -> Shift:
        compliance, slip_torque = values
        lag = play_value(*self._loads(at), abs(slip_torque))
        return Shift(joints=at_joint(compliance * lag, self.joint))

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        compliance, slip_torque = values
        value, by_slip_torque = play_operator(*self._loads(at), abs(slip_torque))
        by_slip_torque = by_slip_torque * np.sign(slip_torque)  # a step of a fit beyond 0 is sent back
        return tuple(Shift(joints=at_joint(column, self.joint)) for column in (value, compliance * by_slip_torque))

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
            return (Trial((Shift(joints=np.zeros_like(at.joints)),), values=partial(_as_slip, slip_torque=1.0)),)
        # part of the touches for whose largest torque a slip torque is looked for
        common = float(np.quantile(np.abs(load), 0.9))
        torques = common * np.geomspace(_SMALLEST, _LARGEST, GRID)
        values = play_value(history, load, torques[:, None])
        return [self._trial(value, float(torque)) for value, torque in zip(values, torques, strict=True)]

    def plot_axis(self, at: TouchState, values: Floats) -> PlotAxis:
        return VARIABLES[self.plot_variable].axis(at, self.joint)

    def random_values(self, random: np.random.Generator) -> Floats:
        """The plausible compliance, with a slip torque as measured on a real arm or up to twice as large."""
        return np.array([self.scales[0], random.uniform(0.5, 4.0)])

    def _loads(self, at: TouchState) -> tuple[Floats, Floats]:
        """Torques of the joint before the hold, (n, K), and in it, (n,), Nm."""
        return at.history_torques(self.joint), at.torques[:, self.joint]

    def _trial(self, value: Floats, slip_torque: float) -> Trial:
        columns = (Shift(joints=at_joint(value, self.joint)),)
        return Trial(columns, values=partial(_as_slip, slip_torque=slip_torque), place=slip_torque)


def _as_slip(coefficients: Floats, slip_torque: float) -> Floats:
    """Compliance and slip torque."""
    return np.array([coefficients[0], slip_torque])

"""Transmission error of a joint."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from scara_kinetostatic.effects.base import Effect, Parameter, Trial, at_joint
from scara_kinetostatic.effects.variables import PlotAxis
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import ForceDependence, Shift, TouchState

LOWEST, HIGHEST = 1.0, 120.0
"""Frequencies of the trials, cycles per turn of the joint."""
RANDOM_CYCLES = (1.0, 110.0)
"""Frequencies of `random_values`, cycles per turn of the joint."""
BARELY = 0.9
"""Part of the lowest frequency below which a fit is not plausible."""
GRID = 0.75
"""Step of the grid times the standard deviation σ of the joint's angles, rad: a wave half a step off a frequency of the
grid keeps 1 - (GRID/2)² = 86 % of its power or more, as the phases along the angles differ by GRID/2 at one σ."""
FINER = 13
"""Trials about one of the grid."""
LARGEST_GRID = np.pi
"""Step of the grid times the span of the angles at most: half of 2π/span."""


@dataclass(frozen=True)
class TransmissionError(Effect):
    """A wave of the gear, the coupling or the encoder: δ = amplitude · cos(cycles · q - phase).

    Attributes:
        joint: 0 or 1.
    """

    joint: int = 0

    name = 'transmission_error'
    parameters = (
        Parameter('amplitude', 'rad', 1e-3, 'largest error of the angle', typical=1e-4),
        Parameter('phase', 'rad', 1.0, 'cycles times the angle at which the error is largest', typical=0.7),
        Parameter('cycles', '1/turn', 1.0, 'waves per turn of the joint', LOWEST, 7.3),
    )
    statement = 'the transmission of {target} has a periodic error'
    short_statement = 'periodic error in the transmission of {target}'
    confounded_with = (
        'x0, y0, the offsets and the link lengths, if there are few cycles per turn and one elbow posture only; '
        'other frequencies, if the angles are evenly spaced'
    )
    identified_by = 'touches at many different angles of the joint, unevenly spaced, in both elbow postures'
    plot_variable = 'angle'
    order = 6
    force_dependence = ForceDependence.NONE
    grid_parameter = 'cycles'
    diverges_with_alias = True

    @classmethod
    def of(cls, joint: int) -> TransmissionError:
        """That of joint 0 or 1."""
        return cls(target=f'joint{joint + 1}', joint=joint)

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return [cls.of(joint) for joint in (0, 1)]

    def shift(self, at: TouchState, values: Floats) -> Shift:
        amplitude, phase, cycles = values
        return Shift(joints=at_joint(amplitude * np.cos(cycles * at.joints[:, self.joint] - phase), self.joint))

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        amplitude, phase, cycles = values
        angle = at.joints[:, self.joint]
        wave, turned = np.cos(cycles * angle - phase), amplitude * np.sin(cycles * angle - phase)
        return tuple(Shift(joints=at_joint(column, self.joint)) for column in (wave, turned, -angle * turned))

    def amplitudes(self, values: Floats) -> Floats:
        """Its amplitude alone."""
        return np.array([values[0], 0.0, 0.0])

    def is_plausible(self, values: Floats) -> bool:
        """Less than one wave per turn is a curve, not a wave."""
        return bool(BARELY * LOWEST < values[2] < HIGHEST / BARELY)

    def trials(self, at: TouchState, force: Floats) -> Sequence[Trial]:
        """One per frequency of a grid: a cosine and a sine."""
        angle = at.joints[:, self.joint]
        return self._at(angle, frequencies(angle))

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
        angle = np.degrees(cycles * at.joints[:, self.joint] - phase)
        title = f'phase of the wave, {cycles:.4g} per turn of joint {self.joint + 1}'
        return PlotAxis(title, '°', np.asarray((angle + 180) % 360 - 180))

    def random_values(self, random: np.random.Generator) -> Floats:
        """The plausible amplitude, with any phase and frequency."""
        return np.array([self.scales[0], random.uniform(0, 2 * np.pi), random.uniform(*RANDOM_CYCLES)])

    def difference(self, values: Floats, others: Floats) -> Floats:
        """A negative amplitude is half a turn of the phase."""
        turn = values[1] + (np.pi if values[0] < 0 else 0.0) - others[1]
        return np.array([abs(values[0]) - others[0], (turn + np.pi) % (2 * np.pi) - np.pi, values[2] - others[2]])

    def _at(self, angle: Floats, cycles: Floats) -> Sequence[Trial]:
        """A trial for each frequency."""
        phase = np.multiply.outer(cycles, angle)
        waves = np.zeros((len(cycles), 2, len(angle), 2))
        waves[:, 0, :, self.joint], waves[:, 1, :, self.joint] = np.cos(phase), np.sin(phase)
        return [
            Trial((Shift(cosine), Shift(sine)), values=partial(_as_wave, cycles=place), place=place)
            for (cosine, sine), place in zip(waves, cycles.tolist(), strict=True)
        ]


def frequencies(angle: Floats) -> Floats:
    """The frequencies to try for a joint's angles (n,), rad: a grid over which no wave is lost, cycles per turn."""
    span, std = float(np.ptp(angle)), float(np.std(angle))
    if std == 0.0:
        return np.array([LOWEST])
    step = min(GRID / std, LARGEST_GRID / span)
    return np.linspace(LOWEST, HIGHEST, int(np.ceil((HIGHEST - LOWEST) / step)) + 1)


def _as_wave(coefficients: Floats, cycles: float) -> Floats:
    """Amplitude, phase and cycles of the wave with given parts of cosine and sine."""
    cosine, sine = coefficients
    return np.array([np.hypot(cosine, sine), np.arctan2(sine, cosine), cycles])

"""Transmission error of a joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from scara_kinetostatic.effects.base import EffectOfJoint, Trial
from scara_kinetostatic.effects.variables import PlotAxis
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import ForceDependence, Parameter, Shift, TouchState

LOWEST, HIGHEST = 1.0, 120.0
"""Frequencies of the trials, cycles per turn of the joint."""
_TYPICAL_CYCLES = (1.0, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0)


@dataclass(frozen=True)
class TransmissionError(EffectOfJoint):
    """A wave of the gear, the coupling or the encoder: δ = amplitude · cos(cycles · q - phase)."""

    name = 'transmission_error'
    parameters = (
        Parameter('amplitude', 'rad', 1e-3, 'largest error of the angle', typical=1e-4),
        Parameter('phase', 'rad', 1.0, 'cycles times the angle at which the error is largest', typical=0.7),
        Parameter('cycles', '1/turn', 1.0, 'waves per turn of the joint', LOWEST, 7.3),
    )
    statement = 'the transmission of {target} has a periodic error'
    confounded_with = (
        'x0, y0, the offsets and the link lengths, if there are few cycles per turn and one elbow posture only; '
        'other frequencies, if the angles are evenly spaced'
    )
    identified_by = 'touches at many different angles of the joint, unevenly spaced, in both elbow postures'
    plot_variable = 'angle'
    force_dependence = ForceDependence.NONE
    grid_parameter = 'cycles'
    diverges_with_alias = True

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
        places = trial.place + step * np.linspace(-width, width, 13)
        return self._at(angle, np.maximum(places, LOWEST))

    def plot_axis(self, at: TouchState, values: Floats) -> PlotAxis:
        """The phase of the wave."""
        _, phase, cycles = values
        angle = np.degrees(cycles * at.joints[:, self.joint] - phase)
        title = f'phase of the wave, {cycles:.4g} per turn of joint {self.joint + 1}'
        return PlotAxis(title, '°', np.asarray((angle + 180) % 360 - 180))

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

"""A calibrated arm: what is needed of a calibration to use it, without the touches that it was made from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import timezone
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.declared_errors import DeclaredErrors
from scara_kinetostatic.calibration.propagation import undetermined_directions
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats, read_only
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.noise import Noise

_UNFIT = 'the calibration is unfit for use; its calibration.json says why (assessment.reasons)'
_OPEN = {
    'ambiguous': 'effects that the touches do not distinguish: one is taken, the uncertainty does not cover the others',
    'unexplained': 'the calibration has a model error of unknown cause; the uncertainty does not cover it',
}
"""What is to be known of a calibration by its verdict."""


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
    """A calibrated arm, from a `Calibration`, or read from a file of it (`files.calibration_file`).

    Attributes:
        cell: what was known before; its `nominal` are the parameters of the nominal arm.
        model: the calibrated model with the effects that were found.
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
        >>> arm = sk.CalibratedArm.of_outcome(sk.diagnose('touches.csv', cell))
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
        effects = ' '.join(effect.label for effect in self.model.effects) or 'none'
        return f'<CalibratedArm: {self.grade or "not assessed"}, effects: {effects}>'

    @classmethod
    def of(cls, calibration: Calibration) -> CalibratedArm:
        """That of a calibration, which nobody has assessed."""
        c, touches = calibration, calibration.touches.select(calibration.used)
        magnitude = np.hypot(*c.force[c.used].T)
        postures = tuple(sign for sign in (1, -1) if np.any(touches.posture == sign))
        return cls(
            cell=c.cell,
            model=c.model,
            covariance=np.array(c.covariance),
            undetermined=undetermined_directions(c),
            noise=c.noise,
            sensor=_sensor_errors(c),
            used=UsedRange(float(magnitude.min()), float(magnitude.max()), float(np.ptp(touches.time)), postures),
        )

    @classmethod
    def of_outcome(cls, outcome: Outcome) -> CalibratedArm:
        """That of the final calibration of an outcome, with its assessment."""
        created = outcome.created.astimezone(timezone.utc).strftime('%Y-%m-%dT%H:%M:%SZ')
        grade = outcome.assessment.grade.value
        return replace(cls.of(outcome.final), grade=grade, verdict=outcome.verdict, created=created)

    @property
    def reservations(self) -> tuple[str, ...]:
        """What is to be known before the calibration is used, one sentence each: it is unfit, its model incomplete."""
        found = (_UNFIT if self.grade == 'unfit' else '', _OPEN.get(self.verdict, ''))
        return tuple(filter(None, found))

    @property
    def nominal(self) -> ExtendedModel:
        """The nominal model, without effects."""
        return ExtendedModel(self.cell.nominal)


def _sensor_errors(c: Calibration) -> SensorErrors:
    declared = DeclaredErrors.of(c.cell)
    return SensorErrors() if declared is None else SensorErrors(*declared.sensor(c.errors))

"""The outcome of a calibration of recordings: all that it gives, frozen, with its assessment."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from functools import cached_property
from typing import NamedTuple

from scara_kinetostatic.assessment.evidence import Evidence
from scara_kinetostatic.assessment.grade import Assessment, assess
from scara_kinetostatic.calibration.result import Estimate
from scara_kinetostatic.diagnosis.comparison import EffectResidual, effect_residuals
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.threads import one_thread


class Recording(NamedTuple):
    """A recording or touch table that a result was calculated from.

    Attributes:
        path: as given.
        sha256: of the file, or of the files of a rosbag2 folder (`files.atomic`), hexadecimal.
        start: time of its first sample by the clock of the recording, UTC; None where unknown, as of a touch table.
        turned: how its forces were turned by their `frame_id`; empty where they were not.
    """

    path: str
    sha256: str
    start: datetime | None
    turned: str = ''


@dataclass(frozen=True, eq=False, repr=False)
class Outcome(Evidence):
    """All that a calibration of recordings gives: the evidence, where it comes from, and what is made of it.

    Attributes:
        sources: the recordings.
        warnings: irregularities of the recordings, one sentence each.
        recordings: the files that the touches come from; empty where they come from elsewhere.
        created: when the calibration was calculated, UTC, whole seconds.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> outcome = sk.diagnose('touches.csv', cell)
        >>> outcome.verdict, list(outcome.effects)
        ('explained', ['object_radius[disc_2]'])
        >>> outcome['p_ee'].unit, outcome.found, outcome.final.used.sum().item()
        ('m/N', 72, 72)
        >>> outcome.assessment.grade.value
        'fit'
    """

    sources: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    recordings: tuple[Recording, ...] = ()
    created: datetime = field(default_factory=lambda: datetime.now(timezone.utc).replace(microsecond=0))

    def __repr__(self) -> str:
        found = ' '.join(item.effect.label for item in self.diagnosis.found) or 'none'
        return f'<Outcome: {self.verdict}, effects: {found}, final {self.final!r}>'

    def __getitem__(self, name: str) -> Estimate:
        """A parameter of the base model by name, in the final model: ``outcome['l1'].value``, ``.std``, ``.unit``.

        Raises:
            KeyError: no such parameter.
        """
        return self.final[name]

    @property
    def effects(self) -> dict[str, dict[str, Estimate]]:
        """The parameters of the effects found by label and name: ``effects['object_radius[disc_2]']['radius'].std``.

        Of an effect that has rivals the values are those it has if it is this one.
        """
        found = dict[str, dict[str, Estimate]]()
        for item in self.diagnosis.found:
            fitted = self.final.effects.get(item.effect.label, {})
            starts = {v.name: fitted[v.name].nominal if v.name in fitted else 0.0 for v in item.values}
            values = {v.name: Estimate.of_effect(v.value, v.std, v.unit, starts[v.name]) for v in item.values}
            found[item.effect.label] = values
        return found

    @property
    def residuals(self) -> Floats:
        """Measured less predicted force of `final`, one row per touch of `final.touches`, base frame, (n, 2), N."""
        return self.final.residual

    @property
    def verdict(self) -> str:
        """``none`` (the base model is enough), ``explained``, ``ambiguous`` or ``unexplained``."""
        return self.diagnosis.verdict

    @property
    def arm(self) -> CalibratedArm:
        """What is needed of the final calibration to use it, with its assessment."""
        created = self.created.astimezone(timezone.utc).strftime('%Y-%m-%dT%H:%M:%SZ')
        arm = self.final.arm
        if self.earlier is not None:
            arm = replace(arm, used=arm.used.joined(self.earlier.used))
        return replace(arm, grade=self.assessment.grade.value, verdict=self.verdict, created=created)

    @cached_property
    @one_thread
    def effect_residuals(self) -> tuple[EffectResidual, ...]:
        """The residual of each effect of the extended model, in the order of `diagnosis.found`."""
        return effect_residuals(self.final, self.diagnosis.found)

    @cached_property
    @one_thread
    def assessment(self) -> Assessment:
        """Whether the result may be used, why, and what to do."""
        return assess(self)

"""All that a calibration of recordings gives, frozen."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from functools import cached_property
from typing import NamedTuple

from scara_kinetostatic.assessment.criteria import assess
from scara_kinetostatic.assessment.evidence import Evidence
from scara_kinetostatic.assessment.grade import Assessment
from scara_kinetostatic.assessment.mistakes import Check
from scara_kinetostatic.calibration.result import Calibration, Estimate, HeldOut
from scara_kinetostatic.calibration.tip_uncertainty import TipUncertainty
from scara_kinetostatic.calibration.uncertainty_budget import Item, uncertainty_budget
from scara_kinetostatic.diagnosis.comparison import Comparison, EffectResidual, compare, effect_residuals
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.touch import Rejection


class Recording(NamedTuple):
    """A recording or touch table that a result was calculated from.

    Attributes:
        path: as given.
        sha256: of the file, or of the files of a rosbag2 folder (`files.checksum`), hexadecimal.
        start: time of its first sample by the clock of the recording, UTC; None where unknown, as of a touch table.
        turned: how its forces were turned by their `frame_id`; empty where they were not.
    """

    path: str
    sha256: str
    start: datetime | None
    turned: str = ''


def _now() -> datetime:
    return datetime.now(timezone.utc).replace(microsecond=0)


@dataclass(frozen=True, eq=False, repr=False)
class Outcome:
    """All that a calibration of recordings gives.

    `comparison`, `effect_residuals` and `assessment` follow from the fits. Each is worked out once, when it is first
    read: a user of the parameters alone needs none, and a copy with another diagnosis gets its own.

    Attributes:
        calibration: the base model with its uncertainty.
        held_out: force error of that model on touches not used in the fit.
        diagnosis: whether the model is complete, and what is missing.
        extended_held_out: as `held_out`, of the model extended by what was found; the same where nothing was.
        found: touches in the recordings, rejected ones included.
        rejected: all that were not used, by index: by the detection and by the fit.
        sources: the recordings.
        warnings: irregularities of the recordings, one sentence each.
        recordings: the files that the touches come from; empty where they come from elsewhere.
        created: when the calibration was calculated, UTC, whole seconds.
        first_touches: number of the first touch of each recording.
        sequence_known: whether the order in time of the recordings is known.
        check: what the touches said of the cell before the fit.

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

    calibration: Calibration
    held_out: HeldOut
    diagnosis: Diagnosis
    extended_held_out: HeldOut
    found: int
    rejected: tuple[Rejection, ...]
    sources: tuple[str, ...]
    warnings: tuple[str, ...]
    recordings: tuple[Recording, ...] = ()
    created: datetime = field(default_factory=_now)
    first_touches: tuple[int, ...] = (0,)
    sequence_known: bool = True
    check: Check | None = None

    def __repr__(self) -> str:
        found = ' '.join(item.effect.label for item in self.diagnosis.found) or 'none'
        return f'<Outcome: {self.verdict}, effects: {found}, final {self.final!r}>'

    def __getitem__(self, name: str) -> Estimate:
        """One of the twelve parameters of the final model by name: ``outcome['l1'].value``, ``.std``, ``.unit``.

        Raises:
            KeyError: no such parameter.
        """
        return self.final[name]

    @property
    def effects(self) -> dict[str, dict[str, Estimate]]:
        """The parameters of the effects found by label and name: ``effects['object_radius[disc_2]']['radius'].std``.

        Of an effect that has rivals the values are those it has if it is this one.
        """
        starts = {
            (label, name): estimate.nominal
            for label, fitted in self.final.effects.items()
            for name, estimate in fitted.items()
        }
        return {
            item.effect.label: {
                v.name: Estimate.of_effect(v.value, v.std, v.unit, starts.get((item.effect.label, v.name), 0.0))
                for v in item.values
            }
            for item in self.diagnosis.found
        }

    @property
    def verdict(self) -> str:
        """``none`` (the base model is enough), ``explained``, ``ambiguous`` or ``unexplained``."""
        return self.diagnosis.verdict

    @property
    def final(self) -> Calibration:
        """The calibration to use: extended by what was found, where something was."""
        return self.diagnosis.extended or self.calibration

    @property
    def arm(self) -> CalibratedArm:
        """What is needed of the final calibration to use it, with its assessment."""
        created = self.created.astimezone(timezone.utc).strftime('%Y-%m-%dT%H:%M:%SZ')
        return replace(self.final.arm, grade=self.assessment.grade.value, verdict=self.verdict, created=created)

    @cached_property
    def comparison(self) -> Comparison:
        """The base model and the final one on the same touches: force error, error of the tip, bias of parameters."""
        held_out = self.held_out.force_error, self.extended_held_out.force_error
        return compare(self.calibration, self.final, *held_out)

    @cached_property
    def effect_residuals(self) -> tuple[EffectResidual, ...]:
        """The residual of each effect of the extended model, in the order of `diagnosis.found`."""
        return effect_residuals(self.calibration, self.final, self.diagnosis.found)

    @cached_property
    def tip_uncertainty(self) -> TipUncertainty:
        """Expanded uncertainty of the tip over the workspace."""
        return self.evidence.tip_uncertainty

    @cached_property
    def budget(self) -> tuple[Item, ...]:
        """What each source of uncertainty contributes to the final model's parameters and to the tip."""
        return uncertainty_budget(self.final, self.tip_uncertainty)

    @cached_property
    def assessment(self) -> Assessment:
        """Whether the result may be used, why, and what to do."""
        return assess(self.evidence)

    @cached_property
    def evidence(self) -> Evidence:
        """What the assessment is made from."""
        return Evidence(
            base=self.calibration,
            final=self.final,
            diagnosis=self.diagnosis,
            comparison=self.comparison,
            found=self.found,
            rejected=self.rejected,
            first_touches=self.first_touches,
            sequence_known=self.sequence_known,
            check=self.check,
        )

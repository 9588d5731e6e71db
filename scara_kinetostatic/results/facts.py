"""What a result is made from and worth, as flat values: the ROS parameters `calibration.<name>`.

They go with the numbers `calibrated.<name>`, in `calibration.yaml` and on the node, so that whoever uses the numbers
can check recording, time and assessment. Lists are of strings; a number that does not exist is NaN.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import NamedTuple

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.files.calibration_file import arm_document
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.report.json_file import utc
from scara_kinetostatic.results.tables import base_rank

GROUP = 'calibration'
Value = str | int | float | list[str]
"""As ROS parameters have it."""


class Fact(NamedTuple):
    """One of the values.

    Attributes:
        kind: its type.
        meaning: in a few words.
        of: from the outcome to the value.
    """

    kind: type
    meaning: str
    of: Callable[[Outcome], Value]


FACTS = {
    'assessment': Fact(str, 'may the result be used: fit, caution or unfit', lambda o: o.assessment.grade.value),
    'reasons': Fact(list, 'of the assessment, the gravest first', lambda o: list(o.assessment.reasons)),
    'actions': Fact(list, 'what to do, in the order of the reasons', lambda o: list(o.assessment.actions)),
    'verdict': Fact(str, 'is the model complete: none, explained, ambiguous or unexplained', lambda o: o.verdict),
    'effects': Fact(
        list, 'effects found', lambda o: [item.effect.label for item in o.diagnosis.found if item.is_found]
    ),
    'possible_effects': Fact(
        list,
        'effects of a model that is still incomplete',
        lambda o: [item.effect.label for item in o.diagnosis.found if item.in_every_model and item.is_possible],
    ),
    'rivals': Fact(
        list,
        'groups of effects that the touches do not tell apart, each with commas',
        lambda o: [', '.join(group) for group in o.diagnosis.rivals],
    ),
    'rank': Fact(int, 'how many combinations of the 12 parameters are determined', lambda o: base_rank(o.final)),
    'confounded': Fact(
        list,
        'groups of parameters that the touches do not separate, each with blanks',
        lambda o: [' '.join(group) for group in o.final.identifiability.confounded],
    ),
    'touches.found': Fact(int, 'touches in the recordings', lambda o: o.found),
    'touches.used': Fact(int, 'touches that the result is made from', lambda o: int(o.final.used.sum())),
    'touches.rejected': Fact(int, 'touches that were rejected', lambda o: len(o.rejected)),
    'force_error.nominal': Fact(float, 'force error before, N', lambda o: o.comparison.nominal),
    'force_error.calibrated': Fact(float, 'force error of the base model, N', lambda o: o.comparison.base.force_error),
    'force_error.extended': Fact(
        float, 'force error of the extended model, N', lambda o: o.comparison.extended.force_error
    ),
    'held_out_force_error.calibrated': Fact(
        float, 'the same of the base model on touches not used in the fit, N', lambda o: o.comparison.base.held_out
    ),
    'held_out_force_error.extended': Fact(
        float,
        'the same of the extended model on touches not used in the fit, N',
        lambda o: o.comparison.extended.held_out,
    ),
    'reduced_chi_square.calibrated': Fact(
        float, 'reduced chi-square of the base model', lambda o: o.comparison.base.reduced_chi_square
    ),
    'reduced_chi_square.extended': Fact(
        float, 'reduced chi-square of the extended model', lambda o: o.comparison.extended.reduced_chi_square
    ),
    'tip_uncertainty': Fact(
        float, 'largest expanded uncertainty of the tip in the workspace (k = 2), m', lambda o: o.tip_uncertainty.worst
    ),
    'warnings': Fact(list, 'irregularities of the recordings', lambda o: list(o.warnings)),
    'recordings': Fact(list, 'the recordings and touch tables', lambda o: list(o.sources)),
    'created': Fact(str, 'when the result was calculated, UTC', lambda o: utc(o.created)),
    'model': Fact(str, 'the calibrated model with its covariance, for the node compensator: JSON', lambda o: _model(o)),
}
"""By the part of the parameter's name after `calibration.`."""


def _model(outcome: Outcome) -> str:
    return json.dumps(arm_document(CalibratedArm.of_outcome(outcome)), ensure_ascii=False, separators=(',', ':'))


def facts(outcome: Outcome) -> dict[str, Value]:
    """The values of a result by the names of `FACTS`."""
    return {name: fact.kind(fact.of(outcome)) for name, fact in FACTS.items()}

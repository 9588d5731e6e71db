"""The touches with what the models predict, as a table: one row per touch, CSV.

Both models stand beside each other: ``calibrated`` is the base model, ``extended`` has the effects found as well; where
nothing was found they are the same. Forces are those on the object in the base frame, as the base model has them
(a sensor in the tool frame turns with the estimated angles). Touches that were rejected before the fit have index,
reason and nothing else. The columns of joints and forces are named as those of a touch table.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.files.columns import csv_lines, quoted

NAME = 'residuals.csv'


def residual_table(outcome: Outcome) -> str:
    """The table of an outcome."""
    base, final = outcome.calibration, outcome.final
    reasons = {item.index: item.reason for item in outcome.rejected}
    touches = base.touches
    index = sorted({*touches.index.tolist(), *reasons})
    names = [disc.name for disc in base.cell.discs]
    place = {number: k for k, number in enumerate(touches.index.tolist())}
    rows = [place.get(number) for number in index]

    def column(values: NDArray[np.generic] | Sequence[str]) -> list[str]:
        texts = [_text(value) for value in np.asarray(values).tolist()]
        return ['' if k is None else texts[k] for k in rows]

    columns = {
        'index': [str(number) for number in index],
        'object': column([quoted(names[disc]) for disc in touches.disc]),
        'posture': column(['left' if side > 0 else 'right' for side in touches.posture]),
        'time_s': column(touches.time),
        'q1_rad': column(touches.joints[:, 0]),
        'q2_rad': column(touches.joints[:, 1]),
        'fx_N': column(base.force[:, 0]),
        'fy_N': column(base.force[:, 1]),
    }
    for model, fit in (('calibrated', base), ('extended', _in_order_of(final, base))):
        predicted, residual = fit.force - fit.residual, fit.residual
        columns |= {
            f'fx_{model}_N': column(predicted[:, 0]),
            f'fy_{model}_N': column(predicted[:, 1]),
            f'residual_x_{model}_N': column(residual[:, 0]),
            f'residual_y_{model}_N': column(residual[:, 1]),
            f'standardized_distance_{model}': column(fit.standardized),
            f'used_{model}': column([str(int(used)) for used in fit.used]),
        }
    columns['used'] = [str(int(number not in reasons)) for number in index]
    columns['reason'] = [quoted(reasons.get(number, '')) for number in index]
    return csv_lines(columns)


def _in_order_of(final: Calibration, base: Calibration) -> Calibration:
    """The final model; both have the same touches."""
    if not np.array_equal(final.touches.index, base.touches.index):
        raise AssertionError('the extended model has other touches than the base model')
    return final


def _text(value: object) -> str:
    """Numbers in the shortest form that gives them back; empty where there is none."""
    if isinstance(value, float):
        return repr(value) if np.isfinite(value) else ''
    return str(value)

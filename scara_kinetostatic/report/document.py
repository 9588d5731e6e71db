"""The outcome as data: what `calibration.json` holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic import __version__
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.comparison import Comparison
from scara_kinetostatic.diagnosis.outcome import Outcome
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import NAMES, UNITS
from scara_kinetostatic.render.json_file import Document
from scara_kinetostatic.report.diagnosis_document import diagnosis_document
from scara_kinetostatic.report.diagnosis_document import number as _number
from scara_kinetostatic.report.parameter_rows import base_rank

Floats = NDArray[np.float64]

NAME = 'calibration.json'
SCHEMA = 'scara_kinetostatic/calibration/1'
"""Keys may be added under the same number; what is there keeps its name and meaning."""


def as_document(outcome: Outcome) -> Document:
    """The outcome as nested dicts and lists of plain JSON values.

    SI units. What the data do not determine, and numbers that are not finite, are None.
    """
    c, compared = outcome.final, outcome.comparison
    return {
        'schema': SCHEMA,
        'version': __version__,
        'sources': list(outcome.sources),
        'warnings': list(outcome.warnings),
        'cell': _cell(c.cell),
        'parameters': _parameters(outcome),
        'covariance': _covariance(c),
        'covariance_extended': _covariance(c, c.extra_std),
        'touches': _touches(outcome),
        'noise': {'joint': c.noise.joint, 'force': c.noise.force, 'source': c.noise_source},
        **_errors(outcome, compared),
        'fit': {
            'chi_square': _number(c.chi_square),
            'degrees_of_freedom': c.degrees_of_freedom,
            'iterations': c.iterations,
            'termination': c.termination.name.lower(),
        },
        'identifiability': _identifiability(c),
        'diagnosis': diagnosis_document(outcome.diagnosis),
    }


def _errors(outcome: Outcome, compared: Comparison) -> Document:
    """The twelve parameters alone and the extended model, on the same touches."""
    alone, extended = compared.alone, compared.extended
    return {
        'force_error': {
            'nominal': _number(compared.nominal),
            'calibrated': _number(alone.force_error),
            'extended': _number(extended.force_error),
        },
        'held_out_force_error': {
            'calibrated': _number(alone.held_out),
            'extended': _number(extended.held_out),
            'folds': outcome.extended_held_out.folds,
        },
        'reduced_chi_square': {
            'calibrated': _number(alone.reduced_chi_square),
            'extended': _number(extended.reduced_chi_square),
        },
        'tip_error': {
            'calibrated': _number(alone.tip.fitted),
            'extended': _number(extended.tip.fitted),
            'held_out': {'calibrated': _number(alone.tip.held_out), 'extended': _number(extended.tip.held_out)},
            'noise': _number(extended.tip.noise),
            'moved': {'rms': _number(compared.moved), 'largest': _number(compared.moved_most)},
        },
    }


def _cell(cell: Cell) -> Document:
    return {
        'joint_names': list(cell.joint_names),
        'objects': [{'name': disc.name, 'center': [disc.x, disc.y], 'radius': disc.radius} for disc in cell.discs],
        'sensor': {'frame': cell.sensor.frame.value, 'sign': cell.sensor.sign.value},
        'gripper_sign': cell.gripper_sign.value,
        'gripper_excess': [list(row) for row in cell.gripper_excess],
    }


def _parameters(outcome: Outcome) -> Document:
    c = outcome.final
    nominal = c.cell.nominal.as_dict()
    return {
        bias.name: {
            'nominal': nominal[bias.name],
            'value': bias.value,
            'std': _number(bias.std),
            'unit': UNITS[bias.name],
            'status': c.status[bias.name],
            'twelve_alone': {
                'value': bias.alone,
                'std': _number(bias.alone_std),
                'shift': bias.shift,
                'shift_in_std': _number(bias.in_std),
            },
        }
        for bias in outcome.comparison.biases
    }


def _covariance(c: Calibration, extra_std: Floats | None = None) -> Document:
    """Of the twelve, and of the effects' parameters if their standard deviations are given; only what is estimated."""
    names = [name for name in NAMES if c.status[name] == 'estimated']
    places = [NAMES.index(name) for name in names]
    labels = [label for law in c.cell.effects for label in law.labels]
    for place, std in enumerate(() if extra_std is None else extra_std):
        if np.isfinite(std):
            names.append(labels[place])
            places.append(len(NAMES) + place)
    return {'names': names, 'matrix': c.covariance[np.ix_(places, places)].tolist()}


def _touches(outcome: Outcome) -> Document:
    c, t = outcome.final, outcome.final.touches
    before = outcome.calibration
    return {
        'found': outcome.found,
        'used': int(c.used.sum()),
        'rejected': [{'index': item.index, 'reason': item.reason} for item in outcome.rejected],
        'fitted': [
            {
                'index': int(t.index[k]),
                'time': float(t.time[k]),
                'object': c.cell.discs[t.disc[k]].name,
                'posture': int(t.posture[k]),
                'joints': t.joints[k].tolist(),
                'force': c.force[k].tolist(),
                'residual': c.residual[k].tolist(),
                'residual_alone': before.residual[k].tolist(),
                'nominal_residual': before.nominal_residual[k].tolist(),
                'distance': _number(c.standardized[k]),
                'used': bool(c.used[k]),
            }
            for k in range(len(t))
        ],
    }


def _identifiability(c: Calibration) -> Document:
    """That of the twelve; groups in which none of them is stand apart."""
    found = c.identifiability
    own = [group for group in found.confounded if set(group) & set(NAMES)]
    return {
        'rank': base_rank(c),
        'condition': _number(found.condition),
        'confounded': [list(group) for group in own],
        'confounded_effects': [list(group) for group in found.confounded if group not in own],
        'combinations': [
            {'text': item.text, 'value': _number(item.value), 'std': _number(item.std), 'unit': item.unit}
            for item in found.combinations
        ],
        'advice': found.advice,
    }

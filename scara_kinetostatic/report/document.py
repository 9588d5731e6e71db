"""The outcome as data: what `calibration.json` holds."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from scara_kinetostatic import __version__
from scara_kinetostatic.calibration.solution import Calibration
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import NAMES, UNITS
from scara_kinetostatic.pipeline import Outcome

SCHEMA = 'scara_kinetostatic/calibration/1'
"""Keys may be added under the same number; what is there keeps its name and meaning."""

Document = dict[str, Any]


def as_document(outcome: Outcome) -> Document:
    """The outcome as nested dicts and lists of plain JSON values.

    SI units. What the data do not determine, and numbers that are not finite, are None.
    """
    c = outcome.calibration
    return {
        'schema': SCHEMA,
        'version': __version__,
        'sources': list(outcome.sources),
        'warnings': list(outcome.warnings),
        'cell': _cell(c.cell),
        'parameters': _parameters(c),
        'covariance': _covariance(c),
        'touches': _touches(outcome),
        'noise': {'joint': c.noise.joint, 'force': c.noise.force, 'source': c.noise_source},
        'force_error': {
            'nominal': _number(c.force_error_nominal),
            'calibrated': _number(c.force_error),
            'extended': _number(c.force_error),
        },
        'held_out_force_error': {
            'calibrated': _number(outcome.held_out.force_error),
            'extended': _number(outcome.held_out.force_error),
            'folds': outcome.held_out.folds,
        },
        'reduced_chi_square': {
            'calibrated': _number(c.reduced_chi_square),
            'extended': _number(c.reduced_chi_square),
        },
        'fit': {
            'chi_square': _number(c.chi_square),
            'degrees_of_freedom': c.degrees_of_freedom,
            'iterations': c.iterations,
            'termination': c.termination.name.lower(),
        },
        'identifiability': _identifiability(c),
        'diagnosis': _diagnosis(outcome),
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _cell(cell: Cell) -> Document:
    return {
        'joint_names': list(cell.joint_names),
        'objects': [{'name': disc.name, 'center': [disc.x, disc.y], 'radius': disc.radius} for disc in cell.discs],
        'sensor': {'frame': cell.sensor.frame.value, 'sign': cell.sensor.sign.value},
        'gripper_sign': cell.gripper_sign.value,
        'gripper_excess': [list(row) for row in cell.gripper_excess],
    }


def _parameters(c: Calibration) -> Document:
    values, nominal = c.parameters.as_dict(), c.cell.nominal.as_dict()
    return {
        name: {
            'nominal': nominal[name],
            'value': values[name],
            'std': _number(c.std_of(name)),
            'unit': UNITS[name],
            'status': c.status[name],
        }
        for name in NAMES
    }


def _covariance(c: Calibration) -> Document:
    """Of the parameters that are estimated; the others have none."""
    names = [name for name in NAMES if c.status[name] == 'estimated']
    places = [NAMES.index(name) for name in names]
    return {'names': names, 'matrix': c.covariance[np.ix_(places, places)].tolist()}


def _touches(outcome: Outcome) -> Document:
    c, t = outcome.calibration, outcome.calibration.touches
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
                'nominal_residual': c.nominal_residual[k].tolist(),
                'distance': _number(c.standardized[k]),
                'used': bool(c.used[k]),
            }
            for k in range(len(t))
        ],
    }


def _identifiability(c: Calibration) -> Document:
    found = c.identifiability
    return {
        'rank': found.rank,
        'condition': _number(found.condition),
        'confounded': [list(group) for group in found.confounded],
        'combinations': [
            {'text': item.text, 'value': _number(item.value), 'std': _number(item.std), 'unit': item.unit}
            for item in found.combinations
        ],
        'advice': found.advice,
    }


def _diagnosis(outcome: Outcome) -> Document:
    found = outcome.diagnosis
    return {
        'verdict': found.verdict,
        'p_value': _number(found.p_value),
        'effects': [
            {
                'name': item.effect.name,
                'target': item.effect.target,
                'parameters': {v.name: {'value': v.value, 'std': _number(v.std), 'unit': v.unit} for v in item.values},
            }
            for item in found.found
            if item.proved
        ],
        'rivals': [list(group) for group in found.rivals],
        'advice': found.advice,
        'traces': [
            {'name': trace.name, 'p_value': _number(trace.p_value), 'share': _number(trace.share)}
            for trace in found.traces
        ],
    }

"""`dial_gauge.json`: the result of dial gauge experiments as data, SI units; null where a quantity does not exist."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from scara_kinetostatic import __version__
from scara_kinetostatic.report.json_file import Document
from scara_kinetostatic.studies.dial_gauge.analysis import DialGaugeAnalysis, LoopRecord, sense_name
from scara_kinetostatic.studies.dial_gauge.loop_analysis import Reversal, Sense
from scara_kinetostatic.studies.dial_gauge.result import DirectionMap, Part, Run
from scara_kinetostatic.studies.dial_gauge.statistics import CombinedEstimate, Estimate

NAME = 'dial_gauge.json'
SCHEMA = 'scara_kinetostatic/dial_gauge/1'


def dial_gauge_document(analysis: DialGaugeAnalysis) -> Document:
    """The document. `gap` is the jump of the displacement at zero force, `half_gap` the g of equations (6) and (7)."""
    points = analysis.points
    document = {
        'schema': SCHEMA,
        'version': __version__,
        'parts': {part.name: _part(part) for part in points.parts} if points else {},
        'loops': [_loop(record) for record in analysis.loops],
        'warnings': list(analysis.warnings),
    }
    cleaned: Document = _plain(document)
    return cleaned


def _part(part: Part) -> dict[str, Any]:
    found = {**_quantities(part, part.units), 'runs': [_run(run, part.units) for run in part.runs]}
    if part.compliance_map is not None and part.gap_map is not None:
        found['over_direction'] = {
            'compliance': _map(part.compliance_map, part.units[0]),
            'gap': _map(part.gap_map, part.units[1]),
        }
    return found


def _quantities(each: Part | Run, units: tuple[str, str]) -> dict[str, Any]:
    return {
        'compliance': _estimate(each.compliance, units[0]),
        'gap': _estimate(each.gap, units[1]),
        'half_gap': _estimate(each.half_gap, units[1]),
    }


def _estimate(estimate: Estimate | CombinedEstimate, unit: str) -> dict[str, Any]:
    value = estimate.value if isinstance(estimate, Estimate) else estimate.mean
    return {'value': value, 'std': estimate.std, 'unit': unit}


def _run(run: Run, units: tuple[str, str]) -> dict[str, Any]:
    fit = run.fit
    return {
        'source': run.source,
        'gauge_at': run.gauge_at,
        'direction': run.direction,
        'lever': run.lever,
        **_quantities(run, units),
        'at_gauge': {'slope': _estimate(fit.compliance, 'm/N'), 'gap': _estimate(fit.gap, 'm')},
        'slope_negative': _estimate(fit.slopes[0], 'm/N'),
        'slope_positive': _estimate(fit.slopes[1], 'm/N'),
        'cycle_gaps': fit.cycle_gaps,
        'reading_std': fit.sigma,
        'resolution': fit.resolution,
        'degrees_of_freedom': fit.degrees_of_freedom,
        'rows': {'found': len(fit.used), 'used': int(fit.used.sum())},
        'checks': [{**check._asdict(), 'failed': check in run.failed_checks} for check in fit.checks],
        'outlier_lines': [int(run.readings.line[row]) for row in run.outliers],
        'note': run.note,
    }


def _map(each: DirectionMap, unit: str) -> dict[str, Any]:
    found: dict[str, Any] = {
        'mean': _estimate(each.mean, unit),
        'smallest': float(each.value.min()),
        'largest': float(each.value.max()),
        'isotropy': _consistency(each.isotropy),
        'ellipse': None,
    }
    if each.ellipse is not None:
        ellipse = each.ellipse
        found['ellipse'] = {
            'major': _estimate(ellipse.major, unit),
            'minor': _estimate(ellipse.minor, unit),
            'axis': _estimate(ellipse.axis, 'rad'),
            'chi_square': ellipse.chi_square,
            'degrees_of_freedom': ellipse.degrees_of_freedom,
            'p_value': ellipse.p_value,
        }
    return found


def _consistency(test: CombinedEstimate) -> dict[str, Any]:
    return {
        'chi_square': test.chi_square,
        'degrees_of_freedom': test.degrees_of_freedom,
        'p_value': test.p_value,
        'between_std': test.between,
    }


def _loop(record: LoopRecord) -> dict[str, Any]:
    analysis = record.analysis
    return {
        'source': record.source,
        'noise': {'displacement': analysis.noise[0], 'force': analysis.noise[1]},
        'senses': {sense_name(sense): _sense(sense) for sense in analysis.senses},
        'rejected': [each._asdict() for each in analysis.rejected],
    }


def _sense(sense: Sense) -> dict[str, Any]:
    found: dict[str, Any] = {'gap_force': sense.level, 'slip_force': sense.plateau, 'residual_std': list(sense.sigma)}
    for place, (name, test, unit) in enumerate((('gap', sense.gap, 'm'), ('compliance', sense.compliance, 'm/N'))):
        found[name] = None
        if test is not None:
            found[name] = {
                **_estimate(test, unit),
                **_consistency(test),
                'repeatability': sense.repeatability[place],
                'definitional_uncertainty': sense.definitional_uncertainty[place],
            }
    found['trends'] = [
        {**trend._asdict(), 'slope': trend.slope.value, 'std': trend.slope.std} for trend in sense.trends
    ]
    found['reversals'] = [_reversal(each) for each in sense.reversals]
    return found


def _reversal(each: Reversal) -> dict[str, Any]:
    return {
        'time': each.time,
        'displacement': each.displacement,
        'speed': each.speed,
        'force': each.force,
        'gap': _estimate(each.gap, 'm'),
        'compliance': _estimate(each.compliance, 'm/N'),
        'unloading_compliance': _estimate(each.unloading, 'm/N'),
        'samples': list(each.samples),
    }


def _plain(value: Any) -> Any:
    """Arrays as lists, numbers that are not finite as null."""
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return [_plain(item) for item in value.tolist()]
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value

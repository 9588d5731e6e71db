"""`design.json`: the optimal design as data, SI units; null where a quantity is not determined."""

from __future__ import annotations

from typing import Any

import numpy as np

from scara_kinetostatic.model.cell import Cell, Disc
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.simulation.plan_file import POSTURE_NAMES
from scara_kinetostatic.studies.design.attainable import contributions
from scara_kinetostatic.studies.design.result import Design, DesignedSet, PlacedDiscs
from scara_kinetostatic.studies.design.selection import COMPLIANCE_FACTOR, NOISE_FACTOR
from scara_kinetostatic.studies.design.self_check import MOST_LEVERAGE
from scara_kinetostatic.studies.design.sensitivity import BAND, Row
from scara_kinetostatic.studies.design.workspace import TipStd

NAME = 'design.json'
SCHEMA = 'scara_kinetostatic/design/1'


def design_document(design: Design) -> dict[str, Any]:
    """Plain JSON values."""
    q, robot, curve, additional = design.requirements, design.robot, design.curve, design.additional_disc
    place = best_place(design)
    return {
        'schema': SCHEMA,
        'requirements': {
            'accuracy': q.accuracy,
            'accuracy_source': q.accuracy_source.value,
            'of': 'loaded tip' if q.under_load else 'free tip',
            'levels': list(q.levels),
            'postures': [POSTURE_NAMES[posture] for posture in q.postures],
            'load': q.load,
            'region': [_number(value) for value in q.region],
            'touches_compared': q.number,
            'seed': q.seed,
        },
        'robot': {
            'parameters': robot.parameters.as_dict(),
            'noise': robot.noise.as_dict(),
            'noise_assumed': list(robot.assumed),
        },
        'declared_uncertainties': _declared(design),
        'recommended': {
            **_designed_set(design.recommended, design),
            'most_leverage': MOST_LEVERAGE,
            'touches_on_discs': {use.name: use.touches for use in design.discs},
        },
        'smallest': _designed_set(design.smallest, design),
        'by_number': {
            'touches': curve.number.tolist(),
            'chosen': _numbers(curve.chosen),
            'evenly_distributed': _numbers(curve.even),
            'random': {f'{100 * share:g} %': _numbers(curve.random[:, k]) for k, share in enumerate(BAND)},
            'lower_bound': _numbers(curve.bound),
        },
        'tables': {name: [_row(row) for row in rows] for name, rows in design.tables.items()},
        'placed': [_placed(placed) for placed in design.placed],
        'additional_disc': {
            'radius': additional.radius,
            'touches': list(additional.touches),
            'without': _number(additional.without),
            'best': None if place is None else {'center': list(place[:2]), 'tip': place[2]},
        },
    }


def best_place(design: Design) -> tuple[float, float, float] | None:
    """The best place of an additional disc, x and y in m, and the tip's largest standard deviation with it, m."""
    disc = design.additional_disc
    if np.isnan(disc.largest).all():
        return None
    row, column = np.unravel_index(int(np.nanargmin(disc.largest)), disc.largest.shape)
    return float(disc.x[column]), float(disc.y[row]), float(disc.largest[row, column])


def _declared(design: Design) -> dict[str, Any] | None:
    """What the cell declares as uncertain, and what it leaves however many touches are made; None without any."""
    declared = design.robot.declared
    if declared is None and design.in_base_frame is None:
        return None
    sources = () if declared is None else declared.prior.sources
    plate = design.plate
    return {
        'sources': [{'source': source.label, 'declared': source.std, 'unit': source.unit} for source in sources],
        'least_possible': design.least_possible,
        'frame': 'base' if plate is None else f'plate {plate.name}',
        'tip_in_base_frame': None if design.in_base_frame is None else _number(design.in_base_frame),
    }


def _designed_set(designed: DesignedSet, design: Design) -> dict[str, Any]:
    check, prediction = designed.check, designed.row.prediction
    return {
        **_row(designed.row),
        'value': designed.value,
        'lower_bound': designed.least,
        'smaller_sets': {str(number): _number(value) for number, value in sorted(designed.tried.items())},
        'largest_leverage': float(prediction.leverage.max()),
        'leverage': _numbers(prediction.leverage),
        'without_each_touch': _numbers(check.without_each),
        'held_out_ratio': _number(check.held_out),
        'std_growth_by_loss': _numbers(check.growth),
        'random_sets': {'number': len(check.random), 'best': _number(check.random[0]),
                        'median': _number(float(np.median(check.random)))},
        'more_compliant': {'factor': COMPLIANCE_FACTOR, 'largest': _number(check.more_compliant)},
        'more_noise': {'factor': NOISE_FACTOR, 'joint': _number(check.more_joint_noise),
                       'force': _number(check.more_force_noise)},
        'contributions': {kind: _number(value) for kind, value in contributions(prediction, design.tip).items()},
        'plan': _plan(designed.plan, design.robot.cell),
    }  # fmt: skip


def _plan(plan: Plan, cell: Cell) -> list[dict[str, Any]]:
    rows = zip(plan.disc, np.degrees(plan.angle), plan.posture, plan.force, strict=True)
    return [
        {
            'disc': cell.discs[d].name,
            'angle_deg': round(float(a), 9),
            'posture': POSTURE_NAMES[int(s)],
            'force': float(f),
        }
        for d, a, s, f in rows
    ]


def _row(row: Row) -> dict[str, Any]:
    p = row.prediction
    return {
        'label': row.label,
        'touches': p.touches,
        'rank': p.rank,
        'confounded': [list(group) for group in p.confounded],
        'condition': _number(p.condition),
        'observability': {name.upper(): _number(value) for name, value in p.indices._asdict().items()},
        'tip_free': _tip(row.free),
        'tip_loaded': _tip(row.loaded),
        'std': {name: _number(value) for name, value in zip(NAMES, p.std, strict=True)},
    }


def _tip(tip: TipStd) -> dict[str, float | None]:
    return {'largest': _number(tip.largest), 'rms': _number(tip.rms)}


def _placed(placed: PlacedDiscs) -> dict[str, Any]:
    return {
        'discs': [_disc(disc) for disc in placed.layout.discs],
        'prediction': None if placed.row is None else _row(placed.row),
        'touches_needed': placed.needed,
    }


def _disc(disc: Disc) -> dict[str, Any]:
    return {'name': disc.name, 'center': [disc.x, disc.y], 'radius': disc.radius}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _numbers(values: Any) -> list[float | None]:
    return [_number(value) for value in values]

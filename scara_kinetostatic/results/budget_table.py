"""The uncertainty budget as tables: what each source contributes to the tip, and what dominates each parameter."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from scara_kinetostatic.assessment.grade import quantity
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.assessment.tolerance import advice
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR
from scara_kinetostatic.calibration.uncertainty_budget import NOISE, Item
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.report.quantities import PAGE_SCALES, PAGE_UNITS, Scale, shown
from scara_kinetostatic.report.table import NOT_DETERMINED, Table

LARGEST = 5
"""So many sources are listed in the text; the others together."""
_FROM_MM = 999.5
"""Largest contribution from which on the text has them in mm, µm."""
_TEXT_UNITS = {**PAGE_UNITS, 'rad': Scale('mrad', 1e3)}


def tip_budget(outcome: Outcome) -> Table | None:
    """Contributions to the tip where its uncertainty is largest, the largest first; None where it is not determined."""
    items = outcome.budget
    total = math.sqrt(sum(item.tip**2 for item in items)) if items else math.nan
    if not total > 0 or not math.isfinite(outcome.tip_uncertainty.worst):
        return None
    ordered = sorted(items, key=lambda item: -item.tip)
    rows = [
        (item.title, item.evaluation, _declared(item), f'{1e3 * item.tip:.3g}', _percent((item.tip / total) ** 2))
        for item in ordered
    ]
    rows.append(('combined standard uncertainty', '', '', f'{1e3 * total:.3g}', '100 %'))
    heading = ('source', 'type', 'declared', 'contribution', 'share of the variance')
    return Table(heading, ('', '', '', 'mm', ''), tuple(rows))


def largest_of_tip(outcome: Outcome) -> Table | None:
    """The largest contributions to the tip, and the rest together; None where it is not determined."""
    items = sorted(outcome.budget, key=lambda item: -item.tip)
    total = math.sqrt(sum(item.tip**2 for item in items)) if items else math.nan
    if not total > 0 or not math.isfinite(total):
        return None
    first, others = items[:LARGEST], items[LARGEST:]
    scale = Scale('mm', 1e3) if first[0].tip * 1e6 >= _FROM_MM else Scale('µm', 1e6)
    rows = [(item.title, _declared(item, _TEXT_UNITS), *_part(item.tip, total, scale)) for item in first]
    if others:
        rest = math.sqrt(sum(item.tip**2 for item in others))
        rows.append((f'{len(others)} others', '', *_part(rest, total, scale)))
    return Table(('tip: source', 'declared', 'contribution', 'share'), ('', '', scale.unit, ''), tuple(rows))


def _part(size: float, total: float, scale: Scale) -> tuple[str, str]:
    return f'{scale.per_si * size:.3g}', _percent((size / total) ** 2)


def tip_sentences(outcome: Outcome) -> list[str]:
    """How uncertain the tip is, what dominates, and what would help most."""
    tip = outcome.tip_uncertainty
    if tip.at is None or not math.isfinite(tip.worst):
        return ['The uncertainty of the tip is not determined by these touches']
    largest = max(outcome.budget, key=lambda item: item.tip)
    share = largest.tip**2 / sum(item.tip**2 for item in outcome.budget)
    at = f'x {tip.at.tip[0]:.2f} m, y {tip.at.tip[1]:.2f} m'
    sizes = f'at most {quantity(tip.worst, "m")}, at {at}, median {quantity(tip.median, "m")}'
    help_most = advice(outcome.evidence)
    found = [
        f'Expanded uncertainty of the tip (k = {COVERAGE_FACTOR:g}) over the workspace: {sizes}',
        f'Largest contribution there: {largest.title}, {_percent(share)} of the variance',
    ]
    return [*found, f'What would help most: {help_most}'] if help_most else found


def parameter_budget(outcome: Outcome) -> Table | None:
    """Noise and the largest declared source of each parameter; None where nothing is declared."""
    items = outcome.budget
    declared = [item for item in items if item.label != NOISE]
    if not declared or np.isnan(outcome.final.std).all():
        return None
    rows = []
    for place, name in enumerate(NAMES):
        parts = np.array([item.parameters[place] for item in items])
        variance = float(np.sum(parts**2))
        if not variance > 0:
            rows.append((name, NOT_DETERMINED, '', '', '', ''))
            continue
        largest = max(declared, key=lambda item, at=place: item.parameters[at])  # type: ignore[misc]
        noise = sum(float(item.parameters[place]) ** 2 for item in items if item.label == NOISE)
        share = float(largest.parameters[place]) ** 2 / variance
        scale = PAGE_SCALES[name]
        of_noise = _short(math.sqrt(noise), scale)
        rows.append((name, _short(math.sqrt(variance), scale), of_noise, scale.unit, largest.title, _percent(share)))
    heading = ('parameter', 'std. uncertainty', 'by noise', '', 'largest declared source', 'its share of the variance')
    return Table(heading, ('',) * 6, tuple(rows))


def _short(value: float, scale: Scale) -> str:
    return f'{value * scale.per_si:.2g}'


def _declared(item: Item, units: Mapping[str, Scale] = PAGE_UNITS) -> str:
    return '' if item.declared is None else shown(item.declared, math.nan, item.unit, units).text


def _percent(share: float) -> str:
    return f'{100 * share:.0f} %' if share >= 0.005 or share == 0 else 'below 1 %'

"""The diagnosis as data: its part of `calibration.json`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from scara_kinetostatic.diagnosis.lack_of_fit import Dependence
from scara_kinetostatic.diagnosis.result import Diagnosis, Found, Ranked, Value
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.unnamed import Unnamed
from scara_kinetostatic.render.json_file import Document


def number(value: float) -> float | None:
    """A number as JSON has it: None where it is not finite."""
    return float(value) if math.isfinite(value) else None


def diagnosis_document(found: Diagnosis) -> Document:
    """Verdict, effects, rivals, and what stands behind them."""
    labels = known_effects(found)
    return {
        'verdict': found.verdict,
        'p_value': number(found.p_value),
        'effects': [_found(item) for item in found.found if item.in_every_model],
        'rivals': [[_plain_name(labels, label) for label in group] for group in found.rivals],
        'rival_effects': [[_rival(found, labels, label) for label in group] for group in found.rivals],
        'remaining_p_value': number(found.remaining_p_value),
        'advice': found.advice,
        'traces': _dependences(found.dependences),
        'remaining': _dependences(found.remaining),
        'candidates': [_candidate(item, role(found, item)) for item in found.ranking],
    }


def known_effects(found: Diagnosis) -> dict[str, Effect]:
    """All effects that a diagnosis speaks of, by label."""
    ranked = {item.effect.label: item.effect for item in found.ranking}
    return ranked | {item.effect.label: item.effect for item in found.found}


def _plain_name(labels: Mapping[str, Effect], label: str) -> str:
    return labels[label].name if label in labels else label.partition('[')[0]


def _named(effect: Effect) -> Document:
    """Name and target; a description where there is no name."""
    named: Document = {'name': effect.name, 'target': effect.target}
    return named | {'description': effect.description} if isinstance(effect, Unnamed) else named


def _values(values: Sequence[Value]) -> Document:
    return {v.name: {'value': number(v.value), 'std': number(v.std), 'unit': v.unit} for v in values}


def _found(item: Found) -> Document:
    return _named(item.effect) | {'proved': item.in_every_model, 'parameters': _values(item.values)}


def _rival(found: Diagnosis, labels: Mapping[str, Effect], label: str) -> Document:
    """One of several that the data do not tell apart; parameters None where it has no part in the extended model."""
    values = next((_values(item.values) for item in found.found if item.effect.label == label), None)
    named = _named(labels[label]) if label in labels else {'name': label.partition('[')[0], 'target': None}
    return named | {'parameters': values}


def role(found: Diagnosis, item: Ranked) -> str:
    """What became of a candidate; a rival is one that `rivals` names."""
    named = any(item.effect.label in group for group in found.rivals)
    return 'refuted' if item.role == 'rival' and not named else item.role


def _candidate(item: Ranked, role: str) -> Document:
    return _named(item.effect) | {
        'role': role,
        'p_value': number(item.p_value),
        'share': number(item.share),
        'gain': number(item.gain),
        'held_out': number(item.held_out),
        'new': number(item.independent_part),
        'hidden_bend': number(item.undetected_bias),
        'bent': item.biased_parameter or None,
    }


def _dependences(dependences: Sequence[Dependence]) -> list[Document]:
    return [{'name': t.name, 'p_value': number(t.p_value), 'share': number(t.share)} for t in dependences]

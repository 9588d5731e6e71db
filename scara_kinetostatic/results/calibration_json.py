"""The outcome as data: what `calibration.json` holds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scara_kinetostatic import __version__
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.result import Calibration, UndetectedErrors, joint_covariance
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR, LEVEL
from scara_kinetostatic.diagnosis.diagnose import suspects
from scara_kinetostatic.diagnosis.result import Diagnosis, Found, Ranked, Value
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.files.calibration_file import SCHEMA, cell_entry, model_entry
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.parameters import UNITS
from scara_kinetostatic.report.json_file import Document, plain

NAME = 'calibration.json'


def as_document(outcome: Outcome) -> Document:
    """The outcome as nested dicts and lists of plain JSON values.

    SI units. What the data do not determine, and numbers that are not finite, are None.
    """
    c, (names, values, matrix) = outcome.final, joint_covariance(outcome.final)
    undetected = {'undetected': UndetectedErrors.of(c)} if c.random is not None else {}
    fit = {key: getattr(c, key) for key in ('chi_square', 'degrees_of_freedom', 'enlargement', 'iterations')}
    document: Document = plain(
        {
            'schema': SCHEMA,
            'version': __version__,
            'created': outcome.created,
            'recordings': [
                {key: value for key, value in item._asdict().items() if key != 'turned' or value}
                for item in outcome.recordings
            ],
            'sources': outcome.sources,
            'warnings': outcome.warnings,
            'cell': cell_entry(c.cell),
            'model': model_entry(outcome.arm),
            'parameters': _parameters(outcome),
            'covariance': _covariance(c, with_effects=False),
            'covariance_extended': _covariance(c, with_effects=True),
            'covariance_with_cell': {'names': names, 'values': values, 'matrix': matrix, **undetected},
            'touches': _touches(outcome),
            'noise': {**c.noise.as_dict(), 'source': c.noise_source},
            **_errors(outcome),
            'fit': {**fit, 'termination': c.termination.name.lower()},
            'identifiability': _identifiability(c),
            'diagnosis': _diagnosis(outcome.diagnosis, c),
            'budget': _budget(outcome),
            'tip_uncertainty': _tip_uncertainty(outcome),
            'assessment': outcome.assessment,
        }
    )
    return document


def _budget(outcome: Outcome) -> list[Document]:
    """What each source contributes to every parameter and to the tip where its uncertainty is largest."""
    names = (*outcome.final.parameters.names, 'tip')
    return [
        {
            'source': item.label,
            **({} if item.declared is None else {'declared': item.declared, 'unit': item.unit}),
            'contribution': dict(zip(names, (*item.parameters, item.tip), strict=True)),
        }
        for item in outcome.budget
    ]


def _tip_uncertainty(outcome: Outcome) -> Document:
    tip, cell, at = outcome.tip_uncertainty, outcome.final.cell, outcome.tip_uncertainty.at
    elbow = 'left' if at and at.posture > 0 else 'right'
    pose = at and {'elbow': elbow, 'joints': at.joints, 'force': at.force, 'direction': at.direction}
    return {
        'median': tip.median,
        'worst': tip.worst,
        'at': at and at.tip,
        'region': cell.region.title,
        'coverage_factor': None if outcome.final.alternatives else COVERAGE_FACTOR,
        **({'coverage_probability': LEVEL} if outcome.final.alternatives else {}),
        'tolerance': cell.tolerance,
        'worst_pose': pose,
        'undetermined': tip.undetermined,
        'between_touches': {'median': tip.median_touched, 'worst': tip.worst_touched},
        **({'assumed': outcome.assumed} if outcome.assumed else {}),
    }


def _errors(outcome: Outcome) -> Document:
    """Errors of the base model and of the extended model on the same touches."""
    compared, folds = outcome.comparison, outcome.extended_held_out.folds
    base, extended = compared.base, compared.extended

    def of_both(key: str) -> Document:
        return {'calibrated': getattr(base, key), 'extended': getattr(extended, key)}

    return {
        'force_error': {'nominal': compared.nominal, **of_both('force_error')},
        'held_out_force_error': {**of_both('held_out'), 'folds': folds},
        'reduced_chi_square': of_both('reduced_chi_square'),
        'tip_error': {
            'nominal': compared.nominal_tip,
            'calibrated': base.tip.fitted,
            'extended': extended.tip.fitted,
            'held_out': {'calibrated': base.tip.held_out, 'extended': extended.tip.held_out},
            'noise': extended.tip.noise,
            'bias': {'rms': compared.tip_bias, 'largest': compared.largest_tip_bias},
        },
    }


def _parameters(outcome: Outcome) -> Document:
    c, nominal = outcome.final, outcome.final.cell.nominal.as_dict()
    stds = np.where(np.isnan(c.std), np.nan, c.std_noise)
    return {
        bias.name: {
            'nominal': nominal[bias.name],
            'value': bias.value,
            'std': bias.std,
            'std_noise': noise,
            'unit': UNITS[bias.name],
            'status': c.status[bias.name],
            'base_model': {'value': bias.base, 'std': bias.base_std, 'bias': bias.shift, 'bias_in_std': bias.in_std},
        }
        for bias, noise in zip(outcome.comparison.biases, stds, strict=True)
    }


def _covariance(c: Calibration, *, with_effects: bool) -> Document:
    """Of the base model's parameters, and of those of the effects; estimated ones only."""
    known = [c.status[name] == 'estimated' for name in c.parameters.names]
    places = np.flatnonzero([*known, *(np.isfinite(c.effect_std) & with_effects)])
    return {'names': [c.model.names[k] for k in places], 'matrix': c.covariance[np.ix_(places, places)]}


def _touches(outcome: Outcome) -> Document:
    c, t, before = outcome.final, outcome.final.touches, outcome.calibration
    columns = {key: getattr(t, key) for key in ('index', 'order', 'time')}
    columns['object'] = [c.cell.discs[disc].name for disc in t.disc]
    columns |= {'surface': t.surface} if c.cell.has_outlines else {}
    columns |= {key: getattr(t, key) for key in ('posture', 'joints', 'approach', 'press')}
    columns |= {'history': t.history} if Predictor(c.arm).effects_of('history') else {}
    columns |= {'force': c.force, 'residual': c.residual, 'residual_base_model': before.residual}
    columns |= {'nominal_residual': before.nominal_residual, 'distance': c.standardized, 'used': c.used}
    return {
        'found': outcome.found,
        'used': c.used.sum(),
        'rejected': [{'index': item.index, 'reason': item.reason} for item in outcome.rejected],
        'fitted': [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)],
    }


def _identifiability(c: Calibration) -> Document:
    """That of the base model's parameters; groups of effects' parameters alone have a key of their own."""
    found, keys = c.identifiability, ('text', 'value', 'std', 'unit')
    own = [group for group in found.confounded if set(group) & set(c.parameters.names)]
    return {
        'rank': c.base_rank,
        'condition': found.condition,
        'confounded': own,
        'confounded_effects': [group for group in found.confounded if group not in own],
        'combinations': [{key: getattr(item, key) for key in keys} for item in found.combinations],
        'advice': found.advice,
    }


def _diagnosis(d: Diagnosis, final: Calibration) -> Document:
    """Verdict, effects, rivals, and the evidence for them."""
    effects = d.effects_by_label()
    values = {item.effect.label: _values(item.values) for item in d.found}
    rivals = [
        [
            (_named(effects[label]) if label in effects else {'name': label.partition('[')[0], 'target': None})
            | {'parameters': values.get(label)}  # None where the extended model lacks it
            for label in group
        ]
        for group in d.rivals
    ]
    return {
        'verdict': d.verdict,
        'p_value': d.p_value,
        'effects': [_found(item) for item in d.found if item.is_found],
        'possible': [_found(item) for item in d.found if item.in_every_model and item.is_possible],
        'rivals': [[rival['name'] for rival in group] for group in rivals],
        'rival_effects': rivals,
        'probabilities': [item._asdict() for item in d.probabilities],
        'inclusion': d.inclusion,
        'remaining_p_value': d.remaining_p_value,
        'advice': d.advice,
        'dependences': d.dependences,
        'remaining_dependences': d.remaining,
        'suspects': [_named(item.effect) | {'parameters': _values(item.values)} for item in suspects(final)],
        'candidates': [_candidate(item, d.role_of(item)) for item in d.ranking],
    }


def _named(effect: Effect) -> Document:
    """Name and target of an effect; a description where it has no physical meaning."""
    named: Document = {'name': effect.name, 'target': effect.target}
    return named | {'description': effect.description} if effect.description else named


def _values(values: Sequence[Value]) -> Document:
    return {v.name: {'value': v.value, 'std': v.std, 'unit': v.unit} for v in values}


def _found(item: Found) -> Document:
    return _named(item.effect) | {'in_every_model': item.in_every_model, 'parameters': _values(item.values)}


def _candidate(item: Ranked, role: str) -> Document:
    values = {key: getattr(item, key) for key in ('p_value', 'share', 'gain', 'independent_part')}
    return {**_named(item.effect), 'role': role, **values}

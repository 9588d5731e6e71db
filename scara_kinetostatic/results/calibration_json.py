"""The outcome as data: what `calibration.json` holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from scara_kinetostatic import __version__
from scara_kinetostatic.assessment.outcome import Outcome, Recording
from scara_kinetostatic.calibration.result import Calibration, UndetectedErrors, joint_covariance
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR
from scara_kinetostatic.diagnosis.diagnose import suspects
from scara_kinetostatic.diagnosis.result import Diagnosis, Found, Ranked, Value
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.files.calibration_file import SCHEMA, cell_entry, model_entry
from scara_kinetostatic.model.arm import CalibratedArm, Predictor
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.parameters import UNITS
from scara_kinetostatic.report.json_file import Document, plain
from scara_kinetostatic.results.tables import base_rank

NAME = 'calibration.json'


def as_document(outcome: Outcome) -> Document:
    """The outcome as nested dicts and lists of plain JSON values.

    SI units. What the data do not determine, and numbers that are not finite, are None.
    """
    c = outcome.final
    document: Document = plain(
        {
            'schema': SCHEMA,
            'version': __version__,
            'created': outcome.created,
            'recordings': [_recording(item) for item in outcome.recordings],
            'sources': outcome.sources,
            'warnings': outcome.warnings,
            'cell': cell_entry(c.cell),
            'model': model_entry(CalibratedArm.of_outcome(outcome)),
            'parameters': _parameters(outcome),
            'covariance': _covariance(c),
            'covariance_extended': _covariance(c, c.effect_std),
            'covariance_with_cell': _covariance_with_cell(c),
            'touches': _touches(outcome),
            'noise': {**c.noise.as_dict(), 'source': c.noise_source},
            **_errors(outcome),
            'fit': {
                'chi_square': c.chi_square,
                'degrees_of_freedom': c.degrees_of_freedom,
                'enlargement': c.enlargement,
                'iterations': c.iterations,
                'termination': c.termination.name.lower(),
            },
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
    return [
        {
            'source': item.label,
            **({} if item.declared is None else {'declared': item.declared, 'unit': item.unit}),
            'contribution': {
                **dict(zip(outcome.final.parameters.names, item.parameters, strict=True)),
                'tip': item.tip,
            },
        }
        for item in outcome.budget
    ]


def _tip_uncertainty(outcome: Outcome) -> Document:
    tip = outcome.tip_uncertainty
    at = tip.at
    return {
        'median': tip.median,
        'worst': tip.worst,
        'at': None if at is None else at.tip,
        'region': outcome.final.cell.region.title,
        'coverage_factor': COVERAGE_FACTOR,
        'tolerance': outcome.final.cell.tolerance,
        'worst_pose': None
        if at is None
        else {
            'elbow': 'left' if at.posture > 0 else 'right',
            'joints': at.joints,
            'force': at.force,
            'direction': at.direction,
        },
        'undetermined': tip.undetermined,
        'between_touches': {'median': tip.median_touched, 'worst': tip.worst_touched},
    }


def _recording(item: Recording) -> Document:
    turned = {'turned': item.turned} if item.turned else {}
    return {'path': item.path, 'sha256': item.sha256, 'start': item.start, **turned}


def _errors(outcome: Outcome) -> Document:
    """Errors of the base model and of the extended model on the same touches."""
    compared = outcome.comparison
    base, extended = compared.base, compared.extended
    return {
        'force_error': {'nominal': compared.nominal, 'calibrated': base.force_error, 'extended': extended.force_error},
        'held_out_force_error': {
            'calibrated': base.held_out,
            'extended': extended.held_out,
            'folds': outcome.extended_held_out.folds,
        },
        'reduced_chi_square': {'calibrated': base.reduced_chi_square, 'extended': extended.reduced_chi_square},
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
    c = outcome.final
    nominal = c.cell.nominal.as_dict()
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


def _covariance(c: Calibration, extra_std: Floats | None = None) -> Document:
    """Of the base model's parameters, of the effects' if their standard deviations are given; estimated ones only."""
    names = [name for name in c.parameters.names if c.status[name] == 'estimated']
    places = [c.parameters.names.index(name) for name in names]
    labels = c.model.names[c.model.base_count :]
    for place, std in enumerate(() if extra_std is None else extra_std):
        if np.isfinite(std):
            names.append(labels[place])
            places.append(c.model.base_count + place)
    return {'names': names, 'matrix': c.covariance[np.ix_(places, places)]}


def _covariance_with_cell(c: Calibration) -> Document:
    """What a later prediction needs: all values of the model and the errors of the cell description, SI units."""
    names, values, matrix = joint_covariance(c)
    undetected = {'undetected': UndetectedErrors.of(c)._asdict()} if c.random is not None else {}
    return {'names': names, 'values': values, 'matrix': matrix, **undetected}


def _touches(outcome: Outcome) -> Document:
    c, t = outcome.final, outcome.final.touches
    before = outcome.calibration
    with_history = bool(Predictor(CalibratedArm.of(c)).effects_of('history'))
    return {
        'found': outcome.found,
        'used': int(c.used.sum()),
        'rejected': [{'index': item.index, 'reason': item.reason} for item in outcome.rejected],
        'fitted': [
            {
                'index': int(t.index[k]),
                'order': int(t.order[k]),
                'time': float(t.time[k]),
                'object': c.cell.discs[t.disc[k]].name,
                **({'surface': int(t.surface[k])} if c.cell.has_outlines else {}),
                'posture': int(t.posture[k]),
                'joints': t.joints[k],
                'approach': t.approach[k],
                'press': t.press[k],
                **({'history': t.history[k]} if with_history else {}),
                'force': c.force[k],
                'residual': c.residual[k],
                'residual_base_model': before.residual[k],
                'nominal_residual': before.nominal_residual[k],
                'distance': c.standardized[k],
                'used': bool(c.used[k]),
            }
            for k in range(len(t))
        ],
    }


def _identifiability(c: Calibration) -> Document:
    """That of the base model's parameters; groups of effects' parameters alone have a key of their own."""
    found = c.identifiability
    own = [group for group in found.confounded if set(group) & set(c.parameters.names)]
    return {
        'rank': base_rank(c),
        'condition': found.condition,
        'confounded': own,
        'confounded_effects': [list(group) for group in found.confounded if group not in own],
        'combinations': [
            {'text': item.text, 'value': item.value, 'std': item.std, 'unit': item.unit} for item in found.combinations
        ],
        'advice': found.advice,
        **({'notes': list(found.notes)} if found.notes else {}),
    }


def _diagnosis(d: Diagnosis, final: Calibration) -> Document:
    """Verdict, effects, rivals, and the evidence for them."""
    effects = d.effects_by_label()
    return {
        'verdict': d.verdict,
        'p_value': d.p_value,
        'effects': [_found(item) for item in d.found if item.is_found],
        'possible': [_found(item) for item in d.found if item.in_every_model and item.is_possible],
        'rivals': [[_name_and_target(effects, label)['name'] for label in group] for group in d.rivals],
        'rival_effects': [[_rival(d, effects, label) for label in group] for group in d.rivals],
        'remaining_p_value': d.remaining_p_value,
        'advice': d.advice,
        'dependences': d.dependences,
        'remaining_dependences': d.remaining,
        'suspects': [_named(item.effect) | {'parameters': _values(item.values)} for item in suspects(final)],
        'candidates': [_candidate(item, d.role_of(item)) for item in d.ranking],
    }


def _name_and_target(effects: Mapping[str, Effect], label: str) -> Document:
    """Name and target of an effect by its label; a description where it has no physical meaning."""
    if label not in effects:
        return {'name': label.partition('[')[0], 'target': None}
    return _named(effects[label])


def _named(effect: Effect) -> Document:
    named: Document = {'name': effect.name, 'target': effect.target}
    return named | {'description': effect.description} if effect.description else named


def _values(values: Sequence[Value]) -> Document:
    return {v.name: {'value': v.value, 'std': v.std, 'unit': v.unit} for v in values}


def _found(item: Found) -> Document:
    return _named(item.effect) | {'in_every_model': item.in_every_model, 'parameters': _values(item.values)}


def _rival(d: Diagnosis, effects: Mapping[str, Effect], label: str) -> Document:
    """One of several effects that the data do not distinguish; parameters None where the extended model lacks it."""
    values = next((_values(item.values) for item in d.found if item.effect.label == label), None)
    return _name_and_target(effects, label) | {'parameters': values}


def _candidate(item: Ranked, role: str) -> Document:
    return _named(item.effect) | {
        'role': role,
        'p_value': item.p_value,
        'share': item.share,
        'gain': item.gain,
        'independent_part': item.independent_part,
    }

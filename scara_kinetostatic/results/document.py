"""The files of a result: `calibration.json`, `calibration.yaml`, `residuals.csv` and, of `report`, `report.html`.

All are written, or none. An earlier result in the same folder is kept under dated names.

`calibration.json` is the outcome as data. `calibration.yaml` is the result as ROS parameters, for `--params-file`. The
names are those of the node `calibrator`: `calibrated.<name>` and `calibrated_std.<name>`, and for the effects
that were found `effects.<name>.<target>.<parameter>` and `effects_std…`. An effect without a target has `all` there, a
fitted curve its channel and variable; whatever is not a letter, a digit or `_` becomes `_`. A standard deviation that
the data do not determine is `.nan`. `calibration.<name>` says what they are made from and worth (`facts`); a list
without entries is left out, as it has no type in ROS. What the numbers mean stands above them, as comments.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timezone
from itertools import chain, count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic import __version__
from scara_kinetostatic.assessment.evidence import Earlier
from scara_kinetostatic.assessment.grade import rivals_in_words
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.joint_covariance import UndetectedErrors, joint_covariance
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR, LEVEL
from scara_kinetostatic.diagnosis.result import Diagnosis, Found, Ranked, Value
from scara_kinetostatic.diagnosis.verdict import suspects
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError, expect, one_line
from scara_kinetostatic.files.atomic import write_texts, writing
from scara_kinetostatic.files.calibration_file import SCHEMA, cell_entry, is_readable, model_entry
from scara_kinetostatic.files.tables import csv_cell, csv_lines
from scara_kinetostatic.files.yaml_file import dump_yaml, parse_yaml, read_text
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.parameters import DESCRIPTIONS, MOMENTS, NAMES, UNITS
from scara_kinetostatic.report.page import Document, json_text, plain, utc
from scara_kinetostatic.results import report as page

YAML, JSON, RESIDUALS = 'calibration.yaml', 'calibration.json', 'residuals.csv'
RESULTS = (YAML, JSON, page.NAME, RESIDUALS)
"""The files of a result."""


class WrittenFiles(NamedTuple):
    """Where the results are.

    Attributes:
        folder: that holds them.
        parameters: the ROS parameter file.
        document: the JSON.
        report: the page; it is not there where it was not wanted.
        residuals: the table of touches.
        kept: the files of an earlier result under their new names; empty if there was none.
    """

    folder: Path
    parameters: Path
    document: Path
    report: Path
    residuals: Path
    kept: tuple[Path, ...] = ()

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files of this result, the page last."""
        page = (self.report,) if self.report.is_file() else ()
        return (self.parameters, self.document, self.residuals, *page)

    @property
    def note(self) -> str:
        """What was kept, one sentence; empty if nothing."""
        names = [path.name for path in self.kept]
        return f'the earlier result in {self.folder} is kept as {", ".join(names)}' if names else ''


def write_results(outcome: Outcome, folder: str | Path, *, report: bool = True) -> WrittenFiles:
    """Write `calibration.yaml`, `calibration.json`, `report.html` and `residuals.csv` into a folder.

    All files are written to a hidden folder inside first and then renamed. If writing fails, by Ctrl-C for one, the
    folder is as before; Ctrl-C waits while they are renamed.

    Args:
        outcome: the result.
        folder: made if it is not there; files of an earlier result in it are kept under the date at which they were
            written, `calibration_2026-11-21T14-03-22Z.json`.
        report: whether to draw the page, which takes several times as long as the calibration.

    Raises:
        OutputError: the folder cannot be written.
        UnsupportedDataError: there are too many touches for a `calibration.json`.
        ParameterError: `outcome` is none, or `folder` no path.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> files = sk.write_results(sk.diagnose('touches.csv', cell), 'result')
        >>> files.document.name, files.report.name
        ('calibration.json', 'report.html')
    """
    expect(outcome, Outcome, 'outcome', 'give what diagnose returns')
    if not isinstance(folder, (str, Path)):
        raise ParameterError('folder', f'expected a path, got {type(folder).__name__}')
    folder = Path(folder)
    document = json_text(as_document(outcome))
    if not is_readable(document):
        problem = f'{len(outcome.final.touches)} touches make a {JSON} too large to be read again'
        raise UnsupportedDataError(problem, 'leave some out')
    contents = {
        YAML: parameter_text(outcome),
        JSON: document,
        **({page.NAME: page.html_text(outcome)} if report else {}),
        RESIDUALS: residual_table(outcome),
    }
    with writing(folder):
        kept = dated_names(folder)
    write_texts(folder, contents, kept)
    parameters, written, drawn, table = (folder / name for name in RESULTS)
    return WrittenFiles(folder, parameters, written, drawn, table, tuple(folder / name for name in kept.values()))


def dated_names(folder: Path) -> dict[str, str]:
    """The names under which the result in a folder is kept, by their present names; empty if there is none.

    Raises:
        OSError: the folder cannot be read.
    """
    present = [folder / name for name in RESULTS if (folder / name).is_file()]
    if not present:
        return {}
    newest = datetime.fromtimestamp(max(path.stat().st_mtime for path in present), timezone.utc)
    date = utc(newest).replace(':', '-')
    endings = chain([date], (f'{date}_{number}' for number in count(2)))
    tried = ({path.name: f'{path.stem}_{ending}{path.suffix}' for path in present} for ending in endings)
    return next(names for names in tried if not any((folder / name).exists() for name in names.values()))


def residual_table(outcome: Outcome) -> str:
    """The touches with what the models predict: one row per touch, CSV.

    Both models stand beside each other: ``calibrated`` is the base model, ``extended`` has the effects found as well;
    where nothing was found they are the same. Forces are those on the object in the base frame, as the base model
    has them (a sensor in the tool frame turns with the estimated angles). Touches that were rejected before the fit
    have index, reason and nothing else. The columns of joints and forces are named as those of a touch table.
    """
    base, t = outcome.calibration, outcome.calibration.touches
    assert np.array_equal(outcome.final.touches.index, t.index)  # both models have the same touches
    names = [csv_cell(disc.name) for disc in base.cell.discs]
    columns: dict[str, Any] = {
        'object': [names[disc] for disc in t.disc],
        'posture': ['left' if side > 0 else 'right' for side in t.posture],
        'time_s': t.time,
    }
    columns |= zip(('q1_rad', 'q2_rad'), base.cell.readings(t.joints).T, strict=True)
    columns |= zip(('fx_N', 'fy_N'), base.force.T, strict=True)
    for model, fit in (('calibrated', base), ('extended', outcome.final)):
        columns |= zip((f'fx_{model}_N', f'fy_{model}_N'), (fit.force - fit.residual).T, strict=True)
        columns |= zip((f'residual_x_{model}_N', f'residual_y_{model}_N'), fit.residual.T, strict=True)
        columns |= {f'standardized_distance_{model}': fit.standardized, f'used_{model}': fit.used.astype(int)}
    texts = [[_text(value) for value in np.asarray(values).tolist()] for values in columns.values()]
    rows = dict(zip(t.index.tolist(), zip(*texts, strict=True), strict=True))
    reasons = {item.index: csv_cell(item.reason) for item in outcome.rejected}
    index = sorted({*rows, *reasons})
    table = [
        (str(number), *rows.get(number, [''] * len(columns)), str(int(number not in reasons)), reasons.get(number, ''))
        for number in index
    ]
    return csv_lines(dict(zip(('index', *columns, 'used', 'reason'), zip(*table, strict=True), strict=True)))


def _text(value: object) -> str:
    """Numbers in the shortest form that gives them back; empty where there is none."""
    if isinstance(value, float):
        return repr(value) if np.isfinite(value) else ''
    return str(value)


def as_document(outcome: Outcome) -> Document:
    """The outcome as nested dicts and lists of plain JSON values.

    SI units. What the data do not determine, and numbers that are not finite, are None.
    """
    c, (names, values, matrix) = outcome.final, joint_covariance(outcome.final)
    undetected = {'undetected': UndetectedErrors.of(c)} if c.random is not None else {}
    if outcome.earlier is not None and outcome.earlier.undetected.columns:  # it moved the declared errors as well
        part = outcome.earlier.undetected
        moved, size = part.at(names), len(c.covariance)
        more = moved @ moved.T
        matrix[size:], matrix[:size, size:] = matrix[size:] + more[size:], matrix[:size, size:] + more[:size, size:]
        undetected = {'undetected': part._replace(rows=names, matrix=moved)}
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
            **_from(outcome.earlier),
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


def _from(earlier: Earlier | None) -> Document:
    """The calibration that was the prior."""
    if earlier is None:
        return {}
    kept = ('path', 'sha256', 'freed', 'p_value', 'grade', 'contradiction', 'recordings')
    stated = {key: getattr(earlier, key) for key in kept}
    return {'from': {**stated, 'detectable_slip': earlier.detectable, **earlier.causes}}


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


EFFECTS, EFFECTS_STD = 'effects', 'effects_std'


def effect_parameters(found: Sequence[Found]) -> dict[tuple[str, str, str], Value]:
    """All parameters of the effects found: value by name of the effect, target and name, which are unique."""
    values: dict[tuple[str, str, str], Value] = {}
    taken: set[tuple[str, str]] = set()
    for item in found:
        name, target = _word(item.effect.name), _word(item.effect.label.partition('[')[2][:-1] or 'all')
        places = ((name, f'{target}_{number}' if number > 1 else target) for number in count(1))
        taken.add(place := next(place for place in places if place not in taken))
        values |= {(*place, _word(value.name)): value for value in item.values}
    return values


def _word(text: str) -> str:
    return re.sub(r'[^A-Za-z0-9_]+', '_', text)


class StoredResult(NamedTuple):
    """What a parameter file of a result holds.

    Attributes:
        values: the parameters in the order of `Parameters.names`.
        deviations: their standard deviations; NaN where there is none.
        facts: what the result is made from and worth, by the names of `FACTS`; as far as the file says so.
    """

    values: list[float]
    deviations: list[float]
    facts: dict[str, Stated]


def load_result(path: str | Path) -> StoredResult:
    """Read a parameter file of a result.

    Raises:
        ParameterError: it cannot be read, or is no such file.
    """
    tree = parse_yaml(read_text(path, ParameterError), path, ParameterError)
    try:
        given = tree['/**']['ros__parameters']
        names = (*NAMES, *(name for name in MOMENTS if name in given['calibrated']))
        values = [given['calibrated'][name] for name in names]
        if not all(map(math.isfinite, values)):
            raise ValueError(values)
        return StoredResult(
            values=list(map(float, values)),
            deviations=[float(given['calibrated_std'][name]) for name in names],
            facts=_stored_facts(given.get(GROUP)),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        remedy = f'expected what calibrate writes as {YAML}'
        raise ParameterError(path, 'is no result of a calibration', remedy) from error


def _stored_facts(group: Mapping[str, Any] | None) -> dict[str, Stated]:
    """The facts; a list that the file leaves out has no entries. None where the file has none of them."""
    found: dict[str, Stated] = {}
    for name, fact in FACTS.items() if group is not None else ():
        value: Any = group
        for key in name.split('.'):
            value = value.get(key) if isinstance(value, Mapping) else None
        if value is not None or fact.kind is list:
            found[name] = fact.kind([] if value is None else value)
    return found


def parameter_text(outcome: Outcome) -> str:
    """The ROS parameter file."""
    c, found = outcome.final, outcome.diagnosis.found
    named: dict[str, Any] = {f'calibrated.{name}': value for name, value in c.parameters.as_dict().items()}
    named |= {f'calibrated_std.{name}': c.std_of(name) for name in c.parameters.names}
    of_effects = effect_parameters(found)
    named |= {'.'.join((EFFECTS, *path)): value.value for path, value in of_effects.items()}
    named |= {'.'.join((EFFECTS_STD, *path)): value.std for path, value in of_effects.items()}
    named |= {f'{GROUP}.{name}': value for name, value in facts(outcome).items() if value != []}
    status = {'estimated': '', 'fixed': '; held at this value', 'confounded': '; these data do not determine it'}
    comments = [
        'Result of a kinetostatic calibration, SI units. Load it into a node by',
        '  ros2 run PACKAGE NODE --ros-args --params-file calibration.yaml',
        *(f'from {source}' for source in outcome.sources),
        *(f'{name}: {UNITS[name]}, {DESCRIPTIONS[name]}{status[c.status[name]]}' for name in c.parameters.names),
        *(f'{item.effect.label}.{v.name}: {v.unit}, {v.meaning}' for item in found for v in item.values),
        *(f'{GROUP}.{name}: {fact.meaning}' for name, fact in FACTS.items()),
    ]
    tree: dict[str, Any] = {}
    for full, value in named.items():
        *path, last = full.split('.')
        branch = tree
        for part in path:
            branch = branch.setdefault(part, {})
        branch[last] = value
    above = ''.join(f'# {one_line(text)}\n' for text in comments)
    return above + dump_yaml({'/**': {'ros__parameters': tree}})


GROUP = 'calibration'
Stated = str | int | float | list[str]
"""As ROS parameters have it."""


class Described(NamedTuple):
    """What a result is made from or worth: its type, its meaning in a few words, and how an outcome has it."""

    kind: type
    meaning: str
    of: Callable[[Outcome], Any]


FACTS = {
    'assessment': Described(str, 'may the result be used: fit, caution or unfit', lambda o: o.assessment.grade.value),
    'reasons': Described(list, 'of the assessment, the gravest first', lambda o: o.assessment.reasons),
    'actions': Described(list, 'what to do, in the order of the reasons', lambda o: o.assessment.actions),
    'verdict': Described(str, 'is the model complete: none, explained, ambiguous or unexplained', lambda o: o.verdict),
    'effects': Described(
        list, 'effects found', lambda o: [item.effect.label for item in o.diagnosis.found if item.is_found]
    ),
    'possible_effects': Described(
        list,
        'effects of a model that is still incomplete',
        lambda o: [item.effect.label for item in o.diagnosis.found if item.in_every_model and item.is_possible],
    ),
    'rivals': Described(
        list,
        'groups of effects that the touches do not tell apart, each with commas',
        lambda o: [', '.join(group) for group in o.diagnosis.rivals],
    ),
    'possible_causes': Described(
        list,
        'the same in words, with their probabilities',
        lambda o: [rivals_in_words(o.diagnosis, group) for group in o.diagnosis.rivals],
    ),
    'rank': Described(int, 'how many combinations of the 12 parameters are determined', lambda o: o.final.base_rank),
    'confounded': Described(
        list,
        'groups of parameters that the touches do not separate, each with blanks',
        lambda o: [' '.join(group) for group in o.final.identifiability.confounded],
    ),
    'touches.found': Described(int, 'touches in the recordings', lambda o: o.found),
    'touches.used': Described(int, 'touches that the result is made from', lambda o: o.final.used.sum()),
    'force_error.nominal': Described(float, 'force error before, N', lambda o: o.comparison.nominal),
    'held_out_force_error.extended': Described(
        float, 'the same after, on touches not used in the fit, N', lambda o: o.comparison.extended.held_out
    ),
    'tip_uncertainty': Described(
        float, 'largest expanded uncertainty of the tip in the workspace (95 %), m', lambda o: o.tip_uncertainty.worst
    ),
    'warnings': Described(list, 'irregularities of the recordings', lambda o: o.warnings),
    'recordings': Described(list, 'the recordings and touch tables', lambda o: o.sources),
    'created': Described(str, 'when the result was calculated, UTC', lambda o: utc(o.created)),
}
"""By the part of the parameter's name after `calibration.`."""


def facts(outcome: Outcome) -> dict[str, Stated]:
    """The values of a result by the names of `FACTS`."""
    return {name: fact.kind(fact.of(outcome)) for name, fact in FACTS.items()}

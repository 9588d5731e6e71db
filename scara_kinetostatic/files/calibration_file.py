"""A calibrated arm as plain JSON values, in `calibration.json` and on a topic; and back.

Both hold the same: the cell under `cell`, the model with its covariance under `model`, `assessment.grade` and
`diagnosis.verdict`.

Of the effects only those of the catalogue of the cell and what a diagnosis adds by itself are made again: a file never
names a module to import.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from itertools import compress
from pathlib import Path
from typing import Any, cast

import numpy as np

from scara_kinetostatic.calibration.identifiability import scales_of
from scara_kinetostatic.calibration.noise import USUAL_NOISE
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.objects import OffNormalForce
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.effects.unnamed import Undetected, Unnamed
from scara_kinetostatic.errors import CalibrationFileError, CellError, InputError, ParameterError
from scara_kinetostatic.files.atomic import MIB
from scara_kinetostatic.files.cell_file import OPTIONAL, cell_description, read_cell
from scara_kinetostatic.files.yaml_file import parse_yaml, read_text
from scara_kinetostatic.model.arm import CalibratedArm, Predictor, SensorErrors, UsedRange
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.cell import Cell, Level, Noise
from scara_kinetostatic.model.extended_model import EffectLaw, ExtendedModel

SCHEMA = 'scara_kinetostatic/calibration/1'
"""Keys may be added under the same number; what is there keeps its name and meaning."""
RESULT_SCHEMA = 'scara_kinetostatic/result/1'
"""Of the document on `~/result` of the calibrator."""
_MAX_BYTES, _MOST_VALUES = 12 * MIB, 1_000_000
"""Larger documents are refused; one has up to 1.2 kB for each touch."""
_REMEDY = 'give the calibration.json that calibrate of this version writes'


def cell_entry(cell: Cell) -> dict[str, Any]:
    """The cell as its description states it; what that leaves out is left out here, too."""
    entry = cell_description(cell)
    robot, model = entry.pop('robot'), entry.pop('model')
    return robot | {'identification': {}} | model | entry


def model_entry(arm: CalibratedArm) -> dict[str, Any]:
    """The calibrated model with all that is needed to use it."""
    effects = zip(arm.model.effects, arm.model.effect_values, strict=True)
    return {
        'names': list(arm.model.names),
        'values': arm.model.as_array().tolist(),
        'covariance': arm.covariance.tolist(),
        'undetermined': arm.undetermined.T.tolist(),
        'effects': [effect_entry(effect) | {'values': list(values)} for effect, values in effects],
        'noise': arm.noise.as_dict(),
        'sensor': arm.sensor._asdict(),
        'used': arm.used._asdict() | {'postures': list(arm.used.postures)},
    }


def arm_document(arm: CalibratedArm) -> dict[str, Any]:
    """The arm alone: those keys of `calibration.json` that are read back."""
    return {
        'schema': SCHEMA,
        'created': arm.created,
        'cell': cell_entry(arm.cell),
        'model': model_entry(arm),
        'assessment': {'grade': arm.grade},
        'diagnosis': {'verdict': arm.verdict},
    }


def load_calibration(path: str | Path) -> CalibratedArm:
    """The calibrated arm of a result.

    Args:
        path: `calibration.json` as `calibrate` writes it.

    Raises:
        CalibrationFileError: the file cannot be read, has another schema, or is damaged.

    Example:
        >>> import scara_kinetostatic as sk
        >>> files = sk.write_results(sk.diagnose('touches.csv', sk.load_cell('cell.yaml')), 'stored')
        >>> arm = sk.load_calibration(files.document)
        >>> arm
        <CalibratedArm: fit, effects: object_radius[disc_2]>
        >>> sk.locate(arm, [0.8, 2.1], [-20.0, 0.0]).position.round(4)
        array([[-0.0867,  0.3136]])
    """
    if not isinstance(path, (str, Path)):
        raise CalibrationFileError('path', f'expected the path of a file, got {type(path).__name__}', _REMEDY)
    path = Path(path)
    return read_arm(read_document(path), path)


def nominal_arm(cell: Cell) -> CalibratedArm:
    """The arm as the cell describes it; nothing of it is determined by touches."""
    nothing, model, noise = UsedRange(0.0, 0.0, 0.0, ()), ExtendedModel(cell.nominal), cell.noise or USUAL_NOISE
    size = model.base_count
    return CalibratedArm(cell, model, np.zeros((size, size)), np.diag(scales_of(model)), noise, SensorErrors(), nothing)


def load_predictor(path: str | Path, *, nominal: bool = False, rigid: bool = False) -> Predictor:
    """H̄ and Ḡ of a result, or of the nominal arm that a cell description has.

    Args:
        path: as for `load_calibration`, or a cell description.
        nominal: whether to take the nominal parameters of a result.
        rigid: as in `Predictor`.

    Raises:
        InputError: the file cannot be read, or is neither.
    """
    path = Path(path)
    if path.suffix.lower() in ('.yaml', '.yml'):
        tree = parse_yaml(read_text(path, CalibrationFileError), path, CalibrationFileError)
        if isinstance(tree, dict) and 'robot' in tree:
            cell = read_cell(tree, path, may_be_empty=True)
            if cell.nominal.has_gravity and not rigid and not (cell.nominal.s1 or cell.nominal.s2):
                raise InputError(f'{path}', 'under gravity the nominal arm has no weight', 'give robot.moments')
            return Predictor(nominal_arm(cell), nominal=True, rigid=rigid)
    return Predictor(load_calibration(path), nominal, rigid)


def read_document(path: Path) -> Any:
    """The document of a JSON file.

    Raises:
        CalibrationFileError: the file cannot be read, or is no JSON.
    """
    return parse_document(read_text(path, CalibrationFileError, _MAX_BYTES, 'JSON'), path)


def is_readable(text: str) -> bool:
    """Whether a `calibration.json` is small enough to be read again."""
    return len(text) <= _MAX_BYTES and sum(map(text.count, '[{,')) <= _MOST_VALUES


def parse_document(text: str, where: str | Path) -> Any:
    """The document of a JSON text: of `calibration.json`, or of `~/result`.

    Raises:
        CalibrationFileError: it is too large, or no JSON.
    """
    try:
        if not is_readable(text):
            limits = f'expected at most {_MAX_BYTES // MIB} MiB, {_MOST_VALUES} values'
            raise CalibrationFileError(where, limits, _REMEDY)
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise CalibrationFileError(where, f'not JSON: {error}', _REMEDY) from error


def read_arm(document: Any, where: str | Path) -> CalibratedArm:
    """The arm of a parsed document.

    Args:
        document: as `json.loads` gives it.
        where: the file or topic, for messages.

    Raises:
        CalibrationFileError: it has another schema, or is damaged.
    """
    schema = document.get('schema') if isinstance(document, dict) else None
    if schema not in (SCHEMA, RESULT_SCHEMA):
        raise CalibrationFileError(where, f'expected the schema {SCHEMA}, got {schema!r:.80}', _REMEDY)
    try:
        return _arm(document, where)
    except CellError as error:
        raise CalibrationFileError(error.where, error.problem, error.remedy) from error
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, ParameterError) as error:
        reason = f'there is no {error}' if isinstance(error, KeyError) else f'{error}'
        raise CalibrationFileError(where, f'is damaged: {reason:.200}', _REMEDY) from error


def _arm(document: Mapping[str, Any], where: str | Path) -> CalibratedArm:
    """The arm of a document with the right schema.

    Raises:
        KeyError, TypeError, ValueError, AttributeError, OverflowError, ParameterError: it is damaged.
    """
    cell, entry = stored_cell(document['cell'], where), document['model']
    model, stored = _model(entry, cell, where)
    stated = {name: part['value'] for name, part in document.get('parameters', {}).items()}
    _check_agreement(stated, model, where)
    directions, noise = entry['undetermined'], entry['noise']
    grade = document['assessment']['grade']
    if grade not in ('', 'fit', 'caution', 'unfit'):  # empty where nobody has assessed it
        raise ValueError(f'assessment.grade: expected fit, caution or unfit, got {grade!r:.40}')
    odds = [each['probability'] for each in document['diagnosis'].get('probabilities', ())]
    if odds and not (min(odds) >= 0 and max(odds) <= 1 and abs(sum(odds) - 1) <= 1e-3):
        raise ValueError(f'diagnosis.probabilities: expected 0 to 1, adding up to 1, got {odds!r:.60}')
    included = document['diagnosis'].get('inclusion', {})
    if not all(0 <= each <= 1 for each in included.values()):
        raise ValueError(f'diagnosis.inclusion: expected 0 to 1, got {included!r:.80}')
    return CalibratedArm(
        cell=cell,
        model=model,
        covariance=stored_covariance(entry['covariance'], stored),
        undetermined=filled(stored_numbers(directions, (len(directions), stored.sum())).T, stored),
        noise=Noise(_level(noise['joint']), _level(noise['force']), noise.get('force_relative')),
        sensor=_sensor(entry['sensor']),
        used=_used(entry['used']),
        grade=grade,
        verdict=str(document['diagnosis']['verdict']),
        created=str(document['created']),
    )


def stored_cell(entry: Mapping[str, Any], where: str | Path) -> Cell:
    """The cell of the key `cell`.

    Args:
        entry: as `cell_entry` gives it.
        where: the file, for messages.

    Raises:
        CellError: it is not valid.
        KeyError, TypeError: something is missing.
    """
    if any(map(any, entry.get('gripper_excess', ()))):  # of older versions
        problem = 'gripper_excess: a cell description has no general gripper'
        raise CellError(f'{where}: cell', problem, 'calibrate again, with the effect anisotropic_gripper')
    stated = ('coupling', 'direction', 'plane', 'limits', 'lift', 'hold', 'moments')
    robot = {key: entry[key] for key in ('joint_names', 'nominal', *(key for key in stated if key in entry))}
    description = {'robot': robot, 'objects': entry['objects'], 'sensor': entry['sensor']}
    description['model'] = {'gripper_sign': entry['gripper_sign']}
    description |= {key: entry[key] for key in ('noise', *OPTIONAL) if entry.get(key)}
    return read_cell(description, f'{where}: cell', check_layout=False)


def _model(entry: Mapping[str, Any], cell: Cell, where: str | Path) -> tuple[ExtendedModel, Mask]:
    """The model, and which of its values are stored."""
    effects = [read_effect(part, cell, where) for part in entry['effects']]
    start = ExtendedModel.at_start(cell.nominal, effects)
    stored = stored_names(entry['names'], start.names, start)
    if stored is None:
        problem = 'the effects of this calibration have other parameters here'
        raise CalibrationFileError(where, problem, 'use the version of this package that wrote it')
    model = start.with_array(filled(stored_numbers(entry['values'], (stored.sum(),)), stored))
    if not min(model.parameters.l1, model.parameters.l2) > 0:
        raise ValueError('a link has no length')
    return model, stored


def stored_names(listed: Sequence[str], names: Sequence[str], model: ExtendedModel) -> Mask | None:
    """Which names of a model and more a file lists, (n,): older ones lack aliases; None where it lists others."""
    found = np.array([name in listed or name not in model.aliases for name in names])
    return found if list(compress(names, found)) == list(listed) else None


def filled(values: Floats, stored: Mask) -> Floats:
    """Values (p, …) in the places that are stored, 0 in others, (n, …)."""
    found = np.zeros((len(stored), *values.shape[1:]))
    found[stored] = values
    return found


def _check_agreement(stated: Mapping[str, Any], model: ExtendedModel, where: str | Path) -> None:
    """Check that values stated beside the model are its own: one of them changed by hand would have no effect.

    Raises:
        CalibrationFileError: they differ.
    """
    for name, used in model.parameters.as_dict().items():
        value = stated.get(name, used)
        if not (isinstance(value, (int, float)) and abs(value - used) <= 1e-9 * abs(used)):
            problem = f'parameters.{name} is {value!r:.40}, but the calibrated model has {used!r}'
            remedy = 'take the file as calibrate wrote it; a value that is known can be fixed there'
            raise CalibrationFileError(where, problem, remedy)


def stored_covariance(rows: Any, stored: Mask) -> Floats:
    """A covariance of a file in the places that it has, (n,), 0 in others, (n, n).

    Raises:
        ValueError, TypeError: it is none.
    """
    size = int(stored.sum())
    found = stored_numbers(rows, (size, size))
    variance = np.diag(found)
    if (variance < 0).any():
        raise ValueError('a variance is negative')
    limit, rounding = np.sqrt(np.outer(variance, variance)), 1e-6
    if (np.abs(found - found.T) > rounding * limit).any() or (np.abs(found[limit == 0]) > 0).any():
        raise ValueError('the covariance is not symmetric, or correlates what is fixed')
    smallest = np.linalg.eigvalsh(found / np.where(limit > 0, limit, 1.0))[0] if size else 0.0
    if smallest < -rounding:
        problem = f'the correlation has an eigenvalue {smallest:.2g}'
        raise ValueError(f'the covariance is not positive semidefinite: {problem}')
    return filled(filled(found, stored).T, stored).T


def _sensor(entry: Mapping[str, Any]) -> SensorErrors:
    found = SensorErrors(*(float(entry[name]) for name in SensorErrors._fields))
    if not (np.isfinite(found).all() and found.gain > -1):
        raise ValueError(f'sensor: {dict(entry)!r:.100}')
    return found


def _level(level: Any) -> Level:
    """One number or one per axis."""
    if not isinstance(level, list):
        return float(level)
    first, second = map(float, level)
    return first, second


def _used(entry: Mapping[str, Any]) -> UsedRange:
    lowest, highest, duration = (float(entry[key]) for key in UsedRange._fields[:3])
    postures = tuple(int(sign) for sign in entry['postures'])
    if not (0 <= lowest <= highest and duration >= 0 and set(postures) <= {1, -1}):
        raise ValueError(f'used: {dict(entry)!r:.100}')
    return UsedRange(lowest, highest, duration, postures)


def stored_numbers(values: Any, shape: tuple[int, ...]) -> Floats:
    """An array of finite numbers of a shape.

    Raises:
        ValueError, TypeError: it is none.
    """
    array = np.array(values, dtype=float).reshape(shape if len(values) == 0 else np.shape(values))
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f'expected finite numbers of shape {shape}')
    return array


def effect_entry(effect: EffectLaw) -> dict[str, Any]:
    """The effect as plain JSON values; what its cell determines, such as a reference, is left out."""
    effect = cast(Effect, effect)
    values = {item.name: getattr(effect, item.name) for item in fields(effect)}
    plain = {name: v for name, v in values.items() if v is None or isinstance(v, (str, int, float, tuple))}
    stored = {name: list(value) if isinstance(value, tuple) else value for name, value in plain.items()}
    return {'label': effect.label, 'name': effect.name, 'class': type(effect).__name__, 'fields': stored}


def read_effect(entry: Mapping[str, Any], cell: Cell, where: str | Path) -> Effect:
    """The effect of an entry.

    Args:
        entry: as `effect_entry` gives it.
        cell: the cell that the effect is of.
        where: the file, for messages.

    Raises:
        CalibrationFileError: no installed package has such an effect.
        ValueError, TypeError, KeyError: the entry is damaged.
    """
    label, stored = str(entry['label']), dict(entry['fields'])
    others = (Unnamed(), OffNormalForce(), Undetected(cell=cell))  # what a diagnosis finds beside the catalogue
    for known in (*catalogue(cell), *others):
        if (known.name, type(known).__name__) == (entry['name'], entry['class']):
            values = _checked(known, stored)
            effect = replace(known, **values)
            if effect.label == label and (known in others or known.label == label):
                for name, value in values.items():  # the number of an object, say
                    if known not in others and type(value) is int and value != getattr(known, name):
                        raise ValueError(f'effect {label}: {name} is {value}, not {getattr(known, name)}')
                return effect
    problem = f'the effect {label!r} of this calibration is not known here'
    raise CalibrationFileError(where, problem, 'install the package that it comes from, or calibrate again')


def _checked(effect: Effect, stored: Mapping[str, Any]) -> dict[str, Any]:
    """Stored fields for an effect of a class, lists as tuples.

    Raises:
        ValueError: a field is unknown, or of another type.
    """
    values = {name: tuple(value) if isinstance(value, list) else value for name, value in stored.items()}
    own = {item.name: getattr(effect, item.name) for item in fields(effect)}
    for name, value in values.items():
        example, numbers = own.get(name), (int, float)
        is_like = type(value) is type(example) or (type(value) in numbers and type(example) in numbers)
        if example is None or value is None:  # anything plain for nothing
            is_like = value is None or isinstance(value, (str, int, float))
        if name not in own or not is_like:
            raise ValueError(f'effect {effect.label}: {name} is {value!r:.40}')
    return values

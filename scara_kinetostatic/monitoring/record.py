"""What monitoring needs of a calibration: the arm, and its joint covariance with the errors of the cell description."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, cast

import numpy as np

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.bags.reader import embedded_cell
from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.calibration.joint_covariance import UndetectedErrors
from scara_kinetostatic.calibration.observations import DeclaredErrors
from scara_kinetostatic.errors import CalibrationFileError, CellError, InputError
from scara_kinetostatic.files.calibration_file import (
    filled,
    read_arm,
    read_document,
    stored_covariance,
    stored_names,
    stored_numbers,
)
from scara_kinetostatic.model.arm import CalibratedArm, Predictor
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import TouchMetadata, reported_force
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.parameters import NAMES, UNITS
from scara_kinetostatic.model.touch import TouchSet, stacked_histories
from scara_kinetostatic.planning.next_touches import Planner
from scara_kinetostatic.report.page import Document
from scara_kinetostatic.results.document import as_document

_REMEDY = 'calibrate again with this version'
_ONE_ROBOT = 'give files of one robot'


@dataclass(frozen=True, eq=False, repr=False)
class CalibrationRecord:
    """A calibration as a file holds it.

    Attributes:
        source: the file, for messages.
        document: `calibration.json`.
        arm: the calibrated arm.
        names: of all values of the model, then of the declared errors of the cell (`DeclaredErrors.names`).
        values: of all these, SI units, (12 + k + m,).
        covariance: of all these, (12 + k + m, 12 + k + m), without what undetected effects of objects and sensor
            contribute (`shared`).

    Raises:
        CalibrationFileError: the joint covariance is missing or damaged.
    """

    source: str
    document: Mapping[str, Any]
    arm: CalibratedArm
    names: tuple[str, ...]
    values: Floats
    covariance: Floats

    @classmethod
    def load(cls, path: str | Path) -> CalibrationRecord:
        """That of a `calibration.json`.

        Raises:
            CalibrationFileError: it cannot be read, has another schema, or is damaged.
        """
        return cls.of_document(read_document(Path(path)), path)

    @classmethod
    def of_outcome(cls, outcome: Outcome) -> CalibrationRecord:
        """That of an outcome that is in memory."""
        return cls.of_document(as_document(outcome), 'calibration')

    @classmethod
    def of_document(cls, document: Document, where: str | Path) -> CalibrationRecord:
        """That of a parsed document; `where` is its file.

        Raises:
            CalibrationFileError: it has another schema, or is damaged.
        """
        arm = read_arm(document, where)
        try:
            record = cls(str(where), document, arm, *_joint(document['covariance_with_cell'], arm))
            datetime.strptime(record.measured, '%Y-%m-%dT%H:%M:%SZ')
            if not (1 <= record.enlargement < np.inf and record.noise_freedoms > 0):
                raise ValueError('fit: expected `enlargement` from 1 on, and degrees of freedom')
            if not len(record.touches):
                raise ValueError('there is no used touch')
            moved = record.undetected.of_all(len(record.names))
            if ((moved**2).sum(axis=1) > 1.01 * np.diag(record.covariance)).any():
                raise ValueError('covariance_with_cell: undetected effects exceed it')
        except (LookupError, TypeError, ValueError, AttributeError) as error:
            reason = f'there is no {error}' if isinstance(error, KeyError) else f'{error}'
            raise CalibrationFileError(where, f'is damaged or old: {reason:.200}', _REMEDY) from error
        return replace(record, covariance=record.covariance - record.shared @ record.shared.T)

    @cached_property
    def undetected(self) -> UndetectedErrors:
        """By how much undetected effects moved its estimates."""
        part = self.document['covariance_with_cell'].get('undetected')
        if part is None:
            return UndetectedErrors()
        if not isinstance(part, dict):
            raise ValueError('covariance_with_cell: an earlier version wrote it')
        rows, columns, of_robot = (tuple(part[key]) for key in ('rows', 'columns', 'of_robot'))
        matrix = stored_numbers(part['matrix'], (len(rows), len(columns)))
        size = stored_numbers(part['size'], (len(columns),))
        if not (all(isinstance(text, str) for text in columns) and len(of_robot) == len(size) and (size > 0).all()):
            raise ValueError('covariance_with_cell: undetected effects without a name or a size')
        for place, name in enumerate(self.arm.model.names):
            if name in self.arm.model.aliases and name not in rows:  # older files have none
                rows, matrix = (*rows[:place], name, *rows[place:]), np.insert(matrix, place, 0.0, axis=0)
        return UndetectedErrors(rows, columns, of_robot, size, matrix)

    @property
    def shared(self) -> Floats:
        """Changes of all values by one standard deviation of each undetected effect of objects and sensor, (v, u), SI:
        touches of the same objects have them as well, and are predicted as if there were none.
        """
        return self.undetected.of_all(len(self.names))[:, np.equal(self.undetected.of_robot, False)]

    def in_cell(self, cell: Cell) -> CalibrationRecord:
        """The same with the numbers that another cell gives its objects; what is of an object that it lacks acts
        nowhere.
        """
        names = [disc.name for disc in cell.discs]
        number = [names.index(disc.name) if disc.name in names else -1 for disc in self.arm.cell.discs]
        effects = list[Any]()
        for effect in self.arm.model.effects:
            numbers = {'disc': getattr(effect, 'disc', None), 'discs': getattr(effect, 'discs', None)}
            moved = {
                key: number[old] if isinstance(old, int) else tuple(number[k] for k in old)
                for key, old in numbers.items()
                if old is not None
            }
            effects.append(replace(cast('Any', effect), **moved) if moved else effect)
        return replace(self, arm=replace(self.arm, model=replace(self.arm.model, effects=tuple(effects))))

    def planner(self, cell: Cell, touches: TouchSet | None) -> Planner:
        """What the touches to make next are planned by.

        Args:
            cell: of the same discs, with limits of the joints.
            touches: made there.

        Raises:
            InputError: its discs are others.
        """
        if [disc.name for disc in cell.discs] != [disc.name for disc in self.arm.cell.discs]:
            raise InputError(self.source, 'its discs are not those of the cell', 'calibrate with that cell')
        stated, found = self.document['tip_uncertainty'], self.document['diagnosis']
        suspected = [*found.get('possible', ()), *chain(*found.get('rival_effects', ()))]
        labels = frozenset(f'{one["name"]}[{one["target"]}]' if one['target'] else one['name'] for one in suspected)
        of_tip = {row['source']: row['contribution']['tip'] or 0.0 for row in self.document['budget']}
        arm, tip = replace(self.arm, cell=cell), (stated['worst'], stated['undetermined'])
        return Planner.of_statement(arm, *tip, of_tip, touches, labels)

    @property
    def created(self) -> str:
        """When it was calculated, UTC."""
        return self.arm.created

    @property
    def measured(self) -> str:
        """When its last recording began, UTC; `created` where that is not known."""
        starts = [str(item['start']) for item in self._recordings if item.get('start')]
        return max(starts, default=self.created)

    @property
    def robot(self) -> str:
        """Its name, as `robot_name`."""
        return robot_name(self.arm.cell)

    @property
    def checksums(self) -> frozenset[str]:
        """SHA-256 of its recordings, and of those of the calibrations that it brought up to date."""
        own = [str(item['sha256']) for item in self._recordings if item.get('sha256')]
        return frozenset([*own, *self.document.get('from', {}).get('recordings', ())])

    @property
    def paths(self) -> frozenset[str]:
        """Its recordings as they were given."""
        return frozenset(str(item.get('path', '')) for item in self._recordings)

    @property
    def _recordings(self) -> Sequence[Mapping[str, Any]]:
        return self.document.get('recordings') or ()

    @property
    def noise_freedoms(self) -> float:
        """Degrees of freedom of the noise: infinite where it was given and covers the residuals."""
        estimated = self.document.get('noise', {}).get('source') == 'estimated' or self.enlargement > 1
        return float(self.document['fit']['degrees_of_freedom']) if estimated else np.inf

    @property
    def enlargement(self) -> float:
        """By what its covariance was enlarged, as the stated noise does not cover the residuals; 1 if not."""
        return float(self.document.get('fit', {}).get('enlargement', 1.0))

    @property
    def fixed(self) -> frozenset[str]:
        """Names of the base parameters that were held."""
        entries = self.document.get('parameters', {})
        return frozenset(name for name in UNITS if entries.get(name, {}).get('status') == 'fixed')

    @cached_property
    def touches(self) -> TouchSet:
        """The used touches of the calibration as its sensor reported them.

        Raises:
            KeyError, TypeError, ValueError: they are damaged.
        """
        rows = [row for row in self.document['touches']['fitted'] if row['used']]
        discs, frame = {disc.name: k for k, disc in enumerate(self.arm.cell.discs)}, self.arm.cell.sensor.frame

        def column(name: str, *shape: int, kind: Any = float) -> Any:
            return np.array([row[name] for row in rows], dtype=kind).reshape(len(rows), *shape)

        joints = column('joints', 2)
        force = frame.from_base(column('force', 2), joints, self.arm.model.parameters)
        touches = TouchSet(
            joints=joints,
            force=force,
            disc=np.array([discs[row['object']] for row in rows], dtype=np.intp),
            time=column('time'),
            **{name: column(name, kind=np.intp) for name in ('posture', 'index', 'order')},
            approach=column('approach', 2),
            press=column('press', 2),
            history=stacked_histories([row.get('history', ()) for row in rows], joints),
            surface=np.array([row.get('surface', -1) for row in rows], dtype=np.intp),
        )
        gain, rotation = self.arm.sensor
        reported = reported_force(self.arm.model, force, TouchMetadata.of(touches, frame))
        return touches.replace(force=(1 + gain) * rotate(reported, rotation))

    @cached_property
    def joints(self) -> Floats:
        """Joint angles of its used touches, (n, 2), rad."""
        return np.array([row['joints'] for row in self.document['touches']['fitted'] if row['used']])

    @cached_property
    def forces(self) -> Floats:
        """The true forces of `touches` on the object, base frame, (n, 2), N."""
        return np.array([row['force'] for row in self.document['touches']['fitted'] if row['used']])

    def tip_moved(self, one: CalibratedArm, other: CalibratedArm) -> Floats:
        """Displacement of the predicted tip from one arm to another at its touches, (n,), m."""
        metadata = TouchMetadata.of(self.touches, self.arm.cell.sensor.frame)
        tips = [Predictor(arm).locate(self.touches.joints, self.forces, metadata).position for arm in (one, other)]
        return np.asarray(np.linalg.norm(tips[1] - tips[0], axis=1))

    def place(self, name: str) -> int:
        """Position of a value of the model or, if it has none of that name, of a declared error."""
        return self.names.index(name)


def _joint(entry: Mapping[str, Any], arm: CalibratedArm) -> tuple[tuple[str, ...], Floats, Floats]:
    """Names, values and covariance of the model and of the declared errors of the cell.

    Raises:
        KeyError, TypeError, ValueError: they are damaged, or not those of the model.
    """
    declared = DeclaredErrors.of(arm.cell)
    names = (*arm.model.names, *(declared.names if declared else ()))
    stored = stored_names(entry['names'], names, arm.model)
    if stored is None:
        raise ValueError('covariance_with_cell: names differ from those of the model and the cell')
    values = filled(stored_numbers(entry['values'], (stored.sum(),)), stored)
    if not np.allclose(values[: len(arm.model.names)], arm.model.as_array(), rtol=1e-9, atol=0):
        raise ValueError('covariance_with_cell: values differ from those of the model')
    return names, values, stored_covariance(entry['matrix'], stored)


def robot_name(cell: Cell) -> str:
    """Type and serial number of a robot, empty where neither is stated."""
    return ' '.join(filter(None, (cell.identification.robot, cell.identification.serial_number)))


def check_same_recorded(cell: Cell, path: str | Path, source: str) -> None:
    """Check that the cell description in a recording, if it has a valid one, is of the robot of a calibration.

    Args:
        cell: of the calibration.
        path: the recording.
        source: the file of the calibration.

    Raises:
        InputError: it is not.
    """
    with suppress(CellError):
        if (recorded := embedded_cell(path)) is not None:
            check_same_arm(cell, recorded, source, str(path))


def check_same_identification(a: Cell, b: Cell, first: str, second: str) -> None:
    """Check that two cells, as far as they say it, are of the same robot; `first` and `second` are their files.

    Raises:
        InputError: they are not.
    """
    for name in ('robot', 'serial_number', 'cell'):
        one, other = getattr(a.identification, name), getattr(b.identification, name)
        if one and other and one != other:
            raise InputError(second, f'is of {name.replace("_", " ")} {other!r}, and {first} of {one!r}', _ONE_ROBOT)


def check_same_arm(a: Cell, b: Cell, first: str, second: str) -> None:
    """Check that two cells have the same robot; `first` and `second` are their files.

    Raises:
        InputError: they have not.
    """
    check_same_identification(a, b, first, second)
    if a.nominal.gravity != b.nominal.gravity:
        values = f'gravity is {list(b.nominal.gravity)} and {list(a.nominal.gravity)} m/s²'
        raise InputError(second, f'is of another cell than {first}: {values}', 'give the cell it was made in')
    nominal = (cell.nominal.as_array()[: len(NAMES)] for cell in (a, b))
    for name, one, other, scale in zip(NAMES, *nominal, SCALES, strict=True):
        if abs(one - other) > scale:
            values = f'nominal {name} is {other:g} and {one:g} {UNITS[name]}'
            raise InputError(second, f'is of another robot than {first}: {values}', _ONE_ROBOT)
    if a.gripper_sign is not b.gripper_sign:
        raise InputError(second, f'has another gripper law (model) than {first}', _ONE_ROBOT)

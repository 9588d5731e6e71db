"""What `verify` says of touches that a calibration has not seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from monitoring.simulated import CELL, DECLARED, TRUTH, record_of, touches_of

from benchmark.common import record_of as as_record
from scara_kinetostatic.assessment.grade import Grade
from scara_kinetostatic.assessment.outcome import Recording
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import Disc, Plate
from scara_kinetostatic.monitoring.drift import DriftMonitor
from scara_kinetostatic.monitoring.linear import State
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.monitoring.report import verification_document, verification_report
from scara_kinetostatic.monitoring.verification import verify
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.report import as_page, plain
from scara_kinetostatic.touches.detection import Detection


def test_p_values_of_sound_calibrations() -> None:
    found = []
    for k in range(8):
        cell = CELL if k % 2 else DECLARED
        found.append(verify(Detection.of(touches_of(cell, 50 + k, world=k)), record_of(cell, k, world=k)))
    p = np.sort([item.p_value for item in found])
    assert np.abs(p - (np.arange(8) + 0.5) / 8).max() < 0.5
    ratio = np.array([item.tip_error / item.expected for item in found])
    assert 0.9 < np.sqrt(np.mean(ratio**2)) < 1.1
    assert all(item.assessment.grade is Grade.FIT and not item.causes.ranking for item in found)


def test_the_errors_of_known_objects_are_known_too(record: CalibrationRecord) -> None:
    known = verify(Detection.of(touches_of(DECLARED, 1)), record)
    new = Disc('disc_4', 0.25, 0.1, 0.05, 1.5e-5, 5e-6)
    cell = replace(DECLARED, discs=(*DECLARED.discs, new))
    touches = touches_of(cell, 1)
    touches = touches.select(touches.disc == 3)
    elsewhere = verify(Detection.of(touches), record, cell)
    assert known.expected < 8e-6 < 1.2e-5 < elsewhere.expected
    assert elsewhere.p_value > 1e-3


def test_undetected_effects_beside_loosely_known_plates() -> None:
    plates = tuple(Plate(name, 0.0, 0.3, center_std=1e-3, angle_std=1e-3) for name in ('one', 'two'))
    discs = tuple(disc._replace(plate=plate) for disc, plate in zip(CELL.discs, ('one', 'one', 'two'), strict=True))
    cell = replace(CELL, discs=discs, plates=plates)
    known = as_record(calibrate_touches(touches_of(CELL, 0), cell).final)
    assert known.undetected.columns
    covariance = State.of(known).covariance
    assert np.linalg.eigvalsh(covariance).min() > -1e-9 * np.linalg.eigvalsh(covariance).max()
    found = verify(Detection.of(touches_of(CELL, 1)), known)
    assert 0.5 < found.tip_error / found.expected < 1.5
    assert found.p_value > 1e-3
    assert not found.causes.ranking


def test_an_effect_has_the_name_of_a_declared_error() -> None:
    """A disc that was found elsewhere, and whose place is declared as uncertain."""
    cell = replace(CELL, discs=tuple(disc._replace(center_std=2e-5) for disc in CELL.discs))
    touches = touches_of(CELL, 0, effects=('object_position[disc_2]:x=5e-4,y=0',))
    known = as_record(calibrate_touches(touches, cell).final)
    assert sorted(known.names).count('object_position[disc_2].x') == 2
    without = known.without_undetected().covariance
    std = np.sqrt(np.diag(known.covariance))
    assert np.linalg.eigvalsh(without / np.outer(std, std)).min() > -1e-9
    found = verify(Detection.of(touches_of(CELL, 1, effects=('object_position[disc_2]:x=5e-4,y=0',))), known)
    assert 0.5 < found.tip_error / found.expected < 1.5


def test_a_change_is_refused_and_named(record: CalibrationRecord) -> None:
    touches = touches_of(DECLARED, 1, TRUTH.replace(theta2=TRUTH.theta2 + 1e-4))
    found = verify(Detection.of(touches), record)
    assert found.assessment.grade is Grade.UNFIT
    assert found.causes.ranking[0].name == 'theta2'
    assert found.test.chi_square > 2 * found.test.freedoms
    tolerant = replace(record, arm=replace(record.arm, cell=replace(DECLARED, tolerance=2e-4)))
    assert verify(Detection.of(touches), tolerant).assessment.grade is Grade.CAUTION


@pytest.mark.parametrize('off', [3e-4, 1e-2])
def test_a_bad_touch_is_named_and_the_others_agree(record: CalibrationRecord, off: float) -> None:
    touches = touches_of(DECLARED, 1)
    joints = touches.joints.copy()
    joints[7] += off
    found = verify(Detection.of(replace(touches, joints=joints)), record)
    assert [item.index for item in found.outlying] == [touches.index[7]]
    assert found.assessment.grade is Grade.CAUTION and found.causes.ranking == ()
    assert 'the others agree' in found.assessment.reasons[0]
    assert found.p_value < 1e-6 and found.others.p_value > 0.01 and found.others_tip_error < 2 * found.expected
    document = plain(verification_document(found))
    place = document['touches']['index'].index(found.outlying[0].index)
    assert document['touches']['tip_error'][place] == document['touches']['outlying'][0]['tip_error']
    assert document['without_outlying']['p_value'] == found.others.p_value


def test_a_change_with_a_bad_touch(record: CalibrationRecord) -> None:
    touches = touches_of(DECLARED, 1, TRUTH.replace(g1=TRUTH.g1 + 5e-5))
    joints = touches.joints.copy()
    joints[7] += 1e-2
    found = verify(Detection.of(replace(touches, joints=joints)), record)
    assert found.few_outlie and found.others.p_value < 1e-3
    assert 'the backlash of joint 1 changed' in found.assessment.reasons[0]


def test_what_touches_cannot_show_is_said(record: CalibrationRecord) -> None:
    tight = replace(DECLARED, tolerance=1e-5)
    found = verify(Detection.of(touches_of(DECLARED, 1)), record, tight)
    assert found.assessment.grade is Grade.CAUTION
    assert 'cannot show a tolerance of 10.0 µm' in found.assessment.reasons[0]
    wide = verify(Detection.of(touches_of(DECLARED, 1)), record, replace(tight, tolerance=2e-5))
    assert wide.assessment.grade is Grade.FIT


def test_touches_on_one_object_say_little(record: CalibrationRecord) -> None:
    touches = touches_of(DECLARED, 1)
    one_side = touches.select(np.flatnonzero(touches.disc == 2)[:6])
    found = verify(Detection.of(one_side), record, replace(DECLARED, tolerance=2e-5))
    assert found.untouched == ('disc_1', 'disc_2') and found.assessment.grade is Grade.CAUTION
    assert 'there is no touch of disc_1, disc_2' in ' '.join(found.assessment.reasons)
    assert 'expected from noise and uncertainty' in as_page(verification_report(found))


def test_touches_that_were_seen_or_are_few(record: CalibrationRecord) -> None:
    document = {**record.document, 'recordings': [{'path': 'a', 'sha256': 'ab', 'start': None}]}
    seen = replace(record, document=document)
    recordings = [Recording(str(Path('b')), 'ab', None), Recording('c', 'cd', None)]
    found = verify(Detection.of(touches_of(DECLARED, 1)), seen, recordings=recordings)
    assert found.seen == ('b',)
    assert found.assessment.grade is Grade.CAUTION and 'part of the calibration' in found.assessment.reasons[0]
    again = verify(Detection.of(touches_of(DECLARED, 0).select(np.arange(20))), record)
    assert again.repeated == 20 and again.assessment.grade is Grade.CAUTION
    assert 'part of the calibration: 20 of 20 touches' in again.assessment.reasons[0]
    assert found.repeated == 0 and not verification_document(again)['independent']
    few = verify(Detection.of(touches_of(DECLARED, 1).select([0, 1, 2])), record)
    assert few.assessment.grade is Grade.CAUTION
    with pytest.raises(UnsupportedDataError):
        verify(Detection.of(touches_of(DECLARED, 1).select([])), record)


def test_what_no_single_part_explains_has_no_name(record: CalibrationRecord) -> None:
    """Two parts changed at once."""
    changed = TRUTH.replace(l1=TRUTH.l1 + 1e-3, theta2=TRUTH.theta2 + 2e-3, p1=2 * TRUTH.p1)
    found = verify(Detection.of(touches_of(DECLARED, 1, changed)), record)
    assert found.assessment.grade is Grade.UNFIT
    assert found.causes.remaining_p_value < 1e-6
    assert 'no single part explains it' in found.assessment.reasons[0]
    assert verification_document(found)['remaining_p_value'] == found.causes.remaining_p_value
    one = verify(Detection.of(touches_of(DECLARED, 1, TRUTH.replace(l1=TRUTH.l1 + 1e-3))), record)
    assert one.causes.remaining_p_value > 1e-3 and 'most likely link 1 changed its length' in one.assessment.reasons[0]


@pytest.mark.parametrize('change', [{'x0': 3e-3}, {'theta2': 1e-2}])
def test_a_large_change_of_one_part_is_named(record: CalibrationRecord, change: dict[str, float]) -> None:
    """What it leaves is the error of linearisation."""
    changed = touches_of(DECLARED, 1, TRUTH.replace(**{name: getattr(TRUTH, name) + d for name, d in change.items()}))
    found = verify(Detection.of(changed), record)
    assert 'most likely' in found.assessment.reasons[0]
    assert found.causes.ranking[0].name in (*change, 'base', 'tool')
    alarm = DriftMonitor(record).add(changed)
    assert alarm is not None and alarm.is_explained

"""What `verify` says of touches that a calibration has not seen."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from monitoring.simulated import CELL, DECLARED, TRUTH, moved, record_of, touches_of

from benchmark.common import record_of as as_record
from scara_kinetostatic.assessment.grade import Grade
from scara_kinetostatic.assessment.outcome import Recording
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import Disc, Plate
from scara_kinetostatic.model.quantities import shown
from scara_kinetostatic.monitoring.change import CalibratedState
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.monitoring.report import verification_document, verification_report
from scara_kinetostatic.monitoring.verification import verify
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.report.page import as_page, as_text, plain
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
    covariance = CalibratedState.of(known).known.covariance
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
    without = known.covariance
    std = np.sqrt(np.diag(known.covariance + known.shared @ known.shared.T))
    assert np.linalg.eigvalsh(without / np.outer(std, std)).min() > -1e-9
    found = verify(Detection.of(touches_of(CELL, 1, effects=('object_position[disc_2]:x=5e-4,y=0',))), known)
    assert 0.5 < found.tip_error / found.expected < 1.5


def verified(record: CalibrationRecord, truth: Any = TRUTH, off: float = 0.0, rows: Any = None, **cell: Any) -> Any:
    """By touches that the calibration has not seen, or some of them; the joints of the eighth are off by so much."""
    touches = touches_of(DECLARED, 1, truth)
    joints = touches.joints.copy()
    joints[7] += off
    touches = touches.replace(joints=joints).select(np.arange(len(touches)) if rows is None else rows)
    return verify(Detection.of(touches), record, replace(DECLARED, **cell))


SEVERAL = moved(l1=1e-3, theta2=2e-3, p1=TRUTH.p1)


@pytest.mark.parametrize(
    ('which', 'grade', 'said'),
    [
        ({'truth': moved(theta2=1e-4)}, Grade.UNFIT, 'most likely the zero of joint 2 changed'),
        ({'truth': moved(theta2=1e-4), 'tolerance': 2e-4}, Grade.CAUTION, 'most likely the zero of joint 2 changed'),
        ({'truth': moved(l1=1e-3)}, Grade.UNFIT, 'most likely link 1 changed its length'),
        ({'truth': moved(x0=3e-3)}, Grade.UNFIT, 'most likely the base'),  # the rest is the error of linearisation
        ({'truth': moved(theta2=1e-2)}, Grade.UNFIT, 'most likely the '),
        ({'truth': SEVERAL}, Grade.UNFIT, 'no single part explains it'),
        ({'truth': moved(g1=5e-5), 'off': 1e-2}, Grade.UNFIT, 'the backlash of joint 1 changed'),
        ({'tolerance': 1e-5}, Grade.CAUTION, 'cannot show a tolerance of 10.0 µm'),
        ({'tolerance': 2e-5}, Grade.FIT, 'agree with the calibration'),
        ({'rows': [0, 1, 2]}, Grade.CAUTION, '3 touches say little'),
    ],
)
def test_what_is_said(record: CalibrationRecord, which: dict[str, Any], grade: Grade, said: str) -> None:
    found = verified(record, **which)
    assert found.assessment.grade is grade
    assert said in found.assessment.reasons[0]
    assert found.few_outlie == ('off' in which)
    assert verification_document(found)['remaining_p_value'] == (
        found.causes.remaining_p_value if found.causes.ranking else None
    )
    assert (found.causes.remaining_p_value < 1e-6) == (which.get('truth') is SEVERAL)


def test_how_far_a_disc_has_moved(record: CalibrationRecord) -> None:
    """In text, page and JSON, with its uncertainty."""
    touches = touches_of(DECLARED, 1, effects=('object_position[disc_2]:x=2.4e-4,y=-1.8e-4',))
    found = verify(Detection.of(touches), record)
    part = plain(verification_document(found))['part']
    assert part['name'] == 'object_position[disc_2]' and part['distance']['unit'] == 'm'
    far, std = part['distance']['value'], part['distance']['std']
    assert far == pytest.approx(3e-4, abs=4 * std) and 2e-6 < std < 3e-5
    said = f'most likely disc_2 moved ({shown(far, std, "m").text}'
    report = verification_report(found)
    assert said in ' '.join(as_text(report).split()) and said in ' '.join(as_page(report).split())
    assert f'{said}: x ' in found.assessment.reasons[0]


@pytest.mark.parametrize('off', [3e-4, 1e-2])
def test_a_bad_touch_is_named_and_the_others_agree(record: CalibrationRecord, off: float) -> None:
    found = verified(record, off=off)
    (item,) = found.outlying
    assert found.assessment.grade is Grade.CAUTION and found.causes.ranking == ()
    assert 'the others agree' in found.assessment.reasons[0]
    assert found.p_value < 1e-6 and found.others.p_value > 0.01 and found.others_tip_error < 2 * found.expected
    document = plain(verification_document(found))
    place = document['touches']['index'].index(item.index)
    assert place == 7 and document['touches']['tip_error'][place] == item.tip_error
    assert document['without_outlying']['p_value'] == found.others.p_value


def test_touches_on_one_object_say_little(record: CalibrationRecord) -> None:
    rows = np.flatnonzero(touches_of(DECLARED, 1).disc == 2)[:6]
    found = verified(record, rows=rows, tolerance=2e-5)
    assert found.untouched == ('disc_1', 'disc_2') and found.assessment.grade is Grade.CAUTION
    assert 'there is no touch of disc_1, disc_2' in ' '.join(found.assessment.reasons)
    assert 'expected from noise and uncertainty' in as_page(verification_report(found))
    with pytest.raises(UnsupportedDataError):
        verified(record, rows=[])


def test_touches_that_were_seen(record: CalibrationRecord) -> None:
    document = {**record.document, 'recordings': [{'path': 'a', 'sha256': 'ab', 'start': None}]}
    recordings = [Recording('b', 'ab', None), Recording('c', 'cd', None)]
    touches = Detection.of(touches_of(DECLARED, 1))
    found = verify(touches, replace(record, document=document), recordings=recordings)
    assert (found.seen, found.repeated) == (('b',), 0)
    assert found.assessment.grade is Grade.CAUTION and 'part of the calibration' in found.assessment.reasons[0]
    again = verify(Detection.of(touches_of(DECLARED, 0).select(np.arange(20))), record)
    assert again.repeated == 20 and again.assessment.grade is Grade.CAUTION
    assert 'part of the calibration: 20 of 20 touches' in again.assessment.reasons[0]
    assert not verification_document(again)['independent']


def test_an_effect_of_an_object_stays_with_it_where_the_cell_lists_them_in_another_order() -> None:
    displaced = ('object_position[disc_1]:x=4e-4,y=-3e-4',)
    known = as_record(calibrate(touches_of(CELL, 0, effects=displaced), CELL, (find(CELL, 'object_position[disc_1]'),)))
    given = touches_of(CELL, 1, effects=displaced)
    other = replace(CELL, discs=CELL.discs[::-1])
    renumbered = given.replace(disc=len(CELL.discs) - 1 - given.disc)
    found, same = verify(Detection.of(renumbered), known, other), verify(Detection.of(given), known)
    assert found.tip_error == pytest.approx(same.tip_error, rel=1e-6)
    assert found.p_value == pytest.approx(same.p_value, rel=1e-3)

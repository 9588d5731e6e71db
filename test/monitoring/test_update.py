"""A calibration brought up to date by a few touches (`monitoring.update`)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from monitoring.simulated import CELL, DECLARED, TRUTH, moved, touches_of

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.observations import EARLIER, LARGE_EFFECT
from scara_kinetostatic.errors import InputError, ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.monitoring.change import CalibratedState, measure
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.monitoring.update import freed_names, update
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.results.document import as_document
from scara_kinetostatic.results.report import html_text, text_report
from scara_kinetostatic.touches.detection import Detection


@pytest.fixture(scope='module')
def first() -> Outcome:
    return calibrate_touches(touches_of(DECLARED, 3), DECLARED)


@pytest.fixture(scope='module')
def earlier(first: Outcome) -> CalibrationRecord:
    return CalibrationRecord.of_outcome(first)


def spread(touches: TouchSet, count: int) -> TouchSet:
    """Touches of all objects, elbows and forces."""
    return touches.select(np.linspace(0, len(touches) - 1, count).astype(int))


def updated(earlier: CalibrationRecord, truth: object, count: int, *freed: str, seed: int = 40) -> Outcome:
    touches = spread(touches_of(DECLARED, seed, truth), count)
    return update(Detection.of(touches), earlier, DECLARED, freed_names(freed, earlier))


def test_the_fit_is_the_earlier_result_conditioned_on_the_touches(earlier: CalibrationRecord) -> None:
    touches = spread(touches_of(DECLARED, 41), 6)
    c = update(Detection.of(touches), earlier, DECLARED).final
    state = CalibratedState.of(earlier)
    seen, flat = measure(touches, earlier, state), len(state.names)
    rows, residual = seen.jacobian.reshape(-1, flat), seen.residual.ravel()
    gain = state.known.covariance @ rows.T
    gain = gain @ np.linalg.inv(np.eye(len(rows)) + rows @ gain)
    size, std = len(c.model.names), np.sqrt(np.diag(earlier.covariance))[:12]
    expected = earlier.arm.model.as_array() + state.scale[:size] * (gain @ residual)[:size]
    covariance = (state.known.covariance - gain @ rows @ state.known.covariance) * np.outer(state.scale, state.scale)
    assert np.abs((c.model.as_array() - expected)[:12] / std).max() < 0.02
    mine = np.diag(c.covariance)[:12] - np.diag(earlier.shared @ earlier.shared.T)[:12]
    assert np.allclose(mine[:6], np.diag(covariance)[:6], rtol=0.02)


def test_a_new_tool(first: Outcome, earlier: CalibrationRecord) -> None:
    truth = moved(l2=1.2e-3, theta2=-4e-3, p_ee=2e-6)
    found = updated(earlier, truth, 8, 'tool')
    assert found.earlier is not None and found.earlier.freed == ('theta2', 'l2', 'p_ee', 'g_ee')
    assert found.earlier.contradiction == '' and found.assessment.grade.value != 'unfit'
    for name in NAMES:
        assert abs(found[name].value - getattr(truth, name)) < 4 * found[name].std, name
    assert found.tip_uncertainty.worst < 2 * first.tip_uncertainty.worst
    joints, force = found.final.touches.joints, found.final.force
    true = direct_kinetostatics(truth, joints, force, DECLARED.gripper_sign)[0]
    stated = Predictor(found.arm).locate(joints, force)
    assert (np.linalg.norm(stated.position - true, axis=1) < 4 * np.hypot(*stated.std.T)).all()
    labels = {item.label for item in found.budget}
    assert {'noise', EARLIER} <= labels <= {'noise', EARLIER, LARGE_EFFECT, *(item.label for item in first.budget)}
    total = np.sum([part.covariance for part in found.final.contributions], axis=0)
    assert np.allclose(total, found.final.covariance)
    assert found.arm.used.postures == first.arm.used.postures


def test_the_next_one_begins_where_this_ended(earlier: CalibrationRecord) -> None:
    truth = moved(theta1=3e-3)
    homed = updated(earlier, truth, 4, 'theta1')
    assert abs(homed['theta1'].value - truth.theta1) < 4 * homed['theta1'].std < 2e-4
    again = updated(CalibrationRecord.of_outcome(homed), truth, 20, seed=42)
    assert again.earlier is not None and again.earlier.p_value > 1e-3
    assert again['theta1'].std < homed['theta1'].std and again['l1'].std <= homed['l1'].std


@pytest.mark.parametrize(('name', 'words'), [
    ('theta1', 'the zero of joint 1 changed'), ('theta2', 'the zero of joint 2 changed'),
])  # fmt: skip
def test_a_slip_is_named_and_not_averaged_away(earlier: CalibrationRecord, name: str, words: str) -> None:
    found = updated(earlier, moved(**{name: 4e-4}), 8)
    assert found.assessment.grade.value == 'unfit'
    assert words in found.assessment.reasons[0] and found.assessment.reasons[0].startswith('the touches contradict')
    document = as_document(found)['from']
    assert document['part']['name'] == name and document['p_value'] < 1e-6
    freed = updated(earlier, moved(**{name: 4e-4}), 8, name)
    assert freed.assessment.grade.value != 'unfit' and freed.earlier is not None and freed.earlier.p_value > 1e-3


def test_touches_too_few_to_contradict_say_so(earlier: CalibrationRecord) -> None:
    few, many = (updated(earlier, TRUTH, count, 'tool') for count in (3, 16))
    (said,) = [text for text in few.assessment.reasons if 'would not show a slip' in text]
    assert 'joint 1' in said and 'joint 2' not in said  # the zero of joint 2 is freed with the tool
    assert not [text for text in many.assessment.reasons if 'would not show a slip' in text]
    assert few.earlier is not None and many.earlier is not None
    assert few.earlier.detectable['theta1'] > 2e-4 > many.earlier.detectable['theta1']


def test_what_is_said(earlier: CalibrationRecord) -> None:
    found = updated(earlier, moved(l2=1e-3), 8, 'tool')
    document, text, page = as_document(found), text_report(found), html_text(found)
    assert document['from']['freed'] == ['theta2', 'l2', 'p_ee', 'g_ee'] and document['from']['contradiction'] == ''
    assert 'calibration, freed: theta2, l2, p_ee, g_ee; the touches agree with it' in text
    assert 'that of the earlier calibration' in text and 'Earlier calibration' in page
    assert 'from' not in as_document(calibrate_touches(touches_of(CELL, 3, count=6), CELL))


def test_bad_input(first: Outcome, earlier: CalibrationRecord) -> None:
    with pytest.raises(ParameterError, match="did you mean 'tool'"):
        freed_names(['tol'], earlier)
    with pytest.raises(InputError, match='part of the earlier calibration'):
        update(Detection.of(first.final.touches.select(slice(0, 6))), earlier, DECLARED)
    with pytest.raises(InputError, match='gripper law'):
        update(Detection.of(touches_of(DECLARED, 43)), earlier, replace(DECLARED, gripper_sign=_other(DECLARED)))


def _other(cell):  # type: ignore[no-untyped-def]
    return next(sign for sign in type(cell.gripper_sign) if sign is not cell.gripper_sign)


def test_a_chain_counts_nothing_twice(first: Outcome, earlier: CalibrationRecord) -> None:
    touches = touches_of(DECLARED, 44)
    one, other = spread(touches, 10), touches.select(slice(1, None, 8))
    between = CalibrationRecord.of_outcome(update(Detection.of(one), earlier, DECLARED))
    chained = update(Detection.of(other), between, DECLARED)
    at_once = update(
        Detection.of(TouchSet.concatenate([one, other.replace(index=other.index + 99)])), earlier, DECLARED
    )
    assert between.undetected.columns and not any(between.undetected.of_robot)
    assert np.allclose(between.shared[:12], earlier.shared[:12])
    for name in NAMES:
        assert abs(chained[name].value - at_once[name].value) < 0.05 * chained[name].std, name
        assert chained[name].std == pytest.approx(at_once[name].std, rel=0.02)
    parts = [{item.label: item.tip for item in outcome.budget} for outcome in (chained, at_once)]
    assert parts[0].keys() == parts[1].keys()
    document = {**between.document, 'from': {'recordings': ['a'], **between.document['from']}}
    assert CalibrationRecord.of_document(document, 'x').checksums == {*between.document['from']['recordings']}
    with pytest.raises(InputError, match='part of the earlier calibration'):
        update(Detection.of(one), between, DECLARED)


def test_a_wrong_touch_is_named_and_nothing_else_is_blamed(earlier: CalibrationRecord) -> None:
    touches = spread(touches_of(DECLARED, 45), 12)
    joints = touches.joints.copy()
    joints[5] += (0.0, 2e-3)
    for freed in ((), ('theta2', 'l2', 'p_ee', 'g_ee')):
        found = update(Detection.of(touches.replace(joints=joints)), earlier, DECLARED, freed)
        assert found.assessment.grade.value == 'caution'
        assert '1 of 12 touches disagree with the others' in found.assessment.reasons[0]
        assert [item.index for item in found.rejected] == [int(touches.index[5])]
        assert found.earlier is not None and found.earlier.p_value > 1e-3


def test_objects_that_were_renamed_or_taken_away(earlier: CalibrationRecord) -> None:
    one, two, three = DECLARED.discs
    renamed = replace(DECLARED, discs=(one, two._replace(name='other'), three))
    found = update(Detection.of(spread(touches_of(DECLARED, 46), 9)), earlier, renamed)
    assert found.assessment.grade.value != 'unfit'
    fewer = replace(DECLARED, discs=(one, two))
    touches = touches_of(DECLARED, 46)
    touches = spread(touches.select(touches.disc < 2), 8)
    again = update(Detection.of(touches), CalibrationRecord.of_outcome(found), fewer)
    assert again.assessment.grade.value != 'unfit'


def test_two_touches_say_little_and_one_is_refused(earlier: CalibrationRecord) -> None:
    touches = spread(touches_of(DECLARED, 47), 2)
    found = update(Detection.of(touches), earlier, DECLARED)
    assert found.assessment.grade.value == 'caution' and '2 touches say little' in found.assessment.reasons
    with pytest.raises(UnsupportedDataError, match='too few to bring a calibration up to date'):
        update(Detection.of(touches.select(slice(0, 1))), earlier, DECLARED)


def test_under_gravity_nothing_is_freed(earlier: CalibrationRecord) -> None:
    upright = replace(DECLARED, nominal=DECLARED.nominal.replace(gravity=(0.0, -9.81)))
    record = replace(earlier, arm=replace(earlier.arm, cell=upright))
    with pytest.raises(UnsupportedDataError, match='under gravity'):
        freed_names(['theta1'], record)
    assert freed_names([], record) == ()

"""Touches as linear measurements: derivatives, objects known or new; what may have changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from monitoring.simulated import CELL, DECLARED, record_of, std_of, touches_of

from benchmark.common import record_of as as_record
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.model.cell import Plate
from scara_kinetostatic.monitoring.change import CalibratedState, change_title, hypotheses_of, measure
from scara_kinetostatic.monitoring.comparison import compare
from scara_kinetostatic.monitoring.record import CalibrationRecord


def test_the_residual_is_that_of_a_change(record: CalibrationRecord) -> None:
    state, touches = CalibratedState.of(record), touches_of(DECLARED, 1)
    measured = measure(touches, record, state)
    for name, size in (('theta2', 1e-5), ('p1', 1e-6), ('object_position[disc_1].x', 1e-5), ('force_gain', 1e-3)):
        place = state.place(name)
        if place < 12:
            values = record.arm.model.as_array() + size * (np.arange(12) == place)
            arm = replace(record.arm, model=record.arm.model.with_array(values))
            moved = measure(touches, replace(record, arm=arm), state)
        else:
            errors = state.errors + size * (np.arange(len(state.errors)) == place - 12)
            moved = measure(touches, record, state._replace(errors=errors))
        expected = measured.residual - measured.jacobian[:, :, place] * size / state.scale[place]
        largest = np.abs(moved.residual - measured.residual).max()
        np.testing.assert_allclose(moved.residual, expected, rtol=0, atol=0.05 * largest)


def test_touches_are_those_that_the_sensor_reported(record: CalibrationRecord) -> None:
    assert abs(record.arm.sensor.rotation) > 1e-4
    np.testing.assert_allclose(record.touches.force, touches_of(DECLARED, 0).force, rtol=1e-9)


def test_an_object_described_otherwise_is_a_new_one(record: CalibrationRecord) -> None:
    name = 'object_position[disc_2].x'
    same = CalibratedState.of(record)
    moved = DECLARED.discs[1]._replace(x=0.21)
    other = CalibratedState.of(record, replace(DECLARED, discs=(DECLARED.discs[0], moved, DECLARED.discs[2])))
    place = same.place(name)
    known, new = (np.sqrt(s.known.covariance[place, place]) * s.scale[place] for s in (same, other))
    np.testing.assert_allclose(new, 1.5e-5)
    np.testing.assert_allclose(known, std_of(record, name))
    assert same.known.covariance[same.place(name), 0] != 0 == other.known.covariance[other.place(name), 0]
    exact = CalibratedState.of(record_of(CELL, 0, world=None))
    assert not exact.known.covariance[12:].any()


PLATED = replace(
    DECLARED,
    discs=(DECLARED.discs[0]._replace(plate='a'), *DECLARED.discs[1:]),
    plates=(Plate('a', -0.25, 0.3, 1e-3, 2e-3),),
)


def with_effects(seed: int, labels: tuple[str, ...], given: tuple[str, ...]) -> CalibrationRecord:
    touches = touches_of(DECLARED, seed, effects=given)
    return as_record(calibrate(touches, DECLARED, [find(DECLARED, label) for label in labels]))


def test_names_and_units() -> None:
    record = as_record(calibrate(touches_of(PLATED, 0), PLATED))
    state = CalibratedState.of(record)
    everything = {h.name: h for h in hypotheses_of(state)}
    units = {'base': 'm m rad', 'p1': 'rad/Nm', 'object_position[disc_3]': 'm m', 'plate_position[a]': 'm m'}
    units |= {'plate_angle[a]': 'rad', 'force_gain': '1'}
    assert {name: ' '.join(everything[name].units) for name in units} == units
    assert everything['tool'].values == ('theta2', 'l2') and everything['object_position[disc_3]'].values == ('x', 'y')
    tool = everything['tool']._replace(change=(1e-4, 2e-5), std=(1e-5, 1e-6))
    assert tool.text == 'theta2 0.100 ± 0.010 mrad, l2 0.0200 ± 0.0010 mm'
    touched = {h.name for h in hypotheses_of(state, [1])}
    gone = {f'object_{what}[disc_{k}]' for what in ('position', 'radius') for k in (1, 3)}
    assert everything.keys() - touched == gone | {'plate_position[a]', 'plate_angle[a]'}
    assert change_title('object_position[disc_2]') == 'disc_2 moved'
    assert change_title('encoder_gain[joint1]') == 'the encoder gain of joint1 changed'


def test_values_of_effects() -> None:
    given = ('object_radius[disc_2]:radius=6e-5', 'encoder_gain[joint1]:gain=1e-3')
    labels = ('object_radius[disc_2]', 'encoder_gain[joint1]')
    one, other = with_effects(0, labels, given), with_effects(1, labels, given)
    state = CalibratedState.of(one)
    found = {h.name: h for h in hypotheses_of(state)}
    assert found['encoder_gain[joint1]'].units == ('1',)
    assert [state.names[k] for k in found['object_radius[disc_2]'].places] == ['object_radius[disc_2]']
    change = compare(one, other)
    assert change.p_value > 1e-3 and change.degrees_of_freedom == 14

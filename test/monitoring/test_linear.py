"""Touches as linear measurements: derivatives, the algebra of evidence, objects that are known or new."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from monitoring.simulated import CELL, DECLARED, record_of, std_of, touches_of

from scara_kinetostatic.monitoring.linear import Evidence, Information, State, measure
from scara_kinetostatic.monitoring.record import CalibrationRecord


def test_the_residual_is_that_of_a_change(record: CalibrationRecord) -> None:
    state, touches = State.of(record), touches_of(DECLARED, 1)
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


def test_evidence_is_that_of_the_joint_distribution() -> None:
    random = np.random.default_rng(0)
    rows, residual = random.normal(size=(40, 5)), random.normal(size=40)
    root = random.normal(size=(5, 3))
    covariance, mean = root @ root.T, root @ random.normal(size=3)  # singular
    found = Evidence.of(Information(rows.T @ rows, rows.T @ residual), covariance, mean)
    spread = np.eye(40) + rows @ covariance @ rows.T
    np.testing.assert_allclose(found.matrix, rows.T @ np.linalg.solve(spread, rows), atol=1e-9)
    np.testing.assert_allclose(found.score, rows.T @ np.linalg.solve(spread, residual - rows @ mean), atol=1e-9)
    statistic, change, std = found.ratio([1, 3])
    block = found.matrix[np.ix_([1, 3], [1, 3])]
    np.testing.assert_allclose(change, np.linalg.solve(block, found.score[[1, 3]]))
    np.testing.assert_allclose(statistic, found.score[[1, 3]] @ change)
    np.testing.assert_allclose(std**2, np.diag(np.linalg.inv(block)))


def test_an_object_described_otherwise_is_a_new_one(record: CalibrationRecord) -> None:
    name = 'object_position[disc_2].x'
    same = State.of(record)
    moved = DECLARED.discs[1]._replace(x=0.21)
    other = State.of(record, replace(DECLARED, discs=(DECLARED.discs[0], moved, DECLARED.discs[2])))
    known, new = (np.sqrt(s.covariance[s.place(name), s.place(name)]) * s.scale[s.place(name)] for s in (same, other))
    np.testing.assert_allclose(new, 1.5e-5)
    np.testing.assert_allclose(known, std_of(record, name))
    assert same.covariance[same.place(name), 0] != 0 == other.covariance[other.place(name), 0]
    exact = State.of(record_of(CELL, 0, world=None))
    assert not exact.covariance[12:].any()

"""From recordings or touches to the outcome; messages on data that cannot be calibrated name the recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration.studies import CELL

from scara_kinetostatic import pipeline
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import CellError, InputError, UnsupportedDataError
from scara_kinetostatic.model.cell import MEASURED_DISCS, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.pipeline import calibrate_recordings, calibrate_touches, gather_touches, usable_touches
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams, simulate_touches
from scara_kinetostatic.touches.detection import Detection


@pytest.mark.parametrize(
    ('force', 'angle', 'message'),
    [
        (1e-3, 1.0, 'one: the forces are in kN, not in N: a touch would have'),
        (1.0, 180 / np.pi, 'one: the angles of joint 1 and joint 2 are in degrees, not in rad'),
    ],
)
def test_streams_of_other_units_are_named(tmp_path, force, angle, message):
    plan = default_plan(CELL).select(np.arange(24))
    streams = simulate_streams(CELL, PAPER_ACTUAL, plan, seed=3)
    wrench = replace(streams.wrench, force=force * streams.wrench.force)
    joints = replace(streams.joints, position=angle * streams.joints.position)
    write_streams(tmp_path / 'one', replace(streams, joints=joints, wrench=wrench), CELL)
    with pytest.raises(InputError, match=message):
        calibrate_recordings([tmp_path / 'one'], CELL)


def test_noise_without_a_touch_may_be_that(tmp_path):
    streams = simulate_streams(CELL, PAPER_ACTUAL, default_plan(CELL).select(np.arange(4)), seed=3)
    noise = np.random.default_rng(0).normal(0.0, 0.05, streams.wrench.force.shape)
    write_streams(tmp_path / 'one', replace(streams, wrench=replace(streams.wrench, force=noise)), CELL)
    with pytest.raises(InputError, match=r'0\.2 N, or nothing was touched; give them .*, or touch the objects$'):
        calibrate_recordings([tmp_path / 'one'], CELL)


def test_touches_from_elsewhere_give_the_same_outcome_as_those_of_a_recording(tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, 'diagnose', lambda _: Diagnosis('none', 0.5))
    write_streams(tmp_path / 'one', simulate_streams(CELL, PAPER_ACTUAL, default_plan(CELL, 6)), CELL)
    detection = gather_touches([tmp_path / 'one'], CELL)
    recorded = calibrate_touches(detection, CELL, sources=[tmp_path / 'one'])
    given = calibrate_touches(detection.touches, CELL)
    assert given.sources == ()
    assert given.found == len(detection.touches) == recorded.found
    assert given.final.parameters == recorded.final.parameters


def test_too_few_touches_from_elsewhere_name_no_file():
    few = simulate_touches(CELL, PAPER_ACTUAL, default_plan(CELL).select(np.arange(4)), CELL.noise)
    with pytest.raises(UnsupportedDataError, match=r'^these touches: 4 touches'):
        calibrate_touches(few, CELL)
    with pytest.raises(UnsupportedDataError, match=r'^empty\.csv: no contact found'):
        calibrate_touches(few.select(np.arange(0)), CELL, sources=['empty.csv'])


@pytest.mark.parametrize('seed', [4, 9, 16])
def test_an_effect_so_large_that_it_hides_everything_is_found_with_unknown_noise(monkeypatch, seed):
    diagnosed, label = [], 'object_position[disc_2]'
    monkeypatch.setattr(pipeline, 'diagnose', lambda c: diagnosed.append(c) or diagnose(c))
    robot = ExtendedModel(PAPER_ACTUAL, (find(CELL, label),), ((5e-3, 2e-3),))
    touches = simulate_touches(CELL, robot, default_plan(CELL, per_disc=14), CELL.noise, seed)
    outcome = calibrate_touches(touches, replace(CELL, noise=None))
    assert len(diagnosed) == 1
    assert outcome.diagnosis.verdict == 'explained'
    assert [item.effect.label for item in outcome.diagnosis.found] == [label]
    assert outcome.final.noise_source == 'estimated'
    off = outcome.final.parameters.as_array() - PAPER_ACTUAL.as_array()
    assert np.abs(off / outcome.final.std).max() < 4


@pytest.fixture(scope='module')
def touches() -> TouchSet:
    return simulate_touches(CELL, PAPER_ACTUAL, default_plan(CELL), CELL.noise, 3)


@pytest.mark.parametrize('factor', [0.1, 10.0])
def test_a_noise_that_is_stated_wrong_is_what_the_actions_name(touches, factor):
    outcome = calibrate_touches(touches, replace(CELL, discs=MEASURED_DISCS, noise=Noise(1e-5 * factor, 0.3 * factor)))
    assert 'times the stated noise' in outcome.assessment.reasons[0]
    assert outcome.assessment.actions == ('leave the noise out of the cell description to have it estimated',)


def test_a_noise_above_every_force_is_named(touches):
    with pytest.raises(UnsupportedDataError, match='its direction is noise of 30 N'):
        calibrate_touches(touches, replace(CELL, noise=Noise(1e-3, 30.0)))


def test_limits_that_exclude_all_touches_or_nearly_all_are_named(touches):
    cell = replace(CELL, limits=((-3.1, -2.9), (1.0, 1.1)))
    message = (
        r'^robot\.limits: they exclude all 72 touches, joint1 from -3.* to 2.*, joint2 from .* rad; correct them: of '
    )
    with pytest.raises(CellError, match=message + 'the joint angles, in rad$'):
        calibrate_touches(touches, cell)
    with pytest.raises(CellError, match=message + 'the joint angles, readings less the coupling, in rad$'):
        calibrate_touches(touches, replace(cell, coupling=0.1))
    low, *_, seventh, eighth = np.sort(touches.joints[:, 0])[:8].tolist()
    tenth, less = (replace(CELL, limits=((low, high), (-3.1, 3.1))) for high in (eighth, seventh))
    assert len(usable_touches(Detection.of(touches), tenth, ['touches'])) == 72
    with pytest.raises(CellError, match=r'^robot\.limits: they exclude 65 of 72 touches, joint1 from '):
        usable_touches(Detection.of(touches), less, ['touches'])

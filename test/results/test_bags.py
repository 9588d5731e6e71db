"""The recordings in `bags/` give back the truth that `bags/README.md` states."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmark.common import normal_error
from scara_kinetostatic.bags.reader import embedded_cell, read_streams
from scara_kinetostatic.contour.trace import trace_contour
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED, Parameters
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.simulation.slides import polygon

BAGS = Path(__file__).parents[2] / 'bags'
LARGEST = 300_000


@pytest.mark.parametrize(
    ('name', 'cell', 'truth', 'confounded'),
    [
        ('paper', None, PAPER_ACTUAL, ()),
        ('measured', 'measured.yaml', PAPER_MEASURED, ()),
        ('one_level.mcap', None, PAPER_ACTUAL, (('p_ee', 'g_ee'),)),
    ],
)
def test_truth_within_four_sigma(
    name: str, cell: str | None, truth: Parameters, confounded: tuple[tuple[str, ...], ...]
) -> None:
    described = load_cell(BAGS / cell) if cell else embedded_cell(BAGS / name)
    assert described is not None
    outcome = calibrate_recordings([BAGS / name], described)
    result = outcome.calibration
    assert outcome.found == 36
    assert result.used.sum() == 36
    assert result.identifiability.confounded == confounded
    known = np.isfinite(result.std)
    assert known.sum() == 12 - 2 * len(confounded)
    deviation = (result.parameters.as_array() - truth.as_array())[known] / result.std[known]
    assert np.abs(deviation).max() < 4
    assert outcome.diagnosis.verdict == 'none'


def test_what_is_determined_of_a_confounded_pair() -> None:
    cell = embedded_cell(BAGS / 'one_level.mcap')
    assert cell is not None
    (pair,) = calibrate_recordings([BAGS / 'one_level.mcap'], cell).calibration.identifiability.combinations
    truth = PAPER_ACTUAL.g_ee + 40 * PAPER_ACTUAL.p_ee
    assert abs(pair.value - truth) < 4 * pair.std + 0.3 * PAPER_ACTUAL.p_ee


def test_the_slide_is_the_outline_that_its_plan_states() -> None:
    cell = embedded_cell(BAGS / 'paper')
    assert cell is not None
    calibrated = CalibratedArm.of(calibrate_recordings([BAGS / 'paper'], cell).final)
    arm = replace(calibrated, cell=replace(cell, tip_radius=0.005))
    contour = trace_contour(read_streams(BAGS / 'slide.mcap', arm.cell), arm)
    ((slide,),) = [yaml.safe_load((BAGS / 'slide.yaml').read_text())]
    error = normal_error(polygon(slide['slide']['outline'], slide['slide']['corner_radius']), contour.surface)
    assert len(error) > 500
    assert np.sqrt(np.mean(error**2)) < 2 * np.sqrt(np.mean(contour.std_normal**2)) < 3e-5


def test_they_stay_small() -> None:
    for name in ('paper', 'measured', 'one_level.mcap', 'slide.mcap'):
        files = [BAGS / name] if (BAGS / name).is_file() else list((BAGS / name).iterdir())
        assert 0 < sum(path.stat().st_size for path in files) < LARGEST

"""The recordings in `bags/` give back the truth that `bags/README.md` states."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmark.common import normal_error
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.bags.reader import embedded_cell, read_streams
from scara_kinetostatic.contour.trace import trace_contour
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED, Parameters
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.simulation.plan import polygon

BAGS = Path(__file__).parents[2] / 'bags'


@cache
def outcome_of(name: str) -> Outcome:
    described = embedded_cell(BAGS / name) or load_cell(BAGS / 'measured.yaml')
    return calibrate_recordings([BAGS / name], described)


@pytest.mark.parametrize(
    ('name', 'truth', 'confounded'),
    [
        ('paper', PAPER_ACTUAL, ()),
        ('measured', PAPER_MEASURED, ()),
        ('one_level.mcap', PAPER_ACTUAL, (('p_ee', 'g_ee'),)),
    ],
)
def test_truth_within_four_sigma(name: str, truth: Parameters, confounded: tuple[tuple[str, ...], ...]) -> None:
    outcome = outcome_of(name)
    result = outcome.calibration
    assert outcome.found == 36
    assert result.used.sum() == 36
    assert result.identifiability.confounded == confounded
    known = np.isfinite(result.std)
    assert known.sum() == 12 - 2 * len(confounded)
    deviation = (result.parameters.as_array() - truth.as_array())[known] / result.std[known]
    assert np.abs(deviation).max() < 4
    assert outcome.diagnosis.verdict == 'none'
    for pair in result.identifiability.combinations:
        truth_of_pair = truth.g_ee + 40 * truth.p_ee
        assert abs(pair.value - truth_of_pair) < 4 * pair.std + 0.3 * truth.p_ee
    assert len(result.identifiability.combinations) == len(confounded)


def test_the_slide_is_the_outline_that_its_plan_states() -> None:
    calibrated = outcome_of('paper').final.arm
    arm = replace(calibrated, cell=replace(calibrated.cell, tip_radius=0.005))
    contour = trace_contour(read_streams(BAGS / 'slide.mcap', arm.cell), arm)
    ((slide,),) = [yaml.safe_load((BAGS / 'slide.yaml').read_text())]
    error = normal_error(polygon(slide['slide']['outline'], slide['slide']['corner_radius']), contour.surface)
    assert len(error) > 500
    assert np.sqrt(np.mean(error**2)) < 2 * np.sqrt(np.mean(contour.std_normal**2)) < 3e-5

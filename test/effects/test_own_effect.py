"""The example of the documentation, run as it stands there."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from calibration.studies import CELL
from effects.scenes import press

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.effects import registry
from scara_kinetostatic.effects.registry import find

DOCS = Path(__file__).parents[2] / 'docs'


@pytest.fixture
def example(tmp_path, monkeypatch):
    """The example's module; what it registers is taken back."""
    monkeypatch.setattr(registry, '_registered', [])
    page = (DOCS / 'how_to' / 'own_effect.md').read_text(encoding='utf-8')
    code = page.split('```python\n')[1].split('```')[0]
    path = tmp_path / 'stiffness_ripple.py'
    path.write_text(code, encoding='utf-8')
    spec = importlib.util.spec_from_file_location('stiffness_ripple', path)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, 'stiffness_ripple', module)
    spec.loader.exec_module(module)
    registry.register(module.StiffnessRipple.instances)
    return module


def test_it_is_listed_and_estimated(example):
    effect = find(CELL, 'stiffness_ripple[joint2]')
    assert effect == example.StiffnessRipple.of(1)
    values = np.array([2e-6, -1e-6])
    found = calibrate(press(effect, values), CELL, [effect])
    np.testing.assert_allclose(found.model.effect_arrays[0], values, rtol=1e-6)
    assert found.force_error < 1e-6

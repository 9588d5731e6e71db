"""Effects of other packages: found by their entry points; one that is broken is left out with one line."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from calibration.studies import CELL
from effects.scenes import press

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.effects import registry
from scara_kinetostatic.effects.registry import GROUP, catalogue, find

ROOT = Path(__file__).parents[2]
EFFECT = """
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects import JointEffect, Parameter


@dataclass(frozen=True)
class StiffnessRipple(JointEffect):
    name: ClassVar[str] = '{name}'
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter('a', 'rad/Nm', 1e-4, 'compliance beyond the mean'),)
    statement: ClassVar[str] = 'the compliance of {{target}} varies with its angle'
    confounded_with: ClassVar[str] = 'the compliance of the joint, if its angle hardly varies'
    identified_by: ClassVar[str] = 'large torques at many angles of the joint'
    plot_variable: ClassVar[str] = 'angle'

    def angles(self, at):
        return (np.cos(2 * at.joints[:, self.joint]) * at.torques[:, self.joint],)


def some(cell):
    return [StiffnessRipple.of(0)]


def numbers(cell):
    return [1, 2]


def fails(cell):
    raise RuntimeError('no such cell')


def exits(cell):
    raise SystemExit(3)
"""
RESULT = '(np.cos(2 * at.joints[:, self.joint]) * at.torques[:, self.joint],)'


def wrong(result: str) -> str:
    """The same effect, its angles another expression."""
    assert RESULT in EFFECT
    return EFFECT.format(name='stiffness_ripple').replace(RESULT, result)


@pytest.fixture(autouse=True)
def _forgets_plugins():
    yield
    for cached in (registry._entry_points, registry._warn):
        cached.cache_clear()


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder on `sys.path` as `pip install` leaves it; packages are added by `install`."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def install(package: str, module: str, code: str, value: str) -> Path:
        (tmp_path / f'{module}.py').write_text(code, encoding='utf-8')
        info = tmp_path / f'{package}-1.0.dist-info'
        info.mkdir()
        (info / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n', encoding='utf-8')
        (info / 'entry_points.txt').write_text(f'[{GROUP}]\nripple = {module}:{value}\n', encoding='utf-8')
        for cached in (registry._entry_points, registry._warn):
            cached.cache_clear()
        monkeypatch.delitem(sys.modules, module, raising=False)
        return tmp_path

    yield install
    for name in [name for name, module in sys.modules.items() if str(tmp_path) in str(getattr(module, '__file__', ''))]:
        del sys.modules[name]


def test_an_installed_package_offers_its_effects(site, caplog):
    before = len(catalogue(CELL))
    site('ripple', 'ripple_one', EFFECT.format(name='stiffness_ripple'), 'StiffnessRipple')
    labels = [effect.label for effect in catalogue(CELL)]
    assert labels[before:] == ['stiffness_ripple[joint1]', 'stiffness_ripple[joint2]']
    assert find(CELL, 'stiffness_ripple[joint2]').title == 'the compliance of joint 2 varies with its angle'
    assert not caplog.records


def test_a_function_may_offer_them(site):
    site('ripple', 'ripple_two', EFFECT.format(name='stiffness_ripple'), 'some')
    assert [effect.label for effect in catalogue(CELL)][-1] == 'stiffness_ripple[joint1]'


@pytest.mark.parametrize(
    ('code', 'value', 'problem'),
    [
        ('import nothing_of_this_name', 'Effect', 'ModuleNotFoundError'),
        ('raise SystemExit(3)', 'Effect', 'SystemExit: 3'),
        ('Effect: int = 3 +', 'Effect', 'SyntaxError'),
        ('', 'Effect', 'AttributeError'),
        ('Effect = 3', 'Effect', 'expected a class derived from Effect or a function from a cell to effects, got 3'),
        ('class Effect: pass', 'Effect', 'expected a class derived from Effect'),
        (EFFECT.format(name='stiffness_ripple').replace('    plot_variable', '    plot_over'), 'some', 'plot_variable'),
        (EFFECT.format(name='stiffness_ripple'), 'numbers', 'expected effects, got 1'),
        (EFFECT.format(name='stiffness_ripple'), 'fails', 'RuntimeError: no such cell'),
        (EFFECT.format(name='stiffness_ripple'), 'exits', 'SystemExit: 3'),
        (wrong('(np.full(len(at.joints), np.nan),)'), 'some', 'ValueError: shift: expected finite values'),
        (wrong('(np.zeros(3),)'), 'some', 'cannot be used: ValueError: '),
        (wrong('(np.zeros((len(at.joints), 2)),)'), 'some', 'cannot be used: ValueError: '),
        (wrong('(at.joints[:, 0], at.joints[:, 1])'), 'some', 'cannot be used: ValueError: '),
        (wrong('1 / 0'), 'some', 'ZeroDivisionError'),
        (EFFECT.format(name='encoder_gain'), 'some', "the label 'encoder_gain[joint1]' is taken"),
    ],
)
def test_a_broken_one_is_one_line_that_names_its_package_and_the_rest_works(site, caplog, code, value, problem):
    before = catalogue(CELL)
    site('broken-ripple', 'ripple_broken', code, value)
    site('good-ripple', 'ripple_good', EFFECT.format(name='good_ripple'), 'StiffnessRipple')
    for _ in range(2):
        found = catalogue(CELL)
    assert found[: len(before)] == before
    assert [effect.label for effect in found[len(before) :]] == ['good_ripple[joint1]', 'good_ripple[joint2]']
    assert len(caplog.records) == 1
    line = caplog.records[0].getMessage()
    assert line.startswith('broken-ripple 1.0: ')
    assert problem in line
    assert 'left out' in line
    assert '\n' not in line


def test_the_example_of_the_documentation_is_listed_and_estimated(tmp_path, monkeypatch):
    monkeypatch.setattr(registry, '_registered', [])
    page = (ROOT / 'docs' / 'how_to' / 'own_effect.md').read_text(encoding='utf-8')
    (tmp_path / 'stiffness_ripple.py').write_text(page.split('```python\n')[1].split('```')[0], encoding='utf-8')
    monkeypatch.syspath_prepend(str(tmp_path))
    example = import_module('stiffness_ripple')
    del sys.modules['stiffness_ripple']
    registry.register(example.StiffnessRipple.instances)
    effect, values = find(CELL, 'stiffness_ripple[joint2]'), np.array([2e-6, -1e-6])
    assert effect == example.StiffnessRipple.of(1)
    found = calibrate(press(effect, values), CELL, [effect])
    np.testing.assert_allclose(found.model.effect_arrays[0], values, rtol=1e-6)
    assert found.force_error < 1e-6

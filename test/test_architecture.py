"""Imports go downwards only, and each library is imported in one place."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import scara_kinetostatic

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / 'scara_kinetostatic'
NAME = 'scara_kinetostatic'
FLOORS = (
    ('errors',),
    ('model',),
    ('effects',),
    ('calibration',),
    ('diagnosis',),
    ('recording', 'simulation', 'experiments', 'physics'),
    ('pipeline',),
    ('report',),
    ('nodes', 'cli'),
)
"""From the ground up. Rooms of one floor may import from each other, but no two modules in a circle."""
KEPT_IN = {
    'rclpy': 'nodes',
    'rosbags': 'recording',
    'mcap': 'recording',
    'matplotlib': 'report',
    'jinja2': 'report',
    'rich': 'cli',
    'mujoco': 'physics',
}
MODULES = sorted(PACKAGE.rglob('*.py'))


def floor(room: str) -> int:
    return next(number for number, rooms in enumerate(FLOORS) if room in rooms)


def module_name(path: Path) -> str:
    return '.'.join(path.relative_to(ROOT).with_suffix('').parts).removesuffix('.__init__')


@cache
def imports(path: Path) -> tuple[str, ...]:
    """Every module that a file imports, wherever in the file, `from package import module` resolved."""
    found: list[str] = []
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path}: relative import'
            assert node.module
            for alias in node.names:
                inner = ROOT.joinpath(*node.module.split('.'), f'{alias.name}.py')
                found.append(f'{node.module}.{alias.name}' if inner.exists() else node.module)
    return tuple(found)


def room_of(module: str) -> str:
    return module.split('.')[1] if '.' in module else ''


def test_every_module_is_in_a_known_room() -> None:
    known = {room for rooms in FLOORS for room in rooms}
    found = {room_of(module_name(path)) for path in MODULES} - {''}
    assert found <= known


@pytest.mark.parametrize('path', [path for path in MODULES if path.parent != PACKAGE or path.stem != '__init__'])
def test_imports_go_downwards(path: Path) -> None:
    here = room_of(module_name(path))
    for module in imports(path):
        if module.startswith(f'{NAME}.'):
            there = room_of(module)
            assert floor(there) <= floor(here), f'{module_name(path)} imports {module}'
            if {here, there} == {'nodes', 'cli'}:  # only the demonstration starts nodes, and nothing in nodes needs cli
                assert module_name(path) == f'{NAME}.cli.demo'


def test_no_circles() -> None:
    graph = {module_name(path): {m for m in imports(path) if m.startswith(f'{NAME}.')} for path in MODULES}
    del graph[NAME]  # its names are loaded on first use
    done: set[str] = set()

    def visit(module: str, above: tuple[str, ...]) -> None:
        assert module not in above, ' -> '.join((*above, module))
        if module not in done:
            for other in graph.get(module, ()):
                visit(other, (*above, module))
            done.add(module)

    for module in graph:
        visit(module, ())


@pytest.mark.parametrize(('library', 'room'), KEPT_IN.items())
def test_a_library_is_imported_in_one_room(library: str, room: str) -> None:
    rooms = {
        room_of(module_name(path))
        for path in MODULES
        for module in imports(path)
        if module.split('.')[0] == library
    }
    assert rooms <= {room}


def test_the_numerical_core_needs_neither_ros_nor_files() -> None:
    code = (
        'import sys, scara_kinetostatic.diagnosis.diagnose as d, scara_kinetostatic.calibration.held_out as h\n'
        "print([m for m in ('rclpy', 'rosbags', 'mcap', 'yaml', 'matplotlib', 'jinja2', 'rich') if m in sys.modules])"
    )
    result = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert result.stdout.strip() == '[]'


def test_public_names_are_there_and_loaded_late() -> None:
    for name in scara_kinetostatic.__all__:
        assert getattr(scara_kinetostatic, name) is not None
    assert set(scara_kinetostatic.__all__) <= set(dir(scara_kinetostatic))
    with pytest.raises(AttributeError, match='nonsense'):
        _ = scara_kinetostatic.nonsense
    code = "import sys, scara_kinetostatic; print('numpy' in sys.modules)"
    result = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert result.stdout.strip() == 'False'


def test_one_version_everywhere() -> None:
    version = scara_kinetostatic.__version__
    assert f"version='{version}'" in (ROOT / 'setup.py').read_text()
    assert f'<version>{version}</version>' in (ROOT / 'package.xml').read_text()
    changes = (ROOT / 'CHANGELOG.md').read_text(encoding='utf-8')
    assert re.search(rf'^## (\[Unreleased\]|\[?{re.escape(version)})', changes, re.MULTILINE)

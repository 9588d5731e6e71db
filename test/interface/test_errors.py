"""Errors carry their data, also from another process."""

from __future__ import annotations

import pickle
import sys
from importlib import import_module

import pytest

from scara_kinetostatic.errors import (
    CellError,
    InputError,
    MissingLibraryError,
    ScaraKinetostaticError,
    UnsupportedDataError,
    naming_missing_libraries,
)


@pytest.mark.parametrize('error', [
    InputError('cell.yaml', 'no discs', 'add one'), CellError('a', 'b'), UnsupportedDataError('few', 'more'),
    MissingLibraryError('a', 'b'),
])  # fmt: skip
def test_an_error_comes_from_another_process_as_it_is(error: ScaraKinetostaticError):
    there = pickle.loads(pickle.dumps(error))
    assert (type(there), str(there), vars(there)) == (type(error), str(error), vars(error))


@pytest.mark.parametrize(('module', 'remedy'), [
    ('mcap.writer', 'pip install mcap'),
    ('yaml', 'pip install pyyaml, or apt install python3-yaml'),
    ('lxml', 'pip install lxml, or apt install python3-lxml'),
    ('mujoco', "pip install 'mujoco>=3.13'"),
    ('control_msgs.action', 'apt install ros-jazzy-control-msgs'),
    ('nav_msgs.msg', "source /opt/ros/jazzy/setup.bash, or pip install 'scara_kinetostatic[ros]', or "
     'apt install ros-jazzy-nav-msgs'),
])  # fmt: skip
def test_a_library_that_is_missing_is_named_with_what_installs_it(monkeypatch, module, remedy):
    name = module.partition('.')[0]
    monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, module if module != name else '', raising=False)
    with pytest.raises(MissingLibraryError) as caught, naming_missing_libraries(), naming_missing_libraries():
        import_module(module)
    assert str(caught.value) == f'{name}: not installed; {remedy}'


@pytest.mark.parametrize('module', ['scara_kinetostatic.no_such_module', 'json.no_such_module'])
def test_a_module_of_our_own_or_of_python_is_a_bug(module):
    with pytest.raises(ImportError) as caught, naming_missing_libraries():
        import_module(module)
    assert not isinstance(caught.value, ScaraKinetostaticError)

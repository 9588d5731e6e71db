"""Every public name has an example, and each one runs."""

from __future__ import annotations

import doctest
import inspect

import numpy as np
import pytest

import scara_kinetostatic as sk
from scara_kinetostatic import interface

NAMES = [name for name in sk.__all__ if not name.startswith('__')]


def examples(name: str) -> list[doctest.DocTest]:
    return doctest.DocTestFinder(recurse=False).find(
        getattr(sk, name), name, module=inspect.getmodule(getattr(sk, name)), globs={'np': np}
    )


@pytest.mark.parametrize('name', NAMES)
def test_an_example_runs(name, in_example_files, calibrated, without_page, monkeypatch):
    monkeypatch.setattr(interface, 'calibrate_recordings', calibrated)
    (found,) = examples(name)
    assert found.examples, f'{name} has no example'
    assert 'import scara_kinetostatic as sk' in found.examples[0].source
    lines: list[str] = []
    doctest.DocTestRunner(verbose=False).run(found, out=lines.append)
    assert not lines, ''.join(lines)


def test_the_lines_of_the_package_run(in_example_files, without_page, capsys):
    code = inspect.getdoc(sk).split('::\n\n', 1)[1].split('\nWhat `__all__`')[0]
    lines = [line[4:] for line in code.splitlines()]
    assert sum(bool(line.strip()) for line in lines) <= 22
    exec('\n'.join(lines), {})  # the example as it stands
    printed = capsys.readouterr().out
    assert printed.startswith('explained 0.330')
    assert 'object_radius[disc_2] radius 6' in printed or 'object_radius[disc_2] radius 5' in printed
    assert '[[0.3 0.2]]' in printed
    assert (in_example_files / 'result' / 'calibration.json').is_file()


def test_names_of_earlier_versions_can_be_imported():
    former = 'Disc Parameters Noise Sensor NAMES read_streams find_touches Diagnosis calibrate_recordings Detection'
    for name in (*former.split(), 'as_document', 'ScaraKinetostaticError', 'PAPER_ACTUAL'):
        assert getattr(sk, name) is not None
    assert len(NAMES) < 26

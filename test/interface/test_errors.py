"""Errors carry their data, also from another process."""

from __future__ import annotations

import pickle

import pytest

from scara_kinetostatic.errors import CellError, InputError, ScaraKinetostaticError, UnsupportedDataError


@pytest.mark.parametrize(
    'error', [InputError('cell.yaml', 'no discs', 'add one'), CellError('a', 'b'), UnsupportedDataError('few', 'more')]
)
def test_an_error_comes_from_another_process_as_it_is(error: ScaraKinetostaticError):
    there = pickle.loads(pickle.dumps(error))
    assert (type(there), str(there), vars(there)) == (type(error), str(error), vars(error))

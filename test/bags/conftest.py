"""A cell, a short recording of it, and the bags of others."""

from __future__ import annotations

from pathlib import Path

import pytest
from bags.forms import CELL, make_streams

from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.touches.streams import Streams


@pytest.fixture
def cell() -> Cell:
    return CELL


@pytest.fixture
def streams() -> Streams:
    return make_streams()


@pytest.fixture
def data() -> Path:
    return Path(__file__).parent / 'data'

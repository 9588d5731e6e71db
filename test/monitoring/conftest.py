"""A calibration that all tests share."""

from __future__ import annotations

import pytest
from monitoring.simulated import DECLARED, record_of

from scara_kinetostatic.monitoring.record import CalibrationRecord


@pytest.fixture(scope='session')
def record() -> CalibrationRecord:
    return record_of(DECLARED, 0)

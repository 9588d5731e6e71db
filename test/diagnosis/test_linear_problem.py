"""The F-test of further columns."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from scara_kinetostatic.diagnosis.linear_problem import f_test


def test_f_test_is_that_of_the_textbook():
    """Against a regression by hand: two columns, beside three that are in the fit already."""
    rng = np.random.default_rng(4)
    design, values = rng.normal(size=(40, 5)), rng.normal(size=40)
    values += 0.4 * design[:, 4]
    base, _ = np.linalg.qr(design[:, :3])
    residual = values - base @ (base.T @ values)
    more, _ = np.linalg.qr(design[:, 3:] - base @ (base.T @ design[:, 3:]))
    before = residual @ residual
    after = np.linalg.lstsq(design, values, rcond=None)[1][0]
    expected = stats.f.sf((before - after) / 2 / (after / 35), 2, 35)
    assert f_test(more, residual, 37) == pytest.approx((expected, 1 - after / before))
    assert f_test(more[:, :0], residual, 37) is None
    assert f_test(more, residual, 2) is None
    assert f_test(more, 0 * residual, 37) is None
    expected = stats.f.sf((before - after) / 2 / 4.0, 2, 35)  # where the noise is known to be larger
    assert f_test(more, residual, 37, 4.0) == pytest.approx((expected, 1 - after / before))

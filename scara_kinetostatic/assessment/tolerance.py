"""Whether the uncertainty of the tip is small enough for the use that the cell description states."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scara_kinetostatic.assessment import thresholds
from scara_kinetostatic.assessment.coverage import tip_std, workspace
from scara_kinetostatic.assessment.evidence import Evidence
from scara_kinetostatic.assessment.grade import Grade, Remark, quantity
from scara_kinetostatic.model.kinematics import forward


def conformity(evidence: Evidence) -> Iterator[Remark]:
    """An expanded uncertainty of the unloaded tip beyond the tolerance; unfit if in more than half of the workspace."""
    c = evidence.final
    if c.cell.tolerance is None:
        return
    joints = workspace(c)
    expanded = thresholds.COVERAGE_FACTOR * tip_std(c, joints)
    beyond = expanded > c.cell.tolerance
    if not beyond.any():
        return
    worst = int(np.argmax(expanded))
    x, y = forward(c.parameters, joints[worst : worst + 1])[0]
    yield Remark(
        Grade.UNFIT if beyond.mean() > 0.5 else Grade.CAUTION,
        f'the expanded uncertainty of the tip (k = 2) exceeds the tolerance of {quantity(c.cell.tolerance, "m")} in '
        f'{100 * beyond.mean():.0f} % of the workspace: {quantity(float(expanded[worst]), "m")} at x {x:.2f} m, '
        f'y {y:.2f} m',
        'lower what dominates the uncertainty budget, or use it only where the tolerance is met',
    )

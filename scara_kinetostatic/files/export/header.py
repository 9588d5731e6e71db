"""C99 header of the calibrated arm: constants, and H, H̄, Ḡ (4) as functions without any library but `math.h`.

The functions are those of the base model with the isotropic gripper (6) (7) (8), with the dead bands crossed
continuously where the sign of a torque is not known: what `scara_kinetostatic.locate` and `compensate` give.
"""

from __future__ import annotations

from pathlib import Path

import jinja2

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.files.export.facts import ExportFacts
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.cell import GripperSign
from scara_kinetostatic.model.parameters import NAMES, UNITS

_TEMPLATE = Path(__file__).with_name('header.h.j2')


def header_text(arm: CalibratedArm, facts: ExportFacts) -> str:
    """The header.

    Args:
        arm: the calibrated arm.
        facts: of it.

    Raises:
        UnsupportedDataError: the arm has a general gripper or effects of its own, which the functions do not have.
    """
    if facts.robot_effects:
        problem = f'a C header has the base model alone, and this calibration found {", ".join(facts.robot_effects)}'
        raise UnsupportedDataError(problem, 'export --format csv, which contains it, or use `compensate`')
    if not arm.cell.gripper.isotropic:
        problem = 'a C header has the isotropic gripper alone, and the cell description states model.gripper_excess'
        raise UnsupportedDataError(problem, 'export --format csv, which contains it, or use `compensate`')
    values = zip(NAMES, arm.model.parameters.as_array().tolist(), facts.std, strict=True)
    constants = [(name.upper(), repr(value), std, UNITS[name]) for name, value, std in values]
    template = jinja2.Template(
        _TEMPLATE.read_text(encoding='utf-8'), trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    physical = arm.cell.gripper_sign is GripperSign.PHYSICAL
    return template.render(
        lines=facts.lines,
        constants=constants,
        force_std=repr(arm.noise.force_rms),
        force_growth=repr(arm.noise.growth),
        compliance_sign='-' if physical else '+',
    )

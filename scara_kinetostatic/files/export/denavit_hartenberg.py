"""Denavit–Hartenberg table of the calibrated arm."""

from __future__ import annotations

from scara_kinetostatic.files.export.facts import ExportFacts
from scara_kinetostatic.model.arm import CalibratedArm

CONVENTIONS = ('standard', 'modified')
"""Denavit and Hartenberg (1955), and Craig's."""


def dh_text(arm: CalibratedArm, facts: ExportFacts, convention: str) -> str:
    """The Denavit–Hartenberg table of the rigid arm as CSV.

    standard:  T = Rot_z(q + theta_offset) Trans_z(d) Trans_x(a) Rot_x(alpha), a and alpha of the same link;
    modified:  T = Rot_x(alpha) Trans_x(a) Rot_z(q + theta_offset) Trans_z(d), a and alpha of the link before.

    The frame before joint 1 is that of the base displaced by (x0, y0), row ``base``; with the modified convention the
    tip is displaced from frame 2 by l2 along x, row ``tool``. All d and alpha are zero.
    """
    p = arm.model.parameters
    j1, j2 = (name.replace('"', '""') for name in arm.cell.joint_names)
    lengths = (p.l1, p.l2) if convention == 'standard' else (0.0, p.l1)
    rows = [('base', '', p.x0, p.y0, 0.0, 0.0, 0.0, 0.0)]
    rows += [
        ('joint1', f'"{j1}"', 0.0, 0.0, p.theta1, 0.0, lengths[0], 0.0),
        ('joint2', f'"{j2}"', 0.0, 0.0, p.theta2, 0.0, lengths[1], 0.0),
    ]
    if convention == 'modified':
        rows.append(('tool', '', p.l2, 0.0, 0.0, 0.0, 0.0, 0.0))
    formula = {
        'standard': 'T = Rot_z(q + theta_offset) Trans_z(d) Trans_x(a) Rot_x(alpha)',
        'modified': 'T = Rot_x(alpha) Trans_x(a) Rot_z(q + theta_offset) Trans_z(d)',
    }[convention]
    lines = [
        *(f'# {line}' for line in facts.lines),
        f'# {convention} convention: {formula}; x_m and y_m of base and tool are translations.',
        'row,joint_name,x_m,y_m,theta_offset_rad,d_m,a_m,alpha_rad',
        *(','.join(part if isinstance(part, str) else repr(part) for part in row) for row in rows),
    ]
    return '\n'.join(lines) + '\n'

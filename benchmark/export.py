"""The exported URDF, read by independent libraries, has the tip of H(L̄, Q).

    python -m benchmark.export [--poses N] [--json FILE]

Libraries: yourdfpy, and pinocchio (`pip install pin`); what is not installed is left out. The xacro is
expanded by `xacro` first.
"""

from __future__ import annotations

import importlib.util
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmark.common import CELL, parser, print_and_save
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.files.export import exported
from scara_kinetostatic.files.urdf import TOOL_FRAME
from scara_kinetostatic.interface import simulate
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import PAPER_ACTUAL

WITHIN = 1e-9
"""m."""


def by_yourdfpy(path: Path, names: tuple[str, str], joints: Floats) -> Floats:
    """Places of the tip, (n, 2), m."""
    import yourdfpy

    robot = yourdfpy.URDF.load(str(path), load_meshes=False, build_scene_graph=True)
    found = []
    for pair in joints.tolist():
        robot.update_cfg(dict(zip(names, pair, strict=True)))
        found.append(robot.get_transform(TOOL_FRAME)[:2, 3])
    return np.array(found)


def by_pinocchio(path: Path, names: tuple[str, str], joints: Floats) -> Floats:
    """The same; a continuous joint is its cosine and sine there."""
    import pinocchio

    model = pinocchio.buildModelFromUrdf(str(path))
    data, found = model.createData(), []
    places = [model.joints[model.getJointId(name)].idx_q for name in names]
    for pair in joints:
        q = pinocchio.neutral(model)
        for place, angle in zip(places, pair, strict=True):
            q[place : place + 2] = np.cos(angle), np.sin(angle)
        pinocchio.framesForwardKinematics(model, data, q)
        found.append(data.oMf[model.getFrameId(TOOL_FRAME)].translation[:2].copy())
    return np.array(found)


LIBRARIES: dict[str, Callable[[Path, tuple[str, str], Floats], Floats]] = {
    'yourdfpy': by_yourdfpy,
    'pinocchio': by_pinocchio,
}


def main() -> int:
    """Compare."""
    made = parser(__doc__)
    made.add_argument('--poses', type=int, default=1000, metavar='N')
    args = made.parse_args()
    if not any(map(importlib.util.find_spec, LIBRARIES)):
        print(f'none of {", ".join(LIBRARIES)} is installed: pip install yourdfpy pin xacro', file=sys.stderr)
        return 2
    arm = calibrate(simulate(CELL, PAPER_ACTUAL), CELL).arm
    joints = np.random.default_rng(0).uniform(-np.pi, np.pi, (args.poses, 2))
    expected = forward(arm.model.parameters, joints)
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, path in _files(arm, Path(folder)).items():
            for library, tips in LIBRARIES.items():
                if importlib.util.find_spec(library):
                    found = tips(path, arm.cell.joint_names, joints)
                    figures[f'{name}, {library}: largest error, m'] = float(np.abs(found - expected).max())
    print_and_save(args.json, figures)
    return 0 if figures and max(figures.values()) <= WITHIN else 1


def _files(arm: CalibratedArm, folder: Path) -> dict[str, Path]:
    """URDF files by the format that they come from."""
    (folder / 'arm.urdf').write_text(exported(arm, 'urdf', 'calibration')[0])
    found = {'urdf': folder / 'arm.urdf'}
    if importlib.util.find_spec('xacro'):
        import xacro

        (folder / 'arm.xacro').write_text(exported(arm, 'xacro', 'calibration')[0])
        expanded = xacro.process_file(str(folder / 'arm.xacro')).toprettyxml()
        (folder / 'from_xacro.urdf').write_text(expanded)
        found['xacro'] = folder / 'from_xacro.urdf'
    return found


if __name__ == '__main__':
    sys.exit(main())

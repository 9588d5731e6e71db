"""How well the memory of a slipping joint in MuJoCo follows from the contact torques alone.

    python -m benchmark.mujoco_slip [--scene NAME …] [--per-disc 6]

The torque of joint 2 in free motion is that of inertia, which no recording contains. The state of the slip in the
engine is compared with the play of the contact torques, both over the slip torque, at the ends of the holds.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from benchmark.common import CELL
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.kinematics import jacobian
from scara_kinetostatic.simulation.mujoco import TouchController, preload_plan
from scara_kinetostatic.simulation.mujoco.engine import Scene, scene_named
from scara_kinetostatic.simulation.plan import Plan


class Watched(TouchController):
    """A controller that notes at each tick the angles of the links, of the slipping spring, and of the other, rad."""

    def __init__(self, scene: Scene, plan: Plan) -> None:
        super().__init__(scene, CELL, plan)
        self.noted: list[Floats] = []

    def _tick(self, progress: float = 0.0) -> None:
        super()._tick(progress)
        springs = [self.engine.data.joint(name).qpos[0] for name in ('slip2', 'spring2')]
        self.noted.append(np.array([*self.engine.links, *springs]))


def play(torque: Floats, half_width: float) -> Floats:
    """The play of a torque over time, (k,), from the relaxed state, Nm."""
    place, places = 0.0, []
    for value in torque.tolist():
        place = min(max(place, value - half_width), value + half_width)
        places.append(place)
    return np.array(places)


def report(scene: Scene, plan: Plan) -> str:
    """Torques of inertia and error of the state in a scene."""
    controller = Watched(scene, plan)
    motion = controller.run()
    noted = np.array(controller.noted)
    torque = -np.einsum('nij,ni->nj', jacobian(scene.parameters, noted[:, :2]), motion.force)[:, 1]
    limit, free = scene.slip_torque[1], ~motion.force.any(axis=1)
    state = noted[:, 2] / scene.slip_compliance[1] - play(torque, limit)
    error = np.abs(state[motion.holds]) / limit
    inertia = np.abs(noted[free, 3]) / scene.parameters.p2
    return (
        f'{scene.name}: {len(plan)} touches, contact torque up to {np.abs(torque).max():.1f} Nm; '
        f'in free motion {inertia.max():.2f} Nm, {np.quantile(inertia, 0.99):.2f} Nm in 99 % of the time; '
        f'error of the state over the slip torque: median {np.median(error):.4f}, largest {error.max():.3f}, '
        f'above 0.1 in {np.mean(error > 0.1):.0%} of the holds'
    )


def main() -> int:
    """Runs the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else '')
    parser.add_argument('--scene', nargs='+', default=['joint_slip', 'joint_slip_fast'], metavar='NAME')
    parser.add_argument('--per-disc', type=int, default=6)
    args = parser.parse_args()
    for name in args.scene:
        print(report(scene_named(name), preload_plan(CELL, args.per_disc)), flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())

"""Simulation of the dial gauge experiments of section 5.2.

Both links of the robot are along y. Three set-ups:

- gripper: both joints locked, gauge at the end-effector, loads along several directions:
  ΔS = p_ee F + ½ gap(φ) sense (7);
- joint 2: joint 1 locked, load along x at the end, gauge at the end of link 2: with the lever l = l2,
  ΔS = l (p F l + ½ gap sense) (6);
- joint 1: joint 2 locked, likewise with the lever l1 + l2.

At the end of link 2 the gauge measures the joint alone.

**Backlash over the direction.** Figure 4(c) is not isotropic; (7) is. Here the dead zone of the gripper is an ellipse:
under a load along u, without friction, the tip is at the point of the ellipse that is farthest along u, so that the gap
between the two senses is the width of the ellipse,

    gap(φ) = √(gap_major² cos²(φ - axis) + gap_minor² sin²(φ - axis)),

an even, smooth function of the direction. By default the gap is largest along x and smallest along y, so that
directions 30° apart contain both ends of the measured range; the paper does not state their directions.

**Gap and half gap.** Values of backlash are gaps here, the jump of ΔS at F = 0, as those of figure 4(d) according to
section 5.2 ("the ΔS gap itself"); g of (6) and (7) is half of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.loops.readings import GRIPPER, JOINT1, JOINT2, PARTS, Readings

LEVELS = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0)
"""Loads in increasing order, N; they are removed in the reverse order."""
DIRECTIONS = tuple(np.radians(np.arange(0, 360, 30)).tolist())


@dataclass(frozen=True)
class DialGaugeBench:
    """The simulated robot, by default with the values of figure 4(d) and table 1, and the errors of its readings.

    Attributes:
        p_ee: compliance of the gripper, m/N.
        gap_major: its largest gap over the directions, m.
        gap_minor: its smallest.
        axis: direction of the largest, rad.
        p: compliance of joint 1 and 2, rad/Nm.
        gap: of joint 1 and 2, rad.
        links: their lengths, m.
        noise: of the dial gauge, one standard deviation, m.
    """

    p_ee: float = 3.76e-5
    gap_major: float = 2.05e-4
    gap_minor: float = 5.49e-5
    axis: float = 0.0
    p: tuple[float, float] = (3.23e-5, 1.08e-4)
    gap: tuple[float, float] = (2.64e-4, 2.68e-4)
    links: tuple[float, float] = (0.33, 0.33)
    noise: float = 2e-6

    def gripper_gap(self, direction: ArrayLike) -> Floats:
        """Gap of the gripper along directions (rad), m."""
        turned = np.asarray(direction, dtype=float) - self.axis
        return np.hypot(self.gap_major * np.cos(turned), self.gap_minor * np.sin(turned))

    def run(
        self, rng: np.random.Generator, part: str, direction: float = 0.0, levels: Sequence[float] = LEVELS
    ) -> Readings:
        """The experiment at the gripper along one direction, joints locked, or at joint 1 or 2, the other one locked.

        A joint is loaded along x at the end of the arm, which is stretched along y.
        """
        force, sense, cycle = load_cycles(levels)
        compliance, gap, lever = self.p_ee, float(self.gripper_gap(direction)), np.nan
        if part != GRIPPER:
            joint, lever = PARTS.index(part) - 1, sum(self.links) if part == JOINT1 else self.links[1]
            compliance, gap = self.p[joint] * lever**2, self.gap[joint] * lever
        displacement = compliance * force + gap / 2 * sense + self.noise * rng.standard_normal(len(force))
        return Readings(force, displacement, cycle, part=part, direction=direction, lever=lever, source=part)


def load_cycles(levels: Sequence[float] = LEVELS, cycles: int = 3) -> tuple[Floats, Floats, Floats]:
    """Force, N, sense of the last load, and cycle of each row of a run, (n,): cycles with loads in both senses."""
    rise = np.array(levels)
    one = np.concatenate([rise, rise[-2::-1], [0.0]])
    force = np.concatenate([[0.0], np.tile(np.concatenate([one, -one]), cycles)])
    sense = np.concatenate([[0.0], np.tile(np.repeat([1.0, -1.0], len(one)), cycles)])
    return force, sense, np.concatenate([[1.0], np.repeat(np.arange(1.0, cycles + 1), 2 * len(one))])


def simulate_experiments(
    bench: DialGaugeBench | None = None,
    directions: Sequence[float] = DIRECTIONS,
    levels: Sequence[float] = LEVELS,
    seed: int = 0,
) -> tuple[Readings, ...]:
    """All of section 5.2: the gripper in every direction, joint 2, joint 1.

    Args:
        bench: robot and gauges.
        directions: of the positive load on the gripper, rad.
        levels: loads in increasing order, N.
        seed: of the noise.
    """
    bench, rng = bench or DialGaugeBench(), np.random.default_rng(seed)
    gripper = [bench.run(rng, GRIPPER, direction, levels) for direction in directions]
    return (*gripper, *(bench.run(rng, joint, 0.0, levels) for joint in (JOINT2, JOINT1)))

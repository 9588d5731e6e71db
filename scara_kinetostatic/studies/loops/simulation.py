"""Simulation of the dial gauge experiments of section 5.2.

Both links of the robot are along y. Three set-ups:

- gripper: both joints locked, gauge at the end-effector, loads along `LoadPlan.directions`:
  ΔS = p_ee F + ½ gap(φ) sense (7);
- joint 2: joint 1 locked, load along x at the end, gauge at the end of link 2: torque F l2, ΔS = l2 Δq2 (6);
- joint 1: joint 2 locked, likewise with the lever l1 + l2.

At the end of link 2 the gauge measures the joint alone; at the end-effector (`gauge_at='tip'`) joint and gripper in
series.

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

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.kinetostatics import joint_deflection, joint_torques
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.studies.loops.readings import GRIPPER, JOINT1, JOINT2, LINK, TIP, DialGaugeReadings, join

_STRETCHED = np.array([np.pi / 2, 0.0])
"""Link angles with both links along y."""


@dataclass(frozen=True)
class DialGaugeTruth:
    """Parameters of the simulated robot; by default those of figure 4(d) and table 1.

    Attributes:
        p_ee: compliance of the gripper, m/N.
        gap_major: its largest gap over the directions, m.
        gap_minor: its smallest.
        axis: direction of the largest, rad.
        p1: compliance of joint 1, rad/Nm.
        gap1: gap of joint 1, rad.
        p2: compliance of joint 2, rad/Nm.
        gap2: gap of joint 2, rad.
        l1: length of link 1, m.
        l2: length of link 2, m.
    """

    p_ee: float = 3.76e-5
    gap_major: float = 2.05e-4
    gap_minor: float = 5.49e-5
    axis: float = 0.0
    p1: float = 3.23e-5
    gap1: float = 2.64e-4
    p2: float = 1.08e-4
    gap2: float = 2.68e-4
    l1: float = 0.33
    l2: float = 0.33

    def gripper_gap(self, direction: ArrayLike) -> Floats:
        """Gap of the gripper along directions (rad), m."""
        turned = np.asarray(direction, dtype=float) - self.axis
        return np.hypot(self.gap_major * np.cos(turned), self.gap_minor * np.sin(turned))

    def with_one_joint(self, joint: int) -> Parameters:
        """Parameters of the model with the other joint and the gripper rigid."""
        p, g = np.array([self.p1, self.p2]), np.array([self.gap1, self.gap2]) / 2
        locked = np.arange(2) != joint - 1
        p[locked], g[locked] = 0.0, 0.0
        return Parameters(l1=self.l1, l2=self.l2, p_ee=0.0, p1=p[0], p2=p[1], g1=g[0], g2=g[1])


@dataclass(frozen=True)
class LoadPlan:
    """The loads of one run, the same for every direction.

    Attributes:
        levels: loads in increasing order, N; they are removed in the reverse order.
        cycles: number of cycles, each in both senses.
        directions: of the positive load in the gripper's experiment, rad.
    """

    levels: tuple[float, ...] = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0)
    cycles: int = 3
    directions: tuple[float, ...] = field(default_factory=lambda: tuple(np.radians(np.arange(0, 360, 30)).tolist()))

    def run(self) -> tuple[Floats, Floats, NDArray[np.int64]]:
        """Force (n,), N, sense of the last load (n,), and cycle (n,) of each row."""
        rise = np.array(self.levels)
        one = np.concatenate([rise, rise[-2::-1], [0.0]])
        force = np.concatenate([[0.0], np.tile(np.concatenate([one, -one]), self.cycles)])
        sense = np.concatenate([[0.0], np.tile(np.repeat([1.0, -1.0], len(one)), self.cycles)])
        cycle = np.concatenate([[1], np.repeat(np.arange(1, self.cycles + 1), 2 * len(one))])
        return force, sense, cycle


@dataclass(frozen=True)
class DialGaugeSensors:
    """Errors of the readings.

    Attributes:
        noise: of the dial gauge, one standard deviation, m.
        resolution: of the dial gauge, m; 0 for none.
        force_noise: of the force, one standard deviation, N.
    """

    noise: float = 2e-6
    resolution: float = 0.0
    force_noise: float = 0.0

    def read(self, force: Floats, displacement: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Force (N) and displacement (m) as read."""
        force = force + self.force_noise * rng.standard_normal(force.shape)
        displacement = displacement + self.noise * rng.standard_normal(displacement.shape)
        if self.resolution:
            displacement = self.resolution * np.round(displacement / self.resolution)
        return force, displacement


def simulate_gripper(
    truth: DialGaugeTruth, plan: LoadPlan, sensors: DialGaugeSensors, rng: np.random.Generator
) -> DialGaugeReadings:
    """The gripper's experiment, joints locked, direction after direction."""
    force, sense, cycle = plan.run()
    runs = []
    for direction in plan.directions:
        displacement = truth.p_ee * force + truth.gripper_gap(direction) / 2 * sense
        read = sensors.read(force, displacement, rng)
        runs.append(DialGaugeReadings.of(*read, part=GRIPPER, direction=direction, cycle=cycle, source='gripper'))
    return join(runs)


def simulate_joint(
    joint: int,
    truth: DialGaugeTruth,
    plan: LoadPlan,
    sensors: DialGaugeSensors,
    rng: np.random.Generator,
    gauge_at: str = LINK,
) -> DialGaugeReadings:
    """The experiment at one joint, the other locked: loads along x at the end of the arm stretched along y.

    Args:
        joint: 1 or 2.
        truth: of the robot.
        plan: the loads; its directions are not used.
        sensors: errors of the readings.
        rng: random generator of the errors.
        gauge_at: where the gauge touches; at the 'tip' it measures the gripper as well.
    """
    force, sense, cycle = plan.run()
    displacement = joint_displacement(truth.with_one_joint(joint), force, sense)
    if gauge_at == TIP:
        displacement = displacement + truth.p_ee * force + truth.gripper_gap(0.0) / 2 * sense
    lever = truth.l2 if joint == 2 else truth.l1 + truth.l2
    part = JOINT1 if joint == 1 else JOINT2
    read = sensors.read(force, displacement, rng)
    return DialGaugeReadings.of(
        *read, part=part, gauge_at=gauge_at, direction=0.0, lever=lever, cycle=cycle, source=part
    )


def joint_displacement(parameters: Parameters, force: Floats, sense: Floats) -> Floats:
    """Displacement of the end of link 2 along x under loads along x, motors held, from (6) and (8), (n,), m.

    Args:
        parameters: L̄, gripper rigid.
        force: load on the robot along x, (n,), N.
        sense: side of the dead zone without load, (n,).
    """
    on_object = np.stack([-force, np.zeros_like(force)], axis=-1)
    links = np.broadcast_to(_STRETCHED, on_object.shape)
    for _ in range(4):  # C = JᵀF with J at Q*
        torques = joint_torques(parameters, links, on_object)
        links = _STRETCHED - joint_deflection(parameters, torques, slack=sense[:, None])
    return forward(parameters, links)[:, 0] - forward(parameters, _STRETCHED[None])[0, 0]


def simulate_experiments(
    truth: DialGaugeTruth | None = None,
    plan: LoadPlan | None = None,
    sensors: DialGaugeSensors | None = None,
    seed: int = 0,
) -> DialGaugeReadings:
    """All of section 5.2: the gripper in every direction, joint 2, joint 1.

    Args:
        truth: by default figure 4(d).
        plan: by default up to 40 N in steps of 5 N, three times, 12 directions 30° apart.
        sensors: by default 2 µm.
        seed: of the noise.
    """
    truth, plan, sensors = truth or DialGaugeTruth(), plan or LoadPlan(), sensors or DialGaugeSensors()
    rng = np.random.default_rng(seed)
    parts = [simulate_gripper(truth, plan, sensors, rng)]
    parts += [simulate_joint(joint, truth, plan, sensors, rng) for joint in (2, 1)]
    return join(parts)

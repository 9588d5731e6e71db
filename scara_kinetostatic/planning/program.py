"""Planned touches as files: `next.csv`, a list; `plan.yaml` for the simulator; `program.csv`, every step of a robot.

The steps of a touch: travel by way of some places to where the approach begins; approach slowly, until the force says
contact, at most as far beyond the expected surface as the cell allows; press to the force, with a preload beyond it and
back; hold; retract along the line of the approach. All moves of the tip are straight, but where the elbow changes its
posture: there both joints move in proportion. With a lift it is raised before the tip travels, and lowered after.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.files.tables import csv_cell, csv_lines
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.planning.motion import Waypoints
from scara_kinetostatic.planning.next_touches import PlannedTouches, Planner
from scara_kinetostatic.simulation.plan import POSTURE_NAMES, dump_plan

CONTACT = 0.1
"""Force at which an approach ends, as a part of the force of the touch."""


class Step(NamedTuple):
    """One step of a program.

    Attributes:
        touch: number of the touch, from 1.
        kind: ``travel``, ``approach``, ``press``, ``hold`` or ``retract``.
        tip: where the tip is to go, (2,), m.
        joints: Q there, (2,), rad.
        lift: position of the lift, m; None without one.
        speed: of the tip, m/s; 0 of a hold.
        until: force that ends the step, N; None for the place that does.
    """

    touch: int
    kind: str
    tip: Floats
    joints: Floats
    lift: float | None
    speed: float
    until: float | None = None


def joint_angles(planner: Planner, poses: Waypoints, force: Floats | None = None) -> Floats:
    """Q for places of the tip under forces (n, 2), N, or none, by the planner's arm, (n, 2), rad."""
    load = np.zeros(poses.tip.shape) if force is None else force
    found = Predictor(planner.arm, nominal=planner.now is None).compensate(poses.tip, load, poses.posture).joints
    return planner.space.in_turn(found)


def program(planner: Planner, planned: PlannedTouches) -> list[Step]:
    """Every step, in order; nobody knows where the robot stands, and its first way is one straight travel."""
    cell, plan = planner.arm.cell, planned.plan
    motion, lift = cell.touch, cell.lift
    up, down = (None, None) if lift is None else (lift.up, lift.down)
    contact, press = plan.contact(cell), -plan.force[:, None] * plan.normal(cell)
    deep = contact - motion.search * plan.normal(cell)
    at_start, at_deep = joint_angles(planner, planned.approach), joint_angles(planner, Waypoints(deep, plan.posture))
    at_hold, at_peak = (
        joint_angles(planner, Waypoints(contact, plan.posture), force)
        for force in (press, (1 + plan.preload[:, None]) * press)
    )
    depth = np.hypot(*(forward(planner.arm.model.parameters, at_hold) - contact).T)
    speed = np.clip(depth / 0.7, motion.contact_speed / 20, motion.contact_speed)  # a press takes 0.7 s, or longer

    origins = [None, *planned.order]

    def steps() -> Iterator[Step]:
        for k, force in enumerate(plan.force.tolist()):
            number, here = k + 1, planned.approach.tip[k]
            way = planned.approach.select(slice(0, 1))
            if (origin := origins[k]) is not None:
                if lift is not None:
                    stands = planned.ways.stop(origin)
                    yield Step(number, 'travel', stands.tip[0], joint_angles(planner, stands)[0], up, motion.speed)
                way = planned.ways.way(origin, planned.order[k])
            for tip, joints in zip(way.tip, joint_angles(planner, way), strict=True):
                yield Step(number, 'travel', tip, joints, up, motion.speed)
            if lift is not None:
                yield Step(number, 'travel', here, at_start[k], down, motion.speed)
            yield Step(number, 'approach', deep[k], at_deep[k], down, motion.contact_speed, CONTACT * force)
            if plan.preload[k] > 0:
                peak = (1 + float(plan.preload[k])) * force
                yield Step(number, 'press', contact[k], at_peak[k], down, float(speed[k]), peak)
            yield Step(number, 'press', contact[k], at_hold[k], down, float(speed[k]), force)
            yield Step(number, 'hold', contact[k], at_hold[k], down, 0.0)
            yield Step(number, 'retract', here, at_start[k], down, motion.contact_speed)

    return list(steps())


def next_files(planner: Planner, planned: PlannedTouches) -> dict[str, str]:
    """The text of each file by its name."""
    plan, cell, steps = planned.plan, planner.arm.cell, program(planner, planned)
    hold, start = (np.array([step.joints for step in steps if step.kind == kind]) for kind in ('hold', 'retract'))

    def pairs(names: str, values: Floats) -> dict[str, list[str]]:
        return {
            name: [f'{value:.7f}' for value in column] for name, column in zip(names.split(), values.T, strict=True)
        }

    touches = {
        'order': [str(k + 1) for k in range(len(plan))],
        'object': [csv_cell(cell.discs[disc].name) for disc in plan.disc],
        'elbow': [POSTURE_NAMES[int(side)] for side in plan.posture],
        'angle_deg': [f'{angle:.3f}' for angle in np.degrees(plan.angle)],
        'force_N': [f'{force:g}' for force in plan.force],
        **pairs('x_m y_m', plan.contact(cell)),
        **pairs('approach_x_m approach_y_m', planned.approach.tip),
        **pairs('q1_rad q2_rad', cell.readings(hold)),
        **pairs('approach_q1_rad approach_q2_rad', cell.readings(start)),
        'reason': [csv_cell(reason) for reason in planned.reasons],
    }
    moves = {
        'step': [str(k + 1) for k in range(len(steps))],
        'touch': [str(step.touch) for step in steps],
        'kind': [step.kind for step in steps],
        **pairs('x_m y_m', np.array([step.tip for step in steps])),
        **pairs('q1_rad q2_rad', cell.readings(np.array([step.joints for step in steps]))),
        'lift_m': ['' if step.lift is None else f'{step.lift:g}' for step in steps],
        'speed_m_s': [f'{step.speed:.4g}' for step in steps],
        'until_force_N': ['' if step.until is None else f'{step.until:g}' for step in steps],
    }
    remark = 'in the order of a short way; planned by scara-kinetostatic next'
    return {
        'next.csv': csv_lines(touches),
        'plan.yaml': dump_plan(plan, cell, (remark,)),
        'program.csv': csv_lines(moves),
    }

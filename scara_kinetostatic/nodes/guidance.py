"""Which touch to make next, for a robot that is guided by hand or taught: part of the node `calibrator`.

The calibrator says it, not the collector: to choose takes a third of a second, in which no message of the streams may
be missed. What is known is the present result, or the nominal arm before the first, and the touches of
`collector/touch` since. With each touch `~/next_touch` has the tip in contact, its x axis along the outward normal,
with an empty `frame_id` where no more are needed, and `~/state` the same in words with the reason, the uncertainty of
the tip predicted with the touches made, and the tolerance. A cell without limits of the joints has no guidance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped

from scara_kinetostatic.errors import ScaraKinetostaticError, UnsupportedDataError
from scara_kinetostatic.files.calibration_file import nominal_arm
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import quantity
from scara_kinetostatic.model.touch import LATER, TouchSet
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.nodes.cell_node import OK, WARN, CellNode
from scara_kinetostatic.nodes.conversion import pose_stamped, touch_of
from scara_kinetostatic.nodes.monitor import was_seen
from scara_kinetostatic.nodes.streams import LATCHED, LATCHED_TOUCHES
from scara_kinetostatic.planning.next_touches import PlannedTouches, Planner
from scara_kinetostatic.simulation.plan import Plan

_AHEAD = 6
"""Touches that are planned together; the nearest of them is the next."""


class Guidance:
    """Publishes the next touch.

    Args:
        node: that does.
        cell: returns the cell description; None where there is none yet, then it is that of the result.

    Attributes:
        text: what is next; empty before anything is known.
    """

    def __init__(self, node: CellNode, cell: Callable[[], Cell | None]) -> None:
        self._node, self._cell, self.text = node, cell, ''
        self._record: CalibrationRecord | None = None
        self._touches: dict[tuple[str, str], Mapping[str, str]] = {}
        self._is_due = True
        self._next = node.create_publisher(PoseStamped, '~/next_touch', LATCHED)
        self._state = node.create_publisher(DiagnosticArray, '~/state', LATCHED)
        node.create_subscription(DiagnosticArray, 'collector/touch', self._note, LATCHED_TOUCHES)
        node.every(0.5, self._plan)

    def use(self, record: CalibrationRecord) -> None:
        """Goes on from a result."""
        self._record, self._is_due = record, True

    def _note(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            key = values.get('recording', ''), values.get('touch', '')
            if values.get('accepted') == 'true':
                self._touches[key] = values
            else:
                self._touches.pop(key, None)
        while len(self._touches) > 1000:  # as many as the topic has for one who hears it anew
            del self._touches[next(iter(self._touches))]
        self._is_due = True

    def _plan(self) -> None:
        """Chooses, after all touches that have come."""
        if not self._is_due:
            return
        self._is_due, record = False, self._record
        try:
            cell = self._cell() or (record.arm.cell if record else None)
            if cell is None or cell.limits is None:
                return
            arm = nominal_arm(cell) if record is None else record.arm
            new = [one for key, one in self._touches.items() if record is None or not was_seen(*key, record)]
            made = [*([record.touches] if record else []), *(touch_of(one, arm).replace(order=[LATER]) for one in new)]
            touches = TouchSet.concatenate(made) if made else None
            planner = Planner(nominal_arm(cell), touches=touches) if record is None else record.planner(cell, touches)
            self._say(planner, cell)
        except (ScaraKinetostaticError, LookupError, ValueError) as error:
            self._publish(WARN, f'no touch can be planned: {error}', {})

    def _say(self, planner: Planner, cell: Cell) -> None:
        tolerance, touches, now = cell.tolerance, planner.touches, planner.present
        reached = '' if tolerance is None else f', tolerance {quantity(tolerance, "m")}'
        tip = f'tip ±{quantity(now, "m")} (k = 2){reached}'
        number = np.bincount([] if touches is None else touches.disc, minlength=len(cell.discs)).astype(int).tolist()
        made = ', '.join(f'{disc.name} {count}' for disc, count in zip(cell.discs, number, strict=True))
        values = {'tip_uncertainty_m': now, 'tolerance_m': '' if tolerance is None else tolerance, 'touches': made}
        if tolerance is not None and now <= tolerance:
            self._next.publish(PoseStamped())
            self._publish(OK, f'enough touches: {tip}', values)
            return
        planned = _nearest(planner)
        plan, place = planned.plan, planned.plan.contact(cell)[0].tolist()
        stamp = int(self._node.get_clock().now().nanoseconds)
        self._next.publish(pose_stamped(stamp, cell.plane, (place[0], place[1], float(plan.direction(cell)[0]))))
        values |= {'object': cell.discs[int(plan.disc[0])].name, 'angle_deg': float(np.degrees(plan.angle[0]))}
        values |= {'force_N': float(plan.force[0]), 'reason': planned.reasons[0]}
        self._publish(OK, f'next: {planned.sentence(cell)}; {tip}', values)

    def _publish(self, level: bytes, text: str, values: Mapping[str, object]) -> None:
        self.text = text
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        name = f'{self._node.get_fully_qualified_name()}: next touch'
        array = DiagnosticArray(status=[DiagnosticStatus(level=level, name=name, message=text, values=pairs)])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._state.publish(array)


def _nearest(planner: Planner) -> PlannedTouches:
    """The best touches, the nearest to the last one first, where a way leads there."""
    touches, arm = planner.touches, planner.arm
    if touches is not None and len(touches):
        last = touches.select(np.array([len(touches) - 1]))
        out = forward(arm.model.parameters, last.joints) - arm.cell.centers[last.disc]
        plan = Plan(last.disc, np.arctan2(out[:, 1], out[:, 0]), last.posture, np.ones(len(last)))
        try:
            return planner.accurate(_AHEAD, planner.approach(plan))
        except UnsupportedDataError:  # a hand gets where no planned way leads
            pass
    return planner.accurate(_AHEAD)

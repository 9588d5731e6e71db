"""The calibration that a node uses: of a file, and each result that the calibrator publishes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from time import time_ns
from typing import Any

from rclpy.node import Node
from std_msgs.msg import String

from scara_kinetostatic.errors import InputError, ParameterError, ScaraKinetostaticError
from scara_kinetostatic.files.calibration_file import load_calibration, parse_document, read_arm
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.monitoring.record import check_same_identification
from scara_kinetostatic.nodes import declare
from scara_kinetostatic.nodes.declare import cell_or_example
from scara_kinetostatic.nodes.diagnostics import ERROR, OK, WARN, Condition
from scara_kinetostatic.nodes.stream_subscription import LATCHED

RESULT = 'calibrator/result'


class FollowedCalibration:
    """Declares the parameters `calibration`, `follow`, `take_unfit` and `cell`, and follows the calibrator.

    Args:
        node: that uses the calibration.
        take: called with each calibration to use from now on; what it raises is said, and the former one stays.

    Attributes:
        cell: of the calibration that the node is started with, or of the parameter `cell`.
        arm: the calibration in use; None before the first.
        origin: where it comes from, in words.
        refused: why the last one was not taken; empty where it was.

    Raises:
        InputError: a parameter, the cell or the calibration is not valid.
    """

    def __init__(self, node: Node, take: Callable[[CalibratedArm], None]) -> None:
        self._logger, self._take, self._began = node.get_logger(), take, time_ns()
        self.arm: CalibratedArm | None = None
        self.origin, self.refused = 'none', ''
        self._path = declare.text(
            node, 'calibration', '', 'calibration.json or calibration.yaml; empty: from the calibrator'
        )
        follow = declare.switch(node, 'follow', True, 'take each result that the calibrator publishes')
        self._take_unfit = declare.switch(node, 'take_unfit', False, 'take a calibration that is unfit for use')
        self._given = load_calibration(declare.place('calibration', self._path)) if self._path else None
        if self._given is None:
            self.cell: Cell = cell_or_example(node)
        else:
            declare.text(node, 'cell', '', 'cell description; not used where a calibration is given')
            self.cell = self._given.cell
        if follow:
            node.create_subscription(String, RESULT, self._take_result, LATCHED)

    def start(self) -> None:
        """Takes the calibration that the node is started with, where there is one."""
        if self._given is None:
            self._logger.info('no calibration yet; waiting for the calibrator')
        else:
            self._use(self._given, self._path)

    def condition(self, found: Iterable[str], values: Mapping[str, str], good: str) -> Condition:
        """The status of the node: an error without a calibration, or where one was refused.

        Args:
            found: what is wrong else; empty texts are nothing.
            values: details by name.
            good: what is said where nothing is wrong.
        """
        values = {'calibration': self.origin, **values}
        known = () if self.arm is None else self.arm.reservations
        listed = tuple(dict.fromkeys(text for text in found if text and text not in known))
        if self.refused:
            return Condition(ERROR, '; '.join((f'calibration not taken: {self.refused}', *listed)), values)
        if self.arm is None:
            return Condition(ERROR, '; '.join(('no calibration yet', *listed)), values)
        grade = self.arm.grade or 'not assessed'
        graded = '' if grade in ('fit', 'unfit') else f'the calibration is {grade}'  # of unfit it is a reservation
        message = '; '.join(filter(None, (*listed, graded, *known)))
        return Condition(WARN if message else OK, message or f'{good}: {self.origin}', values)

    def _take_result(self, message: String, info: Mapping[str, Any]) -> None:
        """A result of the calibrator; not an older one than that of the start, published before it."""
        try:
            document = parse_document(message.data, RESULT)
            if isinstance(document, dict) and not document.get('published', True):
                return  # the calibrator keeps the former one, too
            arm, given = read_arm(document, RESULT), self._given
            is_latched = int(info.get('source_timestamp') or 0) < self._began
            if is_latched and given is not None and arm.created and arm.created < given.created:
                self._logger.info(f'{RESULT}: of {arm.created}, older than the calibration given; not taken')
                return
            self._use(arm, RESULT)
        except ScaraKinetostaticError as error:
            self._refuse(str(error))

    def _use(self, arm: CalibratedArm, origin: str) -> None:
        """Takes a calibration; one that may not be used is said."""
        try:
            self._check(arm, origin)
            self._take(arm)
        except ScaraKinetostaticError as error:
            self._refuse(str(error))
            return
        self.arm, self.refused = arm, ''
        self.origin = f'{origin}, {arm.grade or "not assessed"}, of {arm.created or "unknown date"}'
        self._logger.info(f'calibration in use: {self.origin}')

    def _check(self, arm: CalibratedArm, origin: str) -> None:
        """Check that a calibration may be used here.

        Raises:
            InputError: it is unfit for use, or of another robot or sensor.
        """
        if arm.grade == 'unfit' and not self._take_unfit:
            problem = 'the calibration is unfit for use'
            raise ParameterError(origin, problem, 'take_unfit:=true takes it all the same')
        own, other = self.cell, arm.cell
        if own.joint_names != other.joint_names or own.sensor[2:] != other.sensor[2:]:
            problem = f'is of another robot: joints {" ".join(other.joint_names)}, sensor {other.sensor.frame.value}'
            raise InputError('the calibration', problem, 'give that of this cell')
        check_same_identification(own, other, 'the cell in use', origin, 'give that of this cell')

    def _refuse(self, problem: str) -> None:
        self.refused = problem
        self._logger.error(f'calibration not taken: {problem}')

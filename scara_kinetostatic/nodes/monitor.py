"""Node `monitor`: holds every touch of production against the calibration and says when it has gone stale.

The touches are those that the collector judges, on `collector/touch`. The calibration is the file that the parameter
`calibration` names, then each newer result of the calibrator that is in its parameters. Touches that were
part of the calibration do not count, later ones of the same recording do; one that is discarded is taken back. The
state is on `/diagnostics` and, as JSON, on `~/drift`; `~/reset` begins anew.

`~/touch` does not say the load before a touch, and the time since the robot was switched on is not known: effects that
depend on them are taken as `Predictor.assumptions` says, and the node says so.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import String

from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.quantities import count
from scara_kinetostatic.monitoring.change import Measured
from scara_kinetostatic.monitoring.drift import DriftMonitor, SinceTouch, alarm_line, drift_document
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.nodes.cell_node import ERROR, OK, WARN, CellNode, Condition, FollowedCalibration, RefusedError
from scara_kinetostatic.nodes.conversion import stored_document, touch_of, touches_in
from scara_kinetostatic.nodes.streams import LATCHED, LATCHED_TOUCHES, forget_oldest
from scara_kinetostatic.report.page import Document


class Monitor(CellNode):
    """Watches for drift. One thread spins it.

    Raises:
        InputError: the calibration that the parameter names cannot be read.
        ParameterError: a parameter is not valid.
    """

    def __init__(self) -> None:
        super().__init__('monitor')
        self._monitor: DriftMonitor | None = None
        self._problem = self._assumptions = self._rejection = ''
        self._kept: dict[tuple[str, str], tuple[Measured, int]] = {}  # by recording and number, in time
        self._ignored = self._rejected = 0
        self._drift = self.create_publisher(String, '~/drift', LATCHED)
        self._calibration = FollowedCalibration(self, CalibrationRecord.load, _of_result, self._take)
        self.create_subscription(DiagnosticArray, 'collector/touch', self._note_touch, LATCHED_TOUCHES)
        self.serve('reset', self._reset)
        self.publish_status('drift', self._report)
        self._calibration.start()

    def _take(self, record: CalibrationRecord) -> None:
        """Begins anew with a calibration; latched messages come again."""
        if self._monitor is not None and self._monitor.record.created == record.created:
            return
        self._monitor = DriftMonitor(record)
        self._ignored, self._assumptions = 0, Predictor(record.arm).assumptions
        if self._assumptions:
            self.get_logger().warning(self._assumptions)
        self._forget()

    def _forget(self) -> None:
        self._kept, self._rejected, self._problem = {}, 0, ''
        self._tell()

    def _note_touch(self, message: DiagnosticArray) -> None:
        for key, values in touches_in(message):
            if values.get('accepted') == 'true':
                self._rejected = 0
                self._add(key, values)
            elif key in self._kept:
                self._take_back(key)
            elif values.get('discarded') != 'true':
                self._rejected, self._rejection = self._rejected + 1, values.get('reason', '')
        self._tell()

    def _add(self, key: tuple[str, str], values: Mapping[str, str]) -> None:
        """Counts a touch, unless it was part of the calibration or has been counted."""
        monitor = self._monitor
        if monitor is None or key in self._kept:
            return
        if was_seen(*key, monitor.record):
            self._ignored += 1
            return
        before = monitor.copy()
        try:
            int(key[1])
            touch = touch_of(values, monitor.record.arm)
            measured = monitor.measure(touch), int(touch.disc[0])
            alarm = monitor.add_measured(*measured)
        except (KeyError, ValueError, ArithmeticError, ScaraKinetostaticError) as error:  # LinAlgError is a ValueError
            self._monitor, self._problem = before, f'touch {key[1]} cannot be evaluated: {error}'
            self.get_logger().warning(self._problem)
            return
        self._problem = ''
        self._kept[key] = measured
        if alarm is not None and (before.alarm is None or alarm.best.name != before.alarm.best.name):
            self.get_logger().error(alarm_line(alarm, self._since(monitor)))
        forget_oldest(self._kept)

    def _take_back(self, key: tuple[str, str]) -> None:
        """Counts anew all touches that are kept but one, which was discarded."""
        assert self._monitor is not None
        del self._kept[key]
        self._monitor.reset()
        for number, measured in enumerate(self._kept.values(), 1):
            self._monitor.add_measured(*measured, named=number == len(self._kept))

    def _since(self, monitor: DriftMonitor) -> SinceTouch | None:
        """The touch since which an alarm says that the calibration does not hold; None where it is no longer kept."""
        place = -1 if monitor.alarm is None else monitor.alarm.since - (monitor.count - len(self._kept))
        return SinceTouch(*list(self._kept)[place]) if 0 <= place < len(self._kept) else None

    def _reset(self) -> str:
        if self._monitor is None:
            raise RefusedError(self._calibration.refused or 'no calibration yet')
        self._monitor.reset()
        self._forget()
        return 'touches count anew from here'

    def _report(self) -> Condition:
        monitor = self._monitor
        if monitor is None:
            refused = self._calibration.refused
            missing = 'no calibration yet: calibrate, or set the parameter calibration'
            return Condition(WARN, f'calibration not taken: {refused}' if refused else missing, {})
        values = {
            'calibration': monitor.record.source,
            'created': monitor.record.created,
            'touches': str(monitor.count),
            'touches of the calibration': str(self._ignored),
            'rejected touches in a row': str(self._rejected),
            'statistic': f'{monitor.statistic:.1f}',
            'threshold': f'{monitor.threshold:.1f}',
            'last touch [standard deviations]': f'{monitor.last_distance:.1f}',
        }
        complaints = list(self._complaints(monitor))
        if (alarm := monitor.alarm) is not None:
            values |= {'changed': alarm.best.name, 'rivals': ', '.join(alarm.rivals) or 'none'}
            values |= {'since touch': str(alarm.since)}
            return Condition(ERROR, '; '.join((alarm_line(alarm, self._since(monitor)), *complaints)), values)
        agree = f'{count(monitor.count, "touch agrees", "touches agree")} with the calibration'
        good = agree if monitor.count else 'no touch yet'
        return Condition(WARN if complaints else OK, '; '.join(complaints) or good, values)

    def _complaints(self, monitor: DriftMonitor) -> Iterator[str]:
        """Why nothing, or not all, is watched."""
        if not self.count_publishers('collector/touch'):
            yield f'nobody publishes {self.resolve_topic_name("collector/touch")}: no touch is watched'
        if monitor.record.arm.grade == 'unfit':
            yield 'the calibration is unfit for use'
        if monitor.threshold > 100:  # only large changes are seen
            yield 'the noise was estimated by too few touches: drift is hardly seen'
        if self._rejected >= 3:  # what drifted far is no longer recognised as a touch of an object
            yield f'the last {self._rejected} touches were rejected, the last one: {self._rejection}'
        if self._calibration.refused:
            yield f'calibration not taken: {self._calibration.refused}'
        yield from filter(None, (self._problem, self._assumptions))

    def _tell(self) -> None:
        """Publishes the state on `~/drift`."""
        if (monitor := self._monitor) is not None:
            document = drift_document(monitor, self._assumptions, monitor.alarm, self._since(monitor))
            self._drift.publish(String(data=json.dumps(document)))


def _of_result(said: Document) -> CalibrationRecord:
    """The calibration in the file that a result of the calibrator names."""
    return CalibrationRecord.of_document(stored_document(said), 'calibrator/result')


def was_seen(recording: str, number: str, record: CalibrationRecord) -> bool:
    """Whether a touch is one of those that a calibration was made of.

    Of a calibration by one recording that went on afterwards, the touches that it had found then; of one by several,
    all touches of these. A path that is not absolute is that of any folder whose path ends with it.
    """
    parts = Path(recording).parts
    places = [Path(path) for path in record.paths if path]
    if not any(recording == str(p) or (not p.is_absolute() and parts[-len(p.parts) :] == p.parts) for p in places):
        return False
    found = record.document['touches'].get('found')
    return len(places) > 1 or not isinstance(found, int) or not number.isdigit() or int(number) < found

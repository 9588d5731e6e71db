"""Node `monitor`: holds every touch of production against the calibration and says when it has gone stale.

The touches are those that the collector judges, on `collector/touch`. The calibration is the file that the parameter
`calibration` names and, with `follow`, each newer result of the calibrator that is in its parameters. Touches that were
part of the calibration do not count, later ones of the same recording do; one that is discarded is taken back. The
state is on `/diagnostics` and, as JSON, on `~/drift`; `~/reset` begins anew.

`~/touch` does not say the load before a touch, and the time since the robot was switched on is not known: effects that
depend on them are taken as `Predictor.assumptions` says, and the node says so.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from scara_kinetostatic.errors import InputError, ScaraKinetostaticError
from scara_kinetostatic.files.calibration_file import parse_document
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.monitoring.drift import Alarm, DriftMonitor, SinceTouch, alarm_line, drift_document
from scara_kinetostatic.monitoring.linear import Measured
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.nodes import declare
from scara_kinetostatic.nodes.diagnostics import ERROR, OK, WARN, Condition, DiagnosticsPublisher
from scara_kinetostatic.nodes.monitored_touch import touch_of, was_seen
from scara_kinetostatic.nodes.runtime import run
from scara_kinetostatic.nodes.stream_subscription import LATCHED, LATCHED_TOUCHES
from scara_kinetostatic.report.quantities import count
from scara_kinetostatic.results.document import NAME

TOUCHES = 'collector/touch'
MOST_TOUCHES = 500
"""So many touches are kept to take one back. Where it is not the last, all that are kept are counted anew."""
BLIND = 100.0
"""A threshold above which only changes by many standard uncertainties are seen."""
MOST_REJECTED = 3
"""So many rejected touches in a row are said: what drifted far is no longer recognised as a touch of an object."""


class _Key(NamedTuple):
    """A touch by its recording and number."""

    recording: str
    number: str


class _Kept(NamedTuple):
    """A touch that counts."""

    measured: Measured
    disc: int


class Monitor(Node):
    """Watches for drift. One thread spins it.

    Raises:
        InputError: the calibration that the parameter names cannot be read.
        ParameterError: a parameter is not valid.
    """

    def __init__(self) -> None:
        super().__init__('monitor')
        meaning = 'calibration.json to hold touches against; empty: wait for a result of the calibrator'
        named = declare.text(self, 'calibration', '', meaning)
        follow = declare.switch(self, 'follow', True, 'take each newer result that the calibrator publishes')
        self._monitor: DriftMonitor | None = None
        self._problem = '' if named else 'no calibration yet: calibrate, or set the parameter calibration'
        self._refused = self._assumptions = ''
        self._kept: dict[_Key, _Kept] = {}
        self._forgotten: dict[str, int] = {}
        self._before_last: tuple[_Key, DriftMonitor] | None = None
        self._ignored = self._rejected = 0
        self._rejection = ''
        self._alarm: Alarm | None = None
        self._drift = self.create_publisher(String, '~/drift', LATCHED)
        if named:
            self._take(CalibrationRecord.load(declare.place('calibration', named)))
        if follow or not named:
            self.create_subscription(String, 'calibrator/result', self._note_result, LATCHED)
        self.create_subscription(DiagnosticArray, TOUCHES, self._note_touch, LATCHED_TOUCHES)
        self.create_service(Trigger, '~/reset', self._reset)
        DiagnosticsPublisher(self, 'drift', self._report)

    def close(self) -> None:
        """Nothing is open."""

    def _take(self, record: CalibrationRecord) -> None:
        """Begins anew with a calibration."""
        self._monitor, self._problem, self._refused = DriftMonitor(record), '', ''
        self._forget()
        self._ignored, self._assumptions = 0, Predictor(record.arm).assumptions
        if self._assumptions:
            self.get_logger().warning(self._assumptions)
        self.get_logger().info(f'holding touches against {record.source}, calibrated {record.created}')
        self._tell()

    def _forget(self) -> None:
        self._kept, self._forgotten, self._before_last, self._alarm = {}, {}, None, None
        self._rejected = 0

    def _note_result(self, message: String) -> None:
        """Takes a newer result of the calibrator; one that was not published leaves the former one."""
        try:
            said = parse_document(message.data, 'calibrator/result')
            if not said.get('published', True) or not self._is_newer(str(said['created'])):
                return
            folder = str(said['files']['folder'])
            if not folder:
                raise InputError('calibrator/result', 'the files of the result could not be written')
            record = CalibrationRecord.load(Path(folder) / NAME)
            if record.created != said['created']:
                raise InputError(record.source, f'is of another result, {record.created}')
            self._take(record)
        except (ValueError, LookupError, TypeError, AttributeError, ScaraKinetostaticError) as error:
            self._refused = f'the result of the calibrator cannot be used: {error}'
            self.get_logger().warning(self._refused)

    def _is_newer(self, created: str) -> bool:
        """Whether a result is newer than the calibration in use: latched messages come again."""
        return self._monitor is None or created > self._monitor.record.created

    def _note_touch(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            key = _Key(values.get('recording', ''), values.get('touch', ''))
            if values.get('accepted') == 'true':
                self._rejected = 0
                self._add(key, values)
            elif values.get('discarded') != 'true':
                self._rejected, self._rejection = self._rejected + 1, values.get('reason', '')
            if values.get('accepted') != 'true' and key in self._kept:
                del self._kept[key]
                self._take_back(key)
        self._tell()

    def _add(self, key: _Key, values: Mapping[str, str]) -> None:
        """Counts a touch, unless it was part of the calibration or has been counted."""
        monitor = self._monitor
        if monitor is None or key in self._kept or self._is_forgotten(key):
            return
        if was_seen(key.recording, key.number, monitor.record):
            self._ignored += 1
            return
        before = monitor.copy()
        try:
            int(key.number)
            touch = touch_of(values, monitor.record)
            kept = _Kept(monitor.measure(touch), int(touch.disc[0]))
            alarm = monitor.add_measured(*kept)
        except (KeyError, ValueError, ArithmeticError, ScaraKinetostaticError) as error:  # LinAlgError is a ValueError
            self._monitor, self._problem = before, f'touch {key.number} cannot be evaluated: {error}'
            self.get_logger().warning(self._problem)
            return
        self._problem = ''
        self._before_last = key, before
        self._kept[key] = kept
        if alarm is not None and self._alarm is None:
            self.get_logger().error(alarm_line(alarm, self._since(alarm)))
        self._alarm = alarm
        while len(self._kept) > MOST_TOUCHES:
            oldest = next(iter(self._kept))
            del self._kept[oldest]
            self._forgotten[oldest.recording] = max(int(oldest.number), self._forgotten.get(oldest.recording, -1))

    def _is_forgotten(self, key: _Key) -> bool:
        """Whether a touch has been counted and is no longer kept: latched messages may come again."""
        return key.number.isdigit() and int(key.number) <= self._forgotten.get(key.recording, -1)

    def _since(self, alarm: Alarm) -> SinceTouch | None:
        """The touch since which an alarm says that the calibration does not hold; None where it is no longer kept."""
        assert self._monitor is not None
        place = alarm.since - (self._monitor.count - len(self._kept))
        return SinceTouch(*list(self._kept)[place]) if 0 <= place < len(self._kept) else None

    def _take_back(self, key: _Key) -> None:
        """The last touch as if it had not been; for an earlier one all that are kept are counted again."""
        if self._before_last is not None and self._before_last[0] == key:
            self._monitor = self._before_last[1]
            self._alarm = self._monitor.alarm
        elif self._monitor is not None:
            self._monitor.reset()
            self._alarm = None
            latest = len(self._kept) - 1
            for number, kept in enumerate(self._kept.values()):
                self._alarm = self._monitor.add_measured(*kept, named=number == latest)
        self._before_last = None

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._monitor is None:
            response.message = self._refused or self._problem
            return response
        self._monitor.reset()
        self._forget()
        self._problem = ''
        response.success, response.message = True, 'touches count anew from here'
        self._tell()
        return response

    def _report(self) -> Condition:
        monitor = self._monitor
        if monitor is None:
            return Condition(WARN, self._refused or self._problem, {})
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
        complaints = list(self._complaints(monitor.record))
        if self._alarm is not None:
            a = self._alarm
            values |= {'changed': a.best.name, 'rivals': ', '.join(a.rivals) or 'none', 'since touch': str(a.since)}
            return Condition(ERROR, '; '.join((alarm_line(a, self._since(a)), *complaints)), values)
        if complaints:
            return Condition(WARN, '; '.join(complaints), values)
        agree = f'{count(monitor.count, "touch agrees", "touches agree")} with the calibration'
        good = agree if monitor.count else 'no touch yet'
        return Condition(OK, good, values)

    def _complaints(self, record: CalibrationRecord) -> Iterator[str]:
        """Why nothing, or not all, is watched."""
        if not self.count_publishers(TOUCHES):
            yield f'nobody publishes {self.resolve_topic_name(TOUCHES)}: no touch is watched'
        if record.arm.grade == 'unfit':
            yield 'the calibration is unfit for use'
        if self._monitor is not None and self._monitor.threshold > BLIND:
            yield 'the noise was estimated by too few touches: drift is hardly seen'
        if self._rejected >= MOST_REJECTED:
            yield f'the last {self._rejected} touches were rejected, the last one: {self._rejection}'
        yield from filter(None, (self._refused, self._problem, self._assumptions))

    def _tell(self) -> None:
        """Publishes the state on `~/drift`."""
        monitor = self._monitor
        if monitor is None:
            return
        since = None if self._alarm is None else self._since(self._alarm)
        document = drift_document(monitor, self._assumptions, self._alarm, since)
        self._drift.publish(String(data=json.dumps(document)))


def main(args: Sequence[str] | None = None) -> int:
    """Runs the node; see `runtime.run` for the exit status."""
    return run(Monitor, args)


if __name__ == '__main__':
    sys.exit(main())

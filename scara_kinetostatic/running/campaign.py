"""What to touch next in a run, and when it is enough.

The first touches are planned from the nominal model. After `FIRST` accepted ones, and after each further one, the
touches are calibrated, while the robot makes those planned before; when they are made, the next few are planned. A
place where touches fail is given up.

Where the cause of a model error is not decided, the touches that decide are made first, as long as they are worth it.
The run goes on while what is predicted over the possible causes, by their probabilities, promises the tolerance; else
it ends as undecided, with what decides.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.errors import ScaraKinetostaticError, UnsupportedDataError
from scara_kinetostatic.files.calibration_file import nominal_arm
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.kinematics import forward, posture
from scara_kinetostatic.model.parameters import MICRO, MILLI, NANO
from scara_kinetostatic.model.quantities import quantity
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.planning.motion import Waypoints
from scara_kinetostatic.planning.next_touches import PlannedTouches, Planner
from scara_kinetostatic.simulation.plan import LIMIT_MARGIN, ROUNDING, Plan, reach
from scara_kinetostatic.touches.detection import Detection

FIRST = 9
"""Accepted touches after which the first calibration is made."""
_FEW = 4
"""Touches that are planned at a time from then on."""
_TRIES = 3
"""Failed touches after which a place is given up."""
_MOST_FAILED = 9
"""Failed touches in a row, or three times as many altogether, after which the whole run is given up."""
_TO_DECIDE = 12
"""Touches that are made at most to decide between effects."""
_WELL_KNOWN = 2 * MILLI
"""Expanded uncertainty of the tip above which the motions stay those of the former arm, at first the nominal one, m."""
_STALLED, _PROGRESS = 12, 0.95
"""Touches are not the limit where so many of them left more than this part of the uncertainty of the tip."""

Worker = Callable[..., 'Future[Any]']
"""Calls a function with arguments aside, as `Executor.submit` does; in another process where it may."""


class Target(NamedTuple):
    """A touch to make.

    Attributes:
        plan: the touch, of length 1.
        reason: why.
        attempts: how often it was tried.
    """

    plan: Plan
    reason: str
    attempts: int = 0

    def place(self) -> tuple[int, float, int]:
        """Disc, direction, posture."""
        return int(self.plan.disc[0]), float(self.plan.angle[0]), int(self.plan.posture[0])


class Knowledge(NamedTuple):
    """What the touches so far tell.

    Attributes:
        planner: of the next touches.
        planned: the next touches.
        now: largest expanded uncertainty of the tip, m; None where there is no calibration.
        grade: of the calibration; empty where there is none.
        text: what it says, or why there is none.
        verdict: of the diagnosis, with the effects found.
        discriminating: whether the next touches decide between effects.
        is_unexplained: whether a model error is left.
        undecided: possible causes with their probabilities, and what tells them apart; empty where there are none.
    """

    planner: Planner
    planned: PlannedTouches
    now: float | None = None
    grade: str = ''
    text: str = ''
    verdict: str = ''
    discriminating: bool = False
    is_unexplained: bool = False
    undecided: str = ''


class End(NamedTuple):
    """Why the run ends.

    Attributes:
        status: 0 tolerance reached, or nothing more to gain and the result may be used, 1 given up.
        reason: one sentence.
        is_reached: whether it is the tolerance.
    """

    status: int
    reason: str
    is_reached: bool = False


class Campaign:
    """Chooses the touches.

    Args:
        cell: the cell.
        most: accepted touches after which the run ends.
        planner: to begin with; None for the nominal arm.
        work: does the calibrations.

    Attributes:
        accepted: number of the touches that were accepted.
        failed: of those that were not.
        touches: those accepted, a set for each contact.
        knowledge: what is known.

    Raises:
        UnsupportedDataError: no touch can be reached, or the tolerance is out of reach.
        CellError: the cell has no limits of the joints.
    """

    def __init__(self, cell: Cell, most: int, planner: Planner | None, work: Worker) -> None:
        self.cell, self._most, self._work = cell, most, work
        planner = planner or Planner(nominal_arm(cell))
        self.knowledge = Knowledge(planner, planner.accurate(FIRST), planner.now)
        planned = self.knowledge.planned
        if cell.tolerance is not None and (limit := planned.uncertainty.beyond(cell.tolerance)):
            raise UnsupportedDataError(limit, 'reduce that, or allow a larger tolerance')
        self._targets = _targets(planned)
        self.touches: list[TouchSet] = []
        self._given_up: tuple[tuple[int, float, int], ...] = ()
        self._job: Future[Any] | None = None
        self._is_due = self._waits = False
        self._in_row = self._made_to_decide = self.accepted = self.failed = 0
        self._start, self._past = 0, list[tuple[int, float]]()

    def accept(self, detection: Detection) -> None:
        """Takes the touches of a detection, at least one of them accepted."""
        touches = detection.touches
        self._start = self._start or detection.start
        self.touches.append(touches.replace(time=touches.time + NANO * (detection.start - self._start)))
        self.accepted += len(touches)
        self._in_row = 0
        self._made_to_decide += self.knowledge.discriminating
        if self.accepted >= FIRST:
            self._order()

    def reject(self, target: Target) -> str:
        """A touch that failed: again, or its place is given up; returns which."""
        self.failed += 1
        self._in_row += 1
        attempts = target.attempts + 1
        if attempts >= _TRIES:
            self._given_up = (*self._given_up, target.place())
            return f'{self.name(target)} is given up'
        self._targets.insert(0, target._replace(attempts=attempts))
        return 'again'

    def name(self, target: Target) -> str:
        """Of a touch, in words."""
        return target.plan.titles(self.cell)[0]

    def _order(self) -> None:
        """Orders a calibration of all touches, when the former one is done."""
        self._is_due = self._job is not None
        if self._is_due:
            return
        touches = TouchSet.concatenate(self.touches)
        former = replace(self.knowledge.planner)  # without what it has worked out: that is large
        decides = self._made_to_decide < _TO_DECIDE
        self._job = self._work(calibrated, self.cell, touches, former, self._given_up, decides)

    def poll(self) -> End | None:
        """Takes what has been found out; returns why the run ends, where it does."""
        if self._job is not None and self._job.done():
            job, self._job = self._job, None
            try:
                self.knowledge = job.result()
            except ScaraKinetostaticError as error:
                return End(1, str(error))
            # the nearest touch comes first: with a new plan after each touch, the farther ones would never be made
            if self.knowledge.discriminating or not self._targets:
                again = [target for target in self._targets if target.attempts]
                self._targets = again + _targets(self.knowledge.planned)
            end = self._enough()
            self._waits = self._is_due and end is not None and end.is_reached
            if end is not None and not self._waits:
                return end
            if self._is_due:
                self._order()
        if self._in_row >= _MOST_FAILED or self.failed >= 3 * _MOST_FAILED:
            return End(1, f'{self.failed} touches failed, {self._in_row} of them in a row')
        if self.accepted >= self._most and self._job is None:
            return self._most_made()
        return None

    def _most_made(self) -> End:
        now, tolerance = self.knowledge.now, self.cell.tolerance
        found = 'no calibration' if now is None else f'an expanded uncertainty of the tip of {length(now)}'
        wanted = '' if tolerance is None else f', the tolerance is {length(tolerance)}'
        text = f'; {self.knowledge.text}' if self.knowledge.text else ''
        status = 0 if tolerance is None and now is not None and self.knowledge.grade != 'unfit' else 1
        return End(status, f'{self.accepted} touches (max_touches) give {found}{wanted}{text}')

    def _enough(self) -> End | None:
        """Whether more touches are not needed, or of no use."""
        found, tolerance = self.knowledge, self.cell.tolerance
        if tolerance is None or found.now is None or found.discriminating:
            return None
        if found.now <= tolerance and found.grade != 'unfit':
            reached = f'the expanded uncertainty of the tip is {length(found.now)}, the tolerance {length(tolerance)}'
            return End(0, f'enough: {reached}; {found.verdict}', is_reached=True)
        self._past.append((self.accepted, found.now))
        best = min(now for _, now in self._past)
        limit = found.planned.uncertainty.beyond(tolerance)
        before = [now for accepted, now in self._past if accepted <= self.accepted - _STALLED]
        stalled = bool(before) and np.inf > best > _PROGRESS * min(before)
        if found.now > tolerance and found.is_unexplained:
            limit = (
                f'{_STALLED} of them left the expanded uncertainty of the tip at {length(best)}, the tolerance '
                f'is {length(tolerance)}: a model error has no known cause; {found.verdict}'
            )
        if limit and stalled:
            what = f'undecided: {found.undecided}' if found.undecided else f'touches are not the limit: {limit}'
            return End(int(found.grade == 'unfit'), what)
        return None

    def choose(self, joints: Floats, interrupted: Target | None = None) -> tuple[Target, Waypoints] | End | None:
        """The touch to make next and the way to where it begins; None while nothing is planned.

        Args:
            joints: where the robot stands, (2,), rad.
            interrupted: the touch to make, where there is one.
        """
        if self.accepted >= self._most or (self._waits and self._job is not None):
            return None  # the last calibration is being made, or one of a touch more than those that were enough
        if interrupted is not None:
            self._targets.insert(0, interrupted)
        if not self._targets:
            if self._job is None and self.accepted >= FIRST:
                self._order()
            elif self._job is None:
                planner = replace(self.knowledge.planner, given_up=self._given_up)
                planned = planner.accurate(FIRST - self.accepted)
                self.knowledge = self.knowledge._replace(planner=planner, planned=planned)
                self._targets = _targets(planned)
            return None
        planner = self.knowledge.planner
        start, problem = clear_start(planner, joints)
        if start is None:
            return End(1, problem)
        tries = [interrupted] if interrupted else [each for each in self._targets if each.attempts] or self._targets
        stops = [planner.approach(target.plan) for target in tries]
        every = Waypoints(
            np.concatenate([start.tip[-1:], *(stop.tip for stop in stops)]),
            np.concatenate([start.posture[-1:], *(stop.posture for stop in stops)]),
        )
        ways = planner.roadmap.ways(every)
        lengths = ways.lengths[0, 1:]
        nearest = int(np.argmin(lengths))
        if not np.isfinite(lengths[nearest]):
            if interrupted is None and not self.accepted and not tries[0].attempts:
                x, y = start.tip[0]
                return End(1, f'no way leads from ({x:.3f}, {y:.3f}) m, where the tip is, to the touches: move it')
            self._targets = [target for target in self._targets if target not in tries]
            self._given_up = (*self._given_up, *(target.place() for target in tries))
            self.failed += len(tries)
            return None
        chosen = tries[nearest]
        self._targets = [target for target in self._targets if target is not chosen]
        way = ways.way(0, nearest + 1)
        return chosen, Waypoints(np.concatenate([start.tip, way.tip]), np.concatenate([start.posture, way.posture]))


def clear_start(planner: Planner, joints: Floats) -> tuple[Waypoints | None, str]:
    """Where a way begins from where the robot stands: its first place is reached with both joints in proportion.

    Where a run has brought it, it can go on: from the edge of the limits, from the stretched arm, as on the way to the
    other elbow, and from the folded one; from an object that is nearer than the clearance the tip is moved away first.

    Args:
        planner: with the objects.
        joints: where the robot stands, (2,), rad.

    Returns:
        The beginning, one or two places, and an empty text; or None, and why there is none.
    """
    space, cell, parameters = planner.space, planner.arm.cell, planner.arm.model.parameters
    low, high = space.limits
    begin = np.clip(joints, low + ROUNDING, high - ROUNDING)
    if (off := np.abs(begin - joints) > LIMIT_MARGIN + ROUNDING).any():
        name = cell.joint_names[int(off.argmax())]
        return None, f'{name} stands beyond robot.limits, or more than half a turn from their middle: move it'
    tip, own = forward(parameters, begin)[None], posture(parameters, begin[None])
    ray, (inner, outer) = tip - (parameters.x0, parameters.y0), reach(parameters)
    radius = max(float(np.hypot(*ray[0])), ROUNDING)
    place = tip + (np.clip(radius, inner + MICRO, outer - MICRO) / radius - 1) * ray
    part, raised = np.linspace(0.0, 1.0, 21)[:, None], cell.lift is not None
    for here in [Waypoints(place, side) for side in (own, -own)][: 2 if radius > outer else 1]:
        path = forward(parameters, joints + part * (space.joints(here)[0] - joints))
        near = space.edges.distance(path, path)
        away = (near >= np.clip(near[0], 0.0, space.clearance) - ROUNDING).all() and not space.is_inside(path).any()
        if not space.beyond_limits(here).any() and (raised or away):
            break
    else:
        k = int(np.argmin(near[0]))
        owner = int(space.edges.owner[k])
        nearest = f'{near[0, k] / MILLI:.0f} mm from {"an obstacle" if owner < 0 else cell.discs[owner].name}'
        return None, f'the tip stands too near to an object or the end of its reach ({nearest}): move it away'
    k = int(np.argmin(near[-1]))
    if raised or near[-1, k] >= space.clearance:
        return here, ''
    beside = place + MICRO * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    slopes = space.edges.distance(beside, beside)[:, k]
    out = place + (space.clearance + MILLI - near[-1, k]) * (slopes[:2] - slopes[2:]) / (2 * MICRO)
    both = Waypoints(np.concatenate([place, out]), np.concatenate([here.posture] * 2))
    return both if space.may_move(here, out)[0] else here, ''


def calibrated(
    cell: Cell, touches: TouchSet, former: Planner, given_up: tuple[tuple[int, float, int], ...], decides: bool
) -> Knowledge:
    """Calibrates touches, and plans the next ones.

    Args:
        cell: the cell.
        touches: all that were accepted.
        former: whose arm stays that of the motions where the calibration does not tell where the tip is.
        given_up: places not to be touched.
        decides: whether effects that are not distinguished are to be decided.

    Raises:
        UnsupportedDataError: no touch can be reached.
    """
    try:
        outcome = calibrate_touches(touches, cell)
    except ScaraKinetostaticError as error:
        planner = replace(former, touches=touches, given_up=given_up)
        return Knowledge(planner, planner.accurate(_FEW), text=str(error))
    planner = Planner.of_outcome(outcome, given_up)
    now, grade, found = planner.now, outcome.assessment.grade.value, outcome.diagnosis
    effects = ', '.join(item.effect.label for item in found.found)
    verdict = f'verdict {outcome.verdict}' + (f': {effects}' if effects else '')
    text = outcome.assessment.reasons[0] if grade == 'unfit' and outcome.assessment.reasons else ''
    if now is None or now > _WELL_KNOWN:
        known = planner
        planner = replace(
            former, touches=known.touches, suspected=known.suspected, rivals=known.rivals, given_up=given_up
        )
    unexplained, decision = outcome.verdict == 'unexplained', None
    if outcome.diagnosis.is_undecided and now is not None and now < np.inf:
        decision = planner.decision()
    outlook = decision.outlook if decision else None
    undecided = f'{outlook.causes}; {outlook.action}' if outlook else ''
    is_worth = decides and outlook is not None and outlook.is_decisive
    planned = planner.discriminating(decision, _FEW) if decision and is_worth else planner.accurate(_FEW)
    return Knowledge(planner, planned, now, grade, text, verdict, is_worth, unexplained, undecided)


def _targets(planned: PlannedTouches) -> list[Target]:
    return [Target(planned.plan.select(np.array([k])), reason) for k, reason in enumerate(planned.reasons)]


def length(value: float) -> str:
    """A length, m, in words."""
    return 'not determined' if np.isinf(value) else quantity(value, 'm')

"""Node `contact_simulator`: simulates the robot, the discs and the force sensor of a cell.

The streams of a whole plan, of touches or of slides along objects, are computed beforehand and published by a timer.
Header stamps are in simulated time, which begins at the wall time of the start
and runs `time_factor` times as fast; what a recording holds does not depend on
that factor. Publishes the topics named in the cell description and, latched,
`~/finished` (`std_msgs/Bool`); with `publish_clock` the simulated time on `/clock`.

With `commanded` there is no plan: the robot obeys `joint_trajectory`, see `simulation.commanded`. A trajectory begins
when it arrives; one whose stamp says that it has ended is refused. The parameters `scaling` and `active` are those of
the controller. `~/reset` lets drives that an overload has stopped move again; `sensor.zero_service`, where the cell
names one, sets the force to zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from time import monotonic

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from trajectory_msgs.msg import JointTrajectory

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.files.urdf import TOOL_FRAME
from scara_kinetostatic.model.cell import Noise, SensorFrame
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import NANO
from scara_kinetostatic.nodes import conversion
from scara_kinetostatic.nodes.cell_node import CellNode
from scara_kinetostatic.nodes.streams import LATCHED, QUEUE, RELIABLE_STREAM
from scara_kinetostatic.simulation.commanded import Body, Malfunction, ModelBody, Plant, PlantSettings
from scara_kinetostatic.simulation.mujoco import scene_named
from scara_kinetostatic.simulation.mujoco.engine import EngineBody
from scara_kinetostatic.simulation.plan import Plan, Slide, default_plan, load_plan
from scara_kinetostatic.simulation.streams import TYPICAL_NOISE, SensorModel, simulate_streams
from scara_kinetostatic.simulation.truth import deviating_robot, parse_effect, with_effects
from scara_kinetostatic.touches.clock import SECOND
from scara_kinetostatic.touches.streams import Streams


class Commanded:
    """A commanded robot in the place of a `Playback`, without end.

    Args:
        plant: drives and sensors.
        rates: of joint states and wrenches, Hz.

    Attributes:
        plant: as given.
        start: added to every stamp, ns.
    """

    finished = False

    def __init__(self, plant: Plant, rates: tuple[float, float]) -> None:
        self.plant, self.start, self._rates, self._counts = plant, 0, rates, [0, 0]

    def advance(self, elapsed: float) -> Iterator[tuple[bool, Sequence[float]]]:
        """As `Playback.advance`; of joint states all positions."""
        while True:
            due = [count / rate for count, rate in zip(self._counts, self._rates, strict=True)]
            if min(due) > elapsed:
                return
            reading = self.plant.step(min(due))
            stamp = self.start + round(SECOND * reading.time)
            for number, values in enumerate((reading.joints, reading.force)):
                if due[number] <= min(due) + NANO:
                    self._counts[number] += 1
                    if values is not None:
                        yield number == 1, (stamp, *values)


class Playback:
    """Both streams in the order of their stamps.

    Args:
        streams: stamped from 0, ns.
        start: added to every stamp, ns.

    Attributes:
        start: as given; may be changed before the first message is returned.
    """

    def __init__(self, streams: Streams, start: int) -> None:
        stamps = np.concatenate([streams.joints.stamp, streams.wrench.stamp])
        order = np.argsort(stamps, kind='stable')
        self._stamp = stamps[order]
        self._values = np.concatenate([streams.joints.position, streams.wrench.force])[order]
        self._is_wrench = order >= len(streams.joints.stamp)
        self._next = 0
        self.start = start

    @property
    def finished(self) -> bool:
        """Whether every message has been returned."""
        return self._next == len(self._stamp)

    @property
    def end(self) -> int:
        """Stamp of the last message, ns."""
        return self.start + int(self._stamp[-1])

    def advance(self, elapsed: float) -> Iterator[tuple[bool, Sequence[float]]]:
        """The messages that became due since the last call.

        Args:
            elapsed: simulated time since the start, s.

        Yields:
            Whether it is a wrench, else joint angles; its stamp and its numbers.
        """
        first = self._next
        self._next = max(first, int(np.searchsorted(self._stamp, round(SECOND * elapsed), side='right')))
        for row in range(first, self._next):
            stamp = self.start + int(self._stamp[row])
            yield bool(self._is_wrench[row]), (stamp, *self._values[row].tolist())


class ContactSimulator(CellNode):
    """Publishes a plan of touches or slides, once or repeatedly; or obeys.

    Raises:
        InputError: a parameter, the cell or the plan is not valid.
        UnsupportedDataError: the simulated robot cannot reach a touch, or hold its force.
    """

    def __init__(self) -> None:
        super().__init__('contact_simulator')
        self._cell = self.cell_or_example()
        self._plan = self._declared_plan()
        self._truth = self._declared_truth()
        self._sensors = self._declared_sensors()
        sensor = self._cell.sensor
        self._joints = self.create_publisher(JointState, sensor.joint_states, RELIABLE_STREAM)
        self._wrench = self.create_publisher(WrenchStamped, sensor.wrench, RELIABLE_STREAM)
        self._finished = self.create_publisher(Bool, '~/finished', LATCHED)
        self._finished.publish(Bool(data=False))
        self._time_of_cell = self.create_publisher(Clock, '/clock', QUEUE) if self.value('publish_clock') else None
        plane, self._axes = self._cell.plane, self._cell.force_axes
        mount = plane.tip or TOOL_FRAME if sensor.frame is SensorFrame.TOOL else plane.frame
        self._frame_id = self.value('frame_prefix') + (self.value('sensor_link') or mount)
        self._stopped = ''
        others = self._cell.positions
        self._passes, self._names, self._others = 0, (*self._cell.joint_names, *others), tuple(others.values())
        self._playback: Playback | Commanded = self._obey() if self._plan is None else self._simulate()
        self._elapsed = 0.0
        self._ready_since: float | None = None
        self._last_tick: float | None = None
        self._timer = self.create_timer(0.01 if self._plan is not None else 0.002, self._tick)
        if self._plan is not None:
            kind = 'slides' if isinstance(self._plan, tuple) else 'touches'
            self.get_logger().info(f'{len(self._plan)} {kind} planned')

    def _declared_plan(self) -> Plan | tuple[Slide, ...] | None:
        """The touches, or the slides along objects; None for a robot that is commanded.

        Raises:
            InputError: the plan cannot be read.
        """
        file = self.value('plan')
        if not self.value('commanded'):
            return load_plan(file, self._cell) if file else default_plan(self._cell)
        if file:
            raise ParameterError('parameter commanded', 'a commanded robot has no plan', 'leave out plan')
        return None

    def _declared_truth(self) -> ExtendedModel:
        """The simulated robot with its effects; by default it deviates from the nominal one as in table 2.

        Raises:
            ParameterError: an effect is not valid.
        """
        nominal = self._cell.nominal
        truth = deviating_robot(nominal).as_dict().items()
        values = [self.declare(f'truth.{name}', default) for name, default in truth]
        effects = [parse_effect(text, self._cell) for text in self.value('effects')]
        return with_effects(nominal.with_array(values), effects)

    def _declared_sensors(self) -> SensorModel:
        """Noise, bias and rates of the sensors."""
        noise = self._cell.noise or TYPICAL_NOISE
        usual = noise.joint_rms, noise.force_rms
        levels = self.declare('noise.joint', usual[0]), self.declare('noise.force', usual[1])
        noise = noise if levels == usual else Noise(*levels, noise.force_relative)
        samples = 'noise.joint_sample', 'noise.force_sample', 'bias.x', 'bias.y'
        joint_noise, force_noise, *bias = map(self.value, samples)
        rates = {name: self.value(name) for name in ('joint_rate', 'wrench_rate')}
        return SensorModel(noise, joint_noise, force_noise, (bias[0], bias[1]), **rates)

    def _obey(self) -> Commanded:
        """A robot that is commanded, by the model or in MuJoCo."""
        body: Body = ModelBody(self._cell, self._truth)
        if scene := self.value('scene'):
            if self._truth.effects:
                raise ParameterError('parameter effects', 'a scene has its own', 'leave out scene or effects')
            body = EngineBody(replace(scene_named(scene), parameters=self._truth.parameters), self._cell)
        drives = PlantSettings(self.value('lag'), self.value('speed_limit'), overload=self.value('overload'))
        plant = Plant(self._cell, body, settings=drives, sensors=self._sensors, seed=self.value('seed'))
        self._names, self._others = plant.names, ()

        def take(message: JointTrajectory) -> None:
            try:
                times, *points = conversion.trajectory_points(message)
                begins = NANO * conversion.nanoseconds_of(message.header.stamp)
                ends = begins + max(times, default=0.0)
                if begins and ends < (now := NANO * self.now()):
                    raise ParameterError('trajectory refused', f'it ended {now - ends:.1f} s ago', 'stamp it with 0')
                plant.command(message.joint_names, times, *points)
            except ParameterError as error:
                self.get_logger().warning(str(error))

        if service := self._cell.sensor.zero_service:
            self.serve(self.resolve_service_name(service), plant.zero, 'the force is zero')
        self.create_subscription(JointTrajectory, 'joint_trajectory', take, QUEUE)
        self.serve('reset', plant.reset, 'the drives are on')
        self.get_logger().info(f'obeys {self.resolve_topic_name("joint_trajectory")}: {" ".join(plant.names)}')
        return Commanded(plant, (self._sensors.joint_rate, self._sensors.wrench_rate))

    def _simulate(self, start: int = 0) -> Playback:
        """The next pass through the plan, with noise of its own, from relaxed joints."""
        assert self._plan is not None
        seed = self.value('seed') + self._passes
        streams = simulate_streams(self._cell, self._truth, self._plan, sensors=self._sensors, seed=seed, start=0)
        self._passes += 1
        read = replace(streams.joints, position=self._cell.readings(streams.joints.position))
        return Playback(replace(streams, joints=read), start)

    def _tick(self) -> None:
        if self._last_tick is None:
            self._start_if_ready()
            return
        now = monotonic()
        factor = self.value('time_factor')
        passed = min(now - self._last_tick, 0.05) * factor  # a slow machine slows it down: no bursts
        self._elapsed += passed if self._plan is not None else min(passed, 0.02)  # what commands it has to react
        self._last_tick = now
        if isinstance(self._playback, Commanded):
            self._set_fault(self._playback.plant)
        else:
            self._publish_clock()
        for is_wrench, sample in self._playback.advance(self._elapsed):
            if is_wrench:
                force = np.array(sample[1:]) @ self._axes
                self._wrench.publish(conversion.wrench((sample[0], *force), self._frame_id))
            else:
                self._joints.publish(conversion.joint_state((*sample, *self._others), self._names))
        if isinstance(self._playback, Commanded):  # no sample comes late that this machine was slow to work out
            self._publish_clock()
        if self._playback.finished:
            self._end_pass()

    def _publish_clock(self) -> None:
        if self._time_of_cell is not None:
            stamp = conversion.stamp_of(self._playback.start + round(SECOND * self._elapsed))
            self._time_of_cell.publish(Clock(clock=stamp))

    def _set_fault(self, plant: Plant) -> None:
        """The fault as the parameter has it now; says an overload once."""
        plant.fault = Malfunction(self.value('fault'))
        plant.scaling = self.value('scaling')
        plant.active = self.value('active')
        if plant.stopped != self._stopped:
            self._stopped = plant.stopped
            if plant.stopped:
                self.get_logger().error(f'the drives have stopped: {plant.stopped}; call ~/reset')

    def _start_if_ready(self) -> None:
        heard_by = min(self._joints.get_subscription_count(), self._wrench.get_subscription_count())
        if heard_by < self.value('wait_for_subscribers'):
            self._ready_since = None
            return
        now = monotonic()
        self._ready_since = self._ready_since or now
        if now - self._ready_since >= 0.5:  # the subscriber has then discovered both publishers
            self._playback.start = self.now()
            self._last_tick = now
            self.get_logger().info('the simulation starts')

    def _end_pass(self) -> None:
        assert isinstance(self._playback, Playback)
        if self.value('loop'):
            self._playback = self._simulate(self._playback.end + SECOND)  # after a pause of 1 simulated s
            self._elapsed = -1.0
            return
        self._timer.cancel()
        self._finished.publish(Bool(data=True))
        self.get_logger().info('the plan is finished')

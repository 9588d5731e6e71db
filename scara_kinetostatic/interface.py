"""The functions of the Python interface, ``import scara_kinetostatic as sk``: plain NumPy arrays in and out.

Joint angles, forces and places are arrays (n, 2), one row per touch or pose; one pair alone is taken as n = 1. Forces
are those of the robot on the object. Joint angles are Q of the model; `Cell.angles` and `Cell.readings` convert what
the robot reports where its joints are coupled. All SI units.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.calibration.fit_point import base_force, force_residual
from scara_kinetostatic.calibration.noise import USUAL_NOISE
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.contour.trace import trace_contour as contour_of
from scara_kinetostatic.errors import InputError, ParameterError, did_you_mean, expect
from scara_kinetostatic.files.tables import is_touch_table
from scara_kinetostatic.model.arm import CalibratedArm, JointAngles, Predictor, TipPosition
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.extended_model import TouchMetadata
from scara_kinetostatic.model.kinematics import posture
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch import LATER, TouchSet, order_of_time
from scara_kinetostatic.pipeline import calibrate_recordings, calibrate_touches, gather_touches, usable_touches
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.simulation.truth import World, parse_effect, with_effects
from scara_kinetostatic.touches.detection import associate, press_of
from scara_kinetostatic.touches.streams import Streams

_LOAD = "give one, such as load_cell('cell.yaml')"
Paths = str | Path | Sequence[str | Path]


def make_touches(
    joints: ArrayLike,
    force: ArrayLike,
    cell: Cell,
    *,
    objects: str | Sequence[str] | None = None,
    time: ArrayLike | None = None,
    approach: ArrayLike | None = None,
) -> TouchSet:
    """Touches from arrays.

    Args:
        joints: Q, (n, 2), rad.
        force: on the object, in the frame of the cell's sensor (usually the base frame), (n, 2), N.
        cell: the cell.
        objects: name of the touched object, one for all or n; None: each is found by place and force.
        time: of each touch, (n,), s; the first is taken as 0. None: unknown.
        approach: each joint's last movement before the hold, (n, 2), rad, or only its sense, as 1 or -1; None:
            unknown, so that hysteresis and friction cannot be identified.

    The load before each touch is unknown, so that slip with memory in a joint cannot be identified; where you know it,
    give it by `TouchSet.replace(history=…)`.

    Raises:
        InputError: arrays of other shapes, values that are not finite, an unknown object, a touch where no object is.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> touches = sk.make_touches([[0.8355, 2.1317], [2.9658, -2.1322]], [[-9.8, -0.1], [-25.1, 0.1]], cell)
        >>> [cell.discs[number].name for number in touches.disc]
        ['disc_1', 'disc_1']
    """
    expect(cell, Cell, 'cell', _LOAD)
    q = _pairs(joints, 'joints')
    f = _pairs(force, 'force')
    if len(f) != len(q):
        raise InputError('force', f'expected shape ({len(q)}, 2), got {np.shape(force)}', 'give one row per touch')
    moved = np.zeros_like(q) if approach is None else _pairs(approach, 'approach', len(q))
    when = _times(time, len(q))
    if objects is None:
        association = associate(q, f, cell)
        for k in np.flatnonzero(~association.known):
            remedy = 'leave it out, or check units, sensor.frame and sensor.sign'
            raise InputError(f'touch {k}', association.reason(int(k), cell), remedy)
        disc = association.disc
    else:
        disc = _places(objects, 'objects', [one.name for one in cell.discs], len(q))
    return TouchSet(
        q,
        f,
        disc,
        posture(cell.nominal, q),
        time=when - when.min(),
        approach=moved,
        press=press_of(moved),
        order=order_of_time(when),
    )


def read_touches(paths: Paths, cell: Cell) -> TouchSet:
    """The usable touches of recordings and touch tables.

    Args:
        paths: a recording or a table (``.csv``), or several, of one robot in one cell.
        cell: the cell.

    Raises:
        InputError: a file cannot be read; a table where the cell's sensor reports in the tool frame.
        CellError: a mistake in the cell description, such as another frame or sign of the sensor.
        UnsupportedDataError: there is no usable touch.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> len(sk.read_touches(['touches.csv', 'recording.mcap'], cell))
        144
    """
    expect(cell, Cell, 'cell', _LOAD)
    listed = _listed(paths)
    tables = [path for path in listed if is_touch_table(path)]
    if tables and cell.sensor.frame is SensorFrame.TOOL:
        problem = "a table has its forces in the base frame, the cell's sensor in the tool frame"
        raise InputError(tables[0], problem, 'give a cell with sensor.frame base')
    return usable_touches(gather_touches(listed, cell), cell, listed)


def simulate(
    cell: Cell,
    truth: Parameters | Mapping[str, float],
    *,
    effects: str | Iterable[str] = (),
    per_disc: int = 12,
    preload: float = 0.3,
    seed: int = 0,
    drawn: int | None = None,
) -> TouchSet:
    """The touches that a simulated robot makes all round the objects of a cell.

    Args:
        cell: the cell; its noise is that of the touches, 1e-5 rad and 0.3 N where it does not say.
        truth: parameters of the robot; those not given are nominal.
        effects: what the robot has besides, such as ``object_radius[disc_2]:radius=6e-5``.
        per_disc: touches of each disc and elbow posture.
        preload: part of the force by which every other touch is pressed beyond it first, so that the joints come to
            rest from both sides.
        seed: of the noise.
        drawn: seed of the errors of the cell description, which are drawn from its declared uncertainties: of discs,
            plates and sensor, and of trusted nominal values that `truth` does not give. None for no such errors.

    Raises:
        InputError: an unknown parameter or effect.
        UnsupportedDataError: the robot cannot reach the objects.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> touches = sk.simulate(cell, {'l1': 0.3302, 'p_ee': 1.1e-5}, effects=['encoder_gain[joint1]:gain=1e-3'])
        >>> touches.joints.shape
        (72, 2)
    """
    expect(cell, Cell, 'cell', _LOAD)
    if not isinstance(truth, Parameters):
        expect(truth, Mapping, 'truth', "give the parameters by name, such as {'l1': 0.3302}")
        unknown = [name for name in truth if name not in cell.nominal.names]
        if unknown:
            remedy = did_you_mean(unknown[0], cell.nominal.names)
            raise ParameterError('truth', f'unknown parameter {unknown[0]!r}', remedy)
    world = World.of(cell, None) if drawn is None else World.draw(cell, np.random.default_rng(drawn))
    if not isinstance(truth, Parameters):
        truth = world.robot(cell.nominal).replace(**truth)
    texts = [effects] if isinstance(effects, str) else effects
    robot = with_effects(truth, [parse_effect(text, cell) for text in texts])
    plan, noise = default_plan(cell, per_disc, preload=preload), cell.noise or USUAL_NOISE
    return world.reported(simulate_touches(world.cell, robot, plan, noise, seed))


def diagnose(source: TouchSet | Paths, cell: Cell, *, fixed: Mapping[str, float] | None = None) -> Outcome:
    """Calibrate, look for model errors, and extend the model by those found: the whole outcome of the command.

    Args:
        source: touches, or the recordings and touch tables that hold them.
        cell: the cell.
        fixed: parameters to hold, by name, at these values. Those of an effect, by label and name, all of them: the
            effect is in the model with these values, and is not looked for.

    Returns:
        ``outcome.verdict``; ``outcome['l1'].value``, ``.std``, ``.unit`` of the base model's parameters, and
        ``outcome.effects['object_radius[disc_2]']['radius']`` alike; more in `Outcome`.

    Raises:
        InputError: a file or the cell is wrong.
        UnsupportedDataError: the touches cannot support a calibration.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> outcome = sk.diagnose('touches.csv', cell)
        >>> outcome.verdict
        'explained'
        >>> radius = outcome.effects['object_radius[disc_2]']['radius']
        >>> print(f'{1e6 * radius.value:.0f} ± {1e6 * radius.std:.0f} µm')
        60 ± 3 µm
    """
    expect(cell, Cell, 'cell', _LOAD)
    if isinstance(source, TouchSet):
        return calibrate_touches(source, cell, fixed=fixed)
    return calibrate_recordings(_listed(source), cell, fixed=fixed)


def predict_force(
    result: Outcome | Calibration, touches: TouchSet | ArrayLike, objects: str | Sequence[str] | None = None
) -> Floats:
    """F = A(Q, L̄): the contact force that the calibrated model predicts.

    Args:
        result: of `diagnose` or `calibrate`.
        touches: the touches, or joint angles alone, (n, 2), rad: then at time 0, without a motion or a load before.
        objects: names of the touched objects, one for all or n; only with joint angles.

    Returns:
        On the object, in the frame of the cell's sensor as `touches.force` is, (n, 2), N; zero where the tip does not
        reach the object. Measured less predicted, with errors of the sensor corrected, is `Outcome.residuals`.

    Raises:
        InputError: arrays of other shapes, or an unknown object.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> outcome = sk.diagnose('touches.csv', cell)
        >>> sk.predict_force(outcome, [0.8355, 2.1317], 'disc_1').round(0)
        array([[-10.,   0.]])
    """
    c = _final(result)
    if isinstance(touches, TouchSet):
        if touches is c.touches:  # as the fit took them
            o, model = c.observe(), c.model
        else:
            o, model = observe(touches, c.cell, c.errors), c.full_model
        force = base_force(o, model) - force_residual(o, model)
    else:
        joints = _pairs(touches, 'joints')
        if objects is None:
            raise InputError('objects', 'is missing', 'name the touched objects')
        disc = _places(objects, 'objects', [one.name for one in c.cell.discs], len(joints))
        sides, later = posture(c.parameters, joints), np.full(len(joints), LATER)
        touched = TouchSet(joints, np.zeros_like(joints), disc, sides, order=later)
        for _ in range(3 if c.cell.has_outlines else 1):  # the tip decides on edge or corner
            o = observe(touched, c.cell, c.errors)
            found = contact(
                c.full_model, joints, o.centers, o.radii, c.cell.gripper_sign, metadata=o.metadata, tangents=o.tangents
            )
            if c.cell.has_outlines:
                nearest = c.cell.surfaces.nearest(c.cell.surfaces.distances(found.tip), disc)
                touched = touched.replace(surface=nearest)
        force = found.force
    return np.asarray(o.frame.from_base(force, o.joints, c.parameters))


def locate(
    result: Outcome | Calibration | CalibratedArm,
    joints: ArrayLike,
    force: ArrayLike = (0.0, 0.0),
    *,
    time: ArrayLike | None = None,
    approach: ArrayLike | None = None,
    nominal: bool = False,
    rigid: bool = False,
) -> TipPosition:
    """H̄: where the tip is, from measured joint angles and the force.

    Where the force or a torque is below three times its standard uncertainty, the sign of its backlash is not known
    (`loaded` is False): the dead band is crossed on a straight line, from edge to edge, and g²/3 is added to the
    variance in its middle, nothing at its edges. So no result jumps.
    `force` is the true one: errors of the sensor that the model has are not removed from it.

    Args:
        result: of `diagnose`, `calibrate` or `load_calibration`.
        joints: Q, (n, 2), rad.
        force: on the object, base frame, (n, 2), or one for all, N.
        time: of each pose, s since the first touch of the calibration, (n,), or one for all; None: 0. Needed where the
            model has an effect that depends on it, such as drift.
        approach: each joint's last movement before the pose, rad or only its sense, (n, 2), or one for all; None:
            unknown, the middle of the hysteresis.
        nominal: whether to take the nominal parameters; they have no uncertainty.
        rigid: whether to leave out the deflection: H (1) instead of H̄.

    Raises:
        InputError: arrays of other shapes, or values that are not finite.

    Warns:
        UserWarning: the model has an effect of time or approach, which is not given; or one of the load before, such as
            slip with memory: the joint is taken as loaded to the force from the relaxed state, without a preload.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> outcome = sk.diagnose('touches.csv', cell)
        >>> tip = sk.locate(outcome, [0.8, 2.1], [-20.0, 0.0])
        >>> tip.position.round(4)
        array([[-0.0867,  0.3136]])
        >>> bool((tip.std < 1e-5).all())
        True
    """
    predictor = Predictor(_arm(result), nominal, rigid)
    q = _pairs(joints, 'joints')
    f = _pairs(force, 'force', len(q))
    metadata = _metadata(predictor, posture(predictor.law.model.parameters, q), time, approach)
    return predictor.locate(q, f, metadata)


def trace_contour(
    recording: str | Path | Streams,
    result: Outcome | Calibration | CalibratedArm,
    cell: Cell | None = None,
    *,
    tip_radius: float | None = None,
) -> Contour:
    """The outline of an object of unknown shape, from a recording in which the tip slides along it under force.

    ``contour.outlines`` are the passes joined; ``sk.fit_shape(contour, arm, 'circle')`` fits a circle, ``'line'``
    a line, ``sk.fit_pieces(contour, arm)`` splits an outline into lines and arcs.

    Args:
        recording: its path, or the streams read from it; it begins and ends with free motion.
        result: of `diagnose`, `calibrate` or `load_calibration`.
        cell: topics, frame and sign of the sensor, radius of the tip; None: as in the calibration.
        tip_radius: m; None: as the cell states it; without one the outline is that of the tip's centre.

    Raises:
        InputError: the recording cannot be read.
        UnsupportedDataError: the tip touches nothing, does not slide, or jumps; the calibration does not determine
            where it is.

    Example:
        >>> import scara_kinetostatic as sk
        >>> arm = sk.diagnose('touches.csv', sk.load_cell('cell.yaml')).arm
        >>> contour = sk.trace_contour('slide.mcap', arm)
        >>> outline = contour.outlines[0]
        >>> outline.closed, round(1e3 * outline.length)
        (True, 188)
        >>> print(f"{1e3 * sk.fit_shape(contour, arm, 'circle').value('radius').value:.2f} mm")
        30.00 mm
    """
    arm = _arm(result)
    cell = arm.cell if cell is None else cell
    expect(cell, Cell, 'cell', _LOAD)
    streams = recording if isinstance(recording, Streams) else read_streams(Path(recording), cell)
    radius = cell.tip_radius if tip_radius is None else tip_radius
    return contour_of(streams, arm, cell.sensor, radius)


def compensate(
    result: Outcome | Calibration | CalibratedArm,
    position: ArrayLike,
    force: ArrayLike = (0.0, 0.0),
    elbow: str | Sequence[str] = 'left',
    *,
    time: ArrayLike | None = None,
    approach: ArrayLike | None = None,
) -> JointAngles:
    """Ḡ: the joint angles that bring the tip to a place under a force.

    Where the force or a torque is below three times its standard uncertainty, the sign of its backlash is not known
    (`loaded` is False): the dead band is crossed on a straight line, from edge to edge, and g²/3 is added to the
    variance in its middle, nothing at its edges. So the joint angles do not jump, and `locate` gives the place back.
    `force` is the true one: errors of the sensor that the model has are not removed from it.

    Args:
        result: of `diagnose`, `calibrate` or `load_calibration`.
        position: of the tip, base frame, (n, 2), m.
        force: on the object, base frame, (n, 2), or one for all, N.
        elbow: ``left``, sin(q2 + theta2) > 0, or ``right``; one for all or n.
        time: of each pose, s since the first touch of the calibration, (n,), or one for all; None: 0. Needed where the
            model has an effect that depends on it, such as drift.
        approach: each joint's last movement before the pose, rad or only its sense, (n, 2), or one for all; None:
            unknown, the middle of the hysteresis.

    Raises:
        InputError: arrays of other shapes, values that are not finite, or another elbow.

    Warns:
        UserWarning: the model has an effect of time or approach, which is not given; or one of the load before, such as
            slip with memory: the joint is taken as loaded to the force from the relaxed state, without a preload.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> outcome = sk.diagnose('touches.csv', cell)
        >>> angles = sk.compensate(outcome, [0.3, 0.2], [0.0, 30.0], elbow='right')
        >>> angles.joints.round(4)
        array([[ 1.593 , -1.9882]])
        >>> sk.locate(outcome, angles.joints, [0.0, 30.0]).position.round(9)
        array([[0.3, 0.2]])
    """
    predictor = Predictor(_arm(result))
    tip = _pairs(position, 'position')
    f = _pairs(force, 'force', len(tip))
    sides = 2 * _places(elbow, 'elbow', ['right', 'left'], len(tip)) - 1
    return predictor.compensate(tip, f, sides, _metadata(predictor, sides, time, approach))


def _metadata(
    predictor: Predictor, sides: Indices, time: ArrayLike | None, approach: ArrayLike | None
) -> TouchMetadata:
    """What effects need to know of n poses; warns where it is not given, and an effect needs it."""
    n = len(sides)
    for name, given, absent in (
        ('time', time, 'time, which is not given; its value at time 0 is taken'),
        ('approach', approach, 'approach, which is not given; its value at approach 0 is taken'),
        ('history', None, 'the load before, which is not given; none, and no preload, is taken'),
    ):
        if given is None and (needing := predictor.effects_of(name)):
            warnings.warn(f'{needing[0]} depends on {absent}', UserWarning, stacklevel=4)
    when = _times(time, n)
    moved = np.zeros((n, 2)) if approach is None else _pairs(approach, 'approach', n)
    return TouchMetadata(np.zeros(n, dtype=np.intp), when, moved, sides, np.zeros((n, 2)))


def _arm(result: Outcome | Calibration | CalibratedArm) -> CalibratedArm:
    if isinstance(result, CalibratedArm):
        return result
    return result.arm if isinstance(result, Outcome) else _final(result).arm


def _final(result: Outcome | Calibration) -> Calibration:
    if isinstance(result, Outcome):
        return result.final
    if isinstance(result, Calibration):
        return result
    raise InputError('result', f'expected what diagnose or calibrate return, got {type(result).__name__}')


def _listed(paths: Paths) -> list[str | Path]:
    listed: list[Any] = list(paths) if isinstance(paths, (list, tuple)) else [paths]
    for item in listed:
        if not isinstance(item, (str, Path)):
            problem = f'expected touches of read_touches or make_touches, or files, got {type(item).__name__}'
            raise InputError('source', problem, 'make touches of arrays by make_touches(joints, force, cell)')
    if not listed:
        raise InputError('paths', 'expected one or more files, got none')
    return listed


def _numbers(values: ArrayLike, name: str) -> Floats:
    """Values as an array, finite."""
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(name, f'expected numbers, got {values!r:.60}') from error
    if not np.isfinite(array).all():
        raise InputError(name, f'expected finite numbers, got {array[~np.isfinite(array)][0]}')
    return array


def _pairs(values: ArrayLike, name: str, n: int | None = None) -> Floats:
    """Values as (n, 2), finite; one pair alone is one row, or where n is given stands for all."""
    array = _numbers(values, name)
    array = array[None] if array.ndim == 1 else array
    if array.ndim != 2 or array.shape[1] != 2 or not len(array) or (n is not None and len(array) not in (1, n)):
        problem = f'expected shape ({n or "n"}, 2), got {np.shape(values)}'
        raise InputError(name, problem, 'give one row per touch or pose')
    return np.array(np.broadcast_to(array, (n or len(array), 2)))


def _times(values: ArrayLike | None, n: int) -> Floats:
    """Times as (n,), s; one stands for all, none is 0."""
    array = np.zeros(n) if values is None else _numbers(values, 'time')
    if array.shape not in ((), (1,), (n,)):
        raise InputError('time', f'expected shape ({n},), got {array.shape}', 'give one for each touch or pose')
    return np.array(np.broadcast_to(array, (n,)))


def _places(given: str | Sequence[str], name: str, known: Sequence[str], n: int) -> Indices:
    """The places of n names among those known; one name stands for all."""
    names = [given] * n if isinstance(given, str) else list(given)
    unknown = [each for each in names if each not in known]
    if unknown or len(names) != n:
        problem = f'there is no {unknown[0]!r:.40}' if unknown else f'expected one name or {n}, got {len(names)}'
        raise InputError(name, problem, f'the names are {", ".join(known)}')
    return np.array([known.index(each) for each in names], dtype=np.intp)

"""Where an effect shows: what each touch says of it, over the variable that betrays it, before and after.

An effect moves joints, moves the place of the contact, or misreads the force. Of a unit u of that deviation
(whitened, `diagnosis.problem`) and a residual r of a touch, the deviation that the touch itself calls for is
-u·r / u·u, with standard deviation 1/|u|: after, with r of the extended model; before, with r of the model without the
effect and its rivals. Where nothing else was found that is the fit of the twelve parameters alone; else it
is r - (I - B Bᵀ) X θ, with X the columns of what is taken out and B a basis of those that stay. The second part
is what is to be expected before.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.diagnosis.linear_problem import Problem, orthonormal, pose_problem
from scara_kinetostatic.diagnosis.outcome import Outcome
from scara_kinetostatic.diagnosis.result import Found
from scara_kinetostatic.effects.base import Effect, at_joint
from scara_kinetostatic.effects.transmission_error import TransmissionError
from scara_kinetostatic.effects.unnamed import ANGLES, Unnamed, variable
from scara_kinetostatic.effects.unnamed import VARIABLES as UNNAMED
from scara_kinetostatic.effects.variables import VARIABLES
from scara_kinetostatic.model.extension import split
from scara_kinetostatic.model.law import Shift
from scara_kinetostatic.model.parameters import NAMES

Floats = NDArray[np.float64]

UNCLEAR = 4.0
"""A touch that says so many times less of a deviation than the median one is left out."""
UNITS = {'q1': 'rad', 'q2': 'rad', 'torque1': 'Nm', 'torque2': 'Nm', 'force': 'N', 'time': 's'}


class Channel(NamedTuple):
    """One way in which an effect acts on a touch.

    Attributes:
        label: what deviates, with the unit shown.
        per_si: that unit.
        shift: of one SI unit, as the equations take it.
        reading: the same as an error of the sensor.
        size: how far the effect moves each touch this way, (n,), SI.
    """

    label: str
    per_si: float
    shift: Shift
    sensor_error: Floats | None
    size: Floats


class Signature(NamedTuple):
    """What n touches say of an effect.

    Attributes:
        over: what the x axis is, with unit.
        what: what the y axis is, with unit.
        x: the variable, (n,).
        before: deviation that each touch calls for without the effect and its rivals, (n,).
        after: the same with the extended model.
        expected: what of it the effect must leave beside the rest of the model.
        spread_before: standard deviation of one touch without the effect, (n,).
        spread_after: the same with it; larger if it is one that scatters.
        disc: number of the disc, (n,).
        posture: +1 or -1, (n,).
    """

    over: str
    what: str
    x: Floats
    before: Floats
    after: Floats
    expected: Floats
    spread_before: Floats
    spread_after: Floats
    disc: NDArray[np.intp]
    posture: NDArray[np.intp]


def signature(outcome: Outcome, item: Found) -> Signature:
    """What the used touches say of an effect of the extended model."""
    problem = pose_problem(outcome.final)
    if item.effect.off_normal_std:
        return _off_normal_residual(outcome, problem, item)
    channels = _channels(problem, item)
    which = int(np.argmax([float(np.linalg.norm(_moved(problem, each))) for each in channels]))
    channel = channels[which]
    unit = problem.column(channel.shift, channel.sensor_error).reshape(-1, 2)
    weight = np.linalg.norm(unit, axis=1)
    kept = _touched(problem, item.effect) & (weight > np.median(weight) / UNCLEAR)
    over, x = _over(problem, item)
    metadata, left = problem.touch_state.metadata, problem.point.whitened.residual
    taken_out, alone = _taken_out(outcome, problem, item)
    before = left + taken_out
    old = unit
    if alone:
        earlier = pose_problem(replace(outcome.calibration, used=outcome.final.used, noise=outcome.final.noise))
        there = _channels(earlier, item)[which]
        before, old = earlier.left, earlier.column(there.shift, there.sensor_error).reshape(-1, 2)

    def deviation(column: Floats, residual: Floats) -> Floats:
        scale = np.maximum((column**2).sum(axis=1), 1e-300)
        return np.asarray(-channel.per_si * (column * residual.reshape(-1, 2)).sum(axis=1) / scale)[kept]

    return Signature(
        over=over,
        what=channel.label,
        x=x[kept],
        before=deviation(old, before),
        after=deviation(unit, left),
        expected=deviation(unit, taken_out),
        spread_before=channel.per_si / np.linalg.norm(old, axis=1)[kept],
        spread_after=channel.per_si / weight[kept],
        disc=metadata.disc[kept],
        posture=metadata.posture[kept],
    )


def _taken_out(outcome: Outcome, problem: Problem, item: Found) -> tuple[Floats, bool]:
    """What the residual is richer by without an effect and its rivals, (n, 2), and whether nothing else was found."""
    final, found = outcome.final, outcome.diagnosis.found
    columns = problem.point.whitened.derivative[:, :, len(NAMES) :].reshape(len(problem.left), -1)
    parts = split(final.cell.effects, final.parameters)
    amplitudes = [law.amplitudes(part) for law, part in zip(final.cell.effects, parts, strict=True)]
    out = [other.effect == item.effect or not (other.in_every_model or item.in_every_model) for other in found]
    gone = np.repeat(out, [len(part) for part in parts])
    base = problem.base if gone.all() else orthonormal(np.concatenate([problem.base, columns[:, ~gone]], axis=1))
    lost = columns[:, gone] @ np.concatenate(amplitudes)[gone]
    return -(lost - base @ (base.T @ lost)).reshape(-1, 2), bool(gone.all())


def _off_normal_residual(outcome: Outcome, problem: Problem, item: Found) -> Signature:
    """That of leaning forces: the lean of each, which has the spread of noise alone or that and the effect's own."""
    earlier = pose_problem(replace(outcome.calibration, used=outcome.final.used, noise=outcome.final.noise))
    radii, metadata = earlier.touch_state.radii, earlier.touch_state.metadata
    off_normal = -1e3 * earlier.point.linear.misclosure[:, 1] / radii
    _, l21, l22 = earlier.point.whitened.root
    noise = 1e3 * np.hypot(l21, l22) / radii
    over, x = _over(problem, item)
    return Signature(
        over=over,
        what='lean of the force  [mrad]',
        x=x,
        before=off_normal,
        after=off_normal,
        expected=np.zeros_like(off_normal),
        spread_before=noise,
        spread_after=np.hypot(noise, 1e3 * item.effect.off_normal_std),
        disc=metadata.disc,
        posture=metadata.posture,
    )


def _moved(problem: Problem, channel: Channel) -> Floats:
    column = problem.column(channel.shift, channel.sensor_error).reshape(-1, 2)
    return np.asarray(channel.size[:, None] * column)


def _channels(problem: Problem, item: Found) -> list[Channel]:
    at, values = problem.touch_state, np.array([v.value for v in item.values])
    n, found = len(at.magnitude), item.effect.shift(at, values)
    sensor_error = item.effect.sensor_error(problem.force, values)
    channels = []
    if found.joints is not None:
        for joint in (0, 1):
            unit = Shift(joints=at_joint(np.ones(n), joint))
            channels.append(Channel(f'joint {joint + 1} deviates  [µrad]', 1e6, unit, None, found.joints[:, joint]))
    if found.place is not None:
        for side, direction in (('along', at.normal), ('across', at.tangent)):
            size = (found.place * direction).sum(axis=1)
            channels.append(Channel(f'place {side} the force  [µm]', 1e6, Shift(place=direction), None, size))
    if sensor_error is not None:
        along = problem.force / np.hypot(problem.force[:, 0], problem.force[:, 1])[:, None]
        for side, direction in (('along', along), ('across', np.stack([-along[:, 1], along[:, 0]], axis=-1))):
            size = (sensor_error * direction).sum(axis=1)
            channels.append(Channel(f'reading {side} the force  [N]', 1.0, Shift(), direction, size))
    return channels


def _touched(problem: Problem, effect: Effect) -> NDArray[np.bool_]:
    """The touches that an effect is about: those on its disc, if it has one and that is not the variable."""
    disc = getattr(effect, 'disc', -1)
    touched = problem.touch_state.metadata.disc
    if disc < 0 or effect.plot_variable == 'disc':
        return np.ones(len(touched), dtype=bool)
    return np.asarray(touched == disc)


def _over(problem: Problem, item: Found) -> tuple[str, Floats]:
    """The variable that betrays an effect: its name, and its values, (n,)."""
    effect, at = item.effect, problem.touch_state
    if isinstance(effect, TransmissionError):
        _, phase, cycles = (v.value for v in item.values)
        angle = np.degrees(cycles * at.joints[:, effect.joint] - phase)
        return f'phase of the wave, {cycles:.4g} per turn of joint {effect.joint + 1}  [°]', (angle + 180) % 360 - 180
    if isinstance(effect, Unnamed):
        values = variable(at, effect.variable)
        if effect.variable in ANGLES:
            return f'{UNNAMED[effect.variable]}  [°]', np.degrees((values + np.pi) % (2 * np.pi) - np.pi)
        return f'{UNNAMED[effect.variable]}  [{UNITS[effect.variable]}]', values
    joint = {'joint1': 0, 'joint2': 1}.get(effect.target or '')
    over = VARIABLES[effect.plot_variable]
    title = re.sub(r' \(([^()]*)\)$', r'  [\1]', over.title(joint))
    return title, np.asarray(over.values(at, joint), dtype=float)

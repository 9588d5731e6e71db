"""From touches to L̄; parameters held at a value, as text, checked, and those of effects with their effects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from scara_kinetostatic.calibration.declared_errors import without_sources
from scara_kinetostatic.calibration.estimate import WarmStart, estimate, fewest_touches
from scara_kinetostatic.calibration.fit_point import base_force
from scara_kinetostatic.calibration.observations import Observations, observe
from scara_kinetostatic.calibration.result import Calibration, build_result
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import CellError, InputError, ParameterError, UnsupportedDataError, did_you_mean, expect
from scara_kinetostatic.model.cell import Cell, SensorFrame, SensorSign
from scara_kinetostatic.model.effect_law import EffectLaw
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import NAMES, UNITS, Parameters, implausible_size
from scara_kinetostatic.model.touch import Rejection, TouchSet, common_reason


def calibrate(
    touches: TouchSet,
    cell: Cell,
    effects: Sequence[EffectLaw] = (),
    *,
    start: ExtendedModel | None = None,
    fixed: Mapping[str, float] | None = None,
    warm_start: WarmStart | None = None,
) -> Calibration:
    """Estimate L̄, and the parameters of effects along with it, from touches.

    Args:
        touches: what the sensor measured, in the sensor's frame.
        cell: the cell; its noise, if given, is taken as true.
        effects: effects that extend the base model.
        start: where to begin, its effects being those of the fit; by default the nominal values and the start values
            of `effects`.
        fixed: parameters to hold, by name, at these values; those of `effects` by label and name, such as
            ``encoder_gain[joint1].gain``. The declared uncertainty of an effect that is held does not count.
        warm_start: an earlier fit of the same touches close to this one, with the same effects; the coarse stage is
            then left out.

    Returns:
        The calibration. Parameters that the data cannot separate are held, together, as near to their nominal values
        as the data allow, and marked ``confounded``. Touches with hardly any force, and repeated readings, are
        rejected before the fit: they are in `rejected`, not in `touches`.

    Raises:
        ParameterError: `fixed` names no parameter, gives a senseless value, or leaves nothing free; a
            touch names no disc of the cell; `start` or `warm_start` has other effects.
        UnsupportedDataError: too few touches for the free parameters, touches so much
            alike that they determine less than half of them, or a fit that diverges.
        CellError: the forces contradict the cell's sensor sign or frame.
        InputError: the forces of arrays point away from the discs.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> touches = sk.simulate(cell, {'l1': 0.3302}, seed=1)
        >>> calibration = sk.calibrate(touches, cell, fixed={'x0': 0.0})
        >>> calibration['x0'].status, calibration['l1'].unit
        ('fixed', 'm')
        >>> bool(abs(calibration['l1'].value - 0.3302) < 4 * calibration['l1'].std)
        True
    """
    expect(touches, TouchSet, 'touches', "read them by read_touches('touches.csv', cell), or give the file to diagnose")
    expect(cell, Cell, 'cell', "read it by load_cell('cell.yaml')")
    fixed = _checked(fixed)
    start = _start(cell, _expect_effects(effects), start, fixed)
    cell = without_sources(cell, _held_sources(start, fixed))
    if warm_start is not None:
        if warm_start.model.effects != start.effects:
            raise ParameterError('warm start', 'its effects are not those of the fit', 'give the same effects')
        warm_start = warm_start._replace(model=_with_fixed(warm_start.model, fixed))
    held = start.held.union(fixed)
    free = np.array([j for j, name in enumerate(start.names) if name not in held], dtype=np.intp)
    given = touches.index
    touches, left_out, faint = _leave_out(touches, cell)
    if warm_start is not None:
        warm_start = warm_start._replace(used=warm_start.used[np.isin(given, touches.index)])
    _check_number(len(touches), len(free), [item.reason for item in left_out], faint, cell)
    observations = observe(touches, cell)
    _check_plausible(observations, cell, from_recording=bool(np.any(touches.samples > 1)))
    try:
        found = estimate(observations, cell, start, free, warm_start)
    except np.linalg.LinAlgError as error:
        problem = 'the fit diverged to where the model is not defined'
        raise UnsupportedDataError(problem, 'check the nominal values, the discs and the sensor in the cell') from error
    return build_result(touches, cell, start, fixed, observations, found, left_out)


def _start(
    cell: Cell, effects: Sequence[EffectLaw], start: ExtendedModel | None, fixed: Mapping[str, float]
) -> ExtendedModel:
    if start is None:
        start = ExtendedModel.at_start(cell.nominal, effects)
    elif effects and start.effects != tuple(effects):
        raise ParameterError('start', 'its effects are not those of the fit', 'give the same effects')
    for name in fixed:
        if name not in start.names:
            remedy = did_you_mean(name, start.names)
            raise ParameterError(f'fixed parameter {name!r}', 'no such parameter', remedy)
    if all(name in fixed for name in NAMES):
        raise ParameterError('fixed parameters', 'all twelve are fixed', 'leave one free at least')
    start = _with_fixed(start, fixed)
    start.parameters.check_physical('fixed parameters' if fixed else 'nominal')
    return start


def _with_fixed(model: ExtendedModel, fixed: Mapping[str, float]) -> ExtendedModel:
    if not fixed:
        return model
    pairs = zip(model.names, model.as_array().tolist(), strict=True)
    return model.with_array([fixed.get(name, value) for name, value in pairs])


def _held_sources(model: ExtendedModel, fixed: Mapping[str, float]) -> set[str]:
    """Labels of the sources of uncertainty whose errors are those of effects that are held at given values."""
    held = [law for law in model.effects if all(f'{law.label}.{p.name}' in fixed for p in law.parameters)]
    return {getattr(law, 'declared_as', '') or law.label for law in held if law.parameters}


def _checked(fixed: Mapping[str, float] | None) -> dict[str, float]:
    """Parameters to hold, each with a number of a plausible size.

    Raises:
        ParameterError: one has not.
    """
    expect(fixed or {}, Mapping, 'fixed', "give values by name, such as {'l1': 0.3302}")
    values = dict(fixed or {})
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
            raise ParameterError(f'fixed parameter {name}', f'expected a number, got {value!r:.40}')
        _check_size('fixed parameter', name, float(value), f'{value:g}')
    return values


def _check_size(where: str, name: str, value: float, text: str) -> None:
    if not np.isfinite(value):
        raise ParameterError(f'{where} {name}', f'expected a finite number, got {text}')
    if implausible := implausible_size(value, UNITS.get(name, '')):
        raise ParameterError(f'{where} {name}={text}', *implausible)


def _expect_effects(effects: Sequence[EffectLaw]) -> Sequence[EffectLaw]:
    """The effects, where they are.

    Raises:
        ParameterError: something else is among them.
    """
    wrong = [item for item in effects if not hasattr(item, 'parameters')]
    if wrong:
        remedy = 'take it from catalogue(cell), by its label'
        raise ParameterError('effects', f'expected effects, got {wrong[0]!r:.60}', remedy)
    return effects


def _leave_out(touches: TouchSet, cell: Cell) -> tuple[TouchSet, list[Rejection], int]:
    """Take out touches without a force, how many there are of these, and readings that repeat an earlier one to the
    last bit.
    """
    reasons: dict[int, str] = {}
    magnitude = np.hypot(touches.force[:, 0], touches.force[:, 1])
    least = 3.0 * cell.noise.force_rms if cell.noise else 1e-6  # N; below it a force has no direction to speak of
    faint = np.flatnonzero(magnitude <= least)
    for k in faint:
        noise = f' of {cell.noise.force_rms:.2g} N' if cell.noise else ''
        reasons[int(k)] = f'presses with {magnitude[k]:.2g} N only: its direction is noise{noise}'
    rows = np.concatenate([touches.joints, touches.force], axis=1)
    _, first, which = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    earlier = first[which.ravel()]
    for k in np.flatnonzero(earlier != np.arange(len(touches))):
        reasons.setdefault(int(k), f'the same reading as touch {touches.index[earlier[k]]}, to the last bit')
    if not reasons:
        return touches, [], 0
    kept = np.ones(len(touches), dtype=bool)
    kept[list(reasons)] = False
    left_out = [Rejection(int(touches.index[k]), reason) for k, reason in sorted(reasons.items())]
    return touches.select(kept), left_out, len(faint)


def _check_number(touches: int, parameters: int, left_out: Sequence[str], faint: int, cell: Cell) -> None:
    """Whether there are more equations than parameters.

    Args:
        touches: how many there are.
        parameters: how many are free.
        left_out: why others were left out beforehand.
        faint: how many of these have hardly any force.
        cell: the cell.

    Raises:
        UnsupportedDataError: too few touches.
    """
    needed = fewest_touches(parameters)
    if touches >= needed:
        return
    problem = f'{touches} touches give {2 * touches} equations, too few for {parameters} parameters'
    remedy = f'record {needed} touches at the very least, 36 or more for a good result'
    number = touches + len(left_out)
    if common := common_reason(left_out, number):
        problem = f'{len(left_out)} of {number} touches were left out, the first: {common}; {problem}'
    elif left_out:
        problem += f'; {len(left_out)} were left out, the first: {left_out[0]}'
    if 2 * faint > number:
        remedy = 'check the units and the order of joint angles and forces'
        remedy += ', and the noise in the cell description' if cell.noise else ''
    elif left_out:
        remedy = f'see what was left out, or {remedy}'
    raise UnsupportedDataError(problem, remedy)


def _check_plausible(observations: Observations, cell: Cell, *, from_recording: bool) -> None:
    """Whether the measured forces point from the nominal tip to the disc.

    Args:
        observations: of the touches.
        cell: the cell.
        from_recording: whether the forces were given their sign by the cell, as those of a recording are; arrays hold
            the force on the object, whatever the cell says.

    Raises:
        CellError: they point away, or every way; the message says which key to look at.
        InputError: they point away, and are not of a recording.
    """
    cosine = _alignment(observations, cell.nominal)
    better = _other_frame(observations)
    elsewhere = _alignment(better, cell.nominal)
    if abs(elsewhere) > 0.8 > abs(cosine):  # the right frame gives more, even 20 mm and 3° off
        raise CellError(
            'sensor.frame',
            f'the forces point {"at" if elsewhere > 0 else "away from"} the discs if the frame is '
            f'{better.frame.value}, and every way if it is {observations.frame.value}',
            f'set it to {better.frame.value}, or check the mounting of the sensor',
        )
    if cosine > 0.0:
        return
    other = SensorSign.ON_ROBOT if cell.sensor.sign is SensorSign.ON_OBJECT else SensorSign.ON_OBJECT
    is_opposed = cosine < -0.5
    if is_opposed and not from_recording:
        raise InputError(
            'force', 'the forces point away from the discs', 'give the force on the object: change the signs of x and y'
        )
    if is_opposed:
        raise CellError(
            'sensor.sign',
            f'the forces point away from the discs with {cell.sensor.sign.value}',
            f'set it to {other.value}',
        )
    raise CellError(
        'sensor', 'the forces point every way but at the discs', 'check frame, sign and the axes of the sensor'
    )


def _alignment(observations: Observations, nominal: Parameters) -> float:
    to_disc = observations.centers - forward(nominal, observations.joints)
    force = base_force(observations, ExtendedModel(nominal))
    lengths = np.hypot(*to_disc.T) * np.hypot(*force.T)
    return float(np.median((to_disc * force).sum(axis=1) / np.maximum(lengths, 1e-12)))


def _other_frame(observations: Observations) -> Observations:
    tool = observations.frame is SensorFrame.TOOL
    return observations._replace(frame=SensorFrame.BASE if tool else SensorFrame.TOOL)


_GAP_ANGLE = {1e-3: 'angles are in rad, not mrad', 1e-6: 'angles are in rad, not µrad'}
_OTHER_UNITS: dict[tuple[str, ...], tuple[float, dict[float, str]]] = {
    ('x0', 'y0', 'l1', 'l2'): (0.1, {1e-3: 'lengths are in m, not mm'}),
    ('theta1', 'theta2'): (0.35, {float(np.deg2rad(1.0)): 'angles are in rad, not degrees'}),
    ('p_ee',): (2e-3, {1e-3: 'compliances are in m/N, not mm/N', 1e-6: 'compliances are in m/N, not µm/N'}),
    ('p1', 'p2'): (0.02, {1e-3: 'compliances are in rad/Nm, not mrad/Nm', 1e-6: 'in rad/Nm, not µrad/Nm'}),
    ('g_ee',): (0.02, {1e-3: 'lengths are in m, not mm', 1e-6: 'lengths are in m, not µm'}),
    ('g1', 'g2'): (0.05, _GAP_ANGLE),
}
"""By parameter: how far from the nominal value, in its SI unit, a value may be; factors to that unit of those in which
it may have been given by mistake, with what to say."""


def parse_fixed(text: str, where: str = 'fixed') -> tuple[str, float | None]:
    """Name and value of a text such as ``l1=0.3302`` or ``object_radius[disc_2].radius=0``; None without a value.

    Raises:
        ParameterError: no such parameter, or no number.
    """
    name, sign, value = (part.strip() for part in text.partition('='))
    if '.' not in name and name not in NAMES:
        remedy = did_you_mean(name, NAMES)
        effect = '' if '[' not in name else ', and of an effect such as object_radius[disc_2].radius'
        raise ParameterError(f'{where} {name}', f'expected the name of a parameter{effect}', remedy)
    if not sign:
        return name, None
    try:
        number = float(value)
    except ValueError:
        raise ParameterError(f'{where} {name}', f'expected a number, got {value!r}') from None
    _check_size(where, name, number, value)
    return name, number


def fixed_values(texts: Iterable[str], nominal: Parameters, where: str = 'fixed') -> dict[str, float]:
    """Values by name of texts; without a value the nominal one, and 0 for a parameter of an effect.

    Raises:
        ParameterError: one of them is wrong.
    """
    values = nominal.as_dict()
    pairs = (parse_fixed(text, where) for text in texts)
    return {name: values.get(name, 0.0) if value is None else value for name, value in pairs}


def check_units(fixed: Mapping[str, float], nominal: Parameters) -> None:
    """Check that no value is in another unit: far from the nominal one, and near it if it were in mm, say.

    Raises:
        ParameterError: one is.
    """
    limits = {name: limit for names, limit in _OTHER_UNITS.items() for name in names}
    for name, (farthest, factors) in limits.items():
        stated = getattr(nominal, name)
        off = abs(fixed.get(name, stated) - stated)
        for factor, remedy in factors.items() if off > farthest else ():
            value = factor * fixed[name]
            if abs(value - stated) <= farthest:
                problem = f'is {off:.3g} {UNITS[name]} from its nominal value'
                raise ParameterError(f'fixed parameter {name}={fixed[name]:g}', problem, f'{remedy}: give {value:g}')


def fixed_effects(fixed: Mapping[str, float], cell: Cell) -> tuple[Effect, ...]:
    """The effects whose parameters are held, all of each.

    Args:
        fixed: values by name; of effects such as ``object_radius[disc_2].radius``.
        cell: that has the joints and discs.

    Raises:
        ParameterError: no such effect or parameter, or not all parameters of an effect.
    """
    labels = dict.fromkeys(name.rpartition('.')[0] for name in fixed if '.' in name)
    return tuple(_fixed_effect(label, fixed, cell) for label in labels)


def _fixed_effect(label: str, fixed: Mapping[str, float], cell: Cell) -> Effect:
    effect = find(cell, label)
    names = [f'{label}.{p.name}' for p in effect.parameters]
    for name in (name for name in fixed if name.rpartition('.')[0] == label and name not in names):
        raise ParameterError(f'fixed parameter {name}', 'no such parameter', did_you_mean(name, names))
    missing = [name for name in names if name not in fixed]
    if missing:
        problem = f'{missing[0]} is free: an effect is held by all of its parameters'
        raise ParameterError(f'fixed parameters of {label}', problem, f'give {" and ".join(names)}')
    if any(fixed[name] for name in names) and not effect.is_plausible(np.array([fixed[name] for name in names])):
        raise ParameterError(f'fixed parameters of {label}', 'expected plausible values', 'give them in SI units')
    return effect

"""From touches to L̄; parameters held at a value, as text, checked, and those of effects with their effects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from scara_kinetostatic.calibration.estimate import Estimation, WarmStart, covariance_of_fit, estimate, fewest_touches
from scara_kinetostatic.calibration.fit_point import Point, base_force, fitted_surfaces, fitted_tips, project
from scara_kinetostatic.calibration.gauss_helmert import nearest_flanks
from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.calibration.noise import USUAL_NOISE, raised
from scara_kinetostatic.calibration.observations import JointPrior, observe
from scara_kinetostatic.calibration.result import Calibration, build_result
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import InputError, ParameterError, UnsupportedDataError, did_you_mean, expect
from scara_kinetostatic.model.arrays import Indices, Mask
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.extended_model import EffectLaw, ExtendedModel
from scara_kinetostatic.model.flanks import has_no_sure_sign
from scara_kinetostatic.model.joint_law import joint_torques
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import MOMENTS, NAMES, UNITS, Parameters
from scara_kinetostatic.model.touch import Rejection, TouchSet


def calibrate(
    touches: TouchSet,
    cell: Cell,
    effects: Sequence[EffectLaw] = (),
    *,
    start: ExtendedModel | None = None,
    fixed: Mapping[str, float] | None = None,
    warm_start: WarmStart | None = None,
    known: JointPrior | None = None,
) -> Calibration:
    """Estimate L̄, and the parameters of effects along with it, from touches.

    Args:
        touches: what the sensor measured, in the sensor's frame.
        cell: the cell; its noise, if given, is taken as true.
        effects: effects that extend the base model.
        start: where to begin, its effects being those of the fit; by default the nominal values and the start values
            of `effects`.
        fixed: parameters to hold, by name, at these values; those of `effects` by label and name, such as
            ``encoder_gain[joint1].gain``.
        warm_start: an earlier fit of the same touches close to this one, with the same effects; the coarse stage is
            then left out.
        known: what an earlier calibration says of all values and of the declared errors; few touches are then enough.

    Returns:
        The calibration. Parameters that the data cannot separate are held, together, as near to their nominal values
        as the data allow, and marked ``confounded``. Touches with hardly any force, repeated readings and, under
        gravity, touches that do not tell the flank of a joint are left out: they are in `rejected`, not in `touches`.

    Raises:
        ParameterError: `fixed` names no parameter, gives a senseless value, or leaves nothing free; a touch names no
            disc of the cell; `start` has other effects.
        UnsupportedDataError: too few touches for the free parameters, touches so much
            alike that they determine less than half of them, or a fit that diverges.
        InputError: the forces do not point at the discs.

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
    if wrong := [item for item in effects if not hasattr(item, 'parameters')]:
        remedy = 'take it from catalogue(cell), by its label'
        raise ParameterError('effects', f'expected effects, got {wrong[0]!r:.60}', remedy)
    start = _start(cell, effects, start, fixed)
    if warm_start is not None:
        warm_start = warm_start._replace(model=_with_fixed(warm_start.model, fixed))
    held = start.held.union(start.aliases, fixed)
    free = np.array([j for j, name in enumerate(start.names) if name not in held], dtype=np.intp)
    given = touches.index
    touches, left_out = _leave_out(touches, cell)
    if warm_start is not None:
        warm_start = warm_start._replace(used=warm_start.used[np.isin(given, touches.index)])
    needed = fewest_touches(len(free), known)
    if len(touches) < needed:
        problem = f'{len(touches)} touches give {2 * len(touches)} equations, too few for {len(free)} parameters'
        remedy = f'record {needed} touches at the very least, 36 or more for a good result'
        if known is not None:
            problem = f'{len(touches)} touches are too few to bring a calibration up to date'
            remedy = f'make {needed} at the very least'
        if left_out:
            problem += f'; {len(left_out)} were left out, the first: {left_out[0].reason}'
            remedy = f'check the units and the order of joint angles and forces, or {remedy}'
        raise UnsupportedDataError(problem, remedy)
    alone = cell.has_outlines and len(np.unique(touches.disc)) < 2
    if alone and start.parameters.has_gravity and not held.issuperset(MOMENTS):
        problem = 'under gravity touches of one outline alone may give wrong moments and backlashes'
        raise UnsupportedDataError(problem, 'touch a disc as well, or hold the moments: --fix s1=… --fix s2=…')
    if cell.noise is not None:
        cell = replace(cell, noise=raised(cell.noise, cell, touches.joints))
    observations = observe(touches, cell, known=known)
    to_disc = observations.contact_problem(observations.joints).inward(forward(cell.nominal, observations.joints))
    force = base_force(observations, ExtendedModel(cell.nominal))
    cosine = (to_disc * force).sum(axis=1) / np.maximum(np.hypot(*to_disc.T) * np.hypot(*force.T), 1e-12)
    if (cosine < 0.5).mean() >= 0.5:  # the right frame and sign give more than 0.8, even 20 mm and 3° off
        problem = 'the forces do not point from the tip to the discs'
        raise InputError('force', problem, 'give the force on the object; check sign, frame and axes of the sensor')
    try:
        found = estimate(observations, cell, start, free, warm_start)
        if start.parameters.has_gravity and warm_start is None:
            touches, found, unsettled = _settle_flanks(touches, cell, start, free, found)
            left_out += unsettled
        if cell.has_outlines:
            touches, found, unsettled = _reassociate(touches, cell, start, free, found)
            left_out += unsettled
    except np.linalg.LinAlgError as error:
        problem = 'the fit diverged to where the model is not defined'
        raise UnsupportedDataError(problem, 'check the nominal values, the discs and the sensor in the cell') from error
    return build_result(touches, cell, start, fixed, found, left_out)


def _settle_flanks(
    touches: TouchSet, cell: Cell, start: ExtendedModel, free: Indices, found: Estimation
) -> tuple[TouchSet, Estimation, list[Rejection]]:
    """Fit again under gravity without touches whose flank is not told; where the rest disagree, once more with fewer
    torques taken as of known sign, if these agree: a model error that no flank explains is left to the diagnosis.
    """
    everything, good, needed = found.observations, found.used, fewest_touches(len(free))
    noise = cell.noise or min(found.noise, USUAL_NOISE, key=lambda one: one.joint_rms)  # not what a model error adds

    def with_told_flanks(found: Estimation, *, wide: bool) -> tuple[Mask, Estimation]:
        """Twice by the touches whose torques have a known sign, which no flank can mislead; then by all but those whose
        flank this fit does not tell, and once more where their flanks were not yet right.
        """
        for is_last in (False, False, True, True):
            fit = found.fit.point
            point = project(everything.with_errors(fit.errors), fit.model, noise)
            along, covariance = point.whitened.jacobian[:, 0], covariance_of_fit(found.fit, found.subspace)
            # over the variance of a touch
            predicted = np.einsum('ni,ij,nj->n', along, covariance, along, optimize=True)
            apart = nearest_flanks(everything, fit.model, point.adjusted.state, wide=wide)[1] / point.whitened.root[0]
            apart /= np.sqrt(1.0 + predicted)
            # flanks that are so many standard deviations apart are told; with 6 wrong ones are left
            known = (apart >= 8.0) & ~_only_guessed(point, wide) if is_last else np.isinf(apart)
            if known.sum() >= (1 if is_last else 3) * needed:
                near = WarmStart(fit.model, found.noise, good[known], fit.errors)
                found = estimate(everything.select(known), cell, start, free, near)
        return known, found

    known, found = with_told_flanks(found, wide=False)
    if _disagree(found, noise, len(free)):
        with suppress(UnsupportedDataError):
            fewer, other = with_told_flanks(found, wide=True)
            if fewer.sum() >= 3 * needed and not _disagree(other, noise, len(free)):
                known, found = fewer, other
    reason = 'the torque of a joint is near zero: on which side of its backlash it rests is not known'
    if known.sum() < needed:
        raise UnsupportedDataError(f'of {(~known).sum()} touches {reason}', 'press harder, or farther from the axes')
    unsettled = [Rejection(int(touches.index[k]), reason) for k in np.flatnonzero(~known)]
    return touches.select(known), found, unsettled


def _disagree(found: Estimation, noise: Noise, count: int) -> bool:
    """Whether the touches of a fit of so many values scatter by more than a noise."""
    point = found.fit.point
    distance = project(found.observations.with_errors(point.errors), point.model, noise).distance[found.used]
    freedoms = max(2 * len(distance) - count, 1)
    # standard deviations of chi-square beyond its mean: touches on a wrong flank disagree by more
    return float(distance.sum()) > freedoms + 5.0 * np.sqrt(2 * freedoms)


def _only_guessed(point: Point, wide: bool) -> Mask:
    """Touches whose torque has no sure sign in a joint of which those with a sure one do not show both flanks, (n,):
    the backlash by which the others are judged would be their own.
    """
    state, p = point.adjusted.state, point.parameters
    force = state.magnitude * np.array([np.cos(state.direction), np.sin(state.direction)])
    torques = joint_torques(p, np.array([state.link1, state.link2]).T, force.T).T
    unsure = has_no_sure_sign(p, torques, wide=wide)
    fewest = np.minimum(*(((sign * torques > 0) & ~unsure).sum(axis=1) for sign in (1, -1)))
    # three touches with a torque of sure sign show a flank
    return np.asarray((unsure & (fewest < 3)[:, None]).any(axis=0))


def _reassociate(
    touches: TouchSet, cell: Cell, start: ExtendedModel, free: Indices, found: Estimation
) -> tuple[TouchSet, Estimation, list[Rejection]]:
    """Fit again with every touch on the edge or corner where the fit before places it; those that alternate are left
    out, and those in an inner corner, where the tip touches both edges.
    """
    seen, left_out = list[Indices](), list[Rejection]()
    # until every touch is of the edge or corner on which the fit places it
    for _ in range(6):
        observations = found.observations
        seen.append(observations.surface)
        surface = fitted_surfaces(observations, cell, found.fit.point)
        touches = touches.replace(surface=surface)
        # nearer than this to both edges of an inner corner, m, the tip may touch both
        doubtful = cell.surfaces.touch_both(fitted_tips(observations, found.fit.point), 1e-3)
        if (surface == observations.surface).all() and not doubtful.any():
            break
        if any((surface == before).all() for before in seen):
            doubtful |= surface != observations.surface
        if doubtful.any():
            if (~doubtful).sum() < fewest_touches(len(free), observations.known):
                continue  # until it is said
            names = [cell.discs[number].name for number in touches.disc]
            left_out += [
                Rejection(int(touches.index[k]), f'between two edges of {names[k]}: touch it farther from the corner')
                for k in np.flatnonzero(doubtful)
            ]
            touches, seen = touches.select(~doubtful), []
        fit = found.fit.point
        used = found.used if len(found.used) == len(touches) else np.ones(len(touches), dtype=bool)
        near = WarmStart(fit.model, found.noise, used, fit.errors)
        found = estimate(observe(touches, cell, known=observations.known), cell, start, free, near)
    else:
        problem = 'the touches do not settle on the edges and corners of the outlines'
        raise UnsupportedDataError(problem, 'touch farther from the corners, or check the places of the objects')
    return touches, found, left_out


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
    if all(name in fixed for name in start.parameters.names):
        count = 'fourteen' if start.parameters.has_gravity else 'twelve'
        raise ParameterError('fixed parameters', f'all {count} are fixed', 'leave one free at least')
    check_units(fixed, cell.nominal)
    start = _with_fixed(start, fixed)
    start.parameters.check_physical('fixed parameters' if fixed else 'nominal')
    return start


def _with_fixed(model: ExtendedModel, fixed: Mapping[str, float]) -> ExtendedModel:
    if not fixed:
        return model
    pairs = zip(model.names, model.as_array().tolist(), strict=True)
    return model.with_array([fixed.get(name, value) for name, value in pairs])


def _checked(fixed: Mapping[str, float] | None) -> dict[str, float]:
    """Parameters to hold, each with a finite number.

    Raises:
        ParameterError: one has not.
    """
    expect(fixed or {}, Mapping, 'fixed', "give values by name, such as {'l1': 0.3302}")
    values = dict(fixed or {})
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
            raise ParameterError(f'fixed parameter {name}', f'expected a number, got {value!r:.40}')
        if not np.isfinite(value):
            raise ParameterError(f'fixed parameter {name}', f'expected a finite number, got {value:g}')
    return values


def _leave_out(touches: TouchSet, cell: Cell) -> tuple[TouchSet, list[Rejection]]:
    """Take out touches without a force, and readings that repeat an earlier one to the last bit."""
    magnitude = np.hypot(touches.force[:, 0], touches.force[:, 1])
    least = 3.0 * cell.noise.force_rms if cell.noise else 1e-6  # N; below it a force has no direction to speak of
    earlier = numbers = np.arange(len(touches))
    if len(set(touches.joints[:, 0].tolist())) < len(touches):  # as hardly ever
        rows = np.concatenate([touches.joints, touches.force], axis=1)
        _, first, which = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        earlier = first[which.ravel()]
    kept = (magnitude > least) & (earlier == numbers)
    if kept.all():
        return touches, []
    left_out = []
    for k in np.flatnonzero(~kept):
        noise = f' of {cell.noise.force_rms:.2g} N' if cell.noise else ''
        reason = f'presses with {magnitude[k]:.2g} N only: its direction is noise{noise}'
        if magnitude[k] > least:
            reason = f'the same reading as touch {touches.index[earlier[k]]}, to the last bit'
        left_out.append(Rejection(int(touches.index[k]), reason))
    return touches.select(kept), left_out


def parse_fixed(text: str, where: str = 'fixed') -> tuple[str, float | None]:
    """Name and value of a text such as ``l1=0.3302`` or ``object_radius[disc_2].radius=0``; None without a value.

    Raises:
        ParameterError: no such parameter, or no number.
    """
    name, sign, value = (part.strip() for part in text.partition('='))
    if '.' not in name and name not in UNITS:
        remedy = did_you_mean(name, UNITS)
        effect = '' if '[' not in name else ', and of an effect such as object_radius[disc_2].radius'
        raise ParameterError(f'{where} {name}', f'expected the name of a parameter{effect}', remedy)
    if not sign:
        return name, None
    try:
        return name, float(value)
    except ValueError:
        raise ParameterError(f'{where} {name}', f'expected a number, got {value!r}') from None


def fixed_values(texts: Iterable[str], nominal: Parameters, where: str = 'fixed') -> dict[str, float]:
    """Values by name of texts; without a value the nominal one, and 0 for a parameter of an effect.

    Raises:
        ParameterError: one of them is wrong.
    """
    values = nominal.as_dict()
    pairs = (parse_fixed(text, where) for text in texts)
    return {name: values.get(name, 0.0) if value is None else value for name, value in pairs}


def check_units(fixed: Mapping[str, float], nominal: Parameters) -> None:
    """Check that no value is as far from the nominal one as one in mm, degrees or µm would be.

    Raises:
        ParameterError: one is.
    """
    for name, range_of_plausible in zip(NAMES, SCALES, strict=True):
        off = abs(fixed.get(name, getattr(nominal, name)) - getattr(nominal, name))
        if off > 10 * range_of_plausible:
            problem = f'is {off:.3g} {UNITS[name]} from its nominal value'
            usual = {'rad': ', not in degrees', 'm': ', not in mm'}.get(UNITS[name], '')
            remedy = f'give it in {UNITS[name]}{usual}, or correct the nominal value'
            raise ParameterError(f'fixed parameter {name}={fixed[name]:g}', problem, remedy)


def fixed_effects(fixed: Mapping[str, float], cell: Cell) -> tuple[Effect, ...]:
    """The effects whose parameters are held, all of each.

    Args:
        fixed: values by name; of effects such as ``object_radius[disc_2].radius``.
        cell: that has the joints and discs.

    Raises:
        ParameterError: no such effect, or not all parameters of one.
    """
    effects = []
    for label in dict.fromkeys(name.rpartition('.')[0] for name in fixed if '.' in name):
        effect = find(cell, label)
        names = [f'{label}.{p.name}' for p in effect.parameters if not p.is_alias]
        missing = [name for name in names if name not in fixed]
        if missing:
            problem = f'{missing[0]} is free: an effect is held by all of its parameters'
            raise ParameterError(f'fixed parameters of {label}', problem, f'give {" and ".join(names)}')
        values = np.array([fixed.get(f'{label}.{p.name}', 0.0) for p in effect.parameters])
        if values.any() and not effect.is_plausible(values):
            raise ParameterError(f'fixed parameters of {label}', 'expected plausible values', 'give them in SI units')
        effects.append(effect)
    return tuple(effects)

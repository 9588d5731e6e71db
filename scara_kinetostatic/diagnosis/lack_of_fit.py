"""Lack of fit: F-tests of the residual against everything that it could depend on; noise that grows with the force.

If the model is complete, the whitened misclosures of the used touches are white noise, projected off the columns of
the fit. An effect that the model lacks makes them depend smoothly on a joint angle, a torque, the force, the disc, the
place on it, the time. Each such family of functions is added to the linearised fit, and its contribution is tested by
an F-test, which is valid whether the noise was given or estimated.

**Score tests** look for further variances of the residual, beside those of the joint angles and of the force. The
scatter of the residual of a fit is compared with what V of `calibration.noise` says: if the noise of a
touch has a further component, the squares of the whitened residuals are larger where that component acts. Each kind is
tested by the score of its variance at zero, with those of the other kinds of any size, so that the p-value does not
depend on the size of the stated noise.

Source: Rao, Large sample tests of statistical hypotheses, Proc. Camb. Phil. Soc. 44 (1948) 50; for variance
components, Verbeke and Molenberghs, Biometrics 59 (2003) 254.

`adequacy` is all tests of a model: whether its residual is noise.

**Noise that grows** with the force, where the cell description does not state it, is estimated only where the scatter
of the touches shows it:

- where the diagnosis finds nothing missing, or what is missing, by a score test (`growing_p_value`) at the last
  fit, at a false alarm rate well below 1 %, confirmed by the deviance with it in the linear problem there;
- where the residuals are larger than stated, or unlike noise, by the deviance alone: then noise that grows competes
  with contact friction and with a lack of fit.

In both cases the touches are diagnosed anew with the noise found, and the likelier of the two diagnoses is kept. A
model error is no noise: it depends on something, so the F-tests find it whatever the weights are.

With other noise other touches are outliers. So a rejected touch has a penalty, the squared distance d² beyond which
touches are rejected. Over all touches,

    D = Σ_used d² + Σ_declared e² + Σ_rejected d²_rejection + Σ ln det V,

and the smaller D is the likelier model.

**Contact friction** is a random off-normal angle α of each force, which shifts no mean. It adds the variance
σ_α² h_α h_αᵀ to that of the noise, which grows with the disc's radius, whereas that by noise of the force decreases
with its size: a score test of this component, and σ_α estimated along with the noise (`calibration.estimate`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.fit_point import Point, last_step, select, unfitted
from scara_kinetostatic.calibration.gauss_helmert import noise_left, whiten_by, whitened_square
from scara_kinetostatic.calibration.identifiability import NOISE_SHARE
from scara_kinetostatic.calibration.noise import as_stated, estimated_levels, growing, noise_of_residuals
from scara_kinetostatic.calibration.outliers import FALSE_REJECTIONS, find_good
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import ActivePrior
from scara_kinetostatic.diagnosis.linear_problem import (
    CREDIBLE,
    FORCE_LEVELS,
    INDEPENDENT_PART_CAUTIOUS,
    SIGNIFICANCE,
    STRICT_SIGNIFICANCE,
)
from scara_kinetostatic.diagnosis.result import Dependence, Diagnosis
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.gaussian import least_squares
from scara_kinetostatic.gaussian.linear_model import blocks, independent_part, orthonormal
from scara_kinetostatic.gaussian.p_values import f_test
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.flanks import view_arm


def _families(calibration: Calibration, point: Point) -> Iterator[tuple[str, Floats, Floats | None]]:
    """All families at the used touches: smooth functions along and across the force, displaced discs, joints whose zero
    changes.

    Yields:
        The name of the quantity, the functions at each touch, (n, 2, m), whitened but for the smooth ones, and their
        change by one standard deviation of the noise in the forces, (n, 2, m); None for nothing.
    """
    touches, state, root = calibration.touches.select(calibration.used), point.adjusted.state, point.whitened.root
    arm = view_arm(point.parameters, state)
    f, phi = state.magnitude, state.direction
    q1, q2 = point.adjusted.joints.T
    link2 = q1 + q2 + point.parameters.theta1 + point.parameters.theta2
    larger = f + noise_left(point.linear, root, calibration.noise, 0)
    by_force = {
        'the torque of joint 1': (f * arm.lever[0], larger * arm.lever[0]),
        'the torque of joint 2': (f * arm.lever[1], larger * arm.lever[1]),
        'the size of the force': (f, larger),
    }
    if np.std(f) < FORCE_LEVELS * calibration.noise.force_at(float(np.mean(f))):
        del by_force['the size of the force']  # its differences are noise
    smooth = {
        'the angle of joint 1': _waves(q1, 2),
        'the angle of joint 2': _waves(q2, 2),
        **{name: _powers(values) for name, (values, _) in by_force.items()},
        'the direction of the force': _waves(phi, 2),
        'the direction of the force relative to link 2': _waves(phi - link2, 2),
        'the touched disc': (touches.disc[:, None] == np.unique(touches.disc)).astype(float),
        'the elbow posture': touches.posture[:, None].astype(float),
        'the direction of approach': np.sign(touches.approach),
        'time': _powers(touches.time)[:, :2],
    }
    noise = {name: _powers(*values) - smooth[name] for name, values in by_force.items()}
    for name, columns in smooth.items():
        for side, on_side in zip(('along', 'across'), np.eye(2)[:, :, None], strict=True):
            changed = noise[name][:, None] * on_side if name in noise else None
            yield f'{name} ({side} the force)', columns[:, None] * on_side, changed
    # a disc displaced, or of another radius: h changes by the displacement along n and t, by the radius along n
    c, s, one, none = np.cos(phi), np.sin(phi), np.ones_like(phi), np.zeros_like(phi)
    shifts = np.stack([np.stack([c, s, one], axis=-1), np.stack([-s, c, none], axis=-1)], axis=1)
    for disc in np.unique(touches.disc):
        columns = whiten_by(shifts * (touches.disc == disc)[:, None, None], root)
        yield f'place and size of {calibration.cell.discs[disc].name}', columns, None
    # the zero of a joint drifts with time, jumps at some time, or depends on the direction of approach
    order = np.argsort(np.argsort(touches.time, kind='stable'))
    parts = [np.where(order >= len(order) * part, 0.5, -0.5) for part in (0.25, 0.5, 0.75)]
    drift = np.stack([_powers(touches.time)[:, 0], *parts], axis=-1)
    for joint, turns in enumerate(np.moveaxis(whiten_by(point.linear.by_joints, root), -1, 0)[..., None]):
        approach = np.sign(touches.approach[:, joint])[:, None, None]
        yield f'time, through the zero of joint {joint + 1}', turns * drift[:, None, :], None
        yield f'the direction of approach, through joint {joint + 1}', turns * approach, None


def _waves(angle: Floats, most: int) -> Floats:
    return np.stack([wave(k * angle) for k in range(1, most + 1) for wave in (np.cos, np.sin)], axis=1)


def _powers(values: Floats, at: Floats | None = None) -> Floats:
    """Powers of values (n,) scaled to their range, (n, 3); or of the values `at`, scaled alike."""
    span = float(np.ptp(values)) or 1.0
    z = ((values if at is None else at) - values.mean()) / span
    return np.stack([z, z**2, z**3], axis=1)


def find_dependences(calibration: Calibration) -> tuple[Dependence, ...]:
    """Test every family.

    Args:
        calibration: with or without effects.

    Returns:
        One test per family that is independent of the fitted parameters, the most significant first.
    """
    c = calibration
    point = select(c.projection, c.used)
    n = len(point.distance)
    uninformative = n if c.model.off_normal_std else 0
    marginal, unprojected = unfitted(point)
    jacobian = marginal.apply((point.whitened.derivative @ c.subspace.basis).reshape(2 * n, -1))
    base = np.linalg.qr(jacobian)[0]
    residual = unprojected - base @ (base.T @ unprojected)
    # sizes above the likeliest ones take some of what is noise, whose level is known along with them
    least = 0.0 if c.random is None else 1.0
    dependences = []
    for name, columns, noise in _families(c, point):
        changed = None if noise is None else noise.reshape(2 * n, -1)
        added = marginal.apply(columns.reshape(2 * n, -1))
        unit = independent_part(base, added, INDEPENDENT_PART_CAUTIOUS, changed, NOISE_SHARE)
        explained, total = float(np.square(unit.T @ residual).sum()), float(residual @ residual)
        freedoms = 2 * n - uninformative - base.shape[1]
        tested = f_test(explained, unit.shape[1], total, len(residual), freedoms, least)
        if tested is not None:
            dependences.append(Dependence(name, *tested))
    return tuple(sorted(dependences, key=lambda dependence: dependence.p_value))


JOINT, FORCE, GROWING, OFF_NORMAL = 'joint', 'force', 'growing', 'off_normal'
"""Kinds of variance."""


def _score(c: Calibration, kind: str, beside: Sequence[str]) -> float:
    """The score of one variance in its standard deviations, less what the others explain of it; 0 if they are alike."""
    observations = c.observe(c.used)
    point = select(c.projection, c.used)
    jacobian = (point.whitened.derivative @ c.subspace.basis).reshape(2 * len(point.distance), -1)
    if point.whitened.by_errors is not None:  # whatever the declared errors are; random effects as they are estimated
        by_errors = point.whitened.by_errors[:, :, : len(c.errors)]
        jacobian = np.concatenate([by_errors.reshape(len(jacobian), -1), jacobian], axis=1)
    base = orthonormal(jacobian)
    residual = point.whitened.residual.ravel()
    left = residual - base @ (base.T @ residual)
    # the limit keeps exact data solvable
    size = max(float(left @ left) / max(len(left) - base.shape[1], 1), 1e-12)
    roots = _roots_of_variances(c, observations.radii, point)
    kinds = [whitened_square(roots[name], point.whitened.root) for name in (*beside, kind)]
    rows = base.reshape(-1, 2, base.shape[1])
    kept = np.eye(2) - blocks(rows)
    e = (left / np.sqrt(size)).reshape(-1, 2)
    score = np.array([np.einsum('ni,nij,nj->', e, part, e) - np.einsum('nij,nji->', part, kept) for part in kinds])
    half = [np.einsum('nij,njk->nik', part, kept) for part in kinds]
    information = 2 * np.array([[np.einsum('nij,nji->', first, second) for second in half] for first in half])
    weights = np.linalg.lstsq(information[:-1, :-1], information[:-1, -1], rcond=1e-9)[0]
    value, variance = score[-1] - weights @ score[:-1], information[-1, -1] - weights @ information[:-1, -1]
    return float(value / np.sqrt(variance)) if variance > 0 else 0.0


def _roots_of_variances(c: Calibration, radii: Floats, point: Point) -> dict[str, Floats]:
    """B of each kind of variance B Bᵀ of each touch, of about unit size when whitened, (n, 2, k)."""
    linear, noise = point.linear, c.noise
    by_off_normal = np.zeros((len(radii), 2, 1))
    by_off_normal[:, 1, 0] = 0.01 * radii  # scale of the angles, rad; the p-value does not depend on it
    square = float((linear.force**2).sum(axis=1).mean())
    return {
        JOINT: noise.joint_rms * linear.by_joints,
        FORCE: noise.force_rms * linear.by_force,
        GROWING: noise.force_rms / np.sqrt(square) * growing(linear),
        OFF_NORMAL: by_off_normal,
    }


class Adequacy(NamedTuple):
    """The test of a model.

    Attributes:
        p_value: of "it is complete", Bonferroni-corrected over all tests.
        dependences: what the residual depends on, significant ones only, the most significant first.
    """

    p_value: float
    dependences: tuple[Dependence, ...]


def adequacy(c: Calibration) -> Adequacy:
    """Test a model, with or without effects, against all that its residual could depend on."""
    dependences = find_dependences(with_free_off_normal_angles(c))
    given = c.noise_source == 'given'
    size = float(special.chdtrc(c.degrees_of_freedom, c.chi_square)) if given else 1.0
    tests = max(len(dependences) + given, 1)
    significant = tuple(item for item in dependences if item.p_value * tests < SIGNIFICANCE)
    return Adequacy(min(1.0, tests * min([size, *(item.p_value for item in dependences)])), significant)


def off_normal_p_value(calibration: Calibration, beside_growing: bool = False) -> float:
    """P-value of "the off-normal angles are noise", one-sided.

    It does not depend on the size of the stated noise: the residuals are scaled to unit variance.

    Args:
        calibration: with or without effects, none of them with an off-normal angle.
        beside_growing: whether the noise of the force may grow with it, which acts along the force as well as across.
    """
    beside = (JOINT, FORCE, GROWING) if beside_growing else (JOINT, FORCE)
    return float(special.ndtr(-_score(calibration, OFF_NORMAL, beside)))


def growing_p_value(calibration: Calibration, beside: Sequence[str] = (JOINT, FORCE, OFF_NORMAL)) -> float:
    """P-value of "the noise of the force is the same at all forces", one-sided against noise that grows with it.

    Args:
        calibration: with or without effects.
        beside: further kinds of variance, of any size.
    """
    return float(special.ndtr(-_score(calibration, GROWING, beside)))


def with_free_off_normal_angles(calibration: Calibration) -> Calibration:
    """The same with unconstrained off-normal angles, where it has them: its residual is then free of them.

    Off-normal angles may depend on anything; a test for a lack of fit is to use the other half of the residual.
    """
    # a standard deviation of 10 rad leaves the angle free
    return calibration.changed(model=calibration.model.with_off_normal_std(10.0))


PENALTY = 6.0
"""Decrease of the deviance that noise that grows must bring where the residuals are larger than noise."""
_MOST_ROUNDS, _SAME_LEVEL = 20, 0.01
"""Of the estimation of noise levels in the linear problem, and relative change of a level that ends it."""


def noise_candidate(calibration: Calibration, found: Diagnosis) -> Calibration | None:
    """The base model refitted with noise that grows with the force, where the touches ask for it.

    Args:
        calibration: the base model.
        found: its diagnosis: the noise is looked for at the extended model, or else at the base model.
    """
    c, extended = calibration, found.extended
    # with fewer degrees of freedom the scatter does not show what it depends on
    if c.noise.force_relative is not None or c.degrees_of_freedom < 30 or c.model.off_normal_std:
        return None
    is_friction = extended is not None and bool(extended.model.off_normal_std)
    suspicious = found.verdict == 'unexplained' or is_friction
    plain = None if extended is None or is_friction else fit_again(extended)
    fits = [c] if plain is None else [plain, c] if suspicious else [plain]
    noises = (_noise_of(fit, suspicious) for fit in fits)
    noise = next((noise for noise in noises if noise is not None), None)
    return None if noise is None else fit_again(c, noise=noise)


def _noise_of(c: Calibration, suspicious: bool) -> Noise | None:
    """The noise of a fit without off-normal angles, with a part that grows with the force; None if it asks for none."""
    # where the residuals are larger than noise, a hint is enough, or that they depend on nothing: the levels are then
    # as stated, and the score test, which leaves them free, sees little
    asked = growing_p_value(c, (JOINT, FORCE)) < (0.03 if suspicious else STRICT_SIGNIFICANCE)
    asked = asked or (suspicious and c.cell.noise is not None and not _depends_on_something(c))
    if not asked:
        return None
    try:
        noise, least = _noise_and_deviance(c, c.noise._replace(force_relative=0.01), c.cell)
        gain = _noise_and_deviance(c, c.noise, c.cell)[1] - least
        # stated levels that are all too small may explain the touches clearly better
        plain, free = as_stated(c.noise._replace(force_relative=None), None), replace(c.cell, noise=None)
        other = np.inf if c.cell.noise is None else _noise_and_deviance(c, plain, free)[1]
    except np.linalg.LinAlgError:
        return None
    # noise that grows by more than 5 % of the force is a model error
    if not gain >= (PENALTY if suspicious else CREDIBLE) or noise.growth > 0.05 or not other >= least - CREDIBLE:
        return None
    return None if suspicious and _depends_on_something(c.changed(noise=noise)) else noise


def _noise_and_deviance(c: Calibration, noise: Noise, cell: Cell) -> tuple[Noise, float]:
    """The noise by the residuals, and D, in the linear problem at a fit.

    Args:
        c: the fit.
        noise: to begin with; it has the components wanted.
        cell: which levels are stated.

    Raises:
        LinAlgError: they do not settle, or a touch is where the model is not defined.
    """
    observations, used = c.observe(), c.used
    basis, prior = c.subspace.with_errors(len(observations.errors)), ActivePrior.of(observations, c.subspace)
    for _ in range(_MOST_ROUNDS):
        point = c.projection.with_noise(noise)
        known, w = None if prior is None else prior.system(point), point.whitened
        system = least_squares.compress(w.jacobian, w.residual, used.astype(float), basis, known)
        point = last_step(point, basis @ least_squares.damped_step(system, 0.0))
        good, following = find_good(point.distance), noise
        if estimated_levels(noise, cell.noise):
            following, _ = noise_of_residuals(observations, point, good, c.subspace, noise, cell)
        pairs = zip(following.levels, noise.levels, strict=True)
        if (good == used).all() and all(abs(after - before) <= _SAME_LEVEL * before for after, before in pairs):
            l11, _, l22 = w.root
            distance = np.where(used, point.distance, -2 * np.log(FALSE_REJECTIONS / len(used)))
            return noise, float(np.sum(distance + 2 * np.log(l11 * l22))) + (prior.cost(point) if prior else 0.0)
        noise, used = following, good
    raise np.linalg.LinAlgError('noise levels and outliers do not settle')


def _depends_on_something(c: Calibration) -> bool:
    """Whether the residual of a fit, weighted by its noise, shows a model error."""
    dependences = find_dependences(c)
    return bool(dependences) and dependences[0].p_value * len(dependences) < STRICT_SIGNIFICANCE


def fit_again(c: Calibration, *, noise: Noise | None = None, cell: Cell | None = None) -> Calibration | None:
    """A calibration fitted anew, close to where it is; None where the touches have no such fit. The touches that were
    rejected before any fit stay so.

    Args:
        c: the calibration.
        noise: to start from; that of the calibration by default.
        cell: another description of the cell; likewise.
    """
    warm_start = WarmStart(c.model, noise or c.noise, c.used, c.errors)
    try:
        fit = calibrate(c.touches, cell or c.cell, c.model.effects, fixed=c.fixed, warm_start=warm_start)
    except UnsupportedDataError:
        return None
    if not np.isfinite(fit.projection.distance[fit.used]).all():
        return None  # free, rivals may go off to where the model is not defined
    places = set(c.touches.index.tolist())
    left_out = [item for item in c.rejected if item.index not in places]
    return fit.changed(rejected=tuple(sorted((*left_out, *fit.rejected), key=lambda item: item.index)))

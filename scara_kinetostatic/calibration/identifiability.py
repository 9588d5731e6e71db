"""Identifiability: rank, condition, and the groups of parameters that the data do not separate.

A direction of L̄ is unidentifiable for either of two reasons.

- **It hardly moves the predictions**: a change along it by the whole range a robot's
  parameter can plausibly have (`SCALES`) moves them by less than one standard deviation.
- **Its information is noise**: the Jacobian is evaluated at measured quantities. With one
  force level, the columns of p_ee and g_ee are proportional but for the noise of the
  measured force, and a fit separates the two by that noise. The part ρ of the
  information along a direction that the noise of the observations alone would
  produce is worked out from the derivatives of the Jacobian; 1 - ρ is the
  reliability ratio of errors-in-variables regression. Above `NOISE_SHARE` the direction is unidentifiable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.fit_point import Point, select
from scara_kinetostatic.calibration.gauss_helmert import linearise, noise_left, place_force, whiten_by
from scara_kinetostatic.calibration.observations import JointPrior, Observations, Prior
from scara_kinetostatic.gaussian.least_squares import Compressed, compress, upper_triangle
from scara_kinetostatic.model.arrays import Floats, Indices, pick
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.contact_force import solve_links
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import MOMENTS, NAMES, UNITS

SCALES = np.array([0.02, 0.02, 0.05, 0.02, 0.05, 0.02, 1e-4, 1e-3, 1e-3, 1e-3, 5e-3, 5e-3])
"""Plausible range of each parameter about its nominal value, in its unit; also the solver's scaling."""
NOISE_SHARE = 0.25
_SAMPLE_SIZE = 1024
"""Touches from which the information that noise produces is worked out, if there are more: drawn at random."""
_MEMBER_PART = 0.05
"""A parameter belongs to a group if its part of the unidentifiable direction, in `SCALES`, is at least this."""


def scales_of(model: ExtendedModel) -> Floats:
    """Plausible range of each value of a model, (12 + k,): `SCALES`, then those of the effects."""
    base = np.append(SCALES, (2.0, 2.0)) if model.parameters.has_gravity else SCALES  # of s1 and s2, kg m
    return np.concatenate([base, model.effect_scales]) if model.effects else base


class Combination(NamedTuple):
    """A sum of confounded parameters that the data do determine.

    Attributes:
        first: name of the one.
        factor: of the other.
        second: name of the other.
        value: estimate of first + factor · second.
        std: its standard deviation.
        unit: its unit.
    """

    first: str
    factor: float
    second: str
    value: float
    std: float
    unit: str

    @property
    def text(self) -> str:
        """The sum, such as ``g_ee + 40.0 p_ee``."""
        return f'{self.first} {"-" if self.factor < 0 else "+"} {abs(self.factor):.4g} {self.second}'


@dataclass(frozen=True)
class Identifiability:
    """What the data show.

    Attributes:
        rank: number of independent combinations of the free parameters that the data determine.
        condition: condition number of the weighted Jacobian with unit columns, over what is determined.
        confounded: groups of parameters that only together are determined, by name;
            a group of one is a parameter that the data do not determine at all.
        combinations: what of each pair is determined all the same.
        advice: which touches would cure it; empty where nothing is confounded.
    """

    rank: int
    condition: float
    confounded: tuple[tuple[str, ...], ...] = ()
    combinations: tuple[Combination, ...] = ()
    advice: str = ''


def unidentifiable_directions(observations: Observations, point: Point, free: Indices, noise: Noise | None) -> Floats:
    """The unidentifiable directions of a model.

    Args:
        observations: the used touches.
        point: the fit there.
        free: positions of the parameters that are not fixed, (k,).
        noise: σ_q and σ_f with which the fit was whitened; None not to ask what noise makes.

    Returns:
        (k, d) orthonormal columns in units of `SCALES`; d = 0 where all are identifiable.
    """
    scale = np.diag(scales_of(point.model))[:, free]
    if (prior := observations.prior) is not None:
        scale, system = _without_errors(prior, point, scale)
    else:
        system = compress(point.whitened.derivative, point.whitened.residual, basis=scale)
    weak = system.values < 1.0
    if noise is None and not weak.any():
        return np.empty((len(free), 0))
    seen, values = system.right[:, ~weak], system.values[~weak]
    by_noise = (
        _noise_triangle(observations, point, noise) @ scale if noise is not None else np.zeros((1, scale.shape[1]))
    )
    _, shares, directions = np.linalg.svd(by_noise @ (seen / values), full_matrices=False)
    noisy = (seen / values) @ directions[shares**2 > NOISE_SHARE].T
    together = np.concatenate([system.right[:, weak], noisy / np.linalg.norm(noisy, axis=0)], axis=1)
    if not together.size:
        return np.empty((len(free), 0))
    scaled = system.values[:, None] * system.right.T
    pure = [_purified(row, scaled, by_noise) for row in _sparse_rows(together.T)]
    return np.asarray(np.linalg.qr(np.array(pure).T)[0])


def _without_errors(prior: Prior | JointPrior, point: Point, scale: Floats) -> tuple[Floats, Compressed]:
    """What the touches and the prior say of the parameters, whatever the declared errors are.

    Args:
        prior: of errors and trusted nominal values.
        point: the fit.
        scale: the changes of the parameters, (12 + k, f).

    Returns:
        The same changes, each with the errors that then fit best, (12 + k + m, f); their compressed system.
    """
    values, changes = scale.shape
    m = prior.errors
    basis = np.zeros((values + m, m + changes))  # the errors first: what is left of the others is beside them
    basis[values:, :m], basis[:values, m:] = np.eye(m), scale
    rows = prior.rows(values)
    flat = point.whitened.jacobian.reshape(-1, values + m)
    triangle = upper_triangle(np.concatenate([flat, rows]) @ basis)
    errors = -np.linalg.solve(triangle[:m, :m], triangle[:m, m:])
    lifted = basis @ np.concatenate([errors, np.eye(changes)])
    left = triangle[m:, m:]
    return lifted, compress(np.stack([left, np.zeros_like(left)], axis=1), np.zeros((changes, 2)))


def _purified(row: Floats, scaled: Floats, by_noise: Floats) -> Floats:
    """An unidentifiable direction without the parameters that noise has mixed into it.

    Of its members, the largest first, as few are kept as are an unidentifiable direction by themselves. `scaled`
    and `by_noise` need not be the Jacobian and its changes: any matrices with the same products of columns do.
    """
    order = np.argsort(-np.abs(row))
    for size in range(1, int((np.abs(row) >= _MEMBER_PART * np.abs(row).max()).sum()) + 1):
        members = order[:size]
        vector = np.linalg.svd(np.linalg.qr(scaled[:, members], mode='r'))[2][-1]
        seen = float(np.sum((scaled[:, members] @ vector) ** 2))
        noise = float(np.sum((by_noise[:, members] @ vector) ** 2))
        if seen < 1.0 or noise > NOISE_SHARE / 2 * seen:
            out = np.zeros_like(row)
            out[members] = vector
            return out
    return np.asarray(row / np.linalg.norm(row))


def _noise_triangle(observations: Observations, point: Point, noise: Noise) -> Floats:
    """How the whitened Jacobian changes by one standard deviation of what noise is left in F̂, along it and across it,
    as the triangle R of its QR factorisation, (12, 12): at four forces, two ways along F̂ and two across.
    """
    count = len(observations.joints)
    if count > _SAMPLE_SIZE:
        some = np.sort(np.random.default_rng(0).choice(count, _SAMPLE_SIZE, replace=False))
        observations, point = observations.select(some), select(point, some)
    a, model, n = point.adjusted, point.model, len(observations.joints)
    x, y = a.force[:, 0], a.force[:, 1]
    size = np.hypot(x, y)
    moved = np.empty((2, 4, n))
    for k, (along_x, along_y) in enumerate(((x / size, y / size), (-y / size, x / size))):
        left = noise_left(point.linear, point.whitened.root, noise, k)
        moved[:, 2 * k] = x + left * along_x, y + left * along_y
        moved[:, 2 * k + 1] = x - left * along_x, y - left * along_y
    every = np.tile(np.arange(n), 4)
    o, adjusted, force = observations.select(every), pick(a, every), moved.reshape(2, -1).T
    placed = place_force(o, model, adjusted.joints, force, adjusted.state)
    state, arm = solve_links(model, o.contact_problem(adjusted.joints, adjusted.off_normal), placed)
    linear = linearise(o, model, adjusted._replace(force=force, state=state), arm)
    l11, l21, l22 = (np.tile(part, 4) for part in point.whitened.root)
    derivative = linear.derivative
    if linear.by_errors is not None:
        derivative = np.concatenate([derivative, linear.by_errors], axis=2)
    columns = whiten_by(derivative, (l11, l21, l22)).transpose(2, 1, 0).reshape(-1, 2, 4, n)
    changes = (columns[:, :, 0::2] - columns[:, :, 1::2]) / 2
    triangle = upper_triangle(changes.reshape(len(columns), -1).T, overwrite=True)
    return triangle * np.sqrt(max(count / _SAMPLE_SIZE, 1.0))


def group_names(
    directions: Floats, free: Indices, model: ExtendedModel, std: Floats | None = None
) -> tuple[tuple[str, ...], ...]:
    """The groups of parameters that unidentifiable directions combine, by name.

    Args:
        directions: (k, d), as `unidentifiable_directions` gives them.
        free: positions of the parameters that are not fixed, (k,).
        model: whose parameters these are.
        std: standard deviations of the fit that holds these directions, (12 + k,): a parameter that such a
            direction could have moved by more than 0.3 of its own belongs to the group as well.
    """
    groups, names, scales = [], model.names, scales_of(model)
    for row in _sparse_rows(directions.T):
        row = row / np.linalg.norm(row)
        members = np.abs(row) >= _MEMBER_PART * np.abs(row).max()
        if std is not None:
            members |= np.abs(row) * scales[free] > 0.3 * std[free]
        groups.append(tuple(names[j] for j in free[members]))
    return tuple(groups)


def _sparse_rows(rows: Floats) -> Floats:
    """Gauss–Jordan elimination with full pivoting: a basis of the same space with few entries per row."""
    rows = rows.copy()
    todo = set(range(len(rows)))
    while todo:
        left = sorted(todo)
        i, j = np.unravel_index(np.argmax(np.abs(rows[left])), (len(left), rows.shape[1]))
        pivot = left[int(i)]
        rows[pivot] /= rows[pivot, j]
        for other in range(len(rows)):
            if other != pivot:
                rows[other] -= rows[other, j] * rows[pivot]
        todo.remove(pivot)
    return rows


def condition_number(derivative: Floats) -> float:
    """Largest over smallest singular value of a Jacobian (…, k) whose columns are made unit."""
    flat = derivative.reshape(-1, derivative.shape[-1])
    norms = np.linalg.norm(flat, axis=0)
    values = np.linalg.svd(np.linalg.qr(flat / np.where(norms > 0, norms, 1.0), mode='r'), compute_uv=False)
    return float(values[0] / values[-1]) if values[-1] > 0 else float('inf')


def determined_pairs(directions: Floats, free: Indices, values: Floats, covariance: Floats) -> tuple[Combination, ...]:
    """For each unidentifiable direction of two parameters, the sum of the two that is determined."""
    found = []
    for row in _sparse_rows(directions.T):
        members = np.flatnonzero(np.abs(row) >= _MEMBER_PART * np.abs(row).max())
        if len(members) != 2:
            continue
        # moving along `row` leaves u + c v as it is for c = -du/dv
        v, u = (int(free[m]) for m in members)
        if max(u, v) >= len(NAMES):
            continue
        du, dv = row[members[1]] * SCALES[u], row[members[0]] * SCALES[v]
        factor = -du / dv
        weights = np.zeros(len(values))
        weights[u], weights[v] = 1.0, factor
        std = float(np.sqrt(weights @ covariance @ weights))
        found.append(Combination(NAMES[u], factor, NAMES[v], float(weights @ values), std, UNITS[NAMES[u]]))
    return tuple(found)


def advise(groups: tuple[tuple[str, ...], ...], mean_force: float) -> str:
    """Which further touches would separate the groups, in one or a few sentences."""
    cures = (
        ({'p_ee', 'g_ee'}, f'touches at another force, {mean_force / 2:.0f} N for instance'),
        ({'p1', 'g1', 'p2', 'g2', 'p_ee', 'g_ee'}, 'touches at other force levels and with other lever arms'),
        (set(NAMES), 'touches on other discs, from other sides and in both postures'),
    )
    sentences = []
    for group in groups:
        if group[0] in MOMENTS:
            sentences.append(
                f'{" and ".join(group)} cannot be determined: static moments act through compliance and backlash of '
                'the joints only; hold them (--fix)'
            )
        elif len(group) == 1:
            sentences.append(f'{group[0]} is not determined; touch where it has more effect, or fix it')
        else:
            cure = next((cure for names, cure in cures if set(group) <= names), cures[-1][1])
            sentences.append(f'{" and ".join(group)} cannot be told apart; add {cure}')
    return '. '.join(sentences)

"""Uncertainty budget (GUM, JCGM 100, 5.1.2 and annex H): what each source contributes to every parameter and the tip.

The covariance of a calibration is the sum of what its independent sources contribute (`Calibration.contributions`):
noise (type A) and all that was declared (type B). A parameter's contribution is the root of the diagonal element, so
that the squares add up to std². That of the tip is aᵀ Σ_s a with a the change of the tip at the worst place, in its
worst direction: the squares add up to (U/2)² there.

**Improvements**: what would reduce the uncertainty of the tip most. With C the covariance of the parameters and the
declared errors together, P the rows of the prior, in units of the declared standard uncertainties u, the information
of the fit is C⁻¹ = Jᵀ J + Pᵀ P. A source that is known to u' instead of u adds ((u/u')² - 1) P_sᵀ P_s to it; by
Woodbury's identity the covariance is then

    C' = C - C P_sᵀ (I / ((u/u')² - 1) + P_s C P_sᵀ)⁻¹ P_s C.

This is more than to subtract the contribution of the source: what is known better helps to determine the rest. Twice
as many touches of the same kind double Jᵀ J = C⁻¹ - Pᵀ P.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.declared_errors import (
    LARGE_EFFECT,
    RIVALS,
    UNDETECTED,
    VALUE,
    DeclaredErrors,
    Prior,
)
from scara_kinetostatic.calibration.result import Calibration, of_full_model
from scara_kinetostatic.calibration.tip_uncertainty import (
    COVERAGE_FACTOR,
    TipUncertainty,
    Workspace,
    tip_uncertainty,
    workspace,
)
from scara_kinetostatic.model.arrays import Floats, Indices

NOISE = 'noise'
"""Label of the only source of type A."""
_TITLES = {
    NOISE: 'noise of the touches',
    'size': 'size of {}',
    RIVALS: 'choice between rival effects',
    VALUE: 'choice of {}',
    UNDETECTED: 'undetected {}',
    'object_position': 'place of {}',
    'object_radius': 'radius of {}',
    'object_rotation': 'rotation of {}',
    'object_offset': 'offset of the sides of {}',
    'plate_position': 'place of plate {}',
    'plate_angle': 'rotation of plate {}',
    'radius': 'error common to all radii',
    'force_gain': 'gain of the force sensor',
    'force_rotation': 'rotation of the force sensor',
    'nominal': 'nominal value of {}',
}


def source_title(label: str) -> str:
    """A source in words: ``place of disc_1`` for ``object_position[disc_1]``."""
    kind, _, rest = label.partition('[')
    target = rest.rstrip(']')
    return _TITLES.get(kind, label).format(target.replace('_', ' ') if kind == UNDETECTED else target)


class Item(NamedTuple):
    """One source of the budget. Contributions are standard uncertainties.

    Attributes:
        label: ``noise``, or as `declared_errors.Source` has it.
        declared: its declared standard uncertainty; None for noise and credible models.
        unit: of `declared`.
        parameters: contribution to each of the base model, (12,), in their units; NaN where confounded.
        tip: contribution to the tip where its uncertainty is largest, in its worst direction, m; NaN if undetermined.
    """

    label: str
    declared: float | None
    unit: str
    parameters: Floats
    tip: float

    @property
    def title(self) -> str:
        """The source in words."""
        return source_title(self.label)

    @property
    def evaluation(self) -> str:
        """``A`` or ``B`` (GUM, 2.3.2 and 2.3.3)."""
        return 'A' if self.label == NOISE else 'B'


def uncertainty_budget(c: Calibration, tip: TipUncertainty | None = None) -> tuple[Item, ...]:
    """The budget of a calibration: noise first, then the declared sources in the order of the cell description.

    Args:
        c: the calibration.
        tip: its uncertainty of the tip, where there is one.
    """
    at = (tip_uncertainty(c) if tip is None else tip).at
    undetermined = np.isnan(c.std)

    def item(label: str, declared: float | None, unit: str, covariance: Floats) -> Item:
        variances = np.clip(np.diag(covariance)[: len(c.std)], 0.0, None)
        of_tip = np.nan if at is None else np.sqrt(max(float(at.gradient @ covariance @ at.gradient), 0.0))
        return Item(label, declared, unit, np.where(undetermined, np.nan, np.sqrt(variances)), float(of_tip))

    return tuple(item(*part) for part in c.contributions)


class Improvement(NamedTuple):
    """An action, and the uncertainty of the tip after it.

    Attributes:
        labels: the sources that are then known better; `NOISE` for twice as many touches.
        declared: the largest declared standard uncertainty of them now; the number of touches for more touches.
        wanted: the same after it.
        unit: of both; empty for a number of touches.
        median: expanded uncertainty of the tip, median over the workspace, m.
        worst: the largest, m.
    """

    labels: tuple[str, ...]
    declared: float
    wanted: float
    unit: str
    median: float
    worst: float


def improvements(c: Calibration, area: Workspace | None = None) -> list[Improvement]:
    """Every source by itself, all of one kind together, and twice as many touches; the most effective first.

    Args:
        c: the calibration.
        area: its workspace, where there is one.
    """
    area = workspace(c) if area is None else area
    found = [*_better_known(c, area), *_more_touches(c, area)]
    return sorted(found, key=lambda each: each.worst)


def best_improvement(found: list[Improvement], worst: float, tolerance: float | None = None) -> Improvement | None:
    """The action to advise: the smallest that meets the tolerance or, where none does, is nearly as good as the best.

    Args:
        found: all actions.
        worst: expanded uncertainty of the tip now, m.
        tolerance: of it; None for none.

    Returns:
        The action; None where none is worth naming.
    """
    useful = [each for each in found if each.worst <= 0.97 * worst]
    if not useful:
        return None
    # a smaller action that is nearly as good is preferred
    target = 1.25 * min(each.worst for each in useful)
    if tolerance is not None and any(each.worst <= tolerance for each in useful):
        target = tolerance
    enough = [each for each in useful if each.worst <= target]
    return min(enough, key=lambda each: (len(each.labels), each.worst))


def round_value(largest: float) -> float:
    """The largest of 1, 2, 5 by a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(largest))
    mantissa = next(m for m in (5, 2, 1) if m <= largest / power * (1 + 1e-9))
    return float(f'{mantissa * power:.0e}')


def _better_known(c: Calibration, area: Workspace) -> Iterator[Improvement]:
    declared = DeclaredErrors.of(c.cell)
    if declared is None:
        return
    prior = c.observe().prior
    assert prior is not None
    known = {source.label for source in declared.prior.sources}
    sources = {source.label: (source, rows) for source, rows in prior.by_source() if source.label in known}
    kinds: dict[str, list[str]] = {}
    for label in sources:
        kinds.setdefault(label.partition('[')[0], []).append(label)
    groups: list[tuple[str, ...]] = [(label,) for label in sources]
    groups += [tuple(labels) for kind, labels in kinds.items() if len(labels) > 1 and kind != 'nominal']
    for group in groups:
        # a source is tried at the largest round value (1, 2 or 5 by a power of ten) that is smaller by this factor
        wanted = round_value(max(sources[label][0].std for label in group) / 3.0)
        labels = tuple(label for label in group if sources[label][0].std > wanted)
        if len(labels) < min(len(group), 2):
            continue
        stds = [sources[label][0].std for label in labels]
        rows = np.concatenate([sources[label][1] for label in labels])
        ratios = np.concatenate([np.full(len(sources[label][1]), sources[label][0].std) for label in labels]) / wanted
        covariance = _with_prior(c, prior, rows, ratios)
        yield _improvement(c, area, labels, (max(stds), wanted), sources[labels[0]][0].unit, covariance)


def _with_prior(c: Calibration, prior: Prior, which: Indices, ratios: Floats) -> Floats:
    """Covariance of all values and errors if rows of the prior were tighter by ratios above 1."""
    values = len(c.model.names)
    rows = prior.rows(values)[which]
    cross = c.covariance_with_errors @ rows.T
    inner = np.diag(1 / (ratios**2 - 1)) * c.enlargement + rows @ cross
    return np.asarray(c.covariance_with_errors - cross @ np.linalg.solve(inner, cross.T))


def _more_touches(c: Calibration, area: Workspace) -> Iterator[Improvement]:
    values, count = len(c.model.names), int(c.used.sum())
    everything = c.covariance_with_errors / c.enlargement
    basis = c.subspace.with_errors(len(c.errors) + len(c.random_values))
    inner = np.linalg.pinv(basis)
    information = np.linalg.inv(inner @ everything @ inner.T)
    prior = c.observe().prior
    rows = np.zeros((0, len(everything))) if prior is None else prior.rows(values)
    known = (rows @ basis).T @ (rows @ basis)
    covariance = basis @ np.linalg.inv(2 * information - known) @ basis.T * c.enlargement
    yield _improvement(c, area, (NOISE,), (count, 2 * count), '', covariance)


def _improvement(
    c: Calibration, area: Workspace, labels: tuple[str, ...], sizes: tuple[float, float], unit: str, covariance: Floats
) -> Improvement:
    kept, scale = of_full_model(c)
    beside = sum(part.covariance for part in c.contributions if part.label.startswith((RIVALS, VALUE, LARGE_EFFECT)))
    expanded = COVERAGE_FACTOR * area.std(scale[:, None] * covariance[np.ix_(kept, kept)] * scale + beside)
    known = expanded[np.isfinite(expanded)]
    median, worst = (float(np.median(known)), float(known.max())) if len(known) else (np.nan, np.nan)
    return Improvement(labels, *sizes, unit, median, worst)

r"""The touches that decide between the sets of effects that may be gross, and what else does.

By the set i, of probability p_i, all values (those of the model, the declared errors and the random effects) are off
those of the calibration by d_i, with the covariance C_i: L̄ is fitted again, what is declared or too small to be
detected is known as well as it is. Touches with the whitened derivatives H by these values are then off the surface by
what is normal about -H d_i with the covariance S_i = H C_i Hᵀ + I.

**Choice.** The probability of a wrong decision is at most

    Σ_(i<j) √(p_i p_j) exp(-B_ij),    B_ij = δᵀ S⁻¹ δ / 8 + ½ ln(|S| / √(|S_i| |S_j|)),

with the Bhattacharyya distance B, δ = H (d_j - d_i) and S = (S_i + S_j) / 2. The touch that lowers the bound most is
added, one after the other. By the chain rule it adds to B what is in it given the touches before: with the pair's
covariance C = (C_i + C_j) / 2 and a touch chosen, H_t, the blocks of all candidates change by the rank-2 update of

    C ← C - C H_tᵀ S_tt⁻¹ H_t C,    δ ← δ - H C H_tᵀ S_tt⁻¹ δ_t.

**Forecast.** Misclosures are drawn by the sets with their probabilities; those of the sets afterwards, p_i times the
normal densities, say how likely the likeliest set is then, on average: this is how often it is the true one.

**What else decides**: a size that is measured otherwise is two rows, or one, in units of the standard uncertainty of
that measurement; a further object brings its own declared errors. Each is judged by the same forecast.

Columns of objects are those of the same objects touched again; effects that depend on time are taken after the touches
made, those that are over as they were left.

Source: Kailath, IEEE Trans. Communication Technology 15 (1967) 52, for the bound.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import NamedTuple, cast

import numpy as np

from scara_kinetostatic.assessment.evidence import worth_doing
from scara_kinetostatic.calibration.observations import DeclaredErrors
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.uncertainty_budget import title_of
from scara_kinetostatic.diagnosis.search import FOUND
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.errors import CellError, UnsupportedDataError
from scara_kinetostatic.gaussian.linear_model import blocks
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Disc
from scara_kinetostatic.model.parameters import MILLI, UNITS
from scara_kinetostatic.model.quantities import quantity
from scara_kinetostatic.planning.candidate_touches import MOST_TOUCHES
from scara_kinetostatic.planning.prediction import RobotModel, exact_plan, is_size
from scara_kinetostatic.simulation.plan import Plan, default_plan

_MOST_SETS = 8
"""The others are as likely after the touches as before."""
_DRAWS = 400
"""By each set."""
_STEPS = np.outer([1.0, 2.0, 5.0], 10.0 ** np.arange(-9, 0)).ravel(order='F')
"""Standard uncertainties of a measurement that are tried, SI."""
_LEAST_PLACE, _LEAST_LENGTH = 2e-6, 2e-5
"""No place of an object and no length of a link is measured better, m."""
_APART = 0.03
"""Distance of a further object from the others, m."""


class Forecast(NamedTuple):
    """What touches, or a measurement, are expected to tell.

    Attributes:
        probability: of the likeliest set afterwards, on average.
        decided: how often it is at least `FOUND`.
    """

    probability: float
    decided: float


class Rivals(NamedTuple):
    """The sets that may be gross, and the robot by each of them.

    Attributes:
        robot: the calibrated one, with its effects and those too small to be detected.
        labels: of the sets.
        probability: (s,); they add up to 1.
        share: of these sets in the probability of all.
        change: d of each, (s, v).
        covariance: C of each, (s, v, v).
    """

    robot: RobotModel
    labels: tuple[tuple[str, ...], ...]
    probability: Floats
    share: float
    change: Floats
    covariance: Floats

    @classmethod
    def of(cls, c: Calibration) -> Rivals | None:
        """Those of a calibration; None where fewer than two sets count."""
        if not c.alternatives:
            return None
        likely = sorted(c.alternatives, key=lambda item: -item.probability)
        columns = () if c.random is None else c.random.columns
        sizes = () if c.random is None else tuple(c.random.size.tolist())
        effects = cast(tuple[Effect, ...], c.model.effects)
        last = float(c.touches.time.max())
        robot = RobotModel(c.cell, c.parameters, c.noise, (), effects, c.model.effect_values, (), columns, sizes, last)
        labels, probability, change, covariance = zip(*likely[:_MOST_SETS], strict=True)
        weight = np.array(probability)
        share = float(weight.sum())
        return cls(robot, labels, weight / share, share, np.array(change), np.array(covariance))

    def rows(self, plan: Plan) -> Floats:
        """H of the touches of a plan, (n, 2, v)."""
        return exact_plan(self.robot, plan).point.whitened.jacobian

    def choose(self, rows: Floats, number: int) -> list[int]:
        """The candidates, of H (n, 2, v), that decide most, all together; none twice."""
        i, j = np.array(list(combinations(range(len(self.labels)), 2))).T
        covariance = np.concatenate([self.covariance, (self.covariance[i] + self.covariance[j]) / 2])
        flat = rows.reshape(-1, rows.shape[2])
        own = np.eye(2) + blocks(rows, self.covariance)
        spread = np.concatenate([own, (own[i] + own[j]) / 2])
        off = (flat @ (self.change[j] - self.change[i]).T).T.reshape(len(i), -1, 2)
        weight, reached = np.sqrt(self.probability[i] * self.probability[j]), np.zeros(len(i))
        sets, chosen = len(self.labels), list[int]()
        for _ in range(min(number, len(rows))):
            logs = np.log(np.maximum(np.linalg.det(spread), 1.0))  # below 1 by rounding alone
            squares = (off * np.linalg.solve(spread[sets:], off[..., None])[..., 0]).sum(axis=-1)
            gain = squares / 8 + logs[sets:] / 2 - (logs[i] + logs[j]) / 4
            bound = weight @ np.exp(-reached[:, None] - gain)
            bound[chosen] = np.inf
            t = int(bound.argmin())
            chosen.append(t)
            reached += gain[:, t]
            half = covariance @ rows[t].T
            inverse = np.linalg.inv(spread[:, t])
            through = (flat @ half).reshape(len(covariance), -1, 2, 2)
            weighed = through @ inverse[:, None]
            off = off - (weighed[sets:] @ off[:, t, None, :, None])[..., 0]
            spread = spread - weighed @ through.swapaxes(-1, -2)
            covariance = covariance - half @ inverse @ half.swapaxes(-1, -2)
        return chosen

    def forecast(self, rows: Floats) -> Forecast:
        """What H, (…, v), is expected to tell."""
        rows = rows.reshape(-1, rows.shape[-1])
        if not len(rows):
            return Forecast(float(self.probability.max()), float(self.probability.max() >= FOUND))
        if len(rows) > rows.shape[1]:  # what is orthogonal to all columns is noise alone
            rows = np.asarray(np.linalg.qr(rows, mode='r'))
        means = self.change @ rows.T
        added, axes = np.linalg.eigh(rows @ self.covariance @ rows.T)
        std = np.sqrt(1 + np.maximum(added, 0.0))  # below 0 by rounding, where a direction is not determined
        normal = np.random.default_rng(0).standard_normal((_DRAWS, len(rows)))
        probability = decided = 0.0
        constant = (np.log(self.probability) - np.log(std).sum(axis=1))[:, None]
        for likely, mean, sizes, along in zip(self.probability.tolist(), means, std, axes, strict=True):
            drawn = mean + (sizes * normal) @ along.T
            logs = constant - np.square((drawn - means[:, None]) @ axes / std[:, None]).sum(axis=2) / 2
            likeliest = np.exp(logs.max(axis=0) - np.logaddexp.reduce(logs))
            probability += likely * float(likeliest.mean())
            decided += likely * float((likeliest >= FOUND).mean())
        return Forecast(max(probability, float(self.probability.max())), decided)

    def outlook(self, rows: Floats, chosen: list[int]) -> tuple[Forecast, Forecast]:
        """What chosen ones of candidates of H (n, 2, v) are expected to tell, and what `MOST_TOUCHES` are, evenly
        distributed over all candidates or on the chosen ones; whichever is more.
        """
        at = np.linspace(0, len(rows), MOST_TOUCHES, endpoint=False).astype(np.intp)
        repeated = (MOST_TOUCHES / len(chosen)) ** 0.5 * rows[chosen]
        return self.forecast(rows[chosen]), max(self.forecast(rows[at]), self.forecast(repeated))

    @property
    def is_decided(self) -> bool:
        """Whether one is as likely already as a decision needs."""
        return self.share * float(self.probability.max()) >= FOUND

    def doubt_left(self, outlook: Forecast) -> float:
        """The part, 0 to 1, that a forecast leaves of what the choice between them adds to an uncertainty."""
        doubt = 1 - float(self.probability.max())
        if outlook.decided >= 0.5 or doubt <= 0:
            return 0.0
        return float(min((1 - outlook.probability) / doubt, 1.0) ** 0.5)

    def _sizes(self, effect: Effect) -> Floats:
        """Rows that pick the sizes of an effect, in their units, from all values: of what is named, declared and too
        small to be detected together, (a, v).
        """
        robot, names, declared = self.robot, self.robot.model.names, self.robot.declared
        places = declared.places.get(effect.declared_as or effect.label, ()) if declared else ()
        sizes = np.flatnonzero(is_size(effect))
        rows, first = np.zeros((len(sizes), self.change.shape[1])), self.change.shape[1] - len(robot.random)
        for number, (row, k) in enumerate(zip(rows, sizes.tolist(), strict=True)):
            if (name := f'{effect.label}.{effect.parameters[k].name}') in names:
                row[names.index(name)] = 1.0
            if declared and number < len(places):
                row[len(names) + places[number]] = declared.units[places[number]]
            for j, (column, size) in enumerate(zip(robot.random, robot.random_sizes, strict=True), first):
                row[j] += size * (column.effect.label == effect.label and column.parameter == k)
        return rows

    @property
    def _enough(self) -> float:
        """The probability of the likeliest set afterwards by which a measurement decides."""
        return max(FOUND, worth_doing(float(self.probability.max())))

    def _needed(self, rows: Floats, least: float = 0.0) -> float:
        """The largest standard uncertainty, SI, of a measurement of what rows pick that is expected to decide; 0 where
        none above `least` is so good.
        """
        good = [size for size in _STEPS[::-1] if size >= least]
        low, high = 0, len(good)
        while low < high:
            middle = (low + high) // 2
            enough = self.forecast(rows / good[middle]).probability >= self._enough
            low, high = (low, middle) if enough else (middle + 1, high)
        return good[low] if low < len(good) else 0.0

    def remedies(self, plan: Plan) -> tuple[str, ...]:
        """What decides where touches do not, the easiest of each kind, in the imperative."""
        effects = {effect.label: effect for effect in (*(c.effect for c in self.robot.random), *self.robot.effects)}
        named = [effects[label] for label in dict.fromkeys(x for one in self.labels for x in one) if label in effects]
        objects = [effect for effect in named if effect.on_object and effect.parameters[0].unit == 'm']
        found, groups = list[tuple[float, str]](), [[effect] for effect in named]
        for group in [*groups, *map(list, combinations(objects, 2)), objects]:
            if not group or (found and len(group) > 1):
                break
            effect, unit = group[0], group[0].parameters[0].unit
            rows = np.concatenate([self._sizes(one) for one in group])
            if size := self._needed(rows, _LEAST_PLACE if unit == 'm' else 0.0) if len(rows) else 0.0:
                text = (
                    f'determine {effect.label} to {quantity(size, unit)} otherwise, and hold it: --fix {_held(effect)}'
                )
                if effect.on_object:
                    what = ' and the '.join(title_of(one.label) for one in group)
                    text = f'measure the {what} again, to {quantity(size, unit)} or better, and correct the cell file'
                found.append((size / effect.size(), text))
        remedies = [max(found, key=lambda item: item[0])[1]] if found else []  # of alike the likelier
        names, lengths = self.robot.model.names, list[tuple[float, str]]()
        for name in ('l1', 'l2'):
            row = np.zeros((1, self.change.shape[1]))
            row[0, names.index(name)] = 1.0
            if size := self._needed(row, _LEAST_LENGTH):
                text = f'measure {name} to {quantity(size, UNITS[name])}, and declare it (uncertainty: nominal)'
                lengths.append((size, text))
        remedies += [max(lengths)[1]] if lengths else []
        return (*remedies, *self._further_object(plan))

    def _further_object(self, plan: Plan) -> list[str]:
        """Where a further disc, touched as often, decides; at the best place of a grid, if anywhere."""
        cell, robot = self.robot.cell, self.robot
        discs = [disc for disc in cell.discs if isinstance(disc, Disc)]
        if not discs:
            return []
        radius = float(np.median([disc.radius for disc in discs]))
        std = float(np.median([disc.center_std for disc in discs])) or 1e-5
        span = robot.parameters.l1 + robot.parameters.l2
        places = 0.8 * span * np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 6)] * 2), axis=-1).reshape(-1, 2)
        places = places[cell.region.holds(places)]
        gaps = np.linalg.norm(places[:, None] - cell.centers, axis=-1) - cell.radii - radius
        further, plans, count = list[Disc](), list[Plan](), len(cell.discs)
        for x, y in places[(gaps > _APART).all(axis=1)].tolist():
            one = Disc(f'further {len(further)}', x, y, radius, std, float(np.median([d.radius_std for d in discs])))
            try:
                alone = default_plan(replace(cell, discs=(one,)), 6, np.unique(plan.force).tolist())
            except CellError:
                continue
            plans.append(replace(alone, disc=np.full(len(alone), count + len(further))))
            further.append(one)
        if not further:
            return []
        more = replace(cell, discs=(*cell.discs, *further))
        wide = self._replace(robot=replace(robot, cell=more))
        own, every = DeclaredErrors.of(cell), DeclaredErrors.of(more)
        assert every is not None
        known, first = set(own.names if own else ()), len(robot.model.names)
        try:
            rows = np.split(wide.rows(Plan.joined(plans)), np.cumsum([len(one) for one in plans])[:-1])
        except UnsupportedDataError:
            return []
        old = np.array([name in known for name in every.names], dtype=bool)
        kept = np.concatenate([np.ones(first, dtype=bool), old, np.ones(len(robot.random), dtype=bool)])
        flat = [touched.reshape(-1, len(kept)) for touched in rows]
        able = [(one, h) for one, h in zip(further, flat, strict=True) if np.isfinite(h).all()]
        found = [self.forecast(_whitened_by(h[:, kept], h[:, ~kept])).probability for _, h in able]
        if max(found, default=0.0) < self._enough:
            return []
        best = able[int(np.argmax(found))][0]
        where = f'x {best.x / MILLI:.0f} mm, y {best.y / MILLI:.0f} mm'.replace('-', '−')
        return [f'touch a further disc at about {where}, its place known to {quantity(std, "m")}']


def _whitened_by(rows: Floats, errors: Floats) -> Floats:
    """Rows (n, v) whitened for what errors of their own, (n, m), add to their unit covariance."""
    return np.asarray(np.linalg.solve(np.linalg.cholesky(np.eye(len(rows)) + errors @ errors.T), rows))


def _held(effect: Effect) -> str:
    """How its sizes are held, all of them: so the forecast takes them."""
    sizes = np.flatnonzero(is_size(effect))
    return ' --fix '.join(f"'{effect.label}.{effect.parameters[k].name}=VALUE'" for k in sizes.tolist())

"""The recordings with undeclared effects against their truth: parameters of the base model and of the extended model.

``python -m pipeline.opened [NAME …]`` (with ``test`` and the package on the path) prints a table for each recording.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import NamedTuple

from pipeline.undeclared import ALL, outcome_of, true_robot

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.model.quantities import SCALES, decimals


class Row(NamedTuple):
    """A parameter, SI units: its truth, then estimate and standard deviation of either model."""

    name: str
    truth: float
    alone: float
    alone_std: float
    extended: float
    extended_std: float

    @property
    def off_alone(self) -> float:
        """Standard deviations from the truth."""
        return (self.alone - self.truth) / self.alone_std

    @property
    def off_extended(self) -> float:
        """Standard deviations from the truth."""
        return (self.extended - self.truth) / self.extended_std


def rows(name: str, outcome: Outcome) -> Iterator[Row]:
    """The base parameters and their truth."""
    alone, final = outcome.calibration, outcome.final
    truth = true_robot(name, alone.cell).parameters.as_array()
    for number, parameter in enumerate(NAMES):
        before, after = (getattr(one.parameters, parameter) for one in (alone, final))
        yield Row(parameter, float(truth[number]), before, alone.std_of(parameter), after, final.std_of(parameter))


def table(name: str) -> str:
    """The base parameters of a recording as text."""
    outcome = outcome_of(name)
    lines = [name, f'{"":8}{"truth":>10} {"base model":>29}{"extended model":>29}']
    for row in rows(name, outcome):
        unit, per_si = SCALES[row.name]
        places = decimals(row.extended_std * per_si) or 0
        sides = (
            f'{value * per_si:12.{places}f} ± {std * per_si:<6.{places}f} {off:+5.1f} σ'
            for value, std, off in (
                (row.alone, row.alone_std, row.off_alone),
                (row.extended, row.extended_std, row.off_extended),
            )
        )
        lines.append(f'{row.name:8}{row.truth * per_si:10.{places}f} ' + ' '.join(sides) + f'  {unit}')
    return '\n'.join([*lines, *effects(name, outcome)])


def effects(name: str, outcome: Outcome) -> Iterator[str]:
    """The effects found and the true ones."""
    truth = true_robot(name, outcome.calibration.cell)
    for there, values in zip(truth.effects, truth.effect_values, strict=True):
        named = zip(there.parameters, values, strict=True)
        yield f'true effect: {there.label}: ' + ', '.join(f'{one.name} {value:g} {one.unit}' for one, value in named)
    for found in outcome.diagnosis.found:
        values = ', '.join(f'{one.name} {one.value:.3g} ± {one.std:.2g} {one.unit}' for one in found.values)
        yield f'estimated effect: {found.effect.label}: {values}'


if __name__ == '__main__':
    print('\n\n'.join(table(name) for name in sys.argv[1:] or [one.name for one in ALL]))

"""The table and the catalogue of effects, made from their classes; the picture of each from a simulated calibration."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from common import MarkdownDirective, code, table
from docutils import nodes
from sphinx.application import Sphinx

from scara_kinetostatic.effects.base import VARIABLES, Effect
from scara_kinetostatic.effects.objects import OffNormalForce, PlatePosition
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise, Plate
from scara_kinetostatic.model.extended_model import Parameter
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.report.figure import style
from scara_kinetostatic.results.figures import effect_picture
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.simulation.truth import parse_effect, with_effects

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(joint=1e-5, force=0.3))
PLATED = replace(
    CELL,
    discs=tuple(disc._replace(plate='a') for disc in CELL.discs[:2]) + CELL.discs[2:],
    plates=(Plate('a', 0.0, 0.3),),
)
"""The same with two of its discs on a plate, for the effects of plates."""
SHOWN = {
    'sensor_nonlinearity': 'sensor_nonlinearity:rate=0.008',
    'encoder_gain': 'encoder_gain[joint2]:gain=1e-4',
    'transmission_error': 'transmission_error[joint1]:amplitude=2e-4,phase=0.7,cycles=7.3',
    'joint_hardening': 'joint_hardening[joint1]:rate=-1e-7',
    'joint_slip': 'joint_slip[joint1]:compliance=5e-5,slip_torque=2',
    'tip_shape': 'tip_shape[three-lobed]:a=3e-5,b=-2e-5',
    'load_friction': 'load_friction[joint1]:compliance=5e-5,friction_ratio=0.1',
    'link_bending': 'link_bending[link1]:compliance=1.5e-4',
    'base_tilt': 'base_tilt:m1_x=15,m1_y=-8,m2_x=9,m2_y=-5',
    'contact_compliance': 'contact_compliance[disc_2]:yield=5e-6',
    'thermal_drift': 'thermal_drift[joint1]:rate=1e-6',
}
"""What is simulated for the picture, where that is not the first of the kind at its typical size."""

OFF_NORMAL_ANGLE = Parameter(
    'off_normal_angle',
    'rad',
    OffNormalForce.off_normal,
    'in place of the coefficient where the direction of friction differs from touch to touch: '
    'angle of the force from the normal, root mean square',
)
"""As the diagnosis reports it."""


def kinds() -> Iterator[list[Effect]]:
    """The effects of the example cell, one list for each name, in the order of the catalogue.

    Friction of random direction is no effect of the catalogue, but a result of the diagnosis under the same name.
    """
    by_name: dict[str, list[Effect]] = {}
    for effect in (*catalogue(CELL), *PlatePosition.instances(PLATED), OffNormalForce()):
        by_name.setdefault(effect.name, []).append(effect)
    yield from by_name.values()


class EffectTable(MarkdownDirective):
    """One row for each effect."""

    made_from = 'effects'

    def markdown(self) -> str:
        rows = []
        for kind in kinds():
            first = kind[0]
            units = {(p.name, p.unit) for p in parameters(kind)}
            is_ambiguous = len({name for name, _ in units}) < len(units)
            names = ', '.join(
                f'{code(p.name)} {p.unit}' + (f' ({targets(having)})' if is_ambiguous else '')
                for p, having in parameters(kind).items()
            )
            link = f'[{code(first.name)}](catalogue.md#{first.name.replace("_", "-")})'
            rows.append((link, summary(first), targets(kind), names))
        return table(('effect', 'what it is', 'target', 'parameters'), rows)


class EffectCatalogue(MarkdownDirective):
    """A section for each effect."""

    made_from = 'effects'

    def markdown(self) -> str:
        return '\n\n'.join(self.section(kind) for kind in kinds())

    def section(self, kind: list[Effect]) -> str:
        """Heading, description, facts and parameters of the effects of one name, and the picture."""
        first = kind[0]
        parts = [f'({first.name.replace("_", "-")})=\n## {first.name}']
        for described in dict.fromkeys(type(effect) for effect in kind):
            parts.append(description(described))
        facts = [
            ('Targets in this cell', targets(kind)),
            ('Confounded with', first.confounded_with),
            ('Identified by', first.identified_by),
            ('Plot variable', variable_of(first)),
        ]
        if first.grid_parameter:
            facts.append(('Searched on a grid', code(first.grid_parameter)))
        parts.append('\n'.join(f':{name}: {value}' for name, value in facts))
        head = ['parameter', 'unit', 'plausible size', 'typical error', 'meaning']
        rows = [
            [code(p.name), p.unit, f'{p.scale:.2g}', typical(p, having[0]), p.meaning]
            for p, having in parameters(kind).items()
        ]
        about = [targets(having) for having in parameters(kind).values()]
        if len(set(about)) > 1:
            head.insert(1, 'target')
            for row, target in zip(rows, about, strict=True):
                row.insert(1, target)
        parts.append(table(head, rows))
        parts.append(f'```{{effect-picture}} {SHOWN.get(first.name) or at_typical_size(first)}\n```')
        return '\n\n'.join(parts)


def typical(parameter: Parameter, effect: Effect) -> str:
    """The typical size of a parameter on an industrial arm; a dash for what has none of its own."""
    if parameter not in effect.parameters:
        return '–'
    place = effect.parameters.index(parameter)
    is_size = bool(effect.amplitudes(np.ones(len(effect.parameters)))[place]) and not parameter.is_alias
    return f'{effect.size(place):.2g}' if is_size else '–'


class EffectPicture(MarkdownDirective):
    """The deviation that each touch implies, before and after the effect is in the model."""

    def run(self) -> list[nodes.Node]:
        self.note_sources()
        shown = self.arguments[0]
        label = shown.split(':')[0]
        cell = PLATED if label.startswith(f'{PlatePosition.name}[') else CELL
        chosen = parse_effect(shown, cell)
        robot = with_effects(PAPER_ACTUAL, [chosen])
        touches = simulate_touches(cell, robot, default_plan(cell, per_disc=18, preload=0.3))
        outcome = calibrate_touches(touches, cell)
        labels = [item.effect.label for item in outcome.diagnosis.found]
        found = dict(zip(labels, outcome.effect_residuals, strict=True))
        result = nodes.container(classes=['effect-picture'])
        if label in found:
            with style():
                picture = effect_picture(found[label], f'effect-{chosen.effect.name}')
            result += nodes.raw('', str(picture), format='html')
        others = ', '.join(found) or 'nothing'
        verdict = outcome.diagnosis.verdict
        caption = f"Simulated with `--effect '{shown}'`. Verdict `{verdict}`; in the extended model: {others}."
        paragraph = nodes.container()
        self.state.nested_parse([caption], self.content_offset, paragraph)
        return [result, *paragraph.children]


def targets(kind: Sequence[Effect]) -> str:
    """What effects of one name are about: joints, links, discs, or the cell."""
    return ', '.join(dict.fromkeys(code(effect.target or '') or 'the cell' for effect in kind))


def parameters(kind: Sequence[Effect]) -> dict[Parameter, list[Effect]]:
    """The parameters of effects of one name, each with the effects that have it."""
    having: dict[Parameter, list[Effect]] = {}
    for effect in kind:
        for parameter in (OFF_NORMAL_ANGLE,) if effect.off_normal_std else effect.parameters:
            having.setdefault(parameter, []).append(effect)
    return having


def at_typical_size(effect: Effect) -> str:
    """An effect at its typical size, as `simulate --effect` takes it."""
    values = ','.join(f'{p.name}={value:g}' for p, value in zip(effect.parameters, effect.typical, strict=True))
    return f'{effect.label}:{values}'


def summary(effect: Effect) -> str:
    """What the effect says of the cell."""
    return effect.title


def description(kind: type[Effect]) -> str:
    """The docstring of a class up to its attributes, as Markdown."""
    text = inspect.cleandoc(kind.__doc__ or '')
    text = re.split(r'\n\s*(?:Attributes|Args):', text)[0]
    return re.sub(r'``([^`]+)``', r'`\1`', text).strip()


def variable_of(effect: Effect) -> str:
    """What the residual is drawn over."""
    variable = VARIABLES[effect.plot_variable]
    return variable.label.format(joint='i') + (f' ({variable.unit})' if variable.unit else '')


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the directives."""
    app.add_directive('effect-table', EffectTable)
    app.add_directive('effect-catalogue', EffectCatalogue)
    app.add_directive('effect-picture', EffectPicture)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}

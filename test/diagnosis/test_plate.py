"""A displaced plate is not taken for another disc."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from diagnosis.simulated import CELL, NOISE, deviations

from scara_kinetostatic.effects.objects import PlatePosition
from scara_kinetostatic.effects.registry import catalogue, find
from scara_kinetostatic.model.cell import Cell, Plate
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches


def plated(*names: str) -> Cell:
    discs = tuple(
        d._replace(center_std=3e-6, radius_std=3e-6, plate='a' if d.name in names else '') for d in CELL.discs
    )
    return replace(CELL, discs=discs, plates=(Plate('a', 0.0, 0.3, 1e-5, 1e-4),))


def test_it_is_in_the_catalogue_where_the_plate_carries_several_discs() -> None:
    labels = [[e.label for e in PlatePosition.instances(plated(*names))] for names in ((), ('disc_1',))]
    assert labels == [[], []]
    (effect,) = PlatePosition.instances(plated('disc_1', 'disc_2'))
    assert effect in catalogue(plated('disc_1', 'disc_2'))
    assert (effect.label, effect.title) == ('plate_position[a]', 'the plate a is not where the cell description says')


def test_it_displaces_all_discs_of_the_plate() -> None:
    cell = plated('disc_1', 'disc_3')
    plate, discs = find(cell, 'plate_position[a]'), [find(cell, f'object_position[disc_{k}]') for k in (1, 3)]
    value, plan = (3e-4, -2e-4), default_plan(cell, 2)
    one, other = (
        simulate_touches(cell, ExtendedModel(PAPER_ACTUAL, effects, values), plan, NOISE)
        for effects, values in (((plate,), (value,)), (tuple(discs), (value, value)))
    )
    assert np.allclose(one.force, other.force, rtol=1e-9)
    assert not np.allclose(one.force, simulate_touches(cell, PAPER_ACTUAL, plan, NOISE).force, rtol=1e-3)


def test_a_plate_of_all_discs_is_simulated_and_is_the_base_the_other_way() -> None:
    cell = plated('disc_1', 'disc_2', 'disc_3')
    (effect,) = PlatePosition.instances(cell)
    truth = ExtendedModel(PAPER_ACTUAL, (effect,), ((2e-4, -1e-4),))
    found = calibrate_touches(simulate_touches(cell, truth, default_plan(cell, 8), NOISE, 9), cell)
    assert found.verdict == 'none'
    assert abs(found['x0'].value - (PAPER_ACTUAL.x0 - 2e-4)) < found['x0'].std
    assert found['x0'].std > cell.plates[0].center_std


def test_a_displaced_plate_is_a_rival_of_the_disc_beside_it_and_the_uncertainty_covers_both() -> None:
    cell = plated('disc_1', 'disc_2')
    true = replace(CELL, discs=tuple(d._replace(x=d.x + (2e-4 if d.name != 'disc_3' else 0)) for d in CELL.discs))
    found = calibrate_touches(simulate_touches(true, PAPER_ACTUAL, default_plan(true, 8), NOISE, 9), cell)
    assert found.verdict == 'ambiguous'
    assert {'plate_position[a]', 'object_position[disc_3]'} <= {x for group in found.diagnosis.rivals for x in group}
    assert abs(found['x0'].value - PAPER_ACTUAL.x0) < 3 * found['x0'].std


def test_a_plate_of_one_disc_is_named_with_it() -> None:
    effect = find(plated('disc_3'), 'object_position[disc_3]')
    assert effect.title == 'disc_3 or its plate a is not where the cell description says'
    assert find(plated('disc_1', 'disc_2'), 'object_position[disc_1]').title.startswith('disc_1 is not')


def test_what_is_stated_as_exact_can_be_wrong() -> None:
    """An exact plate of two discs, or an exact disc, beside discs that are declared."""
    for exact in ('plate_position[a]', 'object_position[disc_3]'):
        cell = plated('disc_1', 'disc_2') if exact.startswith('plate') else plated()
        discs = [d._replace(center_std=0.0) if f'object_position[{d.name}]' == exact else d for d in cell.discs]
        cell = replace(cell, discs=tuple(discs), plates=(Plate('a', 0.0, 0.3),))
        truth = ExtendedModel(PAPER_ACTUAL, (find(cell, exact),), ((1.1e-4, -4e-5),))
        touches = simulate_touches(cell, truth, default_plan(cell, 12, preload=0.3), NOISE, 3)
        found = calibrate_touches(touches, cell)
        assert exact in {item.effect.label for item in found.diagnosis.found}
        assert np.abs(deviations(found.final)).max() < 4

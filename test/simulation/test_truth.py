"""Effects named by the user, and the truth as a file."""

from __future__ import annotations

import pytest
from effects.scenes import EFFECTS, LABELS, plausible

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED, PAPER_NOMINAL
from scara_kinetostatic.simulation.truth import (
    TrueEffect,
    deviating_robot,
    load_truth,
    parse_effect,
    truth_named,
    truth_text,
    with_effects,
)

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS)
CHOSEN = [TrueEffect(effect, tuple(float(value) for value in plausible(effect))) for effect in EFFECTS]


@pytest.mark.parametrize('chosen', CHOSEN, ids=LABELS)
def test_text_gives_every_effect_in_any_order_of_its_parameters(chosen):
    pairs = zip(chosen.effect.parameters, chosen.values, strict=True)
    given = [f' {parameter.name} = {value!r}' for parameter, value in pairs]
    assert parse_effect(f'{chosen.effect.label}:{",".join(given)}', CELL) == chosen
    assert parse_effect(f'{chosen.effect.label}: {",".join(reversed(given))},', CELL) == chosen


def test_what_the_arm_contains_may_be_left_out(tmp_path):
    chosen = parse_effect('base_compliance:excess=2e-6,coupling=1e-6', CELL)
    assert chosen.values == (2e-6, 1e-6, 0.0)
    path = tmp_path / 'truth.yaml'
    path.write_text(truth_text(with_effects(PAPER_ACTUAL, [chosen])).replace(', common: 0.0', ''))
    assert 'common' not in path.read_text()
    assert load_truth(path, CELL) == with_effects(PAPER_ACTUAL, [chosen])


def test_the_robot_has_the_chosen_effects_with_their_values():
    truth = with_effects(PAPER_ACTUAL, CHOSEN)
    assert truth.effects == EFFECTS
    assert truth.effect_values == tuple(chosen.values for chosen in CHOSEN)
    assert truth.parameters == PAPER_ACTUAL
    assert with_effects(PAPER_ACTUAL, []) == ExtendedModel(PAPER_ACTUAL)
    with pytest.raises(ParameterError, match='is given twice'):
        with_effects(PAPER_ACTUAL, [CHOSEN[2], *CHOSEN])


def test_a_robot_by_name_deviates_from_the_nominal_values_as_in_the_paper():
    assert truth_named('measured', CELL) == ExtendedModel(PAPER_MEASURED)
    longer = PAPER_NOMINAL.replace(l1=0.5)
    assert deviating_robot(longer).l1 == pytest.approx(0.5002)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('gravity:g=1', r"effect 'gravity': no such effect; the effects are .* joint_hardening"),
        ('object_radius:radius=1', r'no such target in this cell; give object_radius\[disc_1\]'),
        ('sensor_bias', r'expected x, y once each; the parameters of sensor_bias are x \(N; .*\), y \(N; '),
        ('sensor_bias:x=1,y=2,x=3', 'x, y once each'),
        ('sensor_bias:x=1,y=two', "expected parameter=value: .*'two'"),
        ('sensor_bias:x=1,y=inf', 'expected finite numbers'),
        ('transmission_error[joint1]:amplitude=1', r'amplitude \(rad; .*phase \(rad.*cycles \(1/turn'),
    ],
)
def test_senseless_texts(text, message):
    with pytest.raises(ParameterError, match=message):
        parse_effect(text, CELL)


def test_truth_survives_its_file(tmp_path):
    path = tmp_path / 'truth.yaml'
    path.write_text(truth_text(with_effects(PAPER_ACTUAL, CHOSEN), 7))
    assert load_truth(path, CELL) == with_effects(PAPER_ACTUAL, CHOSEN)
    path.write_text(truth_text(PAPER_ACTUAL))
    assert load_truth(path, CELL) == ExtendedModel(PAPER_ACTUAL)


TWELVE = f'parameters: {PAPER_ACTUAL.as_dict()}\n'


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        (TWELVE + 'effects: [{name: object_radius, target: disc_1, size: 1}]', "unknown key 'size'"),
        (TWELVE + 'effects: [{name: nonsense}]', 'no such effect'),
        (TWELVE + 'effects: [{name: sensor_bias, parameters: {x: 1}}]', "the key 'y' is missing"),
        (TWELVE.replace('0.3302', '-1'), 'expected a positive length'),
        ('effects: []', "unknown key 'effects'"),
    ],
)
def test_senseless_truth_files(tmp_path, text, message):
    path = tmp_path / 'truth.yaml'
    path.write_text(text)
    with pytest.raises(ParameterError, match=message):
        load_truth(path, CELL)

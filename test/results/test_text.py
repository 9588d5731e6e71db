"""The report on the terminal."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape

import pytest

from scara_kinetostatic.assessment.grade import Assessment, Grade
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.identifiability import Combination
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.result import Diagnosis, Found
from scara_kinetostatic.effects.objects import ObjectRadius
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.touch import Rejection
from scara_kinetostatic.results import messages
from scara_kinetostatic.results.report import MOST_REJECTED, html_text, text_report
from scara_kinetostatic.results.tables import parameter_rows


def test_every_parameter_with_its_uncertainty(plain: Outcome) -> None:
    lines = {line.split()[0]: line for line in text_report(plain).splitlines() if '±' in line and 'σ' not in line}
    rows = parameter_rows(plain.calibration)
    assert set(lines) == {row.name for row in rows}
    assert 'estimate ± 1 σ' in text_report(plain)
    for row in rows:
        assert f'{row.value} ± {row.std}' in lines[row.name]
        assert row.unit in lines[row.name]


def test_digits_follow_the_uncertainty(plain: Outcome) -> None:
    for row in parameter_rows(plain.calibration):
        assert len(row.std.strip('0.').replace('.', '')) <= 2 or float(row.std) >= 100
        assert len(row.value.partition('.')[2]) == len(row.std.partition('.')[2])


def test_what_is_not_determined_has_no_uncertainty(confounded: Outcome) -> None:
    text = text_report(confounded)
    (line,) = (line for line in text.splitlines() if line.startswith('p_ee '))
    assert '±' not in line
    assert '(' in line
    assert 'not determined by these data' in line
    assert ' fixed' in next(line for line in text.splitlines() if line.startswith('l1 '))
    assert 'these data do not determine every parameter' in text
    assert 'free parameters are determined, ' in ' '.join(text.split())
    assert 'The base model fits, but these data do not' in text
    few = replace(confounded.calibration, degrees_of_freedom=2)
    headline = messages.verdict(replace(confounded, calibration=few)).headline
    assert headline.startswith('The base model fits, but nothing checks it: these data')
    assert 'independent combinations of them (condition number' in ' '.join(text.split())


def test_rejected_touches_are_named_up_to_a_point(plain: Outcome) -> None:
    text = text_report(plain)
    assert 'touch 0: never settles' in text
    assert 'touch 8: disagrees' in text
    many = tuple(Rejection(number, 'slides') for number in range(40))
    assert f'and {40 - MOST_REJECTED} more' in text_report(replace(plain, rejected=many))


def test_a_fit_that_did_not_converge_says_so(plain: Outcome) -> None:
    outcome = replace(plain, calibration=replace(plain.calibration, termination=Termination.ITERATION_LIMIT))
    assert text_report(outcome).startswith('Not fit for use: the fit did not converge')
    assert '\n\nThe fit did not converge' in text_report(outcome)


def test_effects_have_their_lines(grown: Outcome, ambiguous: Outcome, unnamed: Outcome) -> None:
    text = text_report(grown)
    (item,) = grown.diagnosis.found
    compared = grown.comparison
    joined = ' '.join(text.split())
    assert f'added to the base model {item.effect.title} {item.effect.label} radius ' in joined
    alone, extended = compared.base, compared.extended
    assert f'{alone.force_error:.3g} N with the base model, {extended.force_error:.3g} N with the extended' in joined
    assert f'{alone.held_out:.3g} N and {extended.held_out:.3g} N' in joined
    assert f'{1e3 * alone.tip.fitted:.3g} mm from the circle' in joined
    assert re.search(r'bias ignoring it would bias l2 by [\d.]+ σ, ', joined)
    assert 'the force sensor is rotated about its axis (one of' in ' '.join(text_report(ambiguous).split())
    assert 'a fitted curve (joint 1 deviates' in ' '.join(text_report(unnamed).split())


def test_of_many_rivals_the_first_ones_are_named(plain: Outcome) -> None:
    rivals = (tuple(f'effect_{number}' for number in range(20)),)
    text = ' '.join(messages.verdict(replace(plain, diagnosis=Diagnosis('ambiguous', 1e-4, rivals=rivals))).sentences)
    assert 'effect_0 or effect_1' in text
    assert f'or one of {20 - messages.MOST_RIVALS} more' in text


def test_a_base_model_that_did_not_converge_says_so(ambiguous: Outcome) -> None:
    assert 'fit of the base model did not converge' not in ' '.join(text_report(ambiguous).split())
    lost = replace(ambiguous, calibration=replace(ambiguous.calibration, termination=Termination.ITERATION_LIMIT))
    assert '\n\nModel error found, but these data cannot distinguish' in text_report(lost)
    assert 'fit of the base model did not converge' in ' '.join(text_report(lost).split())


def test_lines_fit_a_terminal(request: pytest.FixtureRequest) -> None:
    for which in ('plain', 'confounded', 'grown', 'ambiguous', 'unnamed'):
        outcome = request.getfixturevalue(which)
        assert max(map(len, text_report(outcome).splitlines())) <= 100


@pytest.mark.parametrize(
    ('diagnosis', 'level', 'expected'),
    [
        (Diagnosis('none', 0.5), 'good', 'No model error detected'),
        (Diagnosis('unexplained', 1e-60, advice='the residual depends on q1'), 'bad', '(p < 1e-12)'),
        (Diagnosis('explained', 1e-9, found=(Found(ObjectRadius.of(1, 'd2'), (), True),)), 'caution', 'd2 has another'),
        (Diagnosis('ambiguous', 1e-4, rivals=(('contact_friction', 'sensor_rotation'),)), 'caution', 'or sensor'),
    ],
)
def test_every_verdict_has_its_words(plain: Outcome, diagnosis: Diagnosis, level: str, expected: str) -> None:
    outcome = replace(plain, diagnosis=diagnosis)
    verdict = messages.verdict(outcome)
    assert verdict.level == level
    text = ' '.join(verdict.sentences)
    assert expected in text
    assert f'Verdict: {diagnosis.verdict}.' in text
    assert ('Do not rely on the standard deviations' in text) == (diagnosis.verdict == 'unexplained')
    assert ('The base model explains' in verdict.headline) == (level == 'good')
    shown = text_report(outcome).split('\n\n')
    assert shown[0].startswith(messages.ANSWERS[outcome.assessment.grade])
    assert ' '.join(shown[1].split()).startswith(verdict.headline)


def test_the_headline_says_what_an_effect_means(plain: Outcome) -> None:
    found = tuple(Found(ObjectRadius.of(1, name), (), True) for name in ('d2', 'd3'))
    headline = messages.verdict(replace(plain, diagnosis=Diagnosis('explained', 1e-9, found=found))).headline
    which = (f'{name} has another radius than the cell description says' for name in ('d2', 'd3'))
    assert headline == f'Model error found and corrected: {"; ".join(which)}'


@pytest.mark.parametrize(
    ('joint', 'source', 'expected'),
    [
        (1e-5, 'given', '10 µrad per joint and 0.3 N per force component, given by the cell description'),
        (1e-5, 'estimated', '10 µrad per joint and 0.3 N per force component, estimated from the residuals'),
        (1e-8, 'estimated', 'the joint noise is too small to be estimated'),
    ],
)
def test_noise_in_words(plain: Outcome, joint: float, source: str, expected: str) -> None:
    cell = replace(plain.calibration.cell, noise=Noise(joint, 0.3) if source == 'given' else None)
    calibration = replace(plain.calibration, cell=cell, noise=Noise(joint, 0.3), noise_source=source)
    assert expected in messages.noise(replace(plain, calibration=calibration))


def test_noise_that_was_found_beside_stated_levels_in_words(plain: Outcome) -> None:
    cell = replace(plain.calibration.cell, noise=Noise(1e-5, 0.3))
    found = replace(plain.calibration, cell=cell, noise=Noise(1e-5, (0.4, 0.1), 0.012), noise_source='estimated')
    assert messages.noise(replace(plain, calibration=found)) == (
        '10 µrad per joint and 0.4 and 0.1 N per force component, in addition 1.2 % of the force; '
        'the part that grows with the force and the ratio of the axes estimated from the residuals, the rest given'
    )


@pytest.mark.parametrize(
    ('first', 'factor', 'second', 'shown'),
    [
        ('g1', -12.5, 'p1', 'g1 - 12.5 Nm · p1 ='),
        ('x0', 0.33, 'theta1', 'x0 + 0.33 m/rad · theta1 ='),
        ('l1', 1.0, 'l2', 'l1 + 1 l2 ='),
        ('p_ee', 0.1, 'p1', 'p_ee + 0.1 (m/N)/(rad/Nm) · p1 ='),
    ],
)
def test_the_factor_of_a_combination_has_its_unit(
    confounded: Outcome, first: str, factor: float, second: str, shown: str
) -> None:
    c = confounded.calibration
    known = replace(c.identifiability, combinations=(Combination(first, factor, second, 1.0, 0.1, ''),))
    (line,) = messages.identifiability(replace(confounded, calibration=replace(c, identifiability=known)))[-1:]
    assert shown in line


def test_a_command_in_an_action_keeps_the_labels_that_can_be_typed(grown: Outcome) -> None:
    label = grown.diagnosis.found[0].effect.label
    command = f"--fix '{label}.radius=VALUE'"
    told = Assessment(Grade.CAUTION, ('the cause is open',), (f'hold it by {command}',))
    outcome = replace(grown)
    outcome.__dict__['assessment'] = told
    assert command in ' '.join(text_report(outcome).split())
    assert command in unescape(html_text(outcome))

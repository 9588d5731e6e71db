"""The report on the terminal."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.identifiability import Combination
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.result import Diagnosis, EffectSet, Found
from scara_kinetostatic.effects.objects import ObjectRadius
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.model.quantities import SCALES, micrometres
from scara_kinetostatic.model.touch import Rejection
from scara_kinetostatic.results import report


def joined(outcome: Outcome) -> str:
    return ' '.join(report.text_report(outcome).split())


def test_every_parameter_with_the_digits_that_its_uncertainty_allows(plain: Outcome) -> None:
    text = report.text_report(plain)
    assert 'estimate ± 1 σ' in text
    rows = report.parameter_table(plain.calibration).rows
    assert [row[0] for row in rows] == list(NAMES)
    for name, _, value, unit, meaning in rows:
        (line,) = (line for line in text.splitlines() if line.startswith(f'{name} '))
        assert ' '.join(line.split()).endswith(f'{value} {unit} {meaning}')
        number, std = value.split(' ± ')
        assert float(number) == pytest.approx(getattr(plain.final.parameters, name) * SCALES[name].per_si, rel=1e-2)
        assert len(std.strip('0.').replace('.', '')) <= 2 or float(std) >= 100
        assert len(number.partition('.')[2]) == len(std.partition('.')[2])


def test_what_is_not_determined_has_no_uncertainty(confounded: Outcome) -> None:
    text = report.text_report(confounded)
    (line,) = (line for line in text.splitlines() if line.startswith('p_ee '))
    assert '±' not in line
    assert '(' in line
    assert 'not determined by these data' in line
    assert Counter(report.parameter_table(confounded.calibration).levels) == {'': 9, 'caution': 2, 'faint': 1}
    assert ' fixed' in next(line for line in text.splitlines() if line.startswith('l1 '))
    assert text.startswith('To be used with caution: the touches do not determine p_ee, g_ee each by itself')
    assert '9 of 11 free parameters are determined, 10 independent combinations of all (condition' in joined(confounded)


def test_rejected_touches_are_named_up_to_a_point(plain: Outcome) -> None:
    text = report.text_report(plain)
    assert 'touch 0: never settles' in text
    assert 'touch 8: disagrees' in text
    many = tuple(Rejection(number, 'slides') for number in range(40))
    assert f'and {40 - report.MOST_REJECTED} more' in report.text_report(replace(plain, rejected=many))


def test_a_fit_that_did_not_converge_says_so(plain: Outcome) -> None:
    outcome = replace(plain, calibration=replace(plain.calibration, termination=Termination.ITERATION_LIMIT))
    assert report.text_report(outcome).startswith('Not fit for use: the fit did not converge')


def test_effects_have_their_lines(grown: Outcome, ambiguous: Outcome, unnamed: Outcome) -> None:
    text = report.text_report(grown)
    (item,) = grown.diagnosis.found
    assert f'added to the base model {item.effect.title} {item.effect.label} radius ' in joined(grown)
    for name, side in (('base model', grown.comparison.base), ('extended model', grown.comparison.extended)):
        (line,) = (line for line in text.splitlines() if line.startswith(name))
        forces = (f'{size:.3g}' for size in (side.force_error, side.held_out))
        tips = map(micrometres, (side.tip.fitted, side.tip.held_out))
        assert line.split()[2:] == [*forces, *tips, f'{side.reduced_chi_square:.2f}']
    assert 'bias ignoring it would bias l2 by ' in joined(grown)
    assert 'the force sensor is rotated about its axis (one of' in joined(ambiguous)
    assert 'a fitted curve (joint 1 deviates by an angle, depending on the angle of joint 2)' in joined(unnamed)
    assert 'cos1' not in joined(unnamed), 'coefficients say nothing by themselves'


@pytest.mark.parametrize('which', ['plain', 'confounded', 'grown', 'ambiguous', 'unnamed'])
def test_lines_fit_a_terminal(which: str, request: pytest.FixtureRequest) -> None:
    assert max(map(len, report.text_report(request.getfixturevalue(which)).splitlines())) <= 100


@pytest.mark.parametrize(
    ('diagnosis', 'level', 'expected'),
    [
        (Diagnosis('none', 0.5), 'good', 'No model error detected'),
        (Diagnosis('unexplained', 1e-60, advice='the residual depends on q1'), 'bad', '(p < 1e-12)'),
        (
            Diagnosis('explained', 1e-9, found=(Found(ObjectRadius.of(1, 'd2'), (), True),)),
            'caution',
            'by what was found it does',
        ),
        (
            Diagnosis('explained', 1e-9, probabilities=(EffectSet(('a',), 0.7), EffectSet(('a', 'sensor_bias'), 0.3))),
            'caution',
            'What else may be missing: nothing (70 %) or sensor_bias (30 %).',
        ),
        (Diagnosis('ambiguous', 1e-4, rivals=(('contact_friction', 'sensor_rotation'),)), 'caution', 'or sensor'),
    ],
)
def test_every_verdict_has_its_words(plain: Outcome, diagnosis: Diagnosis, level: str, expected: str) -> None:
    outcome = replace(plain, diagnosis=diagnosis)
    verdict = report.verdict(outcome)
    assert verdict.level == level
    text = ' '.join(verdict.sentences)
    assert expected in text
    assert f'Verdict: {diagnosis.verdict}.' in text
    assert ('Do not rely on the standard deviations' in text) == (diagnosis.verdict == 'unexplained')
    assert ' '.join(report.text_report(outcome).split('\n\n')[1].split()).startswith(verdict.headline)


def test_noise_in_words(plain: Outcome) -> None:
    noise = Noise(1e-5, (0.4, 0.1), 0.012)
    calibration = replace(plain.calibration, noise=noise, cell=replace(plain.calibration.cell, noise=noise))
    words = '10 µrad per joint and 0.4 and 0.1 N per force component, in addition 1.2 % of the force, given by the cell'
    assert report.stated_noise(replace(plain, calibration=calibration)).startswith(words)


def test_a_combination_has_its_value(confounded: Outcome) -> None:
    c = confounded.calibration
    known = replace(c.identifiability, combinations=(Combination('g1', -12.5, 'p1', 1e-4, 1e-6, 'rad'),))
    line = report.identifiability(replace(confounded, calibration=replace(c, identifiability=known)))[-1]
    assert 'g1 - 12.5 p1 (factor in SI units) = 100.0 ± 1.0 µrad' in line

"""What the README shows, and the figures of the recordings, is what the commands give; it stays short."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from docs.examples import NUMBER, WITHIN, blocks, commands, compare, figures
from pipeline.opened import Row, outcome_of, rows

from scara_kinetostatic.cli.main import build_parser
from scara_kinetostatic.model.quantities import SCALES
from scara_kinetostatic.results.report import text_report

ROOT = Path(__file__).parents[1]
README = (ROOT / 'README.md').read_text(encoding='utf-8')
FIGURES = (ROOT / 'docs' / 'figures.md').read_text(encoding='utf-8')
CASE = 'undeclared_a'
OFF = 0.15
"""Standard deviations."""
OF_ERRORS = 0.003
"""Part by which an error may differ, beyond rounding to the figures shown."""


def values_of(text: str) -> list[float]:
    return [float(each) for each in figures(text)]


def half_places(text: str) -> list[float]:
    """Half of the last decimal place of each figure."""
    return [0.5 * 10.0 ** -len(each.partition('.')[2]) for each in NUMBER.findall(text)]


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip('|').split('|')]


def test_the_case_is_what_the_command_prints() -> None:
    (block,) = (block for block in blocks(ROOT / 'README.md') if block.language == 'console')
    ((command, shown),) = commands(block.text)
    assert command == ['scara-kinetostatic', 'calibrate', f'bags/{CASE}.mcap', '--out', 'result']
    assert shown.count('…\n') == 3
    compare(shown, text_report(outcome_of(CASE)), 'calibrate')


@pytest.mark.parametrize('name', ['l1', 'l2'])
def test_the_parameters_beside_the_truth(name: str) -> None:
    (line,) = (line for line in README.splitlines() if line.startswith(f'| `{name}`'))
    row = next(row for row in rows(CASE, outcome_of(CASE)) if row.name == name)
    unit, scale = SCALES[name]
    _, truth, alone, off_alone, extended, off_extended = (values_of(cell) for cell in cells(line))
    assert line.startswith(f'| `{name}`, {unit} |')
    assert truth == pytest.approx([row.truth * scale], abs=1e-9)
    for shown, value, std in ((alone, row.alone, row.alone_std), (extended, row.extended, row.extended_std)):
        assert abs(shown[0] - value * scale) < OFF * std * scale
        assert shown[1] == pytest.approx(std * scale, rel=2 * WITHIN)
    assert [*off_alone, *off_extended] == pytest.approx([row.off_alone, row.off_extended], abs=OFF)


def test_the_other_parameters_are_off_by_no_more_than_is_said() -> None:
    (sentence,) = re.findall(r'^The other ten are within .*$', README, flags=re.MULTILINE)
    others: list[Row] = [row for row in rows(CASE, outcome_of(CASE)) if row.name not in ('l1', 'l2')]
    largest = [max(abs(row.off_alone) for row in others), max(abs(row.off_extended) for row in others)]
    assert values_of(sentence) == pytest.approx(largest, abs=OFF)


@pytest.mark.parametrize('name', ['undeclared_a', 'undeclared_c', 'engine_a', 'engine_d'])
def test_errors_before_and_after(name: str) -> None:
    (line,) = (line for line in FIGURES.splitlines() if line.startswith('|') and f'`bags/{name}.mcap`' in line)
    *_, force, tip = cells(line)
    found = outcome_of(name).comparison
    sides = (found.base, found.extended) if '→' in force else (found.extended,)
    assert ('→' in force) == (outcome_of(name).diagnosis.extended is not None)
    values = [[side.held_out for side in sides], [1e6 * side.tip.held_out for side in sides]]
    for cell, expected in zip((force, tip), values, strict=True):
        for shown, value, rounding in zip(values_of(cell), expected, half_places(cell), strict=True):
            assert abs(shown - value) <= rounding + OF_ERRORS * value
    stated = re.search(r'verdict `(\w+)`', line)
    assert stated is None or stated[1] == outcome_of(name).verdict


def test_it_is_short() -> None:
    assert len(README.split()) <= 900


def test_links_and_pictures_are_there() -> None:
    targets = re.findall(r'\]\(([^)#]+)\)|src="([^"]+)"', README)
    assert len(targets) > 10
    for target in (one or other for one, other in targets):
        assert (ROOT / target).exists(), target


def test_commands_are_understood() -> None:
    bash = '\n'.join(block.text for block in blocks(ROOT / 'README.md') if block.language == 'bash')
    found = re.findall(r'^ *scara-kinetostatic (.*)$', bash, flags=re.MULTILINE)
    assert len(found) >= 2
    for command in found:
        assert build_parser().parse_args(shlex.split(command, comments=True)).verb

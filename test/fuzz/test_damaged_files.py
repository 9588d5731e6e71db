"""A bounded part of `benchmark.faults`: always the same damage, to every form of recording and to cell files."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from benchmark.common import CELL
from benchmark.faults import outcomes
from benchmark.faults.formats import CELL_FILE, forms, short_streams
from benchmark.faults.outcomes import CANARY, FAILURES, Verdict, cell_outcome, outcome_of, reading_outcome
from scara_kinetostatic.errors import CellError
from scara_kinetostatic.files.cell_file import dump_cell

STREAMS = short_streams()
FORMS = forms(STREAMS, CELL)
BAGS, CELLS = 12, 50


@pytest.fixture(autouse=True)
def somewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where something that is executed would leave its traces."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize('form', FORMS, ids=lambda form: form.name)
def test_a_damaged_recording_is_refused_or_warned_about(form, tmp_path):
    met = set()
    for number in range(BAGS):
        case = reading_outcome(form, number, STREAMS, CELL, tmp_path / 'case')
        assert case.verdict not in FAILURES, (number, case)
        assert not (form.protected and case.verdict is Verdict.SILENT), (number, case)
        met.add(case.verdict)
    assert Verdict.REFUSED in met or Verdict.WARNED in met


@pytest.mark.parametrize('text', [CELL_FILE.read_text(encoding='utf-8'), dump_cell(CELL)], ids=['example', 'compact'])
def test_a_damaged_cell_file_is_refused_in_one_line_or_makes_sense(text, tmp_path):
    cases = [cell_outcome(text, number, tmp_path / 'case') for number in range(CELLS)]
    assert [(number, case) for number, case in enumerate(cases) if case.verdict in FAILURES] == []
    refused = sum(case.verdict is Verdict.REFUSED for case in cases)
    assert CELLS // 3 < refused < CELLS


def test_what_is_intact_is_read_without_a_word(tmp_path, monkeypatch):
    monkeypatch.setattr(outcomes, 'mutated', lambda content, other, rng: content)
    monkeypatch.setattr(outcomes, 'mutated_yaml', lambda text, rng: text.encode())
    for form in FORMS:
        case = reading_outcome(form, 0, STREAMS, CELL, tmp_path / 'case')
        assert (case.verdict, case.message) == (Verdict.SAME, ''), form.name
    assert cell_outcome(dump_cell(CELL), 0, tmp_path / 'case').verdict is Verdict.SAME


def test_the_judge_sees_what_it_looks_for(tmp_path, monkeypatch):
    def hang() -> tuple[float, str]:
        try:
            time.sleep(10)
        except Exception:  # as a reader that takes everything for damage
            return 0.0, 'a warning'
        return 0.0, ''

    def fail(error: Exception) -> tuple[float, str]:
        raise error

    def execute() -> tuple[float, str]:
        (tmp_path / CANARY).mkdir()
        return 0.0, ''

    monkeypatch.setattr(outcomes, 'LONGEST', 0.1)
    expected = {
        lambda: fail(CellError('cell.yaml', 'no number')): Verdict.REFUSED,
        lambda: fail(KeyError('robot')): Verdict.CRASHED,
        hang: Verdict.SLOW,
        lambda: (0.0, ''): Verdict.SAME,
        lambda: (0.3, ''): Verdict.SILENT,
        lambda: (0.3, 'damaged'): Verdict.WARNED,
        lambda: (0.3, 'dam\x1b[2Jaged'): Verdict.CRASHED,
        execute: Verdict.EXECUTED,
    }
    for read, verdict in expected.items():
        assert outcome_of(read, tmp_path).verdict is verdict

"""Every target with every kind of poison: nothing in a name is evaluated, and no name breaks its file."""

from __future__ import annotations

import csv
import io
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.files.export import exported
from scara_kinetostatic.files.tables import csv_cell
from scara_kinetostatic.files.urdf import comment, xacro
from scara_kinetostatic.interface import simulate
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.cell import PAPER_CELL, Identification
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.results.document import residual_table

POISONS = (
    '${1/0}', '$(eval 1+1)', "${xacro.load_yaml('SECRET')['key']}", '$(find nothing)', '$(arg standalone)',
    '$$', '$', '$${x}', 'a$', "${'$'}", '$$$(x', '${', '$(', '<xacro:property name="a" value="${1/0}"/>',
    'xacro:eval-comments ${1/0}', 'xacro:eval-comments:off',
    '-->', '--', 'a-', '<!-- x', ']]>', '<![CDATA[', '&lt;', '&#0;', '"', "'", '<script>alert(1)</script>',
    '*/ int x; /*', '/*', '*/', '/*/', '//', '??/', '???/', 'a\\', '%s%n', '#include "x"', '#define SCARA_L1 0',
    'a,=HYPERLINK("http://x")', 'a;=1+1', 'a,-1', 'a\u00e9\U0001f600', '{{ 7 * 7 }}', '{% raw %}',
    'javascript:alert(1)', '$\\frac{', '$x^{2', '"a""b"', 'a,b', '#a', '[a]', 'a: b', '@a', '=a', '+a', '-a', '999',
    '0\\nSECTION',
)  # fmt: skip
SECRET = 'a secret of this machine'


@pytest.fixture(scope='module')
def plain() -> CalibratedArm:
    return calibrate(simulate(PAPER_CELL, PAPER_ACTUAL), PAPER_CELL).arm


def poisoned(arm: CalibratedArm, poison: str) -> CalibratedArm:
    """The arm with that name for robot, joints and discs, which need not be valid."""
    discs = tuple(disc._replace(name=f'{poison}{k}' if k else poison) for k, disc in enumerate(arm.cell.discs))
    names = (poison, poison + 'x')
    identification = Identification(robot=poison, serial_number=poison, cell=poison)
    return replace(arm, cell=replace(arm.cell, discs=discs, joint_names=names, identification=identification))


def file(arm: CalibratedArm, kind: str, poison: str) -> str:
    return exported(poisoned(arm, poison), kind, f'{poison}.json', step=0.2)[0]


def joints_of(robot: ElementTree.Element) -> list[str]:
    return [joint.attrib['name'] for joint in robot.iter('joint') if joint.attrib['type'] != 'fixed']


@pytest.mark.parametrize('poison', POISONS)
def test_urdf_and_xacro(plain: CalibratedArm, poison: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = ElementTree.fromstring(file(plain, 'urdf', poison))
    assert (robot.attrib['name'], joints_of(robot)) == (poison, [poison, poison + 'x'])
    xacro = pytest.importorskip('xacro')
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'SECRET').write_text(f'key: {SECRET}')
    (tmp_path / 'arm.xacro').write_text(file(plain, 'xacro', poison))
    text = xacro.process_file(str(tmp_path / 'arm.xacro')).toprettyxml()
    assert SECRET not in text
    robot = ElementTree.fromstring(text)
    assert (robot.attrib['name'], joints_of(robot)) == (poison, [poison, poison + 'x'])
    assert len(robot.findall('link')) == 4


def test_c_header(plain: CalibratedArm, tmp_path: Path) -> None:
    gcc = shutil.which('gcc')
    if gcc is None:
        pytest.skip('gcc is not installed')
    clean = file(plain, 'header', 'scara')
    end = clean.index('*/')
    comments = []
    for poison in POISONS:
        text = file(plain, 'header', poison)
        assert text[text.index('*/') :] == clean[end:]  # the comment ends where it ends
        comments.append(text[: text.index('*/')] + '*/\n')
    main = 'int main(void) { return SCARA_L1 > 0.1 ? 0 : 1; }\n'
    (tmp_path / 'main.c').write_text(''.join(comments) + clean + main)
    options = ['-std=c99', '-Wall', '-Wextra', '-pedantic', '-Werror', '-Wcomment', '-Wtrigraphs', '-trigraphs']
    command = [gcc, *options, '-o', str(tmp_path / 'main'), str(tmp_path / 'main.c'), '-lm']
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, '')
    assert subprocess.run([tmp_path / 'main'], check=False).returncode == 0


def is_formula(cell: str) -> bool:
    """Whether a spreadsheet evaluates a cell; a number is none."""
    try:
        float(cell)
    except ValueError:
        return cell.startswith(('=', '+', '-', '@', '\t', '\r'))
    return False


@pytest.mark.parametrize(
    ('kind', 'poison'), [*(('dh', poison) for poison in POISONS), ('csv', 'a,=HYPERLINK("http://x")')]
)
def test_csv(plain: CalibratedArm, kind: str, poison: str) -> None:
    text = file(plain, kind, poison)
    comments = [row for row in csv.reader(io.StringIO(text), delimiter=';') if row[0].startswith('#')]
    for row in (*comments, *csv.reader(io.StringIO(text))):
        assert not any(map(is_formula, row)), row
    rows = [row for row in csv.reader(io.StringIO(text)) if not row[0].startswith('#')]
    assert len({len(row) for row in rows}) == 1
    if kind == 'dh':
        for row, name in zip(rows[2:4], (poison, poison + 'x'), strict=True):
            assert row[1] in (name, f"'{name}")


def test_results(grown: Outcome) -> None:
    """Table of residuals; the page has tests of its own."""
    for poison in POISONS:
        discs = tuple(
            disc._replace(name=f'{poison}{k}' if k else poison) for k, disc in enumerate(grown.calibration.cell.discs)
        )
        renamed = replace(grown.calibration, cell=replace(grown.calibration.cell, discs=discs))
        table = residual_table(replace(grown, calibration=renamed))
        rows = list(csv.reader(io.StringIO(table)))
        assert len({len(row) for row in rows}) == 1
        assert not any(is_formula(cell) for row in rows for cell in row)
        assert {row[1] for row in rows[1:] if row[1]} <= {disc.name for disc in discs} | {
            f"'{disc.name}" for disc in discs
        }


@given(text=st.text(st.characters(exclude_categories=['Cs']), max_size=20))
@settings(max_examples=100, suppress_health_check=[HealthCheck.too_slow], deadline=None)
def test_anything(text: str) -> None:
    line = comment(text)
    assert '--' not in line
    assert not line.endswith('-')
    assert not any(mark in line for mark in ('/*', '*/', '??', '\n', '\r'))
    assert xacro(text).replace("${'$'}", '').count('$') == 0
    assert xacro(text).replace("${'$'}", '$') == text
    (row,) = csv.reader(io.StringIO(csv_cell(text), newline='')) if text else ([''],)
    assert row in ([text], ["'" + text])
    assert not is_formula(row[0])


def test_a_number_with_a_decimal_comma_stays() -> None:
    assert csv_cell('-1,5') == '"-1,5"'
    assert csv_cell('-1,5,2') == '"\'-1,5,2"'

"""What pip and colcon read must agree with the package and with itself."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

import pytest

import scara_kinetostatic
from scara_kinetostatic.errors import PYPI
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.model.cell import PAPER_CELL, Region
from scara_kinetostatic.simulation.plan import default_plan

ROOT = Path(__file__).parents[2]
NAME = 'scara_kinetostatic'


def setup_field(field: str) -> str:
    """A keyword of setup.py that is a plain string, or the constant NAME."""
    text = (ROOT / 'setup.py').read_text()
    (value,) = re.findall(rf"^    {field}=(?:'(.*)'|NAME),$", text, re.MULTILINE)
    return value or NAME


def test_name_version_and_licence_agree():
    package = ElementTree.parse(ROOT / 'package.xml').getroot()
    manifest = {field: package.findtext(field) for field in ('name', 'version', 'license')}
    assert manifest == {field: setup_field(field) for field in ('name', 'version', 'license')}
    assert manifest['version'] == scara_kinetostatic.__version__
    assert package.findtext('export/build_type') == 'ament_python'
    assert package.findtext('url') == setup_field('url')
    email = package.find('maintainer').attrib['email']  # type: ignore[union-attr]
    assert email == setup_field('author_email')
    assert re.fullmatch(r'[-a-zA-Z0-9_%+]+(\.[-a-zA-Z0-9_%+]+)*@[-a-zA-Z0-9%]+(\.[-a-zA-Z0-9%]+)*\.[a-zA-Z]{2,}', email)


def test_no_dependency_is_installed_by_pip():
    """The ROS build farm takes no such keys; the packages are named where their absence is noticed."""
    package = ElementTree.parse(ROOT / 'package.xml').getroot()
    keys = {str(item.text) for item in package if item.tag.endswith('depend')}
    assert not [key for key in keys if key.endswith('-pip') or key.startswith('mcap')]
    page = (ROOT / 'docs' / 'how_to' / 'ros_cell.md').read_text(encoding='utf-8')
    assert f'pip install --user --break-system-packages {" ".join(PYPI)}' in page


@pytest.mark.parametrize('code', [
    'from scara_kinetostatic.cli.main import main; sys.exit(main(["inspect", "recording"]))',
    'from scara_kinetostatic.nodes.executables import collector; sys.exit(collector())',
    'import scara_kinetostatic as sk; sk.read_touches',
])  # fmt: skip
def test_a_missing_library_is_one_line_that_says_what_installs_it(code, tmp_path):
    hidden = f'import sys; sys.path.insert(0, {str(ROOT)!r}); sys.modules.update(dict.fromkeys(("rosbags", "mcap")))'
    ended = subprocess.run([sys.executable, '-c', f'{hidden}; {code}'], capture_output=True, text=True, cwd=tmp_path)
    assert ended.stderr.splitlines()[-1].endswith('rosbags mcap: not installed; pip install rosbags mcap')
    if 'sk.' not in code:
        assert len(ended.stderr.splitlines()) == 1 and ended.returncode == 2


def test_every_executable_exists():
    scripts = re.findall(r"f'([\w-]+) = \{NAME\}\.([\w.]+):(\w+)'", (ROOT / 'setup.py').read_text())
    assert len(scripts) == 9
    for _, module, function in scripts:
        assert callable(getattr(import_module(f'{NAME}.{module}'), function))


def test_the_example_cell_is_the_cell_that_the_nodes_take_by_themselves_made_ready_for_planning():
    cell = load_cell(ROOT / 'config' / 'cell.yaml')
    assert replace(cell, limits=None, lift=None, region=Region()) == PAPER_CELL
    assert None not in (cell.limits, cell.lift)
    assert cell.region == Region(-0.35, 0.35, 0.20, 0.55)
    assert len(default_plan(cell)) == len(default_plan(PAPER_CELL)) == 72

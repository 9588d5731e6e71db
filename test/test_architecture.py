"""Imports go downwards only, each library is imported in few packages, and names are the standard terms."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from token import NAME as NAME_TOKEN
from tokenize import tokenize

import pytest

import scara_kinetostatic
from benchmark.smoke import ARGUMENTS, SHARED
from docs._ext.imports import MODULES, NAME, ROOT, floors, imports, module_name, package_of

ORDER = (
    'errors',
    'threads',
    'model',
    'gaussian',
    'effects',
    'calibration',
    'diagnosis',
    'assessment',
    'files',
    'report',
    'touches',
    'bags',
    'contour',
    'simulation',
    'planning',
    'pipeline',
    'results',
    'monitoring',
    'running',
    'studies.loops',
    'studies.paper',
    'interface',
    'nodes',
    'cli',
)
"""The packages from the ground up: each imports from those before it alone."""
ANYWHERE = {'numpy'}
KEPT_IN = {
    'scipy': (
        'assessment',
        'calibration',
        'diagnosis',
        'files',
        'gaussian',
        'model',
        'monitoring',
        'planning',
        'studies',
        'threads',
    ),
    'yaml': ('files', 'simulation', 'bags'),
    'matplotlib': ('planning', 'report', 'results', 'studies'),
    'markupsafe': ('contour', 'files', 'monitoring', 'report', 'planning', 'results', 'simulation', 'studies'),
    'jinja2': ('files',),
    'rich': ('cli',),
    'threadpoolctl': ('threads',),
    'mujoco': ('simulation',),
    'distributed': ('monitoring',),
    **dict.fromkeys(('rosbags', 'mcap', 'zstandard', 'lz4'), ('bags',)),
    **dict.fromkeys(('rclpy', 'builtin_interfaces', 'rcl_interfaces', 'diagnostic_msgs'), ('nodes',)),
    **dict.fromkeys(('geometry_msgs', 'nav_msgs', 'sensor_msgs', 'std_msgs', 'std_srvs', 'tf2_msgs'), ('nodes',)),
    **dict.fromkeys(('action_msgs', 'rosgraph_msgs', 'trajectory_msgs', 'visualization_msgs'), ('nodes',)),
}
"""The packages in which each library is imported."""
FORMER_NAMES = """
betrays hides_behind reveal runs_off makes_sense strength other_forms contest judge price proved stories story told
leaning lean deciding hidden_bend bent unbent unseen misreading unread structure conclude assignment live inflate
folders overpress let_down play played player gauge situation setting tags twelve settle
"""
"""Words that a standard term has replaced: none of them is an identifier."""
UNCLEAR = r'\b(rivals?|leverages?|enlargements?|misclosures?|whitened|independent part|large effect)\b'
"""Words that readers did not understand; keys and columns of files keep them."""


def test_every_module_is_in_a_known_package() -> None:
    found = {package_of(module_name(path)) for path in MODULES} - {'', 'studies'}
    assert found == set(ORDER)


def test_the_docstring_of_the_package_lists_them_from_the_top() -> None:
    listed = re.findall(r'^ {4}(\w+(?:, \w+)*) {2,}\w', scara_kinetostatic.__doc__.partition('from the top')[2], re.M)
    names = [name for line in listed for name in line.split(', ')]
    assert names == list(dict.fromkeys(name.partition('.')[0] for name in reversed(ORDER)))


def test_imports_go_downwards() -> None:
    pairs = [(module_name(path), module) for path in MODULES for module in imports(path)]
    for name, module in pairs:
        here = package_of(name)
        if name != NAME and module.startswith(f'{NAME}.') and here != package_of(module):
            assert ORDER.index(package_of(module)) < ORDER.index(here), f'{name} imports {module}'
            if package_of(module) == 'nodes':  # only the demonstration starts nodes, and one verb hears a topic
                assert name in (f'{NAME}.cli.demo', f'{NAME}.cli.cell')


def test_the_picture_shows_every_package_above_what_it_imports() -> None:
    assert set(floors()) == set(ORDER)
    assert floors()['errors'] == 0 and floors()['cli'] == max(floors().values())


def test_types_of_arrays_are_defined_once() -> None:
    defined = re.compile(r'^(Floats|Indices|Mask)\b[^=\n]*= *(np\.typing\.)?NDArray', re.MULTILINE)
    found = [module_name(path) for path in MODULES if defined.search(path.read_text(encoding='utf-8'))]
    assert found == [f'{NAME}.model.arrays']


def test_no_circles() -> None:
    graph = {module_name(path): {m for m in imports(path) if m.startswith(f'{NAME}.')} for path in MODULES}
    del graph[NAME]  # its names are loaded on first use
    done: set[str] = set()

    def visit(module: str, above: tuple[str, ...]) -> None:
        assert module not in above, ' -> '.join((*above, module))
        if module not in done:
            for other in graph.get(module, ()):
                visit(other, (*above, module))
            done.add(module)

    for module in graph:
        visit(module, ())


def test_a_library_is_imported_in_few_packages() -> None:
    found: dict[str, set[str]] = {}
    for path in MODULES:
        for library in {module.split('.')[0] for module in imports(path)}:
            found.setdefault(library, set()).add(package_of(module_name(path)).split('.')[0])
    others = {library: found[library] for library in found.keys() - sys.stdlib_module_names - {NAME} - ANYWHERE}
    assert others == {library: set(packages) for library, packages in KEPT_IN.items()}


def test_names_are_standard_terms() -> None:
    former = set(FORMER_NAMES.split())
    anywhere = re.compile(rf'\b_*({"|".join(former)})_*\b', re.IGNORECASE)
    for path in filter(lambda path: anywhere.search(path.read_text(encoding='utf-8')), MODULES):
        with path.open('rb') as stream:
            names = {token.string.strip('_').lower() for token in tokenize(stream.readline) if token.type == NAME_TOKEN}
        assert not names & former, path


def test_texts_and_pages_have_plain_words() -> None:
    pages = [path for path in (ROOT / 'docs').rglob('*.md') if '_build' not in path.parts]
    pages += [ROOT / 'README.md', ROOT / 'bags' / 'README.md']
    texts = [(path, path.read_text(encoding='utf-8')) for path in pages]
    for path in MODULES:
        tree = ast.parse(path.read_text(encoding='utf-8'))
        silent = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}  # docstrings
        if path.parent.name == 'cli':  # those are the help
            silent.discard(id(tree.body[0].value))  # type: ignore[attr-defined]
        said = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in silent)
        texts += [(path, str(node.value)) for node in said if ' ' in str(node.value)]
    for path, text in texts:
        words = re.search(UNCLEAR, re.sub(r'`[^`]*`', '', text), re.IGNORECASE)
        assert words is None or path.name == 'glossary.md', (path, text[words.start() - 30 : words.end() + 30])


def test_the_numerical_core_needs_neither_ros_nor_files() -> None:
    code = (
        'import sys, scara_kinetostatic.diagnosis.diagnose as d, scara_kinetostatic.calibration.result as h\n'
        "print([m for m in ('rclpy', 'rosbags', 'mcap', 'yaml', 'matplotlib', 'jinja2', 'rich') if m in sys.modules])"
    )
    result = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert result.stdout.strip() == '[]'


def test_public_names_are_there_and_loaded_late() -> None:
    for name in scara_kinetostatic.__all__:
        assert getattr(scara_kinetostatic, name) is not None
    assert set(scara_kinetostatic.__all__) <= set(dir(scara_kinetostatic))
    with pytest.raises(AttributeError, match='nonsense'):
        _ = scara_kinetostatic.nonsense
    code = "import sys, scara_kinetostatic; print('numpy' in sys.modules)"
    result = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert result.stdout.strip() == 'False'


def test_one_version_everywhere() -> None:
    version = scara_kinetostatic.__version__
    assert f"version='{version}'" in (ROOT / 'setup.py').read_text()
    assert f'<version>{version}</version>' in (ROOT / 'package.xml').read_text()
    assert f'\nversion: {version}\n' in (ROOT / 'CITATION.cff').read_text()
    changes = (ROOT / 'CHANGELOG.md').read_text(encoding='utf-8')
    assert re.search(rf'^## \[?{re.escape(version)}', changes, re.MULTILINE)


def test_every_benchmark_has_a_small_run() -> None:
    there = {path.stem for path in (ROOT / 'benchmark').glob('*.py')}
    there |= {path.parent.name for path in (ROOT / 'benchmark').glob('*/__main__.py')}
    assert there - SHARED == {name.partition('.')[0] for name in ARGUMENTS}

"""What the documentation shows is what its commands and programs give."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path

import pytest
from docs.examples import DOCS, ROOT, blocks, compare, is_run, pages, run_page
from files.robots import CASES, text_of

from scara_kinetostatic.cli.main import build_parser, main
from scara_kinetostatic.effects import registry

RUN = [page for page in pages() if is_run(page)]


@pytest.mark.parametrize('page', RUN, ids=lambda page: page.stem)
@pytest.mark.usefixtures('without_page')
def test_examples(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if page.stem == 'from_urdf':
        text_of(CASES['ur5'])
    for folder in ('bags', 'config'):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, '_registered', [])
    modules = set(sys.modules)
    names: dict[str, object] = {'__name__': 'example'}

    def run(words: list[str]) -> str:
        assert words[0] == 'scara-kinetostatic'
        status = main(words[1:])
        printed = capsys.readouterr()
        assert status == 0, printed.err
        return printed.out

    def execute(program: str) -> str:
        exec(compile(program, f'{page.name}', 'exec'), names)
        return capsys.readouterr().out

    run_page(page, tmp_path, run, execute)
    for name in set(sys.modules) - modules:
        if (tmp_path / f'{name}.py').exists():
            del sys.modules[name]


def test_the_tutorials_are_run() -> None:
    assert {page for page in pages() if page.parent == DOCS / 'tutorials'} <= set(RUN)


@pytest.mark.parametrize('page', pages(), ids=lambda page: page.stem)
def test_commands_are_understood(page: Path) -> None:
    for block in blocks(page):
        if block.language == 'bash':
            lines = block.text.replace('\\\n', ' ').splitlines()
            for line in (line for line in lines if line.startswith('scara-kinetostatic ')):
                assert build_parser().parse_args(shlex.split(line, comments=True)[1:]).verb


@pytest.mark.parametrize(
    ('shown', 'printed'),
    [('l1 330.2', 'l1 340.2'), ('l1 330.2', 'l2 330.2'), ('…\nb 2\n…\na 1', 'a 1\nb 2'), ('done …', 'failed')],
)
def test_another_output_is_noticed(shown: str, printed: str) -> None:
    with pytest.raises(AssertionError):
        compare(shown, printed, 'it')


def test_an_elision_stands_for_anything() -> None:
    compare('a …\nb 2\n…', 'a 1 2 3\nb 2\nc', 'it')


@pytest.mark.parametrize('page', [*pages(), ROOT / 'README.md', ROOT / 'bags' / 'README.md'], ids=str)
def test_modules_and_files_that_are_named_exist(page: Path) -> None:
    text = page.read_text(encoding='utf-8')
    for module in re.findall(r'python -m ([\w.]+\w)', text):
        folders = [folder / module.replace('.', '/') for folder in (ROOT, ROOT / 'test')]
        assert module == 'pytest' or any(f.with_suffix('.py').exists() or f.is_dir() for f in folders), module
    for path in re.findall(r'`((?:test|config|benchmark)/[\w./-]+)`', text):
        assert (ROOT / path).exists(), path


@pytest.mark.parametrize(
    'page',
    [*(DOCS / 'project' / f'{name}.md' for name in ('architecture', 'decisions')), ROOT / 'CONTRIBUTING.md'],
    ids=str,
)
def test_files_of_the_package_that_a_page_of_the_project_names_exist(page: Path) -> None:
    text = page.read_text(encoding='utf-8')
    named = re.findall(r'`((?:[a-z_0-9.]+/)+[a-z_0-9]+\.[a-z]+)`', text)
    assert len(named) > 10
    for path in named:
        assert (ROOT / path).exists() or (ROOT / 'scara_kinetostatic' / path).exists(), path
    for target in re.findall(r'\]\(([^)#]+)', text):
        assert (page.parent / target).exists(), target

"""What the modules of the package import, read from their text; for the page *Architecture* and for the tests."""

from __future__ import annotations

import ast
from collections import Counter
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
NAME = 'scara_kinetostatic'
PACKAGE = ROOT / NAME
MODULES = sorted(PACKAGE.rglob('*.py'))


def module_name(path: Path) -> str:
    """The name by which a file is imported."""
    return '.'.join(path.relative_to(ROOT).with_suffix('').parts).removesuffix('.__init__')


@cache
def imports(path: Path) -> tuple[str, ...]:
    """Every module that a file imports, wherever in the file, `from package import module` resolved."""
    found: list[str] = []
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path}: relative import'
            assert node.module
            for alias in node.names:
                inner = ROOT.joinpath(*node.module.split('.'), f'{alias.name}.py')
                found.append(f'{node.module}.{alias.name}' if inner.exists() else node.module)
    return tuple(found)


def package_of(module: str) -> str:
    """The package of a module, such as `model`, `studies.paper`; of one at the top its own name."""
    parts = module.split('.')[1:]
    return '.'.join(parts[:2] if parts[:1] == ['studies'] and parts[1:] else parts[:1])


def between_packages() -> dict[str, Counter[str]]:
    """Of each package, how many times its files import a module of each other package."""
    found: dict[str, Counter[str]] = {}
    for path in MODULES:
        here = package_of(module_name(path))
        others = (package_of(module) for module in imports(path) if module.startswith(f'{NAME}.'))
        found.setdefault(here, Counter()).update(other for other in others if other not in ('', here))
    return {here: found[here] for here in found if here not in ('', 'studies')}


def floors() -> dict[str, int]:
    """The floor of each package: one above the highest that it imports, from 0, lowest first."""
    graph = between_packages()

    @cache
    def floor(package: str) -> int:
        return 1 + max((floor(other) for other in graph[package]), default=-1)

    return {package: floor(package) for package in sorted(graph, key=lambda each: (floor(each), each))}

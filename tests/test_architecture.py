# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""The core knows neither ROS nor files; imports point downwards, nodes alone know ROS."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
import sys

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / 'identnl_ros'
MODULES = sorted(PACKAGE.rglob('*.py'))

# What each part may import of the others. Parts: the folders of identnl_ros.
MAY_IMPORT = {
    'core': set(),
    'storage': {'core'},
    'reports': {'core', 'storage'},
    'sources': {'core', 'storage'},
    'nodes': {'core', 'storage', 'reports', 'sources'},
    'cli': {'core', 'storage', 'reports', 'sources'},
}
# Inside functions, so that the command line works where there is no ROS.
MAY_IMPORT_LAZILY = {'cli': {'nodes'}}

CORE_LIBRARIES = {'numpy', 'scipy', 'numba'}
FILES_AND_PROCESSES = {
    'fileinput', 'glob', 'io', 'os', 'pathlib', 'shutil', 'socket', 'sqlite3', 'subprocess',
    'tempfile',
}  # fmt: skip
FILE_AND_PRINT_CALLS = {
    'fromfile', 'genfromtxt', 'input', 'loadmat', 'loadtxt', 'memmap', 'open', 'print', 'savemat',
    'savetxt', 'savez', 'savez_compressed', 'tofile',
}  # fmt: skip


@dataclass(frozen=True)
class Import:
    """A module that a file imports, and whether only when a function is called."""

    name: str
    line: int
    lazy: bool

    @property
    def top(self) -> str:
        return self.name.partition('.')[0]

    @property
    def is_ros(self) -> bool:
        return self.top.endswith(('_msgs', '_interfaces', '_srvs')) or self.top in {
            'ament_index_python', 'launch', 'launch_ros', 'rclpy', 'rosidl_runtime_py', 'tf2_ros',
        }  # fmt: skip


def part_of(name: str) -> str | None:
    """Return the folder of identnl_ros that a module is in; None outside of all."""
    names = name.split('.')
    return names[1] if names[0] == PACKAGE.name and len(names) > 1 else None


def module_name(path: Path) -> str:
    return '.'.join(path.relative_to(PACKAGE.parent).with_suffix('').parts)


def imports(path: Path) -> Iterator[Import]:
    """Yield what a file imports; of ``from a import b`` both a.b, as b may be a module."""
    package = module_name(path).split('.')[:-1]

    def visit(node: ast.AST, lazy: bool) -> Iterator[Import]:
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(alias.name, node.lineno, lazy)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            for alias in node.names:
                name = '.'.join([*base, *filter(None, [node.module]), alias.name])
                yield Import(name, node.lineno, lazy)
        lazy = lazy or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        for child in ast.iter_child_nodes(node):
            yield from visit(child, lazy)

    return visit(ast.parse(path.read_text(encoding='utf-8'), str(path)), False)


def each_module_of(*parts: str) -> list[Path]:
    return [path for path in MODULES if not parts or part_of(module_name(path)) in parts]


def test_every_folder_is_a_known_part():
    folders = {path.name for path in PACKAGE.iterdir() if (path / '__init__.py').exists()}
    assert folders <= MAY_IMPORT.keys()


@pytest.mark.parametrize('path', each_module_of(), ids=module_name)
def test_imports_point_downwards(path):
    own = part_of(module_name(path))
    wrong = [
        f'{path}:{found.line} imports {found.name}'
        for found in imports(path)
        for other in [part_of(found.name)]
        if own in MAY_IMPORT and other in MAY_IMPORT and other != own
        if other not in MAY_IMPORT[own]
        if not (found.lazy and other in MAY_IMPORT_LAZILY.get(own, ()))
    ]
    assert not wrong


@pytest.mark.parametrize('path', each_module_of(), ids=module_name)
def test_only_nodes_import_ros(path):
    if part_of(module_name(path)) == 'nodes':
        return
    assert [f'{path}:{found.line} {found.name}' for found in imports(path) if found.is_ros] == []


@pytest.mark.parametrize('path', each_module_of('core'), ids=module_name)
def test_core_imports_numerics_only(path):
    allowed = (set(sys.stdlib_module_names) - FILES_AND_PROCESSES) | CORE_LIBRARIES
    wrong = [
        f'{path}:{found.line} imports {found.name}'
        for found in imports(path)
        if found.top not in allowed and part_of(found.name) != 'core'
    ]
    assert not wrong


@pytest.mark.parametrize('path', each_module_of('core'), ids=module_name)
def test_core_neither_prints_nor_opens_files(path):
    wrong = []
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Call):
            name = getattr(node.func, 'id', None) or getattr(node.func, 'attr', None)
            if name in FILE_AND_PRINT_CALLS:
                wrong.append(f'{path}:{node.lineno} calls {name}')
    assert not wrong

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""What is said twice about the package is said alike."""

import ast
from importlib.metadata import distribution, packages_distributions, version
from pathlib import Path
import re
import sys
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / 'identnl_ros'
MANIFEST = ElementTree.parse(ROOT / 'package.xml')
MESSAGES_MANIFEST = ElementTree.parse(ROOT / 'msg_defs/package.xml')

ENTRY_POINTS = sorted(distribution('identnl_ros').entry_points, key=lambda entry: entry.name)


def normal(name: str) -> str:
    return re.sub(r'[-_.]+', '-', name).lower()


def requirement_name(requirement: str) -> str:
    return normal(re.match(r'[\w.-]+', requirement).group())


def imported_modules(folder: Path) -> set[str]:
    """Return the top-level modules that the files below a folder import."""
    found = set()
    for path in folder.rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                found.add(node.module.partition('.')[0])
    return found - set(sys.stdlib_module_names) - {PACKAGE.name}


def locked() -> dict[str, str]:
    """Return the pinned version of each package in requirements.lock."""
    lines = (ROOT / 'requirements.lock').read_text().splitlines()
    pins = [line.partition('==') for line in lines if line and line.lstrip()[0] != '#']
    return {normal(name.partition('[')[0]): pinned.split()[0] for name, _, pinned in pins}


def test_versions_agree():
    declared = MANIFEST.findtext('version')
    assert re.fullmatch(r'\d+\.\d+\.\d+', declared)
    assert MESSAGES_MANIFEST.findtext('version') == declared
    assert version('identnl_ros') == declared


@pytest.mark.ros
def test_version_of_installed_messages_agrees():
    prefix = Path(pytest.importorskip('identnl_msgs').__file__).parents[4]
    manifest = ElementTree.parse(prefix / 'share/identnl_msgs/package.xml')
    assert manifest.findtext('version') == MANIFEST.findtext('version')


@pytest.mark.parametrize('manifest', [MANIFEST, MESSAGES_MANIFEST], ids=['root', 'msg_defs'])
def test_manifest_names_maintainer_and_license(manifest):
    assert manifest.getroot().get('format') == '3'
    assert manifest.findtext('license') == 'Apache-2.0'
    assert manifest.findtext('maintainer') == 'identnl_ros developers'
    assert manifest.find('maintainer').get('email') == 'identnl_ros@example.com'


@pytest.mark.parametrize('entry', ENTRY_POINTS, ids=lambda entry: entry.name)
def test_entry_point_leads_to_something(entry):
    path = ROOT.joinpath(*entry.module.split('.')).with_suffix('.py')
    assert path.exists()
    top_level = ast.parse(path.read_text(encoding='utf-8')).body
    names = {getattr(node, 'name', None) for node in top_level}
    for node in top_level:
        if isinstance(node, ast.Assign):
            names |= {getattr(target, 'id', None) for target in node.targets}
    assert entry.attr in names


def test_every_node_has_an_entry_point():
    modules = {entry.module for entry in ENTRY_POINTS}
    for path in (PACKAGE / 'nodes').glob('*.py'):
        tree = ast.parse(path.read_text(encoding='utf-8'))
        if any(isinstance(node, ast.FunctionDef) and node.name == 'main' for node in tree.body):
            assert f'identnl_ros.nodes.{path.stem}' in modules


def test_every_import_is_a_declared_dependency():
    python = {requirement_name(r) for r in distribution('identnl_ros').requires or ()}
    ros = {element.text for element in MANIFEST.iterfind('exec_depend')}
    distributions = packages_distributions()
    undeclared = {
        module
        for module in imported_modules(PACKAGE)
        if module not in ros
        and not python & {normal(name) for name in distributions.get(module, [module])}
    }
    assert not undeclared


def test_lock_file_pins_everything_asked_for():
    asked_for = [
        line.partition('#')[0].strip()
        for line in (ROOT / 'requirements.in').read_text().splitlines()
    ]
    asked_for += distribution('identnl_ros').requires or []
    names = {requirement_name(requirement) for requirement in asked_for if requirement}
    assert names <= locked().keys()


def test_lock_file_pins_exact_versions():
    for line in (ROOT / 'requirements.lock').read_text().splitlines():
        if line and not line.lstrip().startswith('#'):
            assert re.fullmatch(r'[\w.\[\],-]+==[\w.+]+', line.strip())

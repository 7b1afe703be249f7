# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""The message package is complete, and its definitions go with the Python package."""

from importlib import import_module
from importlib.resources import files
from pathlib import Path
import re
from xml.etree import ElementTree

import pytest

SOURCE = Path(__file__).resolve().parents[2] / 'msg_defs'
INTERFACES = sorted([*SOURCE.glob('msg/*.msg'), *SOURCE.glob('srv/*.srv')])

each_interface = pytest.mark.parametrize('path', INTERFACES, ids=lambda path: path.stem)


@each_interface
def test_cmake_generates_the_interface(path):
    cmake = (SOURCE / 'CMakeLists.txt').read_text()
    kind = path.parent.name
    assert f'{kind}/{path.name}"' in cmake or f'{kind}/*.{kind}"' in cmake


def test_packages_of_field_types_are_declared():
    field_type = re.compile(r'^(\w+)/\w+', re.MULTILINE)
    used = {name for path in INTERFACES for name in field_type.findall(path.read_text())}
    manifest = ElementTree.parse(SOURCE / 'package.xml')
    assert used == {element.text for element in manifest.iterfind('depend')}
    cmake = (SOURCE / 'CMakeLists.txt').read_text()
    declared = re.search(r'DEPENDENCIES ([\w ]+)\)', cmake).group(1).split()
    assert used == set(declared)
    assert all(f'find_package({name} REQUIRED)' in cmake for name in used)


def test_definitions_are_data_of_the_python_package():
    installed = files('identnl_ros') / 'storage/message_definitions'
    texts = {entry.name: entry.read_text() for entry in installed.iterdir()}
    assert texts == {path.name: path.read_text() for path in SOURCE.glob('msg/*.msg')}


@pytest.mark.ros
@each_interface
def test_interface_is_built(path):
    module = pytest.importorskip(f'identnl_msgs.{path.parent.name}')
    assert hasattr(module, path.stem)


@pytest.mark.ros
@each_interface
def test_built_interface_is_of_this_definition(path):
    """The fields of the built class, in order, are those in the file: it is not out of date."""
    pytest.importorskip('identnl_msgs')
    built = getattr(import_module(f'identnl_msgs.{path.parent.name}'), path.stem)
    parts = [built] if path.suffix == '.msg' else [built.Request, built.Response]
    field = re.compile(r'^[\w/]+(?:\[\d*\])?\s+(\w+)\s*(?:#.*)?$', re.MULTILINE)
    for part, text in zip(parts, re.split(r'^---$', path.read_text(), flags=re.M), strict=True):
        assert list(part.get_fields_and_field_types()) == field.findall(text)

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""Installed sources are found by their metadata; a broken one harms no other."""

from importlib.metadata import entry_points
import sys

from identnl_ros.core.errors import DataError
from identnl_ros.sources.registry import GROUP, Registry
import pytest

SOUND = """
from identnl_ros.sources.setting import Setting

class Devices:
    settings = (Setting('port', 9750, 'Port.', 1, 65535),)

    def devices(self, setting):
        return []

source = Devices()
"""


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Install a package of one module that offers a source, as metadata on the path."""
    monkeypatch.syspath_prepend(tmp_path)
    modules = []

    def package(name, code, source='box'):
        module = name.replace('-', '_')
        modules.append(module)
        (tmp_path / f'{module}.py').write_text(code)
        metadata = tmp_path / f'{module}-1.0.dist-info'
        metadata.mkdir()
        (metadata / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n')
        (metadata / 'entry_points.txt').write_text(f'[{GROUP}]\n{source} = {module}:source\n')
        return Registry(entry_points(group=GROUP))

    yield package
    for module in modules:
        sys.modules.pop(module, None)


def test_source_of_another_package_is_found_with_its_settings(install):
    source = install('box-maker', SOUND)['box']
    assert source.distribution == 'box-maker'
    assert [(one.name, one.default) for one in source.settings] == [('port', 9750)]


@pytest.mark.parametrize(
    ('code', 'words'),
    [
        ('import software_of_the_maker', "No module named 'software_of_the_maker'"),
        ('raise SystemExit(3)', 'SystemExit: 3'),
        ('def source(:', 'SyntaxError'),
        ('', 'AttributeError: .*source'),
        ('source = 3', 'of type int and has neither make.. nor devices..'),
        ('class source: devices = print', 'AttributeError: .*settings'),
        ('class source:\n settings = ["port"]\n devices = print', 'no tuple of .*Setting'),
        (SOUND.replace("'port'", "'a port'"), 'setting "a port" is no word'),
        (SOUND.replace('9750', 'None'), 'default of its setting port is a NoneType'),
    ],
)
def test_broken_source_is_told_with_its_package_when_it_is_asked_for(install, code, words):
    install('sound', SOUND, 'sound')
    registry = install('box-maker', code)
    with pytest.raises(
        DataError, match=f'source "box" of the package box-maker .*{words}'
    ) as told:
        registry['box']
    assert '\n' not in str(told.value)
    assert registry['sound'].settings
    assert 'box' in registry.names


def test_source_that_is_not_installed_is_told_with_what_is_close(install):
    with pytest.raises(DataError, match='source "bx" is not installed; did you mean "box"'):
        install('box-maker', SOUND)['bx']
    with pytest.raises(DataError, match=r'installed are .*bag.*simulated'):
        install('other', SOUND, 'other')['']


def test_two_packages_cannot_offer_the_same_source(install):
    install('box-maker', SOUND)
    registry = install('copy-cat', SOUND)
    with pytest.raises(DataError, match=r'two packages, .*(box-maker|copy-cat).*uninstall one'):
        registry['box']


def test_other_package_cannot_take_the_place_of_an_own_source(install):
    source = install('copy-cat', SOUND, 'bag')['bag']
    assert [one.name for one in source.settings] == ['bag']
    assert source.distribution != 'copy-cat'

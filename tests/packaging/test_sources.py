# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""Every file of the project says its licence; none depends on where packages come from."""

from collections.abc import Iterator
from pathlib import Path
import re

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOT_OURS = {'build', 'dist', 'install', 'log', 'results', '__pycache__'}
SOURCE_NAMES = re.compile(
    r'.*\.(cfg|cmake|in|msg|py|sh|srv|toml|yaml|yml)|CMakeLists\.txt|Makefile|package\.xml|run'
)
# Written in two halves, so that this file does not hold them.
REGISTRIES = [
    'pypi' + '.org', 'python' + 'hosted', 'crates' + '.io', 'npm' + 'js', 'proxy.golang' + '.org',
    'repo.maven' + '.apache', 'deb.debian' + '.org', 'archive.ubuntu' + '.com',
]  # fmt: skip


def project_files(folder: Path = ROOT) -> Iterator[Path]:
    for path in sorted(folder.iterdir()):
        hidden = path.name.startswith('.') and path.name not in ('.ci', '.gitignore')
        if hidden or path.name in NOT_OURS or path.suffix == '.egg-info' or path.is_symlink():
            continue
        if path.is_dir():
            yield from project_files(path)
        else:
            yield path


def relative(path: Path) -> str:
    return str(path.relative_to(ROOT))


SOURCES = [path for path in project_files() if SOURCE_NAMES.fullmatch(path.name)]


@pytest.mark.parametrize('path', SOURCES, ids=relative)
def test_source_file_names_its_licence(path):
    if path.stat().st_size:
        head = path.read_text(encoding='utf-8').splitlines()[:8]
        assert any('SPDX-License-Identifier: Apache-2.0' in line for line in head)
        assert any(re.search(r'Copyright \d{4} The identnl_ros developers', line) for line in head)


def test_licence_text_is_complete():
    text = (ROOT / 'LICENSE').read_text()
    assert 'Apache License' in text
    assert 'END OF TERMS AND CONDITIONS' in text


def test_no_file_names_a_package_registry():
    hosts = re.compile('|'.join(map(re.escape, REGISTRIES)).encode(), re.IGNORECASE)
    named = [relative(path) for path in project_files() if hosts.search(path.read_bytes())]
    assert not named

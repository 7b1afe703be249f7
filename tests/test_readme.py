# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The commands that the documents show run as they stand."""

import os
from pathlib import Path
import re
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r'^```sh\n(.*?)^```', re.MULTILINE | re.DOTALL)
DOCUMENTS = [
    path for path in (ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md')),
                      ROOT / 'bags/README.md')
    if BLOCK.search(path.read_text('utf-8'))
]  # fmt: skip


@pytest.mark.parametrize('path', DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_commands_of_the_document_run(path, tmp_path):
    for folder in ('config', 'bags'):
        (tmp_path / folder).symlink_to(ROOT / folder)
    environment = dict(os.environ)
    environment['PATH'] = f'{Path(sys.executable).parent}{os.pathsep}{environment["PATH"]}'
    for block in BLOCK.findall(path.read_text('utf-8')):
        result = subprocess.run(
            ['bash', '-euc', block], cwd=tmp_path, env=environment, capture_output=True,
            text=True, timeout=240,
        )  # fmt: skip
        assert result.returncode == 0, f'{block}\n{result.stderr}'


def test_links_in_the_documents_lead_somewhere():
    for path in (ROOT / 'README.md', *(ROOT / 'docs').glob('*.md'), ROOT / 'bags/README.md'):
        for target in re.findall(r'\]\(([^)#:]+)\)', path.read_text('utf-8')):
            assert (path.parent / target).exists(), f'{path.name}: {target}'


def test_no_placeholder_is_left_in_the_documents():
    for path in (ROOT / 'README.md', *(ROOT / 'docs').glob('*.md'), ROOT / 'bags/README.md'):
        assert not re.search(r'^[A-Z]+_[A-Z]+$', path.read_text('utf-8'), re.MULTILINE)

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl check`: tell whether files are sound."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

import click
from identnl_ros.cli.output import command as reporting, DONE, NEGATIVE, Outcome

if TYPE_CHECKING:
    from identnl_ros.sources.soundness import Findings

UNITS = {
    'rest': 'm, rad',
    'natural_frequencies': 'Hz',
    'displacement_standard_deviation': 'm, rad',
    'sample_rate': 'Hz',
    'duration': 's',
    'delay': 's',
    'remaining_delays': 's',
    'standard_deviation': 's',
}

# Told as problems and remarks.
TOLD = {'faults', 'gain_limits'}


@click.command('check')
@click.argument('paths', nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    '--machine',
    type=click.Path(path_type=Path),
    help='Machine file that layouts and bags have to fit; layouts: by default the one in PATHS.',
)
@click.option(
    '--delays',
    is_flag=True,
    help='Also estimate by how much channels of bags are late against redundant ones; takes some '
    'seconds.',
)
@reporting
def command(paths: tuple[Path, ...], machine: Path | None, delays: bool) -> Outcome:
    """
    Check machine files, layout files and bags.

    YAML files are told apart by their content; everything else is taken for a bag. Layout files
    are checked against the machine file among PATHS; of several, against the one of their name.
    A bag that lacks less than 1 % of its samples is sound, with a remark. Exit code 1: something
    is not sound.
    """
    findings = _checked(paths, machine, delays)
    sound = all(one.sound for one in findings)
    document = {
        'sound': sound,
        'files': [
            {
                'path': str(one.path),
                'kind': one.kind,
                'sound': one.sound,
                'problems': one.problems,
                'remarks': one.remarks,
                **one.facts,
            }
            for one in findings
        ],
    }
    return Outcome(document, lambda: _show(findings), DONE if sound else NEGATIVE)


def _checked(paths: Sequence[Path], machine: Path | None, delays: bool) -> 'list[Findings]':
    from identnl_ros.sources.soundness import check_bag, check_layout, check_machine

    machines = {
        path: check_machine(path) for path in paths if _is_yaml(path) and not _is_layout(path)
    }
    readable = [path for path, found in machines.items() if found.facts]
    findings = []
    for path in paths:
        if path in machines:
            findings.append(machines[path])
        elif _is_layout(path):
            findings.append(check_layout(path, machine or _machine_of(path, readable)))
        else:
            findings.append(check_bag(path, machine, delays))
    return findings


def _machine_of(layout: Path, machines: Sequence[Path]) -> Path | None:
    """Find the machine file that a layout file belongs to."""
    from identnl_ros.storage.layout_file import default_layout_path

    if len(machines) == 1:
        return machines[0]
    return next((one for one in machines if default_layout_path(one) == layout), None)


def _is_yaml(path: Path) -> bool:
    return path.suffix in ('.yaml', '.yml')


def _is_layout(path: Path) -> bool:
    if not _is_yaml(path):
        return False
    try:
        text = path.read_text('utf-8', errors='replace')
    except OSError:
        return False
    return any(line.startswith('sensors:') for line in text.splitlines())


def _show(findings: 'list[Findings]') -> None:
    for one in findings:
        click.echo(f'{one.path}: {one.kind}, {"sound" if one.sound else "NOT sound"}')
        for problem in one.problems:
            click.echo(f'  problem: {problem}')
        for remark in one.remarks:
            click.echo(f'  remark: {remark}')
        for key, value in one.facts.items():
            if key != 'streams':
                click.echo(f'  {_title(key)}: {_short(value)}')
                continue
            for number, stream in enumerate(value):
                click.echo(f'  stream {number}:')
                _show_stream(stream)


def _show_stream(stream: dict[str, Any]) -> None:
    from identnl_ros.core.quality.common_faults import told_once

    for key, value in stream.items():
        if key in TOLD or value in ([], {}):
            continue
        if key == 'left_out':
            channels = [one['name'] for one in stream['channels']]
            causes = ((name, _short(counts)) for name, counts in value.items())
            shown = '; '.join(told_once(causes, channels))
        else:
            shown = _short(value)
        click.echo(f'    {_title(key)}: {shown}')


def _title(key: str) -> str:
    return key.replace('_', ' ') + (f' [{UNITS[key]}]' if key in UNITS else '')


def _short(value: object) -> str:
    if isinstance(value, dict):
        return ', '.join(
            f'{_title(name) if name in UNITS else name} {_short(one)}'
            for name, one in value.items()
            if name not in TOLD and one not in ([], {})
        )
    if isinstance(value, list):
        if value and isinstance(value[0], dict) and 'name' in value[0]:
            return f'{len(value)}: ' + ', '.join(str(one['name']) for one in value)
        return ', '.join(_short(one) for one in value)
    return f'{value:.4g}' if isinstance(value, float) else str(value)

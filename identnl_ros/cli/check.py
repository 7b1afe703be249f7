# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl check`: tell whether files are sound."""

from pathlib import Path
from typing import TYPE_CHECKING

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
    'standard_deviation': 's',
}

# Told as problems and remarks.
TOLD = {'faults', 'gain_limits'}


@click.command('check')
@click.argument('paths', nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    '--machine',
    type=click.Path(path_type=Path),
    help='Machine file that layouts and bags have to fit.',
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

    YAML files are told apart by their content; everything else is taken for a bag. A bag that
    lacks less than 1 % of its samples is sound, with a remark. Exit code 1: something is not
    sound.
    """
    findings = [_check(path, machine, delays) for path in paths]
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


def _check(path: Path, machine: Path | None, delays: bool) -> 'Findings':
    from identnl_ros.sources.soundness import check_bag, check_layout, check_machine

    if path.suffix not in ('.yaml', '.yml'):
        return check_bag(path, machine, delays)
    try:
        text = path.read_text('utf-8', errors='replace')
    except OSError:
        text = ''
    if any(line.startswith('sensors:') for line in text.splitlines()):
        return check_layout(path, machine)
    return check_machine(path)


def _show(findings: 'list[Findings]') -> None:
    for one in findings:
        click.echo(f'{one.path}: {one.kind}, {"sound" if one.sound else "NOT sound"}')
        for problem in one.problems:
            click.echo(f'  problem: {problem}')
        for remark in one.remarks:
            click.echo(f'  remark: {remark}')
        for key, value in one.facts.items():
            click.echo(f'  {_title(key)}: {_short(value)}')


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

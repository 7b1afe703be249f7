# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl record`: the topics of a stand in a bag."""

from pathlib import Path

import click
from identnl_ros.cli.output import command as reporting, DONE, NEGATIVE, Outcome, say
from identnl_ros.cli.ros import require_ros
from identnl_ros.core.errors import DataError

STAND_TOPICS = ('samples', 'stand_description', 'estimates', 'discrepancy')
OWN_TOPICS = {'/diagnostics'}


@click.command('record')
@click.option(
    '--out',
    required=True,
    type=click.Path(path_type=Path),
    help='Bag to write: a file if it ends in .mcap, else a folder.',
)
@click.option('--namespace', default='/stand', show_default=True, help='Of the topics.')
@click.option(
    '--topic',
    'topics',
    multiple=True,
    help='Topic to record, relative to the namespace; may be repeated. Without it: samples, '
    'stand_description, estimates, discrepancy and /diagnostics.',
)
@reporting
def command(out: Path, namespace: str, topics: tuple[str, ...]) -> Outcome:
    """
    Record until interrupted (Ctrl-C); the bag is then complete.

    Exit code 1: nothing was published.
    """
    require_ros()
    from identnl_ros.nodes.recorder import Recorder
    from identnl_ros.nodes.running import run

    _check_is_new(out)
    namespace = '/' + namespace.strip('/')
    asked = set(topics)
    arguments = ['--ros-args', '-r', f'__ns:={namespace}', '-p', f'path:={out}']
    if topics:
        arguments += ['-p', f'topics:=[{",".join(topics)}]']
    recorders: list[Recorder] = []

    def make_nodes() -> list[Recorder]:
        recorders.append(Recorder())
        return recorders

    exit_code = run(make_nodes, arguments)
    messages = recorders[0].messages if recorders else {}
    document = {'bag': str(out), 'messages': messages}
    # The recorder itself publishes diagnostics.
    silent = not any(count for topic, count in messages.items() if topic not in OWN_TOPICS - asked)
    if silent and exit_code == 0:
        where = ', '.join(topics or [f'{namespace.rstrip("/")}/{topic}' for topic in STAND_TOPICS])
        say(f'nothing was published on {where}')
    return Outcome(
        document,
        lambda: click.echo(
            f'{out}: ' + ', '.join(f'{count} of {topic}' for topic, count in messages.items())
        ),
        DONE if exit_code == 0 and not silent else NEGATIVE,
    )


def _check_is_new(path: Path) -> None:
    """Complain here rather than in the node's log."""
    if path.exists():
        raise DataError(f'{path} exists and is never overwritten; choose another path')
    if not path.parent.is_dir():
        raise DataError(f'{path}: there is no folder {path.parent}; make it first')

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl record`: the topics of a stand in a bag."""

from pathlib import Path

import click
from identnl_ros.cli.output import command as reporting, DONE, NEGATIVE, Outcome
from identnl_ros.cli.ros import require_ros


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
    'stand_description, estimates and /diagnostics.',
)
@reporting
def command(out: Path, namespace: str, topics: tuple[str, ...]) -> Outcome:
    """Record until interrupted (Ctrl-C); the bag is then complete."""
    require_ros()
    from identnl_ros.nodes.recorder import Recorder
    from identnl_ros.nodes.running import run

    arguments = ['--ros-args', '-r', f'__ns:={"/" + namespace.strip("/")}', '-p', f'path:={out}']
    if topics:
        arguments += ['-p', f'topics:=[{",".join(topics)}]']
    recorders: list[Recorder] = []

    def make_nodes() -> list[Recorder]:
        recorders.append(Recorder())
        return recorders

    exit_code = run(make_nodes, arguments)
    messages = recorders[0].messages if recorders else {}
    document = {'bag': str(out), 'messages': messages}
    return Outcome(
        document,
        lambda: click.echo(
            f'{out}: ' + ', '.join(f'{count} of {topic}' for topic, count in messages.items())
        ),
        DONE if exit_code == 0 else NEGATIVE,
    )

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl replay`: the samples of a bag on ROS 2 topics."""

from pathlib import Path
from typing import Any

import click
from identnl_ros.cli.output import command as reporting, DONE, NEGATIVE, Outcome
from identnl_ros.cli.ros import require_ros


class _Speed(click.ParamType):  # type: ignore[type-arg]
    """A factor on real time, or max."""

    name = 'FACTOR|max'

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        try:
            speed = 0.0 if value == 'max' else float(value)
        except ValueError:
            self.fail(f'expected a factor or max, found "{value}"', param, ctx)
        if value != 'max' and not 0 < speed < float('inf'):
            self.fail(f'expected a positive factor or max, found "{value}"', param, ctx)
        return speed


@click.command('replay')
@click.argument('bag', type=click.Path(path_type=Path))
@click.option(
    '--speed',
    type=_Speed(),
    default='1',
    show_default=True,
    help='Times real time; max: as fast as the consumers keep up.',
)
@click.option('--namespace', default='/stand', show_default=True, help='Of the topics.')
@click.option(
    '--wait-for',
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help='Consumers that must be there before the first block.',
)
@reporting
def command(bag: Path, speed: float, namespace: str, wait_for: int) -> Outcome:
    """Publish the samples of BAG as they were recorded."""
    require_ros()
    from identnl_ros.nodes.running import run
    from identnl_ros.nodes.sensor_bridge import SensorBridge
    from identnl_ros.storage.bag_reader import open_bag

    open_bag(bag)  # complain here rather than in the node's log
    arguments = ['--ros-args', '-r', f'__ns:={"/" + namespace.strip("/")}']
    parameters = {
        'source': 'bag',
        'bag': bag,
        'speed': speed,
        'wait_for_consumers': wait_for,
        'exit_at_end': 'true',
    }
    for name, value in parameters.items():
        arguments += ['-p', f'{name}:={value}']
    bridges: list[SensorBridge] = []

    def make_nodes() -> list[SensorBridge]:
        bridges.append(SensorBridge())
        return bridges

    exit_code = run(make_nodes, arguments)
    published = bridges[0].published if bridges else None
    document = {
        'bag': str(bag),
        'blocks': published.blocks if published else 0,
        'next_sample_index': published.next_index if published else 0,
        'complete': bool(published and published.complete),
    }
    return Outcome(
        document,
        lambda: click.echo(f'{bag}: {document["blocks"]} blocks published'),
        DONE if exit_code == 0 and document['complete'] else NEGATIVE,
    )

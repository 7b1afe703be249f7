# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl import`: a recorded table as a bag."""

from pathlib import Path

import click
from identnl_ros.cli.output import command as reporting, Outcome, say


@click.command('import')
@click.argument('table', type=click.Path(path_type=Path))
@click.option(
    '--layout',
    required=True,
    type=click.Path(path_type=Path),
    help='Layout file that says which column is which sensor.',
)
@click.option(
    '--machine', type=click.Path(path_type=Path), help='Machine file to keep in the bag.'
)
@click.option(
    '--out',
    required=True,
    type=click.Path(path_type=Path),
    help='Bag to write: a file if it ends in .mcap, else a folder.',
)
@reporting
def command(table: Path, layout: Path, machine: Path | None, out: Path) -> Outcome:
    """Turn TABLE, a CSV file, into a bag."""
    from identnl_ros.cli.progress import progress
    from identnl_ros.storage.csv_import import import_csv
    from identnl_ros.storage.layout_file import load_layout
    from identnl_ros.storage.machine_file import load_machine

    layout_file = load_layout(layout)
    machine_text = load_machine(machine).text if machine else ''
    size = table.stat().st_size if table.is_file() else 0
    with progress(f'importing {table.name}', size) as advance:
        done = 0

        def report(read: int, _: int) -> None:
            nonlocal done
            advance(read - done)
            done = read

        imported = import_csv(
            table,
            layout_file.layout,
            out,
            layout_text=layout_file.text,
            machine_text=machine_text,
            progress=report,
        )
    silent = [one.name for one in layout_file.layout.sensors if one.noise != one.noise]
    if silent:
        say(f'note: the layout does not state the noise of {", ".join(silent)}')
    if imported.lost_samples:
        say(f'note: by the time column, {imported.lost_samples} samples are missing')
    document = {
        'bag': str(out),
        'samples': imported.samples,
        'lost_samples': imported.lost_samples,
        'channels': [sensor.name for sensor in layout_file.layout.sensors],
    }
    return Outcome(document, lambda: click.echo(f'{out}: {imported.samples} samples'))

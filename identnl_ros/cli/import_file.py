# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl import`: a recorded table as a bag."""

from pathlib import Path

import click
from identnl_ros.cli.formats import READABLE
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
@click.option(
    '--format',
    'format_name',
    type=click.Choice(READABLE),
    help='Of TABLE; without it, the end of its name tells.',
)
@click.option('--ignore-units', is_flag=True, help="Take the layout's units, whatever TABLE says.")
@reporting
def command(
    table: Path,
    layout: Path,
    machine: Path | None,
    out: Path,
    format_name: str | None,
    ignore_units: bool,
) -> Outcome:
    """Turn TABLE, a recorded file (CSV, UFF58, MATLAB, TDMS, HDF5, Parquet), into a bag."""
    from identnl_ros.cli.progress import progress_of
    from identnl_ros.storage.layout_file import load_layout
    from identnl_ros.storage.machine_file import load_machine
    from identnl_ros.storage.table_import import import_table

    layout_file = load_layout(layout)
    machine_text = load_machine(machine).text if machine else ''
    with progress_of(f'importing {table.name}') as report:
        imported = import_table(
            table,
            layout_file.layout,
            out,
            format_name=format_name,
            ignore_units=ignore_units,
            layout_text=layout_file.text,
            machine_text=machine_text,
            progress=report,
        )
    silent = [one.name for one in layout_file.layout.sensors if one.noise != one.noise]
    if silent:
        say(f'note: the layout does not state the noise of {", ".join(silent)}')
    for note in imported.notes:
        say(f'note: {note}')
    if imported.lost_samples:
        say(f'note: by the time column, {imported.lost_samples} samples are missing')
    document = {
        'bag': str(out),
        'samples': imported.samples,
        'lost_samples': imported.lost_samples,
        'notes': list(imported.notes),
        'channels': [sensor.name for sensor in layout_file.layout.sensors],
    }
    return Outcome(document, lambda: click.echo(f'{out}: {imported.samples} samples'))

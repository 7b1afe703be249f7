# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl export`: the samples of a bag as a table."""

from pathlib import Path

import click
from identnl_ros.cli.formats import WRITABLE
from identnl_ros.cli.output import command as reporting, Outcome, say


@click.command('export')
@click.argument('bag', type=click.Path(path_type=Path))
@click.option(
    '--out',
    required=True,
    type=click.Path(path_type=Path),
    help='Table to write: .csv, .uff or .parquet.',
)
@click.option(
    '--format',
    'format_name',
    type=click.Choice(WRITABLE),
    help='Of the table; without it, the end of its name tells.',
)
@click.option(
    '--stream',
    type=click.IntRange(min=1),
    help='Which stream, in the order of recording, where the bag holds several.',
)
@click.option(
    '--layout-out',
    type=click.Path(path_type=Path),
    help='Layout file to write, with which `identnl import` reads the table.',
)
@reporting
def command(
    bag: Path, out: Path, format_name: str | None, stream: int | None, layout_out: Path | None
) -> Outcome:
    """Write the samples of BAG, in SI units, as a table."""
    from identnl_ros.cli.progress import progress_of
    from identnl_ros.core.errors import DataError
    from identnl_ros.storage.bag_reader import open_bag
    from identnl_ros.storage.layout_writing import layout_text
    from identnl_ros.storage.replaced_file import require_folder, write_text
    from identnl_ros.storage.table_export import export_table

    if layout_out is not None:
        if layout_out.exists():
            raise DataError(
                f'{layout_out} exists and is never overwritten; choose another path or remove it'
            )
        require_folder(layout_out)
    opened = open_bag(bag)
    with progress_of(f'exporting {bag.name}') as report:
        exported = export_table(
            opened, out, format_name=format_name, stream_number=stream, progress=report
        )
    if layout_out is not None:
        write_text(layout_out, [layout_text(exported.layout, f'Of the table {out.name}')])
    for problem in opened.problems:
        say(f'note: {problem}')
    if exported.lost_samples:
        say(f'note: {exported.lost_samples} samples are missing in the bag')
    document = {
        'table': str(out),
        'samples': exported.samples,
        'lost_samples': exported.lost_samples,
        'sample_rate': exported.sample_rate,
        'channels': [sensor.name for sensor in exported.layout.sensors],
        'problems': opened.problems,
    }
    return Outcome(document, lambda: click.echo(f'{out}: {exported.samples} samples'))

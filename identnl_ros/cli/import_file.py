# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl import`: recorded tables of one run as a bag."""

from collections.abc import Sequence
from datetime import datetime, UTC
from pathlib import Path
from typing import Any, TYPE_CHECKING

import click
from identnl_ros.cli.formats import READABLE
from identnl_ros.cli.output import command as reporting, Outcome, say
from identnl_ros.core.errors import DataError
from identnl_ros.core.readable import readable

MOST_NAMES_SHOWN = 20

if TYPE_CHECKING:
    from identnl_ros.core.measurement.layout import Layout
    from identnl_ros.storage.several_tables import ImportedTables


@click.command('import')
@click.argument(
    'tables', nargs=-1, required=True, type=click.Path(path_type=Path), metavar='TABLE...'
)
@click.option(
    '--layout',
    required=True,
    type=click.Path(path_type=Path),
    help='Layout file that says which column is which sensor.',
)
@click.option(
    '--machine',
    type=click.Path(path_type=Path),
    help='Machine file to keep in the bag; by it, the motion aligns several TABLES.',
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
@click.option(
    '--start',
    'starts',
    multiple=True,
    metavar='FILE=TIME',
    help='When the recording FILE began, 2026-03-01T12:00:00.25 (UTC, or with +01:00).',
)
@click.option(
    '--same-start', is_flag=True, help='The times in all TABLES count from the same instant.'
)
@click.option(
    '--start-deviation',
    type=float,
    help='Standard deviation of the begins, several TABLES [s]; default 0.005.',
)
@click.option(
    '--ignore-column',
    'ignored',
    multiple=True,
    metavar='NAME',
    help='A column that is no time, whatever it looks like; may be given several times.',
)
@reporting
def command(
    tables: tuple[Path, ...],
    layout: Path,
    machine: Path | None,
    out: Path,
    format_name: str | None,
    ignore_units: bool,
    starts: tuple[str, ...],
    same_start: bool,
    start_deviation: float | None,
    ignored: tuple[str, ...],
) -> Outcome:
    """
    Turn recorded TABLES (CSV, UFF58, MATLAB, TDMS, HDF5, Parquet) into a bag.

    Several TABLES are of one run, recorded by devices with clocks of their own: they are brought
    on the grid of the first.
    """
    from identnl_ros.cli.progress import progress_of
    from identnl_ros.storage.layout_file import load_layout
    from identnl_ros.storage.machine_file import load_machine
    from identnl_ros.storage.table_import import import_table

    layout_file = load_layout(layout)
    machine_file = load_machine(machine) if machine else None
    machine_text = machine_file.text if machine_file else ''
    if len(tables) > 1:
        from identnl_ros.core.mechanics.assembly import assemble
        from identnl_ros.storage.several_tables import import_tables, START_DEVIATION

        with progress_of(f'importing {len(tables)} files') as report:
            aligned = import_tables(
                tables,
                layout_file.layout,
                out,
                model=assemble(machine_file.machine) if machine_file else None,
                starts=_times(starts),
                same_start=same_start,
                start_deviation=START_DEVIATION if start_deviation is None else start_deviation,
                format_name=format_name,
                ignore_units=ignore_units,
                layout_text=layout_file.text,
                machine_text=machine_text,
                progress=report,
                ignored=ignored,
            )
        return _told(tables, layout_file.layout, out, machine is not None, aligned)
    if starts or same_start or start_deviation is not None:
        raise DataError(
            '--start, --same-start and --start-deviation align several files; leave them out, or '
            'give more than one'
        )
    (table,) = tables
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
            ignored=ignored,
        )
    _say_noise(layout_file.layout)
    for note in imported.notes:
        say(f'note: {note}')
    if imported.lost_samples:
        say(f'note: by the time column, {imported.lost_samples} samples are missing')
    document = {
        'bag': str(out),
        'samples': imported.samples,
        'lost_samples': imported.lost_samples,
        'notes': list(imported.notes),
        'time_columns': list(imported.time_columns),
        'unused_columns': list(imported.unused_columns),
        'channels': [sensor.name for sensor in layout_file.layout.sensors],
    }

    def show() -> None:
        click.echo(f'{out}: {imported.samples} samples')
        _show_columns('', imported.time_columns, imported.unused_columns)
        _show_next(out, machine is not None)

    return Outcome(document, show)


def _show_columns(table: str, times: Sequence[str], unused: Sequence[str]) -> None:
    """Say by which columns the time was checked, and what nobody reads."""
    if times:
        click.echo(f'{table}time checked by: {_listed(times)}')
    if unused:
        click.echo(f'{table}columns that no sensor reads: {_listed(unused)}')


def _listed(names: Sequence[str]) -> str:
    more = len(names) - MOST_NAMES_SHOWN
    return ', '.join(names[:MOST_NAMES_SHOWN]) + (f' and {more} more' if more > 0 else '')


def _show_next(out: Path, has_machine: bool) -> None:
    if not has_machine:
        click.echo(f'no machine file is in it: identnl identify {out} needs --machine FILE')


def _say_noise(layout: 'Layout') -> None:
    silent = [one.name for one in layout.sensors if one.noise != one.noise]
    if silent:
        say(f'note: the layout does not state the noise of {", ".join(silent)}')


def _times(starts: Sequence[str]) -> dict[str, int]:
    """Read FILE=TIME; whole seconds and fraction apart, for the nanoseconds."""
    result = {}
    for text in starts:
        name, equals, time = text.rpartition('=')
        try:
            if not equals:
                raise ValueError
            head, _, fraction = time.partition('.')
            digits = len(fraction) - len(fraction.lstrip('0123456789'))
            moment = datetime.fromisoformat(head + fraction[digits:])
        except ValueError:
            raise DataError(
                f'--start {text}: expected FILE=TIME, e.g. probes.csv=2026-03-01T12:00:00.25'
            ) from None
        if moment.tzinfo is None:
            moment = moment.replace(tzinfo=UTC)
        nanoseconds = int(f'{fraction[:digits][:9]:0<9}')
        result[name] = round(moment.timestamp()) * 1_000_000_000 + nanoseconds
    return result


def _told(
    tables: Sequence[Path],
    layout: 'Layout',
    out: Path,
    has_machine: bool,
    imported: 'ImportedTables',
) -> Outcome:
    """Make the outcome of several files."""
    _say_noise(layout)
    for note in (*imported.notes, *imported.warnings):
        say(f'note: {note}')
    sources: list[dict[str, Any]] = [
        {
            'table': str(path),
            'name': one.name,
            'sample_rate': rate,
            'aligned': one.aligned
            and (one.by_motion or one.deviation <= 0.5 / imported.sample_rate),
            'offset': one.offset,
            'skew': one.skew,
            'remaining': one.deviation,
            'time_columns': list(times),
            'unused_columns': list(unused),
        }
        for path, one, rate, times, unused in zip(
            tables,
            imported.sources,
            imported.rates,
            imported.time_columns,
            imported.unused_columns,
            strict=True,
        )
    ]
    document = {
        'bag': str(out),
        'samples': imported.samples,
        'lost_samples': imported.lost_samples,
        'sample_rate': imported.sample_rate,
        'sources': sources,
        'warnings': list(imported.warnings),
        'notes': list(imported.notes),
        'channels': [sensor.name for sensor in layout.sensors],
    }

    def show() -> None:
        click.echo(f'{out}: {imported.samples} samples at {imported.sample_rate:g} Hz')
        for one in sources[1:]:
            click.echo(
                f'{one["name"]}: late by {one["offset"] * 1e3:.6g} ms, clock slow by '
                f'{one["skew"] * 1e6:.4g} ppm, a delay with a standard deviation of '
                f'{readable(one["remaining"], "s")} remains'
            )
        for one in sources:
            _show_columns(f'{one["name"]}: ', one['time_columns'], one['unused_columns'])
        _show_next(out, has_machine)

    return Outcome(document, show)

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl calibrate`: find what the sensors of a layout file are, from records."""

from pathlib import Path
from typing import TYPE_CHECKING

import click
from identnl_ros.cli.known_inputs import amplitude, mass, reference_uncertainty
from identnl_ros.cli.output import command as reporting, DONE, NEGATIVE, Outcome, say
from identnl_ros.core.errors import DataError

if TYPE_CHECKING:
    from identnl_ros.sources.bag_calibration import BagCalibration

PATH = click.Path(path_type=Path)


@click.command('calibrate')
@click.argument('layout', type=PATH)
@click.option('--machine', type=PATH, help='Machine file; without it, the one of the bags.')
@click.option('--quiet', type=PATH, help='Bag of the machine at rest: noise, steps, offsets.')
@click.option(
    '--motion',
    multiple=True,
    type=PATH,
    help='Bag of the machine in motion, several times: gains, directions, delays.',
)
@click.option(
    '--reference',
    'references',
    multiple=True,
    metavar='NAME',
    help='Sensor that is right, several times: a name, a pattern such as "knee_a*", or a kind.',
)
@click.option(
    '--reference-uncertainty',
    'uncertainties',
    multiple=True,
    metavar='NAME=UNCERTAINTY',
    help='How well the gain of a reference, or of an accelerometer on a known mass, is known, '
    'several times, e.g. "probe=0.5 %"; "displacement=0.5 % of laser": all share one error.',
)
@click.option(
    '--estimate',
    'properties',
    multiple=True,
    type=click.Choice(['gain', 'direction', 'delay']),
    help='What to find from the motion, several times; without it, all three.',
)
@click.option(
    '--known',
    multiple=True,
    nargs=2,
    type=(PATH, str),
    metavar='BAG SENSOR=AMPLITUDE',
    help='Sensor on a calibrator of known amplitude (rms), several times, e.g. '
    'ring.mcap "ring=10 m/s^2 +- 1% @ 159.155 Hz"; "+- 1% of NAME" is shared by all of that NAME.',
)
@click.option(
    '--known-mass',
    'masses',
    multiple=True,
    nargs=2,
    type=(PATH, str),
    metavar='BAG CELL=MASS:ACCELEROMETER',
    help='Force cell that shakes a freely hung mass, several times, e.g. '
    'mass.mcap "cell=5 kg +- 0.1%: ring"; different masses, also 0 kg, tell the front mass too.',
)
@click.option('--out', type=PATH, help='Layout file to write.')
@click.option('--overwrite', is_flag=True, help='OUT may exist, and may be LAYOUT itself.')
@click.option('--force', is_flag=True, help='Write though the sensors do not agree.')
@reporting
def command(
    layout: Path,
    machine: Path | None,
    quiet: Path | None,
    motion: tuple[Path, ...],
    references: tuple[str, ...],
    uncertainties: tuple[str, ...],
    properties: tuple[str, ...],
    known: tuple[tuple[Path, str], ...],
    masses: tuple[tuple[Path, str], ...],
    out: Path | None,
    overwrite: bool,
    force: bool,
) -> Outcome:
    """
    Find noise, offsets, gains, directions, delays and front masses of the sensors of LAYOUT.

    The bags must have been recorded with LAYOUT. OUT is LAYOUT with the numbers that were found;
    comments, order and units stay. Exit code 1: the sensors do not agree with one another even so,
    and nothing is written.
    """
    from identnl_ros.core.calibration.findings import Property
    from identnl_ros.core.calibration.motion_calibration import ALL
    from identnl_ros.reports.calibration_document import calibration_document
    from identnl_ros.sources.bag_calibration import calibrate_bags, CalibrationBags
    from identnl_ros.storage.layout_file import load_layout

    if quiet is None and not (motion or known or masses):
        raise DataError(
            'nothing to calibrate from; give --quiet, --motion, --known or --known-mass'
        )
    if out is not None and out.exists() and not overwrite:
        raise DataError(f'{out} exists; choose another name, or add --overwrite')
    if (references or properties) and not motion:
        raise DataError('--reference and --estimate go with --motion')
    described = load_layout(layout).layout
    result = calibrate_bags(
        layout,
        machine,
        CalibrationBags(
            quiet,
            motion,
            references,
            [(path, amplitude(text, described)) for path, text in known],
            [(path, mass(text)) for path, text in masses],
            frozenset(map(Property, properties)) or ALL,
            [reference_uncertainty(text) for text in uncertainties],
        ),
    )
    for problem in result.problems:
        say(f'warning: {problem}')
    agrees = not result.findings.doubts
    kept = _write(out, result) if out is not None and (agrees or force) else None
    document = {
        'layout': str(layout),
        'references': list(result.references),
        **calibration_document(result.file.layout, result.findings, result.channels),
        'written': None if kept is None else str(out),
        'comments_kept': kept,
        'problems': list(result.problems),
    }
    return Outcome(document, lambda: _show(result, document), DONE if agrees else NEGATIVE)


def _write(out: Path, result: 'BagCalibration') -> bool:
    """Write the layout file; tell whether the comments are still there."""
    from identnl_ros.storage.layout_editing import edited_layout
    from identnl_ros.storage.replaced_file import write_text

    edited = edited_layout(result.file.text, str(result.file.path), result.findings.calibrated)
    write_text(out, [edited.text])
    if edited.whole:
        say(
            f'warning: {out} is written anew, in SI: comments, defaults, units and triaxial '
            f'entries of {result.file.path} are gone'
        )
    return not edited.whole


def _show(result: 'BagCalibration', document: dict[str, object]) -> None:
    from identnl_ros.reports.calibration_tables import show_calibration
    from rich.console import Console

    show_calibration(result.file.layout, result.findings, result.channels, Console())
    if document['written']:
        click.echo(f'Written: {document["written"]}')

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The source that the parameters of the sensor bridge ask for."""

from collections.abc import Callable
from pathlib import Path
import secrets
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.nodes.parameters import Setting
from identnl_ros.sources.recorded import BagSource
from identnl_ros.sources.simulated import Excitation, SimulatedSource, TestRun
from identnl_ros.sources.source import Source
from identnl_ros.sources.stand_layout import stand_layout
from identnl_ros.storage.machine_file import load_machine

EXCITATIONS = tuple(
    excitation.value for excitation in Excitation if excitation is not Excitation.RECORDED
)

SETTINGS = (
    Setting(
        'source',
        'simulated',
        'Where the samples come from: a simulated stand or a recorded bag.',
        choices=('simulated', 'bag'),
    ),
    Setting('machine_file', '', 'Machine file (YAML) of the simulated stand.'),
    Setting(
        'layout_file',
        '',
        'Sensor layout file (YAML); empty: the one beside the machine file.',
    ),
    Setting(
        'excitation',
        'multisine',
        'Form of the force of the simulated exciters.',
        choices=EXCITATIONS,
    ),
    Setting(
        'amplitude',
        0.0,
        'Amplitude of the simulated exciters [N]; 0: that of the machine file.',
        0.0,
        1e9,
    ),
    Setting(
        'frequency',
        0.0,
        'Frequency of a simulated sine [Hz]; 0: that of the machine file.',
        0.0,
        1e6,
    ),
    Setting(
        'sample_rate',
        0.0,
        'Sample rate of the simulated stand [Hz]; 0: that of the layout file, or 10 kHz.',
        0.0,
        1e7,
    ),
    Setting('duration', 10.0, 'Length of the simulated run [s].', 1e-6, 1e9),
    Setting(
        'noise',
        1.0,
        'Factor on the sensor noise that the layout states [-]; 0: perfect sensors.',
        0.0,
        1e6,
    ),
    Setting('seed', 0, 'Seed of all that is random in the simulated stand.', 0, 2**62),
    Setting(
        'stream_from_seed',
        False,
        'Derive the stream identifier from the seed instead of drawing a new one, so that a seed '
        'gives the same messages again.',
    ),
    Setting('bag', '', 'Bag to replay: an MCAP or SQLite file, or a folder with metadata.yaml.'),
)


def make_source(setting: Callable[[str], Any]) -> Source:
    """
    Make the source.

    Parameters
    ----------
    setting : callable
        Gives the value of a parameter by its name.

    Returns
    -------
    Source
        A simulated one begins at the time 0 of its own clock.

    Raises
    ------
    IdentnlError
        If a file or a number is unsound.

    """
    if setting('source') == 'bag':
        if not setting('bag'):
            raise DataError('parameter bag is empty; give the path of the bag to replay')
        return BagSource(Path(setting('bag')))
    if not setting('machine_file'):
        raise DataError(
            'parameter machine_file is empty; give the machine file of the stand to simulate'
        )
    machine = load_machine(setting('machine_file'))
    path = setting('layout_file')
    sensors = stand_layout(machine, Path(path) if path else None)
    run = TestRun(
        excitation=Excitation(setting('excitation')),
        duration=setting('duration'),
        sample_rate=sensors.sample_rate(setting('sample_rate') or None),
        noise=setting('noise'),
        seed=setting('seed'),
        amplitude=setting('amplitude') or None,
        frequency=setting('frequency') or None,
    )
    return SimulatedSource(
        machine.machine,
        sensors.layout,
        run,
        machine.text,
        sensors.text,
        stream_id=None if setting('stream_from_seed') else secrets.randbits(64),
    )

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated stand as a source that the user can ask for."""

from collections.abc import Callable
from pathlib import Path
import secrets
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.sources.setting import Setting
from identnl_ros.sources.simulated import Excitation, SimulatedSource, TestRun
from identnl_ros.sources.stand_layout import stand_layout
from identnl_ros.storage.machine_file import load_machine

EXCITATIONS = tuple(
    excitation.value for excitation in Excitation if excitation is not Excitation.RECORDED
)


class SimulatedStandChoice:
    """Makes a simulated stand as its settings ask for."""

    settings = (
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
            'Derive the stream identifier from the seed instead of drawing a new one, so that a '
            'seed gives the same messages again.',
        ),
    )

    def make(self, setting: Callable[[str], Any]) -> SimulatedSource:
        """
        Make the source.

        Parameters
        ----------
        setting : callable
            Gives the value of a setting by its name.

        Returns
        -------
        SimulatedSource
            It begins at the time 0 of its own clock.

        Raises
        ------
        IdentnlError
            If a file or a number is unsound.

        """
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


source = SimulatedStandChoice()

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What the diagnostics say about a device."""

from identnl_ros.nodes.diagnosis import Health, Level
from identnl_ros.sources.device_state import DeviceState

# A clock that is off by more was set up wrongly, or its rate is not what the device says. Stamps
# of a host are good for less than that after a second.
LARGEST_DEVIATION = 0.01


def device_health(state: DeviceState) -> Health:
    """
    Put the state of a device into words.

    Parameters
    ----------
    state : DeviceState

    Returns
    -------
    Health

    """
    health = Health(
        f'device {state.name}',
        {
            'device': state.name,
            'state': state.problem or 'delivers samples',
            'samples': state.samples,
            'samples lost': state.lost_samples,
            'reconnects': state.reconnects,
            'nominal rate [Hz]': state.sample_rate,
            'measured rate [Hz]': state.measured_rate,
        },
    )
    if state.problem:
        health.add(Level.ERROR, f'away: {state.problem}')
    health.warn_of(state.lost_samples, 'samples lost')
    if abs(state.measured_rate / state.sample_rate - 1) > LARGEST_DEVIATION:
        health.add(
            Level.WARN,
            f'samples at {state.measured_rate:.6g} Hz by their stamps, says '
            f'{state.sample_rate:.6g} Hz',
        )
    return health

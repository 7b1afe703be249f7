# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What a data acquisition device offers to the sensor bridge."""

from dataclasses import dataclass, field
from typing import Protocol

from identnl_ros.core.errors import DataError
import numpy as np
from numpy.typing import NDArray


class DeviceLost(DataError):
    """The device does not answer any more; it may come back."""


@dataclass(frozen=True)
class DeviceChannel:
    """
    One channel of a device.

    Parameters
    ----------
    name : str
        By which the layout's key ``column`` names it; unique in the device.
    unit : str
        Of the numbers that the device delivers, e.g. ``V``; empty: the device does not say.

    """

    name: str
    unit: str = ''


@dataclass(frozen=True)
class DeviceBlock:
    """
    Consecutive samples of all channels of a device, taken with its own clock.

    Parameters
    ----------
    first_index : int
        Running number of the first sample on the device's clock; a jump: samples are lost.
    stamp_ns : int
        Host time of the first sample, as well as the device or the host can tell [ns].
    samples : ndarray, shape (n_samples, n_channels)
        In the units of the channels; NaN where there is no valid sample.

    """

    first_index: int
    stamp_ns: int
    samples: NDArray[np.float64] = field(repr=False)


class Device(Protocol):
    """
    A device with one sample clock.

    A device is opened, read until it is closed or lost, and may be opened again after that. It
    is closed before it is opened again, also where `open` or `read` have raised: what they have
    begun need only be let go in `close`.

    """

    @property
    def name(self) -> str:
        """By which the user knows it, e.g. its address."""
        ...

    @property
    def sample_rate(self) -> float:
        """Nominal rate of its clock [Hz]; known once it is open."""
        ...

    def open(self) -> tuple[DeviceChannel, ...]:
        """
        Connect and begin to sample.

        Raises
        ------
        DeviceLost
            If it cannot be reached at present.
        DataError
            If it can never be used as configured.

        """
        ...

    def read(self, timeout: float) -> DeviceBlock | None:
        """
        Give the samples that have come since the last call.

        Returns None if none has come within the timeout [s].

        Raises
        ------
        DeviceLost
            If it does not answer any more.

        """
        ...

    def close(self) -> None:
        """Let go of it; never raises, also where it is lost or was never open."""
        ...

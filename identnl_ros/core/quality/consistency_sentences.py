# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Faults that show in the motion of rigid bodies, in words."""

from collections.abc import Mapping, Sequence

from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.quality.condition import Condition
import numpy as np

# Errors of a direction that one does not see when mounting a sensor [rad].
LARGEST_TURN = float(np.radians(5.0))
# Names in a list, before the rest is counted.
MOST_NAMES = 3


class Sentences:
    """
    What is seen and what to do.

    Parameters
    ----------
    layout : Layout

    """

    def __init__(self, layout: Layout) -> None:
        self._sensors = layout.sensors

    def factor(
        self,
        channel: int,
        condition: Condition,
        factor: float,
        deviation: float,
        rivals: Sequence[int],
        turned: float,
        both: Sequence[int] = (),
    ) -> str:
        """
        Describe a wrong sign or gain.

        Parameters
        ----------
        channel : int
        condition : Condition
            INVERTED or GAIN.
        factor, deviation : float
            Reading over what the others say, its standard deviation.
        rivals : sequence of int
            Channels that could be the wrong one as well.
        turned : float
            Error of the sensor's direction that has the same effect [rad].
        both : sequence of int
            Two channels that, both wrong, would explain the readings as well.

        Returns
        -------
        str

        """
        who = self._suspects(channel, rivals)
        if both:
            who = f'{who} (or {" and ".join(self._sensors[one].name for one in both)}, both)'
        seen = (
            f'{who}: reads {factor:.2f} +- '
            f'{max(deviation, 0.005):.2f} times what {self._others(channel, rivals)} say'
        )
        if condition is Condition.INVERTED:
            return (
                f'{seen}: polarity is inverted; change its direction in the layout or turn its '
                'cable'
            )
        if turned < LARGEST_TURN:
            return (
                f'{seen}: the gain is wrong, or the direction by {np.degrees(turned):.0f} '
                'degrees; check gain, unit, range and direction in the layout'
            )
        return f'{seen}: the gain is wrong; check gain, unit and range in the layout'

    def swapped(self, channel: int, other: int, both_inverted: bool) -> str:
        """
        Describe an exchange of two channels.

        Parameters
        ----------
        channel, other : int
        both_inverted : bool
            Two wrong signs would explain the readings as well.

        Returns
        -------
        str

        """
        name = self._sensors[other].name
        own = self._sensors[channel].name
        if both_inverted:
            return (
                f'{own}: exchanged with {name}, or {own} and {name} both have the wrong polarity: '
                'the readings fit both; compare the cables with the layout, or repeat with motion '
                'of more frequencies or directions'
            )
        return (
            f'{own}: has the readings of {name}, and {name} has its: the two are exchanged; '
            'exchange the cables, or the columns in the layout'
        )

    def hum(self, channel: int, lines: Mapping[float, float], rivals: Sequence[int]) -> str:
        """
        Describe hum.

        Parameters
        ----------
        channel : int
        lines : mapping of float to float
            Frequencies [Hz] and amplitudes [SI].
        rivals : sequence of int

        Returns
        -------
        str

        """
        unit = self._sensors[channel].kind.unit
        listed = ', '.join(
            f'{amplitude:.2g} {unit} at {frequency:g} Hz'
            for frequency, amplitude in sorted(lines.items())
        )
        return (
            f'{self._suspects(channel, rivals)}: has {listed} that '
            f'{self._others(channel, rivals)} do not see: hum of the mains; check shield, '
            'grounding and supply'
        )

    def drift(self, channel: int, size: float, duration: float, rivals: Sequence[int]) -> str:
        """
        Describe a wandering zero point.

        Parameters
        ----------
        channel : int
        size : float
            [SI].
        duration : float
            [s].
        rivals : sequence of int

        Returns
        -------
        str

        """
        return (
            f'{self._suspects(channel, rivals)}: zero point moved by {size:.2g} '
            f'{self._sensors[channel].kind.unit} within {duration:.0f} s, which '
            f'{self._others(channel, rivals)} do not see; let it warm up, check its mounting and '
            'its amplifier'
        )

    def _suspects(self, channel: int, rivals: Sequence[int]) -> str:
        name = self._sensors[channel].name
        return f'{name} (or {self._list(rivals)})' if rivals else name

    def _list(self, channels: Sequence[int]) -> str:
        names = [self._sensors[one].name for one in channels]
        if len(names) > MOST_NAMES:
            more = len(names) - MOST_NAMES + 1
            names = [*names[: MOST_NAMES - 1], f'one of {more} others']
        return ' or '.join(names)

    def _others(self, channel: int, rivals: Sequence[int]) -> str:
        sensor = self._sensors[channel]
        place = f'excitation {sensor.excitation}' if sensor.kind is SensorKind.FORCE else (
            f'{sensor.body} and {sensor.reference_body}' if sensor.reference_body else sensor.body
        )  # fmt: skip
        return f'the other sensors of {place}'

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What faults of sensors would do to the readings: each concerns very few sensors."""

from collections.abc import Sequence

from identnl_ros.core.discrepancy.comparison import averages
from identnl_ros.core.discrepancy.effect import Hypothesis, SensorFault
from identnl_ros.core.discrepancy.evidence import Evidence
from identnl_ros.core.discrepancy.force_noise import Lines, spectral_lines
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


class SensorColumns:
    """
    Columns of a regression, one per hypothesis about sensors, kept by sensor.

    Parameters
    ----------
    evidence : Evidence
    hypotheses : sequence of Hypothesis
        Of faults of sensors.

    """

    def __init__(self, evidence: Evidence, hypotheses: Sequence[Hypothesis]) -> None:
        self._evidence = evidence
        self.count = len(hypotheses)
        comparison = evidence.comparison
        place = {sensor.name: i for i, sensor in enumerate(comparison.sensors)}
        signals = comparison.signals() if hypotheses else None
        owners: dict[int, list[int]] = {}
        series: dict[int, list[Reals]] = {}
        for i, one in enumerate(hypotheses):
            assert isinstance(one.effect, SensorFault)
            assert signals is not None
            for name, deviation in one.effect.deviation(signals, one.place).items():
                sensor = place[name]
                white = deviation[: comparison.count] / comparison.deviation[sensor]
                owners.setdefault(sensor, []).append(i)
                series.setdefault(sensor, []).append(averages(white, comparison.average))
        self._owners = owners
        self._lines = {sensor: spectral_lines(np.array(own)) for sensor, own in series.items()}

    def products(self, rows: Lines) -> Reals:
        """
        Multiply with vectors of weighted rows.

        Parameters
        ----------
        rows : ndarray, shape (n_vectors, n_channels, n_lines)
            Complex, of all channels or of those in which motion shows.

        Returns
        -------
        ndarray, shape (n_hypotheses, n_vectors)

        """
        weighted = rows.astype(np.complex128)
        motion = self._evidence.channels.count
        weighted[:, :motion] = self._evidence.whitened(weighted[:, :motion].copy())
        turn = self._evidence.channels.turn[:, : rows.shape[1]]
        result = np.zeros((self.count, len(rows)))
        for sensor, owners in self._owners.items():
            of_sensor = np.tensordot(weighted, turn[sensor], axes=(1, 0))
            np.add.at(result, owners, (self._lines[sensor].conj() @ of_sensor.T).real)
        return result

    def gram(self) -> Reals:
        """
        Multiply the columns with one another.

        Returns
        -------
        ndarray, shape (n_hypotheses, n_hypotheses)

        """
        result = np.zeros((self.count, self.count))
        weights = self._evidence.weights
        turn = self._evidence.channels.turn
        along = None
        if weights is not None:
            shape = self.count, *weights.shrink.shape
            along = np.zeros(shape, np.complex128)
        for sensor, owners in self._owners.items():
            lines = self._lines[sensor]
            result[np.ix_(owners, owners)] += (lines.conj() @ lines.T).real
            if weights is not None and along is not None:
                own = np.tensordot(
                    turn[sensor, : len(weights.directions)], weights.directions, axes=(0, 0)
                )
                np.add.at(along, owners, own.conj() * lines[:, :, np.newaxis])
        if weights is not None and along is not None:
            # Weights squared: one less directions (2 shrink - shrink^2) directions^H.
            share = np.sqrt(2 * weights.shrink - weights.shrink**2)
            flat = (along * share).reshape(self.count, share.size)
            result -= (flat.conj() @ flat.T).real
        return result

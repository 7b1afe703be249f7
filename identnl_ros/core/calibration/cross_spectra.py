# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Cross-spectra of all motion sensors, summed over segments and records."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.synchronisation.advanced import advanced
from identnl_ros.core.synchronisation.segment_spectra import segment_spectra, SegmentSpectra
import numpy as np
from numpy.typing import NDArray


@dataclass
class CrossSpectra:
    """
    Sums of products of acceleration spectra; the likelihood of rigid motion needs no more.

    Parameters
    ----------
    channels : ndarray of int, shape (n_used,)
        Of the layout.
    frequencies : ndarray, shape (n_bins,)
        Angular, of all bins [rad/s].
    variance : ndarray, shape (n_bins, n_used)
        Of one segment's spectra under the noise.
    sums : ndarray of complex, shape (n_bins, n_used, n_used)
        Of spectrum times conjugate spectrum.
    counts : ndarray, shape (n_bins,)
        Segments in the sums; 0 where no motion stands out of the noise.
    weight : float
        Sum over the samples of the squared windows that reach a sample.
    square_weight : float
        Sum of its square.

    """

    channels: NDArray[np.int64]
    frequencies: NDArray[np.float64]
    variance: NDArray[np.float64]
    sums: NDArray[np.complex128]
    counts: NDArray[np.float64]
    weight: float
    square_weight: float

    def bins(self, chosen: slice | NDArray[np.bool_]) -> 'CrossSpectra':
        """
        Copy with some bins alone.

        Parameters
        ----------
        chosen : slice or ndarray of bool

        Returns
        -------
        CrossSpectra

        """
        return replace(
            self,
            frequencies=self.frequencies[chosen],
            variance=self.variance[chosen],
            sums=self.sums[chosen],
            counts=self.counts[chosen],
        )

    def moving(self) -> 'CrossSpectra':
        """Copy with the bins alone in which there is motion."""
        return self.bins(np.asarray(self.counts > 0))

    @property
    def overlap(self) -> float:
        """Variance of the score over the information: segments overlap, so it exceeds 1/2."""
        return self.square_weight / self.weight


def cross_spectra(
    model: Model, records: Iterable[MeasuredRecord], delays: NDArray[np.float64]
) -> list[CrossSpectra]:
    """
    Transform records and sum up.

    Parameters
    ----------
    model : Model
    records : iterable of MeasuredRecord
        Of one layout.
    delays : ndarray, shape (n_sensors,)
        To be taken out beyond those that the layout states [s].

    Returns
    -------
    list of CrossSpectra
        One for each length of segments and set of valid channels.

    Raises
    ------
    DataError
        If no record is long enough.

    """
    found: dict[tuple[int, float, bytes], CrossSpectra] = {}
    problem = 'there is no record'
    for record in records:
        stated = np.array([sensor.delay for sensor in record.layout.sensors])
        sensors = tuple(replace(sensor, delay=0.0) for sensor in record.layout.sensors)
        prompt = replace(record, layout=replace(record.layout, sensors=sensors))
        try:
            spectra = segment_spectra(model, advanced(prompt, stated + delays))
        except DataError as error:
            problem = str(error)
            continue
        key = spectra.length, record.sample_rate, spectra.channels.tobytes()
        if key not in found:
            found[key] = _empty(spectra, record.sample_rate)
        _add(found[key], spectra)
    if not found:
        raise DataError(problem)
    return list(found.values())


def _empty(spectra: SegmentSpectra, rate: float) -> CrossSpectra:
    bins, used = (spectra.length + 1) // 2, len(spectra.channels)
    return CrossSpectra(
        spectra.channels,
        np.arange(bins, dtype=np.float64) * (2 * np.pi * rate / spectra.length),
        np.ones((bins, used)),
        np.zeros((bins, used, used), dtype=np.complex128),
        np.zeros(bins),
        0.0,
        0.0,
    )


def _add(total: CrossSpectra, spectra: SegmentSpectra) -> None:
    values = np.moveaxis(spectra.spectra, 0, 2)
    total.sums[spectra.bins] += values @ np.conj(np.swapaxes(values, 1, 2))
    total.counts[spectra.bins] += len(spectra.begins)
    total.variance[spectra.bins] = spectra.variance
    power = spectra.windows[0] ** 2
    # A complex amplitude of a bin has the information of half a segment's samples.
    power *= spectra.length / 2 / power.sum()
    reach = np.zeros(int(spectra.begins[-1]) + spectra.length)
    for begin in spectra.begins:
        reach[begin : begin + spectra.length] += power
    total.weight += float(reach.sum())
    total.square_weight += float((reach**2).sum())

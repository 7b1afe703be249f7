# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Test whether measured motion obeys the equations of motion, and sensors each other, but for noise.

Noise is independent from instant to instant. So the residual of the equations at one instant has
no correlation with the force and motion well before and after it, whatever the size of the noise;
and neither has the difference between a measured rate and that of the displacement. A gain, a
delay or a mass that is wrong leaves one. There are more such moments than unknowns, and those
left over must vanish but for chance: the test of overidentifying restrictions (Sargan 1958,
Econometrica 26, 393-415; Hansen 1982, Econometrica 50, 1029-1054), with the scatter taken from
groups of instants and therefore as Hotelling's T squared.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.estimation.judged_estimate import FALSE_ALARM_RATE
from identnl_ros.core.estimation.regression import PointwiseRegression
from identnl_ros.core.measurement.alignment import convolve
from identnl_ros.core.measurement.blocks import MotionBlock
from identnl_ros.core.measurement.stencils import stencil
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

Reals = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Instants whose products are one draw, and those factored at once.
GROUP = 128
BATCH = 16 * GROUP
# Fewer draws per moment than this say too little about their scatter.
GROUPS_PER_MOMENT = 4
# Half widths of smoothing [samples] and of the differences of displacement behind it.
SMOOTHING = 8
DIFFERENCES = 4
# Interpolation and derivatives by 17 samples each, and smoothing on both sides: at this distance
# [samples] no reading counts twice.
LAG = 16 + 2 * SMOOTHING + DIFFERENCES + 1
CONTEXT = LAG + SMOOTHING
# Contradictions below this part of the forces and of the motion are the arithmetic's.
TOLERANCE = 1e-4
# Moments whose scatter is this much smaller than that of others are combinations of them.
RANK_TOLERANCE = 1e-10
# Beside those of the unknowns: of the whole force, inertia and joint force, and of the force
# without a lag.
_OF_FORCES = 8
_OF_RATES = 4


@dataclass(frozen=True)
class Moments:
    """
    Sums over groups of instants of ``Z^T [Phi, Y]``, Z the instruments.

    Parameters
    ----------
    sums : ndarray, shape (n_moments, n_unknowns + 1)
    products : ndarray, shape (n_moments (n_unknowns + 1), n_moments (n_unknowns + 1))
        Of two groups' moments: what scatter they have at any values of the unknowns.
    sizes : ndarray, shape (n_moments, 3)
        Sums of squares of the instrument and of what it is multiplied with; what the noise that
        both may share can add to the moment.
    scale : ndarray, shape (3, n_coordinates)
        Size of the residual of the equations of motion, of velocity and of acceleration, fixed by
        the first instants; 0: nothing to be tested.
    reference : ndarray, shape (n_unknowns,)
        Estimate from the first instants.
    groups : int

    """

    sums: Reals
    products: Reals
    sizes: Reals
    scale: Reals
    reference: Reals
    groups: int = 0

    @classmethod
    def empty(cls, unknowns: int, coordinates: int) -> 'Moments':
        """
        Begin with no data.

        Parameters
        ----------
        unknowns, coordinates : int

        Returns
        -------
        Moments

        """
        count = unknowns + _OF_FORCES + _OF_RATES
        return cls(
            np.zeros((count, unknowns + 1)),
            np.zeros((count * (unknowns + 1),) * 2),
            np.zeros((count, 3)),
            np.zeros((3, coordinates)),
            np.zeros(unknowns),
        )

    def excess(self, values: Reals) -> tuple[float, float]:
        """
        Compare the moments that no unknown can take up with what chance makes them.

        Parameters
        ----------
        values : ndarray, shape (n_unknowns,)
            The estimate, at which they scatter.

        Returns
        -------
        all_moments, of_rates : float
            T squared over its limit: above 1 at the stated rate of false alarms; of all moments,
            and of the measured rates against the displacement. 0 where there are too few data.

        """
        count = len(self.sums)
        rates = np.arange(count) >= count - _OF_RATES
        return self._excess(values, np.ones(count, dtype=bool)), self._excess(values, rates)

    def _excess(self, values: Reals, which: NDArray[np.bool_]) -> float:
        used = np.flatnonzero(which & (self.sizes[:, 0] > 0))
        unknowns = len(values)
        length = np.sqrt(self.sizes[used, 0])
        scaled = self.sums[used] / length[:, np.newaxis]
        columns = np.linalg.norm(scaled[:, :-1], axis=0)
        taken = scaled[:, :-1][:, columns > 0] / columns[columns > 0]
        # Directions in which no unknown moves the moments.
        left = np.linalg.qr(taken, mode='complete')[0][:, taken.shape[1] :].T
        free = len(left)
        if free < 1 or self.groups < GROUPS_PER_MOMENT * free + 2:
            return 0.0
        weights = np.append(-values, 1.0)
        shape = (len(self.sums), unknowns + 1) * 2
        spread = np.einsum('iajb,a,b->ij', self.products.reshape(shape), weights, weights)
        spread = spread[np.ix_(used, used)] / np.outer(length, length)
        total = scaled @ weights
        groups = self.groups
        covariance = (spread - np.outer(total, total) / groups) * groups / (groups - 1)
        shared = self.sizes[used, 2] ** 2 / self.sizes[used, 0]
        covariance += np.diag(TOLERANCE**2 * self.sizes[used, 1] + shared)
        variances, directions = np.linalg.eigh(left @ covariance @ left.T)
        told = variances > RANK_TOLERANCE * variances[-1]
        free = int(told.sum())
        if not free:
            return 0.0
        squared = float((((left @ total) @ directions[:, told]) ** 2 / variances[told]).sum())
        # All moments, and those of the rates: two tests.
        limit = float(fisher.isf(FALSE_ALARM_RATE / 2, free, groups - free))
        return squared / (limit * free * (groups - 1) / (groups - free))


class Overidentification:
    """
    Gather the moments of a stream.

    Parameters
    ----------
    model : Model
    regression : PointwiseRegression
        Of this model.

    """

    def __init__(self, model: Model, regression: PointwiseRegression) -> None:
        self._model = model
        self._regression = regression
        self.moments = Moments.empty(len(model.estimated), len(model.coordinates))
        self._waiting = np.empty((0, 4, len(model.coordinates)))
        self._setting: tuple[float, tuple[bool, bool]] | None = None
        self._force_noise = np.full(len(model.coordinates), np.nan)

    def add(self, block: MotionBlock, motion: Reals, follows: bool) -> None:
        """
        Take the next instants.

        Parameters
        ----------
        block : MotionBlock
        motion : ndarray, shape (n_samples, 4, n_coordinates)
            Its displacement, velocity, acceleration and force; NaN: not known.
        follows : bool
            Whether they follow those before.

        """
        if self._model.hidden_columns:
            return  # hysteretic states need all motion before
        measured = not block.velocity_derived, not block.acceleration_derived
        setting = block.sample_rate, measured
        if not follows or setting != self._setting:
            self.moments = self.at_the_end()
            self._waiting = self._waiting[:0]
        self._setting = setting
        self._force_noise = np.sqrt(np.diag(block.force_covariance))
        self._waiting = np.concatenate((self._waiting, motion))
        while len(self._waiting) >= BATCH + 2 * CONTEXT:
            self.moments = self._with(self._waiting[: BATCH + 2 * CONTEXT])
            self._waiting = self._waiting[BATCH:]

    def at_the_end(self) -> Moments:
        """
        Give the moments with those instants that wait for more.

        Returns
        -------
        Moments

        """
        groups = (len(self._waiting) - 2 * CONTEXT) // GROUP
        if groups < 1:
            return self.moments
        return self._with(self._waiting[: groups * GROUP + 2 * CONTEXT])

    def _with(self, motion: Reals) -> Moments:
        """Add instants that have a context on either side."""
        known: Flags = np.asarray(np.isfinite(motion).all(axis=(1, 2)))
        motion = np.where(known[:, np.newaxis, np.newaxis], motion, 0.0)
        regressor, target = self._regression.rows(*(motion[:, i] for i in range(4)))
        rows = np.column_stack((regressor, target)).reshape(*motion[:, 0].shape, -1)
        rates = [self._rate(motion, known, order) for order in (1, 2)]
        moments = self.moments
        if not moments.groups:
            moments = self._begun(rows, known, rates)
        forces = _moments(
            self._instruments(moments, motion, rows[:, :, :-1]),
            rows[CONTEXT:-CONTEXT],
            rows[CONTEXT:-CONTEXT, :, -1],
            _thrice(known),
            moments.scale[0],
            self._force_noise,
        )
        parts = [forces]
        for rate, scale in zip(rates, moments.scale[1:], strict=True):
            before, after = _before(rate.smoothed), _after(rate.smoothed)
            instruments = np.stack((after + before, after - before), axis=2)
            error, measured = rate.error[:, :, np.newaxis], rate.smoothed[LAG:-LAG]
            table, sizes = _moments(instruments, error, measured, rate.known, scale)
            unknowns = np.zeros((*table.shape[:2], rows.shape[2] - 1))
            parts.append((np.concatenate((unknowns, table), axis=2), sizes))
        table = np.concatenate([one for one, _ in parts], axis=1)
        flat = table.reshape(len(table), -1)
        return replace(
            moments,
            sums=moments.sums + table.sum(axis=0),
            products=moments.products + flat.T @ flat,
            sizes=moments.sizes + np.concatenate([sizes for _, sizes in parts]),
            groups=moments.groups + len(table),
        )

    def _begun(self, rows: Reals, known: Flags, rates: Sequence['_Rate']) -> Moments:
        """Fix what all instants are referred to."""
        unknowns = rows.shape[2] - 1
        flat = rows[known].reshape(-1, unknowns + 1)
        fit = Information.empty(unknowns).with_rows(flat[:, :-1], flat[:, -1])
        reference = fit.solve().values
        residual = rows[known] @ np.append(-reference, 1.0)
        scale = [_noise_size(residual, rows[known][:, :, -1])]
        scale += [
            _noise_size(one.error[one.known], one.smoothed[LAG:-LAG][one.known]) for one in rates
        ]
        return replace(self.moments, scale=np.array(scale), reference=reference)

    def _instruments(self, moments: Moments, motion: Reals, regressor: Reals) -> Reals:
        """Give force and motion before and after every instant."""
        displacement, velocity, acceleration, force = (motion[:, i] for i in range(4))
        known = self._regression.known
        whole = self._model.with_unknowns(moments.reference)
        # Of what is unknown, the columns of the unknowns stand here already.
        even = (
            force,
            known.mass_diagonal() * acceleration,
            known.joint_force(displacement, velocity),
        )
        odd = (
            force,
            whole.mass_diagonal() * acceleration,
            whole.joint_force(displacement, velocity),
        )
        sums = np.concatenate((regressor, np.stack(even, axis=2)), axis=2)[SMOOTHING:-SMOOTHING]
        differences = np.stack(odd, axis=2)[SMOOTHING:-SMOOTHING]
        # The noise of the force is small and white: the force needs no distance from itself, if
        # its noise is known. Where it takes a mass in front along, it shares that noise.
        told = np.isfinite(self._force_noise).all()
        inner = force[CONTEXT - 1 : len(force) - CONTEXT + 1] * told
        near = np.stack((inner[1:-1], inner[2:] - inner[:-2]), axis=2)
        return np.concatenate(
            (_after(sums) + _before(sums), _after(differences) - _before(differences), near),
            axis=2,
        )

    def _rate(self, motion: Reals, known: Flags, order: int) -> '_Rate':
        """Smooth a measured rate, and take that of the displacement from it."""
        assert self._setting is not None
        sample_rate, measured = self._setting
        window = np.hanning(2 * SMOOTHING + 3)[1:-1] ** 2
        window /= window.sum()
        count = len(motion) - 2 * SMOOTHING
        smoothed = convolve(motion[:, order], window, count)
        difference = stencil(order, 0.0, DIFFERENCES) * sample_rate**order
        inner = motion[CONTEXT - SMOOTHING - DIFFERENCES :, 0]
        taps = np.convolve(window, difference)
        derived = convolve(inner, taps, len(motion) - 2 * CONTEXT)
        gaps = convolve((~known).astype(float), np.ones(len(taps)), len(known) - len(taps) + 1)
        whole = np.zeros(len(known), dtype=bool)
        whole[len(taps) // 2 : len(known) - len(taps) // 2] = gaps == 0
        usable = _thrice(whole) if measured[order - 1] else np.zeros(len(derived), dtype=bool)
        return _Rate(smoothed, smoothed[LAG:-LAG] - derived, usable)


@dataclass(frozen=True)
class _Rate:
    """
    A measured rate and its difference from that of the displacement, both smoothed.

    Parameters
    ----------
    smoothed : ndarray, shape (n_samples + 2 LAG, n_coordinates)
    error : ndarray, shape (n_samples, n_coordinates)
    known : ndarray of bool, shape (n_samples,)

    """

    smoothed: Reals
    error: Reals
    known: Flags


def _before(table: Reals) -> Reals:
    return table[: len(table) - 2 * LAG]


def _after(table: Reals) -> Reals:
    return table[2 * LAG :]


def _thrice(known: Flags) -> Flags:
    """Tell of every instant between the contexts whether it, before and after are known."""
    inner = known[SMOOTHING : len(known) - SMOOTHING]
    return np.asarray(inner[: -2 * LAG] & inner[LAG:-LAG] & inner[2 * LAG :])


def _noise_size(error: Reals, whole: Reals) -> Reals:
    """Root mean squares, not below what the arithmetic leaves; 0: nothing there."""
    if not len(error):
        return np.zeros(error.shape[1])
    squares = np.stack([(one**2).mean(axis=0) for one in (error, TOLERANCE * whole)])
    return np.asarray(np.sqrt(squares.max(axis=0)))


def _moments(
    instruments: Reals,
    rows: Reals,
    whole: Reals,
    usable: Flags,
    scale: Reals,
    noise: Reals | None = None,
) -> tuple[Reals, Reals]:
    """
    Multiply, and sum up over every group of instants.

    Parameters
    ----------
    instruments, rows : ndarray, shape (n_samples, n_coordinates, ...)
    whole : ndarray, shape (n_samples, n_coordinates)
        What errors in the rows are to be compared with.
    usable : ndarray of bool, shape (n_samples,)
    scale : ndarray, shape (n_coordinates,)
    noise : ndarray, shape (n_coordinates,), or None
        Of the last two instruments, perhaps shared with the rows.

    Returns
    -------
    table : ndarray, shape (n_groups, n_instruments, n_columns)
    sizes : ndarray, shape (n_instruments, 3)

    """
    weights = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
    weights = usable[:, np.newaxis, np.newaxis] * weights[:, np.newaxis]
    groups = len(rows) // GROUP
    first = (instruments * weights).reshape(groups, -1, instruments.shape[2])
    second = (rows * weights).reshape(groups, -1, rows.shape[2])
    table = first.transpose(0, 2, 1) @ second
    squares = (first**2).sum(axis=(0, 1))
    target = np.full_like(squares, float(((whole * weights[:, :, 0]) ** 2).sum()))
    shared = np.zeros_like(squares)
    if noise is not None:
        shared[-2:] = np.nansum(weights[:, :, 0] * noise) * np.sqrt((1, 2))
    return table, np.column_stack((squares, target, shared))

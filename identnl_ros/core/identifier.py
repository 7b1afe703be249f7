# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The streaming identifier: motion blocks in, estimates out; nodes and offline use this one."""

from dataclasses import dataclass

from identnl_ros.core.blocks import MotionBlock
from identnl_ros.core.combinations import determined_combinations
from identnl_ros.core.continuity import StreamFollower
from identnl_ros.core.errors import DataError
from identnl_ros.core.estimate import Estimate, EstimateStatus, ParameterEstimate
from identnl_ros.core.information import Information, Solution
from identnl_ros.core.model import Model
from identnl_ros.core.regression import PointwiseRegression
import numpy as np
from numpy.typing import NDArray

# Instants factored at once. Counted from the first one used, whatever the blocks, so that the
# result does not depend on how the stream was cut into blocks.
BATCH = 2048
# An estimate whose bias from sensor noise exceeds this many standard errors is marked.
NOISE_BIAS_LIMIT = 1.0


@dataclass(frozen=True)
class IdentifierState:
    """
    Everything an identifier has learned.

    Parameters
    ----------
    information : Information
        Of all complete batches.
    noise_gram : ndarray, shape (n_unknowns, n_unknowns)
        Expected contribution of sensor noise to ``Phi^T Phi``.
    noise_samples : int
        Instants at which the sensor noise was known.
    pending : ndarray, shape (n_pending, 4, n_coordinates)
        Displacement, velocity, acceleration, force of instants not yet factored.
    samples, rejected : int
        Instants used and left out.
    unknowns : tuple of str
        Names of the unknown parameters.

    """

    information: Information
    noise_gram: NDArray[np.float64]
    noise_samples: int
    pending: NDArray[np.float64]
    samples: int
    rejected: int
    unknowns: tuple[str, ...]


class Identifier:
    """
    Pointwise identification of a machine, the method of Berczynski et al. (2010).

    Every instant gives one equation per coordinate; least squares (44) with the covariance
    (45)-(47). Exact on clean data. On noisy data the measured motion in the regressor biases
    the estimates; the bias that the stated sensor noise must cause is computed, included in
    the standard deviation and reported.

    Parameters
    ----------
    model : Model

    Raises
    ------
    DataError
        If the machine has no unknown parameter.

    """

    estimator = 'pointwise'

    def __init__(self, model: Model) -> None:
        self._model = model
        self._regression = PointwiseRegression(model)
        self._unknowns = tuple(model.parameters[i].name for i in model.estimated)
        if not self._unknowns:
            raise DataError(
                f'machine {model.machine.name}: no parameter is marked "estimate"; '
                'there is nothing to identify'
            )
        known = [i for i in range(len(model.parameters)) if i not in model.estimated]
        for i in known:
            if np.isnan(model.parameters[i].value):
                raise DataError(f'{model.parameters[i].name}: known but without a value')
        self.follower = StreamFollower()
        self.reset()

    def reset(self) -> None:
        """Forget all data."""
        size = len(self._unknowns)
        self._information = Information.empty(size)
        self._noise_gram = np.zeros((size, size))
        self._noise_samples = 0
        self._noise_estimated = False
        self._pending = np.empty((0, 4, len(self._model.coordinates)))
        self._samples = 0
        self._rejected = 0
        self._derived: set[str] = set()

    @property
    def samples(self) -> int:
        """Instants used so far."""
        return self._samples

    @property
    def rejected(self) -> int:
        """Instants left out so far."""
        return self._rejected

    def end_stream(self) -> None:
        """Expect another stream next: the present one has ended, marked so or not."""
        self.follower.ended = True

    @property
    def state(self) -> IdentifierState:
        """All that has been learned, to be saved or merged."""
        return IdentifierState(
            self._information,
            self._noise_gram,
            self._noise_samples,
            self._pending,
            self._samples,
            self._rejected,
            self._unknowns,
        )

    def restore(self, state: IdentifierState) -> None:
        """
        Continue from a saved state.

        Parameters
        ----------
        state : IdentifierState

        Raises
        ------
        DataError
            If it belongs to other unknowns.

        """
        if state.unknowns != self._unknowns:
            missing = sorted(set(self._unknowns) ^ set(state.unknowns))
            raise DataError(
                'the saved state belongs to another machine or other unknowns '
                f'(differing: {", ".join(missing) or "the order"})'
            )
        if state.pending.shape[1:] != self._pending.shape[1:]:
            raise DataError('the saved state belongs to a machine with other degrees of freedom')
        self._information = state.information
        self._noise_gram = state.noise_gram
        self._noise_samples = state.noise_samples
        self._pending = state.pending
        self._samples = state.samples
        self._rejected = state.rejected

    def add(self, block: MotionBlock) -> bool:
        """
        Accumulate one block.

        Parameters
        ----------
        block : MotionBlock

        Returns
        -------
        bool
            False where the block is not new data of the stream (`follower` counts why).

        Raises
        ------
        DataError
            If the block's coordinates are not the machine's.

        """
        if block.coordinates != self._model.coordinate_names:
            raise DataError(
                f'motion block {block.first_index}: its coordinates are not those of machine '
                f'{self._model.machine.name}; do transform and identifier use the same machine '
                'file?'
            )
        arrival = self.follower.accept(
            block.stream_id, block.first_index, block.next_index, block.last
        )
        if not arrival.usable:
            return False
        motion = np.stack(
            (block.displacement, block.velocity, block.acceleration, block.force), axis=1
        )
        valid = np.isfinite(motion).all(axis=(1, 2))
        self._rejected += int((~valid).sum())
        self._samples += int(valid.sum())
        self._derived |= {
            name
            for name, derived in (
                ('velocity', block.velocity_derived),
                ('acceleration', block.acceleration_derived),
            )
            if derived
        }
        self._noise_estimated |= block.noise_estimated
        gram = self._regression.noise_gram(block.displacement[valid], block)
        if np.isfinite(gram).all():
            self._noise_gram = self._noise_gram + gram
            self._noise_samples += int(valid.sum())
        self._pending = np.concatenate((self._pending, motion[valid]))
        while self._pending.shape[0] >= BATCH:
            self._information = self._factored(self._pending[:BATCH])
            self._pending = self._pending[BATCH:]
        return True

    def estimate(self) -> Estimate:
        """
        Solve for the parameters with all data so far.

        Returns
        -------
        Estimate

        """
        information = self._factored(self._pending) if len(self._pending) else self._information
        if information.rows <= information.size:
            return self._nothing_yet()
        solution = information.solve()
        variance = solution.residual_squares / (information.rows - information.size)  # (47)
        covariance = variance * solution.inverse  # (45)
        bias, bounded = self._noise_bias(solution)
        # The bias is known in size only as far as the noise is: it widens, it does not correct.
        # And no estimate is surer than the arithmetic behind it.
        covariance = covariance + np.outer(bias, bias) + np.diag(solution.rounding**2)
        covariance[solution.free, :] = np.nan
        covariance[:, solution.free] = np.nan
        names = self._unknowns
        combinations = determined_combinations(solution.null_space, solution.free, names)
        parameters = tuple(
            self._parameter(i, solution, covariance, variance, float(bias[i]), bounded)
            for i in range(len(names))
        )
        if not bounded:
            covariance[:] = np.nan
        return Estimate(
            estimator=self.estimator,
            parameters=parameters,
            covariance=covariance,
            samples=self._samples,
            rejected_samples=self._rejected,
            residual=float(np.sqrt(solution.residual_squares / solution.target_squares))
            if solution.target_squares > 0
            else float('nan'),
            condition_number=solution.condition_number,
            combinations=tuple(combination.in_words for combination in combinations),
            notes=self._notes(parameters),
        )

    def _noise_bias(self, solution: Solution) -> tuple[NDArray[np.float64], bool]:
        """
        Find the bias of least squares from the noise in the regressor; False: unbounded.

        With G the expected contribution of noise to Phi^T Phi, the estimate is about
        ``(I - (Phi^T Phi)^-1 G)`` times the truth.

        """
        unbounded = np.full_like(solution.values, np.nan), False
        if self._noise_samples == 0:
            return unbounded
        attenuation = solution.inverse @ self._noise_gram * (self._samples / self._noise_samples)
        if np.max(np.abs(np.linalg.eigvals(attenuation)), initial=0.0) >= 0.5:
            return unbounded
        corrected = np.linalg.solve(np.eye(len(attenuation)) - attenuation, solution.values)
        return solution.values - corrected, True

    def _factored(self, motion: NDArray[np.float64]) -> Information:
        regressor, target = self._regression.rows(*(motion[:, i] for i in range(4)))
        return self._information.with_rows(regressor, target)

    def _parameter(
        self,
        index: int,
        solution: Solution,
        covariance: NDArray[np.float64],
        variance: float,
        bias: float,
        bounded: bool,
    ) -> ParameterEstimate:
        parameter = self._model.parameters[self._model.estimated[index]]
        head = (parameter.name, parameter.symbol, parameter.unit)
        if solution.free[index]:
            return ParameterEstimate(
                *head,
                float('nan'),
                float('nan'),
                EstimateStatus.NOT_IDENTIFIABLE,
                'these data do not determine it by itself',
            )
        value = float(solution.values[index])
        if not bounded:
            return ParameterEstimate(
                *head,
                value,
                float('nan'),
                EstimateStatus.NOISE_LIMITED,
                'sensor noise is as large as the information in these data'
                if self._noise_samples
                else 'the noise of the sensors is not known',
            )
        deviation = float(np.sqrt(covariance[index, index]))
        statistical = float(np.sqrt(variance * solution.inverse[index, index]))
        if abs(bias) > NOISE_BIAS_LIMIT * statistical:
            return ParameterEstimate(
                *head,
                value,
                deviation,
                EstimateStatus.NOISE_LIMITED,
                f'sensor noise in the measured motion biases it by about {abs(bias / value):.1%}',
            )
        return ParameterEstimate(*head, value, deviation, EstimateStatus.OK)

    def _nothing_yet(self) -> Estimate:
        size = len(self._unknowns)
        parameters = tuple(
            ParameterEstimate(
                parameter.name,
                parameter.symbol,
                parameter.unit,
                float('nan'),
                float('nan'),
                EstimateStatus.UNKNOWN,
                'too few samples yet',
            )
            for parameter in (self._model.parameters[i] for i in self._model.estimated)
        )
        return Estimate(
            self.estimator,
            parameters,
            np.full((size, size), np.nan),
            self._samples,
            self._rejected,
            float('nan'),
            float('nan'),
        )

    def _notes(self, parameters: tuple[ParameterEstimate, ...]) -> tuple[str, ...]:
        notes = []
        for name in sorted(self._derived):
            notes.append(
                f'The {name} is not (fully) measured: it is derived from the displacement, '
                'which amplifies its noise.'
            )
        if self._noise_estimated:
            notes.append(
                "The layout does not state every sensor's noise: it is estimated from the "
                'fastest changes of the samples, rather too large than too small.'
            )
        if any(parameter.status is EstimateStatus.NOISE_LIMITED for parameter in parameters):
            notes.append(
                'The pointwise estimator takes the measured motion for exact; its estimates '
                'marked noise_limited are off by about their standard deviation, always to the '
                'same side.'
            )
        return tuple(notes)

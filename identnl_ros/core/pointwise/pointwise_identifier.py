# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The streaming identifier: motion blocks in, estimates out; nodes and offline use this one."""

from identnl_ros.core.algebra.information import Information, Solution
from identnl_ros.core.errors import DataError
from identnl_ros.core.estimation.combinations import combination_estimates
from identnl_ros.core.estimation.estimate import (
    Estimate,
    EstimateStatus,
    IN_DOUBT,
    ParameterEstimate,
)
from identnl_ros.core.estimation.regression import PointwiseRegression
from identnl_ros.core.estimation.unknowns import (
    nothing_yet,
    require_coordinates,
    require_no_time,
    require_same_unknowns,
    require_unknowns,
)
from identnl_ros.core.measurement.blocks import MotionBlock
from identnl_ros.core.measurement.continuity import Arrival, StreamFollower
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.pointwise.identifier_state import IdentifierState
from identnl_ros.core.pointwise.noise_bias import NoiseBias, NoiseCovariances, SlopeSums
from identnl_ros.core.pointwise.overidentification import Overidentification
from identnl_ros.core.pointwise.scatter import Scatter
import numpy as np
from numpy.typing import NDArray

# Instants factored at once. Counted from the first one used, whatever the blocks, so that the
# result does not depend on how the stream was cut into blocks.
BATCH = 2048
# Instants whose residuals may have samples in common where a rate is derived.
CORRELATED_INSTANTS = 32
# A residual may exceed what noise explains by this factor, as rough as a stated noise is, and
# anyway be this fraction of the forces, before the model is doubted.
LARGEST_EXCESS = 1.5
RESIDUAL_TOLERANCE = 1e-4
ROWS_FOR_DOUBT = 200
# An estimate whose bias from sensor noise exceeds this many standard errors is marked.
NOISE_BIAS_LIMIT = 1.0


class PointwiseIdentifier:
    """
    Pointwise identification of a machine, the method of Berczynski et al. (2010).

    Every instant gives one equation per coordinate; least squares (44). The covariance (45)-(47)
    holds for equal, independent residuals; it is replaced by one that takes their scatter as it
    is wherever there are enough samples. Exact on clean data. On noisy data the measured motion
    in the regressor biases the estimates; the bias that the sensors' noise must cause is
    computed, included in the standard deviation and reported.

    Parameters
    ----------
    model : Model

    Raises
    ------
    DataError
        If the machine has no unknown parameter.
    MachineError
        If its forces depend on time.

    """

    estimator = 'pointwise'

    def __init__(self, model: Model) -> None:
        require_unknowns(model)
        require_no_time(model, self.estimator)
        self._model = model
        self._regression = PointwiseRegression(model)
        self._noise_bias = NoiseBias(model)
        self._unknowns = tuple(model.parameters[i].name for i in model.estimated)
        self.reset()

    def reset(self) -> None:
        """Forget all data, and which stream they came from."""
        self.follower = StreamFollower()
        size = len(self._unknowns)
        self._information = Information.empty(size)
        self._scatter = Scatter.empty(size)
        self._test = Overidentification(self._model, self._regression)
        self._slopes = self._noise_bias.empty()
        self._noise: NoiseCovariances | None = None
        self._earlier_noise = np.zeros((size + 1, size + 1))
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
            self._scatter,
            self._slopes,
            self._noise,
            self._earlier_noise,
            self._pending,
            self._samples,
            self._rejected,
            self._unknowns,
            frozenset(self._derived),
            self._noise_estimated,
            self.follower.stream_id,
            self.follower.next_index,
            self._test.at_the_end(),
        )

    def restore(self, state: object) -> None:
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
        if not isinstance(state, IdentifierState):
            raise DataError('the saved state belongs to another estimator, expected pointwise')
        require_same_unknowns(self._unknowns, state.unknowns)
        if state.pending.shape[1:] != self._pending.shape[1:]:
            raise DataError('the saved state belongs to a machine with other degrees of freedom')
        self._information = state.information
        self._scatter = state.scatter
        self._test = Overidentification(self._model, self._regression)
        if state.moments is not None:
            self._test.moments = state.moments
        self._slopes = state.slopes
        self._noise = state.noise
        self._earlier_noise = state.earlier_noise
        self._derived = set(state.derived)
        self._noise_estimated = state.noise_estimated
        if self.follower.stream_id is None and state.stream_id is not None:
            self.follower.resume(state.stream_id, state.next_index)
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
        require_coordinates(self._model, block)
        arrival = self.follower.accept(
            block.stream_id, block.first_index, block.next_index, block.last
        )
        if not arrival.usable:
            return False
        if arrival is Arrival.FIRST and self._samples:
            self._close_stream()
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
        self._test.add(block, motion, arrival is Arrival.IN_ORDER)
        self._take_noise(block, int(valid.sum()))
        self._pending = np.concatenate((self._pending, motion[valid]))
        while self._pending.shape[0] >= BATCH:
            self._commit(BATCH)
        return True

    def estimate(self) -> Estimate:
        """
        Solve for the parameters with all data so far.

        Returns
        -------
        Estimate

        """
        information, scatter, slopes = self._accumulated(self._pending)
        if information.rows <= information.size:
            counts = self._samples, self._rejected
            return nothing_yet(self._model, self.estimator, *counts, 'too few samples yet')
        solution = information.solve()
        covariance = self._scattering(information, solution, scatter)
        noise = self._noise_moments(slopes)
        bias, bounded = self._bias(solution, noise)
        doubt = self._doubt(information, solution, solution.values - bias, noise)
        statistical = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        # The bias is known in size only as far as the noise is: it widens, it does not correct.
        # And no estimate is surer than the arithmetic behind it.
        covariance = covariance + np.outer(bias, bias) + np.diag(solution.rounding**2)
        names = self._unknowns
        combinations = combination_estimates(
            solution.null_space, solution.free, names, solution.values, covariance
        )
        covariance[solution.free, :] = np.nan
        covariance[:, solution.free] = np.nan
        parameters = tuple(
            self._parameter(i, solution, covariance, float(statistical[i]), float(bias[i]), doubt)
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
            combinations=combinations,
            notes=self._notes(parameters, doubt),
        )

    def _take_noise(self, block: MotionBlock, count: int) -> None:
        """Average stated noise over the instants of the stream; the last estimate is the best."""
        noise = NoiseCovariances.of(block)
        earlier = self._slopes.samples + len(self._pending)
        if self._noise is not None and earlier and not block.noise_estimated:
            noise = self._noise.moved_towards(noise, count / (earlier + count))
        self._noise = noise

    def _commit(self, count: int) -> None:
        accumulated = self._accumulated(self._pending[:count])
        self._information, self._scatter, self._slopes = accumulated
        self._pending = self._pending[count:]

    def _close_stream(self) -> None:
        """Settle what is pending: the next stream has other sensors, perhaps."""
        self._commit(len(self._pending))
        self._earlier_noise = self._noise_moments(self._slopes)
        self._slopes = self._noise_bias.empty()

    def _noise_moments(self, slopes: SlopeSums) -> NDArray[np.float64]:
        """Sum the effect of sensor noise in all streams; NaN where a noise is not known."""
        if self._noise is None or not slopes.samples:
            return self._earlier_noise
        return self._earlier_noise + self._noise_bias.moments(slopes, self._noise)

    def _accumulated(self, motion: NDArray[np.float64]) -> tuple[Information, Scatter, SlopeSums]:
        """Add instants to what has been accumulated."""
        if not len(motion):
            return self._information, self._scatter, self._slopes
        regressor, target = self._regression.rows(*(motion[:, i] for i in range(4)))
        instants = CORRELATED_INSTANTS if self._derived else 1
        return (
            self._information.with_rows(regressor, target),
            self._scatter.with_rows(regressor, target, instants * motion.shape[2]),
            self._noise_bias.with_motion(self._slopes, motion[:, 0]),
        )

    def _scattering(
        self, information: Information, solution: Solution, scatter: Scatter
    ) -> NDArray[np.float64]:
        """Covariance from the residuals; (45) and (47) where there are too few for more."""
        robust = scatter.covariance(solution.values, solution.inverse)
        if robust is not None:
            return robust
        variance = solution.residual_squares / (information.rows - information.size)  # (47)
        return variance * solution.inverse  # (45)

    @staticmethod
    def _bias(solution: Solution, noise: NDArray[np.float64]) -> tuple[NDArray[np.float64], bool]:
        """Bias from the noise in regressor and target; False: it has no bound."""
        unbounded = np.full_like(solution.values, np.nan), False
        gram, cross = noise[:-1, :-1], noise[:-1, -1]
        if not np.isfinite(noise).all():
            return unbounded
        attenuation = solution.inverse @ gram
        if np.max(np.abs(np.linalg.eigvals(attenuation)), initial=0.0) >= 0.5:
            return unbounded
        corrected = np.linalg.solve(
            np.eye(len(gram)) - attenuation, solution.values - solution.inverse @ cross
        )
        return solution.values - corrected, True

    def _doubt(
        self,
        information: Information,
        solution: Solution,
        values: NDArray[np.float64],
        noise: NDArray[np.float64],
    ) -> str:
        """
        Say why the model is in doubt; empty: nothing speaks against it.

        The residual is compared with what the sensors' noise explains at the unbiased values,
        unless it is too small to matter, or the noise too large to tell.

        """
        weights = np.append(-values, 1.0)
        expected = float(weights @ noise @ weights)
        tolerated = RESIDUAL_TOLERANCE**2 * solution.target_squares
        if (
            information.rows >= ROWS_FOR_DOUBT
            and np.isfinite(expected)
            and solution.residual_squares > tolerated
        ):
            excess = float(np.sqrt(solution.residual_squares / max(expected, tolerated)))
            if excess > LARGEST_EXCESS:
                return (
                    f'The residual is {excess:.3g} times what the stated sensor noise explains: '
                    'the model lacks something, or a gain, direction, delay, column or noise in '
                    'the layout is wrong. The standard deviations do not hold.'
                )
        of_all, of_rates = self._test.at_the_end().excess(solution.values)
        if of_rates > 1:
            return (
                'The measured rates are not those of the displacement: they differ by '
                f'{np.sqrt(of_rates):.3g} times what chance explains; a gain or delay in the '
                'layout is wrong. The standard deviations do not hold.'
            )
        if of_all > 1:
            return (
                'The residual goes with the force and the motion, by '
                f'{np.sqrt(of_all):.3g} times what chance explains: the model lacks something, '
                'or a mass, or a gain, direction, delay or column in the layout is wrong. The '
                'standard deviations do not hold.'
            )
        return ''

    def _parameter(
        self,
        index: int,
        solution: Solution,
        covariance: NDArray[np.float64],
        statistical: float,
        bias: float,
        doubt: str,
    ) -> ParameterEstimate:
        parameter = self._model.parameters[self._model.estimated[index]]
        head = (parameter.name, parameter.symbol, parameter.unit)
        value = float(solution.values[index])
        if solution.free[index] or not np.isfinite(value):
            return ParameterEstimate(
                *head,
                float('nan'),
                float('nan'),
                EstimateStatus.NOT_IDENTIFIABLE,
                'these data do not determine it by itself',
            )
        deviation = float(np.sqrt(covariance[index, index]))
        if doubt:
            status, note = EstimateStatus.MODEL_IN_DOUBT, IN_DOUBT
        elif not np.isfinite(bias):
            deviation = float('nan')
            status = EstimateStatus.NOISE_LIMITED
            note = 'sensor noise is unknown, or as large as the information in these data'
        elif abs(bias) > NOISE_BIAS_LIMIT * statistical and abs(bias) > solution.rounding[index]:
            status = EstimateStatus.NOISE_LIMITED
            note = (
                'sensor noise in the measured motion biases it by about '
                f'{abs(bias):.2g} {parameter.unit}'
            )
        else:
            status, note = EstimateStatus.OK, ''
        return ParameterEstimate(*head, value, deviation, status, note)

    def _notes(self, parameters: tuple[ParameterEstimate, ...], doubt: str) -> tuple[str, ...]:
        notes = [doubt] if doubt else []
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

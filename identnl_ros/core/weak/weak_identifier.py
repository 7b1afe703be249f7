# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The streaming estimator that survives sensor noise: weak-form start, linearised likelihood."""

from copy import deepcopy
from dataclasses import replace

from identnl_ros.core.errors import DataError
from identnl_ros.core.estimation.estimate import Estimate
from identnl_ros.core.estimation.judged_estimate import (
    FALSE_ALARM_RATE,
    judged_estimate,
    NOT_HELD,
    Verdict,
    verdict_on,
)
from identnl_ros.core.estimation.score_tests import contradiction, ScoreTest
from identnl_ros.core.estimation.unknowns import (
    nothing_yet,
    require_coordinates,
    require_same_unknowns,
    require_unknowns,
)
from identnl_ros.core.estimation.unseen_errors import unseen_errors, unseen_note
from identnl_ros.core.measurement.blocks import MotionBlock
from identnl_ros.core.measurement.continuity import Arrival, StreamFollower
from identnl_ros.core.measurement.motion_record import records_of
from identnl_ros.core.measurement.motion_weights import PERFECT
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.weak.recursion import Recursion
from identnl_ros.core.weak.run import Noise
from identnl_ros.core.weak.weak_state import WeakState
import numpy as np
from numpy.typing import NDArray

CHANGING = (
    'The latest samples contradict what was learned before: the machine is changing. The standard '
    'deviations do not hold.'
)


class WeakIdentifier:
    """
    Streaming identification from noisy motion, in memory that does not grow.

    A weak-form regression on the first samples gives a start. From it the machine is simulated
    under the measured force; the deviation of the measured motion from the simulated one is
    linear in the errors of the unknowns, with noise that is white and known, and every part of
    the stream improves the estimates by weighted least squares (recursive Gauss-Newton on the
    likelihood, cf. Ljung and Soderstrom 1983, Theory and Practice of Recursive Identification).

    Parameters
    ----------
    model : Model
        Preloads and exponents that are unknown start from the values they have here; no value
        of another unknown is used.
    memory : float or None
        Time after which what was learned counts 1/e as much, for a machine that changes [s];
        where new samples contradict it, it counts less at once. None: all counts alike.

    Raises
    ------
    DataError
        If the machine has no unknown parameter, or a known one without a value.

    """

    estimator = 'weak'

    def __init__(self, model: Model, memory: float | None = None) -> None:
        require_unknowns(model)
        self._model = model
        self._memory = memory
        self.reset()

    def reset(self) -> None:
        """Forget all data, and which stream they came from."""
        self.follower = StreamFollower()
        self._recursion = Recursion(self._model, self._memory)
        self._samples = 0
        self._rejected = 0
        self._noise_estimated = False

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
        self._recursion.close()

    @property
    def state(self) -> WeakState:
        """
        All that has been learned, to be saved or merged.

        Raises
        ------
        DataError
            If that is nothing yet.

        """
        recursion = deepcopy(self._recursion)
        recursion.finish()
        if not recursion.started:
            raise DataError(
                f'nothing has been learned yet that could be saved: {recursion.failure}'
            )
        return WeakState(
            recursion.information,
            recursion.tested,
            recursion.values,
            recursion.statistics.tables,
            recursion.statistics.average,
            recursion.fitted,
            recursion.force_noise,
            recursion.perfect,
            recursion.changing,
            self._samples,
            self._rejected,
            tuple(self._model.parameters[i].name for i in self._model.estimated),
            self._noise_estimated,
            self.follower.stream_id,
            self.follower.next_index,
        )

    def restore(self, state: object) -> None:
        """
        Continue from a saved state; the samples that come next begin a run of their own.

        Parameters
        ----------
        state : WeakState

        Raises
        ------
        DataError
            If it belongs to another estimator or to other unknowns.

        """
        if not isinstance(state, WeakState):
            raise DataError('the saved state belongs to another estimator, expected weak')
        names = tuple(self._model.parameters[i].name for i in self._model.estimated)
        require_same_unknowns(names, state.unknowns)
        self._recursion = Recursion(self._model, self._memory)
        self._recursion.resume(state)
        self._samples, self._rejected = state.samples, state.rejected
        self._noise_estimated = state.noise_estimated
        if self.follower.stream_id is None and state.stream_id is not None:
            self.follower.resume(state.stream_id, state.next_index)

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
        if arrival is not Arrival.IN_ORDER:
            self._recursion.close()
        self._noise_estimated |= block.noise_estimated
        noise = noise_of(block, self._model.excitation_directions)
        for number, record in enumerate(records_of(block, self._model.excitation_directions)):
            if number:
                self._recursion.close()
                self._rejected += 1
            if len(record):
                valid = int(np.isfinite(record.displacement).all(axis=1).sum())
                self._samples += valid
                self._rejected += len(record) - valid
                self._recursion.add(record, noise)
        return True

    def estimate(self) -> Estimate:
        """
        Solve for the parameters with all data so far.

        Returns
        -------
        Estimate

        """
        # What is settled for this estimate must not change how the stream goes on. Where no start
        # was found, the next one is tried when there are more samples, not at every question.
        recursion = deepcopy(self._recursion)
        recursion.finish(self.follower.ended or not recursion.tried)
        counts = self._samples, self._rejected
        if not recursion.started and recursion.weighed is None:
            return nothing_yet(self._model, self.estimator, *counts, recursion.failure)
        information = recursion.information
        solution = information.solve()
        freedom = max(information.rows - information.size, 1.0)
        force_noise = recursion.force_noise
        verdict = self._verdict(recursion)
        if recursion.perfect:
            # The weights are not those of the noise: the residual says how exact the values are.
            variance = max(verdict.variance, solution.residual_squares / freedom)
            verdict = replace(verdict, variance=variance)
            force_noise = replace(
                force_noise, variance_share=force_noise.variance_share / variance
            )
        if recursion.changing and not verdict.doubt:
            verdict = replace(verdict, doubt=CHANGING)
        model = recursion.model
        estimate = judged_estimate(
            self.estimator,
            [model.parameters[i] for i in model.estimated],
            recursion.values + solution.values,
            solution,
            verdict,
            *counts,
            # Over the noise; over the motion where there is none.
            residual=float(np.sqrt(solution.residual_squares / freedom))
            * (PERFECT if recursion.perfect else 1.0),
            failure=recursion.failure,
            remarks=self._remarks(recursion),
            force_noise=force_noise,
        )
        if recursion.failure or verdict.doubt:
            return estimate
        errors = unseen_errors(recursion.tests, estimate, model, FALSE_ALARM_RATE / 2)
        note = unseen_note(errors, model)
        return replace(estimate, notes=(*estimate.notes, note)) if note else estimate

    def tests(self) -> tuple[ScoreTest, ...]:
        """
        Test what may be wrong in machine or layout with all data so far.

        Returns
        -------
        tuple of ScoreTest
            None of them while there is no start.

        """
        recursion = deepcopy(self._recursion)
        recursion.finish(self.follower.ended or not recursion.tried)
        return recursion.tests if recursion.started else ()

    def simulated_model(self) -> Model | None:
        """
        Give the model its estimates, with some value for what the data do not determine.

        Returns
        -------
        Model or None
            None: there are too few samples.

        """
        recursion = deepcopy(self._recursion)
        recursion.finish()
        return None if recursion.weighed is None else recursion.model

    def _verdict(self, recursion: Recursion) -> Verdict:
        """Judge the residual as a whole and by what may be wrong; each has half the alarms."""
        rate = FALSE_ALARM_RATE / 2
        verdict = verdict_on(
            recursion.statistics,
            recursion.fitted,
            recursion.force_noise,
            perfect=PERFECT if recursion.perfect else None,
            false_alarm_rate=rate,
        )
        contradicted = contradiction(recursion.tests, rate, recursion.model)
        if not contradicted:
            return verdict
        doubt = f'{contradicted} {verdict.doubt or NOT_HELD}'
        return replace(verdict, doubt=doubt, remark='')

    def _remarks(self, recursion: Recursion) -> list[str]:
        remarks = []
        if self._noise_estimated:
            remarks.append(
                "The layout does not state every sensor's noise: it is estimated from the "
                'fastest changes of the samples.'
            )
        if recursion.weighed is not None:
            duration = 1e3 * recursion.weighed.function.duration
            remarks.append(f'Test functions of {duration:.3g} ms, chosen from the spectrum.')
        return remarks


def noise_of(block: MotionBlock, directions: NDArray[np.float64]) -> Noise:
    # An estimate of the moment depends on how the stream was cut into blocks: not used.
    unknown = np.nan if block.noise_estimated else 0.0
    covariances = (
        block.displacement_covariance + unknown,
        block.velocity_covariance + unknown,
        block.acceleration_covariance + unknown,
    )
    to_exciters = np.linalg.pinv(directions)
    force = to_exciters.T @ (np.nan_to_num(block.force_covariance)) @ to_exciters
    return Noise(
        covariances, force + unknown, (False, block.velocity_derived, block.acceleration_derived)
    )

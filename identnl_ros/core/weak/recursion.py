# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Recursive estimation along a stream of records, in memory that does not grow.

The first samples are kept until they have given a start, and gone over again while the estimates
still move by more than their errors; from then on every part of the stream is used once.
"""

from collections.abc import Sequence
from contextlib import suppress

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.errors import IdentnlError, MachineError
from identnl_ros.core.estimation.alternatives import alternatives_of
from identnl_ros.core.estimation.force_noise import DRAWS, force_noise_effect, ForceNoise
from identnl_ros.core.estimation.residual_statistics import QUIETEST, ResidualStatistics
from identnl_ros.core.estimation.score_tests import score_tests, ScoreNoise, ScoreTest
from identnl_ros.core.measurement.motion_record import MotionRecord, same_noise
from identnl_ros.core.measurement.motion_weights import noise_covariance
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.weak.chunk_fit import (
    CONCESSIONS,
    Contradiction,
    FALSE_ALARM_RATE,
    fitted_to_chunk,
)
from identnl_ros.core.weak.response_fit import FORCE_MARGIN, joined, padded, ResponseFit
from identnl_ros.core.weak.response_search import (
    CHUNK,
    remembered,
    Search,
    search,
    search_by_lengths,
    statistics_for,
    WeighedRecord,
)
from identnl_ros.core.weak.run import Noise, Run
from identnl_ros.core.weak.weak_start import weak_form_start
from identnl_ros.core.weak.weak_state import WeakState
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# Samples at which a start is tried first; then at twice as many, and so on.
FIRST_START = 2048
# Samples kept to go over them again.
KEPT = 2**15
# With forgetting, samples are kept for so many memories: what was learned at bad values before
# that hardly counts.
KEPT_MEMORIES = 3
# Where no values suit both the first samples of a run and what was known, the latter counts less
# by this factor.
LARGE_CONCESSION = 100.0
# Chances that all chunks of a machine that has not changed seem to contradict what was known: to
# doubt its model, and to let what was known count less.
CREEP_ALARM_RATE = 1e-2
CREEP_CONCESSION_RATE = 1e-4
# With forgetting, a residual greater by this factor than after the start, in more than so many
# chunks in a row, is no longer that of the same machine: a start is sought anew.
ASTRAY = 10.0
PATIENCE = 1
# When there are twice as many samples as when they were gone over last, a change of the values by
# this many standard errors is worth another pass: what was learned at the old values is wrong to
# second order.
WORTH_A_PASS = 0.3
# Second-order effects of a relative change this small are beyond double precision.
NEGLIGIBLE = 1e-8
# Rows learned at different values contradict each other in the directions that the data tell
# worst, by about the relative change times the condition number: so much is worth a last pass.
WORTH_A_LAST_PASS = 0.3
# Samples on which the effect of force noise is studied at most.
LONGEST_FORCE_STUDY = 2**13


class Recursion:
    """
    Estimates along a stream.

    Parameters
    ----------
    model : Model
        Unknown preloads and exponents start from its values; no other unknown value is used.
    memory : float or None
        Time after which what was learned counts 1/e as much [s]; None: nothing is forgotten.

    """

    def __init__(self, model: Model, memory: float | None) -> None:
        self._described = model
        self._memory = memory
        self._begin('too few samples yet')

    def _begin(self, failure: str) -> None:
        self.model = self._described
        self.failure = failure
        self.started = self.tried = False
        self.perfect = False
        # The latest samples contradict what was learned before.
        self.changing = False
        # Of all chunks that still count, each with what was known before it.
        self._contradiction = Contradiction()
        # Root mean square of the residual over the noise, as it was after the start; chunks in a
        # row with much more of it.
        self._usual = 1.0
        self._astray = 0
        # Initial states that were fitted; a fraction where some have been forgotten.
        self._states_fitted = 0.0
        self.statistics = ResidualStatistics(0, 1)
        self.force_noise = ForceNoise.none(len(self.model.estimated))
        self.weighed: WeighedRecord | None = None
        # Complete runs, until there are too many samples to keep, and the one that still grows.
        self._kept: list[Run] | None = []
        self._run: Run | None = None
        self._next_start = FIRST_START
        self._gone_over = 0
        self._reference = self.values
        self._earlier = self._nothing

    @property
    def values(self) -> Reals:
        """Present values of the unknowns."""
        return self.model.values[list(self.model.estimated)]

    @property
    def fitted(self) -> int:
        """Numbers that were fitted to what still counts."""
        return len(self.model.estimated) + round(self._states_fitted)

    @property
    def _nothing(self) -> Information:
        """On the unknowns and the alternatives."""
        return Information.empty(len(self.model.estimated) + len(alternatives_of(self.model)))

    @property
    def tested(self) -> Information:
        """On the unknowns, as differences from the values of `model`, and the alternatives."""
        fit = self._run.fit if self._run is not None else None
        return self._earlier if fit is None else self._earlier.merged(fit.unknowns)

    @property
    def information(self) -> Information:
        """On the unknowns, as differences from the values of `model`."""
        tested = self.tested
        return tested.without(range(len(self.model.estimated), tested.size))

    @property
    def tests(self) -> tuple[ScoreTest, ...]:
        """Of what may be wrong in machine or layout."""
        known = self.statistics.noise[np.isfinite(self.statistics.noise)]
        arithmetic = 1.0 if self.perfect else 0.0
        noise = ScoreNoise(
            # The noisiest channel: which of them a score rests on is not known.
            variance=max(float(known.max(initial=0.0)), QUIETEST) ** 2 if known.size else 1.0,
            arithmetic=arithmetic,
            force_share=self.force_noise.test_share,
            draws=DRAWS,
            force_bias=self.force_noise.test_bias,
        )
        alternatives = alternatives_of(self.model)
        return score_tests(self.tested, len(self.model.estimated), alternatives, noise)

    def add(self, record: MotionRecord, noise: Noise) -> None:
        """
        Go on with samples that follow those before.

        Parameters
        ----------
        record : MotionRecord
        noise : Noise
            Of these samples; that of the force counts where nothing came before.

        """
        # Whole chunks, counted from where the run begins: how the stream arrives changes nothing.
        first = 0
        while first < len(record):
            if self._run is None:
                self._run = Run(record.part(0, 0), noise)
            if not first and not same_noise(noise.covariances, self._run.noise.covariances):
                record = record.with_noise(noise.covariances)
            waiting = sum(map(len, self._run.waiting))
            end = min(first + CHUNK - waiting, len(record))
            self._run.waiting.append(record.part(first, end))
            if waiting + end - first == CHUNK:
                self._run.join()
                self._work(final=False)
            first = end

    def resume(self, state: WeakState) -> None:
        """
        Go on from what was learned before.

        Parameters
        ----------
        state : WeakState

        """
        self.model = self.model.with_unknowns(state.values)
        self._earlier = joined(self._nothing, state.tested or state.information)
        self.started, self.failure = True, ''
        self.statistics = ResidualStatistics.of(state.statistics, state.average)
        self._usual = self.statistics.excess
        self._states_fitted = state.fitted - len(self.model.estimated)
        self.force_noise = state.force_noise
        self.perfect = state.perfect
        self.changing = state.changing
        self._kept = None

    def close(self) -> None:
        """Use up the present run; what comes next does not follow it."""
        if self._run is None:
            return
        self._run.join()
        if self.started:
            self._work(final=True)
        run = self._run
        if run is None:
            return
        self._earlier, run.fit, self._run = self.tested, None, None
        self.statistics.restart()
        if self._kept is not None:
            self._kept.append(run)
            self._let_go()

    def finish(self, start: bool = True) -> None:
        """
        Use whatever samples there are.

        Parameters
        ----------
        start : bool
            Search for a start if there is none yet, however few samples there are; that takes
            its time.

        """
        if self._run is not None:
            self._run.join()
        if self.started or start:
            self._work(final=True)
        if self.started and self._memory is None:
            self._go_over_again_if_moved(last=True)
            while self._advance(final=True):
                pass

    def _work(self, final: bool) -> None:
        if not self.started:
            self._start(final)
        while self.started and self._advance(final):
            self._go_over_again_if_moved()
        self._let_go()

    def _start(self, final: bool) -> None:
        """Try to find values from which a simulation follows the samples kept."""
        count = sum(len(run.record) for run in self._runs)
        if count < self._next_start and not final:
            return
        self.tried = True
        # Later samples may be better ones: never give up.
        self._next_start = min(2 * self._next_start, self._room)
        try:
            for run in self._runs:
                if run.weigh(anew=True):
                    run.skip_rest()
            runs = [run for run in self._runs if run.weigh(anew=True)]
            if runs and not any(run.whole.moves for run in runs):
                self.failure = 'the motion does not stand out of the noise of its sensors'
            elif runs:
                first = runs[0].whole
                records = [run.record for run in runs]
                model = weak_form_start(self._described, records, first.weights, first.function)
                states = [run.state for run in runs if run.state is not None]
                found = search_by_lengths(model, [run.whole for run in runs], states, self._memory)
                self._take(found, runs)
        except (IdentnlError, np.linalg.LinAlgError) as error:
            self.failure = f'no values were found from which a simulation could go on ({error})'

    def _take(self, found: Search, runs: Sequence[Run]) -> None:
        """Go on from where a search has come to."""
        self.failure = found.reason
        self.started = found.converged
        self.statistics = found.statistics
        self._usual, self._astray = found.statistics.excess, 0
        self.weighed = runs[-1].whole
        self.perfect = any(run.whole.weights.perfect for run in runs)
        self.model = found.fits[-1].model
        self._states_fitted = 0.0
        self._earlier = self._nothing
        for run, fit in zip(runs, found.fits, strict=True):
            self._states_fitted += fit.states
            run.state = fit.initial_state
            if run is self._run:
                run.fit, run.position = fit, run.whole.end
            else:
                self._earlier = self._earlier.merged(fit.unknowns)
        self._gone_over = sum(len(run.record) for run in self._runs)
        self._reference = self.values
        self._move()
        if self.started:
            self._weigh_force_noise(max(runs, key=lambda run: len(run.record)))

    def _weigh_force_noise(self, run: Run) -> None:
        """Find what noise of the measured force adds to the errors."""
        whole = run.whole
        if run.state is None:
            return
        noise = run.noise.force
        if np.isnan(noise).any() or (self.perfect and not noise.any()):
            # Where all is perfect, what is not known of the force between its samples matters.
            noise = noise_covariance(run.record.force)
        with suppress(MachineError):
            self.force_noise = force_noise_effect(
                self.model,
                whole.weights.matrices,
                run.record.force[whole.first : whole.first + LONGEST_FORCE_STUDY],
                noise,
                run.record.sample_rate,
                run.state,
                whole.function.stride,
                float(run.record.time[whole.first]),
                alternatives_of(self.model),
            )

    def _advance(self, final: bool) -> bool:
        """Use the next chunk of the present run, if there is one."""
        run = self._run
        if run is None:
            return False
        inside = len(run.record) - FORCE_MARGIN
        try:
            if run.fit is None and (final or inside >= CHUNK) and run.weigh(anew=False):
                self._enter(run)
        except (IdentnlError, np.linalg.LinAlgError) as error:
            self._give_up(run, len(run.record), str(error))
            return False
        end = min(run.position + CHUNK, inside)
        if run.fit is None or end <= run.position or (end < run.position + CHUNK and not final):
            return False
        try:
            self._use(run, run.fit, end)
        except IdentnlError as error:
            self._give_up(run, end, str(error))
            return False
        run.position = end
        return True

    def _use(self, run: Run, fit: ResponseFit, end: int) -> None:
        """Learn from samples up to an end."""
        if self._memory is None:
            deviation = fit.advance(run.record, run.position, end)
            residuals = deviation.after(self._move())
            self.statistics.add(residuals, run.whole.weights.places, deviation.energy)
            return
        share = remembered(self._memory, end - run.position, run.record.sample_rate)
        self._forget(share)
        known = fit.carried_on(self._earlier)
        found = fitted_to_chunk(known, run.record, run.position, end)
        self._concede(found.share)
        self._contradiction = self._contradiction.followed_by(
            found.contradiction, share * found.share
        )
        run.fit, self.model = found.fit, found.fit.model
        self._earlier = self._nothing
        self.statistics.add(found.residuals, run.whole.weights.places, found.energy)
        squares = found.residuals[np.isfinite(found.residuals)] ** 2
        self._require_following(float(np.sqrt(squares.mean())) if squares.size else 0.0)
        # Too little to be seen in a chunk, but always again: the machine changes slowly.
        if self._contradiction.excess(CREEP_CONCESSION_RATE) > 1:
            self._concede(self._contradiction.freedom / self._contradiction.squares)
        self.changing |= self._contradiction.excess(CREEP_ALARM_RATE) > 1

    def _require_following(self, residual: float) -> None:
        """
        Require that the simulation still follows the motion about as well as at the start.

        Parameters
        ----------
        residual : float
            Root mean square over the noise, of the latest chunk.

        Raises
        ------
        MachineError
            If it does not: no step leads from the present values to those of the machine.

        """
        self._astray = self._astray + 1 if residual > ASTRAY * max(1.0, self._usual) else 0
        if self._astray > PATIENCE:
            raise MachineError(
                f'machine {self.model.machine.name}: it has changed so much that the simulation '
                'no longer follows it'
            )

    def _concede(self, share: float) -> None:
        """Let what was learned count less where new samples contradict it."""
        self.changing = share < 1
        if self.changing:
            self._forget(share)
            # Going over samples from before the change would bring it back.
            self._kept = None

    def _forget(self, share: float) -> None:
        """Let all that was learned count less."""
        if share == 1:
            return
        self._earlier = self._earlier.discounted(share)
        if self._run is not None and self._run.fit is not None:
            self._run.fit.tested = self._run.fit.tested.discounted(share)
        self.statistics.discount(share)
        self._states_fitted *= share

    def _give_up(self, run: Run, end: int, reason: str) -> None:
        """Start anew behind samples that cannot be simulated with the present values."""
        self._begin(reason)
        self._run = Run(run.record.part(end, len(run.record)), run.noise)

    def _enter(self, run: Run) -> None:
        """Begin to simulate a run at the present values."""
        self.weighed = run.whole
        if not self.statistics.channels:
            self.statistics = statistics_for(run.whole)
        beginning = run.whole.beginning(CHUNK)
        length = beginning.end - beginning.first
        self._forget(remembered(self._memory, length, run.record.sample_rate))
        found, share = self._begin_fit(beginning)
        self._concede(share)
        (run.fit,) = found.fits
        self._shift_earlier(run.fit.values - self.values)
        self.model = run.fit.model
        run.state, run.position = run.fit.initial_state, beginning.end
        self.statistics.merge(found.statistics)
        if self._memory is not None:
            self._require_following(found.statistics.excess)
        self._states_fitted += run.fit.states
        self._move()

    def _begin_fit(self, beginning: WeighedRecord) -> tuple[Search, float]:
        """Fit the first samples of a run; tell how much what was known before still counts."""
        state, share = beginning.initial_state(), 1.0
        # Of the initial state little is known: the first samples are gone over until it fits.
        found = search_by_lengths(self.model, [beginning], [state], known=self._earlier)
        if self._memory is None:
            return found, share
        for _ in range(CONCESSIONS):
            fit = found.fits[0]
            known = self._earlier.discounted(share)
            known = known.shifted(fit.padded(fit.values - self.values))
            known = known.without(range(len(self.values), known.size))
            excess = Contradiction.between(fit.information, known).excess(FALSE_ALARM_RATE)
            if found.converged and excess <= 1:
                break
            # The machine has changed since the last run.
            share /= max(excess, 1.0 if found.converged else LARGE_CONCESSION)
            known = self._earlier.discounted(share)
            found = search_by_lengths(self.model, [beginning], [state], known=known)
        return found, share

    def _move(self) -> Reals:
        """Linearise about the present estimate; give the step, initial state included."""
        unknowns = self.information.solve().values
        run = self._run
        step = unknowns
        # Where a number would leave its range, the values stay what they are.
        with suppress(MachineError):
            if run is None or run.fit is None:
                self.model = self.model.with_unknowns(self.values + unknowns)
            else:
                step = run.fit.difference(unknowns)
                run.fit.move(step)
                run.state, self.model = run.fit.initial_state, run.fit.model
            self._shift_earlier(unknowns)
        return step

    def _shift_earlier(self, difference: Reals) -> None:
        """Express what was learned before by the differences from other values."""
        count = len(difference)
        offset = padded(difference, count, self._earlier.size - count)
        self._earlier = self._earlier.shifted(offset)

    def _go_over_again_if_moved(self, last: bool = False) -> None:
        count = sum(len(run.record) for run in self._runs)
        if self._kept is None or (count < 2 * self._gone_over and not last):
            return
        moved = np.abs(self.values - self._reference)
        solution = self.information.solve()
        deviation = np.sqrt(np.maximum(np.diag(solution.inverse), 0.0))
        relative = np.where(moved > 0, np.inf, 0.0)
        np.divide(moved, np.abs(self.values), out=relative, where=self.values != 0)
        if np.all((moved <= WORTH_A_PASS * deviation) | solution.free | (relative <= NEGLIGIBLE)):
            return
        largest = float(relative[~solution.free].max(initial=0.0))
        if last and largest * solution.condition_number <= WORTH_A_LAST_PASS:
            return
        # Where it does not help, not again at every chunk.
        self._gone_over = count
        runs = [run for run in self._runs if run.weigh(anew=False)]
        with suppress(IdentnlError):
            states = [run.state for run in runs if run.state is not None]
            records = [run.whole for run in runs]
            found = search(self.model, records, states, self._memory, WORTH_A_PASS)
            if found.converged:
                self._take(found, runs)

    def _let_go(self) -> None:
        """Keep no more samples than memory is meant for."""
        if sum(len(run.record) for run in self._runs) > self._room:
            if self.started and self._kept is not None:
                self._kept = None
            elif self._kept:
                self._kept = self._kept[1:]
            elif self._run is not None and (not self.started or self._run.fit is None):
                count = len(self._run.record)
                self._run.record = self._run.record.part(count - self._room // 2, count)
        run = self._run
        if self._kept is None and run is not None and run.fit is not None:
            used = max(run.position - FORCE_MARGIN, 0)
            run.record = run.record.part(used, len(run.record))
            run.position -= used

    @property
    def _room(self) -> int:
        """Samples to keep."""
        runs = self._runs
        if self._memory is None or not runs:
            return KEPT
        wanted = KEPT_MEMORIES * self._memory * runs[-1].record.sample_rate
        return int(np.clip(wanted, 2 * FIRST_START, KEPT))

    @property
    def _runs(self) -> list[Run]:
        """All runs that are kept, the open one last."""
        return [*(self._kept or []), *([] if self._run is None else [self._run])]

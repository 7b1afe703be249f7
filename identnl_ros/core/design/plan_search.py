# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Which of several plans brings every parameter under a wanted error, and after how long."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from identnl_ros.core.design.design import Outlook, outlook
from identnl_ros.core.design.plan import Plan
from identnl_ros.core.errors import MachineError
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.model import Model
import numpy as np

# Plans whose durations differ by this factor at most are equally good: the gentler force decides.
ALIKE = 1.1


@dataclass(frozen=True)
class Candidate:
    """
    One plan of a comparison.

    Parameters
    ----------
    outlook : Outlook
        For the duration needed; for the stretch computed where that is infinite.
    needed : float
        Duration for every parameter to be exact enough, in whole cycles of the force [s];
        infinite if a parameter is not identifiable.

    """

    outlook: Outlook
    needed: float


@dataclass(frozen=True)
class Comparison:
    """
    Plans compared for a wanted error.

    Parameters
    ----------
    wanted : float
        Relative standard deviation of every parameter [-].
    longest : float
        Duration that is allowed [s].
    candidates : tuple of Candidate
        In the order of the plans.
    failures : tuple of str
        Plans that cannot be simulated, and why.

    Raises
    ------
    ValueError
        If there is no candidate.

    """

    wanted: float
    longest: float
    candidates: tuple[Candidate, ...]
    failures: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse to compare nothing."""
        if not self.candidates:
            raise ValueError('no plan to compare')

    @property
    def best(self) -> Candidate:
        """
        The plan to advise.

        The shortest of those that are not too strong; where several take about as long, or no
        longer than the longest cycle of all, the gentlest; of equals the first. Without any that
        meets the error, the one closest to it.
        """
        advisable = [one for one in self.candidates if one.outlook.plan.advisable]
        advisable = advisable or list(self.candidates)
        shortest = min(one.needed for one in advisable)
        if np.isfinite(shortest):
            cycle = max(one.outlook.plan.cycle for one in self.candidates)
            short = max(ALIKE * shortest, cycle)
            alike = [one for one in advisable if one.needed <= short]
            return min(alike, key=lambda one: max(one.outlook.plan.amplitudes.values()))
        return min(advisable, key=_distance)

    @property
    def attainable(self) -> bool:
        """Whether the plan to advise meets the error if it only lasts long enough."""
        return bool(np.isfinite(self.best.needed))

    @property
    def met(self) -> bool:
        """Whether it does so within the duration allowed."""
        return self.attainable and self.best.needed <= self.longest


def compare(
    model: Model,
    layout: Layout,
    plans: Sequence[Plan],
    wanted: float,
    longest: float = np.inf,
    advance: Callable[[float], None] = lambda part: None,
) -> Comparison:
    """
    Compute every plan once, for its duration, and scale it to the duration it needs.

    The plan to advise is computed again where it needs less than was computed.

    Parameters
    ----------
    model : Model
        The values expected.
    layout : Layout
        With the noise of every sensor of motion.
    plans : sequence of Plan
        At least one; each with the duration to compute, whole cycles of its force.
    wanted : float
        Relative standard deviation of every parameter [-].
    longest : float
        Duration that is allowed [s].
    advance : callable
        Called with 1 after every plan.

    Returns
    -------
    Comparison

    Raises
    ------
    LayoutError
        If a noise is not stated, or a sensor does not fit the machine.
    MachineError
        If no plan can be simulated.

    """
    found: list[Outlook] = []
    failures: list[str] = []
    for plan in plans:
        try:
            found.append(outlook(model, layout, plan))
        except MachineError as error:
            failures.append(str(error))
        advance(1)
    if not found:
        raise MachineError(failures[0])
    candidates = [_candidate(one, wanted) for one in found]
    best = Comparison(wanted, longest, tuple(candidates)).best
    place = next(i for i, one in enumerate(candidates) if one is best)
    if best.needed < found[place].computed:
        candidates[place] = _confirmed(model, layout, best, wanted, found[place])
    return Comparison(wanted, longest, tuple(candidates), tuple(failures))


def _candidate(found: Outlook, wanted: float) -> Candidate:
    needed = found.duration_needed(wanted)
    return Candidate(found.lasting(needed) if np.isfinite(needed) else found, needed)


def _confirmed(
    model: Model, layout: Layout, best: Candidate, wanted: float, computed: Outlook
) -> Candidate:
    """Compute a run that is shorter than the one scaled from, lengthening it as needed."""
    duration = best.needed
    while duration < computed.computed:
        found = outlook(model, layout, computed.plan.lasting(duration))
        if found.expectation.meets(wanted):
            return Candidate(found, duration)
        identifiable = found.expectation.identifiable
        longer = (found.expectation.worst / wanted) ** 2 if identifiable else 2.0
        duration = computed.plan.whole_cycles(duration * max(longer, 1.1))
    return Candidate(computed, computed.computed)


def _distance(candidate: Candidate) -> tuple[int, float]:
    found = candidate.outlook.expectation
    return sum(not one.identifiable for one in found.parameters), found.worst

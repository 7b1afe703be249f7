# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
What a planned run would determine, how long it must last, and which sensors it needs.

All from the Cramer-Rao bound at the values expected: no unbiased estimate is more exact.
"""

from dataclasses import dataclass, replace

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.design.plan import Plan
from identnl_ros.core.design.planned_run import PlannedRun
from identnl_ros.core.design.sensor_information import sensor_information, SensorInformation
from identnl_ros.core.errors import MachineError
from identnl_ros.core.estimation.combinations import Combination, determined_combinations
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.model import Model
import numpy as np


@dataclass(frozen=True)
class ExpectedParameter:
    """
    One unknown of a planned run.

    Parameters
    ----------
    name, symbol, unit : str
        As in `Parameter`.
    value : float
        Expected [unit].
    standard_deviation : float
        The smallest possible one of its estimate [unit]; NaN if it is not identifiable.
    identifiable : bool
        By itself, not only in a combination with others.

    """

    name: str
    symbol: str
    unit: str
    value: float
    standard_deviation: float
    identifiable: bool

    @property
    def relative(self) -> float:
        """Standard deviation over value [-]; NaN for a value of 0 or without either."""
        return self.standard_deviation / abs(self.value) if self.value else float('nan')


@dataclass(frozen=True)
class Expectation:
    """
    What a run would tell of the unknowns.

    Parameters
    ----------
    parameters : tuple of ExpectedParameter
    combinations : tuple of Combination
        What is determined where single parameters are not.
    condition_number : float
        Of the column-scaled information's root.

    """

    parameters: tuple[ExpectedParameter, ...]
    combinations: tuple[Combination, ...]
    condition_number: float

    @property
    def identifiable(self) -> bool:
        """Whether every parameter is."""
        return all(one.identifiable for one in self.parameters)

    @property
    def bottleneck(self) -> ExpectedParameter | None:
        """The identifiable parameter of the largest relative error; None: there is none."""
        judged = [one for one in self.parameters if np.isfinite(one.relative)]
        return max(judged, key=lambda one: one.relative, default=None)

    @property
    def worst(self) -> float:
        """Largest relative standard deviation of the identifiable parameters [-]."""
        return self.bottleneck.relative if self.bottleneck else 0.0

    def meets(self, wanted: float) -> bool:
        """
        Tell whether every parameter is identifiable and exact enough.

        Parameters
        ----------
        wanted : float
            Relative standard deviation [-]; a parameter with the value 0 has none and counts
            as exact enough.

        Returns
        -------
        bool

        """
        return self.identifiable and self.worst <= wanted

    def repeated(self, times: float) -> 'Expectation':
        """
        Expect more data of the same sort: information grows in proportion.

        Parameters
        ----------
        times : float
            As much data as now [-].

        Returns
        -------
        Expectation

        """
        return replace(
            self,
            parameters=tuple(
                replace(one, standard_deviation=one.standard_deviation / np.sqrt(times))
                for one in self.parameters
            ),
        )


@dataclass(frozen=True)
class Outlook:
    """
    A plan and what is to be expected of it.

    Parameters
    ----------
    plan : Plan
    expectation : Expectation
        For the whole duration of the plan.
    sensors : SensorInformation
        Of the stretch computed.
    computed : float
        Length of this stretch [s].
    relief : dict of str to float
        As in `PlannedRun.relief`.

    """

    plan: Plan
    expectation: Expectation
    sensors: SensorInformation
    computed: float
    relief: dict[str, float]

    @property
    def keeps_contact(self) -> bool:
        """Whether no joint is relieved of all its compression at rest."""
        return all(relieved < 1 for relieved in self.relief.values())

    def lasting(self, duration: float) -> 'Outlook':
        """
        Expect a longer or shorter run: after settling, information grows linearly with time.

        For a steady response to a periodic force and a duration of whole multiples of the
        stretch computed this errs to the safe side only: the stretches one by one, each with an
        initial state of its own, tell no more than the whole.

        Parameters
        ----------
        duration : float
            [s].

        Returns
        -------
        Outlook

        """
        return replace(
            self,
            plan=self.plan.lasting(duration),
            expectation=self.expectation.repeated(duration / self.plan.duration),
        )

    def duration_needed(self, wanted: float) -> float:
        """
        Find how long the run must be for every parameter to be exact enough.

        Parameters
        ----------
        wanted : float
            Relative standard deviation [-].

        Returns
        -------
        float
            Whole cycles of the force [s]; infinite if a parameter is not identifiable.

        """
        if not self.expectation.identifiable:
            return float('inf')
        times = (self.expectation.worst / wanted) ** 2
        return self.plan.whole_cycles(times * self.plan.duration)


def expectation(model: Model, information: Information) -> Expectation:
    """
    Say what information means for every unknown.

    Parameters
    ----------
    model : Model
    information : Information
        On the model's unknowns, rows in units of their noise.

    Returns
    -------
    Expectation

    """
    solution = information.solve()
    unknowns = [model.parameters[index] for index in model.estimated]
    deviations = np.where(solution.free, np.nan, np.sqrt(np.diag(solution.inverse)))
    parameters = tuple(
        ExpectedParameter(
            one.name, one.symbol, one.unit, one.value, float(deviation), not bool(free)
        )
        for one, deviation, free in zip(unknowns, deviations, solution.free, strict=True)
    )
    names = [one.name for one in unknowns]
    combinations = determined_combinations(solution.null_space, solution.free, names)
    return Expectation(parameters, tuple(combinations), solution.condition_number)


def outlook(model: Model, layout: Layout, plan: Plan, at_most: float = np.inf) -> Outlook:
    """
    Compute what a planned run would tell.

    Parameters
    ----------
    model : Model
        The values expected.
    layout : Layout
        With the noise of every sensor of motion.
    plan : Plan
    at_most : float
        Of a longer run whole cycles of about this length are computed, and the rest scaled [s].

    Returns
    -------
    Outlook

    Raises
    ------
    DataError
        If there would be fewer than two samples.
    LayoutError
        If a noise is not stated, or a sensor does not fit the machine.
    MachineError
        If there is no exciter, nothing to be estimated or a value is missing, or the motion
        grows without bound.

    """
    _require_plannable(model)
    computed = min(plan.duration, plan.whole_cycles(min(at_most, plan.duration)))
    run = PlannedRun(
        model, layout, plan.signals, plan.sample_rate, computed, plan.settling
    )  # fmt: skip
    sensors = sensor_information(run)
    found = Outlook(
        plan.lasting(computed), expectation(model, sensors.together()), sensors, computed,
        run.relief(),
    )  # fmt: skip
    return found if computed == plan.duration else found.lasting(plan.duration)


def _require_plannable(model: Model) -> None:
    name = model.machine.name
    if not model.estimated:
        raise MachineError(
            f'machine {name}: nothing is to be estimated; mark what a run is to find out '
            '"{estimate: VALUE}"'
        )
    if not model.machine.excitations:
        raise MachineError(
            f'machine {name}: no exciter; list at least one under the key excitations'
        )
    model.require_values()

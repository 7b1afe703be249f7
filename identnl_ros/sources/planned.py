# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Plans for a machine's exciters, from what is asked for and what its file says."""

from dataclasses import dataclass, replace

from identnl_ros.core.design.plan import Plan
from identnl_ros.core.errors import DataError
from identnl_ros.core.mechanics.machine import ExcitationPoint, Machine
from identnl_ros.sources.simulated import (
    Excitation,
    excitation_signals,
    IMPULSE_INTERVAL,
    SWEEP_DURATION,
    TestRun,
)
import numpy as np

# To compare when no excitation is asked for; the first is preferred among equals.
COMPARED = (Excitation.MULTISINE, Excitation.SWEEP, Excitation.SINE)
FACTORS = (1 / 3, 1.0, 3.0)
# Length to compute of each plan that is compared [s], rounded up to whole cycles of the force.
STRETCH = 0.5


@dataclass(frozen=True)
class PlanSettings:
    """
    What is asked of a run.

    Parameters
    ----------
    sample_rate : float
        [Hz].
    settling : float
        From rest to the first sample used [s].
    amplitude, frequency : float or None
        Of every exciter [N], [Hz]; None: as in the machine file.
    band : tuple of float or None
        Of a multisine or sweep [Hz]; None: as in the machine file.
    period : float
        Of a multisine [s].
    seed : int
        Of the phases of a multisine, as in `TestRun`.

    Raises
    ------
    DataError
        If a number is out of range.

    """

    sample_rate: float
    settling: float = 1.0
    amplitude: float | None = None
    frequency: float | None = None
    band: tuple[float, float] | None = None
    period: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Check what `TestRun` does not."""
        if not (np.isfinite(self.settling) and self.settling >= 0):
            raise DataError(f'plan: settling is {self.settling}, expected 0 or a positive time')


def plan(
    machine: Machine,
    settings: PlanSettings,
    excitation: Excitation,
    duration: float,
    factor: float = 1.0,
    advisable: bool = True,
) -> Plan:
    """
    Plan one run.

    Parameters
    ----------
    machine : Machine
    settings : PlanSettings
    excitation : Excitation
        Not a recorded one.
    duration : float
        [s].
    factor : float
        On the amplitude of every exciter [-].
    advisable : bool
        As in `Plan`.

    Returns
    -------
    Plan

    Raises
    ------
    DataError
        If a number is out of range, or a frequency too high for the sample rate.

    """
    run = TestRun(
        excitation, duration, settings.sample_rate, seed=settings.seed,
        amplitude=settings.amplitude, frequency=settings.frequency, band=settings.band,
        period=settings.period,
    )  # fmt: skip
    points = tuple(_excited(point, settings, factor) for point in machine.excitations)
    as_set = replace(run, amplitude=None, frequency=None, band=None)
    bands = [_band(point, excitation) for point in points]
    return Plan(
        excitation=excitation.value,
        signals=excitation_signals(points, as_set),
        amplitudes={point.name: point.amplitude for point in points},
        band=(
            min((low for low, _ in bands), default=0),
            max((top for _, top in bands), default=0),
        ),
        cycle=_cycle(points, run),
        sample_rate=settings.sample_rate,
        duration=duration,
        settling=settings.settling,
        advisable=advisable,
    )


def plans_to_compare(
    machine: Machine,
    settings: PlanSettings,
    excitation: Excitation | None = None,
    largest_amplitude: float | None = None,
) -> list[Plan]:
    """
    Plan runs of several excitations and amplitudes.

    Parameters
    ----------
    machine : Machine
    settings : PlanSettings
        With an amplitude: only this one.
    excitation : Excitation or None
        The only one to consider; None: multisine, sweep and sine.
    largest_amplitude : float or None
        Of any exciter [N]; None: larger ones than the machine file's are for comparison only.

    Returns
    -------
    list of Plan
        Each with a duration that suffices to compute its information per time.

    Raises
    ------
    DataError
        If a number is out of range, or a frequency too high for the sample rate.

    """
    if largest_amplitude is not None and not 0 < largest_amplitude < np.inf:
        raise DataError(
            f'plan: largest amplitude is {largest_amplitude} N, expected a positive number'
        )
    factors: tuple[float, ...] = FACTORS if settings.amplitude is None else (1.0,)
    if largest_amplitude is not None:
        strongest = max(
            (settings.amplitude or point.amplitude for point in machine.excitations), default=1.0
        )
        limit = largest_amplitude / strongest
        factors = tuple(sorted({min(factor, limit) for factor in factors}))
    plans = []
    for kind in COMPARED if excitation is None else (excitation,):
        for factor in factors:
            advisable = factor <= 1 or largest_amplitude is not None
            made = plan(machine, settings, kind, STRETCH, factor, advisable)
            plans.append(made.lasting(made.whole_cycles(STRETCH)))
    return plans


def _excited(point: ExcitationPoint, settings: PlanSettings, factor: float) -> ExcitationPoint:
    return replace(
        point,
        amplitude=factor * (settings.amplitude or point.amplitude),
        frequency=settings.frequency or point.frequency,
        band=settings.band or point.band,
    )


def _band(point: ExcitationPoint, excitation: Excitation) -> tuple[float, float]:
    if excitation is Excitation.SINE:
        return point.frequency, point.frequency
    # A blow contains all frequencies up to about that of its contact time.
    return (0.0, point.band[1]) if excitation is Excitation.IMPULSE else point.band


def _cycle(points: tuple[ExcitationPoint, ...], run: TestRun) -> float:
    match run.excitation:
        case Excitation.SINE:
            return max((1 / point.frequency for point in points), default=1.0)
        case Excitation.MULTISINE:
            return run.period
        case Excitation.SWEEP:
            return SWEEP_DURATION
        case _:
            return IMPULSE_INTERVAL

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A model brought as close to a record as it can come: Gauss-Newton about a nominal motion."""

from dataclasses import dataclass, replace

from identnl_ros.core.discrepancy.changed_number import changed
from identnl_ros.core.discrepancy.comparison import Comparison, State
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Hypothesis
from identnl_ros.core.discrepancy.evidence import Evidence, real_rows
from identnl_ros.core.discrepancy.machine_columns import with_numbers
from identnl_ros.core.errors import MachineError
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

PASSES = 12
# Steps in a row that make nothing better, after which there is no hope.
PATIENCE = 3
HALVINGS = 6
# The last step may be this many standard errors (root mean square): convergence is quadratic, the
# error that is left after it is far smaller.
SMALL_STEP = 0.3
# Relative change of a noise that is no change.
SAME_NOISE = 0.01
# Directions of the unknowns that the data see less than this, relatively, are left alone.
UNSEEN = 1e-9
# Factor by which a positive number may change in a step, and steps where some are not seen.
LARGEST_CHANGE = 3.0
UNSEEN_PASSES = 14
# Times that what is left may grow in a step, beyond which the step is too long.
GROWTH = 1.5
# Beyond this, responses to a step cannot be told from growth without bound.
LARGEST = 1e30


@dataclass(frozen=True)
class Liberties:
    """
    What a fit may change beyond the values of the machine's unknowns, which stay positive.

    Parameters
    ----------
    either_sign : frozenset of str
        Parts whose coefficients may be negative.
    numbers : tuple of Hypothesis
        Changes of numbers inside elements, see `numbers_to_fit`.

    """

    either_sign: frozenset[str] = frozenset()
    numbers: tuple[Hypothesis, ...] = ()


@dataclass(frozen=True)
class SettledModel:
    """
    A description with the values that fit a record best.

    Parameters
    ----------
    description : Description
    model : Model
        Assembled from its machine, with these values.
    comparison : Comparison
        Of the record, about the last nominal motion.
    deviations : ndarray, shape (n_unknowns,)
        Standard deviations of the unknowns, as in `Model.estimated` [SI].
    excess : float
        Mean square of what is left, over that of noise.
    freedom : int
        Degrees of freedom of that.
    state : State
        At the first sample compared.
    liberties : Liberties
    number_deviations : ndarray
        Standard deviations of the numbers inside elements that were fitted.

    """

    description: Description
    model: Model
    comparison: Comparison
    deviations: Reals
    excess: float
    freedom: int
    state: State
    liberties: Liberties
    number_deviations: Reals

    @property
    def cost(self) -> float:
        """Sum of squares of what is left, in units of the noise."""
        return self.excess * self.freedom

    @property
    def is_noise(self) -> bool:
        """What is left is noise, as far as its size tells."""
        return self.excess < 1 + ROUGHNESS + TOLERANCE * float(np.sqrt(2 / self.freedom))


# Standard deviations of the mean square that are let pass, and what the estimate of the noise
# itself may be wrong by.
TOLERANCE = 3.0
ROUGHNESS = 0.01


def settled(
    description: Description,
    model: Model,
    record: MeasuredRecord,
    state: State | None = None,
    held: bool = False,
    passes: int = PASSES,
    noise: Reals | None = None,
    liberties: Liberties = Liberties(),
) -> SettledModel:
    """
    Improve the unknowns and the initial state until they fit the record.

    Parameters
    ----------
    description : Description
    model : Model
        Assembled from its machine; its values are the start.
    record : MeasuredRecord
    state : State or None
        Initial state to start from; None: from the first samples.
    held : bool
        The unknowns stay; only the initial state is improved.
    passes : int
        At most.
    noise : ndarray, shape (n_motion_sensors,), or None
        Of one reading [SI]; None: read off the data, anew for the result.
    liberties : Liberties

    Returns
    -------
    SettledModel

    Raises
    ------
    MachineError
        If the motion grows without bound with the values to start from.

    """
    fixed = noise is not None
    best: SettledModel | None = None
    unseen = _unseen_parts(model, record)
    if unseen and not held:
        passes = max(passes, UNSEEN_PASSES)
    point = _Point(description, model, state)
    base, step, lost = point, np.zeros(0), 0
    comparison: Comparison | None = None
    for _ in range(passes):
        comparison = Comparison(
            point.description, point.model, record, point.state, noise, comparison
        )
        noise = comparison.deviation
        solved = _solved(comparison, held, liberties)
        if best is not None and (solved is None or solved.left > GROWTH * best.cost):
            # Too far: the linearisation does not hold.
            step, lost = step / 2, lost + 1
            if lost == PATIENCE:
                break
            point = _after(base, step, held, liberties)
            continue
        if solved is None:
            raise MachineError(
                f'machine {model.machine.name}: its motion grows without bound with the values to '
                'start from; give other start values'
            )
        motion = comparison.motion
        begin = State(motion.displacement[0], motion.velocity[0], comparison.state.hidden)
        base, step = replace(point, state=begin), solved.step
        point = _after(base, step, held, liberties)
        assert point.state is not None
        change = solved.step.copy()
        unknowns = len(model.estimated)
        flat = point.state.flat
        change[unknowns : unknowns + len(flat)] = flat - comparison.state.flat
        if best is None or solved.left < best.cost:
            best = _settled_at(point, comparison, solved, liberties)
        lost = 0 if best.comparison is comparison else lost + 1
        if np.sqrt(np.mean((change / solved.spread) ** 2)) < SMALL_STEP or lost == PATIENCE:
            break
    assert best is not None
    return best if fixed else with_noise_anew(best, record, held)


@dataclass(frozen=True)
class _Point:
    """Where the search is."""

    description: Description
    model: Model
    state: State | None


def _settled_at(
    point: _Point, comparison: Comparison, solved: '_Solved', liberties: Liberties
) -> SettledModel:
    freedom = solved.rows - len(solved.step)
    numbers = len(liberties.numbers)
    assert point.state is not None
    return SettledModel(
        point.description, point.model, comparison,
        solved.spread[: len(point.model.estimated)], solved.left / freedom, freedom,
        point.state, liberties, solved.spread[len(solved.spread) - numbers :],
    )  # fmt: skip


def with_noise_anew(
    settled: SettledModel, record: MeasuredRecord, held: bool = False
) -> SettledModel:
    """
    Read the noise off what is left in the end, and judge by that.

    Parameters
    ----------
    settled : SettledModel
    record : MeasuredRecord
    held : bool
        Only the initial state was fitted.

    Returns
    -------
    SettledModel

    """
    noise = settled.comparison.noise()
    if np.allclose(noise, settled.comparison.deviation, rtol=SAME_NOISE):
        return settled
    comparison = Comparison(
        settled.description, settled.model, record, settled.state, noise, settled.comparison
    )
    solved = _solved(comparison, held, settled.liberties)
    if solved is None:
        return settled
    point = _Point(settled.description, settled.model, settled.state)
    return _settled_at(point, comparison, solved, settled.liberties)


@dataclass(frozen=True)
class _Solved:
    """One linear regression: its step, with standard deviations, and what that leaves."""

    step: Reals
    spread: Reals
    left: float
    rows: int


def _solved(comparison: Comparison, held: bool, liberties: Liberties) -> _Solved | None:
    """
    Solve the regression by the unknowns, the initial state and numbers inside elements.

    None where the linearised motion grows without bound.
    """
    if comparison.failed:
        return None
    with np.errstate(over='ignore', invalid='ignore'):
        evidence = with_numbers(Evidence(comparison), () if held else liberties.numbers)
    unknowns = len(comparison.model.estimated)
    table = real_rows(evidence.base[unknowns:] if held else evidence.base)
    motion = evidence.channels.count
    residual = real_rows(evidence.residual[None, :motion])[0]
    largest = max(np.abs(table).max(initial=0.0), np.abs(residual).max())
    if not largest < LARGEST:
        return None
    step, deviations, unexplained = _step(table.T, residual)
    # Not the difference of two squares, of which little may be left.
    left = float(np.sum(np.abs(evidence.residual[motion:]) ** 2)) + unexplained
    if held:
        own, more = np.zeros(unknowns), np.zeros(len(liberties.numbers))
        step = np.concatenate((own, step, more))
        deviations = np.concatenate((own + np.inf, deviations, more + np.inf))
    return _Solved(step, deviations, left, evidence.rows)


def _after(base: _Point, step: Reals, held: bool, liberties: Liberties) -> _Point:
    """Go a step."""
    model, description, state = base.model, base.description, base.state
    assert state is not None
    unknowns, rest = len(model.estimated), len(step) - len(liberties.numbers)
    state = state.moved(step[unknowns:rest])
    if held:
        return replace(base, state=state)
    moved = _moved(model, step[:unknowns].copy(), liberties.either_sign)
    if liberties.numbers:
        for change, one in zip(liberties.numbers, step[rest:], strict=True):
            description = changed(change, description, one)
        moved = start_of(description, {one.name: one.value for one in moved.parameters})
    return _Point(description, moved, state)


def _unseen_parts(model: Model, record: MeasuredRecord) -> frozenset[str]:
    """Find bodies on which there is no sensor, and their joints."""
    sensors = record.layout.sensors
    seen = {body for one in sensors for body in (one.body, one.reference_body) if body}
    bodies = {body.name for body in model.machine.bodies} - seen
    joints = {
        joint.name
        for joint in model.machine.joints
        if joint.body in bodies or joint.other_body in bodies
    }
    return frozenset(bodies | joints)


def start_of(description: Description, values: dict[str, float]) -> Model:
    """
    Assemble a machine and give its unknowns start values.

    Parameters
    ----------
    description : Description
    values : dict of str to float
        By the names of parameters [SI]; others keep those of the description.

    Returns
    -------
    Model

    """
    model = assemble(description.machine)
    numbers = model.values
    for i in model.estimated:
        name = model.parameters[i].name
        if name in values:
            numbers[i] = values[name]
    return model.with_values(numbers)


def _step(base: Reals, residual: Reals) -> tuple[Reals, Reals, float]:
    """Solve the regression: the step, its standard deviations, what it leaves."""
    lengths = np.linalg.norm(base, axis=0)
    lengths[lengths == 0] = 1.0
    basis, triangle = np.linalg.qr(base / lengths)
    left, sizes, right = np.linalg.svd(triangle)
    used = sizes > UNSEEN * sizes.max(initial=0.0)
    part = left[:, used].T @ (basis.T @ residual)
    inverse = right[used].T / sizes[used]
    deviations = np.sqrt((inverse**2).sum(axis=1)) / lengths
    deviations[deviations == 0] = np.inf
    rest = residual - basis @ (left[:, used] @ part)
    return inverse @ part / lengths, deviations, float(rest @ rest)


def _moved(model: Model, step: Reals, either_sign: frozenset[str]) -> Model:
    """Go as much of a step as the machine allows."""
    values = model.values[list(model.estimated)]
    for i, index in enumerate(model.estimated):
        # What an incomplete model makes of its unknowns, and motion that no sensor sees, can go
        # astray.
        if model.parameters[index].name.split('.')[0] not in either_sign and values[i] > 0:
            low, high = values[i] / LARGEST_CHANGE, values[i] * LARGEST_CHANGE
            step[i] = np.clip(values[i] + step[i], low, high) - values[i]
    for _ in range(HALVINGS):
        try:
            moved = model.with_unknowns(values + step)
            if np.all(moved.mass_diagonal() > 0):
                return moved
        except MachineError:
            pass
        step = step / 2
    return model

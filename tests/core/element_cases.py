# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Oscillators with one element each, and their laws written down once more."""

from dataclasses import dataclass

from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.elements import Element
from identnl_ros.core.simulation.simulation import Simulation, steps_per_sample
import numpy as np
from scipy.integrate import solve_ivp

from tests.core.machines import known, ORIGIN, oscillator, unknown

MASS, STIFFNESS, DAMPING = 10.0, 4e5, 200.0


def element(kind, coefficient, name='extra', axis=1, **numbers):
    """Build an element along the axis of the spring of `oscillator`."""
    return Element(
        name, 'block', 'ground', ORIGIN, np.eye(3), kind, axis, coefficient,
        {key: one if hasattr(one, 'tie') else known(one) for key, one in numbers.items()},
    )  # fmt: skip


@dataclass(frozen=True)
class Case:
    """An element: its coefficient, its other numbers, its force per unit of coefficient."""

    kind: str
    coefficient: float
    numbers: dict
    law: object = None

    def model(self, estimated=False, **more):
        coefficient = (unknown if estimated else known)(self.coefficient)
        one = element(self.kind, coefficient, **self.numbers)
        return assemble(oscillator(more_joints=(one,), **more))


CASES = {
    'coulomb_friction': Case(
        'coulomb_friction', 2.0, {'transition_velocity': 1e-4},
        lambda d, v: np.tanh(v / 1e-4),
    ),
    'stribeck_friction': Case(
        'stribeck_friction', 1.5, {'transition_velocity': 1e-4, 'stribeck_velocity': 6e-4},
        lambda d, v: np.tanh(v / 1e-4) / np.exp(v * v / 3.6e-7),
    ),
    'quadratic_damping': Case('quadratic_damping', 2e5, {}, lambda d, v: np.copysign(v * v, v)),
    'backlash': Case(
        'backlash', 3e5, {'gap': 4e-6},
        lambda d, v: d if abs(d) > 9e9 else (-d if abs(d) < 4e-6 else -np.copysign(4e-6, d)),
    ),
    'bilinear_stiffness': Case(
        'bilinear_stiffness', 5e5, {'gap': -3e-6},
        lambda d, v: (d if d > -3e-6 else -3e-6),
    ),
    'hysteresis': Case('hysteresis', 4e5, {'limit': 5e-6, 'exponent': 2.0}),
}  # fmt: skip


def simulated(model, signal, count, interval=1e-3, start=(0.0, 0.0)):
    """Return displacement and velocity of a one-body machine."""
    place, rate = (np.array([one]) for one in start)
    steps = steps_per_sample(model, place[np.newaxis], interval)
    run = Simulation(model, (signal,), interval, place, rate, steps)
    displacement, velocity, _ = run.advance(count)
    return displacement[0, :, 0], velocity[0, :, 0], run


def independent(case, signal, count, interval=1e-3, start=(0.0, 0.0)):
    """Integrate the same oscillator with scipy, the equations written anew."""
    size = np.array([1e-6, 1e-4, 1e-6])

    def slopes(time, scaled):
        d, v, z = scaled * size
        force = signal.on_grid(time, 1.0, 1)[0] - STIFFNESS * d - DAMPING * v
        if case.law is not None:
            return np.array([v, (force - case.coefficient * case.law(d, v)) / MASS, 0.0]) / size
        limit, exponent = case.numbers['limit'], case.numbers['exponent']
        share = abs(z / limit) ** exponent if v * z > 0 else 0.0
        return np.array([v, (force - case.coefficient * z) / MASS, v * (1 - share)]) / size

    solution = solve_ivp(
        slopes, (0, (count - 1) * interval), np.array([*start, 0.0]) / size, method='DOP853',
        t_eval=np.arange(count) * interval, rtol=1e-11, atol=1e-9, max_step=interval / 20,
    )  # fmt: skip
    assert solution.success
    return solution.y.T * size

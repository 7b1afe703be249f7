# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Speed and accuracy on the paper's problem, against peers in the same run.

Machines are noisy: read medians and ratios. Run by `make bench`.
"""

from collections.abc import Callable
import json
from pathlib import Path
import platform
import statistics
import subprocess
import sys
import tempfile
import time

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.estimation.regression import PointwiseRegression
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.pointwise.pointwise_identifier import PointwiseIdentifier
from identnl_ros.core.quality.monitor import monitored, QualityMonitor
from identnl_ros.core.simulation.excitation import sine
from identnl_ros.core.simulation.simulation import Simulation, steps_per_sample
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.machine_file import load_machine
from identnl_ros.storage.shipped import shipped_config
import numba
import numpy as np
from rich.console import Console
from rich.table import Table
import scipy
from scipy.integrate import solve_ivp

PAPER_SECONDS = 40.0  # Berczynski et al. (2010), section 4.2
DURATION = 2.0  # [s]
RATE = 10_000.0  # [Hz]
RUNS = 7


def median_seconds(action: Callable[[], object], runs: int = RUNS) -> float:
    """Time an action a few times after a warm-up."""
    action()
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def identnl(*arguments: str, check: bool = True) -> str:
    """Run the command line as a whole process."""
    script = Path(sys.executable).with_name('identnl')
    return subprocess.run(
        [str(script), *arguments], check=check, capture_output=True, text=True
    ).stdout


def worst_error(values: np.ndarray, model: Model) -> float:
    """Largest relative error of the estimated parameters."""
    truth = model.values[list(model.estimated)]
    return float(np.abs(values / truth - 1).max())


def identification(bag_path: Path, machine_path: Path, table: Table) -> None:
    """Whole process, its parts, and other solvers on the same rows."""
    model = assemble(load_machine(machine_path).machine)
    command = ('identify', str(bag_path), '--estimator', 'pointwise', '--json')
    whole = median_seconds(lambda: identnl(*command))
    document = json.loads(identnl(*command))
    values = np.array([parameter['value'] for parameter in document['parameters']])

    def read():
        bag = open_bag(bag_path)
        return bag.description, list(bag.blocks())

    description, blocks = read()

    def judged():
        monitor = QualityMonitor(description.layout, description.sample_rate, model)
        return list(monitored(blocks, monitor))

    def transformed():
        transform = MotionTransform(model, description.layout, description.sample_rate)
        return [motion for block in blocks if (motion := transform.add(block)) is not None]

    motions = transformed()

    def identified():
        identifier = PointwiseIdentifier(model)
        for motion in motions:
            identifier.add(motion)
        return identifier.estimate()

    regression = PointwiseRegression(model)
    regressor, target = regression.rows(
        *(
            np.concatenate([getattr(motion, name) for motion in motions])
            for name in ('displacement', 'velocity', 'acceleration', 'force')
        )
    )

    def normal_equations():
        return np.linalg.solve(regressor.T @ regressor, regressor.T @ target)

    def lstsq():
        return np.linalg.lstsq(regressor, target, rcond=None)[0]

    def gelsy():
        return scipy.linalg.lstsq(regressor, target, lapack_driver='gelsy')[0]

    def orthogonal():
        information = Information.empty(regression.size)
        for part in range(0, len(target), 24_576):
            chunk = slice(part, part + 24_576)
            information = information.with_rows(regressor[chunk], target[chunk])
        return information.solve().values

    lstsq_time = median_seconds(lstsq)
    rows = [
        ('identnl identify, whole process', whole, worst_error(values, model)),
        ('  of it: reading the bag', median_seconds(read), None),
        ('  of it: judging the samples', median_seconds(judged), None),
        ('  of it: sensors to body motion', median_seconds(transformed), None),
        ('  of it: regression and solution', median_seconds(identified), None),
        ('this solver alone, streaming', median_seconds(orthogonal), orthogonal()),
        ('numpy.linalg.lstsq', lstsq_time, lstsq()),
        ('scipy.linalg.lstsq, gelsy', median_seconds(gelsy), gelsy()),
        ('normal equations, (44) as printed', median_seconds(normal_equations),
         normal_equations()),
    ]  # fmt: skip
    for name, seconds, result in rows:
        error = worst_error(result, model) if isinstance(result, np.ndarray) else result
        table.add_row(
            name,
            f'{seconds:.3f}',
            f'{seconds / lstsq_time:.2f}',
            f'{PAPER_SECONDS / seconds:.0f}',
            '' if error is None else f'{error:.1e}',
        )


def estimators(machine_path: Path, folder: Path, table: Table) -> None:
    """All estimators on clean and on noisy data: whole processes, errors against the bound."""
    for excitation in ('multisine', 'sine'):
        bags = {}
        for noise in ('none', 'nominal'):
            bags[noise] = folder / f'{excitation}_{noise}.mcap'
            identnl(
                'simulate', '--machine', str(machine_path), '--excitation', excitation,
                '--noise', noise, '--duration', str(DURATION), '--rate', str(RATE),
                '--out', str(bags[noise]),
            )  # fmt: skip
        for estimator in ('weak', 'likelihood', 'pointwise'):
            errors = {}
            for noise, bag in bags.items():  # the noisy one last: it is timed
                command = ('identify', str(bag), '--estimator', estimator, '--json')
                # The command ends with 1 where it says that its numbers are not to be trusted.
                document = json.loads(identnl(*command, check=False))
                parameters = document['parameters']
                values, truth, deviations = (
                    np.array([one[key] or np.nan for one in parameters], np.float64)
                    for key in ('value', 'true_value', 'standard_deviation')
                )
                relative = np.abs(values / truth - 1)
                scores = (values - truth) / deviations
                errors[noise] = relative.max(), np.sqrt(np.nanmean(scores**2))
            seconds = median_seconds(lambda: identnl(*command, check=False), 3)  # noqa: B023
            table.add_row(
                estimator, excitation, f'{seconds:.2f}', f'{DURATION / seconds:.2f}',
                f'{errors["none"][0]:.1e}', f'{100 * errors["nominal"][0]:.2g} %',
                f'{errors["nominal"][1]:.2f}', document['parameters'][0]['status'],
            )  # fmt: skip


def simulation(machine_path: Path, table: Table) -> None:
    """Time integration against scipy's, half a second of the paper's sine."""
    model = assemble(load_machine(machine_path).machine)
    point = model.machine.excitations[0]
    rest = static_equilibrium(model)
    count = 2000
    force = sine(point.amplitude, point.frequency)
    mass = model.mass_diagonal()
    n = len(rest)

    def ours(factor: int = 1):
        steps = steps_per_sample(model, rest[np.newaxis], 1 / RATE) * factor
        run = Simulation(model, (force,), 1 / RATE, rest, np.zeros(n), steps)
        return run.advance(count + 1)[0][0]

    def slope(time_s, state):
        value = point.amplitude * np.sin(2 * np.pi * point.frequency * time_s)
        joints = model.joint_force(state[np.newaxis, :n], state[np.newaxis, n:])[0]
        generalised = value * model.excitation_directions[0] + model.constant_load() - joints
        return np.concatenate((state[n:], generalised / mass))

    def peer():
        span = (0, count / RATE)
        return solve_ivp(
            slope, span, np.concatenate((rest, np.zeros(n))), method='DOP853', rtol=1e-9,
            atol=1e-16, t_eval=np.arange(count + 1) / RATE, max_step=1 / RATE,
        ).y[:n].T  # fmt: skip

    reference = ours(8)
    scale = np.abs(reference).max(axis=0)
    for name, action, runs in (('compiled, fixed steps', ours, RUNS), ('scipy DOP853', peer, 1)):
        error = float((np.abs(action() - reference).max(axis=0) / scale).max())
        seconds = median_seconds(action, runs) if runs > 1 else _once(action)
        table.add_row(name, f'{seconds:.3f}', f'{count / RATE / seconds:.2f}', f'{error:.1e}')


def diagnosis(machine_path: Path, folder: Path, table: Table) -> None:
    """Whole process, all shipped sensors, full library: with and without something hidden."""
    for hidden in ('', 'coulomb_friction:slideway_8.axis_2:5%'):
        path = folder / f'strange_{bool(hidden)}.mcap'
        options = ('--hide', hidden) if hidden else ()
        identnl(
            'simulate', '--machine', str(machine_path), '--duration', '4', '--rate', str(RATE),
            *options, '--out', str(path),
        )  # fmt: skip
        said: list[str] = []

        def diagnose(path: Path = path, said: list[str] = said) -> None:
            said.append(identnl('diagnose', str(path), '--json'))

        seconds = median_seconds(diagnose, 3)
        found = json.loads(said[-1])
        named = ', '.join(f'{one["effect"]} {one["location"]}' for one in found['findings'])
        held_out = found['held_out']
        errors = [held_out[one]['response_nrmse'] for one in ('before', 'after', 'noise_floor')]
        table.add_row(
            hidden or 'nothing', f'{seconds:.1f}', f'{found["verdict"]}: {named or "-"}',
            ' / '.join(f'{100 * one:.3g} %' for one in errors),
        )  # fmt: skip


def _once(action: Callable[[], object]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def main() -> None:
    """Run all benchmarks and print their tables."""
    console = Console(width=100)
    console.print(
        f'{platform.processor() or platform.machine()}, Python {platform.python_version()}, '
        f'numpy {np.__version__}, scipy {scipy.__version__}, numba {numba.__version__}'
    )
    machine_path = shipped_config('knee_column.yaml')
    with tempfile.TemporaryDirectory() as folder:
        bag_path = Path(folder) / 'paper.mcap'
        identnl(
            'simulate', '--machine', str(machine_path), '--excitation', 'sine', '--noise', 'none',
            '--duration', str(DURATION), '--rate', str(RATE), '--out', str(bag_path),
        )  # fmt: skip
        table = Table(
            title=f"The paper's problem: 16 parameters, 40 Hz sine, {DURATION:g} s at "
            f'{RATE / 1000:g} kHz, {round(DURATION * RATE) * 12} equations',
            title_justify='left',
        )
        for heading in ('', 'median s', 'to numpy lstsq', "paper's 40 s /", 'worst rel. error'):
            table.add_column(heading, justify='right' if heading else 'left')
        identification(bag_path, machine_path, table)
        console.print(table)
        table = Table(
            title=f'Estimators, whole process, {DURATION:g} s of all shipped sensors',
            title_justify='left',
        )
        for heading in ('', 'excitation', 'median s', 'times real time', 'worst error, clean',
                        'worst error, noisy', 'rms z, noisy', 'status, noisy'):  # fmt: skip
            table.add_column(heading, justify='right' if heading else 'left')
        estimators(machine_path, Path(folder), table)
        console.print(table)
        table = Table(title='Diagnosis, whole process, 4 s at 10 kHz', title_justify='left')
        for heading in ('hidden', 'median s', 'said', 'held-out error before / after / noise'):
            table.add_column(heading)
        diagnosis(machine_path, Path(folder), table)
        console.print(table)
    table = Table(title='Simulation of the same machine, 0.2 s', title_justify='left')
    for heading in ('', 'median s', 'times real time', 'worst rel. error'):
        table.add_column(heading, justify='right' if heading else 'left')
    simulation(machine_path, table)
    console.print(table)


if __name__ == '__main__':
    main()

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""Real node processes over DDS, and a node of the test that watches and disturbs them."""

from collections.abc import Callable, Iterator
from dataclasses import astuple, replace
import os
from pathlib import Path
import pickle
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

rclpy = pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from identnl_msgs.msg import (  # noqa: E402
    ParameterEstimateArray,
    SampleBlock as SampleBlockMessage,
    StandDescription as StandDescriptionMessage,
)
from identnl_ros.core.estimation.estimate import Estimate  # noqa: E402
from identnl_ros.core.measurement.blocks import SampleBlock  # noqa: E402
from identnl_ros.nodes import qos  # noqa: E402
from identnl_ros.nodes.estimate_conversion import estimate_from_message  # noqa: E402
from identnl_ros.storage.stand_description import StandDescription  # noqa: E402
from rclpy.context import Context  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
MACHINE = ROOT / 'config' / 'knee_column.yaml'
LAYOUT = ROOT / 'config' / 'knee_column_layout.yaml'
NAMESPACE = '/bench'
SETTLING_TIME = 0.3  # [s]
PATIENCE = 120.0  # [s] for what happens at once on an idle machine
RUN = {'duration': 1.0, 'sample_rate': 5000.0, 'seed': 3, 'excitation': 'multisine'}


# What the bridge and all after it should give, from the core alone: one process, no ROS. With as
# many threads of linear algebra as the nodes have, since rounding depends on them.
OFFLINE = """
import pickle, sys
from identnl_ros.core.estimation.identifier import identifier_for
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.sources.simulated import Excitation, SimulatedSource, TestRun
from identnl_ros.storage.layout_file import load_layout
from identnl_ros.storage.machine_file import load_machine

machine_file, layout_file, settings, estimator, result = sys.argv[1:]
machine, layout = load_machine(machine_file), load_layout(layout_file)
settings = eval(settings)
run = TestRun(**{**settings, 'excitation': Excitation(settings['excitation'])})
source = SimulatedSource(machine.machine, layout.layout, run, machine.text, layout.text)
blocks = list(source.blocks())
model = assemble(machine.machine)
transform = MotionTransform(model, layout.layout, run.sample_rate)
identifier = identifier_for(model, estimator)
for motion in map(transform.add, blocks):
    if motion is not None:
        identifier.add(motion)
pickle.dump((source.description, blocks, identifier.estimate()), open(result, 'wb'))
"""


class NodeProcess:
    """A process with nodes, its output in a file."""

    def __init__(self, module: str, parameters: dict[str, object], folder: Path) -> None:
        self.log = folder / f'{module}_{time.monotonic_ns()}.log'
        arguments = [sys.executable, '-m', f'identnl_ros.nodes.{module}', '--ros-args']
        arguments += ['-r', f'__ns:={NAMESPACE}']
        name = parameters.pop('node_name', None)
        arguments += ['-r', f'__node:={name}'] if name else []
        for name, value in parameters.items():
            arguments += ['-p', f'{name}:={_yaml(value)}']
        self._output = self.log.open('w')
        self.process = subprocess.Popen(
            arguments, stdout=self._output, stderr=subprocess.STDOUT, cwd=folder
        )

    @property
    def output(self) -> str:
        return self.log.read_text()

    def signal(self, number: int) -> None:
        self.process.send_signal(number)

    def exit_code(self, timeout: float = PATIENCE) -> int:
        return self.process.wait(timeout)

    def kill(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self._output.close()


class Watcher:
    """A node of the test."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node(
            'watcher', namespace=NAMESPACE, context=self.context, use_global_arguments=False
        )
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.estimates: list[ParameterEstimateArray] = []
        self.blocks: list[SampleBlockMessage] = []
        self.descriptions: list[StandDescriptionMessage] = []
        self.health: dict[str, SimpleNamespace] = {}
        subscribe = self.node.create_subscription
        subscribe(ParameterEstimateArray, 'estimates', self.estimates.append, qos.estimates())
        subscribe(DiagnosticArray, '/diagnostics', self._note_health, qos.diagnostics())

    def listen(self, what: str) -> None:
        """Collect blocks or descriptions as well."""
        if what == 'samples':
            self.node.create_subscription(
                SampleBlockMessage, what, self.blocks.append, qos.blocks()
            )
        else:
            self.node.create_subscription(
                StandDescriptionMessage, what, self.descriptions.append, qos.stand_description()
            )

    def until(self, condition: Callable[[], object], timeout: float = PATIENCE) -> object:
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)
            if result := condition():
                return result
        raise AssertionError(f'did not happen in {timeout} s; health: {self.health}')

    def final_estimate(self, timeout: float = PATIENCE) -> ParameterEstimateArray:
        return self.until(
            lambda: self.estimates and self.estimates[-1].stream_ended and self.estimates[-1],
            timeout,
        )

    def health_of(self, name: str, words: str, level: int = 1) -> str:
        """Wait until a part reports something of a level."""

        def found() -> str | None:
            part = self.health.get(f'{NAMESPACE}/{name}'.lstrip('/'))
            known = part is not None and part.level >= level and words in part.message
            return part.message if known else None

        return self.until(found)

    def call(self, kind: type, service: str, **fields: object) -> object:
        client = self.node.create_client(kind, service)
        try:
            self.until(client.service_is_ready)
            # Ready means that requests arrive; the server may still have to find the reader of
            # its answers, and drops the answer until then.
            found = time.monotonic() + SETTLING_TIME
            self.until(lambda: time.monotonic() > found)
            future = client.call_async(kind.Request(**fields))
            self.until(future.done)
            return future.result()
        finally:
            self.node.destroy_client(client)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def _note_health(self, array: DiagnosticArray) -> None:
        for status in array.status:
            values = {item.key: item.value for item in status.values}
            self.health[status.name] = SimpleNamespace(
                level=status.level[0], message=status.message, values=values
            )


@pytest.fixture
def start(ros_domain: int, tmp_path: Path) -> Iterator[Callable[..., NodeProcess]]:
    """Start a process with nodes; all are ended by their number afterwards."""
    started: list[NodeProcess] = []

    def run(module: str, **parameters: object) -> NodeProcess:
        if module in ('identifier', 'stand'):
            # Quick and exact on clean data: most of these tests are about what is around it.
            parameters = {'estimator': 'pointwise', **parameters}
        if module in ('sensor_bridge', 'stand'):
            parameters = {'wait_timeout': PATIENCE, **parameters}
        started.append(NodeProcess(module, parameters, tmp_path))
        return started[-1]

    yield run
    for process in started:
        process.kill()
        sys.stdout.write(f'{process.log.name}:\n{process.output}\n')  # shown if the test fails


@pytest.fixture
def bridge_settings() -> dict[str, object]:
    """Parameters of the bridge for the run that `offline` computes."""
    return {
        **RUN,
        'machine_file': MACHINE,
        'layout_file': LAYOUT,
        'speed': 0.0,
        'stream_from_seed': True,
        'wait_for_consumers': 2,
    }


@pytest.fixture
def watcher(ros_domain: int) -> Iterator[Watcher]:
    node = Watcher()
    yield node
    node.close()


@pytest.fixture(scope='session')
def compute(
    tmp_path_factory: pytest.TempPathFactory,
) -> Callable[[dict[str, object], str], tuple[object, ...]]:
    """Compute description, blocks and estimate of a run from the core alone."""

    def of(run: dict[str, object], estimator: str) -> tuple[object, ...]:
        file = tmp_path_factory.mktemp('offline') / 'result'
        subprocess.run(
            [sys.executable, '-c', OFFLINE, MACHINE, LAYOUT, repr(run), estimator, file],
            env={**os.environ, 'OPENBLAS_NUM_THREADS': '1'},
            check=True,
            timeout=240,
        )
        return pickle.loads(file.read_bytes())

    return of


@pytest.fixture(scope='session')
def computed(compute) -> tuple[object, ...]:
    return compute(RUN, 'pointwise')


@pytest.fixture(scope='session')
def description(computed) -> StandDescription:
    return computed[0]


@pytest.fixture(scope='session')
def blocks(computed) -> list[SampleBlock]:
    return computed[1]


@pytest.fixture(scope='session')
def offline(computed) -> Estimate:
    return computed[2]


@pytest.fixture(scope='session')
def bits() -> Callable[[Estimate], tuple[object, ...]]:
    """Everything in an estimate, numbers as hexadecimal digits."""

    def of(estimate: Estimate) -> tuple[object, ...]:
        parameters = tuple(
            replace(
                parameter,
                value=float(parameter.value).hex(),
                standard_deviation=float(parameter.standard_deviation).hex(),
            )
            for parameter in estimate.parameters
        )
        return astuple(
            replace(
                estimate,
                parameters=parameters,
                covariance=estimate.covariance.tobytes(),
                residual=float(estimate.residual).hex(),
                condition_number=float(estimate.condition_number).hex(),
            )
        )

    return of


@pytest.fixture(scope='session')
def same_bits(bits) -> Callable[[ParameterEstimateArray, Estimate], bool]:
    return lambda message, estimate: bits(estimate_from_message(message)) == bits(estimate)


def _yaml(value: object) -> str:
    if isinstance(value, bool):
        return 'true' if value else 'false'
    return str(value)

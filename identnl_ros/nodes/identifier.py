# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The node that turns motion of bodies into estimates of the machine's parameters."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
import sys
from typing import Any, ClassVar

from identnl_msgs.msg import (
    BodyMotionBlock,
    DiscrepancyReport,
    ParameterEstimateArray,
    SampleBlock as SampleBlockMessage,
)
from identnl_msgs.srv import LoadIdentifierState, ResetIdentifier, SaveIdentifierState
from identnl_ros.core.errors import DataError, IdentnlError
from identnl_ros.core.estimation.estimate import Estimate, EstimateStatus
from identnl_ros.core.estimation.force_scale import force_scale_remarks
from identnl_ros.core.estimation.identifier import ESTIMATORS, Identifier, identifier_for
from identnl_ros.core.measurement.blocks import MotionBlock, stamp_after
from identnl_ros.core.measurement.continuity import StreamFollower
from identnl_ros.nodes import qos
from identnl_ros.nodes.consumer_node import ConsumerNode
from identnl_ros.nodes.conversions import block_from_message, motion_from_message
from identnl_ros.nodes.diagnosis import Health
from identnl_ros.nodes.estimate_conversion import estimate_to_message
from identnl_ros.nodes.live_diagnosis import LiveDiagnosis
from identnl_ros.nodes.running import run
from identnl_ros.sources.setting import Setting
from identnl_ros.storage.stand_description import StandDescription
from identnl_ros.storage.state_file import load_state, save_state, state_path
from rclpy.duration import Duration
from std_srvs.srv import Trigger

CONFIRMATION_TIME = 0.5  # [s]
DIAGNOSIS_BEAT = 0.1  # [s]


class IdentifierNode(ConsumerNode):
    """
    Consumes `motion`, publishes `estimates`; consumes `samples`, publishes `discrepancy` if asked.

    All streams of the same machine add to one estimate, until the service ~/reset; another
    machine begins anew. What the newest samples say the machine lacks is found out in a process
    of its own.

    """

    topic: ClassVar[str] = 'motion'
    message_type: ClassVar[type] = BodyMotionBlock
    type_name: ClassVar[str] = 'identnl_msgs/msg/BodyMotionBlock'
    settings: ClassVar[tuple[Setting, ...]] = (
        *ConsumerNode.settings,
        Setting('estimator', 'weak', 'Method of estimation.', choices=ESTIMATORS),
        Setting(
            'memory',
            0.0,
            'Time after which what was learned counts 1/e as much [s]; 0: all counts alike.',
            0.0,
            1e9,
        ),
        Setting(
            'publish_rate',
            2.0,
            'How often estimates are published while data come [Hz]; the last one comes at once.',
            0.01,
            100.0,
        ),
        Setting(
            'diagnose_every',
            0.0,
            'How often the newest samples are diagnosed [s], if new ones have come and no '
            'diagnosis is running; 0: on request only (~/diagnose).',
            0.0,
            1e6,
        ),
        Setting(
            'state_directory',
            '',
            'Folder of the files of the services ~/save_state and ~/load_state; '
            'empty: these services are refused.',
            live=True,
        ),
    )

    def __init__(self, **options: Any) -> None:
        self._identifier: Identifier | None = None
        self._last: Estimate | None = None
        self._machine_text = ''
        self._contradictions: dict[str, None] = {}
        self._remarks: tuple[str, ...] = ()
        self._has_news = False
        self._stamp = self._last_index = 0
        self._diagnosis = LiveDiagnosis()
        super().__init__('identifier', **options)

    @property
    def follower(self) -> StreamFollower | None:
        return None if self._identifier is None else self._identifier.follower

    def configure(self) -> None:
        self.setting('estimator')
        super().configure()
        self._estimates = self.publish_on(ParameterEstimateArray, 'estimates', qos.estimates())
        self.every(1 / self.setting('publish_rate'), self._publish_news)
        self._readings = self.subscribe(
            SampleBlockMessage, 'samples', self._on_samples, qos_profile=qos.blocks()
        )
        self._reports = self.publish_on(DiscrepancyReport, 'discrepancy', qos.discrepancy())
        self.every(DIAGNOSIS_BEAT, self._publish_report)
        if interval := self.setting('diagnose_every'):
            self.every(interval, self._diagnose_again)
        for service_type, name, answer in (
            (Trigger, '~/diagnose', self._begin_diagnosis),
            (ResetIdentifier, '~/reset', self._reset),
            (SaveIdentifierState, '~/save_state', self._save),
            (LoadIdentifierState, '~/load_state', self._load),
        ):
            service = self.create_service(service_type, name, _answered(answer))
            self._endings.append(partial(self.destroy_service, service))

    def clean_up(self) -> None:
        super().clean_up()
        self._diagnosis.close()
        self._diagnosis = LiveDiagnosis()
        self._identifier = None
        self._forget_estimates()

    def convert(self, message: BodyMotionBlock) -> MotionBlock:
        return motion_from_message(message)

    def open(self, description: StandDescription) -> None:
        if self._identifier is not None and description.machine_text == self._machine_text:
            return
        if self._identifier is not None:
            self.get_logger().warning(
                f'stand {description.stand} has another machine file now: '
                f'{self._identifier.samples} samples are forgotten'
            )
        self._identifier = None
        self._contradictions.clear()
        memory = self.setting('memory')
        model = self.model(description)
        self._identifier = identifier_for(model, self.setting('estimator'), memory or None)
        self._remarks = force_scale_remarks(model)
        self._machine_text = description.machine_text

    def use(self, block: MotionBlock) -> None:
        if not self._ready().add(block):
            return
        self._contradictions |= dict.fromkeys(block.contradictions)
        if samples := block.next_index - block.first_index:
            self._stamp = stamp_after(block.stamp_ns, samples - 1, block.sample_rate)
            self._last_index = block.next_index - 1
        self._has_news = True
        if block.last:
            self._publish()

    def is_connected(self) -> bool:
        return self._sources > 0 and self._readings.get_publisher_count() > 0

    def finish(self) -> None:
        if self.is_active:
            self._publish_news()
            self._publish_report()
            for publisher in (self._estimates, self._reports):
                publisher.wait_for_all_acked(Duration(seconds=CONFIRMATION_TIME))

    def diagnose(self) -> list[Health]:
        health = Health('estimate', {'estimator': self.setting('estimator')})
        if self._last is not None:
            health.values |= {
                'samples used': self._last.samples,
                'samples rejected': self._last.rejected_samples,
                'residual [-]': f'{self._last.residual:.3g}',
                'condition number [-]': f'{self._last.condition_number:.3g}',
            }
            for parameter in self._last.parameters:
                if parameter.status is not EstimateStatus.OK:
                    health.values[parameter.name] = f'{parameter.status.value}: {parameter.note}'
        return [*super().diagnose(), health, self._diagnosis.health()]

    @staticmethod
    def _length(message: BodyMotionBlock) -> int:
        return len(message.displacement) // max(1, len(message.coordinates))

    def _publish_news(self) -> None:
        if self._has_news and self.is_active:
            self._publish()

    def _publish(self) -> None:
        self._has_news = False
        identifier = self._ready()
        estimate = identifier.estimate().doubted(tuple(self._contradictions))
        self._last = estimate.noted(self._remarks)
        self._estimates.publish(
            estimate_to_message(
                self._last,
                stand=self.stand,
                stream_id=identifier.follower.stream_id or 0,
                stamp=self._stamp,
                last_index=self._last_index,
                stream_ended=identifier.follower.ended,
            )
        )

    def _on_samples(self, message: SampleBlockMessage) -> None:
        description = self._descriptions.get(message.stream_id)
        if not self.is_active or description is None:
            return
        if message.channel_count != len(description.layout.sensors):
            return
        with suppress(DataError):  # the transform tells it; here it is a gap
            self._diagnosis.take(block_from_message(message), description)

    def _begin_diagnosis(self, _request: Trigger.Request) -> str:
        if not self.is_active:
            raise DataError('the node is not active, so it takes no samples; activate it first')
        return self._diagnosis.begin(
            self._descriptions, lambda description: self.model(description).machine
        )

    def _diagnose_again(self) -> None:
        if self.is_active and self._diagnosis.has_news and not self._diagnosis.is_running:
            with suppress(DataError):  # /diagnostics says it
                self._begin_diagnosis(Trigger.Request())

    def _publish_report(self) -> None:
        if not self.is_active:
            return
        try:
            report = self._diagnosis.finished()
        except DataError as error:
            self.get_logger().error(str(error))
            return
        if report is not None:
            self._reports.publish(report)
            self.get_logger().info(f'stand {report.stand}: {report.sentence}')

    def _reset(self, _request: ResetIdentifier.Request) -> str:
        identifier = self._ready()
        forgotten = identifier.samples
        identifier.reset()
        self._contradictions.clear()
        self._diagnosis.readings.clear()
        self._publish()
        return f'{forgotten} samples forgotten'

    def _save(self, request: SaveIdentifierState.Request) -> str:
        identifier = self._ready()
        path = self._path(request.file_name)
        save_state(path, identifier.state)
        return str(path.absolute())

    def _load(self, request: LoadIdentifierState.Request) -> str:
        identifier = self._ready()
        identifier.restore(load_state(self._path(request.file_name)))
        self._publish()
        return f'{identifier.samples} samples loaded'

    def _ready(self) -> Identifier:
        if self._identifier is None:
            raise DataError('no description of the stand has come yet, so there is no machine')
        return self._identifier

    def _path(self, name: str) -> Path:
        folder = self.setting('state_directory')
        if not folder:
            raise DataError('parameter state_directory is empty; set it to a folder')
        return state_path(folder, name)

    def _forget_estimates(self) -> None:
        self._machine_text = ''
        self._contradictions.clear()
        self._has_news = False
        self._last = None
        self._stamp = self._last_index = 0


def _answered(answer: Callable[[Any], str]) -> Callable[[Any, Any], Any]:
    """Make a service of a function that returns the message or raises."""

    def call(request: Any, response: Any) -> Any:
        try:
            response.message = answer(request)
            response.success = True
        except IdentnlError as error:
            response.message = str(error)
            response.success = False
        return response

    return call


def main(args: Sequence[str] | None = None) -> int:
    """
    Run the node.

    Parameters
    ----------
    args : sequence of str or None
        None: those of the process.

    Returns
    -------
    int
        Exit code.

    """
    return run(lambda: [IdentifierNode()], args)


if __name__ == '__main__':
    sys.exit(main())

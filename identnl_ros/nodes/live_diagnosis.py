# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The newest samples of a stand, and what a diagnosis says of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import time

from identnl_msgs.msg import DiscrepancyReport
from identnl_ros.core.errors import DataError, IdentnlError
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.core.measurement.newest_run import NewestRun
from identnl_ros.core.mechanics.machine import Machine
from identnl_ros.core.quality.monitor import QualityMonitor
from identnl_ros.nodes.diagnosis import Health, Level
from identnl_ros.nodes.diagnosis_process import DiagnosisProcess
from identnl_ros.nodes.discrepancy_conversion import report_to_message
from identnl_ros.sources.bag_runs import runs_with_force
from identnl_ros.sources.record_diagnosis import divided, LONGEST, LONGEST_HELD_OUT
from identnl_ros.storage.stand_description import StandDescription

_VERDICTS = {
    getattr(DiscrepancyReport, name): name.removeprefix('VERDICT_').lower()
    for name in ('VERDICT_COMPLETE', 'VERDICT_EXPLAINED', 'VERDICT_PARTLY_EXPLAINED',
                 'VERDICT_UNEXPLAINED')
}  # fmt: skip


@dataclass(frozen=True)
class _Running:
    """A diagnosis that runs, and what it is about."""

    process: DiagnosisProcess
    began: float
    stand: str
    stream_id: int
    stamp: int


class LiveDiagnosis:
    """One diagnosis at a time, of the samples that came last."""

    def __init__(self) -> None:
        self.readings = NewestRun(LONGEST + LONGEST_HELD_OUT)
        self._monitor: tuple[StandDescription, QualityMonitor] | None = None
        self._running: _Running | None = None
        self._report: DiscrepancyReport | None = None
        self._last_attempt = 'none yet'
        self._has_failed = False
        self._seen: tuple[int | None, int] = (None, 0)

    @property
    def is_running(self) -> bool:
        """A diagnosis has begun and its result has not been taken."""
        return self._running is not None

    @property
    def has_news(self) -> bool:
        """Samples have come since the last diagnosis began."""
        return (self.readings.stream_id, self.readings.next_index) != self._seen

    def take(self, block: SampleBlock, description: StandDescription) -> None:
        """
        Keep the samples of a block that are not at fault.

        Parameters
        ----------
        block : SampleBlock
        description : StandDescription
            Of its stream.

        Raises
        ------
        DataError
            If the block does not have the channels or the sample rate described.

        """
        if self._monitor is None or self._monitor[0] is not description:
            monitor = QualityMonitor(description.layout, description.sample_rate)
            self._monitor = description, monitor
        for cleaned in self._monitor[1].add(block):
            self.readings.add(cleaned)

    def begin(
        self,
        descriptions: Mapping[int, StandDescription],
        machine_of: Callable[[StandDescription], Machine],
    ) -> str:
        """
        Begin to diagnose the samples that came last.

        Parameters
        ----------
        descriptions : mapping of int to StandDescription
            By stream.
        machine_of : callable
            Gives the machine of a stand.

        Returns
        -------
        str
            What has begun, in a sentence.

        Raises
        ------
        IdentnlError
            If nothing has begun; says why.

        """
        if self._running is not None:
            raise DataError(
                f'a diagnosis has been running for {time.monotonic() - self._running.began:.0f} '
                's; its report comes on the topic discrepancy, ask again after that'
            )
        try:
            count = self._begin(descriptions, machine_of)
        except IdentnlError as error:
            self._last_attempt = f'refused: {error}'
            raise
        return f'diagnosis of {count} samples has begun; its report comes on the topic discrepancy'

    def finished(self) -> DiscrepancyReport | None:
        """
        Take the result of a diagnosis, once.

        Returns
        -------
        DiscrepancyReport or None
            None: there is nothing new.

        Raises
        ------
        DataError
            If the diagnosis has failed; says why.

        """
        running = self._running
        if running is None or not running.process.is_over:
            return None
        self._running = None
        try:
            answer = running.process.answer()
        except DataError as error:
            self._last_attempt, self._has_failed = f'failed: {error}', True
            raise DataError(f'stand {running.stand}: diagnosis failed: {error}') from None
        finally:
            running.process.close()
        self._report = report_to_message(
            answer, stand=running.stand, stream_id=running.stream_id, stamp=running.stamp
        )
        self._last_attempt = f'took {time.monotonic() - running.began:.1f} s'
        return self._report

    def close(self) -> None:
        """End a diagnosis that runs; its result is lost."""
        if self._running is not None:
            self._running.process.close()
            self._running = None

    def health(self) -> Health:
        """
        Tell the last verdict and what goes on.

        Returns
        -------
        Health

        """
        health = Health('discrepancy', {'samples kept': len(self.readings)})
        running = self._running
        health.values['diagnosis'] = (
            self._last_attempt
            if running is None
            else f'running for {time.monotonic() - running.began:.0f} s'
        )
        if self._has_failed:
            health.add(Level.WARN, f'diagnosis {self._last_attempt}')
        report = self._report
        if report is None:
            health.values['verdict'] = 'unknown'
            return health
        health.values |= {
            'verdict': _VERDICTS[report.verdict],
            'missing': ', '.join(f'{one.effect} at {one.location}' for one in report.findings),
            'held-out force error before [-]': f'{report.held_out_error_before:.3g}',
            'held-out force error after [-]': f'{report.held_out_error_after:.3g}',
            'held-out force error of noise alone [-]': f'{report.held_out_error_floor:.3g}',
        }
        if report.verdict != DiscrepancyReport.VERDICT_COMPLETE:
            health.add(Level.WARN, report.sentence)
        return health

    def _begin(
        self,
        descriptions: Mapping[int, StandDescription],
        machine_of: Callable[[StandDescription], Machine],
    ) -> int:
        stream_id = self.readings.stream_id
        description = None if stream_id is None else descriptions.get(stream_id)
        if description is None:
            raise DataError(
                'no samples have come on the topic samples that could be diagnosed; start the '
                'stand and ask again'
            )
        readings = self.readings
        runs = runs_with_force(
            description.layout, readings.sample_rate, readings.samples, readings.first_index
        )
        where = f'stand {description.stand}'
        if not runs:
            raise DataError(
                f'{where}: the newest {len(readings)} uninterrupted samples hold no run with a '
                'measured force that is long enough; let the stand go on and ask again'
            )
        longest = max(runs, key=lambda run: len(run.samples))
        record, held_out = divided(longest, None, where)
        count = len(longest.samples)
        self._running = _Running(
            DiagnosisProcess(machine_of(description), record, held_out),
            time.monotonic(),
            description.stand,
            description.stream_id,
            readings.stamp_of(longest.first_index + count - 1),
        )
        self._seen = readings.stream_id, readings.next_index
        self._has_failed = False
        return count

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A diagnosis in a process of its own: it takes seconds, and a node must not stand still."""

import json
import os
import pickle
import subprocess
import sys
from tempfile import TemporaryFile
from typing import Any

from identnl_ros.core.errors import DataError, IdentnlError
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.machine import Machine
from identnl_ros.reports.diagnosis_document import diagnosis_document, summary
from identnl_ros.sources.record_diagnosis import diagnose_record
from identnl_ros.storage.machine_writing import machine_text

# Samples that come must not wait for a diagnosis.
NICENESS = 10


class DiagnosisProcess:
    """
    A diagnosis that has begun.

    Parameters
    ----------
    machine : Machine
    record, held_out : MeasuredRecord

    Raises
    ------
    DataError
        If the process cannot be started.

    """

    def __init__(self, machine: Machine, record: MeasuredRecord, held_out: MeasuredRecord) -> None:
        # Files have no limit as pipes have, so nobody waits for anybody.
        try:
            self._answer = TemporaryFile()  # noqa: SIM115  (closed by `close`)
            with TemporaryFile() as task:
                pickle.dump((machine, record, held_out), task)
                task.seek(0)
                self._process = subprocess.Popen(
                    [sys.executable, '-m', __name__],
                    stdin=task,
                    stdout=self._answer,
                    # An interrupt at the terminal is for the node, which ends this process.
                    start_new_session=True,
                )
        except OSError as error:
            raise DataError(
                f'the process of the diagnosis cannot be started: {error}; is there memory, and '
                'room for temporary files?'
            ) from None

    @property
    def is_over(self) -> bool:
        """The process has ended."""
        return self._process.poll() is not None

    def answer(self) -> dict[str, Any]:
        """
        Take the result of a process that is over.

        Returns
        -------
        dict
            As `diagnosis_document`, and the text of the corrected ``machine_file``.

        Raises
        ------
        DataError
            If there is none; says why.

        """
        self._answer.seek(0)
        text = self._answer.read()
        if self._process.returncode or not text:
            raise DataError(
                f'the process of the diagnosis has ended with code {self._process.returncode} '
                'and no result; its messages in the log say why'
            )
        answer: dict[str, Any] = json.loads(text)
        if 'error' in answer:
            raise DataError(answer['error'])
        return answer

    def close(self) -> None:
        """End the process if it still runs."""
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self._answer.close()


def _work() -> None:
    """Do what is told on standard input, answer on standard output."""
    parent = os.getppid()
    os.nice(NICENESS)
    machine, record, held_out = pickle.load(sys.stdin.buffer)

    def stop_if_orphaned(_: str) -> None:
        if os.getppid() != parent:
            sys.exit('the node that wanted this diagnosis is gone')

    try:
        result = diagnose_record(machine, record, held_out, progress=stop_if_orphaned)
        after = result.diagnosis.after
        values = {one.name: one.value for one in after.model.parameters}
        text = machine_text(after.description.machine, values, summary(result))
        answer = {**diagnosis_document(result), 'machine_file': text}
    except IdentnlError as error:
        answer = {'error': str(error)}
    json.dump(answer, sys.stdout)


if __name__ == '__main__':
    _work()

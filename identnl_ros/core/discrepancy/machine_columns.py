# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What effects of the machine would do to the readings, block by block."""

from collections.abc import Sequence

from identnl_ros.core.discrepancy.effect import Hypothesis
from identnl_ros.core.discrepancy.evidence import CHUNK, Evidence, real_rows
from identnl_ros.core.discrepancy.features import Features
from identnl_ros.core.discrepancy.force_noise import spectral_lines
import numpy as np
from numpy.typing import NDArray

BLOCK = 48


class MachineColumns:
    """
    Columns of a regression, one per hypothesis about the machine.

    Parameters
    ----------
    evidence : Evidence
    hypotheses : sequence of Hypothesis
        Not of sensors.

    """

    def __init__(self, evidence: Evidence, hypotheses: Sequence[Hypothesis]) -> None:
        self._evidence = evidence
        self._features = Features(evidence.comparison.course(), hypotheses)
        self.blocks = tuple(
            range(first, min(first + BLOCK, len(hypotheses)))
            for first in range(0, len(hypotheses), BLOCK)
        )
        """Places of hypotheses that are computed together."""

    def of(self, block: Sequence[int]) -> NDArray[np.float32]:
        """
        Compute some columns: responses of the linearised machine.

        Parameters
        ----------
        block : sequence of int
            Places among the hypotheses.

        Returns
        -------
        ndarray, shape (n_block, n_rows)
            Real rows of the motion channels, in units of noise per unit of size. Correlations
            need no more digits than these.

        """
        evidence = self._evidence
        comparison = evidence.comparison
        count, average = comparison.count, comparison.average
        state = np.zeros((3, len(comparison.model.coordinates), len(block)))
        inside = np.zeros((2, len(comparison.model.hidden_columns), len(block)))
        table = np.empty((len(block), evidence.channels.count, count // average), np.float32)
        size = max(CHUNK // average, 1) * average
        for first in range(0, count, size):
            end = min(first + size, count)
            forcing = self._features.forces(block, first, end + 1)
            means = evidence.equations.respond(state, forcing, inside, first, average)
            part = slice(first // average, end // average)
            table[:, :, part] = evidence.channels.of_motion(means, np.float32)
        table *= np.float32(np.sqrt(average))
        return real_rows(evidence.whitened(spectral_lines(table)))


def with_numbers(evidence: Evidence, numbers: Sequence[Hypothesis]) -> Evidence:
    """
    Let numbers inside elements explain what they can, as the unknowns do.

    Parameters
    ----------
    evidence : Evidence
    numbers : sequence of Hypothesis
        Changes of numbers, see `numbers_to_fit`.

    Returns
    -------
    Evidence
        The same, with more columns in its base.

    """
    if numbers:
        rows = MachineColumns(evidence, numbers).of(range(len(numbers)))
        lines = rows.view(np.complex64).reshape(len(numbers), *evidence.base.shape[1:])
        evidence.base = np.concatenate((evidence.base, lines))
    return evidence

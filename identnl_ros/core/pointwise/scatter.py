# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Scatter of a least-squares estimate without assuming equal, independent residuals.

The residuals of different coordinates have different units and common sensors, and those of
neighbouring instants share the samples that a derivative was taken from. The covariance
``(Phi^T Phi)^-1 (sum over groups of Phi_g^T r_g r_g^T Phi_g) (Phi^T Phi)^-1`` takes all that from
the residuals themselves, if groups of instants are independent (White 1980, Econometrica 48,
817-838; Liang and Zeger 1986, Biometrika 73, 13-22).
"""

from dataclasses import dataclass

from identnl_ros.core.algebra.information import Information
import numpy as np
from numpy.typing import NDArray

# Fewer groups than this per unknown say too little about the scatter.
GROUPS_PER_UNKNOWN = 8
# Rows in which a column is so much longer than it was give a better reference.
GROWTH = 10.0


@dataclass(frozen=True)
class Scatter:
    """
    Second moments of the groups' ``Phi_g^T [Phi_g, r_g]``, r the residual of a reference estimate.

    The residual of any later estimate is linear in these, and so they give its scatter. The
    reference, an estimate from the first rows, keeps the digits that differences of large
    numbers would lose.

    Parameters
    ----------
    moments : ndarray, shape (n (n + 1), n (n + 1))
        In the units of `scale`.
    scale : ndarray, shape (n + 1,)
        Size of the columns and of the residual, fixed by the first rows.
    reference : ndarray, shape (n,)
        Estimate from the first rows.
    groups : int

    """

    moments: NDArray[np.float64]
    scale: NDArray[np.float64]
    reference: NDArray[np.float64]
    groups: int = 0

    @classmethod
    def empty(cls, size: int) -> 'Scatter':
        """
        Begin with no data.

        Parameters
        ----------
        size : int
            Number of unknowns.

        Returns
        -------
        Scatter

        """
        return cls(np.zeros((size * (size + 1),) * 2), np.zeros(size + 1), np.zeros(size))

    def with_rows(
        self, regressor: NDArray[np.float64], target: NDArray[np.float64], rows: int
    ) -> 'Scatter':
        """
        Add groups of consecutive rows.

        Parameters
        ----------
        regressor : ndarray, shape (n_rows, n)
        target : ndarray, shape (n_rows,)
        rows : int
            Rows of a group; what is left over joins the last.

        Returns
        -------
        Scatter

        """
        size = regressor.shape[1]
        scale, reference = self.scale, self.reference
        kept = self.moments
        lengths = np.linalg.norm(regressor, axis=0)
        if np.any(lengths > GROWTH * scale[:size]):
            # These rows say more than the first ones did: they give the reference from now on.
            solution = Information.empty(size).with_rows(regressor, target).solve()
            reference = solution.values
            residual = np.linalg.norm(target - regressor @ reference, axis=0, keepdims=True)
            scale = np.maximum(np.concatenate((lengths, residual)), scale)
            kept = self._referred_to(reference, scale)
        table = np.column_stack((regressor, target - regressor @ reference))
        table /= np.where(scale > 0, scale, 1.0)
        count = max(1, len(table) // rows)
        whole = table[: count * rows].reshape(count, -1, size + 1)
        moments = np.matmul(whole[:, :, :size].transpose(0, 2, 1), whole)
        left_over = table[count * rows :]
        moments[-1] += left_over[:, :size].T @ left_over
        flat = moments.reshape(count, -1)
        return Scatter(kept + flat.T @ flat, scale, reference, self.groups + count)

    def _referred_to(
        self, reference: NDArray[np.float64], scale: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Express the moments by another reference and scale."""
        size = len(reference)
        before, after = (np.where(part > 0, part, 1.0) for part in (self.scale, scale))
        # [Phi, r'] = [Phi, r] @ change, in the units of the scales.
        change = np.diag(before / after)
        change[:size, size] = (self.reference - reference) * before[:size] / after[size]
        turn = np.kron(np.diag(before[:size] / after[:size]), change)
        result: NDArray[np.float64] = turn.T @ self.moments @ turn
        return result

    def covariance(
        self, values: NDArray[np.float64], inverse: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """
        Evaluate the covariance of an estimate.

        Parameters
        ----------
        values : ndarray, shape (n,)
            The estimate.
        inverse : ndarray, shape (n, n)
            ``(Phi^T Phi)^-1``.

        Returns
        -------
        ndarray, shape (n, n), or None
            None where there are too few groups.

        """
        size = len(values)
        if self.groups < GROUPS_PER_UNKNOWN * size + 2:
            return None
        scale = np.where(self.scale > 0, self.scale, 1.0)
        change = (values - self.reference) * scale[:size] / scale[size]
        weights = np.append(-change, 1.0)
        folded = self.moments.reshape(size, size + 1, size, size + 1)
        # Phi_g^T r_g, scaled, is linear in the moments of the group.
        spread = np.einsum('iajb,a,b->ij', folded, weights, weights, optimize=True)
        outer = inverse * (scale[:size] * scale[size])
        result: NDArray[np.float64] = outer @ spread @ outer.T
        return result * self.groups / (self.groups - size)

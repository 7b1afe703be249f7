# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Principal central axes of inertia, named after the machine axes that they are nearest to."""

from functools import lru_cache
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

# Principal moments that agree to this fraction leave their axes undetermined.
EQUAL_MOMENTS = 1e-9


def principal_axes(
    inertia: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Find the principal moments and axes of an inertia tensor.

    Eigenvectors have no order and no sign, and equal moments leave their plane free. Axis i is
    the one nearest to axis i of the machine, so that a body whose inertia is diagonal keeps the
    machine's axes whatever its moments.

    Parameters
    ----------
    inertia : ndarray, shape (3, 3)
        Symmetric, positive definite [kg m^2].

    Returns
    -------
    moments : ndarray, shape (3,)
        [kg m^2].
    axes : ndarray, shape (3, 3)
        Principal axes as columns, right-handed, machine frame.

    """
    moments, axes = _principal_axes(np.asarray(inertia, dtype=np.float64).tobytes())
    return moments.copy(), axes.copy()


@lru_cache(maxsize=256)
def _principal_axes(
    content: bytes,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find them once for every tensor: many joints ask for the axes of few bodies."""
    inertia = np.frombuffer(content).reshape(3, 3)
    moments, vectors = np.linalg.eigh((inertia + inertia.T) / 2)
    # Where moments are equal, any basis of their space is principal: project the machine's
    # axes into each space, so that nearness below does not depend on eigh's choice.
    spaces = _equal_moment_spaces(moments)
    nearness = np.zeros((3, 3))
    for space in spaces:
        overlap = np.linalg.norm(vectors[:, space], axis=1) ** 2
        nearness[:, space] = overlap[:, np.newaxis]
    # eigen[i]: the eigenvector that becomes axis i.
    eigen = max(permutations(range(3)), key=lambda order: nearness[range(3), order].sum())
    axes = np.zeros((3, 3))
    sorted_moments = np.zeros(3)
    for space in spaces:
        chosen = [axis for axis, index in enumerate(eigen) if index in space]
        basis = vectors[:, space]
        # Orthogonal Procrustes: the basis of the space nearest to the chosen machine axes.
        left, _, right = np.linalg.svd(basis.T @ np.eye(3)[:, chosen])
        axes[:, chosen] = basis @ (left @ right)
        sorted_moments[chosen] = moments[space].mean()
    if np.linalg.det(axes) < 0:
        furthest = int(np.argmin(np.abs(np.diag(axes))))
        axes[:, furthest] *= -1
    return sorted_moments, axes


def _equal_moment_spaces(moments: NDArray[np.float64]) -> list[list[int]]:
    spaces = [[0]]
    for index in (1, 2):
        if moments[index] - moments[index - 1] <= EQUAL_MOMENTS * moments[2]:
            spaces[-1].append(index)
        else:
            spaces.append([index])
    return spaces

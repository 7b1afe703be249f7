# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Where the example files that come with the package lie."""

import os
from pathlib import Path
import sys

from identnl_ros.core.errors import DataError


def shipped_config(name: str) -> Path:
    """
    Find an example machine or layout file.

    Parameters
    ----------
    name : str
        E.g. ``knee_column.yaml``.

    Returns
    -------
    Path

    Raises
    ------
    DataError
        If the package was installed without it.

    """
    checkout = Path(__file__).parents[2]
    prefixes = [*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix]
    folders = [
        checkout / 'config',
        *(Path(prefix) / 'share/identnl_ros/config' for prefix in prefixes if prefix),
    ]
    for folder in folders:
        if (folder / name).is_file():
            return folder / name
    raise DataError(
        f'{name} was not installed with identnl_ros; looked in '
        f'{", ".join(str(folder) for folder in folders)}'
    )

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Libraries that only some users need: of file formats, of manufacturers of devices."""

import importlib
from types import ModuleType

from identnl_ros.core.errors import DataError


def library(module: str, package: str, purpose: str) -> ModuleType:
    """
    Import a library that only some users need.

    Parameters
    ----------
    module : str
    package : str
        That brings it.
    purpose : str
        E.g. ``TDMS files``.

    Returns
    -------
    module

    Raises
    ------
    DataError
        If it is not installed.

    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise DataError(
            f'{purpose} need the Python package {package}, which cannot be imported ({error}); '
            f'install it: python -m pip install {package}'
        ) from None

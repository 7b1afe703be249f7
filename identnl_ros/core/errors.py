# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Errors a user can cause and mend; every one says what, where, found, expected, next step."""


class IdentnlError(Exception):
    """Base of all errors that are reported to the user without a traceback."""


class MachineError(IdentnlError):
    """The machine's description cannot be true or is incomplete."""


class LayoutError(IdentnlError):
    """The sensor layout is unsound or does not fit the machine."""


class DataError(IdentnlError):
    """Recorded or received data cannot be used."""

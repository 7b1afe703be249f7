# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Quality of service of every topic, with the reason for it."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

BLOCK_DEPTH = 1000
RECORDING_DEPTH = 2000


def blocks() -> QoSProfile:
    """
    Profile of samples and motion.

    Reliable, because a lost block is a hole in the regression. Volatile, because a consumer that
    joins later begins with the present. Deep, because reliable delivery holds nobody up: a
    consumer that stalls loses what no longer fits, and 1000 blocks are 10 s at 100 blocks/s.

    Returns
    -------
    QoSProfile

    """
    return _reliable(BLOCK_DEPTH)


def stand_description() -> QoSProfile:
    """
    Profile of the description of a stream.

    Latched (transient local), because consumers that join later need it too; the last one of a
    source is the valid one.

    Returns
    -------
    QoSProfile

    """
    return _reliable(1, latched=True)


def estimates() -> QoSProfile:
    """
    Profile of the estimates.

    Latched, because an estimate holds until the next: who asks later gets the last one,
    also after the stream has ended.

    Returns
    -------
    QoSProfile

    """
    return _reliable(1, latched=True)


def discrepancy() -> QoSProfile:
    """
    Profile of the reports of what the machine lacks.

    Latched, because a report holds until the next, and who asked for it may be gone for a while.

    Returns
    -------
    QoSProfile

    """
    return _reliable(1, latched=True)


def consumed() -> QoSProfile:
    """
    Profile of the consumers' progress.

    Reliable and latched, because a source without word from a consumer would wait for it;
    only the last word of each counts.

    Returns
    -------
    QoSProfile

    """
    return _reliable(1, latched=True)


def progress() -> QoSProfile:
    """
    Profile with which a source listens to its consumers' progress.

    As `consumed`, with room for the last word of many consumers at once.

    Returns
    -------
    QoSProfile

    """
    return _reliable(100, latched=True)


def diagnostics() -> QoSProfile:
    """
    Profile of /diagnostics: that of everybody else on this topic.

    Returns
    -------
    QoSProfile

    """
    return _reliable(10)


def recording(latched: bool) -> QoSProfile:
    """
    Profile with which a recorder listens.

    Deeper than any publisher's, because what a recorder misses is gone. Reliable topics only.

    Parameters
    ----------
    latched : bool
        Also take what was published before.

    Returns
    -------
    QoSProfile

    """
    return _reliable(RECORDING_DEPTH, latched=latched)


def overriding() -> QoSOverridingOptions:
    """
    Let history, depth and reliability of a topic be overridden by parameters (qos_overrides).

    Returns
    -------
    QoSOverridingOptions

    """
    return QoSOverridingOptions.with_default_policies()


def _reliable(depth: int, latched: bool = False) -> QoSProfile:
    # A new object every time: overriding parameters are written into it.
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )

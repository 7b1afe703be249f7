# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""All nodes of a stand in one process."""

from collections.abc import Sequence
import sys

from identnl_ros.nodes.identifier import IdentifierNode
from identnl_ros.nodes.managed_node import ManagedNode
from identnl_ros.nodes.recorder import Recorder
from identnl_ros.nodes.running import run
from identnl_ros.nodes.sensor_bridge import SensorBridge
from identnl_ros.nodes.transform import Transform


def make_nodes() -> list[ManagedNode]:
    """
    Make the nodes in the order in which samples pass through them.

    Returns
    -------
    list of ManagedNode
        The recorder only if its parameter path says where to.

    """
    nodes: list[ManagedNode] = [SensorBridge(), Transform(), IdentifierNode()]
    recorder = Recorder()
    if recorder.setting('path'):
        nodes.append(recorder)
    else:
        recorder.destroy_node()
    return nodes


def main(args: Sequence[str] | None = None) -> int:
    """
    Run the nodes.

    Parameters
    ----------
    args : sequence of str or None
        None: those of the process.

    Returns
    -------
    int
        Exit code.

    """
    return run(make_nodes, args)


if __name__ == '__main__':
    sys.exit(main())

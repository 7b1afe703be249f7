# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What is to be started for a stand; knows nothing of ROS, so that it can be tested without."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from identnl_ros.core.errors import DataError


@dataclass(frozen=True)
class Argument:
    """
    An argument of the launch file.

    Parameters
    ----------
    name : str
    default : str
    description : str

    """

    name: str
    default: str
    description: str


@dataclass(frozen=True)
class PlannedNode:
    """
    A node to start.

    Parameters
    ----------
    executable : str
        Also the name of the node.
    parameters : dict

    """

    executable: str
    parameters: dict[str, object] = field(default_factory=dict)


ARGUMENTS = (
    Argument('namespace', 'stand', 'Namespace of the stand.'),
    Argument('machine_file', '', 'Machine file (YAML); needed for a simulated stand.'),
    Argument('layout_file', '', 'Sensor layout file (YAML); empty: beside the machine file.'),
    Argument('bag', '', 'Bag to replay; empty: simulate the stand.'),
    Argument('excitation', 'multisine', 'Form of the force: multisine, sine, sweep, impulse.'),
    Argument('duration', '10.0', 'Length of the simulated run [s].'),
    Argument('seed', '0', 'Seed of all that is random in the simulated stand.'),
    Argument('speed', '1.0', 'Times real time; 0: as fast as the consumers keep up.'),
    Argument('record', '', 'Bag to write; empty: record nothing.'),
    Argument('state_directory', '', 'Folder of saved states of the identifier.'),
)


def plan(arguments: Mapping[str, str]) -> list[PlannedNode]:
    """
    Choose the nodes of a stand and their parameters; consumers first.

    Parameters
    ----------
    arguments : mapping of str
        Values of `ARGUMENTS` as texts; those that are missing count as the default.

    Returns
    -------
    list of PlannedNode

    Raises
    ------
    DataError
        If an argument is missing or no number.

    """
    given = {argument.name: argument.default for argument in ARGUMENTS} | dict(arguments)
    nodes = [
        PlannedNode('identifier', {'state_directory': given['state_directory']}),
        PlannedNode('transform'),
    ]
    if given['record']:
        nodes.insert(0, PlannedNode('recorder', {'path': given['record']}))
    bridge: dict[str, object] = {
        'speed': _number(given, 'speed', float),
        'wait_for_consumers': len(nodes),
    }
    if given['bag']:
        bridge |= {'source': 'bag', 'bag': given['bag']}
    elif given['machine_file']:
        bridge |= {
            'source': 'simulated',
            'machine_file': given['machine_file'],
            'layout_file': given['layout_file'],
            'excitation': given['excitation'],
            'duration': _number(given, 'duration', float),
            'seed': _number(given, 'seed', int),
        }
    else:
        raise DataError('launch: give machine_file:=... to simulate a stand, or bag:=...')
    return [*nodes, PlannedNode('sensor_bridge', bridge)]


def _number(given: Mapping[str, str], name: str, kind: type[float] | type[int]) -> float | int:
    try:
        return kind(given[name])
    except ValueError:
        raise DataError(f'launch: {name} is "{given[name]}", expected a number') from None

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What is to be started for a stand; knows nothing of launch, so that it can be tested without."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.nodes.identifier import IdentifierNode
from identnl_ros.nodes.managed_node import ManagedNode
from identnl_ros.nodes.parameter_file import read_parameter_file
from identnl_ros.nodes.parameters import AUTOSTART
from identnl_ros.nodes.recorder import Recorder
from identnl_ros.nodes.sensor_bridge import SensorBridge
from identnl_ros.nodes.source_choice import chosen_sources, is_kind_of_device, parameter_name
from identnl_ros.nodes.transform import Transform
from identnl_ros.sources.registry import installed_sources
from identnl_ros.sources.setting import Setting
import yaml

# By the names of executables and nodes, consumers before whom they consume from.
KINDS: dict[str, type[ManagedNode]] = {
    'recorder': Recorder,
    'identifier': IdentifierNode,
    'transform': Transform,
    'sensor_bridge': SensorBridge,
}
# Parameters of the identifier that are arguments too; of the bridge all are but the last ones.
_OF_IDENTIFIER = ('estimator', 'state_directory')
_NOT_OFFERED = ('wait_for_consumers', 'exit_at_end')


@dataclass(frozen=True)
class Argument:
    """
    An argument of the launch file.

    Parameters
    ----------
    name : str
    description : str
    default : str
        Empty: what the parameter file says, or else the node's own default.
    node : str
        Whose parameter it is; empty: of the launch file itself.
    setting : Setting or None
        That parameter.

    """

    name: str
    description: str
    default: str = ''
    node: str = ''
    setting: Setting | None = None


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
    parameters: dict[str, Any] = field(default_factory=dict)


def arguments() -> tuple[Argument, ...]:
    """
    Give the arguments of the launch file, with those of all sources that are installed.

    Returns
    -------
    tuple of Argument

    """
    own = (
        Argument('namespace', 'Namespace of the stand.', 'stand'),
        Argument(
            'parameters',
            'Parameter file of ROS (YAML) with sections of the nodes; arguments go before it.',
        ),
        Argument('record', 'Bag to write; empty: record nothing.'),
    )
    offered = [
        (node, setting)
        for node, kind in reversed(KINDS.items())
        for setting in kind.all_settings()
        if (node == 'sensor_bridge' and setting.name not in _NOT_OFFERED)
        or (node == 'identifier' and setting.name in _OF_IDENTIFIER)
    ]
    return (*own, *(_argument(node, setting) for node, setting in offered))


def plan(given: Mapping[str, str]) -> list[PlannedNode]:
    """
    Choose the nodes of a stand and their parameters; consumers first.

    Parameters
    ----------
    given : mapping of str
        Values of `arguments` as texts; those that are missing or empty count as not given.

    Returns
    -------
    list of PlannedNode

    Raises
    ------
    DataError
        If an argument, the parameter file or what both together ask for is unsound.

    """
    texts = {name: text for name, text in given.items() if text != ''}
    parameters: dict[str, dict[str, Any]] = {node: {} for node in KINDS}
    if 'parameters' in texts:
        parameters = read_parameter_file(
            Path(texts['parameters']),
            texts.get('namespace', 'stand'),
            {node: (AUTOSTART, *kind.all_settings()) for node, kind in KINDS.items()},
        )
    for argument in arguments():
        if argument.setting is not None and argument.name in texts:
            value = _value(argument.setting, texts[argument.name])
            parameters[argument.node][argument.name] = value
    if 'record' in texts:
        parameters['recorder']['path'] = texts['record']
    bridge = parameters['sensor_bridge']
    if 'bag' in texts and 'source' not in texts:
        bridge['source'] = 'bag'
    _check_source(bridge, texts)
    nodes = [
        PlannedNode(node, parameters[node])
        for node in KINDS
        if node != 'recorder' or parameters[node].get('path')
    ]
    bridge.setdefault('wait_for_consumers', len(nodes) - 1)
    return nodes


def _argument(node: str, setting: Setting) -> Argument:
    choices = f' One of: {", ".join(setting.choices)}.' if setting.choices else ''
    default = ', '.join(setting.default) if isinstance(setting.default, list) else setting.default
    shown = 'empty' if default == '' else default
    description = f'{setting.description}{choices} Default of {node}: {shown}.'
    return Argument(setting.name, description, '', node, setting)


def _value(setting: Setting, text: str) -> Any:
    """Read an argument; lists are written as in YAML, or one text alone."""
    value: Any = text
    if not isinstance(setting.default, str):
        with suppress(yaml.YAMLError):  # then it is refused as a text
            value = setting.converted(yaml.safe_load(text))
    if reason := setting.refusal(value):
        raise DataError(f'launch: {reason}')
    return value


def _check_source(bridge: Mapping[str, Any], texts: Mapping[str, str]) -> None:
    """Refuse what the bridge could not begin with, and arguments that would have no effect."""
    if not {'source', 'machine_file', 'bag'} & bridge.keys():
        raise DataError(
            'launch: nothing is named that samples come from; give machine_file:=... to simulate '
            'a stand, bag:=... to replay a bag, or source:=... and machine_file:=... to measure'
        )
    text = bridge.get('source', 'simulated')
    chosen = chosen_sources(text)
    names = [source.name for source in chosen]
    if names == ['bag'] and not bridge.get('bag'):
        raise DataError('launch: source is "bag", but bag is empty; give bag:=...')
    needs_machine = names == ['simulated'] or any(map(is_kind_of_device, chosen))
    if needs_machine and not bridge.get('machine_file'):
        raise DataError(
            f'launch: source is "{text}", but machine_file is empty; give machine_file:=... '
            'of the stand'
        )
    for source in installed_sources():
        for setting in source.settings:
            name = parameter_name(source.name, setting.name)
            if name in texts and source.name not in names:
                raise DataError(
                    f'launch: {name} is "{texts[name]}", but source is "{text}", which does not '
                    f'have it; leave it out, or give source:={source.name}'
                )

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""What the launch file starts exists and takes the parameters it is given."""

import ast
from importlib import import_module
from pathlib import Path

from identnl_ros.core.errors import DataError
from identnl_ros.nodes.launch_plan import ARGUMENTS, plan
import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
MACHINE = str(ROOT / 'config' / 'oscillator.yaml')


def node_settings(name):
    module = import_module(f'identnl_ros.nodes.{name}')
    kinds = {
        'sensor_bridge': 'SensorBridge',
        'transform': 'Transform',
        'identifier': 'IdentifierNode',
        'recorder': 'Recorder',
    }
    settings = getattr(module, kinds[name]).all_settings()
    # Those of kinds of device, which may be installed or not, have a prefix.
    return {setting.name: setting for setting in settings if '.' not in setting.name}


@pytest.mark.ros
@pytest.mark.parametrize(
    'arguments', [{'machine_file': MACHINE, 'record': 'bag'}, {'bag': 'a', 'speed': '0'}]
)
def test_planned_nodes_take_their_parameters(arguments):
    for node in plan(arguments):
        settings = node_settings(node.executable)
        for name, value in node.parameters.items():
            assert type(value) is type(settings[name].default)
            assert settings[name].refusal(value) == ''


def test_source_comes_last_and_waits_for_all_others():
    *others, bridge = plan({'machine_file': MACHINE, 'record': 'bag'})
    assert [node.executable for node in others] == ['recorder', 'identifier', 'transform']
    assert bridge.executable == 'sensor_bridge'
    assert bridge.parameters['wait_for_consumers'] == 3


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [({}, 'give machine_file'), ({'bag': 'a', 'speed': 'fast'}, 'speed is "fast"')],
)
def test_unsound_argument_is_refused(arguments, words):
    with pytest.raises(DataError, match=words):
        plan(arguments)


def test_launch_file_is_sound_python_and_declares_what_the_plan_reads():
    path = ROOT / 'launch' / 'stand_launch.py'
    tree = ast.parse(path.read_text())
    compile(tree, str(path), 'exec')
    assert 'generate_launch_description' in {
        node.name for node in tree.body if isinstance(node, ast.FunctionDef)
    }
    assert len({argument.name for argument in ARGUMENTS}) == len(ARGUMENTS)


@pytest.mark.ros
@pytest.mark.parametrize('name', ['sensor_bridge', 'transform', 'identifier', 'recorder'])
def test_parameter_file_lists_every_parameter_with_its_default(name):
    content = yaml.safe_load((ROOT / 'config' / 'nodes' / f'{name}.yaml').read_text())
    listed = content['/**']['ros__parameters']
    settings = node_settings(name)
    assert listed.pop('autostart') is True
    assert listed == {key: setting.default for key, setting in settings.items()}


@pytest.mark.ros
@pytest.mark.parametrize('name', ['sensor_bridge', 'transform', 'identifier', 'recorder'])
def test_reference_names_every_parameter(name):
    text = (ROOT / 'docs' / 'nodes.md').read_text()
    assert [key for key in node_settings(name) if f'`{key}`' not in text] == []

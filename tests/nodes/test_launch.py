# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""What the launch file starts exists and takes the parameters it is given."""

from pathlib import Path
import re
import runpy
import sys
from types import ModuleType, SimpleNamespace

from identnl_ros.core.errors import DataError
from identnl_ros.nodes.launch_plan import arguments, KINDS, plan
import pytest
import yaml

pytestmark = pytest.mark.ros

ROOT = Path(__file__).resolve().parents[2]
MACHINE = str(ROOT / 'config' / 'oscillator.yaml')
SIMULATED = {'machine_file': MACHINE}
OPENDAQ = {'source': 'opendaq', **SIMULATED}


def node_settings(name):
    # Those of kinds of device, which may be installed or not, have a prefix.
    settings = KINDS[name].all_settings()
    return {setting.name: setting for setting in settings if '.' not in setting.name}


def planned(given, name='sensor_bridge'):
    (node,) = (one for one in plan(given) if one.executable == name)
    return node.parameters


@pytest.fixture
def parameter_file(tmp_path):
    def write(text):
        path = tmp_path / 'bench.yaml'
        path.write_text(text)
        return str(path)

    return write


@pytest.mark.parametrize(
    'given',
    [
        {**SIMULATED, 'record': 'bag', 'duration': '3', 'amplitude': '1e3', 'seed': '4'},
        {'bag': 'a', 'speed': '0', 'estimator': 'pointwise'},
        {**SIMULATED, 'source': 'opendaq+topics', 'opendaq.connection': 'daq.nd://10.0.0.5:7420',
         'topics.topics': '[/a/imu, "/b/imu:sensor_msgs/msg/Imu"]'},
    ],
)  # fmt: skip
def test_planned_nodes_take_their_parameters(given):
    for node in plan(given):
        settings = {one.name: one for one in KINDS[node.executable].all_settings()}
        for name, value in node.parameters.items():
            assert type(value) is type(settings[name].default)
            assert settings[name].refusal(value) == ''


def test_source_comes_last_and_waits_for_all_others():
    *others, bridge = plan({**SIMULATED, 'record': 'bag'})
    assert [node.executable for node in others] == ['recorder', 'identifier', 'transform']
    assert bridge.executable == 'sensor_bridge'
    assert bridge.parameters['wait_for_consumers'] == 3


def test_arguments_reach_the_node_that_has_them():
    given = {
        **OPENDAQ, 'opendaq.connection': 'daq.nd://a:7420', 'estimator': 'pointwise',
        'opendaq.channels': '[force, probe]', 'device_silence': '2', 'duration': '',
    }  # fmt: skip
    assert planned(given) == {
        **OPENDAQ, 'opendaq.connection': ['daq.nd://a:7420'], 'wait_for_consumers': 2,
        'opendaq.channels': ['force', 'probe'], 'device_silence': 2.0,
    }  # fmt: skip
    assert planned(given, 'identifier') == {'estimator': 'pointwise'}
    assert planned(given, 'transform') == {}


def test_every_setting_of_an_installed_source_is_an_argument():
    names = [argument.name for argument in arguments()]
    assert len(set(names)) == len(names)
    bridge = {one.name for one in KINDS['sensor_bridge'].all_settings()}
    assert bridge - set(names) == {'wait_for_consumers', 'exit_at_end'}


@pytest.mark.parametrize(
    ('section', 'reached'),
    [
        ('/**', True), ('/stand/sensor_bridge', True), ('stand/sensor_bridge', True),
        ('/**/sensor_bridge', True), ('/*/sensor_bridge', True), ('sensor_bridge', True),
        ('/other/sensor_bridge', False), ('/stand/*/sensor_bridge', False), ('bridge', False),
    ],
)  # fmt: skip
def test_sections_are_named_as_ros_names_them(parameter_file, section, reached):
    path = parameter_file(f'{section}:\n  ros__parameters: {{source: bag, bag: a}}\n')
    if reached:
        assert planned({'parameters': path})['bag'] == 'a'
    else:
        with pytest.raises(DataError, match=re.escape(f'"{section.strip("/")}" is for no node')):
            plan({'parameters': path})


def test_parameter_file_speaks_to_every_node_and_arguments_go_before_it(parameter_file):
    path = parameter_file("""
stand:
  sensor_bridge:
    ros__parameters:
      source: opendaq
      device_silence: 5
      opendaq: {connection: ['daq.nd://a:7420'], sample_rate: 1e4}
  identifier: {ros__parameters: {estimator: pointwise, memory: 20, use_sim_time: false}}
/**: {ros__parameters: {machine_file: slide.yaml}}
recorder: {ros__parameters: {path: run.mcap}}
""")
    given = {'parameters': path, 'device_silence': '1.5', 'layout_file': 'b.yaml'}
    assert planned(given) == {
        'source': 'opendaq', 'device_silence': 1.5, 'opendaq.connection': ['daq.nd://a:7420'],
        'opendaq.sample_rate': 1e4, 'machine_file': 'slide.yaml', 'layout_file': 'b.yaml',
        'wait_for_consumers': 3,
    }  # fmt: skip
    assert planned(given, 'identifier') == {
        'estimator': 'pointwise', 'memory': 20.0, 'use_sim_time': False,
        'machine_file': 'slide.yaml',
    }  # fmt: skip
    # The recorder has no machine file.
    assert planned(given, 'recorder') == {'path': 'run.mcap'}


@pytest.mark.parametrize('name', KINDS)
def test_shipped_parameter_files_can_be_launched(name):
    path = ROOT / 'config' / 'nodes' / f'{name}.yaml'
    given = {'parameters': str(path), **SIMULATED, 'record': 'bag'}
    listed = yaml.safe_load(path.read_text())['/**']['ros__parameters']
    reached = planned(given, name)
    assert {key: reached[key] for key in listed if key not in ('machine_file', 'path')} == {
        key: value for key, value in listed.items() if key not in ('machine_file', 'path')
    }


@pytest.mark.parametrize(
    ('given', 'words'),
    [
        ({}, 'nothing is named that samples come from; give machine_file:='),
        ({'bag': 'a', 'speed': 'fast'}, 'speed is "fast", expected a number'),
        ({'bag': 'a', 'speed': '-1'}, 'speed is -1.0, expected 0 to 1e+06'),
        ({'bag': 'a', 'estimator': 'best'}, 'estimator is "best", expected one of: weak'),
        ({**SIMULATED, 'seed': '1.5'}, 'seed is 1.5, expected a whole number'),
        ({'source': 'bag'}, 'source is "bag", but bag is empty'),
        ({'source': 'opendaq'}, 'source is "opendaq", but machine_file is empty'),
        ({**SIMULATED, 'source': 'opendak'}, 'did you mean "opendaq"?'),
        ({**SIMULATED, 'source': 'opendaq+bag'}, 'bag cannot be joined'),
        ({**OPENDAQ, 'bag': 'a'}, 'bag is "a", but source is "opendaq"'),
        ({**OPENDAQ, 'duration': '5'}, 'leave it out, or give source:=simulated'),
        ({**OPENDAQ, 'nidaqmx.iepe': 'x'}, 'nidaqmx.iepe is "x", but source is "opendaq"'),
        ({**OPENDAQ, 'opendaq.channels': '[1, 2]'}, 'expected a list of texts'),
    ],
)
def test_unsound_argument_is_refused(given, words):
    with pytest.raises(DataError, match=re.escape(words)):
        plan(given)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('sensor_bridge: {source: opendaq}', 'expected the name of a node, below it'),
        ('a: [', 'is not YAML'),
        ('sensor_bridge: {ros__parameters: {opendaq.conection: [a]}}',
         'parameter "opendaq.conection" of sensor_bridge is unknown; did you mean "opendaq.conn'),
        ('identifier: {ros__parameters: {memory: long}}', 'memory is "long", expected a number'),
        ('/**: {ros__parameters: {estimater: weak}}', 'did you mean "estimator"?'),
    ],
)  # fmt: skip
def test_unsound_parameter_file_is_refused(parameter_file, text, words):
    with pytest.raises(DataError, match=re.escape(words)):
        plan({**SIMULATED, 'parameters': parameter_file(text)})


def test_parameter_file_that_is_not_there_is_told():
    with pytest.raises(DataError, match=r'nowhere\.yaml cannot be read: No such file'):
        plan({**SIMULATED, 'parameters': 'nowhere.yaml'})


def launched(monkeypatch, given):
    """Run the launch file; the package launch is in no package index, so this stands in for it."""

    def module(name, **content):
        made = ModuleType(name)
        vars(made).update(content)
        monkeypatch.setitem(sys.modules, name, made)

    def noted(kind):
        return lambda *values, **named: SimpleNamespace(kind=kind, values=values, named=named)

    class Configuration:
        def __init__(self, name):
            self.name = name

        def perform(self, context):
            return context[self.name]

    module('launch', LaunchDescription=list, LaunchContext=dict)
    module('launch.actions', DeclareLaunchArgument=noted('argument'),
           OpaqueFunction=noted('function'))  # fmt: skip
    module('launch.substitutions', LaunchConfiguration=Configuration)
    module('launch_ros')
    module('launch_ros.actions', LifecycleNode=noted('node'))
    file = runpy.run_path(str(ROOT / 'launch' / 'stand_launch.py'))
    *declared, function = file['generate_launch_description']()
    assert {one.kind for one in declared} == {'argument'}
    defaults = {one.values[0]: one.named['default_value'] for one in declared}
    return [one.named for one in function.named['function']({**defaults, **given})]


def test_launch_file_starts_what_is_planned(monkeypatch):
    given = {**OPENDAQ, 'namespace': 'mill', 'opendaq.connection': 'daq.nd://a:7420'}
    nodes = launched(monkeypatch, given)
    for node, wanted in zip(nodes, plan(given), strict=True):
        assert node['package'] == 'identnl_ros'
        assert node['executable'] == node['name'] == wanted.executable
        assert node['namespace'] == 'mill'
        assert node['parameters'] == ([wanted.parameters] if wanted.parameters else [])


@pytest.mark.parametrize('name', ['sensor_bridge', 'transform', 'identifier', 'recorder'])
def test_parameter_file_lists_every_parameter_with_its_default(name):
    content = yaml.safe_load((ROOT / 'config' / 'nodes' / f'{name}.yaml').read_text())
    listed = content['/**']['ros__parameters']
    settings = node_settings(name)
    assert listed.pop('autostart') is True
    assert listed == {key: setting.default for key, setting in settings.items()}


@pytest.mark.parametrize('name', ['sensor_bridge', 'transform', 'identifier', 'recorder'])
def test_reference_names_every_parameter(name):
    text = (ROOT / 'docs' / 'nodes.md').read_text()
    assert [key for key in node_settings(name) if f'`{key}`' not in text] == []

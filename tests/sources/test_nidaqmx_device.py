# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""What can be tested of NI devices without one: words, and calls against the real package."""

import ast
import inspect
from pathlib import Path

from identnl_ros.core.errors import DataError
from identnl_ros.sources import nidaqmx_device
from identnl_ros.sources.device import DeviceLost
import pytest

nidaqmx = pytest.importorskip('nidaqmx', reason='nidaqmx is not installed (extra nidaqmx)')
pytest.importorskip('nidaqmx.stream_readers')

TREE = ast.parse(Path(nidaqmx_device.__file__).read_text())


def classes():
    """Of what the module calls, by how the source calls it."""
    from nidaqmx.stream_readers import AnalogMultiChannelReader
    from nidaqmx.task import InStream, Task
    from nidaqmx.task._timing import Timing
    from nidaqmx.task.channels import AIChannel
    from nidaqmx.task.collections import AIChannelCollection

    return {
        'task': Task,
        'task.ai_channels': AIChannelCollection,
        'task.timing': Timing,
        'task.in_stream': InStream,
        'self._reader': AnalogMultiChannelReader,
        'channel': AIChannel,
    }


def device(**settings):
    values = {one.name: one.default for one in nidaqmx_device.source.settings} | settings
    (made,) = nidaqmx_device.source.devices(values.__getitem__)
    return made


def test_missing_driver_is_told_with_what_to_install():
    made = device(voltage=['Dev1/ai0'])
    try:
        nidaqmx.Task().close()
    except nidaqmx.errors.DaqNotFoundError:
        pass
    else:
        pytest.skip('the driver NI-DAQmx is installed here')
    with pytest.raises(DataError, match=r'NI-DAQmx is not installed .* nidaqmx installdriver'):
        made.open()
    made.close()
    with pytest.raises(DeviceLost, match='not open'):
        made.read(0.0)


def test_no_channel_is_refused_in_words():
    with pytest.raises(DataError, match='voltage and iepe are empty; give physical channels'):
        device()


def test_calls_fit_the_signatures_of_the_package():
    known, checked = classes(), set()
    for node in ast.walk(TREE):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
            continue
        owner = known.get(ast.unparse(node.func.value))
        if owner is None:
            continue
        signature = inspect.signature(getattr(owner, node.func.attr))
        arguments = {word.arg: None for word in node.keywords}
        signature.bind(None, *([None] * len(node.args)), **arguments)
        checked.add(node.func.attr)
    assert checked >= {
        'add_ai_voltage_chan', 'cfg_samp_clk_timing', 'read_many_sample', 'start', 'close',
    }  # fmt: skip
    reader = inspect.signature(nidaqmx.stream_readers.AnalogMultiChannelReader)
    reader.bind(None)


def test_properties_exist_and_those_that_are_set_can_be_set():
    known, found = classes(), {}
    for node in ast.walk(TREE):
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) in known:
            owner = known[ast.unparse(node.value)]
            member = inspect.getattr_static(owner, node.attr)
            if isinstance(node.ctx, ast.Store):
                assert member.fset is not None, node.attr
            found[node.attr] = member
    assert found.keys() >= {
        'samp_clk_rate', 'avail_samp_per_chan', 'channel_names', 'ai_coupling', 'ai_excit_src',
        'ai_excit_val',
    }  # fmt: skip


def test_constants_and_errors_exist():
    names = {
        ast.unparse(node).removeprefix('ni.')
        for node in ast.walk(TREE)
        if isinstance(node, ast.Attribute) and ast.unparse(node).startswith('ni.')
    }
    for name in sorted(names):
        value = nidaqmx
        for part in name.split('.'):
            value = getattr(value, part)
    terminals = nidaqmx.constants.TerminalConfiguration.__members__
    (terminal,) = [one for one in nidaqmx_device.source.settings if one.name == 'terminal']
    assert set(terminal.choices) == set(terminals)
    assert all(hasattr(nidaqmx.error_codes.DAQmxErrors, name) for name in nidaqmx_device._ABSENT)

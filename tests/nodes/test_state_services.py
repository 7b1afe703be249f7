# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""What an identifier has learned can be saved, loaded and forgotten while it runs."""

from identnl_msgs.srv import LoadIdentifierState, ResetIdentifier, SaveIdentifierState
import pytest

pytestmark = pytest.mark.ros


def test_state_survives_the_process(start, watcher, bridge_settings, offline, same_bits, tmp_path):
    folder = tmp_path / 'states'
    folder.mkdir()
    first = start('stand', **bridge_settings, state_directory=folder)
    assert same_bits(watcher.final_estimate(), offline)
    saved = watcher.call(SaveIdentifierState, 'identifier/save_state', file_name='run.npz')
    assert saved.success, saved.message
    assert saved.message == str(folder / 'run.npz')
    for name in ('', '../run.npz', 'a/b', '..'):
        answer = watcher.call(SaveIdentifierState, 'identifier/save_state', file_name=name)
        assert not answer.success
        assert 'without folder' in answer.message
    assert [path.name for path in folder.iterdir()] == ['run.npz']
    assert watcher.call(ResetIdentifier, 'identifier/reset').success
    watcher.until(lambda: watcher.estimates[-1].samples_used == 0)
    first.signal(15)
    assert first.exit_code() == 0

    # Loaded before any block has come: the description alone tells the machine.
    watcher.estimates.clear()
    start('identifier', state_directory=folder)
    start('sensor_bridge', **{**bridge_settings, 'wait_for_consumers': 9})
    (folder / 'broken.npz').write_bytes(b'PK\x03\x04 not really')

    def loaded():
        answer = watcher.call(LoadIdentifierState, 'identifier/load_state', file_name='run.npz')
        return answer.success

    watcher.until(loaded)
    watcher.until(lambda: watcher.estimates)
    assert watcher.estimates[-1].samples_used == offline.samples
    for found, expected in zip(watcher.estimates[-1].parameters, offline.parameters, strict=True):
        assert found.value == expected.value
    for name, words in (('none.npz', 'cannot be read'), ('broken.npz', 'no state')):
        answer = watcher.call(LoadIdentifierState, 'identifier/load_state', file_name=name)
        assert not answer.success
        assert words in answer.message


def test_services_are_refused_without_a_folder(start, watcher, bridge_settings):
    start('stand', **bridge_settings)
    watcher.final_estimate()
    answer = watcher.call(SaveIdentifierState, 'identifier/save_state', file_name='run.npz')
    assert not answer.success
    assert 'state_directory is empty' in answer.message

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""
An openDAQ device of the tests: a process that sends a table of samples by the native protocol.

The server of the SDK listens on all network interfaces and cannot be told otherwise. So this
process enters a network namespace that has nothing but a loopback device, and passes on what
comes to a socket of the outer loopback device, which the test opened.

Lines on standard input change what is sent, see `Sender.command`.
"""

import argparse
import contextlib
import ctypes
import fcntl
import json
import os
import queue
import socket
import struct
import sys
import threading
import time

CLONE_NEWUSER, CLONE_NEWNET = 0x10000000, 0x40000000
SIOCGIFFLAGS, SIOCSIFFLAGS, IFF_UP = 0x8913, 0x8914, 0x1
PORT = 7420
PACKET_TIME = 0.02  # [s]


def enter_namespace() -> str:
    """Leave all networks; the process may have one thread only. Returns why not, or nothing."""
    if ctypes.CDLL(None, use_errno=True).unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0:
        return f'no network namespace of its own: {os.strerror(ctypes.get_errno())}'
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        request = struct.pack('16sH14x', b'lo', 0)
        flags = struct.unpack('16sH14x', fcntl.ioctl(control, SIOCGIFFLAGS, request))[1]
        fcntl.ioctl(control, SIOCSIFFLAGS, struct.pack('16sH14x', b'lo', flags | IFF_UP))
    return ''


def pass_on(listener: socket.socket) -> None:
    """Connect whoever comes from the outer loopback device with the server in here."""

    def pump(source: socket.socket, sink: socket.socket) -> None:
        try:
            while data := source.recv(1 << 16):
                sink.sendall(data)
        except OSError:
            pass
        for one in (source, sink):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)

    while True:
        outer, _ = listener.accept()
        inner = socket.create_connection(('127.0.0.1', PORT))
        for ends in ((outer, inner), (inner, outer)):
            threading.Thread(target=pump, args=ends, daemon=True).start()


class Sender:
    """
    Own signals of an openDAQ device.

    `table`: file with `samples` of shape (n_samples, n_channels); sent again and again, so that
    the sample with index i, by the device's clock, is row ``i % n_samples``.
    `channels`: of each a dict with name, unit and, where it is sent as 16 bit integers, scale
    and offset.
    """

    def __init__(self, table: str, channels: list[dict], rate: int, origin: str) -> None:
        import numpy as np
        import opendaq as daq

        self.np, self.daq = np, daq
        self.samples = np.load(table)
        self.channels = channels
        builder = daq.InstanceBuilder()
        builder.global_log_level = daq.LogLevel.Off
        self.instance = builder.build()
        self.folder = daq.IFolderConfig.cast_from(self.instance.root_device.find_component('Sig'))
        self.rate, self.origin = rate, origin
        self.time = self.time_descriptor()
        self.clock = self.signal('clock', self.time)
        self.descriptors = [self.descriptor(one) for one in channels]
        self.signals = []
        for one, descriptor in zip(channels, self.descriptors, strict=True):
            signal = self.signal(one['name'], descriptor)
            signal.domain_signal = self.clock
            self.signals.append(signal)
        kind = self.instance.available_server_types['OpenDAQNativeStreaming']
        settings = daq.IComponentType.cast_from(kind).create_default_config()
        settings.set_property_value('NativeStreamingPort', PORT)
        self.server = self.instance.add_server('OpenDAQNativeStreaming', settings)
        self.index = 0
        self.lag = 0.0
        self.is_sending = True

    def signal(self, name: str, descriptor: object) -> object:
        signal = self.daq.SignalWithDescriptor(
            self.instance.context, descriptor, self.folder, name, None
        )
        self.folder.add_item(signal)
        return signal

    def time_descriptor(self) -> object:
        daq = self.daq
        builder = daq.DataDescriptorBuilder()
        builder.name = 'time'
        builder.sample_type = daq.SampleType.Int64
        builder.rule = daq.LinearDataRule(10, 0)  # ten ticks from sample to sample
        builder.tick_resolution = daq.Ratio(1, 10 * self.rate)
        builder.unit = daq.Unit(-1, 's', 'second', 'time')
        builder.origin = self.origin
        return builder.build()

    def descriptor(self, channel: dict) -> object:
        daq = self.daq
        builder = daq.DataDescriptorBuilder()
        builder.name = channel['name']
        builder.sample_type = daq.SampleType.Float64
        builder.unit = daq.Unit(-1, channel['unit'], channel['unit'], '')
        if 'scale' in channel:
            builder.post_scaling = daq.LinearScaling(
                channel['scale'],
                channel['offset'],
                daq.SampleType.Int16,
                daq.ScaledSampleType.Float64,
            )
        return builder.build()

    def send(self, count: int) -> None:
        np, daq = self.np, self.daq
        times = daq.DataPacket(self.time, count, 10 * self.index)
        rows = np.arange(self.index, self.index + count) % len(self.samples)
        for signal, descriptor, channel, values in zip(
            self.signals, self.descriptors, self.channels, self.samples[rows].T, strict=True
        ):
            kind = float
            if 'scale' in channel:
                kind = np.int16
                values = np.rint((values - channel['offset']) / channel['scale'])
            packet = daq.DataPacketWithDomain(times, descriptor, count, 0)
            np.frombuffer(packet.raw_data, kind)[:] = values
            signal.send_packet(packet)
        self.clock.send_packet(times)
        self.index += count

    def command(self, words: list[str]) -> None:
        match words:
            case ['lose', count]:
                self.index += int(count)
            case ['unit', name, unit]:
                number = [one['name'] for one in self.channels].index(name)
                self.channels[number]['unit'] = unit
                self.descriptors[number] = self.descriptor(self.channels[number])
                self.signals[number].descriptor = self.descriptors[number]
            case ['rate', rate]:
                self.rate = int(rate)
                self.time = self.time_descriptor()
                self.clock.descriptor = self.time
            case ['back', count]:
                self.index -= int(count)
            case ['silent' | 'sound' as how]:
                self.is_sending = how == 'sound'

    def run(self, begin: int) -> None:
        lines: queue.SimpleQueue[str] = queue.SimpleQueue()

        def listen() -> None:
            for line in sys.stdin:
                lines.put(line)

        threading.Thread(target=listen, daemon=True).start()
        self.index = begin
        due = time.monotonic()
        while True:
            while not lines.empty():
                self.command(lines.get().split())
            count = round(PACKET_TIME * self.rate)
            if self.is_sending:
                self.send(count)
            due += count / self.rate
            time.sleep(max(due - time.monotonic(), 0.0))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument('socket', type=int, help='number of the listening socket')
    parser.add_argument('table')
    parser.add_argument('channels', type=json.loads)
    parser.add_argument('rate', type=int, help='[Hz]')
    parser.add_argument('begin', type=int, help='index of the first sample')
    parser.add_argument('--origin', default='1970-01-01T00:00:00Z')
    chosen = parser.parse_args()
    if problem := enter_namespace():
        sys.exit(problem)
    sender = Sender(chosen.table, chosen.channels, chosen.rate, chosen.origin)
    listener = socket.socket(fileno=chosen.socket)
    threading.Thread(target=pass_on, args=(listener,), daemon=True).start()
    print('ready', flush=True)  # noqa: T201
    sender.run(chosen.begin)


if __name__ == '__main__':
    main()

# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What a node says about its health, and what it can see that is wrong around it."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import IntEnum

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.time import Time


class Level(IntEnum):
    """Severity, as in DiagnosticStatus.msg."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass
class Health:
    """
    Health of one part of a node: the gravest of its findings, and its numbers.

    Parameters
    ----------
    part : str
        Name of the part.
    values : dict of str
        Numbers by name; a name carries the unit.

    """

    part: str
    values: dict[str, object] = field(default_factory=dict)
    level: Level = Level.OK
    sentences: list[str] = field(default_factory=list)

    def add(self, level: Level, sentence: str) -> None:
        """
        Report a finding.

        Parameters
        ----------
        level : Level
        sentence : str

        """
        self.level = max(self.level, level)
        self.sentences.append(sentence)

    def warn_of(self, count: int, words: str) -> None:
        """
        Report a number of mishaps, if there were any.

        Parameters
        ----------
        count : int
        words : str
            What happened, to follow the number.

        """
        if count:
            self.add(Level.WARN, f'{count} {words}')

    @property
    def message(self) -> str:
        """All findings in one line."""
        return '; '.join(self.sentences) or 'OK'


def to_array(parts: list[Health], node: str, stand: str, now: Time) -> DiagnosticArray:
    """
    Make the message for /diagnostics.

    Parameters
    ----------
    parts : list of Health
    node : str
        Full name of the node.
    stand : str
        Name of the stand.
    now : Time

    Returns
    -------
    DiagnosticArray

    """
    array = DiagnosticArray()
    array.header.stamp = now.to_msg()
    for part in parts:
        status = DiagnosticStatus(
            level=bytes([part.level]),
            name=f'{node.lstrip("/")}: {part.part}',
            message=part.message,
            hardware_id=stand,
            values=[KeyValue(key=key, value=str(value)) for key, value in part.values.items()],
        )
        array.status.append(status)
    return array


def check_topic(node: Node, topic: str, type_name: str, health: Health) -> None:
    """
    Look at who else is on a topic that one node is to publish: other types, a second publisher.

    Parameters
    ----------
    node : Node
        The node that subscribes.
    topic : str
        Full name.
    type_name : str
        The type expected, e.g. ``identnl_msgs/msg/SampleBlock``.
    health : Health
        Where findings go.

    """
    publishers = node.get_publishers_info_by_topic(topic)
    for end in [*publishers, *node.get_subscriptions_info_by_topic(topic)]:
        if end.topic_type != type_name:
            health.add(
                Level.ERROR,
                f'{_full_name(end)} has the type {end.topic_type} on {topic}, expected '
                f'{type_name}; its messages do not arrive, rename its topic',
            )
    right = sorted(_full_name(end) for end in publishers if end.topic_type == type_name)
    health.values[f'publishers of {topic}'] = ', '.join(right) or 'none'
    if len(right) > 1:
        health.add(
            Level.ERROR,
            f'{topic} has {len(right)} publishers ({", ".join(right)}), expected one; '
            'stop all others or give each stand a namespace',
        )


def full_names(ends: Iterable[object]) -> set[str]:
    """
    Names of the nodes at the ends of a topic.

    Parameters
    ----------
    ends : iterable of TopicEndpointInfo

    Returns
    -------
    set of str

    """
    return {_full_name(end) for end in ends}


def _full_name(end: object) -> str:
    if 'UNKNOWN' in end.node_name:  # type: ignore[attr-defined]
        return 'a node that has not told its name yet'
    name, namespace = end.node_name, end.node_namespace  # type: ignore[attr-defined]
    return f'{namespace.rstrip("/")}/{name}'

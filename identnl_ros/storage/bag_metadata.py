# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What `ros2 bag` wants to know of a bag: quality of service, and the file metadata.yaml."""

from dataclasses import dataclass
from typing import Any

from identnl_ros.storage.bag_files import METADATA_KEY
import yaml

VERSION = 9
ROS_DISTRIBUTION = 'jazzy'

_FOREVER = {'sec': 9_223_372_036, 'nsec': 854_775_807}


@dataclass
class WrittenTopic:
    """
    A topic of a bag that is being written.

    Parameters
    ----------
    name : str
    type_name : str
    type_hash : str
    depth : int
        Length of the publisher's history.
    latched : bool
        Late subscribers get the last messages (transient local).
    count : int
        Messages so far.

    """

    name: str
    type_name: str
    type_hash: str
    depth: int
    latched: bool
    count: int = 0

    @property
    def offered_qos_profiles(self) -> list[dict[str, Any]]:
        """Quality of service with which the topic is to be played."""
        return [
            {
                'history': 'keep_last',
                'depth': self.depth,
                'reliability': 'reliable',
                'durability': 'transient_local' if self.latched else 'volatile',
                'deadline': dict(_FOREVER),
                'lifespan': dict(_FOREVER),
                'liveliness': 'automatic',
                'liveliness_lease_duration': dict(_FOREVER),
                'avoid_ros_namespace_conventions': False,
            }
        ]

    @property
    def channel_metadata(self) -> dict[str, str]:
        """What an MCAP channel tells of the topic."""
        return {
            'offered_qos_profiles': yaml.safe_dump(self.offered_qos_profiles, sort_keys=False),
            'topic_type_hash': self.type_hash,
        }


def metadata_text(
    file_name: str, topics: list[WrittenTopic], first_time_ns: int, last_time_ns: int
) -> str:
    """
    Make the text of metadata.yaml for a bag of one MCAP file.

    Parameters
    ----------
    file_name : str
    topics : list of WrittenTopic
    first_time_ns, last_time_ns : int
        Log time of the first and of the last message [ns].

    Returns
    -------
    str

    """
    count = sum(topic.count for topic in topics)
    span = {
        'starting_time': {'nanoseconds_since_epoch': first_time_ns},
        'duration': {'nanoseconds': last_time_ns - first_time_ns},
        'message_count': count,
    }
    content = {
        'version': VERSION,
        'storage_identifier': 'mcap',
        'relative_file_paths': [file_name],
        **span,
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': topic.name,
                    'type': topic.type_name,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': topic.offered_qos_profiles,
                    'type_description_hash': topic.type_hash,
                },
                'message_count': topic.count,
            }
            for topic in topics
        ],
        'compression_format': '',
        'compression_mode': '',
        'files': [{'path': file_name, **span}],
        'custom_data': None,
        'ros_distro': ROS_DISTRIBUTION,
    }
    return str(yaml.dump({METADATA_KEY: content}, Dumper=_PlainDumper, sort_keys=False))


class _PlainDumper(yaml.SafeDumper):
    """Writes equal values again instead of referring to the first."""

    def ignore_aliases(self, data: Any) -> bool:
        return True

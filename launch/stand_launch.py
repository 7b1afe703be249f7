# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Start the nodes of a stand: ros2 launch identnl_ros stand_launch.py machine_file:=..."""

from identnl_ros.nodes.launch_plan import arguments, plan
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode

from launch import LaunchContext, LaunchDescription


def start_nodes(context: LaunchContext) -> list[LifecycleNode]:
    given = {
        argument.name: LaunchConfiguration(argument.name).perform(context)
        for argument in arguments()
    }
    # The nodes configure and activate themselves (parameter autostart).
    return [
        LifecycleNode(
            package='identnl_ros',
            executable=node.executable,
            name=node.executable,
            namespace=given['namespace'],
            parameters=[node.parameters] if node.parameters else [],
            output='screen',
        )
        for node in plan(given)
    ]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(
                    argument.name,
                    default_value=argument.default,
                    description=argument.description,
                )
                for argument in arguments()
            ),
            OpaqueFunction(function=start_nodes),
        ]
    )

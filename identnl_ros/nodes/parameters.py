# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Declaration of parameters: each with a description, a range and whether it may change."""

from collections.abc import Callable, Iterable
from difflib import get_close_matches

from identnl_ros.sources.setting import Setting
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter

AUTOSTART = Setting(
    'autostart',
    True,
    'Configure and activate the node as it starts; a failure then ends the process with code 1. '
    'false: wait for a lifecycle manager.',
    read_only=True,
)


def unknown_overrides(given: Iterable[str], known: Iterable[str]) -> list[str]:
    """
    Tell which parameters are given to a node in vain.

    Parameters
    ----------
    given : iterable of str
        Names from the command line and parameter files.
    known : iterable of str
        Names that some node of the process declares.

    Returns
    -------
    list of str
        A sentence for each.

    """
    names = sorted(known)
    sentences = []
    for name in sorted(set(given) - set(names)):
        if name.startswith('qos_overrides.'):
            continue  # declared with the topics
        close = get_close_matches(name, names, 1)
        hint = f'did you mean "{close[0]}"?' if close else f'known are {", ".join(names)}'
        sentences.append(f'parameter "{name}" is unknown; {hint}')
    return sentences


def descriptor_of(setting: Setting) -> ParameterDescriptor:
    """
    Tell what tools show of a parameter.

    Parameters
    ----------
    setting : Setting

    Returns
    -------
    ParameterDescriptor

    """
    choices = setting.choices
    descriptor = ParameterDescriptor(
        description=setting.description,
        read_only=setting.read_only,
        additional_constraints=f'one of: {", ".join(choices)}' if choices else '',
    )
    if setting.lowest is not None and setting.highest is not None:
        lowest, highest = setting.lowest, setting.highest
        if isinstance(setting.default, float):
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(lowest), to_value=float(highest))
            ]
        else:
            descriptor.integer_range = [
                IntegerRange(from_value=int(lowest), to_value=int(highest))
            ]
    return descriptor


def declare(
    node: LifecycleNode, settings: tuple[Setting, ...], is_configured: Callable[[], bool]
) -> None:
    """
    Declare parameters and refuse changes that cannot take effect.

    Parameters
    ----------
    node : LifecycleNode
    settings : tuple of Setting
    is_configured : callable
        Whether it is too late to change a parameter that is not live.

    """
    known = {setting.name: setting for setting in settings}
    for setting in settings:
        node.declare_parameter(setting.name, setting.default, descriptor_of(setting))
    clock = node.describe_parameter('use_sim_time')
    clock.description = 'Take the time from the topic /clock instead of the computer.'
    node.set_descriptor('use_sim_time', clock)

    def check(parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            setting = known.get(parameter.name)
            if setting is None:
                continue
            if reason := setting.refusal(parameter.value):
                return SetParametersResult(successful=False, reason=reason)
            if not setting.live and is_configured():
                return SetParametersResult(
                    successful=False,
                    reason=f'{parameter.name} counts from the next configuration on; '
                    'clean the node up first',
                )
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(check)

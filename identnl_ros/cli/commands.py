# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The commands of `identnl`; every one is a module of its own, imported when it is called."""

import importlib
from typing import Any

import click
from identnl_ros import __version__

# Command: its module, and the one line that the overview shows without importing it.
COMMANDS = {
    'simulate': ('simulate', 'Record a bag on the simulated stand.'),
    'identify': ('identify', 'Identify the parameters of a machine from a bag.'),
    'diagnose': ('diagnose', 'Find what a model lacks where it differs from the measurement.'),
    'validate': ('validate', 'Compare a machine with identified parameters with a bag.'),
    'design': ('design', 'Tell what a planned run would determine, before it is made.'),
    'calibrate': ('calibrate', 'Find noise, gains, directions and delays of the sensors.'),
    'replay': ('replay', 'Publish the samples of a bag on ROS 2 topics.'),
    'record': ('record', 'Record the topics of a stand in a bag.'),
    'import': ('import_file', 'Turn a recorded file of another program into a bag.'),
    'export': ('export', 'Write the samples of a bag as a table for other programs.'),
    'check': ('check', 'Tell whether machine files, layout files and bags are sound.'),
    'demo': ('demo', 'Identify the simulated knee and column live, over DDS.'),
}


class _LazyGroup(click.Group):
    """Imports a command's module only when the command is used."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise click.Abort from None

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        module = importlib.import_module(f'identnl_ros.cli.{COMMANDS[name][0]}')
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section('Commands'):
            formatter.write_dl([(name, summary) for name, (_, summary) in COMMANDS.items()])


@click.group(cls=_LazyGroup, context_settings={'help_option_names': ['-h', '--help']})
@click.version_option(__version__, prog_name='identnl')
def cli() -> None:
    """
    Identify the nonlinear joints of vibrating machine tools.

    Exit code 0: done; 1: done, and the verdict is negative; 2: wrong use or unusable input;
    130: interrupted.
    """

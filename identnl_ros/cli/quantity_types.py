# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers on the command line: in SI, or with a unit."""

from typing import Any

import click


class _Noise(click.ParamType):  # type: ignore[type-arg]
    """none, nominal or a factor."""

    name = 'none|nominal|FACTOR'

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        if isinstance(value, float):
            return value
        words = {'none': 0.0, 'nominal': 1.0}
        try:
            return words[value] if value in words else float(value)
        except ValueError:
            self.fail(f'expected none, nominal or a factor, found "{value}"', param, ctx)


class _Quantity(click.ParamType):  # type: ignore[type-arg]
    """A number in SI, or with a unit."""

    def __init__(self, unit: str, example: str, name: str = '') -> None:
        self.name = name or unit
        self._unit = unit
        self._example = example

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        if isinstance(value, float):
            return value
        from identnl_ros.storage.quantities import Quantity

        try:
            return Quantity(self._unit, self._example).number(value)
        except ValueError as error:
            self.fail(str(error), param, ctx)


NOISE = _Noise()
FREQUENCY = _Quantity('Hz', 'a frequency such as "40 Hz"')
TIME = _Quantity('s', 'a time such as "4 s"')
FORCE = _Quantity('N', 'a force such as "100 daN"')
ERROR = _Quantity('', 'a relative error such as "1 %"', '%')

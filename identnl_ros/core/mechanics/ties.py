# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Ties between the numbers of a machine: which follow which."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.machine import Machine
from identnl_ros.core.mechanics.periodic_force import COSINE, PeriodicForce, SINE


@dataclass(frozen=True)
class Declared:
    """
    A number of the machine, as its description has it.

    Parameters
    ----------
    kind : str
        Of the part: ``body``, ``force`` or ``joint``.
    name : str
        Part and key, e.g. ``slideway_6.normal_stiffness``.
    symbol, unit : str
    coefficient : Coefficient
    inner : bool
        It is inside the laws of a joint, or the frequency of a force.

    """

    kind: str
    name: str
    symbol: str
    unit: str
    coefficient: Coefficient
    inner: bool = False

    @property
    def where(self) -> str:
        """Begin of an error, e.g. ``joint slideway_6: normal_stiffness``."""
        part, _, key = self.name.partition('.')
        return f'{self.kind} {part}: {key}'


@dataclass(frozen=True)
class Root:
    """
    What a number follows in the end: ``number = times * root``; itself where it has no tie.

    Parameters
    ----------
    name : str
        Of the root.
    times : float

    """

    name: str
    times: float


def declared_numbers(machine: Machine) -> dict[str, Declared]:
    """
    Collect all numbers of a machine that can be known, estimated or tied.

    Parameters
    ----------
    machine : Machine

    Returns
    -------
    dict of str to Declared
        By name, in the order of the machine file.

    """
    numbers: dict[str, Declared] = {}
    for number in _numbers(machine):
        numbers.setdefault(number.name, number)
    return numbers


def roots_of(numbers: Mapping[str, Declared]) -> dict[str, Root]:
    """
    Follow all ties to their ends.

    Parameters
    ----------
    numbers : mapping of str to Declared

    Returns
    -------
    dict of str to Root
        By name.

    Raises
    ------
    MachineError
        If a number is tied to one that does not exist or has another unit, or to itself.

    """
    return {name: _root(number, numbers) for name, number in numbers.items()}


def with_inner_ties(machine: Machine) -> Machine:
    """
    Give tied preloads, exponents and other numbers inside laws the values that they follow.

    Parameters
    ----------
    machine : Machine

    Returns
    -------
    Machine

    Raises
    ------
    MachineError
        If one of them is tied to what does not exist or has another unit, or to itself.

    """
    periodic = [one for one in machine.forces if isinstance(one, PeriodicForce)]
    inner = [one for part in machine.joints for one in part.inner]
    inner += [one for part in periodic for one in part.inner]
    if all(one.coefficient.tie is None for one in inner):
        return machine
    numbers = declared_numbers(machine)
    values: dict[str, dict[str, float]] = {}
    for name, number in numbers.items():
        if number.inner and number.coefficient.tie is not None:
            root = _root(number, numbers)
            part, _, key = name.partition('.')
            value = root.times * numbers[root.name].coefficient.value
            values.setdefault(part, {})[key] = value
    return replace(
        machine,
        joints=tuple(joint.starting_at(values.get(joint.name, {})) for joint in machine.joints),
        forces=tuple(
            one.starting_at(values.get(one.name, {})) if isinstance(one, PeriodicForce) else one
            for one in machine.forces
        ),
    )


def _numbers(machine: Machine) -> Iterator[Declared]:
    for body in machine.bodies:
        yield Declared('body', f'{body.name}.mass', 'm', 'kg', body.mass)
    for force in machine.forces:
        if isinstance(force, PeriodicForce):
            yield from _numbers_of(force)
        else:
            yield Declared('force', f'{force.name}.force', 'F', 'N', force.force)
    for joint in machine.joints:
        for term in joint.terms():
            name = f'{joint.name}.{term.key}'
            yield Declared('joint', name, term.symbol, term.unit, term.coefficient)
        for one in joint.inner:
            name = f'{joint.name}.{one.key}'
            yield Declared('joint', name, one.symbol, one.unit, one.coefficient, inner=True)


def _numbers_of(force: PeriodicForce) -> Iterator[Declared]:
    yield Declared('force', f'{force.name}.{COSINE}', 'F_cos', force.unit, force.cosine)
    yield Declared('force', f'{force.name}.{SINE}', 'F_sin', force.unit, force.sine)
    for one in force.inner:
        name = f'{force.name}.{one.key}'
        yield Declared('force', name, one.symbol, one.unit, one.coefficient, inner=True)


def _root(number: Declared, numbers: Mapping[str, Declared]) -> Root:
    chain, times = [number], 1.0
    while (tie := chain[-1].coefficient.tie) is not None:
        followed = numbers.get(tie.same_as)
        if followed is None:
            raise MachineError(
                f'{chain[-1].where} is the same as "{tie.same_as}", which is no parameter of '
                f'this machine{_expected(chain[-1], tie.same_as, numbers)}'
            )
        if followed.unit != chain[-1].unit:
            raise MachineError(
                f'{chain[-1].where} [{chain[-1].unit}] is the same as "{tie.same_as}" '
                f'[{followed.unit}], but the units differ'
                f'{_expected(chain[-1], tie.same_as, numbers)}'
            )
        times *= tie.times
        if followed in chain:
            circle = [one.name for one in chain[chain.index(followed) :]]
            raise MachineError(
                f'{chain[-1].where} follows itself ({" -> ".join([*circle, circle[0]])}); '
                'give one of them a value'
                if len(circle) > 1
                else f'{chain[-1].where} is the same as itself; give it a value'
            )
        chain.append(followed)
    return Root(chain[-1].name, times)


def _expected(number: Declared, wrong: str, numbers: Mapping[str, Declared]) -> str:
    """Say what a number can be tied to."""
    fitting = [
        one.name for one in numbers.values() if one.unit == number.unit and one is not number
    ]
    close = get_close_matches(wrong, fitting, n=1)
    if close:
        return f'; did you mean "{close[0]}"?'
    return f'; expected one of {", ".join(fitting)}' if fitting else ''

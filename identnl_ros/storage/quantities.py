# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Numbers with units as people write them, converted to SI.

A bare number is SI, a text such as ``380 daN/um^2`` is converted and its dimension checked.
Where the identification may find a number out, it is a coefficient: ``900 kg`` or
``{known: 900 kg}`` is known, ``{estimate: 900 kg}`` is to be estimated and has a nominal value
for the simulated stand, ``estimate`` is to be estimated and has none.
``{same_as: slideway_6.normal_stiffness, times: 1.2}`` follows another coefficient.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
import math
import re
from typing import Annotated, TYPE_CHECKING, TypeVar

from identnl_ros.core.mechanics.coefficients import Coefficient, Tie
import numpy as np
from numpy.typing import NDArray
from pydantic import PlainValidator

if TYPE_CHECKING:
    import pint

ESTIMATE = 'estimate'
KNOWN = 'known'
SAME_AS = 'same_as'
TIMES = 'times'

_NUMBER_AND_UNIT = re.compile(r'([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)', re.ASCII)
# The unit parser computes powers of numbers: only powers of units, and small ones, reach it.
_UNIT_FACTOR = re.compile(r'%|[^\W\d]\w*(?:\s*(?:\^|\*\*)\s*-?\d{1,2}(?:\.\d{1,12})?)?')
_UNIT_JOINTS = re.compile(r'[\s()*/·]*')
_LONGEST_UNIT = 80
_GRAM = re.compile(r'(?<!\w)([munkµ]?)([gG])(?!\w)')
_DIRECTION = re.compile(r'([+-]?)([xyz])')
_PARAMETER = re.compile(r'[^\W\d][\w-]*\.\w+')


Item = TypeVar('Item')


class UnitError(ValueError):
    """A text is no unit, or a unit of another dimension than the needed one."""


@dataclass(frozen=True)
class Quantity:
    """
    What a key of a file needs: a unit to convert to, and words for the error.

    Parameters
    ----------
    unit : str
        SI unit the numbers are converted to; empty: dimensionless.
    expected : str
        Completes "expected ...", e.g. ``a mass such as "900 kg"``.

    """

    unit: str
    expected: str

    def number(self, value: object) -> float:
        """
        Read a number that must be known.

        Parameters
        ----------
        value : object
            As found in the file.

        Returns
        -------
        float
            [`unit`].

        Raises
        ------
        ValueError
            If it is not such a number, or is to be estimated.

        """
        coefficient = self.coefficient(value)
        if coefficient.estimated or coefficient.tie is not None:
            prevented = 'estimated' if coefficient.estimated else 'tied to another one'
            raise ValueError(
                f'found {shown(value)}, but this number must be known and cannot be '
                f'{prevented}; expected {self.expected}'
            )
        return coefficient.value

    def coefficient(self, value: object) -> Coefficient:
        """
        Read a number that is known, to be estimated, or tied to another one.

        Parameters
        ----------
        value : object
            As found in the file.

        Returns
        -------
        Coefficient
            [`unit`].

        Raises
        ------
        ValueError
            If it is none of these.

        """
        if value == ESTIMATE:
            return Coefficient(estimated=True)
        if isinstance(value, dict):
            if SAME_AS in value and value.keys() <= {SAME_AS, TIMES}:
                return Coefficient(tie=_tie(value))
            if len(value) != 1 or not value.keys() <= {ESTIMATE, KNOWN}:
                raise ValueError(
                    f'found {{{", ".join(value)}}}, expected {self.expected}, '
                    f'or that behind one of {{{KNOWN}: ...}} and {{{ESTIMATE}: ...}}, '
                    f'or {{{SAME_AS}: another parameter, {TIMES}: factor}}'
                )
            ((key, inner),) = value.items()
            return Coefficient(self._si(inner), estimated=key == ESTIMATE)
        return Coefficient(self._si(value))

    def coefficient_with_start(self, value: object) -> Coefficient:
        """
        Read a coefficient that needs a start value where it is to be estimated.

        Parameters
        ----------
        value : object
            As found in the file.

        Returns
        -------
        Coefficient
            [`unit`].

        Raises
        ------
        ValueError
            If it is no coefficient, or to be estimated without a value.

        """
        if value == ESTIMATE:
            raise ValueError(
                f'found {shown(value)}, but the search for this number needs a start; '
                f'expected {{{ESTIMATE}: start}} with {self.expected}'
            )
        return self.coefficient(value)

    def vector(self, value: object) -> NDArray[np.float64]:
        """
        Read three known numbers.

        Parameters
        ----------
        value : object
            As found in the file.

        Returns
        -------
        ndarray, shape (3,)
            [`unit`].

        Raises
        ------
        ValueError
            If there are not three, or one is no such number.

        """
        items = _list_of(value, 3, f'a list of three, each {self.expected}')
        return np.array([_numbered(i, self.number, item) for i, item in enumerate(items)])

    def pair(self, value: object) -> tuple[float, float]:
        """
        Read two known numbers.

        Parameters
        ----------
        value : object
            As found in the file.

        Returns
        -------
        tuple of float
            [`unit`].

        Raises
        ------
        ValueError
            If there are not two, or one is no such number.

        """
        items = _list_of(value, 2, f'a list of two, each {self.expected}')
        first, second = (_numbered(i, self.number, item) for i, item in enumerate(items))
        return first, second

    def matrix(self, value: object) -> NDArray[np.float64]:
        """
        Read a table of three rows of three known numbers.

        Parameters
        ----------
        value : object
            As found in the file.

        Returns
        -------
        ndarray, shape (3, 3)
            [`unit`].

        Raises
        ------
        ValueError
            If it is no such table.

        """
        rows = _list_of(value, 3, f'three rows of three numbers, each {self.expected}')
        return np.array([self.vector(row) for row in rows])

    def _si(self, value: object) -> float:
        """Convert one number without a word about estimation."""
        found = f'found {shown(value)}'
        match = _NUMBER_AND_UNIT.fullmatch(value.strip()) if isinstance(value, str) else None
        if match is None:
            raise ValueError(f'{found}, expected {self.expected}')
        number, unit = float(match[1]), match[2]
        try:
            result = convert(number, unit, self.unit) if unit else number
        except UnitError as error:
            raise ValueError(f'{found}{error}, expected {self.expected}') from None
        if not math.isfinite(result):
            raise ValueError(f'{found}, which is too large; expected {self.expected}')
        return result


def coefficients(value: object, quantities: Sequence[Quantity]) -> tuple[Coefficient, ...]:
    """
    Read a list of coefficients, each with its own unit.

    Parameters
    ----------
    value : object
        As found in the file.
    quantities : sequence of Quantity
        One for every place of the list, which may be shorter.

    Returns
    -------
    tuple of Coefficient
        As many as found.

    Raises
    ------
    ValueError
        If it is no list, is empty or too long, or one item is no such coefficient.

    """
    if not isinstance(value, list) or not 0 < len(value) <= len(quantities):
        raise ValueError(
            f'found {shown(value)}, expected a list of 1 to {len(quantities)}, '
            f'the first being {quantities[0].expected}'
        )
    pairs = zip(quantities, value, strict=False)
    return tuple(
        _numbered(i, quantity.coefficient, item) for i, (quantity, item) in enumerate(pairs)
    )


def direction(value: object) -> NDArray[np.float64]:
    """
    Read a direction: ``+x``, ``-y`` and the like, or three numbers of any length.

    Parameters
    ----------
    value : object
        As found in the file.

    Returns
    -------
    ndarray, shape (3,)
        As written, not normalised.

    Raises
    ------
    ValueError
        If it is neither.

    """
    match = _DIRECTION.fullmatch(value.strip()) if isinstance(value, str) else None
    if match:
        vector = np.zeros(3)
        vector['xyz'.index(match[2])] = -1.0 if match[1] == '-' else 1.0
        return vector
    items = _list_of(value, 3, 'a direction such as "+x", or three numbers')
    component = Quantity('', 'a number without a unit')
    return np.array([_numbered(i, component.number, item) for i, item in enumerate(items)])


Vector = NDArray[np.float64]

LENGTH = Quantity('m', 'a length such as "0.3 m"')
FREQUENCY = Quantity('Hz', 'a frequency such as "40 Hz"')
ACCELERATION = Quantity('m/s^2', 'an acceleration such as "-9.81 m/s^2"')

# Types of keys that several files have.
Direction = Annotated[Vector, PlainValidator(direction)]
Position = Annotated[Vector, PlainValidator(LENGTH.vector)]
Frequency = Annotated[float, PlainValidator(FREQUENCY.number)]
Gravity = Annotated[Vector, PlainValidator(ACCELERATION.vector)]


def convert(number: float, unit: str, to_unit: str) -> float:
    """
    Convert a number between units of one dimension.

    Parameters
    ----------
    number : float
        [`unit`].
    unit, to_unit : str
        E.g. ``daN/um^2``; empty: dimensionless.

    Returns
    -------
    float
        [`to_unit`].

    Raises
    ------
    UnitError
        If one is no unit, the dimensions differ, or an angular velocity is given for a
        frequency or the other way round. The message continues a sentence that tells what was
        found.

    """
    old, new = _unit(unit), _unit(to_unit)
    if _angular(old) and new.dimensionality == {'[time]': -1} and not _angular(new):
        raise UnitError(', an angular velocity instead of a frequency (divide by 2 pi)')
    if _angular(new) and old.dimensionality == {'[time]': -1} and not _angular(old):
        raise UnitError(', a frequency instead of an angular velocity (multiply by 2 pi)')
    if old.dimensionality != new.dimensionality:
        raise UnitError(_if_gravity_is_meant(unit, to_unit))
    try:
        result = float(_registry().Quantity(number, old).to(new).magnitude)
    except (ArithmeticError, ValueError, TypeError):
        raise UnitError('') from None
    # Without the rounding of the factors: 380 daN/um^2 is 3.8e15 N/m^2 to the last bit.
    return number if old == new else float(f'{result:.15g}')


def same_dimension(unit: str, other_unit: str) -> bool:
    """
    Tell whether two units measure the same physical quantity.

    Parameters
    ----------
    unit, other_unit : str

    Returns
    -------
    bool

    Raises
    ------
    UnitError
        If one is no unit.

    """
    return bool(_unit(unit).dimensionality == _unit(other_unit).dimensionality)


def is_unit(text: str) -> bool:
    """
    Tell whether a text is a known unit.

    Parameters
    ----------
    text : str

    Returns
    -------
    bool

    """
    try:
        _unit(text)
    except UnitError:
        return False
    return True


def shown(value: object) -> str:
    """
    Put a value found in a file into words for an error.

    Parameters
    ----------
    value : object

    Returns
    -------
    str
        One short line.

    """
    if isinstance(value, dict):
        return 'keys and values' if value else 'nothing between braces'
    if isinstance(value, list):
        return f'a list of {len(value)}'
    text = ' '.join(str(value).split())
    if not text:
        return 'nothing'
    return f'"{text}"' if len(text) <= 60 else f'"{text[:57]}..."'


def _tie(value: dict[str, object]) -> Tie:
    other, times = value[SAME_AS], value.get(TIMES, '1')
    if not (isinstance(other, str) and _PARAMETER.fullmatch(other)):
        raise ValueError(
            f'{SAME_AS}: found {shown(other)}, expected the name of a parameter such as '
            '"slideway_6.normal_stiffness"'
        )
    try:
        factor = Quantity('', 'a positive number such as 1.2').number(times)
    except ValueError as error:
        raise ValueError(f'{TIMES}: {error}') from None
    if factor <= 0:
        raise ValueError(f'{TIMES}: found {shown(times)}, expected a positive number such as 1.2')
    return Tie(other, factor)


def _list_of(value: object, length: int, expected: str) -> list[object]:
    if not isinstance(value, list) or len(value) != length:
        raise ValueError(f'found {shown(value)}, expected {expected}')
    return value


def _numbered(index: int, read: Callable[[object], Item], item: object) -> Item:
    """Say in the error which item of a list is wrong."""
    try:
        return read(item)
    except ValueError as error:
        raise ValueError(f'number {index + 1}: {error}') from None


@cache
def _unit(text: str) -> 'pint.Unit':
    unknown = UnitError(f', in which {shown(text)} is no known unit')
    if len(text) > _LONGEST_UNIT or not _UNIT_JOINTS.fullmatch(_UNIT_FACTOR.sub(' ', text)):
        raise unknown
    try:
        unit = _registry().parse_units(text)
        _registry().get_root_units(unit)  # overflows where a power is absurd
    except Exception:  # whatever a foreign parser makes of a text that people typed
        raise unknown from None
    return unit


def _if_gravity_is_meant(unit: str, to_unit: str) -> str:
    """Say it where a gram, or a gauss, would be right as the acceleration of gravity."""
    meant = _GRAM.sub(r'\1g_0', unit)
    if meant == unit or not (is_unit(meant) and same_dimension(meant, to_unit)):
        return ''
    letter = _GRAM.findall(unit)[0][1]
    what = 'gram' if letter == 'g' else 'gauss'
    return f', where "{letter}" is the {what} (gravity is "g_0": write "{meant}")'


def _angular(unit: 'pint.Unit') -> bool:
    return 'radian' in str(_registry().get_root_units(unit)[1])


@cache
def _registry() -> 'pint.UnitRegistry[float]':
    """Import pint only where a unit occurs: it takes a fifth of a second."""
    import pint

    return pint.UnitRegistry()

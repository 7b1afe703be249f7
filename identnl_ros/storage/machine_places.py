# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Where a joint of a machine file acts: written out, or taken from another joint."""

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Annotated, Any

from identnl_ros.core.mechanics.joints import Joint
from identnl_ros.storage.quantities import LENGTH, Position, shown, Vector
from identnl_ros.storage.yaml_reading import KeyProblem, Name, StrictModel, word
from pydantic import model_validator, PlainValidator

AT = 'at'


def _end(value: object) -> str | None:
    if value is None:
        return None
    if not isinstance(value, str):
        raise ValueError(f'found {shown(value)}, expected a word')
    return word(value)


def _point(value: object) -> Vector | None:
    return None if value is None else LENGTH.vector(value)


class Placed(StrictModel):
    """
    Keys of a joint that may name another one, ``at``, in place of its own place and axes.

    Those left out for that are None.
    """

    at: Name | None = None
    body: Annotated[str | None, PlainValidator(_end)]
    to: Annotated[str | None, PlainValidator(_end)]
    point: Annotated[Position | None, PlainValidator(_point)]

    @model_validator(mode='before')
    @classmethod
    def _check_place(cls, data: object) -> object:
        if not (isinstance(data, dict) and AT in data):
            return data
        own = [key for key in cls.frame_keys() if key in cls.model_fields]
        for key in own:
            if key in data:
                raise KeyProblem(key, f'comes from the joint that "{AT}" names; leave it out')
        return {**data, **dict.fromkeys(own)}

    @classmethod
    def frame_keys(cls) -> tuple[str, ...]:
        """Keys that ``at`` replaces."""
        return 'body', 'to', 'point', 'axis_1', 'axis_2'


@dataclass(frozen=True)
class Place:
    """
    Where a joint acts and along which axes.

    Parameters
    ----------
    body, to : str
    point : ndarray, shape (3,)
        Machine frame [m].
    axes : ndarray, shape (3, 3)
        Axes 1 to 3 as columns, machine frame.

    """

    body: str
    to: str
    point: Vector
    axes: Vector

    @classmethod
    def of(cls, joint: Joint) -> 'Place':
        """
        Take the place of a joint.

        Parameters
        ----------
        joint : Joint

        Returns
        -------
        Place

        """
        return cls(joint.body, joint.other_body, joint.point, joint.axes)


def place_at(at: str, placed: Mapping[str, Joint], parts: Mapping[str, Any]) -> Place:
    """
    Find the place that a joint takes from another one.

    Parameters
    ----------
    at : str
        Name of the other joint.
    placed : mapping of str to Joint
        Joints with a place of their own, by name.
    parts : mapping of str to object
        All joints of the file.

    Returns
    -------
    Place

    Raises
    ------
    ValueError
        If there is no such joint, or it has no place of its own.

    """
    if at in placed:
        return Place.of(placed[at])
    found = f'found {shown(at)}'
    if at in parts:
        raise ValueError(
            f'{found}, which takes its own place from "{parts[at].at}"; name that joint'
        )
    close = get_close_matches(at, placed, n=1)
    if close:
        raise ValueError(f'{found}, which is no joint of this machine; did you mean "{close[0]}"?')
    names = f'expected one of {", ".join(placed)}' if placed else 'give one a place of its own'
    raise ValueError(f'{found}, which is no joint of this machine; {names}')

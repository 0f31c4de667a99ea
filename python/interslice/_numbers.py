"""Arguments as they are given, checked under their names: whole numbers (of Python, of numpy, and floats that are whole), lengths, answers."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = Sequence[float] | NDArray[Any]
Spacing = float | Vector


def whole(name: str, given: Any) -> int:
    """A whole number of 64 bits; `name` is the argument's."""
    try:
        is_whole_float = isinstance(given, (float, np.floating)) and float(given).is_integer()
        number = int(given) if is_whole_float else operator.index(given)
    except TypeError:
        raise ValueError(f"`{name}` takes whole numbers; got {given}") from None
    if not -(2**63) <= number < 2**63:
        raise ValueError(f"`{name}` takes numbers of 64 bits; got {number}")
    return number


def wholes(name: str, given: Iterable[Any]) -> list[int]:
    """Several such."""
    return [whole(name, number) for number in several(name, given)]


def counted(name: str, given: Any) -> int:
    """Such a number from 0."""
    number = whole(name, given)
    if number < 0:
        raise ValueError(f"`{name}` takes numbers from 0; got {number}")
    return number


def several(name: str, given: Any) -> Iterator[Any]:
    """The values of something that has several."""
    try:
        if isinstance(given, (str, bytes)):
            raise TypeError
        return iter(given)
    except TypeError:
        raise ValueError(f"`{name}` takes several values, such as a list; got {given!r}") from None


def numbers(name: str, given: Any, count: int | None = None) -> list[float]:
    """Several numbers, `count` of them if it is named."""
    found = []
    for value in several(name, given):
        try:
            found.append(float(value))
        except (TypeError, ValueError):
            raise ValueError(f"`{name}` takes numbers; got {value!r}") from None
    if count is not None and len(found) != count:
        raise ValueError(f"`{name}` takes {count} numbers; got {len(found)}")
    return found


def answer(name: str, given: Any) -> bool:
    """True or False."""
    if not isinstance(given, (bool, np.bool_)):
        raise ValueError(f"`{name}` must be True or False; got {given!r}")
    return bool(given)


def called(progress: Any) -> Any:
    """What is called while a run goes on, or None."""
    if progress is not None and not callable(progress):
        raise TypeError(f"`progress` must be a function, called with a stage, what is done and all there is to do; got {progress!r}")
    return progress

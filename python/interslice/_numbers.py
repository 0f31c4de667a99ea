"""Whole numbers as they are given: of Python, of numpy, and floats that are whole."""

from __future__ import annotations

import operator
from collections.abc import Iterable
from typing import Any

import numpy as np


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
    return [whole(name, number) for number in given]


def counted(name: str, given: Any) -> int:
    """Such a number from 0."""
    number = whole(name, given)
    if number < 0:
        raise ValueError(f"`{name}` takes numbers from 0; got {number}")
    return number

"""Arguments of the parts in Python: one converter for each kind, whose error begins with the name of the argument."""

from __future__ import annotations

import operator
import os
from collections.abc import Mapping, Sequence
from typing import Any

from dermatome._errors import ArgumentError, DataError


def check_kind(argument: str, value: object, kind: type | tuple[type, ...], needed: str) -> None:
    """Refuses an argument of another type."""
    if not isinstance(value, kind):
        raise ArgumentError(f"{argument}: found {type(value).__name__}; needed: {needed}")


def path_of(argument: str, value: object, needed: str = "a path") -> str:
    """A path as text; bytes are none, as to the library."""
    try:
        path = os.fspath(value)  # type: ignore[call-overload]
    except TypeError:
        path = None
    if not isinstance(path, str):
        raise ArgumentError(f"{argument}: found {type(value).__name__}; needed: {needed}")
    return path


def word_of(argument: str, value: object, needed: str = "a str") -> str:
    """A word."""
    if not isinstance(value, str):
        raise ArgumentError(f"{argument}: found {shown(value)}; needed: {needed}")
    return str(value)


def one_of(argument: str, value: object, known: Sequence[str]) -> str:
    """One of some words."""
    needed = ", ".join(map(repr, known[:10])) + (", ..." if len(known) > 10 else "")
    if word_of(argument, value, needed) not in known:
        raise DataError(f"{argument}: found {value!r}; needed: {needed}")
    return str(value)


def words_of(argument: str, value: object, needed: str = "a str, or a sequence of them") -> tuple[str, ...]:
    """Words; one may stand alone."""
    if isinstance(value, str):
        return (value,)
    return tuple(word_of(argument, each, needed) for each in items_of(argument, value, needed))


def items_of(argument: str, value: object, needed: str) -> list[Any]:
    """What a sequence, an array or another iterable has, one after the other; text is none."""
    try:
        if not isinstance(value, (str, bytes)):
            return list(value)  # type: ignore[call-overload, no-any-return]
    except TypeError:
        pass
    raise ArgumentError(f"{argument}: found {type(value).__name__}; needed: {needed}")


def mapping_of(argument: str, value: object, needed: str) -> Mapping[Any, Any]:
    """A dict, or another mapping."""
    check_kind(argument, value, Mapping, needed)
    return value  # type: ignore[return-value]


def flag_of(argument: str, value: object) -> bool:
    """True or False, of Python or of numpy."""
    if type(value).__name__ not in ("bool", "bool_"):
        raise ArgumentError(f"{argument}: found {shown(value)}; needed: True or False")
    return bool(value)


def array_of(argument: str, value: object, needed: str) -> Any:
    """An array of any numbers; rows of several lengths are none."""
    import numpy as np

    if np.ma.is_masked(value):
        raise ArgumentError(f"{argument}: found masked numbers; needed: {needed}: .filled(...) or .compressed() makes one")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, OverflowError):
        raise ArgumentError(f"{argument}: found {type(value).__name__} of several lengths or kinds; needed: {needed}") from None
    if array.dtype.kind not in "biuf":
        raise ArgumentError(f"{argument}: found {type(value).__name__} of {array.dtype}; needed: {needed}")
    return array


def number_of(argument: str, value: object, needed: str) -> float:
    """A number; an error of another argument."""
    try:
        if not isinstance(value, (str, bytes)):  # `float` reads them, too.
            return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        pass
    raise ArgumentError(f"{argument}: found {shown(value)}; needed: {needed}")


def shown(value: object) -> str:
    """A value in a message: the first letters of its text."""
    try:
        return repr(str(value)[:40])
    except ValueError:  # Of a number of thousands of digits.
        return type(value).__name__


def whole_of(argument: str, value: object, needed: str) -> int:
    """A whole number of 64 bits; an error of another argument."""
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        raise ArgumentError(f"{argument}: found {shown(value)}; needed: {needed}") from None
    if not -(2**63) <= number < 2**63:
        raise DataError(f"{argument}: found a number of {number.bit_length()} bits; needed: {needed}, of 64 bits")
    return number


#: What takes the place of another type, in messages.
A_MAP = "a Map, as dermatome.build or Map.read makes it"
READINGS = "Readings, as Readings.read(path) reads them"

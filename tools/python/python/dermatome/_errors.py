"""What can go wrong, as exceptions."""

from __future__ import annotations

import operator
import os
import re
from typing import Any


class Error(Exception):
    """Any error of dermatome.

    Attributes
    ----------
    kind : str
        What went wrong as one word, which stays the same from version to version; `argument` where an argument
        cannot be used.
    """

    def __init__(self, message: str, kind: str = "argument") -> None:
        super().__init__(message)
        self.kind = kind

    def __reduce__(self) -> tuple[Any, ...]:
        return (type(self), (str(self), self.kind))


class DataError(Error, ValueError):
    """Arguments or data that cannot be used: the message says which element, what was found, what is needed."""


class ArgumentError(DataError, TypeError):
    """An argument of another type than is needed."""

    def add_note(self, note: str) -> None:
        """Put the name of the argument, which the extension says in a note, in front of the message, which is all that logs
        show; CPython 3.10 has no notes."""
        said = re.fullmatch("while processing '(.*)'", note)
        if said:
            self.args = (f"{said[1]}: {self}",)
        else:
            super().add_note(note)  # type: ignore[misc, unused-ignore]  # pyright: ignore


class FileError(Error, OSError):
    """A file that cannot be read or written."""


class MissingFileError(FileError, FileNotFoundError):
    """A file that does not exist."""


class DermatomeWarning(UserWarning):
    """What was done is other than may be expected, as `build` says of a map that is poor or of a patch that is left out."""


def check_kind(argument: str, value: object, kind: type | tuple[type, ...], needed: str) -> None:
    """Refuses an argument of another type."""
    if not isinstance(value, kind):
        raise ArgumentError(f"{argument}: found {type(value).__name__}; needed: {needed}")


def path_of(argument: str, value: object) -> str:
    """A path as text; an error of another argument."""
    try:
        return os.fspath(value)  # type: ignore[call-overload, no-any-return]
    except TypeError:
        raise ArgumentError(f"{argument}: found {type(value).__name__}; needed: a path") from None


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


for _class in (Error, DataError, ArgumentError, FileError, MissingFileError, DermatomeWarning):
    _class.__module__ = "dermatome"

"""What can go wrong, as exceptions."""

from __future__ import annotations

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


class FileError(Error, OSError):
    """A file that cannot be read or written."""


class MissingFileError(FileError, FileNotFoundError):
    """A file that does not exist."""


def check_kind(argument: str, value: object, kind: type | tuple[type, ...], needed: str) -> None:
    """Refuses an argument of another type."""
    if not isinstance(value, kind):
        raise DataError(f"{argument}: found {type(value).__name__}; needed: {needed}")


#: What takes the place of another type, in messages.
A_MAP = "a Map, as dermatome.build or Map.read makes it"
READINGS = "Readings, as Readings.read(path) reads them"


for _class in (Error, DataError, FileError, MissingFileError):
    _class.__module__ = "dermatome"

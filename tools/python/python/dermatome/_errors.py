"""What can go wrong, as exceptions."""

from __future__ import annotations

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


for _class in (Error, DataError, ArgumentError, FileError, MissingFileError, DermatomeWarning):
    _class.__module__ = "dermatome"

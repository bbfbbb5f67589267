"""Files that are there as a whole or not at all, and whole numbers of any library."""

from __future__ import annotations

import operator
import os
import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dermatome._errors import FileError


@contextmanager
def written(path: Any) -> Generator[Path]:
    """The path under which a file or a new folder is written. It takes the place of `path` at the end; where that is not
    reached, what was there before stays as it was.

    Until then it is in a folder next to `path`, under the name that it will have. A device or a pipe is written directly.
    """
    # A link goes on to lead to the file.
    target, folder = Path(os.path.realpath(path)), None
    try:
        if target.exists() and not target.is_file():
            yield target
            return
        folder = tempfile.mkdtemp(prefix=".dermatome-", suffix=".part", dir=target.parent)
        part = Path(folder) / target.name
        yield part
        if target.exists():
            shutil.copymode(target, part)
        os.replace(part, target)
    except OSError as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"{path}: cannot be written: {error}", "io") from error
    finally:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)


def whole(value: object) -> int | None:
    """A whole number, of Python or of numpy; None for anything else, also for a bool."""
    try:
        return None if isinstance(value, bool) else operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        return None

"""Files that the library reads itself: text of vendors and loggers, arrays of numpy."""

from __future__ import annotations

from typing import Any

from dermatome._dermatome import Layout, RecordingFile
from dermatome._errors import DataError


class Text:
    """A file that the library reads, from its first frame on."""

    def __init__(self, path: str, stream: str | None, layout: Any, episode: int | None = None) -> None:
        self.path = path
        self.file = RecordingFile(path, stream, layout, episode)
        self.episodes: int = self.file.episodes
        self.ids, self.channels, self.units, self.frames = self.file.ids, self.file.channels, self.file.units, self.file.frames
        # The number of frames is -1 where only reading all of them shows it.
        unknown = () if self.frames is not None else (-1,)
        self.kinds: tuple[str, ...] | None = self.file.kinds
        self.streams = {name: (*unknown, *shape) for name, shape in self.file.streams.items()}

    @property
    def statements(self) -> list[tuple[str, str, str]]:
        """What is known, and who says so."""
        return self.file.statements

    @property
    def says(self) -> dict[str, Any]:
        """What the file states."""
        return self.file.says

    @property
    def rest(self) -> tuple[list[bool], float | None]:
        """Of each channel whether readings are about 0 where nothing touches, and the threshold that is stated."""
        return self.file.rest

    def next(self, frames: int) -> Any:
        """The number of an episode, the next of its frames and their times; None at the end."""
        return self.file.next(frames)

    def draft(self) -> str:
        """The text of a layout."""
        return self.file.draft()

    @staticmethod
    def is_known(path: str) -> bool:
        """Whether the library reads a file."""
        return RecordingFile.is_known(path)


class Arrays(Text):
    """An array of three axes whose order is given by a word, "tnc" or "tcn"."""

    def __init__(self, path: str, read: Any) -> None:
        self.path, self.at, self.episodes, self.read = path, 0, 1, read
        self.ids, self.channels, self.units, self.frames = self.read.ids, self.read.channels, self.read.units, len(self.read)
        self.kinds = self.read.kinds
        self.streams = {"values": self.read.values.shape}

    @property
    def statements(self) -> list[tuple[str, str, str]]:
        return [("unit", ", ".join(self.units), "file"), *(("remark", remark, "checked") for remark in self.read.remarks)]

    @property
    def says(self) -> dict[str, Any]:
        return {}

    @property
    def rest(self) -> tuple[list[bool], float | None]:
        from dermatome._rest import flags_of

        return flags_of(self.read), self.read.threshold

    def draft(self) -> str:
        return draft_of_array(self.path)

    def next(self, frames: int) -> Any:
        part = slice(self.at, self.at + frames)
        self.at += frames
        values = self.read.values[part]
        return (0, values, self.read.timestamps[part]) if len(values) else None


def draft_of_array(path: str) -> str:
    """The text of a layout of an array, which states nothing but its shape."""
    import numpy as np

    try:
        array: Any = np.load(path, mmap_mode="r")
    except Exception as error:  # Of a damaged file numpy raises what its parts do.
        raise DataError(f"{path}: found no array: {error}; needed: a layout") from error
    if not getattr(array, "ndim", 0):
        raise DataError(f"{path}: found several arrays; needed: a layout that names one as `stream`")
    return Layout.draft(path, array.shape[1:])

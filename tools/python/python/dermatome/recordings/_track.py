"""What every reader of a container gives: the streams of a file, and the frames of one of them along time."""

from __future__ import annotations

import fnmatch
import json
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dermatome._errors import DataError, Error, FileError
from dermatome._kinds import is_mapping

# The most bytes of a frame, and of a piece of a file that is decoded at once. Chunks of real files have some MB.
MOST_BYTES = 1 << 28
# The most bytes of JSON that describes a file: that of a dataset of 10,000 features has about 1 MB.
MOST_JSON = 1 << 25
# What streams of times are called.
TIME_NAMES = ("timestamps", "timestamp", "times", "time")
# Names of streams that may have readings. Others are read when they are named.
TOUCH = re.compile("tactile|touch|taxel|pressure|airskin|skin", re.IGNORECASE)


@dataclass
class Block:
    """Some frames of an episode, as the file has them.

    `times` are (T,), or None where no stream of times was asked for; `zero` likewise: of the shape of a frame, or (T, ...), one beside
    each frame.
    """

    episode: int
    values: Any
    times: Any = None
    zero: Any = None


@dataclass
class Track(ABC):
    """One stream of a file.

    `cells` is the shape of a frame, `episodes` the number of frames of each episode, `says` what the file states (the
    keys `unit`, `units` of the components, `rate`, `axes`, `ids`, `time_unit` have the meaning of a layout), and
    `statements` grows by what is found while reading.
    """

    path: str
    stream: str
    cells: tuple[int, ...]
    dtype: str
    episodes: tuple[int, ...]
    says: dict[str, Any] = field(default_factory=lambda: {})
    statements: list[tuple[str, str, str]] = field(default_factory=lambda: [])
    # Numbers of a zero that stand for none.
    missing: tuple[float, ...] = ()

    @abstractmethod
    def blocks(self, frames: int, episode: int | None = None, time: str | None = None, zero: str | None = None) -> Iterator[Block]:
        """At most `frames` frames at a time, of one episode or all, with the streams of times and zeros of these names."""

    def mean_zero(self, rows: Any) -> Any:
        """The mean of some rows of zeros, (n, ...), without those that stand for none; NaN where there is no other."""
        import numpy as np

        kind = rows.dtype if rows.dtype.kind == "f" else np.dtype(np.float64)
        known = np.isfinite(rows) & ~np.isin(rows, np.array([*self.missing, *np.array(self.missing, kind).astype(np.float64)]))
        sums = np.where(known, rows, 0).sum(axis=0, dtype=np.float64)
        return np.where(known.any(axis=0), sums / np.maximum(known.sum(axis=0), 1), np.nan)

    def times_beside(self) -> str | None:
        """The stream of times that a file has beside the readings, if it has one."""
        return None

    def state(self, what: str, value: str) -> None:
        """Adds a statement of the file, once."""
        if (what, value, "file") not in self.statements:
            self.statements.append((what, value, "file"))


class Container(ABC):
    """A file with streams: their shapes with the number of frames first. What cannot be read is in `unread`, with why."""

    def __init__(self, path: Any) -> None:
        self.path = str(path)
        self.streams: dict[str, tuple[int, ...]] = {}
        self.unread: dict[str, Error] = {}

    @abstractmethod
    def track(self, stream: str, frame_axis: int = 0) -> Track:
        """One of the streams."""

    def single_columns(self) -> list[str]:
        """The names of columns with one number a frame, of which several may be taxels."""
        return []

    def joined(self, layout: Any) -> Track | None:
        """Columns that a layout joins to taxels by their names, as one stream; None if it does not."""
        return None

    def choose(self, stream: str | None) -> str:
        """The name of a stream; without one the only stream that is named as touch is."""
        if stream is not None:
            return stream
        found = [name for name in self.streams if TOUCH.search(name)]
        lost = [name for name in self.unread if TOUCH.search(name) or not self.streams]
        if lost and not found:
            raise self.unread[lost[0]]
        found = found or list(self.streams)
        if len(found) == 1:
            return found[0]
        raise DataError(f"{self.path}: found {listed(self.streams)}; needed: stream=, the name of one of them")

    def close(self) -> None:
        """Closes the file."""


def listed(streams: dict[str, tuple[int, ...]], most: int = 40) -> str:
    """The names and shapes of streams, for a message."""
    if not streams:
        return "no stream of numbers"
    shown = [f"{name} {shape}" for name, shape in list(streams.items())[:most]]
    more = [f"{len(streams) - most} more"] if len(streams) > most else []
    return f"{len(streams)} stream{'s' * (len(streams) > 1)}: {', '.join(shown + more)}"


def matching(path: str, streams: Sequence[str], pattern: str) -> list[str]:
    """The names that a pattern matches, in the order of the numbers in them."""
    hits = [pattern] if pattern in streams else [name for name in streams if fnmatch.fnmatchcase(name, pattern)]
    if not hits:
        known = dict.fromkeys(re.sub(r"\d+", "*", name) for name in streams)
        shown = ", ".join(list(known)[:40]) or "none"
        raise DataError(f"{path}: found no stream {pattern!r}; needed: one of {shown}")
    return sorted(hits, key=lambda name: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)])


def chosen(path: str, episodes: Sequence[int], episode: int | None) -> list[int]:
    """The numbers of the episodes that are read."""
    if episode is None:
        return list(range(len(episodes)))
    if not 0 <= episode < len(episodes):
        raise DataError(f"{path}: found episode={episode}; needed: 0 to {len(episodes) - 1}")
    return [episode]


def read_json(path: str, data: bytes, what: str) -> dict[str, Any]:
    """An object of JSON."""
    if len(data) > MOST_JSON:
        raise FileError(f"{path}: {what}: found {len(data)} bytes or more; needed: at most {MOST_JSON}", "too-large")
    try:
        found: Any = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path}: {what}: found no JSON: {error}; needed: the file as it was written", "json") from None
    if not is_mapping(found):
        raise FileError(f"{path}: {what}: found {type(found).__name__}; needed: an object", "json")
    return dict(found)


def bytes_of(path: Path, most: int) -> bytes:
    """The bytes of a file, at most one more than `most`."""
    try:
        with open(path, "rb") as file:
            return file.read(most + 1)
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror}", "io") from error


def sizes(path: str, what: str, given: Any, item: int = 1) -> tuple[int, ...]:
    """A shape in a file: whole numbers from 0, of a number of items that can be counted."""
    numbers: list[Any] = [*given] if isinstance(given, (list, tuple)) else [None]
    if not all(isinstance(n, int) and not isinstance(n, bool) and n >= 0 for n in numbers):
        raise DataError(f"{path}: {what}: found the shape {given!r}; needed: whole numbers from 0")
    total = item
    for n in numbers:
        total *= max(n, 1)
    if total >= 1 << 62:
        raise DataError(f"{path}: {what}: found the shape {tuple(numbers)}; needed: fewer than 2^62 bytes")
    return tuple(numbers)


def small_enough(path: str, what: str, shape: tuple[int, ...], item: int) -> int:
    """The bytes of a piece that is decoded at once."""
    total = item
    for n in shape:
        total *= n
    if total > MOST_BYTES:
        raise DataError(f"{path}: {what}: found pieces {shape} of {total} bytes; needed: at most {MOST_BYTES}; write the file with smaller chunks")
    return total

"""Open-X-Tactile (FTP-1): a Zarr group `data` with an array a stream, and `meta/episode_ends`."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from dermatome._adapter import need
from dermatome._errors import DataError, FileError
from dermatome._kinds import is_list
from dermatome.recordings._track import TIME_NAMES, Block, Container, Track, chosen
from dermatome.recordings.areas import AREAS
from dermatome.recordings.zarr import Array, Store

# What `type` of a group may be: `image` is a picture of a camera.
STATES = ("state", "matrix", "binary")
# What the stream of a store is called that is an array itself.
ITSELF = "values"
# Frames of the small arrays that are checked at a time.
CHECKED = 4096


class Zarr(Container):
    """A Zarr group: Open-X-Tactile, or any arrays with frames along their first axis."""

    def __init__(self, path: Any) -> None:
        super().__init__(path)
        self.store = Store(path)
        self.arrays: dict[str, Array] = {}
        for name in self.store.arrays():
            try:
                self.arrays[name] = Array(self.store, name)
            except (DataError, FileError) as error:  # Pictures, and text without a length: an error when they are asked for.
                self.unread[name] = error
        for name, array in self.arrays.items():
            short = name.removeprefix("data/") or ITSELF
            about = any(f"_tactile_{kind}_" in short for kind in ("area", "sensor", "type"))
            if array.dtype.kind in "biuf" and len(array.shape) > 1 and not about and not name.startswith("meta/"):
                self.streams[short] = array.shape
        self.ends = self._ends()

    def _ends(self) -> list[int] | None:
        array = self.arrays.get("meta/episode_ends")
        if array is None:
            return None
        array.complete()
        if array.dtype.kind not in "iu" or len(array.shape) != 1:
            raise DataError(f"{array.where}: found {array.dtype} {array.shape}; needed: whole numbers, one for each episode")
        ends: list[int] = array.whole().tolist()
        for number, (before, end) in enumerate(zip([0, *ends], ends)):
            if end <= before:
                raise DataError(f"{array.where}: found {end} for episode {number} after {before}; needed: ascending numbers of frames")
        return ends

    def close(self) -> None:
        if self.store.archive is not None:
            self.store.archive.close()

    def choose(self, stream: str | None) -> str:
        tactile = [name for name in self.streams if "_tactile_data_" in name]
        return tactile[0] if stream is None and len(tactile) == 1 else super().choose(stream)

    def array(self, name: str, beside: str = "") -> Array:
        """An array by its name, which may stand beside another one."""
        folder = beside.rpartition("/")[0]
        if name == ITSELF and "" in self.arrays:
            return self.arrays[""]
        for each in (f"{folder}/{name}" if folder else name, f"data/{name}", name):
            if each in self.unread:
                raise self.unread[each]
            if each in self.arrays:
                return self.arrays[each]
        known = ", ".join(list(self.streams)[:40]) or "none"
        raise DataError(f"{self.path}: found no stream {name!r}; needed: one of {known}")

    def track(self, stream: str, frame_axis: int = 0) -> Track:
        if frame_axis:
            raise DataError(f"{self.path}: found the frames on axis {frame_axis} in the layout; needed: axis 0, as Zarr recordings have")
        array = self.array(stream)
        if array.dtype.kind not in "biuf" or len(array.shape) < 1:
            raise DataError(f"{array.where}: found {array.dtype} {array.shape}; needed: numbers, a frame each along the first axis")
        if array.name.startswith("data/") and self.ends is not None and self.ends[-1:] != [array.shape[0]]:
            last = self.ends[-1] if self.ends else 0
            raise DataError(f"{array.where}: found {array.shape[0]} frames; needed: {last}, the last of meta/episode_ends")
        array.complete()
        ends = self.ends or [array.shape[0]]
        lengths = tuple(end - before for before, end in zip([0, *ends], ends))
        made = ZarrTrack(self.path, stream, array.shape[1:], array.dtype.str, lengths, container=self, array=array)
        for what in ("area", "sensor", "type"):
            other = array.name.replace("_tactile_data_", f"_tactile_{what}_")
            if other != array.name and other in self.arrays:
                made.says[what] = constant(self.arrays[other], array.shape[0])
        made.says |= {key: value for key, value in array.attributes.items() if key in ("unit", "rate", "axes")}
        _check_group(made, array)
        return made


def constant(array: Array, frames: int) -> Any:
    """What an array says in every frame."""
    np = need("numpy", "zarr")
    if not array.shape or array.shape[0] != frames:
        raise DataError(f"{array.where}: found the shape {array.shape}; needed: {frames} frames, as the readings have")
    array.complete(constant=True)
    first: Any = None
    for start in range(0, frames, CHECKED):
        rows = array.read(start, min(start + CHECKED, frames))
        first = rows[0] if first is None else first
        other = np.flatnonzero((rows != first).reshape(len(rows), -1).any(axis=1))
        if len(other):
            at = int(other[0])
            found = f"{np.asarray(rows[at]).tolist()!r} at frame {start + at} after {np.asarray(first).tolist()!r}"
            raise DataError(f"{array.where}: found {found}; needed: the same in every frame")
    return None if first is None else np.asarray(first).tolist()


def _check_group(made: Track, array: Array) -> None:
    areas, kind = made.says.get("area"), made.says.get("type")
    if areas is not None:
        count = made.cells[0] if made.cells else 1
        if not is_list(areas) or len(areas) != count:
            raise DataError(f"{array.where}: found the areas {areas}; needed: {count}, one for each part of a frame {made.cells}")
        wrong = [area for area in areas if not isinstance(area, int) or not 0 <= area < len(AREAS)]
        if wrong:
            raise DataError(f"{array.where}: found area {wrong[0]}; needed: 0 to {len(AREAS) - 1}")
    if kind is not None and kind not in STATES:
        raise DataError(f"{array.where}: found the type {kind!r}; needed: one of {', '.join(STATES)}: no picture of a camera")


@dataclass
class ZarrTrack(Track):
    container: Any = None
    array: Any = None

    def blocks(self, frames: int, episode: int | None = None, time: str | None = None, zero: str | None = None) -> Iterator[Block]:
        times = None if time is None else self._beside(time)
        zeros = None if zero is None else self.container.array(zero, self.array.name)
        whole: Any = None
        if zeros is not None:
            zeros.complete()
            whole = self._whole_zero(zeros)
        starts = [0, *itertools.accumulate(self.episodes)]
        for number in chosen(self.path, self.episodes, episode):
            for start in range(starts[number], starts[number + 1], frames):
                stop = min(start + frames, starts[number + 1])
                zero_rows: Any = None
                if zeros is not None:
                    zero_rows = zeros.read(start, stop) if whole is None else whole if whole.shape == self.cells else whole[number]
                values = self.array.read(start, stop)
                if self.array.filled:
                    count, fill = len(self.array.filled), self.array.fill
                    self.statements = [each for each in self.statements if each[0] != "chunks"]
                    self.statements.append(("chunks", f"{count} are not stored, as chunks of one value are not: readings there are {fill}", "checked"))
                yield Block(number, values, None if times is None else times.read(start, stop), zero_rows)

    def _whole_zero(self, zeros: Any) -> Any:
        """One zero for all frames, or one for each episode; None if there is one beside each frame."""
        if zeros.dtype.kind not in "biuf" or zeros.shape != self.cells and zeros.shape[1:] != self.cells:
            raise DataError(f"{zeros.where}: found zeros {zeros.dtype} {zeros.shape}; needed: numbers of the shape {self.cells}, that of a frame, or rows of it")
        if zeros.shape == self.cells:
            return zeros.whole()
        if zeros.shape[0] == sum(self.episodes):
            return None
        return zeros.whole() if 1 < len(self.episodes) == zeros.shape[0] else self.mean_zero(zeros.whole())

    def times_beside(self) -> str | None:
        folder = self.array.name.rpartition("/")[0]
        known = (self.container.arrays.get(f"{folder}/{name}" if folder else name) for name in TIME_NAMES)
        fits = (each.dtype.kind in "iuf" and each.shape == (sum(self.episodes),) if each is not None else False for each in known)
        return next((name for name, good in zip(TIME_NAMES, fits) if good), None)

    def _beside(self, time: str) -> Array:
        array: Array = self.container.array(time, self.array.name)
        frames = sum(self.episodes)
        if len(array.shape) == 2 and array.shape[1] == 1:
            pass
        elif len(array.shape) != 1:
            raise DataError(f"{array.where}: found the shape {array.shape}; needed: one time for each frame")
        if array.shape[0] != frames:
            raise DataError(f"{array.where}: found {array.shape[0]} times beside {frames} frames of {self.stream}; needed: one each")
        array.complete()
        return array

"""HDF5: datasets with frames along one axis, an episode a group. Nothing outside the file is read."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from dermatome._adapter import need
from dermatome._errors import DataError, FileError
from dermatome.recordings._track import TIME_NAMES, Block, Container, Track, chosen, matching, sizes, small_enough

# Names of numbers and attributes that say how many frames a second there are, in small letters.
RATES = ("rate", "rate_hz", "fps", "hz", "frequency", "frequency_hz", "sample_rate", "sampling_rate", "sampling_frequency")
# Groups that describe what is beside them.
DESCRIPTIONS = ("meta", "metadata", "info", "config", "settings", "parameters", "attributes")
# The most groups above a stream whose attributes are read.
MOST_GROUPS = 16
# The most objects of a file that are listed.
MOST_OBJECTS = 100_000


class Hdf5(Container):
    """An HDF5 file."""

    def __init__(self, path: Any) -> None:
        super().__init__(path)
        h5py = need("h5py", "hdf5")
        try:
            self.file: Any = h5py.File(path, "r")
        except OSError as error:
            raise FileError(f"{path}: found no HDF5 file that can be read: {error}; needed: the file as it was written", "hdf5") from error
        self.datasets: dict[str, Any] = {}
        self._walk()
        shapes: dict[str, tuple[int, ...]] = {}
        for name, dataset in self.datasets.items():
            pattern = re.sub(r"\d+", "*", name)
            if dataset.dtype.kind not in "biuf" or dataset.ndim < 2:
                continue
            key, shape = (pattern, dataset.shape[1:])
            if shapes.setdefault(key, shape) != shape:
                key = name
            self.streams[key] = (self.streams.get(key, (0,))[0] + dataset.shape[0], *shape)
        for key in [key for key in self.streams if "*" in key]:  # One dataset is listed by its own name.
            hits = matching(self.path, list(self.datasets), key)
            if len(hits) == 1:
                self.streams = {hits[0] if name == key else name: shape for name, shape in self.streams.items()}

    def _walk(self) -> None:
        """Lists the datasets, those of a group that several links lead to once: under the name of a hard link, if one does."""
        h5py = need("h5py", "hdf5")
        seen: set[Any] = set()
        # Groups that soft links lead to come last.
        waiting: list[tuple[str, Any]] = [("", self.file)]
        for first in waiting:
            opened = self._entered(first, seen)
            while opened:
                prefix, group, names = opened[-1]
                name = next(names, None)
                if name is None:
                    opened.pop()
                    continue
                path = f"{prefix}{name}"
                link = group.get(name, getlink=True)
                if isinstance(link, h5py.ExternalLink):
                    self._leave(path, f"a link to {link.filename!r}")
                    continue
                try:
                    item = group[name]
                except (KeyError, OSError, RuntimeError):
                    self._leave(path, "a link to nothing")
                    continue
                if isinstance(item, h5py.Group):
                    if isinstance(link, h5py.SoftLink):
                        waiting.append((f"{path}/", item))
                    else:
                        opened += self._entered((f"{path}/", item), seen)
                elif isinstance(item, h5py.Dataset):
                    if len(self.datasets) == MOST_OBJECTS:
                        raise DataError(f"{self.path}: found more than {MOST_OBJECTS} datasets; needed: fewer")
                    self.datasets[path] = item

    def _entered(self, place: tuple[str, Any], seen: set[Any]) -> list[tuple[str, Any, Iterator[str]]]:
        """A group and the names in it, if it was not entered before."""
        prefix, group = place
        about = need("h5py", "hdf5").h5o.get_info(group.id)
        key = (about.addr, about.fileno)
        if key in seen:
            return []
        if len(seen) == MOST_OBJECTS:
            raise DataError(f"{self.path}: found more than {MOST_OBJECTS} groups; needed: fewer")
        seen.add(key)
        return [(prefix, group, iter(group))]

    def _leave(self, path: str, found: str) -> None:
        self.unread[path] = DataError(f"{self.path}: {path}: found {found}; needed: readings in the file itself; copy them into it")

    def close(self) -> None:
        self.file.close()

    def track(self, stream: str, frame_axis: int = 0) -> Track:
        stream = stream.strip("/")
        if stream in self.unread:
            raise self.unread[stream]
        hits = matching(self.path, list(self.datasets), stream)
        # An episode is a group: two arrays of one are two streams.
        groups: dict[str, str] = {}
        for name in hits:
            if groups.setdefault(name.rpartition("/")[0], name) != name:
                found = f"{groups[name.rpartition('/')[0]]} and {name} for {stream!r}"
                raise DataError(f"{self.path}: found {found}; needed: stream=, a pattern of one array of each episode")
        shapes: dict[tuple[int, ...], str] = {}
        for name in hits:
            dataset = self._checked(name)
            if not 0 <= frame_axis < dataset.ndim or dataset.dtype.kind not in "biuf":
                raise DataError(f"{self.path}: {name}: found {dataset.dtype} {dataset.shape}; needed: numbers with {frame_axis + 1} axes or more")
            shapes.setdefault(_cells(dataset.shape, frame_axis), name)
        if len(shapes) > 1:
            found = ", ".join(f"{shape} in {name}" for shape, name in list(shapes.items())[:4])
            raise DataError(f"{self.path}: found frames of several shapes: {found}; needed: stream=, one of them, or other `axes` in the layout")
        first = self.datasets[hits[0]]
        lengths = tuple(self.datasets[name].shape[frame_axis] for name in hits)
        made = Hdf5Track(self.path, stream, next(iter(shapes)), first.dtype.str, lengths, container=self, names=hits, axis=frame_axis)
        made.says |= self._stated(hits)
        return made

    def _stated(self, names: list[str]) -> dict[str, Any]:
        """Unit and rate, which the attributes of arrays and of the groups around them say, or a number beside these, also in a group
        that describes them; the nearest counts. They are the same for all episodes."""
        rates = {name: item for name, item in self.datasets.items() if name.rpartition("/")[2].lower() in RATES and item.shape == () and item.dtype.kind in "iuf"}
        known: dict[str, dict[str, Any]] = {}

        def of_group(group: str) -> dict[str, Any]:
            if group not in known:
                inner = {f"{group}/{name}".lstrip("/") for name in (self.file[group] if group else self.file) if name.lower() in DESCRIPTIONS}
                beside, described = ({float(item[()]) for name, item in rates.items() if name.rpartition("/")[0] in of} for of in ({group}, inner))
                number = beside or described
                rate: dict[str, Any] = {"rate": number.pop()} if len(number) == 1 else {}
                known[group] = {**rate, **_attributes(self.file[group] if group else self.file)}
            return known[group]

        stated: dict[str, tuple[str, Any]] = {}
        for name in names:
            says, group = _attributes(self.datasets[name]), name
            for _ in range(MOST_GROUPS):
                group = group.rpartition("/")[0]
                says = {**of_group(group), **says}
                if not group:
                    break
            for key, value in says.items():
                other, found = stated.setdefault(key, (name, value))
                if found != value:
                    raise DataError(f"{self.path}: found the {key} {found!r} of {other} and {value!r} of {name}; needed: stream=, arrays of one of them")
        return {key: value for key, (_, value) in stated.items()}

    def _checked(self, name: str) -> Any:
        """A dataset that can be read from this file, with bounded memory."""
        h5py, dataset = need("h5py", "hdf5"), self.datasets[name]
        where, item = f"{self.path}: {name}", dataset.dtype.itemsize
        if dataset.is_virtual or dataset.external:
            kept = "other files" if dataset.is_virtual else repr(dataset.external[0][0])
            raise DataError(f"{where}: found numbers kept in {kept}; needed: readings in the file itself; copy them into it")
        shape = sizes(self.path, name, dataset.shape, item)
        plist = dataset.id.get_create_plist()
        for k in range(plist.get_nfilters()):
            code, _, _, title = plist.get_filter(k)
            if not h5py.h5z.filter_avail(code):
                known = title.decode("utf-8", "replace") or "without a name"
                raise DataError(f"{where}: found the filter {code} ({known}), which is not installed; needed: pip install hdf5plugin, or gzip")
        if 0 in shape:
            return dataset
        if dataset.chunks:
            most = small_enough(self.path, name, dataset.chunks, item)
            needed = math.prod(math.ceil(size / chunk) for size, chunk in zip(shape, dataset.chunks))
            found = dataset.id.get_num_chunks()
            if found != needed:
                raise DataError(f"{where}: found {found} of {needed} chunks; needed: all; HDF5 gives {dataset.fillvalue} for the others, which looks like a reading")
            # No filter makes a chunk much larger; one that is may become anything.
            dataset.id.chunk_iter(partial(_check_chunk, where, 2 * most + (1 << 16)))
        elif dataset.id.get_storage_size() < item * math.prod(shape):
            found = dataset.id.get_storage_size()
            raise DataError(f"{where}: found {found} bytes for the shape {shape}; needed: {item * math.prod(shape)}; HDF5 gives {dataset.fillvalue} for the others, which looks like a reading")
        return dataset

    def beside(self, name: str, stream: str) -> str:
        """The dataset of a name in the group of another, or in one above."""
        folder = stream.rpartition("/")[0]
        while True:
            path = f"{folder}/{name}" if folder else name
            if path in self.datasets:
                return path
            if not folder:
                break
            folder = folder.rpartition("/")[0]
        near = stream.rpartition("/")[0]
        known = [each for each in self.datasets if each.rpartition("/")[0] == near][:20]
        raise DataError(f"{self.path}: found no {name!r} beside {stream}, which the layout names; needed: one of {known}, or `rate` in the layout")


def _check_chunk(where: str, most: int, chunk: Any) -> None:
    if chunk.size > most:
        needed = f"at most {most}; needed: the file as it was written"
        raise DataError(f"{where}: found {chunk.size} bytes in the chunk at {chunk.chunk_offset}, of {needed}")


def _cells(shape: tuple[int, ...], frame_axis: int) -> tuple[int, ...]:
    return shape[:frame_axis] + shape[frame_axis + 1 :]


def _attributes(owner: Any) -> dict[str, Any]:
    """What the attributes of an array or a group say."""
    made: dict[str, Any] = {}
    for name in [name for name in owner.attrs if name.lower() in ("unit", "units", *RATES)]:
        key = name.lower()
        try:
            value: Any = owner.attrs[name]
        except (OSError, TypeError):
            continue
        if isinstance(value, bytes):
            value = value.decode("utf-8", "replace")
        if getattr(value, "size", 1) != 1:
            continue
        value = value.item() if hasattr(value, "item") else value
        if key in RATES and isinstance(value, (int, float)) and not isinstance(value, bool):
            made["rate"] = float(value)
        elif key not in RATES and isinstance(value, str):
            made["unit"] = value
    return made


@dataclass
class Hdf5Track(Track):
    container: Any = None
    names: Any = ()
    axis: int = 0

    def blocks(self, frames: int, episode: int | None = None, time: str | None = None, zero: str | None = None) -> Iterator[Block]:
        np = need("numpy", "hdf5")
        for number in chosen(self.path, self.episodes, episode):
            name, count = self.names[number], self.episodes[number]
            dataset = self.container.datasets[name]
            times = None if time is None else self._beside(time, name, count)
            zeros, whole = (None, None) if zero is None else self._zeros(zero, name, number, count)
            valid = self._valid(name, count)
            # Whole chunks, so that none is decoded twice.
            step = self._step(dataset, frames)
            for start in range(0, count, step):
                stop = min(start + step, count)
                rows = np.moveaxis(self._read(dataset, (slice(None),) * self.axis + (slice(start, stop),)), self.axis, 0)
                if valid is not None and not (good := self._read(valid, slice(start, stop)).astype(bool)).all():
                    rows = np.where(good.reshape(-1, *[1] * (rows.ndim - 1)), rows, np.nan)
                    self.state("validity", f"{int((~good).sum())} frames of episode {number} from frame {start} on are not valid: no readings there")
                at = None if times is None else self._read(times, slice(start, stop)).ravel()
                rest: Any = whole
                if zeros is not None:
                    rest = np.moveaxis(self._read(zeros, (slice(None),) * self.axis + (slice(start, stop),)), self.axis, 0)
                for first in range(0, len(rows), frames):
                    part = slice(first, first + frames)
                    yield Block(number, rows[part], None if at is None else at[part], rest if zeros is None else rest[part])

    def _zeros(self, zero: str, name: str, number: int, count: int) -> tuple[Any, Any]:
        """The dataset of zeros that has one beside each frame of an episode, or else the one zero of the episode."""
        paths = [self.container.beside(zero, each) for each in self.names]
        path = self.container.beside(zero, name)
        dataset = self.container._checked(path)
        if dataset.dtype.kind not in "biuf":
            raise DataError(f"{self.path}: {path}: found {dataset.dtype}; needed: numbers")
        if dataset.shape == self.cells:
            return None, self._read(dataset, ())
        if dataset.shape == self.container.datasets[name].shape:
            return dataset, None
        if dataset.shape[1:] != self.cells:
            raise DataError(f"{self.path}: {path}: found zeros of the shape {dataset.shape}; needed: {self.cells}, that of a frame, or rows of it")
        # One for each episode, beside all of them.
        if len(paths) > 1 and len(set(paths)) == 1 and dataset.shape[0] == len(paths):
            return None, self._read(dataset, number)
        small_enough(self.path, path, dataset.shape, dataset.dtype.itemsize)
        return None, self.mean_zero(self._read(dataset, ()))

    def _step(self, dataset: Any, frames: int) -> int:
        """How many frames are read at once: those of whole chunks, but not more than take some MB."""
        size = dataset.chunks[self.axis] if dataset.chunks else 1
        each = max(dataset.dtype.itemsize * math.prod(self.cells), 1)
        small_enough(self.path, self.stream, self.cells, dataset.dtype.itemsize)
        return int(max(1, min(frames, (1 << 25) // each) // size) * size)

    def _read(self, dataset: Any, part: Any) -> Any:
        try:
            return dataset[part]
        except (OSError, RuntimeError, ValueError) as error:
            where = f"{self.path}: {dataset.name.strip('/')}"
            raise FileError(f"{where}: frames {part} cannot be read: {error}; needed: the file as it was written", "hdf5") from error

    def times_beside(self) -> str | None:
        for time in TIME_NAMES:
            found = [self.container.datasets.get(f"{name.rpartition('/')[0]}/{time}".lstrip("/")) for name in self.names]
            if all(each is not None and each.size == count and each.dtype.kind in "iuf" for each, count in zip(found, self.episodes)):
                return time
        return None

    def _beside(self, time: str, name: str, count: int) -> Any:
        dataset = self.container._checked(self.container.beside(time, name))
        if dataset.size != count or dataset.dtype.kind not in "iuf":
            found = f"{dataset.size} times ({dataset.dtype}) beside {count} frames of {name} {self.container.datasets[name].shape}"
            raise DataError(f"{self.path}: {dataset.name.strip('/')}: found {found}; needed: one for each frame; is `axes` of the layout right?")
        return dataset

    def _valid(self, name: str, count: int) -> Any:
        """Flags `validity/NAME`, one a frame, where one episode alone has as many."""
        path = f"validity/{name.rpartition('/')[2]}"
        found = self.container.datasets.get(path)
        if found is None or found.shape != (count,) or found.dtype.kind != "b":
            return None
        if (fitting := self.episodes.count(count)) > 1:
            self.state("validity", f"{path} is not used: {fitting} episodes have as many frames")
            return None
        return self.container._checked(path)


def is_hdf5(path: Path) -> bool:
    """Whether a file has the signature of HDF5, at its start or behind a user block."""
    try:
        with open(path, "rb") as file:
            for at in (0, 512, 1024, 2048):
                file.seek(at)
                if file.read(8) == b"\x89HDF\r\n\x1a\n":
                    return True
    except OSError:
        return False
    return False

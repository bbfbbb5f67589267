"""LeRobot datasets, formats 2.0, 2.1 and 3.0, by `pyarrow` alone: only the columns that are asked for are read."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dermatome._adapter import need
from dermatome._errors import DataError, FileError
from dermatome._kinds import is_list, is_mapping
from dermatome.recordings._track import MOST_JSON, Block, Container, Track, bytes_of, chosen, read_json, sizes, small_enough

VERSIONS = ("v2.0", "v2.1", "v3.0")
# Columns that count.
COUNTERS = ("timestamp", "frame_index", "episode_index", "index", "task_index")
# What a column of times may be called in a layout that is written for several formats.
TIMES = ("timestamp", "timestamps")
# Numbers that are decoded at once: some MB.
NUMBERS = 1 << 19


class LeRobot(Container):
    """A LeRobot dataset: a folder with `meta/info.json`."""

    def __init__(self, path: Any) -> None:
        super().__init__(path)
        self.root = Path(path)
        self.info = read_json(self.path, bytes_of(self.root / "meta/info.json", MOST_JSON), "meta/info.json")
        version = self.info.get("codebase_version")
        if version not in VERSIONS:
            raise self.wrong("codebase_version", f"{version!r}" if version else "none", f"one of {', '.join(VERSIONS)}")
        fps = self.info.get("fps")
        if not isinstance(fps, (int, float)) or isinstance(fps, bool) or not 0 < fps < math.inf:
            raise self.wrong("fps", repr(fps), "a number above 0")
        self.fps = float(fps)
        features = self.info.get("features")
        if not is_mapping(features) or not all(is_mapping(each) for each in features.values()):
            raise self.wrong("features", type(features).__name__, "an object with an object for each feature")
        self.features = features
        self.frames = self.count("total_frames")
        for name, feature in features.items():
            if feature.get("dtype") not in ("image", "video", "string") and name not in COUNTERS:
                self.streams[name] = (self.frames, *sizes(self.path, f"feature {name}", feature.get("shape"), 8))
        self.lengths: dict[int, int] = {}
        # Each data file with the first of its episodes, None where that is not known.
        self.files: dict[Path, int | None] = {}
        self.columns: set[str] = set()
        # The last file that was opened, and its metadata: those of a file of many episodes are large.
        self.last: tuple[Path | None, Any] = (None, None)
        self._find(version)

    def wrong(self, what: str, found: Any, needed: str) -> DataError:
        """An error of `info.json`."""
        return DataError(f"{self.path}: {what} in meta/info.json: found {found}; needed: {needed}")

    def count(self, key: str) -> int:
        """A number of frames or episodes."""
        found = self.info.get(key)
        if not isinstance(found, int) or isinstance(found, bool) or found < 0:
            raise self.wrong(key, repr(found), "a whole number from 0")
        return found

    def choose(self, stream: str | None) -> str:
        if stream is None:
            beside = (".baseline", ".status", ".valid", ".dt", ".std")
            named = [name for name in self.streams if "tactile" in name and not name.endswith(beside)]
            if len(named) == 1:
                return named[0]
        return super().choose(stream)

    def single_columns(self) -> list[str]:
        return [name for name, shape in self.streams.items() if shape[1:] == (1,)]

    def joined(self, layout: Any) -> Track | None:
        names = self.single_columns()
        found = layout.named_columns(self.path, names)
        if found is None:
            return None
        ids, components, places = found
        of = {(place[0], place[1]): name for name, place in zip(names, places) if place is not None}
        first = layout.axes[1:].index("component") == 0 if "component" in layout.axes else True
        cells = (len(ids),) if "component" not in layout.axes else (components, len(ids)) if first else (len(ids), components)
        pairs = [(k, n) for k in range(components) for n in range(len(ids))] if first else [(k, n) for n in range(len(ids)) for k in range(components)]
        made = self.track(of[0, 0])
        assert isinstance(made, LeRobotTrack)
        made.stream, made.cells, made.joined = f"{len(of)} columns", cells, tuple(of[pair] for pair in pairs)
        made.says |= {"ids": ids, "named_columns": True}
        unread = [name for name, place in zip(names, places) if place is None]
        if unread:
            made.state("columns not read", ", ".join(unread[:12]) + ", ..." * (len(unread) > 12))
        return made

    def _find(self, version: str) -> None:
        """The data files, and the length of each episode as the metadata say."""
        if version == "v3.0":
            files = sorted(self.root.glob("data/chunk-*/file-*.parquet"), key=_numbers)
            self.files = dict.fromkeys(files, None)
            self._read_episodes()
            total = sum(self.open(path).metadata.num_rows for path in files)
        else:
            self._read_lines()
            there = {path.name: path for path in sorted(self.root.glob("data/chunk-*/episode_*.parquet"))}
            for number in sorted(self.lengths):
                name = f"episode_{number:06d}.parquet"
                if name not in there:
                    needed = f"a file for each of {len(self.lengths)} episodes; copy it again"
                    raise DataError(f"{self.path}: found no data/*/{name}; needed: {needed}")
                self.files[there[name]] = number
            total = sum(self.lengths.values())
        if total != self.frames:
            raise DataError(f"{self.path}: found {total} frames in {len(self.files)} files; needed: {self.frames}, total_frames of meta/info.json")

    def open(self, path: Path) -> Any:
        """A Parquet file."""
        pq, arrow = need("pyarrow.parquet", "parquet"), need("pyarrow", "parquet")
        try:
            known = self.last[1] if self.last[0] == path else None
            file = pq.ParquetFile(path, metadata=known, thrift_string_size_limit=1 << 27, thrift_container_size_limit=1 << 24)
            self.last = (path, file.metadata)
            return file
        except (OSError, arrow.ArrowException) as error:
            raise FileError(f"{path}: found no Parquet file that can be read: {error}; needed: the file as it was written", "parquet") from error

    def _read_episodes(self) -> None:
        arrow = need("pyarrow", "parquet")
        for path in sorted(self.root.glob("meta/episodes/chunk-*/file-*.parquet"), key=_numbers):
            file = self.open(path)
            where = ["data/chunk_index", "data/file_index"]
            where = where if set(where) <= set(file.schema_arrow.names) else []
            try:
                table = file.read(columns=["episode_index", "length", *where], use_threads=False).to_pydict()
                numbers, lengths = table["episode_index"], table["length"]
            except (OSError, arrow.ArrowException, KeyError) as error:
                raise FileError(f"{path}: cannot be read: {error}; needed: episode_index and length of each episode", "parquet") from error
            self.lengths |= dict(zip(numbers, lengths))
            for number, chunk, part in zip(numbers, *(table[name] for name in where)) if where else ():
                each = self.root / f"data/chunk-{chunk:03d}/file-{part:03d}.parquet"
                if each in self.files:
                    self.files[each] = number if self.files[each] is None else min(number, self.files[each] or 0)
        self._check_episodes()

    def _read_lines(self) -> None:
        path = self.root / "meta/episodes.jsonl"
        for number, line in enumerate(bytes_of(path, 4 * MOST_JSON).splitlines()):
            if line.strip():
                each = read_json(str(path), line, f"line {number + 1}")
                self.lengths[each.get("episode_index", -1)] = each.get("length", -1)
        self._check_episodes()

    def _check_episodes(self) -> None:
        wrong = [key for key, value in self.lengths.items() if not isinstance(value, int) or not isinstance(key, int) or min(key, value) < 0]
        if wrong or sorted(self.lengths) != list(range(self.count("total_episodes"))):
            known = str(list(self.lengths)[:20])
            raise DataError(f"{self.path}: found the episodes {known} in meta/episodes; needed: 0 to {self.count('total_episodes') - 1}, each with its length")

    def track(self, stream: str, frame_axis: int = 0) -> Track:
        if frame_axis:
            raise DataError(f"{self.path}: found the frames on axis {frame_axis} in the layout; needed: axis 0: a row is a frame")
        if stream not in self.streams:
            raise DataError(f"{self.path}: found no stream {stream!r}; needed: one of {', '.join(list(self.streams)[:40]) or 'none'}")
        feature, cells = self.features[stream], self.streams[stream][1:]
        small_enough(self.path, stream, cells, 8)
        self.columns = set(self.open(next(iter(self.files))).schema_arrow.names) if self.files else set()
        if self.files and stream not in self.columns:
            raise DataError(f"{next(iter(self.files))}: found no column {stream!r}; needed: one, as features of meta/info.json say")
        lengths = tuple(self.lengths[number] for number in sorted(self.lengths))
        says: dict[str, Any] = {"rate": self.fps}
        names = feature.get("names")
        if is_list(names) and 1 < len(names) == len(cells) and all(isinstance(name, str) for name in names):
            says["axes"] = names
        made = LeRobotTrack(self.path, stream, cells, str(feature.get("dtype")), lengths, says, dataset=self)
        if "unit" in feature:
            says["unit"] = feature["unit"]
        made.state("times", "frame / fps, as LeRobot writes them")
        return made


@dataclass
class LeRobotTrack(Track):
    dataset: Any = None
    # Columns that are the numbers of a frame, one each.
    joined: tuple[str, ...] = ()
    counted: dict[str, int] = field(default_factory=lambda: {})

    def blocks(self, frames: int, episode: int | None = None, time: str | None = None, zero: str | None = None) -> Iterator[Block]:
        np = need("numpy", "parquet")
        wanted = chosen(self.path, self.episodes, episode)
        columns = [*(self.joined or (self.stream,)), "timestamp", "episode_index", "frame_index"]
        status = self._status()
        columns += [name for name in (zero, status and status[0]) if name]
        if time is not None and time not in TIMES:
            columns.append(time)
        if not wanted:
            return
        files, last = self._files(wanted)
        left_out = self._groups_before(files[0], wanted[0]) if len(wanted) == 1 else 0
        last = wanted[0] - 1 if left_out else last
        at, origin = self.episodes[last] if last >= 0 else 0, 0.0
        for path, batch in self._batches(files, columns, max(1, min(frames, NUMBERS // max(math.prod(self.cells), 1))), left_out):
            if left_out and last < wanted[0]:
                # The group in which an episode begins has the end of the one before.
                batch = batch.slice(int(np.searchsorted(self._column(path, batch, "episode_index"), wanted[0])))
                if not len(batch):
                    continue
            episodes, counter = (self._column(path, batch, name) for name in ("episode_index", "frame_index"))
            stamps = self._column(path, batch, "timestamp")
            if self.joined:
                values = np.stack([self._column(path, batch, name).reshape(-1) for name in self.joined], axis=1).reshape(-1, *self.cells)
            else:
                values = self._column(path, batch, self.stream)
            zeros = None if zero is None else self._column(path, batch, zero)
            times = stamps if time in TIMES else None if time is None else self._column(path, batch, time)
            cuts = [0, *(np.flatnonzero(np.diff(episodes)) + 1).tolist(), len(episodes)]
            for first, stop in zip(cuts, cuts[1:]):
                number, rows = int(episodes[first]), slice(first, stop)
                if number != last:
                    if number != last + 1 or (last >= 0 and at != self.episodes[last]):
                        raise self._order(path, last, at, number)
                    last, at, origin = number, 0, float(stamps[first])
                if number >= len(self.episodes) or at + stop - first > self.episodes[number]:
                    raise self._order(path, last, at + stop - first, number)
                expected = np.arange(at, at + stop - first)
                if (counter[rows] != expected).any():
                    row = int(np.argmax(counter[rows] != expected))
                    raise DataError(f"{path}: episode {number}: found frame_index {counter[rows][row]} in row {at + row}; needed: {at + row}: no frame is left out")
                self._check_times(path, number, at, stamps[rows].astype(np.float64) - origin, time)
                at += stop - first
                if number in wanted:
                    kept = self._valid(status, batch, path, rows, values[rows], number, at - (stop - first))
                    yield Block(number, kept, None if times is None else times[rows].reshape(-1), None if zeros is None else zeros[rows])
                if last > wanted[-1]:
                    return
        if last < wanted[-1] or at != self.episodes[last]:
            raise self._order(self.path, last, at, last + 1)

    def _files(self, wanted: list[int]) -> tuple[list[Path], int]:
        """The files that have some episodes, and the number of the episode before the first of them."""
        firsts, files = self.dataset.files, list(self.dataset.files)
        if len(wanted) > 1 or None in firsts.values():
            return files, -1
        kept = [path for path in files if firsts[path] <= wanted[0]]
        # An episode may begin in the file before the one that the metadata name.
        start = max((firsts[path] for path in kept), default=0)
        return [path for path in files if firsts[path] >= start], start - 1

    def _groups_before(self, path: Path, number: int) -> int:
        """How many groups of rows of a file are before an episode, as their statistics say."""
        about = self.dataset.open(path).metadata
        names = [about.row_group(0).column(k).path_in_schema for k in range(about.num_columns)] if about.num_row_groups else []
        if "episode_index" not in names:
            return 0
        column = names.index("episode_index")

        def is_before(group: int) -> bool:
            said = about.row_group(group).column(column).statistics
            return bool(said is not None and said.has_min_max and said.max < number)

        return sum(1 for _ in itertools.takewhile(is_before, range(about.num_row_groups)))

    def _order(self, path: Any, last: int, at: int, number: int) -> DataError:
        said = self.episodes[last] if 0 <= last < len(self.episodes) else 0
        found = f"{at} frames of episode {last}, then episode {number}" if last >= 0 else f"episode {number} first"
        return DataError(f"{path}: found {found}; needed: {len(self.episodes)} episodes in order, {said} frames in this one; are rows mixed?")

    def _check_times(self, path: Any, number: int, at: int, seconds: Any, time: str | None) -> None:
        """Refuses times that do not follow from the frames a second, which the file states too."""
        np, fps = need("numpy", "parquet"), self.dataset.fps
        expected = (np.arange(len(seconds)) + at) / fps
        # Measured times may be late by half a frame; a layout that names the column takes them as they are.
        late = ~(np.abs(seconds - expected) <= 0.5 / fps + 1e-6 * np.abs(expected))
        steps = np.diff(seconds)
        other_rate = len(steps) > 4 and not 0.8 <= float(np.median(steps)) * fps <= 1.25
        if other_rate or (time is None and late.any()):
            row = int(np.argmax(late))
            found = f"timestamp {seconds[row]:.6g} s after the first in frame {at + row}"
            raise DataError(f"{path}: episode {number}: found {found}; needed: {expected[row]:.6g}, as fps {fps:g} of meta/info.json says")

    def _batches(self, files: list[Path], columns: list[str], rows: int, left_out: int = 0) -> Iterator[tuple[Path, Any]]:
        """Some rows at a time, but for the first groups of the first file."""
        arrow = need("pyarrow", "parquet")
        for path in files:
            file = self.dataset.open(path)
            missing = [name for name in columns if name not in file.schema_arrow.names]
            if missing:
                raise DataError(f"{path}: found no column {missing[0]!r}; needed: one of {', '.join(file.schema_arrow.names[:40])}")
            # pyarrow keeps the columns of a file that it goes through as a whole.
            groups = range(left_out if path == files[0] else 0, file.num_row_groups)
            batches = (batch for group in groups for batch in file.iter_batches(rows, row_groups=[group], columns=columns, use_threads=False))
            while True:
                try:
                    batch = next(batches)
                except StopIteration:
                    break
                except (OSError, arrow.ArrowException) as error:
                    raise FileError(f"{path}: cannot be decoded: {error}; needed: the file as it was written", "parquet") from error
                yield path, batch

    def _column(self, path: Any, batch: Any, name: str) -> Any:
        """The numbers of a column: a row a frame."""
        np, arrow = need("numpy", "parquet"), need("pyarrow", "parquet")
        feature = self.dataset.features.get(name, {})
        shape = sizes(self.path, f"feature {name}", feature.get("shape", [1]), 8)
        column, count = batch.column(name), len(batch)
        if isinstance(column, arrow.ExtensionArray):
            column = column.storage
        empty = None
        if column.null_count:
            if name in COUNTERS:
                raise DataError(f"{path}: found no {name} in a row; needed: one in each")
            empty = ~column.is_valid().to_numpy(zero_copy_only=False)
            column = column.drop_null()
        flat, axes = column, shape if shape != (1,) or _is_list(arrow, column.type) else ()
        depth, rows = 0, count if empty is None else int((~empty).sum())
        while _is_list(arrow, flat.type):
            size = axes[depth] if depth < len(axes) else None
            if size is None or flat.null_count or not _has_length(np, arrow, flat, size):
                found = f"lists of {_lengths(np, flat)} numbers" if size is not None else f"lists in {depth + 1} levels"
                raise DataError(f"{path}: {name}: found {found} on axis {depth + 1}; needed: the shape {shape}, as features of meta/info.json say")
            flat, depth = flat.flatten(), depth + 1
        if depth != len(axes) or not (arrow.types.is_integer(flat.type) or arrow.types.is_floating(flat.type) or arrow.types.is_boolean(flat.type)):
            raise DataError(f"{path}: {name}: found {column.type}; needed: numbers of the shape {shape}, as features of meta/info.json say")
        array = flat.to_numpy(zero_copy_only=False).reshape(rows, *axes)
        if name in COUNTERS or (empty is None and axes == shape):
            return array
        array = array.reshape(rows, *shape)
        if empty is None:
            return array
        whole = np.full((count, *shape), np.nan, np.result_type(array.dtype, np.float32))
        whole[~empty] = array
        self._count("null", int(empty.sum()))
        return whole

    def _count(self, what: str, number: int) -> None:
        """How many frames have no readings, for the statement at the end."""
        self.counted[what] = self.counted.get(what, 0) + number
        self.statements = [each for each in self.statements if each[0] != what]
        self.state(what, f"{self.counted[what]} frames are {what}: no readings there")

    def _status(self) -> tuple[str, int | None] | None:
        """The column that says which frames are valid: `.valid`, or `valid` of `.status`."""
        for suffix in (".valid", ".status"):
            name = self.stream + suffix
            feature = self.dataset.features.get(name)
            if feature is None or name not in self.dataset.columns:
                continue
            if suffix == ".valid":
                return name, None
            names = feature.get("names")
            if is_list(names) and "valid" in names:
                return name, names.index("valid")
        return None

    def _valid(self, status: tuple[str, int | None] | None, batch: Any, path: Any, rows: slice, values: Any, number: int, at: int) -> Any:
        """The values, NaN where the file says that they are not valid."""
        np = need("numpy", "parquet")
        if status is None:
            return values
        name, column = status
        flags = self._column(path, batch, name)[rows]
        good = np.asarray(flags.reshape(len(values), -1)[:, column or 0] != 0) if column is not None else flags != 0
        if column is None and good.shape[1:] not in ((1,), self.cells):
            raise DataError(f"{path}: {name}: found the shape {good.shape[1:]}; needed: (1,) or {self.cells}")
        if good.all():
            return values
        self._count("not valid", int((~good.reshape(len(good), -1)).any(axis=1).sum()))
        if good.shape[1:] != self.cells:
            good = good.reshape(len(good), *[1] * len(self.cells))
        return np.where(good, values, np.asarray(np.nan, np.result_type(values.dtype, np.float32)))


def _is_list(arrow: Any, kind: Any) -> bool:
    types = arrow.types
    return bool(types.is_list(kind) or types.is_fixed_size_list(kind) or types.is_large_list(kind))


def _has_length(np: Any, arrow: Any, lists: Any, size: int) -> bool:
    """Whether all lists of an array have one length."""
    if arrow.types.is_fixed_size_list(lists.type) or not len(lists):
        return not len(lists) or bool(lists.type.list_size == size)
    return bool((np.diff(lists.offsets.to_numpy()) == size).all())


def _lengths(np: Any, lists: Any) -> str:
    return ", ".join(map(str, np.unique(lists.value_lengths().to_numpy(zero_copy_only=False))[:4].tolist()))


def _numbers(path: Path) -> list[int]:
    """The numbers in the names of a file and of its folder."""
    return [int(each) for name in (path.parent.name, path.name) for each in re.findall(r"\d+", name)]

"""A recording in a file: what is in it, what it says, and its readings a chunk at a time."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

from dermatome._arguments import A_MAP, check_kind, path_of, word_of
from dermatome._dermatome import Layout, Map, Skin
from dermatome._errors import ArgumentError, DataError
from dermatome._whole import whole, written
from dermatome.recordings import Container, Track, open_container
from dermatome.recordings._blocks import Join, learn_frames, learnable
from dermatome.recordings._track import Block
from dermatome.recordings.core import Arrays, Text, draft_of_array

if TYPE_CHECKING:
    from types import TracebackType

    from dermatome._readings import Readings

# `Recording.read` refuses more: 1 GB.
MOST_BYTES = 10**9
# The stream of times where the layout names a unit of time and no stream.
TIMES = "timestamps"
# What a number of ns is multiplied by to be in a unit of time.
NANOSECONDS = {"s": 1e-9, "ms": 1e-6, "us": 1e-3, "ns": 1.0}


class Draft(str):
    """The text of a layout, with null where nobody knows."""

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write it to a file.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        with written(path) as part:
            part.write_text(self, encoding="utf-8")


class Recording:
    """A recording in a file, of which nothing but headers was read: made by `Readings.open`. It is pickled as its path and
    what was asked of it, and opened again.

    Attributes
    ----------
    path : str
        The file or folder.
    streams : dict of str to tuple of int
        What there is: the shape of each stream, the number of frames first, -1 where only reading all of them shows it.
        A `*` stands for the number of an episode.
    layout : Layout or None
        What the file does not say.
    episode : int or None
        The episode that is read; None: one after the other, never joined in a chunk.
    """

    def __init__(
        self, made: type[Readings], path: str | os.PathLike[str], stream: str | None = None, layout: Any = None, episode: int | None = None
    ) -> None:
        self._made, self.path = made, path_of("path", path)
        number = None if episode is None else whole(episode)
        if episode is not None and (number is None or number < 0):
            raise DataError(f"episode: found {episode!r}; needed: a whole number from 0")
        # The order of three axes of an array, as a word.
        is_axes = isinstance(layout, str) and layout in ("tnc", "tcn")
        self._axes: Literal["tnc", "tcn"] | None = layout if is_axes else None  # type: ignore[assignment, unused-ignore]
        self.layout = layout_of(None if self._axes else layout)
        self.episode = number
        self._given = stream = None if stream is None else word_of("stream", stream)
        self._wanted = stream if stream is not None else self.layout.stream if self.layout else None
        self._from = "argument" if stream is not None else "layout" if self._wanted else "file"
        self._container: Container | None = open_container(path)
        if self._container is not None and self._axes:
            raise DataError(f"{path}: found the layout {self._axes!r}; needed: a layout with axes, time, channels, press, zero and taxels")
        self._track: Track | None = None
        self._decoder: Any = None
        self._said: tuple[tuple[str, str, str], ...] = ()
        if self._container is not None:
            self.streams = dict(self._container.streams)
            if self._wanted is not None or self.layout is not None:
                self._decoder = self._new_decoder()
                self._remember(self._decoder.statements if self._decoder else ())
            return
        self._text: Text | None = None
        self.streams = {}
        # An array without a layout can be drafted: what is missing is an error when it is read.
        if self.layout is not None or self._axes or not Text.is_known(self.path) or self._opens():
            self._text = self._core()
            self.streams = dict(self._text.streams)
            self._remember(self._text.statements)

    @property
    def stream(self) -> str:
        """str: The name of the stream that is read."""
        return self._of().stream if self._container is not None else (self._wanted or next(iter(self.streams), ""))

    @property
    def says(self) -> dict[str, Any]:
        """dict: What the file states of the stream: unit, rate, axes, ids, area, sensor, pitch."""
        return dict(self._of().says) if self._container is not None else self._opened().says

    @property
    def episodes(self) -> tuple[int, ...]:
        """tuple of int: The number of frames of each episode; empty where that is not known before the end."""
        if self._container is not None:
            return self._of().episodes
        text = self._opened()
        return () if text.frames is None else (text.frames // text.episodes,) * text.episodes

    @property
    def statements(self) -> list[tuple[str, str, str]]:
        """list of tuple of str: What is known, its value, and who says so: "file", "layout", "argument" or "checked".

        What is found in the readings is added while they are read.
        """
        made = [("stream", self.stream, self._from)]
        if self.episode is not None:
            made.append(("episode", str(self.episode), "argument"))
        elif len(self.episodes) > 1:
            lengths = ", ".join(map(str, self.episodes[:10])) + (", ..." if len(self.episodes) > 10 else "")
            made.append(("episodes", f"{len(self.episodes)}, one after the other, of {lengths} frames; times are those of each", "file"))
        if self._track is not None:
            made += self._track.statements
        return list(dict.fromkeys([*made, *self._said]))

    def chunks(self, map: Map | None = None, frames: int = 1024) -> Iterator[Readings]:
        """The readings, at most `frames` frames at a time; a chunk has frames of one episode.

        Parameters
        ----------
        map : Map, optional
            The map in whose order they are; by default they are in the order of their ids.
        frames : int
            The most frames of a chunk.

        Yields
        ------
        Readings
            With float32 values, or float64 where numbers of the file need them. Times begin at 0 in each episode, or
            are those of the file in s.

        Raises
        ------
        DataError
            If frames is no whole number above 0, a layout is needed, or, while they are read, a frame is not as the
            layout says.
        """
        if map is not None:
            check_kind("map", map, Map, A_MAP)
        return self._chunks(map, _frames(frames))

    def _chunks(self, map: Map | None, frames: int) -> Iterator[Readings]:
        from dermatome._rest import rested

        join: Join | None = None
        channels: tuple[str, ...] = ()
        units: tuple[str, ...] = ()
        for episode, values, seconds, source in self._decoded(frames):
            if join is None:
                channels, units = tuple(source.channels), tuple(source.units)
                join = Join(map, source.ids, channels, units)
            for start in range(0, len(values), frames):
                part = slice(start, start + frames)
                made = self._made(join(values[part]), join.ids, seconds[part], channels, units, remarks=join.remarks, episode=episode)
                tared, threshold = source.rest
                yield rested(replace(made, threshold=threshold, kinds=source.kinds), tared)

    def _decoded(self, frames: int) -> Iterator[tuple[int, Any, Any, Any]]:
        """The number of an episode, values (T, C, N) and times of some of its frames, and who decoded them."""
        if self._container is None:
            source = self._core()
            while (found := source.next(frames)) is not None:
                yield *found, source
                self._remember(source.statements)
            self._remember(source.statements)
            return
        layout, track = self._needed(), self._of()
        if not sum(track.episodes):
            raise DataError(f"{self.path}: found no frame of {track.stream}; needed: one or more")
        # Times beside a stated rate are compared with it.
        time = track.times_beside() if "rate" in layout.time else layout.time.get("stream") or TIMES
        decoder = self._decoder = self._new_decoder()
        learn = learn_frames(decoder)
        track.missing = tuple(json.loads(layout.text).get("missing") or ())
        blocks = track.blocks(max(frames, learn), self.episode, time, layout.zero_stream)
        first: dict[int, Any] = {}
        for block in learnable(blocks, learn):
            times = block.times
            if times is not None and getattr(track, "ticks", None):
                # The first is subtracted as an integer: 1e18 ns as a float is 0.2 us off.
                times = times - first.setdefault(block.episode, times[0])
                times = times if "rate" in layout.time else times * NANOSECONDS[layout.time["unit"]]
            made, seconds = decoder.decode(block.values, times, block.episode, self._zero(block))
            self._remember(decoder.statements)
            yield block.episode, made, seconds, decoder

    def raw(self, frames: int = 1024) -> Iterator[tuple[int, Any]]:
        """The number of the episode and the numbers of the stream as the file has them, at most `frames` frames at a time.

        Raises
        ------
        DataError
            If the file has no raw numbers, or frames is no whole number above 0.
        """
        if self._container is None:
            raise DataError(f"{self.path}: found a file without raw numbers; needed: chunks, or Zarr, LeRobot, HDF5, a bag")
        return ((block.episode, block.values) for block in self._of().blocks(_frames(frames), self.episode))

    def read(self, map: Map | None = None) -> Readings:
        """All readings; episodes one after the other, each with its own times.

        Raises
        ------
        DataError
            If they take more than 1 GB: `chunks` reads them a part at a time.
        """
        import numpy as np

        # A file that the library reads has the chosen episode alone.
        known = self.episodes
        if self.episode is not None and self._container is not None:
            known = known[self.episode : self.episode + 1]
        total, at = (sum(known) if known else None), 0
        made: tuple[Readings, Any, Any] | None = None
        numbers: list[Any] = []
        kept: list[Readings] = []
        size = 0
        for part in self.chunks(map):
            each = part.values.nbytes // max(len(part), 1)
            size = (total or 0) * each if total else size + part.values.nbytes
            if size > MOST_BYTES:
                frames = f"{total} frames" if total else "more frames"
                raise DataError(f"{self.path}: found {frames} of {each} bytes; needed: at most {MOST_BYTES} bytes in all; chunks() reads them a part at a time")
            numbers.append(np.full(len(part), part.episode or 0, dtype=np.int64))
            if total is None:
                kept.append(part)
                continue
            if made is None:
                made = (part, np.empty((total, *part.values.shape[1:]), part.values.dtype), np.empty(total))
            made[1][at : at + len(part)], made[2][at : at + len(part)] = part.values, part.timestamps
            at += len(part)
        if total is None and kept:
            made = (kept[0], np.concatenate([part.values for part in kept]), np.concatenate([part.timestamps for part in kept]))
            at = len(made[1])
        if made is None:
            raise DataError(f"{self.path}: found no frame; needed: one or more")
        first, values, times = made
        said = [f"{what}: {value}" for what, value, source in self.statements if source == "checked" or what == "episodes"]
        episode = first.episode if len(known) <= 1 else None
        remarks = (*first.remarks, *said)
        episodes: Any = np.concatenate(numbers)
        several = episodes if (episodes != episodes[:1]).any() else None
        return replace(first, values=values[:at], timestamps=times[:at], remarks=remarks, episode=episode, episodes=several)

    def skin(self) -> Skin:
        """A skin of the taxels where the file says where they are: by their pitch, their centres, or points of a cloud.

        Raises
        ------
        FileError
            If the file cannot be read.
        DataError
            If it does not say where taxels are.
        """
        found: Skin | None = None
        if self._container is None:
            found = Skin.read(self.path)
        else:
            first: Any = getattr(self._of(), "first", None)
            if first is not None and first.points is not None:
                found = Skin.from_arrays(first.points, ids=first.ids)
        if found is None:
            raise DataError(f"{self.path}: found no pitch and no positions of taxels; needed: Skin.read or Skin.from_arrays")
        return found

    def write_oxt(self, path: str | os.PathLike[str], map: Map, level: int = 1, *, areas: Mapping[str, int] | None = None, side: str = "right") -> None:
        """Write images of a map as a Zarr of Open-X-Tactile, which FTP-1 reads: `SIDE_tactile_data_map (T, areas, H, W)`.

        Parameters
        ----------
        path : str or os.PathLike
            A `.zarr.zip`, or a `.zarr` folder that does not exist yet.
        map : Map
            The map.
        level : int
            The level that is drawn; a patch without it has its coarsest level.
        areas : mapping of str to int, optional
            The functional area of each patch, 0 to 23: 0 to 4 are the tips of thumb to little finger, 5 is the palm. A
            patch that is not in it is left out. By default the named regions of the map that have the name of an area
            (`dermatome.recordings.AREAS`): an image of each, of the patch that has most of its taxels. Images have pixels
            of one size, and are padded to one size with 0, as is what shows no skin; a missing reading is NaN.
        side : {"right", "left"}
            The hand.

        Raises
        ------
        FileError
            If it cannot be written.
        DataError
            If the folder exists, or the map has no such level or area.
        """
        from dermatome.recordings.write import write_oxt

        write_oxt(self, path, map, level, areas, side)

    def write_lerobot(self, path: str | os.PathLike[str], map: Map, level: int | str = 1, *, repo_id: str | None = None) -> Any:
        """Write a copy of a LeRobot dataset with the values of the fields of a map as features, by lerobot's `add_features`.

        Features are those of `dermatome.lerobot.features`, for each channel; also of a level without a mesh, as `level="body.L1"`.

        Returns
        -------
        LeRobotDataset
            The new dataset, in the folder `path`.

        Raises
        ------
        ImportError
            If lerobot is not installed.
        DataError
            If the recording is no LeRobot dataset, the folder exists, or the map has no such level.
        """
        from dermatome.recordings.write import write_lerobot

        return write_lerobot(self, path, map, level, repo_id)

    def close(self) -> None:
        """Close the file."""
        if self._container is not None:
            self._container.close()

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        return Recording, (self._made, self.path, self._given, self._axes or self.layout, self.episode)

    def __repr__(self) -> str:
        shown = ", ".join(f"{name} {shape}" for name, shape in list(self.streams.items())[:3])
        return f"<Recording: {self.path}: {shown}{', ...' if len(self.streams) > 3 else ''}>"

    def draft(self) -> Draft:
        """The text of a layout with what the file says, and null where nobody knows, for `Draft.write`.

        Raises
        ------
        FileError
            If the file cannot be read.
        DataError
            If it holds several streams and none is chosen.
        """
        if self._container is None:
            return Draft(self._text.draft() if self._text else draft_of_array(self.path))
        if self._wanted is None and self._track is None and len(names := self._container.single_columns()) > 1:
            rate = self._container.track(names[0]).says.get("rate")
            drafted = Layout.draft_columns(self.path, names, says={} if rate is None else {"rate": rate})
            if drafted is not None:
                return Draft(drafted)
        track = self._of()
        return Draft(Layout.draft(self.path, track.cells, stream=track.stream, says=_stated(track, None)))

    def _remember(self, said: Any) -> None:
        self._said = tuple(tuple(map(str, each)) for each in said)  # type: ignore[misc]

    def _opened(self) -> Text:
        """The reader of a file that the library reads itself; an error if it needs a layout."""
        return self._text or self._core()

    def _opens(self) -> bool:
        try:
            self._core()
        except DataError:
            return False
        return True

    def _core(self) -> Text:
        """A new reader of a file that the library reads itself."""
        if self._axes:
            if self.episode not in (None, 0):
                raise DataError(f"{self.path}: found episode={self.episode!r}; needed: 0: this file is one episode")
            return Arrays(self.path, self._made.read(self.path, layout=self._axes))
        return Text(self.path, self._given, self.layout, self.episode)

    def _needed(self) -> Any:
        if self.layout is None:
            needed = "layout=, a file that says axes, time, unit, sign, zero and taxels; Layout.draft(recording).write(path) begins one"
            raise DataError(f"{self.path}: found {self._of().stream} {self._of().cells} without a layout; needed: {needed}")
        return self.layout

    def _of(self) -> Track:
        if self._track is None:
            container: Any = self._container
            axis = self.layout.frame_axis if self.layout else 0
            if self.layout and "episode" in self.layout.axes:
                raise DataError(f"{self.path}: found an axis 'episode' in the layout; needed: axes without it: only an array of numpy has one")
            joined: Track | None = container.joined(self.layout) if self.layout else None
            self._track = joined or container.track(container.choose(self._wanted), axis)
        assert self._track is not None
        return self._track

    def _zero(self, block: Block) -> Any:
        """The numbers at rest of a block: one for all its frames, or one beside each; None where the layout takes none of a stream."""
        import numpy as np

        name = self._needed().zero_stream
        if name is None:
            return None
        zero = np.asarray(block.zero)
        if zero.shape not in (block.values.shape, block.values.shape[1:]):
            raise DataError(f"{self.path}: {name}: found zeros of the shape {zero.shape[1:]}; needed: {block.values.shape[1:]}, that of a frame")
        return zero

    def _new_decoder(self) -> Any:
        track, layout = self._of(), self.layout
        if layout is None:
            return None
        zero: Any = None
        if layout.zero_stream:
            import numpy as np

            # That of each block is given with it.
            zero = np.zeros(track.cells)
        return layout.decoder(self.path, track.cells, stream=track.stream, says=_stated(track, layout), zero=zero)


def _frames(given: Any) -> int:
    """The most frames of a chunk."""
    number = whole(given)
    if number is None or number < 1:
        raise DataError(f"frames: found {given!r}; needed: a whole number above 0")
    return number


def _stated(track: Track, layout: Any) -> dict[str, Any]:
    """What a file says, with the units of the components that a layout takes."""
    says = dict(track.says)
    if layout is not None and "rate" in layout.time and getattr(track, "ticks", None):
        says["time_unit"] = "ns"
    units = says.pop("units", None)
    if units and len(set(units)) == 1:
        says["unit"] = units[0]
    elif units and layout is not None:
        chosen = [channel.get("component") for channel in json.loads(layout.text).get("channels", [])]
        if all(isinstance(k, int) and 0 <= k < len(units) for k in chosen):
            says["unit"] = [units[k] for k in chosen]
    elif units:
        says["units"] = ", ".join(units)
    return says


def layout_of(given: Layout | str | os.PathLike[str] | Mapping[str, Any] | None) -> Layout | None:
    """A layout, of a file, an object or a dict."""
    if given is None or isinstance(given, Layout):
        return given
    if isinstance(given, Mapping):
        try:
            return Layout.parse(json.dumps(given, default=_plain))
        except (TypeError, ValueError) as error:
            if isinstance(error, DataError):
                raise
            raise DataError(f"layout: found {error}; needed: what JSON can hold") from None
    if isinstance(given, (str, os.PathLike)):
        return Layout.read(given)
    raise ArgumentError(f"layout: found {type(given).__name__}; needed: a file, a Layout or a dict")


def _plain(value: Any) -> Any:
    """A number or an array of numpy as JSON has them."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"a {type(value).__name__}")


Recording.__module__ = "dermatome"

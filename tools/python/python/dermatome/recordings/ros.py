"""Bags of ROS 1 and 2 and MCAP files, without ROS. A stream is a topic, or a field of its messages: `/skin.pressure`.

`/hand.thumb` is a sensor of a TactileState, `/points.pressure` a field of a cloud of points, `/wrist.wrench.force` any
field of any message. Times are the stamps of the headers (`header`) or those of the recording (`log`), in ns.
"""

from __future__ import annotations

import itertools
import json
import numbers
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from dermatome._adapter import need
from dermatome._errors import DataError, FileError
from dermatome._messages import DEFINITIONS, Frame, fields_of_message, frame_of
from dermatome.recordings._track import MOST_BYTES, MOST_JSON, Block, Container, Track, small_enough

HEADER, LOG = ("header", "stamp", "header.stamp"), ("log", "bag", "recording")
# What an MCAP record of a chunk begins with: opcode, length; then times, size, checksum, and the length of a name.
RECORD, CHUNK, CHUNK_HEAD = struct.Struct("<BQ"), 6, struct.Struct("<QQQII")


class Bag(Container):
    """A bag: a folder, a `.bag`, a `.db3` or an `.mcap`."""

    def __init__(self, path: Any) -> None:
        super().__init__(path)
        self.reader = open_bag(path)
        self.counts: dict[str, int] = {}
        for topic, count in self.reader.topics().items():
            self.counts[topic] = count
            message = None
            try:
                _, message = next(self.reader.messages(topic))
                for name, shape in fields_of_message(message).items():
                    self.streams[f"{topic}.{name}" if name else topic] = (count, *shape)
            except StopIteration:
                continue
            except FileError as error:  # Told when the topic is asked for.
                self.unread[topic] = error
            except DataError as error:
                self.unread[topic] = error if message is None else DataError(f"{path}: message 0 of {topic}: {error}")

    def close(self) -> None:
        self.reader.close()

    def track(self, stream: str, frame_axis: int = 0) -> Track:
        if frame_axis:
            raise DataError(f"{self.path}: found the frames on axis {frame_axis} in the layout; needed: axis 0: a message is a frame")
        topics = [topic for topic in self.counts if stream == topic or stream.startswith(f"{topic}.")]
        if not topics:
            known = ", ".join(list(self.streams)[:40]) or "no topic with numbers"
            raise DataError(f"{self.path}: found no stream {stream!r}; needed: one of {known}")
        topic = max(topics, key=len)
        wanted = stream[len(topic) + 1 :]
        try:
            _, message = next(self.reader.messages(topic))
        except StopIteration:
            raise DataError(f"{self.path}: found no message of {topic}; needed: at least one") from None
        first = self.frame(message, topic, wanted, 0)
        small_enough(self.path, stream, first.values.shape, first.values.dtype.itemsize)
        says = {key: value for key, value in (("axes", first.axes), ("unit", first.unit), ("units", first.units)) if value}
        if first.ids is not None:
            says["ids"] = first.ids.tolist()
        made = BagTrack(self.path, stream, first.values.shape, first.values.dtype.str, (self.counts[topic],), says, bag=self, topic=topic, wanted=wanted)
        made.first = first
        for what, value in first.said.items():
            made.state(what, value)
        return made

    def frame(self, message: Any, topic: str, wanted: str, number: int) -> Frame:
        """The numbers of a message."""
        try:
            return frame_of(message, wanted)
        except DataError as error:
            raise DataError(f"{self.path}: message {number} of {topic}: {error}") from None


@dataclass
class BagTrack(Track):
    bag: Any = None
    topic: str = ""
    wanted: str = ""
    first: Any = None
    # Times are in ns, whatever unit the layout has.
    ticks: bool = True
    log_times: bool = field(default=False)

    def blocks(self, frames: int, episode: int | None = None, time: str | None = None, zero: str | None = None) -> Iterator[Block]:
        np = need("numpy", "ros")
        if zero is not None:
            raise DataError(f"{self.path}: found the stream {zero!r} as `zero` in the layout; needed: a number, or {{\"first\": n}}: messages have no stream beside them")
        if episode not in (None, 0):
            raise DataError(f"{self.path}: found episode={episode}; needed: 0: a bag is one episode")
        most = max(1, min(frames, MOST_BYTES // max(self.first.values.nbytes, 1)))
        rows: list[Any] = []
        times: list[int] = []
        for number, (logged, message) in enumerate(self.bag.reader.messages(self.topic)):
            frame = self.bag.frame(message, self.topic, self.wanted, number)
            rows.append(self._in_order(frame, number))
            if time is not None:
                times.append(self._time(message, logged, time, number))
            if len(rows) == most:
                yield Block(0, np.stack(rows), np.array(times, np.int64) if times else None)
                rows, times = [], []
        if rows:
            yield Block(0, np.stack(rows), np.array(times, np.int64) if times else None)

    def times_beside(self) -> str | None:
        _, message = next(self.bag.reader.messages(self.topic))
        return "header" if self._stamp(message, 0) else None

    def _time(self, message: Any, logged: int, time: str, number: int) -> int:
        if time in LOG:
            return logged
        if time not in HEADER:
            raise DataError(f"{self.path}: found the times {time!r} in the layout; needed: 'header', the stamps of the messages, or 'log', those of the recording")
        found = self._stamp(message, number)
        if found is None:
            raise DataError(f"{self.path}: found no header in messages of {self.topic}; needed: 'log' as the stream of times, or a rate")
        if number == 0 and found == 0:
            # A simulation begins at 0: its second stamp shows it.
            later = (self._stamp(message, k) for k, (_, message) in enumerate(self.bag.reader.messages(self.topic)))
            self.log_times = not any(itertools.islice(later, 1, 3))
            if self.log_times:
                self.state("times", "those of the recording, as all stamps are 0")
        if (found == 0) != self.log_times and number > 0:
            raise DataError(f"{self.path}: message {number} of {self.topic}: found the stamp {found}; needed: {'0' if self.log_times else 'a time'} as before; or 'log' as the stream of times")
        return logged if self.log_times else found

    def _stamp(self, message: Any, number: int) -> int | None:
        return stamp_of(message, f"{self.path}: message {number} of {self.topic}")

    def _in_order(self, frame: Frame, number: int) -> Any:
        """The numbers in the order of the first message, by their ids."""
        np, first = need("numpy", "ros"), self.first
        where = f"{self.path}: message {number} of {self.topic}"
        for found, needed in ((frame.names, first.names), (frame.sensors, first.sensors)):
            if found != needed:
                raise DataError(f"{where}: found {found}; needed: {needed} as in the first message")
        if frame.unit != first.unit:
            raise DataError(f"{where}: found the unit {frame.unit!r}; needed: {first.unit!r} as in the first message")
        if first.ids is None:
            if frame.values.shape != first.values.shape:
                raise DataError(f"{where}: found the shape {frame.values.shape}; needed: {first.values.shape} as in the first message")
            if frame.points is not None and not np.array_equal(frame.points, first.points, equal_nan=True):
                same = frame.points.shape == first.points.shape and np.array_equal(*(np.sort(p.ravel()) for p in (frame.points, first.points)))
                if same:
                    raise DataError(f"{where}: found the points in another order, without ids; needed: a field `id`, or one order")
                self.state("points", "positions change from message to message; a point is a taxel by its number")
            return frame.values
        if frame.ids is not None and np.array_equal(frame.ids, first.ids):
            return frame.values
        order = np.argsort(first.ids, kind="stable")
        at = np.searchsorted(first.ids[order], frame.ids) if frame.ids is not None else np.array([], int)
        good = frame.ids is not None and bool(np.all(at < len(order))) and np.array_equal(first.ids[order][at], frame.ids)
        if not good or len(np.unique(at)) != len(at) or len(np.unique(first.ids)) != len(order):
            raise DataError(f"{where}: found other ids than in the first message; needed: {len(order)} ids, each once and all of them known")
        if len(at) < len(order):
            self.state("ids", "some messages lack some ids: no readings there")
        # Types of messages may differ, and where some have no readings there are floats.
        dtype = np.result_type(frame.values.dtype, np.float32) if len(at) < len(order) else frame.values.dtype
        made = np.full(first.values.shape, np.nan if len(at) < len(order) else 0, dtype)
        made[order[at]] = frame.values
        return made


def stamp_of(message: Any, where: str) -> int | None:
    """Nanoseconds of the stamp of a message, of ROS or as Foxglove writes it in JSON; None if it has none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return None
    parts: list[Any] = [getattr(stamp, name, None) for name in ("sec", "nanosec" if hasattr(stamp, "nanosec") else "nsec")]
    if not all(isinstance(part, numbers.Integral) for part in parts):
        known: Any = getattr(stamp, "__dict__", None)
        found = type(stamp).__name__ if known is None else sorted({*map(str, known)} - {"__msgtype__"})
        raise DataError(f"{where}: found the stamp {found}; needed: whole numbers sec and nanosec or nsec")
    return int(parts[0]) * 10**9 + int(parts[1])


def open_bag(path: Any, definitions: Mapping[str, str] | None = None) -> _Ros | _Json:
    """The messages of a bag; definitions of those of which it holds none."""
    for file in [Path(path)] if Path(path).is_file() else sorted(Path(path).glob("*.mcap")):
        _check_chunks(file)
    return _Json(str(path)) if _is_json(Path(path)) else _Ros(str(path), definitions or {})


class _Ros:
    """Messages of a bag by rosbags."""

    def __init__(self, path: str, definitions: Mapping[str, str]) -> None:
        highlevel, typesys = need("rosbags.highlevel", "ros"), need("rosbags.typesys", "ros")
        store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        for kind, text in {**DEFINITIONS, **definitions}.items():
            try:
                store.register(typesys.get_types_from_msg(text, kind))
            except Exception as error:  # Each of its parsers has its own.
                raise DataError(f"definitions: found {kind!r} that cannot be read: {error}; needed: a definition of ROS") from error
        self.path = path
        try:
            self.bag = highlevel.AnyReader([Path(path)], default_typestore=store)
            self.bag.open()
        except Exception as error:  # Each of its parsers has its own.
            raise FileError(f"{path}: found no bag that can be read: {error}; needed: a folder with metadata.yaml, .mcap, .db3 or .bag", "bag") from error

    def topics(self) -> dict[str, int]:
        made: dict[str, int] = {}
        for each in self.bag.connections:
            made[each.topic] = made.get(each.topic, 0) + each.msgcount
        return made

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        connections = [each for each in self.bag.connections if each.topic == topic]
        kinds = sorted({each.msgtype for each in connections})
        if len(kinds) > 1:
            raise DataError(f"{self.path}: found messages of {', '.join(kinds)} in {topic}; needed: one type")
        messages, number = self.bag.messages(connections=connections), -1
        while True:
            number += 1
            try:
                connection, time, raw = next(messages)
                message = self.bag.deserialize(raw, connection.msgtype)
            except StopIteration:
                return
            except KeyError as error:
                needed = f"a bag with definitions, as ROS 2 Iron and later write, or dermatome.ros.read(definitions={{{kinds[0]!r}: ...}})"
                raise DataError(f"{self.path}: found no definition of {kinds[0]}, the messages of {topic}; needed: {needed}") from error
            except Exception as error:
                raise FileError(f"{self.path}: message {number} of {topic} cannot be read: {error}; needed: the bag as it was written", "bag") from error
            yield time, message

    def close(self) -> None:
        self.bag.close()


class _Json:
    """Messages of JSON in an MCAP file."""

    def __init__(self, path: str) -> None:
        self.path, self.file = path, open(path, "rb")
        self.reader = need("mcap.reader", "ros").SeekingReader(self.file, record_size_limit=MOST_BYTES)

    def topics(self) -> dict[str, int]:
        made: dict[str, int] = {}
        for _, channel, _ in self._all(None):
            made[channel.topic] = made.get(channel.topic, 0) + 1
        return made

    def _all(self, topics: Any) -> Iterator[Any]:
        try:
            yield from self.reader.iter_messages(topics=topics)
        except Exception as error:  # Each of its parsers has its own.
            raise FileError(f"{self.path}: found no MCAP file that can be read: {error}; needed: the file as it was written", "bag") from error

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        for number, (schema, channel, message) in enumerate(self._all([topic])):
            where = f"{self.path}: message {number} of {topic}"
            if channel.message_encoding != "json":
                raise DataError(f"{where}: found the encoding {channel.message_encoding!r}; needed: cdr or json")
            kind = schema.name if schema else "JSON"
            if len(message.data) > MOST_JSON:
                raise FileError(f"{where}: found {len(message.data)} bytes; needed: at most {MOST_JSON}", "too-large")
            try:
                found = json.loads(message.data, object_hook=lambda each: SimpleNamespace(**{**each, "__msgtype__": kind}))
            except (ValueError, RecursionError) as error:
                raise FileError(f"{where}: found no JSON: {error}; needed: the file as it was written", "json") from None
            if not isinstance(found, SimpleNamespace):
                raise DataError(f"{where}: found {type(found).__name__}; needed: an object")
            yield message.log_time, found

    def close(self) -> None:
        self.file.close()


def _is_json(path: Path) -> bool:
    """Whether a file is MCAP with a profile that is not of ROS: rosbags reads the others."""
    if not path.is_file():
        return False
    with open(path, "rb") as file:
        head = file.read(64)
    if not head.startswith(b"\x89MCAP0\r\n") or len(head) < 21:
        return False
    length = int.from_bytes(head[17:21], "little")
    return head[21 : 21 + length] not in (b"ros2", b"ros1")


def _check_chunks(path: Path) -> None:
    """Refuses an MCAP file with a chunk that becomes larger than is useful."""
    with open(path, "rb") as file:
        if not file.read(8).startswith(b"\x89MCAP0\r\n"):
            return
        while len(head := file.read(RECORD.size)) == RECORD.size:
            kind, length = RECORD.unpack(head)
            start = file.tell()
            if kind == CHUNK:
                about = file.read(CHUNK_HEAD.size)
                if len(about) < CHUNK_HEAD.size:
                    return
                _, _, size, _, name = CHUNK_HEAD.unpack(about)
                compression = file.read(min(name, 16))
                file.read(8)
                frame = file.read(18)
                if compression == b"zstd" and len(frame) == 18:
                    from dermatome.recordings.zarr import size_in

                    try:
                        size = max(size, size_in("zstd", frame))
                    except ValueError:
                        pass  # The size is that of the record.
                if size > MOST_BYTES:
                    raise FileError(f"{path}: found a chunk of {size} bytes at byte {start}; needed: at most {MOST_BYTES}; `mcap compress --chunk-size` makes smaller ones", "too-large")
            file.seek(start + length)

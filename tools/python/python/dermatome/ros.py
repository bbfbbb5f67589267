"""Readings in ROS bags, and images, points and contacts to them, without an installation of ROS.

`rosbags` reads bags of ROS 1 and 2, of SQLite and MCAP.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from dermatome._adapter import fields_of, level_of, need, patch_of
from dermatome._arguments import A_MAP, READINGS, array_of, check_kind, mapping_of, one_of, path_of, word_of, words_of
from dermatome._dermatome import Map, as_floats
from dermatome._errors import DataError, FileError, MissingFileError
from dermatome._messages import Frame, arrays_in, field_of, frame_of, is_array, is_image, kind_of, readings_in, sensors_of, table_of
from dermatome._readings import Readings, channel_of
from dermatome._whole import written
from dermatome.recordings.ros import open_bag, stamp_of

__all__ = ["read", "write"]

# What `values` of `read` may be.
Wanted = str | Sequence[str] | Callable[[Any], Any] | None
# Labels of the axis of a MultiArray that is not of taxels.
CHANNELS = re.compile("channel|component|^ax[ei]s|^xyz|^force|^c$")


def read(
    path: Any,
    topic: str,
    map: Map,
    *,
    values: Wanted = None,
    ids: Any = None,
    channels: str | Sequence[str] | None = None,
    units: str | Sequence[str] | None = None,
    stamp: Literal["header", "bag"] | None = None,
    definitions: Mapping[str, str] | None = None,
) -> Readings:
    """Read the readings of a topic.

    Parameters
    ----------
    path : str or os.PathLike
        A bag: a folder, a `.mcap` or a `.bag`.
    topic : str
        A topic of one of these messages, or of any other with `values`:

        - `tactile_msgs/TactileState`: sensors are patches with these names, or channels with a reading of each taxel, or
          parts of the taxels one after the other;
        - arrays of numbers as `std_msgs/Float32MultiArray`: as their layout says, an axis called `channel`, `axis` or the
          like is of channels;
        - `sensor_msgs/Image`: a pixel for each taxel, row by row from the top, of any encoding of whole or real numbers;
        - `sensor_msgs/PointCloud2`: a point for each taxel, with the field `value`, or else all fields that are no
          position, normal, colour, time or id. A field `id` or `taxel_id` has the ids.
    map : Map
        The map.
    values : str, sequence of str, or function, optional
        Where the readings are: the name of a field of the message (`pressure`, `hand.pressure`, `taxels.force` of a list),
        of its points or of its sensors, several for several channels; or a function of a message that returns an array
        (n,) or (C, n).
    ids : (n,) array_like of int, str or function, optional
        Ids of the numbers in a message, or the name of the field that has them, or a function of a message; by default
        those of the message, or else the order of the map. Ids may differ from message to message.
    channels, units : str or sequence of str, optional
        Names and units of the channels, instead of those of the message, which has no units.
    stamp : {"header", "bag"}, optional
        Which time a frame has: that in the header of its message, or that of the recording; by default the first if
        there is one.
    definitions : mapping of str to str, optional
        Definitions of messages by their type, for bags that hold none.

    Returns
    -------
    Readings

    Raises
    ------
    MissingFileError, FileError
        If it does not exist, or cannot be read.
    ImportError
        If rosbags is not installed.
    DataError
        If there is no such topic or field, or a message is not of the taxels of the map: the message says which.
    """
    stamp = None if stamp is None else one_of("stamp", stamp, ("header", "bag"))  # type: ignore[assignment]
    check_kind("map", map, Map, A_MAP)
    path, topic = path_of("path", path), word_of("topic", topic, "the name of a topic")
    if values is not None and not callable(values):
        values = words_of("values", values, "the name of a field, names of several, or a function of a message")
    if definitions is not None:
        needed = "a dict of types of messages to their definitions"
        definitions = {word_of("definitions", kind, needed): word_of("definitions", text, needed) for kind, text in mapping_of("definitions", definitions, needed).items()}
    np = need("numpy", "ros")
    frames: list[Any] = []
    kind = ""
    at: list[float] = []
    recorded: list[int] = []
    for number, (time, message) in enumerate(_messages(path, topic, definitions)):
        kind = kind_of(message)
        own = ids(message) if callable(ids) else _named_ids(message, ids) if isinstance(ids, str) else ids
        own = None if own is None else array_of("ids", own, "ids of taxels, the name of their field, or a function of a message").ravel()
        made = _numbers_of(message, map, map.n_taxels if own is None else len(own), values)
        if own is None:
            own = made.ids
        elif len(own) != made.values.shape[1]:
            raise DataError(f"ids: found {len(own)}; needed: {made.values.shape[1]}, one for each number of a message")
        if frames and made.names != frames[0].names:
            raise DataError(f"topic: found the channels {made.names} in a message; needed: {frames[0].names} as before")
        _refuse_fields(map, own, made.values.shape[1])
        frames.append(replace(made, ids=own))
        head = stamp_of(message, f"{path}: message {number} of {topic}")
        at.append(np.nan if head is None else head // 10**9 + head % 10**9 * 1e-9)
        recorded.append(time)
    times, remarks = _times(np.array(at), np.array(recorded), stamp, kind)
    array, columns = _joined(frames)
    # The points of one patch, which may share ids with another one.
    homes = [patch for patch in map.patches.values() if columns is not None and np.array_equal(columns, patch.ids)]
    if len(homes) == 1:
        whole = np.full((*array.shape[:2], map.n_taxels), np.nan)
        whole[:, :, homes[0].start : homes[0].start + len(homes[0].ids)] = array
        array, columns = whole, None
    names = frames[0].names if channels is None else channels
    readings = Readings.from_arrays(array, ids=columns, timestamps=times, channels=names, units=units)
    return replace(readings, remarks=remarks).on(map)


def _named_ids(message: Any, name: str) -> Any:
    """The ids in a field of a message or of its points."""
    return frame_of(message, name).values.astype(int) if hasattr(message, "point_step") else field_of(message, name)


@dataclass
class _Numbers:
    """The numbers of a message as channels of taxels: (C, n), names of the channels, and ids of the n where the message has some."""

    values: Any
    names: list[str]
    ids: Any = None


def _numbers_of(message: Any, map: Map, count: int, wanted: Wanted) -> _Numbers:
    """The numbers of a message that has readings of `count` taxels."""
    np = need("numpy", "ros")
    if callable(wanted):
        rows = as_floats("values", wanted(message))
        if rows.ndim not in (1, 2):
            raise DataError(f"values: found shape {rows.shape}; needed: shape (n,) or (C, n)")
        rows = np.atleast_2d(rows)
        return _Numbers(rows, [f"channel{k}" for k in range(len(rows))])
    names = _all_of(message) if wanted is None else list(wanted)
    parts = [_laid(frame_of(message, name), name, map, count) for name in names]
    lengths = [part.values.shape[1] for part in parts]
    if len(set(lengths)) != 1:
        raise DataError(f"values: found {lengths} numbers in {names}; needed: as many in each")
    return _Numbers(np.concatenate([part.values for part in parts]), [name for part in parts for name in part.names], parts[0].ids)


def _all_of(message: Any) -> list[str]:
    """What is read of a message where nothing is named: all of it, or of points `value`, or what may be a reading."""
    if hasattr(message, "point_step"):
        points = table_of(message)
        known = ["value"] if "value" in points.dtype.names else readings_in(points)
        if not known:
            needed = f"one of the fields {list(points.dtype.names)} of the points"
            raise DataError(f"values: found none that can be a reading; needed: {needed}")
        return known
    if is_image(message) or is_array(message) or sensors_of(message):
        return [""]
    raise DataError(f"topic: found {kind_of(message)}; needed: values, one of its fields {arrays_in(message)}, or a function of it")


def _laid(frame: Frame, name: str, map: Map, count: int) -> _Numbers:
    """The numbers of a frame as channels of taxels."""
    np = need("numpy", "ros")
    values = np.asarray(frame.values, dtype=np.float64)
    if frame.sensors is not None:
        return _sensors(frame.sensors, values, map, count)
    if frame.names is not None and values.ndim > 1 and values.shape[-1] == len(frame.names):
        block = values.reshape(-1, len(frame.names)).T
    else:
        is_one = values.ndim == 1 or frame.word == "pixels"
        block = values.reshape(1, -1) if is_one else _channels_first(values, frame.labels or [], count)
    # A list of numbers or points may be of other taxels, which ids say.
    is_grid = values.ndim > 1 and frame.word != "points" or frame.labels is not None
    if block.shape[1] != count and frame.ids is None and is_grid:
        sizes = " x ".join(f"{size} {label}".strip() for size, label in zip(values.shape, frame.labels or [""] * values.ndim))
        argument = "layout" if frame.labels else "values" if name else "topic"
        raise DataError(f"{argument}: found {sizes} {frame.word}; needed: {count}, one for each taxel, or ids of as many as there are")
    names = frame.names or ([name or "data"] if len(block) == 1 else [f"{name or 'data'}{k}" for k in range(len(block))])
    return _Numbers(block, names, frame.ids)


def _channels_first(values: Any, labels: list[str], count: int) -> Any:
    """A block of numbers with its axis of channels first, the one named so or else one beside the taxels, and one of taxels."""
    np = need("numpy", "ros")
    named = [axis for axis, label in enumerate(labels) if CHANNELS.search(label.lower())]
    if len(named) == 1:
        return np.moveaxis(values, named[0], 0).reshape(values.shape[named[0]], -1)
    if values.size == count * values.shape[-1] and values.size != count:
        return values.reshape(-1, values.shape[-1]).T
    if values.size == count * values.shape[0] and values.size != count:
        return values.reshape(values.shape[0], -1)
    return values.reshape(1, -1)


def _sensors(sensors: list[tuple[str, int]], values: Any, map: Map, count: int) -> _Numbers:
    """Sensors are patches of these names, or channels of all taxels, or parts of the taxels, one after the other."""
    np = need("numpy", "ros")
    names, lengths, patches = [name for name, _ in sensors], [length for _, length in sensors], map.patches
    if all(name in patches for name in names) and lengths == [patches[name].n_taxels for name in names]:
        # In the order of the map: patches may share ids.
        columns = np.full(count, np.nan)
        for name, part in zip(names, np.split(values, np.cumsum(lengths)[:-1])):
            columns[patches[name].start : patches[name].start + patches[name].n_taxels] = part
        return _Numbers(columns[None], ["tactile"])
    if set(lengths) == {count}:
        return _Numbers(values.reshape(len(sensors), count), names)
    if sum(lengths) == count:
        return _Numbers(values[None], ["tactile"])
    raise DataError(f"topic: found sensors of {lengths} numbers; needed: {count} in each or {count} in all")


def _messages(path: Any, topic: str, definitions: Mapping[str, str] | None) -> Iterator[tuple[int, Any]]:
    """The messages of a topic and when they were recorded, in ns."""
    if not Path(path).exists():
        raise MissingFileError(f"{path}: found nothing; needed: a bag", "missing")
    bag = open_bag(path, definitions)
    try:
        counts = bag.topics()
        if not counts.get(topic):
            found = "no message of " if topic in counts else ""
            raise DataError(f"topic: found {found}{topic!r}; needed: one of {sorted(name for name, count in counts.items() if count)}")
        yield from bag.messages(topic)
    finally:
        bag.close()


def _times(header: Any, recorded: Any, stamp: str | None, kind: str) -> tuple[Any, tuple[str, ...]]:
    """The time of each frame, and what is to be said about it; `recorded` is in ns."""
    np = need("numpy", "ros")
    has_header = bool(np.isfinite(header).all())
    if stamp == "header" and not has_header:
        raise DataError(f"stamp: found 'header'; needed: 'bag', as {kind} has no header")
    if stamp == "bag" or not has_header:
        return recorded * 1e-9, ()
    if stamp is None and not header.any():
        if np.array_equal(recorded, 1 + np.arange(len(recorded))):
            return np.full(len(recorded), np.nan), ("the messages have numbers, as `write` gives frames without times",)
        return recorded * 1e-9, ("the stamps of all messages are 0; times are those of the recording",)
    return header, ()


def _joined(frames: list[Any]) -> tuple[Any, Any]:
    """The values of all frames (T, C, n), and their ids."""
    np = need("numpy", "ros")
    first = frames[0]
    same = all((frame.ids is None) == (first.ids is None) and frame.values.shape == first.values.shape for frame in frames)
    if same and (first.ids is None or all(np.array_equal(frame.ids, first.ids) for frame in frames)):
        return np.stack([frame.values for frame in frames]), first.ids
    bare = [k for k, frame in enumerate(frames) if frame.ids is None]
    if bare:
        odd = next((frame.values.shape for frame in frames if frame.values.shape != first.values.shape), None)
        if odd is None:
            raise DataError(f"topic: found no ids in message {bare[0]}; needed: ids in all messages, or in none")
        raise DataError(f"topic: found {odd} numbers in a message; needed: {first.values.shape} as before, or ids")
    columns = np.unique(np.concatenate([frame.ids for frame in frames]))
    array = np.full((len(frames), len(first.names), len(columns)), np.nan)
    for k, frame in enumerate(frames):
        if len(np.unique(frame.ids)) != len(frame.ids):
            raise DataError(f"ids: found one twice in message {k}; needed: each once")
        array[k][:, np.searchsorted(columns, frame.ids)] = frame.values
    return array, columns


def _refuse_fields(map: Map, ids: Any, count: int) -> None:
    """Refuses the points of a coarser level, which `write` makes: their values are no readings of taxels."""
    np = need("numpy", "ros")
    if ids is None or count >= map.n_taxels:
        return
    for name, patch in map.patches.items():
        if np.array_equal(ids, patch.ids):
            return
        for of in patch.levels[1:]:
            if np.array_equal(ids, of.taxel_ids):
                raise DataError(f"topic: found the fields of level {of.number} of {name!r}; needed: taxels, as write(level=0) makes")


def write(
    path: Any, map: Map, readings: Readings, *, level: int = 0, patch: str | None = None, channel: int | None = None, topic: str = "/skin"
) -> None:
    """Write images (`TOPIC/image`, 32FC1) and points with values (`TOPIC/points`) of a recording to a bag of ROS 2.

    Frames without times get the stamp 0 and their number as time, and `read` gives them no times again. Points have the values of
    `Map.pool`: of a channel that is an amount, as a force in N, they have the same total on
    every level. Images are those of `Map.renderer`: of such a channel they are per m^2 of the map.

    Parameters
    ----------
    path : str or os.PathLike
        The folder of the bag, which does not exist yet.
    level : int
        The level; a patch without it has its coarsest level.
    patch : str, optional
        The patch; by default all of them, in topics `TOPIC/PATCH/image` and `TOPIC/PATCH/points` if there are several.
    channel : int, optional
        The channel; by default the first that measures touches.

    Raises
    ------
    FileError
        If it cannot be written.
    ImportError
        If rosbags is not installed.
    DataError
        If the bag exists, or there is no such level, patch or channel.
    """
    np = need("numpy", "ros")
    rosbag2, typesys = need("rosbags.rosbag2", "ros"), need("rosbags.typesys", "ros")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    check_kind("map", map, Map, A_MAP)
    check_kind("readings", readings, Readings, READINGS)
    path, topic = path_of("path", path), word_of("topic", topic, "the name of a topic")
    readings = readings.on(map)
    channel = channel_of(readings, channel)
    values = readings.values[:, channel]
    how: Any = {"extensive": readings.extensive[channel], "modality": readings.modalities(map)[channel]}
    names = list(map.patches) if patch is None else [patch_of(map, patch).name]
    pooled = map.pool(values, level, **how)
    fields = {name: part for name, _, part in fields_of(map, level)}
    stamps = _stamps(readings.timestamps)
    if Path(path).exists():
        raise FileError(f"{path}: found a file or folder; needed: the name of a new folder", "exists")
    with written(path) as part, rosbag2.Writer(part, version=9) as writer:
        for name, prefix in zip(names, _prefixes(topic, names)):
            of = level_of(map, name, level)
            renderer = map.renderer(of.number, patch=name, **how)
            frame = map.patches[name].link
            _write_images(writer, store, f"{prefix}/image", frame, stamps, renderer(values)[:, 0])
            _write_points(writer, store, f"{prefix}/points", frame, stamps, of, np.ascontiguousarray(pooled[:, fields[name]]))


def _prefixes(topic: str, names: list[str]) -> list[str]:
    """The topic of each patch: letters, digits and underscores, each once."""
    if len(names) == 1:
        return [topic]
    made: list[str] = []
    for name in names:
        word = re.sub(r"\W", "_", name, flags=re.ASCII)
        word = f"_{word}" if word[:1].isdigit() else word
        number = 1
        while f"{topic}/{word}{f'_{number}' if number > 1 else ''}" in made:
            number += 1
        made.append(f"{topic}/{word}{f'_{number}' if number > 1 else ''}")
    return made


def _stamps(times: Any) -> list[tuple[int, int]]:
    """The stamp and the time of the message of each frame in ns; without times 0 and its number from 1 on."""
    np = need("numpy", "ros")
    if not np.isfinite(times).any():
        return [(0, 1 + frame) for frame in range(len(times))]
    wrong = ~((times >= 0) & (times < 2**31))
    if wrong.any():
        frame = int(np.argmax(wrong))
        raise DataError(f"timestamps: found {times[frame]} for frame {frame}; needed: s from 0 to 2^31")
    falls = np.diff(times) < 0
    if falls.any():
        frame = int(np.argmax(falls)) + 1
        needed = "times that do not fall; a bag for each episode"
        raise DataError(f"timestamps: found {times[frame]} for frame {frame} after {times[frame - 1]}; needed: {needed}")
    return [(round(time * 1e9),) * 2 for time in times]


def _header(store: Any, stamp: int, frame: str) -> Any:
    header, time = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    return header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id=frame)


def _write_images(writer: Any, store: Any, topic: str, frame: str, stamps: list[tuple[int, int]], images: Any) -> None:
    np, image = need("numpy", "ros"), store.types["sensor_msgs/msg/Image"]
    to, (_, height, width) = writer.add_connection(topic, image.__msgtype__, typestore=store), images.shape
    for (stamp, time), drawn in zip(stamps, images):
        pixels = np.frombuffer(drawn.astype("<f4").tobytes(), np.uint8)
        message = image(
            header=_header(store, stamp, frame),
            height=height,
            width=width,
            encoding="32FC1",
            is_bigendian=0,
            step=4 * width,
            data=pixels,
        )
        writer.write(to, time, store.serialize_cdr(message, image.__msgtype__))


def _write_points(writer: Any, store: Any, topic: str, frame: str, stamps: list[tuple[int, int]], of: Any, values: Any) -> None:
    np, (cloud, field) = need("numpy", "ros"), (store.types[f"sensor_msgs/msg/{name}"] for name in ("PointCloud2", "PointField"))
    fields = [field(name=name, offset=4 * k, datatype=7, count=1) for k, name in enumerate(["x", "y", "z", "nx", "ny", "nz", "value"])]
    fields.append(field(name="id", offset=28, datatype=6, count=1))
    points = np.zeros(len(of.areas), dtype=[("xyz", "<f4", 3), ("n", "<f4", 3), ("value", "<f4"), ("id", "<u4")])
    points["xyz"], points["n"], points["id"] = of.positions, of.normals, of.taxel_ids
    to = writer.add_connection(topic, cloud.__msgtype__, typestore=store)
    for (stamp, time), row in zip(stamps, values):
        points["value"] = row
        message = cloud(
            header=_header(store, stamp, frame),
            height=1,
            width=len(points),
            fields=fields,
            is_bigendian=False,
            point_step=32,
            row_step=32 * len(points),
            data=np.frombuffer(points.tobytes(), np.uint8),
            is_dense=bool(np.isfinite(row).all()),
        )
        writer.write(to, time, store.serialize_cdr(message, cloud.__msgtype__))

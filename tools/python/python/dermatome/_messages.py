"""The numbers in messages of ROS: their types decide what they are, and bytes are never taken for readings."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from dermatome._adapter import need
from dermatome._dermatome import Map, as_floats
from dermatome._errors import DataError
from dermatome._kinds import is_list

# Messages that bags up to ROS 2 Humble hold no definitions of, and rosbags does not know.
DEFINITIONS = {
    "tactile_msgs/msg/TactileState": "std_msgs/Header header\nsensor_msgs/ChannelFloat32[] sensors",
    "tuw_airskin_msgs/msg/AirskinPressures": "std_msgs/Header header\nuint8[] ids\nstring[] frame_ids\nuint32[] pressures",
}

# What a message of `ros.read(values=)` is turned to numbers by.
Wanted = str | Sequence[str] | Callable[[Any], Any] | None
# Labels of the axis of a MultiArray that is not of taxels.
CHANNELS = re.compile("channel|component|^ax[ei]s|^xyz|^force|^c$")
# Fields of a point that are no readings.
NOT_READ = re.compile("^(x|y|z|n[xyz]|normal_[xyz]|rgba?|id|taxel_id|index|label|ring|t|time|timestamp)$")
OPENCV = re.compile(r"(8U|8S|16U|16S|32S|32F|64F)C?(\d*)")
TYPES = {"8U": "u1", "8S": "i1", "16U": "u2", "16S": "i2", "32S": "i4", "32F": "f4", "64F": "f8"}
NAMED = {"mono": 1, "rgb": 3, "bgr": 3, "rgba": 4, "bgra": 4}
POINTS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


@dataclass
class Numbers:
    """The numbers of a message: (C, n), names of the channels, and ids of the n where the message has some."""

    values: Any
    names: list[str]
    ids: Any = None


def numbers_of(message: Any, map: Map, count: int, wanted: Wanted) -> Numbers:
    """The numbers of a message that has readings of `count` taxels."""
    np = need("numpy", "ros")
    if callable(wanted):
        rows = as_floats("values", wanted(message))
        if rows.ndim not in (1, 2):
            raise DataError(f"values: found shape {rows.shape}; needed: shape (n,) or (C, n)")
        return Numbers(np.atleast_2d(rows), [f"channel{k}" for k in range(len(np.atleast_2d(rows)))])
    names = None if wanted is None else [wanted] if isinstance(wanted, str) else list(wanted)
    if hasattr(message, "point_step"):
        return points_of(message, names)
    if names is not None:
        parts = [_named(message, name, map, count) for name in names]
        return Numbers(np.concatenate([part.values for part in parts]), [n for part in parts for n in part.names], parts[0].ids)
    if hasattr(message, "sensors"):  # tactile_msgs/TactileState
        return _sensors([(sensor.name, sensor.values) for sensor in message.sensors], map, count)
    if hasattr(message, "channels") and hasattr(message, "points"):  # sensor_msgs/PointCloud
        return _sensors([(channel.name, channel.values) for channel in message.channels], map, count)
    if hasattr(message, "encoding") and hasattr(message, "step"):
        return _image(message, count)
    if hasattr(message, "layout"):
        return _array(message, count)
    raise DataError(f"topic: found {kind_of(message)}; needed: values, one of its fields {arrays_in(message)}, or a function of it")


def kind_of(message: Any) -> str:
    """The type of a message."""
    return str(getattr(message, "__msgtype__", type(message).__name__))


def arrays_in(message: Any, depth: int = 3) -> list[str]:
    """The names of the fields of a message that are arrays of numbers."""
    np = need("numpy", "ros")
    found: list[str] = []
    fields: Any = message.__dict__
    for name, value in fields.items():
        if name.startswith("_"):
            continue
        inner = value[0] if is_list(value) and value else value
        if hasattr(inner, "__msgtype__") and depth:
            found += [f"{name}.{each}" for each in arrays_in(inner, depth - 1)]
        elif is_list(value) or isinstance(value, np.ndarray) or (isinstance(value, float) and depth < 3):
            found.append(name)
    return found


def field_of(message: Any, name: str) -> Any:
    """A field by its name, as `pressure`, or `taxels.force` of a list of messages."""
    found: Any = message
    for step in name.split("."):
        try:
            found = [getattr(each, step) for each in found] if is_list(found) else getattr(found, step)
        except AttributeError:
            known = arrays_in(message)
            raise DataError(f"values: found {name!r}; needed: one of the fields {known} of {kind_of(message)}") from None
    return found


def _named(message: Any, name: str, map: Map, count: int) -> Numbers:
    np = need("numpy", "ros")
    sensors = {sensor.name: sensor.values for sensor in getattr(message, "sensors", ())}
    found = sensors[name] if name in sensors else field_of(message, name)
    if hasattr(found, "__msgtype__"):
        return numbers_of(found, map, count, None)
    row = as_floats(name, found)
    if row.ndim == 0 or (row.ndim > 1 and row.size != count):
        raise DataError(f"values: found shape {row.shape} in {name!r}; needed: {count} numbers")
    return Numbers(np.reshape(row, (1, -1)), [name])


def _sensors(sensors: list[tuple[str, Any]], map: Map, count: int) -> Numbers:
    """Sensors are patches of these names, or channels of all taxels, or parts of the taxels, one after the other."""
    np = need("numpy", "ros")
    rows = [np.asarray(values, dtype=np.float64) for _, values in sensors]
    names, lengths = [name for name, _ in sensors], [len(row) for row in rows]
    patches = map.patches
    if rows and len(set(names)) == len(names) and all(name in patches for name in names):
        if lengths == [patches[name].n_taxels for name in names]:
            ids = np.concatenate([patches[name].ids for name in names])
            return Numbers(np.concatenate(rows)[None], ["tactile"], ids)
    if rows and set(lengths) == {count}:
        return Numbers(np.stack(rows), names)
    if rows and sum(lengths) == count:
        return Numbers(np.concatenate(rows)[None], ["tactile"])
    raise DataError(f"topic: found sensors of {lengths} numbers; needed: {count} in each or {count} in all")


def _image(message: Any, count: int) -> Numbers:
    """A reading for each pixel, row by row from the top."""
    pixels, names = pixels_of(message)
    height, width, depth = pixels.shape
    if height * width != count:
        needed = f"{count} pixels, one for each taxel, or values, a function of an image; a cloud of points can have ids"
        raise DataError(f"image: found {height} x {width} pixels; needed: {needed}")
    return Numbers(pixels.reshape(count, depth).T.astype("f8"), names)


def pixels_of(message: Any) -> tuple[Any, list[str]]:
    """The pixels of an image, (H, W, C), and names of the channels."""
    np = need("numpy", "ros")
    encoding, known = message.encoding, OPENCV.fullmatch(message.encoding)
    named = re.fullmatch(r"(mono|rgba?|bgra?)(8|16)", encoding)
    if known:
        dtype, depth = TYPES[known[1]], int(known[2] or 1)
    elif named:
        dtype, depth = f"u{int(named[2]) // 8}", NAMED[named[1]]
    else:
        raise DataError(f"encoding: found {encoding!r}; needed: mono8, mono16, rgb8, 16UC1, 32FC1 or the like, or values")
    kind = np.dtype(dtype).newbyteorder(">" if message.is_bigendian else "<")
    height, width, data = message.height, message.width, np.ascontiguousarray(message.data, dtype=np.uint8)
    row = width * depth * kind.itemsize
    if message.step < row or len(data) < message.step * height:
        raise DataError(f"image: found {len(data)} bytes in rows of {message.step}; needed: {height} rows of {row} or more")
    pixels = np.ascontiguousarray(data[: message.step * height].reshape(height, -1)[:, :row]).view(kind)
    letters = named[1] if named and depth > 1 else ""
    names = list(letters) or (["image"] if depth == 1 else [f"image{k}" for k in range(depth)])
    return pixels.reshape(height, width, depth), names


def points_of(message: Any, names: list[str] | None) -> Numbers:
    """A reading for each point: its field `value`, or all that are no position, normal, colour, time or id."""
    np = need("numpy", "ros")
    points = table_of(message)
    kinds = points.dtype.names
    known = [name for name in kinds if not NOT_READ.match(name)]
    names = names or (["value"] if "value" in kinds else known)
    missing = [name for name in names if name not in kinds]
    if missing or not names:
        found = f"{missing[0]!r}" if missing else "none that can be a reading"
        raise DataError(f"values: found {found}; needed: one of the fields {list(kinds)} of the points")
    values = np.concatenate([points[name].astype(np.float64).T for name in names])
    counts = {name: points[name].shape[1] for name in names}
    titles = [name if counts[name] == 1 else f"{name}{k}" for name in names for k in range(counts[name])]
    ids = next((points[name][:, 0].astype(np.int64) for name in ("id", "taxel_id") if name in kinds), None)
    return Numbers(values, titles, ids)


def table_of(message: Any) -> Any:
    """The points of a cloud, each with its fields, (n, count) each."""
    np = need("numpy", "ros")
    kinds: dict[str, tuple[str, int, int]] = {}
    for field in message.fields:
        if field.datatype not in POINTS:
            raise DataError(f"field {field.name!r}: found the type {field.datatype}; needed: 1 to 8")
        kinds[field.name] = (POINTS[field.datatype], max(field.count, 1), field.offset)
    order, width, data = ">" if message.is_bigendian else "<", message.width, np.asarray(message.data, np.uint8)
    formats = [(f"{order}{kind}", (count,)) for kind, count, _ in kinds.values()]
    offsets = [offset for _, _, offset in kinds.values()]
    try:
        point = np.dtype({"names": list(kinds), "formats": formats, "offsets": offsets, "itemsize": message.point_step})
    except (ValueError, TypeError) as error:
        raise DataError(f"points: found {message.point_step} bytes; needed: room for the fields {list(kinds)}: {error}") from None
    row, step = width * message.point_step, message.row_step or width * message.point_step
    if step < row or len(data) < step * message.height:
        raise DataError(f"points: found {len(data)} bytes in rows of {step}; needed: {message.height} rows of {row} or more")
    rows = np.ascontiguousarray(data[: step * message.height].reshape(message.height, step)[:, :row])
    return rows.reshape(-1).view(point)


def _array(message: Any, count: int) -> Numbers:
    """The numbers of a MultiArray by its layout: the axis of channels is the one named so, else one beside the taxels."""
    np = need("numpy", "ros")
    layout, data = message.layout, np.asarray(message.data, dtype=np.float64)
    sizes, offset = [int(each.size) for each in layout.dim], int(layout.data_offset)
    labels = [str(each.label).strip().lower() for each in layout.dim]
    flat = data[offset:]
    shape = sizes or [len(flat)]
    if len(flat) == np.prod(shape):
        block = flat.reshape(shape)
    else:
        steps = [int(each.stride) for each in layout.dim[1:]] + [1]
        reach = sum((size - 1) * step for size, step in zip(shape, steps))
        if min(shape) < 1 or min(steps) < 1 or reach >= len(flat):
            raise DataError(f"layout: found {len(data)} numbers from {offset} on; needed: those of {' x '.join(map(str, shape))}")
        at = sum(np.arange(size).reshape([-1 if k == axis else 1 for k in range(len(shape))]) * steps[axis] for axis, size in enumerate(shape))
        block = flat[at]
    named = [axis for axis, label in enumerate(labels) if CHANNELS.search(label)]
    if len(named) == 1 and len(shape) > 1:
        block = np.moveaxis(block, named[0], 0).reshape(shape[named[0]], -1)
    elif block.size == count:
        block = block.reshape(1, -1)
    elif block.size == count * shape[-1]:
        block = block.reshape(-1, shape[-1]).T
    elif block.size == count * shape[0]:
        block = block.reshape(shape[0], -1)
    if block.ndim != 2 or block.shape[1] != count:
        found = " x ".join(f"{size} {label}".strip() for size, label in zip(shape, labels or [""]))
        raise DataError(f"layout: found {found} numbers; needed: {count} taxels, or ids of as many as there are")
    return Numbers(block, ["data"] if len(block) == 1 else [f"data{k}" for k in range(len(block))])

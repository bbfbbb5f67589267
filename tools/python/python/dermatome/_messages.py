"""The numbers in messages of ROS, with the shape, axes, names, ids and units that their types give them. Types decide what bytes
are, and bytes are never taken for readings."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

from dermatome._adapter import need
from dermatome._errors import DataError
from dermatome._kinds import is_list

# Messages that bags up to ROS 2 Humble hold no definitions of, and rosbags does not know.
DEFINITIONS = {
    "tactile_msgs/msg/TactileState": "std_msgs/Header header\nsensor_msgs/ChannelFloat32[] sensors",
    "tuw_airskin_msgs/msg/AirskinPressures": "std_msgs/Header header\nuint8[] ids\nstring[] frame_ids\nuint32[] pressures",
}

# Fields of a point that are no readings.
NOT_READ = re.compile("^(x|y|z|n[xyz]|normal_[xyz]|rgba?|id|taxel_id|index|label|ring|t|time|timestamp)$")
OPENCV = re.compile(r"(8U|8S|16U|16S|32S|32F|64F)C?(\d*)")
TYPES = {"8U": "u1", "8S": "i1", "16U": "u2", "16S": "i2", "32S": "i4", "32F": "f4", "64F": "f8"}
NAMED = {"mono": 1, "rgb": 3, "bgr": 3, "rgba": 4, "bgra": 4}
POINTS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
# Units of messages whose definition gives them.
WRENCH = ("force", "torque")


@dataclass
class Frame:
    """The numbers of a message, in its shape."""

    values: Any
    # What one of its values is.
    word: str = "numbers"
    # Of a MultiArray: what its axes are called, empty where it does not say it.
    labels: list[str] | None = None
    # Names of components.
    names: list[str] | None = None
    ids: Any = None
    unit: str | None = None
    # A unit a component, where they differ.
    units: list[str] | None = None
    # Positions of points.
    points: Any = None
    # The sensors that are in `values` one after the other, and how many numbers each has.
    sensors: list[tuple[str, int]] | None = None
    said: dict[str, str] = field(default_factory=lambda: {})

    @property
    def axes(self) -> list[str] | None:
        """The labels, where they tell several axes apart."""
        labels = self.labels or []
        return labels if all(labels) and len(set(labels)) == len(labels) > 1 else None


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


# ---- The numbers of a message, as its type has them


def frame_of(message: Any, wanted: str) -> Frame:
    """The numbers of a message, or of one of its fields, sensors or fields of points."""
    if hasattr(message, "point_step"):
        return _cloud(message, wanted)
    sensors = sensors_of(message)
    if sensors and (not wanted or wanted in [sensor.name for sensor in sensors] or not hasattr(message, wanted.partition(".")[0])):
        return _sensors(sensors, wanted)
    if hasattr(message, "wrench"):
        return _wrench(message.wrench, wanted.removeprefix("wrench").removeprefix("."))
    if hasattr(message, "force") and hasattr(message, "torque"):
        return _wrench(message, wanted)
    if wanted:
        step, _, rest = wanted.partition(".")
        inner = getattr(message, step, None)
        return frame_of(inner, rest) if hasattr(inner, "__msgtype__") else _field(message, field_of(message, wanted), wanted)
    if is_image(message):
        return _image(message)
    if is_array(message):
        return _array(message)
    fields = fields_of_message(message)
    if len(fields) == 1:
        name = next(iter(fields))
        return _field(message, field_of(message, name), name)
    raise DataError(f"found {kind_of(message)}; needed: one of its fields {list(fields)} behind the topic and a point")


def is_image(message: Any) -> bool:
    """Whether a message is a sensor_msgs/Image."""
    return hasattr(message, "encoding") and hasattr(message, "step")


def is_array(message: Any) -> bool:
    """Whether a message is one of the MultiArrays of std_msgs."""
    return hasattr(message, "layout") and hasattr(message, "data")


def sensors_of(message: Any) -> list[Any]:
    """The sensors of a TactileState, or the channels of a PointCloud, each with a name and values; else none."""
    sensors = getattr(message, "sensors", None) or (getattr(message, "channels", None) if hasattr(message, "points") else None)
    if is_list(sensors) and sensors and hasattr(sensors[0], "values") and hasattr(sensors[0], "name"):
        return sensors
    return []


def fields_of_message(message: Any) -> dict[str, tuple[int, ...]]:
    """The streams of a message and their shapes; the name is empty where it is the message itself."""
    if hasattr(message, "point_step"):
        known = readings_in(table_of(message))
        return {(name if len(known) > 1 else ""): _cloud(message, name).values.shape for name in known}
    if sensors := sensors_of(message):
        names: list[str] = [sensor.name for sensor in sensors]
        return {(name if len(names) > 1 else ""): (len(sensor.values),) for name, sensor in zip(names, sensors)}
    if hasattr(message, "wrench") or is_image(message) or is_array(message):
        return {"": frame_of(message, "").values.shape}
    made: dict[str, tuple[int, ...]] = {}
    for name in arrays_in(message):
        try:
            made[name] = _field(message, field_of(message, name), name).values.shape
        except DataError:
            continue  # Text, or lists of several lengths.
    ids = [name for name in made if name.rpartition(".")[2] in ("ids", "id")]
    return {name: shape for name, shape in made.items() if name not in ids} if len(made) > len(ids) else made


def _field(message: Any, found: Any, name: str) -> Frame:
    np = need("numpy", "ros")
    try:
        values = np.asarray(found)
    except ValueError:
        values = np.asarray(None)
    if values.dtype.kind not in "biuf" or values.ndim == 0:
        raise DataError(f"values: found {name!r} of {kind_of(message)}, which is no array of numbers; needed: one of its fields {arrays_in(message)}")
    made, ids = Frame(values), getattr(message, "ids", None)
    if ids is not None and np.shape(ids) == values.shape[:1]:
        made.ids = np.asarray(ids).astype(np.int64)
    unit = getattr(message, "unit", None)
    if isinstance(unit, str) and unit:
        made.unit = unit
    return made


def readings_in(points: Any) -> list[str]:
    """The fields of points that may be readings."""
    return [name for name in points.dtype.names or () if not NOT_READ.match(name)]


def _cloud(message: Any, wanted: str) -> Frame:
    """A reading, or a row of them, for each point."""
    np, points = need("numpy", "ros"), table_of(message)
    names: list[str] = list(points.dtype.names or ())
    known = readings_in(points)
    if wanted and wanted not in names:
        raise DataError(f"values: found {wanted!r}; needed: one of the fields {names} of the points")
    wanted = wanted or (known[0] if len(known) == 1 else "value" if "value" in known else "")
    if not wanted:
        raise DataError(f"found the fields {known} of the points; needed: one of them behind the topic and a point")
    values = points[wanted]
    is_one = values.shape[1] == 1
    made = Frame(values[:, 0] if is_one else values, "points", names=None if is_one else [f"{wanted}{k}" for k in range(values.shape[1])])
    made.ids = next((points[name][:, 0].astype(np.int64) for name in ("id", "taxel_id") if name in names), None)
    if {"x", "y", "z"} <= set(names):
        made.points = np.concatenate([points[name] for name in "xyz"], axis=1)
    return made


def table_of(message: Any) -> Any:
    """The points of a cloud, each with its fields, (n, count) each."""
    np = need("numpy", "ros")
    kinds: dict[str, tuple[str, int, int]] = {}
    for each in message.fields:
        if each.datatype not in POINTS:
            raise DataError(f"field {each.name!r}: found the type {each.datatype}; needed: 1 to 8")
        kinds[each.name] = (POINTS[each.datatype], max(each.count, 1), each.offset)
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


def _sensors(sensors: list[Any], wanted: str) -> Frame:
    """One of the sensors, or all of them, one after the other."""
    np = need("numpy", "ros")
    names = [sensor.name for sensor in sensors]
    if len(set(names)) != len(names):
        raise DataError(f"found the sensors {names}; needed: names that differ")
    if wanted:
        if wanted not in names:
            raise DataError(f"values: found no sensor {wanted!r}; needed: one of {names}")
        return Frame(np.asarray(sensors[names.index(wanted)].values))
    made = Frame(np.concatenate([np.asarray(sensor.values) for sensor in sensors]))
    made.sensors = [(sensor.name, len(sensor.values)) for sensor in sensors]
    if len(names) > 1:
        made.said["sensors"] = f"one after the other: {', '.join(f'{name}: {count}' for name, count in made.sensors)} taxels"
    return made


def _wrench(wrench: Any, wanted: str) -> Frame:
    np = need("numpy", "ros")
    if wanted not in ("", *WRENCH):
        raise DataError(f"values: found no {wanted!r} of a wrench; needed: force or torque")
    kinds = [wanted] if wanted else list(WRENCH)
    values = np.array([[getattr(getattr(wrench, kind), axis) for kind in kinds for axis in "xyz"]], np.float64)
    units = ["N" if kind == "force" else "N m" for kind in kinds for _ in range(3)]
    return Frame(values, names=[f"{kind}.{axis}" for kind in kinds for axis in "xyz"], units=units)


def _image(message: Any) -> Frame:
    """The pixels of an image: (H, W), or (H, W, C) with names of the channels."""
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
    pixels = pixels.reshape(height, width, depth)
    letters = named[1] if named and depth > 1 else ""
    names = list(letters) or (["image"] if depth == 1 else [f"image{k}" for k in range(depth)])
    return Frame(pixels[:, :, 0] if depth == 1 else pixels, "pixels", names=names)


def _array(message: Any) -> Frame:
    """The numbers of a MultiArray by its sizes; by its strides where rows are padded, which the first of them says. Some writers
    count bytes in strides, and others nothing."""
    np = need("numpy", "ros")
    data, offset, dims = np.asarray(message.data), int(message.layout.data_offset), message.layout.dim
    flat, labels = data[max(offset, 0) :], [str(each.label).strip() for each in dims]
    shape = [int(each.size) for each in dims] or [len(flat)]
    steps = [int(each.stride) for each in dims[1:]] + [1]
    total, reach = 1, 1 + sum((size - 1) * step for size, step in zip(shape, steps))
    for size in shape:
        total *= size
    if data.dtype.kind in "biuf" and offset >= 0 and min(shape) >= 0 and total == len(flat):
        return Frame(flat.reshape(shape), labels=labels)
    is_padded = dims and int(dims[0].stride) == len(flat) > total and min(*shape, *steps) > 0 and reach <= len(flat)
    if data.dtype.kind not in "biuf" or offset < 0 or not is_padded:
        raise DataError(f"layout: found {len(data)} numbers from {offset} on; needed: {' x '.join(map(str, shape))} of them")
    axes = range(len(shape))
    at = sum(np.arange(shape[axis]).reshape([-1 if axis == k else 1 for k in axes]) * steps[axis] for axis in axes)
    return Frame(flat[at], labels=labels)

"""The numbers of one message, with the shape, axes, names, ids and units that its type gives them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from dermatome._adapter import need
from dermatome._errors import DataError
from dermatome._kinds import is_list
from dermatome._messages import NOT_READ, arrays_in, field_of, kind_of, pixels_of, table_of

# Units of messages whose definition gives them.
WRENCH = ("force", "torque")


@dataclass
class Frame:
    """The numbers of a message."""

    values: Any
    axes: list[str] | None = None
    # Names of components.
    names: list[str] | None = None
    ids: Any = None
    ids_are_of_taxels: bool = True
    unit: str | None = None
    # A unit a component, where they differ.
    units: list[str] | None = None
    # Positions of points.
    points: Any = None
    said: dict[str, str] = field(default_factory=lambda: {})


def frame_of(message: Any, wanted: str) -> Frame:
    """The numbers of a message, or of one of its fields, sensors or fields of points."""
    if hasattr(message, "point_step"):
        return _cloud(message, wanted)
    if sensors := sensors_of(message):
        return _sensors(sensors, wanted)
    if hasattr(message, "wrench"):
        return _wrench(message.wrench, wanted.removeprefix("wrench").removeprefix("."))
    if hasattr(message, "force") and hasattr(message, "torque"):
        return _wrench(message, wanted)
    if wanted:
        inner = field_of(message, wanted)
        return frame_of(inner, "") if hasattr(inner, "__msgtype__") else _field(message, inner, wanted)
    if hasattr(message, "encoding") and hasattr(message, "step"):
        return _image(message)
    if hasattr(message, "layout") and hasattr(message, "data"):
        return _array(message)
    fields = fields_of_message(message)
    if len(fields) == 1:
        name = next(iter(fields))
        return _field(message, field_of(message, name), name)
    raise DataError(f"found {kind_of(message)}; needed: one of its fields {list(fields)} behind the topic and a point")


def sensors_of(message: Any) -> list[Any]:
    """The sensors of a TactileState, or the channels of a PointCloud, each with a name and values; else none."""
    sensors = getattr(message, "sensors", None) or (getattr(message, "channels", None) if hasattr(message, "points") else None)
    if is_list(sensors) and sensors and hasattr(sensors[0], "values") and hasattr(sensors[0], "name"):
        return sensors
    return []


def fields_of_message(message: Any) -> dict[str, tuple[int, ...]]:
    """The streams of a message and their shapes; the name is empty where it is the message itself."""
    if hasattr(message, "point_step"):
        known = [name for name in table_of(message).dtype.names or () if not NOT_READ.match(name)]
        return {(name if len(known) > 1 else ""): _cloud(message, name).values.shape for name in known}
    if sensors := sensors_of(message):
        names: list[str] = [sensor.name for sensor in sensors]
        return {(name if len(names) > 1 else ""): (len(sensor.values),) for name, sensor in zip(names, sensors)}
    known_type = hasattr(message, "wrench") or (hasattr(message, "encoding") and hasattr(message, "step"))
    if known_type or (hasattr(message, "layout") and hasattr(message, "data")):
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
        raise DataError(f"found {name!r} of {kind_of(message)}, which is no array of numbers; needed: one of its fields {arrays_in(message)}")
    made, ids = Frame(values), getattr(message, "ids", None)
    if ids is not None and np.shape(ids) == values.shape[:1]:
        made.ids = np.asarray(ids).astype(np.int64)
    unit = getattr(message, "unit", None)
    if isinstance(unit, str) and unit:
        made.unit = unit
    return made


def _cloud(message: Any, wanted: str) -> Frame:
    np, points = need("numpy", "ros"), table_of(message)
    names: list[str] = list(points.dtype.names or ())
    known = [name for name in names if not NOT_READ.match(name)]
    if wanted and wanted not in names:
        raise DataError(f"found no field {wanted!r} of the points; needed: one of {names}")
    wanted = wanted or (known[0] if len(known) == 1 else "value" if "value" in known else "")
    if not wanted:
        raise DataError(f"found the fields {known} of the points; needed: one of them behind the topic and a point")
    values = points[wanted]
    made = Frame(values[:, 0] if values.shape[1] == 1 else values)
    made.ids = next((points[name][:, 0].astype(np.int64) for name in ("id", "taxel_id") if name in names), None)
    if {"x", "y", "z"} <= set(names):
        made.points = np.concatenate([points[name] for name in "xyz"], axis=1)
    return made


def _sensors(sensors: list[Any], wanted: str) -> Frame:
    np = need("numpy", "ros")
    names = [sensor.name for sensor in sensors]
    if len(set(names)) != len(names):
        raise DataError(f"found the sensors {names}; needed: names that differ")
    if wanted:
        if wanted not in names:
            raise DataError(f"found no sensor {wanted!r}; needed: one of {names}")
        return Frame(np.asarray(sensors[names.index(wanted)].values))
    made = Frame(np.concatenate([np.asarray(sensor.values) for sensor in sensors]))
    made.names = [f"{name}: {len(sensor.values)}" for name, sensor in zip(names, sensors)]
    if len(names) > 1:
        made.said["sensors"] = f"one after the other: {', '.join(made.names)} taxels"
    return made


def _wrench(wrench: Any, wanted: str) -> Frame:
    np = need("numpy", "ros")
    if wanted not in ("", *WRENCH):
        raise DataError(f"found no {wanted!r} of a wrench; needed: force or torque")
    kinds = [wanted] if wanted else list(WRENCH)
    values = np.array([[getattr(getattr(wrench, kind), axis) for kind in kinds for axis in "xyz"]], np.float64)
    units = ["N" if kind == "force" else "N m" for kind in kinds for _ in range(3)]
    return Frame(values, names=[f"{kind}.{axis}" for kind in kinds for axis in "xyz"], units=units)


def _image(message: Any) -> Frame:
    pixels, names = pixels_of(message)
    return Frame(pixels[:, :, 0] if len(names) == 1 else pixels, names=names)


def _array(message: Any) -> Frame:
    """The numbers of a MultiArray by sizes and labels: what strides mean is not certain."""
    np = need("numpy", "ros")
    data, offset = np.asarray(message.data), int(message.layout.data_offset)
    shape = tuple(int(each.size) for each in message.layout.dim) or (len(data) - offset,)
    labels = [str(each.label).strip() for each in message.layout.dim]
    total = 1
    for size in shape:
        total *= size
    if data.dtype.kind not in "biuf" or total != len(data) - offset or offset < 0:
        sizes = " x ".join(map(str, shape))
        raise DataError(f"found {len(data)} numbers, {offset} of them before the first; needed: {sizes} after those, as the layout of the message says")
    axes = labels if all(labels) and len(set(labels)) == len(labels) > 1 else None
    return Frame(data[offset:].reshape(shape), axes)

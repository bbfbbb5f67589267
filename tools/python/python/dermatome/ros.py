"""Readings in ROS bags, and images, points and contacts to them, without an installation of ROS.

`rosbags` reads bags of ROS 1 and 2, of SQLite and MCAP.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dermatome._adapter import need
from dermatome._dermatome import Map
from dermatome._errors import DataError
from dermatome._readings import Readings


def _values(message: Any) -> tuple[Any, list[str]]:
    """The numbers of a message, (C, n), and the names of its channels."""
    np = need("numpy", "ros")
    if hasattr(message, "sensors"):  # tactile_msgs/TactileState
        rows = [np.asarray(sensor.values, dtype=np.float64) for sensor in message.sensors]
        return np.stack(rows), [sensor.name for sensor in message.sensors]
    if hasattr(message, "data"):  # std_msgs/Float32MultiArray and its like
        return np.asarray(message.data, dtype=np.float64)[None], ["data"]
    raise DataError(f"topic: found {type(message).__name__}; needed: sensors with values, or data")


def read(path: Any, topic: str, map: Map, *, ids: Any = None) -> Readings:
    """Read the readings of a topic.

    Parameters
    ----------
    path : str or os.PathLike
        A bag: a folder, a `.mcap` or a `.bag`.
    topic : str
        A topic of `tactile_msgs/TactileState` (a channel for each sensor) or of an array of numbers.
    map : Map
        The map.
    ids : (n,) array_like of int, optional
        Ids of the numbers in a message; by default they are in the order of the map.
    """
    np, highlevel = need("numpy", "ros"), need("rosbags.highlevel", "ros")
    rows, times, names = [], [], []
    with highlevel.AnyReader([Path(path)]) as reader:
        connections = [known for known in reader.connections if known.topic == topic]
        if not connections:
            known = sorted({each.topic for each in reader.connections})
            raise DataError(f"topic: found {topic!r}; needed: one of {known}")
        for connection, stamp, raw in reader.messages(connections=connections):
            values, names = _values(reader.deserialize(raw, connection.msgtype))
            if rows and values.shape != rows[0].shape:
                raise DataError(f"topic: found {values.shape} numbers in a message; needed: {rows[0].shape} as before")
            rows.append(values)
            times.append(stamp * 1e-9)
    if not rows:
        raise DataError(f"topic: found no message of {topic!r}; needed: at least one")
    return Readings.from_arrays(np.stack(rows), ids=ids, timestamps=times, channels=tuple(names)).on(map)


def write(
    path: Any, map: Map, readings: Readings, *, level: int = 0, patch: str | None = None, channel: int = 0, topic: str = "/skin"
) -> None:
    """Write images (`TOPIC/image`, 32FC1) and points with values (`TOPIC/points`) of a recording to a bag of ROS 2.

    Parameters
    ----------
    path : str or os.PathLike
        The folder of the bag, which does not exist yet.
    level : int
        The level.
    patch : str, optional
        The patch; by default the only one.
    """
    from dermatome._adapter import level_of, patch_of

    np = need("numpy", "ros")
    rosbag2, typesys = need("rosbags.rosbag2", "ros"), need("rosbags.typesys", "ros")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kinds = store.types
    header, stamp = kinds["std_msgs/msg/Header"], kinds["builtin_interfaces/msg/Time"]
    image, cloud, field = (kinds[f"sensor_msgs/msg/{name}"] for name in ("Image", "PointCloud2", "PointField"))
    whole, of = patch_of(map, patch), level_of(map, patch, level)
    values = readings.on(map).values[:, channel]
    renderer = map.renderer(level, patch=whole.name)
    images = renderer(values)[:, 0]
    start = sum(len(p.levels[level].positions) for p in map.patches.values() if p.start < whole.start and level < len(p.levels))
    pooled = map.pool(values, level)[:, start : start + len(of.positions)]
    fields = [field(name=name, offset=4 * k, datatype=7, count=1) for k, name in enumerate(["x", "y", "z", "nx", "ny", "nz", "value"])]
    fields.append(field(name="id", offset=28, datatype=6, count=1))
    points = np.zeros(len(of.positions), dtype=[("xyz", "<f4", 3), ("n", "<f4", 3), ("value", "<f4"), ("id", "<u4")])
    points["xyz"], points["n"], points["id"] = of.positions, of.normals, of.taxel_ids
    with rosbag2.Writer(Path(path), version=9) as writer:
        to_image = writer.add_connection(f"{topic}/image", image.__msgtype__, typestore=store)
        to_cloud = writer.add_connection(f"{topic}/points", cloud.__msgtype__, typestore=store)
        for k, time in enumerate(readings.timestamps):
            nanoseconds = round(time * 1e9) if np.isfinite(time) else k
            at = header(stamp=stamp(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9), frame_id=whole.link)
            height, width = renderer.shape
            pixels = np.frombuffer(images[k].astype("<f4").tobytes(), np.uint8)
            drawn = image(header=at, height=height, width=width, encoding="32FC1", is_bigendian=0, step=4 * width, data=pixels)
            points["value"] = pooled[k]
            said = cloud(
                header=at,
                height=1,
                width=len(points),
                fields=fields,
                is_bigendian=False,
                point_step=32,
                row_step=32 * len(points),
                data=np.frombuffer(points.tobytes(), np.uint8),
                is_dense=bool(np.isfinite(pooled[k]).all()),
            )
            writer.write(to_image, nanoseconds, store.serialize_cdr(drawn, image.__msgtype__))
            writer.write(to_cloud, nanoseconds, store.serialize_cdr(said, cloud.__msgtype__))

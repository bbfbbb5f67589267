"""Bags of ROS against the real `rosbags`: messages are what their types say, and nothing gets lost on the way to a bag."""

import sqlite3

import numpy as np
import pytest
from conftest import lattice

import dermatome
import dermatome.ros as adapter

rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")

CUSTOM = {
    "tactile_msgs/msg/TactileState": "std_msgs/Header header\nsensor_msgs/ChannelFloat32[] sensors",
    "my_msgs/msg/Taxel": "uint32 number\nfloat32 force",
    "my_msgs/msg/Skin": "std_msgs/Header header\nuint16[] counts\nmy_msgs/Taxel[] taxels\nfloat32 temperature",
}


@pytest.fixture(scope="module")
def store():
    made = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    for kind, text in CUSTOM.items():
        made.register(typesys.get_types_from_msg(text, kind))
    return made


@pytest.fixture(scope="module")
def grid_map():
    return dermatome.build(dermatome.Skin.from_arrays(lattice(6, 5)[0]))


def header(store, time):
    stamp = store.types["builtin_interfaces/msg/Time"](sec=int(time), nanosec=round(time % 1 * 1e9))
    return store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="hand")


def bag(path, store, messages):
    """A bag with the topic /skin, recorded 0.5 s after each whole second."""
    kind = messages[0].__msgtype__
    with rosbag2.Writer(path, version=9) as writer:
        to = writer.add_connection("/skin", kind, typestore=store)
        for k, message in enumerate(messages):
            writer.write(to, k * 10**9 + 5 * 10**8, store.serialize_cdr(message, kind))
    return path


def image(store, encoding, pixels, big=False, pad=0):
    height = len(pixels)
    rows = pixels.astype(pixels.dtype.newbyteorder(">" if big else "<")).reshape(height, -1).view(np.uint8)
    data = np.pad(rows, ((0, 0), (0, pad)), constant_values=77)
    kind, step = store.types["sensor_msgs/msg/Image"], data.shape[1]
    return kind(header(store, 3), height, pixels.shape[1], encoding, int(big), step, np.ascontiguousarray(data).ravel())


@pytest.mark.parametrize(
    "encoding, dtype, depth",
    [("mono8", "u1", 1), ("mono16", "u2", 1), ("8SC1", "i1", 1), ("16UC1", "u2", 1), ("16SC1", "i2", 1), ("32SC1", "i4", 1),
     ("32FC1", "f4", 1), ("64FC1", "f8", 1), ("32FC3", "f4", 3), ("rgb8", "u1", 3), ("bgra16", "u2", 4)],
)  # fmt: skip
@pytest.mark.parametrize("big, pad", [(False, 0), (True, 5)])
def test_images_are_read_by_their_encoding(encoding, dtype, depth, big, pad, store, grid_map, tmp_path):
    pixels = (np.random.default_rng(1).random((5, 6, depth)) * 120 - (60 if "S" in encoding else 0)).astype(dtype)
    readings = adapter.read(bag(tmp_path / "a", store, [image(store, encoding, pixels, big, pad)]), "/skin", grid_map)
    assert np.array_equal(readings.values[0], pixels.reshape(30, depth).T) and readings.timestamps.tolist() == [3]
    if encoding == "rgb8":
        assert readings.channels == ("r", "g", "b")


def test_bytes_are_never_readings(store, grid_map, tmp_path):
    thirty = np.zeros((3, 5), np.uint16)  # 30 bytes, 15 readings.
    packed = store.types["sensor_msgs/msg/CompressedImage"](header(store, 1), "png", np.zeros(30, np.uint8))
    odd = image(store, "yuv422", np.zeros((5, 6), np.uint8))
    short = image(store, "mono8", np.zeros((5, 6), np.uint8))
    short.data = short.data[:-1]
    words = store.types["std_msgs/msg/String"]("thirty")
    wrong = [(image(store, "mono16", thirty), "3 x 5 pixels"), (packed, "needed: values"), (odd, "yuv422"), (short, "29 bytes"), (words, "values")]
    for k, (message, match) in enumerate(wrong):
        with pytest.raises(dermatome.DataError, match=match):
            adapter.read(bag(tmp_path / str(k), store, [message]), "/skin", grid_map)


def test_points_are_read_by_field(store, grid_map, tmp_path):
    cloud, field = store.types["sensor_msgs/msg/PointCloud2"], store.types["sensor_msgs/msg/PointField"]
    rng, order = np.random.default_rng(2), np.random.default_rng(3).permutation(30)
    kind = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("force", "f8"), ("heat", "i2"), ("gap", "u1"), ("id", "u4"), ("cell", "u2"), ("axes", "f4", 3)]
    numbers = {"i2": 3, "u1": 2, "u2": 4, "u4": 6, "f4": 7, "f8": 8}
    for big in (False, True):
        points = np.zeros(30, np.dtype([(name, (">" if big else "<") + t, *n) for name, t, *n in kind]))
        points["force"], points["heat"], points["id"] = rng.random(30), rng.integers(-99, 99, 30), grid_map.ids[order]
        points["cell"] = grid_map.ids[order][::-1]
        points["axes"] = rng.random((30, 3))
        fields = [field(name, points.dtype.fields[name][1], numbers[t], *(n or [1])) for name, t, *n in kind]
        step = points.dtype.itemsize
        rows = np.pad(points.view(np.uint8).reshape(5, 6 * step), ((0, 0), (0, 3)))
        message = cloud(header(store, 2), 5, 6, fields, big, step, 6 * step + 3, rows.ravel(), True)
        path = bag(tmp_path / str(big), store, [message])
        readings = adapter.read(path, "/skin", grid_map, values="force", units="N")
        assert np.array_equal(readings.values[0, 0, order], points["force"]) and readings.extensive == (True,)
        several = adapter.read(path, "/skin", grid_map, values=["heat", "axes"])
        assert several.channels == ("heat", "axes0", "axes1", "axes2")
        assert np.array_equal(several.values[0][:, order], [points["heat"], *points["axes"].T])
        assert adapter.read(path, "/skin", grid_map).channels == ("force", "heat", "gap", "cell", "axes0", "axes1", "axes2")
        turned = adapter.read(path, "/skin", grid_map, values="force", ids="cell")
        assert np.array_equal(turned.values[0, 0, order[::-1]], points["force"])
        with pytest.raises(dermatome.DataError, match="'pressure'.*force"):
            adapter.read(path, "/skin", grid_map, values="pressure")


def test_arrays_obey_their_layout(store, grid_map, tmp_path):
    array, layout, dim = (store.types[f"std_msgs/msg/{name}"] for name in ("Float32MultiArray", "MultiArrayLayout", "MultiArrayDimension"))
    numbers = np.random.default_rng(4).random((30, 3)).astype(np.float32)

    def message(sizes, data, offset=0, labels=("", "", ""), strides=None):
        strides = strides or [int(np.prod(sizes[k:])) for k in range(len(sizes))]
        dims = [dim(label, size, stride) for label, size, stride in zip(labels, sizes, strides)]
        return array(layout(dims, offset), np.asarray(data, np.float32).ravel())

    padded = np.zeros((30, 8))
    padded[:, :3] = numbers
    cases = {
        "taxels first": message([30, 3], numbers),
        "channels first": message([3, 30], numbers.T),
        "offset": message([30, 3], [9, 9, *numbers.ravel()], offset=2),
        "rows and columns": message([5, 6, 3], numbers, labels=("height", "width", "channels")),
        "named first": message([3, 5, 6], numbers.T, labels=("axis", "row", "column")),
        "padded": message([30, 3], padded, strides=[240, 8]),
    }
    for name, case in cases.items():
        readings = adapter.read(bag(tmp_path / name, store, [case]), "/skin", grid_map)
        assert np.array_equal(readings.values[0], numbers.T), name
    for name, sizes in (("flat", []), ("grid", [5, 6])):
        readings = adapter.read(bag(tmp_path / name, store, [message(sizes, numbers[:, 0])]), "/skin", grid_map)
        assert np.array_equal(readings.values[0, 0], numbers[:, 0])
    wrong = {
        "10 taxel x 3 axis": message([10, 3], numbers[:10], labels=("taxel", "axis")),
        "90 numbers": message([], numbers),
        "found 12 numbers from 2 on": message([30, 3], numbers[:4], offset=2),
    }
    for match, case in wrong.items():
        with pytest.raises(dermatome.DataError, match=match):
            adapter.read(bag(tmp_path / match, store, [case]), "/skin", grid_map)


def test_any_field_and_any_function_of_a_message(store, grid_map, tmp_path):
    skin, taxel = store.types["my_msgs/msg/Skin"], store.types["my_msgs/msg/Taxel"]
    rng = np.random.default_rng(5)
    counts, force = rng.integers(0, 999, (3, 30)).astype(np.uint16), rng.random((3, 30)).astype(np.float32)
    order = [rng.permutation(30) for _ in range(3)]
    taxels = [[taxel(int(grid_map.ids[i]), float(force[k, i])) for i in order[k][:20]] for k in range(3)]
    path = bag(tmp_path / "a", store, [skin(header(store, 1 + k), counts[k], taxels[k], 20.0) for k in range(3)])
    readings = adapter.read(path, "/skin", grid_map, values="counts", units="Pa", channels=["pressure"])
    assert np.array_equal(readings.values[:, 0], counts) and (readings.channels, readings.units) == (("pressure",), ("Pa",))
    known = adapter.read(path, "/skin", grid_map, values="taxels.force", ids="taxels.number")
    for k in range(3):
        assert np.array_equal(known.values[k, 0, order[k][:20]], force[k, order[k][:20]])
        assert np.isnan(known.values[k, 0, order[k][20:]]).all()
    both = adapter.read(path, "/skin", grid_map, values=lambda m: [m.counts, m.counts / 2], ids=lambda m: grid_map.ids[::-1])
    assert np.array_equal(both.values[:, 1, ::-1], counts / 2)
    with pytest.raises(dermatome.DataError, match="my_msgs/msg/Skin; needed: values, one of its fields .*'counts'"):
        adapter.read(path, "/skin", grid_map)
    with pytest.raises(dermatome.DataError, match="'presure'.*counts"):
        adapter.read(path, "/skin", grid_map, values="presure")
    with pytest.raises(dermatome.DataError, match="ids: found 29"):
        adapter.read(path, "/skin", grid_map, values="counts", ids=grid_map.ids[:29])


def test_times_are_those_of_the_header(store, grid_map, tmp_path):
    skin = store.types["my_msgs/msg/Skin"]
    stamped = bag(tmp_path / "a", store, [skin(header(store, 7.25 + k), np.zeros(30, np.uint16), [], 0.0) for k in range(3)])
    bare = bag(tmp_path / "b", store, [skin(header(store, 0), np.zeros(30, np.uint16), [], 0.0) for k in range(3)])
    layout = store.types["std_msgs/msg/MultiArrayLayout"]([], 0)
    none = bag(tmp_path / "c", store, [store.types["std_msgs/msg/Float32MultiArray"](layout, np.zeros(30, np.float32))])

    def times(path, stamp, values="counts"):
        readings = adapter.read(path, "/skin", grid_map, values=values, stamp=stamp)
        return readings.timestamps.tolist(), readings.remarks

    for stamp in (None, "header"):
        assert times(stamped, stamp) == ([7.25, 8.25, 9.25], ())
    assert times(stamped, "bag")[0] == [0.5, 1.5, 2.5] and times(bare, "header")[0] == [0, 0, 0]
    assert times(bare, None) == ([0.5, 1.5, 2.5], ("the stamps of all messages are 0; times are those of the recording",))
    assert times(none, None, None)[0] == [0.5]
    with pytest.raises(dermatome.DataError, match="no header"):
        times(none, "header", None)
    with pytest.raises(dermatome.DataError, match="stamp"):
        times(none, "clock", None)


def test_sensors_are_channels_patches_or_parts(store, uneven_map, grid_map, tmp_path):
    state, channel = store.types["tactile_msgs/msg/TactileState"], store.types["sensor_msgs/msg/ChannelFloat32"]
    rng = np.random.default_rng(6)

    def read(name, map, *rows):
        sensors = [channel(title, np.asarray(row, np.float32)) for title, row in rows]
        return adapter.read(bag(tmp_path / name, store, [state(header(store, 1), sensors)]), "/skin", map)

    a, b = rng.random((2, 30)).astype(np.float32)
    assert np.array_equal(read("1", grid_map, ("p", a), ("t", b)).values[0], [a, b])
    for name, cut in (("2", 15), ("3", 10)):
        assert np.array_equal(read(name, grid_map, ("f0", a[:cut]), ("f1", a[cut:])).values[0, 0], a)
    first, second = uneven_map.patches.values()
    rows = {patch.name: rng.random(patch.n_taxels).astype(np.float32) for patch in (second, first)}
    values = read("4", uneven_map, *rows.items()).values[0, 0]
    for patch in (first, second):
        part, known = slice(patch.start, patch.start + patch.n_taxels), uneven_map.present[patch.start :][: patch.n_taxels] == 1
        assert np.array_equal(values[part][known], rows[patch.name][known])
    with pytest.raises(dermatome.DataError, match=r"sensors of \[10, 10\] numbers; needed: 30"):
        read("5", grid_map, ("f0", a[:10]), ("f1", a[:10]))


@pytest.mark.parametrize("level", [0, 1, 2])
def test_a_force_keeps_its_total_in_a_bag(level, uneven_map, tmp_path):
    from rosbags.highlevel import AnyReader

    force = np.random.default_rng(7).random((3, 1, 592))
    readings = dermatome.Readings.from_arrays(force, units="N", channels="force", timestamps=[1, 2, 3])
    adapter.write(tmp_path / "a", uneven_map, readings, level=level)
    total, drawn = np.zeros(3), np.zeros(3)
    with AnyReader([tmp_path / "a"]) as reader:
        for connection, time, raw in reader.messages():
            message, frame = reader.deserialize(raw, connection.msgtype), round(time * 1e-9) - 1
            if connection.topic.endswith("/points"):
                total[frame] += np.nansum(np.frombuffer(message.data.tobytes(), np.float32).reshape(-1, 8)[:, 6], dtype=float)
            else:
                drawn[frame] += np.nansum(np.frombuffer(message.data.tobytes(), np.float32), dtype=float) * area(uneven_map, level, message)
    expected = force[:, 0, uneven_map.present == 1].sum(axis=1)
    assert np.allclose(total, expected, rtol=1e-5) and np.allclose(drawn, expected, rtol=1e-5)


def area(map, level, message):
    """The area of a pixel of the image of one patch."""
    for name, patch in map.patches.items():
        renderer = map.renderer(min(level, len(patch.levels) - 1), patch=name)
        if renderer.shape == (message.height, message.width):
            return float(np.prod(renderer.pixel))
    raise AssertionError("an image of no patch")


def test_points_of_a_bag_are_read_back(uneven_map, tmp_path):
    readings = dermatome.Readings.from_arrays(np.random.default_rng(8).random((3, 1, 592)).astype(np.float32), timestamps=[1, 2, 3])
    adapter.write(tmp_path / "a", uneven_map, readings)
    for name, patch in uneven_map.patches.items():
        again = adapter.read(tmp_path / "a", f"/skin/{name.replace('.', '_')}/points", uneven_map)
        part = np.zeros(592, bool)
        part[patch.start : patch.start + patch.n_taxels] = True
        part &= uneven_map.present == 1
        assert np.array_equal(again.values[:, 0, part], readings.values[:, 0, part]) and np.isnan(again.values[:, 0, ~part]).all()
        assert again.timestamps.tolist() == [1, 2, 3]
    large = list(uneven_map.patches)[1]
    adapter.write(tmp_path / "b", uneven_map, readings, level=1, patch=large)
    with pytest.raises(dermatome.DataError, match="fields of level 1"):
        adapter.read(tmp_path / "b", "/skin/points", uneven_map)
    with pytest.raises(dermatome.DataError, match="pixels"):
        adapter.read(tmp_path / "b", "/skin/image", uneven_map)


def test_points_of_one_patch_stay_there(rough_map, tmp_path):
    """Two patches share ids: what a bag has of one is not read on the other."""
    values = np.zeros((2, 1, rough_map.n_taxels))
    values[:, :, :369], values[:, :, 369:] = 10 / 369, 5 / 120
    readings = dermatome.Readings.from_arrays(values, timestamps=[0.0, 0.01], channels="force", units="N")
    adapter.write(tmp_path / "bag", rough_map, readings)
    for topic, [arm, tip] in (("/skin/upper_arm/points", [10, 0]), ("/skin/tip_of_it/points", [0, 5])):
        back = adapter.read(tmp_path / "bag", topic, rough_map).values[0, 0]
        assert np.allclose([np.nansum(back[:369]), np.nansum(back[369:])], [arm, tip], rtol=1e-2)
    again = dermatome.Readings.from_arrays(values, timestamps=[0.01, 0.0])
    with pytest.raises(dermatome.DataError, match="frame 1"):
        adapter.write(tmp_path / "again", rough_map, again)


def test_bags_without_definitions(store, grid_map, tmp_path):
    """Those that ROS 2 up to Humble wrote."""
    kind, custom = "std_msgs/msg/Float32MultiArray", "my_msgs/msg/Counts"
    own = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    own.register(typesys.get_types_from_msg("uint16[] counts", custom))
    with rosbag2.Writer(tmp_path / "a", version=8) as writer:
        array = writer.add_connection("/skin", kind, typestore=own)
        counts = writer.add_connection("/counts", custom, typestore=own)
        layout = own.types["std_msgs/msg/MultiArrayLayout"]([], 0)
        writer.write(array, 10**9, own.serialize_cdr(own.types[kind](layout, np.arange(30, dtype=np.float32)), kind))
        writer.write(counts, 10**9, own.serialize_cdr(own.types[custom](np.arange(30, dtype=np.uint16)), custom))
    for database in (tmp_path / "a").glob("*.db3"):
        with sqlite3.connect(database) as connection:
            connection.execute("DELETE FROM message_definitions")
        connection.close()
    assert adapter.read(tmp_path / "a", "/skin", grid_map).values[0, 0].tolist() == list(range(30))
    with pytest.raises(dermatome.DataError, match="definitions={'my_msgs/msg/Counts'"):
        adapter.read(tmp_path / "a", "/counts", grid_map, values="counts")
    known = adapter.read(tmp_path / "a", "/counts", grid_map, values="counts", definitions={custom: "uint16[] counts"})
    assert known.values[0, 0].tolist() == list(range(30))


def test_ids_are_in_all_messages_or_in_none(store, grid_map, tmp_path):
    kind = store.types["std_msgs/msg/Float32MultiArray"]
    layout = store.types["std_msgs/msg/MultiArrayLayout"]([], 0)
    path = bag(tmp_path / "a", store, [kind(layout, np.ones(30, np.float32)) for _ in range(3)])
    given = iter([grid_map.ids, None, grid_map.ids])
    with pytest.raises(dermatome.DataError, match="topic: found no ids in message 1; needed: ids in all messages, or in none"):
        adapter.read(path, "/skin", grid_map, ids=lambda message: next(given))


def test_errors_of_bags_are_ours(store, grid_map, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "a.mcap").write_bytes(b"nothing")
    for name in ("empty", "a.mcap"):
        with pytest.raises(dermatome.FileError, match=name):
            adapter.read(tmp_path / name, "/skin", grid_map)
    with pytest.raises(dermatome.MissingFileError, match="none"):
        adapter.read(tmp_path / "none", "/skin", grid_map)
    readings = dermatome.Readings.from_arrays(np.zeros((1, 30)))
    with pytest.raises(dermatome.FileError, match="empty"):
        adapter.write(tmp_path / "empty", grid_map, readings)
    with pytest.raises(dermatome.DataError, match="channel"):
        adapter.write(tmp_path / "b", grid_map, readings, channel=1)
    late = dermatome.Readings.from_arrays(np.zeros((2, 30)), timestamps=[1, 9e10])
    with pytest.raises(dermatome.DataError, match="timestamps: found .* for frame 1"):
        adapter.write(tmp_path / "b", grid_map, late)
    assert not (tmp_path / "b").exists()


def test_a_recording_goes_through_bags(dome_map, store, tmp_path):
    from rosbags.highlevel import AnyReader
    kinds = store.types
    values = np.random.default_rng(2).random((5, 256)).astype(np.float32)
    order = np.random.default_rng(3).permutation(256)
    with rosbag2.Writer(tmp_path / "in", version=9) as writer:
        to = writer.add_connection("/tactile", "tactile_msgs/msg/TactileState", typestore=store)
        for k in range(5):
            stamp = kinds["builtin_interfaces/msg/Time"](sec=k, nanosec=0)
            header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="hand")
            channel = kinds["sensor_msgs/msg/ChannelFloat32"](name="pressure", values=values[k, order])
            message = kinds["tactile_msgs/msg/TactileState"](header=header, sensors=[channel])
            writer.write(to, k * 10**9, store.serialize_cdr(message, "tactile_msgs/msg/TactileState"))
    readings = adapter.read(tmp_path / "in", "/tactile", dome_map, ids=dome_map.ids[order])
    assert np.array_equal(readings.values[:, 0], values) and readings.timestamps.tolist() == [0, 1, 2, 3, 4]
    with pytest.raises(dermatome.DataError, match="/tactile"):
        adapter.read(tmp_path / "in", "/nothing", dome_map)
    adapter.write(tmp_path / "out", dome_map, readings, level=1)
    renderer = dome_map.renderer(1)
    with AnyReader([tmp_path / "out"]) as reader:
        images = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages() if c.topic == "/skin/image"]
        clouds = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages() if c.topic == "/skin/points"]
    drawn = np.frombuffer(images[3].data.tobytes(), "<f4").reshape(images[3].height, images[3].width)
    assert np.array_equal(drawn, renderer(values[3:4])[0, 0], equal_nan=True)
    rows = np.frombuffer(clouds[3].data.tobytes(), np.float32).reshape(-1, 8)
    assert np.allclose(rows[:, :3], dome_map.patches["dome"].levels[1].positions, atol=1e-7)
    assert np.array_equal(rows[:, 6], dome_map.pool(values[3], 1))


def test_bags_of_ros_1(dome_map, tmp_path):
    rosbag1 = pytest.importorskip("rosbags.rosbag1")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    kind = store.types["sensor_msgs/msg/Image"]
    stamp = store.types["builtin_interfaces/msg/Time"](sec=5, nanosec=0)
    head = store.types["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id="hand")
    pixels = np.random.default_rng(9).integers(0, 60_000, (16, 16)).astype("<u2")
    message = kind(head, 16, 16, "mono16", 0, 32, pixels.view(np.uint8).ravel())
    with rosbag1.Writer(tmp_path / "a.bag") as writer:
        to = writer.add_connection("/skin", kind.__msgtype__, typestore=store)
        writer.write(to, 10**9, store.serialize_ros1(message, kind.__msgtype__))
    readings = adapter.read(tmp_path / "a.bag", "/skin", dome_map)
    assert np.array_equal(readings.values[0, 0], pixels.ravel()) and readings.timestamps.tolist() == [5]

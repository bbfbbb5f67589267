"""Recordings that lie: each is refused with a message that says what to do, or read right, in bounded memory and time."""

import json
import subprocess
import sys
import time
import zipfile
import zlib

import numpy as np
import pytest

import dermatome
from dermatome import Readings

LAYOUT = {
    "dermatome_layout": 1, "axes": ["frame", "taxel"], "time": {"rate": 10}, "press": "raises", "zero": 0,
    "channels": [{"name": "pressure", "unit": "count"}], "taxels": {"shape": [5], "first_id": 1},
}  # fmt: skip
ROWS = np.random.default_rng(0).integers(0, 99, (40, 5)).astype(np.float32)
FILE_TIME = {**LAYOUT, "time": {"stream": "timestamps", "unit": "s"}}


def read(path, **options):
    recording = Readings.open(path, **{"layout": LAYOUT, **options})
    return np.concatenate([part.values for part in recording.chunks()])[:, 0], recording


def refuse(path, match, **options):
    began = time.monotonic()
    with pytest.raises(dermatome.Error, match=match) as caught:
        read(path, **options)
    text = str(caught.value)
    assert path.name in text and "found" in text and "needed" in text or "cannot be" in text, text
    assert time.monotonic() - began < 10


# ---- Zarr


def about(shape, chunks, dtype="<f4", codec=None, **more):
    return {"zarr_format": 2, "shape": shape, "chunks": chunks, "dtype": dtype, "compressor": codec, "fill_value": 0, "order": "C", "filters": None, **more}


def zarr_file(path, changes=(), rows=ROWS, root="task.zarr/", codec=None):
    """A zip with 40 frames of 5 taxels in chunks of 10, and what is changed in it; None takes a file away."""
    pytest.importorskip("numcodecs")
    from numcodecs import get_codec

    def encoded(array):
        raw = np.ascontiguousarray(array)
        return bytes(get_codec(codec).encode(raw)) if codec else raw.tobytes()

    name = "data/tactile"
    files = {".zgroup": b'{"zarr_format": 2}', "data/.zgroup": b'{"zarr_format": 2}'}
    files |= {f"{name}/.zarray": about([40, 5], [10, 5], codec=codec), "data/timestamps/.zarray": about([40], [40], "<f8")}
    files["data/timestamps/0"] = (np.arange(40) / 10).tobytes()
    files |= {f"{name}/{k}.0": encoded(rows[10 * k : 10 * k + 10]) for k in range(4)}
    for key, value in dict(changes).items():
        files[key] = value(files[key]) if callable(value) else value
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for key, value in files.items():
            if value is not None:
                archive.writestr(root + key, json.dumps(value) if isinstance(value, dict) else value)
    return path


ZARRAY, CHUNK = "data/tactile/.zarray", "data/tactile/0.0"
BLOSC = {"id": "blosc", "cname": "zstd", "clevel": 5, "shuffle": 2, "blocksize": 0}


@pytest.mark.parametrize("codec", [None, BLOSC, {"id": "zstd", "level": 3}, {"id": "lz4", "acceleration": 1}, {"id": "gzip", "level": 5}, {"id": "zlib", "level": 5}])
def test_zarr_chunks_that_lie(codec, tmp_path):
    assert np.array_equal(read(zarr_file(tmp_path / "a.zarr.zip", codec=codec))[0], ROWS)
    assert np.array_equal(read(zarr_file(tmp_path / "root.zip", codec=codec, root=""))[0], ROWS)
    refuse(zarr_file(tmp_path / "short.zip", {CHUNK: lambda data: data[:-3]}, codec=codec), "tactile/0.0")
    refuse(zarr_file(tmp_path / "bomb.zip", {CHUNK: b"\0" * (1 << 24)}, codec=codec), "tactile/0.0: found more than")
    if codec is None:
        return
    name = codec["id"]
    lies = {
        "blosc": lambda data: data[:4] + (2**31 - 1).to_bytes(4, "little") + data[8:],
        "zstd": lambda data: data[:4] + bytes([0xC0 | data[4] & 0x3F]) + (0 if data[4] & 0x20 else 1) * data[5:6] + (2**40).to_bytes(8, "little") + data[6:],
        "lz4": lambda data: (2**31 - 1).to_bytes(4, "little") + data[4:],
    }
    if name in lies:
        refuse(zarr_file(tmp_path / "lie.zip", {CHUNK: lies[name]}, codec=codec), f"tactile/0.0: cannot be decoded by {name}")
    from numcodecs import get_codec

    large = bytes(get_codec(codec).encode(np.zeros(1 << 24, np.uint8)))
    refuse(zarr_file(tmp_path / "large.zip", {CHUNK: large}, codec=codec), "tactile/0.0: (found|cannot)")


ZARRS = {
    "frames that are not there": ({ZARRAY: about([10**12, 5], [10, 5])}, "found 4 chunks; needed: all 100000000000"),
    "a chunk of 400 GB": ({ZARRAY: about([40, 5], [10**10, 5])}, "found pieces"),
    "2^80 numbers": ({ZARRAY: about([2**60, 2**20], [10, 5])}, "fewer than 2\\^62"),
    "a negative size": ({ZARRAY: about([-40, 5], [10, 5])}, "whole numbers from 0"),
    "a shape of words": ({ZARRAY: about(["40", 5], [10, 5])}, "whole numbers from 0"),
    "no chunks": ({ZARRAY: about([40, 5], [0, 5])}, "one size for each axis"),
    "records": ({ZARRAY: about([40, 5], [10, 5], [["a", "<f4"]])}, "no stream|records"),
    "another format": ({ZARRAY: about([40, 5], [10, 5]) | {"zarr_format": 7}}, "zarr_format 7"),
    "no JSON": ({ZARRAY: b'{"shape": [40'}, "no JSON"),
    "JSON without end": ({ZARRAY: b"[" * 100_000}, "no JSON"),
    "a chunk is gone": ({CHUNK: None}, "found 3 chunks; needed: all 4"),
    "a chunk is gone, and one of fill values is stored": ({CHUNK: None, "data/tactile/3.0": bytes(200)}, "found 3 chunks; needed: all 4"),
    "no chunk at all": ({f"data/tactile/{k}.0": None for k in range(4)}, "found 0 chunks; needed: all 4"),
    "a chunk is gone, without a fill value": ({CHUNK: None, ZARRAY: about([40, 5], [10, 5]) | {"fill_value": None}}, "found 3 chunks; needed: all 4"),
    "a chunk has another number": ({CHUNK: None, "data/tactile/9.0": b"0"}, "no chunk data/tactile/0.0"),
    "no group": ({".zgroup": None}, "no .zgroup"),
    "a codec that is not there": ({ZARRAY: about([40, 5], [10, 5], codec={"id": "jpegxl"})}, "codec 'jpegxl'"),
    "a filter that is not there": ({ZARRAY: about([40, 5], [10, 5], filters=[{"id": "wavelet"}])}, "codec 'wavelet'"),
    "fewer ends than frames": ({"meta/episode_ends/.zarray": about([1], [1], "<i8"), "meta/episode_ends/0": np.array([30]).tobytes()}, "found 40 frames; needed: 30"),
}


@pytest.mark.parametrize("what", ZARRS)
def test_zarr_arrays_that_lie(what, tmp_path):
    changes, match = ZARRS[what]
    refuse(zarr_file(tmp_path / "a.zarr.zip", changes), match)


def test_zarr_of_other_kinds(tmp_path):
    big = {ZARRAY: about([40, 5], [10, 5], ">f4")} | {f"data/tactile/{k}.0": ROWS[10 * k : 10 * k + 10].astype(">f4").tobytes() for k in range(4)}
    assert np.array_equal(read(zarr_file(tmp_path / "big.zip", big))[0], ROWS)
    turned = {ZARRAY: about([40, 5], [10, 5], order="F")} | {f"data/tactile/{k}.0": ROWS[10 * k : 10 * k + 10].T.tobytes() for k in range(4)}
    assert np.array_equal(read(zarr_file(tmp_path / "turned.zip", turned))[0], ROWS)
    parts = {ZARRAY: about([40, 5], [10, 3], dimension_separator="/")}
    for k in range(4):
        block = np.pad(ROWS[10 * k : 10 * k + 10], ((0, 0), (0, 1)))
        parts |= {f"data/tactile/{k}.0": None, f"data/tactile/{k}/0": block[:, :3].tobytes(), f"data/tactile/{k}/1": block[:, 3:].tobytes()}
    assert np.array_equal(read(zarr_file(tmp_path / "parts.zip", parts))[0], ROWS)
    with zipfile.ZipFile(zarr_file(tmp_path / "zip.zip")) as archive:
        archive.extractall(tmp_path / "folder")
    for folder in (tmp_path / "folder", tmp_path / "folder" / "task.zarr"):
        assert np.array_equal(read(folder)[0], ROWS)
    nan = {"data/timestamps/0": np.where(np.arange(40) == 7, np.nan, np.arange(40) / 10).tobytes()}
    refuse(zarr_file(tmp_path / "nan.zip", nan), "time|frame 7", layout=FILE_TIME)
    refuse(zarr_file(tmp_path / "inf.zip", {"data/timestamps/0": np.append(np.arange(39) / 10, np.inf).tobytes()}), "time|frame 39", layout=FILE_TIME)


@pytest.mark.parametrize("shards", [None, (400, 6)])
def test_chunks_are_decoded_once(shards, tmp_path, monkeypatch):
    """A file is read and a chunk decoded once, whatever the blocks of frames."""
    zarr = pytest.importorskip("zarr")
    if not hasattr(zarr, "create_array"):
        pytest.skip("zarr 3 is needed")
    from dermatome.recordings import zarr as ours

    rows = np.random.default_rng(2).random((380, 6), dtype=np.float32) + 1
    array = zarr.create_array(str(tmp_path / "a.zarr"), shape=rows.shape, dtype="float32", chunks=(100, 2), shards=shards)
    array[:] = rows
    read, decoded = [], []
    reads, decodes = ours.Store.read, ours.Array._numbers
    monkeypatch.setattr(ours.Store, "read", lambda self, name, most: read.append(name) or reads(self, name, most))
    monkeypatch.setattr(ours.Array, "_numbers", lambda self, data, where: decoded.append(where) or decodes(self, data, where))
    for step in (7, 64, 100, 380):
        array = ours.Array(ours.Store(tmp_path / "a.zarr"), "")
        read.clear()
        decoded.clear()
        got = np.concatenate([array.read(k, min(k + step, 380)) for k in range(0, 380, step)])
        assert np.array_equal(got, rows) and len(decoded) == 12 and len(read) == (1 if shards else 12), step
        assert len(array.kept) == 3  # Those that a next block would begin in.


def test_the_checksum_of_a_shard_is_that_of_castagnoli():
    from dermatome.recordings.zarr import crc32c

    assert crc32c(b"123456789") == 0xE3069283 and crc32c(b"") == 0


@pytest.mark.parametrize("shards", [None, (20, 5)])
def test_zarr_3(shards, tmp_path):
    zarr = pytest.importorskip("zarr")
    if not hasattr(zarr, "create_array"):
        pytest.skip("zarr 3 is needed")
    group = zarr.open_group(str(tmp_path / "a.zarr"), mode="w", zarr_format=3)
    rows = ROWS + 1  # No chunk is of fill values, which Zarr leaves out.
    for name, kind in (("tactile", "float32"), ("other", "int16")):
        group.create_array(f"data/{name}", shape=(40, 5), dtype=kind, chunks=(10, 5), shards=shards)[:] = rows.astype(kind)
    for stream in ("tactile", "other"):
        assert np.array_equal(read(tmp_path / "a.zarr", stream=stream)[0], rows)
    first = next(path for path in sorted((tmp_path / "a.zarr/data/tactile").rglob("*")) if path.is_file() and path.name != "zarr.json")
    data = first.read_bytes()
    first.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
    refuse(tmp_path / "a.zarr", "checksum" if shards else "cannot be decoded|bytes", stream="tactile")
    first.write_bytes(data[:9])
    refuse(tmp_path / "a.zarr", "needed: an index" if shards else "cannot be decoded|bytes", stream="tactile")
    # A chunk of fill values is not stored: it is one where another chunk has a frame of them, and may be lost otherwise.
    group["data/other"][:10] = 0
    refuse(tmp_path / "a.zarr", r"found no chunk \(0, 0\)" if shards else "found 3 chunks; needed: all 4", stream="other")
    rows = (ROWS + 1).astype("int16")
    rows[:12] = 0
    rows[30:] = 0
    group["data/other"][:] = rows
    values, recording = read(tmp_path / "a.zarr", stream="other")
    assert np.array_equal(values, rows)
    assert ("chunks", "2 are not stored, as chunks of one value are not: readings there are 0", "checked") in recording.statements
    alone = zarr.create_array(str(tmp_path / "alone.zarr"), shape=(40, 5), dtype="float32", chunks=(10, 5))
    alone[:] = ROWS + 1
    assert np.array_equal(read(tmp_path / "alone.zarr")[0], ROWS + 1) and list(Readings.open(tmp_path / "alone.zarr").streams) == ["values"]


def test_zarr_areas_that_are_all_zero(tmp_path):
    name = "data/right_tactile_area_hand"
    areas = {f"{name}/.zarray": about([40, 1], [40, 1], "<i8")}
    pads = {"data/right_tactile_data_hand/.zarray": about([40, 1, 5], [40, 1, 5]), "data/right_tactile_data_hand/0.0.0": ROWS.tobytes()}
    gone = {ZARRAY: None, **{f"data/tactile/{k}.0": None for k in range(4)}}
    layout = {**LAYOUT, "axes": ["frame", "pad", "taxel"], "taxels": {"shape": [1, 5], "first_id": 1}}
    path = zarr_file(tmp_path / "a.zip", {**areas, **pads, **gone})
    values, recording = read(path, layout=layout)
    assert np.array_equal(values, ROWS) and recording.says["area"] == [0]
    refuse(zarr_file(tmp_path / "b.zip", {**areas, **pads, **gone, f"{name}/.zarray": {**areas[f"{name}/.zarray"], "fill_value": None}}), "found 0 chunks", layout=layout)


# ---- HDF5


@pytest.fixture
def h5(tmp_path):
    h5py = pytest.importorskip("h5py")

    def make(name, change=None, rows=ROWS, times=None):
        path = tmp_path / f"{name}.hdf5"
        with h5py.File(path, "w") as file:
            group = file.create_group("data/demo_0")
            group["pressure"] = rows
            group["timestamps"] = np.arange(len(rows)) / 10 if times is None else times
            if change:
                del group["pressure"]
                change(h5py, file, group)
        return path

    return make


def outside(h5py, file, group):
    group["pressure"] = h5py.ExternalLink("/etc/passwd", "/data")


def stored_outside(h5py, file, group):
    group.create_dataset("pressure", (40, 5), "f4", external=[("other.bin", 0, 800)])


def virtual(h5py, file, group):
    made = h5py.VirtualLayout((40, 5), "f4")
    made[:] = h5py.VirtualSource("other.hdf5", "a", (40, 5))
    group.create_virtual_dataset("pressure", made)


def never_written(h5py, file, group):
    group.create_dataset("pressure", (10**11, 5), "f4", chunks=(1000, 5))


def half_written(h5py, file, group):
    group.create_dataset("pressure", (40, 5), "f4", chunks=(10, 5))[:20] = ROWS[:20]


def filter_gone(h5py, file, group):
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk((10, 5))
    plist.set_filter(32015, h5py.h5z.FLAG_OPTIONAL, ())
    space = h5py.h5s.create_simple((40, 5))
    made = h5py.h5d.create(group.id, b"pressure", h5py.h5t.NATIVE_FLOAT, space, plist)
    h5py.Dataset(made)[:] = ROWS


def loop(h5py, file, group):
    group["again"] = file["data"]
    group["pressure"] = ROWS


def bomb(h5py, file, group):
    made = group.create_dataset("pressure", (40, 5), "f4", chunks=(10, 5), compression="gzip")
    made[:] = ROWS
    made.id.write_direct_chunk((10, 0), zlib.compress(bytes(1 << 28), 1))


BROKEN = {
    bomb: "found [0-9]+ bytes in the chunk at \\(10, 0\\)",
    outside: "found a link to '/etc/passwd'",
    stored_outside: "kept in 'other.bin'",
    virtual: "kept in other files",
    never_written: "found 0 of 100000000 chunks",
    half_written: "found 2 of 4 chunks",
    filter_gone: "filter 32015",
}


@pytest.mark.parametrize("change", BROKEN, ids=lambda change: change.__name__)
def test_hdf5_that_is_not_all_there(change, h5):
    if change is filter_gone and pytest.importorskip("h5py").h5z.filter_avail(32015):
        pytest.skip("the filter is installed")
    refuse(h5("a", change), BROKEN[change], stream="data/demo_0/pressure")


def test_rates_of_hdf5_stand_around_the_readings(tmp_path):
    """The rate, and the unit, are those of the nearest group, and of all episodes."""
    h5py = pytest.importorskip("h5py")

    def stated(name, attributes, datasets=(), stream="runs/*/hand/tactile"):
        with h5py.File(tmp_path / name, "w") as file:
            for run in ("one", "two"):
                file[f"runs/{run}/hand/tactile"] = ROWS
            for path, key, value in attributes:
                file[path].attrs[key] = value
            for path, value in datasets:
                file[path] = value
        return Readings.open(tmp_path / name, stream=stream).says

    for k, (path, key) in enumerate((("/", "rate"), ("runs", "FPS"), ("runs", "Sampling_Rate"), ("/", "Hz"))):
        assert stated(f"{k}.h5", [(path, key, np.float32(25))]) == {"rate": 25.0}, (path, key)
    both = [(f"runs/{run}/hand", "rate", 25) for run in ("one", "two")]
    assert stated("near.h5", [("/", "fps", 30), ("runs", "unit", b"kPa"), *both]) == {"rate": 25.0, "unit": "kPa"}
    assert stated("beside.h5", [("/", "rate", 30)], [(f"runs/{run}/rate", 25.0) for run in ("one", "two")]) == {"rate": 25.0}
    assert stated("else.h5", [], [("meta/fps", 25)]) == {"rate": 25.0}
    assert stated("two.h5", [], [("meta/fps", 30), ("info/fps", 25)]) == stated("camera.h5", [], [("camera/fps", 30)]) == {}
    assert stated("above.h5", [], [("runs/fps", 50), ("meta/fps", 25)]) == {"rate": 50.0}
    assert stated("mask.h5", [("/", "rate", True), ("runs", "hz", [1.0, 2.0])]) == {}
    with pytest.raises(dermatome.DataError, match="found the rate 25.0 of runs/one/hand/tactile and 50.0 of runs/two"):
        stated("other.h5", [("runs/one", "rate", 25), ("runs/two", "rate", 50)])
    assert stated("one.h5", [("runs/one", "rate", 25), ("runs/two", "rate", 50)], stream="runs/two/hand/tactile") == {"rate": 50.0}
    deep = "/".join("abcdefghijklmnopqrstuvwxyz")
    with h5py.File(tmp_path / "deep.h5", "w") as file:
        file[f"{deep}/tactile"], file.attrs["rate"] = ROWS, 25
    assert Readings.open(tmp_path / "deep.h5", stream=f"{deep}/tactile").says == {}
    refuse(tmp_path / "near.h5", "25", stream="runs/one/hand/tactile", layout={**LAYOUT, "time": {"rate": 50}, "channels": [{"name": "pressure", "unit": "kPa"}]})


def test_groups_of_many_links_are_listed_once(tmp_path):
    """A graph of 30 groups with two links each has 2^30 paths."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        group = file.create_group("g0")
        for k in range(1, 30):
            group["a"] = group["b"] = file.create_group(f"g{k}")
            group = group["a"]
        group["tactile"] = ROWS
        # The name of a hard link counts, wherever a soft one stands.
        file["episode_1"], file["a_link"] = file["g0"].file.create_group("demo"), h5py.SoftLink("/demo")
        file["demo/tactile"] = ROWS + 1
    streams = Readings.open(tmp_path / "a.h5").streams
    assert len(streams) == 2 and not any("a_link" in name for name in streams)


def test_flags_of_one_episode_are_not_those_of_others(tmp_path):
    h5py = pytest.importorskip("h5py")
    for name, lengths in (("same", (40, 40)), ("other", (40, 30))):
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            for k, length in enumerate(lengths):
                file[f"data/demo_{k}/tactile"] = ROWS[:length]
            file["validity/tactile"] = np.arange(40) != 7
    got = [Readings.open(tmp_path / f"{name}.h5", stream="data/*/tactile", layout=LAYOUT) for name in ("same", "other")]
    same, other = (each.read() for each in got)
    assert np.isfinite(same.values).all() and np.flatnonzero(np.isnan(other.values[:, 0]).all(axis=1)).tolist() == [7]
    assert any(what == "validity" and "2 episodes" in value for what, value, _ in got[0].statements)


def test_hdf5_of_other_kinds(h5, tmp_path):
    assert np.array_equal(read(h5("good"))[0], ROWS)
    assert np.array_equal(read(h5("loop", loop), stream="data/demo_0/pressure")[0], ROWS)
    padded = np.append(np.arange(30) / 10, np.zeros(10))
    refuse(h5("padded", times=padded), "30|ascend", layout=FILE_TIME)
    refuse(h5("nan", times=np.append(np.arange(39) / 10, np.nan)), "39|time", layout=FILE_TIME)
    refuse(h5("cut").rename(tmp_path / "c.hdf5") and cut(tmp_path / "c.hdf5"), "no HDF5 file that can be read")
    two = h5("rates", times=np.cumsum(np.where(np.arange(40) < 20, 1 / 10, 1 / 20)))
    values, recording = read(two, layout=FILE_TIME)
    assert np.array_equal(values, ROWS)
    both = h5("both", lambda h5py, file, group: [group.create_dataset(f"{side}_pressure", data=ROWS) for side in ("left", "right")])
    refuse(both, "left_pressure and data/demo_0/right_pressure for", stream="data/*/*_pressure")
    assert np.array_equal(read(both, stream="data/*/left_pressure")[0], ROWS)
    for episode in (-1, "0", True):
        with pytest.raises(dermatome.DataError, match="episode: found"):
            Readings.open(both, episode=episode)
    times = np.arange(40) / 10
    assert any("a rate is stated" in value for _, value, _ in read(h5("rated", times=times))[1].statements)
    refuse(h5("episodes"), "an axis 'episode' in the layout", layout={**LAYOUT, "axes": ["episode", "frame", "taxel"]})
    frames_last = {**LAYOUT, "axes": ["taxel", "frame"]}
    assert np.array_equal(read(h5("turned", rows=np.ascontiguousarray(ROWS.T), times=np.arange(40) / 10), layout=frames_last)[0], ROWS)


def cut(path):
    path.write_bytes(path.read_bytes()[:-700])
    return path


# ---- LeRobot


@pytest.fixture
def robot(tmp_path):
    arrow, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")

    def make(name, info=None, **columns):
        root = tmp_path / name
        for folder in ("meta/episodes/chunk-000", "data/chunk-000"):
            (root / folder).mkdir(parents=True)
        made = {"codebase_version": "v3.0", "fps": 10, "total_frames": 40, "total_episodes": 1}
        made["features"] = {"observation.tactile": {"dtype": "float32", "shape": [5], "names": None}}
        (root / "meta/info.json").write_bytes(info if isinstance(info, bytes) else json.dumps({**made, **(info or {})}).encode())
        pq.write_table(arrow.table({"episode_index": [0], "length": [40]}), root / "meta/episodes/chunk-000/file-000.parquet")
        index = np.arange(40)
        table = {"observation.tactile": ROWS.tolist(), "timestamp": (index / 10).astype(np.float32), "frame_index": index}
        table |= {"episode_index": np.zeros(40, np.int64), **columns}
        pq.write_table(arrow.table({key: value for key, value in table.items() if value is not None}), root / "data/chunk-000/file-000.parquet")
        return root

    return make


def swapped(k, value):
    return [value if row == k else each for row, each in enumerate(ROWS.tolist())]


TACTILE = "observation.tactile"
FEATURE = {"dtype": "float32", "names": None}
ROBOTS = {
    "a list that is short": ({}, {TACTILE: swapped(9, [1.0, 2.0])}, "lists of 2, 5 numbers"),
    "lists of lists": ({}, {TACTILE: [[row] for row in ROWS.tolist()]}, "axis 1; needed: the shape \\(5,\\)"),
    "numbers for lists": ({}, {TACTILE: ROWS[:, 0]}, "needed: numbers of the shape"),
    "words": ({}, {TACTILE: [["a"] * 5] * 40}, "needed: numbers of the shape"),
    "a frame is counted twice": ({}, {"frame_index": np.where(np.arange(40) == 9, 8, np.arange(40))}, "frame_index 8 in row 9; needed: 9"),
    "no frame_index": ({}, {"frame_index": None}, "no column 'frame_index'"),
    "time of another rate": ({}, {"timestamp": (np.arange(40) / 50).astype(np.float32)}, "as fps 10"),
    "NaN times": ({}, {"timestamp": np.full(40, np.nan, np.float32)}, "as fps 10"),
    "an episode without a number": ({}, {"episode_index": [None, *[0] * 39]}, "no episode_index in a row"),
    "a second episode": ({}, {"episode_index": np.arange(40) // 20}, "are rows mixed"),
    "a frame of 4 TB": ({"features": {TACTILE: {**FEATURE, "shape": [10**12]}}}, {}, "found pieces"),
    "a shape of words": ({"features": {TACTILE: {**FEATURE, "shape": "5"}}}, {}, "whole numbers from 0"),
    "features as a list": ({"features": []}, {}, "an object"),
    "fps is a word": ({"fps": "10"}, {}, "a number above 0"),
    "fps is NaN": ({"fps": float("nan")}, {}, "a number above 0"),
    "frames are not whole": ({"total_frames": 40.5}, {}, "a whole number"),
    "more episodes": ({"total_episodes": 2}, {}, "0 to 1, each with its length"),
    "text of another encoding": (b'{"codebase_version": "\xff\xfe"}', {}, "no JSON"),
    "JSON without end": (b"[" * 100_000, {}, "no JSON"),
    "JSON of 40 MB": (b" " * 40_000_000, {}, "at most"),
}


@pytest.mark.parametrize("what", ROBOTS)
def test_datasets_that_lie(what, robot):
    info, columns, match = ROBOTS[what]
    refuse(robot("a", info, **columns), match, stream=None if isinstance(info, bytes) else TACTILE)


def test_datasets_with_a_column_a_taxel(robot):
    names = [f"pressure_{k}" for k in (3, 0, 1, 10, 2)]
    columns = {name: row for name, row in zip([*names, "battery"], [*ROWS.T, ROWS[:, 0]])}
    info = {"features": {name: {**FEATURE, "shape": [1]} for name in columns}}
    path = robot("columns", info, **{TACTILE: None}, **columns)
    layout = {**LAYOUT, "taxels": {"columns": "pressure_{id}"}}
    values, recording = read(path, layout=layout)
    assert np.array_equal(values, ROWS[:, [1, 2, 4, 0, 3]]) and recording.read().ids.tolist() == [0, 1, 2, 3, 10]
    assert ("columns not read", "battery", "file") in recording.statements
    draft = json.loads(Readings.open(path).draft())
    assert draft["taxels"] == {"columns": "pressure_{id}"} and draft["time"] == {"rate": 10.0}
    refuse(path, "needed: columns called ele{id}", layout={**LAYOUT, "taxels": {"columns": "ele{id}"}})
    refuse(robot("list"), "taxels: found", layout=layout)


def test_datasets_of_other_kinds(robot):
    assert np.array_equal(read(robot("good"))[0], ROWS)
    valid = np.ones((40, 5), np.float32)
    valid[3, 2] = valid[7] = 0
    features = {TACTILE: {**FEATURE, "shape": [5]}, f"{TACTILE}.valid": {**FEATURE, "shape": [5]}}
    values, recording = read(robot("valid", {"features": features}, **{f"{TACTILE}.valid": valid.tolist()}), stream=TACTILE)
    assert np.array_equal(np.isnan(values), valid == 0) and ("not valid", "2 frames are not valid: no readings there", "file") in recording.statements
    broken = robot("cut")
    cut(broken / "data/chunk-000/file-000.parquet")
    with pytest.raises(dermatome.FileError, match="file-000.parquet"):
        read(broken)


# ---- Bags

PRESSURE = "std_msgs/Header header\nfloat32[] pressure"


@pytest.fixture
def bag(tmp_path):
    rosbag2, typesys = pytest.importorskip("rosbags.rosbag2"), pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    store.register(typesys.get_types_from_msg(PRESSURE, "my_msgs/msg/Pressure"))

    def make(name, topics):
        with rosbag2.Writer(tmp_path / name, version=9) as writer:
            for topic, (step, messages) in topics.items():
                kind = messages[0].__msgtype__
                to = writer.add_connection(topic, kind, typestore=store)
                for k, message in enumerate(messages):
                    writer.write(to, 10**18 + k * step, store.serialize_cdr(message, kind))
        return tmp_path / name

    def message(kind, stamp=None, **fields):
        if stamp is not None:
            time = store.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
            fields["header"] = store.types["std_msgs/msg/Header"](stamp=time, frame_id="hand")
        return store.types[kind](**fields)

    return make, message


START = 1_760_000_000 * 10**9
HEADER_TIME = {**LAYOUT, "time": {"stream": "header", "unit": "ns"}}


def pressures(message, stamps, rows=ROWS):
    return [message("my_msgs/msg/Pressure", int(stamp), pressure=row) for stamp, row in zip(stamps, rows)]


def test_bags_keep_their_times(bag):
    make, message = bag
    stamps = START + np.arange(40) * 10**7
    both = make("two", {"/slow": (10**8, pressures(message, START + np.arange(40) * 10**8)), "/fast": (10**7, pressures(message, stamps))})
    for topic, step in (("/slow.pressure", 0.1), ("/fast.pressure", 0.01)):
        recording = Readings.open(both, stream=topic, layout=HEADER_TIME)
        got = recording.read()
        assert np.array_equal(got.values[:, 0], ROWS) and np.allclose(got.timestamps, step * np.arange(40), rtol=0, atol=1e-12)
    zero = make("zero", {"/a": (10**8, pressures(message, [0] * 40))})
    values, recording = read(zero, layout=HEADER_TIME)
    assert np.array_equal(values, ROWS) and any("stamps are 0" in value for _, value, _ in recording.statements)
    refuse(make("some", {"/a": (10**8, pressures(message, [*stamps[:9], 0, *stamps[10:]]))}), "message 9 of /a: found the stamp 0", layout=HEADER_TIME)
    refuse(make("back", {"/a": (10**8, pressures(message, [*stamps[:9], stamps[3], *stamps[10:]]))}), "9|ascend", layout=HEADER_TIME)
    longer = [*ROWS[:9], np.zeros(6, np.float32), *ROWS[10:]]
    refuse(make("longer", {"/a": (10**8, pressures(message, stamps, longer))}), r"message 9 of /a: found the shape \(6,\)")
    simulated = make("simulated", {"/a": (10**7, pressures(message, np.arange(40) * 10**7))})
    assert np.allclose(Readings.open(simulated, layout=HEADER_TIME).read().timestamps, np.arange(40) / 100, rtol=0, atol=1e-12)
    at_100 = {**LAYOUT, "time": {"rate": 100}}
    assert np.array_equal(read(both, stream="/fast.pressure", layout=at_100)[0], ROWS)
    refuse(both, "frame 1: found 0.100000 s after the first in the file; needed: 0.010000 s", stream="/slow.pressure", layout=at_100)
    refuse(both, "/slow.pressure.*/fast.pressure")
    refuse(both, "one of /slow.pressure, /fast.pressure", stream="/skin")
    refuse(both, "found 'heat'", stream="/slow.heat")


def test_bags_of_points_and_images(bag):
    make, message = bag
    kind = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("pressure", "<f4"), ("id", "<u4")])
    points = np.zeros(5, kind)
    points["x"], points["id"] = np.arange(5) / 100, [7, 3, 9, 1, 5]

    def clouds(fields, orders):
        made = []
        for k, (row, order) in enumerate(zip(ROWS, orders)):
            points["pressure"] = row
            chosen = points[order]
            chosen = np.rec.fromarrays([chosen[name] for name in fields], dtype=[(name, kind[name]) for name in fields])
            about = [message("sensor_msgs/msg/PointField", name=n, offset=chosen.dtype.fields[n][1], datatype=6 if n == "id" else 7, count=1) for n in fields]
            step, data = chosen.dtype.itemsize, np.frombuffer(chosen.tobytes(), np.uint8)
            size = {"height": 1, "width": len(chosen), "point_step": step, "row_step": step * len(chosen)}
            made.append(message("sensor_msgs/msg/PointCloud2", START + k * 10**8, fields=about, is_bigendian=False, data=data, is_dense=True, **size))
        return {"/a": (10**8, made)}

    rng = np.random.default_rng(1)
    mixed = [np.arange(5), *[rng.permutation(5) for _ in range(39)]]
    by_file = {**LAYOUT, "taxels": {"ids": "file"}}
    values = read(make("ids", clouds(list(kind.names), mixed)), layout=by_file)[0]
    assert np.array_equal(values, ROWS[:, np.argsort(points["id"])])
    refuse(make("none", clouds(["x", "y", "z", "pressure"], mixed)), "in another order, without ids")
    lacking = [np.arange(5), *[order if k != 8 else order[:4] for k, order in enumerate(mixed[1:])]]
    path = make("lacking", clouds(list(kind.names), lacking))
    values, recording = read(path, layout=by_file)
    assert np.isnan(values).sum() == np.isnan(values[9]).sum() == 1 and any("lack some ids" in value for _, value, _ in recording.statements)

    grid = {**LAYOUT, "axes": ["frame", "row", "col"], "taxels": {"shape": [2, 2], "first_id": 1}}
    about = {"height": 2, "width": 2, "encoding": "mono16", "is_bigendian": 1}
    data = [np.pad(row[:4].astype(">u2").reshape(2, 2).view(np.uint8), ((0, 0), (0, 3)), constant_values=255) for row in ROWS]
    images = [message("sensor_msgs/msg/Image", START + k * 10**8, step=7, data=np.ascontiguousarray(each).ravel(), **about) for k, each in enumerate(data)]
    assert np.array_equal(read(make("padded", {"/a": (10**8, images)}), layout=grid)[0], ROWS[:, :4])
    images[5].step = 3
    refuse(make("step", {"/a": (10**8, images)}), "message 5 of /a: image: found 14 bytes in rows of 3", layout=grid)


def test_bags_of_arrays(bag):
    make, message = bag

    def arrays(sizes, strides, offset=0, labels=("row", "col")):
        dims = [message("std_msgs/msg/MultiArrayDimension", label=label, size=size, stride=stride) for label, size, stride in zip(labels, sizes, strides)]
        about = message("std_msgs/msg/MultiArrayLayout", dim=dims, data_offset=offset)
        data = [np.append(np.full(offset, 77), row[:4]).astype(np.float32) for row in ROWS]
        return {"/a": (10**8, [message("std_msgs/msg/Float32MultiArray", layout=about, data=each) for each in data])}

    grid = {**LAYOUT, "axes": ["frame", "row", "col"], "taxels": {"shape": [2, 2], "first_id": 1}}
    for name, sizes, strides, offset in (("right", [2, 2], [4, 2], 0), ("bytes", [2, 2], [16, 8], 0), ("offset", [2, 2], [4, 2], 3)):
        assert np.array_equal(read(make(name, arrays(sizes, strides, offset)), layout=grid)[0], ROWS[:, :4]), name
    refuse(make("more", arrays([2, 3], [6, 3])), "needed: 2 x 3", layout=grid)
    refuse(make("axes", arrays([2, 2], [4, 2], labels=("col", "row"))), "col", layout=grid)


def test_a_bag_that_is_cut(bag, tmp_path):
    make, message = bag
    path = make("a", {"/a": (10**8, pressures(message, [START] * 40))})
    file = next(path.glob("*.db3"))
    file.write_bytes(file.read_bytes()[:5000])
    with pytest.raises(dermatome.Error, match="bag|message"):
        read(path)
    (tmp_path / "b.mcap").write_bytes(b"\x89MCAP0\r\n" + b"\x01" + (10**6).to_bytes(8, "little"))
    refuse(tmp_path / "b.mcap", "no bag|MCAP")


BOMB = """
import resource, sys
import dermatome
from dermatome import Readings
import numcodecs, h5py, pyarrow.parquet

before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for path in sys.argv[1:]:
    try:
        recording = Readings.open(path, stream="tactile")
        for _ in recording.raw():
            pass
        print("read", path)
    except dermatome.Error:
        pass
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
"""


def test_lies_take_no_memory(tmp_path):
    for need in ("numcodecs", "h5py", "pyarrow"):
        pytest.importorskip(need)
    from numcodecs import get_codec

    paths = [zarr_file(tmp_path / "deflated.zip", {CHUNK: b"\0" * (1 << 29)})]
    for codec in (BLOSC, {"id": "zstd", "level": 3}, {"id": "gzip", "level": 9}):
        huge = bytes(get_codec(codec).encode(np.zeros(1 << 29, np.uint8)))
        paths.append(zarr_file(tmp_path / f"{codec['id']}.zip", {CHUNK: huge}, codec=codec))
    paths.append(zarr_file(tmp_path / "shape.zip", {ZARRAY: about([10**15, 5], [10, 5])}))
    said = subprocess.run([sys.executable, "-c", BOMB, *map(str, paths)], capture_output=True, text=True)
    assert said.returncode == 0 and int(said.stdout) < 100, said.stdout + said.stderr


def test_a_missing_package_is_named(tmp_path, monkeypatch):
    import importlib

    real = importlib.import_module

    def missing(name, *rest):
        if name.split(".")[0] in ("h5py", "pyarrow", "numcodecs", "rosbags", "mcap"):
            raise ModuleNotFoundError(name)
        return real(name, *rest)

    paths = {"hdf5": tmp_path / "a.h5", "zarr": zarr_file(tmp_path / "a.zip", codec=BLOSC), "ros": tmp_path / "bag", "parquet": tmp_path / "robot"}
    paths["hdf5"].write_bytes(b"\x89HDF\r\n\x1a\n")
    for folder, name in ((tmp_path / "bag", "metadata.yaml"), (tmp_path / "robot/meta", "info.json")):
        folder.mkdir(parents=True)
        (folder / name).write_text('{"codebase_version": "v3.0", "fps": 1, "features": {}, "total_frames": 0}')
    monkeypatch.setattr(importlib, "import_module", missing)
    for extra, path in paths.items():
        with pytest.raises(ImportError, match=rf"dermatome\[{extra}\]"):
            read(path)


def test_episodes_of_an_array_and_pointers(tmp_path):
    trials = np.stack([ROWS[:20], ROWS[20:]])
    np.save(tmp_path / "trials.npy", trials)
    layout = {**LAYOUT, "axes": ["episode", "frame", "taxel"]}
    recording = Readings.open(tmp_path / "trials.npy", layout=layout)
    parts = list(recording.chunks(frames=15))
    assert [(part.episode, len(part)) for part in parts] == [(0, 15), (0, 5), (1, 15), (1, 5)] and recording.episodes == (20, 20)
    assert np.array_equal(np.concatenate([part.values[:, 0] for part in parts]), ROWS) and parts[2].timestamps[0] == 0
    second = Readings.open(tmp_path / "trials.npy", layout=layout, episode=1)
    assert np.array_equal(second.read().values[:, 0], ROWS[20:])
    with pytest.raises(dermatome.Error, match="episode: found 2; needed: 0 to 1"):
        Readings.open(tmp_path / "trials.npy", layout=layout, episode=2)
    with pytest.raises(dermatome.Error, match="episode: found 1; needed: 0"):
        Readings.open(tmp_path / "trials.npy", layout={**LAYOUT, "axes": ["frame", "a", "taxel"]}, episode=1)
    pointer = tmp_path / "a.h5"
    pointer.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12\n")
    refuse(pointer, "a pointer of Git LFS")


def test_stamps_of_foxglove(tmp_path):
    writer, adapter = pytest.importorskip("mcap.writer"), pytest.importorskip("dermatome.ros")

    def write(name, stamp):
        with open(tmp_path / name, "wb") as file:
            to = writer.Writer(file)
            to.start("", "")
            schema = to.register_schema("Pressure", "jsonschema", b"{}")
            channel = to.register_channel("/skin", "json", schema)
            for k, row in enumerate(ROWS):
                message = {"header": {"stamp": stamp(k)}, "pressure": row.tolist()}
                to.add_message(channel, 10**18 + k, json.dumps(message).encode(), 10**18 + k)
            to.finish()
        return tmp_path / name

    path = write("a.mcap", lambda k: {"sec": 5, "nsec": k * 10**7})
    got = Readings.open(path, layout=HEADER_TIME).read()
    flat = dermatome.build(dermatome.Skin.from_arrays([[0.005 * (k % 5), 0.005 * (k // 5), 0] for k in range(10)]))
    ids = flat.ids[:5]
    alone = adapter.read(path, "/skin", flat, values="pressure", ids=ids)
    assert np.array_equal(alone.values[:, 0, :5], ROWS) and np.allclose(alone.timestamps - 5, got.timestamps, rtol=0, atol=1e-12)
    assert np.array_equal(got.values[:, 0], ROWS) and np.allclose(got.timestamps, np.arange(40) / 100, rtol=0, atol=1e-12)
    refuse(write("b.mcap", lambda k: {"secs": 5}), r"message 0 of /skin: found the stamp \[.*'secs'\]; needed: whole numbers", layout=HEADER_TIME)
    with pytest.raises(dermatome.DataError, match=r"message 0 of /skin: found the stamp .*needed: whole numbers"):
        adapter.read(tmp_path / "b.mcap", "/skin", flat, values="pressure", ids=ids)

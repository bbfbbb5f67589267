"""`Readings.open`: recordings of other programs equal their truth, and spoiled ones are refused, stated or read as is right.

The samples and the program that spoils them are in `DERMATOME_DATA/recordings`; tests of them are skipped without it."""

import csv
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import dermatome
from dermatome import Readings

DATA = Path(os.environ.get("DERMATOME_DATA", "")) / "recordings"
samples = pytest.mark.skipif(not (DATA / "truth.json").is_file(), reason="DERMATOME_DATA has no recordings")
PACKAGES = {"oxt": "numcodecs", "lerobot": "pyarrow", "hdf5": "h5py", "ros": "rosbags"}


def layout(name, **changes):
    return {**json.loads((DATA / "layouts" / f"{name}.json").read_text()), **changes}


def opened(path, **options):
    pytest.importorskip(next((need for kind, need in PACKAGES.items() if str(path).startswith(kind)), "numpy"))
    return Readings.open(DATA / path, **options)


def pads(path=""):
    """The frames of the pads; the bags have each fourth one."""
    return np.load(DATA / "numpy/pads.npy")[:: 4 if path.startswith("ros") else 1]


PADS = {"zero": 0}
PAD_STREAM = "observation.tactile.pads"
SAME = [
    ("oxt/pad_pair.zarr.zip", None, (20, 28)),
    ("oxt/pad_v3.zarr.zip", None, (48,)),
    ("lerobot_v3", PAD_STREAM, (16, 24)),
    ("lerobot_v21", PAD_STREAM, (16, 24)),
    ("ros/bag_mcap", "/pads", (12,)),
    ("ros/bag_sqlite", "/pads", (12,)),
    ("ros/bag_mcap/bag_mcap.mcap", "/pads", (12,)),
]


@samples
@pytest.mark.parametrize("path, stream, episodes", SAME)
def test_one_recording_is_the_same_in_every_container(path, stream, episodes):
    recording = opened(path, stream=stream, layout=layout("pad_pair", zero=0))
    assert recording.episodes == episodes
    parts = list(recording.chunks(frames=7))
    assert [part.episode for part in parts] == [k for k, n in enumerate(episodes) for _ in range(-(-n // 7))]
    values = np.concatenate([part.values for part in parts])
    truth = pads(path)[: sum(episodes)].reshape(sum(episodes), 1, -1)
    assert values.dtype == np.float32 and np.array_equal(values, truth)
    for number, frames in enumerate(episodes):
        times = np.concatenate([part.timestamps for part in parts if part.episode == number])
        assert np.allclose(times, np.arange(frames) / 30)
        one = opened(path, stream=stream, layout=layout("pad_pair", zero=0), episode=number).read()
        assert np.array_equal(one.values, truth[sum(episodes[:number]) :][:frames]) and one.episode == number
    whole = recording.read()
    assert np.array_equal(whole.values, truth) and whole.channels == ("pressure",) and whole.units == ("count",)
    assert any("one after the other" in remark for remark in whole.remarks) == (len(episodes) > 1)
    raw = np.concatenate([values for _, values in recording.raw(5)])
    assert np.array_equal(raw, truth.reshape(raw.shape))
    with pytest.raises(dermatome.DataError, match=f"episode={len(episodes)}; needed: 0 to {len(episodes) - 1}|a bag is one episode"):
        list(opened(path, stream=stream, layout=layout("pad_pair"), episode=len(episodes)).chunks())


@samples
def test_row_groups_of_any_length_give_the_same(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    how = {"stream": PAD_STREAM, "layout": layout("pad_pair")}
    for path in (path for path in (DATA / "lerobot_v3").rglob("*") if path.is_file()):
        copy = tmp_path / path.relative_to(DATA)
        copy.parent.mkdir(parents=True, exist_ok=True)
        if path.parts[-3] == "data":
            parquet.write_table(parquet.read_table(path), copy, row_group_size=7)
        else:
            copy.write_bytes(path.read_bytes())
    assert np.array_equal(opened(tmp_path / "lerobot_v3", **how).read().values, opened("lerobot_v3", **how).read().values)


def test_an_episode_of_a_long_store_is_found_at_once(tmp_path):
    """What an episode costs does not grow with their number: this took 3.7 s for one of 26,000."""
    ends = np.arange(1, 20_001, dtype="<i8") * 3
    values = np.arange(ends[-1] * 4, dtype="<f4").reshape(-1, 4)
    for name, array, chunk in (("data/tactile", values, 30), ("meta/episode_ends", ends, len(ends))):
        folder = tmp_path / "long.zarr" / name
        folder.mkdir(parents=True)
        about = {"zarr_format": 2, "compressor": None, "fill_value": 0, "order": "C", "filters": None, "dtype": array.dtype.str}
        (folder / ".zarray").write_text(json.dumps({**about, "shape": array.shape, "chunks": [chunk, *array.shape[1:]]}))
        for k in range(len(array) // chunk):
            part = array[k * chunk : (k + 1) * chunk]
            (folder / ".".join([str(k), *["0"] * (array.ndim - 1)])).write_bytes(part.tobytes())
    (tmp_path / "long.zarr" / ".zgroup").write_text('{"zarr_format": 2}')
    about = {"dermatome_layout": 1, "axes": ["frame", "taxel"], "time": {"rate": 50}, "press": "raises", "zero": 0}
    about |= {"channels": [{"name": "force", "unit": "N"}], "taxels": {"shape": [4]}}
    recording = Readings.open(tmp_path / "long.zarr", stream="tactile", layout=about)
    assert len(recording.episodes) == 20_000
    began = time.process_time()
    for number in range(0, 20_000, 200):
        recording.episode = number
        (part,) = recording.chunks()
        assert np.array_equal(part.values[:, 0], values[3 * number :][:3]) and np.allclose(part.timestamps, [0, 0.02, 0.04])
    assert time.process_time() - began < 10, "100 episodes"


@samples
@pytest.mark.parametrize("rows", [7, 16, 40])
def test_one_episode_is_the_same_whatever_the_row_groups(rows, tmp_path):
    """Groups before it are left out, also where it begins within one."""
    parquet = pytest.importorskip("pyarrow.parquet")
    truth, numbers = pads(), (16, 24)
    for path in (path for path in (DATA / "lerobot_v3").rglob("*") if path.is_file()):
        copy = tmp_path / path.relative_to(DATA)
        copy.parent.mkdir(parents=True, exist_ok=True)
        if path.parts[-3] == "data":
            parquet.write_table(parquet.read_table(path), copy, row_group_size=rows)
        else:
            copy.write_bytes(path.read_bytes())
    recording = opened(tmp_path / "lerobot_v3", stream=PAD_STREAM, layout=layout("pad_pair", zero=0))
    for number, frames in enumerate(numbers):
        recording.episode = number
        whole = np.concatenate([part.values for part in recording.chunks(frames=5)])
        assert np.array_equal(whole[:, 0], truth[sum(numbers[:number]) :][:frames].reshape(frames, -1))


@samples
def test_samples_equal_their_truth():
    truth = json.loads((DATA / "truth.json").read_text())
    glove = opened("hdf5/opentouch_like.hdf5", layout=DATA / "layouts/opentouch.json")
    about = truth["hdf5/opentouch_like.hdf5"]
    values = glove.read().values[:, 0]
    assert values.shape == (40, about["valid_cells"]) and glove.episodes == (25, 15)
    assert values[0, 0] == 3072 - about["cell_0_0"] and values.max() == 3072 - about["deepest"][0]
    assert np.unravel_index(values.argmax(), values.shape)[0] == about["deepest"][1][0]
    skin = opened("hdf5/dexskin_like.hdf5", layout=DATA / "layouts/dexskin.json").read()
    assert skin.values.shape == (80, 1, 120) and abs(skin.values.max() - truth["hdf5/dexskin_like.hdf5"]["max"]) < 1e-4
    hand = {"axes": ["frame", "taxel", "component"], "time": {"rate": 30}, "press": "raises", "zero": 0, "taxels": {"shape": [320]}}
    hand |= {"dermatome_layout": 1, "channels": [{"name": "pressure", "unit": "count", "component": 3}]}
    recording = opened("hdf5/humantouch_like.hdf5", layout=hand)
    raw = np.concatenate([values for _, values in recording.raw()])
    assert raw.shape == (20, 320, 4)
    read = recording.read().values[:, 0]
    assert np.array_equal(read, np.where(np.isnan(read), np.nan, raw[:, :, 3]), equal_nan=True)
    aether = truth["oxt/aether_glove.zarr.zip"]
    fingers = {"axes": ["frame", "finger", "taxel"], "time": {"stream": "timestamps", "unit": "s"}, "taxels": {"shape": [5, 12]}, "press": "raises"}
    fingers |= {"dermatome_layout": 1, "channels": [{"name": "pressure", "unit": "count"}], "zero": 0}
    made = opened("oxt/aether_glove.zarr.zip", stream="left_tactile_data_fingers", layout=fingers)
    assert made.says["area"] == aether["areas"]["fingers"]
    read = made.read()
    assert np.allclose(read.values[0, 0, :4], aether["value_left_fingers_0_0"], atol=1e-6)
    assert np.allclose(np.diff(read.timestamps), 0.1) and read.timestamps[0] > 1.7e9
    touch = opened("oxt/touch_880.zarr.zip", layout=DATA / "layouts/oxt_glove880.json").read()
    assert touch.values.shape == (12, 3, 880) and touch.extensive == (True, True, True)
    for path in ("lerobot_v3", "lerobot_v21"):
        glove = opened(path, stream="observation.tactile.glove", layout=DATA / "layouts/glove256.json").read()
        first = truth[path]["observation.tactile.glove"]["frame0_sum"]
        assert glove.values.shape == (40, 1, 256) and abs(glove.values[0].sum() + first) < 1e-2
    beside = layout("glove256", zero={"stream": "observation.tactile.glove.baseline"})
    lowered = opened("lerobot_v3", stream="observation.tactile.glove", layout=beside).read()
    assert np.allclose(lowered.values, glove.values + 3072, atol=1e-3)


FORCE = [{"name": f"force.{axis}", "unit": "N", "component": k, "signed": True} for k, axis in enumerate("xyz")]


def of_taxels(count, **changes):
    """A layout of a list of taxels, with the stamps of headers."""
    made = {"dermatome_layout": 1, "axes": ["frame", "taxel"], "time": {"stream": "header", "unit": "ns"}, "press": "raises", "zero": 0}
    return {**made, "channels": [{"name": "pressure", "unit": "count"}], "taxels": {"shape": [count], "first_id": 1}, **changes}


@samples
@pytest.mark.parametrize("bag", ["ros/bag_mcap", "ros/bag_sqlite"])
def test_messages_of_every_type(bag):
    streams = opened(bag).streams
    assert streams == {
        "/pads": (12, 2, 12, 32), "/pad_image": (12, 12, 32), "/pad_mono16": (12, 12, 32), "/skin_points": (12, 169),
        "/wrist": (12, 1, 6), "/skin.thumb": (12, 12), "/skin.index": (12, 16), "/airskin.pressures": (12, 3),
    }  # fmt: skip
    image = of_taxels(0, axes=["frame", "row", "col"], taxels={"shape": [12, 32], "first_id": 1})
    for topic in ("/pad_image", "/pad_mono16"):
        read = opened(bag, stream=topic, layout=image).read()
        assert np.array_equal(read.values[:, 0], pads(bag)[:12, 0].reshape(12, -1)), topic
        assert np.allclose(read.timestamps, 0.033 * np.arange(12), atol=1e-9)
    for unit in ("s", "ms", "us"):
        times = opened(bag, stream="/pad_image", layout={**image, "time": {"stream": "header", "unit": unit}}).read().timestamps
        assert np.allclose(times, 0.033 * np.arange(12), atol=1e-9)
    points = opened(bag, stream="/skin_points", layout=of_taxels(169, press="lowers", zero=3072, taxels={"ids": "file"}))
    read, cells = points.read(), np.loadtxt(DATA / "layouts/opentouch_cells.csv", delimiter=",", skiprows=1, usecols=2)
    assert np.array_equal(read.ids, cells) and points.skin().n_taxels == 169
    force = of_taxels(1, axes=["frame", "taxel", "component"], channels=FORCE)
    wrist = opened(bag, stream="/wrist", layout=force)
    assert wrist.read().values.shape == (12, 3, 1) and ("unit", "['N', 'N', 'N']", "file") in wrist.statements or wrist.read().units == ("N",) * 3
    with pytest.raises(dermatome.DataError, match="N m|N.m"):
        opened(bag, stream="/wrist.torque", layout=force)
    thumb, both = (opened(bag, stream=name, layout=of_taxels(n)).read().values for name, n in (("/skin.thumb", 12), ("/skin", 28)))
    assert thumb.shape == (12, 1, 12) and np.array_equal(both[:, :, :12], thumb)
    air = opened(bag, stream="/airskin", layout=of_taxels(3, taxels={"ids": "file"})).read()
    assert air.ids.tolist() == [8, 9, 12] and air.values[0, 0].tolist() == [101325, 101300, 101310]
    logged = opened(bag, stream="/pads", layout=layout("pad_pair", time={"stream": "log", "unit": "ns"})).read()
    assert np.allclose(np.diff(logged.timestamps), 0.033)
    with pytest.raises(dermatome.DataError, match="no header.*'log'"):
        opened(bag, stream="/pads", layout=layout("pad_pair", time={"stream": "header", "unit": "ns"})).read()
    with pytest.raises(dermatome.DataError, match="/pads.*needed: stream="):
        opened(bag, layout=of_taxels(3))


@samples
def test_json_in_mcap():
    pytest.importorskip("mcap")
    glove = of_taxels(256, press="lowers", zero=3072, time={"stream": "log", "unit": "ns"})
    read = opened("ros/json.mcap", layout=glove).read()
    assert read.values.shape == (12, 1, 256) and read.values[0, 0, 0] == 3072 - 1572


@samples
def test_files_that_the_library_reads(tmp_path):
    truth = json.loads((DATA / "truth.json").read_text())
    walk = Readings.open(DATA / "vendor/fscan_testL.asf", layout=DATA / "layouts/fscan.json")
    read, about = walk.read(), truth["vendor/fscan_testL.asf"]
    assert len(read) == 20 and read.values.shape[2] == 60 * 21 - about["no_sensor_cells"] == walk.skin().n_taxels
    assert np.nanmax(read.values) == about["max"] and np.allclose(np.diff(read.timestamps), about["dt"])
    forces = np.nansum(read.values[:3, 0], axis=1) * 1e3 * np.prod(about["pitch_mm"]) * 1e-6
    assert np.allclose(forces, about["force_N"], atol=0.1) and ("unit", "kPa", "file") in walk.statements
    mat = dermatome.build(walk.skin())
    parts = list(walk.chunks(mat, frames=8))
    assert [len(part) for part in parts] == [8, 8, 4] and {part.values.shape[2] for part in parts} == {mat.n_taxels}
    rows = Readings.open(DATA / "numpy/pads.npy", layout=layout("pad_pair", zero=0))
    assert np.array_equal(rows.read().values[:, 0], pads().reshape(48, -1)) and len(rows.episodes) in (0, 1)
    finger = Readings.open(DATA / "xela/xr1944.jsonl", layout=DATA / "layouts/xela_xr1944.json").read()
    assert finger.values.shape == (30, 3, 16) and finger.channels == ("shear.x", "shear.y", "normal")
    assert np.allclose(np.diff(finger.values[10:, 2, 5], axis=0).mean(), 40, atol=5)
    np.save(tmp_path / "a.npy", np.arange(24.0).reshape(2, 4, 3))
    words = [Readings.open(tmp_path / "a.npy", layout=axes).read().values for axes in ("tnc", "tcn")]
    assert np.array_equal(np.moveaxis(words[0], 1, 2), words[1])
    with pytest.raises(dermatome.DataError, match="episode=1"):
        Readings.open(tmp_path / "a.npy", layout="tnc", episode=1)
    with pytest.raises(dermatome.DataError, match="'tnc'"):
        opened("oxt/pad_pair.zarr.zip", layout="tnc")


@samples
def test_drafts_of_layouts(tmp_path):
    from dermatome import Layout

    for path, stream, axes in (("oxt/pad_pair.zarr.zip", None, 4), ("lerobot_v3", PAD_STREAM, 4), ("hdf5/opentouch_like.hdf5", "data/*/right_pressure", 3)):
        draft = Layout.draft(opened(path, stream=stream))
        draft.write(tmp_path / "draft.json")
        made = json.loads((tmp_path / "draft.json").read_text())
        assert len(made["axes"]) == axes and made["press"] is None and made["zero"] is None
        with pytest.raises(dermatome.DataError, match="draft.json.*null"):
            Readings.open(DATA / path, layout=tmp_path / "draft.json")
    array = Readings.open(DATA / "numpy/pads.npy")
    assert json.loads(Layout.draft(array))["press"] is None
    with pytest.raises(dermatome.DataError, match="cells: found none"):
        Layout.draft("a.npy")
    with pytest.raises(dermatome.DataError, match="pads.npy"):
        array.read()


@samples
def test_spoiled_files_are_refused_stated_or_read(tmp_path):
    for need in ("h5py", "zarr", "pyarrow", "numcodecs"):
        pytest.importorskip(need)
    subprocess.run([sys.executable, DATA / "spoil.py", tmp_path], check=True, capture_output=True)
    rows = list(csv.DictReader((tmp_path / "spoiled.csv").open()))
    assert len(rows) == 50
    plain = {}
    for row in rows:
        wanted = {"stream": row["stream"] or None, "layout": DATA / row["layout"] if row["layout"] else None}
        found, text, said = "read", "", []
        try:
            recording = Readings.open(tmp_path / row["file"], **wanted)
            values = np.concatenate([part.values for part in recording.chunks()])
            said = recording.statements
            if (row["base"], row["stream"]) not in plain and row["right"] != "refuse":
                good = Readings.open(DATA / row["base"], **wanted)
                plain[row["base"], row["stream"]] = (np.concatenate([part.values for part in good.chunks()]), good.statements)
            good, known = plain[row["base"], row["stream"]]
            same = np.isnan(values) | (values == good)
            assert same.all() and np.isnan(values).mean() < 0.2, row
            if set(said) != set(known):
                found = "state"
        except dermatome.Error as error:
            found, text = "refuse", str(error)
            assert "found" in text and "needed" in text, row
            assert any(name in text for name in (Path(row["file"]).name, Path(row["layout"]).name)), (row, text)
        assert found == row["right"], (row, said, text)


@samples
def test_readings_go_to_images_fields_and_areas(tmp_path):
    positions = [[0.004 * c, 0.004 * r, 0.15 * p] for p in range(2) for r in range(12) for c in range(32)]
    pair = dermatome.build(dermatome.Skin.from_arrays(positions))
    recording = opened("oxt/pad_pair.zarr.zip", layout=layout("pad_pair", zero=0))
    read = recording.read(pair)
    assert read.ids is None and np.array_equal(read.values[:, 0], pads().reshape(48, -1))
    patches = list(pair.patches)
    for name in ("o.zarr", "o.zarr.zip"):
        recording.write_oxt(tmp_path / name, pair, 1, areas=dict(zip(patches, (0, 1))))
        back = Readings.open(tmp_path / name)
        (stream,) = back.streams
        assert stream == "right_tactile_data_map" and back.says == {"area": [0, 1], "sensor": "dermatome", "type": "matrix"}
        assert back.episodes == (20, 28) and not [p for p in tmp_path.iterdir() if p.name.endswith(".part")]
        images = np.concatenate([values for _, values in back.raw()])
        for k, patch in enumerate(patches):
            pixel = max(max(pair.renderer(1, patch=each).pixel) for each in patches)
            renderer = pair.renderer(1, patch=patch, pixel=pixel)
            drawn = renderer(read.values)[:, 0]
            height, width = renderer.shape
            assert np.array_equal(images[:, k, :height, :width], np.where(renderer.mask, drawn, 0))
        zarr = pytest.importorskip("zarr")
        group = zarr.open_group(str(tmp_path / "o.zarr"), mode="r")
        assert np.array_equal(group["data/right_tactile_data_map"][:], images)
        assert group["meta/episode_ends"][:].tolist() == [20, 48]
    with pytest.raises(dermatome.FileError, match="o.zarr: found a file or folder"):
        recording.write_oxt(tmp_path / "o.zarr", pair, areas={patches[0]: 0})
    for areas in ({patches[0]: 24}, {"palm": 5}, {}):
        with pytest.raises(dermatome.DataError, match="area|patch"):
            recording.write_oxt(tmp_path / "p.zarr", pair, areas=areas)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["o.zarr", "o.zarr.zip"]


@samples
@pytest.mark.parametrize("name, force, impulse", [("fscan_testL", 909.7, 442.2), ("footpress_left", 924.4, 2591.6)])
def test_a_walk_has_the_force_of_its_cells(name, force, impulse):
    """Without an option, also where a recording begins under load."""
    path = DATA / f"vendor/{name}.asf"
    mat = dermatome.build(dermatome.Skin.read(path))
    for readings in (Readings.read(path, mat), opened(f"vendor/{name}.asf").read(mat)):
        whole = readings.summary(mat)[0]
        assert abs(whole["force_peak"] - force) < 0.05 and abs(whole["impulse"] - impulse) < 0.05
        forces = np.nansum(readings.values[:, 0], axis=1) * 1e3 * 5.08e-3**2
        assert whole["force_peak"] == pytest.approx(forces.max(), rel=1e-6)
        assert whole["impulse"] == pytest.approx(((forces[1:] + forces[:-1]) / 2 * np.diff(readings.timestamps)).sum(), rel=1e-6)


@samples
def test_the_command_draws_a_container(tmp_path):
    positions = [[0.004 * c, 0.004 * r, 0.15 * p] for p in range(2) for r in range(12) for c in range(32)]
    pair = dermatome.build(dermatome.Skin.from_arrays(positions))
    pair.write(tmp_path / "map.glb")

    def command(*args):
        line = [sys.executable, "-m", "dermatome", *map(str, args)]
        return subprocess.run(line, capture_output=True, text=True, cwd=tmp_path)

    pytest.importorskip("numcodecs")
    path, given = DATA / "oxt/pad_pair.zarr.zip", ["--layout", DATA / "layouts/pad_pair.json"]
    said = command("render", "map.glb", path, *given, "-o", "o.npz", "--json", "--values-only", "--level", 0)
    assert said.returncode == 0 and "2 episodes" in said.stderr, said.stderr
    report = json.loads(said.stdout)
    assert report["frames"] == 48 and report["matched"] == 768 and "layout" in [each["source"] for each in report["statements"] if each["what"] == "press"]
    read = Readings.open(path, layout=DATA / "layouts/pad_pair.json").read(pair)
    made = np.load(tmp_path / "o.npz")
    drawn = np.concatenate([made[f"{name}.L0.values"] for name in pair.patches], axis=2)
    assert np.allclose(drawn, read.values, atol=1e-6) and made["units"].tolist() == ["count"]
    assert made["episode"].tolist() == [0] * 20 + [1] * 28
    assert command("render", "map.glb", path, *given, "-o", "p.npz", "--episode", 1, "--zero", "first=2").returncode == 0
    assert np.load(tmp_path / "p.npz")["timestamps"].shape == (28,)
    assert command("--color", "never", "--quiet", "render", "map.glb", path, *given, "-o", "r.npz").stderr == "" and (tmp_path / "r.npz").exists()
    for wrong, match in ((["--episode", 7], "0 to 1"), (["--episode", "x"], "--episode")):
        said = command("render", "map.glb", path, *given, "-o", "q.npz", *wrong)
        assert said.returncode == 2 and match in said.stderr and not (tmp_path / "q.npz").exists()
    said = command("render", "map.glb", path, "-o", "q.npz")
    assert said.returncode == 2 and "layout" in said.stderr
    assert command("layout", path, "-o", "draft.json").returncode == 0
    with pytest.raises(dermatome.DataError, match="draft.json"):
        Readings.open(path, layout=tmp_path / "draft.json")


def test_layout_of_a_container_has_the_options_of_the_command(tmp_path):
    """Its recording is never replaced, `-` is standard output, and options are those of other recordings."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "rec.h5", "w") as file:
        file["tactile"], file["camera"] = np.ones((3, 4)), np.ones((3, 8))

    def command(*args):
        return subprocess.run([sys.executable, "-m", "dermatome", *args], capture_output=True, text=True, cwd=tmp_path)

    before = (tmp_path / "rec.h5").read_bytes()
    for output in ("rec.h5", "./rec.h5"):
        said = command("layout", "rec.h5", "-o", output)
        assert said.returncode == 2 and "rec.h5" in said.stderr and (tmp_path / "rec.h5").read_bytes() == before
    drafts = [command("layout", "rec.h5", *more).stdout for more in ((), ("-o", "-"), ("--threads", "1", "-q"), ("--stream=tactile",))]
    assert all(json.loads(draft)["stream"] == "tactile" for draft in drafts) and len(set(drafts)) == 1
    for k, more in enumerate((["-o"], ["--output"])):
        assert command("layout", "rec.h5", *more, f"{k}.json", "--stream", "camera").returncode == 0
    said = command("-q", "layout", "rec.h5", "--output=2.json", "--stream", "camera")
    assert said.returncode == 0 and not said.stderr
    assert len({(tmp_path / f"{k}.json").read_text() for k in range(3)}) == 1 and json.loads((tmp_path / "2.json").read_text())["stream"] == "camera"
    said = command("layout", "rec.h5", "--stream", "foot")
    assert said.returncode == 2 and "needed: one of" in said.stderr
    assert sorted(each.name for each in tmp_path.iterdir()) == ["0.json", "1.json", "2.json", "rec.h5"]


def test_the_border_of_an_episode_resets_everything(tmp_path):
    """Every command reads a container, and its episodes together are what each is by itself, also where one ends in contact."""
    h5py = pytest.importorskip("h5py")
    map = dermatome.build(dermatome.Skin.from_arrays([[0.004 * c, 0.004 * r, 0] for r in range(9) for c in range(16)]))
    map.write(tmp_path / "map.glb")
    rng = np.random.default_rng(3)
    with h5py.File(tmp_path / "two.h5", "w") as file:
        for number, pressed in enumerate((slice(70, 100), slice(30, 60))):
            values = np.round(rng.normal(0, 0.02, (100, 144)), 4) + 5 * number
            values[pressed, 60:64] += 2
            group = file.create_group(f"data/demo_{number}")
            group["tactile"], group["timestamps"] = values, np.arange(100) / 20
    channel = {"name": "force", "unit": "N"}
    stated = {"axes": ["frame", "taxel"], "time": {"stream": "timestamps", "unit": "s"}, "stream": "data/demo_*/tactile"}
    about = {"dermatome_layout": 1, **stated, "channels": [channel], "press": "raises", "zero": 0, "taxels": {"shape": [144], "first_id": 1}}
    (tmp_path / "l.json").write_text(json.dumps(about))

    def command(*args, codes=(0,)):
        line = [sys.executable, "-m", "dermatome", *(str(each) for each in args)]
        said = subprocess.run(line, capture_output=True, text=True, cwd=tmp_path)
        assert said.returncode in codes, said.stderr
        return said.stdout + said.stderr

    def rows(name):
        with open(tmp_path / name, newline="") as file:
            return list(csv.DictReader(file))

    given = ["map.glb", "two.h5", "--layout", "l.json", "--zero", "follow"]
    made = {}
    for episode in (None, 0, 1):
        chosen = given if episode is None else [*given, "--episode", episode]
        command("summary", *chosen, "--threshold", 0.5, "-o", "s.csv", "--over-time", "t.csv")
        command("render", *chosen, "--threshold", 0.5, "-o", "v.npz", "--values-only", "--contacts", "c.csv", "--events", "e.jsonl")
        events = [json.loads(line) for line in (tmp_path / "e.jsonl").read_text().splitlines()]
        made[episode] = [rows("s.csv"), rows("t.csv"), rows("c.csv"), events]
    for all_of_it, *parts in zip(*(made[episode] for episode in (None, 0, 1))):
        assert all(parts), "each episode has rows"
        numbered = [{"episode": str(number), **row} for number, part in enumerate(parts) for row in part]
        plain = [{key: str(value) for key, value in row.items() if key != "frame"} for row in numbered]
        assert [{key: str(value) for key, value in row.items() if key != "frame"} for row in all_of_it] == plain
    assert "gap" not in [event["event"] for event in made[None][3]]
    assert "--episode" in command("report", *given, "-o", "r.html", codes=(2,))
    command("report", *given, "--episode", 1, "-o", "r.html")
    command("plot", "map.glb", "--readings", "two.h5", "--layout", "l.json", "--frame", 50, "-o", "p.svg")
    # Whether taxels are accused is another matter.
    assert "; 200 frames, touches" in command("check", "map.glb", "--recording", "two.h5", "--layout", "l.json", codes=(0, 1))
    assert "cannot read two.h5" in command("summary", *given, "--episode", 7, "-o", "s.csv", codes=(2,))


@samples
def test_a_copy_of_a_dataset_has_fields(tmp_path):
    pytest.importorskip("lerobot")
    positions = [[0.004 * c, 0.004 * r, 0.15 * p] for p in range(2) for r in range(12) for c in range(32)]
    pair = dermatome.build(dermatome.Skin.from_arrays(positions))
    recording = opened("lerobot_v3", stream=PAD_STREAM, layout=layout("pad_pair", zero=0))
    recording.write_lerobot(tmp_path / "more", pair, level=1)
    fields = recording.read(pair).pooled(pair, 1)[:, 0]
    start = 0
    for name in dermatome.lerobot.features(pair, 1):
        if not name.endswith(".valid"):
            values = np.concatenate([values for _, values in Readings.open(tmp_path / "more", stream=name).raw()])
            assert np.array_equal(values, fields[:, start : start + values.shape[1]])
            start += values.shape[1]
    assert start == fields.shape[1]


def test_areas_of_a_hand(dome_map):
    from dermatome.recordings import AREAS

    assert len(AREAS) == 24 and (AREAS[0], AREAS[5], AREAS[6], AREAS[11], AREAS[20]) == (
        "tip of thumb", "palm", "base of thumb", "base of index", "torque of little",
    )  # fmt: skip
    values = np.random.default_rng(0).random((3, 2, 256)).astype(np.float32)
    values[1, :, :128] = np.nan
    values[2, 0, 5] = np.nan
    numbers = np.where(np.arange(256) < 128, 0, 5)
    numbers[200:] = -1
    readings = dermatome.Readings(values, None, np.arange(3.0), ("force", "pressure"), ("N", "Pa"))
    made, weights = readings.by_area(dome_map, numbers), dome_map.patches["dome"].levels[0].areas
    assert made.shape == (3, 2, 24) and np.isnan(made[1, :, 0]).all() and np.isnan(made[:, :, [1, 6, 23]]).all()
    assert np.allclose(made[:, 0, 5], values[:, 0, 128:200].sum(axis=1))
    assert np.allclose(made[:, 1, 5], values[:, 1, 128:200] @ weights[128:200] / weights[128:200].sum())
    assert np.isclose(made[2, 0, 0], np.nansum(values[2, 0, :128]))
    whole = readings.by_area(dome_map, {"dome": 5})[:, :, 5]
    assert np.allclose(whole[0, 0], readings.pooled(dome_map, dome_map.n_levels - 1)[0, 0].sum(), rtol=1e-5)
    for wrong in ({"palm": 5}, {"dome": 24}, np.zeros(3, int), np.zeros(256)):
        with pytest.raises(dermatome.DataError, match="areas: found"):
            readings.by_area(dome_map, wrong)

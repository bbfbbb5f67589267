"""What every adapter keeps, on one uneven skin: forces, places on maps, times, and who is touched."""

import copy
import csv
import json
import pickle
import subprocess
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from conftest import lattice

import dermatome


@pytest.fixture
def forces(rough_map, rough_readings):
    """The forces on the skin in each frame, in N."""
    return np.nansum(rough_readings.values[:, 0, rough_map.present == 1], axis=1)


@pytest.mark.parametrize("level", [0, 1, 2])
def test_forces_in_are_forces_out(level, rough_map, rough_readings, forces, tmp_path):
    level = min(level, rough_map.n_levels - 1)
    values = rough_readings.values
    totals = {"pooled": np.nansum(rough_readings.pooled(rough_map, level)[:, 0], axis=1)}
    features = rough_readings.features(rough_map, level)
    kept = [feature["values"].reshape(6, 3, -1)[:, 0] for feature in features.values()]
    totals["features"] = sum(part.sum(axis=1) for part in kept)
    for name, options in {"tight": {"pack": "tight"}, "body": {"pack": "body", "size": (60, 90)}, "fill": {"pack": True, "fill": 0.0}}.items():
        draw = rough_map.renderer(level, extensive=rough_readings.extensive, **options)
        assert draw.extensive == (True, False, False)
        images = draw(values)[:, 0]
        totals[name] = np.nansum(images, axis=(1, 2)) * draw.pixel[0] * draw.pixel[1]
        matrix = draw.matrix().scipy()
        whole = rough_map.pool(np.nan_to_num(values[:, 0]), level, extensive=True)
        whole[:, ~np.isfinite(whole[0])] = 0
        drawn = (matrix @ whole.T).T.reshape(images.shape)
        assert np.allclose(drawn, np.nan_to_num(draw(np.nan_to_num(values))[:, 0]), rtol=1e-5, atol=1e-3), name
        averages = rough_map.pool(values[:1, 1], level)
        averages[:, ~np.isfinite(averages[0])] = 0
        shown = draw(values[:1])[0, 1]
        assert np.allclose((draw.matrix(1).scipy() @ averages[0])[np.isfinite(shown).ravel()], shown[np.isfinite(shown)], rtol=1e-5)
    for name, total in totals.items():
        assert np.allclose(total, forces, rtol=1e-5), name
    with pytest.raises(dermatome.DataError, match="channel: found 3; needed: a channel from 0 to 2"):
        draw.matrix(3)


@pytest.mark.parametrize("size", [None, (60, 90), (9, 7)])
def test_torch_draws_what_the_renderer_draws(size, rough_map, rough_readings, forces):
    torch = pytest.importorskip("torch")
    from dermatome.torch import Draw, Pool, pixels

    for level in range(rough_map.n_levels):
        for extensive in (True, False):
            values = rough_readings.values[:, 0 if extensive else 1].copy()
            values[3, 100:160] = np.nan
            draw = rough_map.renderer(level, pack="tight", size=size, extensive=extensive)
            images = draw(values)[:, 0]
            module = torch.nn.Sequential(Pool(rough_map, level, extensive=extensive), Draw(draw))
            drawn = module(torch.from_numpy(values)).numpy()
            scale = np.nanmax(images)
            assert np.array_equal(np.isnan(drawn), np.isnan(images)) and np.nanmax(abs(drawn - images)) < 2e-5 * scale
            assert not module.state_dict(), "a checkpoint goes to the same policy on another skin"
            full = torch.from_numpy(np.nan_to_num(rough_map.pool(values[:1], level, extensive=extensive), nan=0.0))
            shown = np.isfinite(images[0])
            assert np.allclose((pixels(draw) @ full.T).numpy().reshape(shown.shape)[shown], images[0][shown], rtol=1e-4)
    with pytest.raises(dermatome.DataError, match="amounts and others that are averages"):
        Draw(rough_map.renderer(0, pack=True, extensive=[True, False]))
    assert Pool(rough_map, 1)(torch.ones(2, 489, dtype=torch.int64)).dtype == torch.get_default_dtype()


def test_labels_of_touches_are_of_their_frames(rough_map):
    pytest.importorskip("torch")
    from dermatome.torch import Touches

    readings, truth = dermatome.touch(rough_map, presses=1, rate=20.0)
    readings = replace(readings, ids=None)  # Two taxels have one id.
    assert Touches(rough_map, readings, truth).contacts["touched"].any()
    with pytest.raises(dermatome.DataError, match=r"truth: found time\[0\] = .* needed: .* s, as the readings have it"):
        Touches(rough_map, readings[3:], truth)


def test_places_on_maps_are_in_their_images(rough_map):
    for patch in rough_map.patches.values():
        for level in patch.levels:
            frame = level.frame
            parts = (level.uv - [frame.x, frame.y]) / [frame.width, frame.height]
            assert ((parts > -1e-9) & (parts < 1 + 1e-9)).all()
            draw = rough_map.renderer(level.number, patch=patch.name)
            assert frame.pixels == draw.shape and draw.charts[0]["frame"] == frame
            assert draw.pixel == pytest.approx((frame.height / frame.pixels[0], frame.width / frame.pixels[1]))
            assert pickle.loads(pickle.dumps(frame)) == frame == copy.deepcopy(frame)


def test_probes_of_genesis_are_on_the_map(rough_map):
    import dermatome.genesis as adapter

    for name, patch in rough_map.patches.items():
        grid = adapter.probes(rough_map, patch=name, grid=(12, 10))
        frame, inside = patch.levels[0].frame, grid["probe_radius"] > 0
        u, v = np.meshgrid(frame.x + (np.arange(10) + 0.5) / 10 * frame.width, frame.y + (1 - (np.arange(12) + 0.5) / 12) * frame.height)
        level = patch.levels[0]
        corners = level.uv[level.uv_faces]
        sides = np.roll(corners, -1, axis=1) - corners
        off = np.stack([u, v], axis=-1)[:, :, None, None] - corners
        cross = sides[..., 0] * off[..., 1] - sides[..., 1] * off[..., 0]
        expected = (cross > 0).all(axis=-1).any(axis=-1)
        assert abs(int(inside.sum()) - int(expected.sum())) <= 6 and inside.sum() > 80, name


def test_textures_of_trimesh_are_in_the_unit_square(rough_map):
    pytest.importorskip("trimesh")
    import dermatome.trimesh as adapter

    for name in rough_map.patches:
        uv = np.asarray(adapter.mesh(rough_map, patch=name).visual.uv)
        assert (uv > -1e-9).all() and (uv < 1 + 1e-9).all() and np.ptp(uv, axis=0).min() > 0.8


def test_times_in_are_times_out(rough_map, rough_readings, tmp_path):
    rough_readings.write(tmp_path / "a.npz")
    ways = {"npz": dermatome.Readings.read(tmp_path / "a.npz", rough_map).timestamps}
    conditioned = rough_readings.condition(rough_map)
    ways |= {"condition": conditioned.timestamps, "slice": rough_readings[:].timestamps, "copy": copy.deepcopy(rough_readings).timestamps}
    without = dermatome.Readings.from_arrays(rough_readings.values[:, :1], units="N")
    try:
        import dermatome.ros as ros

        for name, written in (("bag", rough_readings), ("bag without", without)):
            ros.write(tmp_path / name, rough_map, written, patch="tip of it", topic="/skin")
            tip = dermatome.build(dermatome.Skin.from_arrays(rough_map.patches["tip of it"].levels[0].positions))
            read = ros.read(tmp_path / name, "/skin/points", tip)
            if written is without:
                assert np.isnan(read.timestamps).all() and "the messages have numbers" in read.remarks[0]
            else:
                ways[name] = read.timestamps
    except ImportError:
        pytest.skip("rosbags is not installed")
    for name, times in ways.items():
        assert np.allclose(times, rough_readings.timestamps, atol=1e-9), name


def test_dates_keep_their_nanoseconds():
    for unit in ("s", "ms", "us", "ns"):
        layout = dermatome.Layout.parse(
            '{"dermatome_layout": 1, "axes": ["frame", "taxel"], "time": {"stream": "t", "unit": "%s", "between": [1, 1e6]}, "press": "raises", '
            '"zero": 0, "channels": [{"name": "pressure", "unit": "Pa"}], "taxels": {"shape": [3]}}' % unit
        )
        decoder, dates = layout.decoder("a.npy", (3,)), np.array([0, 400_000, 1_250_001], "datetime64[ns]") + np.timedelta64(1_700_000_000, "s")
        seconds = [decoder.decode(np.zeros((len(part), 3)), part)[1] for part in (dates[:2], dates[2:])]
        assert np.allclose(np.concatenate(seconds), [0, 0.0004, 0.001250001], atol=1e-12), unit


def test_limits_of_pictures_are_in_the_unit_of_the_renderer(rough_map, rough_readings):
    import dermatome.lerobot as adapter

    values = rough_readings.values[0, 0]
    draw = rough_map.renderer(0, pack=True, extensive=True)
    with pytest.raises(dermatome.DataError, match="limit: found none for a renderer of amounts"):
        adapter.frame(rough_map, values, 0, extensive=True, images={"skin": draw})
    largest = float(np.nanmax(draw(values)))
    frame = adapter.frame(rough_map, values, 0, extensive=True, images={"skin": draw}, limit=largest)
    assert len(np.unique(frame["observation.images.skin"])) > 50


def test_shared_ids_name_no_region(rough_map):
    with pytest.raises(dermatome.DataError, match="regions: found 7; needed: the id of one taxel, not of 2"):
        rough_map.with_regions({"tip": [200, 7]})
    assert rough_map.with_regions({"rim": [200, 201]}).regions == ("rim",)


def test_contacts_that_are_not_known_have_no_answer(rough_map):
    index = rough_map.index(reactive=True, fields=True)
    points = rough_map.patches["upper arm"].levels[0].positions[[3, 5, 7]] + [0, 0, 1e-3]
    gaps = points.copy()
    gaps[1, 2] = np.nan
    for find in (index.locate, lambda at: index.reactive(at, 0), lambda at: index.ray(at, [[0, 0, -1.0]] * 3)):
        hits, whole = find(gaps), find(points)
        assert hits.patch.tolist() == [0, -1, 0] == hits.link.tolist() and np.isnan(hits.distance).tolist() == [False, True, False]
        assert (hits.field[1], hits.taxel_id[1], hits.region[1]) == (-1, 4294967295, -1) and np.isnan(hits.uv[1]).all()
        assert np.array_equal(hits.point[[0, 2]], whole.point[[0, 2]]) and hits.fields.indptr.tolist()[1:3] == [hits.fields.indptr[1]] * 2
    assert index.ray(points, [[0, 0, -1], [np.nan, 0, 0], [0, 0, -1]]).patch.tolist() == [0, -1, 0]
    assert np.diff(index.nearest(gaps, 2).indptr).tolist() == np.diff(index.within(gaps, 0.006).indptr).clip(0, 2).tolist() == [2, 0, 2]
    readings, felt = index.readings(gaps, [1.0, 1.0, 1.0])
    assert felt.tolist() == [True, False, True] and np.nansum(readings) == pytest.approx(2)
    with pytest.raises(dermatome.DataError, match=r"points\[0\]: found .*inf.*within 1e12 m, or NaN"):
        index.locate([[np.inf, 0, 0]])


def test_long_calls_release_the_lock(rough_map):
    values = np.ones((40_000, 489))
    by_id = dermatome.build(dermatome.Skin.from_arrays(rough_map.patches["upper arm"].levels[0].positions))
    readings = dermatome.Readings.from_arrays(np.ones((40_000, 369)), ids=by_id.ids, units="N")
    named = rough_map.with_regions({"rim": range(200, 300)})
    draw = rough_map.renderer(0, pack=True, size=(1500, 1500))
    for name, call in {
        "on": lambda: readings.on(by_id),
        "pool_regions": lambda: named.pool_regions(values),
        "matrix": draw.matrix,
    }.items():
        ticks, done = [], threading.Event()

        def tick(ticks=ticks, done=done):
            while not done.is_set():
                ticks.append(time.perf_counter())
                time.sleep(0.001)

        other = threading.Thread(target=tick)
        other.start()
        time.sleep(0.02)
        began = time.perf_counter()
        call()
        took = time.perf_counter() - began
        done.set()
        other.join()
        pause = max(np.diff(ticks))
        assert pause < max(0.1, took / 2), (name, pause, took)


@pytest.mark.parametrize("zero", ["stored", "follow"])
def test_gains_multiply_what_is_above_the_zero(zero, rough_map, tmp_path):
    tip = dermatome.build(dermatome.Skin.from_arrays(rough_map.patches["tip of it"].levels[0].positions))
    (tmp_path / "response.csv").write_text("taxel_id,zero\n" + "".join(f"{taxel},{100 + taxel}\n" for taxel in tip.ids))
    rng = np.random.default_rng(2)
    readings = dermatome.Readings.from_arrays(100 + tip.ids + rng.random((30, 120)), timestamps=np.arange(30) / 10, channels="pressure", units="count")
    gain = 1 + rng.random(120)
    how = {"zero": zero, "response": dermatome.Response.read(tmp_path / "response.csv")}
    made = readings.condition(tip, gain=gain, **how)
    assert np.array_equal(made.values, readings.condition(tip, gain=dict(zip(tip.ids.tolist(), gain)), **how).values, equal_nan=True)
    if zero == "stored":
        assert np.allclose(made.values[:, 0], gain * (readings.values[:, 0] - 100 - tip.ids))
    with pytest.raises(dermatome.DataError, match="gain: found several for taxel"):
        rough_map_readings = dermatome.Readings.from_arrays(np.ones((3, 489)), timestamps=[0, 1, 2])
        rough_map_readings.condition(rough_map, gain=np.arange(489.0), zero="follow")


# ---- Recordings: what must not matter, through every container

STAMPS = {"even": np.arange(240) / 25, "paused": np.arange(240) / 25 + np.where(np.arange(240) < 130, 0, 4.0)}


@pytest.fixture(scope="module")
def pressed(tmp_path_factory):
    """A map like the rough one, with ids that no two taxels share and that are not in order, and five presses on it with noise,
    next to a temperature and a shear. All numbers are those of 32 bits."""
    folder = tmp_path_factory.mktemp("pressed")
    present = np.ones(369, dtype=bool)
    present[50] = False
    ids = np.random.default_rng(4).permutation(np.arange(1000, 1489))
    arm = dermatome.Skin.from_arrays(*lattice(41, 9), patch="upper arm", link="left arm", present=present, ids=ids[:369])
    tip = dermatome.Skin.from_arrays(*lattice(5, 24), patch="tip of it", link="left hand", ids=ids[369:])
    pose = np.eye(4)
    pose[:3, 3] = 0.0, 0.5, 0.1
    made = dermatome.build(dermatome.Skin.join([arm, tip], poses={"left hand": pose}))
    for clock in STAMPS:
        (folder / clock).mkdir()
        made.write(folder / clock / "map.glb")
    rng, places = np.random.default_rng(5), [patch.levels[0].positions for patch in made.patches.values()]
    pressure = rng.normal(0, 0.05, (240, 489))
    for first, frames, centre, peak in ((20, 30, 180, 20.0), (60, 5, 90, 12.0), (100, 25, 430, 25.0), (150, 20, 200, 15.0), (200, 25, 400, 18.0)):
        patch = 0 if centre < 369 else 1
        off = np.linalg.norm(places[patch] - places[patch][centre - 369 * patch], axis=1)
        shape = np.sqrt(np.sin(np.pi * (np.arange(frames) + 0.5) / frames))
        pressure[first : first + frames, 369 * patch : 369 * patch + len(off)] += peak * np.outer(shape, np.exp(-((off / 0.012) ** 2)))
    heat, shear = 30 + 0.01 * np.arange(489) + 0.001 * np.arange(240)[:, None], 0.1 * pressure + 0.01
    values = np.stack([pressure, heat, shear], axis=1).round(3).astype(np.float32)
    return folder, made, values


def in_containers(folder, on, values, times, kinds):
    """The recording as a file of each kind, and the layout that it needs."""
    (folder / "taxels.csv").write_text("taxel,taxel_id\n" + "".join(f"{k},{taxel}\n" for k, taxel in enumerate(on.ids)))
    channels = [("pressure", "kPa", False), ("temperature", "degC", False), ("force.x", "N", True)]
    named = [{"name": name, "unit": unit, "component": k, **({"signed": True} if signed else {})} for k, (name, unit, signed) in enumerate(channels)]
    about = {"dermatome_layout": 1, "axes": ["frame", "component", "taxel"], "press": "raises", "zero": 0, "channels": named, "taxels": "taxels.csv"}

    def laid(name, **more):
        (folder / f"{name}.json").write_text(json.dumps({**about, **more}))
        return ["--layout", f"{name}.json"]

    stamped, made = {"time": {"stream": "timestamps", "unit": "s"}}, {}
    whole = dermatome.Readings(values, on.ids, times, tuple(c[0] for c in channels), tuple(c[1] for c in channels))
    whole.write(folder / "whole.npz")
    made["npz"] = ["whole.npz"]
    backwards = replace(whole, values=values[:, :, ::-1], ids=on.ids[::-1])
    backwards.write(folder / "backwards.npz")
    made["backwards"] = ["backwards.npz"]
    head = ",".join(f"{taxel}.{name}[{unit}]" for taxel in on.ids for name, unit, _ in channels)
    rows = (",".join(map(repr, [float(t), *map(float, row.T.ravel())])) for t, row in zip(times, values))
    (folder / "whole.csv").write_text("\n".join([f"time,{head}", *rows]) + "\n")
    made["csv"] = ["whole.csv"]
    if "hdf5" in kinds:
        h5py = pytest.importorskip("h5py")
        with h5py.File(folder / "whole.h5", "w") as file:
            group = file.create_group("data/demo_0")
            group.create_dataset("tactile", data=values, chunks=(7, 3, 100))
            group["timestamps"] = times
        made["hdf5"] = ["whole.h5", *laid("hdf5", stream="data/demo_0/tactile", **stamped)]
    if "zarr" in kinds:
        files = {".zgroup": {"zarr_format": 2}, "data/.zgroup": {"zarr_format": 2}}
        for name, array, step in (("tactile", values, 100), ("timestamps", times.astype("<f8"), 240)):
            parts = np.concatenate([array, np.zeros((-len(array) % step, *array.shape[1:]), array.dtype)])
            kept = {"zarr_format": 2, "compressor": None, "fill_value": 0, "order": "C", "filters": None, "dtype": array.dtype.str}
            files[f"data/{name}/.zarray"] = {**kept, "shape": array.shape, "chunks": [step, *array.shape[1:]]}
            for k in range(len(parts) // step):
                files[f"data/{name}/{'.'.join([str(k), *['0'] * (array.ndim - 1)])}"] = parts[k * step : (k + 1) * step].tobytes()
        for name, data in files.items():
            (folder / "whole.zarr" / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / "whole.zarr" / name).write_bytes(data if isinstance(data, bytes) else json.dumps(data).encode())
        made["zarr"] = ["whole.zarr", *laid("zarr", stream="data/tactile", **stamped)]
    if "parquet" in kinds:
        arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
        root = folder / "whole.lerobot"
        for part in ("data/chunk-000", "meta"):
            (root / part).mkdir(parents=True, exist_ok=True)
        count = len(values)
        columns = {"observation.tactile": values.tolist(), "timestamp": times.astype(np.float32), "frame_index": np.arange(count)}
        columns |= {"episode_index": np.zeros(count, np.int64), "index": np.arange(count), "task_index": np.zeros(count, np.int64)}
        parquet.write_table(arrow.table(columns), root / "data/chunk-000/episode_000000.parquet")
        info = {"codebase_version": "v2.1", "fps": 25, "total_frames": count, "total_episodes": 1}
        info["features"] = {"observation.tactile": {"dtype": "float32", "shape": [3, 489]}}
        (root / "meta/info.json").write_text(json.dumps(info))
        (root / "meta/episodes.jsonl").write_text(json.dumps({"episode_index": 0, "tasks": [], "length": count}) + "\n")
        made["parquet"] = ["whole.lerobot", *laid("parquet", stream="observation.tactile", time={"rate": 25})]
    return made


def run(folder, *words, stdin=None, codes=(0,)):
    line = [sys.executable, "-m", "dermatome", *map(str, words)]
    said = subprocess.run(line, capture_output=True, cwd=folder, input=stdin)
    assert said.returncode in codes, said.stderr.decode()


def outcomes(folder, given, stdin=None):
    """What every command makes of a recording."""
    given = [*given, "--zero", 0]
    run(folder, "summary", "map.glb", *given, "-o", "s.csv", "--over-time", "t.csv", stdin=stdin)
    run(folder, "render", "map.glb", *given, "-o", "v.npz", "--values-only", "--contacts", "c.csv", "--events", "e.jsonl", stdin=stdin)
    made = {name: (folder / name).read_bytes() for name in ("s.csv", "t.csv", "c.csv", "e.jsonl")}
    with np.load(folder / "v.npz") as arrays:
        made |= {name: arrays[name] for name in arrays.files}
    if stdin is None:
        run(folder, "plot", "map.glb", "--readings", *given, "--frame", 35, "-o", "p.svg")
        run(folder, "check", "map.glb", "--recording", *given, "-o", "h.csv", codes=(0, 1))
        made |= {name: (folder / name).read_bytes() for name in ("p.svg", "h.csv")}
    return made


@pytest.mark.parametrize("clock", STAMPS)
def test_every_command_gives_the_same_for_every_container(clock, pressed):
    folder, on, values = pressed
    kinds = ["hdf5", "zarr"] + (["parquet"] if clock == "even" else [])
    containers = in_containers(folder / clock, on, values, STAMPS[clock], kinds)
    base = outcomes(folder / clock, containers["npz"])
    assert base["e.jsonl"].count(b"\n") > 9 and base["c.csv"].count(b"\n") > 50
    for kind, given in containers.items():
        found = outcomes(folder / clock, given)
        assert found.keys() == base.keys()
        for name, expected in base.items():
            np.testing.assert_array_equal(found[name], expected, err_msg=f"{name} of {kind}")
    streamed = outcomes(folder / clock, ["-"], stdin=(folder / clock / "whole.csv").read_bytes())
    for name, found in streamed.items():
        np.testing.assert_array_equal(found, base[name], err_msg=f"{name} of a stream")


@pytest.mark.parametrize("clock", STAMPS)
def test_python_says_what_the_command_says(clock, pressed):
    """Sums and events of a recording in Python, whatever it is read from, are those of the command."""
    folder, on, values = pressed
    kinds = ["hdf5", "zarr"] + (["parquet"] if clock == "even" else [])
    containers = in_containers(folder / clock, on, values, STAMPS[clock], kinds)
    run(folder / clock, "summary", "map.glb", *containers["csv"], "--zero", 0, "-o", "s.csv")
    run(folder / clock, "render", "map.glb", *containers["csv"], "--zero", 0, "--threshold", 1, "--events", "e.jsonl", "-o", "v.npz")
    with open(folder / clock / "s.csv", newline="") as file:
        sums = list(csv.DictReader(line for line in file if not line.startswith("#")))
    said = [json.loads(line) for line in (folder / clock / "e.jsonl").read_text().splitlines()]
    assert len(sums) > 6 and len(said) > 9
    for kind, given in containers.items():
        layout = folder / clock / given[2] if len(given) > 1 else None
        with dermatome.Readings.open(folder / clock / given[0], layout=layout) as opened:
            readings = opened.read(on)
        if layout is None:
            readings = readings.condition(on, zero=0)
        rows = readings.summary(on)
        assert len(rows) == len(sums), kind
        for row, needed in zip(rows, sums):
            for name, cell in needed.items():
                found = "" if row[name] is None else row[name]
                same = str(found) == cell or (cell and found != "" and float(found) == pytest.approx(float(cell), rel=1e-6, abs=1e-9))
                assert same, f"{name} of {kind}: {found!r} for {cell!r}"
        detector = dermatome.EventDetector(on, unit="kPa", threshold=1.0)
        events = [event for time, frame in zip(readings.timestamps, readings.values[:, 0]) for event in detector.see(time, frame)]
        events += detector.finish()
        assert [(e["event"], e["phase"]) for e in events] == [(e["event"], e["phase"]) for e in said], kind
        for event, needed in zip(events, said):
            for name in {"time", "begin", "duration", "force_peak", "impulse"} & needed.keys():
                assert event[name] == pytest.approx(needed[name], rel=1e-6, abs=1e-6), f"{name} of {kind}"

"""The adapters, each against the real package; those that are not installed are skipped by name."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from conftest import dome, lattice

import dermatome


def test_adapters_are_importable_without_their_packages():
    import importlib

    for name in ("genesis", "lerobot", "mujoco", "ray", "rerun", "ros", "torch", "trimesh"):
        importlib.import_module(f"dermatome.{name}")


def unit_uv(level):
    """Places on the map as parts of its image."""
    frame = level.frame
    return (level.uv - [frame.x, frame.y]) / [frame.width, frame.height]


def test_trimesh(dome_map, tube_map, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    import dermatome.trimesh as adapter

    for map in (dome_map, tube_map):
        level = next(iter(map.patches.values())).levels[0]
        mesh = adapter.mesh(map)
        assert mesh.area == pytest.approx(level.areas.sum(), rel=1e-3)
        mesh.export(tmp_path / "mesh.glb")
        again = trimesh.load(tmp_path / "mesh.glb", force="mesh", process=False)
        assert np.allclose(np.asarray(again.visual.uv), unit_uv(level), atol=1e-6)
        flat = adapter.mesh(map, flat=True)
        assert flat.area == pytest.approx(mesh.area, rel=0.02) and (flat.face_normals[:, 2] > 0.99).all()
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    with pytest.raises(dermatome.DataError, match="mesh: found a Scene of several meshes; needed: one; scene.to_mesh"):
        adapter.skin(trimesh.Scene([ball]))
    assert adapter.skin(trimesh.Scene([ball]).to_mesh()).n_taxels == len(ball.vertices)
    skin = adapter.skin(ball, patch="ball")
    points = np.random.default_rng(0).normal(size=(500, 3)) * 0.05
    theirs = trimesh.proximity.ProximityQuery(ball).on_surface(points)
    ours = dermatome.build(skin).index().locate(points)
    assert np.allclose(abs(ours.distance), theirs[1], atol=1e-7)


def test_trimesh_keeps_what_a_map_holds(dome_map, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    dome_map.write(tmp_path / "map.glb")
    scene = trimesh.load(tmp_path / "map.glb", process=False)
    level = dome_map.patches["dome"].levels[0]
    mesh = scene.geometry["dome/L0"]
    assert np.allclose(np.asarray(mesh.visual.uv), unit_uv(level), atol=1e-6)
    for name, kept in (("_TAXEL_ID", dome_map.ids), ("_PRESENT", dome_map.present), ("_AREA", level.areas)):
        assert np.allclose(np.ravel(mesh.vertex_attributes[name]), kept, rtol=1e-6)
    scene.export(tmp_path / "again.glb")
    with pytest.raises(dermatome.DataError, match="trimesh.*rewrote this map") as refused:
        dermatome.Map.read(tmp_path / "again.glb")
    assert refused.value.kind == "rewritten"


def test_lerobot_takes_the_features(dome_map):
    import dermatome.lerobot as adapter

    images = {"dome": dome_map.renderer(0, size=(32, 32))}
    features = adapter.features(dome_map, 1, images=images)
    values = np.random.default_rng(4).random(256)
    values[5] = np.nan
    frame = adapter.frame(dome_map, values, 1, images=images)
    reserved = {"timestamp", "frame_index", "episode_index", "index", "task_index"}
    assert frame.keys() == features.keys() and not reserved & features.keys()
    valid = frame["observation.tactile.dome.L1.valid"]
    assert np.array_equal(valid == 1, np.isfinite(dome_map.pool(values, 1)))
    dead = np.where(dome_map.pool(np.eye(256), 1)[:, 3] > 0, np.nan, values)
    assert adapter.frame(dome_map, dead, 1)["observation.tactile.dome.L1.valid"][3] == 0
    for key, feature in features.items():
        assert "/" not in key
        assert frame[key].shape == feature["shape"] and isinstance(feature["shape"], tuple)
        assert np.isfinite(frame[key]).all()
        assert frame[key].dtype == (np.uint8 if feature["dtype"] == "image" else np.float32)
    assert adapter.masks(dome_map, 1)["observation.tactile.dome.L1"].all()


def test_features_of_patches_have_names_of_their_own():
    import dermatome.lerobot as adapter

    one = lattice(8, 8)[0]
    skin = [dermatome.Skin.from_arrays(one, patch=name) for name in ("arm/wrist", "arm_wrist")]
    assert [adapter.key(each.patches[0], 0) for each in skin] == ["observation.tactile.arm_wrist.L0"] * 2
    glue = pytest.importorskip("trimesh")  # Two objects of a file are two patches.
    scene = glue.Scene()
    for k, name in enumerate(("arm/wrist", "arm_wrist")):
        positions, faces = lattice(8, 8)
        scene.add_geometry(glue.Trimesh(positions + [0.2 * k, 0, 0], faces, process=False), node_name=name, geom_name=name)
    made = dermatome.build(dermatome.Skin.from_bytes(scene.export(file_type="glb"), "glb"))
    assert len(made.patches) == 2
    values = np.arange(128.0)
    for features in (adapter.features(made, 0), adapter.frame(made, values, 0)):
        assert len(features) == 4
    assert sum(adapter.frame(made, values, 0)[key].sum() for key in adapter.keys(made, 0).values()) == values.sum()
    assert len(adapter.masks(made, 0)) == len(dermatome.Readings.from_arrays(values[None]).features(made, 0)) == 2


@pytest.mark.parametrize("level", [0, 1, 2])
def test_forces_keep_their_total_in_every_adapter(level, uneven_map, monkeypatch):
    import dermatome.lerobot

    force = np.random.default_rng(6).random((2, 1, 592))
    force[:, 0, 300] = np.nan
    readings = dermatome.Readings.from_arrays(force, units="N", channels="force")
    expected = np.nansum(force[:, 0, uneven_map.present == 1], axis=1)
    totals = {"pooled": np.nansum(readings.pooled(uneven_map, level)[:, 0], axis=1)}
    features = readings.features(uneven_map, level)
    totals["features"] = sum(feature["values"].sum(axis=1) for feature in features.values())
    frames = [dermatome.lerobot.frame(uneven_map, row, level, extensive=True) for row in force[:, 0]]
    with pytest.raises(dermatome.DataError, match="one frame"):
        dermatome.lerobot.frame(uneven_map, force[0], level)
    kept = dermatome.lerobot.keys(uneven_map, level).values()
    totals["lerobot"] = [sum(frame[key].sum() for key in kept) for frame in frames]
    assert all(frame.keys() == dermatome.lerobot.features(uneven_map, level).keys() for frame in frames)
    if importlib.util.find_spec("rerun"):
        import rerun

        import dermatome.rerun

        logged = []
        monkeypatch.setattr(rerun, "log", lambda path, *parts, **_: logged.append((path, parts)))
        dermatome.rerun.log(uneven_map, readings, level=level)
        totals["rerun"] = [float(parts[0].scalars.as_arrow_array()[0].as_py()) for path, parts in logged if path == "skin/total"]
        assert len(logged) == 2 + 2 * 3
    if importlib.util.find_spec("torch"):
        import torch

        from dermatome.torch import Pool, Touches

        totals["Pool"] = np.nansum(Pool(uneven_map, level, extensive=True)(torch.from_numpy(force[:, 0])).numpy(), axis=1)
        touches = Touches(uneven_map, readings, truth={"frame": [], "force": [], "centre": [], "patch": []}, level=level)
        totals["Touches"] = [touches[k]["fields"].sum().item() for k in range(2)]
    for name, total in totals.items():
        assert np.allclose(total, expected, rtol=1e-5), name


def test_rerun_puts_patches_where_their_links_are(tmp_path, monkeypatch):
    rerun = pytest.importorskip("rerun")
    import dermatome.rerun as adapter

    robot = dermatome.build(Path(__file__).parents[3] / "meshes" / "robot.glb")
    logged = {}
    monkeypatch.setattr(rerun, "log", lambda path, *parts, **_: logged.setdefault(path, parts))
    adapter.log(robot, level=robot.n_levels - 1)
    poses = robot.index().poses
    for name, patch in robot.patches.items():
        transform = next(part for part in logged[f"skin/{name}"] if isinstance(part, rerun.Transform3D))
        assert np.allclose(np.ravel(transform.translation.as_arrow_array().to_pylist()), poses[patch.link][:3, 3])
    assert len({tuple(poses[link][:3, 3]) for link in robot.links}) == 3


def test_rerun(dome_map, tmp_path):
    rerun = pytest.importorskip("rerun")
    import dermatome.rerun as adapter

    readings, _ = dermatome.touch(dome_map, presses=1, rate=20.0)
    rerun.init("dermatome", spawn=False)
    rerun.save(tmp_path / "skin.rrd")
    adapter.log(dome_map, readings, level=1)
    rerun.disconnect()
    assert (tmp_path / "skin.rrd").stat().st_size > 10_000


def test_counts_of_batches_add_up(dome_map):
    arrow = pytest.importorskip("pyarrow")
    import dermatome.ray as adapter

    points = dome()[0][np.random.default_rng(5).integers(0, 256, 4000)] + 1e-4
    table = arrow.table({"x": points[:, 0], "y": points[:, 1], "z": points[:, 2], "force": np.ones(4000)})
    lookup = adapter.Lookup(dome_map.to_bytes(), level=1)
    whole = adapter.touch_counts(lookup(table))

    class Parts:
        def iter_batches(self, **_):
            for k in range(0, 4000, 700):
                yield adapter.touch_counts(lookup(table.slice(k, 700)))

    parts = adapter.total(Parts())
    assert sum(parts["count"].to_pylist()) == 4000 and sum(parts["force_sum"].to_pylist()) == 4000
    assert parts.select(["patch", "field", "count"]).to_pylist() == sorted(
        whole.select(["patch", "field", "count"]).to_pylist(), key=lambda row: (row["patch"], row["field"])
    )


def test_forces_that_are_not_known_are_none(dome_map):
    arrow = pytest.importorskip("pyarrow")
    import dermatome.ray as adapter

    points = dome()[0][[40, 40, 41]]
    cells = adapter.Lookup(dome_map.to_bytes(), level=0)(arrow.table({**dict(zip("xyz", points.T)), "force": [1.0, float("nan"), 2.0]}))
    counts = adapter.touch_counts(cells)
    assert sorted(counts["force_sum"].to_pylist()) == [1.0, 2.0] and sum(counts["count"].to_pylist()) == 3

    class Parts:
        def iter_batches(self, **_):
            yield counts
            yield adapter.touch_counts(cells.drop_columns(["force"]))

    both = adapter.total(Parts())
    assert sum(both["count"].to_pylist()) == 6 and sorted(both["force_sum"].to_pylist()) == [1.0, 2.0]
    with pytest.raises(dermatome.DataError, match="level"):
        adapter.Lookup(dome_map.to_bytes(), level=9)


def test_ray_draws_episodes_and_goes_on_where_it_was(dome_map, tmp_path):
    """A file for each episode, the images and values of the renderer, and no episode is read twice."""
    import dermatome.ray as adapter

    values = np.random.default_rng(3).random((5, 20, 256))
    np.save(tmp_path / "glove.npy", values)
    layout = {"dermatome_layout": 1, "axes": ["episode", "frame", "taxel"], "time": {"rate": 50}, "press": "raises", "zero": 0}
    layout |= {"channels": [{"name": "force", "unit": "N"}], "taxels": {"ids": dome_map.ids.tolist()}}
    rows = adapter.episodes([tmp_path / "glove.npy"], layout=layout)
    assert [(row["episode"], row["file"]) for row in rows] == [(k, f"glove.{k:06d}") for k in range(5)]
    for folder, level, options in (("images", 0, {"size": (16, 24), "fill": 0.0}), ("fields", 1, None)):
        render = adapter.Render(dome_map.to_bytes(), tmp_path / folder, level, options, layout=layout)
        said = [render(row) for row in rows[::-1]]
        assert [row["frames"] for row in said] == [20] * 5 and not any(row["error"] for row in said)
        for k in range(5):
            with np.load(tmp_path / folder / f"glove.{k:06d}.npz") as made:
                draw = dome_map.renderer(level, extensive=True, **options) if options else lambda x: dome_map.pool(x, level, extensive=True)
                assert np.array_equal(made["values"], draw(values[k][:, None]))
                assert np.allclose(made["timestamps"], np.arange(20) / 50) and made["units"].tolist() == ["N"]
    with pytest.raises(dermatome.DataError, match="different names"):
        adapter.episodes([tmp_path / "glove.npy", tmp_path / "images/glove.npy"], layout=layout)
    # What says the same is the same, whatever its type.
    same = adapter.Render(dome_map.to_bytes(), tmp_path / "images", 0, {"fill": 0.0, "size": [np.int64(16), 24]}, layout=dermatome.Layout.parse(json.dumps(layout)))
    assert same(rows[0])["frames"] == 20
    # What is there is not read again, and a half file is none.
    stored = (tmp_path / "glove.npy").read_bytes()
    (tmp_path / "glove.npy").unlink()
    (tmp_path / "fields/glove.000004.npz").unlink()
    (tmp_path / "fields/.glove.000004.npz.1.part").write_bytes(b"half")
    again = adapter.Render(dome_map.to_bytes(), tmp_path / "fields", 1, layout=layout)
    assert [row["frames"] for row in map(again, rows)] == [20, 20, 20, 20, 0] and "glove.npy" in again(rows[4])["error"]
    with pytest.raises(dermatome.DataError, match="level: found 9"):
        adapter.Render(dome_map.to_bytes(), tmp_path / "fields", 9)
    # A file of something else is not what was asked for.
    (tmp_path / "glove.npy").write_bytes(stored)
    other = adapter.Render(dome_map.to_bytes(), tmp_path / "images", 1, None, layout=layout)(rows[0])
    changed = adapter.Render(dome_map.to_bytes(), tmp_path / "images", 0, {"size": (16, 24), "fill": 0.0}, layout=layout)(rows[0])
    for said in (other, changed):
        assert said["frames"] == 0 and "another map, level, renderer or recording; needed: another folder" in said["error"]
    # What a layout of one name says is not always the same.
    for k, unit in enumerate(("N", "mN")):
        (tmp_path / "layout.json").write_text(json.dumps(layout | {"channels": [{"name": "force", "unit": unit}]}))
        for given in (tmp_path / "layout.json", dermatome.Layout.read(tmp_path / "layout.json")):
            said = adapter.Render(dome_map.to_bytes(), tmp_path / "by file", 1, layout=given)(rows[0])
            assert (said["frames"], bool(said["error"])) == ((0, True) if k else (20, False))
    (tmp_path / "images/glove.000001.npz").write_bytes(b"PK damaged")
    assert "cannot be read" in adapter.Render(dome_map.to_bytes(), tmp_path / "images", 1, layout=layout)(rows[1])["error"]


def test_ray_says_that_an_episode_has_no_frame(dome_map, tmp_path, monkeypatch):
    import dermatome.ray as adapter

    render = adapter.Render(dome_map.to_bytes(), tmp_path / "images", 1)
    monkeypatch.setattr(render, "_episode", lambda row: iter([]))
    said = render({"path": "a.h5", "episode": 3, "file": "a.000003"})
    assert said["frames"] == 0 and said["error"] == "a.h5: found no frame in episode 3; needed: one or more"
    assert not list((tmp_path / "images").iterdir())


def test_ray_gives_the_same_total(dome_map, tmp_path):
    ray = pytest.importorskip("ray")
    arrow = pytest.importorskip("pyarrow")
    import pyarrow.parquet

    import dermatome.ray as adapter

    points = dome()[0][np.random.default_rng(5).integers(0, 256, 4000)] + 1e-4
    table = arrow.table({"x": points[:, 0], "y": points[:, 1], "z": points[:, 2]})
    for k in range(4):
        pyarrow.parquet.write_table(table.slice(1000 * k, 1000), tmp_path / f"{k}.parquet")
    lookup = adapter.Lookup(dome_map.to_bytes(), 1)
    alone = adapter.touch_counts(lookup(table)).sort_by([("patch", "ascending"), ("field", "ascending")])
    # Two for the actors, two for the tasks before and after them.
    ray.init(num_cpus=4, include_dashboard=False, log_to_driver=False)
    try:
        cells = ray.data.read_parquet(str(tmp_path)).map_batches(
            adapter.Lookup,
            fn_constructor_args=(dome_map.to_bytes(), 1),
            batch_format="pyarrow",
            compute=ray.data.ActorPoolStrategy(size=2),
        )
        together = adapter.total(cells.map_batches(adapter.touch_counts, batch_format="pyarrow"))
        for k in range(3):
            dermatome.Readings.from_arrays(points[:256, k] + np.zeros((4, 1)), units="N").write(tmp_path / f"axis{k}.npz")
        rows = adapter.episodes(tmp_path / f"axis{k}.npz" for k in range(3))
        drawn = ray.data.from_items(rows).map(adapter.Render, fn_constructor_args=(dome_map.to_bytes(), tmp_path / "drawn", 1), concurrency=2)
        assert sorted(row["frames"] for row in drawn.take_all()) == [4, 4, 4]
        with np.load(tmp_path / "drawn/axis2.000000.npz") as made:
            assert np.array_equal(made["values"][0, 0], dome_map.pool(points[:256, 2], 1, extensive=True))
    finally:
        ray.shutdown()
    assert together.select(["field", "count"]).to_pylist() == alone.select(["field", "count"]).to_pylist()


def test_genesis_probes(dome_map):
    import dermatome.genesis as adapter

    assert adapter.probes(dome_map).keys() == {"probe_local_pos", "probe_radius"}
    at_fields = adapter.probes(dome_map, level=1, normals=True)
    assert at_fields["probe_local_pos"].shape == at_fields["probe_local_normal"].shape
    grid = adapter.probes(dome_map, grid=(12, 9), normals=True)
    assert grid["probe_local_pos"].shape == (12, 9, 3) and grid["probe_radius"].shape == (12, 9)
    inside = grid["probe_radius"] > 0
    assert inside.any()
    index = dome_map.index()
    assert abs(index.locate(grid["probe_local_pos"][inside]).distance).max() < 1e-9
    assert np.allclose(np.linalg.norm(grid["probe_local_normal"][inside], axis=1), 1)
    for wrong in (12, (12,), (12, 9, 3), (0, 9), (12, -9), (1.5, 9), "ab", ("a", 9), [None, 3]):
        with pytest.raises(dermatome.DataError, match="grid: found .*needed: two whole numbers above 0"):
            adapter.probes(dome_map, grid=wrong)
    assert adapter.probes(dome_map, grid=np.array([12, 9]))["probe_radius"].shape == (12, 9)


def test_genesis_takes_the_probes(dome_map):
    gs = pytest.importorskip("genesis", exc_type=ImportError)
    import dermatome.genesis as adapter

    gs.init(backend=gs.cpu, logging_level="warning")
    for sensor in (gs.sensors.ContactProbe, gs.sensors.KinematicTaxel):
        for options in (adapter.probes(dome_map, level=1), adapter.probes(dome_map, grid=(12, 9))):
            made = sensor(entity_idx=0, **options)
            assert np.allclose(np.asarray(made.probe_local_pos), options["probe_local_pos"])
    for sensor in (gs.sensors.ElastomerTaxel, gs.sensors.ProximityTaxel):
        sensor(entity_idx=0, track_link_idx=(1,), **adapter.probes(dome_map, level=1, normals=True))

    positions, faces = dome()
    map = dermatome.build(dermatome.Skin.from_arrays(positions - [*positions[:, :2].mean(axis=0), 0], faces))
    probes = adapter.probes(map)
    scene = gs.Scene(show_viewer=False, sim_options=gs.options.SimOptions(dt=0.005))
    hand = scene.add_entity(gs.morphs.Sphere(radius=0.08, fixed=True))
    ball = scene.add_entity(gs.morphs.Sphere(radius=0.02, pos=(0.01, 0.02, 0.103)))
    sensor = scene.add_sensor(gs.sensors.ContactDepthProbe(entity_idx=hand.idx, link_idx_local=0, **probes))
    scene.build()
    for _ in range(40):
        scene.step()
        felt = np.asarray(sensor.read()).ravel()
        if felt.any():
            break
    away = np.linalg.norm(probes["probe_local_pos"] - np.asarray(ball.get_pos()).ravel(), axis=1)
    depth = np.maximum(0.02 + probes["probe_radius"] - away, 0)
    assert felt.max() > 1e-3 and np.allclose(felt, depth, atol=1e-6)


def test_lerobot_makes_a_dataset(dome_map, tmp_path):
    lerobot = pytest.importorskip("lerobot.datasets.lerobot_dataset")
    import dermatome.lerobot as adapter

    images = {"dome": dome_map.renderer(0, size=(32, 32))}
    readings, _ = dermatome.touch(dome_map, presses=1, rate=20.0)
    features = adapter.features(dome_map, 1, images=images)
    dataset = lerobot.LeRobotDataset.create("test/skin", fps=20, root=tmp_path / "set", features=features, use_videos=False)
    frames = [adapter.frame(dome_map, values, 1, extensive=True, images=images, limit=5.0) for values in readings.values[:, 0]]
    for frame in frames:
        dataset.add_frame({**frame, "task": "touch"})
    dataset.save_episode()
    dataset.finalize()
    statistics = json.loads((tmp_path / "set" / "meta" / "stats.json").read_text())
    key = "observation.tactile.dome.L1"
    assert len(statistics[key]["mean"]) == features[key]["shape"][0]
    assert all(np.isfinite(numbers).all() for numbers in statistics[key].values())
    again = lerobot.LeRobotDataset("test/skin", root=tmp_path / "set")
    assert np.array_equal(again[7][key].numpy(), frames[7][key])


def test_lerobot_takes_the_fields_of_a_dataset(tmp_path):
    lerobot = pytest.importorskip("lerobot.datasets.lerobot_dataset")
    rng = np.random.default_rng(5)
    counts = rng.integers(0, 900, (12, 2, 3, 8)).astype(np.int16)
    features = {
        "observation.tactile.pads": {"dtype": "int16", "shape": (2, 3, 8), "names": ["pad", "row", "col"]},
        "action": {"dtype": "float32", "shape": (2,), "names": None},
    }
    dataset = lerobot.LeRobotDataset.create("test/pads", fps=20, root=tmp_path / "set", features=features, use_videos=False)
    for k, frame in enumerate(counts):
        dataset.add_frame({"observation.tactile.pads": frame, "action": np.full(2, k, np.float32), "task": "touch"})
        if k in (4, 11):
            dataset.save_episode()
    dataset.finalize()
    layout = {"dermatome_layout": 1, "axes": ["frame", "pad", "row", "col"], "time": {"rate": 20}, "press": "raises", "zero": 0}
    layout |= {"channels": [{"name": "pressure", "unit": "count"}], "taxels": {"shape": [2, 3, 8], "first_id": 1}}
    places = [[0.004 * c, 0.004 * r, 0.1 * p] for p in range(2) for r in range(3) for c in range(8)]
    made = dermatome.build(dermatome.Skin.from_arrays(places, outside=(0, 0, 1)), coarsest=4)
    recording = dermatome.Readings.open(tmp_path / "set", stream="observation.tactile.pads", layout=layout)
    for level in range(made.n_levels):
        recording.write_lerobot(tmp_path / f"set{level}", made, level, repo_id="test/with")
        copy = lerobot.LeRobotDataset("test/with", root=tmp_path / f"set{level}")
        expected = recording.read(made).features(made, level)
        assert copy.num_frames == 12 and copy.num_episodes == 2 and len(expected) == len(made.patches)
        for k in range(12):
            row = copy[k]
            assert np.array_equal(row["observation.tactile.pads"].numpy(), counts[k]) and row["action"].tolist() == [k, k]
            for name, feature in expected.items():
                assert np.array_equal(np.ravel(row[name].numpy()), feature["values"][k]) and row[f"{name}.valid"].numpy().all()
        for name, feature in expected.items():
            known = copy.meta.stats[name]
            assert np.allclose(np.ravel(known["mean"]), feature["values"].mean(axis=0), rtol=1e-4) and np.isfinite(known["std"]).all()
        assert copy.meta.stats["action"]["max"].tolist() == [11, 11]
    with pytest.raises(dermatome.FileError, match="set0"):
        recording.write_lerobot(tmp_path / "set0", made)

"""What every adapter keeps, on one uneven skin: forces in are forces out, places are on the map, times in are times out, and
contacts are of their frames and patches. Each adapter has tests of its own, so that one that is not installed skips no other."""

from dataclasses import replace

import numpy as np
import pytest

import dermatome


@pytest.fixture
def forces(rough_map, rough_readings):
    """The forces on the skin in each frame, in N."""
    return np.nansum(rough_readings.values[:, 0, rough_map.present == 1], axis=1)


@pytest.fixture
def known(rough_readings):
    """The recording without a missing reading."""
    return rough_readings.with_values(np.nan_to_num(rough_readings.values))


@pytest.fixture
def pressed(rough_map):
    """A simulated recording, whose taxels are in the order of the map, and its truth; both patches are touched."""
    made = (dermatome.touch(rough_map, presses=4, rate=20.0, seed=seed) for seed in range(20))
    readings, truth = next(each for each in made if len(set(each[1]["patch"])) == 2)
    return replace(readings, ids=None), truth


def parts_of(patch, uv):
    """Places on the map of a patch as parts of its image."""
    frame = patch.levels[0].frame
    return (np.asarray(uv) - [frame.x, frame.y]) / [frame.width, frame.height]


def is_inside(parts):
    return bool(((parts > -1e-9) & (parts < 1 + 1e-9)).all())


levels = pytest.mark.parametrize("level", [0, 1, 2])


# ---- torch


@levels
def test_torch_pools_and_draws_forces(level, rough_map, rough_readings, forces):
    torch = pytest.importorskip("torch")
    from dermatome.torch import Draw, Pool, pixels, pooling

    values = torch.from_numpy(rough_readings.values[:, 0])
    fields = Pool(rough_map, level, extensive=True)(values)
    assert np.allclose(fields.nansum(dim=1), forces, rtol=1e-5)
    by_patch = [
        Pool(rough_map, level, patch=name, extensive=True)(values[:, patch.start : patch.start + patch.n_taxels]).nansum(dim=1)
        for name, patch in rough_map.patches.items()
    ]
    assert np.allclose(sum(by_patch), forces, rtol=1e-5)
    whole = torch.nan_to_num(values).float()
    assert np.allclose((pooling(rough_map, level, extensive=True) @ whole.T).sum(dim=0), forces, rtol=1e-5)
    for options in ({"pack": "tight"}, {"pack": "body", "size": (60, 90)}):
        renderer = rough_map.renderer(level, extensive=True, **options)
        area = renderer.pixel[0] * renderer.pixel[1]
        assert np.allclose(Draw(renderer)(fields).nansum(dim=(1, 2)) * area, forces, rtol=1e-5)
        assert np.allclose((pixels(renderer) @ torch.nan_to_num(fields).float().T).sum(dim=0) * area, forces, rtol=1e-4)
    for name, patch in rough_map.patches.items():
        own = min(level, len(patch.levels) - 1)
        renderer = rough_map.renderer(own, patch=name, extensive=True)
        fields = Pool(rough_map, own, extensive=True)(values)
        part = slice(patch.start, patch.start + patch.n_taxels)
        felt = np.nansum(rough_readings.values[:, 0, part][:, rough_map.present[part] == 1], axis=1)
        area = renderer.pixel[0] * renderer.pixel[1]
        assert np.allclose(Draw(renderer)(fields).nansum(dim=(1, 2)) * area, felt, rtol=1e-5), name


@levels
@pytest.mark.parametrize("size", [(64, 64), (9, 31)])
def test_torch_touches_keep_forces(level, size, rough_map, rough_readings, forces):
    torch = pytest.importorskip("torch")
    from dermatome.torch import Touches

    touches = Touches(rough_map, rough_readings, {"frame": [], "force": [], "centre": [], "patch": []}, level=level, size=size)
    batch = next(iter(torch.utils.data.DataLoader(touches, batch_size=6)))
    renderer = rough_map.renderer(0, size=size, extensive=rough_readings.extensive, channels=3, pack=True)
    assert np.allclose(batch["image"][:, 0].sum(dim=(1, 2)) * renderer.pixel[0] * renderer.pixel[1], forces, rtol=1e-5)
    assert np.allclose(batch["fields"][:, 0].sum(dim=1), forces, rtol=1e-5)
    assert (batch["image"][~batch["mask"]] == 0).all() and (batch["fields"][~batch["valid"]] == 0).all()
    assert not batch["contact"]["touched"].any() and set(batch["contact"]["patch"].tolist()) == {-1}


def test_torch_labels_are_the_contacts_of_their_frames(rough_map, pressed):
    pytest.importorskip("torch")
    from dermatome.torch import Touches

    readings, truth = pressed
    contacts = Touches(rough_map, readings, truth).contacts
    names, index = list(rough_map.patches), rough_map.index()
    rows = [max(np.flatnonzero(truth["frame"] == frame), key=lambda row: truth["force"][row]) for frame in np.unique(truth["frame"])]
    frames = truth["frame"][rows]
    assert np.array_equal(np.flatnonzero(contacts["touched"]), frames), "a frame is touched if and only if its truth has a contact"
    assert np.allclose(readings.timestamps[frames], truth["time"][rows], atol=1e-9)
    assert np.allclose(contacts["force"][frames], truth["force"][rows]) and (np.delete(contacts["force"], frames) == 0).all()
    assert [names[number] for number in contacts["patch"][frames]] == [truth["patch"][row] for row in rows]
    for number, name in enumerate(names):
        patch = rough_map.patches[name]
        centres = contacts["centre"][contacts["patch"] == number].astype(float)
        hits = index.locate(centres, link=patch.link)
        assert (hits.patch == number).all() and is_inside(parts_of(patch, hits.uv)), name
        assert (abs(hits.distance) < 0.0021).all(), "the sphere is pressed in by at most 2 mm"


def test_torch_labels_that_are_tracked_lie_on_the_skin(rough_map, pressed):
    pytest.importorskip("torch")
    from dermatome.torch import Touches

    readings, truth = pressed
    contacts = Touches(rough_map, readings).contacts
    touched, total = contacts["touched"], np.nansum(readings.values[:, 0], axis=1)
    assert set(np.flatnonzero(touched)) <= set(truth["frame"].tolist()) and touched.sum() > 0.8 * len(set(truth["frame"].tolist()))
    assert np.allclose(contacts["force"][touched], total[touched], rtol=1e-3), "one press at a time has all of the force"
    index = rough_map.index()
    for number, (name, patch) in enumerate(rough_map.patches.items()):
        hits = index.locate(contacts["centre"][contacts["patch"] == number].astype(float), link=patch.link)
        assert (hits.patch == number).all() and is_inside(parts_of(patch, hits.uv)), name


# ---- lerobot


@levels
def test_lerobot_keeps_forces(level, rough_map, rough_readings, forces):
    import dermatome.lerobot as adapter

    renderer = rough_map.renderer(level, pack=True, extensive=True)
    limit = float(np.nanmax(renderer(rough_readings.values[:, :1])))
    for values, force in zip(rough_readings.values[:, 0], forces):
        frame = adapter.frame(rough_map, values, level, extensive=True, images={"skin": renderer}, limit=limit)
        names, masks = adapter.keys(rough_map, level).values(), adapter.masks(rough_map, level)
        assert sum(frame[name].sum() for name in names) == pytest.approx(force, rel=1e-5)
        assert all((masks[name] >= (frame[f"{name}.valid"] == 1)).all() for name in names)
        grey = frame["observation.images.skin"][:, :, 0] / 255 * limit
        lost = renderer.mask.sum() * limit / 255  # Of each pixel less than one of 256 steps.
        drawn, area = grey.sum(), renderer.pixel[0] * renderer.pixel[1]
        assert (force - lost * area) * (1 - 1e-5) <= drawn * area <= force * (1 + 1e-5)


# ---- genesis


@levels
def test_genesis_probes_feel_forces_on_the_map(level, rough_map):
    import dermatome.genesis as adapter

    for name, patch in rough_map.patches.items():
        index, known = rough_map.index(fields=True), rough_map.present[patch.start : patch.start + patch.n_taxels] == 1
        for options in ({}, {"grid": (12, 10)}):
            made = adapter.probes(rough_map, patch=name, level=level, normals=True, **options)
            points, outward = (made[f"probe_local_{key}"][made["probe_radius"] > 0].reshape(-1, 3) for key in ("pos", "normal"))
            assert np.allclose(np.linalg.norm(outward, axis=1), 1)
            hits = index.locate(points, link=patch.link)
            assert is_inside(parts_of(patch, hits.uv)) and abs(hits.distance).max() < 1e-6
            felt, is_felt = index.readings(points, np.ones(len(points)), link=patch.link)
            part = felt[patch.start : patch.start + patch.n_taxels]
            assert np.nansum(part[known]) == pytest.approx(is_felt.sum()) and is_felt.mean() > 0.9


# ---- ray


@levels
def test_ray_renders_forces_and_times(level, rough_map, known, forces, tmp_path):
    import dermatome.ray as adapter

    known.write(tmp_path / "whole.npz")
    rows = adapter.episodes([tmp_path / "whole.npz"])
    for folder, options in (("fields", None), ("images", {"pack": "tight"}), ("body", {"pack": "body", "size": (60, 90)})):
        said = [adapter.Render(rough_map.to_bytes(), tmp_path / folder, level, options)(row) for row in rows]
        assert [(row["frames"], row["error"]) for row in said] == [(6, "")]
        with np.load(said[0]["file"]) as made:
            totals = np.nansum(made["values"][:, 0].reshape(6, -1), axis=1)
            assert np.allclose(made["timestamps"], known.timestamps, atol=1e-9)
            assert made["channels"].tolist() == list(known.channels) and made["units"].tolist() == list(known.units)
        if options is not None:
            renderer = rough_map.renderer(level, extensive=known.extensive, **options)
            totals = totals * renderer.pixel[0] * renderer.pixel[1]
        assert np.allclose(totals, forces, rtol=1e-5), folder


@levels
def test_ray_counts_forces_on_the_map(level, rough_map):
    arrow = pytest.importorskip("pyarrow")
    import dermatome.ray as adapter

    rng, poses = np.random.default_rng(6), rough_map.index().poses
    points = np.concatenate(
        [poses[patch.link][:3, 3] + rng.permutation(patch.levels[0].positions)[:60] for patch in rough_map.patches.values()]
    )
    force = rng.random(len(points))
    table = arrow.table({**dict(zip("xyz", points.T)), "force": force})
    cells = adapter.Lookup(rough_map.to_bytes(), level)(table)
    counts = adapter.touch_counts(cells).to_pydict()
    assert sum(counts["force_sum"]) == pytest.approx(force.sum()) and sum(counts["count"]) == len(points)
    assert max(counts["force_max"]) == force.max()
    for number, patch in enumerate(rough_map.patches.values()):
        chosen = np.asarray(cells["patch"]) == number
        uv = np.stack([np.asarray(cells[name])[chosen] for name in "uv"], axis=1)
        assert chosen.sum() == 60 and is_inside(parts_of(patch, uv))


# ---- ros


@levels
def test_ros_keeps_forces_and_times(level, rough_map, rough_readings, forces, tmp_path):
    pytest.importorskip("rosbags")
    from rosbags.highlevel import AnyReader

    import dermatome.ros as adapter

    adapter.write(tmp_path / "bag", rough_map, rough_readings, level=level, channel=0)
    points, images, stamps = np.zeros(6), np.zeros(6), {}
    names = {name.replace(" ", "_"): name for name in rough_map.patches}
    with AnyReader([tmp_path / "bag"]) as reader:
        for connection, time, raw in reader.messages():
            message, (_, _, patch, kind) = reader.deserialize(raw, connection.msgtype), connection.topic.split("/")
            stamp = message.header.stamp
            frame = int(np.argmin(abs(rough_readings.timestamps - (stamp.sec + 1e-9 * stamp.nanosec))))
            stamps[frame] = stamp.sec + 1e-9 * stamp.nanosec
            numbers = np.frombuffer(message.data.tobytes(), np.float32)
            if kind == "points":
                points[frame] += np.nansum(numbers.reshape(-1, 8)[:, 6], dtype=float)
            else:
                of = rough_map.patches[names[patch]]
                renderer = rough_map.renderer(min(level, len(of.levels) - 1), patch=of.name)
                images[frame] += np.nansum(numbers, dtype=float) * renderer.pixel[0] * renderer.pixel[1]
    assert np.allclose(points, forces, rtol=1e-5) and np.allclose(images, forces, rtol=1e-5)
    assert np.allclose([stamps[frame] for frame in range(6)], rough_readings.timestamps, atol=1e-9)


# ---- rerun


@levels
def test_rerun_shows_forces_at_their_times(level, rough_map, rough_readings, forces, monkeypatch):
    rerun = pytest.importorskip("rerun")
    import dermatome.rerun as adapter

    logged, at = [], []
    monkeypatch.setattr(rerun, "log", lambda path, *parts, **_: logged.append((path, parts)))
    monkeypatch.setattr(rerun, "set_time", lambda name, **when: at.append((name, when)))
    adapter.log(rough_map, rough_readings, level=level, channel=0)
    totals = [float(parts[0].scalars.as_arrow_array()[0].as_py()) for path, parts in logged if path == "skin/total"]
    assert np.allclose(totals, forces, rtol=1e-5)
    assert [when["duration"] for name, when in at if name == "time"] == rough_readings.timestamps.tolist()
    assert [when["sequence"] for name, when in at if name == "frame"] == list(range(6))


# ---- xarray and pandas


def test_xarray_keeps_forces_places_and_times(rough_map, rough_readings, forces):
    pytest.importorskip("xarray")
    array = rough_readings.to_xarray(rough_map)
    on_skin = array.sel(channel="force")[:, rough_map.present == 1]
    assert np.allclose(on_skin.sum("taxel"), forces) and np.array_equal(array.time, rough_readings.timestamps)
    for name, patch in rough_map.patches.items():
        of = array.patch == name
        assert is_inside(parts_of(patch, np.stack([array.u[of], array.v[of]], axis=1))), name
    back = dermatome.Readings.from_xarray(rough_readings.to_xarray())
    assert np.array_equal(back.values, rough_readings.values, equal_nan=True) and back.extensive == rough_readings.extensive
    assert np.array_equal(back.timestamps, rough_readings.timestamps)


def test_pandas_keeps_forces_and_times(rough_map, rough_readings, forces):
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame(rough_readings.values[:, 0], index=rough_readings.timestamps)
    back = replace(dermatome.Readings.from_pandas(table, units="N"), ids=None)
    for level in range(rough_map.n_levels):
        assert np.allclose(np.nansum(back.pooled(rough_map, level)[:, 0], axis=1), forces, rtol=1e-5)
    assert np.array_equal(back.timestamps, rough_readings.timestamps)

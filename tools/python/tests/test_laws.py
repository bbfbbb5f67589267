"""What every adapter keeps, on one uneven skin: forces, places on maps, times, and who is touched."""

import copy
import pickle
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

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

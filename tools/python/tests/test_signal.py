"""Images, contacts, recordings, calibration and pictures."""

import copy
import pickle
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import dome, lattice

import dermatome
from dermatome import _dermatome


def test_images_of_a_batch_are_those_of_one_frame_and_of_the_command(dome_map, tmp_path):
    values = np.random.default_rng(3).random((50, 2, 256)).astype(np.float32)
    values[30, 0, 100:110] = np.nan
    renderer = dome_map.renderer(1, channels=2, size=(48, 40))
    images = renderer(values)
    assert images.shape == (50, 2, 48, 40) and images.dtype == np.float32 and renderer.shape == (48, 40)
    assert np.array_equal(renderer(values, threads=1), images, equal_nan=True)
    for same in (values.astype(float), values.astype(">f4"), np.asfortranarray(values)):
        assert np.array_equal(renderer(same), images, equal_nan=True)
    assert renderer(values[:0]).shape == (0, 2, 48, 40)
    for k in range(50):
        assert np.array_equal(renderer(values[k : k + 1])[0], images[k], equal_nan=True)
    assert np.isnan(images[:, :, ~renderer.mask]).all() and np.isfinite(images[0][:, renderer.mask]).all()
    dome_map.write(tmp_path / "map.glb")
    dermatome.Readings.from_arrays(values, ids=dome_map.ids).write(tmp_path / "values.npz")
    command = ["render", "map.glb", "values.npz", "-o", "out.npz", "--level", "1", "--size", "48", "40", "--quiet"]
    subprocess.run([sys.executable, "-m", "dermatome", *command], check=True, cwd=tmp_path)
    assert np.array_equal(np.load(tmp_path / "out.npz")["dome.L1.image"], images, equal_nan=True)
    assert np.array_equal(np.load(tmp_path / "out.npz")["dome.L1.taxel_id"], renderer.taxel_id)
    filled = dome_map.renderer(1, channels=2, size=(48, 40), fill=0.0)(values)
    assert np.array_equal(filled, np.nan_to_num(images))
    mixed = dome_map.renderer(1, channels=2, size=(48, 40), extensive=[False, True])(values)
    assert np.array_equal(mixed[:, 0], images[:, 0], equal_nan=True) and np.nanmax(mixed[:, 1]) > 10 * np.nanmax(images[:, 1])
    with pytest.raises(dermatome.DataError, match="extensive: found 3; needed: one, or 2"):
        dome_map.renderer(channels=2, extensive=[True, True, False])


@pytest.mark.parametrize("size", [None, (12, 12), (200, 200)])
@pytest.mark.parametrize("level", [0, 1])
def test_the_matrix_draws_the_images(dome_map, tube_map, level, size):
    for map in (dome_map, tube_map):
        renderer = map.renderer(level, size=size)
        values = np.random.default_rng(4).random((3, map.n_taxels))
        drawn = renderer(values)[:, 0].reshape(3, -1)
        product = (renderer.matrix().scipy() @ map.pool(values, level).astype(float).T).T
        covered = renderer.mask.ravel()
        assert np.allclose(drawn[:, covered], product[:, covered], atol=1e-5)
        assert (product[:, ~covered] == 0).all()


def test_images_take_any_leading_axes(dome_map):
    values = np.random.default_rng(8).random((2, 5, 3, 256))
    values[0, 1, 2, 30:50] = np.nan
    one, three = dome_map.renderer(size=[20, 16]), dome_map.renderer(size=[20, 16], channels=3)
    expected = np.stack([three(part) for part in values])
    assert expected.shape == (2, 5, 3, 20, 16)
    for renderer in (one, three, dome_map.renderer(size=(20, 16), extensive=[False] * 3)):
        assert np.array_equal(renderer(values), expected, equal_nan=True)
        frame = expected[0, 1, :, None] if renderer is one else expected[0, 1]  # Without `channels` two axes are frames and taxels.
        assert np.array_equal(renderer(values[0, 1]), frame, equal_nan=True)
    assert np.array_equal(one(values[1, 0, 0]), expected[1, 0, :1], equal_nan=True)
    assert np.array_equal(one(values[1, :, 0]), expected[1, :, :1], equal_nan=True)
    single = dome_map.renderer(size=(20, 16), channels=1)
    assert single(values[:, :, :1]).shape == (2, 5, 1, 20, 16) and single(values[0, 0, 0]).shape == (1, 20, 16)
    assert one(np.zeros((2, 0, 256))).shape == (2, 0, 20, 16) and one(np.zeros((0, 256))).shape == (0, 1, 20, 16)
    for renderer, wrong in ((single, values), (three, values[:, :, 0]), (one, values[..., :9]), (one, 3.0), (three, values[0, 0, 0])):
        with pytest.raises(dermatome.DataError, match="values: found shape .*needed: shape .*256"):
            renderer(wrong)
    # The last channel of a mask: 1 where all others are known.
    values[:, :, :, 100:130] = np.nan
    for fill in (None, -2.0):
        bare = dome_map.renderer(size=(20, 16))(values)
        for channels in (None, 3):
            masked = dome_map.renderer(size=(20, 16), channels=channels, fill=fill, mask=True)(values)
            assert masked.shape == (2, 5, 4, 20, 16)
            assert np.array_equal(masked[:, :, 3], np.isfinite(bare).all(axis=2))
            filled = bare if fill is None else np.nan_to_num(bare, nan=fill)
            assert np.array_equal(masked[:, :, :3], filled, equal_nan=True)


@pytest.mark.parametrize("options", [{"pack": "tight", "size": [90, 70]}, {"pack": "body"}, {"patch": 1, "size": [40, 60]}, {"patch": 0}])
def test_points_and_pixels_are_inverse(uneven_map, options):
    names, index = list(uneven_map.patches), uneven_map.index()
    options = {**options, "patch": names[options["patch"]]} if "patch" in options else options
    for level in range(uneven_map.n_levels if "pack" in options else 1):
        renderer = uneven_map.renderer(level, **options)
        drawn = [names.index(chart["patch"]) for chart in renderer.charts]
        patch, of_level, place = uneven_map.fields(level)
        centres = np.array([uneven_map.patches[names[p]].levels[n].positions[k] for p, n, k in zip(patch, of_level, place)])
        hits = index.locate(centres + [0, 0, 1e-4], level=level)
        pixels = renderer.pixels(hits)
        shown = np.isin(patch, drawn)
        assert np.isfinite(pixels).all(axis=1).tolist() == shown.tolist()
        back, points, normals, off_chart = renderer.to_skin(*pixels[shown].T)
        assert np.array_equal(back, patch[shown]) and off_chart.max() < 1e-9
        assert np.allclose(points, centres[shown], atol=1e-9) and np.allclose(normals, [0, 0, 1])
        # A pixel shows the patch, the field and the place that it is of.
        rows, columns = np.nonzero(renderer.mask)
        back, points, _, off_chart = renderer.to_skin(rows, columns)
        assert np.array_equal(back, renderer.patch[renderer.mask]) and off_chart.max() < 1e-7
        assert (renderer.patch[~renderer.mask] == -1).all() and (renderer.field[~renderer.mask] == -1).all()
        again = renderer.pixels(index.locate(points, level=0)) if level == 0 else None
        assert again is None or np.allclose(again, np.stack([rows, columns], axis=1), atol=1e-6)
        shown_by = renderer.field[rows, columns]
        assert np.array_equal(patch[shown_by], back)
        nearest = np.array([np.linalg.norm(centres[patch == p] - x, axis=1).min() for p, x in zip(back, points)])
        assert np.linalg.norm(centres[shown_by] - points, axis=1) == pytest.approx(nearest, abs=1e-6)
        for chart in renderer.charts:
            (row, column), frame = chart["corner"], chart["frame"]
            height, width = frame.pixels
            inside = renderer.patch[row : row + height, column : column + width] == names.index(chart["patch"])
            assert inside.sum() == (renderer.patch == names.index(chart["patch"])).sum()
            assert (frame.height, frame.width) == pytest.approx((height * renderer.pixel[0], width * renderer.pixel[1]))
    far = renderer.to_skin([-5, 1000], [3, 3])
    assert (far[3] > 0).all() and np.isfinite(far[1]).all()
    for wrong, text in (
        (lambda: renderer.pixels(index.locate(centres, level=None)), "hits without places"),
        (lambda: renderer.to_skin([np.nan], [1]), r"rows\[0\]: found NaN"),
        (lambda: renderer.to_skin([1, 2], [1]), "columns: found shape"),
        (lambda: uneven_map.renderer(1, pack=True).pixels(index.locate(centres[-1:], level=0)), "level 0 of hit 0; needed: hits on the map: locate.*level=1"),
    ):
        with pytest.raises(dermatome.DataError, match=text):
            wrong()


def test_forces_keep_their_total(dome_map):
    renderer = dome_map.renderer(0, extensive=True)
    forces = np.zeros((1, 256))
    forces[0, [30, 77]] = [2.0, 3.0]
    assert np.nansum(renderer(forces)) * np.prod(renderer.pixel) == pytest.approx(5.0, rel=1e-5)


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_numbers_beyond_32_bits_are_missing(dome_map, kind):
    values = np.random.default_rng(5).random((20, 256)).astype(kind)
    missing = values.copy()
    missing[3:19, 70:90], missing[:, 9] = np.nan, np.nan
    for huge in (1e300, -np.inf, 3.5e38):
        given = values.copy()
        with np.errstate(over="ignore"):
            given[3:19, 70:90], given[:, 9] = huge, huge
        for level in (0, 1):
            assert np.array_equal(dome_map.pool(given, level), dome_map.pool(missing, level), equal_nan=True)
            for options in ({}, {"extensive": True, "fill": -1.0}):
                renderer = dome_map.renderer(level, size=(32, 32), **options)
                assert np.array_equal(renderer(given), renderer(missing), equal_nan=True)
    most = np.full((17, 256), 3e38)
    assert not np.isinf(dome_map.renderer(extensive=True)(most)).any()
    assert not np.isinf(dome_map.pool(most, 1, extensive=True)).any()


def test_several_patches_are_packed_or_named():
    first = lattice(8, 8)[0]
    both = np.concatenate([first, first + [0.2, 0, 0]])
    map = dermatome.build(dermatome.Skin.from_arrays(both, outside=(0, 0, 1)))
    assert len(map.patches) == 2
    values = np.ones((2, 128))
    assert map.renderer(0, pack=True)(values).shape[0] == 2
    assert map.renderer(0, pack="body").mask.any()
    with pytest.raises(dermatome.DataError, match="tight"):
        map.renderer(0, pack="loose")
    name = list(map.patches)[1]
    assert map.patches[name].start == 64
    values[:, :64] = 7
    assert np.nanmax(map.renderer(0, patch=name)(values)) == 1
    for options in ({}, {"pack": True, "patch": name}, {"pack": "body", "patch": name}):
        with pytest.raises(dermatome.DataError, match="patch: found"):
            map.renderer(0, **options)
    assert map.renderer(0, pack=False, patch=name).mask.any()


def test_a_patch_without_the_level_answers_with_its_coarsest():
    small, large = lattice(4, 4)[0], lattice(24, 24)[0]
    both = np.concatenate([small, large + [0.5, 0, 0]])
    map = dermatome.build(dermatome.Skin.from_arrays(both, outside=(0, 0, 1)))
    coarsest = map.n_levels - 1
    forces = np.ones((3, len(both)))
    pooled = map.pool(forces, coarsest, extensive=True)
    assert pooled.sum(axis=1) == pytest.approx([len(both)] * 3)
    assert map.pooling(coarsest).shape[1] == pooled.shape[1]
    renderer = map.renderer(coarsest, pack=True, extensive=True)
    assert np.nansum(renderer(forces[:1])) * np.prod(renderer.pixel) == pytest.approx(len(both), rel=1e-5)


def test_a_contact_is_followed(dome_map):
    tracker = dermatome.ContactTracker(dome_map, unit="Pa", threshold=100.0)
    events = []
    for pressed in ([], [100, 101, 116], [101, 102, 117], []):
        values = np.zeros(256)
        values[pressed] = 2000.0
        events += [(c["event"], sorted(c["taxels"].tolist()), c["track"]) for c in tracker.track(values)]
    assert events == [("onset", [100, 101, 116], 0), ("move", [101, 102, 117], 0), ("release", [101, 102, 117], 0)]
    assert tracker.threshold == 100.0


def test_touches_are_said_in_words(dome_map):
    readings, _ = dermatome.touch(dome_map, presses=2, roll=0.0, seed=5)
    detector = dermatome.EventDetector(dome_map, unit="N", tap_s=0.2, words=[(dome_map.patches["dome"].link, (1, 0, 0), "on")])
    frames = zip(readings.timestamps, readings.values[:, 0], strict=True)
    events = [event for time, values in frames for event in detector.see(time, values)] + detector.finish()
    assert [(event["event"], event["phase"]) for event in events] == [("touch", "begin"), ("press", "end")] * 2
    press = events[1]
    assert press["force_peak"] > 0.5 and len(press["taxels"]) > 2 and set(press["from"]) == set("xyzuv")
    assert detector.at_once == 1 and detector.threshold is not None
    finger = dermatome.ContactTracker(dome_map, unit="N", probe="finger")
    for time, values in zip(readings.timestamps, readings.values[:, 0], strict=True):
        finger.track(values, time)
    assert finger.at_once == 1
    with pytest.raises(TypeError, match="ContactTracker of fingers"):
        pickle.dumps(finger)
    for wrong in ({"tap": 1.0}, {"tap_s": 3.0}, {"pat_taps": -1}, {"probe": "hand"}, {"words": [("no", (1, 0, 0), "on")]}):
        with pytest.raises(dermatome.DataError):
            dermatome.EventDetector(dome_map, **wrong)
    for time, values in ((np.nan, np.zeros(256)), (0.0, np.zeros(3))):
        with pytest.raises(dermatome.DataError):
            dermatome.EventDetector(dome_map).see(time, values)


def test_changes_between_two_files_are_listed(tmp_path):
    places = np.array([[0.005 * x, 0.005 * y, 0] for x in range(8) for y in range(8)])
    for name, moved in (("a.csv", 0.0), ("b.csv", 0.002)):
        places[20, 0] += moved
        rows = (f"{k + 1},{x},{y},{z}" for k, (x, y, z) in enumerate(places))
        (tmp_path / name).write_text("\n".join(["taxel_id,x,y,z", *rows]) + "\n")
    assert dermatome.diff(tmp_path / "a.csv", tmp_path / "a.csv") == []
    [change] = dermatome.diff(tmp_path / "a.csv", tmp_path / "b.csv", modules={21: "m"})
    assert (change["kind"], change["taxels"].tolist()) == ("moved", [21])
    assert change["distance"] == pytest.approx(0.002, abs=1e-4)
    with pytest.raises(dermatome.DataError):
        dermatome.diff(tmp_path / "a.csv", tmp_path / "b.csv", sigma=0.0)


@pytest.mark.parametrize("threshold", [None, 0.5])
@pytest.mark.parametrize("lasting", [1, 3])
@pytest.mark.parametrize("probe", ["any", "foot"])
def test_a_copied_tracker_goes_on(dome_map, threshold, lasting, probe):
    rng = np.random.default_rng(6)
    options = {"threshold": threshold, "lasting": lasting, "noise_frames": 4, "unit": "N", "probe": probe}
    frames = rng.normal(0.1, 0.01, (30, 256))
    for frame in range(6, 27):
        frames[frame, [100 + frame // 4, 101 + frame // 4, 116 + frame // 4]] += 5
        if frame % 9 < 5:
            frames[frame, [200, 201, 185]] += 3
    whole = dermatome.ContactTracker(dome_map, **options)
    for frame, values in enumerate(frames):
        tracked = [copy.deepcopy(whole), pickle.loads(pickle.dumps(whole)), dermatome.ContactTracker(dome_map, **options)]
        expected = [str(contact) for contact in whole.track(values)]
        for part in tracked[:2]:
            assert [str(contact) for contact in part.track(values)] == expected and repr(part) == repr(whole), frame
            for later in frames[frame + 1 : frame + 3]:
                part.track(later)
    assert whole.threshold is not None and "contacts, threshold" in repr(whole)
    state = whole.__reduce__()[1][2]
    for name, wrong in (("rest", np.zeros(3)), ("contacts", [{}]), ("next", -1), ("memory", np.zeros(7))):
        with pytest.raises((dermatome.DataError, OverflowError)):
            whole._resume({**state, name: wrong})


def test_a_copied_tracker_keeps_its_clock_and_votes(rough_map):
    """Half a second is a pause among frames of 2 ms and none among those of 0.3 s, and votes are of all frames."""
    values, rng = np.zeros((60, rough_map.n_taxels)), np.random.default_rng(2)
    values += rng.normal(0, 0.001, values.shape)
    values[10:, [100, 101, 300, 301]] += 5.0
    steps = np.where(np.arange(60) == 40, 0.7, 0.002)
    for times in (np.cumsum(steps), np.where(np.arange(60) >= 40, 100, 0) + np.arange(60) * 0.3, np.cumsum(steps) - np.where(np.arange(60) > 45, 1, 0)):
        for threshold in (None, 0.5):
            whole = dermatome.ContactTracker(rough_map, unit="N", threshold=threshold)
            part = dermatome.ContactTracker(rough_map, unit="N", threshold=threshold)
            for frame, time in zip(values, times.tolist()):
                part = pickle.loads(pickle.dumps(copy.copy(part)))
                assert [str(each) for each in part.track(frame, time)] == [str(each) for each in whole.track(frame, time)]
                assert part.at_once == whole.at_once
            assert whole.at_once > 0


def test_touches_have_their_truth(dome_map):
    readings, truth = dermatome.touch(dome_map, presses=1, seed=5)
    assert readings.units == ("N",) and readings.values.shape[2] == 256
    strongest = int(truth["frame"][np.argmax(truth["force"])])
    hits = dome_map.index().locate(truth["centre"][truth["frame"] == strongest])
    assert abs(hits.distance).max() < 2e-3
    again, _ = dermatome.touch(dome_map, presses=1, seed=5)
    assert np.array_equal(readings.values, again.values)


def test_recordings_are_read_by_id(dome_map, tmp_path):
    values = np.random.default_rng(6).random((4, 256))
    order = np.random.default_rng(7).permutation(256)
    dermatome.Readings.from_arrays(values[:, order], ids=dome_map.ids[order], timestamps=np.arange(4) / 100).write(tmp_path / "a.npz")
    read = dermatome.Readings.read(tmp_path / "a.npz", dome_map)
    assert np.array_equal(read.values[:, 0], values) and read.timestamps.tolist() == [0, 0.01, 0.02, 0.03]
    np.save(tmp_path / "a.npy", np.stack([values, values], axis=1))
    known = dermatome.Readings.read(tmp_path / "a.npy", dome_map, layout="tcn", channels=("force.N", "heat"), units=("N", "K"))
    assert (known.channels, known.units) == (("force.N", "heat"), ("N", "K")) and np.array_equal(known.values[:, 1], values)
    with pytest.raises(dermatome.DataError, match="channels: found 1; needed: 2"):
        dermatome.Readings.read(tmp_path / "a.npy", layout="tcn", channels=("heat",))
    (tmp_path / "b.csv").write_text("time,1.pressure[Pa],2.pressure[Pa]\n0,5,\n1,6,7\n")
    some = dermatome.Readings.read(tmp_path / "b.csv", dome_map)
    assert some.units == ("Pa",) and some.values[1, 0, :2].tolist() == [6, 7] and np.isnan(some.values[0, 0, 1:]).all()


def test_zeros_are_followed_or_given(dome_map):
    rng, frames = np.random.default_rng(3), 1200
    drift = np.linspace(0, 24, frames)[:, None, None]
    values = 1000 + drift + rng.normal(0, 1, (frames, 1, 256))
    readings = dermatome.Readings.from_arrays(values, ids=dome_map.ids, timestamps=np.arange(frames) / 10, units=("count",))
    followed = readings.condition(dome_map, zero="follow").values
    assert np.abs(followed).max() < 8 < 20 < np.abs(readings.condition(dome_map, baseline=10).values).max()
    for zero in (1000, np.full(256, 1000.0)):
        assert np.allclose(readings.condition(dome_map, zero=zero, gain=np.full(256, 2.0)).values, 2 * (readings.on(dome_map).values - 1000))
    with pytest.raises(dermatome.DataError, match="one of the two"):
        readings.condition(dome_map, zero="follow", baseline=3)
    with pytest.raises(dermatome.DataError, match="follow"):
        readings.condition(dome_map, zero="tracks")


def test_readings_are_made_comparable_as_the_command_does(dome_map, tmp_path):
    values = np.random.default_rng(11).normal(5, 1, (30, 1, 256))
    readings = dermatome.Readings.from_arrays(values, ids=dome_map.ids, timestamps=np.arange(30) / 50, units=("N",))
    readings.write(tmp_path / "values.npz")
    dome_map.write(tmp_path / "map.glb")
    (tmp_path / "gain.csv").write_text("id,gain\n7,2.5\n")
    options = ["--zero", "first=4", "--gain", "gain.csv", "--clip=-1,1", "--split", "5", "--layout", "tcn", "--values-only", "--quiet"]
    command = ["render", "map.glb", "values.npz", "-o", "out.npz", *options]
    subprocess.run([sys.executable, "-m", "dermatome", *command], check=True, cwd=tmp_path)
    written = np.load(tmp_path / "out.npz")
    made = readings.condition(dome_map, baseline=4, gain={7: 2.5}, clip=(-1, 1), split=5.0)
    assert made.channels == tuple(written["channels"]) and made.units == ("N", "N") and made.extensive == (True, True)
    assert np.array_equal(made.values.astype("f4"), written["dome.L0.values"])
    feature = made.features(dome_map)["observation.tactile.dome.L1"]
    assert feature["shape"] == feature["values"].shape[1:] and feature["valid"].all()
    assert np.array_equal(feature["values"], written["dome.L1.values"].reshape(30, -1))
    for shape in [(0, 1, 256), (3, 0, 256)]:
        empty = dermatome.Readings.from_arrays(np.empty(shape)).features(dome_map)["observation.tactile.dome.L1"]
        assert empty["values"].shape == (shape[0], *empty["shape"])
    with pytest.raises(dermatome.DataError, match="split: found readings without times"):
        dermatome.Readings.from_arrays(values).condition(dome_map, split=5.0)
    steady = dermatome.Readings.from_arrays(np.ones((3, 256))).condition(dome_map, split=5.0, rate=100.0)
    assert (steady.values[:, 1] == 0).all() and steady.timestamps.tolist() == [0, 0.01, 0.02]


def test_contrast_is_what_the_coarser_level_leaves(dome_map):
    values = np.random.default_rng(12).random((5, 256))
    up = dome_map.patches["dome"].levels[0].up().scipy()
    left = values - dome_map.pool(values, 1).astype(float) @ up.T
    assert np.allclose(dome_map.pool(values, 0, contrast=True), left, atol=1e-6)


def test_contacts_become_readings(dome_map):
    level = dome_map.patches["dome"].levels[0]
    index = dome_map.index(fields=True)
    readings, felt = index.readings(level.positions[[100, 37]] + 1e-4, [2.0, 3.0])
    assert readings.sum() == pytest.approx(5) and readings[100] > 1.5 and felt.all()
    above = level.positions[100] + 0.008 * level.normals[100]
    spheres, felt = index.readings([above, [9, 9, 9]], [2.0, 1.0], [0.01, 0.01])
    assert spheres.sum() == pytest.approx(2) and (spheres > 0).sum() > 3 and felt.tolist() == [True, False]
    with pytest.raises(dermatome.DataError, match="force: found shape"):
        index.readings(level.positions[:2], [1.0])


def test_calibration_finds_the_truth(tmp_path):
    observations, truth = dermatome.simulate(taxels=120, noise=1e-4, anchors=6, anchor_noise=1e-4, seed=8)
    found = dermatome.calibrate(observations)
    assert found.converged and found.covariances.shape == (120, 6)
    assert np.abs(found.positions - truth["positions"]).max() < 1e-3
    assert found.skin().n_taxels == 120
    observations.write(tmp_path / "o.g2o")
    again = dermatome.calibrate(tmp_path / "o.g2o", robust="none")
    assert np.abs(again.positions - found.positions).max() < 1e-4
    assert np.allclose((again.residuals[0][:, 0] ** 2).sum() + (again.residuals[1][:, 0] ** 2).sum(), again.chi2)
    assert again.skin(truth["faces"]).faces.shape == truth["faces"].shape
    assert dermatome.Observations.read(tmp_path / "o.g2o", clip_information=True).n_edges == observations.n_edges
    tilted, _ = dermatome.simulate(taxels=60, anchors=20, normal_noise=0.01, indentation=1e-3, arm_noise=1e-3)
    assert tilted.n_contacts == 20
    worse, outliers = dermatome.simulate(taxels=120, outliers=0.05, seed=9)
    assert set(dermatome.calibrate(worse, robust="gnc").rejected[0]) & set(outliers["outliers"])


def test_pictures(dome_map, tmp_path):
    picture = dome_map.plot(width=600)
    assert "dome, level 0" in picture._repr_svg_() and picture.svg() == picture._repr_svg_()
    assert "<svg" in dome_map.plot(unfold=[0, 0.5, 1], view=(30, 40), width=600).svg()
    dome_map.plot(np.arange(256.0), levels=[0], space=True).save(tmp_path / "readings.png")
    assert (tmp_path / "readings.png").read_bytes().startswith(b"\x89PNG")
    pixels = picture.array()
    assert pixels.dtype == np.uint8 and pixels.shape[1:] == (600, 3) and (pixels[0, 0] == 255).all() and pixels.min() < 100
    assert repr(picture) == f"<dermatome.Picture: {pixels.shape[0]} x 600 pixels>"
    shown = []
    axes = SimpleNamespace(imshow=shown.append, axis=shown.append)
    assert np.array_equal(dome_map.plot(width=600, levels=[0, 1], ax=axes).array(), shown[0]) and shown[1] == "off"


def test_axes_of_matplotlib_show_a_level_in_map_coordinates(rough_map):
    """What is drawn at the place of a taxel on the map is its reading."""
    pyplot = pytest.importorskip("matplotlib.pyplot")
    values = np.random.default_rng(1).random(rough_map.n_taxels)
    patch = rough_map.patches["tip of it"]
    level, read = patch.levels[0], values[patch.start :]
    figure, axes = pyplot.subplots()
    rough_map.plot(values, patches=["tip of it"], range=[0, 2], ax=axes)
    (image,) = axes.get_images()
    left, right, bottom, top = image.get_extent()
    assert left <= level.uv[:, 0].min() and right >= level.uv[:, 0].max() and bottom <= level.uv[:, 1].min() and top >= level.uv[:, 1].max()
    pixels = np.ma.filled(image.get_array().astype(float), np.nan)
    rows, columns = pixels.shape
    column = ((level.uv[:, 0] - left) / (right - left) * columns).astype(int).clip(0, columns - 1)
    row = ((top - level.uv[:, 1]) / (top - bottom) * rows).astype(int).clip(0, rows - 1)
    inside = np.isfinite(pixels[row, column])
    assert inside.mean() > 0.8 and np.abs(pixels[row, column] - read)[inside].max() < 0.35 and image.get_clim() == (0, 2)
    assert axes.get_aspect() == 1 and axes.get_xlabel() == "u (m)"
    figure, axes = pyplot.subplots()
    rough_map.plot(patches=["upper arm"], levels=[1], ax=axes)
    drawn = np.concatenate([line.get_xydata() for line in axes.get_lines()])
    assert {tuple(place) for place in rough_map.patches["upper arm"].levels[1].uv} <= {tuple(place) for place in drawn}
    pyplot.close("all")


def test_a_map_shows_itself(uneven_map, tmp_path):
    shown = uneven_map._repr_html_()
    assert "<svg" in shown and shown.count("<tr>") == 1 + sum(len(patch.levels) for patch in uneven_map.patches.values())
    skin = dermatome.Skin.from_arrays(*dome(), patch="<script>&", link="<b>")
    assert "<script>" not in dermatome.build(skin)._repr_html_() and "&lt;script&gt;&amp;" in dermatome.build(skin)._repr_html_()


@pytest.mark.parametrize("kind", ["gif", "mp4"])
def test_videos_show_the_frames(dome_map, tmp_path, kind):
    pytest.importorskip("imageio")
    pytest.importorskip("imageio_ffmpeg" if kind == "mp4" else "PIL")
    import imageio.v2 as imageio

    values = np.zeros((300, 2, 256))
    values[:, 1, 100:140] = np.linspace(0, 5, 300)[:, None]
    values[7, 1, 30:90] = np.nan
    renderer = dome_map.renderer(size=(21, 32))
    renderer.video(values, tmp_path / f"skin.{kind}", channel=1, rate=25, magnification=3)
    frames = imageio.mimread(tmp_path / f"skin.{kind}", memtest=False)
    assert frames[0].shape[:2] == (64, 96) and (kind == "gif" or len(frames) == 300)
    images = renderer(values)[:, 1]
    for shown, image in ((frames[0], images[0]), (frames[-1], images[-1])):
        wanted = _dermatome.colours(image[None], renderer.mask, [0, 5])[0].repeat(3, axis=0).repeat(3, axis=1)
        assert abs(shown[:63, :, :3].astype(float) - wanted).mean() < 12
    renderer.video(values[:3, 0], str(tmp_path / f"still.{kind}"), range=[-1, 1])
    for wrong in ({"channel": 2}, {"range": [1, 1]}, {"rate": 0}, {"channel": -1}):
        with pytest.raises(dermatome.DataError):
            renderer.video(values[:2], tmp_path / f"no.{kind}", **wrong)


def test_images_have_the_colours_of_the_command(dome_map):
    values = np.array([[[0.0, 0.5], [1.0, np.nan]]], dtype=np.float32)
    shown = _dermatome.colours(values, np.array([[True, True], [True, False]]), [0, 1])
    assert shown[0].tolist() == [[[68, 1, 84], [33, 145, 140]], [[253, 231, 37], [255] * 3]]


def test_findings_of_bad_arguments_name_them(dome_map):
    for call, text in [
        (lambda: dome_map.renderer(9), "level: found 9"),
        (lambda: dome_map.renderer()(np.zeros((2, 9))), "values: found shape (2, 9)"),
        (lambda: dome_map.pool(np.zeros(9), 1), "values: found shape (9,)"),
        (lambda: dermatome.ContactTracker(dome_map, threshold=-1.0), "threshold"),
        (lambda: dome_map.plot(unfold=[2.0]), "unfold: found 2"),
        (lambda: dermatome.build(dermatome.Skin.from_arrays(*dome()), acuity=np.zeros(256)), "acuity[0]: found 0"),
        (lambda: dermatome.Readings.from_arrays(np.zeros((2, 3)), ids=[1, 2]), "ids: found shape (2,)"),
        (lambda: dermatome.build(dermatome.Skin.from_arrays(*dome()), cut="maybe"), 'cut: found "maybe"'),
    ]:
        with pytest.raises(dermatome.DataError) as found:
            call()
        assert text in str(found.value)


def test_tared_readings_may_begin_under_load(dome_map):
    """A tracker that knows that readings are about 0 at rest subtracts nothing; so does a copy of it."""
    noise = np.random.default_rng(3).normal(0, 0.1, (40, dome_map.n_taxels))
    pressed = noise + np.where(np.isin(np.arange(dome_map.n_taxels), [100, 101, 116, 117]), 50.0, 0.0)
    found = {}
    for tared in (True, False):
        tracker = dermatome.ContactTracker(dome_map, tared=tared)
        for row in pressed[:10]:
            tracker.track(row)
        tracker = copy.deepcopy(tracker)
        found[tared] = [len(tracker.track(row)) for row in pressed[10:]]
        detector = dermatome.EventDetector(dome_map, tared=tared)
        events = [event for k, row in enumerate(pressed) for event in detector.see(0.05 * k, row)] + detector.finish()
        assert bool(events) == tared, events
    assert found == {True: [1] * 30, False: [0] * 30}


def test_zeros_and_gains_concern_channels_of_touch(rough_map, rough_readings):
    """As by the command: a temperature stays as it is, unless there is a number for each channel."""
    first = rough_readings.select(["heat", "force", "pressure"])
    plain = first.condition(rough_map).values
    for options in ({"zero": 0.25}, {"baseline": np.full(489, 0.25)}, {"gain": np.full(489, 2.0)}, {"gain": dict.fromkeys(rough_map.ids.tolist(), 2.0)}):
        made = first.condition(rough_map, **options)
        assert np.allclose(made.values[:, 0], plain[:, 0], equal_nan=True), options
        assert not np.allclose(made.values[:, 1], plain[:, 1], equal_nan=True), options
    every = first.condition(rough_map, gain=np.full((3, 489), 2.0))
    assert np.allclose(every.values, 2 * plain, equal_nan=True)
    with pytest.raises(dermatome.DataError, match="gain: found the channels"):
        first.select("heat").condition(rough_map, gain=np.full(489, 2.0))
    assert first.summary(rough_map, threshold=0)[0]["force_peak"] == rough_readings.summary(rough_map, threshold=0)[0]["force_peak"]

"""Named regions and the sums of a trial."""

import copy
import json
import pickle
import subprocess
import sys

import dermatome
import dermatome.lerobot
import numpy as np
import pytest
from dermatome import Readings
from dermatome.recordings import AREAS


@pytest.fixture(scope="module")
def hand():
    """A sheet of 12 x 12 taxels: ids 1 to 72 are the palm, 133 to 144 the tip of the thumb."""
    grid = [[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(12)]
    made = dermatome.build(dermatome.Skin.from_arrays(grid, outside=(0, 0, 1)))
    return made.with_regions({"palm": range(1, 73), "tip of thumb": range(133, 145)})


def test_regions_travel_with_the_map(hand, tmp_path):
    assert hand.regions == ("palm", "tip of thumb")
    expected = np.select([hand.ids <= 72, hand.ids >= 133], [0, 1], -1)
    assert np.array_equal(hand.region_of, expected)
    for other in (pickle.loads(pickle.dumps(hand)), copy.deepcopy(hand)):
        assert other == hand and other.regions == hand.regions
    hand.write(tmp_path / "map.glb")
    assert np.array_equal(dermatome.Map.read(tmp_path / "map.glb").region_of, expected)
    (tmp_path / "r.csv").write_text("taxel_id,region\n100,back\n")
    assert hand.with_regions(tmp_path / "r.csv").regions == ("palm", "back", "tip of thumb")
    low, high = (getattr(hand.patches["skin"].levels[0].uv, of)(axis=0) for of in ("min", "max"))
    corners = [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]]
    (tmp_path / "p.json").write_text(json.dumps([{"patch": "skin", "region": "all", "uv": corners}]))
    assert "all" in hand.with_regions(tmp_path / "p.json").regions
    hits = hand.index().locate(hand.patches["skin"].levels[0].positions, level=0)
    assert np.array_equal(hits.region, expected) and np.array_equal(pickle.loads(pickle.dumps(hits)).region, expected)
    renderer = hand.renderer(0)
    assert np.array_equal(renderer.region[renderer.mask], expected[renderer.field[renderer.mask]])


@pytest.mark.parametrize(
    ("regions", "said"),
    [({"palm": [5000]}, "5000"), ({"palm": []}, "no taxel"), ({"": [1]}, "1 to 100"), ("missing.csv", "missing.csv"), ("a.txt", "unknown kind")],
)
def test_regions_that_are_none(hand, regions, said):
    with pytest.raises(dermatome.Error, match=said):
        hand.with_regions(regions)


def test_pools_are_sums_and_weighted_means(hand):
    values = np.arange(288, dtype=float).reshape(2, 144)
    areas = hand.patches["skin"].levels[0].areas
    sums, means = hand.pool_regions(values, extensive=True), hand.pool_regions(values)
    for k in range(2):
        chosen = hand.region_of == k
        assert np.allclose(sums[:, k], values[:, chosen].sum(axis=1))
        assert np.allclose(means[:, k], values[:, chosen] @ areas[chosen] / areas[chosen].sum())
    values[:, :72] = np.nan
    assert np.isnan(hand.pool_regions(values)[:, 0]).all()
    readings = Readings.from_arrays(np.ones((3, 1, 144)), channels=["force"], units=["N"])
    assert np.array_equal(readings.by_region(hand), np.tile([[[72, 12]]], (3, 1, 1)))
    by_area = readings.by_area(hand)
    assert by_area.shape == (3, 1, 24) and np.array_equal(by_area[0, 0, [AREAS.index("tip of thumb"), AREAS.index("palm")]], [12, 72])
    assert np.isnan(np.delete(by_area, [0, 5], axis=2)).all()
    with pytest.raises(dermatome.DataError, match="regions named as"):
        readings.by_area(hand.with_regions({"other": hand.ids}))


def test_sums_of_a_trial(hand):
    values = np.zeros((4, 1, 144))
    values[1:3, 0, 139:141] = [1.0, 2.0]
    readings = Readings.from_arrays(values, timestamps=np.arange(4) / 10, channels=["force"], units=["N"])
    rows = {(row["group"], row["name"]): row for row in readings.summary(hand, threshold=0)}
    assert {group for group, _ in rows} == {"whole", "link", "patch", "region", "contact"}
    whole, tip, palm = rows["whole", ""], rows["region", "tip of thumb"], rows["region", "palm"]
    assert whole["impulse"] == pytest.approx(0.6) and tip["impulse"] == pytest.approx(0.6) and palm["impulse"] == 0
    assert tip["first_contact"] == pytest.approx(0.1) and tip["contact_time"] == pytest.approx(0.2) and tip["peak_taxel_id"] == 141
    assert palm["first_contact"] is None and palm["mean"] is None
    with pytest.raises(dermatome.DataError, match="channel"):
        readings.summary(hand, channel="heat")


def test_images_of_areas_are_written(hand, tmp_path):
    pytest.importorskip("numcodecs")
    values = np.random.default_rng(0).random((5, 144))
    np.savez(tmp_path / "r.npz", values=values, timestamps=np.arange(5) / 10, units=["N"], channels=["force"])
    recording = Readings.open(tmp_path / "r.npz")
    recording.write_oxt(tmp_path / "o.zarr", hand, 0)
    back = Readings.open(tmp_path / "o.zarr")
    assert back.says["area"] == [0, 5]
    images = np.concatenate([values for _, values in back.raw()])
    renderer = hand.renderer(0, extensive=True)
    drawn = renderer(values)[:, 0]
    for k, region in enumerate((1, 0)):
        mask = renderer.mask & (renderer.region == region)
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
        expected = np.where(mask, drawn, 0)[(slice(None), *box)]
        # A pixel as far from a taxel of the region as from one outside may be of either.
        same = np.isclose(images[:, k, : expected.shape[1], : expected.shape[2]], expected, rtol=1e-5, atol=1)
        assert same.mean() > 0.99
    with pytest.raises(dermatome.DataError, match="areas"):
        recording.write_oxt(tmp_path / "p.zarr", hand.with_regions({"other": hand.ids}), 0)


def test_modalities_have_levels_of_their_own(tmp_path):
    rows = [f"{12 * y + x + 1},{0.005 * x},{0.005 * y},0,{'thermal' if x % 4 == y % 4 == 1 else ''}" for y in range(12) for x in range(12)]
    (tmp_path / "skin.csv").write_text("id,x,y,z,modality\n" + "\n".join(rows))
    made = dermatome.build(dermatome.Skin.read(tmp_path / "skin.csv"))
    assert made.field_levels[:2] == ("skin.thermal.L0", "skin.thermal.L1") and pickle.loads(pickle.dumps(made)) == made
    values = np.where(made.present == 2, 30.0, 1.0)
    assert (made.present == 2).sum() == 9
    for name in made.field_levels:
        assert np.allclose(made.pool(values, level=name), 30)
    assert made.pool(values, level="skin.thermal.L0").shape == (9,)
    with pytest.raises(dermatome.DataError, match="field_levels"):
        made.pool(values, level="skin.thermal.L9")


def skin_of_two_patches(folder, has_pads=(True, True)):
    """Two patches of 12 x 12 taxels, of which nine are thermal pads."""
    rows = [
        f"{144 * right + 12 * y + x + 1},{0.065 * right + 0.005 * x},{0.005 * y},0,{'thermal' if has_pads[right] and x % 4 == y % 4 == 1 else ''},{name}"
        for right, name in enumerate(["arm", "hand"])
        for y in range(12)
        for x in range(12)
    ]
    (folder / "skin.csv").write_text("id,x,y,z,modality,patch\n" + "\n".join(rows))
    return dermatome.Skin.read(folder / "skin.csv")


def test_readings_of_pads_are_those_of_pads(tmp_path):
    """Pressures and temperatures of a patch with thermal pads and of one without: by id and in the order of the map, of each
    adapter the same."""
    made = dermatome.build(skin_of_two_patches(tmp_path, (True, False))).with_regions({"tip": range(1, 60)})
    pads, arm = made.present == 2, made.patch_of == 0
    values, order = np.random.default_rng(2).random((3, 2, 288)), np.random.default_rng(3).permutation(288)
    about = {"timestamps": np.arange(3) * 0.1, "channels": ["pressure", "temperature"], "units": ["kPa", "degC"]}
    by_id = dermatome.Readings.from_arrays(values[:, :, order], ids=made.ids[order], **about)
    by_order = dermatome.Readings.from_arrays(values, **about)
    assert by_id.modalities(made) == (None, "thermal")
    joined = by_id.on(made).values
    assert np.array_equal(np.isfinite(joined[0]), [~pads, pads | ~arm]) and np.array_equal(joined[np.isfinite(joined)], values[np.isfinite(joined)])
    by_id.write(tmp_path / "a.npz")
    (chunk,) = dermatome.Readings.open(tmp_path / "a.npz").chunks(made)
    for read in (dermatome.Readings.read(tmp_path / "a.npz", made), chunk):
        assert np.array_equal(read.values, joined, equal_nan=True)
    for level in [*range(made.n_levels), "arm.thermal.L0", "body.L0"]:
        fields = by_id.pooled(made, level)
        assert np.array_equal(fields, by_order.pooled(made, level), equal_nan=True)
    assert np.isnan(by_order.pooled(made, "arm.thermal.L0")[:, 0]).all() and np.isfinite(by_order.pooled(made, "arm.thermal.L0")[:, 1]).all()
    for level in range(made.n_levels):
        count = len(made.patches["arm"].levels[min(level, len(made.patches["arm"].levels) - 1)].areas)
        heat = by_id.pooled(made, level)[:, 1, :count]
        known = heat[np.isfinite(heat)]
        assert len(known) and values[:, 1, pads].min() - 1e-6 <= known.min() and known.max() <= values[:, 1, pads].max() + 1e-6
    assert np.isfinite(by_id.pooled(made, "body.L0")).all()
    assert all(each["valid"].all() for each in by_id.features(made, "arm.thermal.L0").values())
    assert np.array_equal(by_id.by_region(made), by_order.by_region(made)) and np.isfinite(by_id.by_region(made)).all()
    how = {"extensive": by_id.extensive, "modality": by_id.modalities(made)}
    renderer = pickle.loads(pickle.dumps(made.renderer(0, patch="arm", **how)))
    drawn = renderer(by_order.values)
    assert np.array_equal(drawn, renderer(joined), equal_nan=True)
    assert set(drawn[0, 1][np.isfinite(drawn[0, 1])]) and renderer.matrix(1).shape == renderer.matrix(0).shape
    for channel in (0, 1):
        shown = np.flatnonzero(np.bincount(renderer.matrix(channel).indices, minlength=288))
        assert set(shown) <= set(np.flatnonzero((pads if channel else ~pads) & arm))
    assert "<svg" in made.plot(values[0, 1], modality="thermal").svg()
    with pytest.raises(dermatome.DataError, match='modality: found "heat"; needed: None for touch, or one of the map: "thermal"'):
        made.pool(values, 1, modality="heat")
    with pytest.raises(dermatome.DataError, match="modality: found 3"):
        made.renderer(0, patch="arm", channels=2, modality=["thermal", None, None])


def test_modalities_have_levels_of_the_whole_body(tmp_path):
    made = dermatome.build(skin_of_two_patches(tmp_path))
    assert {"arm.thermal.L0", "hand.thermal.L0", "body.L0", "body.thermal.L0"} <= set(made.field_levels)
    values = np.where(made.present == 2, 30.0, np.nan)
    assert np.allclose(made.pool(values, level="body.thermal.L0"), 30)
    heat = values + np.arange(12)[:, None, None]
    readings = dermatome.Readings(heat, made.ids, np.arange(12) * 0.1, ("temperature",), ("degC",))
    sums = readings.summary(made, level="body.thermal.L0")
    fields = [row for row in sums if row["group"] == "field"]
    assert len(fields) == made.pool(values, level="body.thermal.L0").shape[-1]
    assert all(row["peak"] == sums[0]["peak"] for row in fields) and sums[0]["taxels"] == 18
    with pytest.raises(dermatome.DataError, match="readings of thermal"):
        pressures = dermatome.Readings(np.ones((5, 1, 288)), made.ids, np.arange(5) * 0.1, ("pressure",), ("Pa",))
        pressures.summary(made, threshold=0.5, level="body.thermal.L0")


def test_levels_without_a_mesh_are_levels_everywhere(tmp_path):
    rows = [
        f"{144 * right + 12 * y + x + 1},{0.065 * right + 0.005 * x},{0.005 * y},0,{name}"
        for right, name in enumerate(["arm", "body"])
        for y in range(12)
        for x in range(12)
    ]
    (tmp_path / "skin.csv").write_text("id,x,y,z,patch\n" + "\n".join(rows))
    made = dermatome.build(dermatome.Skin.read(tmp_path / "skin.csv")).with_regions({"left": range(1, 145), "right": range(145, 289)})
    count = made.n_fields("body.L0")
    values = np.random.default_rng(3).uniform(1, 2, (4, 2, 288))
    values[:, :, 7] = np.nan
    # The law of fields, by the matrix of the level.
    to_fields, known = made.pooling("body.L0"), np.isfinite(values)
    weights = np.zeros(to_fields.shape)
    weights[np.repeat(np.arange(288), np.diff(to_fields.indptr)), to_fields.indices] = to_fields.data
    assert weights.shape == (288, count) and np.allclose(weights.sum(axis=1), 1)
    assert np.allclose(made.pool(values, "body.L0", extensive=True), np.where(known, values, 0) @ weights)
    assert made.pooling("body.L0", patch="body").shape == (144, count)
    # Frames are shared among threads, whose number is checked.
    many = np.random.default_rng(4).random((200, 288))
    one = made.pool(many, "body.L0", threads=1)
    assert np.array_equal(one, made.pool(many, "body.L0", threads=3)) and np.array_equal(one[150], made.pool(many[150], "body.L0"))
    for wrong in (-1, 10**6):
        with pytest.raises(dermatome.DataError, match="threads: found"):
            made.pool(many, "body.L0", threads=wrong)
    # Fields on both sides of the gap.
    regions = made.field_regions("body.L0")
    assert regions.shape == (count,) and set(regions) == {0, 1} and len(made.field_regions(1)) == made.n_fields(1)
    hits = made.index().locate([[0.0575, 0.02, 0.001], [np.nan] * 3, [0.1, 0.03, 0]], level="body.L0")
    shares = hits.fields
    assert hits.uv is None and hits.pixel is None and shares.shape == (3, count)
    assert np.allclose(np.add.reduceat(shares.data, shares.indptr[[0, 2]]), 1) and shares.indptr[1] == shares.indptr[2]
    assert list(hits.level) == [0, -1, 0] and hits.field[1] == -1 and list(hits.region == -1) == [False, True, False]
    assert all(hits.region[k] == regions[hits.field[k]] for k in (0, 2))
    # What a dataset keeps is what the command writes.
    readings = dermatome.Readings(values, made.ids, np.arange(4) * 0.1, ("p", "q"), ("Pa", "N"))
    kept = readings.features(made, "body.L0")
    assert {key: each["shape"] for key, each in kept.items()} == {"observation.tactile.body.L0": (2 * count,)}
    pooled = readings.pooled(made, "body.L0")
    assert np.array_equal(kept["observation.tactile.body.L0"]["values"], pooled.reshape(4, -1))
    made.write(tmp_path / "map.glb")
    readings.write(tmp_path / "r.npz")
    render = ["render", tmp_path / "map.glb", tmp_path / "r.npz", "-o", tmp_path / "o.npz", "--values-only", "-q"]
    subprocess.run([sys.executable, "-m", "dermatome", *map(str, render)], check=True)
    of_command = json.loads((tmp_path / "o.features.json").read_text())
    for level in (0, "body.L0"):
        assert set(readings.features(made, level)) <= set(of_command), level
        assert set(dermatome.lerobot.masks(made, level)) == set(readings.features(made, level))
        of_frame = dermatome.lerobot.frame(made, values[0, 0], level)
        assert {key: each.shape for key, each in of_frame.items()} == {key: each["shape"] for key, each in dermatome.lerobot.features(made, level).items()}
    for call in (made.n_fields, made.pooling, made.field_regions, lambda level: made.index().locate([[0, 0, 0]], level=level)):
        with pytest.raises(dermatome.DataError, match=r"body\.L9.*body\.L0"):
            call("body.L9")
        with pytest.raises(dermatome.ArgumentError, match="level: found"):
            call([1])


def test_steps_are_rows_of_a_summary():
    made = dermatome.build(dermatome.Skin.from_arrays([[0.01 * x, 0.01 * y, 0] for y in range(4) for x in range(6)], patch="left sole"))
    values = np.zeros((100, 1, 24))
    values[10:40], values[60:80] = 2e4, 3e4
    readings = dermatome.Readings(values, None, np.arange(100) * 0.01, ("pressure",), ("Pa",), is_tared=True)
    steps = readings.summary(made, threshold=1000, by="step")
    of_patch = [step for step in steps if step["group"] == "patch"]
    assert [(step["step"], step["side"], step["frames"]) for step in of_patch] == [(0, "left", 30), (1, "left", 20)]
    assert np.allclose([step["peak"] for step in of_patch], [2e4, 3e4])
    groups = readings.summary(made, threshold=1000)
    whole = groups[0]
    assert np.isclose(sum(step["impulse"] for step in of_patch), whole["impulse"], rtol=1e-6)
    with pytest.raises(dermatome.DataError, match="by: found"):
        readings.summary(made, threshold=1000, by="steps")
    with pytest.raises(dermatome.DataError, match="level"):
        readings.summary(made, threshold=1000, by="step", level="body.L0")

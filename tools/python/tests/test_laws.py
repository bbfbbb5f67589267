"""What every adapter keeps, on one uneven skin: forces, places on maps, times, and who is touched."""

import copy
from dataclasses import replace

import numpy as np
import pytest

import dermatome


def test_forces_in_are_forces_out(rough_map, rough_readings):
    values = rough_readings.values
    forces = np.nansum(values[:, 0, rough_map.present == 1], axis=1)
    for level in range(rough_map.n_levels):
        totals = {"pooled": np.nansum(rough_readings.pooled(rough_map, level)[:, 0], axis=1)}
        features = rough_readings.features(rough_map, level)
        totals["features"] = sum(feature["values"].reshape(6, 3, -1)[:, 0].sum(axis=1) for feature in features.values())
        for name, options in {"tight": {"pack": "tight"}, "body": {"pack": "body", "size": (60, 90)}}.items():
            draw = rough_map.renderer(level, extensive=rough_readings.extensive, **options)
            totals[name] = np.nansum(draw(values)[:, 0], axis=(1, 2)) * draw.pixel[0] * draw.pixel[1]
        for name, total in totals.items():
            assert np.allclose(total, forces, rtol=1e-5), name


def test_checkpoints_go_to_another_skin(rough_map):
    torch = pytest.importorskip("torch")
    from dermatome.torch import Draw, Pool

    policy = torch.nn.Sequential(Pool(rough_map, 1), Draw(rough_map.renderer(1, pack=True)))
    assert not policy.state_dict() and copy.deepcopy(policy)(torch.ones(2, 489)).shape[0] == 2
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
            height, width = level.size
            parts = (level.uv - level.origin) / [width, height]
            assert ((parts > -1e-9) & (parts < 1 + 1e-9)).all()


def test_probes_of_genesis_are_on_the_map(rough_map):
    import dermatome.genesis as adapter

    for name, patch in rough_map.patches.items():
        grid = adapter.probes(rough_map, patch=name, grid=(12, 10))
        level, inside = patch.levels[0], grid["probe_radius"] > 0
        (left, low), (height, width) = level.origin, level.size
        u, v = np.meshgrid(left + (np.arange(10) + 0.5) / 10 * width, low + (1 - (np.arange(12) + 0.5) / 12) * height)
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

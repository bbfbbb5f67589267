"""What a layout states of zeros, kinds and missing numbers counts in every container, in Python and in the command alike."""

import csv
import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import dermatome
from dermatome import DataError, Readings

LAYOUT = {
    "dermatome_layout": 1, "axes": ["frame", "taxel"], "time": {"rate": 30}, "channels": [{"name": "pressure", "unit": "count"}],
    "press": "raises", "zero": {"stream": "rest"}, "taxels": {"shape": [6]}, "missing": [-1],
}
BASE = 100 + np.arange(6.0)


def hdf5(path, data, rests):
    """An episode a group, each with its zeros; or the zeros of all of them above the groups."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for number, values in enumerate(data):
            file[f"ep_{number}/pressure"] = values
            if isinstance(rests, list):
                file[f"ep_{number}/rest"] = rests[number]
        if not isinstance(rests, list):
            file["rest"] = rests
    return Readings.open(path, layout=LAYOUT, stream="ep_*/pressure" if len(data) > 1 else "ep_0/pressure")


ZEROS = {"one": BASE, "a row of it": BASE[None], "ten rows": np.tile(BASE, (10, 1))}


@pytest.mark.parametrize("rest", ZEROS.values(), ids=ZEROS.keys())
def test_one_zero_is_that_of_all_frames(tmp_path, rest):
    found = hdf5(tmp_path / "a.h5", [np.tile(BASE + 2, (1500, 1))], [rest])
    assert all((part.values == 2).all() for part in found.chunks(frames=1024))


def test_rows_of_zeros_are_averaged_without_what_is_missing(tmp_path):
    rows = np.tile(BASE, (4, 1)) + np.array([-1, 0, 1, 0])[:, None]
    rows[1, 3], rows[3, 4], rows[:, 5] = -1, np.nan, -1
    values = hdf5(tmp_path / "a.h5", [np.tile(BASE, (50, 1))], [rows]).read().values[:, 0]
    assert (values[:, :5] == 0).all() and np.isnan(values[:, 5]).all()


def test_zeros_beside_frames_are_subtracted_frame_by_frame(tmp_path):
    drift = np.linspace(0, 9, 300)[:, None]
    rest = BASE + drift
    rest[:, 1] = -1
    values = hdf5(tmp_path / "a.h5", [BASE + drift + 1], [rest]).read().values[:, 0]
    assert np.isnan(values[:, 1]).all() and np.allclose(np.delete(values, 1, axis=1), 1)


def test_each_episode_has_its_own_zero(tmp_path):
    data = [np.tile(BASE, (100, 1)), np.tile(BASE + 50, (80, 1))]
    for rests in ([BASE, BASE + 50], [data[0], data[1]], np.stack([BASE, BASE + 50])):
        assert (hdf5(tmp_path / "a.h5", data, rests).read().values == 0).all()


def test_zeros_of_zarr_are_those_of_hdf5(tmp_path):
    zarr = pytest.importorskip("zarr")
    pytest.importorskip("numcodecs")
    data = np.concatenate([np.tile(BASE, (100, 1)), np.tile(BASE + 50, (80, 1))])
    for number, rest in enumerate((np.stack([BASE, BASE + 50]), data)):
        group = zarr.open_group(tmp_path / f"{number}.zarr", mode="w", zarr_format=2)
        for name, values in {"data/skin": data, "data/rest": rest, "meta/episode_ends": np.array([100, 180])}.items():
            group.create_array(name, shape=values.shape, dtype=values.dtype, chunks=(16, *values.shape[1:]))[:] = values
        assert (Readings.open(tmp_path / f"{number}.zarr", layout={**LAYOUT, "stream": "skin"}).read().values == 0).all()


def test_first_frames_are_those_of_each_episode(tmp_path):
    """A batch may end in the frames that an episode learns its zero from."""
    pytest.importorskip("h5py")
    from dermatome.recordings._blocks import learnable
    from dermatome.recordings._track import Block

    rows = [(0, 1000), (0, 24), (1, 5), (1, 40), (1, 7), (2, 3)]
    blocks = [Block(number, np.full((count, 2), number)) for number, count in rows]
    found = [(block.episode, len(block.values)) for block in learnable(iter(blocks), 20)]
    assert found == [(0, 1000), (0, 24), (1, 45), (1, 7), (2, 3)]


@pytest.mark.parametrize("kind, missing", [("f4", -999.9), ("f2", -999.9), ("f8", -999.9), ("i4", -7)])
def test_missing_numbers_are_those_of_the_type(tmp_path, kind, missing):
    values = np.tile(BASE, (40, 1)).astype(kind)
    values[5:9, 2] = missing
    np.savez(tmp_path / "a.npz", data=values)
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["data"] = values
    for name in ("a.npz", "a.h5"):
        about = {**LAYOUT, "zero": 0, "missing": [missing], "stream": "data"}
        found = Readings.open(tmp_path / name, layout=about).read().values[:, 0]
        assert np.isnan(found[5:9, 2]).all() and np.isnan(found).sum() == 4, name


@pytest.mark.parametrize("about", [{"signed": True}, {"kind": "other"}])
def test_kinds_of_a_layout_are_kept(tmp_path, about):
    """What a channel measures is what its layout says, in arrays and containers, through every step, and in a file again."""
    h5py = pytest.importorskip("h5py")
    skin = dermatome.build(dermatome.Skin.from_arrays([[0.005 * c, 0.005 * r, 0] for r in range(6) for c in range(6)]))
    skin.write(tmp_path / "map.glb")
    rng = np.random.default_rng(0)
    shear, pressed = rng.normal(0, 50, (40, 36)), rng.normal(0, 5, (40, 36))
    shear[3:, 5] += 3000
    pressed[10:30, 14:16] += 2000
    data = np.stack([shear, pressed], axis=2)
    np.savez(tmp_path / "a.npz", data=data)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["data"] = data
    layout = {
        "dermatome_layout": 1, "axes": ["frame", "taxel", "component"], "time": {"rate": 10}, "press": "raises", "zero": "taken",
        "channels": [{"name": "a", "unit": "count", "component": 0, **about}, {"name": "p", "unit": "count", "component": 1}],
        "taxels": {"shape": [36]}, "stream": "data",
    }
    (tmp_path / "l.json").write_text(json.dumps(layout))
    kind = "other" if "kind" in about else "tangential"
    peaks = []
    for name in ("a.npz", "a.h5"):
        readings = Readings.open(tmp_path / name, layout=layout).read(skin)
        assert readings.kinds == (kind, "touch")
        assert readings.select(["p", "a"]).kinds == ("touch", kind) and readings[3:].kinds == readings.kinds
        conditioned = readings.condition(skin, zero="follow", fill="neighbours")
        assert conditioned.kinds == readings.kinds
        # What is no touch has no zero.
        same = np.array_equal(conditioned.values[:, 0], readings.values[:, 0])
        assert same == (kind == "other"), name
        readings.write(tmp_path / "again.npz")
        again = Readings.read(tmp_path / "again.npz")
        assert again.kinds == readings.kinds and again.summary(skin)[0]["peak"] == readings.summary(skin)[0]["peak"]
        peaks.append(readings.summary(skin)[0]["peak"])
        line = [sys.executable, "-m", "dermatome", "summary", "map.glb", name, "--layout", "l.json", "-o", "s.csv"]
        said = subprocess.run(line, capture_output=True, text=True, cwd=tmp_path)
        with open(tmp_path / "s.csv", newline="") as file:
            assert next(csv.DictReader(file))["channel"] == "p", said.stderr
    assert peaks[0] == peaks[1] < 2100


def test_each_channel_has_a_rest_of_its_own(tmp_path):
    """A zero that is stated is that of pressures; counts beside them learn theirs."""
    skin = dermatome.build(dermatome.Skin.from_arrays([[0.005 * c, 0.005 * r, 0] for r in range(6) for c in range(6)]))
    rng = np.random.default_rng(0)
    pressed = np.zeros((40, 36))
    pressed[10:30, 14:16] = 20
    raw = 3000 + 100 * pressed + rng.normal(0, 3, pressed.shape)
    np.savez(tmp_path / "a.npz", data=np.stack([raw, pressed], axis=2))
    layout = {
        "dermatome_layout": 1, "axes": ["frame", "taxel", "component"], "time": {"rate": 10}, "press": "raises", "zero": "taken",
        "channels": [{"name": "raw", "unit": "count", "component": 0}, {"name": "pressure", "unit": "kPa", "component": 1}],
        "taxels": {"shape": [36]},
    }
    readings = Readings.open(tmp_path / "a.npz", layout=layout).read(skin)
    assert (readings.is_tared, readings.tared) == (False, (False, True))
    assert 1900 < readings.summary(skin, channel="raw")[0]["peak"] < 2100
    loaded = readings[12:]
    assert loaded.summary(skin, channel="pressure")[0]["peak"] == 20
    loaded.write(tmp_path / "b.npz")
    again = Readings.read(tmp_path / "b.npz")
    assert again.tared == (False, True) and again.select("pressure").is_tared and not again.select("raw").is_tared
    assert replace(again, tared=None).summary(skin, channel="pressure")[0]["peak"] < 20
    assert again.condition(skin, zero=0.0).is_tared


def test_units_of_a_file_are_compared(tmp_path):
    readings = Readings.from_arrays(np.ones((3, 4)), units="kPa")
    readings.write(tmp_path / "a.npz")
    assert Readings.read(tmp_path / "a.npz", units="kPa").units == ("kPa",)
    with pytest.raises(DataError, match="'kPa' as .*a.npz says; needed: one unit"):
        Readings.read(tmp_path / "a.npz", units="Pa")


def test_a_response_takes_its_zeros(tmp_path):
    """Gains are of readings above the zero: without one that is known the readings are refused."""
    skin = dermatome.build(dermatome.Skin.from_arrays([[0.005 * c, 0.005 * r, 0] for r in range(6) for c in range(6)]))
    raised = Readings.from_arrays(np.full((5, 36), 3002.0), units="count")
    rows = [f"{taxel},3000,{taxel}" for taxel in skin.ids.tolist()]
    for name, first in (("known.csv", rows[0]), ("unknown.csv", f"{skin.ids[0]},,1")):
        (tmp_path / name).write_text("\n".join(["# unit: count", "# scale: Pa", "taxel_id,zero,gain", first, *rows[1:]]))
    taken = raised.condition(skin, response=dermatome.Response.read(tmp_path / "known.csv"))
    assert np.allclose(taken.values[0, 0], 2.0 * skin.ids)
    assert taken.is_tared and "zero: that of the response, subtracted" in taken.remarks
    unknown = dermatome.Response.read(tmp_path / "unknown.csv")
    with pytest.raises(DataError, match="zero of 35 of 36 taxels"):
        raised.condition(skin, response=unknown)
    assert raised.condition(skin, response=unknown, zero=3000.0).values[0, 0, 1] == 2 * skin.ids[1]


def test_times_that_stand_still_are_said(tmp_path):
    readings = Readings.from_arrays(np.ones((3, 4)), timestamps=[5.0, 5.0, 5.0])
    readings.write(tmp_path / "a.npz")
    found = Readings.read(tmp_path / "a.npz")
    assert any("later than the first" in remark for remark in found.remarks)

"""Meshes, tables and arrays of other packages, and parts of recordings."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import dome, lattice

import dermatome
from dermatome import DataError, Readings


def quads(columns, rows):
    positions, _ = lattice(columns, rows)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    return positions, np.stack([corner, corner + 1, corner + columns + 1, corner + columns], axis=1)


def test_a_skin_of_any_mesh():
    positions, faces = dome()
    counted = np.column_stack([np.full(len(faces), 3), faces]).ravel()
    meshes = [
        SimpleNamespace(vertices=positions, faces=faces),
        SimpleNamespace(vertices=positions, triangles=faces),
        SimpleNamespace(points=positions, faces=counted),
        SimpleNamespace(points=positions, cells_dict={"triangle": faces, "line": faces[:, :2]}),
    ]
    same = dermatome.Skin.from_arrays(positions, faces, patch="palm").to_bytes()
    assert all(dermatome.Skin.from_mesh(mesh, patch="palm").to_bytes() == same for mesh in meshes)
    points, corners = quads(9, 7)
    for mesh in (SimpleNamespace(vertices=points, faces=corners), SimpleNamespace(points=points, cells_dict={"quad": corners})):
        made = dermatome.build(dermatome.Skin.from_mesh(mesh))
        assert made.n_taxels == 63 and len(made.patches["skin"].levels[0].faces) == 96
    for mesh, text in (
        (SimpleNamespace(points=points, cells_dict={"tetra": corners}), "tetra"),
        (SimpleNamespace(geometry={}, to_mesh=None), "several meshes"),
        (SimpleNamespace(points=points, faces=np.array([3, 0, 1, 2, 4, 0, 1, 2, 3])), "triangulate"),
        (3, "found int"),
    ):
        with pytest.raises(DataError, match=text):
            dermatome.Skin.from_mesh(mesh)


@pytest.mark.parametrize("package", ["trimesh", "meshio", "pyvista"])
def test_a_skin_of_the_mesh_of_a_package(package):
    module = pytest.importorskip(package)
    positions, faces = dome()
    mesh = {
        "trimesh": lambda: module.Trimesh(positions, faces, process=False),
        "meshio": lambda: module.Mesh(positions, [("triangle", faces)]),
        "pyvista": lambda: module.PolyData(positions, np.column_stack([np.full(len(faces), 3), faces]).ravel()),
    }[package]()
    skin = dermatome.Skin.from_mesh(mesh)
    assert skin.n_taxels == len(positions)


@pytest.fixture
def two_channels():
    values = np.random.default_rng(1).random((6, 2, 5))
    values[2, 1, 3] = np.nan
    return Readings.from_arrays(
        values, ids=[9, 4, 7, 1, 30], timestamps=np.arange(6) / 10, channels=["force", "temperature"], units=["N", "degC"]
    )


def test_xarray_there_and_back(two_channels):
    pytest.importorskip("xarray")
    array = two_channels.to_xarray()
    for turned in (array, array.transpose("taxel", "time", "channel")):
        back = Readings.from_xarray(turned)
        assert np.array_equal(back.values, two_channels.values, equal_nan=True)
        assert (back.channels, back.units) == (two_channels.channels, two_channels.units)
        assert np.array_equal(back.ids, two_channels.ids) and np.array_equal(back.timestamps, two_channels.timestamps)
    with pytest.raises(DataError, match="axes"):
        Readings.from_xarray(array.rename(taxel="column"))
    with pytest.raises(dermatome.ArgumentError, match=r"found Dataset of \['readings'\]; needed: a DataArray"):
        Readings.from_xarray(array.to_dataset())
    # A channel alone keeps its name, and a threshold is of the channel that it was of.
    named = replace(two_channels, units=("", ""), threshold=0.5)
    for name, threshold in (("force", 0.5), ("temperature", None)):
        one, expected = Readings.from_xarray(named.to_xarray().sel(channel=name)), named.select(name)
        assert (one.channels, one.extensive, one.threshold) == (expected.channels, expected.extensive, threshold)


def test_coordinates_of_taxels(uneven_map):
    pytest.importorskip("xarray")
    array = Readings.from_arrays(np.zeros((2, uneven_map.n_taxels))).to_xarray(uneven_map)
    positions = np.concatenate([patch.levels[0].positions for patch in uneven_map.patches.values()])
    assert np.array_equal(np.stack([array.x, array.y, array.z], axis=1), positions)
    assert np.array_equal(array.taxel, uneven_map.ids)
    assert list(dict.fromkeys(array.patch.values)) == list(uneven_map.patches)


def test_pandas(two_channels):
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame(two_channels.values[:, 0], index=two_channels.timestamps, columns=two_channels.ids)
    made = Readings.from_pandas(table, units="N")
    assert np.array_equal(made.values, two_channels.values[:, :1]) and np.array_equal(made.ids, two_channels.ids)
    assert np.array_equal(made.timestamps, two_channels.timestamps) and made.extensive == (True,)
    dated = table.set_axis(pandas.date_range("2026-01-01", periods=6, freq="100ms"), axis=0)
    assert np.diff(Readings.from_pandas(dated).timestamps) == pytest.approx(0.1, abs=1e-6)
    assert np.isnan(Readings.from_pandas(table.reset_index(drop=True)).timestamps).all()
    # Of a pivot numbers of columns are floats.
    assert Readings.from_pandas(table.rename(columns=float)).ids.tolist() == two_channels.ids.tolist()
    for name in ("time", 7.5):
        with pytest.raises(DataError, match=f"'{name}'"):
            Readings.from_pandas(table.assign(**{"new": 0.0}).rename(columns={"new": name}))


def test_parts_of_a_recording(two_channels):
    assert np.array_equal(two_channels.crop(0.1, 0.3).timestamps, [0.1, 0.2])
    assert two_channels.select("temperature").units == ("degC",)
    assert np.array_equal(two_channels.select(["temperature", "force"]).values, two_channels.values[:, ::-1], equal_nan=True)
    dropped = two_channels.drop([7, 30])
    assert np.isnan(dropped.values[:, :, [2, 4]]).all()
    assert np.array_equal(dropped.values[:, :, [0, 1, 3]], two_channels.values[:, :, [0, 1, 3]], equal_nan=True)
    by_mask = two_channels.drop(np.isin(two_channels.ids, [7, 30]))
    assert np.array_equal(by_mask.values, dropped.values, equal_nan=True)
    doubled = two_channels.with_values(2 * two_channels.values)
    assert np.array_equal(doubled.values, 2 * two_channels.values, equal_nan=True) and doubled.channels == two_channels.channels
    for wrong in (
        lambda: two_channels.crop(5.0),
        lambda: two_channels.select("pressure"),
        lambda: two_channels.drop([8]),
        lambda: two_channels.drop([True, False]),
        lambda: two_channels.with_values(np.zeros((6, 5))),
        lambda: two_channels.resample(0),
    ):
        with pytest.raises(DataError):
            wrong()


@pytest.mark.parametrize("begin", [0.0, 3.3, 1.8e9])
def test_the_last_frame_is_kept_at_the_same_rate(begin):
    for count in range(2, 9):
        readings = Readings.from_arrays(np.ones((count, 3)), timestamps=begin + np.arange(count) / 100)
        assert len(readings.resample(100.0)) == count


def test_what_was_not_measured_is_not_after_another_rate(two_channels):
    known = np.ones(two_channels.values.shape, dtype=bool)
    known[:, :, 2] = False
    again = replace(two_channels, measured=known).resample(20.0).measured
    assert not again[:, :, 2].any() and again[:, 0, [0, 1, 3, 4]].all()


def test_another_rate(two_channels):
    assert np.array_equal(two_channels.resample(10.0).values, two_channels.values, equal_nan=True)
    twice = two_channels.resample(20.0)
    assert len(twice) == 11
    assert np.allclose(twice.values[1, 0], two_channels.values[:2, 0].mean(axis=0))
    assert np.allclose(two_channels.resample(5.0).values[1, 0], two_channels.values[1:3, 0].mean(axis=0))
    paused = Readings.from_arrays(np.ones((6, 5)), timestamps=[0, 0.1, 0.2, 2.0, 2.1, 2.2]).resample(10.0)
    assert np.isnan(paused.values[4:19]).all() and (paused.values[[0, 1, 2, -1]] == 1).all()


def joined_episodes(map):
    """Two episodes of touches, the second one 0.3 N higher, as `Recording.read` makes them."""
    parts = [dermatome.touch(map, presses=1, rate=25.0, seed=seed, noise=0.001)[0].on(map) for seed in (1, 2)]
    values = np.concatenate([parts[0].values, parts[1].values + 0.3])
    numbers = np.repeat([0, 1], [len(part) for part in parts])
    whole = replace(parts[0], values=values, timestamps=np.concatenate([part.timestamps for part in parts]), episodes=numbers)
    return whole, [parts[0], replace(parts[1], values=parts[1].values + 0.3)]


def test_episodes_begin_anew_in_python_as_in_the_command(rough_map):
    whole, parts = joined_episodes(rough_map)
    for how in ({"baseline": 3}, {"zero": "follow"}, {"split": 2.0}, {"baseline": 3, "fill": "neighbours"}):
        made, alone = whole.condition(rough_map, **how), [part.condition(rough_map, **how) for part in parts]
        for name in ("values", "timestamps"):
            assert np.array_equal(getattr(made, name), np.concatenate([getattr(part, name) for part in alone]), equal_nan=True), how
        assert made.channels == alone[0].channels and made.episodes.tolist() == whole.episodes.tolist()
    rows = whole.summary(rough_map)
    assert rows == [{"episode": k, **row} for k, part in enumerate(parts) for row in part.summary(rough_map)]
    assert [part.episode for part in whole.by_episode()] == [0, 1] and [len(part) for part in whole[10:].by_episode()] == [len(parts[0]) - 10, len(parts[1])]
    again = whole.by_episode()[1]
    assert again.episodes is None and np.array_equal(again.values, parts[1].values, equal_nan=True)
    resampled = whole.resample(5.0)
    assert np.array_equal(resampled.values, np.concatenate([part.resample(5.0).values for part in parts]), equal_nan=True)
    assert [len(part) for part in resampled.by_episode()] == [len(part.resample(5.0)) for part in parts]
    none = whole[:0]
    assert [len(part) for part in none.by_episode()] == [0] and none.condition(rough_map).values.shape == none.values.shape
    findings = dermatome.examine(rough_map, whole)[0]
    assert [each["message"] for each in findings] == [each["message"] for each in dermatome.examine(rough_map, parts)[0]]


def test_a_file_has_one_episode(rough_map, tmp_path):
    whole, parts = joined_episodes(rough_map)
    with pytest.raises(DataError, match="found 2 episodes; needed: one"):
        whole.write(tmp_path / "a.npz")
    whole.by_episode()[1].write(tmp_path / "a.npz")
    assert np.array_equal(Readings.read(tmp_path / "a.npz").values, parts[1].values, equal_nan=True)


def test_a_read_recording_knows_its_episodes(dome_map, tmp_path):
    values = np.random.default_rng(1).random((2, 30, 256)) + [[[0.0]], [[5.0]]]
    np.save(tmp_path / "a.npy", values)
    layout = {"dermatome_layout": 1, "axes": ["episode", "frame", "taxel"], "time": {"rate": 50}, "press": "raises", "zero": "taken"}
    layout |= {"channels": [{"name": "raw", "unit": "count"}], "taxels": {"ids": dome_map.ids.tolist()}}
    recording = Readings.open(tmp_path / "a.npy", layout=layout)
    made = recording.read()
    assert made.episodes.tolist() == [0] * 30 + [1] * 30
    assert np.abs(made.condition(dome_map, baseline=30).values[:, 0].reshape(2, -1).mean(axis=1)).max() < 1e-9
    recording.episode = 1
    assert recording.read().episodes is None


def test_touches_of_episodes_begin_anew(dome_map):
    pytest.importorskip("torch")
    from dermatome.torch import Touches

    whole, parts = joined_episodes(dome_map)
    made, alone = Touches(dome_map, whole, history=3), [Touches(dome_map, part, history=3) for part in parts]
    for name, found in made.contacts.items():
        assert np.array_equal(found, np.concatenate([each.contacts[name] for each in alone]), equal_nan=True)
    first = len(parts[0])
    assert np.array_equal(made[first]["image"], alone[1][0]["image"])


def test_a_threshold_is_of_the_readings_it_was_stated_for(dome_map):
    raw = replace(dermatome.touch(dome_map, presses=1, rate=25.0)[0], threshold=2050.0)
    raw = raw.with_values(raw.values * 100 + 2000)
    for how in ({"baseline": 10}, {"zero": "follow"}, {"zero": 2000.0}, {"clip": (0, 1)}):
        made = raw.condition(dome_map, **how)
        assert made.threshold is None, how
    assert raw.condition(dome_map).threshold == 2050.0
    tared = replace(raw, values=raw.values - 2000, is_tared=True, threshold=50.0)
    assert tared.condition(dome_map, zero="follow").threshold == 50.0


def test_bounds_are_of_channels_that_measure_touches(rough_map, rough_readings):
    made = rough_readings.condition(rough_map, clip=(0, 0.4))
    heat, known = made.values[:, 2], np.isfinite(made.values[:, 2])
    assert np.nanmax(made.values[:, :2]) <= 0.4 and known.mean() > 0.9 and np.allclose(heat[known], rough_readings.values[:, 2][known])


def test_masked_numbers_are_refused_by_every_door(dome_map):
    layout = dermatome.Layout.parse(
        '{"dermatome_layout": 1, "axes": ["frame", "taxel"], "time": {"rate": 50}, "press": "raises", "zero": 0, "channels": [{"name": "pressure", "unit": "kPa"}], "taxels": {"ids": [1, 2, 3]}}'
    )
    masked, readings = np.ma.masked_equal([[0.0, 1.0, -9999.0], [0.0, 2.0, 3.0]], -9999.0), dermatome.touch(dome_map, presses=1)[0]
    for call in (
        lambda: layout.decoder("x", (3,)).decode(masked),
        lambda: readings.drop(np.ma.masked_equal([1, 2], 2)),
        lambda: readings[np.ma.masked_equal([0, 1], 1)],
        lambda: Readings.from_arrays(np.zeros((2, 3)), timestamps=np.ma.masked_equal(np.array([0, 5], "M8[s]"), np.datetime64(5, "s"))),
        lambda: dome_map.pool(masked, 0),
    ):
        with pytest.raises(DataError, match="masked"):
            call()


def test_indices_of_tables_are_times_only_where_they_say_so():
    pandas = pytest.importorskip("pandas")
    values = np.arange(10.0).reshape(5, 2)
    table = pandas.DataFrame(values, columns=[7, 8])
    table.iloc[2, 0] = np.nan
    for counted in (table.dropna(), pandas.concat([table, table])):
        made = Readings.from_pandas(counted, units="N")
        assert np.isnan(made.timestamps).all() and "no times" in made.remarks[-1]
    in_ms = table.set_index(pandas.Index([0, 20, 40, 60, 80], name="time[ms]"))
    assert np.allclose(Readings.from_pandas(in_ms).timestamps, np.arange(5) * 0.02)
    with pytest.raises(DataError, match="furlong"):
        Readings.from_pandas(table.set_index(pandas.Index(range(5), name="t[furlong]")))
    for index in (pandas.date_range("2026-01-01", periods=5, freq="20ms", tz="Europe/Berlin"), pandas.period_range("2026-01-01", periods=5, freq="s")):
        times = Readings.from_pandas(table.set_index(index)).timestamps
        assert np.allclose(np.diff(times), 1.0 if hasattr(index, "to_timestamp") else 0.02, atol=1e-6)
    assert len(Readings.from_pandas(table.iloc[:0])) == 0
    with pytest.raises(DataError, match="numbers in all cells"):
        Readings.from_pandas(pandas.DataFrame([["a", 1.0]], columns=[1, 2]))


def test_units_of_xarray_are_stated_once(rough_map):
    pytest.importorskip("xarray")
    readings = dermatome.touch(rough_map, presses=1)[0].on(rough_map)
    array = readings.to_xarray()
    with pytest.raises(DataError, match="found units='mN' and the coordinate unit"):
        Readings.from_xarray((array * 1000).assign_attrs(units="mN"))
    assert Readings.from_xarray((array * 1000).drop_vars("unit").assign_attrs(units="mN")).units == ("mN",)
    slow = array.assign_coords(time=array.time.values * 1000)
    slow.time.attrs["units"] = "ms"
    assert np.allclose(Readings.from_xarray(slow).timestamps, readings.timestamps)
    with pytest.raises(DataError, match="threshold: found 0"):
        Readings.from_xarray(array.assign_attrs(threshold=0.0))
    whole, _ = joined_episodes(rough_map)
    assert Readings.from_xarray(whole.to_xarray()).episodes.tolist() == whole.episodes.tolist()


def test_patches_that_share_ids_are_told_apart_by_the_order_of_the_map(rough_map):
    """Simulated touches and tables of a map go back to it."""
    readings, _ = dermatome.touch(rough_map, presses=2)
    assert readings.ids is None and readings.on(rough_map) is readings and readings.pooled(rough_map, 1).shape[1] == 1
    if pytest.importorskip("xarray"):
        again = Readings.from_xarray(readings.to_xarray(rough_map)).on(rough_map)
        assert np.array_equal(again.values, readings.values, equal_nan=True)
        assert set(readings.to_xarray(rough_map).patch.values) == {"upper arm", "tip of it"}


def test_channels_of_one_name_are_not_chosen_by_it(dome_map, tmp_path):
    readings = Readings.from_arrays(np.ones((3, 2, 256)), channels=["force", "force"], units=["N", "Pa"])
    with pytest.raises(DataError, match=r"several of the name 'force': \[0, 1\]"):
        readings.select("force")
    with pytest.raises(DataError, match="several of the name 'force'"):
        readings.summary(dome_map, channel="force", threshold=0.5)
    for wrong, text in ((readings[:0], "no frame"), (replace(readings, threshold=0.0), "threshold: found 0")):
        with pytest.raises(DataError, match=text):
            wrong.write(tmp_path / "a.npz")
    assert not (tmp_path / "a.npz").exists()
    flags = [True] * 255 + [False]
    assert (dermatome.build(dermatome.Skin.from_arrays(*dome(), present=flags)).present == 1).tolist() == flags
    with pytest.raises(DataError, match="7.9"):
        dermatome.touches({"taxels": [[7.9]]})

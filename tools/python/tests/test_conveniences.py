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
    with pytest.raises(DataError, match="'time'"):
        Readings.from_pandas(table.assign(time=0.0))


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

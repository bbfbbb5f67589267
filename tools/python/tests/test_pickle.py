"""What is pickled and copied is the same again, also in processes that are spawned."""

import copy
import multiprocessing
import operator
import pickle
import subprocess
import sys

import numpy as np
import pytest
from conftest import dome, lattice

import dermatome


SPAWNED = """
import multiprocessing, sys
import numpy as np
import dermatome

class Frames:
    def __init__(self, renderer, index):
        self.renderer, self.index = renderer, index

    def __call__(self, seed):
        values = np.random.default_rng(seed).random((2, self.renderer.matrix().shape[1]))
        return self.renderer(values), self.index.locate([[0.01, 0.02, 0.1]]).point

if __name__ == "__main__":
    skin_map = dermatome.Map.read(sys.argv[1])
    frames = Frames(skin_map.renderer(0, size=[16, 16], mask=True), skin_map.index().posed({"hand": np.eye(4)}))
    for method in ("spawn", "forkserver"):
        with multiprocessing.get_context(method).Pool(2) as pool:
            for seed, (images, points) in enumerate(pool.map(frames, range(4))):
                assert np.array_equal(images, frames(seed)[0], equal_nan=True) and np.array_equal(points, frames(seed)[1])
    print("same")
"""


def test_objects_go_to_spawned_workers(dome_map, tmp_path):
    dome_map.write(tmp_path / "map.glb")
    (tmp_path / "spawned.py").write_text(SPAWNED)
    said = subprocess.run([sys.executable, "spawned.py", "map.glb"], cwd=tmp_path, capture_output=True, text=True)
    assert said.stdout == "same\n", said.stderr


def copies(thing):
    yield copy.copy(thing)
    yield copy.deepcopy(thing)
    for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1):
        yield pickle.loads(pickle.dumps(thing, protocol))


def same(one, other):
    """Whether all attributes are equal."""
    names = [name for name in dir(one) if not name.startswith("_") and not callable(getattr(one, name))]
    for a, b in ((getattr(one, name), getattr(other, name)) for name in names):
        if isinstance(a, (dermatome.Matrix, dermatome.Hits)):
            assert same(a, b)
        elif isinstance(a, np.ndarray):
            assert a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        elif isinstance(a, (list, tuple)) and a and isinstance(a[0], np.ndarray):
            assert all(np.array_equal(x, y, equal_nan=True) for x, y in zip(a, b, strict=True))
        elif not isinstance(a, (dermatome.Level, tuple)) or not a or not isinstance(a[0], dermatome.Level):
            assert str(a) == str(b)
    return bool(names)


LAYOUT = """{"dermatome_layout": 1, "axes": ["frame", "taxel"], "time": {"rate": 10}, "press": "raises", "zero": 0,
    "channels": [{"name": "pressure", "unit": "Pa"}], "taxels": {"shape": [256]}}"""


@pytest.fixture
def one_of_each(dome_map, tmp_path):
    """An object of every public class by its name."""
    values, index = np.random.default_rng(0).random((3, 256)), dome_map.index(fields=True)
    observations, _ = dermatome.simulate(taxels=60, anchors=20, normal_noise=0.01, indentation=1e-3)
    np.save(tmp_path / "a.npy", values)
    (tmp_path / "arm.urdf").write_text("<robot name='r'><link name='hand'/></robot>")
    (tmp_path / "response.csv").write_text("taxel_id,gain,sigma\n1,2,0.1\n2,3,\n")
    columns = {"i": [1], "x": [0.001], "y": [0], "z": [0], "touch": [0], "contact": [0], "qx": [0], "qy": [0], "qz": [0], "qw": [1]}
    columns |= {"dx:elbow": [0.1], "dy:elbow": [0], "dz:elbow": [0]}
    columns = {name: np.resize(column, 4) for name, column in columns.items()} | {"i": [1, 2, 3, 4], "touch": range(4), "contact": range(4)}
    contacts = dermatome.Observations.from_columns(columns | {"sigma": [1e-3] * 4})
    bodies = dermatome.calibrate(contacts, cad=dermatome.Skin.from_arrays(*dome()), fit_probe=True, fit_joints=True, folds=2)
    following = dermatome.follow([contacts])
    patch, layout = dome_map.patches["dome"], dermatome.Layout.parse(LAYOUT)
    things = [
        dome_map, patch, patch.levels[1], patch.levels[1].frame, dermatome.Skin.from_arrays(*dome()), index, index.locate(dome()[0]), index.nearest(dome()[0], 3),
        dome_map.pooling(1), dome_map.renderer(1), dermatome.ContactTracker(dome_map, threshold=1.0), dermatome.EventDetector(dome_map),
        dome_map.plot(values[0], width=300, levels=[1], range=(0, 1)), dermatome.coarsen(*dome())[1], dermatome.flatten(*dome()),
        observations, dermatome.calibrate(observations, robust="none", residual="log"), dermatome.Robot.read(tmp_path / "arm.urdf"), layout,
        layout.decoder("a.npy", (256,)), dermatome.RecordingFile(tmp_path / "a.npy"), dermatome.Readings.open(tmp_path / "a.npy", layout=layout),
        dermatome.Readings.from_arrays(values, units="N"), *(error("no", "argument") for error in (dermatome.Error, dermatome.DataError, dermatome.ArgumentError)),
        dermatome.DermatomeWarning("poor"), dermatome.FileError("no", "io"), dermatome.MissingFileError("no", "read"), dermatome.Response.read(tmp_path / "response.csv"),
        bodies, bodies.bodies[1], bodies.probe, bodies.joints[0], bodies.held_back, bodies.held_back.levels[0], next(following), following,
    ]  # fmt: skip
    return {type(thing).__name__: thing for thing in things}


def test_every_public_class_goes_to_spawned_processes_and_back(one_of_each, tmp_path):
    assert set(one_of_each) == {name for name in dermatome.__all__ if isinstance(getattr(dermatome, name), type)}
    # These stand at a frame of what they read.
    for name in ("Decoder", "EventDetector", "Following", "RecordingFile"):
        with pytest.raises(TypeError, match=f"cannot pickle .*{name}"):
            pickle.dumps(one_of_each.pop(name))
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        returned = dict(pool.map(operator.itemgetter(0, 1), one_of_each.items()))
    for name, thing in one_of_each.items():
        for again in (returned[name], *copies(thing)):
            assert type(again) is type(thing) and repr(again) == repr(thing), name
            if name == "Skin":  # Its positions are rounded to 32 bits.
                assert np.array_equal(again.faces, thing.faces) and np.allclose(again.positions, thing.positions, atol=1e-8)
            elif name == "Picture":
                assert again.svg() == thing.svg()
            else:
                assert isinstance(thing, Exception) or same(thing, again), name
    assert np.array_equal(returned["Picture"].array(), one_of_each["Picture"].array())
    assert same(returned["MeshLevel"].pooling(), one_of_each["MeshLevel"].pooling())
    assert same(returned["Calibration"].skin(), one_of_each["Calibration"].skin())
    assert np.array_equal(returned["Recording"].read().values, one_of_each["Recording"].read().values)
    for coarse in dermatome.coarsen(*dome()):
        assert all(same(coarse, again) and same(coarse.pooling(), again.pooling()) for again in copies(coarse))


@pytest.mark.parametrize("options", [{}, {"model": "poses", "anchors": 9}, {"anchors": 9}, {"model": "poses", "anchors": 9, "normal_noise": 0.1}])
def test_observations_of_every_kind_are_pickled(options, tmp_path):
    observations, _ = dermatome.simulate(taxels=40, **options)
    for again in copies(observations):
        assert same(dermatome.calibrate(again), dermatome.calibrate(observations)) and again.remarks == observations.remarks
    make, state = observations.__reduce__()
    for place, wrong in ((1, []), (2, [([0, 1], [1.0])]), (2, [([0, 99], [1.0] * 12)]), (3, [(0, [1.0] * 11)])):
        with pytest.raises(dermatome.DataError, match="state"):
            make(*state[:place], wrong, *state[place + 1 :])


def test_every_result_is_pickled_and_copied(uneven_map, tmp_path):
    index = uneven_map.index(reactive=True, fields=True)
    points, coarsest = uneven_map.patches["skin"].levels[0].positions[:7] + 1e-3, uneven_map.n_levels - 1
    turned = {uneven_map.links[0]: [[0, -1, 0, 0.1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
    first, second = uneven_map.patches.values()
    path = tmp_path / "arm.urdf"
    path.write_text("""<robot name="arm"><link name="base"/><link name="tip"/><link name="thumb"/>
      <joint name="turn" type="revolute"><parent link="base"/><child link="tip"/><origin xyz="1 0 0" rpy="1 2 3"/>
        <axis xyz="0 0 2"/><limit lower="-1" upper="1"/></joint>
      <joint name="slide" type="prismatic"><parent link="tip"/><child link="thumb"/>
        <mimic joint="turn" multiplier="2" offset="0.5"/></joint></robot>""")
    robot = dermatome.Robot.read(path)
    for thing in (
        index.locate(points, level=1), index.reactive(points), index.ray(points, -points), index.within(points, 0.01),
        uneven_map.pooling(1), uneven_map.renderer(coarsest, pack="body", size=[40, 30], extensive=[True], fill=2.0, mask=True),
        uneven_map.renderer(0, patch=second.name, pixel=0.01), second, second.levels[1], index, index.posed(turned),
        dermatome.flatten(*lattice(5, 5)), robot,
    ):  # fmt: skip
        for again in copies(thing):
            assert type(again) is type(thing) and repr(again) == repr(thing) and same(thing, again)
    values = np.random.default_rng(0).random((3, 1, 592))
    renderer = uneven_map.renderer(coarsest, pack=True, size=(40, 30), channels=1)
    for again in copies(renderer):
        assert np.array_equal(again(values), renderer(values), equal_nan=True)
    for moved in copies(index.posed(turned)):
        assert same(moved.locate(points), index.posed(turned).locate(points)) and same(moved.nearest(points, 3), index.posed(turned).nearest(points, 3))
    for again in copies(robot):
        assert all(np.array_equal(pose, robot.poses({"turn": 0.3})[name]) for name, pose in again.poses({"turn": 0.3}).items())
    assert copy.deepcopy([renderer, uneven_map, index, robot]) == [renderer, uneven_map, index, robot], "what never changes is shared"
    hits = index.locate(points)
    copy.deepcopy(hits).distance[:] = 0
    assert (hits.distance != 0).all()
    with pytest.raises(dermatome.Error):
        dermatome.Robot._of([("a", 7, np.eye(4))], [])

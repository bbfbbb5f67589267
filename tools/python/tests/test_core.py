"""Skins, maps, levels, matrices and lookups: laws on small named shapes."""

import gc
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from conftest import dome, lattice, tube

import dermatome


def test_a_skin_keeps_its_arrays():
    positions, faces = dome()
    skin = dermatome.Skin.from_arrays(positions, faces, ids=np.arange(256) + 1000, patch="dome")
    assert np.array_equal(skin.positions, positions)
    assert np.array_equal(skin.ids, np.arange(256) + 1000)
    assert sorted(map(tuple, skin.faces)) == sorted(map(tuple, faces))
    assert skin.areas.sum() == pytest.approx(dermatome.build(skin).patches["dome"].levels[0].areas.sum(), rel=1e-6)


def test_a_skin_is_written_and_read(tmp_path):
    skin = dermatome.Skin.from_arrays(*dome(), patch="dome")
    skin.write(tmp_path / "dome.glb")
    again = dermatome.Skin.read(tmp_path / "dome.glb", patches=["d*"])
    assert again.patches == ("dome",)
    assert np.allclose(again.positions, skin.positions, atol=1e-8)
    larger = dermatome.Skin.read(str(tmp_path / "dome.glb"), unit=2.0)
    assert np.allclose(larger.positions, 2 * skin.positions, atol=1e-7)
    assert pickle.loads(pickle.dumps(skin)).n_taxels == 256


@pytest.mark.parametrize("form", [np.float32, np.float64, ">f8", "list", "fortran", "view", "read-only"])
def test_every_form_of_an_array_gives_the_same_skin(form):
    positions, faces = lattice(8, 8)
    positions = np.round(positions * 1024) / 1024
    if form == "list":
        given = positions.tolist()
    elif form == "fortran":
        given = np.asfortranarray(positions)
    elif form == "view":
        given = np.repeat(positions, 2, axis=0)[::2]
    else:
        given = positions.astype(np.float64 if form == "read-only" else form)
        given.flags.writeable = form != "read-only"
    assert np.array_equal(dermatome.Skin.from_arrays(given, faces).positions, positions)


def test_a_map_is_the_same_built_read_and_unpickled(dome_map, tmp_path):
    dome_map.write(tmp_path / "map.glb")
    for other in (
        dermatome.Map.read(tmp_path / "map.glb"),
        dermatome.Map.from_bytes(dome_map.to_bytes()),
        dermatome.Map.from_bytes(memoryview(bytearray(dome_map.to_bytes()))),
        pickle.loads(pickle.dumps(dome_map)),
    ):
        assert other == dome_map
        assert hash(other) == hash(dome_map)
        assert other.to_bytes() == dome_map.to_bytes()
        assert np.array_equal(other.pooling(1).data, dome_map.pooling(1).data)
    assert dome_map != "a map"
    assert dermatome.build(dermatome.Skin.from_arrays(*lattice(8, 8))) != dome_map


def test_the_number_of_threads_changes_nothing(dome_map):
    skin = dermatome.Skin.from_arrays(*dome(), patch="dome", link="hand")
    assert dermatome.build(skin, threads=1) == dermatome.build(skin, threads=3) == dome_map


def test_levels_are_nested_and_areas_are_carried(dome_map):
    levels = dome_map.patches["dome"].levels
    assert len(levels) > 1
    for level in levels:
        n, m = len(level.positions), len(level.faces)
        assert level.normals.shape == level.tangents.shape == (n, 3)
        assert level.faces.max() < n and level.uv_faces.shape == (m, 3)
        assert np.array_equal(level.positions, levels[0].positions[level.origins])
        assert np.array_equal(level.vertex_of_place[level.uv_faces], level.faces)
        assert np.array_equal(level.taxel_ids, dome_map.ids[level.origins])
        assert level.distortion["flips"] == 0
        pooling = dome_map.pooling(level.number).scipy()
        assert pooling.shape == (256, n)
        assert np.diff(pooling.indptr).max() <= 3
        assert np.allclose(pooling.sum(axis=1), 1)
        assert np.allclose(pooling.T @ levels[0].areas, level.areas, rtol=1e-5)
    assert levels[0].up().shape == (256, len(levels[1].positions))
    assert levels[-1].up() is None


def test_a_cut_map_keeps_its_vertices_whole(tube_map):
    level = tube_map.patches["sleeve"].levels[0]
    assert len(level.positions) == 24 * 30 < len(level.uv)
    assert np.array_equal(np.unique(level.vertex_of_place), np.arange(24 * 30))
    assert np.array_equal(level.vertex_of_place[level.uv_faces], level.faces)


def test_pool_is_the_pooling_matrix(dome_map):
    values = np.random.default_rng(1).random((7, 256))
    areas = dome_map.patches["dome"].levels[0].areas
    for level in range(dome_map.n_levels):
        weights = dome_map.pooling(level).scipy()
        mean = (values * areas) @ weights / (areas @ weights)
        assert np.allclose(dome_map.pool(values, level), mean, rtol=1e-6)
        assert np.allclose(dome_map.pool(values, level, extensive=True), values @ weights, rtol=1e-6)
        assert np.array_equal(dome_map.pool(values, level, threads=1), dome_map.pool(values, level, threads=2))
        # Infinite readings are missing ones.
        lost = np.where(np.arange(256) % 5 == 0, np.inf, values)
        gone = np.where(np.isinf(lost), np.nan, lost)
        assert np.array_equal(dome_map.pool(lost, level), dome_map.pool(gone, level), equal_nan=True)
        two = np.stack([values, 2 * values], axis=1)
        assert np.array_equal(dome_map.pool(two, level)[:, 1], dome_map.pool(2 * values, level))
    values[:] = np.nan
    assert np.isnan(dome_map.pool(values, 1)).all()
    assert dome_map.pool(np.empty((0, 256)), 1).shape[0] == 0


def test_taxels_that_are_absent_have_no_reading():
    positions, faces = lattice(10, 10)
    present = np.ones(100, int)
    present[37] = 0
    map = dermatome.build(dermatome.Skin.from_arrays(positions, faces, present=present))
    assert np.array_equal(map.present, present)
    pooled = map.pool(np.arange(100.0), 0)
    assert np.array_equal(np.flatnonzero(np.isnan(pooled)), [37])


def test_points_are_located_where_they_are(dome_map):
    level = dome_map.patches["dome"].levels[0]
    index = dome_map.index()
    hits = index.locate(level.positions + 1e-3 * level.normals, level=0)
    assert len(hits) == 256
    assert np.allclose(hits.point, level.positions, atol=3e-4)
    assert np.allclose(hits.distance, 1e-3, atol=2e-5)
    assert (hits.taxel_id == dome_map.ids).mean() > 0.9
    corners = level.positions[level.faces[hits.face]]
    assert np.allclose((hits.barycentric[:, :, None] * corners).sum(axis=1), hits.point)
    fields = hits.fields.scipy()
    assert fields.shape == (256, 256) and np.allclose(fields.sum(axis=1), 1)
    one = index.locate(level.positions[7:8] + 1e-3 * level.normals[7:8], level=1, threads=1)
    many = index.locate(level.positions + 1e-3 * level.normals, level=1, threads=2)
    assert one.uv[0].tolist() == many.uv[7].tolist() and one.field[0] == many.field[7]
    assert index.locate(level.positions, level=None).uv is None
    assert len(index.locate(np.empty((0, 3)))) == 0


def test_map_and_skin_are_inverse(dome_map):
    level = dome_map.patches["dome"].levels[0]
    hits = dome_map.index().locate(level.positions[40:60] + 1e-4, level=0)
    points, normals, off_chart = dome_map.to_skin("dome", hits.uv)
    assert np.allclose(points, hits.point, atol=1e-6)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1) and (off_chart == 0).all()
    assert dome_map.to_skin("dome", [[9.0, 9.0]])[2][0] > 8


def test_exports(dome_map, tube_map, tmp_path):
    path = tmp_path / "out.npz"
    for map in (dome_map, tube_map):
        level = next(iter(map.patches.values())).levels[1]
        map.export(path, level=1)
        table = np.load(path)
        for name in ("positions", "normals", "tangents", "areas", "taxel_ids"):
            assert np.array_equal(table[name], getattr(level, name)), name
        assert np.array_equal(table["uv"], level.uv[: len(level.positions)])
    robot = tmp_path / "robot.urdf"
    robot.write_text("<robot name='r'><link name='hand'/></robot>")
    dome_map.export(tmp_path / "out.urdf", patch="dome", robot=robot)
    skin = dermatome.Skin.read(tmp_path / "out.urdf")
    assert sum(len(patch.ids) for patch in dermatome.build(skin).patches.values()) == dome_map.n_taxels
    for bad in ({"patch": "palm"}, {"level": 9}, {"robot": robot}):
        with pytest.raises(dermatome.DataError):
            dome_map.export(tmp_path / "no.csv", **bad)
    with pytest.raises(dermatome.DataError, match="unknown kind"):
        dome_map.export(tmp_path / "no.stl")
    assert not list(tmp_path.glob("no.*"))


def test_rays_meet_the_skin_or_nothing(dome_map):
    middle = dome()[0].mean(axis=0)
    above, below = middle + [0, 0, 1], middle - [0, 0, 1]
    hits = dome_map.index().ray([above, above], [[0, 0, -1], [0, 0, 1]])
    assert hits.patch.tolist() == [0, -1] and np.isnan(hits.distance[1]) and hits.taxel_id[1] == 2**32 - 1
    assert hits.point[0][2] == pytest.approx(0.08, abs=2e-4)
    assert dome_map.index().ray([below], [[0, 0, 1]], longest=0.5).patch.tolist() == [-1]


def test_reactive_answers_keep_their_bound(dome_map):
    index = dome_map.index(reactive=True)
    points = dome()[0] + np.random.default_rng(2).normal(scale=0.003, size=(256, 3))
    exact, quick = index.locate(points), index.reactive(points, 1)
    away = abs(exact.distance)
    assert (quick.least <= away + 1e-12).all() and (away <= quick.most + 1e-12).all()
    assert np.median(quick.most - quick.least) < 0.001 and (quick.level == 1).all()
    assert (quick.taxel_id == index.locate(points, level=1).taxel_id).mean() > 0.9
    assert index.reactive(points).uv is None
    with pytest.raises(dermatome.DataError, match="reactive"):
        dome_map.index().reactive(points, 1)


def test_patches_without_a_level_answer_with_their_coarsest(tmp_path):
    dermatome.Skin.from_arrays([[1, 0, 0], [1.01, 0, 0], [1, 0.01, 0]], [[0, 1, 2]], patch="small").write(tmp_path / "a.glb")
    dermatome.Skin.from_arrays(*dome()).write(tmp_path / "b.glb")
    map = dermatome.build(dermatome.Skin.read([tmp_path / "a.glb", tmp_path / "b.glb"]))
    hits = map.index(reactive=True).reactive([[1.001, 0.001, 0.001], dome()[0][0]], 1)
    assert hits.level.tolist() == [0, 1]
    assert hits.fields.shape[1] == map.pooling(1).shape[1], "the fields of the level, and the taxels of the small patch"
    assert np.add.reduceat(hits.fields.data, hits.fields.indptr[:-1]) == pytest.approx([1, 1])


def test_fields_near_a_point(dome_map):
    index = dome_map.index(fields=True)
    positions = dome()[0]
    near = index.nearest(positions[:5] + 1e-4, 4)
    assert np.diff(near.indptr).tolist() == [4] * 5
    for k in range(5):
        by_distance = np.argsort(np.linalg.norm(dome_map.patches["dome"].levels[0].positions - positions[k] - 1e-4, axis=1))
        assert near.field[near.indptr[k]] == by_distance[0]
    inside = index.within(positions[100:101], 0.011)
    away = np.linalg.norm(dome_map.patches["dome"].levels[0].positions - positions[100], axis=1)
    assert np.array_equal(inside.field, np.flatnonzero(away <= 0.011))


def test_a_posed_index_moves_and_leaves_the_other(dome_map):
    index = dome_map.index()
    turn = np.eye(4)
    turn[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    turn[:3, 3] = [1.0, 2.0, 3.0]
    posed = index.posed({"hand": turn})
    points = dome()[0] + 1e-3
    moved = posed.locate(points @ turn[:3, :3].T + turn[:3, 3])
    still = index.locate(points)
    assert np.allclose(moved.distance, still.distance) and np.array_equal(moved.face, still.face)
    assert np.allclose(posed.poses["hand"], turn) and np.allclose(index.poses["hand"], np.eye(4))
    assert np.allclose(posed.locate(points, link="hand").point, still.point)
    with pytest.raises(dermatome.DataError, match="rigid"):
        index.posed({"hand": 2 * np.eye(4) - np.diag([0, 0, 0, 1])})


def test_joints_say_where_links_are(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text("""<robot name="arm"><link name="base"/><link name="tip"/><link name="thumb"/>
      <joint name="turn" type="revolute"><parent link="base"/><child link="tip"/><origin xyz="1 0 0"/>
        <axis xyz="0 0 2"/></joint>
      <joint name="slide" type="prismatic"><parent link="tip"/><child link="thumb"/><origin xyz="0 1 0"/>
        <mimic joint="turn" multiplier="2" offset="0.5"/></joint></robot>""")
    robot = dermatome.Robot.read(path)
    assert robot.links == ("base", "tip", "thumb") and robot.joints == ("turn",)
    poses = robot.poses({"turn": 0.25})
    c, s = np.cos(0.25), np.sin(0.25)
    assert np.allclose(poses["tip"], [[c, -s, 0, 1], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-15)
    assert np.allclose(poses["thumb"], poses["tip"] @ [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-15)
    for joints in ({"slide": 1.0}, {"knee": 1.0}, {"turn": np.nan}, {"turn": "x"}, {1: 1.0}):
        with pytest.raises(dermatome.DataError, match="joints"):
            robot.poses(joints)


def test_flatten_and_coarsen():
    positions, faces = tube()
    flat = dermatome.flatten(positions, faces, cut="all")
    assert len(flat.uv) > len(positions) and flat.distortion["qc_max"] < 1.01 and flat.converged
    assert np.array_equal(flat.vertex_of_place[flat.faces], faces)
    ring = dermatome.flatten(positions, faces, cut="none")
    assert ring.uv.shape == (720, 2) and ring.distortion["flips"] == 0
    levels = dermatome.coarsen(positions, faces)
    assert np.allclose(levels[1].pooling().scipy().sum(axis=1), 1)
    assert np.array_equal(levels[1].positions, positions[levels[1].origins])


def test_findings_and_errors_are_named(tmp_path):
    positions, faces = lattice(5, 5)
    assert dermatome.check(positions, faces) == []
    found = dermatome.check(positions, np.concatenate([faces, faces[:1]]))
    assert [f["kind"] for f in found if f["severity"] == "error"]
    with pytest.raises(FileNotFoundError, match="no.glb") as missing:
        dermatome.Map.read(tmp_path / "no.glb")
    assert isinstance(missing.value, dermatome.Error) and missing.value.kind == "read"
    (tmp_path / "bad.glb").write_bytes(b"glTF")
    with pytest.raises(dermatome.DataError, match="bad.glb"):
        dermatome.Map.read(tmp_path / "bad.glb")
    with pytest.raises(ValueError) as argument:
        dermatome.Skin.from_arrays(positions[:, :2], faces)
    assert str(argument.value) == "positions: found shape (25, 2); needed: shape (k, 3)"
    assert argument.value.kind == "argument"
    again = pickle.loads(pickle.dumps(argument.value))
    assert (str(again), again.kind, type(again)) == (str(argument.value), "argument", dermatome.DataError)


def worker(index_of, points):
    return index_of.index(threads=1).locate(points, threads=2).distance.sum()


@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_other_processes_answer_alike(dome_map, start):
    points = dome()[0] + 1e-3
    here = worker(dome_map, points)
    with multiprocessing.get_context(start).Pool(2) as pool:
        there = [pool.apply_async(worker, (dome_map, points)) for _ in range(3)]
        assert {result.get(timeout=60) for result in there} == {here}


def test_other_threads_run_meanwhile(dome_map):
    ticks, done = [], threading.Event()

    def tick():
        while not done.is_set():
            ticks.append(1)
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    before = len(ticks)
    dermatome.build(dermatome.Skin.from_arrays(*dome(60, 60, spacing=0.0015)))
    during = len(ticks) - before
    done.set()
    thread.join()
    assert during > 3


def interrupted(code):
    """What a program says after it said that it begins, and was interrupted half a second later."""
    command = [sys.executable, "-c", code, os.path.dirname(__file__)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "begins\n"
            time.sleep(0.5)
            process.send_signal(signal.SIGINT)
            said = process.communicate(timeout=60)[0]
        finally:
            # A program that does not hear must not hold the tests.
            process.kill()
    assert process.returncode == 7
    return said


def test_interrupts_are_heard():
    code = (
        "import signal, sys, dermatome; sys.path.insert(0, sys.argv[1]); from conftest import lattice\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "p, f = lattice(700, 700); p[:, 2] = (p[:, 0] - p[:, 1]) ** 2\n"
        "try: print('begins', flush=True); dermatome.flatten(p, f)\n"
        "except KeyboardInterrupt: print('stopped', flush=True); import os; os._exit(7)\n"
    )
    assert interrupted(code) == "stopped\n"


# A process that was started in the background of a shell without job control ignores SIGINT.
IDLE = """
import os, signal, sys, time
import numpy as np
import dermatome
sys.path.insert(0, sys.argv[1])
from conftest import dome, lattice
map = dermatome.build(dermatome.Skin.from_arrays(*dome()))
values = np.random.default_rng(0).random((3000, 256))
values[values < 0.1] = np.nan
renderer, index, points = map.renderer(), map.index(), np.zeros((4_000_000, 3))
signal.signal(signal.SIGINT, signal.default_int_handler)
print("begins", flush=True)
try:
    while True:
        CALL
except KeyboardInterrupt:
    # The factorisation of a large system ends first.
    for _ in range(40):
        before = time.process_time()
        time.sleep(0.5)
        is_idle = time.process_time() - before < 0.2
        if is_idle:
            break
    print("idle" if is_idle else "busy", flush=True)
    os._exit(7)
"""


@pytest.mark.parametrize(
    "call",
    [
        "renderer(values)",
        "map.pool(np.tile(values, (200, 1)), 1)",
        "index.locate(points)",
        "dermatome.touch(map, presses=10_000)",
        "dermatome.build(dermatome.Skin.from_arrays(*dome(600, 600, spacing=1e-4)))",
        "dermatome.flatten(*dome(600, 600, spacing=1e-4))",
        "dermatome.coarsen(*lattice(900, 900))",
        "dermatome.calibrate(dermatome.simulate(taxels=60_000, radius=2.0, model='poses')[0])",
        "dermatome.simulate(taxels=200_000, anchors=100_000, radius=2.0)",
        "dermatome.Skin.from_arrays(np.random.default_rng(1).random((300_000, 3)) * [1, 1, 0])",
    ],
)
def test_what_was_interrupted_ends(call):
    assert interrupted(IDLE.replace("CALL", call)) == "idle\n"


def resident():
    """Bytes of memory that the process holds now."""
    try:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        pytest.skip("no /proc/self/statm")


def test_memory_does_not_grow(dome_map):
    index, renderer, point, frame = dome_map.index(), dome_map.renderer(1, size=(8, 8)), dome()[0][:1], np.zeros((1, 256))
    turned = {"hand": np.eye(4)}

    def calls(count):
        for _ in range(count):
            index.locate(point, level=1, threads=1)
            index.posed(turned)
            renderer(frame, threads=1)
            dome_map.pool(frame, 1, threads=1)
        gc.collect()
        return resident()

    before = calls(2000)
    after = calls(25_000)
    assert after - before < 4 << 20, f"{after - before} bytes more after 100,000 calls: {(after - before) / 100_000} a call"


def test_posed_indices_share_their_trees():
    index = dermatome.build(dermatome.Skin.from_arrays(*lattice(70, 70))).index(reactive=True)
    before = resident()
    posed = [index.posed({"link": np.eye(4)}) for _ in range(200)]
    assert (resident() - before) / len(posed) < 50_000, "a tree of 4900 taxels takes some 500 kB"


def test_several_files_are_one_skin(tmp_path):
    positions, faces = dome()
    for k in range(2):
        dermatome.Skin.from_arrays(positions + [k, 0, 0], faces, patch=f"part{k}").write(tmp_path / f"{k}.glb")
    both = dermatome.Skin.read([tmp_path / "0.glb", str(tmp_path / "1.glb")])
    assert both.patches == ("part0", "part1") and both.n_taxels == 512
    with pytest.raises(dermatome.DataError, match="weld"):
        dermatome.Skin.read(tmp_path / "0.glb", weld="texture")
    coarse = dermatome.Skin.read(tmp_path / "0.glb", spacing=0.01)
    assert 30 < coarse.n_taxels < 128
    named = dermatome.Skin.read(tmp_path / "0.glb", spacing={"li*": 0.01, "*": 0.02})
    assert named.n_taxels == coarse.n_taxels
    with pytest.raises(dermatome.DataError, match="spacing: found no name of the link"):
        dermatome.Skin.read(tmp_path / "0.glb", spacing={"hand": 0.01})
    within = np.concatenate([positions, positions - [0, 0, 0.01]])
    assert dermatome.Skin.from_arrays(within, np.concatenate([faces, faces + 256])).n_taxels == 512
    assert dermatome.Skin.read(tmp_path / "0.glb", outer=True).n_taxels == 256


def test_what_outer_leaves_out_is_named(tmp_path):
    files = []
    for name, half in (("palm", 0.05), ("finger", 0.01)):
        corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        faces = [face for a, b, c, d in sides for face in ([a, b, c], [a, c, d])]
        files.append(tmp_path / f"{name}.stl")
        dermatome.Skin.from_arrays(corners, faces, patch=name).write(files[-1])
    skin = dermatome.Skin.read(files, outer=True)
    assert len(skin.patches) == 1 and skin.remarks[0] == "12 faces are not seen from outside, and left out"
    assert [r for r in skin.remarks if "finger" in r and "cannot be seen from outside, and left out" in r]


def test_the_outside_of_bodies_that_are_wound_inside_out(tmp_path):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([face for a, b, c, d in sides for face in ([a, c, b], [a, d, c])])
    vertices = 0.02 * np.concatenate([corners, corners * [1, 0.5, 0.5] + [1, 0, 0]])
    lines = ["v " + " ".join(map(str, vertex)) for vertex in vertices]
    lines += ["f " + " ".join(map(str, face + 1)) for face in np.concatenate([faces, faces + 8])]
    (tmp_path / "cubes.obj").write_text("\n".join(lines))
    skin = dermatome.Skin.read(tmp_path / "cubes.obj", outer=True)
    a, b, c = skin.positions[skin.faces].transpose(1, 0, 2)
    middle = (a + b + c) / 3
    inner = np.clip(middle, [-0.01, -0.005, -0.005], [0.015, 0.005, 0.005])
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), middle - inner) > 0).all()
    assert [remark for remark in skin.remarks if "wound against the closed surface" in remark]


def test_fields_are_finer_where_the_acuity_is_larger():
    positions, faces = lattice(30, 30)
    acuity = np.where(positions[:, 0] < positions[:, 0].mean(), 3.0, 1.0)
    for level in (
        dermatome.build(dermatome.Skin.from_arrays(positions, faces), acuity=acuity).patches["skin"].levels[1],
        dermatome.coarsen(positions, faces, acuity=acuity)[1],
    ):
        fine = (level.positions[:, 0] < positions[:, 0].mean()).mean()
        assert fine > 0.6
    uv = dermatome.flatten(positions, faces, acuity=acuity).uv
    (ax, ay), (bx, by) = (uv[faces[:, 1]] - uv[faces[:, 0]]).T, (uv[faces[:, 2]] - uv[faces[:, 0]]).T
    area = ax * by - ay * bx
    assert area[acuity[faces].min(axis=1) == 3].mean() > 4 * area[acuity[faces].max(axis=1) == 1].mean()


def test_progress_is_told():
    told = []
    dermatome.build(dermatome.Skin.from_arrays(*lattice(8, 8)), progress=lambda *step: told.append(step))
    assert told == [("coarsen", 0, 1), ("coarsen", 1, 1), ("flatten", 0, 1), ("flatten", 1, 1)]


def test_what_progress_raises_ends_the_build(dome_map):
    skin, calls = dermatome.Skin.from_arrays(*lattice(8, 8)), []
    for exception in (ValueError, KeyboardInterrupt, SystemExit):

        def progress(*_, exception=exception):
            calls.append(exception)
            raise exception("enough")

        def nested(*_, progress=progress):
            dermatome.build(skin, progress=progress)

        for stop in (progress, nested):
            with pytest.raises(exception, match="enough"):
                dermatome.build(skin, progress=stop)
    assert len(calls) == 6
    assert dermatome.build(skin).n_taxels == 64
    for wrong in (3, "tqdm"):
        with pytest.raises(dermatome.DataError, match="progress: found .*; needed: a function"):
            dermatome.build(skin, progress=wrong)


def test_progress_may_call_the_package(dome_map):
    pooled = []

    def progress(*_):
        pooled.append(dome_map.pool(np.zeros(256), 1, threads=1))
        pooled.append(dermatome.flatten(*lattice(4, 4), threads=1).uv)

    dermatome.build(dermatome.Skin.from_arrays(*lattice(8, 8)), threads=1, progress=progress)
    assert len(pooled) == 8


def test_fields_of_the_whole_map_have_one_order(uneven_map):
    index = uneven_map.index(fields=True)
    for number in range(uneven_map.n_levels):
        patch, level, place = uneven_map.fields(number)
        count = uneven_map.n_fields(number)
        assert len(patch) == count == uneven_map.pooling(number).shape[1] == uneven_map.pool(np.zeros(592), number).shape[0]
        of_patches = list(uneven_map.patches.values())
        assert level.tolist() == [min(number, len(of_patches[p].levels) - 1) for p in patch]
        centres = np.array([of_patches[p].levels[n].positions[k] for p, n, k in zip(patch, level, place)])
        near = index.locate(centres, level=number).fields.scipy()
        assert near.shape == (count, count) and (near.diagonal() > 0.99).all()
        nearest = index.nearest(centres + 1e-5, level=number)
        assert np.array_equal(nearest.patch, patch) and np.array_equal(nearest.level, level) and np.array_equal(nearest.field, place)
        assert np.array_equal(index.within(centres, 1e-6, level=number).field, place)
    with pytest.raises(dermatome.DataError, match="level: found 9"):
        uneven_map.fields(9)


def test_edges_are_the_sides_of_faces(dome_map):
    for level in dome_map.patches["dome"].levels:
        sides = np.sort(np.concatenate([level.faces[:, [0, 1]], level.faces[:, [1, 2]], level.faces[:, [2, 0]]]), axis=1)
        assert np.array_equal(level.edges, np.unique(sides, axis=0)) and level.edges.dtype == np.uint32


def test_skins_of_several_links(tmp_path):
    positions, faces = lattice(6, 5)
    away = np.eye(4)
    away[:3] = [[0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, 0.3]]
    palm = dermatome.Skin.from_arrays(positions, faces, patch="palm", link="base", ids=np.arange(30) + 100)
    thumb = dermatome.Skin.from_arrays(positions, faces, patch="tip", link="thumb")
    hand = dermatome.Skin.join([palm, thumb], poses={"thumb": away})
    assert (hand.patches, hand.links, hand.remarks) == (("palm", "tip"), ("base", "thumb"), ())
    assert np.array_equal(hand.positions, np.concatenate([positions] * 2)) and np.array_equal(hand.ids, [*range(100, 130), *range(1, 31)])
    index = dermatome.build(hand).index()
    world = positions @ away[:3, :3].T + away[:3, 3]
    assert np.allclose(index.poses["thumb"], away) and abs(index.locate(world).distance).max() < 1e-9
    assert (index.locate(world).link == 1).all()
    # Links keep what hangs from them; the same skin twice is one link.
    (tmp_path / "arm.urdf").write_text("""<robot name="arm"><link name="base"/><link name="tip"><visual><geometry><box size="0.1 0.1 0.1"/>
      </geometry></visual></link><joint name="j" type="fixed"><parent link="base"/><child link="tip"/><origin xyz="0 0 1"/></joint></robot>""")
    arm = dermatome.Skin.read(tmp_path / "arm.urdf", spacing=0.02)
    moved = dermatome.build(dermatome.Skin.join([arm, palm], poses={"base": away})).index()
    assert moved.poses["tip"][:3, 3] == pytest.approx([0.1, 0.2, 1.3]) and list(moved.poses) == ["base", "tip"]
    twice = dermatome.Skin.join([palm, palm, thumb])
    assert twice.patches == ("palm", "palm.1", "tip") and twice.links == ("base", "thumb")
    assert twice.remarks == ("palm: the name is taken; this patch is now palm.1", "30 ids belong to several taxels, which share their readings")
    assert dermatome.Skin.join([hand, palm]).links == ("base", "thumb")
    other = dermatome.Skin.from_arrays(positions, faces, patch="tip", link="bose")
    dermatome.Skin.join([palm, other]).write(tmp_path / "twins.glb")
    (tmp_path / "twins.glb").write_bytes((tmp_path / "twins.glb").read_bytes().replace(b'"bose"', b'"base"'))
    twins = dermatome.Skin.read(tmp_path / "twins.glb")
    for wrong, text in (
        (lambda: dermatome.Skin.join([hand, thumb]), "skins: found two links \"thumb\" with another parent or pose"),
        (lambda: dermatome.Skin.join([palm], poses={"thumb": away}), "poses: found \"thumb\""),
        (lambda: dermatome.Skin.join([twins], poses={"base": away}), "the name of 2 links of skins"),
        (lambda: dermatome.Skin.join([palm], poses={"base": 2 * away}), "last row"),
        (lambda: dermatome.Skin.join([palm], poses={"base": np.diag([2, 1, 1, 1])}), "no rigid pose"),
    ):
        with pytest.raises(dermatome.DataError, match=text):
            wrong()


def test_taxels_of_several_patches_from_arrays():
    positions, faces = lattice(6, 5)
    both, two = np.concatenate([positions, positions + [0.2, 0, 0]]), np.concatenate([faces, faces + 30])
    order = np.random.default_rng(0).permutation(60)
    place = np.argsort(order)
    names = np.array(["palm"] * 30 + ["tip"] * 30)
    ids, normals = np.arange(60) + 500, np.tile([0.0, 0, 1], (60, 1))
    for given in (names[order], names[order].tolist()):
        skin = dermatome.Skin.from_arrays(
            both[order], place[two], patch=given, link=np.where(names == "palm", "base", "finger")[order], ids=ids[order], normals=normals
        )
        at = np.argsort(skin.ids)
        assert set(skin.patches) == {"palm", "tip"} and set(skin.links) == {"base", "finger"}
        assert np.array_equal(skin.positions[at], both) and len(skin.faces) == len(two)
    bare = dermatome.Skin.from_arrays(both[order], patch=names[order].tolist(), outside=(0, 0, 1))
    assert bare.links == ("link",) and np.array_equal(bare.positions, both[order][bare.ids - 1])
    for wrong, text in (
        ({"patch": names[:9].tolist()}, "patch: found 9; needed: a word, or 60"),
        ({"patch": 3}, "patch: found int"),
        ({"patch": ["a"] * 59 + ["b"]}, r"faces\[.*\]: found taxels of the patches"),
        ({"link": ["a"] * 59 + ["b"]}, r"link\[59\]: found \"b\"; needed: \"a\", that of the other taxels of the patch \"skin\""),
    ):
        with pytest.raises(dermatome.DataError, match=text):
            dermatome.Skin.from_arrays(both, two, **wrong)


def test_each_point_may_have_its_link():
    flat = lattice(12, 12)[0]
    names = ["a"] * 144 + ["b"] * 144
    skin = dermatome.Skin.from_arrays(np.concatenate([flat, flat + [0, 0, 0.01]]), patch=names, link=names, outside=(0, 0, 1))
    index = dermatome.build(skin).index(reactive=True, fields=True)
    points = flat[[30, 40, 50, 60]] + [0, 0, 0.002]
    for only, expected in (
        (["a", "b", None, "b"], [0, 1, 0, 1]),
        ([0, 1, -1, 1], [0, 1, 0, 1]),
        (np.array([1, 1, 0, 0], dtype=np.uint8), [1, 1, 0, 0]),
        (np.array(["b", "a", "a", "b"]), [1, 0, 0, 1]),
        ("b", [1] * 4),
    ):
        assert index.locate(points, only_link=only).link.tolist() == expected
        assert index.reactive(points, only_link=only).link.tolist() == expected
        assert index.nearest(points, only_link=only).patch.tolist() == expected
    readings, felt = index.readings(points, np.ones(4), only_link=["a", "a", "b", "b"])
    assert felt.all() and np.allclose(readings.reshape(2, 144).sum(axis=1), 2)
    for wrong, text in ((["a"], "found 1 links; needed: one, or 4"), ([0, 1, 2, 0], r"only_link\[2\]: found 2"), (["a", "b", "c", "a"], '"c"')):
        with pytest.raises(dermatome.DataError, match=text):
            index.locate(points, only_link=wrong)


def test_flatten_cuts_as_build_does():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    box = [face for a, b, c, d in sides for face in ([a, b, c], [a, c, d])]
    assert len(dermatome.flatten(corners, box).uv) > 8
    with pytest.raises(dermatome.DataError):
        dermatome.flatten(corners, box, cut="none")
    positions, faces = dome()
    assert np.array_equal(dermatome.flatten(positions, faces).faces, faces.astype(np.uint32)), "a disk is not cut"
    around = tube()
    seam = [[24 * k, 24 * (k + 1)] for k in range(29)]
    cut = dermatome.flatten(*around, cut=seam)
    assert len(cut.uv) == 720 + 30 and np.array_equal(np.unique(cut.vertex_of_place[720:] % 24), [0])
    with pytest.raises(dermatome.DataError, match="cut: found vertex 720; needed: 0 to 719"):
        dermatome.flatten(*around, cut=[[719, 720]])

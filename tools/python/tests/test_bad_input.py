"""Whatever comes in, what comes out is an answer or an exception that says what is wrong; never a panic."""

import sys

import numpy as np
import pytest
from conftest import dome, lattice
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import dermatome

SETTINGS = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)

numbers = st.one_of(
    st.floats(-1, 1), st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-320, 1e300, -1e13, 1e12])
)
dtypes = st.sampled_from([np.float64, np.float32, np.float16, ">f8", np.int32, ">i2", np.uint8, bool, complex, "U3", object])


@st.composite
def anything(draw, columns=3, rows=12):
    """An array, or what might be meant as one."""
    shape = draw(
        st.one_of(
            st.tuples(st.integers(0, rows), st.just(columns)),
            st.sampled_from([(), (columns,), (0,), (2, columns + 1), (2, 2, columns), (0, 0)]),
        )
    )
    array = draw(hnp.arrays(np.float64, shape, elements=numbers))
    with np.errstate(all="ignore"):
        array = array.astype(draw(dtypes))
    form = draw(st.sampled_from(["array", "list", "fortran", "reversed", "read-only", "other"]))
    if form == "list":
        return array.tolist()
    if form == "fortran":
        return np.asfortranarray(array)
    if form == "reversed":
        return array[::-1] if array.ndim else array
    if form == "read-only":
        array.flags.writeable = False
    if form == "other":
        return draw(st.sampled_from([None, "text", {}, [[1, 2], [3]], b"x", 3, object()]))
    return array


def accepts(call):
    """Calls, and takes the exceptions of the package."""
    try:
        return call()
    except dermatome.Error as e:
        assert e.kind and str(e)
    except TypeError as e:  # Of Python, for a name that is no argument.
        assert "unexpected keyword argument" in str(e)
    return None


@pytest.fixture(scope="session")
def index(dome_map):
    return dome_map.index(reactive=True, fields=True)


words = st.one_of(st.sampled_from(["", "hand", "nowhere", "\0", "\u202e"]), st.none())
levels = st.integers(-2, 4) | st.sampled_from([2**31, 2**63 - 1, 2**70, None, 1.5, "1"])
real = numbers | st.sampled_from([None, "1", 10**400])


@SETTINGS
@given(anything(), anything(), words, levels)
def test_lookups(index, points, directions, link, level):
    for call in (
        lambda: index.locate(points, link=link, level=level),
        lambda: index.locate(points, only_link=link),
        lambda: index.ray(points, directions, level=level),
        lambda: index.ray(points, points, longest=level),
        lambda: index.reactive(points, level),
        lambda: index.nearest(points, level),
        lambda: index.within(points, 0.01, level=level),
    ):
        accepts(call)


@SETTINGS
@given(anything(), real, levels)
def test_distances_and_poses(index, points, length, count):
    accepts(lambda: index.within(points, length))
    accepts(lambda: index.ray(points, points, longest=length))
    accepts(lambda: index.nearest(points, count, threads=count))
    accepts(lambda: index.posed({"hand": points}))
    accepts(lambda: index.posed({points if isinstance(points, str) else "x": np.eye(4)}))


@SETTINGS
@given(anything(columns=256), levels)
def test_values(dome_map, values, level):
    accepts(lambda: dome_map.pool(values, level))
    accepts(lambda: dome_map.pooling(level))
    accepts(lambda: dome_map.renderer(size=(9, 9))(values))
    accepts(lambda: dermatome.ContactTracker(dome_map).track(values))
    accepts(lambda: dome_map.plot(values, width=300, levels=[level]))
    accepts(lambda: dermatome.Readings.from_arrays(values).on(dome_map))


@SETTINGS
@given(anything(columns=2), levels)
def test_places(dome_map, uv, level):
    accepts(lambda: dome_map.to_skin("dome", uv, level=level))


@SETTINGS
@given(anything(), anything(), anything(columns=1))
def test_skins(positions, faces, ids):
    accepts(lambda: dermatome.Skin.from_arrays(positions, faces))
    accepts(lambda: dermatome.Skin.from_arrays(positions))
    accepts(lambda: dermatome.Skin.from_arrays(lattice(4, 3)[0], ids=ids, normals=positions, present=ids))
    accepts(lambda: dermatome.check(positions, faces))
    accepts(lambda: dermatome.flatten(positions, faces))
    accepts(lambda: dermatome.coarsen(positions, faces))


@SETTINGS
@given(hnp.arrays(np.int64, st.tuples(st.integers(0, 12), st.just(3)), elements=st.integers(-1, 13)))
def test_any_triangles(faces):
    positions = lattice(4, 3)[0]
    for call in (
        lambda: dermatome.flatten(positions, faces, cut="auto"),
        lambda: dermatome.coarsen(positions, faces, coarsest=4),
        lambda: dermatome.build(dermatome.Skin.from_arrays(positions, faces, repair=True)),
        lambda: dermatome.check(positions, faces),
    ):
        accepts(call)


@SETTINGS
@given(real, real, real, levels)
def test_options(a, b, c, count):
    palm = dermatome.Skin.from_arrays(*lattice(5, 5))
    for options in (
        {"ratio": a}, {"levels": count}, {"coarsest": count}, {"angle": a, "area": b, "perimeter": c}, {"magnify": a},
        {"pixel": a}, {"seam_side": [a, b, c]}, {"max_area_ratio": a}, {"threads": count}, {"cut": [[count, 1]]},
        {"method": "linear", "angle": a, "area": b}, {"nonsense": 1},
    ):  # fmt: skip
        if options.get("threads") in (None, 1.5, "1") or options.get("threads", 0) < 5:
            accepts(lambda: dermatome.build(palm, **options))
    accepts(lambda: dermatome.Skin.from_arrays(*lattice(5, 5), gap=a, outside=[a, b, c], fill_holes=count))
    accepts(lambda: dermatome.simulate(taxels=min(count, 200) if isinstance(count, int) else count, noise=a, spacing=b))
    accepts(lambda: dermatome.touch(palm, presses=1, radius=a, depth=b, dead=c, rate=10.0))


@SETTINGS
@given(anything(columns=256), anything(columns=1), real, real, levels)
def test_recordings(dome_map, index, values, times, a, b, count):
    readings = accepts(lambda: dermatome.Readings.from_arrays(values, timestamps=times))
    for call in (
        lambda: readings.condition(dome_map, baseline=count),
        lambda: readings.condition(dome_map, gain={count: a}, clip=(a, b)),
        lambda: readings.condition(dome_map, split=a, rate=b),
        lambda: readings.condition(dome_map, scale=times, offset=values, fill="neighbours", units=[count]),
        lambda: readings.condition(dome_map, baseline=values, gain=times, clip=[a]),
        lambda: readings.features(dome_map, count),
        lambda: (len(list(readings)), repr(readings)),
    ):
        if readings is not None:
            accepts(call)
    accepts(lambda: dome_map.pool(values, count, contrast=True))
    accepts(lambda: dome_map.renderer(extensive=values))
    accepts(lambda: dome_map.plot(view=(a, b), unfold=[a, b], range=(a, b), width=300))
    accepts(lambda: dermatome.ContactTracker(dome_map, threshold=a, low=b, least=count, noise_frames=count, reach=a))
    accepts(lambda: index.readings(times, [a], [b]))
    accepts(lambda: index.readings(np.zeros((1, 3)), [a], [b], taxel_radius=a, max_distance=b))


@SETTINGS
@given(anything(columns=1, rows=25), real, real, levels)
def test_acuities_and_calibrations(acuity, a, b, count):
    positions, faces = lattice(5, 5)
    accepts(lambda: dermatome.build(dermatome.Skin.from_arrays(positions, faces), acuity=acuity))
    accepts(lambda: dermatome.coarsen(positions, faces, acuity=acuity, coarsest=4))
    accepts(lambda: dermatome.flatten(positions, faces, acuity=np.full(25, a)))
    few = count if count is None or not isinstance(count, int) else min(count, 40)
    made = accepts(lambda: dermatome.simulate(taxels=40, anchors=few, anchor_noise=a, normal_noise=b, indentation=a, arm_noise=b))
    if made:
        found = accepts(lambda: dermatome.calibrate(made[0], iterations=few))
        if found:
            accepts(lambda: found.skin(acuity))


@SETTINGS
@given(st.binary(max_size=200), st.integers(0, 10**6), st.binary(min_size=1, max_size=3))
def test_damaged_files(dome_map, garbage, place, patch):
    good = dome_map.to_bytes()
    place %= len(good)
    for data in (garbage, good[:place], good[:place] + patch + good[place + len(patch) :]):
        accepts(lambda: dermatome.Map.from_bytes(data))
        accepts(lambda: dermatome.Skin.from_bytes(data))
    for kind in ("obj", "stl", "ply", "json", "nothing", ""):
        accepts(lambda: dermatome.Skin.from_bytes(garbage, kind))


def test_masked_unaligned_and_tracked_arrays(dome_map):
    values = np.random.default_rng(0).random((2, 256))
    with pytest.raises(dermatome.DataError, match="values: found masked numbers"):
        dome_map.pool(np.ma.masked_greater(values, 0.9), 1)
    unaligned = np.frombuffer(b"\0" + values.tobytes(), np.uint8)[1:].view(np.float64).reshape(2, 256)
    assert np.array_equal(dome_map.pool(unaligned, 1), dome_map.pool(values, 1))

    class Tracked:
        def __array__(self, *_, **__):
            raise RuntimeError("requires grad")

    with pytest.raises(dermatome.DataError, match="values: found Tracked") as found:
        dome_map.pool(Tracked(), 1)
    assert "requires grad" in str(found.value.__cause__)


def test_a_bad_point_is_named_in_any_batch(index):
    points = np.random.default_rng(0).random((150_000, 3)) * 0.1
    hits, behind = index.locate(points), index.locate(points[130_000:])
    assert np.array_equal(hits.point[130_000:], behind.point) and np.array_equal(hits.fields.data[-9:], behind.fields.data[-9:])
    points[140_000:] = np.inf
    with pytest.raises(dermatome.DataError, match=r"points\[140000\]: found \[inf, inf, inf\]"):
        index.locate(points)


def test_numbers_that_are_too_large_are_named(dome_map):
    for name, call in [
        ("threads", lambda huge: dome_map.pool(np.zeros(256), 1, threads=huge)),
        ("size", lambda huge: dome_map.renderer(size=(huge, 3))),
        ("coarsest", lambda huge: dermatome.build(dermatome.Skin.from_arrays(*lattice(5, 5)), coarsest=huge)),
        ("longest", lambda huge: dome_map.index().ray(np.zeros((1, 3)), np.ones((1, 3)), longest=huge)),
        ("pixel", lambda huge: dome_map.renderer(pixel=huge)),
    ]:
        with pytest.raises(dermatome.DataError, match=f"^{name}: found .*; needed: .*number"):
            call(10**400)
    with pytest.raises(dermatome.DataError, match="level: found 1000"):
        dome_map.pool(np.zeros(256), 10**400)
    with pytest.raises(dermatome.DataError, match="poses: found a key"):
        dome_map.index().posed({3: np.eye(4)})


def test_huge_results_are_refused(dome_map):
    with pytest.raises((MemoryError, dermatome.DataError)):
        dome_map.renderer(size=(16000, 16000), channels=2**40)
    accepts(lambda: dome_map.renderer(size=(2**31, 2**31)))


def test_flat_and_huge_shapes(dome_map):
    for scale in (1e-9, 1e9, 1e200):
        accepts(lambda: dermatome.build(dermatome.Skin.from_arrays(dome()[0] * scale, dome()[1])))
    accepts(lambda: dermatome.build(dermatome.Skin.from_arrays(np.zeros((9, 3)), lattice(3, 3)[1])))


def test_messages_say_what_to_do(dome_map, monkeypatch):
    index, points = dome_map.index(), np.zeros((2, 3))

    class Trimesh:
        vertices = points

    class Tensor:
        def detach(self):
            return self

        def __array__(self, *_, **__):
            raise RuntimeError("requires grad")

    monkeypatch.setitem(sys.modules, "scipy.sparse", None)
    for call, match in (
        (lambda: index.reactive(points), r"index: found no reactive; needed: Map.index\(reactive=True\)"),
        (lambda: index.nearest(points), r"index: found no fields; needed: Map.index\(fields=True\)"),
        (lambda: index.within(points, 1), r"Map.index\(fields=True\)"),
        (lambda: index.readings(points, [1, 1]), r"Map.index\(fields=True\)"),
        (lambda: index.locate(points + [0, np.inf, 0]), r"points\[0\]: found \[0.0, inf, 0.0\]; needed: coordinates within"),
        (lambda: index.ray(points - [0, 1e13, 0], points), r"origins\[0\]: found"),
        (lambda: index.posed({"hand": np.diag([2, 1, 1, 1])}), r'poses\["hand"\]: found no rigid pose'),
        (lambda: dermatome.build(Trimesh()), r"skin: found Trimesh; needed: a Skin or a file: Skin.from_mesh"),
        (lambda: dome_map.pool(Tensor(), 1), r"values: found Tensor; .*detach\(\).cpu\(\)"),
        (lambda: dome_map.renderer(channels=2, extensive=[True]), "extensive: found 1; needed: one, or 2: one for each channel"),
        (lambda: dome_map.pooling(1).scipy(), r"scipy.sparse is needed: pip install 'dermatome\[scipy\]'"),
    ):
        with pytest.raises((dermatome.DataError, ImportError), match=match):
            call()


def test_arguments_of_another_type_say_what_makes_the_right_one(tmp_path):
    skin_map = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
    readings = dermatome.Readings.from_arrays(np.zeros((5, 81)))
    log = {name: [0.0, 0.0] for name in ("px", "py", "pz")}
    for call, said in (
        (lambda: dermatome.build(skin_map), "skin: found Map; needed: a Skin or a file"),
        (lambda: dermatome.build(np.zeros((9, 3))), "Skin.from_arrays"),
        (lambda: dermatome.build(None), "skin: found NoneType"),
        (lambda: dermatome.calibrate(np.zeros((9, 3))), "observations: found ndarray; needed: Observations"),
        (lambda: dermatome.calibrate({"i": [1]}), "Observations.from_columns"),
        (lambda: dermatome.touches(log, readings=[1]), "readings: found list; needed: Readings"),
        (lambda: dermatome.touches(log, joints=[1]), "joints: found list; needed: a value for each joint"),
        (lambda: readings.condition("map.glb"), "map: found str; needed: a Map"),
        (lambda: readings.on(None), "map: found NoneType; needed: a Map"),
        (lambda: dermatome.response("map.glb", readings), "map: found str; needed: a Map"),
        (lambda: dermatome.order("map.glb", readings), "map: found str; needed: a Map"),
        (lambda: dermatome.order(skin_map, readings, known=[1]), "known: found list; needed: a mapping"),
        (lambda: dermatome.examine(skin_map, readings, modules=["a"]), "modules: found list; needed: a mapping"),
        (lambda: dermatome.examine(skin_map, 3), "readings: found int; needed: Readings"),
    ):
        with pytest.raises(dermatome.DataError) as error:
            call()
        assert said in str(error.value), error.value
    np.save(tmp_path / "frames.npy", np.zeros((5, 81)))
    assert dermatome.Readings.open(tmp_path / "frames.npy").read(skin_map).values.shape == (5, 1, 81)

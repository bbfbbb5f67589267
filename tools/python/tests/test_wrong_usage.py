"""Wrong calls, as users make them: each is answered by our own words, which begin with the argument and say what was found and what
is needed."""

import numpy as np
import pytest
from conftest import lattice

import dermatome

# What is called, and the argument that the answer names.
WRONG = [
    ("d.build(5)", "skin"),
    ("d.build(positions)", "skin"),
    ("d.build(skin, levels='three')", "levels"),
    ("d.build(skin, levels=2.5)", "levels"),
    ("d.build(skin, coarsest=10**400)", "coarsest"),
    ("d.build(skin, ratio='4')", "ratio"),
    ("d.build(skin, method='lscm')", "method"),
    ("d.build(skin, method=3)", "method"),
    ("d.build(skin, cut='maybe')", "cut"),
    ("d.build(skin, acuity=[1, 2])", "acuity"),
    ("d.build(skin, keep_going='yes')", "keep_going"),
    ("d.build(skin, pixel='2mm')", "pixel"),
    ("d.build(skin, threads='all')", "threads"),
    ("d.build(skin, magnify=None)", "magnify"),
    ("d.Skin.read(5)", "path"),
    ("d.Skin.read(mesh_file, spacing='5mm')", "spacing"),
    ("d.Skin.read(mesh_file, unit='km')", "unit"),
    ("d.Skin.read(mesh_file, unit=[1])", "unit"),
    ("d.Skin.read(mesh_file, patches='palm')", "patches"),
    ("d.Skin.read(mesh_file, gap='wide')", "gap"),
    ("d.Skin.read(mesh_file, fill_holes='all')", "fill_holes"),
    ("d.Skin.from_arrays(positions[:, :2])", "positions"),
    ("d.Skin.from_arrays('palm.obj')", "positions"),
    ("d.Skin.from_arrays(positions, [[0, 1, 99]])", r"faces\[0\]"),
    ("d.Skin.from_arrays(positions, ids=[1])", "ids"),
    ("d.Skin.from_arrays(positions, outside='up')", "outside"),
    ("d.Skin.from_arrays(positions, weld=True)", "weld"),
    ("d.Skin.from_mesh(3)", "mesh"),
    ("d.Skin.join(skin)", "skins"),
    ("d.Skin.join([skin_map])", "skins"),
    ("d.Map.read(None)", "path"),
    ("d.Map.from_bytes('map.glb')", "data"),
    ("skin_map.write(3)", "path"),
    ("skin_map.export('skin.xml', level='fine')", "level"),
    ("skin_map.export('skin.xml', patch=0)", "patch"),
    ("skin_map.pool(values, 'fine')", "level"),
    ("skin_map.pool(values[:5], 1)", "values"),
    ("skin_map.pool(['a'] * 81, 1)", "values"),
    ("skin_map.pool(values, 1, extensive='yes')", "extensive"),
    ("skin_map.pooling(99)", "level"),
    ("skin_map.renderer(size=64)", "size"),
    ("skin_map.renderer(size=(64,))", "size"),
    ("skin_map.renderer(size=('64', '96'))", "size"),
    ("skin_map.renderer(level=None)", "level"),
    ("skin_map.renderer(pack='loose')", "pack"),
    ("skin_map.renderer(pack=3)", "pack"),
    ("skin_map.renderer(fill='black')", "fill"),
    ("skin_map.renderer(channels=-1)", "channels"),
    ("skin_map.renderer(patch='elbow')", "patch"),
    ("skin_map.renderer(extensive='N')", "extensive"),
    ("skin_map.plot(width='wide')", "width"),
    ("skin_map.plot(patches='palm')", "patches"),
    ("skin_map.plot(levels=1)", "levels"),
    ("skin_map.plot(range=3)", "range"),
    ("skin_map.plot(view=(1, 2, 3))", "view"),
    ("skin_map.to_skin(0, [[0, 0]])", "patch"),
    ("skin_map.to_skin('palm', [0, 0])", "uv"),
    ("skin_map.index(reactive='yes')", "reactive"),
    ("skin_map.with_regions(3)", "regions"),
    ("index.locate(points, level='1')", "level"),
    ("index.locate([1, 2, 3])", "points"),
    ("index.locate(points, link=3)", "link"),
    ("index.nearest(points, count='two')", "count"),
    ("index.within(points, radius='5mm')", "radius"),
    ("index.ray(points, points, longest='far')", "longest"),
    ("index.ray(points, [[0, 0, 0]])", "directions"),
    ("index.readings(points, [np.nan])", r"force\[0\]"),
    ("index.readings(points, [1.0], taxel_radius='2mm')", "taxel_radius"),
    ("index.posed([np.eye(4)])", "poses"),
    ("index.posed({3: np.eye(4)})", "poses"),
    ("draw(values[:5])", "values"),
    ("draw.pixels(points)", "hits"),
    ("draw.matrix('force')", "channel"),
    ("draw.video(np.zeros((3, 81)), 'a.gif', rate='fast')", "rate"),
    ("readings['force']", "frames"),
    ("readings[0.5]", "frames"),
    ("readings.on('map.glb')", "map"),
    ("readings.condition(skin_map, clip=3)", "clip"),
    ("readings.condition(skin_map, gain='double')", "gain"),
    ("readings.condition(skin_map, fill='zeros')", "fill"),
    ("readings.condition(skin_map, rate='fast')", "rate"),
    ("readings.condition(skin_map, split='5Hz')", "split"),
    ("readings.pooled(skin_map, 'L1')", "level"),
    ("readings.summary(skin_map, threshold='low')", "threshold"),
    ("readings.summary(skin_map, channel='heat')", "channel"),
    ("readings.select(3)", "channels"),
    ("readings.drop([99])", "ids"),
    ("readings.crop('1s')", "begin"),
    ("readings.resample('fast')", "rate"),
    ("readings.write(3)", "path"),
    ("d.Readings.from_arrays('a.npy')", "values"),
    ("d.Readings.from_arrays([[1, 2]], units=3)", "units"),
    ("d.Readings.from_arrays([[1, 2]], timestamps='now')", "timestamps"),
    ("d.Readings.open(3)", "path"),
    ("d.Readings.open('a.npy', episode='first')", "episode"),
    ("d.ContactTracker('map.glb')", "map"),
    ("d.ContactTracker(skin_map, threshold='low')", "threshold"),
    ("d.ContactTracker(skin_map, probe='elbow')", "probe"),
    ("d.EventDetector(skin_map, words='touch')", "words"),
    ("d.check(skin_map)", "source"),
    ("d.diff(3, 4)", "before"),
    ("d.calibrate(positions)", "observations"),
    ("d.simulate(taxels='many')", "taxels"),
    ("d.simulate(noise='low')", "noise"),
    ("d.touch(skin_map, presses='two')", "presses"),
    ("d.touch('skin.glb')", "skin"),
    ("d.flatten(positions, faces, angle='1')", "angle"),
    ("d.coarsen(positions, faces, levels='all')", "levels"),
    ("d.Robot.read(3)", "path"),
]


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    positions, faces = lattice(9, 9)
    skin = dermatome.Skin.from_arrays(positions, faces, patch="palm", link="hand")
    mesh_file = tmp_path_factory.mktemp("wrong") / "palm.obj"
    skin.write(mesh_file)
    skin_map, values = dermatome.build(skin), np.linspace(0, 1, 81)
    return {
        "d": dermatome, "np": np, "positions": positions, "faces": faces, "skin": skin, "mesh_file": mesh_file, "skin_map": skin_map,
        "values": values, "points": positions[:1], "index": skin_map.index(fields=True), "draw": skin_map.renderer(size=(8, 8)),
        "readings": dermatome.Readings.from_arrays(np.stack([values] * 9), channels="force", units="N", timestamps=np.arange(9) / 10),
    }  # fmt: skip


@pytest.mark.parametrize("call, argument", WRONG, ids=[call for call, _ in WRONG])
def test_wrong_calls_are_answered_by_name(call, argument, names):
    with pytest.raises(dermatome.DataError, match=rf"^{argument}(\[[^\]]*\])?: found .*; needed: ") as error:
        eval(call, names)
    assert error.value.kind

"""Sensors in MuJoCo, and skins of its models, against the real package."""

import numpy as np
import pytest
from conftest import dome, lattice

import dermatome

mujoco = pytest.importorskip("mujoco")
import dermatome.mujoco as adapter  # noqa: E402

SCENE = """
<mujoco><option gravity="0 0 0" timestep="0.001"/>
  <worldbody>
    <body name="hand"><geom name="bone" type="sphere" size="0.08"/></body>
    <body name="ball" pos="0 0 0.092"><freejoint/><geom name="ball" type="sphere" size="0.015" mass="0.01"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("level", [0, 1])
def test_mujoco(level):
    positions, faces = dome()
    map = dermatome.build(dermatome.Skin.from_arrays(positions - [*positions[:, :2].mean(axis=0), 0], faces, patch="dome", link="hand"))
    spec = mujoco.MjSpec.from_string(SCENE)
    name = adapter.attach(spec, map, level=level)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    felt = adapter.readings(data, name)
    of = map.patches["dome"].levels[level]
    assert felt.shape == (3, len(of.positions))
    depth = np.maximum(0.015 - np.linalg.norm(of.positions - [0, 0, 0.092], axis=1), 0)
    assert depth.max() > 1e-3
    assert np.allclose(felt[0], depth, atol=1e-6)
    with pytest.raises(dermatome.DataError, match="body"):
        adapter.attach(mujoco.MjSpec.from_string(SCENE), map, body="foot")


def hand_map():
    positions, faces = dome()
    middle = [*positions[:, :2].mean(axis=0), 0]
    return dermatome.build(dermatome.Skin.from_arrays(positions - middle, faces, patch="dome", link="hand"))


def test_a_refused_sensor_leaves_the_model_as_it_was():
    map, spec = hand_map(), mujoco.MjSpec.from_string(SCENE)
    name = adapter.attach(spec, map)
    before = spec.to_xml()
    small = dermatome.build(dermatome.Skin.from_arrays([[0, 0, 0], [0.005, 0, 0], [0, 0.005, 0]], link="hand", patch="three"))
    wrong = [
        (lambda: adapter.attach(spec, map), "name: found 'dome', which is a mesh"),
        (lambda: adapter.attach(spec, map, level=1), "name: found 'dome'"),
        (lambda: adapter.attach(spec, map, name="bone"), "name: found 'bone', which is a geom"),
        (lambda: adapter.attach_all(spec, map), "name: found 'dome'"),
        (lambda: adapter.attach(spec, map, name="new", body="foot"), "body: found 'foot'.*'hand'"),
        (lambda: adapter.attach_all(spec, map, bodies={"foot": "hand"}), "bodies: found 'foot'"),
        (lambda: adapter.attach_all(spec, map, bodies={"hand": "foot"}), "bodies: found 'foot'"),
        (lambda: adapter.attach(spec, small), "3 vertices of 'three'; needed: 4"),
    ]
    for call, match in wrong:
        with pytest.raises(dermatome.DataError, match=match):
            call()
    assert spec.to_xml() == before and len(spec.meshes) == 1
    data = mujoco.MjData(spec.compile())
    assert adapter.readings(data, name).shape == (3, 256)
    with pytest.raises(dermatome.DataError, match="sensor: found 'foot'"):
        adapter.readings(data, "foot")
    with pytest.raises(dermatome.DataError, match="found 256 vertices; needed"):
        adapter.readings(data, map, level=1)


def test_defaults_of_a_model_do_not_change_the_skin():
    defaults = '<default><mesh scale="0.001 0.001 0.001"/><geom pos="1 0 0" euler="90 0 0" contype="1"/></default><worldbody>'
    scene = SCENE.replace("<worldbody>", defaults).replace('name="bone"', 'name="bone" pos="0 0 0"').replace('name="ball" type', 'name="ball" pos="0 0 0" type')
    felt = []
    for text in (SCENE, scene):
        spec = mujoco.MjSpec.from_string(text)
        name = adapter.attach(spec, hand_map())
        data = mujoco.MjData(spec.compile())
        mujoco.mj_forward(data.model, data)
        felt.append(adapter.readings(data, name)[0])
    assert felt[0].max() > 1e-3 and np.allclose(felt[0], felt[1], atol=1e-9)


TWO = """
<mujoco><option gravity="0 0 0"/>
  <asset><mesh name="wedge" scale="2 1 1" vertex="0 0 0  .02 0 0  0 .04 0  0 0 .03" face="0 2 1  0 1 3  1 2 3  0 3 2"/></asset>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="palm" pos="0 0 .3" euler="30 0 0"><freejoint/>
      <geom name="plate" type="box" size=".03 .02 .01" pos=".1 0 0" euler="0 20 0"/>
      <geom name="shell" type="sphere" size=".05" contype="0" conaffinity="0"/>
      <body name="finger" pos="0 .2 0"><joint/>
        <geom name="wedge" type="mesh" mesh="wedge" euler="0 40 0" pos=".01 .02 .03"/>
        <geom name="tip" type="capsule" size=".01" fromto="0 0 .2 0 .05 .2"/>
        <geom name="egg" type="ellipsoid" size=".01 .02 .015" pos="0 .2 0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def test_a_skin_covers_the_geoms_of_a_model(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    (tmp_path / "two.xml").write_text(TWO)
    model = mujoco.MjModel.from_xml_string(TWO)
    skins = [adapter.skin(each, spacing=0.004) for each in (model, mujoco.MjSpec.from_string(TWO), tmp_path / "two.xml")]
    assert len({skin.to_bytes() for skin in skins}) == 1 and skins[0].links == ("world", "palm", "finger")
    map = dermatome.build(skins[0])
    assert [patch.link for patch in map.patches.values()] == ["palm", "finger", "finger", "finger"]
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for name, pose in map.index().poses.items():
        body = data.body(name)
        assert np.allclose(pose, np.block([[body.xmat.reshape(3, 3), body.xpos[:, None]], [np.zeros(3), 1]]), atol=1e-9)
    # Taxels lie on the geoms, as MuJoCo has them.
    plate, wedge = (patch.levels[0].positions for patch in list(map.patches.values())[:2])
    turned = np.zeros(9)
    mujoco.mju_quat2Mat(turned, model.geom("plate").quat)
    local = abs((plate - model.geom("plate").pos) @ turned.reshape(3, 3)) - [0.03, 0.02, 0.01]
    assert abs(local.max(axis=1)).max() < 1e-7
    mujoco.mju_quat2Mat(turned, model.geom("wedge").quat)
    mesh = trimesh.Trimesh(model.mesh_vert @ turned.reshape(3, 3).T + model.geom("wedge").pos, model.mesh_face)
    assert trimesh.proximity.ProximityQuery(mesh).on_surface(wedge)[1].max() < 1e-6
    assert adapter.skin(model, bodies=["palm"], spacing=0.004, visual=True).n_taxels > adapter.skin(model, bodies=["palm"], spacing=0.004).n_taxels
    with pytest.raises(dermatome.DataError, match="bodies: found 'foot'.*'palm'"):
        adapter.skin(model, bodies=["foot"], spacing=0.004)
    with pytest.raises(dermatome.DataError, match="none with a mesh or a primitive"):
        adapter.skin(model, bodies=["world"], spacing=0.004)
    with pytest.raises(dermatome.DataError, match="none.xml"):
        adapter.skin(tmp_path / "none.xml")


@pytest.mark.parametrize("level", [0, 1])
def test_sensors_of_all_patches_read_in_the_order_of_the_map(level):
    spec = mujoco.MjSpec.from_string(TWO)
    map = dermatome.build(adapter.skin(spec, spacing=0.004))
    sensors = adapter.attach_all(spec, map, level=level)
    assert list(sensors) == list(map.patches)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0, 0], pos=[0.1, 0, 0.3])
    data = mujoco.MjData(spec.compile())
    mujoco.mj_forward(data.model, data)
    felt = adapter.readings(data, map, level=level)
    assert felt.shape == (3, map.pool(np.zeros(map.n_taxels), level).shape[0]) and np.array_equal(felt, adapter.readings(data, sensors))
    first = 0
    for name in map.patches:
        own = adapter.readings(data, name)
        assert np.array_equal(felt[:, first : first + own.shape[1]], own)
        first += own.shape[1]
    assert first == felt.shape[1] and felt[0].max() > 1e-3
    if level == 0:
        assert map.renderer(0, pack=True, channels=3)(felt[None]).shape[:2] == (1, 3)

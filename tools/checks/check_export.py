"""Holds what `export` writes of a map against MuJoCo, OpenUSD and yourdfpy: exit 1 with a sentence if they differ.

    python check_export.py dermatome map.glb folder [robot.urdf]
"""
import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import yourdfpy
from pxr import Usd, UsdGeom

RADIUS, PRESS, SLIP = 0.015, 0.003, (0.2, 0.1)


def check_mujoco(path, table):
    """A sphere is pressed on each patch where it is outermost, and slides along tangent and binormal there."""
    worst_depth = worst_slip = 0.0
    model = mujoco.MjModel.from_xml_path(str(path))
    if model.nsensordata != 3 * len(table["positions"]):
        return f"{model.nsensordata} numbers of sensors for {len(table['positions'])} vertices"
    for k, name in enumerate(table["patches"]):
        of = table["patch_of"] == k
        points, normals, tangents = (table[key][of] for key in ("positions", "normals", "tangents"))
        spec = mujoco.MjSpec.from_string(
            f'<mujoco><option gravity="0 0 0"/><include file="{path.name}"/><worldbody><body name="a ball"><freejoint/>'
            f'<geom type="sphere" size="{RADIUS}" mass="0.01"/></body></worldbody></mujoco>',
            include={path.name: path.read_bytes()},
        )
        model = spec.compile()
        data = mujoco.MjData(model)
        geom = model.geom(str(name))
        mujoco.mj_kinematics(model, data)
        frame, at = data.xmat[geom.bodyid[0]].reshape(3, 3), data.xpos[geom.bodyid[0]]
        # The hull reaches the skin where that is outermost.
        outwards = normals.mean(axis=0)
        outermost = np.argmax(points @ (outwards if np.linalg.norm(outwards) > 0.1 else [0, 0, 1]))
        normal, tangent = normals[outermost], tangents[outermost]
        centre = points[outermost] + (RADIUS - PRESS) * normal
        velocity = SLIP[0] * tangent + SLIP[1] * np.cross(normal, tangent)
        data.qpos[:3], data.qvel[:3] = frame @ centre + at, frame @ velocity
        mujoco.mj_forward(model, data)
        felt = data.sensor(str(name)).data.reshape(3, -1)
        depth = np.maximum(RADIUS - np.linalg.norm(points - centre, axis=1), 0)
        worst_depth = max(worst_depth, abs(felt[0] - depth).max())
        touched = depth > 0
        across = np.cross(normals[touched], tangents[touched])
        slip = np.stack([tangents[touched] @ velocity, across @ velocity])
        worst_slip = max(worst_slip, abs(felt[1:, touched] - slip).max() / np.linalg.norm(velocity))
    print(f"MuJoCo: {len(table['patches'])} sensors; depth to {worst_depth:.1e} m, slip to {worst_slip:.1e}")
    return "depth or slip are others" if worst_depth > 1e-6 or worst_slip > 0.01 else None


def check_usd(path, table):
    stage = Usd.Stage.Open(str(path))
    if UsdGeom.GetStageMetersPerUnit(stage) != 1 or UsdGeom.GetStageUpAxis(stage) != "Z" or not stage.GetDefaultPrim():
        return "unit, axis or default prim are others"
    meshes = {prim.GetDisplayName(): UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)}
    for k, name in enumerate(table["patches"]):
        of, mesh = table["patch_of"] == k, meshes[str(name)]
        points = np.array(mesh.GetPointsAttr().Get())
        if points.shape != table["positions"][of].shape or abs(points - table["positions"][of]).max() > 1e-6:
            return f"{name}: the points are others"
        extent, indices = np.array(mesh.GetExtentAttr().Get()), np.array(mesh.GetFaceVertexIndicesAttr().Get())
        if not np.array_equal(extent, np.array(UsdGeom.Mesh.ComputeExtent(mesh.GetPointsAttr().Get()))):
            return f"{name}: the extent is another"
        valid, why = UsdGeom.Mesh.ValidateTopology(
            mesh.GetFaceVertexIndicesAttr().Get(), mesh.GetFaceVertexCountsAttr().Get(), len(points)
        )
        if not valid:
            return f"{name}: {why}"
        primvars = UsdGeom.PrimvarsAPI(mesh)
        st = primvars.GetPrimvar("st")
        if st.GetInterpolation() != "faceVarying" or mesh.GetNormalsInterpolation() != "vertex":
            return f"{name}: another interpolation"
        corners = np.array(st.ComputeFlattened())
        if corners.shape != (len(indices), 2) or corners.min() < 0 or corners.max() > 1:
            return f"{name}: st of {len(corners)} corners for {len(indices)}"
        a, b, c = corners.reshape(-1, 3, 2).transpose(1, 0, 2)
        if ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).min() <= 0:
            return f"{name}: the map is mirrored"
        if not np.array_equal(primvars.GetPrimvar("taxel_id").Get(), table["taxel_ids"][of]):
            return f"{name}: the ids are others"
        if not np.allclose(primvars.GetPrimvar("area").Get(), table["areas"][of], rtol=1e-6):
            return f"{name}: the areas are others"
    print(f"OpenUSD: {len(meshes)} meshes agree with the table")
    return None


def check_urdf(path, robot, table):
    before, after = (yourdfpy.URDF.load(str(file), load_meshes=False) for file in (robot, path))
    if set(before.link_map) != set(after.link_map) or set(before.joint_map) != set(after.joint_map):
        return "the robot is another"
    sensors = {sensor.get("name"): sensor for sensor in ET.parse(path).getroot().iter("sensor")}
    for k, name in enumerate(table["patches"]):
        of, sensor = table["patch_of"] == k, sensors[str(name)]
        if sensor.find("parent").get("link") != table["links"][k]:
            return f"{name}: on another link"
        taxels = sensor.findall("tactile/taxel")
        if [int(taxel.get("idx")) for taxel in taxels] != table["taxel_ids"][of].tolist():
            return f"{name}: the ids are others"
        for taxel, position, normal in zip(taxels, table["positions"][of], table["normals"][of]):
            roll, pitch, yaw = (float(x) for x in taxel.get("rpy").split())
            # The third column of Rz(yaw) Ry(pitch) Rx(roll).
            z = np.array([np.cos(roll) * np.sin(pitch), -np.sin(roll), np.cos(roll) * np.cos(pitch)])
            z = [np.cos(yaw) * z[0] - np.sin(yaw) * z[1], np.sin(yaw) * z[0] + np.cos(yaw) * z[1], z[2]]
            off = abs(np.array([float(x) for x in taxel.get("xyz").split()]) - position).max()
            if off > 1e-9 or abs(z - normal).max() > 1e-6:
                return f"{name}: taxel {taxel.get('idx')} is elsewhere"
    print(f"yourdfpy: {len(after.link_map)} links, {len(sensors)} sensors agree with the table")
    return None


def main(dermatome, glb, folder, robot=None):
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)

    def export(name, *more):
        subprocess.run([dermatome, "export", glb, "-o", folder / name, "--quiet", *more], check=True)
        return folder / name

    for level in (0, 1):
        at = ("--level", str(level))
        table = dict(np.load(export(f"L{level}.npz", *at)))
        rows = export(f"L{level}.csv", *at).read_text().splitlines()
        probes = json.loads(export(f"L{level}.json", *at).read_text())
        counts = sum(len(patch["probes"]["probe_local_pos"]) for patch in probes["patches"])
        if not len(rows) - 1 == counts == len(table["positions"]):
            return f"{len(rows) - 1} rows, {counts} probes, {len(table['positions'])} positions"
        wrong = check_mujoco(export(f"L{level}.xml", *at), table) or check_usd(export(f"L{level}.usda", *at), table)
        if wrong is None and robot:
            wrong = check_urdf(export(f"L{level}.urdf", *at, "--robot", robot), robot, table)
        if wrong:
            return f"level {level}: {wrong}"
    return None


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

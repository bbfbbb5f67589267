"""Compares the poses of the bodies of MJCF models with MuJoCo's: exit 1 with a sentence if they differ.

    python check_mjcf.py dermatome model.xml...      # without models: those of PyPI packages that are installed
"""
import importlib.util
import json
import pathlib
import subprocess
import sys

import mujoco
import numpy as np

PACKAGES = "mujoco gymnasium_robotics gymnasium dm_control robosuite".split()
MACROS = ("<replicate", "<attach", "<composite", "<flexcomp", "<plugin", "coordinate=\"global\"")


def packaged():
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        if spec is None:
            print(f"skipped: the models of {name}")
            continue
        for path in sorted(pathlib.Path(spec.submodule_search_locations[0]).rglob("*.xml")):
            text = path.read_text(errors="replace")
            if "<mujoco" in text and "<worldbody" in text and not any(macro in text for macro in MACROS):
                yield str(path)


def matrix(quaternion):
    w, x, y, z = np.roll(quaternion, 1)
    flat = np.zeros(9)
    mujoco.mju_quat2Mat(flat, np.array([w, x, y, z]))
    return flat.reshape(3, 3)


def compare(dermatome, path):
    """The largest difference, or None where MuJoCo does not read the model."""
    try:
        model = mujoco.MjModel.from_xml_path(path)
    except ValueError as error:
        print(f"skipped: {path}: {str(error).splitlines()[0]}")
        return None
    if model.nbody < 2:
        return None
    data = mujoco.MjData(model)
    worst = 0.0
    for seed in range(3):
        random = np.random.default_rng(seed)
        mujoco.mj_resetData(model, data)
        given = []
        for k in range(model.njnt):
            if int(model.jnt_type[k]) in (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)):
                name = model.joint(k).name
                value = random.uniform(-1, 1) if name and not set(name) & set("=,") else 0.0
                data.qpos[model.jnt_qposadr[k]] = value
                given += [f"{name}={float(value)!r}"] if value else []
        mujoco.mj_kinematics(model, data)
        command = [dermatome, "info", path, "--json", "--quiet", *(["--joints", ",".join(given)] if given else [])]
        run = subprocess.run(command, capture_output=True, text=True)
        if "a mesh of one of" in run.stderr:  # .msh
            print(f"skipped: {path}: no mesh of it is of a kind that is read")
            return None
        if run.returncode:
            raise SystemExit(f"{path}: {run.stderr}")
        links = {link["name"]: link for link in json.loads(run.stdout)["links"]}
        for body in range(1, model.nbody):
            name = model.body(body).name
            if not name or model.body_mocapid[body] >= 0:
                continue
            link = links[name]
            turn = data.xmat[body].reshape(3, 3) - matrix(link["rotation"])
            worst = max(worst, np.abs(data.xpos[body] - link["position"]).max(), np.abs(turn).max())
            if worst > 1e-9:
                raise SystemExit(f"{path}: body {name} is {worst} off with {given}")
    return worst


def main(dermatome, *paths):
    found = [compare(dermatome, path) for path in paths or packaged()]
    found = [worst for worst in found if worst is not None]
    if paths and len(found) < len(paths):
        raise SystemExit("MuJoCo does not read a model that was named")
    print(f"MuJoCo: bodies of {len(found)} models agree to {max(found, default=0.0):.1e}")


if __name__ == "__main__":
    main(*sys.argv[1:])

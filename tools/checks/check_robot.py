"""Compares the poses of a robot's links with yourdfpy's: exit 1 with a sentence if they differ.

    python check_robot.py dermatome robot.urdf
"""
import json
import subprocess
import sys

import numpy as np
import yourdfpy


def turned(quaternion):
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def main(dermatome, path):
    robot = yourdfpy.URDF.load(path, load_meshes=False, build_scene_graph=True, force_mesh=False)
    worst = 0.0
    for seed in range(3):
        values = np.random.default_rng(seed).uniform(-1.0, 1.0, len(robot.actuated_joint_names))
        robot.update_cfg(values)
        given = ",".join(f"{name}={float(value)!r}" for name, value in zip(robot.actuated_joint_names, values))
        command = [dermatome, "info", path, "--json", "--quiet", *(["--joints", given] if given else [])]
        info = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        if {link["name"] for link in info["links"]} != set(robot.link_map):
            return "the links are others"
        for link in info["links"]:
            expected = robot.get_transform(link["name"], info["links"][0]["name"])
            found = np.eye(4)
            found[:3, :3], found[:3, 3] = turned(link["rotation"]), link["position"]
            worst = max(worst, np.abs(found - expected).max())
            if worst > 1e-12:
                return f"link {link['name']} is {worst} off with {given}"
    print(f"yourdfpy: {len(robot.link_map)} links agree to {worst:.1e}")
    return None


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

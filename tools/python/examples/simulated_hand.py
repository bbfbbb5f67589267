"""A hand of MuJoCo with skin on its links: what its sensors feel, an image of all of it, and the forces of its contacts."""

import importlib
import sys
from typing import Any

import numpy as np

import dermatome
import dermatome.mujoco

mujoco: Any = importlib.import_module("mujoco")  # It has no types.


def main(file: str, bodies: list[str], spacing: float, steps: int) -> None:
    spec = mujoco.MjSpec.from_file(file)
    skin_map = dermatome.build(dermatome.mujoco.skin(spec, bodies=bodies, spacing=spacing))
    dermatome.mujoco.attach_all(spec, skin_map)
    model = spec.compile()
    data, index = mujoco.MjData(model), skin_map.index(fields=True)
    draw = skin_map.renderer(0, pack=True, channels=3, size=(120, 160), fill=0.0)
    deepest, felt, lost, number, six = 0.0, 0, 0, {name: k for k, name in enumerate(skin_map.links)}, np.zeros(6)
    for _ in range(steps):
        mujoco.mj_step(model, data)
        image = draw(dermatome.mujoco.readings(data, skin_map))  # (3, 120, 160): depth, and slip both ways
        deepest = max(deepest, float(image[0].max()))
        poses = {name: np.eye(4) for name in bodies}
        for name, pose in poses.items():
            pose[:3] = np.column_stack([data.body(name).xmat.reshape(3, 3), data.body(name).xpos])
        points, forces, links = [], [], []
        for k, contact in enumerate(data.contact):
            mujoco.mj_contactForce(model, data, k, six)
            touching = {model.body(model.geom_bodyid[geom]).name for geom in contact.geom}
            for name in touching & set(bodies):
                points.append(contact.pos.copy())
                forces.append(six[0])
                links.append(number[name])
        if points:
            newtons, is_felt = index.posed(poses).readings(points, forces, only_link=links)
            assert np.isclose(np.nansum(newtons), np.sum(np.array(forces)[is_felt]))
            felt, lost = felt + int(is_felt.sum()), lost + int((~is_felt).sum())
    print(f"{skin_map.n_taxels} taxels, deepest {1e3 * deepest:.2f} mm, {felt} contacts felt, {lost} lost")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2].split(","), float(sys.argv[3]), int(sys.argv[4]))

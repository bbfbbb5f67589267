"""Nanoseconds per closest-point query of fcpw (PyPI) on an OBJ mesh: the contacts of each file (f32 triples), as a batch. fcpw
uses all processors that the process may use: `taskset -c 0` for one.

    python fcpw_nearest.py MESH.obj CONTACTS.f32 ...
"""

import sys
import time

import fcpw
import numpy as np


def main(mesh, *files):
    rows = [line.split() for line in open(mesh)]
    vertices = np.array([row[1:4] for row in rows if row[:1] == ["v"]], dtype=np.float32, order="F")
    faces = np.array([row[1:4] for row in rows if row[:1] == ["f"]], dtype=np.int32, order="F") - 1
    scene = fcpw.scene_3D()
    scene.set_object_count(1)
    scene.set_object_vertices(vertices, 0)
    scene.set_object_triangles(np.asfortranarray(faces), 0)
    scene.build(fcpw.aggregate_type.bvh_surface_area, True)
    for file in files:
        points = np.asfortranarray(np.fromfile(file, dtype="<f4").reshape(-1, 3))
        radii = np.full(len(points), np.inf, dtype=np.float32)
        best = np.inf
        for _ in range(9):
            interactions = fcpw.interaction_3D_list()
            start = time.perf_counter()
            scene.find_closest_points(points, radii, interactions)
            best = min(best, time.perf_counter() - start)
        print(f"{best * 1e9 / len(points):.0f}", end=" ")
    print()


if __name__ == "__main__":
    main(*sys.argv[1:])

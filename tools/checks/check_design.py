"""Recomputes a design of triangles from its files alone: exit 1 with a sentence if a promise is broken.

    python check_design.py dermatome surface.obj side_mm tolerance_mm radius_mm chain

Area-uniform points of the surface are unbent into each module: how many lie under one module and under two. Outlines are
measured against all triangles near them; sides, curvature, wires and chains are those that were asked for.
"""
import csv
import json
import math
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from scipy.spatial import cKDTree

GAP = 5e-4  # between modules, m


def read_obj(path):
    lines = [line.split() for line in open(path)]
    points = np.array([[float(x) for x in words[1:4]] for words in lines if words[:1] == ["v"]])
    faces = [[int(word.split("/")[0]) - 1 for word in words[1:4]] for words in lines if words[:1] == ["f"]]
    return points[np.array(faces)]


def matrix(q):
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


class Plate:
    """A row of modules.csv."""

    def __init__(self, row):
        number = lambda *names: np.array([float(row[name]) for name in names])
        self.origin, self.turn = number("x", "y", "z"), matrix(number("qx", "qy", "qz", "qw"))
        self.curvature, direction = number("curvature", "direction")
        self.along = np.array([math.cos(direction), math.sin(direction)])
        self.across = np.array([-self.along[1], self.along[0]])

    def bend(self, at):
        """Points of the drawing in space."""
        u, v, k = at @ self.along, at @ self.across, self.curvature or 1e-9
        flat = np.outer(np.sin(k * u) / k, self.along) + np.outer(v, self.across)
        return self.origin + np.c_[flat, (np.cos(k * u) - 1) / k] @ self.turn.T

    def unbend(self, points):
        """Points in space, in the drawing, and their heights over the plate."""
        local = (points - self.origin) @ self.turn
        u, v, k = local[:, :2] @ self.along, local[:, :2] @ self.across, self.curvature or 1e-9
        side, radius = np.sign(k), 1 / k
        height = side * np.hypot(u, radius + local[:, 2]) - radius
        u = np.arctan2(side * u, side * (radius + local[:, 2])) * radius
        return np.outer(u, self.along) + np.outer(v, self.across), height


def distances(points, triangles):
    """Of points to triangles."""
    a, b, c = (triangles[None, :, k] for k in range(3))
    p = points[:, None]
    best = np.full((len(points), len(triangles)), np.inf)
    for s, t in ((a, b), (b, c), (c, a)):
        d = t - s
        part = np.clip(((p - s) * d).sum(-1) / np.maximum((d * d).sum(-1), 1e-300), 0, 1)
        best = np.minimum(best, np.linalg.norm(p - s - part[..., None] * d, axis=-1))
    normal = np.cross(b - a, c - a)
    height = ((p - a) * normal).sum(-1) / np.maximum(np.linalg.norm(normal, axis=-1), 1e-300)
    inside = np.ones_like(best, bool)
    for s, t in ((a, b), (b, c), (c, a)):
        inside &= (np.cross(t - s, p - s) * normal).sum(-1) >= 0
    return np.where(inside, np.abs(height), best).min(1, initial=np.inf)


def faults(triangles, folder, side, tolerance, radius, chain):
    report = json.loads((folder / "design.json").read_text())["patches"][0]
    modules = list(csv.DictReader(open(folder / "modules.csv")))
    plates = {row["module"]: Plate(row) for row in modules}
    corners = side * np.array([[0, -1 / math.sqrt(3)], [0.5, 0.5 / math.sqrt(3)], [-0.5, 0.5 / math.sqrt(3)]])
    step = np.linspace(0, 1, 41)[:-1, None]
    outline = np.concatenate([corners[k] + (corners[(k + 1) % 3] - corners[k]) * step for k in range(3)])

    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    random = np.random.default_rng(1)
    face = random.choice(len(area), 100_000, p=area / area.sum())
    weights = np.sort(random.random((len(face), 2)), axis=1)
    weights = np.diff(weights, prepend=0, append=1, axis=1)
    points = (triangles[face] * weights[..., None]).sum(1)
    tree, count, reach = cKDTree(points), np.zeros(len(points), int), 2 * tolerance + 1e-3
    low, high = triangles.min(1), triangles.max(1)
    gap = 0.0
    for plate in plates.values():
        near = np.array(tree.query_ball_point(plate.origin, side), int)
        at, height = plate.unbend(points[near])
        inside = np.abs(height) < reach
        # The other side of a thin wall is not under the module.
        inside &= (cross[face[near]] @ plate.turn[:, 2]) > 0
        for k in range(3):
            edge = corners[(k + 1) % 3] - corners[k]
            inside &= edge[0] * (at[:, 1] - corners[k, 1]) - edge[1] * (at[:, 0] - corners[k, 0]) >= 0
        count[near[inside]] += 1
        rim = plate.bend(outline)
        back, _ = plate.unbend(rim)
        if np.abs(back - outline).max() > 1e-6:
            yield f"a side is {np.abs(back - outline).max()} m from the drawing"
        far = 2 * tolerance
        close = (low < rim.max(0) + far).all(1) & (high > rim.min(0) - far).all(1)
        gap = max(gap, distances(rim, triangles[close]).max())
    covered, twice = (count > 0).mean(), (count > 1).mean()
    print(
        f"{len(plates)} modules, covered {covered:.3f} (says {report['covered']:.3f}), twice {twice:.5f}, gap {1e3 * gap:.3f} mm,"
        f" chains {report['chains']} of at least {report['least_chains']}, pieces {report['pieces']}"
    )
    if abs(covered - report["covered"]) > 0.01:
        yield f"{covered:.3f} of the area is covered, not {report['covered']:.3f}"
    if twice > 1e-3:
        yield f"{twice} of the area is under two modules"
    if gap > 1.05 * tolerance:
        yield f"an outline is {1e3 * gap:.3f} mm from the surface"
    if max(abs(plate.curvature) for plate in plates.values()) > 1 / radius + 1e-9:
        yield "a module is bent too much"

    wires, seen = list(csv.DictReader(open(folder / "chains.csv"))), set()
    for wire in wires:
        own = wire["module"]
        if own in seen:
            yield f"module {own} is wired twice"
        seen.add(own)
        if int(wire["place"]) > chain:
            yield f"chain {wire['chain']} is longer than {chain}"
        if wire["from_module"]:
            ends = []
            for name, port in ((wire["from_module"], wire["from_port"]), (own, wire["to_port"])):
                k = int(port) - 1
                ends.append(plates[name].bend(corners[[k, (k + 1) % 3]]))
            if np.linalg.norm(ends[0] - ends[1][::-1], axis=1).max() > 2.2e-3 + GAP:
                yield f"modules {wire['from_module']} and {own} share no edge"
    if seen != set(plates):
        yield "a module is not wired"


def main(dermatome, surface, side, tolerance, radius, chain):
    with tempfile.TemporaryDirectory() as folder:
        flags = ["--module", f"triangle:{side}mm", "--tolerance", f"{tolerance}mm", "--bend-radius", f"{radius}mm"]
        command = [dermatome, "design", surface, "-o", folder, *flags, "--chain", chain, "--quiet"]
        subprocess.run(command, check=True)
        numbers = [1e-3 * float(x) for x in (side, tolerance, radius)]
        found = list(faults(read_obj(surface), pathlib.Path(folder), *numbers, int(chain)))
    return "; ".join(found) or None


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

"""What each step of `flatten` earns: maps the shapes below with the command as it is and with variants of it.

usage: ablate.py DIR COMMAND NAME=COMMAND... [--files MESH...]

Each variant is a command built with one step left out or one constant changed. A row of the table says on how many
shapes it changes the symmetric Dirichlet energy or the time by more than 5 %, and where flips, overlaps, convergence
or the number of levels differ. DIR takes the shapes and the maps. The time is that of `flatten` in `timings.json`.
"""
import json, os, subprocess, sys
import numpy as np
import shapes


def grid(columns, rows, at, closed=False):
    """A grid of triangles at the points `at(u, v)`; `closed`: the last column is the first."""
    u, v = np.meshgrid(np.arange(columns) / (columns if closed else columns - 1), np.arange(rows) / (rows - 1))
    i, j = np.meshgrid(np.arange(columns if closed else columns - 1), np.arange(rows - 1))
    a, b = (i + columns * j).ravel(), ((i + 1) % columns + columns * j).ravel()
    faces = np.concatenate([np.column_stack([a, b, b + columns]), np.column_stack([a, b + columns, a + columns])])
    return np.stack(at(u.ravel(), v.ravel()), 1), faces


def body(triangles, spikes, holes, seed):
    """A ball with horns, and round openings: as far from a disk as an animal."""
    from scipy.spatial import ConvexHull
    rng = np.random.default_rng(seed)
    k = np.arange(triangles // 2 + 2) + 0.5
    z, t = 1 - 2 * k / len(k), np.pi * (1 + 5**0.5) * k
    points = np.column_stack([np.sqrt(1 - z * z) * np.cos(t), np.sqrt(1 - z * z) * np.sin(t), z])
    faces = ConvexHull(points).simplices
    a, b, c = points[faces].transpose(1, 0, 2)
    wrong = (np.cross(b - a, c - a) * a).sum(1) < 0
    faces[wrong] = faces[wrong][:, ::-1]
    directions = rng.normal(size=(spikes + holes, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    radius = 1 + (1.5 * np.exp(-np.arccos(np.clip(points @ directions[:spikes].T, -1, 1)) / 0.15)).sum(1)
    middle = points[faces].mean(1)
    faces = faces[(middle / np.linalg.norm(middle, axis=1)[:, None] @ directions[spikes:].T < np.cos(0.2)).all(1)]
    return shapes.compact(0.05 * radius[:, None] * points, faces)


def needles(vertices, faces, share, seed):
    """Splits a share of the faces at a point next to one of their sides: needles of a ten-thousandth."""
    rng = np.random.default_rng(seed)
    chosen = rng.random(len(faces)) < share
    a, b, c = faces[chosen].T
    new = len(vertices) + np.arange(len(a))
    at = (vertices[a] + vertices[b]) / 2 * (1 - 1e-4) + 1e-4 * vertices[c]
    split = [np.column_stack(t) for t in ((a, b, new), (b, c, new), (c, a, new))]
    return np.concatenate([vertices, at]), np.concatenate([faces[~chosen], *split])


def tube(columns, rows, radius, length, taper=0.0):
    def at(u, v):
        r = radius * (1 - taper * v)
        return r * np.cos(2 * np.pi * u), r * np.sin(2 * np.pi * u), length * v
    return grid(columns, rows, at, closed=True)


def ramp(columns, rows, turns):
    """A strip that winds over itself on a flat map."""
    def at(u, v):
        t = 2 * np.pi * turns * u
        return (0.03 + 0.02 * v) * np.cos(t), (0.03 + 0.02 * v) * np.sin(t), 0.02 * turns * u
    return grid(columns, rows, at)


def all_shapes():
    yield "cap", shapes.cap(3000), ["none"]
    yield "cap-large", shapes.cap(40000), ["none"]
    yield "dense-large", shapes.dense(30000), ["none"]
    yield "dense", shapes.dense(3000), ["none"]
    yield "forearm", shapes.forearm(4000), ["none"]
    yield "saddle", shapes.saddle(3000), ["none"]
    yield "tube", tube(12, 40, 0.02, 0.3), ["none", "auto"]
    yield "tube-thin", tube(6, 40, 0.02, 0.5), ["none"]
    yield "cuff", tube(40, 30, 0.05, 0.1, 0.5), ["none"]
    yield "ramp", ramp(120, 9, 2.5), ["none"]
    yield "ramp-short", ramp(60, 9, 1.3), ["none"]
    for seed in range(3):
        yield f"body-{seed}", body(3000, 6, 0, seed), ["auto"]
        yield f"body-open-{seed}", body(2400, 3, 4, seed), ["none", "auto"]
    yield "needles-cap", needles(*shapes.cap(2000), 0.1, 1), ["none"]
    yield "needles-body", needles(*body(2400, 6, 0, 4), 0.1, 2), ["auto"]
    yield "needles-tubes", needles(*body(2000, 3, 3, 5), 0.05, 3), ["none"]


def run(command, mesh, cut, energy, out, env):
    done = subprocess.run([command, "build", mesh, "-o", out, "--cut", cut, "--energy", energy, "--quiet"],
                          capture_output=True, text=True, env=env)
    if done.returncode:
        return None
    levels = [x for p in json.load(open(f"{out}/report.json"))["patches"] for x in p["levels"]]
    seconds = json.load(open(f"{out}/timings.json"))["seconds"]
    worst = max(x["symmetric_dirichlet"] or np.inf for x in levels)
    flaws = [sum(x["flips"] for x in levels), sum(x["crossings"] for x in levels),
             sum(not x["converged"] for x in levels), len(levels)]
    return worst, flaws, seconds["flatten"] + seconds["coarsen"]


def main():
    arguments = sys.argv[1:]
    files = []
    if "--files" in arguments:
        k = arguments.index("--files")
        arguments, files = arguments[:k], arguments[k + 1:]
    out, base, *variants = arguments
    os.makedirs(out, exist_ok=True)
    jobs = [(os.path.basename(f), f, ["auto"]) for f in files]
    for name, (vertices, faces), cuts in all_shapes():
        shapes.write_obj(f"{out}/{name}.obj", vertices, faces)
        jobs.append((name, f"{out}/{name}.obj", cuts))
    jobs = [(f"{n} {c} {e[:3]}", f, c, e) for n, f, cuts in jobs for c in cuts for e in ("sum",)]

    def measured(command, name=""):
        env = {**os.environ, "ABLATE": name}
        return {job: min((run(command, f, c, e, f"{out}/map", env) for _ in range(1 if name else 2)),
                         key=lambda r: r[2] if r else 0) for job, f, c, e in jobs}

    first = measured(base)
    for job, r in first.items():
        print(job, r, flush=True)
    for variant in variants:
        name, _, command = variant.partition("=")
        worse, better, flaws = [], [], []
        found = measured(command or base, name)
        for job, new in found.items():
            old = first[job]
            if not (new and old):
                flaws += [f"{job}: {'no map' if old else 'a map'}"] if (new is None) != (old is None) else []
                continue
            change = new[0] / old[0] - 1
            (worse if change > 0 else better).extend([f"{job} {100 * change:+.1f}%"] if abs(change) > 0.003 else [])
            flaws += [f"{job}: {old[1]}->{new[1]}"] if new[1] != old[1] else []
        time = [sum(r[j][2] for j in first if r[j] and first[j]) for r in (first, found)]
        slow = [f"{j} x{found[j][2] / first[j][2]:.2f}" for j in first if found[j] and first[j]
                and abs(found[j][2] - first[j][2]) > max(0.05, 0.15 * first[j][2])]
        print(f"{name:16} time {time[1] / time[0]:.2f} | worse {worse} | better {better} | flaws {flaws} | slow {slow}",
              flush=True)


if __name__ == "__main__":
    main()

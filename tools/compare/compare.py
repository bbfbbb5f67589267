#!/usr/bin/env python3
"""Measures dermatome beside its peers, in turn in one run, and prints the tables of BENCHMARKS.md.

    cargo build --release
    python3 -m venv .checks/peers
    .checks/peers/bin/pip install numpy scipy libigl fast-simplification gtsam OpenEXR fcpw
    .checks/peers/bin/python tools/compare/compare.py [flatten] [coarsen] [nearest] [coarse] [graphs] [skins] [build] [images] [frames]
    .checks/peers/bin/python tools/compare/compare.py versions=OLD_BINARY [1000 100000]

Without words it measures everything. dermatome is timed as a whole process that reads and writes files; peers are timed
without file access. `nearest` needs Debian's libembree-dev and g++, and reads one cover of DERMATOME_DATA/cyskin; sizes
after it (`nearest 20000 100000`) leave out the others, and `rounds=9` takes medians of nine rounds instead of three, which a
busy machine needs. `coarse` runs the bench `coarse_to_fine` and the same peers on its contacts. `graphs` reads the pose graphs
sphere2500.g2o, parking-garage.g2o and smallGrid3D.g2o from the folder DERMATOME_DATA/g2o, and is skipped without it. `versions` times `build` by another binary of
dermatome and by this one, in turn, on open and closed surfaces; it needs numpy and scipy alone.
"""
import json, os, re, statistics, subprocess, sys, tempfile, time
from pathlib import Path

import numpy as np

from shapes import SHAPES, write_obj

ROOT = Path(__file__).resolve().parents[2]
DERMATOME = os.environ.get("DERMATOME", str(ROOT / "target/release/dermatome"))
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
# Without DERMATOME_DATA, a folder without files: what needs them is skipped.
DATA = Path(os.environ.get("DERMATOME_DATA", "/nowhere"))
FOLDER = Path(tempfile.mkdtemp())
RUNS = 5


# Runs a command from a small process: a child's peak memory counts what it was forked from.
LAUNCHER = """
import os, sys, time
start = time.perf_counter()
pid = os.posix_spawnp(sys.argv[1], sys.argv[1:], os.environ)
_, status, usage = os.wait4(pid, 0)
wall = time.perf_counter() - start
print(wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, file=sys.stderr)
sys.exit(os.waitstatus_to_exitcode(status))
"""


def ours(*args, binary=DERMATOME):
    """One run of the command: (wall seconds, processor seconds, peak memory in MB, what it printed as JSON)."""
    command = [sys.executable, "-S", "-c", LAUNCHER, binary, *map(str, args)]
    out = subprocess.PIPE if "--json" in args else subprocess.DEVNULL
    done = subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(f"{args} failed: {done.stderr}")
    wall, processor, memory = map(float, done.stderr.splitlines()[-1].split())
    return wall, processor, memory, json.loads(done.stdout) if "--json" in args else None


def timed(call):
    start = time.perf_counter()
    result = call()
    return time.perf_counter() - start, result


def median(numbers):
    return statistics.median(numbers)


def row(*cells):
    print("| " + " | ".join(cells) + " |", flush=True)


def symmetric_dirichlet(vertices, faces, uv):
    """Mean over the area of s1^2 + s2^2 + 1/s1^2 + 1/s2^2 after the best scale; 4 is an isometry."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    ab, ac = b - a, c - a
    x = np.linalg.norm(ab, axis=1)
    p = np.einsum("ij,ij->i", ab, ac) / x
    q = np.linalg.norm(np.cross(ab, ac), axis=1) / x
    d1, d2 = uv[faces[:, 1]] - uv[faces[:, 0]], uv[faces[:, 2]] - uv[faces[:, 0]]
    column1 = d1 / x[:, None]
    column2 = (d2 - d1 * (p / x)[:, None]) / q[:, None]
    squares = (column1**2).sum(1) + (column2**2).sum(1)
    det = column1[:, 0] * column2[:, 1] - column1[:, 1] * column2[:, 0]
    area = x * q / 2
    grow, shrink = (area * squares).sum(), (area * squares / det**2).sum()
    flips = min((det < 0).sum(), (det > 0).sum())
    return 2 * np.sqrt(grow * shrink) / area.sum(), flips


def slim(vertices, faces):
    import igl
    boundary = igl.boundary_loop(faces)
    start = igl.harmonic(vertices, faces, boundary, igl.map_vertices_to_circle(vertices, boundary), 1)
    energy = getattr(igl, "SYMMETRIC_DIRICHLET", None)
    energy = energy if energy is not None else igl.pyigl_core.MappingEnergyType.SYMMETRIC_DIRICHLET
    data = igl.slim_precompute(np.asfortranarray(vertices), np.asfortranarray(faces.astype(np.int32)),
                               np.asfortranarray(start[:, :2]), energy, np.zeros(0, np.int32), np.zeros((0, 2), order="F"), 0.0)
    return np.array(igl.slim_solve(data, 20))[:, :2]


def lscm(vertices, faces):
    import igl
    boundary = igl.boundary_loop(faces)
    i = boundary[np.argmax(((vertices[boundary] - vertices[boundary].mean(0)) ** 2).sum(1))]
    j = boundary[np.argmax(((vertices[boundary] - vertices[i]) ** 2).sum(1))]
    return igl.lscm(vertices, faces, np.array([i, j], np.int64), np.array([[0.0, 0], [1, 0]]))[0]


def flatten():
    print("\n`dermatome flatten SHAPE.obj -o OUT.npz --energy symmetric-dirichlet | --method conformal`, whole process;"
          " libigl SLIM with 20 iterations and LSCM, solve alone\n")
    row("shape, triangles", "method", "dermatome s", "memory MB", "symmetric Dirichlet", "peer s", "its energy (flips)")
    row(*["---"] * 7)
    for name, size in [(name, 10_000) for name in ["cap", "forearm", "saddle", "dense"]] + [("cap", 100_000)]:
        vertices, faces = SHAPES[name](size)
        file = FOLDER / f"{name}{size}.obj"
        write_obj(file, vertices, faces)
        for method, peer, call, options in [
            ("symmetric Dirichlet", "SLIM", slim, ["--energy", "symmetric-dirichlet"]),
            ("conformal", "LSCM", lscm, ["--method", "conformal"]),
        ]:
            slow = size > 10_000 and call is slim
            own, other, energy = [], [], "not run"
            for _ in range(RUNS):
                own.append(ours("flatten", file, "-o", FOLDER / "flat.npz", "--json", *options))
                if not slow and len(other) < (2 if call is slim else RUNS):
                    seconds, uv = timed(lambda: call(vertices, faces))
                    other.append(seconds)
                    value, flips = symmetric_dirichlet(vertices, faces, uv)
                    energy = f"{value:.5f} ({flips})"
            row(f"{name}, {len(faces)}", method, f"{median([o[0] for o in own]):.3f}", f"{own[0][2]:.0f}",
                f"{own[0][3]['symmetric_dirichlet']:.5f} ({own[0][3]['flips']})",
                f"{peer} {median(other):.3f}" if other else f"{peer} not run", energy)


def coarsen():
    import fast_simplification
    print("\n`dermatome build cap.obj --levels 1 --json`, stage `coarsen`; fast-simplification to 25 %\n")
    row("triangles", "dermatome s", "left", "fast-simplification s")
    row(*["---"] * 4)
    vertices, faces = SHAPES["cap"](100_000)
    write_obj(FOLDER / "cap.obj", vertices, faces)
    own, other = [], []
    for _ in range(RUNS):
        printed = ours("build", FOLDER / "cap.obj", "-o", FOLDER / "cap", "--levels", "1", "--json")[3]
        own.append(json.loads((FOLDER / "cap" / "timings.json").read_text())["seconds"]["coarsen"])
        other.append(timed(lambda: fast_simplification.simplify(vertices.astype(np.float32), faces.astype(np.int32), 0.75))[0])
    left = printed["patches"][0]["levels"][1]["faces"] / len(faces)
    row(str(len(faces)), f"{median(own):.3f}", f"{left:.0%}", f"{median(other):.3f}")


def refined(vertices, faces):
    """Every triangle in four, at the middles of its sides."""
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    sides, number = np.unique(sides, axis=0, return_inverse=True)
    x, y, z = number.reshape(3, -1) + len(vertices)
    a, b, c = faces.T
    middles = vertices[sides].mean(1)
    return np.concatenate([vertices, middles]), np.concatenate([np.stack(t, 1) for t in [(a, x, z), (x, b, y), (z, y, c), (x, y, z)]])


def cover(times):
    """A cover of 642 taxels, refined; None without its file."""
    file = DATA / "cyskin/ur10e_link1_patch1_isomap.json"
    if not file.exists():
        return None
    subprocess.run([DERMATOME, "convert", file, FOLDER / "cover.obj"], check=True, capture_output=True)
    lines = [line.split() for line in (FOLDER / "cover.obj").read_text().splitlines()]
    mesh = (np.array([list(map(float, w[1:4])) for w in lines if w and w[0] == "v"]),
            np.array([[int(x.split("/")[0]) - 1 for x in w[1:4]] for w in lines if w and w[0] == "f"]))
    for _ in range(times):
        mesh = refined(*mesh)
    return mesh


MESH = FOLDER / "mesh.obj"

ROUNDS = next((int(word.removeprefix("rounds=")) for word in sys.argv if word.startswith("rounds=")), 3)


def build_peers():
    """Builds the engines that find nearest points; returns what runs one of them on MESH and the contacts beside it."""
    program = FOLDER / "embree_nearest"
    subprocess.run(["g++", "-O3", ROOT / "tools/compare/embree_nearest.cpp", "-lembree3", "-o", program], check=True)
    subprocess.run(["cargo", "build", "--release", "--quiet"], cwd=ROOT / "tools/contact-peers", check=True)
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "tools/contact-peers/target"))
    peers = target / "release/contact-peers"

    def peer(engine):
        command = [peers, engine, MESH, FOLDER]
        if engine == "embree":
            command = [program, MESH, FOLDER / "scattered.f32", FOLDER / "path.f32"]
        if engine == "fcpw":
            script = ROOT / "tools/compare/fcpw_nearest.py"
            command = ["taskset", "-c", "0", sys.executable, script, MESH, FOLDER / "scattered.f32", FOLDER / "path.f32"]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()

    return peer


def in_turn(run, engines):
    """Medians of the columns that `run` gives for each engine, of ROUNDS rounds through all."""
    runs = {engine: [] for engine in engines}
    for _ in range(ROUNDS):
        for engine, outputs in runs.items():
            outputs.append(run(engine))
    number = lambda text: float("nan") if text == "-" else float(text)
    return {engine: [median(column) for column in zip(*[map(number, out) for out in outputs])] for engine, outputs in runs.items()}


def sizes_asked():
    return [int(word) for word in sys.argv[2:] if word.isdigit()]


def coarse():
    peer, rows = build_peers(), []
    for skin in ["cap", "forearm", "robot"]:
        for size in sizes_asked() or [10_000, 100_000, 1_000_000]:
            # Writes the mesh and the contacts that the engines answer.
            bench = ["cargo", "bench", "--quiet", "--bench", "coarse_to_fine", "--", skin, str(size), f"peers={FOLDER}"]
            table = subprocess.run(bench, cwd=ROOT, check=True, capture_output=True, text=True).stdout
            print(table, flush=True)
            ns = in_turn(peer, ["dermatome", "embree", "fcpw", "parry", "obvhs"])
            own, other = ns["dermatome"], ns["embree"]
            cell = lambda engine: f"{ns[engine][0]:.0f} ({ns[engine][1]:.0f})"
            title = re.search(r"(\w+, \d+) triangles", table).group(1)
            rows.append([title, cell("dermatome"), cell("embree"), f"{own[0] / other[0]:.2f} ({own[1] / other[1]:.2f})", cell("fcpw"), cell("parry"), cell("obvhs")])
    print(f"\nns of the same contacts on level 0, one thread, all patches as one mesh, medians of {ROUNDS} rounds in turn; along a path in brackets\n")
    row("skin, triangles", "dermatome", "Embree", "share", "fcpw", "parry3d", "obvhs, scalar")
    row(*["---"] * 7)
    for cells in rows:
        row(*cells)


def nearest():
    peer = build_peers()
    wanted = sizes_asked() or [20_000, 100_000, 1_000_000]
    shapes = [(f"{name}", lambda name=name, size=size: SHAPES[name](size)) for size in wanted for name in ["cap", "saddle"]]
    shapes += [("cover refined twice", lambda: cover(2))] * (20_000 in wanted) + [("cover refined 5 times", lambda: cover(5))] * (1_000_000 in wanted)
    print(f"\nns per contact 0 to 3 mm off the skin, one thread, engines in turn, medians of {ROUNDS} rounds: `tools/contact-peers`,"
          " `tools/compare/embree_nearest.cpp` (g++ -O3, Embree of Debian), `tools/compare/fcpw_nearest.py` (a batch on one thread); along a path in brackets; then a batch of 1M contacts in no order on all threads\n")
    row("mesh, triangles", "dermatome", "Embree", "share", "fcpw", "parry3d", "obvhs, scalar", "batch", "Embree one by one / batch")
    row(*["---"] * 9)
    for name, make in shapes:
        mesh = make()
        if mesh is None:
            row(name, *["skipped: no file"] * 8)
            continue
        write_obj(MESH, *mesh)
        peer("contacts")
        ns = in_turn(peer, ["dermatome", "embree", "fcpw", "parry", "obvhs"])
        cell = lambda engine: f"{ns[engine][0]:.0f} ({ns[engine][1]:.0f})"
        own, other = ns["dermatome"], ns["embree"]
        row(f"{name}, {len(mesh[1])}", cell("dermatome"), cell("embree"), f"{own[0] / other[0]:.2f} ({own[1] / other[1]:.2f})", cell("fcpw"), cell("parry"),
            cell("obvhs"), f"{own[2]:.0f}", f"{other[0] / own[2]:.1f}")
    print("\nns for the eight taxels nearest to a contact, with their distances in f64: dermatome `nearest_fields`, kiddo `ImmutableKdTree<f64, 3>`\n")
    row("taxels on a cap", "dermatome", "kiddo", "share")
    row(*["---"] * 4)
    for taxels in [10_000, 100_000]:
        write_obj(MESH, *SHAPES["cap"](2 * taxels))
        peer("contacts")
        found = in_turn(peer, ["dermatome8", "kiddo"])
        own, other = found["dermatome8"], found["kiddo"]
        assert abs(own[1] - other[1]) < 1e-6 * other[1], "both find the same"
        row(str(taxels), f"{own[0]:.0f}", f"{other[0]:.0f}", f"{own[0] / other[0]:.2f}")


def gtsam_seconds(path):
    import gtsam
    graph, initial = gtsam.readG2o(str(path), True)
    graph.add(gtsam.PriorFactorPose3(min(initial.keys()), gtsam.Pose3(), gtsam.noiseModel.Diagonal.Variances(np.full(6, 1e-6))))

    def solve():
        start = gtsam.InitializePose3.initialize(graph)
        return gtsam.GaussNewtonOptimizer(graph, start).optimize()

    seconds, poses = timed(solve)
    return seconds, graph.error(poses)


def graphs():
    print("\n`dermatome calibrate X.g2o -o OUT.csv --residual log --json` with and without `--no-covariance`, seconds of start and solve"
          " (and covariance) that it prints; GTSAM, chordal start and Gauss-Newton, no marginals\n")
    row("pose graph", "dermatome s", "with all covariances s", "cost", "GTSAM s", "its cost")
    row(*["---"] * 6)
    for name in ["sphere2500", "parking-garage", "smallGrid3D"]:
        file = DATA / "g2o" / f"{name}.g2o"
        if not file.exists():
            row(name, *["skipped: no file"] * 5)
            continue
        own, whole, other = [], [], []
        for _ in range(2 * RUNS + 1):
            printed = ours("calibrate", file, "-o", FOLDER / "skin.csv", "--residual", "log", "--no-covariance", "--json")[3]
            own.append(printed["seconds"])
            whole.append(ours("calibrate", file, "-o", FOLDER / "skin.csv", "--residual", "log", "--json")[3]["seconds"])
            other.append(gtsam_seconds(file))
        row(name, f"{median(own):.3f}", f"{median(whole):.3f}", f"{printed['cost']:.7f}",
            f"{median([o[0] for o in other]):.3f}", f"{other[0][1]:.7f}")


def skins():
    print("\n`dermatome simulate --taxels N --model M --spacing-mm S --noise-mm S/5 -o X.g2o`, `dermatome calibrate X.g2o -o OUT.csv --json`: start, solve and all covariances\n")
    row("simulated skin", "seconds")
    row("---", "---")
    for model, taxels in [("positions", 500), ("poses", 500), ("positions", 20_000), ("positions", 200_000)]:
        file = FOLDER / "skin.g2o"
        spacing = 5 * (500 / taxels) ** 0.5
        ours("simulate", "-o", file, "--model", model, "--taxels", taxels, "--spacing-mm", spacing, "--noise-mm", spacing / 5)
        seconds = [ours("calibrate", file, "-o", FOLDER / "skin.csv", "--json")[3]["seconds"] for _ in range(RUNS)]
        row(f"{taxels} {model}", f"{median(seconds):.4f}")


def build():
    print("\n`dermatome build SKIN -o OUT`, whole process with images of all levels\n")
    row("skin", "wall s", "processor s", "memory MB")
    row(*["---"] * 4)
    inputs = [("cover of 642 taxels", DATA / "cyskin/ur10e_link1_patch1_isomap.json", 5)]
    for size in [100_000, 1_000_000]:
        file = FOLDER / f"cap{size}.glb"
        write_obj(FOLDER / "cap.obj", *SHAPES["cap"](size))
        ours("convert", FOLDER / "cap.obj", file)
        inputs.append((f"cap of {size} triangles", file, 5 if size < 1_000_000 else 3))
    for name, file, runs in inputs:
        if not file.exists():
            row(name, *["skipped: no file"] * 3)
            continue
        measured = [ours("build", file, "-o", FOLDER / "out") for _ in range(runs)]
        row(name, *[f"{median([m[k] for m in measured]):.3f}" for k in range(2)], f"{median([m[2] for m in measured]):.0f}")
    print("\n`dermatome convert TAXELS.csv OUT.glb`, bare taxels to a mesh, whole process\n")
    row("taxels", "wall s", "memory MB")
    row(*["---"] * 3)
    for size in [100_000, 1_000_000]:
        vertices, _ = SHAPES["cap"](2 * size)
        np.savetxt(FOLDER / "bare.csv", vertices, delimiter=",", header="x,y,z", comments="", fmt="%.9g")
        wall, _, memory, _ = ours("convert", FOLDER / "bare.csv", FOLDER / "bare.glb")
        row(str(len(vertices)), f"{wall:.2f}", f"{memory:.0f}")


def versions(old):
    print(f"\n`dermatome build SKIN -o OUT`, processor seconds of {old} and of this version, in turn; coarsening in wall seconds\n")
    row("skin", "old s", "new s", "new/old", "old coarsen s", "new coarsen s", "old MB", "new MB", "same map")
    row(*["---"] * 9)
    for size in sizes_asked() or [1000, 10_000, 100_000, 1_000_000]:
        for name in ["cap", "forearm", "ball"]:
            write_obj(FOLDER / "skin.obj", *SHAPES[name](size))
            measured, maps, folder = {old: [], DERMATOME: []}, {}, FOLDER / "out"
            for _ in range(3 if size > 500_000 else 7):
                for binary, runs in measured.items():
                    _, processor, memory, _ = ours("build", FOLDER / "skin.obj", "-o", folder, binary=binary)
                    coarsening = json.loads((folder / "timings.json").read_text())["seconds"]["coarsen"]
                    runs.append((processor, coarsening, memory))
                    maps[binary] = (folder / "map.glb").read_bytes()
            (before, coarse_before, memory_before), (after, coarse_after, memory_after) = [
                [median(column) for column in zip(*runs)] for runs in measured.values()]
            row(f"{name} {size}", f"{before:.2f}", f"{after:.2f}", f"{after / before:.2f}", f"{coarse_before:.3f}",
                f"{coarse_after:.3f}", f"{memory_before:.0f}", f"{memory_after:.0f}", "yes" if len(set(maps.values())) == 1 else "no")


def pixel_matrices(path):
    """(D, R, L0) of a map: pixels of all levels from fields, fields of all levels from taxels, pixels of level 0 alone."""
    from scipy import sparse
    sys.path.insert(0, str(ROOT / "tools/checks"))
    from check_frames import faces_of_centres, read_levels
    draw, carry = [], []
    for levels in read_levels(path).values():
        for k, level in enumerate(levels):
            width, height = level.extras["map"]["pixels"]
            inside, faces, weights = faces_of_centres(level, (height, width))
            covered = inside >= 0
            corners, weights = level.unsplit[level.triangles[faces[covered]]], weights[covered]
            count = level.unsplit.max() + 1
            rows = np.repeat(np.arange(len(corners)), 3)
            draw.append((k, sparse.csr_matrix((weights.ravel(), (rows, corners.ravel())), (len(corners), count))))
            if k == 0:
                step, areas = sparse.identity(count, format="csr"), np.zeros(count)
                areas[level.unsplit] = level.areas
            else:
                indices, up = levels[k - 1].up
                rows = np.repeat(np.arange(len(indices)), 3)
                up = sparse.csr_matrix((up.ravel(), (rows, indices.ravel())), (len(indices), count))
                step = up.T @ sparse.diags(areas) @ step
                areas = up.T @ areas
                step = sparse.diags(1 / areas) @ step
            carry.append((len(carry), step, k))
    finest = [d for k, d in draw if k == 0]
    patches, columns = [], -1
    for _, step, k in carry:
        columns += k == 0
        patches.append([step if c == columns else None for c in range(len(finest))])
    return [sparse.csr_matrix(m) for m in
            (sparse.block_diag([d for _, d in draw]), sparse.bmat(patches), sparse.block_diag(finest))]


def images():
    """Frames of readings to pixels, without files: the library's renderer and scipy's products."""
    print("\n`DERMATOME_MAPS=... cargo bench --bench image`, one thread; scipy.sparse CSR times vector, the same matrices: of level 0,"
          " and readings to the fields and pixels of all levels in two products. Only covered pixels, one channel, pressures\n")
    row("map", "taxels", "pixels", "what", "dermatome us", "scipy f64 us", "scipy f32 us", "ratio f64", "ratio f32")
    row(*["---"] * 9)
    maps = {}
    write_cover()
    for name, file in [("cover", FOLDER / "cover.obj"), ("hand", ROOT / "meshes/hand.glb"), ("robot", ROOT / "meshes/robot.glb")]:
        ours("build", file, "-o", FOLDER / name, "--pixel-mm", "1")
        maps[name] = FOLDER / name / "map.glb"
    os.environ["DERMATOME_MAPS"] = os.pathsep.join(map(str, maps.values()))
    matrices = {name: pixel_matrices(path) for name, path in maps.items()}
    times = {}
    for _ in range(3):
        subprocess.run(["cargo", "bench", "--bench", "image", "--", f"image/(frame|draw_L0)/({'|'.join(maps)})"], cwd=ROOT,
                       check=True, capture_output=True)
        for name, (draw, carry, finest) in matrices.items():
            for what in ["frame", "draw_L0"]:
                folder = TARGET / f"criterion/image/{what}/{name}/new/estimates.json"
                ns = json.loads(folder.read_text())["median"]["point_estimate"]
                times.setdefault((name, what, "ours"), []).append(ns / 1e3)
            for kind in [np.float64, np.float32]:
                d, r, f = (m.astype(kind) for m in (draw, carry, finest))
                x = np.sin(np.arange(r.shape[1])).astype(kind)
                for what, call in [("frame", lambda: d @ (r @ x)), ("draw_L0", lambda: f @ x)]:
                    times.setdefault((name, what, kind), []).append(1e6 * median([timed(call)[0] for _ in range(300)]))
    for name, (draw, carry, finest) in matrices.items():
        for what, m in [("all levels", draw), ("level 0", finest)]:
            key = "frame" if m is draw else "draw_L0"
            own, double, single = (median(times[name, key, kind]) for kind in ["ours", np.float64, np.float32])
            row(name, str(carry.shape[1]), str(m.shape[0]), what, f"{own:.1f}", f"{double:.1f}", f"{single:.1f}",
                f"{double / own:.2f}", f"{single / own:.2f}")


def write_cover():
    """Writes cover.obj, a cap of 642 taxels or so, 6 mm apart, and returns their number."""
    vertices, faces = SHAPES["cap"](1200)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    write_obj(FOLDER / "cover.obj", vertices * 6e-3 / np.sqrt(2 / np.sqrt(3) * area / len(vertices)), faces)
    return len(vertices)


def frames():
    """Recordings of 642 taxels drawn to nothing and to arrays, and the delay of a live pipe at 250 Hz."""
    print("\n`dermatome render MAP READINGS.npz -o - --level 0 > /dev/null` and `dermatome render MAP READINGS.npz -o OUT.npz`, whole process\n")
    row("frames of 642 taxels", "raw f32 of level 0, s", "MB", "all levels' values to .npz, s", "MB")
    row(*["---"] * 5)
    ids = np.arange(1, write_cover() + 1)
    ours("build", FOLDER / "cover.obj", "-o", FOLDER / "cover", "--pixel-mm", "1")
    cover = FOLDER / "cover/map.glb"
    rng = np.random.default_rng(1)
    for count in [1000, 10_000, 100_000]:
        readings = FOLDER / "readings.npz"
        np.savez(readings, values=rng.uniform(0, 1000, (count, len(ids))).astype(np.float32), ids=ids, timestamps=np.arange(count) / 250)
        raw = [ours("render", cover, readings, "-o", "-", "--level", "0", "--quiet") for _ in range(3)]
        values = [ours("render", cover, readings, "-o", FOLDER / "out.npz", "--values-only", "--quiet") for _ in range(3)]
        row(str(count), f"{median([m[0] for m in raw]):.2f}", f"{max(m[2] for m in raw):.0f}",
            f"{median([m[0] for m in values]):.2f}", f"{max(m[2] for m in values):.0f}")
    pipes(cover, readings, ids)


# Takes lines and answers each with as many bytes: what pipes cost alone.
ECHO = """
import sys
frame = bytes(int(sys.argv[1]))
for line in sys.stdin.buffer:
    if not line.startswith(b"time"):
        sys.stdout.buffer.write(frame)
        sys.stdout.buffer.flush()
"""


def delays(command, size, lines, rate):
    """From the write of each line to the last byte of its answer, in s."""
    import fcntl
    with subprocess.Popen(list(map(str, command)), stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0) as child:
        for pipe in (child.stdin, child.stdout):
            fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, 1 << 20)
        child.stdin.write(lines[0])
        answer, found = memoryview(bytearray(size)), []
        start = time.perf_counter() + 0.5
        for k, line in enumerate(lines[1:]):
            time.sleep(max(0.0, start + k / rate - time.perf_counter()))
            before, got = time.perf_counter(), 0
            child.stdin.write(line)
            while got < size:
                got += child.stdout.readinto(answer[got:]) or sys.exit("the stream ended early")
            found.append(time.perf_counter() - before)
        child.stdin.close()
    return found


def pipes(cover, readings, ids):
    """Delays of a live pipe at 250 Hz for 10 s, and of one that does nothing."""
    printed = ours("render", cover, readings, "-o", FOLDER / "out.npz", "--to", "0", "--json", "--quiet")[3]
    size = 4 * sum(height * width for height, width in printed["size"].values())
    rng = np.random.default_rng(2)
    lines = [",".join(["time", *map(str, ids)]).encode() + b"\n"]
    for k in range(2500):
        lines.append(",".join([f"{k / 250:.3f}", *(f"{x:.1f}" for x in rng.uniform(0, 1000, len(ids)))]).encode() + b"\n")
    print(f"\n`dermatome render MAP - -o -`, all levels, a line of CSV at 250 Hz for 10 s: from the write of a line of {len(lines[1])} bytes"
          f" to the last of its {size} bytes of pixels, in ms; the same of a program that answers at once\n")
    row("program", "median", "90 %", "99 %", "largest")
    row(*["---"] * 5)
    for name, command in [("dermatome", [DERMATOME, "render", cover, "-", "-o", "-", "--quiet"]),
                          ("none", [sys.executable, "-S", "-c", ECHO, size])]:
        row(name, *[f"{1e3 * x:.3f}" for x in np.percentile(delays(command, size, lines, 250), [50, 90, 99, 100])])


if __name__ == "__main__":
    processor = next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "unknown")
    print(f"{processor}, {os.cpu_count()} threads")
    for part in [word for word in sys.argv[1:] if not word.isdigit() and not word.startswith("rounds=")] or ["flatten", "coarsen", "nearest", "coarse", "graphs", "skins", "build", "images", "frames"]:
        part, *values = part.split("=")
        globals()[part](*values)

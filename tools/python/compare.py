"""Compares the times of two installed versions of the package: `python tools/python/compare.py OLD/bin/python NEW/bin/python`.

Each version runs in a process of its own, on one thread; every call is timed in the two by turns (ABAB), so that what else
the machine does meets both. Times are those of the processor (`time.process_time`): the least and the median of the rounds. A
call that one version does not have is left out. A call is slower where both its least and its median time are by more
than 5 %. Options: `--rounds N` (9), `--only TEXT` (calls whose name has it)."""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

MESHES = Path(__file__).resolve().parents[2] / "meshes"

#: Shortest time of a round, in s: a short call is repeated.
ROUND_S = 0.02


def sphere(count):
    """Places of taxels all over a ball, in m."""
    import numpy as np

    k = np.arange(count) + 0.5
    polar, azimuth = np.arccos(1 - 2 * k / count), np.pi * (1 + 5**0.5) * k
    return 0.05 * np.column_stack([np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)])


def calls(folder):
    """The calls by their names; each is made ready when it is first needed."""
    import numpy as np

    import dermatome

    sources = {path.stem: path for path in sorted(MESHES.glob("*.glb"))}
    places = sphere(642)
    ball = dermatome.Skin.from_arrays(places, normals=places / 0.05)
    sources["ball of 642"] = folder / "ball.glb"
    ball.write(sources["ball of 642"])
    yield "Skin.from_arrays", lambda: dermatome.Skin.from_arrays(places, normals=places / 0.05)
    for name, source in sources.items():
        yield from calls_of_map(folder, name, source, is_whole=name in ("forearm", "ball of 642"))
    observations, _ = dermatome.simulate(seed=1)
    observations.write(folder / "observations.csv")
    mesh = dermatome.build(sources["forearm"]).patches["forearm"].levels[0]
    positions, faces = mesh.positions, mesh.faces
    robot = dermatome.Robot.read(MESHES / "arm.urdf")
    made = {
        "simulate": lambda: dermatome.simulate(seed=1),
        "Observations.read": lambda: dermatome.Observations.read(folder / "observations.csv"),
        "Observations.write": lambda: observations.write(folder / "again.csv"),
        "calibrate": lambda: dermatome.calibrate(observations, threads=1),
        "calibrate, no covariances": lambda: dermatome.calibrate(observations, covariances=False, threads=1),
        "coarsen": lambda: dermatome.coarsen(positions, faces, threads=1),
        "flatten": lambda: dermatome.flatten(positions, faces, cut="auto", threads=1),
        "check, a file": lambda: dermatome.check(sources["forearm"]),
        "check, arrays": lambda: dermatome.check(positions, faces),
        "Robot.read": lambda: dermatome.Robot.read(MESHES / "arm.urdf"),
        "Robot.poses": lambda: robot.poses(),
    }
    yield from made.items()


def calls_of_map(folder, name, source, is_whole):
    """The calls on one map; of all of them, or those that every mesh is asked."""
    import pickle

    import numpy as np

    import dermatome

    skin = dermatome.Skin.read(source)
    skin_map = dermatome.build(skin, threads=1)
    rng = np.random.default_rng(0)
    index, level = skin_map.index(fields=True), next(iter(skin_map.patches.values())).levels[0]
    base = level.positions + 1e-3 * level.normals
    points = np.tile(base, (1000 // len(base) + 1, 1))[:1000] + rng.normal(0, 1e-3, (1000, 3))
    frames = rng.random((100, skin_map.n_taxels))
    patch = next(iter(skin_map.patches))
    content, path = skin_map.to_bytes(), folder / f"{name}_map.glb"
    few, many = ({"patch": patch, "size": (side, side)} for side in (64, 256))
    small, large = skin_map.renderer(0, **few), skin_map.renderer(0, **many)
    core = {
        "Skin.read": lambda: dermatome.Skin.read(source),
        "build": lambda: dermatome.build(skin, threads=1),
        "Map.from_bytes": lambda: dermatome.Map.from_bytes(content),
        "Map.index": lambda: skin_map.index(threads=1),
        "locate, 1 point": lambda: index.locate(points[:1], threads=1),
        "locate, 1000 points": lambda: index.locate(points, threads=1),
        "nearest, 1000 points": lambda: index.nearest(points, 4, threads=1),
        "pool, 100 frames": lambda: skin_map.pool(frames, 1, threads=1),
        "renderer, 64": lambda: skin_map.renderer(0, **few),
        "render 64, 100 frames": lambda: small(frames, threads=1),
        "render 256, 10 frames": lambda: large(frames[:10], threads=1),
        "plot": lambda: skin_map.plot(frames[0], width=600),
    }
    for what, call in core.items():
        yield f"{name}: {what}", call
    if not is_whole:
        return
    try:
        reactive = skin_map.index(reactive=True)
    except TypeError:
        reactive = skin_map.index(levels=True)
    directions, ones = points - points.mean(axis=0), np.ones(4)
    poses, uv = {skin_map.links[0]: np.eye(4)}, level.uv
    readings, _ = dermatome.touch(skin_map, presses=3, rate=50.0, noise=0.001, seed=1)
    recording = folder / f"{name}.npz"
    readings.write(recording)
    tracker = dermatome.ContactTracker(skin_map, threshold=0.5, unit="N")
    touched = readings.on(skin_map).values[:, 0]
    picture = skin_map.plot(frames[0], width=600)
    whole = {
        "Skin.write": lambda: skin.write(folder / "skin.glb"),
        "Skin.to_bytes": lambda: skin.to_bytes(),
        "Skin.positions": lambda: skin.positions,
        "Map.read": lambda: dermatome.Map.read(path),
        "Map.write": lambda: skin_map.write(path),
        "Map.to_bytes": lambda: skin_map.to_bytes(),
        "Map.patches": lambda: skin_map.patches,
        "Map.ids": lambda: skin_map.ids,
        "Map.patch_of": lambda: skin_map.patch_of,
        "Map.report": lambda: skin_map.report,
        "Map.pooling": lambda: skin_map.pooling(1),
        "Map.to_skin": lambda: skin_map.to_skin(patch, uv),
        "Map, equal": lambda: skin_map == skin_map,
        "pickle": lambda: pickle.loads(pickle.dumps(skin_map)),
        "export .csv": lambda: skin_map.export(folder / "out.csv"),
        "export .npz": lambda: skin_map.export(folder / "out.npz"),
        "export .xml": lambda: skin_map.export(folder / "out.xml"),
        "export .usda": lambda: skin_map.export(folder / "out.usda"),
        "Level.positions": lambda: level.positions,
        "Level.uv": lambda: level.uv,
        "Level.faces": lambda: level.faces,
        "Level.normals": lambda: level.normals,
        "Level.distortion": lambda: level.distortion,
        "Level.up": lambda: level.up(),
        "Map.index, fields": lambda: skin_map.index(fields=True, threads=1),
        "locate, level=None": lambda: index.locate(points, level=None, threads=1),
        "locate, level 1": lambda: index.locate(points, level=1, threads=1),
        "within, 1000 points": lambda: index.within(points, 0.01, threads=1),
        "reactive, 1000 points": lambda: reactive.reactive(points, 1, threads=1),
        "reactive, 1 point": lambda: reactive.reactive(points[:1], 1, threads=1),
        "ray, 1000": lambda: index.ray(points, directions, threads=1),
        "nearest, 1 point": lambda: index.nearest(points[:1], 1, threads=1),
        "Index.readings": lambda: index.readings(points[:4], ones, 0.01 * ones),
        "Index.posed": lambda: index.posed(poses),
        "pool, 1 frame": lambda: skin_map.pool(frames[0], 1, threads=1),
        "pool, contrast": lambda: skin_map.pool(frames, 1, contrast=True, threads=1),
        "pool, extensive": lambda: skin_map.pool(frames, 1, extensive=True, threads=1),
        "renderer, 256": lambda: skin_map.renderer(0, **many),
        "render 64, 1 frame": lambda: small(frames[:1], threads=1),
        "render 256, 1 frame": lambda: large(frames[:1], threads=1),
        "Renderer.mask": lambda: small.mask,
        "Renderer.taxel_id": lambda: small.taxel_id,
        "Renderer.matrix": lambda: small.matrix(),
        "track": lambda: tracker.track(touched[40]),
        "plot, fields": lambda: skin_map.plot(width=600),
        "Picture.svg": lambda: picture.svg(),
        "Picture.png": lambda: picture.png(),
        "touch": lambda: dermatome.touch(skin_map, presses=1, rate=50.0, seed=1),
        "Readings.read": lambda: dermatome.Readings.read(recording),
        "Readings.write": lambda: readings.write(folder / "out_readings.npz"),
        "Readings.from_arrays": lambda: dermatome.Readings.from_arrays(frames),
        "Readings.on": lambda: readings.on(skin_map),
        "Readings.condition": lambda: readings.condition(skin_map, baseline=5),
        "Readings.features": lambda: readings.features(skin_map),
    }
    skin_map.write(path)
    for what, call in whole.items():
        yield f"{name}: {what}", call


def serve():
    """Runs a call for each line of input, and answers with the seconds that one took."""
    counts, known, failed = {}, {}, {}
    with tempfile.TemporaryDirectory() as folder:
        known = dict(calls(Path(folder)))
        print(json.dumps(list(known)), flush=True)
        for line in sys.stdin:
            name = json.loads(line)
            call = known[name]
            if name not in counts:
                try:
                    call()
                    start = time.process_time()
                    call()
                    counts[name] = max(1, round(ROUND_S / max(time.process_time() - start, 1e-7)))
                except Exception as error:  # The other version may have another signature.
                    counts[name], failed[name] = 1, f"{type(error).__name__}: {error}"
            if name in failed:
                print(json.dumps(failed[name]), flush=True)
                continue
            start = time.process_time()
            for _ in range(counts[name]):
                call()
            print(json.dumps((time.process_time() - start) / counts[name]), flush=True)


def main():
    arguments = sys.argv[1:]
    options = {"--rounds": "9", "--only": ""}
    for option in options:
        if option in arguments:
            at = arguments.index(option)
            options[option] = arguments[at + 1]
            del arguments[at : at + 2]
    environment = {**os.environ, "RAYON_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    start = lambda python: subprocess.Popen(
        [python, __file__, "--serve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    )
    versions = [start(python) for python in arguments]
    names = [json.loads(version.stdout.readline()) for version in versions]

    def ask(version, name):
        version.stdin.write(json.dumps(name) + "\n")
        version.stdin.flush()
        return json.loads(version.stdout.readline())

    print("| call | old, us | new, us | least | median |\n|---|---|---|---|---|")
    slower = []
    for name in (name for name in names[0] if name in names[1] and options["--only"] in name):
        times = [[ask(version, name) for version in versions] for _ in range(int(options["--rounds"]))]
        if any(isinstance(each, str) for each in times[0]):
            print(f"| {name} | {times[0]} | | | |", flush=True)
            continue
        old, new = zip(*times)
        least, median = min(new) / min(old), statistics.median(new) / statistics.median(old)
        mark = " **slower**" if min(least, median) > 1.05 else ""
        slower += [name] * bool(mark)
        print(f"| {name} | {1e6 * min(old):.4g} | {1e6 * min(new):.4g} | {least:.3f} | {median:.3f}{mark} |", flush=True)
    for version in versions:
        version.stdin.close()
        version.wait()
    print(f"slower by more than 5 %: {', '.join(slower) or 'none'}")


if __name__ == "__main__":
    serve() if sys.argv[1:] == ["--serve"] else main()

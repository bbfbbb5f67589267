"""Times what a user of the package waits for: `python tools/python/bench.py` in an environment that has it, with torch for the loader.

Each number is the median of some rounds; the loader's is the best of three passes, workers started."""

import statistics
import subprocess
import sys
import time

import numpy as np

import dermatome


def timed(call, rounds=9):
    """The median time of a call, in s, after one call that is not counted."""
    call()
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def imported():
    code = "import time; start = time.perf_counter(); import dermatome; print(time.perf_counter() - start)"
    return statistics.median(float(subprocess.check_output([sys.executable, "-c", code])) for _ in range(15))


def loaded(skin_map):
    """Images of 64 x 64 a second from a loader of two spawned workers."""
    import torch

    from dermatome.torch import Touches

    readings, truth = dermatome.touch(skin_map, presses=80, rate=100.0)
    touches = Touches(skin_map, readings, truth, size=(64, 64))
    loader = torch.utils.data.DataLoader(touches, batch_size=64, num_workers=2, multiprocessing_context="spawn", persistent_workers=True)
    best = 0.0
    for _ in range(4):  # The first pass starts the workers.
        start, count = time.perf_counter(), 0
        for batch in loader:
            count += len(batch["image"])
        best = max(best, count / (time.perf_counter() - start))
    return best


def main():
    skin_map = dermatome.build("meshes/forearm.glb")
    index, rng = skin_map.index(reactive=True, fields=True), np.random.default_rng(0)
    level = skin_map.patches["forearm"].levels[0]
    points = np.tile(level.positions + 1e-3 * level.normals, (200, 1)) + rng.normal(0, 1e-3, (200 * len(level.positions), 3))
    frames, renderer = rng.random((1000, skin_map.n_taxels)), skin_map.renderer(0, size=(64, 64))
    rows, columns = renderer.pixels(index.locate(points[:1000])).T
    observations, _ = dermatome.simulate()
    tracker = dermatome.ContactTracker(skin_map, threshold=0.99)
    calls = {
        "index.locate, 1 point": (lambda: index.locate(points[:1], threads=1), 1e6, "us"),
        "index.locate, 200000 points": (lambda: index.locate(points), 1e3, "ms"),
        "index.locate, level=None": (lambda: index.locate(points, level=None), 1e3, "ms"),
        "index.reactive": (lambda: index.reactive(points), 1e3, "ms"),
        "index.nearest": (lambda: index.nearest(points[:20_000], 8), 1e3, "ms"),
        "index.posed": (lambda: index.posed({skin_map.links[0]: np.eye(4)}), 1e6, "us"),
        "map.pool, 1000 frames": (lambda: skin_map.pool(frames, 2), 1e3, "ms"),
        "renderer, 1 frame": (lambda: renderer(frames[:1], threads=1), 1e6, "us"),
        "renderer, 1000 frames": (lambda: renderer(frames), 1e3, "ms"),
        "renderer.to_skin, 1000 pixels": (lambda: renderer.to_skin(rows, columns), 1e3, "ms"),
        "tracker.track": (lambda: tracker.track(frames[0]), 1e6, "us"),
        "map.plot": (lambda: skin_map.plot(frames[0], width=600), 1e3, "ms"),
        "coarsen": (lambda: dermatome.coarsen(level.positions, level.faces), 1e3, "ms"),
        "calibrate, 500 taxels": (lambda: dermatome.calibrate(observations), 1e3, "ms"),
        "build": (lambda: dermatome.build("meshes/forearm.glb"), 1e3, "ms"),
    }
    print(f"import dermatome: {1e3 * imported():.0f} ms")
    for name, (call, factor, unit) in calls.items():
        print(f"{name}: {factor * timed(call):.4g} {unit}")
    print(f"loader of two spawned workers: {loaded(skin_map):.0f} images of 64 x 64 a second")


if __name__ == "__main__":
    main()

"""Draws the episodes of a Zarr of Open-X-Tactile and of a LeRobot dataset by one process and by Ray, stops the job of Ray in its middle,
starts it again and compares the files: `python tools/python/episodes.py FOLDER [EPISODES]` in an environment with ray and numcodecs.

It prints the table of docs/python.md, and fails where bytes differ. Memory is that of the largest process, as Linux states it (`VmHWM`)."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import dermatome

LAYOUT = {
    "dermatome_layout": 1,
    "axes": ["frame", "taxel"],
    "time": {"rate": 50},
    "channels": [{"name": "force", "unit": "N"}],
    "press": "raises",
    "zero": 0,
    "taxels": {"shape": [1000], "first_id": 1},
}
OPTIONS = {"size": (64, 96), "fill": 0.0}
KINDS = {"zarr": ("touch.zarr", "right_tactile_data_skin"), "lerobot": ("touch", "observation.tactile.skin")}


def lengths_of(count):
    return np.random.default_rng(1).integers(60, 181, count)


def frames_of(number, frames, touched):
    """An episode: a piece of a simulated recording, with its own strength and noise."""
    rng = np.random.default_rng([2, number])
    first = rng.integers(0, len(touched) - frames)
    part = touched[first : first + frames] * rng.uniform(0.5, 2)
    return (part + rng.normal(0, 1e-4, part.shape)).astype("<f4")


def write(folder, count):
    """Both recordings of the same episodes, one at a time."""
    import pyarrow as arrow
    from pyarrow import parquet

    touched = dermatome.touch(dermatome.Skin.example(), presses=40, rate=50.0)[0].values[:, 0]
    lengths = lengths_of(count)
    ends, width = np.cumsum(lengths), touched.shape[1]
    zarr, lerobot = folder / KINDS["zarr"][0], folder / KINDS["lerobot"][0]
    about = {"zarr_format": 2, "compressor": None, "fill_value": 0, "order": "C", "filters": None}
    for name, shape, chunk, kind in ((f"data/{KINDS['zarr'][1]}", [int(ends[-1]), width], [100, width], "<f4"), ("meta/episode_ends", [count], [count], "<i8")):
        (zarr / name).mkdir(parents=True)
        (zarr / name / ".zarray").write_text(json.dumps({**about, "shape": shape, "chunks": chunk, "dtype": kind}))
    for name in ("", "data", "meta"):
        (zarr / name / ".zgroup").write_text('{"zarr_format": 2}')
    (zarr / "meta/episode_ends/0").write_bytes(ends.astype("<i8").tobytes())
    for name in ("data/chunk-000", "meta/episodes/chunk-000"):
        (lerobot / name).mkdir(parents=True)
    feature = {"dtype": "float32", "shape": [width], "names": None}
    said = {"codebase_version": "v3.0", "fps": 50, "features": {KINDS["lerobot"][1]: feature}, "total_episodes": count, "total_frames": int(ends[-1])}
    (lerobot / "meta/info.json").write_text(json.dumps(said))
    rows = {"episode_index": range(count), "length": lengths, "data/chunk_index": [0] * count, "data/file_index": [0] * count}
    parquet.write_table(arrow.table(rows), lerobot / "meta/episodes/chunk-000/file-000.parquet")
    schema = arrow.schema({KINDS["lerobot"][1]: arrow.list_(arrow.float32(), width), "episode_index": arrow.int64(), "frame_index": arrow.int64(), "timestamp": arrow.float32(), "index": arrow.int64()})
    rest, chunk = np.empty((0, width), "<f4"), 0
    with parquet.ParquetWriter(lerobot / "data/chunk-000/file-000.parquet", schema) as writer:
        for number, frames in enumerate(lengths):
            values = frames_of(number, frames, touched)
            column = arrow.FixedSizeListArray.from_arrays(arrow.array(values.ravel()), width)
            counted = np.arange(frames)
            columns = [column, np.full(frames, number), counted, (counted / 50).astype("f4"), ends[number] - frames + counted]
            writer.write_table(arrow.table([arrow.array(each) if isinstance(each, np.ndarray) else each for each in columns], schema=schema))
            rest = np.concatenate([rest, values])
            while len(rest) >= 100 or number == count - 1 and len(rest):
                block = np.zeros((100, width), "<f4")  # A chunk of Zarr is whole.
                block[: len(rest[:100])] = rest[:100]
                (zarr / f"data/{KINDS['zarr'][1]}/{chunk}.0").write_bytes(block.tobytes())
                rest, chunk = rest[100:], chunk + 1


def peak():
    """The most memory that this process has had, in MB."""
    return int(next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1]) / 1000


def rows_of(source, stream):
    import dermatome.ray

    return dermatome.ray.episodes([source], stream=stream, layout=LAYOUT)


def alone(source, stream, out):
    """All episodes by this process."""
    import dermatome.ray

    render = dermatome.ray.Render(dermatome.build(dermatome.Skin.example()).to_bytes(), out, 0, OPTIONS, stream=stream, layout=LAYOUT)
    done = [render(row) for row in rows_of(source, stream)]
    print(json.dumps({"peak": peak(), "frames": sum(row["frames"] for row in done), "errors": sum(bool(row["error"]) for row in done)}))


def cluster(source, stream, out):
    """All episodes by two actors of Ray."""
    import ray

    import dermatome.ray

    ray.init(num_cpus=4, include_dashboard=False, log_to_driver=False)
    data = dermatome.build(dermatome.Skin.example()).to_bytes()
    began = time.perf_counter()
    job = ray.data.from_items(rows_of(source, stream)).map(
        Measured, fn_constructor_args=(data, out, 0, OPTIONS), fn_constructor_kwargs={"stream": stream, "layout": LAYOUT}, concurrency=2
    )
    done = job.take_all()
    took = time.perf_counter() - began
    errors = sum(bool(row["error"]) for row in done)
    print(json.dumps({"peak": max(row["peak"] for row in done), "driver": peak(), "frames": sum(row["frames"] for row in done), "errors": errors, "job": took}))
    ray.shutdown()


class Measured:
    """`dermatome.ray.Render`, and the memory of its actor."""

    def __init__(self, *given, **named):
        import dermatome.ray

        self.render = dermatome.ray.Render(*given, **named)

    def __call__(self, row):
        return self.render(row) | {"peak": peak()}


def run(way, kind, folder, out, stop_at=None):
    """What a program of its own says, and the time that it took; with `stop_at` it is ended when there are so many files."""
    source, stream = KINDS[kind]
    began = time.perf_counter()
    command = [sys.executable, __file__, way, str(folder / source), stream, str(out)]
    program = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True)
    while stop_at and len(list(out.glob("*.npz"))) < stop_at:
        assert program.poll() is None, "the job ended before it was stopped"
        time.sleep(0.05)
    if stop_at:
        # All of the job at once, workers too: nothing can tidy up.
        os.killpg(program.pid, signal.SIGKILL)
        program.wait()
        return {"files": len(list(out.glob("*.npz")))}, time.perf_counter() - began
    said, _ = program.communicate()
    assert program.returncode == 0, f"{way} failed"
    return json.loads(said.splitlines()[-1]), time.perf_counter() - began


def sums(out):
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in out.glob("*.npz")}


def main(folder, count=500):
    folder.mkdir(parents=True)
    write(folder, count)
    print("| recording | way | time (s) | memory (MB) | files | the same bytes |\n|---|---|---|---|---|---|")
    for kind in KINDS:
        size = sum(path.stat().st_size for path in (folder / KINDS[kind][0]).rglob("*") if path.is_file())
        out = {way: folder / f"{kind}_{way}" for way in ("alone", "ray", "stopped")}
        said, took = run("alone", kind, folder, out["alone"])
        known = sums(out["alone"])
        print(f"| {kind}, {said['frames']} frames, {size / 1e6:.0f} MB | one process | {took:.0f} | {said['peak']:.0f} | {len(known)} | |", flush=True)
        assert said["errors"] == 0 and len(known) == count
        said, took = run("ray", kind, folder, out["ray"])
        assert sums(out["ray"]) == known, "other bytes by Ray"
        print(f"| | Ray, two actors | {took:.0f}, of the job {said['job']:.0f} | {said['peak']:.0f} an actor, {said['driver']:.0f} the driver | {len(sums(out['ray']))} | {sums(out['ray']) == known} |", flush=True)
        said, took = run("ray", kind, folder, out["stopped"], stop_at=count // 2)
        print(f"| | the same, killed | {took:.0f} | | {said['files']} | |", flush=True)
        said, took = run("ray", kind, folder, out["stopped"])
        assert sums(out["stopped"]) == known, "other bytes after a stop"
        print(f"| | and started again | {took:.0f}, of the job {said['job']:.0f} | {said['peak']:.0f} an actor, {said['driver']:.0f} the driver | {len(sums(out['stopped']))} | {sums(out['stopped']) == known} |", flush=True)


if __name__ == "__main__":
    ways = {"alone": alone, "ray": cluster}
    if sys.argv[1] in ways:
        ways[sys.argv[1]](Path(sys.argv[2]), sys.argv[3], Path(sys.argv[4]))
    else:
        main(Path(sys.argv[1]).absolute(), *map(int, sys.argv[2:]))

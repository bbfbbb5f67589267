"""`Readings`: its objects, its files, what it says."""

import json
import os
import subprocess
import sys
import zipfile
from dataclasses import replace

import numpy as np
import pytest

import dermatome
from dermatome import Readings


@pytest.mark.parametrize("channels, taxels", [(1, 256), (2, 256), (256, 256)])
def test_a_file_reads_itself(channels, taxels, dome_map, tmp_path):
    values = np.random.default_rng(0).random((3, channels, taxels))
    times, names = np.arange(3) / 50, [f"c{k}" for k in range(channels)]
    for ids in (None, dome_map.ids[::-1]):
        Readings.from_arrays(values, ids=ids, timestamps=times, channels=names, units=["Pa"] * channels).write(tmp_path / "a.npz")
        for layout in (None, "tnc", "tcn"):
            read = Readings.read(tmp_path / "a.npz", layout=layout)
            assert np.array_equal(read.values, values) and read.channels == tuple(names) and set(read.units) == {"Pa"}
            assert np.array_equal(read.timestamps, times) and (ids is None or np.array_equal(read.ids, ids))
            assert [r for r in read.remarks if "layout" in r] == (
                ["the layout is 'tnc', as the file says, and not 'tcn'"] if layout == "tcn" and channels > 1 else []
            )
    dome_map.write(tmp_path / "map.glb")
    command = [sys.executable, "-m", "dermatome", "render", "map.glb", "a.npz", "-o", "o.npz", "--values-only", "--level", "0"]
    subprocess.run([*command, "--quiet"], check=True, cwd=tmp_path)
    assert np.allclose(np.load(tmp_path / "o.npz")["dome.L0.values"].reshape(values.shape), values[:, :, ::-1])


def test_a_file_of_another_program_may_name_its_layout(tmp_path):
    values = np.random.default_rng(0).random((3, 4, 4))
    np.savez(tmp_path / "a.npz", values=values, layout="tcn")
    assert np.array_equal(Readings.read(tmp_path / "a.npz").values, values)
    np.savez(tmp_path / "a.npz", values=values)
    assert np.array_equal(Readings.read(tmp_path / "a.npz").values, np.moveaxis(values, 2, 1))
    assert np.array_equal(Readings.read(tmp_path / "a.npz", layout="tcn").values, values)
    (tmp_path / "b.npz").write_bytes(b"no archive")
    with pytest.raises(dermatome.Error, match="b.npz"):
        Readings.read(tmp_path / "b.npz")
    with pytest.raises(dermatome.MissingFileError):
        Readings.read(tmp_path / "c.npz")
    with pytest.raises(dermatome.FileError, match="none"):
        Readings.from_arrays(values).write(tmp_path / "none" / "a.npz")


def test_what_was_measured_is_kept(dome_map, tmp_path):
    values = np.random.default_rng(1).random((4, 2, 256))
    values[:, :, 40:44] = np.nan
    filled = Readings.from_arrays(values).condition(dome_map, fill="neighbours", rate=10.0)
    assert np.isfinite(filled.values).all() and not filled.measured[:, :, 40:44].any()
    filled.write(tmp_path / "a.npz")
    again = Readings.read(tmp_path / "a.npz")
    assert np.array_equal(again.measured, filled.measured) and np.array_equal(filled[1:3].measured, filled.measured[1:3])
    order = np.random.default_rng(2).permutation(256)
    mixed = Readings(filled.values[:, :, order], dome_map.ids[order], filled.timestamps, filled.channels, filled.units, filled.measured[:, :, order])
    assert np.array_equal(mixed.on(dome_map).measured, filled.measured)
    assert np.array_equal(mixed.condition(dome_map).measured, filled.measured)
    assert np.array_equal(mixed.condition(dome_map, split=2.0).measured, np.repeat(filled.measured, 2, axis=1))
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert "layout.npy" in archive.namelist()


def test_a_known_zero_and_threshold_are_kept(dome_map, tmp_path):
    """A touch of the first frame is no zero where one was subtracted, in every file and command."""
    readings, _ = dermatome.touch(dome_map, presses=1, rate=50.0)
    loaded = readings[int(np.argmax(readings.values.sum(axis=(1, 2)))) :]
    tared = replace(loaded, is_tared=True, threshold=0.01)
    unknown, known = (each.summary(dome_map)[0]["force_peak"] for each in (loaded, tared))
    assert unknown < 0.5 * known
    tared.write(tmp_path / "a.npz")
    dome_map.write(tmp_path / "map.glb")
    again = [Readings.read(tmp_path / "a.npz"), Readings.read(tmp_path / "a.npz", dome_map), Readings.open(tmp_path / "a.npz").read()]
    try:
        again.append(Readings.from_xarray(tared.to_xarray()))
    except ImportError:
        pass
    for each in again:
        assert (each.is_tared, each.threshold) == (True, 0.01) and each.summary(dome_map)[0]["force_peak"] == known
    said = subprocess.run([sys.executable, "-m", "dermatome", "summary", "map.glb", "a.npz", "-o", "sums.csv", "--json"], capture_output=True, text=True, cwd=tmp_path)
    whole = json.loads(said.stdout)["groups"][0]
    assert whole["force_peak"] == pytest.approx(known, rel=1e-12), said.stderr
    conditioned = loaded.condition(dome_map, zero=0.0)
    conditioned.write(tmp_path / "b.npz")
    assert Readings.read(tmp_path / "b.npz").is_tared and not Readings.read(tmp_path / "b.npz").threshold
    loaded.write(tmp_path / "c.npz")
    assert not Readings.read(tmp_path / "c.npz").is_tared
    # A threshold is of one channel, in its unit.
    assert replace(tared, units=("",)).condition(dome_map, units="kN").threshold is None
    heat = Readings.from_arrays(np.ones((3, 2, 4)), channels=["force", "temperature"], units=["N", "K"])
    heat = replace(heat, is_tared=True, threshold=0.5)
    assert heat.select("force").threshold == 0.5 and heat.select(["temperature", "force"]).threshold == 0.5
    assert heat.select("temperature").threshold is None


@pytest.mark.parametrize("name, data", [("empty.npz", b""), ("array.npz", None), ("deflate.npz", "deflate"), ("empty.npy", b"")])
def test_a_damaged_file_is_an_error_of_ours(name, data, tmp_path):
    path = tmp_path / name
    if data == "deflate":
        np.savez_compressed(path, values=np.random.default_rng(1).random((40, 30)), layout=np.array("tnc"))
        packed = bytearray(path.read_bytes())
        packed[60:80] = bytes(20)
        data = bytes(packed)
    elif data is None:
        with open(path, "wb") as file:
            np.save(file, np.ones((3, 4)))
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(dermatome.Error, match=name):
        Readings.read(path)
    if name.startswith("empty"):
        with pytest.raises(dermatome.Error, match=name):
            Readings.open(path).draft()


def test_readings_are_short_and_sliced(dome_map):
    readings = Readings.from_arrays(np.arange(150 * 256).reshape(150, 256), timestamps=np.arange(150) / 50, channels="force", units="N")
    assert repr(readings) == "<Readings: 150 frames, 1 channel (force, N), 256 taxels, 2.98 s>"
    many = Readings.from_arrays(np.zeros((1, 9, 3)))
    assert repr(many) == "<Readings: 1 frame, 9 channels (channel0; channel1; channel2; channel3; ...), 3 taxels>"
    assert repr(Readings.from_arrays(np.zeros((0, 0, 0)), channels=[])) == "<Readings: 0 frames, 0 channels, 0 taxels>"
    assert len(readings) == 150 and len(readings[10:50:2]) == 20 and len(list(readings)) == 150
    for part in (readings[[3, -1]], readings[np.array([3, 149])], readings[np.isin(np.arange(150), [3, 149])]):
        assert np.array_equal(part.values[:, 0, 0], [3 * 256, 149 * 256]) and np.allclose(part.timestamps, [0.06, 2.98])
    assert readings[-1].values.shape == (1, 1, 256) and readings[5].units == ("N",)
    with pytest.raises(IndexError):
        readings[150]
    with pytest.raises(dermatome.DataError, match="frames"):
        readings[1, 2]
    assert len(readings[5:9].condition(dome_map, baseline=2)) == 4


def test_units_and_names_are_words_or_lists():
    values = np.zeros((2, 2, 3))
    made = Readings.from_arrays(values, channels=["force", "heat"], units=["N", "K"])
    assert made.channels == ("force", "heat") and made.extensive == (True, False)
    assert Readings.from_arrays(values[:, :1], units="N").extensive == (True,)
    for wrong in ("N", ["N"], ["N", 1]):
        with pytest.raises(dermatome.DataError, match="units"):
            Readings.from_arrays(values, units=wrong)


def test_times_are_seconds():
    for times in (np.array([10**18, 10**18 + 5 * 10**8], "datetime64[ns]"), np.array([1e9, 1e9 + 0.5])):
        assert np.allclose(Readings.from_arrays(np.zeros((2, 3)), timestamps=times).timestamps, [1e9, 1e9 + 0.5])
    missing = np.array(["2026-01-01", "NaT"], "datetime64[s]")
    assert np.isnan(Readings.from_arrays(np.zeros((2, 3)), timestamps=missing).timestamps).tolist() == [False, True]
    with pytest.raises(dermatome.DataError, match="timestamps: found 1.7e[+]18 for frame 1.*nanoseconds"):
        Readings.from_arrays(np.zeros((2, 3)), timestamps=[0, 1_700_000_000_000_000_000])
    with pytest.raises(dermatome.DataError, match="timestamps: found 3; needed: 2"):
        Readings.from_arrays(np.zeros((2, 3)), timestamps=[0, 1, 2])
    with pytest.raises(dermatome.DataError, match="frame 1"):
        Readings.from_arrays(np.zeros((2, 3)), timestamps=[0, np.nan]).write("never.npz")


def test_arrays_of_taxels_condition(dome_map):
    rng = np.random.default_rng(3)
    counts, scale, offset, zero = rng.random((5, 2, 256)), rng.random(256), rng.random((2, 256)), rng.random(256)
    made = Readings.from_arrays(counts).condition(dome_map, scale=scale, offset=offset, baseline=zero, gain=scale, units=["Pa", "N"])
    assert np.allclose(made.values, (counts * scale + offset - zero) * scale) and made.units == ("Pa", "N")
    assert np.allclose(Readings.from_arrays(counts).condition(dome_map, scale=2, offset=[[1], [3]]).values, 2 * counts + [[1], [3]])
    by_id = dict(zip(dome_map.ids.tolist(), scale))
    for gain in (scale, by_id):
        made = Readings.from_arrays(counts).condition(dome_map, baseline=2, gain=gain, clip=[-0.2, 0.3])
        assert np.allclose(made.values, np.clip((counts - counts[:2].mean(axis=0)) * scale, -0.2, 0.3))
    zero[7] = np.nan
    assert np.isnan(Readings.from_arrays(counts).condition(dome_map, baseline=zero).values[:, :, 7]).all()
    for name, wrong in (("scale", np.ones(3)), ("offset", np.nan), ("baseline", np.ones((256, 2))), ("gain", np.ones((1, 2))), ("clip", [1])):
        with pytest.raises(dermatome.DataError, match=name):
            Readings.from_arrays(counts).condition(dome_map, **{name: wrong})


def test_remarks_are_what_the_command_says(uneven_map, tmp_path):
    rng, ids = np.random.default_rng(4), uneven_map.ids
    values, times = rng.random((4, 1, 592)), np.array([0.0, 2.0, 1.0, 3.0])
    values[1, 0, 50], values[2, 0, 60], values[:, 0, 70] = np.nan, 1e300, np.nan
    columns = np.concatenate([ids[:580], [9998, 9999]])
    readings = Readings.from_arrays(np.concatenate([values[:, :, :580], values[:, :, :2]], axis=2), ids=columns, timestamps=times)
    joined = readings.on(uneven_map).remarks
    absent = int((uneven_map.present[:580] != 1).sum())
    assert joined == (
        "2 columns are of no taxel of the map: 9998, 9999",
        f"{580 - absent} taxels have readings, {12 + absent} have none and are masked",
    )
    made = readings.condition(uneven_map, baseline=99, gain={9999: 2.0, int(ids[0]): 1.5}, clip=(-0.3, 0.3))
    readings.write(tmp_path / "a.npz")
    uneven_map.write(tmp_path / "map.glb")
    (tmp_path / "gain.csv").write_text(f"id,gain\n9999,2\n{ids[0]},1.5\n")
    command = "render map.glb a.npz -o o.npz --values-only --zero first=99 --gain gain.csv --clip -0.3,0.3".split()
    said = subprocess.run([sys.executable, "-m", "dermatome", *command], capture_output=True, text=True, cwd=tmp_path)
    assert said.returncode == 0, said.stderr
    notes = [line.removeprefix("note: ").removeprefix("a.npz: ") for line in said.stderr.splitlines() if line.startswith("note: ")]
    assert notes[: len(made.remarks)] == list(made.remarks) and len(made.remarks) > 5
    assert Readings.from_arrays(values).condition(uneven_map).remarks[0].endswith("missing, NaN or infinite, and masked")
    assert Readings.from_arrays(np.zeros((2, 592))).condition(uneven_map, baseline=2).remarks == ()


def test_readings_go_to_xarray(dome_map):
    pytest.importorskip("xarray")
    readings = Readings.from_arrays(
        np.random.default_rng(5).random((4, 2, 256)), ids=dome_map.ids, timestamps=np.arange(4) / 10, channels=["p", "t"], units=["Pa", "K"]
    )
    array = readings.to_xarray()
    assert array.dims == ("time", "channel", "taxel") and np.array_equal(array.values, readings.values)
    assert np.array_equal(array.sel(channel="t", taxel=dome_map.ids[9]), readings.values[:, 1, 9])
    assert array.sel(time=slice(0.1, 0.2)).shape[0] == 2 and array.coords["unit"].values.tolist() == ["Pa", "K"]


def test_whole_numbers_may_be_those_of_numpy(dome_map, tmp_path):
    layout = {"dermatome_layout": 1, "axes": ["episode", "frame", "taxel"], "time": {"rate": np.int32(10)}, "press": "raises", "zero": np.float64(0)}
    layout |= {"channels": [{"name": "pressure", "unit": "Pa"}], "taxels": {"shape": np.array([256]), "first_id": np.uint8(1)}}
    values = np.random.default_rng(1).random((2, 6, 256)).astype(np.float32)
    np.save(tmp_path / "a.npy", values)
    for number in (np.int64(1), np.uint8(1), np.arange(2)[1]):
        opened = dermatome.Readings.open(tmp_path / "a.npy", layout=layout, episode=number)
        parts = list(opened.chunks(frames=np.int16(4)))
        assert [len(part) for part in parts] == [4, 2] and opened.episode == 1
        assert np.array_equal(np.concatenate([part.values for part in parts])[:, 0], values[1])
    for wrong in (True, np.True_, 1.0, np.float64(1), -1, np.int8(-1), "1"):
        with pytest.raises(dermatome.DataError, match="episode: found"):
            dermatome.Readings.open(tmp_path / "a.npy", layout=layout, episode=wrong)
    for wrong in (True, 0, np.int64(0), 2.0):
        with pytest.raises(dermatome.DataError, match="frames: found"):
            opened.chunks(frames=wrong)
    readings, truth = dermatome.touch(dome_map, presses=np.int64(1), seed=np.uint16(3), rate=np.float32(20))
    same, _ = dermatome.touch(dome_map, presses=1, seed=3, rate=20.0)
    assert np.array_equal(readings.values, same.values)
    assert np.array_equal(readings.pooled(dome_map, np.int64(1)), readings.pooled(dome_map, 1))
    assert dome_map.renderer(np.int32(1), channels=np.int64(2)).shape == dome_map.renderer(1, channels=2).shape
    assert readings[np.int64(3)].timestamps == readings[3].timestamps


def test_what_cannot_be_written_leaves_the_file_before(tmp_path, monkeypatch):
    """A file is there as a whole: until it is, the one before stays, with its rights and behind its link."""
    readings = dermatome.Readings.from_arrays(np.ones((3, 5)), timestamps=[0, 1, 2], units="N")
    target, link = tmp_path / "real.npz", tmp_path / "link.npz"
    readings.write(target)
    target.chmod(0o640)
    link.symlink_to(target)
    before, savez = target.read_bytes(), np.savez

    def fails(path, **arrays):
        savez(path, **arrays)
        assert target.read_bytes() == before and path.name == "real.npz"
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", fails)
    with pytest.raises(dermatome.FileError, match="link.npz: cannot be written: .*No space left"):
        readings.with_values(np.zeros((3, 1, 5))).write(link)
    assert target.read_bytes() == before and sorted(p.name for p in tmp_path.iterdir()) == ["link.npz", "real.npz"]
    monkeypatch.undo()

    def stops(path, **arrays):
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", stops)
    with pytest.raises(KeyboardInterrupt):
        readings.write(tmp_path / "new.npz")
    assert not (tmp_path / "new.npz").exists() and len(list(tmp_path.iterdir())) == 2
    monkeypatch.undo()
    readings.with_values(np.zeros((3, 1, 5))).write(link)
    assert link.is_symlink() and target.stat().st_mode & 0o777 == 0o640 and not np.load(target)["values"].any()
    readings.write(tmp_path / "without")
    assert (tmp_path / "without.npz").exists()
    umask = os.umask(0o022)
    os.umask(umask)
    assert (tmp_path / "without.npz").stat().st_mode & 0o777 == 0o666 & ~umask
    with pytest.raises(dermatome.FileError, match="cannot be written"):
        readings.write(tmp_path / "none" / "a.npz")

"""Every public call with values of every kind in place of each of its arguments: what cannot be used is answered by an error of ours
that says what was found and what is needed; one of another type by an `ArgumentError` that begins with the argument."""

import importlib
import importlib.util
import inspect
import itertools
import json
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import lattice
from test_package import ADAPTERS, public

import dermatome



class Thing:
    def __init__(self, *given, **named):
        pass


#: What an argument may be given.
VALUES = {
    "None": None,
    "True": True,
    "-1": -1,
    "3": 3,
    "10**400": 10**400,
    "0.5": 0.5,
    "nan": float("nan"),
    "inf": float("inf"),
    "1j": 1j,
    "'word'": "word",
    "''": "",
    "b'word'": b"word",
    "object": object(),
    "class": Thing,
    "function": lambda *given, **named: None,
    "generator": (k for k in ()),
    "[]": [],
    "['a', 1]": ["a", 1],
    "[[1], [1, 2]]": [[1], [1, 2]],
    "[nan]": [float("nan")],
    "{}": {},
    "{'a': 1}": {"a": 1},
    "{1: 'a'}": {1: "a"},
    "{1.5}": {1.5},
    "path": Path("word"),
    "array()": np.array(3),
    "array('a')": np.array("a"),
    "array(2, 2)": np.ones((2, 2)),
    "array(1, 2, 2, 2)": np.ones((1, 2, 2, 2)),
    "array(str)": np.array(["a", "b"]),
    "array(None)": np.array([None, 1]),
    "datetime64": np.datetime64("2026-01-01"),
}

#: A sound call of each public function, method and class: its arguments by name. `Class.method` is called on what `ON` has.
CALLS = {
    "build": {"skin": "skin"},
    "calibrate": {"observations": "observed"},
    "check": {"source": "positions", "faces": "faces"},
    "coarsen": {"vertices": "positions", "faces": "faces"},
    "diff": {"before": "'before.csv'", "after": "'after.csv'"},
    "examine": {"map": "skin_map", "readings": "readings"},
    "flatten": {"vertices": "positions", "faces": "faces"},
    "follow": {"rows": "[]"},
    "order": {"map": "skin_map", "readings": "readings"},
    "response": {"map": "skin_map", "readings": "readings"},
    "simulate": {"taxels": "20"},
    "touch": {"skin": "skin_map", "presses": "1", "rate": "10.0", "duration": "0.3"},
    "touches": {"log": "log"},
    "ContactTracker": {"map": "skin_map"},
    "ContactTracker.track": {"values": "values"},
    "EventDetector": {"map": "skin_map"},
    "EventDetector.see": {"time": "0.0", "values": "values"},
    "RecordingFile": {"path": "'touch.csv'"},
    "RecordingFile.is_known": {"path": "'touch.csv'"},
    "RecordingFile.next": {"frames": "3"},
    "Calibration.skin": {},
    "BodyCalibration.write": {"path": "'bodies.csv'"},
    "Decoder.decode": {"raw": "raw"},
    "Index.locate": {"points": "points"},
    "Index.nearest": {"points": "points"},
    "Index.posed": {"poses": "{'hand': eye}"},
    "Index.ray": {"origins": "points", "directions": "[[0, 0, 1]]"},
    "Index.reactive": {"points": "points"},
    "Index.readings": {"points": "points", "force": "[1.0]"},
    "Index.within": {"points": "points", "radius": "0.01"},
    "Layout.decoder": {"file": "'a.npy'", "cells": "[16]"},
    "Layout.draft": {"file": "'a.npy'", "cells": "[16]"},
    "Layout.draft_columns": {"file": "'a.npy'", "names": "['a', 'b']"},
    "Layout.named_columns": {"file": "'a.npy'", "names": "['a', 'b']"},
    "Layout.parse": {"text": "layout.text"},
    "Layout.read": {"path": "'layout.json'"},
    "Map.carry_to": {"other": "skin_map"},
    "Map.export": {"path": "'level.obj'"},
    "Map.field_regions": {"level": "0"},
    "Map.fields": {"level": "1"},
    "Map.from_bytes": {"data": "skin_map.to_bytes()"},
    "Map.index": {},
    "Map.modality": {"channel": "'heat'"},
    "Map.n_fields": {"level": "0"},
    "Map.plot": {"width": "400"},
    "Map.pool": {"values": "values", "level": "1"},
    "Map.pool_regions": {"values": "values"},
    "Map.pooling": {"level": "1"},
    "Map.read": {"path": "'map.glb'"},
    "Map.renderer": {"size": "(8, 8)"},
    "Map.to_skin": {"patch": "'palm'", "uv": "[[0.0, 0.0]]"},
    "Map.with_regions": {"regions": "{'tip': [1]}"},
    "Map.write": {"path": "'again.glb'"},
    "Observations.from_columns": {"columns": "columns"},
    "Observations.read": {"path": "'contacts.csv'"},
    "Observations.write": {"path": "'again.csv'"},
    "Picture.save": {"path": "'a.svg'"},
    "Readings.by_area": {"map": "skin_map", "areas": "{'palm': 5}"},
    "Readings.by_region": {"map": "skin_map"},
    "Readings.condition": {"map": "skin_map"},
    "Readings.crop": {},
    "Readings.drop": {"ids": "[0]"},
    "Readings.features": {"map": "skin_map"},
    "Readings.from_arrays": {"values": "[[1.0, 2.0]]"},
    "Readings.from_pandas": {"table": "table"},
    "Readings.from_xarray": {"array": "readings.to_xarray()"},
    "Readings.modalities": {"map": "skin_map"},
    "Readings.on": {"map": "skin_map"},
    "Readings.open": {"path": "'touch.npz'"},
    "Readings.pooled": {"map": "skin_map", "level": "1"},
    "Readings.read": {"path": "'touch.npz'"},
    "Readings.resample": {"rate": "5.0"},
    "Readings.select": {"channels": "'force'"},
    "Readings.summary": {"map": "skin_map"},
    "Readings.to_xarray": {},
    "Readings.with_values": {"values": "readings.values"},
    "Readings.write": {"path": "'again.npz'"},
    "Readings.__getitem__": {"frames": "0"},
    "Recording.chunks": {},
    "Recording.read": {},
    "Recording.write_lerobot": {"path": "'lerobot'", "map": "skin_map"},
    "Recording.write_oxt": {"path": "'new.zarr'", "map": "skin_map", "areas": "{'palm': 5}"},
    "Renderer.matrix": {},
    "Renderer.pixels": {"hits": "hits"},
    "Renderer.to_skin": {"rows": "[1]", "columns": "[1]"},
    "Renderer.video": {"values": "np.ones((1, 16))", "path": "'a.gif'"},
    "Renderer.__call__": {"values": "values"},
    "Response.read": {"path": "'response.json'"},
    "Response.write": {"path": "'again.json'"},
    "Robot.poses": {},
    "Robot.read": {"path": "'arm.urdf'"},
    "Skin.from_arrays": {"positions": "positions", "faces": "faces"},
    "Skin.from_bytes": {"data": "skin.to_bytes()"},
    "Skin.from_mesh": {"mesh": "mesh"},
    "Skin.join": {"skins": "[skin]"},
    "Skin.read": {"path": "'palm.glb'"},
    "Skin.to_bytes": {},
    "Skin.write": {"path": "'again.glb'"},
    "genesis.probes": {"map": "skin_map"},
    "lerobot.features": {"map": "skin_map"},
    "lerobot.frame": {"map": "skin_map", "values": "values"},
    "lerobot.keys": {"map": "skin_map", "level": "0"},
    "lerobot.masks": {"map": "skin_map"},
    "mujoco.attach": {"spec": "spec()", "map": "skin_map", "body": "'ball'"},
    "mujoco.attach_all": {"spec": "spec()", "map": "skin_map", "bodies": "{'hand': 'ball'}"},
    "mujoco.readings": {"data": "felt", "sensor": "'palm'"},
    "mujoco.skin": {"model": "model"},
    "ray.Lookup": {"map": "skin_map.to_bytes()"},
    "ray.Render": {"map": "skin_map.to_bytes()", "folder": "'images'"},
    "ray.episodes": {"paths": "['touch.npz']"},
    "ros.read": {"path": "'bag'", "topic": "'/skin/points'", "map": "skin_map"},
    "ros.write": {"path": "'new_bag'", "map": "skin_map", "readings": "readings"},
    "torch.Augment": {"map": "skin_map", "shift": "0.001"},
    "torch.Draw": {"renderer": "draw"},
    "torch.Pool": {"map": "skin_map", "level": "1"},
    "torch.pixels": {"renderer": "draw"},
    "torch.pooling": {"map": "skin_map", "level": "1"},
    "torch.tensor": {"matrix": "skin_map.pooling(1)"},
    "torch.Touches": {"map": "skin_map", "readings": "readings", "size": "(8, 8)"},
    "trimesh.mesh": {"map": "skin_map"},
}

#: What methods are called on.
ON = {
    "BodyCalibration": "bodies", "Calibration": "calibration", "ContactTracker": "d.ContactTracker(skin_map)", "Decoder": "layout.decoder('a.npy', [16])",
    "EventDetector": "d.EventDetector(skin_map)", "Index": "index", "Layout": "layout", "Map": "skin_map", "Observations": "observed",
    "Picture": "skin_map.plot(width=400)", "Readings": "readings", "Recording": "d.Readings.open('touch.npz')", "RecordingFile": "d.RecordingFile('touch.csv')",
    "Renderer": "draw", "Response": "response", "Robot": "robot", "Skin": "skin",
}  # fmt: skip
#: Arguments that other packages take as they are.
THEIRS = {"build.progress", *(f"torch.{name}.{argument}" for name in ("pixels", "pooling", "tensor") for argument in ("device", "dtype"))}



#: Calls that are not swept: of objects of other packages, of containers alone, or under another name.
LEFT_OUT = {"ray.touch_counts", "ray.total", "Recording.raw", "rerun.log", "trimesh.skin"}
#: The package that a call needs.
NEEDS = {"mujoco": "mujoco", "ray": "pyarrow", "ros": "rosbags", "torch": "torch", "trimesh": "trimesh", "Readings.from_pandas": "pandas", "Readings.from_xarray": "xarray", "Readings.to_xarray": "xarray", "Recording.write_lerobot": "lerobot", "Recording.write_oxt": "numcodecs", "Renderer.video": "imageio"}
LAYOUT = {"dermatome_layout": 1, "axes": ["frame", "taxel"], "time": {"rate": 50}, "channels": [{"name": "pressure", "unit": "count"}], "press": "raises", "zero": 0, "taxels": {"shape": [16], "first_id": 1}}
SCENE = '<mujoco><worldbody><geom type="plane" size="1 1 .1" pos="0 0 -1"/><body name="ball"><freejoint/><geom type="sphere" size="0.015" mass="0.01"/></body></worldbody></mujoco>'


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """What the calls are made of, in a folder with the files that they read."""
    folder = tmp_path_factory.mktemp("kinds")
    positions, faces = lattice(4, 4)
    skin = dermatome.Skin.from_arrays(positions, faces, patch="palm", link="hand")
    skin_map, values = dermatome.build(skin, coarsest=4), np.linspace(0, 1, 16)
    readings = dermatome.Readings.from_arrays(np.stack([values] * 9), channels="force", units="N", timestamps=np.arange(9) / 10)
    columns = {"i": np.arange(1, 17), "x": positions[:, 0], "y": positions[:, 1], "z": positions[:, 2], "sigma": np.full(16, 1e-3)}
    observed, layout = dermatome.Observations.from_columns(columns), dermatome.Layout.parse(json.dumps(LAYOUT))
    still = {"x": [0, 0], "y": [0, 0], "z": [0, 0], "qx": [0, 0], "qy": [0, 0], "qz": [0, 0], "qw": [1, 1]}
    made = {
        "d": dermatome, "np": np, "positions": positions, "faces": faces, "skin": skin, "skin_map": skin_map, "values": values, "eye": np.eye(4),
        "readings": readings, "points": positions[:1], "columns": columns, "observed": observed, "index": skin_map.index(reactive=True, fields=True),
        "mesh": SimpleNamespace(vertices=positions, faces=faces), "draw": skin_map.renderer(size=(8, 8)), "response": dermatome.examine(skin_map, readings)[1], "layout": layout,
        "calibration": dermatome.calibrate(observed), "bodies": dermatome.calibrate(observed, cad=skin, level="mount"), "raw": np.zeros((2, 16)),
        "log": {"px": [0, 0.01], "py": [0, 0], "pz": [0, 0], **still, "touch": [1, 2], "taxels": [[7, 8], [8, 9]]},
    }  # fmt: skip
    made["hits"] = made["index"].locate(positions[:1])
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        files(made)
        yield made


def files(made):
    """The files that calls read."""
    made["skin"].write("palm.glb")
    made["skin_map"].write("map.glb")
    made["readings"].write("touch.npz")
    Path("touch.csv").write_text("0.1,0.2,0.3\n0.2,0.2,0.3\n")
    Path("layout.json").write_text(made["layout"].text)
    np.save("a.npy", made["raw"])
    Path("arm.urdf").write_text('<robot name="a"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/><limit lower="-1" upper="1"/></joint></robot>')
    made["robot"] = dermatome.Robot.read("arm.urdf")
    made["observed"].write("contacts.csv")
    made["response"].write("response.json")
    for name in ("before.csv", "after.csv"):
        Path(name).write_text("id,x,y,z,sxx,sxy,sxz,syy,syz,szz\n1,0,0,0,1e-6,0,0,1e-6,0,1e-6\n")
    if importlib.util.find_spec("pandas"):
        import pandas

        made["table"] = pandas.DataFrame([[1.0, 2.0], [3.0, 4.0]], index=[0.0, 0.1], columns=[7, 8])
    if importlib.util.find_spec("rosbags"):
        importlib.import_module("dermatome.ros").write("bag", made["skin_map"], made["readings"][:1])
    if importlib.util.find_spec("mujoco"):
        import mujoco

        made["spec"] = lambda: mujoco.MjSpec.from_string(SCENE)
        spec = made["spec"]()
        importlib.import_module("dermatome.mujoco").attach(spec, made["skin_map"], body="ball")
        made["model"] = spec.compile()
        made["felt"] = mujoco.MjData(made["model"])


def called(name, names):
    """What is called under a name."""
    of, _, member = name.rpartition(".")
    if of in ADAPTERS:
        return getattr(importlib.import_module(f"dermatome.{of}"), member)
    if not of or isinstance(inspect.getattr_static(getattr(dermatome, of), member), staticmethod):
        return getattr(getattr(dermatome, of) if of else dermatome, member)
    return getattr(eval(ON[of], names), member)


def taken(call, arguments):
    """Calls it, and takes some of what it makes one after the other."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = call(**arguments)
        if isinstance(made, Iterator):
            list(itertools.islice(made, 3))


def refused(argument, error):
    """What is wrong with an answer, or None."""
    # What is beyond the end of a sequence is Python's own error.
    if not isinstance(error, dermatome.Error):
        return None if isinstance(error, IndexError) and argument == "frames" else "an error of another"
    if isinstance(error, dermatome.ArgumentError) and not re.match(rf"{argument}\b", str(error)):
        return "another argument"
    if error.kind == "argument" and not re.search(r"^\S.*?: found [^;]*.*; needed: \S", str(error), re.DOTALL):
        return "no found and needed"
    return None


@pytest.mark.parametrize("name", CALLS)
def test_what_cannot_be_used_is_said(name, names):
    missing = NEEDS.get(name) or NEEDS.get(name.split(".")[0])
    if missing:
        pytest.importorskip(missing)
    call = called(name, names)
    try:
        taken(call, {argument: eval(source, names) for argument, source in CALLS[name].items()})
    except dermatome.Error as error:  # Of arguments that are right, data may be too few.
        assert error.kind != "argument"
    foreign = []
    for argument in takes(call):
        for said, value in VALUES.items():
            if f"{name}.{argument}" in THEIRS:
                continue
            arguments = {known: eval(source, names) for known, source in CALLS[name].items()} | {argument: value}
            try:
                taken(called(name, names), arguments)
            except Exception as error:
                if wrong := refused(argument, error):
                    foreign.append(f"{argument}={said}: {wrong}: {type(error).__name__}: {str(error)[:150]}")
    assert foreign == []


def test_every_public_call_is_swept():
    known = set()
    for name, thing in public():
        if callable(thing) and not inspect.isclass(thing) and name.split(".")[0] not in ("ArgumentError",) and takes(thing):
            known.add(name)
    for module in ADAPTERS:
        for member in importlib.import_module(f"dermatome.{module}").__all__:
            known.add(f"{module}.{member}")
    assert known - CALLS.keys() == LEFT_OUT


def takes(thing):
    """The arguments of a call; those of an object of the extension are not written down."""
    found = [each for each in inspect.signature(thing).parameters if each != "self"]
    return ["values", "threads"] if found == ["args", "kwargs"] else found

"""What type checkers say: nothing of right programs, and something of each mistake."""

import functools
import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
PROJECT = Path(__file__).parents[1] / "pyproject.toml"
USE = """# pyright: strict
import numpy as np
import dermatome, dermatome.mujoco, dermatome.ray, dermatome.ros

skin = dermatome.Skin.from_arrays(np.zeros((9, 3)), patch=["a"] * 9, outside=(0, 0, 1))
skin_map = dermatome.build(skin, cut=[[1, 2]], progress=lambda stage, done, count: print(stage))
index = skin_map.index(reactive=True, fields=True)
hits = index.locate([[0, 0, 0.1]], only_link=["hand"], level=1)
readings, truth = dermatome.touch(skin_map, presses=2)
renderer = skin_map.renderer(0, size=[64, 64], extensive=readings.extensive, pack="body")
rows, columns = renderer.pixels(hits).T
part: dermatome.Readings = readings[3:5]
shapes = [one.values.shape for one in readings]
part.condition(skin_map, scale=np.ones(9), baseline=3, gain={1: 2.0}, clip=[0, 1], units="N")
part.condition(skin_map, gain=np.ones(9), baseline=[0.5] * 9, units=["N"], zero="follow")
def taxels_of(message: np.ndarray[tuple[int], np.dtype[np.uint32]]) -> np.ndarray[tuple[int], np.dtype[np.uint32]]:
    return message
dermatome.ros.read("bag", "/skin", skin_map, values="pressure", ids=taxels_of, units="N", stamp="header")
dermatome.ros.read("bag", "/skin", skin_map, values=["force", "heat"], channels=["force", "heat"])
contacts, summary = dermatome.touches({"px": [0.0], "py": np.zeros(1), "taxels": [{1: 2.0}]}, skin=skin, radius=0.01)
taxels: dermatome.Calibration = dermatome.calibrate(contacts, robust="gnc")
bodies: dermatome.BodyCalibration = dermatome.calibrate("contacts.csv", cad="skin.glb", modules={1: "a"}, fit_probe=True)
moved: list[float] = [body.moved for body in bodies.bodies]
following = dermatome.follow(open("contacts.csv"), cad=skin, every=10)
known: list[bool | None] = [touch.fits for touch in following]
dermatome.follow([{"i": 1, "x": 0.0}]).result.covariances
rows_of = dermatome.ray.episodes(["a.zarr"], layout="layout.json")
dermatome.ray.Render(skin_map.to_bytes(), "out", 1, {"size": (64, 96)}, layout="layout.json")(rows_of[0])
dermatome.mujoco.readings(None, dermatome.mujoco.attach_all(None, skin_map, bodies={"hand": "palm"}))
"""
MISTAKES = [
    "dermatome.Skin()",
    "dermatome.touch(skin_map, press=3)",
    'dermatome.build(skin, cut="maybe")',
    "dermatome.build(skin, progress=3)",
    "skin_map.renderer(0, size=64)",
    "skin_map.renderer(0, pack='loose')",
    "skin_map.pool(readings, 1)",
    "index.locate([[0, 0, 0]], levels=1)",
    'dermatome.calibrate(contacts, cad=skin, robust="gnc")',
    "dermatome.calibrate(contacts, folds=3)",
    "bodies.chi2 = 3.0",
    'dermatome.touches("log.csv", probe=0.01)',
    "dermatome.follow(3)",
    "hits.distances",
    "hits.fields.scipy()",
    "hits.uv = hits.uv",
    "renderer.to_skin(rows)",
    'dermatome.Readings.read("a.npy", layout="nct")',
    "part.condition(skin_map, gains=3)",
    'part.condition(skin_map, zero="tracks")',
    'part.units = ("N",)',
    'dermatome.ros.read("bag", "/skin", skin_map, stamp="clock")',
    'dermatome.ros.write("bag", skin_map, part, level="1")',
    "dermatome.mujoco.readings(None, 3)",
    "dermatome.mujoco.skin(None, outter=True)",
    "dermatome.trimesh.skin(None, links='hand')",
    "dermatome.lerobot.features(skin_map, images=[1])",
]


def mypy(*files, cwd):
    """The lines of each file of which mypy says that they are wrong, and all that it says. What it knows of numpy is kept for the next call."""
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(cwd / "cache"), *map(str, files)]
    said = subprocess.run(command, capture_output=True, text=True, cwd=cwd)
    wrong = [line.split(":")[:2] for line in said.stdout.splitlines() if " error: " in line]
    assert bool(wrong) == bool(said.returncode), said.stdout + said.stderr
    return by_file((name, int(line)) for name, line in wrong), said.stdout


def pyright(*files, cwd):
    """The same of pyright."""
    pytest.importorskip("pyright")
    command = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, "--outputjson", *map(str, files)]
    said = subprocess.run(command, capture_output=True, text=True, cwd=cwd)
    assert said.stdout.startswith("{"), said.stdout + said.stderr
    found = [each for each in json.loads(said.stdout)["generalDiagnostics"] if each["severity"] == "error"]
    return by_file((each["file"], each["range"]["start"]["line"] + 1) for each in found), str(found)


def by_file(lines):
    made = {}
    for name, line in lines:
        made.setdefault(Path(name).name, set()).add(line)
    return made


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Right and wrong programs and the examples whose packages are there."""
    made = tmp_path_factory.mktemp("types")
    (made / "use.py").write_text(USE)
    (made / "wrong.py").write_text(USE + "import dermatome.lerobot, dermatome.trimesh\n" + "\n".join(MISTAKES))
    for example in EXAMPLES.glob("*.py"):
        if all(name not in example.read_text() or importlib.util.find_spec(name) for name in ("torch", "mujoco")):
            (made / example.name).write_text(example.read_text())
    return made


@pytest.fixture(scope="module")
def check(folder):
    """What a checker says of all of them at once."""
    return functools.cache(lambda checker: checker(*sorted(folder.glob("*.py")), cwd=folder))


@pytest.mark.parametrize("checker, arguments", [(mypy, ["-p", "dermatome"]), (pyright, ["--project", PROJECT])])
def test_the_package_is_typed(checker, arguments, folder):
    lines, said = checker(*arguments, cwd=folder)
    assert not lines, said


@pytest.mark.parametrize("checker", [mypy, pyright])
def test_checkers_find_mistakes_and_nothing_else(checker, check):
    lines, said = check(checker)
    assert "use.py" not in lines, said
    first = USE.count("\n") + 2
    assert [MISTAKES[k] for k in range(len(MISTAKES)) if first + k not in lines["wrong.py"]] == [] and min(lines["wrong.py"]) == first, said


@pytest.mark.parametrize("checker", [mypy, pyright])
@pytest.mark.parametrize("example", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_examples_are_typed(example, checker, check, folder):
    if not (folder / example.name).is_file():
        pytest.skip("needs torch or mujoco")
    lines, said = check(checker)
    assert example.name not in lines, said

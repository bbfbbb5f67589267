"""The package: its command, its types, its documentation."""

import doctest
import inspect
import subprocess
import sys
from pathlib import Path

import dermatome
from dermatome import _dermatome


def command(*args, **options):
    return subprocess.run([sys.executable, "-m", "dermatome", *args], capture_output=True, text=True, **options)


def test_the_command_is_in_the_package(tmp_path):
    said = command("--version")
    assert (said.returncode, said.stdout) == (0, f"dermatome {dermatome.__version__}\n")
    wrong = command("build", "no.glb", "-o", str(tmp_path), "--quiet")
    assert wrong.returncode == 2 and "no.glb" in wrong.stderr and wrong.stdout == ""
    skin = dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)])
    skin.write(tmp_path / "palm.glb")
    assert command("build", str(tmp_path / "palm.glb"), "-o", str(tmp_path / "out"), "--quiet").returncode == 0
    assert dermatome.Map.read(tmp_path / "out" / "map.glb") == dermatome.build(tmp_path / "palm.glb")
    script = Path(sys.executable).parent / "dermatome"
    assert subprocess.run([script, "--version"], capture_output=True).returncode == 0


def test_the_import_needs_no_other_package():
    code = "import sys, dermatome; print([m for m in ('numpy', 'scipy', 'torch', 'trimesh') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "[]\n"


def public():
    for name in dermatome.__all__:
        thing = getattr(dermatome, name)
        if callable(thing):
            yield name, thing
        if inspect.isclass(thing):
            for member, value in vars(thing).items():
                if not member.startswith("_"):
                    yield f"{name}.{member}", value


def test_every_public_name_is_documented():
    assert [name for name, thing in public() if not inspect.getdoc(thing)] == []


def test_examples_run():
    runner, parser = doctest.DocTestRunner(), doctest.DocTestParser()
    examples = 0
    for name, thing in public():
        text = inspect.getdoc(thing) or ""
        test = parser.get_doctest(text, {}, name, None, None)
        examples += len(test.examples)
        runner.run(test)
    assert runner.summarize().failed == 0
    assert examples > 20


def test_stubs_are_those_of_the_module():
    said = subprocess.run(
        [sys.executable, "-m", "mypy.stubtest", "dermatome._dermatome"],
        capture_output=True,
        text=True,
    )
    assert said.returncode == 0, said.stdout + said.stderr


USE = """
import numpy as np
import dermatome, dermatome.lerobot, dermatome.mujoco, dermatome.ros

skin_map = dermatome.Map.read("map.glb")
readings, truth = dermatome.touch(skin_map, presses=2)
part: dermatome.Readings = readings[3:5]
shapes = [one.values.shape for one in readings]
part.condition(skin_map, scale=np.ones(9), baseline=3, gain={1: 2.0}, clip=[0, 1], units="N")
part.condition(skin_map, gain=np.ones(9), baseline=[0.5] * 9, units=["N"])
dermatome.ros.read("bag", "/skin", skin_map, values="pressure", ids=lambda message: message.ids, units="N", stamp="header")
dermatome.ros.read("bag", "/skin", skin_map, values=["force", "heat"], channels=["force", "heat"])
dermatome.mujoco.readings(None, dermatome.mujoco.attach_all(None, skin_map, bodies={"hand": "palm"}))
"""
MISTAKES = [
    "dermatome.touch(skin_map, press=3)",
    'dermatome.Readings.read("a.npy", layout="nct")',
    "part.condition(skin_map, gains=3)",
    'part.units = ("N",)',
    'dermatome.ros.read("bag", "/skin", skin_map, stamp="clock")',
    'dermatome.ros.write("bag", skin_map, part, level="1")',
    "dermatome.mujoco.readings(None, 3)",
    "dermatome.lerobot.features(skin_map, images=[1])",
]


def test_types_are_strict_and_find_mistakes(tmp_path):
    (tmp_path / "use.py").write_text(USE)
    (tmp_path / "wrong.py").write_text(USE + "\n".join(MISTAKES))
    strict = [sys.executable, "-m", "mypy", "--strict"]
    for what in (["-p", "dermatome"], ["use.py"]):
        said = subprocess.run([*strict, *what], capture_output=True, text=True, cwd=tmp_path)
        assert said.returncode == 0, said.stdout
    said = subprocess.run([*strict, "wrong.py"], capture_output=True, text=True, cwd=tmp_path).stdout
    found = {int(line.split(":")[1]) for line in said.splitlines() if " error: " in line}
    first = USE.count("\n") + 1
    assert found == set(range(first, first + len(MISTAKES))), said


def test_types_are_final_and_frozen():
    for name in ("Skin", "Robot", "Map", "Patch", "Level", "Index"):
        thing = getattr(_dermatome, name)
        assert thing.__module__ == "dermatome"

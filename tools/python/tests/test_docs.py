"""The Python blocks of the documentation and the cells of the notebooks, run as a user would: one after the other, next to
the folder `meshes`. Blocks that import a package which is not there are skipped by name, and those of recordings without the
samples of DERMATOME_DATA."""

import ast
import builtins
import contextlib
import doctest
import importlib.util
import inspect
import io
import json
import os
import re
import shutil
import subprocess
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import dermatome

ROOT = Path(__file__).parents[3]
SAMPLES = Path(os.environ.get("DERMATOME_DATA", "")) / "recordings"
NOTEBOOKS = sorted((ROOT / "tools" / "python" / "examples").glob("*.ipynb"))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "meshes").mkdir()
    for name in ("forearm.glb", "arm.urdf", "hand.glb", "robot_hand.glb", "hands.csv"):
        shutil.copy(ROOT / "meshes" / name, tmp_path / "meshes")
    if SAMPLES.is_dir():
        for name, sample in {"layouts": "layouts", "lerobot_v3": "lerobot_v3", "bag": "ros/bag_sqlite"}.items():
            shutil.copytree(SAMPLES / sample, tmp_path / name)
        shutil.copy(SAMPLES / "hdf5/opentouch_like.hdf5", tmp_path / "glove.hdf5")
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def ros(monkeypatch):
    """A stand-in of ROS 2, whose `spin` sends three messages; what is published."""
    published, taken = [], []

    class Node:
        def __init__(self, name):
            self.name = name

        def create_publisher(self, kind, topic, depth):
            return SimpleNamespace(publish=published.append)

        def create_subscription(self, kind, topic, take, depth):
            taken.append(take)

    def spin(node):
        for k in range(3):
            taken[0](SimpleNamespace(data=np.full(1000, k, dtype=np.float32)))

    parts = {
        "rclpy": {"init": lambda: None, "spin": spin},
        "rclpy.node": {"Node": Node},
        "sensor_msgs.msg": {"Image": SimpleNamespace},
        "std_msgs.msg": {"Float32MultiArray": SimpleNamespace},
    }
    for name, members in parts.items():
        for path in (name.split(".")[0], name):
            module = sys.modules.get(path) or ModuleType(path)
            module.__spec__, module.__path__ = ModuleSpec(path, None), []
            monkeypatch.setitem(sys.modules, path, module)
        vars(sys.modules[name]).update(members)
    return published


def run(blocks, page, say):
    names = {"__name__": "page"}
    for number, block in enumerate(blocks):
        needed = re.findall(r"^import (\w+)", block, re.MULTILINE)
        missing = [name for name in needed if importlib.util.find_spec(name) is None]
        if "Readings.open(" in block and not SAMPLES.is_dir():
            missing.append("DERMATOME_DATA/recordings")
        if missing:
            print(f"{page}: skipped a block that needs {', '.join(missing)}")
            say(f"block {number}", f"needs {', '.join(missing)}")
        else:
            say(f"block {number}", "ran")
            exec(compile(block, page, "exec"), names)


@pytest.mark.parametrize("page", ["README.md", "docs/python.md", "docs/behaviours.md", "docs/atlas.md"])
def test_blocks_run(page, folder, ros, record_property):
    text = (ROOT / page).read_text()
    blocks = [block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "touch.npz" not in block]
    assert blocks
    run(blocks, page, record_property)
    if any("rclpy" in block for block in blocks):
        drawn = [np.frombuffer(image.data, np.float32).reshape(image.height, image.width) for image in ros]
        assert [image.max() for image in drawn] == [0, 1, 2]


ALONE = """
import sys
from importlib.abc import MetaPathFinder

class Others(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.split(".")[0] not in {*sys.stdlib_module_names, "dermatome", "numpy"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Others())
"""


def test_readme_of_the_index_needs_the_package_alone(tmp_path):
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "tools/python/README.md").read_text(), re.DOTALL)
    said = subprocess.run([sys.executable, "-c", ALONE + "".join(blocks)], cwd=tmp_path, capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"map.glb", "touch.png"} and len(blocks) > 1
    links = re.findall(r"\]\(([^)]+)\)", (ROOT / "tools/python/README.md").read_text())
    assert links and [link for link in links if not (ROOT / "tools/python" / link).is_file()] == []


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.name)
def test_notebooks_show_what_their_cells_do(notebook, folder):
    """Their outputs are stored (`jupyter nbconvert --to notebook --execute --inplace NOTEBOOK`), and are those of today."""
    cells = [cell for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"]
    names, figures = {"__name__": "page"}, 0
    for cell in cells:
        *steps, last = ast.parse("".join(cell["source"])).body
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile(ast.Module(steps, []), notebook.name, "exec"), names)
            is_shown = isinstance(last, ast.Expr)
            shown = eval(compile(ast.Expression(last.value), notebook.name, "eval"), names) if is_shown else None
            if not is_shown:
                exec(compile(ast.Module([last], []), notebook.name, "exec"), names)
        stored = "".join("".join(output["text"]) for output in cell["outputs"] if output["output_type"] == "stream")
        assert stored == printed.getvalue()
        pictures = ["".join(output["data"]["image/svg+xml"]) for output in cell["outputs"] if "data" in output]
        assert len(pictures) == (shown is not None)
        for picture in pictures:
            figures += 1
            assert picture.splitlines()[0] == shown.svg().splitlines()[0] and len(picture) == pytest.approx(len(shown.svg()), rel=0.02)
    assert figures > 2


def test_examples_shadow_no_builtin():
    sources = [(path.name, path.read_text()) for path in (ROOT / "tools/python/examples").glob("*.py")]
    sources += [(path.name, "\n".join("".join(cell["source"]) for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == "code")) for path in NOTEBOOKS]
    for page in ("README.md", "docs/python.md", "tools/python/README.md"):
        sources += [(page, block) for block in re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), re.DOTALL)]
    for thing in [dermatome, *vars(dermatome).values()]:
        sources += [(str(thing), example.source) for example in doctest.DocTestParser().get_examples(inspect.getdoc(thing) or "")]
    for name, source in sources:
        stored = {node.id for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
        # Torch puts `_` among the builtins.
        shadowed = stored & (set(dir(builtins)) - {"_"})
        assert not shadowed, f"{name}: {shadowed}"

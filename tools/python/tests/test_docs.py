"""The Python blocks of the documentation and the cells of the notebooks, run as a user would: one after the other, next to
the folder `meshes`. Blocks that import a package which is not there are skipped by name, and those of recordings without the
samples of DERMATOME_DATA."""

import importlib.util
import json
import os
import re
import shutil
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

ROOT = Path(__file__).parents[3]
SAMPLES = Path(os.environ.get("DERMATOME_DATA", "")) / "recordings"
NOTEBOOKS = sorted((ROOT / "tools" / "python" / "examples").glob("*.ipynb"))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "meshes").mkdir()
    for name in ("forearm.glb", "arm.urdf"):
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


def run(blocks, page):
    names = {"__name__": "page"}
    for block in blocks:
        needed = re.findall(r"^import (\w+)", block, re.MULTILINE)
        missing = [name for name in needed if importlib.util.find_spec(name) is None]
        if "Readings.open(" in block and not SAMPLES.is_dir():
            missing.append("DERMATOME_DATA/recordings")
        if missing:
            print(f"{page}: skipped a block that needs {', '.join(missing)}")
        else:
            exec(compile(block, page, "exec"), names)


@pytest.mark.parametrize("page", ["README.md", "docs/python.md", "tools/python/README.md"])
def test_blocks_run(page, folder, ros):
    text = (ROOT / page).read_text()
    blocks = [block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "touch.npz" not in block]
    assert blocks
    run(blocks, page)
    if any("rclpy" in block for block in blocks):
        drawn = [np.frombuffer(image.data, np.float32).reshape(image.height, image.width) for image in ros]
        assert [image.max() for image in drawn] == [0, 1, 2]


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.name)
def test_notebooks_run(notebook, folder):
    cells = [cell for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"]
    assert cells and not any(cell["outputs"] or cell["execution_count"] for cell in cells)
    run(["".join(cell["source"]) for cell in cells], notebook.name)

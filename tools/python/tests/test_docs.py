"""The Python blocks of the documentation and the cells of the notebooks, run as a user would: one after the other, next to
the folder `meshes`. Blocks that import a package which is not there are skipped by name."""

import importlib.util
import json
import re
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
NOTEBOOKS = sorted((ROOT / "tools" / "python" / "examples").glob("*.ipynb"))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "meshes").mkdir()
    for name in ("forearm.glb", "arm.urdf"):
        shutil.copy(ROOT / "meshes" / name, tmp_path / "meshes")
    monkeypatch.chdir(tmp_path)


def run(blocks, page):
    names = {"__name__": "page"}
    for block in blocks:
        needed = re.findall(r"^import (\w+)", block, re.MULTILINE)
        missing = [name for name in needed if importlib.util.find_spec(name) is None]
        if missing:
            print(f"{page}: skipped a block that needs {', '.join(missing)}")
        else:
            exec(compile(block, page, "exec"), names)


@pytest.mark.parametrize("page", ["README.md", "docs/python.md", "tools/python/README.md"])
def test_blocks_run(page, folder):
    text = (ROOT / page).read_text()
    blocks = [block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "touch.npz" not in block]
    assert blocks
    run(blocks, page)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.name)
def test_notebooks_run(notebook, folder):
    cells = [cell for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"]
    assert cells and not any(cell["outputs"] or cell["execution_count"] for cell in cells)
    run(["".join(cell["source"]) for cell in cells], notebook.name)

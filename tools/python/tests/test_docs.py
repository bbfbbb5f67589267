"""The Python blocks of the documentation, run as a user would: one after the other, next to the folder `meshes`."""

import re
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("page", ["README.md", "docs/python.md", "tools/python/README.md"])
def test_blocks_run(page, tmp_path, monkeypatch):
    (tmp_path / "meshes").mkdir()
    shutil.copy(ROOT / "meshes" / "forearm.glb", tmp_path / "meshes")
    monkeypatch.chdir(tmp_path)
    text = (ROOT / page).read_text()
    blocks = [block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "touch.npz" not in block]
    assert blocks
    names = {}
    for block in blocks:
        exec(compile(block, page, "exec"), names)

"""Writes the pages that follow from the package: python pages.py SOURCE."""

import ast
import importlib.util
import inspect
import sys
from pathlib import Path

import dermatome

ADAPTERS = ("genesis", "lerobot", "mujoco", "ray", "rerun", "ros", "torch", "trimesh")


def pages(source: Path, title: str, names: list[str], directive: str) -> str:
    """A page for each of these names of the package, and the list of them with their first sentences."""
    text = f"## {title}\n\n| | |\n|---|---|\n"
    for name in names:
        # The fields of a named tuple are documented by its class.
        is_tuple = hasattr(getattr(dermatome, name), "_fields")
        members = "   :members:\n" if directive == "autoclass" and not is_tuple else ""
        body = f"# dermatome.{name}\n\n```{{eval-rst}}\n.. {directive}:: dermatome.{name}\n{members}```\n"
        (source / "api" / f"{name}.md").write_text(body)
        first = (inspect.getdoc(getattr(dermatome, name)) or "").split("\n\n")[0].replace("\n", " ")
        text += f"| [{name}](api/{name}.md) | {first} |\n"
    return text + "\n```{toctree}\n:hidden:\n\n" + "\n".join(f"api/{name}" for name in names) + "\n```\n\n"


def adapter(name: str) -> str:
    """What an adapter says of itself and of its functions, read from its text: its package need not be installed."""
    found = importlib.util.find_spec(f"dermatome.{name}")
    assert found and found.origin
    tree = ast.parse(Path(found.origin).read_text())
    text = f"### dermatome.{name}\n\n{ast.get_docstring(tree)}\n\n"
    for node in tree.body:
        documented = isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_")
        if documented and (says := ast.get_docstring(node)):
            kind = "class " if isinstance(node, ast.ClassDef) else ""
            arguments = f"({ast.unparse(node.args)})" if isinstance(node, ast.FunctionDef) else ""
            text += f"```python\n{kind}{node.name}{arguments}\n```\n\n```text\n{says}\n```\n\n"
    return text


def main(source: Path) -> None:
    public = [name for name in dermatome.__all__ if not name.startswith("_")]
    classes = [name for name in public if isinstance(getattr(dermatome, name), type)]
    functions = [name for name in public if name not in classes]
    (source / "api").mkdir()
    api = "# The Python package, name by name\n\n" + pages(source, "Functions", functions, "autofunction")
    api += pages(source, "Classes", classes, "autoclass")
    api += "## Adapters\n\n" + "".join(adapter(name) for name in ADAPTERS)
    (source / "api.md").write_text(api)
    readme = (source / "README.md").read_text()
    documents = sorted(path.stem for path in (source / "docs").glob("*.md"))
    notes = sorted(f"docs/notes/{path.stem}" for path in (source / "docs" / "notes").glob("*.md"))
    lists = {
        "Documents": [f"docs/{name}" for name in documents],
        "Reference": ["api", "gallery"],
        "Project": ["meshes/README", "ARCHITECTURE", "BENCHMARKS", "CONTRIBUTING", "CHANGELOG", "REFERENCES", *notes],
    }
    for caption, entries in lists.items():
        readme += f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n" + "\n".join(entries) + "\n```\n"
    (source / "index.md").write_text(readme)
    (source / "README.md").unlink()


if __name__ == "__main__":
    main(Path(sys.argv[1]))

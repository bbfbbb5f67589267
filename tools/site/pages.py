"""Writes the pages that follow from the package: python pages.py SOURCE."""

import ast
import copy
import importlib.util
import inspect
import sys
from pathlib import Path

from sphinx.ext.napoleon import Config, NumpyDocstring

import dermatome

# Documents as somebody new reads them; what is looked up comes after.
FIRST = ("python", "recordings", "pressure_mapping", "response", "touches", "experiment", "behaviours", "design", "atlas")
ADAPTERS = ("genesis", "lerobot", "mujoco", "ray", "rerun", "ros", "torch", "trimesh")


def pages(source: Path, title: str, names: list[str], directive: str) -> str:
    """A page for each of these names of the package, and the list of them with their first sentences."""
    text = f"## {title}\n\n| | |\n|---|---|\n"
    for name in names:
        # The fields of a named tuple are documented by its class.
        is_tuple = hasattr(getattr(dermatome, name), "_fields")
        members = "   :members:\n" if directive == "autoclass" and not is_tuple else ""
        body = f"# {name}\n\n```{{eval-rst}}\n.. {directive}:: dermatome.{name}\n{members}```\n"
        (source / "api" / f"{name}.md").write_text(body)
        first = (inspect.getdoc(getattr(dermatome, name)) or "").split("\n\n")[0].replace("\n", " ")
        text += f"| [{name}](api/{name}.md) | {first} |\n"
    return text + "\n```{toctree}\n:hidden:\n\n" + "\n".join(f"api/{name}" for name in names) + "\n```\n\n"


def adapters(source: Path) -> str:
    """A page for each adapter, read from its text, since its package need not be installed; and the list of them."""
    text = "## Adapters\n\n| | |\n|---|---|\n"
    for name in ADAPTERS:
        says, body = adapter(name)
        page = f"# dermatome.{name}\n\n```{{eval-rst}}\n.. py:module:: dermatome.{name}\n\n{says}\n\n{body}\n```\n"
        (source / "api" / f"dermatome.{name}.md").write_text(page)
        text += f"| [dermatome.{name}](api/dermatome.{name}.md) | {says.split(chr(10) * 2)[0].replace(chr(10), ' ')} |\n"
    return text + "\n```{toctree}\n:hidden:\n\n" + "\n".join(f"api/dermatome.{name}" for name in ADAPTERS) + "\n```\n"


def adapter(name: str) -> tuple[str, str]:
    """What an adapter says of itself, and its public functions and classes as Sphinx describes them."""
    found = importlib.util.find_spec(f"dermatome.{name}")
    assert found and found.origin
    # Its classes may stand in files of their own, which need the package.
    files = [Path(found.origin), *sorted(Path(found.origin).parent.glob(f"_{name}*.py"))]
    trees = [ast.parse(path.read_text()) for path in files]
    public = {element.value for node in ast.walk(trees[0]) if isinstance(node, ast.List) for element in node.elts if isinstance(element, ast.Constant)}
    text = ""
    for node in (node for tree in trees for node in tree.body):
        documented = isinstance(node, (ast.FunctionDef, ast.ClassDef)) and node.name in public
        if documented and (says := ast.get_docstring(node)):
            made = [each for each in node.body if isinstance(each, ast.FunctionDef) and each.name == "__init__"] if isinstance(node, ast.ClassDef) else [node]
            kind = "class" if isinstance(node, ast.ClassDef) else "function"
            text += f".. py:{kind}:: {node.name}({', '.join(map(plain, made))})\n\n"
            lines = str(NumpyDocstring(says, Config(napoleon_use_rtype=False))).splitlines()
            text += "".join(f"   {line}\n" if line else "\n" for line in lines) + "\n"
    return ast.get_docstring(trees[0]) or "", text


def plain(function: ast.FunctionDef) -> str:
    """The arguments without types, which the docstring has."""
    arguments = copy.deepcopy(function.args)
    for argument in [*arguments.args, *arguments.kwonlyargs]:
        argument.annotation = None
    arguments.args = [argument for argument in arguments.args if argument.arg != "self"]
    return ast.unparse(arguments)


def main(source: Path) -> None:
    public = [name for name in dermatome.__all__ if not name.startswith("_")]
    types = {name: getattr(dermatome, name) for name in public if isinstance(getattr(dermatome, name), type)}
    errors = [name for name, each in types.items() if issubclass(each, Exception)]
    classes, functions = ([name for name in names if name not in errors] for names in (types, [name for name in public if name not in types]))
    (source / "api").mkdir()
    api = "# The Python package, name by name\n\n" + pages(source, "Functions", functions, "autofunction")
    api += pages(source, "Classes", classes, "autoclass") + pages(source, "Errors and warnings", errors, "autoclass")
    api += adapters(source)
    (source / "api.md").write_text(api)
    readme = (source / "README.md").read_text()
    documents = sorted((path.stem for path in (source / "docs").glob("*.md")), key=lambda name: (FIRST.index(name) if name in FIRST else len(FIRST), name))
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

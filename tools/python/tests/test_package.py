"""The package: its command, its types, its documentation."""

import ast
import doctest
import importlib
import inspect
import itertools
import re
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
                    yield f"{name}.{member}", getattr(thing, member) if isinstance(value, (staticmethod, classmethod)) else value


def test_every_public_name_is_documented():
    assert [name for name, thing in public() if not inspect.getdoc(thing)] == []


ADAPTERS = ("genesis", "lerobot", "mujoco", "ray", "rerun", "ros", "torch", "trimesh")


def adapters():
    for name in ADAPTERS:
        module = importlib.import_module(f"dermatome.{name}")
        yield from ((f"{name}.{member}", thing) for member, thing in vars(module).items() if inspect.isfunction(thing) and thing.__module__ == module.__name__ and not member.startswith("_"))


def test_every_argument_has_its_name():
    calls = [*public(), *adapters()]
    assert len(calls) > 200
    for name, thing in calls:
        if callable(thing) and not (inspect.isclass(thing) and thing.__module__ == "builtins"):
            try:
                parameters = inspect.signature(thing).parameters.values()
            except ValueError:  # A class without a constructor.
                continue
            if not inspect.isclass(thing):
                assert [each.name for each in parameters if each.kind in (each.VAR_KEYWORD, each.VAR_POSITIONAL)] == [], name


def test_help_says_the_shapes_of_arrays():
    arrays = 0
    for name, thing in [*public(), *adapters()]:
        for line in (inspect.getdoc(thing) or "").splitlines():
            if re.match(r"\w[\w, ]* : .*\barray(_like)?\b|.*\barrays?( or None)?:", line):
                arrays += 1
                assert re.search(r"\([^)]*\).*\barrays?|: array_like, optional", line), f"{name}: {line}"
    assert arrays > 100
    # The call of an object is described by its class.
    assert "(..., C, N)" in dermatome.Renderer.__doc__ and "(..., C, H, W)" in dermatome.Renderer.__doc__


def documented_in_adapters():
    """The names in `__all__` of adapters and what their text says of them: their packages need not be installed."""
    for name in ADAPTERS:
        folder = Path(dermatome.__file__).parent
        trees = [ast.parse(file.read_text()) for file in (folder / f"{name}.py", *sorted(folder.glob(f"_{name}*.py")))]
        nodes = {node.name: node for tree in trees for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
        for member in importlib.import_module(f"dermatome.{name}").__all__:
            if member in nodes:
                node = nodes[member]
                inner = [node] if isinstance(node, ast.FunctionDef) else [each for each in node.body if isinstance(each, ast.FunctionDef) and each.name == "__init__"]
                arguments = [each.arg for of in inner for each in [*of.args.args, *of.args.kwonlyargs] if each.arg != "self"]
                yield f"{name}.{member}", ast.get_docstring(node) or "", arguments


def test_adapters_say_what_is_public_and_what_it_raises():
    seen = {}
    for name, doc, arguments in documented_in_adapters():
        seen[name] = doc
        assert doc and (not arguments or re.search(r"^Raises\n------\n\w", doc, re.MULTILINE)), name
        for line, text in numbers_of(doc):
            assert re.search(UNIT, text, re.IGNORECASE), f"{name}: {line}"
    known = {f"{name}.{member}" for name in ADAPTERS for member in importlib.import_module(f"dermatome.{name}").__all__}
    assert known - seen.keys() == {"trimesh.skin"}, "it is Skin.from_mesh"
    for name in ADAPTERS:
        module = importlib.import_module(f"dermatome.{name}")
        own = {member for member, thing in vars(module).items() if getattr(thing, "__module__", "") == module.__name__ and not member.startswith("_")}
        assert own - {"key"} <= set(module.__all__), name


def test_help_says_what_is_raised():
    """Of every call that takes arguments, and of classes that do."""
    missing, calls = [], 0
    for name, thing in [*public(), *adapters()]:
        doc = inspect.getdoc(thing) or ""
        is_call = callable(thing) and (not inspect.isclass(thing) or "\nParameters\n" in doc)
        if not is_call or inspect.isclass(thing) and issubclass(thing, Exception) or name.startswith("ArgumentError."):
            continue
        takes = [each for each in inspect.signature(thing).parameters if each != "self"]
        calls += bool(takes)
        if takes and not re.search(r"^Raises\n------\n\w", doc, re.MULTILINE):
            missing.append(name)
    assert missing == [] and calls > 90


#: How a number is said to have a unit, or none.
UNIT = r"(?<![\w/])(m|mm|rad|s|Hz|N|Pa|m\^2|m/s|1/m\^2|pixels?|frames?|in the unit|in their unit|units?|ratio|share|from 0 to 1|times|factor|weights?|chance|degrees|frames per|coordinates|number of|numbers of|per m|of pixels|columns)(?!\w)"


def numbers_of(doc, is_value=False):
    """The lines of a help text that name numbers, and all that is said of these."""
    lines = doc.splitlines()
    for k, line in enumerate(lines):
        said = re.match(r"\w[\w, ]* : (.*)", line)
        if said and re.search(r"float|\barray", said[1]) and not re.search(r"\bu?int|bool|of str", said[1]):
            yield line, " ".join([said[1], *itertools.takewhile(lambda row: row.startswith("    "), lines[k + 1 :])])
        elif k == 0 and is_value and re.match(r"[^:]*\bfloat", line):
            yield line, " ".join(lines)


def test_help_says_the_units_of_numbers():
    numbers, missing = 0, []
    for name, thing in public():
        for line, text in numbers_of(inspect.getdoc(thing) or "", not callable(thing)):
            numbers += 1
            if not re.search(UNIT, text, re.IGNORECASE):
                missing.append(f"{name}: {line}")
    assert missing == [] and numbers > 100


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


def test_types_are_final_and_frozen():
    for name in ("Skin", "Robot", "Map", "Patch", "Level", "Index"):
        thing = getattr(_dermatome, name)
        assert thing.__module__ == "dermatome"


def imported(file, known):
    """The modules of the package that a file imports when it runs, in its functions too."""
    tree = ast.parse(file.read_text())
    typing = {id(each) for node in ast.walk(tree) if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING" for each in ast.walk(node)}
    for node in ast.walk(tree):
        if id(node) in typing:
            continue
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{name.name}" if f"{node.module}.{name.name}" in known else node.module for name in node.names)
        elif isinstance(node, ast.Import):
            yield from (name.name for name in node.names)


def test_no_files_import_each_other_in_a_circle():
    root = Path(dermatome.__file__).parent
    known = {".".join(("dermatome", *file.relative_to(root).with_suffix("").parts)).removesuffix(".__init__"): file for file in root.rglob("*.py")}
    # A file may say what the package is called.
    del known["dermatome"]
    below = {name: {each for each in imported(file, known) if each in known and each != name} for name, file in known.items()}
    while below:
        lowest = [name for name, needed in below.items() if not needed & below.keys()]
        assert lowest, f"circles among {sorted(below)}"
        for name in lowest:
            del below[name]

"""How Sphinx makes the site: the documents of docs/, the Python package from its docstrings, the examples."""

import inspect
import re
import tomllib
from pathlib import Path

import dermatome

HERE = Path(__file__).parent
project = "dermatome"
author = "The dermatome maintainers"
release = tomllib.loads((HERE / "Cargo.toml").read_text())["package"]["version"]
extensions = ["sphinx.ext.autodoc", "sphinx.ext.napoleon", "myst_nb", "sphinx_copybutton"]
html_theme = "furo"
html_title = f"dermatome {release}"
exclude_patterns = ["_build"]

# Headings are linked as GitHub names them.
myst_heading_anchors = 4
suppress_warnings = ["myst.header"]  # README begins its figures at level 4.
# The notebook has its outputs: tests run it.
nb_execution_mode = "off"

autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_rtype = False


# Names in docstrings are code, and links where they are of the package.
default_role = "py:obj"


def _signature(app, what, name, thing, options, signature, returns):
    """The signature without types, which the docstring has, and without what a method is called on."""
    try:
        return re.sub(r"^\(self(, /)?(, )?", "(", str(inspect.signature(thing))), None
    except (TypeError, ValueError):
        return signature, None


def _links(app, docname, source):
    """Files of the repository that the site has no page of are named, not linked."""
    page = Path(app.srcdir, docname).parent

    def link(match):
        target = match[2].split("#")[0]
        known = not target or "://" in target or (page / target).resolve().is_file()
        return match[0] if known else match[1]

    if not docname.endswith("experiment"):
        source[0] = re.sub(r"(?<!!)\[([^\]]*)\]\(([^)\s]+)\)", link, source[0])


def setup(app):
    app.connect("autodoc-process-signature", _signature)
    app.connect("source-read", _links)


assert dermatome.__version__.startswith(release.split("-")[0]), f"found dermatome {dermatome.__version__}; needed: {release}"

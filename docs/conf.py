"""The documentation site: `sphinx-build -W docs build/docs` runs every example and tutorial."""

from __future__ import annotations

import logging
import re
import shutil
import sys
from pathlib import Path

import matplotlib
from sphinx.application import Sphinx

import ksd

matplotlib.use("agg")
logging.getLogger("skfem").setLevel(logging.WARNING)
HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path.insert(0, str(HERE))

from blocks import show_blocks, with_blocks  # noqa: E402  (beside this file)
from docstrings import as_rst, readable  # noqa: E402
from offline import offline_settings  # noqa: E402
from tables import write_tables  # noqa: E402
from validated import write_validated  # noqa: E402

project = "ksd"
author = "The ksd developers"
release = version = ksd.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.mathjax", "sphinx_gallery.gen_gallery"]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb", ".rst": "restructuredtext"}
nb_execution_mode = "off"  # the notebook is stored with its answers
exclude_patterns = [
    "_made/scripts",
    "gallery/*.ipynb",
    "tutorial/*.ipynb",
    "_made/blocks",
    "_made/commands.md",
    "_made/job_tables.md",
    "_made/scene_tables.md",
    "_made/units.md",
    "_made/validated.md",
]
default_role = "code"
html_theme = "furo"
globals().update(offline_settings(HERE / "_made" / "static"))
# poses to be turned by hand, written while the gallery is built
EXTRA = HERE / "_made" / "extra"
EXTRA.mkdir(parents=True, exist_ok=True)
html_extra_path = [str(EXTRA)]
html_title = "ksd"
html_show_sphinx = False
html_copy_source = False
smartquotes = False

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3

autodoc_typehints = "signature"
autodoc_type_aliases = {
    "ArrayLike": "ArrayLike",
    "MechanismLike": "Mechanism | Scene | Callable[..., Mechanism]",
}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
maximum_signature_line_length = 90


def scripts(kind: str, source: Path, header: str) -> str:
    """Copy the scripts of a folder to where the gallery runs them, the first line of each docstring its title."""
    target = HERE / "_made" / "scripts" / kind
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir(parents=True)
    for path in sorted(source.glob("*.py")):
        first, rest = path.read_text().split("\n", 1)
        title = first.removeprefix('"""').removesuffix('"""')
        (target / path.name).write_text('r"""\n' + f"{title}\n{'=' * len(title)}\n" + rest)
    for path in source.glob("*.toml"):
        shutil.copy(path, target)
    (target / "GALLERY_HEADER.rst").write_text(header + by_question(kind, source))
    return str(target)


def by_question(folder: str, source: Path) -> str:
    """A table of the scripts of a folder: the question each answers, and the joints it uses."""
    rows = []
    for path in sorted(source.glob("*.py")):
        text = path.read_text()
        title = text.split("\n", 1)[0].removeprefix('"""').removesuffix('"""').replace("`", "")
        names = {family.__name__ for family in ksd.joint_families().values()} & set(
            re.findall(r"ksd\.(\w+)", text)
        )
        joints = ", ".join(sorted(names)) or "-"
        rows.append(f"   * - :ref:`{title} <sphx_glr_{folder}_{path.name}>`\n     - {joints}\n")
    head = "\n.. list-table::\n   :header-rows: 1\n   :widths: 70 30\n\n   * - question\n     - joints\n"
    return head + "".join(rows) + "\n"


HEADS = {
    "gallery": "Gallery\n=======\n\nOne design question each, answered in a page of Python.\n",
    "tutorial": "Tutorials\n=========\n\nFrom a drawing to numbers, step by step.\n",
}
sphinx_gallery_conf = {
    "examples_dirs": [
        scripts("gallery", ROOT / "examples", HEADS["gallery"]),
        scripts("tutorial", HERE / "tutorials", HEADS["tutorial"]),
    ],
    "gallery_dirs": ["gallery", "tutorial"],
    "filename_pattern": r"\.py$",
    # a script that did not change has other answers and pictures when the program has
    "run_stale_examples": True,
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("figures.of_block",),
    "ignore_repr_types": r".*(Figure|Path).*",
    "show_signature": False,
    "show_memory": False,
    "min_reported_time": 1e9,
    "download_all_examples": False,
    "abort_on_example_error": True,
    "plot_gallery": "True",
}

write_tables(HERE / "_made")


def setup(app: Sphinx) -> None:
    """Below every Python block of a page stands what it printed and drew; docstrings and signatures are readable."""
    # after the gallery, whose numbers it has
    app.connect("builder-inited", lambda app: write_validated(HERE / "_made" / "validated.md"), priority=900)
    app.connect("env-get-outdated", with_blocks)
    app.connect("source-read", show_blocks)
    app.connect("autodoc-process-docstring", as_rst)
    app.connect("autodoc-process-signature", readable)

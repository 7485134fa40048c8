"""Which figures of an example or a tutorial the site shows."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst


def of_block(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """The figure a block ends with, or the one of the function `picture` at the end of an example."""
    names = block_vars["example_globals"]
    found = names.get("___")
    if not isinstance(found, Figure):
        if "__name__ ==" not in block[1] or "picture" not in names:
            return ""
        found = names["picture"]()
    path = next(block_vars["image_path_iterator"])
    found.savefig(path, dpi=150)
    names["___"] = None
    return figure_rst([path], gallery_conf["src_dir"])

"""Which figures of an example or a tutorial the site shows."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst


def of_block(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """The figure a block ends with, or the picture that an example wrote at its end."""
    names = block_vars["example_globals"]
    found, written = names.get("___"), Path(block_vars["src_file"]).with_suffix(".png")
    if not isinstance(found, Figure) and not written.exists():
        return ""
    path = next(block_vars["image_path_iterator"])
    if isinstance(found, Figure):
        found.savefig(path, dpi=150)
    else:
        # drawn once: nothing is solved again
        shutil.move(written, path)
    names["___"] = None
    return figure_rst([path], gallery_conf["src_dir"])

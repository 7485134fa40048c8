"""Which figures of an example or a tutorial the site shows, and how large."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from PIL import Image


def css_width(path: Path) -> str:
    """Width of a picture on the site: that in which its words are as large as those of all others."""
    picture = Image.open(path)
    return f"{96 * picture.width / picture.info['dpi'][0]:.0f}px"


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
    place = Path(path).relative_to(gallery_conf["src_dir"]).as_posix()
    return f".. image:: /{place}\n   :alt: what the lines above draw\n   :width: {css_width(path)}\n"

"""Which figures of an example or a tutorial the site shows, how large, and what can be turned by hand."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from PIL import Image

import ksd
from ksd.view import write_page
from ksd.view.drawing import mechanism_plane


def css_width(path: Path) -> str:
    """Width of a picture on the site: that in which its words are as large as those of all others."""
    picture = Image.open(path)
    return f"{96 * picture.width / picture.info['dpi'][0]:.0f}px"


SAID: dict[str, dict[str, Any]] = {}
"""What every script of the gallery has named so far, by its name."""


def of_block(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """The figure or film a block ends with, or the picture that an example wrote at its end."""
    names = SAID[Path(block_vars["src_file"]).stem] = block_vars["example_globals"]
    found, written = names.get("___"), Path(block_vars["src_file"]).with_suffix(".png")
    if isinstance(found, Path) and found.suffix == ".gif":
        film = Path(next(block_vars["image_path_iterator"])).with_suffix(".gif")
        shutil.move(found, film)
        names["___"] = None
        return f".. image:: /{film.relative_to(gallery_conf['src_dir']).as_posix()}\n   :alt: the motion as a film\n"
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
    image = f".. image:: /{place}\n   :alt: what the lines above draw\n   :width: {css_width(path)}\n"
    return image + to_turn(
        names, Path(gallery_conf["src_dir"]) / "_made" / "extra" / "turn" / f"{Path(path).stem}.html"
    )


def to_turn(names: dict[str, Any], path: Path) -> str:
    """The last pose in space among what a script has named, once, in three dimensions; nothing without one."""
    poses = [v for v in names.values() if isinstance(v, ksd.Configuration) and mechanism_plane(v) is None]
    if not poses or poses[-1] is names.get("___turned"):
        return ""
    names["___turned"] = poses[-1]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_page(poses[-1], path)
    frame = (
        f'<iframe src="../turn/{path.name}" title="the pose, to be turned by hand" loading="lazy"></iframe>'
    )
    return f"\n.. raw:: html\n\n   {frame}\n"

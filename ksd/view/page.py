"""Poses as one HTML file, in three dimensions, to be turned by hand; a path with a slider. It loads nothing."""

from __future__ import annotations

import html
import json
import os
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ksd.errors import SceneError
from ksd.files import write_file
from ksd.view.drawable import Drawable
from ksd.view.sheets import sheets_geometry, sheets_pose, station_stress

SCRIPT = Path(__file__).parent / "sheets.js"
"""The component that draws."""
STYLE = """body{margin:0;font:13px Roboto,Arial,sans-serif;color:#1f2430}
#view{position:absolute;inset:0}
.ksd-name{font-size:12px;padding:0 3px;background:#ffffffb0;border-radius:3px;white-space:nowrap}
.ksd-scale{position:absolute;right:12px;bottom:12px;display:flex;gap:6px;align-items:center}
.ksd-scale i{width:130px;height:10px;display:inline-block;border-radius:2px}
#path{position:absolute;left:12px;bottom:10px;width:min(340px,45%)} #path input{width:100%}
#title{position:absolute;left:12px;top:10px;z-index:1}"""
"""Style of the page."""
START = """const texts = (id) => document.getElementById(id).textContent;
const address = (text) => URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
const bundle = address(texts("three"));
const { Sheets } = await import(address(texts("sheets").replace('"nicegui-scene"', JSON.stringify(bundle))));
const { geometry, poses, names } = JSON.parse(texts("poses"));
const sheets = new Sheets(document.getElementById("view"));
sheets.setGeometry(geometry);
const show = (k) => {
  sheets.setPose(poses[k]);
  document.getElementById("name").textContent = names[k];
};
const slider = document.getElementById("at");
slider.max = poses.length - 1;
slider.value = poses.length - 1;
slider.hidden = poses.length < 2;
slider.addEventListener("input", () => show(Number(slider.value)));
show(poses.length - 1);
window.ksdPoses = poses.length;"""
"""Script that shows the poses."""


def scene_bundle() -> Path:
    """The file of three.js that nicegui brings. Raises SceneError without the extra `live`."""
    found = find_spec("nicegui")
    if found is None or found.origin is None:
        raise SceneError("a page in three dimensions needs the package nicegui: pip install 'ksd[live]'")
    return Path(found.origin).parent / "elements" / "scene" / "dist" / "index.js"


def write_page(
    poses: Drawable | Sequence[Drawable],
    path: str | os.PathLike[str],
    *,
    stations: int = 17,
    names: Sequence[str] | None = None,
) -> Path:
    """Write one HTML file that shows a pose in three dimensions, or several of one mechanism with a slider; its path.

    Leaf springs are coloured by von Mises stress, on one scale for all poses. stations: per leaf spring; names: what the
    slider says of every pose, its drive values when None. The file loads nothing: notebooks show it by
    ``IPython.display.IFrame(path, 800, 500)``. Raises SceneError for no poses, another number of names, poses of several
    mechanisms, another file type, and without the extra `live`.
    """
    target = Path(path)
    every: list[Any] = list(poses) if isinstance(poses, Sequence) else [poses]
    if target.suffix.lower() not in (".html", ".htm"):
        raise SceneError(f"page '{target}': write it as .html")
    if not every:
        raise SceneError(f"page '{target}': there are no poses to show")
    if names is not None and len(names) != len(every):
        raise SceneError(f"page '{target}': {len(names)} names for {len(every)} poses; give one for each")
    shapes = [pose.shape(points=stations) for pose in every]
    if any([leaf.name for leaf in s.leaves] != [leaf.name for leaf in shapes[0].leaves] for s in shapes):
        raise SceneError(f"page '{target}': its poses are of several mechanisms; write a page for each")
    stresses = [station_stress(pose, shape)[0] for pose, shape in zip(every, shapes, strict=True)]
    most = max(float(s.max(initial=0.0)) for s in stresses)
    shown = {
        "geometry": sheets_geometry(every[-1], shapes[-1]),
        "poses": [sheets_pose(*each, most=most) for each in zip(every, shapes, stresses, strict=True)],
        "names": list(names or map(_drive_values, every)),
    }
    parts = {
        "three": scene_bundle().read_text("utf-8"),
        "sheets": SCRIPT.read_text("utf-8"),
        "poses": json.dumps(shown),
    }
    scripts = "\n".join(f'<script type="text/plain" id="{k}">{_inside(v)}</script>' for k, v in parts.items())
    name = html.escape(every[0].model.scene.name)
    text = (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{name}</title>'
        f'<link rel="icon" href="data:,"><style>{STYLE}</style></head>\n<body><div id="view"></div>'
        f'<div id="title">{name}</div><div id="path"><span id="name"></span>'
        f'<input id="at" type="range" min="0"></div>\n{scripts}\n<script type="module">{START}</script></body></html>\n'
    )
    return write_file(target, text, what="page")


def _drive_values(pose: Drawable) -> str:
    return ", ".join(f"{n} = {v:.6g}" for n, v in pose.targets.items())


def _inside(text: str) -> str:
    """Text inside a script element that it must not end; scripts and JSON mean the same by it."""
    return text.replace("</script", "<\\/script").replace("<!--", "<\\!--")

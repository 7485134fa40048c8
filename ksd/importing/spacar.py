"""Input of SPACAR Light (`nodes, elements, nprops, eprops, opt` saved to a MAT file) as a scene file.

Elements with `flex` are leaf springs; elements without are rigid, and what they join rigidly is one link. `dim` has the
width first, `orien` is the direction of the width. Words: page *Coming from SPACAR*.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.checks import clear_argument_errors
from ksd.errors import SceneError
from ksd.files import named_file, read_file
from ksd.importing.scene_text import Parts, scene_text

Array = NDArray[np.float64]
NAMES = ("nodes", "elements", "nprops", "eprops", "opt")
COMPRESSED = 15
"""Kind of a variable with a check sum in a MAT file of version 7."""
AXES = ("x", "y", "z")
NODE_WORDS = {
    "fix", "fix_pos", "fix_orien", "force", "force_initial", "moment", "moment_initial", "mass", "mominertia",
    *(f"{word}_{axis}" for word in ("fix", "displ", "displ_initial", "rot", "rot_initial") for axis in AXES),
}  # fmt: skip
ELEMENT_WORDS = {
    "elems",
    "emod",
    "smod",
    "dens",
    "cshape",
    "dim",
    "orien",
    "flex",
    "warping",
    "nbeams",
    "color",
    "hide",
}
"""Words that are read, or that say nothing about the mechanism."""
OPTION_WORDS = {"gravity", "loadsteps", "filename", "silent", "showinputonly", "calcbuck", "calccompl"}
MAX_NODES = 2000
"""Limit of the number of nodes and of elements."""


@clear_argument_errors
def read_spacar(path: str | os.PathLike[str], *, name: str | None = None) -> str:
    """The text of a scene file, with comments, from the input of SPACAR Light in a MAT file (`save -v7`).

    name: of the mechanism, that of the file when None. Units are SI. What has no counterpart is listed in the comments.
    Raises SceneError.

    Example: `text = ksd.importing.read_spacar("guide.mat")`.
    """
    file = named_file(path, "SPACAR file")
    return _Reader(file, _variables(file)).scene(name or file.stem)


def _variables(file: Path) -> dict[str, Any]:
    """The variables of a MAT file. Raises SceneError."""
    from scipy.io import loadmat

    content = read_file(file, what="SPACAR file")
    try:
        _check_sums(content)
        found: dict[str, Any] = loadmat(io.BytesIO(content), struct_as_record=False, chars_as_strings=True)
    except Exception as reason:
        # scipy raises whatever a damaged file makes it raise
        said = " ".join(str(reason).split())[:120] or type(reason).__name__
        raise SceneError(
            f"{file.name} cannot be read as a MAT file of version 7 ({said}); write it with "
            f"`save -v7 FILE {' '.join(NAMES)}`."
        ) from None
    missing = [key for key in ("nodes", "elements") if key not in found]
    if missing:
        raise SceneError(
            f"{file.name} has no variable '{missing[0]}'; write it with `save -v7 FILE {' '.join(NAMES)}`."
        )
    return found


def _check_sums(content: bytes) -> None:
    """Raises ValueError or zlib.error for a MAT file of another version than 7, or whose variables fail their check sums:
    scipy trusts the sizes in a file, and takes the process down where they are damaged."""
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    version = int.from_bytes(content[124:126], "little" if order == "<" else "big")
    if order is None or version != 0x100:
        raise ValueError("it is one of version 7.3" if version == 0x200 else "it does not begin like one")
    at = 128
    while at < len(content):
        kind, size = struct.unpack_from(f"{order}II", content.ljust(at + 8, b"\0"), at)
        if kind != COMPRESSED:
            raise ValueError("it is one of version 6, without check sums" if kind == 14 else "it is damaged")
        zlib.decompress(content[at + 8 : at + 8 + size])
        at += 8 + size


def _records(value: Any) -> list[dict[str, Any]]:
    """The fields that are not empty of every element of an array of structs."""
    if value is None:
        return []
    return [
        {key: getattr(one, key) for key in one._fieldnames if np.size(getattr(one, key))}
        for one in np.asarray(value).ravel()
        if hasattr(one, "_fieldnames")
    ]


def _real(value: Any) -> Array:
    """An array of numbers; raises TypeError or ValueError for what are none, or complex ones."""
    if np.iscomplexobj(value):
        raise TypeError
    return np.asarray(value, float)


def _holds_all(words: dict[str, Any]) -> bool:
    """Whether a node is clamped to ground."""
    fix, place, turn = (bool(np.any(words.get(key, False))) for key in ("fix", "fix_pos", "fix_orien"))
    return fix or (place and turn)


class _Reader:
    """The mechanism of a file; numbers of nodes and elements start at 1, as in the file."""

    def __init__(self, file: Path, variables: dict[str, Any]) -> None:
        self.file, self.notes = file, list[str]()
        self.nodes = self.numbers(variables["nodes"], "nodes", 3)
        self.elements = self.whole(
            self.numbers(variables["elements"], "elements", 2), "elements", len(self.nodes)
        )
        self.nprops = _records(variables.get("nprops"))
        self.eprops = _records(variables.get("eprops"))
        self.opt = (_records(variables.get("opt")) or [{}])[0]
        if len(self.nprops) > len(self.nodes):
            raise SceneError(
                f"{file.name}: nprops has {len(self.nprops)} entries for {len(self.nodes)} nodes."
            )
        self.set_of: dict[int, dict[str, Any]] = {}
        for k, words in enumerate(self.eprops, 1):
            if "elems" not in words:
                raise SceneError(
                    f"{file.name}: eprops({k}) has no elems; name the elements that it is about."
                )
            for e in self.whole(
                self.row(words, "elems", f"eprops({k})"), f"eprops({k}).elems", len(self.elements)
            ).tolist():
                if e in self.set_of:
                    raise SceneError(f"{file.name}: element {e} is in two sets of eprops; name it in one.")
                self.set_of[e] = words
        self.links = self.find_links()

    def numbers(self, value: Any, what: str, columns: int) -> Array:
        """A table (k, columns) of finite numbers."""
        try:
            table = np.atleast_2d(_real(value))
        except (TypeError, ValueError):
            table = np.zeros((0, 0))
        if table.ndim != 2 or not len(table) or table.shape[1] != columns or not np.isfinite(table).all():
            raise SceneError(
                f"{self.file.name}: {what} must be a table of finite numbers with {columns} columns."
            )
        if len(table) > MAX_NODES:
            raise SceneError(
                f"{self.file.name}: {what} has {len(table)} rows, more than the {MAX_NODES} that are read."
            )
        if what == "nodes" and np.abs(table).max() > 1e6:
            raise SceneError(
                f"{self.file.name}: {what} has the number {np.abs(table).max():g}; lengths are in m."
            )
        return table

    def whole(self, table: Array, what: str, most: int) -> NDArray[np.int64]:
        """Whole numbers from 1 to `most`."""
        if not ((table == np.round(table)) & (table >= 1) & (table <= most)).all():
            raise SceneError(f"{self.file.name}: {what} must be whole numbers from 1 to {most}.")
        return table.astype(np.int64)

    def row(self, words: dict[str, Any], key: str, owner: str, count: int | None = None) -> Array:
        """The numbers (count,) of a field."""
        try:
            found = _real(words[key]).ravel()
        except (KeyError, TypeError, ValueError):
            found = np.zeros(0)
        if not len(found) or not np.isfinite(found).all() or (count is not None and len(found) != count):
            amount = "numbers" if count is None else f"{count} number{'s' * (count > 1)}"
            raise SceneError(f"{self.file.name}: {owner}.{key} must be {amount}.")
        return found

    def is_flexible(self, e: int) -> bool:
        """Whether element e is a leaf spring."""
        return "flex" in self.set_of.get(e, {})

    def find_links(self) -> list[str]:
        """The link of every node: nodes joined by elements without `flex` are one, "ground" where one of them is fixed."""
        group = list(range(len(self.nodes)))
        for e, (p, q) in enumerate(self.elements.tolist(), 1):
            if not self.is_flexible(e):
                a, b = group[p - 1], group[q - 1]
                group = [min(a, b) if g in (a, b) else g for g in group]
        fixed = {group[n] for n, words in enumerate(self.nprops) if _holds_all(words)}
        names = {}
        for g in dict.fromkeys(group):
            own = [str(n) for n, other in enumerate(group, 1) if other == g]
            names[g] = "ground" if g in fixed else f"node{'s' * (len(own) > 1)} {' '.join(own)}"
        return [names[g] for g in group]

    def section(self, words: dict[str, Any], owner: str) -> dict[str, Any]:
        """The table of a section: `dim` has the width first."""
        shape = "".join(np.asarray(words.get("cshape", "")).ravel().astype(str))
        if shape == "rect":
            width, thickness = self.row(words, "dim", owner, 2).tolist()
            return {"kind": "rectangle", "thickness": thickness, "width": width}
        if shape == "circ":
            return {"kind": "circle", "diameter": self.row(words, "dim", owner, 1).tolist()[0]}
        raise SceneError(f"{self.file.name}: {owner}.cshape = '{shape}' must be 'rect' or 'circ'.")

    def width_axis(self, words: dict[str, Any], e: int, owner: str) -> Array:
        """The direction (3,) of the width of element e: the part of `orien` normal to it."""
        p, q = self.nodes[self.elements[e - 1] - 1]
        along = (q - p) / max(float(np.linalg.norm(q - p)), 1e-300)
        axis = self.row(words, "orien", owner, 3)
        axis = axis - (axis @ along) * along
        if np.linalg.norm(axis) < 1e-6:
            raise SceneError(f"{self.file.name}: {owner}.orien lies along element {e}.")
        width: Array = axis / np.linalg.norm(axis)
        return width

    def leaves(self, parts: Parts) -> Iterator[dict[str, Any]]:
        """Tables of the leaf springs."""
        for e, ends in enumerate((self.elements - 1).tolist(), 1):
            if not self.is_flexible(e):
                continue
            words = self.set_of[e]
            owner = f"eprops({self.eprops.index(words) + 1})"
            section = self.section(words, owner)
            material = {
                key: self.row(words, own, owner, 1).tolist()[0] for key, own in (("E", "emod"), ("G", "smod"))
            }
            if "dens" in words:
                material["density"] = self.row(words, "dens", owner, 1).tolist()[0]
            if sorted(self.row(words, "flex", owner).tolist()) != [1, 2, 3, 4, 5, 6]:
                self.notes.append(
                    f"{owner}.flex names some deformations; here leaf springs are flexible in all of them."
                )
            table: dict[str, Any] = {
                "name": f"element {e}",
                "a": self.links[ends[0]],
                "b": self.links[ends[1]],
            }
            table |= {"start": self.nodes[ends[0]].tolist(), "end": self.nodes[ends[1]].tolist()}
            if section["kind"] == "rectangle":
                table["width_axis"] = self.width_axis(words, e, owner).tolist()
            table["section"] = parts.name_of(
                "section", "sheet" if section["kind"] == "rectangle" else "wire", section
            )
            table["material"] = parts.name_of("material", "material", material)
            yield table

    def masses(self) -> Iterator[dict[str, Any]]:
        """Tables of the masses of rigid elements and of nodes."""
        for e, words in self.set_of.items():
            ends = self.nodes[self.elements[e - 1] - 1]
            link = self.links[self.elements[e - 1, 0] - 1]
            if self.is_flexible(e) or "dens" not in words or link == "ground":
                continue
            owner = f"eprops({self.eprops.index(words) + 1})"
            section, along = self.section(words, owner), ends[1] - ends[0]
            length = float(np.linalg.norm(along))
            density = self.row(words, "dens", owner, 1).tolist()[0]
            if section["kind"] == "rectangle":
                e3 = self.width_axis(words, e, owner)
                sides = np.array([length, section["thickness"], section["width"]])
                mass = density * float(sides.prod())
                own = mass / 12.0 * ((sides**2).sum() - sides**2)
            else:
                e3 = np.linalg.svd(along[None]).Vh[1]
                r = 0.5 * section["diameter"]
                mass = density * np.pi * r * r * length
                own = mass * np.array([0.5 * r * r, *[(3.0 * r * r + length**2) / 12.0] * 2])
            axes = np.stack([along / length, np.cross(e3, along / length), e3], axis=1)
            inertia = axes @ np.diag(own) @ axes.T
            yield {"link": link, "mass": mass, "at": ends.mean(axis=0).tolist(), "inertia": inertia.tolist()}
        for n, words in enumerate(self.nprops, 1):
            if self.links[n - 1] == "ground" or not {"mass", "mominertia"} & set(words):
                continue
            owner = f"nprops({n})"
            mass = self.row(words, "mass", owner, 1).tolist()[0] if "mass" in words else 0.0
            table: dict[str, Any] = {
                "link": self.links[n - 1],
                "mass": mass,
                "at": self.nodes[n - 1].tolist(),
            }
            if "mominertia" in words:
                xx, xy, xz, yy, yz, zz = self.row(words, "mominertia", owner, 6).tolist()
                table["inertia"] = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
            yield table

    def statements(self) -> dict[str, list[dict[str, Any]]]:
        """Tables of drives, supports and loads of the nodes."""
        found: dict[str, list[dict[str, Any]]] = {"actuate": [], "support": [], "load": []}
        for n, words in enumerate(self.nprops, 1):
            owner, link, at = f"nprops({n})", self.links[n - 1], self.nodes[n - 1].tolist()
            own = [key for key in words if key not in ("fix", "fix_pos", "fix_orien") or np.any(words[key])]
            if link == "ground":
                if set(own) - {"fix", "fix_pos", "fix_orien", *(f"fix_{a}" for a in AXES)}:
                    self.notes.append(f"{owner} is fixed; what else it says ({', '.join(own)}) is left out.")
                continue
            for axis in AXES:
                if np.any(words.get(f"fix_{axis}", False)) or "fix_pos" in own:
                    found["support"].append({"link": link, "along": axis, "at": at})
                if "fix_orien" in own:
                    found["support"].append({"link": link, "about": axis, "at": at})
                for word, way in (("displ", "along"), ("rot", "about")):
                    keys = [key for key in (f"{word}_{axis}", f"{word}_initial_{axis}") if key in words]
                    if keys:
                        value = sum(self.row(words, key, owner, 1).tolist()[0] for key in keys)
                        drive = {"name": f"{word}_{axis} {n}", "link": link, way: axis, "at": at}
                        found["actuate"].append(drive | {"value": value})
            load: dict[str, Any] = {}
            for word in ("force", "moment"):
                keys = [key for key in (word, f"{word}_initial") if key in words]
                if keys:
                    load[word] = np.sum([self.row(words, key, owner, 3) for key in keys], axis=0).tolist()
            if load:
                found["load"].append({"name": f"load {n}", "link": link, "at": at} | load)
        return {key: tables for key, tables in found.items() if tables}

    def left_out(self) -> Iterator[str]:
        """Words of the file that have no counterpart."""
        for what, records, known in (
            ("nprops", self.nprops, NODE_WORDS), ("eprops", self.eprops, ELEMENT_WORDS), ("opt", [self.opt], OPTION_WORDS),
        ):  # fmt: skip
            for k, words in enumerate(records, 1):
                owner = what if what == "opt" else f"{what}({k})"
                yield from (
                    f"{owner}.{key} has no counterpart, and is left out." for key in words if key not in known
                )

    def scene(self, name: str) -> str:
        """The text of the scene file."""
        parts = Parts()
        leaves = list(self.leaves(parts))
        if not leaves:
            raise SceneError(
                f"{self.file.name} has no element with `flex`, so nothing in it is a leaf spring."
            )
        links = [link for link in dict.fromkeys(self.links) if link != "ground"]
        tree: dict[str, Any] = {"name": name, "links": links}
        if any(np.any(words.get("warping", False)) for words in self.eprops):
            tree["consider"] = ["warping"]
        if "gravity" in self.opt:
            tree["gravity"] = self.row(self.opt, "gravity", "opt", 3).tolist()
        tree |= {kind: made for kind, made in parts.tables.items() if made} | {"leaf": leaves}
        masses = list(self.masses())
        tree |= self.statements() | ({"mass": masses} if masses else {})
        count = f"leaf springs: {len(leaves)}, links: {len(links)}"
        head = [
            f"Read from {self.file.name}, input of SPACAR Light, in SI units; {count}.",
            "A link has the numbers of its nodes as its name, a leaf spring that of its element.",
            *dict.fromkeys([*self.notes, *self.left_out()]),
        ]
        return scene_text(self.file, tree, [*head, ""], {})

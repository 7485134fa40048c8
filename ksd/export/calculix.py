"""A mechanism as an input file of CalculiX (.inp; mm, N, MPa, t): sheets of quadratic bricks along leaf springs.

Every link, and every block inside a joint, is a rigid body of the end faces clamped to it; those of ground are fixed. A
condition or a load of a point of a link acts on the tip of a stiff tetrahedron that stands on its rigid body, since nodes of
a rigid body take no condition of their own.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from ksd.checks import clear_argument_errors, show
from ksd.errors import SceneError
from ksd.files import check_target, write_file
from ksd.model.compile import Model
from ksd.model.leaves import cut_leaves
from ksd.scene.drive import GROUND, Drive
from ksd.scene.leaf import Leaf
from ksd.section.section import Section
from ksd.view.drawable import Drawable

Array = NDArray[np.float64]
MM = 1e3
GROWTH = 1.6
"""Growth from one element to the next at ends and edges."""
FINEST = 1.0
"""Size [thicknesses] of the elements at ends and edges."""
STIFF = 1e3
"""Young's modulus of tetrahedra over that of the stiffest leaf spring."""
TETRAHEDRON = 0.02
"""Height of tetrahedra over the size of the mechanism."""
MOST_TURN = 0.3
"""Largest rotation [rad] of a link, or displacement over the length of the shortest leaf, in one increment."""
OFF_AXIS = 1e-4
"""Rotation [rad] normal to a moment from which on CalculiX means another moment than this package."""


class Mesh(NamedTuple):
    """Elements in half the length of a leaf, in half its width and through its thickness; size [thicknesses] of those at its
    ends and edges, from which they grow by a constant factor; parts: into which each is then divided along and across."""

    along: int = 12
    across: int = 2
    through: int = 1
    end: float = FINEST
    parts: int = 1


COARSE, COARSER = Mesh(), Mesh(along=6, across=1, end=5.0)
MANY_LEAVES = 6
"""Number of leaf springs from which on the coarser mesh is taken: rigid bodies couple all of them, time grows faster than
their number."""


class Output(NamedTuple):
    """Where the force of a drive is read: node, rows (3,) of its force or moment, and its unit [N or Nm per unit of the
    deck] divided by the coefficient of the drive."""

    node: int
    direction: Array
    unit: float


@clear_argument_errors
def write_deck(configuration: Drawable, path: str | os.PathLike[str]) -> Path:
    """Write an input file of CalculiX (.inp) that solves for this pose; returns the path. Refused are scenes of which it
    cannot say everything. Raises SceneError.

    Example: `ksd.export.write_deck(pose, "pivot.inp")`, then `ccx pivot`.
    """
    target = Path(path)
    if target.suffix.lower() != ".inp":
        raise SceneError(f"'{target}': input of CalculiX ends in .inp")
    check_target(target, what="input of CalculiX")
    return write_file(target, deck_of(configuration).text, what="input of CalculiX")


def deck_of(configuration: Any, mesh: Mesh | None = None, *, parts: int = 1) -> Deck:
    """The deck of a pose in as many increments as its rotations and displacements ask for. mesh: by default by the number of
    leaf springs; each of its elements is divided into `parts` along and across."""
    model, motion = configuration.unreduced_state
    chosen = mesh or (COARSE if len(model.member_names) < MANY_LEAVES else COARSER)
    mesh = chosen._replace(parts=parts * chosen.parts)
    if model.solids:
        raise SceneError(
            f"CalculiX: reduced solids ({', '.join(model.solids)}) are not written; they are meshes already."
        )
    turns = [float(np.linalg.norm(configuration.rotation(link))) for link in model.scene.links]
    _refuse_moments(model, configuration, motion)
    shortest = min(leaf.length for leaf in model.scene.leaf_names().values())
    moves = np.linalg.norm(motion.x[: model.links] - model.rest.x[: model.links], axis=1).max() / shortest
    increments = math.ceil(max(*turns, float(moves)) / MOST_TURN)
    values = dict(zip(model.drive_names, model.targets(configuration.targets).tolist(), strict=False))
    return Deck(model, mesh, values, increments=max(increments, 1), load_factor=configuration.load_factor)


class Deck:
    """The input of CalculiX of a model.

    values: drive values [m or rad]; half: only z >= 0 of a mechanism that is symmetric about z = 0. text: of the file;
    forces: where to read the force of every drive; references: reference node of the rigid body of every block, by its
    number in the model, the one after it holds the rotation. Raises SceneError for what the deck cannot say.
    """

    def __init__(
        self,
        model: Model,
        mesh: Mesh,
        values: dict[str, float],
        *,
        increments: int = 1,
        load_factor: float = 1.0,
        half: bool = False,
    ) -> None:
        refuse(model.scene)
        self.model, self.half = model, half
        self.nodes: list[Array] = []
        self.sheets: dict[Any, list[str]] = {}
        self.stiff: list[str] = []
        self.faces: dict[int, list[int]] = {0: []}
        self.middle: list[int] = []
        self.fixed: list[str] = []
        self.turned: list[str] = []
        self.count = 0
        self.forces: dict[str, Output] = {}
        leaves = {f"{j.name}/{leaf.name}": (j, leaf) for j in model.scene.joints for leaf in j.leaves()}
        leaves |= {name: (None, leaf) for name, _, _, leaf in cut_leaves(model.scene)}
        for name, ends in zip(model.member_names, model.arrays.members.node.tolist(), strict=True):
            self._sheet(*leaves[name], ends, mesh)
        self.height = TETRAHEDRON * max(float(model.arrays.size), 1e-6)
        # as the tetrahedra are there, numbers of what follows are known
        moved, loads = self._conditions(values), self._loads(load_factor)
        steps = self._steps(moved, loads, increments)
        self.text = "\n".join([*self._head(), *self._bodies(), *self.fixed_lines(), *steps]) + "\n"

    def _node(self, at: ArrayLike) -> int:
        """Number of a new node at a place (3,) [m]."""
        self.nodes.append(np.asarray(at, float))
        return len(self.nodes)

    def _element(self, elements: list[str], nodes: list[int]) -> None:
        self.count += 1
        numbers = [str(self.count), *map(str, nodes)]
        elements.append(",\n".join(", ".join(numbers[k : k + 11]) for k in range(0, len(numbers), 11)))

    def _sheet(self, joint: Any, leaf: Leaf, ends: list[int], mesh: Mesh) -> None:
        """Add the elements of a leaf; i along, j through the thickness, k across the width."""
        places = [leaf.section_at(s) for s in (0.5, 0.0)]
        if joint is not None:
            places = [(joint.place(p), np.asarray(joint.rotation) @ axes) for p, axes in places]
        (middle, _), (_, start_axes) = places
        if self.half and middle[2] < -1e-9:
            return
        t, w = leaf.section.thickness, leaf.section.width
        along = graded(mesh.along, 0.5 * leaf.length, mesh.end * t)
        corners = np.concatenate([along, leaf.length - along[-2::-1]]) / leaf.length
        if leaf.profile is not None:
            corners = np.unique(np.round(np.concatenate([corners, leaf.profile.breaks]), 12))
        u = with_middles(corners, mesh.parts)
        inside = 0.5 - graded(mesh.across, 0.5 * w, mesh.end * t)[::-1] / w
        cut = self.half and abs(middle[2]) < 1e-9
        v = with_middles(inside if cut else np.concatenate([-inside[:0:-1], inside]), mesh.parts)
        # into z >= 0
        mirror = self.half and start_axes[2, 2] < 0.0
        v = -v if mirror else v
        shape = (
            len(u),
            2 * (through := mesh.through if leaf.curve is None else max(2, mesh.through)) + 1,
            len(v),
        )
        ids = np.zeros(shape, int)
        for i, s in enumerate(u.tolist()):
            place, axes = leaf.section_at(s)
            if joint is not None:
                place, axes = joint.place(place), np.asarray(joint.rotation) @ axes
            if leaf.profile is not None:
                t, w = _sizes(leaf, s)
            for j in range(shape[1]):
                for k in range(shape[2]):
                    if (i % 2) + (j % 2) + (k % 2) < 2:
                        offset = np.array([0.0, (0.5 * j / through - 0.5) * t, v[k] * w])
                        ids[i, j, k] = self._node(place + axes @ offset)
        for end, face in zip(ends, (ids[0], ids[-1]), strict=True):
            self.faces.setdefault(end, []).extend(face[face > 0].tolist())
        # nodes of rigid bodies take no condition
        self.middle += [n for n in ids[1:-1, :, 0].ravel().tolist() if n and cut]
        sheet = self.sheets.setdefault(leaf.material, [])
        for i in range(0, shape[0] - 1, 2):
            for j in range(0, shape[1] - 1, 2):
                for k in range(0, shape[2] - 1, 2):
                    self._element(
                        sheet, [int(ids[i + a, j + b, k + (2 - c if mirror else c)]) for a, b, c in BRICK]
                    )

    def _tip(self, block: int, at: ArrayLike) -> int:
        """The node of a point of a block at `at` (3,) [m] at rest: the tip of a stiff tetrahedron."""
        tip = self._node(at)
        if block == 0:
            self.fixed.append(f"{tip}, 1, 3")
            return tip
        base = [self._node(np.asarray(at, float) + self.height * e) for e in np.eye(3)]
        self._element(self.stiff, [tip, *base])
        self.faces.setdefault(block, []).extend(base)
        return tip

    def _block(self, link: str) -> int:
        return self.model.scene.links.index(link)

    def _conditions(self, values: dict[str, float]) -> list[tuple[str, float]]:
        """Fix the supports; returns the node and direction, and the value [mm or rad], of every drive."""
        scene, moved = self.model.scene, []
        for drive in (*scene.supports, *scene.drives):
            term, block = drive.terms[0], self._block(drive.terms[0].link)
            axis, direction = int(np.abs(term.direction).argmax()), np.asarray(term.direction)
            sign = float(np.sign(direction[axis]))
            if term.kind == "rotation":
                node, unit = -block, 1.0
            else:
                node, unit = self._tip(block, term.point), MM
                if abs(direction[axis]) < 1.0 - 1e-12:
                    axis, sign = 0, 1.0
                    other = np.cross(direction, np.eye(3)[int(np.abs(direction).argmin())])
                    system = ", ".join(f"{c:.12g}" for c in (*direction, *other))
                    self.turned += [
                        f"*NSET, NSET=T{node}",
                        f"{node}",
                        f"*TRANSFORM, NSET=T{node}, TYPE=R",
                        system,
                    ]
            if drive not in scene.drives:
                self.fixed.append(f"{self._own(node)}, {axis + 1}, {axis + 1}")
                continue
            moved.append(
                (
                    f"{self._own(node)}, {axis + 1}, {axis + 1}",
                    sign * unit * values[drive.name] / term.coefficient,
                )
            )
            force = 1e-3 if term.kind == "rotation" else 1.0
            self.forces[drive.name] = Output(node, direction, force / term.coefficient)
        return moved

    def _own(self, node: int) -> str:
        """A node for the text, in which the rotation of a block b, -b here, has its place later."""
        return str(node) if node > 0 else f"<{-node}>"

    def _loads(self, factor: float) -> list[str]:
        """Lines of forces, moments and weight."""
        scene, lines = self.model.scene, []
        gravity = None if scene.gravity is None else np.asarray(scene.gravity, float)
        for load in scene.loads:
            if any(load.force):
                tip = self._tip(self._block(load.link), load.at)
                lines += _components(str(tip), factor * np.asarray(load.force))
            lines += _components(f"<{self._block(load.link)}>", factor * MM * np.asarray(load.moment))
        if gravity is None or not gravity.any():
            return ["*CLOAD", *lines] if lines else []
        for mass in scene.masses:
            if mass.mass and mass.link != GROUND:
                tip = self._tip(self._block(mass.link), mass.at)
                lines += _components(str(tip), factor * mass.mass * gravity)
        lines = ["*CLOAD", *lines] if lines else []
        size = float(np.linalg.norm(gravity))
        along = ", ".join(f"{c:.12g}" for c in gravity / size)
        weighs = [k for k, material in enumerate(self.sheets) if material.density is not None]
        return (
            lines
            + ["*DLOAD"] * bool(weighs)
            + [f"LEAVES{k}, GRAV, {factor * MM * size:.12g}, {along}" for k in weighs]
        )

    def _head(self) -> Iterator[str]:
        """Lines of nodes, elements and materials."""
        yield f"** {' '.join(self.model.scene.name.split())}: written by ksd; mm, N, MPa, t"
        yield "*NODE"
        for n, place in enumerate(self.nodes, 1):
            yield f"{n}, {', '.join(f'{MM * x:.12g}' for x in place)}"
        materials = [
            (f"LEAVES{k}", "C3D20R", elements, m.E, m.nu, m.density)
            for k, (m, elements) in enumerate(self.sheets.items())
        ]
        if self.stiff:
            materials.append(("STIFF", "C3D4", self.stiff, STIFF * max(m.E for m in self.sheets), 0.0, None))
        for name, kind, elements, E, nu, density in materials:
            yield f"*ELEMENT, TYPE={kind}, ELSET={name}"
            yield from elements
            yield f"*MATERIAL, NAME={name}"
            yield f"*ELASTIC\n{1e-6 * E:.12g}, {nu:.12g}"
            if density is not None:
                yield f"*DENSITY\n{1e-12 * density:.12g}"
            yield f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"
        yield from self.turned

    def _bodies(self) -> Iterator[str]:
        """Lines of the rigid bodies, whose reference nodes follow all others."""
        self.references = {}
        for block, face in sorted(self.faces.items()):
            if not face:
                continue
            yield f"** {' '.join(self.model.node_names[block].split())}"
            yield f"*NSET, NSET=B{block}"
            yield ",\n".join(map(str, face))
            if block:
                ref = self.references[block] = len(self.nodes) + 2 * block
                place = ", ".join(f"{MM * x:.12g}" for x in self.model.rest.x[block])
                yield f"*NODE\n{ref}, {place}\n{ref + 1}, {place}"
                yield f"*RIGID BODY, NSET=B{block}, REF NODE={ref}, ROT NODE={ref + 1}"
        self.forces = {
            name: o._replace(node=o.node if o.node > 0 else self.references[-o.node] + 1)
            for name, o in self.forces.items()
        }

    def fixed_lines(self) -> list[str]:
        """Lines of what does not move, and of the nodes whose results are printed."""
        lines = [
            "*BOUNDARY",
            *(["B0, 1, 3"] if self.faces[0] else []),
            *dict.fromkeys(map(self._placed, self.fixed)),
        ]
        if self.half:
            for ref in self.references.values():
                lines += [f"{ref}, 3, 3", f"{ref + 1}, 1, 2"]
            lines += [f"{n}, 3, 3" for n in self.middle]
        printed = {n + k for n in self.references.values() for k in (0, 1)} | {
            o.node for o in self.forces.values()
        }
        return [*(lines if len(lines) > 1 else []), "*NSET, NSET=OUT", ",\n".join(map(str, sorted(printed)))]

    def _placed(self, line: str) -> str:
        """A line with the rotation node of its block in place of <block>."""
        if not line.startswith("<"):
            return line
        block, rest = line[1:].split(">")
        return f"{self.references[int(block)] + 1}{rest}"

    def _steps(self, moved: list[tuple[str, float]], loads: list[str], increments: int) -> Iterator[str]:
        """Lines of the steps: loads first, with the drives at zero, then the drives."""
        # the usual residual is half a percent of the mean force
        head = ["*STEP, NLGEOM, INC=1000", "*STATIC", f"{1 / increments:.6g}, 1.0, 1e-6, {1 / increments:.6g}",
                "*CONTROLS, PARAMETERS=FIELD", "5e-5, 1e-2", *INCREMENTATION]  # fmt: skip
        tail = ["*NODE PRINT, NSET=OUT, FREQUENCY=1000, GLOBAL=YES", "U, RF", "*END STEP"]
        steps = [(loads, 0.0)] * bool(loads) + [([], 1.0)] * (bool(moved) or not loads)
        for lines, share in steps:
            yield from head
            yield from map(self._placed, lines)
            if moved:
                yield "*BOUNDARY"
                yield from (f"{self._placed(where)}, {share * value:.12g}" for where, value in moved)
            yield from tail


INCREMENTATION = [
    "*CONTROLS, PARAMETERS=TIME INCREMENTATION",
    "8, 10, 9, 16, 12, 8, , 10",
    "0.25, 0.5, 0.75, 0.85, , , 1.5,",
]
"""An increment of up to 8 iterations, which thin sheets need for a tight residual, lets the next one grow; by default 4."""
BRICK = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2), (1, 0, 0), (2, 1, 0),
         (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2), (0, 0, 1), (2, 0, 1), (2, 2, 1),
         (0, 2, 1)]  # fmt: skip
"""Nodes of a brick C3D20R by their steps along, through and across."""


def _components(node: str, value: Array) -> list[str]:
    return [f"{node}, {k + 1}, {c:.12g}" for k, c in enumerate(value.tolist()) if c]


def _sizes(leaf: Leaf, s: float) -> tuple[float, float]:
    """Thickness and width [m] of the section at s of a leaf with a profile."""
    section = leaf.profile.sides(s)[0]  # type: ignore[union-attr]
    return section.thickness, section.width


def refuse(scene: Any) -> None:
    """Raises SceneError for what the deck cannot say, by its name."""

    def no(what: str, instead: str) -> None:
        raise SceneError(f"CalculiX: {what}; {instead}.")

    for words, what in (("springs", "spring"), ("heats", "heat of"), ("fits", "assembly error of")):
        for said in getattr(scene, words):
            name = getattr(said, "name", None) or getattr(said, "leaf", "")
            no(f"{what} '{name}' is not written", "leave it out to compare what remains")
    for hinge in scene.hinges:
        if hinge.kind in ("pin", "ball") or hinge.a != GROUND:
            no(f"{hinge.kind} '{hinge.name}' is not written", "compare with a flexure in its place")
    for said in scene.compliances:
        no(
            f"elastic link '{said.link}' is not written, links are rigid bodies",
            "leave its compliance out to compare",
        )
    for load in scene.loads:
        if load.following:
            no(
                f"load '{load.name}' turns with its link, loads of a rigid body do not",
                "say following=False to compare",
            )
    for line in scene.loads_along:
        no(
            f"the load '{line.name}' along leaf '{line.leaf}' is not written",
            "leave it out to compare what remains",
        )
    for drive in (*scene.drives, *scene.supports):
        _refuse_drive(drive, no)
    for name, leaf in scene.leaf_names().items():
        if not -1.0 < leaf.material.nu < 0.4999:
            no(
                f"leaf '{name}' has nu = {leaf.material.nu:.4g}, solids take -1 < nu < 0.4999",
                "give E and another nu",
            )
        at = [0.0, 0.5, 1.0] if leaf.profile is None else [0.0, 0.5, 1.0, *leaf.profile.breaks]
        for s in at:
            sides = (leaf.section,) if leaf.profile is None else leaf.profile.sides(s)
            if not all(map(_is_rectangle, sides)):
                no(
                    f"leaf '{name}' is no sheet, only rectangular sections are written",
                    "compare with a sheet in its place",
                )
            if (
                abs(sides[0].thickness / sides[-1].thickness - 1) + abs(sides[0].width / sides[-1].width - 1)
                > 1e-6
            ):
                no(
                    f"leaf '{name}' has a step in its section, where solids meet by no rule",
                    "compare with a taper in its place",
                )


def _refuse_drive(drive: Drive, no: Any) -> None:
    """Raises SceneError, by `no`, for a drive or support of several terms, of a moving base or about a skew axis."""
    term = drive.terms[0]
    if len(drive.terms) > 1:
        no(f"'{drive.name}' prescribes a sum of {len(drive.terms)} motions", "drive one of them")
    if term.base != GROUND:
        no(
            f"'{drive.name}' is a motion relative to link '{term.base}', whose direction moves",
            "drive a motion relative to ground",
        )
    if term.kind == "rotation" and max(map(abs, term.direction)) < 1.0 - 1e-9:
        no(
            f"'{drive.name}' is a rotation about {show(term.direction)}, not about x, y or z",
            "turn the scene",
        )


def _refuse_moments(model: Model, configuration: Any, motion: Any) -> None:
    """Raises SceneError for a moment on a link that turns about other axes too: its meaning differs there."""
    for load in model.scene.loads:
        moment = np.asarray(load.moment)
        off = np.cross(moment, configuration.rotation(load.link)) / max(float(np.linalg.norm(moment)), 1e-300)
        if np.linalg.norm(off) > OFF_AXIS:
            raise SceneError(
                f"CalculiX: load '{load.name}' is a moment on link '{load.link}', which turns about other axes by "
                f"{np.linalg.norm(off):.2g} rad, where moments of CalculiX turn too; use forces at two points."
            )


def _is_rectangle(section: Section) -> bool:
    t, w = section.thickness, section.width
    own = ((section.A, t * w), (section.Iy, t * w**3 / 12), (section.Iz, w * t**3 / 12))
    return section.outline is None and t > 0.0 and all(math.isclose(a, b, rel_tol=1e-9) for a, b in own)


def graded(elements: int, length: float, finest: float) -> Array:
    """Corners (elements + 1,) in [m] of elements that grow from `finest` [m] at 0, by `GROWTH` up to a largest size
    where this reaches, else by more."""
    grown = finest * GROWTH ** np.arange(elements)
    if elements == 1 or finest * elements > 0.999 * length:
        sizes = np.ones(elements)
    elif grown.sum() > length:
        sizes = np.minimum(grown, brentq(lambda most: np.minimum(grown, most).sum() - length, 0.0, grown[-1]))
    else:
        factor = brentq(lambda q: finest * (q**elements - 1.0) / (q - 1.0) - length, 1.1, 1e3)
        sizes = factor ** np.arange(elements)
    return np.concatenate([[0.0], length * np.cumsum(sizes) / sizes.sum()])


def with_middles(corners: Array, parts: int) -> Array:
    """Corners and middles of elements that are each divided into equal parts."""
    found: Array = np.interp(
        np.arange(2 * parts * (len(corners) - 1) + 1) / (2 * parts), np.arange(len(corners)), corners
    )
    return found

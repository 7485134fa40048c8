"""`ksd.rest_shape`: the mechanism that takes a wanted shape when it is loaded.

Lan (2005), chapter 5, inverse problem: with the deformed lines of all leaf springs given, their undeformed ones follow from
the forces in them without iteration (`ksd.design.rest_leaf`); forces that equilibrium leaves open are those for which the
mechanism fits together unloaded (`ksd.design.rest_equations`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.checks import boolean, clear_argument_errors, name_hint, show
from ksd.checks import number as checked
from ksd.design.rest_equations import Equations, Found, Row, Said, Term, solved
from ksd.design.rest_leaf import Axes, DrawnLeaf, axes_of, deformed_curve, rotated
from ksd.design.rest_result import FINE, RestShape, pieces_of
from ksd.errors import ConvergenceError, KsdError, SceneError
from ksd.model.arrays import STRAIN
from ksd.model.leaves import cut_leaves
from ksd.model.mesh import Mesh
from ksd.numerics.rotations import rotation_log
from ksd.properties.printing import format_number
from ksd.scene.clearance import (
    FINE_BOX_COUNT,
    OVERLAP_TOLERANCE,
    leaf_boxes,
    overlapping_leaves,
    overlaps_itself,
)
from ksd.scene.curve import FreeCurve
from ksd.scene.drive import Drive
from ksd.scene.leaf import Leaf
from ksd.scene.mechanism import Mechanism
from ksd.scene.move_links import RigidMove, scene_with_moved_links
from ksd.scene.plane_curves import Legendre
from ksd.scene.scene import Scene
from ksd.solve.configuration import Configuration
from ksd.solve.required_loads import prescribed_pose, required_loads
from ksd.solve.solver import given_values, prepare, solve

Array = NDArray[np.float64]
Piece = tuple[str, str, str, Leaf]
"""A leaf spring, or its piece between points: name, links at its start and end, and how it lies."""
RETURNED = 1e-4
"""Distance from the wanted shape, over the size, up to which the forward solution has come back to it."""
SNAPPED = 0.1
"""Difference of the moments at the ends of a leaf spring, over the largest, from which on it is bent otherwise."""
UNSAID = {
    "joints": "joints (put their leaf springs in with mechanism.constrain)",
    "springs": "springs",
    "compliances": "elastic links",
    "heats": "heat",
    "fits": "assembly errors and preloads",
}
"""What a scene may not mention, in words."""


@clear_argument_errors
def rest_shape(
    mechanism: Mechanism | Scene,
    wanted: Configuration | Mapping[str, Any] | None = None,
    *,
    free: str | Iterable[str] = (),
    forces: Mapping[str, float | Mapping[str, float]] | None = None,
    beyond_fold: bool = False,
    check: bool = True,
    mesh: Mesh | None = None,
    targets: Mapping[str, float] | None = None,
    **drives: float,
) -> RestShape:
    """The undeformed mechanism that takes a wanted shape under its loads: a `RestShape`, a scene of `ksd.FreeCurve` leaves.

    mechanism: drawn as it shall look when loaded, with the loads that act then; lives in a plane. wanted: nothing for the
    drawing itself; a pose of this mechanism (`ksd.solve`), whose shape is taken and whose loads may be others; or poses by
    link, said as in `ksd.required_loads`, between which leaf springs bend as they are. Drive values [m or rad] by name:
    how far each drive has moved from rest in the wanted shape; those of the pose by default. free: names of loads whose
    size, and of drives whose value, is to be found; forces: as many forces that are known in their place, of drives
    {"push": 3.0} [N or Nm], or within leaf springs {"left": {"x": -5.0}} [N], global component of what the part beyond
    exerts on the leaf at its end. Loops shall close at rest, clamped angles kept: that decides all other forces.
    The solution is followed from the unloaded drawing; beyond_fold takes the other one, which lies around the fold. check:
    solve forward, on leaf springs of `mesh`.

    Raises SceneError for what has no rest shape, ConvergenceError beyond a fold, with the share of the loads that works.
    Source: Lan (2005), chapter 5; stretch, shear and weight of the leaf springs are in.
    """
    scene = mechanism.scene() if isinstance(mechanism, Mechanism) else mechanism
    if not isinstance(scene, Scene):
        raise SceneError(f"rest_shape: {show(mechanism)} is no mechanism; give a ksd.Mechanism or its scene.")
    for key, value in (("beyond_fold", beyond_fold), ("check", check)):
        boolean(value, key)
    _refuse(scene)
    axes, values = axes_of(str(scene.plane)), given_values(targets, drives)
    drawn, pieces, values = _drawn(scene, wanted, axes, values, mesh)
    problem = _Problem(
        drawn,
        pieces,
        axes,
        values,
        (free,) if isinstance(free, str) else tuple(free),
        forces or {},
        mesh or FINE,
    )
    found = solved(problem.equations, beyond_fold=beyond_fold)
    if not isinstance(found, Found):
        raise ConvergenceError(problem.refusal(found, beyond_fold))
    made = problem.rest(found)
    return _checked(made, problem.moves, mesh or FINE) if check else made


def _refuse(scene: Scene) -> None:
    """SceneError for what rest shapes are not known of."""
    if scene.plane is None:
        raise SceneError(
            f"rest_shape: mechanism '{scene.name}' names no plane, and rest shapes are found in one; say "
            f'ksd.Mechanism("{scene.name}", plane="xy").'
        )
    for key, words in UNSAID.items():
        if getattr(scene, key):
            raise SceneError(
                f"rest_shape: '{scene.name}' has {words}, of which rest shapes are not known; leave them out."
            )


def _drawn(
    scene: Scene, wanted: Any, axes: Axes, values: dict[str, float], mesh: Mesh | None
) -> tuple[Scene, list[Piece], dict[str, float]]:
    """The scene drawn in its wanted shape, the pieces of its leaf springs there, and its drive values."""
    if wanted is None:
        return scene, cut_leaves(scene), values
    if isinstance(wanted, Mapping):
        wanted = prescribed_pose(prepare(scene, mesh=mesh or FINE), wanted)
    elif isinstance(wanted, Configuration):
        values = {n: v for n, v in wanted.targets.items() if n in {d.name for d in scene.drives}} | values
    else:
        raise SceneError(
            f"rest_shape: wanted = {show(wanted)}: give a pose (ksd.solve), poses by link, or nothing for the drawing."
        )
    model, motion = wanted.unreduced_equilibrium
    pieces = {name: (f, leaf) for name, f, leaf in pieces_of(scene)}
    if not set(scene.links) <= set(model.node_names) or set(pieces) != set(model.member_names):
        raise SceneError(
            f"rest_shape: the wanted pose is one of another mechanism, '{model.scene.name}'; give one of '{scene.name}' "
            "itself, or of one with its links, leaf springs and points by the same names."
        )
    if (model.arrays.members.kind != STRAIN).any():
        raise SceneError(
            "rest_shape: the wanted pose is one of chains or reduced bodies; solve it without mesh= and basis=."
        )
    gravity = wanted.load_factor * _gravity(model.scene, axes)
    moves = {
        link: RigidMove(motion.R[i], motion.x[i] - motion.R[i] @ model.rest.x[i])
        for i, link in enumerate(model.node_names)
    }
    curves: dict[str, list[Legendre]] = {}
    drawn: list[Piece] = []
    for name, a, b, leaf in cut_leaves(scene):
        whole, i = pieces[name][0], model.member_names.index(name)
        curve = deformed_curve(leaf, model.mesh.of(whole), axes, (model, motion, i), gravity)
        curves.setdefault(whole, []).append(curve)
        # a force at a point turns the line there against its sections, by shear: each piece is drawn by itself
        ends = moves[a].move_point(leaf.start), moves[b].move_point(leaf.end)
        drawn.append((name, a, b, replace(leaf, start=ends[0], end=ends[1], curve=FreeCurve.of(curve))))
    return Scene(**scene_with_moved_links(scene, moves, curves)), drawn, values


def _gravity(scene: Scene, axes: Axes) -> Array:
    """Gravity (2,) in the plane. Raises SceneError where it leaves that."""
    if scene.gravity is None:
        return np.zeros(2)
    if abs(scene.gravity[axes.normal]) > 1e-12 * float(np.abs(scene.gravity).max()):
        raise SceneError(f"rest_shape: gravity leaves the plane {scene.plane}; keep it in the plane.")
    return axes.of(scene.gravity)


class _Problem:
    """Equations of a drawn scene, and their solution as a scene at rest."""

    def __init__(
        self, scene: Scene, pieces: list[Piece], axes: Axes, values: Mapping[str, float], free: tuple[str, ...],
        forces: Mapping[str, Any], mesh: Mesh,
    ) -> None:  # fmt: skip
        self.scene, self.axes, self.free, self.forces = scene, axes, free, forces
        ends = np.array([axes.of(p) for f in scene.leaves for p in (f.leaf.start, f.leaf.end)])
        self.origin = ends.mean(axis=0)
        size = float(np.ptp(ends, axis=0).max())
        self.number = {link: i for i, link in enumerate(scene.links)}
        self.leaves = tuple(
            DrawnLeaf(name, (a, b), leaf, axes, self.origin, mesh) for name, a, b, leaf in pieces
        )
        bending = float(np.mean([1.0 / leaf.bending.mean() for leaf in self.leaves]))
        self.loads = {load.name: load for load in scene.loads}
        self._check_free(values)
        self.values = values
        rows = tuple(row for d in (*scene.drives, *scene.supports) if (row := self._row(d)) is not None)
        pushes = [(self.number[p.link], self._wrench(p)) for p in scene.loads if p.name not in free]
        gravity = _gravity(scene, axes)
        for mass in scene.masses:
            at = axes.of(mass.at) - self.origin
            weight = mass.mass * gravity
            pushes.append(
                (self.number[mass.link], np.array([*weight, at[0] * weight[1] - at[1] * weight[0]]))
            )
        self.equations = Equations(
            self.leaves, tuple((self.number[leaf.a], self.number[leaf.b]) for leaf in self.leaves), len(scene.links), rows,
            tuple(pushes), tuple((self.number[p.link], self._wrench(p)) for p in scene.loads if p.name in free),
            tuple(self._said(rows)), gravity, size, bending / size**2,
        )  # fmt: skip

    def _check_free(self, values: Mapping[str, float]) -> None:
        """SceneError for unknown names, and for drives that are neither free nor have a value."""
        drives = [d.name for d in self.scene.drives]
        known = [*self.loads, *drives]
        for name in self.free:
            if name not in known:
                raise SceneError(
                    f"rest_shape: free = {show(name)} is neither a load nor a drive; there are {', '.join(known) or 'none'}"
                    f"{name_hint(name, known)}"
                )
        for name in self.free:
            if name in self.loads and not any((*self.loads[name].force, *self.loads[name].moment)):
                raise SceneError(
                    f"rest_shape: free load '{name}' is zero, so that it has no direction; give it one, of any size."
                )
        for name in values:
            if name not in drives:
                raise SceneError(
                    f"rest_shape: there is no drive {show(name)}; there are {', '.join(drives) or 'none'}"
                    f"{name_hint(name, drives)}"
                )
        for name in drives:
            if name not in values and name not in self.free:
                raise SceneError(
                    f"rest_shape: drive '{name}' has no value: say how far it has moved from rest in the wanted shape, "
                    f"{name}=..., or its force instead, free='{name}', forces={{'{name}': ...}}."
                )
        said = sum(len(f) if isinstance(f, Mapping) else 1 for f in self.forces.values())
        if said != len(self.free):
            raise SceneError(
                f"rest_shape: {len(self.free)} loads or drives are free ({', '.join(self.free) or 'none'}) and {said} "
                "forces are said; say as many forces as there are free ones."
            )

    def _row(self, drive: Drive) -> Row | None:
        """A drive or support in the plane; None of what holds across it."""
        k, terms = self.axes.normal, []
        for t in drive.terms:
            across, turns = float(t.direction[k]), t.kind == "rotation"
            if abs(across) > 1e-9 and abs(abs(across) - 1.0) > 1e-9:
                raise SceneError(
                    f"rest_shape: '{drive.name}' is askew of the plane {self.scene.plane}; keep it in the plane."
                )
            if (abs(across) > 0.5) != turns:
                continue
            way = np.array([np.sign(across)]) if turns else self.axes.of(t.direction)
            point = self.axes.of(t.point) - self.origin
            terms.append(Term(t.coefficient, turns, self.number[t.base], self.number[t.link], way, point))
        if not terms:
            return None
        own = drive.name in {d.name for d in self.scene.drives}
        value = None if drive.name in self.free else float(self.values[drive.name]) if own else 0.0
        return Row(drive.name, tuple(terms), value)

    def _wrench(self, load: Any) -> Array:
        """Force and moment about the origin (3,) of a load."""
        k = self.axes.normal
        size = max(float(np.abs(load.force).max()), float(np.abs(load.moment).max()))
        if abs(load.force[k]) > 1e-12 * size or np.abs(self.axes.of(load.moment)).max() > 1e-12 * size:
            raise SceneError(
                f"rest_shape: load '{load.name}' leaves the plane {self.scene.plane}; keep it in the plane."
            )
        at, force = self.axes.of(load.at) - self.origin, self.axes.of(load.force)
        return np.array([*force, at[0] * force[1] - at[1] * force[0] + load.moment[k]])

    def _said(self, rows: tuple[Row, ...]) -> Iterable[Said]:
        """Forces that are said, of drives and within leaf springs."""
        drives, known = [d.name for d in self.scene.drives], [leaf.name for leaf in self.leaves]
        axes = ["xyz"[k] for k in self.axes.own]
        for name, force in self.forces.items():
            if name in drives and not isinstance(force, Mapping):
                size = checked(force, f"force of drive '{name}'", owner="rest_shape")
                yield Said([r.name for r in rows].index(name), None, 0, size)
                continue
            if name not in known or not isinstance(force, Mapping):
                raise SceneError(
                    f"rest_shape: forces: {show(name)}: {show(force)} must be the force of a drive "
                    f"({', '.join(drives) or 'none'}), or components of that in a leaf ({', '.join(known)}), such as "
                    f"{{'{known[0]}': {{'{axes[0]}': -5.0}}}}."
                )
            for component, size in force.items():
                if component not in axes:
                    raise SceneError(
                        f"rest_shape: forces: '{name}' has no component {show(component)}; give '{axes[0]}' or '{axes[1]}'."
                    )
                size = checked(size, f"force in leaf '{name}'", owner="rest_shape")
                yield Said(None, known.index(name), axes.index(component), size)

    def refusal(self, fold: float | None, beyond_fold: bool) -> str:
        """Why there is no solution, in words."""
        name = self.scene.name
        if fold is None and beyond_fold:
            return f"rest_shape: no second rest shape of '{name}' is found: its path does not fold; leave beyond_fold out."
        if fold is None:
            return f"rest_shape: the way to the rest shape of '{name}' ends; ask for smaller loads, forces or drive values."
        if beyond_fold:
            return f"rest_shape: around the fold at {100 * fold:.4g} % of the loads is no other rest shape of '{name}'."
        sizes = [
            f"'{n}' {c}{fold * v:.5g}"
            for n, said in self.forces.items()
            for c, v in (said.items() if isinstance(said, Mapping) else (("", said),))
            for c in ([f"along {c}: "] if c else [""])
        ] or [
            f"'{p.name}' {fold * float(np.linalg.norm(p.force)):.5g}"
            for p in self.scene.loads
            if any(p.force)
        ]
        at = f" ({', '.join(sizes)} N)" if sizes else ""
        return (
            f"rest_shape: '{name}' has no rest shape beyond a fold at {100 * fold:.4g} % of its loads, forces and drive "
            f"values{at}; ask for less than that."
        )

    def rest(self, found: Found) -> RestShape:
        """The scene at rest, with forces and what was free."""
        at, equations = self.equations.starts, self.equations
        z = found.y * equations.unknowns
        self.moves = {link: self._move(z[at[1] + 3 * (i - 1) :][:3]) for link, i in self.number.items() if i}
        curves: dict[str, list[Legendre]] = {}
        inside: dict[str, Array] = {}
        pieces = list(zip(self.leaves, pieces_of(self.scene), range(len(self.leaves)), strict=True))
        for whole, group in groupby(pieces, key=lambda piece: piece[1][1]):
            parts = [(leaf, z[3 * k : 3 * k + 3]) for leaf, _, k in group]
            rested = [leaf.rest(w[None], equations.gravity) for leaf, w in parts]
            curves[whole] = [leaf.curve(r) for (leaf, _), r in zip(parts, rested, strict=True)]
            (first, _), (last, w) = parts[0], parts[-1]
            inside[whole] = np.array(
                [*w[:2], _moment(rested[0].start[0], first.first), _moment(w, last.last)]
            )
        words = scene_with_moved_links(self.scene, self.moves, curves)
        sizes = dict(
            zip(
                [p.name for p in self.scene.loads if p.name in self.free],
                z[at[3] : at[4]].tolist(),
                strict=True,
            )
        )
        words["loads"] = tuple(_scaled(p, sizes.get(p.name, 1.0)) for p in words["loads"])
        opened = dict(
            zip([r.name for r in equations.rows if r.value is None], z[at[4] :].tolist(), strict=True)
        )
        named = dict(zip([r.name for r in equations.rows], z[at[2] : at[3]].tolist(), strict=True))
        drives = [d.name for d in self.scene.drives]
        scene = Scene(**words)
        bodies = [leaf_boxes(_named(f), count=FINE_BOX_COUNT) for f in scene.leaves]
        met = [pair for pair, _ in overlapping_leaves(bodies, tolerance=OVERLAP_TOLERANCE)]
        return RestShape(
            **{f.name: getattr(scene, f.name) for f in fields(Scene)}, wanted=self.scene,
            targets={n: opened.get(n, float(self.values.get(n, 0.0))) for n in drives},
            forces={n: named[n] for n in drives}, leaf_forces=inside, folds=found.folds,
            crossings=(*met, *((b.name, b.name) for b in bodies if overlaps_itself(b))),
        )  # fmt: skip

    def _move(self, pose: Array) -> RigidMove:
        """Where a link is at rest, from its pose (3,) about the origin."""
        own, turn, shift = list(self.axes.own), np.eye(3), np.zeros(3)
        R = rotated(pose[2])
        turn[np.ix_(own, own)] = R
        shift[own] = self.origin + pose[:2] - R @ self.origin
        return RigidMove(turn, shift)


def _moment(wrench: Array, at: Array) -> float:
    return float(wrench[2] - (at[0] * wrench[1] - at[1] * wrench[0]))


def _scaled(load: Any, size: float) -> Any:
    force, moment = (tuple(size * c + 0.0 for c in part) for part in (load.force, load.moment))
    return replace(load, force=force, moment=moment)


def _named(placed: Any) -> Any:
    return replace(placed.leaf, name=placed.name, start_block=placed.a, end_block=placed.b)


def _checked(made: RestShape, moves: Mapping[str, RigidMove], mesh: Mesh) -> RestShape:
    """The rest shape, solved forward."""
    try:
        pose = solve(made, dict(made.targets), mesh=mesh, strict=False, estimate=False, method="conventional")
    except KsdError as reason:
        return replace(made, checked=f"{_in_equilibrium(made, moves, mesh)}not solved forward: {reason}")
    turn, shift, rotation = np.empty(3), 0.0, 0.0
    for link, move in moves.items():
        i = pose.model.node_names.index(link)
        shift = max(shift, float(np.linalg.norm(pose.motion.x[i] - _back(move, pose.model.rest.x[i]))))
        rotation_log(pose.motion.R[i] @ move.rotation, turn)
        rotation = max(rotation, float(np.linalg.norm(turn)))
    size = pose.model.arrays.size
    said = f"{format_number(1e3 * shift, 2, zero=1e-9 * size)} mm and {format_number(rotation, 2, zero=1e-12)} rad"
    words = f"solved forward it comes back to the wanted shape within {said}"
    if shift > RETURNED * size or rotation > 10 * RETURNED:
        words = f"{_in_equilibrium(made, moves, mesh)}solved forward from rest it ends elsewhere, {said} off"
    elif not pose.stable:
        words += ", where it is not stable"
    elif snapped := _snapped(made, pose):
        words = f"solved forward its links come back to the wanted shape within {said}, but {snapped}"
    return replace(made, displacement=shift, rotation=rotation, checked=words)


def _snapped(made: RestShape, pose: Configuration) -> str:
    """What is said of the leaf spring that is bent otherwise than wanted, with its links in place; empty where none is."""
    for name, forces in pose.section_forces().items():
        wanted, found = made.leaf_forces[name][2:], forces.values[[0, -1], 5]
        if np.abs(found - wanted).max() > SNAPPED * max(np.abs(found).max(), np.abs(wanted).max()):
            return (
                f"leaf spring '{name}' snaps into another shape, {format_number(float(found[-1]), 2)} Nm at its end instead "
                f"of {format_number(float(wanted[-1]), 2)}: from rest it has to be led there by hand"
            )
    return ""


def _back(move: RigidMove, point: Array) -> Array:
    """Where a point (3,) of a link at rest is wanted."""
    return np.asarray(move.rotation.T @ (point - move.shift))


def _in_equilibrium(made: RestShape, moves: Mapping[str, RigidMove], mesh: Mesh) -> str:
    """What holding it in the wanted shape says, where the forward solution does not come there; empty where that fails."""
    try:
        solver = prepare(made, mesh=mesh)
        rest = dict(zip(solver.model.node_names, solver.model.rest.x, strict=True))
        poses = {n: (_back(m, rest[n]) - rest[n], m.rotation.T) for n, m in moves.items()}
        need = required_loads(solver, poses)
    except KsdError:
        return ""
    left = max(float(np.abs(w[:3]).max()) for w in need.unbalanced.values())
    inside = max(float(np.hypot(*f[:2])) for f in made.leaf_forces.values())
    if left > RETURNED * inside:
        return f"held in the wanted shape {format_number(left, 2)} N are missing to equilibrium; "
    return "in equilibrium in the wanted shape, where it has to be led by hand or is not stable: "


__all__ = ["rest_shape"]

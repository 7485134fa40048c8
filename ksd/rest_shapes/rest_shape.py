"""`ksd.rest_shape`: the mechanism that takes a wanted shape when it is loaded.

Lan (2005), chapter 5, inverse problem: given the deformed lines of all leaf springs, the undeformed ones follow from the
forces in them without iteration (`ksd.rest_shapes.rest_leaf`). Forces that equilibrium does not determine are those for
which the undeformed mechanism closes (`ksd.rest_shapes.rest_equations`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.answers.printing import format_number
from ksd.checks import boolean, clear_argument_errors, name_hint, show
from ksd.checks import number as checked_number
from ksd.errors import ConvergenceError, KsdError, SceneError
from ksd.model.leaves import cut_leaves
from ksd.model.mesh import Mesh
from ksd.numerics.rotations import rotation_log
from ksd.numerics.threads import small_matrices
from ksd.rest_shapes.rest_equations import (
    ConstraintRow,
    PrescribedForce,
    RestEquations,
    RestSolution,
    Term,
    solve_rest_equations,
)
from ksd.rest_shapes.rest_leaf import DeformedLeaf, PlaneAxes, deformed_curve, plane_axes, rotation_matrix
from ksd.rest_shapes.rest_result import CHECK_MESH, RestShape, leaf_pieces
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
from ksd.solvers.configuration import Configuration
from ksd.solvers.required_loads import prescribed_pose, required_loads
from ksd.solvers.solver import given_values, prepare, solve

Array = NDArray[np.float64]
LeafPiece = tuple[str, str, str, Leaf]
"""A leaf spring, or its piece between points on it: name, links at its start and end, leaf."""
RETURN_TOLERANCE = 1e-4
"""Largest displacement, over the size of the mechanism, and tenth of the rotation [rad], at which the forward solution has
returned to the wanted shape."""
SNAP_TOLERANCE = 0.1
"""Difference of the end moments of a leaf spring, over the largest one, above which it has snapped into another shape."""
UNSUPPORTED = {
    "joints": "joints (put their leaf springs in with mechanism.constrain)",
    "springs": "springs",
    "compliances": "elastic links",
    "heats": "heat",
    "fits": "assembly errors and preloads",
    "line_loads": "loads along leaf springs",
    "pressures": "loads along leaf springs",
}
"""Parts that a scene may not have, by its fields, in words for a message."""


# shapes on the way to an answer may overflow; what is not finite is refused or left by a shorter step
@clear_argument_errors
@small_matrices
@np.errstate(all="ignore")
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

    mechanism: drawn in the wanted shape, with the loads that act then; lies in a plane. wanted: None for the shape as drawn;
    a pose of this mechanism (`ksd.solve`), whose shape is taken and whose loads may be others; or poses by link, given as in
    `ksd.required_loads`, between which leaf springs bend as they are. Drive values [m or rad] by name: displacement of each
    drive from the undeformed to the wanted shape; those of the pose by default. free: names of loads of unknown size, and of
    drives of unknown value; forces: as many known forces in exchange, of drives {"push": 3.0} [N or Nm], or within leaf
    springs {"left": {"x": -5.0}} [N], global component of what the part beyond exerts on the leaf at its end. The undeformed
    loops close, with clamped angles: that determines all other forces. The solution is followed from the unloaded drawing;
    beyond_fold takes the other one, around the fold of the path. check: solve forward, on leaf springs of `mesh`.

    Raises SceneError for scenes and arguments without a rest shape, ConvergenceError beyond a fold, with the load fraction
    up to which there is a solution. Source: Lan (2005), chapter 5; extended by stretch, shear and weight of leaf springs.

    >>> spring = ksd.Mechanism("spring", plane="xy")
    >>> leaf = spring.leaf(
    ...     "ground", spring.link("tip"), start=(0, 0, 0), end=(80 * mm, 0, 0),
    ...     section=ksd.rectangle(0.5 * mm, 10 * mm), material=ksd.Material(E=200 * GPa, nu=0.3),
    ... )
    >>> load = spring.load("tip", force=(0, -2, 0), at=(80 * mm, 0, 0))
    >>> pose = ksd.solve(ksd.rest_shape(spring))
    >>> print(f"down by {-pose.links['tip'][0][1] / mm:.3f} mm, to where it was drawn")
    down by 16.208 mm, to where it was drawn
    """
    scene = mechanism.scene() if isinstance(mechanism, Mechanism) else mechanism
    if not isinstance(scene, Scene):
        raise SceneError(f"rest_shape: {show(mechanism)} is no mechanism; give a ksd.Mechanism or its scene.")
    for key, value in (("beyond_fold", beyond_fold), ("check", check)):
        boolean(value, key)
    _check_supported(scene)
    axes, values = plane_axes(str(scene.plane)), given_values(targets, drives)
    drawn, pieces, values = _drawn_in_wanted_shape(scene, wanted, axes, values, mesh)
    problem = RestShapeProblem(
        drawn,
        pieces,
        axes,
        values,
        (free,) if isinstance(free, str) else tuple(free),
        forces or {},
        mesh or CHECK_MESH,
    )
    solution = solve_rest_equations(problem.equations, beyond_fold=beyond_fold)
    if solution.y is None:
        raise ConvergenceError(problem.no_solution_message(solution, beyond_fold))
    z = solution.y * problem.equations.scales
    moves = problem.link_moves(z)
    shape = problem.rest_shape(z, moves, solution.folds)
    return _with_forward_check(shape, moves, mesh or CHECK_MESH) if check else shape


def _check_supported(scene: Scene) -> None:
    """Raise SceneError for a scene without a plane, or with UNSUPPORTED parts."""
    if scene.plane is None:
        raise SceneError(
            f"rest_shape: mechanism '{scene.name}' names no plane, and rest shapes are found in one; say "
            f'ksd.Mechanism("{scene.name}", plane="xy").'
        )
    for key, words in UNSUPPORTED.items():
        if getattr(scene, key):
            raise SceneError(
                f"rest_shape: '{scene.name}' has {words}, of which rest shapes are not known; leave them out."
            )


def _drawn_in_wanted_shape(
    scene: Scene, wanted: Any, axes: PlaneAxes, values: dict[str, float], mesh: Mesh | None
) -> tuple[Scene, list[LeafPiece], dict[str, float]]:
    """The scene drawn in its wanted shape, the pieces of its leaf springs, and its drive values. Raises SceneError."""
    if wanted is None:
        return scene, cut_leaves(scene), values
    if isinstance(wanted, Mapping):
        wanted = prescribed_pose(prepare(scene, mesh=mesh or CHECK_MESH), wanted)
    elif isinstance(wanted, Configuration):
        values = {n: v for n, v in wanted.targets.items() if n in {d.name for d in scene.drives}} | values
    else:
        raise SceneError(
            f"rest_shape: wanted = {show(wanted)}: give a pose (ksd.solve), poses by link, or nothing for the drawing."
        )
    model, motion = wanted.unreduced_equilibrium
    whole_leaves = {name: whole for name, whole, _ in leaf_pieces(scene)}
    if not set(scene.links) <= set(model.node_names) or set(whole_leaves) != set(model.member_names):
        raise SceneError(
            f"rest_shape: the wanted pose is one of another mechanism, '{model.scene.name}'; give one of '{scene.name}' "
            "itself, or of one with its links, leaf springs and points by the same names."
        )
    if not model.has_strain_leaves_only:
        raise SceneError(
            "rest_shape: the wanted pose is one of chains or reduced bodies; solve it without mesh= and basis=."
        )
    gravity = wanted.load_factor * _gravity(model.scene, axes)
    moves = {
        link: RigidMove(motion.R[i], motion.x[i] - motion.R[i] @ model.rest.x[i])
        for i, link in enumerate(model.node_names)
    }
    curves: dict[str, list[Legendre]] = {}
    pieces: list[LeafPiece] = []
    for name, a, b, leaf in cut_leaves(scene):
        whole, i = whole_leaves[name], model.member_names.index(name)
        curve = deformed_curve(leaf, model.mesh.for_leaf(whole), axes, (model, motion, i), gravity)
        curves.setdefault(whole, []).append(curve)
        # a force at a point changes the angle between line and sections there, by shear: each piece has its own curve
        ends = moves[a].move_point(leaf.start), moves[b].move_point(leaf.end)
        pieces.append((name, a, b, replace(leaf, start=ends[0], end=ends[1], curve=FreeCurve.of(curve))))
    return Scene(**scene_with_moved_links(scene, moves, curves)), pieces, values


def _gravity(scene: Scene, axes: PlaneAxes) -> Array:
    """Gravity (2,) [m/s^2] in the plane. Raises SceneError where it leaves the plane."""
    if scene.gravity is None:
        return np.zeros(2)
    if abs(scene.gravity[axes.normal]) > 1e-12 * float(np.abs(scene.gravity).max()):
        raise SceneError(f"rest_shape: gravity leaves the plane {scene.plane}; keep it in the plane.")
    return axes.project(scene.gravity)


class RestShapeProblem:
    """Equations of a scene drawn in its wanted shape, and the undeformed scene of their solution; positions are relative to
    `origin` (2,), the mean of the leaf ends."""

    def __init__(
        self, scene: Scene, pieces: list[LeafPiece], axes: PlaneAxes, values: Mapping[str, float],
        free: tuple[str, ...], forces: Mapping[str, Any], mesh: Mesh,
    ) -> None:  # fmt: skip
        self.scene, self.axes, self.values, self.free, self.forces = scene, axes, values, free, forces
        ends = np.array([axes.project(p) for f in scene.leaves for p in (f.leaf.start, f.leaf.end)])
        self.origin = ends.mean(axis=0)
        length_scale = float(np.ptp(ends, axis=0).max())
        self.link_index = {link: i for i, link in enumerate(scene.links)}
        self.leaves = tuple(
            DeformedLeaf(name, (a, b), leaf, axes, self.origin, mesh) for name, a, b, leaf in pieces
        )
        bending = float(np.mean([1.0 / leaf.bending.mean() for leaf in self.leaves]))
        self.loads = {load.name: load for load in scene.loads}
        self._check_free()
        constraints = (*scene.drives, *scene.supports)
        rows = tuple(row for d in constraints if (row := self._constraint_row(d)) is not None)
        loads = [(load.name in free, self.link_index[load.link], self._wrench(load)) for load in scene.loads]
        known_loads = [(link, wrench) for is_free, link, wrench in loads if not is_free]
        gravity = _gravity(scene, axes)
        for mass in scene.masses:
            at = axes.project(mass.at) - self.origin
            weight = mass.mass * gravity
            moment = at[0] * weight[1] - at[1] * weight[0]
            known_loads.append((self.link_index[mass.link], np.array([*weight, moment])))
        self.equations = RestEquations(
            leaves=self.leaves,
            ends=tuple((self.link_index[leaf.a], self.link_index[leaf.b]) for leaf in self.leaves),
            link_count=len(scene.links),
            rows=rows,
            known_loads=tuple(known_loads),
            free_loads=tuple((link, wrench) for is_free, link, wrench in loads if is_free),
            prescribed_forces=tuple(self._prescribed_forces(rows)),
            gravity=gravity,
            length_scale=length_scale,
            force_scale=bending / length_scale**2,
        )

    def _check_free(self) -> None:
        """Raise SceneError for unknown names, for drives that are neither free nor have a value, and where the number of
        forces is not that of free loads and drives."""
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
        for name in self.values:
            if name not in drives:
                raise SceneError(
                    f"rest_shape: there is no drive {show(name)}; there are {', '.join(drives) or 'none'}"
                    f"{name_hint(name, drives)}"
                )
        for name in drives:
            if name not in self.values and name not in self.free:
                raise SceneError(
                    f"rest_shape: drive '{name}' has no value: say how far it has moved from rest in the wanted shape, "
                    f"{name}=..., or its force instead, free='{name}', forces={{'{name}': ...}}."
                )
        count = sum(len(f) if isinstance(f, Mapping) else 1 for f in self.forces.values())
        if count != len(self.free):
            raise SceneError(
                f"rest_shape: {len(self.free)} loads or drives are free ({', '.join(self.free) or 'none'}) and {count} "
                "forces are given; give as many forces as there are free ones."
            )

    def _constraint_row(self, drive: Drive) -> ConstraintRow | None:
        """A drive or support in the plane; None for one that acts out of the plane. Raises SceneError for one askew."""
        k, terms = self.axes.normal, []
        for t in drive.terms:
            normal, is_rotation = float(t.direction[k]), t.kind == "rotation"
            if abs(normal) > 1e-9 and abs(abs(normal) - 1.0) > 1e-9:
                raise SceneError(
                    f"rest_shape: '{drive.name}' is askew of the plane {self.scene.plane}; keep it in the plane."
                )
            if (abs(normal) > 0.5) != is_rotation:
                continue
            direction = np.array([np.sign(normal)]) if is_rotation else self.axes.project(t.direction)
            point = self.axes.project(t.point) - self.origin
            base, link = self.link_index[t.base], self.link_index[t.link]
            terms.append(Term(t.coefficient, is_rotation, base, link, direction, point))
        if not terms:
            return None
        if drive.name in self.free:
            value = None
        elif drive.name in {d.name for d in self.scene.drives}:
            value = float(self.values[drive.name])
        else:
            value = 0.0
        return ConstraintRow(drive.name, tuple(terms), value)

    def _wrench(self, load: Any) -> Array:
        """Force and moment about the origin (3,) of a load. Raises SceneError where it leaves the plane."""
        k = self.axes.normal
        size = max(float(np.abs(load.force).max()), float(np.abs(load.moment).max()))
        if abs(load.force[k]) > 1e-12 * size or np.abs(self.axes.project(load.moment)).max() > 1e-12 * size:
            raise SceneError(
                f"rest_shape: load '{load.name}' leaves the plane {self.scene.plane}; keep it in the plane."
            )
        at, force = self.axes.project(load.at) - self.origin, self.axes.project(load.force)
        return np.array([*force, at[0] * force[1] - at[1] * force[0] + load.moment[k]])

    def _prescribed_forces(self, rows: tuple[ConstraintRow, ...]) -> Iterable[PrescribedForce]:
        """Known forces of drives and within leaf springs. Raises SceneError."""
        drives, known = [d.name for d in self.scene.drives], [leaf.name for leaf in self.leaves]
        axes = ["xyz"[k] for k in self.axes.in_plane]
        for name, force in self.forces.items():
            if name in drives and not isinstance(force, Mapping):
                value = checked_number(force, f"force of drive '{name}'", owner="rest_shape")
                yield PrescribedForce([r.name for r in rows].index(name), None, 0, value)
                continue
            if name not in known or not isinstance(force, Mapping):
                raise SceneError(
                    f"rest_shape: forces: {show(name)}: {show(force)} must be the force of a drive "
                    f"({', '.join(drives) or 'none'}), or components of that in a leaf ({', '.join(known)}), such as "
                    f"{{'{known[0]}': {{'{axes[0]}': -5.0}}}}."
                )
            for component, value in force.items():
                if component not in axes:
                    raise SceneError(
                        f"rest_shape: forces: '{name}' has no component {show(component)}; give '{axes[0]}' or '{axes[1]}'."
                    )
                value = checked_number(value, f"force in leaf '{name}'", owner="rest_shape")
                yield PrescribedForce(None, known.index(name), axes.index(component), value)

    def no_solution_message(self, solution: RestSolution, beyond_fold: bool) -> str:
        """Why there is no solution."""
        name, fold = self.scene.name, solution.folds[0] if solution.folds else None
        if fold is None and beyond_fold:
            return f"rest_shape: no second rest shape of '{name}' is found: its path does not fold; leave beyond_fold out."
        if fold is None:
            return f"rest_shape: the way to the rest shape of '{name}' ends; ask for smaller loads, forces or drive values."
        if beyond_fold:
            return f"rest_shape: around the fold at {100 * fold:.4g} % of the loads is no other rest shape of '{name}'."
        sizes = [
            f"'{n}' {c}{fold * v:.5g}"
            for n, force in self.forces.items()
            for c, v in (force.items() if isinstance(force, Mapping) else (("", force),))
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

    def link_moves(self, z: Array) -> dict[str, RigidMove]:
        """Move of every link from the wanted to the undeformed configuration, from the unknowns z (n,)."""
        first = self.equations.offsets.link_poses
        return {
            link: self._rigid_move(z[first + 3 * (i - 1) :][:3]) for link, i in self.link_index.items() if i
        }

    def _rigid_move(self, pose: Array) -> RigidMove:
        """Move of a link in space from its pose (3,) in the plane: displacement of the origin and angle."""
        in_plane, turn, shift = list(self.axes.in_plane), np.eye(3), np.zeros(3)
        R = rotation_matrix(pose[2])
        turn[np.ix_(in_plane, in_plane)] = R
        shift[in_plane] = self.origin + pose[:2] - R @ self.origin
        return RigidMove(turn, shift)

    def rest_shape(self, z: Array, moves: Mapping[str, RigidMove], folds: tuple[float, ...]) -> RestShape:
        """The undeformed scene, from the unknowns z (n,)."""
        at, equations = self.equations.offsets, self.equations
        curves: dict[str, list[Legendre]] = {}
        leaf_forces: dict[str, Array] = {}
        pieces = list(zip(self.leaves, leaf_pieces(self.scene), range(len(self.leaves)), strict=True))
        for whole, group in groupby(pieces, key=lambda piece: piece[1][1]):
            parts = [(leaf, z[3 * k : 3 * k + 3]) for leaf, _, k in group]
            undeformed = [leaf.undeformed(w[None], equations.gravity) for leaf, w in parts]
            curves[whole] = [leaf.undeformed_curve(u) for (leaf, _), u in zip(parts, undeformed, strict=True)]
            (first, _), (last, w) = parts[0], parts[-1]
            start_wrench = undeformed[0].start_wrench[0]
            leaf_forces[whole] = np.array(
                [*w[:2], _moment_at(start_wrench, first.start), _moment_at(w, last.end)]
            )
        free_loads = [load.name for load in self.scene.loads if load.name in self.free]
        factors = dict(zip(free_loads, z[at.load_factors : at.drive_values].tolist(), strict=True))
        free_rows = [r.name for r in equations.rows if r.value is None]
        free_values = dict(zip(free_rows, z[at.drive_values :].tolist(), strict=True))
        row_forces = z[at.row_forces : at.load_factors].tolist()
        forces = dict(zip([r.name for r in equations.rows], row_forces, strict=True))
        drives = [d.name for d in self.scene.drives]
        parts_of_scene = scene_with_moved_links(self.scene, moves, curves)
        parts_of_scene["loads"] = tuple(
            _scaled_load(load, factors.get(load.name, 1.0)) for load in parts_of_scene["loads"]
        )
        scene = Scene(**parts_of_scene)
        boxes = [leaf_boxes(_named_leaf(f), count=FINE_BOX_COUNT) for f in scene.leaves]
        pairs = [pair for pair, _ in overlapping_leaves(boxes, tolerance=OVERLAP_TOLERANCE)]
        return RestShape(
            **{f.name: getattr(scene, f.name) for f in fields(Scene)},
            wanted=self.scene,
            targets={n: free_values.get(n, float(self.values.get(n, 0.0))) for n in drives},
            forces={n: forces[n] for n in drives},
            leaf_forces=leaf_forces,
            folds=folds,
            crossings=(*pairs, *((b.name, b.name) for b in boxes if overlaps_itself(b))),
        )


def _moment_at(wrench: Array, point: Array) -> float:
    """Moment [Nm] of a wrench (3,) about a point (2,)."""
    return float(wrench[2] - (point[0] * wrench[1] - point[1] * wrench[0]))


def _scaled_load(load: Any, factor: float) -> Any:
    force, moment = (tuple(factor * c + 0.0 for c in part) for part in (load.force, load.moment))
    return replace(load, force=force, moment=moment)


def _named_leaf(placed: Any) -> Any:
    """The leaf of a placed leaf, with its name and its links."""
    return replace(placed.leaf, name=placed.name, start_block=placed.a, end_block=placed.b)


def _with_forward_check(shape: RestShape, moves: Mapping[str, RigidMove], mesh: Mesh) -> RestShape:
    """The rest shape with the result of its forward solution."""
    try:
        pose = solve(
            shape, dict(shape.targets), mesh=mesh, strict=False, estimate=False, method="conventional"
        )
    except KsdError as reason:
        return replace(shape, checked=f"{_equilibrium_check(shape, moves, mesh)}not solved forward: {reason}")
    turn, shift, rotation = np.empty(3), 0.0, 0.0
    for link, move in moves.items():
        i = pose.model.node_names.index(link)
        distance = pose.motion.x[i] - _wanted_point(move, pose.model.rest.x[i])
        shift = max(shift, float(np.linalg.norm(distance)))
        rotation_log(pose.motion.R[i] @ move.rotation, turn)
        rotation = max(rotation, float(np.linalg.norm(turn)))
    size = pose.model.arrays.size
    off = f"{format_number(1e3 * shift, 2, zero=1e-9 * size)} mm and {format_number(rotation, 2, zero=1e-12)} rad"
    checked = f"solved forward it comes back to the wanted shape within {off}"
    if shift > RETURN_TOLERANCE * size or rotation > 10 * RETURN_TOLERANCE:
        equilibrium = _equilibrium_check(shape, moves, mesh)
        checked = f"{equilibrium}solved forward from rest it ends elsewhere, {off} off"
    elif not pose.stable:
        checked += ", where it is not stable"
    elif snapped := _snapped_leaf_message(shape, pose):
        checked = f"solved forward its links come back to the wanted shape within {off}, but {snapped}"
    return replace(shape, displacement=shift, rotation=rotation, checked=checked)


def _snapped_leaf_message(shape: RestShape, pose: Configuration) -> str:
    """Message about a leaf spring of the forward solution that is bent into another shape than wanted; "" if none is."""
    for name, forces in pose.section_forces().items():
        wanted, actual = shape.leaf_forces[name][2:], forces.values[[0, -1], 5]
        largest = max(np.abs(actual).max(), np.abs(wanted).max())
        if np.abs(actual - wanted).max() > SNAP_TOLERANCE * largest:
            return (
                f"leaf spring '{name}' snaps into another shape, {format_number(float(actual[-1]), 2)} Nm at its end "
                f"instead of {format_number(float(wanted[-1]), 2)}: from rest it has to be led there by hand"
            )
    return ""


def _wanted_point(move: RigidMove, point: Array) -> Array:
    """Position (3,) [m] in the wanted shape of a point of a link; `move`: of the link from there to the undeformed shape."""
    return np.asarray(move.rotation.T @ (point - move.shift))


def _equilibrium_check(shape: RestShape, moves: Mapping[str, RigidMove], mesh: Mesh) -> str:
    """Whether the shape is in equilibrium when its links are held in the wanted poses, in words; "" where that fails."""
    try:
        solver = prepare(shape, mesh=mesh)
        rest = dict(zip(solver.model.node_names, solver.model.rest.x, strict=True))
        poses = {n: (_wanted_point(m, rest[n]) - rest[n], m.rotation.T) for n, m in moves.items()}
        loads = required_loads(solver, poses)
    except KsdError:
        return ""
    unbalanced = max(float(np.abs(w[:3]).max()) for w in loads.unbalanced.values())
    leaf_force = max(float(np.hypot(*f[:2])) for f in shape.leaf_forces.values())
    if unbalanced > RETURN_TOLERANCE * leaf_force:
        return f"held in the wanted shape {format_number(unbalanced, 2)} N are missing to equilibrium; "
    return "in equilibrium in the wanted shape, where it has to be led by hand or is not stable: "

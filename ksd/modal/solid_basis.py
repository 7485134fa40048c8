"""A reduced solid: Craig-Bampton modes and modal derivatives of a meshed solid, and its exact polynomial energy.

The displacement patterns of the two rigid end faces are linear in the rotation matrices of the faces, so finite rotations
are exact and the second-order terms of a rotation are patterns of the faces, not derivatives. Chord frame (default) or node
frame, internal modes and derivatives are those of the leaf springs. Because Green-Lagrange strain is quadratic, the energy
in these coordinates is a polynomial of fourth order whose tensors are computed once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ksd.checks import show
from ksd.elements.modal_jets import JET
from ksd.elements.polynomial_solid import face_jets
from ksd.errors import SceneError
from ksd.modal.choices import ModalBasis
from ksd.modal.solid import Solid
from ksd.modal.symmetry import MirrorPlanes, condition_by_parity, mirror_planes, split_by_parity
from ksd.model.arrays import SOLID
from ksd.model.compile import Model
from ksd.model.reduced_bodies import with_bodies
from ksd.numerics.reduction import Modes, craig_bampton, modal_derivatives, static_extension


@dataclass(frozen=True, repr=False)
class SolidBasis:
    """A reduced solid: displacement = patterns (size, nb) (b - b0) + inner (size, m) eta, in the frame `frame`.

    b (nb,): the entries `pose_indices` of the pose values of `ksd.elements.polynomial_solid.face_jets`; b0 (nb,): the
    same at rest; value, number: the constants of that kernel; condition: condition number of the inner columns.
    """

    solid: Solid
    frame: str
    pose_indices: tuple[int, ...]
    b0: np.ndarray
    patterns: np.ndarray
    inner: np.ndarray
    value: np.ndarray
    number: np.ndarray
    condition: float
    kind, word, trained = SOLID, "solid", False

    def __repr__(self) -> str:
        # distinguished by identity, since solvers are cached by the text of their basis
        return f"<SolidBasis of {self.unknowns} coordinates, {self.frame} frame, at {id(self):#x}>"

    @property
    def unknowns(self) -> int:
        """Number of coordinates of the energy polynomial."""
        return int(self.number[1] + self.number[2])

    def constants(self) -> tuple[np.ndarray, np.ndarray]:
        """`value` and `number` of `ksd.elements.polynomial_solid`."""
        return self.value, self.number

    def stroke_and_rotation(self, d: np.ndarray, R: np.ndarray, eta: np.ndarray) -> tuple[float, float]:
        """Displacement of face B over the length, and its rotation [rad], in the frame of face A."""
        stroke = float(np.linalg.norm(d - [self.solid.length, 0.0, 0.0])) / self.solid.length
        return stroke, float(np.arccos(np.clip(0.5 * (np.trace(R) - 1.0), -1.0, 1.0)))

    def energy(self, d: np.ndarray, R: np.ndarray, eta: np.ndarray) -> float:
        """Strain energy [J]."""
        return self.solid.energy(self.displacements(d, R, eta))

    def displacements(self, d: np.ndarray, R: np.ndarray, eta: np.ndarray) -> np.ndarray:
        """Displacements (size,) [m] of the full model at a state of the reduced one: face B at d (3,) [m], R (3, 3)."""
        solid, jets = self.solid, np.empty((19, JET))
        face_jets(int(self.frame == "chord"), d, R, jets)
        u = self.patterns @ (jets[list(self.pose_indices), 0] - self.b0) + self.inner @ eta
        if self.frame == "node":
            return np.asarray(u)
        # rotated from the chord frame into that of face A
        turn, found = jets[1:10, 0].reshape(3, 3), np.empty_like(u)
        dim = 2 if solid.is_2d else 3
        at = [np.flatnonzero(solid.component == c) for c in range(dim)]
        at = [a[np.lexsort(solid.position[a].T)] for a in at]
        points = np.zeros((3, len(at[0])))
        for c in range(dim):
            points[c] = solid.position[at[c], c] + u[at[c]]
        points = turn @ points
        for c in range(dim):
            found[at[c]] = points[c] - solid.position[at[c], c]
        return found

    def middle_line(
        self, d: np.ndarray, R: np.ndarray, eta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stations (k,) [m], positions (k, 3) [m] and axes (k, 3, 3) of the middle line, in the frame of face A.

        The middle of a section is the mean of its degrees of freedom at rest; the axes follow the line and the width.
        """
        solid, u = self.solid, self.displacements(d, R, eta)
        dim = 2 if solid.is_2d else 3
        tolerance = 1e-9 * solid.length
        s, section = np.unique(np.round(solid.position[:, 0] / tolerance), return_inverse=True)
        s, count = tolerance * s, len(s)
        middle = np.zeros((count, 3))
        middle[:, 0] = s
        for c in range(dim):
            own = solid.component == c
            middle[:, c] += np.bincount(section[own], u[own], count) / np.bincount(section[own], None, count)
        along: np.ndarray = np.asarray(np.gradient(middle, s, axis=0))
        along[0], along[-1] = (1.0, 0.0, 0.0), R[:, 0]
        # the width direction, interpolated along the line between the faces
        width = (1 - s / s[-1])[:, None] * np.array([0.0, 0.0, 1.0]) + (s / s[-1])[:, None] * R[:, 2]
        e1 = along / np.linalg.norm(along, axis=1)[:, None]
        e2 = np.cross(width, e1)
        e2 /= np.linalg.norm(e2, axis=1)[:, None]
        return s, middle, np.stack([e1, e2, np.cross(e1, e2)], axis=2)


def _face_patterns(solid: Solid, frame: str) -> tuple[list[int], list[float], list[np.ndarray]]:
    """Indices into the pose values, values at rest, and displacement patterns of the faces.

    The first columns of the rotation matrices are left out, since the faces have no extent along x.
    """
    flat = solid.is_2d
    dim, length = (2, solid.length) if flat else (3, solid.length)
    found: list[tuple[int, float, np.ndarray]] = []
    ends = [("b", 3 if frame == "node" else 10)] + ([("a", 1)] if frame == "chord" else [])
    for row in range(dim if frame == "node" else 1):
        found.append((row, length if row == 0 else 0.0, solid.face_displacement("b", row, -1)))
    for end, first in ends:
        for column in range(1, dim):
            for row in range(dim):
                found.append(
                    (
                        first + 3 * column + row,
                        float(row == column),
                        solid.face_displacement(end, row, column),
                    )
                )
    at, rest, patterns = zip(*found, strict=True)
    return list(at), list(rest), list(patterns)


def _first_order_motions(solid: Solid, frame: str) -> list[np.ndarray]:
    """First-order motions (size,) of the faces, of which derivatives are taken."""
    flat = solid.is_2d
    axes = [2] if flat else [1, 2]

    def turn(end: str, axis: int) -> np.ndarray:
        u = np.zeros(solid.dof_count)
        # unit rotation about `axis` by cyclic permutation: u_j = x_i, u_i = -x_j
        i, j = (axis + 1) % 3, (axis + 2) % 3
        for row, column, sign in ((j, i, 1.0), (i, j, -1.0)):
            if row < (2 if flat else 3) and column > 0:
                u += sign * solid.face_displacement(end, row, column)
        return u

    shifts = range(1 if frame == "chord" else (2 if flat else 3))
    # scaled like the rotations, whatever the unit of length, since small columns are dropped
    found = [solid.length * solid.face_displacement("b", row, -1) for row in shifts]
    found += [turn("b", axis) for axis in ([2] if flat else [0, 1, 2])]
    if frame == "chord":
        found += [turn("a", axis) for axis in axes]
    return found


def _derivatives(solid: Solid, modes: np.ndarray, inner: Any, order: int) -> list[np.ndarray]:
    """Derivatives (size,) of the modes (size, k) along each other."""
    followed = Modes(modes, 0, np.zeros(0))
    distance = 0.1 * solid.length

    def along(v: np.ndarray) -> Any:
        # the tangent is quadratic in displacement, so this difference is exact at any distance
        scale = distance / np.abs(v).max()
        return (solid.tangent(scale * v) - solid.tangent(-scale * v)) / (2.0 * scale)

    found = modal_derivatives(solid.tangent, followed, inner, step=0.01, order=order, analytic=along)
    return list(found.shapes.T)


def reduce_solid(
    solid: Solid, *, frame: str = "chord", internal: int = 2, order: int = 2, cut: float = 1e-7
) -> SolidBasis:
    """Basis and polynomial of a solid.

    frame, internal, order, cut: as in `ksd.ModalBasis`. Raises SceneError for values that are not possible.
    """
    ModalBasis(frame=frame, internal=internal, order=order, cut=cut)
    rest, inner, planes = solid.tangent(np.zeros(solid.dof_count)), solid.inner, mirror_planes(solid)
    at, b0, faces = _face_patterns(solid, frame)
    patterns = np.array(faces).T + static_extension(rest, np.array(faces).T, inner)
    patterns, sides = split_by_parity(patterns, planes)
    first = np.array(_first_order_motions(solid, frame)).T
    first = first + static_extension(rest, first, inner)
    vibration = _vibration(solid, rest, internal, planes)
    columns = [*vibration.T]
    if order > 1:
        columns += _derivatives(solid, np.hstack([first, vibration * solid.length]), inner, order)
    basis, parity = condition_by_parity(np.array(columns).T.reshape(solid.dof_count, -1), planes, cut=cut)
    every, parity = np.hstack([patterns, basis.columns]), np.concatenate([sides, parity])
    value = np.concatenate([at, b0, energy_tensors(solid, every, parity)])
    number = np.array([0, basis.columns.shape[1], len(at), int(frame == "chord")], np.int64)
    return SolidBasis(
        solid, frame, tuple(at), np.array(b0), patterns, basis.columns, value, number, basis.condition
    )


def _vibration(solid: Solid, rest: Any, internal: int, planes: MirrorPlanes) -> np.ndarray:
    """Fixed-interface modes (size, internal), each even or odd; modes of equal frequency, which may mix, are separated."""
    mass = solid.mass()
    found = craig_bampton(rest, [], solid.inner, M=mass, internal=internal).shapes
    pure, _ = split_by_parity(found, planes)
    if pure.shape[1] == internal:
        return pure
    single = condition_by_parity(found, planes, cut=1e-3)[0].columns
    square = np.einsum("ik,ik->k", single, rest @ single) / np.einsum("ik,ik->k", single, mass @ single)
    chosen = single[:, np.argsort(square, kind="stable")[:internal]]
    return np.asarray(chosen / np.abs(chosen).max(axis=0))


def energy_tensors(solid: Solid, columns: np.ndarray, parity: np.ndarray) -> np.ndarray:
    """Constants of `ksd.elements.polynomial_solid.quartic`: energy of displacements columns (size, M) y of given parity
    (M,).

    With H_a the gradients of the columns, E = sym(H_a) y_a + sym(H_a^T H_b) y_a y_b / 2; the tensors are the
    integrals of products of these by the elasticity, made symmetric in all indices. Products of other parity are zero.
    """
    M = columns.shape[1]
    H = np.array([solid.gradients(c) for c in columns.T])
    i, j = np.triu_indices(M)
    at = np.zeros((M, M), np.int64)
    at[i, j] = at[j, i] = np.arange(len(i))
    lin = _energy_scaled(solid, _strain(H)).reshape(M, -1)
    cross, square = np.zeros((M, len(i))), np.zeros((len(i), len(i)))
    both, families = parity[i] ^ parity[j], []
    for code in np.unique(both):
        some, pairs = np.flatnonzero(parity == code), np.flatnonzero(both == code)
        quad = np.array([_strain(np.einsum("kiq,kjq->ijq", H[i[p]], H[j[p]])[None])[0] for p in pairs])
        quad = _energy_scaled(solid, quad).reshape(len(pairs), -1)
        cross[np.ix_(some, pairs)], square[np.ix_(pairs, pairs)] = lin[some] @ quad.T, quad @ quad.T
        families.append((some, pairs))
    K2, K3, K4 = (lin @ lin.T)[i, j], _third(cross, at, i, j), _fourth(square, at, i, j)
    K2[both > 0] = 0.0
    parts: list[Any] = [np.zeros(M), [len(families)]]
    for some, pairs in families:
        parts += [[len(some), len(pairs)], some, i[pairs], j[pairs], K2[pairs]]
        parts += [K3[np.ix_(some, pairs)].ravel(), K4[np.ix_(pairs, pairs)].ravel()]
    return np.concatenate([np.asarray(p, float).ravel() for p in parts])


def _third(cross: np.ndarray, at: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Third-order tensor K3[a, bc] = L[a, bc] + L[b, ac] + L[c, ab] from L = linear times quadratic strain."""
    M = len(cross)
    a = np.arange(M)[:, None]
    return cross + cross[i[None, :], at[a, j[None, :]]] + cross[j[None, :], at[a, i[None, :]]]


def _fourth(square: np.ndarray, at: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Fourth-order tensor K4[ab, cd] = Q[ab, cd] + Q[ac, bd] + Q[ad, bc]."""
    total = square.copy()
    for p in range(len(i)):
        a, b = i[p], j[p]
        total[p] += square[at[a, i], at[b, j]] + square[at[a, j], at[b, i]]
    return total


def _strain(H: np.ndarray) -> np.ndarray:
    """Symmetric parts (k, components, points) of gradients (k, dim, dim, points), shear entries times sqrt 2."""
    dim = H.shape[1]
    parts = [H[:, r, r] for r in range(dim)]
    parts += [(H[:, r, c] + H[:, c, r]) / np.sqrt(2) for r in range(dim) for c in range(r + 1, dim)]
    return np.stack(parts, axis=1)


def _energy_scaled(solid: Solid, strain: np.ndarray) -> np.ndarray:
    """C^1/2 E sqrt(volume) of strains E, so that sums of their products are twice the elastic energy."""
    return np.einsum("rc,kcq->krq", solid.elastic_root, strain) * np.sqrt(solid.weights)


def with_solids(model: Model, solids: Mapping[str, SolidBasis]) -> Model:
    """`model` with the leaf springs named in `solids` replaced by reduced solids between the same ends.

    Raises SceneError for unknown names, for a solid of another length than its leaf, and for models with plates. A solid
    meshed in 2D has no stiffness out of its plane: constrain the mechanism there by supports.
    """
    _check_solids(model, solids)
    return with_bodies(model, solids)


def _check_solids(model: Model, solids: Mapping[str, SolidBasis]) -> None:
    """Raises SceneError where a solid cannot replace the leaf of its name."""
    if model.full is not None:
        raise SceneError(
            "solids and modal bodies cannot be combined; leave the other leaf springs as they are"
        )
    if model.choice is not None and model.choice["plate"].present:
        raise SceneError("solids cannot be combined with plate stiffening: compile without='plate'")
    members = model.arrays.members
    for name, body in solids.items():
        if not isinstance(body, SolidBasis):
            raise SceneError(
                f"solid '{name}' = {show(body)}: give what ksd.modal.solid_basis.reduce_solid returns"
            )
        if name not in model.member_names:
            raise SceneError(
                f"there is no leaf '{name}' to be a solid; the leaf springs are: {', '.join(model.member_names)}"
            )
        i = model.member_names.index(name)
        if len(model.arrays.weight) and model.arrays.weight[i, 0] > 0.0:
            raise SceneError(
                f"leaf '{name}' carries its own weight, which solids do not know: compile without='gravity', or give its "
                "material no density"
            )
        if abs(members.length[i] - body.solid.length) > 1e-9 * body.solid.length:
            raise SceneError(
                f"leaf '{name}' is {members.length[i]:.6g} m long, its solid {body.solid.length:.6g} m; make them equal"
            )

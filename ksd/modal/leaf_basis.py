"""The basis of one leaf: from a chain of Appendix A elements, at rest or in a given shape, to the span of its nodes.

Everything is made in additive coordinates of the nodes, displacement and rotation vector from the expansion point,
in the floating frame of the body; only then is it carried over to the values the body moves in (directors or
rotation vectors), where second and third order terms of a rotation become columns of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations

import numpy as np

from ksd.beam.modal import chain_tangent
from ksd.beam.modal_jets import JET, boundary_jets
from ksd.modal.choices import ModalBasis
from ksd.model.arrays import MODAL
from ksd.numerics.reduction import (
    Derivatives,
    Modes,
    condition_basis,
    craig_bampton,
    modal_derivatives,
    second_derivatives,
    split_boundary,
)

RECORD = 16
HOLD = 1e-4
"""Stiffness of columns without energy over the softest bending stiffness."""
IN_PLANE = (0, 1, 5)
"""Of six node coordinates those in the plane of a leaf: along, across its thickness, rotation about its width."""


@dataclass(frozen=True)
class LeafShape:
    """The expansion point: constants record (n, 25), positions x (n+1, 3) m and rotations from rest R (n+1, 3, 3),
    in the frame of end p."""

    record: np.ndarray
    x: np.ndarray
    R: np.ndarray

    @property
    def length(self) -> float:
        """Length of the leaf, m."""
        return float(self.record[:, 0].sum())


@dataclass(frozen=True)
class LeafBasis:
    """The span of one leaf's nodes: z = z0 + boundary (b - b0) + inner eta, node by node.

    z0 ((n+1) q,), boundary (.., nb), inner (.., m), hold (m,) Nm (see `_separated`), b0 (nb,), orientation (n+1, 9)
    (columns of the expansion point, in the floating frame); q = 9 values per node for directors, 6 for angles.
    condition: of `inner` before it was made orthonormal. tied ((n+1) q, nb + m, nb + m): second derivatives of z by all
    coordinates, on a quadratic manifold.
    """

    choices: ModalBasis
    record: np.ndarray
    orientation: np.ndarray
    z0: np.ndarray
    boundary: np.ndarray
    inner: np.ndarray
    hold_stiffness: np.ndarray
    b0: np.ndarray
    condition: float
    second_derivatives: np.ndarray | None = None

    kind, word = MODAL, "leaf"

    @property
    def trained(self) -> bool:
        """Whether it is good about a trained configuration alone."""
        return self.choices.expansion == "trained"

    def __str__(self) -> str:
        return str(self.choices)

    def boundary_values(self, d: np.ndarray, Q: np.ndarray) -> np.ndarray:
        """Boundary values b (nb,) with end q at d (3,) m, Q (3, 3) in the frame of end p."""
        reference = np.concatenate([self.orientation[0], self.orientation[-1]])
        jets = np.empty((len(self.b0), JET))
        angle = self.choices.coordinates == "angle"
        boundary_jets(int(self.choices.frame == "chord"), int(angle), reference, d, Q, jets)
        return np.asarray(jets[:, 0])

    def values(self, d: np.ndarray, Q: np.ndarray, eta: np.ndarray) -> np.ndarray:
        """Values z ((n+1) q,) of all nodes with end q at d, Q and inner coordinates eta (m,)."""
        y = np.concatenate([self.boundary_values(d, Q) - self.b0, eta])
        z = self.z0 + np.hstack([self.boundary, self.inner]) @ y
        return z if self.second_derivatives is None else z + 0.5 * (self.second_derivatives @ y) @ y

    def nodes(self, d: np.ndarray, Q: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n+1, 3) and rotations from rest (n+1, 3, 3) of all nodes, in the frame of end p."""
        from scipy.spatial.transform import Rotation

        z = self.values(d, Q, eta).reshape(-1, self.values_per_node)
        if self.choices.coordinates == "angle":
            start = self.orientation.reshape(-1, 3, 3).transpose(0, 2, 1)
            R = Rotation.from_rotvec(z[:, 3:]).as_matrix() @ start
        else:
            R = _frames(z[:, 3:6], z[:, 6:])
        return (z[:, :3] - z[0, :3]) @ R[0], np.einsum("ji,kjl->kil", R[0], R)

    def stroke_and_rotation(self, d: np.ndarray, Q: np.ndarray, eta: np.ndarray) -> tuple[float, float]:
        """Displacement of end q over the length, and the largest rotation [rad] of a node against the chord."""
        x, R = self.nodes(d, Q, eta)
        rest = undeformed_shape(self.record)
        cosine = np.einsum("i,ki->k", rotation_without_roll(x[-1])[:, 0], R[:, :, 0]).min()
        turn = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        return float(np.linalg.norm(x[-1] - rest.x[-1])) / rest.length, turn

    def nearest_coordinates(
        self, other: LeafBasis, d: np.ndarray, Q: np.ndarray, eta: np.ndarray
    ) -> np.ndarray:
        """Inner coordinates (m,) with the nodes nearest to those of another basis of the same leaf at its eta."""
        left = other.values(d, Q, eta) - self.values(d, Q, np.zeros(self.inner.shape[1]))
        return np.asarray(np.linalg.lstsq(self.inner, left, rcond=None)[0])

    @property
    def unknowns(self) -> int:
        """Independent boundary values and inner coordinates."""
        return int(np.linalg.matrix_rank(self.boundary)) + self.inner.shape[1]

    @property
    def values_per_node(self) -> int:
        """6 or 9."""
        return 6 if self.choices.coordinates == "angle" else 9

    def constants(self, weights: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """`value` and `number` of `ksd.beam.modal`, with the elements of nonzero weight."""
        q, n = self.values_per_node, len(self.record)
        w = np.ones(n) if weights is None else weights
        columns = np.hstack([self.boundary, self.inner])
        parts = [self.orientation[0], self.orientation[-1], self.b0, self.hold_stiffness]
        for e in np.flatnonzero(w):
            rows = slice(q * e, q * (e + 2))
            parts += [[w[e]], self.record[e], self.orientation[e : e + 2].ravel(), self.z0[rows]]
            parts.append(columns[rows].ravel())
            if self.second_derivatives is not None:
                parts.append(self.second_derivatives[rows].ravel())
        flags = (self.choices.frame == "chord") + 2 * (self.choices.coordinates == "angle")
        flags += 4 * (self.second_derivatives is not None)
        number = np.array([np.count_nonzero(w), self.inner.shape[1], len(self.b0), flags], np.int64)
        return np.concatenate([np.asarray(p, float).ravel() for p in parts]), number


def chain_records(value: np.ndarray, n: int) -> np.ndarray:
    """Constants (n, 25) of the single elements of a chain with constants `value` (16 n + 9,)."""
    return np.hstack([value[: RECORD * n].reshape(n, RECORD), np.tile(np.eye(3).ravel(), (n, 1))])


def undeformed_shape(record: np.ndarray) -> LeafShape:
    """The undeformed leaf."""
    steps = record[:, :1] * record[:, [7, 10, 13]]
    x = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    return LeafShape(record, x, np.tile(np.eye(3), (len(x), 1, 1)))


def rotation_without_roll(d: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) that takes e1 onto the direction of d without roll."""
    u = d / np.linalg.norm(d)
    k = 1.0 / (1.0 + u[0])
    return np.array(
        [[u[0], -u[1], -u[2]], [u[1], 1 - k * u[1] ** 2, -k * u[1] * u[2]], [u[2], -k * u[1] * u[2], 1 - k * u[2] ** 2]]
    )  # fmt: skip


def _frames(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Gram-Schmidt frames (k, 3, 3) of directors a, b (k, 3)."""
    e1 = a / np.linalg.norm(a, axis=1)[:, None]
    e2 = b - np.einsum("ki,ki->k", b, e1)[:, None] * e1
    e2 /= np.linalg.norm(e2, axis=1)[:, None]
    return np.stack([e1, e2, np.cross(e1, e2)], axis=2)


def _mass(shape: LeafShape, R: np.ndarray) -> np.ndarray:
    """Lumped mass (6 (n+1),)^2 for unit mass per length: which modes are lowest is all it decides."""
    n = len(shape.record)
    M = np.zeros((6 * (n + 1), 6 * (n + 1)))
    for e, r in enumerate(shape.record):
        radius = []
        for a, b in ((r[3], r[4]), (r[5], r[6])):
            phi = (4 + 2 * a / b) / (a / b - 1)
            radius.append((a - b) / 6 * (1 + phi) * r[0] ** 2 / r[1])
        inertia = np.diag([sum(radius), *radius])
        for k in (e, e + 1):
            at = slice(6 * k, 6 * k + 3), slice(6 * k + 3, 6 * k + 6)
            M[at[0], at[0]] += 0.5 * r[0] * np.eye(3)
            M[at[1], at[1]] += 0.5 * r[0] * R[k] @ inertia @ R[k].T
    return M


def _coordinates(n: int, frame: str, straight: bool) -> tuple[list[int], list[int]]:
    """Boundary and inner coordinates of n elements; what is in neither is held by the floating frame."""
    last = 6 * n
    inner = list(range(6, last))
    if frame == "node":
        return list(range(last, last + 6)), inner
    roll = [] if straight else [3]
    return [last, *roll, 4, 5, last + 3, last + 4, last + 5], inner


def tangent_function(record: np.ndarray, x: np.ndarray, orientation: np.ndarray):
    """Tangent function of the additive coordinates (6 (n+1),)."""
    first, size = np.arange(len(record)), 6 * len(x)
    z0 = np.hstack([x, np.zeros_like(x)])
    g = np.empty(size)

    def tangent(q: np.ndarray) -> np.ndarray:
        H = np.empty((size, size))
        chain_tangent(record, orientation, first, z0 + q.reshape(-1, 6), 1, g, H)
        return 0.5 * (H + H.T)

    return tangent


def _columns(choices: ModalBasis, modes: Modes, derived: Derivatives, R: np.ndarray) -> np.ndarray:
    """Columns ((n+1) q, ..) in the values of the nodes: the path to the order of the basis, term by term."""
    every = np.hstack([modes.shapes, derived.shapes]).T.reshape(-1, len(R), 6)
    if choices.coordinates == "angle":
        return every.reshape(len(every), -1).T
    k = modes.shapes.shape[1]
    index = {(i,): i for i in range(k)} | {p: k + n for n, p in enumerate(derived.pairs)}
    psi = every[:, :, 3:]
    spin = np.zeros((*psi.shape, 3))
    for i, j, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        spin[..., i, j], spin[..., j, i] = -psi[..., c], psi[..., c]
    found = []
    for key, at in index.items():
        turned = spin[at] @ R[:, :, :2] + _higher(key, index, spin, R[:, :, :2])
        found.append(np.hstack([every[at, :, :3], turned[..., 0], turned[..., 1]]).ravel())
    return np.array(found).T


def _higher(key: tuple[int, ...], index: dict, spin: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Second and third order terms of exp(psi) v in the derivative `key` of the path; spin (.., n+1, 3, 3) = [psi]x, v (n+1,
    3, 2)."""

    def turn(*parts: tuple[int, ...]) -> np.ndarray:
        w = v
        for part in reversed(parts):
            w = spin[index[part]] @ w
        return w

    total = np.zeros_like(v)
    if len(key) == 2:
        i, j = (key[0],), (key[1],)
        total += 0.5 * (turn(i, j) + turn(j, i))
    if len(key) == 3:
        for one in range(3):
            # what is left of a sorted key is sorted
            i, rest = (key[one],), tuple(k for n, k in enumerate(key) if n != one)
            total += 0.5 * (turn(i, rest) + turn(rest, i))
        for a, b, c in permutations(key):
            total += turn((a,), (b,), (c,)) / 6
    return total


def _boundary_rows(choices: ModalBasis, n: int) -> list[int]:
    """Rows of z that are the boundary values of `ksd.beam.modal_jets.boundary_jets`, in its order."""
    q = 6 if choices.coordinates == "angle" else 9
    last = q * n
    if choices.frame == "node":
        return list(range(last, last + q))
    return [last, *range(3, q), *range(last + 3, last + q)]


def _expansion(choices: ModalBasis, x: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Values z0 of all nodes at the expansion point."""
    if choices.coordinates == "angle":
        return np.hstack([x, np.zeros_like(x)]).ravel()
    return np.hstack([x, R[:, :, 0], R[:, :, 1]]).ravel()


def _kept(modes: Modes, choices: ModalBasis) -> list[int]:
    """Modes that are followed to second order: all of them, or those in the plane of the leaf."""
    if not choices.plane:
        return list(range(modes.shapes.shape[1]))
    share = (modes.shapes.reshape(-1, 6, modes.shapes.shape[1]) ** 2).sum(axis=0)
    return [k for k in range(share.shape[1]) if share[list(IN_PLANE), k].sum() > 0.5 * share[:, k].sum()]


def _modes(K0, boundary, inner, mass, choices: ModalBasis) -> Modes:
    """Boundary modes, and the lowest internal ones in the plane of the leaf: weak bending, which large strokes need."""
    first = craig_bampton(K0, boundary, inner)
    if choices.internal == 0:
        return first
    flat = [k for k in inner if k % 6 in IN_PLANE]
    second = craig_bampton(K0, [], flat, M=mass, internal=choices.internal)
    return Modes(np.hstack([first.shapes, second.shapes]), len(boundary), second.omega)


def make_basis(shape: LeafShape, choices: ModalBasis) -> LeafBasis:
    """The basis of a leaf about `shape`. Raises ValueError where the leaf has a singular tangent there."""
    n = len(shape.record)
    turn = np.eye(3) if choices.frame == "node" else rotation_without_roll(shape.x[-1])
    x, R = shape.x @ turn, np.einsum("ji,kjl->kil", turn, shape.R)
    # the element constants are in the frame of end p; rotations from rest carry them along
    orientation = R.transpose(0, 2, 1).reshape(n + 1, 9)
    straight = np.abs(R[0] - np.eye(3)).max() < 1e-12
    boundary, inner = _coordinates(n, choices.frame, straight)
    K = tangent_function(shape.record, x, orientation)
    modes = _modes(K(np.zeros(6 * (n + 1))), boundary, inner, _mass(shape, R), choices)
    derived = _derived(K, modes, inner, choices, shape.length)
    if choices.derivatives == "tied":
        return _manifold(LeafShape(shape.record, x, R), choices, modes, derived, boundary)
    columns = _columns(choices, modes, derived, R)
    rows = _boundary_rows(choices, n)
    edge, rest = split_boundary(columns, rows)
    scale = np.ones_like(columns[:, 0])
    q = 6 if choices.coordinates == "angle" else 9
    for r in range(3):
        scale[r::q] = shape.length
    basis = condition_basis(rest, scale=scale, cut=choices.cut)
    z0 = _expansion(choices, x, R)
    columns, hold = _separated(shape.record, orientation, z0, basis.columns, choices)
    return LeafBasis(choices, shape.record, orientation, z0, edge, columns, hold, z0[rows], basis.condition)


def _manifold(
    shape: LeafShape, choices: ModalBasis, modes: Modes, derived: Derivatives, boundary: list[int]
) -> LeafBasis:
    """The quadratic manifold: boundary values and internal modes are all there is, derivatives hang on them."""
    n = len(shape.record)
    rows = _boundary_rows(choices, n)
    nb, m = len(rows), modes.shapes.shape[1] - modes.boundary
    place = [*(rows.index(b) for b in boundary), *range(nb, nb + m)]
    columns = np.zeros((6 * (n + 1), nb + m))
    columns[:, place] = modes.shapes
    tied = np.zeros((6 * (n + 1), nb + m, nb + m))
    tied[:, np.array(place)[:, None], place] = np.moveaxis(second_derivatives(modes, derived), 2, 0)
    z0 = _expansion(choices, shape.x, shape.R)
    unit = condition_basis(modes.shapes / np.tile([shape.length] * 3 + [1.0] * 3, n + 1)[:, None])
    return LeafBasis(
        choices, shape.record, shape.R.transpose(0, 2, 1).reshape(n + 1, 9), z0, columns[:, :nb], columns[:, nb:],
        np.zeros(m), z0[rows], unit.condition, tied,
    )  # fmt: skip


def _separated(
    record: np.ndarray, orientation: np.ndarray, z0: np.ndarray, columns: np.ndarray, choices: ModalBasis
) -> tuple[np.ndarray, np.ndarray]:
    """The columns turned so that those that cost no energy at the expansion point stand alone, and their hold.

    Such columns only stretch directors there, but far away they count (without them the cross flexure is 1.7 % off at
    60 degrees instead of 0.003 %). The hold [Nm] of HOLD times the softest bending stiffness keeps the tangent regular.
    """
    q = 6 if choices.coordinates == "angle" else 9
    g, H = np.empty(len(z0)), np.empty((len(z0), len(z0)))
    chain_tangent(record, orientation, np.arange(len(record)), z0.reshape(-1, q), int(q == 6), g, H)
    energy, turn = np.linalg.eigh(columns.T @ (0.5 * (H + H.T)) @ columns)
    softest = record[:, [2, 3, 5]].min() * record[0, 0] ** 3 / record[:, 0].sum()
    idle = np.abs(energy) < 1e-6 * softest
    hold_stiffness = np.where(idle, HOLD * softest, 0.0)
    return (columns @ turn, hold_stiffness) if np.any(idle) else (columns, hold_stiffness)


def _derived(K, modes: Modes, inner: list[int], choices: ModalBasis, length: float) -> Derivatives:
    """Derivatives of the modes that are followed, with indices into all modes."""
    if choices.order == 1:
        return Derivatives(np.zeros((len(modes.shapes), 0)), ())
    kept = _kept(modes, choices)
    some = Modes(modes.shapes[:, kept], 0, modes.omega)
    found = modal_derivatives(K, some, inner, order=choices.order, step=1e-3 * min(1.0, length))
    return Derivatives(found.shapes, tuple(tuple(kept[i] for i in p) for p in found.pairs))


@lru_cache(maxsize=64)
def _cached_undeformed_basis(record: bytes, n: int, choices: ModalBasis) -> LeafBasis:
    # a copy: for an array that cannot be written all kernels below would be compiled once more
    return make_basis(undeformed_shape(np.frombuffer(record).reshape(n, 25).copy()), choices)


def undeformed_basis(record: np.ndarray, choices: ModalBasis) -> LeafBasis:
    """The basis of an undeformed leaf; the last ones are kept, equal leaf springs share one."""
    return _cached_undeformed_basis(np.ascontiguousarray(record).tobytes(), len(record), choices)

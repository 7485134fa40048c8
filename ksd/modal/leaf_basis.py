"""The modal basis of one leaf: from a chain of Appendix A elements, undeformed or in a given shape, to columns of its nodes.

Modes and derivatives are computed in additive coordinates of the nodes, displacement and rotation vector from the expansion
point, in the floating frame of the body. They are then converted to the values of the kernel (directors or rotation
vectors), where second and third order terms of a rotation become part of the columns.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations

import numpy as np
from scipy.spatial.transform import Rotation

from ksd.elements.modal import chain_tangent
from ksd.elements.modal_jets import JET, boundary_jets
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

CHAIN_CONSTANTS = 16
"""Constants per element in those of a chain; the frame of its end q follows them."""
HOLD_RATIO = 1e-4
"""Stiffness given to columns without energy, relative to the softest bending stiffness."""
IN_PLANE = (0, 1, 5)
"""Coordinates of a node in the plane of a leaf: along it, through its thickness, and rotation about its width."""


@dataclass(frozen=True)
class LeafShape:
    """The expansion point of a basis, in the frame of end p.

    element_constants (n, 25): constants of the n elements; x (n+1, 3) [m], R (n+1, 3, 3): positions of the nodes and their
    rotations from rest.
    """

    element_constants: np.ndarray
    x: np.ndarray
    R: np.ndarray

    @property
    def length(self) -> float:
        """Length of the leaf [m]."""
        return float(self.element_constants[:, 0].sum())


@dataclass(frozen=True)
class LeafBasis:
    """Values of the nodes of one leaf as a function of boundary values b and inner coordinates eta.

    z = z0 + boundary (b - b0) + inner eta, with q = 9 values per node for directors, 6 for angles. z0 ((n+1) q,), boundary
    ((n+1) q, nb), inner ((n+1) q, m), b0 (nb,); element_constants (n, 25): constants of the elements; orientation (n+1, 9):
    columns of the node rotations at the expansion point, in the floating frame; hold_stiffness (m,) [Nm]: see
    `_separate_idle_columns`; condition: condition number of `inner` before it was made orthonormal. second_derivatives
    ((n+1) q, nb + m, nb + m): of z by all coordinates, on a quadratic manifold.
    """

    choices: ModalBasis
    element_constants: np.ndarray
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
        """Whether the basis is expanded about a trained configuration, and accurate near that only."""
        return self.choices.expansion == "trained"

    def __str__(self) -> str:
        return str(self.choices)

    def boundary_values(self, d: np.ndarray, Q: np.ndarray) -> np.ndarray:
        """Boundary values b (nb,) with end q at d (3,) [m], Q (3, 3) in the frame of end p."""
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
        z = self.values(d, Q, eta).reshape(-1, self.values_per_node)
        if self.choices.coordinates == "angle":
            start = self.orientation.reshape(-1, 3, 3).transpose(0, 2, 1)
            R = Rotation.from_rotvec(z[:, 3:]).as_matrix() @ start
        else:
            R = _gram_schmidt_frames(z[:, 3:6], z[:, 6:])
        return (z[:, :3] - z[0, :3]) @ R[0], np.einsum("ji,kjl->kil", R[0], R)

    def stroke_and_rotation(self, d: np.ndarray, Q: np.ndarray, eta: np.ndarray) -> tuple[float, float]:
        """Displacement of end q over the length, and the largest rotation [rad] of a node against the chord."""
        x, R = self.nodes(d, Q, eta)
        rest = undeformed_shape(self.element_constants)
        cosine = np.einsum("i,ki->k", rotation_without_roll(x[-1])[:, 0], R[:, :, 0]).min()
        turn = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        return float(np.linalg.norm(x[-1] - rest.x[-1])) / rest.length, turn

    def nearest_coordinates(
        self, other: LeafBasis, d: np.ndarray, Q: np.ndarray, eta: np.ndarray
    ) -> np.ndarray:
        """Inner coordinates (m,) with the nodes nearest to those of another basis of the same leaf at its eta."""
        difference = other.values(d, Q, eta) - self.values(d, Q, np.zeros(self.inner.shape[1]))
        return np.asarray(np.linalg.lstsq(self.inner, difference, rcond=None)[0])

    @property
    def unknowns(self) -> int:
        """Number of independent boundary values and inner coordinates."""
        return int(np.linalg.matrix_rank(self.boundary)) + self.inner.shape[1]

    @property
    def values_per_node(self) -> int:
        """6 for angles, 9 for directors."""
        return _values_per_node(self.choices)

    def constants(self, weights: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """`value` and `number` of the kernel `ksd.elements.modal`; weights (n,) of elements, without those of zero."""
        q, n = self.values_per_node, len(self.element_constants)
        w = np.ones(n) if weights is None else weights
        columns = np.hstack([self.boundary, self.inner])
        parts = [self.orientation[0], self.orientation[-1], self.b0, self.hold_stiffness]
        for e in np.flatnonzero(w):
            rows = slice(q * e, q * (e + 2))
            parts += [[w[e]], self.element_constants[e], self.orientation[e : e + 2].ravel(), self.z0[rows]]
            parts.append(columns[rows].ravel())
            if self.second_derivatives is not None:
                parts.append(self.second_derivatives[rows].ravel())
        flags = (self.choices.frame == "chord") + 2 * (self.choices.coordinates == "angle")
        flags += 4 * (self.second_derivatives is not None)
        number = np.array([np.count_nonzero(w), self.inner.shape[1], len(self.b0), flags], np.int64)
        return np.concatenate([np.asarray(p, float).ravel() for p in parts]), number


def chain_element_constants(value: np.ndarray, n: int) -> np.ndarray:
    """Constants (n, 25) of each element of a chain with the constants `value` (16 n + 9,)."""
    return np.hstack(
        [value[: CHAIN_CONSTANTS * n].reshape(n, CHAIN_CONSTANTS), np.tile(np.eye(3).ravel(), (n, 1))]
    )


def undeformed_shape(element_constants: np.ndarray) -> LeafShape:
    """The undeformed leaf with these element constants (n, 25)."""
    steps = element_constants[:, :1] * element_constants[:, [7, 10, 13]]
    x = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    return LeafShape(element_constants, x, np.tile(np.eye(3), (len(x), 1, 1)))


def rotation_without_roll(d: np.ndarray) -> np.ndarray:
    """The shortest rotation (3, 3) from e1 onto the direction of d (3,)."""
    u = d / np.linalg.norm(d)
    k = 1.0 / (1.0 + u[0])
    return np.array(
        [[u[0], -u[1], -u[2]], [u[1], 1 - k * u[1] ** 2, -k * u[1] * u[2]], [u[2], -k * u[1] * u[2], 1 - k * u[2] ** 2]]
    )  # fmt: skip


def _values_per_node(choices: ModalBasis) -> int:
    """6 for angles, 9 for directors."""
    return 6 if choices.coordinates == "angle" else 9


def _gram_schmidt_frames(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Orthonormal frames (k, 3, 3) of directors a, b (k, 3)."""
    e1 = a / np.linalg.norm(a, axis=1)[:, None]
    e2 = b - np.einsum("ki,ki->k", b, e1)[:, None] * e1
    e2 /= np.linalg.norm(e2, axis=1)[:, None]
    return np.stack([e1, e2, np.cross(e1, e2)], axis=2)


def _mass(shape: LeafShape, R: np.ndarray) -> np.ndarray:
    """Lumped mass matrix (6 (n+1), 6 (n+1)) for unit mass per length; it only decides which modes are lowest."""
    n = len(shape.element_constants)
    M = np.zeros((6 * (n + 1), 6 * (n + 1)))
    for e, r in enumerate(shape.element_constants):
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
    """Indices of boundary and inner coordinates of n elements; the others are fixed by the floating frame."""
    last = 6 * n
    inner = list(range(6, last))
    if frame == "node":
        return list(range(last, last + 6)), inner
    roll = [] if straight else [3]
    return [last, *roll, 4, 5, last + 3, last + 4, last + 5], inner


def tangent_function(element_constants: np.ndarray, x: np.ndarray, orientation: np.ndarray):
    """The function that returns the tangent (6 (n+1), 6 (n+1)) at coordinates (6 (n+1),) in addition to x: displacements [m]
    and rotation vectors of the nodes from `orientation`."""
    first, size = np.arange(len(element_constants)), 6 * len(x)
    z0 = np.hstack([x, np.zeros_like(x)])
    g = np.empty(size)

    def tangent(q: np.ndarray) -> np.ndarray:
        H = np.empty((size, size))
        chain_tangent(element_constants, orientation, first, z0 + q.reshape(-1, 6), 1, g, H)
        return 0.5 * (H + H.T)

    return tangent


def _columns(choices: ModalBasis, modes: Modes, derived: Derivatives, R: np.ndarray) -> np.ndarray:
    """Columns ((n+1) q, k) of node values: modes and derivatives, with the higher-order terms of their rotations."""
    every = np.hstack([modes.shapes, derived.shapes]).T.reshape(-1, len(R), 6)
    if choices.coordinates == "angle":
        return every.reshape(len(every), -1).T
    k = modes.shapes.shape[1]
    index = {(i,): i for i in range(k)} | {p: k + n for n, p in enumerate(derived.pairs)}
    psi = every[:, :, 3:]
    spin = np.zeros((*psi.shape, 3))
    for i, j, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        spin[..., i, j], spin[..., j, i] = -psi[..., c], psi[..., c]
    columns = []
    for key, at in index.items():
        directors = spin[at] @ R[:, :, :2] + _higher_order_terms(key, index, spin, R[:, :, :2])
        columns.append(np.hstack([every[at, :, :3], directors[..., 0], directors[..., 1]]).ravel())
    return np.array(columns).T


def _higher_order_terms(key: tuple[int, ...], index: dict, spin: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Second and third order terms of exp(psi) v in the derivative `key` of the path.

    index: position in spin by key; spin (k, n+1, 3, 3): [psi]x; v (n+1, 3, 2): directors.
    """

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
            # a sorted key stays sorted without one of its entries
            i, rest = (key[one],), tuple(k for n, k in enumerate(key) if n != one)
            total += 0.5 * (turn(i, rest) + turn(rest, i))
        for a, b, c in permutations(key):
            total += turn((a,), (b,), (c,)) / 6
    return total


def _boundary_rows(choices: ModalBasis, n: int) -> list[int]:
    """Rows of z with the boundary values of `ksd.elements.modal_jets.boundary_jets`, in its order."""
    q = _values_per_node(choices)
    last = q * n
    if choices.frame == "node":
        return list(range(last, last + q))
    return [last, *range(3, q), *range(last + 3, last + q)]


def _expansion_values(choices: ModalBasis, x: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Values z0 of all nodes at the expansion point."""
    if choices.coordinates == "angle":
        return np.hstack([x, np.zeros_like(x)]).ravel()
    return np.hstack([x, R[:, :, 0], R[:, :, 1]]).ravel()


def _followed_modes(modes: Modes, choices: ModalBasis) -> list[int]:
    """Indices of the modes that have derivatives: all, or those in the plane of the leaf."""
    if not choices.plane:
        return list(range(modes.shapes.shape[1]))
    share = (modes.shapes.reshape(-1, 6, modes.shapes.shape[1]) ** 2).sum(axis=0)
    return [k for k in range(share.shape[1]) if share[list(IN_PLANE), k].sum() > 0.5 * share[:, k].sum()]


def _modes(K0, boundary, inner, mass, choices: ModalBasis) -> Modes:
    """Boundary modes, and the lowest internal modes in the plane of the leaf: weak bending, which large strokes need."""
    first = craig_bampton(K0, boundary, inner)
    if choices.internal == 0:
        return first
    in_plane = [k for k in inner if k % 6 in IN_PLANE]
    second = craig_bampton(K0, [], in_plane, M=mass, internal=choices.internal)
    return Modes(np.hstack([first.shapes, second.shapes]), len(boundary), second.omega)


def make_basis(shape: LeafShape, choices: ModalBasis) -> LeafBasis:
    """The basis of a leaf about `shape`. Raises ValueError where the tangent of the leaf is singular there."""
    n = len(shape.element_constants)
    turn = np.eye(3) if choices.frame == "node" else rotation_without_roll(shape.x[-1])
    x, R = shape.x @ turn, np.einsum("ji,kjl->kil", turn, shape.R)
    # the element constants are in the frame of end p; rotations from rest apply to them
    orientation = R.transpose(0, 2, 1).reshape(n + 1, 9)
    straight = np.abs(R[0] - np.eye(3)).max() < 1e-12
    boundary, inner = _coordinates(n, choices.frame, straight)
    K = tangent_function(shape.element_constants, x, orientation)
    modes = _modes(K(np.zeros(6 * (n + 1))), boundary, inner, _mass(shape, R), choices)
    derived = _mode_derivatives(K, modes, inner, choices, shape.length)
    if choices.derivatives == "tied":
        return _quadratic_manifold(
            LeafShape(shape.element_constants, x, R), choices, modes, derived, boundary
        )
    columns = _columns(choices, modes, derived, R)
    rows = _boundary_rows(choices, n)
    edge, rest = split_boundary(columns, rows)
    scale = np.ones_like(columns[:, 0])
    q = _values_per_node(choices)
    for r in range(3):
        scale[r::q] = shape.length
    basis = condition_basis(rest, scale=scale, cut=choices.cut)
    z0 = _expansion_values(choices, x, R)
    columns, hold = _separate_idle_columns(shape.element_constants, orientation, z0, basis.columns, choices)
    return LeafBasis(
        choices, shape.element_constants, orientation, z0, edge, columns, hold, z0[rows], basis.condition
    )


def _quadratic_manifold(
    shape: LeafShape, choices: ModalBasis, modes: Modes, derived: Derivatives, boundary: list[int]
) -> LeafBasis:
    """The basis on the quadratic manifold, whose only coordinates are boundary values and amplitudes of internal modes."""
    n = len(shape.element_constants)
    rows = _boundary_rows(choices, n)
    nb, m = len(rows), modes.shapes.shape[1] - modes.boundary
    order = [*(rows.index(b) for b in boundary), *range(nb, nb + m)]
    columns = np.zeros((6 * (n + 1), nb + m))
    columns[:, order] = modes.shapes
    second = np.zeros((6 * (n + 1), nb + m, nb + m))
    second[:, np.array(order)[:, None], order] = np.moveaxis(second_derivatives(modes, derived), 2, 0)
    z0 = _expansion_values(choices, shape.x, shape.R)
    unit = condition_basis(modes.shapes / np.tile([shape.length] * 3 + [1.0] * 3, n + 1)[:, None])
    return LeafBasis(
        choices, shape.element_constants, shape.R.transpose(0, 2, 1).reshape(n + 1, 9), z0, columns[:, :nb], columns[:, nb:],
        np.zeros(m), z0[rows], unit.condition, second,
    )  # fmt: skip


def _separate_idle_columns(
    element_constants: np.ndarray,
    orientation: np.ndarray,
    z0: np.ndarray,
    columns: np.ndarray,
    choices: ModalBasis,
) -> tuple[np.ndarray, np.ndarray]:
    """The columns, transformed so that those without energy at the expansion point are separate, and their hold stiffness.

    Such columns only stretch directors there, but matter far from it (without them the cross flexure is 1.7 % off at 60
    degrees instead of 0.003 %). Their stiffness [Nm] of HOLD_RATIO times the softest bending stiffness keeps the tangent
    regular.
    """
    q = _values_per_node(choices)
    g, H = np.empty(len(z0)), np.empty((len(z0), len(z0)))
    chain_tangent(
        element_constants,
        orientation,
        np.arange(len(element_constants)),
        z0.reshape(-1, q),
        int(q == 6),
        g,
        H,
    )
    energy, turn = np.linalg.eigh(columns.T @ (0.5 * (H + H.T)) @ columns)
    softest = (
        element_constants[:, [2, 3, 5]].min() * element_constants[0, 0] ** 3 / element_constants[:, 0].sum()
    )
    idle = np.abs(energy) < 1e-6 * softest
    hold_stiffness = np.where(idle, HOLD_RATIO * softest, 0.0)
    return (columns @ turn, hold_stiffness) if np.any(idle) else (columns, hold_stiffness)


def _mode_derivatives(K, modes: Modes, inner: list[int], choices: ModalBasis, length: float) -> Derivatives:
    """Derivatives of the modes of `_followed_modes`, with indices into all modes."""
    if choices.order == 1:
        return Derivatives(np.zeros((len(modes.shapes), 0)), ())
    followed = _followed_modes(modes, choices)
    some = Modes(modes.shapes[:, followed], 0, modes.omega)
    found = modal_derivatives(K, some, inner, order=choices.order, step=1e-3 * min(1.0, length))
    return Derivatives(found.shapes, tuple(tuple(followed[i] for i in p) for p in found.pairs))


@lru_cache(maxsize=64)
def _cached_undeformed_basis(constants: bytes, n: int, choices: ModalBasis) -> LeafBasis:
    # a copy, since kernels would be compiled once more for a read-only array
    return make_basis(undeformed_shape(np.frombuffer(constants).reshape(n, 25).copy()), choices)


def undeformed_basis(element_constants: np.ndarray, choices: ModalBasis) -> LeafBasis:
    """The basis of an undeformed leaf with these element constants (n, 25); cached, so that equal leaf springs share it."""
    return _cached_undeformed_basis(
        np.ascontiguousarray(element_constants).tobytes(), len(element_constants), choices
    )

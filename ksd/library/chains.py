"""Element and node rotations of any chain, from the curvature amplitudes of the strain mesh.

Orientation is the integral of curvature (leaf-elements note, "Intended-motion functions"). The Appendix A
element differs from the exact rod by terms of second order in its length, so the known difference of the
longest trained chain, times (its n / n)^2, is added.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from ksd.library.functions import Array, Functions, JointFunctions, monomials

GAUSS_POINTS = 4
"""Gauss points per element when curvature is integrated."""


def rotation_matrices(v: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(v.reshape(-1, 3)).as_matrix()).reshape(*v.shape, 3)


def rotation_vectors(R: Array) -> Array:
    """Rotation vectors (..., 3) of rotation matrices (..., 3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()).reshape(R.shape[:-1])


def chain_rotations(amplitudes: Array, orders: tuple[int, int, int], n: int) -> Array:
    """(..., 2n-1, 3): rotations of n elements, then n-1 nodes, of a unit leaf with curvature amplitudes (...,
    N).

    A chord's roll is the mean of its nodes' axes. Orientation by a fourth-order Magnus step per gap.
    """
    x, w = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    edges = np.linspace(0.0, 1.0, n + 1)
    s = (edges[:-1, None] + 0.5 * (1 + x) / n).ravel()
    stops = np.concatenate([[0.0], np.sort(np.concatenate([s, edges[1:]]))])
    R = np.broadcast_to(np.eye(3), (*amplitudes.shape[:-1], 3, 3))
    nodes, chords = [R], []
    chord = np.zeros((*amplitudes.shape[:-1], 3))
    for g, (a, b) in enumerate(itertools.pairwise(stops)):
        R = R @ rotation_matrices(_magnus_vector(amplitudes, orders, a, b))
        if (g + 1) % (GAUSS_POINTS + 1):
            chord = chord + w[g % (GAUSS_POINTS + 1)] * R[..., 0]
        else:
            nodes.append(R)
            chords.append(chord)
            chord = np.zeros_like(chord)
    across = [p[..., 1] + q[..., 1] for p, q in itertools.pairwise(nodes)]
    turned = map(element_axes, chords, across)
    return np.stack([rotation_vectors(T) for T in (*turned, *nodes[1:-1])], axis=-2)


def _magnus_vector(amplitudes: Array, orders: tuple[int, int, int], a: float, b: float) -> Array:
    """Rotation vector over [a, b]: mean curvature plus the commutator of its two Gauss points."""
    h, root = b - a, 0.5 / np.sqrt(3.0)
    first, second = (_curvature_at(amplitudes, orders, 0.5 * (a + b) + e * root * h) for e in (-1, 1))
    return 0.5 * h * (first + second) + h**2 * np.sqrt(3.0) / 12.0 * np.cross(first, second)


def _curvature_at(amplitudes: Array, orders: tuple[int, int, int], s: float) -> Array:
    modes = np.polynomial.legendre.legvander(np.array([2 * s - 1]), max(orders) - 1)[0]
    parts, first = [], 0
    for n in orders:
        parts.append(amplitudes[..., first : first + n] @ modes[:n])
        first += n
    return np.stack(parts, axis=-1)


def element_axes(chord: Array, across: Array) -> Array:
    """Axes (..., 3, 3) of elements along chords (..., 3), their y in the plane of the chord and of `across` (..., 3)."""
    x = chord / np.linalg.norm(chord, axis=-1, keepdims=True)
    y = across - np.sum(x * across, axis=-1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def extend_chain(strain: JointFunctions, n: int, *, known: JointFunctions | None = None) -> JointFunctions:
    """Functions of a mesh of n elements per leaf, from those of the strain mesh; `known`: the longest trained
    chain.

    Rotations are refitted over the trained range in the powers of the strain mesh. The difference of `known`
    from the strain mesh is added, times (its n / n)^2.
    """
    basis = _monomials_on_grid(strain)
    amplitudes = np.moveaxis(np.tensordot(strain.amplitudes, basis, axes=(2, 1)), 2, 0)
    rotations = _fit_coefficients(chain_rotations(amplitudes, strain.orders, n), basis)
    interface, blocks = strain.interface, strain.blocks
    if known is not None:
        k = int(known.mesh)
        share = (k / n) ** 2
        interface = interface + share * (known.interface - interface)
        blocks = blocks + share * (known.blocks - blocks)
        own = _fit_coefficients(chain_rotations(amplitudes, strain.orders, k), basis)
        rotations = rotations + share * _interpolate_along_leaf(known.rotations - own, k, n)
    functions = Functions(interface, blocks, rotations=rotations)
    return JointFunctions(
        n, strain.powers, strain.motion_range, functions, strain.orders, strain.extrapolated
    )


def _monomials_on_grid(strain: JointFunctions) -> Array:
    """The monomials (k, P) at enough Chebyshev points over the trained range."""
    lines = []
    for j, (low, high) in enumerate(strain.motion_range):
        count = 2 * int(strain.powers[:, j].max()) + 3
        lines.append(
            0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * (np.arange(count) + 0.5) / count)
        )
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, len(lines))
    return monomials(strain.powers, grid)


def _fit_coefficients(values: Array, basis: Array) -> Array:
    """Coefficients (.., P) of values (k, leaf springs, rotations, 3) at the points of basis (k, P)."""
    scale = np.abs(basis).max(axis=0)
    flat = np.linalg.lstsq(basis / scale, values.reshape(len(values), -1), rcond=None)[0]
    return np.asarray((flat / scale[:, None]).T.reshape(*values.shape[1:], -1))


def _interpolate_along_leaf(difference: Array, k: int, n: int) -> Array:
    """A difference known at the elements and nodes of k elements, at those of n: smooth polynomials along the
    leaf.

    At both ends the nodes of the chain and of the exact rod agree.
    """
    middle, node = (np.arange(k) + 0.5) / k, np.arange(1, k) / k
    at_elements = _smooth_interpolation(middle, (np.arange(n) + 0.5) / n, np.ones_like)
    at_nodes = _smooth_interpolation(node, np.arange(1, n) / n, lambda s: s * (1 - s))
    parts = [
        np.einsum("ij,ljcp->licp", at_elements, difference[:, :k]),
        np.einsum("ij,ljcp->licp", at_nodes, difference[:, k:]),
    ]
    return np.concatenate(parts, axis=1)


def _smooth_interpolation(known: Array, wanted: Array, factor: Callable[[Array], Array]) -> Array:
    """(wanted, known): least squares by `factor` times a polynomial of at most degree 4, evaluated at
    `wanted`.
    """
    degree = min(4, len(known) - 1)
    there, here = (
        np.polynomial.legendre.legvander(2 * s - 1, degree) * factor(s)[:, None] for s in (wanted, known)
    )
    return np.asarray(there @ np.linalg.pinv(here))

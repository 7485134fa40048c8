"""Element and node rotations of chains of any number of elements, from the curvature amplitudes of the strain mesh.

The orientation is the integral of the curvature (leaf-elements note, "Intended-motion functions"). The Appendix A element
differs from the exact rod by terms of second order in its length; therefore the known difference of the trained chain with
the largest number of elements k, times (k / n)^2, is added.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from ksd.library.functions import Array, Functions, JointFunctions, monomials

GAUSS_POINTS = 4
"""Gauss points per element for the integration of the curvature."""


def rotation_matrices(v: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3)."""
    return np.asarray(Rotation.from_rotvec(v.reshape(-1, 3)).as_matrix()).reshape(*v.shape, 3)


def rotation_vectors(R: Array) -> Array:
    """Rotation vectors (..., 3) of rotation matrices (..., 3, 3)."""
    return np.asarray(Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()).reshape(R.shape[:-1])


def chain_rotations(amplitudes: Array, orders: tuple[int, int, int], n: int) -> Array:
    """Rotation vectors (..., 2n-1, 3) of n elements, then n-1 nodes, of a unit leaf with curvature amplitudes (..., N).

    The rotation of an element about its chord is the mean of those of its nodes. The orientation is integrated by one
    fourth-order Magnus step between neighbouring Gauss points and nodes.
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
    elements = map(element_axes, chords, across)
    return np.stack([rotation_vectors(T) for T in (*elements, *nodes[1:-1])], axis=-2)


def _magnus_vector(amplitudes: Array, orders: tuple[int, int, int], a: float, b: float) -> Array:
    """Rotation vector over [a, b]: mean curvature plus the commutator of the curvatures at two Gauss points."""
    h, root = b - a, 0.5 / np.sqrt(3.0)
    first, second = (_curvature_at(amplitudes, orders, 0.5 * (a + b) + e * root * h) for e in (-1, 1))
    return 0.5 * h * (first + second) + h**2 * np.sqrt(3.0) / 12.0 * np.cross(first, second)


def _curvature_at(amplitudes: Array, orders: tuple[int, int, int], s: float) -> Array:
    """Curvature (..., 3) at fraction s of a unit leaf with amplitudes (..., N)."""
    modes = np.polynomial.legendre.legvander(np.array([2 * s - 1]), max(orders) - 1)[0]
    parts, first = [], 0
    for n in orders:
        parts.append(amplitudes[..., first : first + n] @ modes[:n])
        first += n
    return np.stack(parts, axis=-1)


def element_axes(chord: Array, across: Array) -> Array:
    """Axes (..., 3, 3) of elements: x along chords (..., 3), y in the plane of the chord and `across` (..., 3)."""
    x = chord / np.linalg.norm(chord, axis=-1, keepdims=True)
    y = across - np.sum(x * across, axis=-1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def extend_chain(strain: JointFunctions, n: int, *, known: JointFunctions | None = None) -> JointFunctions:
    """Functions of a chain of n elements per leaf, from those of the strain mesh.

    The rotations are fitted over the trained range in the powers of the strain mesh. known: functions of the trained chain
    with the largest number of elements k; their difference from the strain mesh, times (k / n)^2, is added.
    """
    basis = _monomials_on_grid(strain)
    amplitudes = np.moveaxis(np.tensordot(strain.amplitudes, basis, axes=(2, 1)), 2, 0)
    rotations = _fit_coefficients(chain_rotations(amplitudes, strain.orders, n), basis)
    interface, blocks = strain.interface, strain.blocks
    if known is not None:
        k = int(known.mesh)
        weight = (k / n) ** 2
        interface = interface + weight * (known.interface - interface)
        blocks = blocks + weight * (known.blocks - blocks)
        integrated = _fit_coefficients(chain_rotations(amplitudes, strain.orders, k), basis)
        rotations = rotations + weight * _interpolate_along_leaf(known.rotations - integrated, k, n)
    functions = Functions(interface, blocks, rotations=rotations)
    return JointFunctions(
        n, strain.powers, strain.motion_range, functions, strain.orders, strain.extrapolated
    )


def _monomials_on_grid(strain: JointFunctions) -> Array:
    """Monomials (k, P) of functions of the strain mesh at a grid of Chebyshev points over their trained range."""
    points_by_motion = []
    for j, (low, high) in enumerate(strain.motion_range):
        count = 2 * int(strain.powers[:, j].max()) + 3
        points_by_motion.append(
            0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * (np.arange(count) + 0.5) / count)
        )
    grid = np.stack(np.meshgrid(*points_by_motion, indexing="ij"), axis=-1).reshape(-1, len(points_by_motion))
    return monomials(strain.powers, grid)


def _fit_coefficients(values: Array, basis: Array) -> Array:
    """Coefficients (leaf springs, rotations, 3, P) that fit values (k, leaf springs, rotations, 3), by basis (k, P)."""
    scale = np.abs(basis).max(axis=0)
    coefficients = np.linalg.lstsq(basis / scale, values.reshape(len(values), -1), rcond=None)[0]
    return np.asarray((coefficients / scale[:, None]).T.reshape(*values.shape[1:], -1))


def _interpolate_along_leaf(difference: Array, k: int, n: int) -> Array:
    """A difference (leaf springs, 2k-1, 3, P) at elements and nodes of k elements, interpolated to those of n elements.

    The polynomial along the leaf for the nodes is zero at both ends, where the chain and the exact rod agree.
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
    """Matrix (wanted, known) from values at fractions `known` to those at `wanted`.

    Least squares fit by `factor` times a polynomial of degree 4 at most.
    """
    degree = min(4, len(known) - 1)
    at_wanted, at_known = (
        np.polynomial.legendre.legvander(2 * s - 1, degree) * factor(s)[:, None] for s in (wanted, known)
    )
    return np.asarray(at_wanted @ np.linalg.pinv(at_known))

"""Set-up of the corotational chain in plain Python: sizes, constants, undeformed state, element mass.

Layouts are those of `ksd.elements.corotational`. SI units; everything in the frame of end p.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ksd.elements.strain_values import GRAVITY_BLOCK_SIZE

Array = NDArray[np.float64]
ELEMENT_RECORD_SIZE = 16
"""Numbers per element in `value`."""
NODE_RECORD_SIZE = 12
"""Numbers per inner node in `inner`."""
ELEMENT_STORE_SIZE, CHAIN_SCRATCH_SIZE = 120, 154
"""Store per element and scratch per chain, as in `ksd.elements.corotational_element`, which would load the compiler."""


class ElementSection(NamedTuple):
    """Section of an element: moduli E, G [Pa], area A [m2], Saint-Venant torsion constant J, second moments Iy (about
    y, deflection along z) and Iz [m4], shear factors ky, kz (along y and z)."""

    E: float
    G: float
    A: float
    J: float
    Iy: float
    Iz: float
    ky: float = 5 / 6
    kz: float = 5 / 6


class ChainSizes(NamedTuple):
    """Lengths of the flat arrays of a chain."""

    value: int
    inner: int
    store: int


def sizes(n: int, *, has_weight: bool = False) -> ChainSizes:
    """Lengths of `value`, `inner` and `store` for a chain of n elements; has_weight: with weight."""
    gravity = 18 * (n + 1) + GRAVITY_BLOCK_SIZE if has_weight else 0
    return ChainSizes(
        ELEMENT_RECORD_SIZE * n + 9 + has_weight * (n + 7),
        NODE_RECORD_SIZE * (n - 1) + 6 * n,
        ELEMENT_STORE_SIZE * n + CHAIN_SCRATCH_SIZE + gravity,
    )


def lumped_masses(value: Array, n: int, line_mass: Array) -> Array:
    """Masses (n + 7,) of a chain with `line_mass` (n,) [kg/m] per element, as `ksd.elements.weight` takes them.

    Half of every element at each of its nodes [kg]; then the first moments [kg m] of the halves at end p, in its
    frame, and at end q, in its frame: levers of a sixth of the element, work-equivalent to its cubic deflection.
    """
    records = value[: ELEMENT_RECORD_SIZE * n].reshape(n, ELEMENT_RECORD_SIZE)
    half = 0.5 * line_mass * records[:, 0]
    first, last = (half[k] * records[k, 0] / 6.0 * records[k, [7, 10, 13]] for k in (0, n - 1))
    Q0 = value[ELEMENT_RECORD_SIZE * n : ELEMENT_RECORD_SIZE * n + 9].reshape(3, 3)
    return np.concatenate([np.append(half, 0.0) + np.append(0.0, half), first, -Q0.T @ last])


def stiffness_numbers(section: ElementSection, length: float) -> tuple[float, ...]:
    """(S1, S2, S3a, S3b, S4a, S4b) of an element of `length` m: paper 1 (A.15), shear factors by errata 2.

    Phi of S3 (deflection along z) is 12 E Iy/(kz G A L0^2); paper 1 prints Phi_y and Phi_z exchanged in (A.16).
    """
    phi_y, phi_z = shear_ratios(section, length)
    s3 = section.E * section.Iy / ((1 + phi_z) * length**3)
    s4 = section.E * section.Iz / ((1 + phi_y) * length**3)
    s1 = section.E * section.A / length
    s2 = section.G * section.J / length**3
    return s1, s2, s3 * (4 + phi_z), s3 * (-2 + phi_z), s4 * (4 + phi_y), s4 * (-2 + phi_y)


def shear_ratios(section: ElementSection, length: float) -> tuple[float, float]:
    """(Phi_y, Phi_z) of deflection along y and along z: 12 E Iz/(ky G A L^2) and 12 E Iy/(kz G A L^2)."""
    ratio = 12 * section.E / (section.G * section.A * length**2)
    return ratio * section.Iz / section.ky, ratio * section.Iy / section.kz


def straight_nodes(length: float, n: int) -> tuple[Array, Array]:
    """Undeformed nodes of a straight leaf of `length` m: positions (n+1, 3) and orientations (n+1, 3, 3)."""
    positions = np.zeros((n + 1, 3))
    positions[:, 0] = np.linspace(0.0, length, n + 1)
    return positions, np.tile(np.eye(3), (n + 1, 1, 1))


def chain_values(
    section: ElementSection, L: float, n: int, curve: tuple[Array, Array] | None = None
) -> Array:
    """The constants `value` (16 n + 9,) of a chain of n equal elements of one section.

    `curve` gives undeformed positions (n+1, 3) m and orientations (n+1, 3, 3) of the nodes of a curved leaf,
    starting at the origin unrotated; without it the leaf is straight with length `L`.
    Elements of a curved leaf are its chords, their section axes the mean of both nodes'.
    Raises ValueError when n < 1 or a length is not positive.
    """
    if n < 1:
        raise ValueError(f"A leaf needs at least one element, got elements = {n}; use 2 or more for bending.")
    positions, orientations = straight_nodes(L, n) if curve is None else curve
    value = np.empty(ELEMENT_RECORD_SIZE * n + 9)
    for k in range(n):
        chord = positions[k + 1] - positions[k]
        length = float(np.linalg.norm(chord))
        if not length > 0.0:
            raise ValueError(f"Element {k + 1} of a leaf has length {length} m; it must be positive.")
        x = chord / length
        y = orientations[k][:, 1] + orientations[k + 1][:, 1]
        y = y - (y @ x) * x
        y /= np.linalg.norm(y)
        record = value[ELEMENT_RECORD_SIZE * k : ELEMENT_RECORD_SIZE * (k + 1)]
        record[0] = length
        record[1:7] = stiffness_numbers(section, length)
        record[7:] = np.column_stack([x, y, np.cross(x, y)]).ravel()
    value[ELEMENT_RECORD_SIZE * n :] = orientations[n].ravel()
    return value


def undeformed_inner(value: Array, number: NDArray[np.int64]) -> Array:
    """The undeformed inner state (12 (n-1) + 6 n,): nodes on the undeformed leaf, unrotated, unstressed."""
    n = int(number[0])
    inner = np.zeros(sizes(n).inner)
    position = np.zeros(3)
    for k in range(n - 1):
        record = value[ELEMENT_RECORD_SIZE * k : ELEMENT_RECORD_SIZE * (k + 1)]
        position = position + record[0] * record[[7, 10, 13]]
        inner[NODE_RECORD_SIZE * k : NODE_RECORD_SIZE * k + 3] = position
        inner[NODE_RECORD_SIZE * k + 3 : NODE_RECORD_SIZE * (k + 1)] = np.eye(3).ravel()
    return inner


def stretched_inner(value: Array, number: NDArray[np.int64], d: Array, Q: Array) -> Array:
    """Inner state where end q is at d (3,) [m] with axes Q (3, 3): the motion from the undeformed end is spread evenly
    over the nodes, so that no element takes all of it."""
    n, inner = int(number[0]), undeformed_inner(value, number)
    end, clamp = undeformed_end(value, number)
    rotation = Rotation.from_matrix(Q @ clamp.T).as_rotvec()
    for k in range(n - 1):
        share, node = (k + 1) / n, inner[NODE_RECORD_SIZE * k : NODE_RECORD_SIZE * (k + 1)]
        node[:3] += share * (d - end)
        node[3:] = Rotation.from_rotvec(share * rotation).as_matrix().ravel()
    return inner


def undeformed_end(value: Array, number: NDArray[np.int64]) -> tuple[Array, Array]:
    """Position d (3,) m and orientation Q (3, 3) of end q in the undeformed state."""
    n = int(number[0])
    records = value[: ELEMENT_RECORD_SIZE * n].reshape(n, ELEMENT_RECORD_SIZE)
    clamp = value[ELEMENT_RECORD_SIZE * n : ELEMENT_RECORD_SIZE * n + 9].reshape(3, 3).copy()
    return (records[:, :1] * records[:, [7, 10, 13]]).sum(axis=0), clamp


def _timoshenko_shapes(x: float, length: float, phi: float) -> tuple[Array, Array]:
    """Deflection and section rotation shapes (4,) of a Timoshenko element at x in 0..1 for (w, w', w, w')."""
    deflection = np.array(
        [
            2 * x**3 - 3 * x**2 - phi * x + 1 + phi,
            length * (x**3 - (2 + phi / 2) * x**2 + (1 + phi / 2) * x),
            -(2 * x**3 - 3 * x**2 - phi * x),
            length * (x**3 - (1 - phi / 2) * x**2 - phi / 2 * x),
        ]
    )
    rotation = np.array(
        [
            6 * (x**2 - x) / length,
            3 * x**2 - (4 + phi) * x + 1 + phi,
            -6 * (x**2 - x) / length,
            3 * x**2 - (2 - phi) * x,
        ]
    )
    return deflection / (1 + phi), rotation / (1 + phi)


def element_mass(
    L: float, *, rhoA: float, rhoIy: float, rhoIz: float, rhoIp: float, phi_y: float = 0.0, phi_z: float = 0.0
) -> Array:
    """Consistent Timoshenko mass matrix (12, 12) in element axes, unknowns (u, phi) at p, then at q.

    `rhoA` kg/m, `rhoIy`, `rhoIz`, `rhoIp` kg m (rotary inertia of the section about y, z, x per length),
    `phi_y`, `phi_z` from `shear_ratios`. Source: exact static shapes of the Timoshenko element (Friedman and
    Kosmatka 1993), the shapes paper 1 (A.15) stands on; 4 Gauss points integrate their products exactly.
    """
    mass = np.zeros((12, 12))
    points, weights = np.polynomial.legendre.leggauss(4)
    along_y, along_z = [1, 5, 7, 11], [2, 4, 8, 10]
    flip = np.array([1.0, -1.0, 1.0, -1.0])
    for x, w in zip((points + 1) / 2, weights * L / 2, strict=True):
        linear = np.array([1 - x, x])
        mass[np.ix_([0, 6], [0, 6])] += w * rhoA * np.outer(linear, linear)
        mass[np.ix_([3, 9], [3, 9])] += w * rhoIp * np.outer(linear, linear)
        v, rotation = _timoshenko_shapes(x, L, phi_y)
        mass[np.ix_(along_y, along_y)] += w * (rhoA * np.outer(v, v) + rhoIz * np.outer(rotation, rotation))
        v, rotation = (shape * flip for shape in _timoshenko_shapes(x, L, phi_z))
        mass[np.ix_(along_z, along_z)] += w * (rhoA * np.outer(v, v) + rhoIy * np.outer(rotation, rotation))
    return mass

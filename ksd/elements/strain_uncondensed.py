"""The strain-mode leaf before condensation: its tangent, mass, inner flexibility and derivatives by distributed loads.

The velocity of the leaf is that of end p plus the mode fields (rho_i, psi_i) of `ksd.elements.strain` times the rates of
the amplitudes; the stretch and shear that join it to end q (a velocity of 1/EA times the rate of the force) are spread
linearly along it, so that the mass depends on motions only and is never negative. What inertia between the ends adds to
stretch and shear are displacements that vanish at both ends, `bubbles`: a constant force does no work on them, so that they
are not coupled to any other stiffness. Everything is in frame p. Arrays of k leaf springs with equal settings have a leading
axis (k,).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ksd.elements.inertia import inertia_places
from ksd.elements.pressure import GIVEN_MODES, PRESSURE_MODES
from ksd.elements.strain import LeafFields, constant_offsets, fill_leaf_fields, leaf_fields, strain_tangent
from ksd.elements.strain_values import loads_beyond

Array = NDArray[np.float64]
BUBBLES = 3
"""Shapes of stretch and shear between the ends, in each direction: displacements int P_j ds of Legendre polynomials P_j."""


@dataclass(frozen=True)
class UncondensedLeaves:
    """k leaf springs at one state each: W (k, N, N), J (k, 6, N), S (k, 3, 3) of the uncondensed tangent, and the mode
    fields.

    Tangent in (xi, a, lam): [0 0 I; 0 W -J^T; I -J -S], S in the force block only. length (k,) [m]; r (k, ng, 3):
    points; end (k, 3): end q; R (k, ng, 3, 3): orientations; rho, psi (k, ng, 3, N): displacement and rotation per unit
    amplitude; compliance (k, ng, 3, 3) [1/N]: R C R^T of stretch and shear, whose integral is S; weight (k, ng), sum 1; s
    (k, ng): points in units of the length.
    """

    W: Array
    J: Array
    S: Array
    length: Array
    s: Array
    weight: Array
    r: Array
    end: Array
    R: Array
    rho: Array
    psi: Array
    compliance: Array


def quadrature_points(value: Array, number: NDArray[np.int64]) -> Array:
    """Quadrature points (ng,) of a leaf in units of its length."""
    _, weight, _, _, _ = constant_offsets(number)
    ng = int(number[3])
    return value[weight + ng : weight + ng + ng * ng].reshape(ng, ng).sum(axis=1)


@dataclass(frozen=True)
class LoadDerivatives:
    """Dependence of k uncondensed leaves on the D components f of their load modes in frame p, see
    `ksd.elements.leaf_loads`.

    s (k, D): first moments, with their derivatives eta (k, D, N) by a, B (k, 3, D) by n and D (k, D, D) by f; follows (k,
    D, N): derivatives by a of the modes of pressure, per unit of it, zero for all others.
    """

    s: Array
    eta: Array
    B: Array
    D: Array
    follows: Array


def uncondensed_leaves(
    value: Array, number: NDArray[np.int64], inner: Array, loads: Array | None = None
) -> UncondensedLeaves:
    """`UncondensedLeaves` from constants (k, v) and inner states (k, N + 6) of k leaf springs of equal settings
    `number`.

    loads (k, D): load modes in frames p, None without any.
    """
    return _leaves_and_fields(value, number, inner, loads)[0]


def load_derivatives(value: Array, number: NDArray[np.int64], inner: Array, loads: Array) -> LoadDerivatives:
    """`LoadDerivatives` of k leaf springs with load modes (k, D), frames p; arrays as in `uncondensed_leaves`."""
    leaves, v, S, eta = _leaves_and_fields(value, number, inner, loads)
    Q = np.stack([loads_beyond(leaf, number) for leaf in value])
    weighted = (leaves.length[:, None] * leaves.weight)[..., None] * Q
    count, D = loads.shape
    follows = np.zeros((count, D, leaves.W.shape[-1]))
    _, c_at = inertia_places(number, False)
    if pressed := max(int(number[5]) - GIVEN_MODES, 0):
        at = c_at + int(number[5])
        table = value[:, at : at + int(number[3]) * PRESSURE_MODES].reshape(count, -1, PRESSURE_MODES)
        turned = np.cross(leaves.psi, leaves.R[..., 1, None], axis=2)
        follows[:, -3 * pressed :] = np.einsum("kgm,kgri->kmri", table, turned).reshape(
            count, 3 * pressed, -1
        )
    return LoadDerivatives(
        np.einsum("kgm,kgi->kmi", weighted, v).reshape(count, D),
        eta,
        np.einsum("kgm,kgij->kimj", weighted, S).reshape(count, 3, D),
        np.einsum("kgm,kgn,kgij->kminj", weighted, Q, S).reshape(count, D, D),
        follows,
    )


def _stacked_fields(
    value: Array, number: NDArray[np.int64], inner: Array, gravity: Array, *, tangent: bool
) -> LeafFields:
    """`LeafFields` of k leaf springs, every array with a leading axis (k,), with W and Y where `tangent`."""
    value, inner = np.ascontiguousarray(value), np.ascontiguousarray(inner)
    if gravity.shape[1] == 0:
        number = np.append(number[:5], [0, 0])
    stacked = LeafFields(*(np.empty((len(value), *part.shape)) for part in leaf_fields(number)))
    for i in range(len(value)):
        fields = LeafFields(*(part[i] for part in stacked))
        fill_leaf_fields(value[i], number, inner[i], gravity[i], fields)
        if tangent:
            strain_tangent(value[i], number, inner[i], fields)
    return stacked


def stretch_shear_compliances(value: Array, number: NDArray[np.int64], inner: Array) -> Array:
    """S (k, 3, 3) [m/N] of k leaf springs, without the rest of `uncondensed_leaves`."""
    _, first, _, _, _ = constant_offsets(number)
    ng = int(number[3])
    fields = _stacked_fields(value, number, inner, np.zeros((len(value), 0)), tangent=False)
    weight = value[:, :1] * value[:, first : first + ng]
    compliances: Array = np.einsum("kg,kgij->kij", weight, fields.S)
    return compliances


def _leaves_and_fields(
    value: Array, number: NDArray[np.int64], inner: Array, loads: Array | None
) -> tuple[UncondensedLeaves, Array, Array, Array]:
    """The leaves, and v (k, ng, 3), S (k, ng, 3, 3), eta (k, D, N) of their `ksd.elements.strain.LeafFields`."""
    _, at, _, _, _ = constant_offsets(number)
    k, ng = len(value), int(number[3])
    L, weight = value[:, 0], value[:, at : at + ng]
    integral = value[:, at + ng : at + ng + ng * ng].reshape(k, ng, ng)
    given = np.zeros((k, 0)) if loads is None else np.ascontiguousarray(loads)
    fields = _stacked_fields(value, number, inner, given, tangent=True)
    inside = L[:, None, None] * integral
    leaves = UncondensedLeaves(
        W=fields.W,
        J=np.concatenate([fields.rho, fields.psi[:, -1]], axis=1),
        S=np.einsum("k,kg,kgij->kij", L, weight, fields.S),
        length=L,
        s=integral.sum(axis=2),
        weight=weight,
        r=inside @ fields.v,
        end=fields.end,
        R=fields.R[:, 1:-1],
        rho=np.einsum("kgh,khri->kgri", inside, fields.slope),
        psi=fields.psi[:, 1:-1],
        compliance=fields.S,
    )
    return leaves, fields.v, fields.S, fields.eta


def strain_flexibility(leaves: UncondensedLeaves) -> tuple[Array, Array, Array]:
    """(P (k, N, 6), Z (k, N, N), K (k, 6, 6)): a = P xi + b, with b = Z f under inner loads f while the ends are fixed,
    and K xi the wrench at end q.

    With a = P xi + b the stiffness of a leaf decouples into its condensed K on xi and Z^-1 on b: keeping b as an
    unknown besides the end motions is exact, and needs no further factorisation.
    """
    flexibility = np.linalg.inv(leaves.W)
    Y = flexibility @ leaves.J.swapaxes(-1, -2)
    F = leaves.J @ Y
    F[..., :3, :3] += leaves.S
    K = np.linalg.inv(F)
    K = 0.5 * (K + K.swapaxes(-1, -2))
    P = Y @ K
    Z = flexibility - P @ Y.swapaxes(-1, -2)
    return P, 0.5 * (Z + Z.swapaxes(-1, -2)), K


def _bubbles(s: Array) -> tuple[Array, Array]:
    """Slopes P_j and, over the length, displacements (..., BUBBLES) at points s (...)."""
    P, j = np.asarray(legendre.legvander(2.0 * s - 1.0, BUBBLES + 1), float), np.arange(1, BUBBLES + 1)
    return P[..., 1:-1], (P[..., 2:] - P[..., :-2]) / (4 * j + 2)


def bubble_flexibility(leaves: UncondensedLeaves) -> Array:
    """Flexibility (k, 3 BUBBLES, 3 BUBBLES) of stretch and shear between fixed ends; the unknowns are shape by shape."""
    slope = _bubbles(leaves.s)[0]
    soft = leaves.compliance
    # a leaf spring without shear is stiff, not singular
    small = 1e-9 * np.trace(soft, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
    stiff = (leaves.length[:, None] * leaves.weight)[..., None, None] * np.linalg.inv(soft + small)
    K = np.einsum("kgi,kgab,kgj->kiajb", slope, stiff, slope)
    n = 3 * BUBBLES
    return np.linalg.inv(K.reshape(len(K), n, n))


def strain_mass_root(leaves: UncondensedLeaves, P: Array, line: Array) -> Array:
    """B (k, 6 ng, 12 + N + 3 BUBBLES) with the mass matrix B^T B of a leaf in (motion of p, xi, b, bubbles), frame p.

    Motion of p: velocity and spin (6); xi: motion of q relative to p (6); b as in `strain_flexibility`; bubbles as in
    `bubble_flexibility`. line (ng, 4), (4,) or (k, ng, 4): mass per length [kg/m], rotary inertia per length about e1, e2,
    e3 [kg m].
    """
    batch, N = leaves.W.shape[:-2], leaves.W.shape[-1]
    ng, s = leaves.weight.shape[-1], leaves.s[..., None, None]
    size, bubbles = 12 + N + 3 * BUBBLES, leaves.length[..., None, None] * _bubbles(leaves.s)[1]
    move, spin = np.zeros((2, *batch, ng, 3, size))
    relative_rho = leaves.rho - s * leaves.J[..., None, :3, :]
    end_motion = P[..., None, :, :]
    move[..., 0:3] = np.eye(3)
    # spin x r
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        move[..., j, 3 + i] = -leaves.r[..., k]
        move[..., k, 3 + i] = leaves.r[..., j]
    move[..., 6:12] = relative_rho @ end_motion
    move[..., 6:9] += s * np.eye(3)
    move[..., 12 : 12 + N] = relative_rho
    for i in range(3):
        move[..., i, 12 + N + i :: 3] = bubbles
    spin[..., 3:6] = np.eye(3)
    spin[..., 6:12] = leaves.psi @ end_motion
    spin[..., 12 : 12 + N] = leaves.psi
    spin = leaves.R.swapaxes(-1, -2) @ spin
    scale = leaves.length[..., None] * leaves.weight
    root = np.sqrt(scale[..., None] * np.broadcast_to(line, (*batch, ng, 4)))
    move *= root[..., :1, None]
    spin *= root[..., 1:, None]
    return np.concatenate([x.reshape(*batch, 3 * ng, size) for x in (move, spin)], axis=-2)

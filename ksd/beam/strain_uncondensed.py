"""What the strain-mode leaf needs beyond equilibrium: its uncondensed tangent, its mass, and its inner
flexibility.

The velocity of the leaf is that of end p plus the mode fields (rho_i, psi_i) of `ksd.beam.strain`
times the rates of the amplitudes; the stretch and shear that join it to end q (a velocity of 1/EA times the
rate of the force) are spread linearly along it, so that the mass stands on motions alone and is never
negative. Everything in frame p.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ksd.beam.strain import LeafFields, constant_offsets, fill_leaf_fields, leaf_fields, strain_tangent
from ksd.beam.strain_values import masses_beyond

Array = NDArray[np.float64]


@dataclass(frozen=True)
class UncondensedLeaves:
    """Leaf springs at one state each, k of them: W (k, N, N), J (k, 6, N), S (k, 3, 3) of the uncondensed tangent, and the
    mode fields.

    Tangent in (xi, a, lam): [0 0 I; 0 W -J^T; I -J -S], S in the force block only. length (k,) [m]; r (k, ng, 3): points;
    end (k, 3): end q; R (k, ng, 3, 3): orientations; rho, psi (k, ng, 3, N): displacement and rotation per unit amplitude;
    weight (k, ng), sum 1; s (k, ng): points in units of the length.
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


def quadrature_points(value: Array, number: NDArray[np.int64]) -> Array:
    """Quadrature points (ng,) of a leaf in units of its length."""
    _, weight, _, _, _ = constant_offsets(number)
    ng = int(number[3])
    return value[weight + ng : weight + ng + ng * ng].reshape(ng, ng).sum(axis=1)


@dataclass(frozen=True)
class GravityDerivatives:
    """How the uncondensed leaf follows gravity g in frame p, see `ksd.beam.weight`: first moment s (3,) [kg m] and its
    derivatives eta (3, N) by a, B (3, 3) by n and D (3, 3) by g."""

    s: Array
    eta: Array
    B: Array
    D: Array


def uncondensed_leaves(
    value: Array, number: NDArray[np.int64], inner: Array, gravity: Array | None = None
) -> UncondensedLeaves:
    """Those of k leaf springs of equal settings `number`, from constants (k, v) and inner states (k, N + 6); every array has
    a leading axis (k,), so that all are worked on in one call. gravity (k, 3) [m/s^2] in frames p of leaves with weight.
    """
    return _many(value, number, inner, gravity)[0]


def gravity_derivatives(
    value: Array, number: NDArray[np.int64], inner: Array, gravity: Array
) -> GravityDerivatives:
    """How k leaf springs with weight follow gravity (k, 3) [m/s^2], frames p; arrays as in `uncondensed_leaves`."""
    parts, v, S, eta = _many(value, number, inner, gravity)
    M = np.stack([masses_beyond(leaf, number) for leaf in value])
    amount = parts.length[:, None] * parts.weight * M
    B, D = (np.einsum("kg,kgij->kij", a, S) for a in (amount, amount * M))
    return GravityDerivatives(np.einsum("kg,kgi->ki", amount, v), eta, B, D)


def _every_leaf(
    value: Array, number: NDArray[np.int64], inner: Array, pull: Array, *, tangent: bool
) -> LeafFields:
    """`LeafFields` of k leaf springs, every array with a leading axis (k,), with W and Y for their tangents."""
    value, inner = np.ascontiguousarray(value), np.ascontiguousarray(inner)
    every = LeafFields(*(np.empty((len(value), *part.shape)) for part in leaf_fields(number)))
    for i in range(len(value)):
        f = LeafFields(*(part[i] for part in every))
        fill_leaf_fields(value[i], number, inner[i], pull[i], f)
        if tangent:
            strain_tangent(value[i], number, inner[i], f)
    return every


def stretch_shear_compliances(value: Array, number: NDArray[np.int64], inner: Array) -> Array:
    """S (k, 3, 3) [m/N] of k leaf springs, without the rest of `uncondensed_leaves`."""
    _, first, _, _, _ = constant_offsets(number)
    ng = int(number[3])
    f = _every_leaf(value, number, inner, np.zeros((len(value), 0)), tangent=False)
    weight = value[:, :1] * value[:, first : first + ng]
    found: Array = np.einsum("kg,kgij->kij", weight, f.S)
    return found


def _many(
    value: Array, number: NDArray[np.int64], inner: Array, gravity: Array | None
) -> tuple[UncondensedLeaves, Array, Array, Array]:
    """The parts, and v (k, ng, 3), S (k, ng, 3, 3), eta (k, 3, N) of `ksd.beam.strain.LeafFields`."""
    _, at, _, _, _ = constant_offsets(number)
    k, ng = len(value), int(number[3])
    L, weight = value[:, 0], value[:, at : at + ng]
    integral = value[:, at + ng : at + ng + ng * ng].reshape(k, ng, ng)
    pull = np.zeros((k, 0)) if gravity is None else np.ascontiguousarray(gravity)
    f = _every_leaf(value, number, inner, pull, tangent=True)
    inside = L[:, None, None] * integral
    parts = UncondensedLeaves(
        W=f.W,
        J=np.concatenate([f.rho, f.psi[:, -1]], axis=1),
        S=np.einsum("k,kg,kgij->kij", L, weight, f.S),
        length=L,
        s=integral.sum(axis=2),
        weight=weight,
        r=inside @ f.v,
        end=f.end,
        R=f.R[:, 1:-1],
        rho=np.einsum("kgh,khri->kgri", inside, f.slope),
        psi=f.psi[:, 1:-1],
    )
    return parts, f.v, f.S, f.eta


def strain_flexibility(parts: UncondensedLeaves) -> tuple[Array, Array, Array]:
    """(P (N, 6), Z (N, N), K (6, 6)): a = P xi + b, with b = Z f under inner loads f while the ends are held, and K xi the
    wrench at end q; of stacked parts (k, N, 6), (k, N, N) and (k, 6, 6).

    With a = P xi + b the stiffness of a leaf falls apart into its condensed K6 on xi and Z^-1 on b: nothing
    is left out by keeping b as an unknown beside the end motions, and nothing has to be factored anew.
    """
    soft = np.linalg.inv(parts.W)
    Y = soft @ parts.J.swapaxes(-1, -2)
    F = parts.J @ Y
    F[..., :3, :3] += parts.S
    K = np.linalg.inv(F)
    K = 0.5 * (K + K.swapaxes(-1, -2))
    P = Y @ K
    Z = soft - P @ Y.swapaxes(-1, -2)
    return P, 0.5 * (Z + Z.swapaxes(-1, -2)), K


def strain_mass_root(parts: UncondensedLeaves, P: Array, line: Array) -> Array:
    """B (6 ng, 12 + N) with the mass matrix B^T B of a leaf in (motion of p, xi, b), frame p; of stacked parts
    (k, 6 ng, 12 + N).

    Motion of p: velocity and spin (6); xi: motion of q relative to p (6); b as in `strain_flexibility`.
    line (ng, 4), (4,) or stacked (k, ng, 4): mass per length [kg/m], rotary inertia per length about e1, e2, e3 [kg m].
    """
    batch, N = parts.W.shape[:-2], parts.W.shape[-1]
    ng, s = parts.weight.shape[-1], parts.s[..., None, None]
    move, spin = np.zeros((*batch, ng, 3, 12 + N)), np.zeros((*batch, ng, 3, 12 + N))
    own = parts.rho - s * parts.J[..., None, :3, :]
    across = P[..., None, :, :]
    move[..., 0:3] = np.eye(3)
    # spin x r
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        move[..., j, 3 + i] = -parts.r[..., k]
        move[..., k, 3 + i] = parts.r[..., j]
    move[..., 6:12] = own @ across
    move[..., 6:9] += s * np.eye(3)
    move[..., 12:] = own
    spin[..., 3:6] = np.eye(3)
    spin[..., 6:12] = parts.psi @ across
    spin[..., 12:] = parts.psi
    spin = parts.R.swapaxes(-1, -2) @ spin
    scale = parts.length[..., None] * parts.weight
    amount = np.sqrt(scale[..., None] * np.broadcast_to(line, (*batch, ng, 4)))
    move *= amount[..., :1, None]
    spin *= amount[..., 1:, None]
    return np.concatenate([x.reshape(*batch, 3 * ng, 12 + N) for x in (move, spin)], axis=-2)

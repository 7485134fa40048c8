"""Eigenfrequencies and modes about a deformed, loaded state, with all inner unknowns (no Guyan condensation).

K x = omega^2 M x with K the exact tangent (constraint rows and geometric terms included) and M the consistent mass. With
M = L L^T the symmetric matrix L^T K^-1 L has the eigenvalues 1/omega^2: K may be a saddle, M may be singular, and an
unstable state has a negative one. Where it is faster the matrices are dense (`scipy.linalg`); with more unknowns per mode,
ARPACK works on K^-1 M with the factored tangent (shift and invert; `scipy.sparse.linalg`), and once more with the pairs
found deflated, as a single start vector may miss the second of two equal frequencies of a symmetric mechanism.

A motion N of unit modal mass that released drives leave without stiffness has 0 Hz. The others are found by inertia relief:
K^-1 becomes P^T K_h^-1 P with P = 1 - M N N^T, which removes the free motion from loads and responses, and K_h with as many
of these drives held, which then carry nothing (Craig and Kurdila, Fundamentals of Structural Dynamics, 2006, 17.7).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas, cholesky, eig, eigh, lapack, null_space, solve_triangular
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, eigsh

from ksd.answers.centrelines import scene_leaves
from ksd.answers.finer_model import finer_state
from ksd.answers.leaf_groups import leaf_groups
from ksd.answers.mass import Inertia, assemble_inertia, base_load, centre_of_mass, stack_nodes
from ksd.answers.material_damping import material_stiffness, member_loss_factors
from ksd.answers.printing import (
    PrintableAnswer,
    describe_node_motion,
    format_number,
    format_table,
    name_of_node,
    node_travel,
    released_text,
)
from ksd.answers.stiffness import DIRECTIONS
from ksd.answers.tangent import (
    Tangent,
    assemble_and_factor,
    check_backward_error,
    remove_row_components,
    row_gradients,
)
from ksd.checks import names_of
from ksd.errors import ConvergenceError, KinematicsError, SceneError
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.leaves import whole_leaf_name
from ksd.model.newton import move_nodes

Array = NDArray[np.float64]
MAX_DENSE = 220
"""Largest number of unknowns with mass, besides MAX_DENSE_PER_MODE for every mode, for which dense matrices are faster."""
MAX_DENSE_PER_MODE = 10
MAX_DENSE_SKEW = 1000
"""The same where modes that are not among the lowest may grow."""
MIN_ENERGY_SHARE = 0.25
"""Kinetic energy, relative to the largest, above which a leaf or link may name a mode."""
MIN_COMPLIANCE_RATIO = 1e-10
"""Compliance of a combination of released drives, relative to the largest, up to which the drives count as dependent."""
OFF_POLE = 1e-5
"""Relative change of the inner state of leaf springs by which a spectrum is taken off the poles of their flexibility."""
MIN_MASS_SHARE = 1e-12
"""Mass of a motion without stiffness, relative to that of the other such motions, up to which it counts as none."""
MIN_DRIVE_TRAVEL = 1e-9
"""Motion of a drive in a motion without stiffness, relative to that of the links, up to which it counts as none."""
MIN_INTENDED_CANDIDATES = 60
"""Number of modes among which intended motions are searched where the requested modes do not contain them."""
MIN_EIGENVALUE_RATIO = 1e-13
"""Value of 1/omega^2, relative to the largest, up to which a mode is rounding of the constraints."""


@dataclass(frozen=True, repr=False)
class Modes(PrintableAnswer):
    """Eigenfrequencies about a state, lowest first, and their shapes.

    frequency_Hz (k,): omega / 2 pi; an unstable mode (omega^2 < 0) has the negative number -sqrt(-omega^2) / 2 pi and
    comes first. omega_squared (k,) [1/s^2]. shape (k, nodes, 6): displacement [m] and rotation [rad] of every node of
    `model` for unit modal mass [kg m^2]; vector (k, size): all unknowns, inner ones included. drive_motion (k, drives):
    coordinate of every drive in each mode [m or rad]; zero where it is held. drive_compliance (d, d) [m/N, rad/Nm]: static
    compliance of the released drives; with modes at 0 Hz, that of the others. intended: rows of the modes that are intended
    motions, ascending, at most one per released drive (see `intended_modes`), independent of the number of modes requested.
    growth_per_s (k,): growth rate of a mode: of an unstable one, or, where loads are not conservative, of a pair that
    flutters at one frequency; both come first. freed: names of released drives and supports. motion, mass: the state and
    its mass; tangent: stiffness there; rigid (size, m): motions of 0 Hz. massless: materials without a density, whose leaves
    have no mass here. backward_error: change of a mode by one more inverse iteration, relative to the response of the
    softest mode.
    """

    model: Model
    frequency_Hz: Array
    omega_squared: Array
    shape: Array
    vector: Array
    drive_motion: Array
    drive_compliance: Array
    intended: NDArray[np.intp]
    growth_per_s: Array
    freed: tuple[str, ...]
    massless: tuple[str, ...]
    mass: Inertia = field(repr=False)
    motion: State = field(repr=False)
    tangent: Tangent = field(repr=False)
    rigid: Array = field(repr=False)
    conservative: bool = True
    backward_error: float = 0.0

    def __len__(self) -> int:
        return len(self.frequency_Hz)

    def _line(self) -> str:
        first, last = (format_number(f) for f in self.frequency_Hz[[0, -1]])
        return (
            f"{len(self)} modes, {first} to {last} Hz, {released_text(self.freed)}"
            if len(self)
            else "no modes"
        )

    def __str__(self) -> str:
        rows = []
        for k, f in enumerate(self.frequency_Hz):
            words = (
                [self.movements[k]]
                + [self.names[k]] * (k in self.intended)
                + ["unstable"] * bool(self.omega_squared[k] < 0.0)
            )
            rows.append((str(k + 1), format_number(f, 5), ", ".join(words)))
        unsymmetric = (
            "Loads that follow their link, pressure, or moments fixed in space, are not conservative: from the unsymmetric "
            f"tangent; {self._growth()}"
        )
        growth = [unsymmetric] * (not self.conservative)
        massless = [f"Without mass, for want of a density: {', '.join(self.massless)}"] * bool(self.massless)
        return format_table(
            ("mode", "[Hz]", "<what moves"),
            rows,
            f"Eigenfrequencies, {released_text(self.freed)}",
            *growth,
            *massless,
        )

    def _growth(self) -> str:
        """Sentence about the modes that grow."""
        growing = np.flatnonzero(self.growth_per_s > 0.0)
        if not len(growing):
            return "none of these grows, neither by itself (divergence) nor in oscillations (flutter)"
        kinds = {True: "divergence", False: "flutter"}
        named = (
            f"{k + 1} by {format_number(self.growth_per_s[k])} ({kinds[bool(self.omega_squared[k] < 0.0)]})"
            for k in growing
        )
        return f"modes that grow, per second and without damping: {', '.join(named)}"

    @cached_property
    def movements(self) -> tuple[str, ...]:
        """Dominant motion of every mode in words.

        It is that of the centre of mass of a link; or of the leaf springs, where more than half of the kinetic energy is in
        their motion between ends at rest, or where an internal block moves most.
        """
        between_ends, energy = self._between_ends(), self._energy_of_nodes()
        leaves = np.array(list(self.model.member_names), dtype=object)
        is_body = _is_named_body(self.model)
        descriptions = []
        for k, shape in enumerate(self.shape):
            if between_ends[:, k].sum() > 0.5:
                active = leaves[between_ends[:, k] > MIN_ENERGY_SHARE * between_ends[:, k].max()]
                more = f" and {len(active) - 2} more" if len(active) > 2 else ""
                descriptions.append(", ".join(f"'{n}'" for n in active[:2]) + f"{more} between the ends")
                continue
            active = energy[:, k] > MIN_ENERGY_SHARE * energy[:, k].max()
            active = active & is_body if np.any(active & is_body) else active
            node = int(np.argmax(np.where(active, node_travel(self.model, shape), -1.0)))
            at_centre = self._at_centre(node, shape[node]) if is_body[node] else shape[node]
            descriptions.append(_describe_dominant_body(self.model, node, at_centre, bool(is_body[node])))
        return tuple(descriptions)

    def _at_centre(self, node: int, shape: Array) -> Array:
        """Motion (6,) of the centre of mass of a link with the motion `shape` (6,) of its reference point."""
        arm = centre_of_mass(self.model, self.model.node_names[node]) - self.model.rest.x[node]
        return np.concatenate([shape[:3] + np.cross(shape[3:], self.motion.R[node] @ arm), shape[3:]])

    def _energy_of_nodes(self) -> Array:
        """Kinetic energy (nodes, k) of the point mass of every node and of the leaves that end there.

        The energy of a leaf is shared between its ends in proportion to the squares of their motions.
        """
        found = np.zeros((len(self.model.node_names), len(self)))
        moves = node_travel(self.model, self.shape).T ** 2
        padded = np.vstack([self.vector.T, np.zeros((1, len(self)))])
        for nodes, (places, B) in zip(stack_nodes(self.model), self.mass.stacks, strict=True):
            energy = ((B @ padded[places]) ** 2).sum(axis=1)
            both = moves[nodes].sum(axis=1)
            for e in range(nodes.shape[1]):
                share = np.divide(moves[nodes[:, e]], both, out=np.zeros_like(both), where=both > 0.0)
                np.add.at(found, nodes[:, e], share * energy)
        return found

    def _between_ends(self) -> Array:
        """Share (members, k) of the kinetic energy in the motion of every leaf relative to fixed ends."""
        share = np.zeros((len(self.model.member_names), len(self)))
        for group, (places, B) in zip(leaf_groups(self.model), self.mass.stacks, strict=False):
            moving = B[:, :, 12:] @ self.vector.T[places[:, 12:]]
            share[group.members] = (moving**2).sum(axis=1)
        return share

    def has_unknowns_of(self, other: Modes) -> bool:
        """Whether both are of the same nodes and constraints: a closed contact is one, and cuts the leaf spring it is on."""
        one, two = self.model, other.model
        return (one.node_names, one.drive_names, one.support_names) == (
            two.node_names,
            two.drive_names,
            two.support_names,
        )

    def mac(self, other: Modes) -> Array:
        """Modal assurance criterion, MAC (k, k'), in 0..1 between these modes and `other`, with the mean of both masses.

        To follow a mode along a stroke, take the mode with the largest number in its row. Raises SceneError where
        `other` has other unknowns.
        """
        if not self.has_unknowns_of(other):
            raise SceneError(
                "mac: these modes are of mechanisms with other links, supports or closed contacts."
            )
        one = np.vstack([self._rooted, other.mass.rooted(self.vector.T)])
        two = np.vstack([self.mass.rooted(other.vector.T), other._rooted])
        return np.asarray((one.T @ two) ** 2 / np.outer(np.sum(one**2, axis=0), np.sum(two**2, axis=0)))

    @cached_property
    def _rooted(self) -> Array:
        """Vectors of the modes times the square root of the mass matrix, see `Inertia.rooted`."""
        return self.mass.rooted(self.vector.T)

    def moved(self, row: int, size: float) -> State:
        """State of `model` displaced by `size` times the mode `row`, to first order, inner unknowns included."""
        # index -1, of fixed unknowns, reads the appended zero
        state, x = self.motion.copy(), np.append(size * self.vector[row], 0.0)
        for group, bent in zip(leaf_groups(self.model), self._bent(row), strict=True):
            state.inner[group.inner_index[:, : group.modes]] += size * bent
        move_nodes(self.model.arrays, state, x[: self.model.arrays.plan.unknowns], 1.0)
        return state

    def _bent(self, row: int) -> list[Array]:
        """Amplitudes (k, N) of the leaf springs of every group in the mode `row`."""
        x = np.append(self.vector[row], 0.0)
        return [
            x[leaf.inner] + (leaf.P @ (leaf.relative @ x[at[:, :12], None]))[..., 0]
            for leaf, (at, _) in zip(self.mass.leaves, self.mass.stacks, strict=False)
        ]

    def caption(self, row: int) -> str:
        """What a mode is called in pictures: its number, name and frequency."""
        return f"mode {row + 1}, {self.names[row]}: {self.frequency_Hz[row]:.4g} Hz"

    def static_response(self, loads: Array) -> Array:
        """Displacement (size, n) of all unknowns under loads (size, n), without the motions of 0 Hz."""
        return _inverse_stiffness(self.tangent, self.mass, self.rigid, _without_carried(self.tangent, loads))

    def participation(self, direction: str) -> Array:
        """Participation factors (k,) [kg^0.5; kg^0.5 m] of the modes where everything, ground included, is moved along or
        turned about a global axis through the origin: "x", "y", "z", "rx", "ry" or "rz"."""
        if direction not in DIRECTIONS:
            raise SceneError(f"direction {direction!r} is not known; give one of {', '.join(DIRECTIONS)}")
        motion = np.eye(6)[DIRECTIONS.index(direction)]
        return np.asarray(self.vector @ base_load(self.mass, self.model, self.motion, motion))

    @cached_property
    def effective_mass(self) -> Array:
        """Effective masses (k, 3) [kg] of the modes along x, y, z; over all modes they sum to the mass that moves."""
        return np.column_stack([self.participation(d) ** 2 for d in "xyz"])

    @cached_property
    def _leaf_shares(self) -> Array:
        """Elastic stiffness (members, k) of every leaf spring in every mode over omega^2; nan where that is not positive."""
        stiffness = material_stiffness(self.model, self.motion, self.mass, self.vector)
        squared = np.where(self.omega_squared > 0.0, self.omega_squared, np.nan)
        return np.asarray(stiffness / squared)

    @property
    def elastic_share(self) -> Array:
        """Share (k,) of the stiffness of every mode that is elastic, in leaf springs: below 1 in those that stand under a
        weight or hang on springs, above 1 in those that gravity or stress stiffen. nan for modes of 0 Hz."""
        return np.asarray(self._leaf_shares.sum(axis=0))

    @property
    def damping(self) -> Array:
        """Damping ratio (k,) of every mode by the loss factors of its leaf springs, half of each over its share; 0 where
        materials have none, and for modes of 0 Hz."""
        lost = 0.5 * member_loss_factors(self.model) @ self._leaf_shares
        return np.where(np.isnan(lost), 0.0, lost)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the modes in tables, sweeps and pictures: "intended" ("intended_1", ... where there are several) and
        "parasitic_1", ..., each kind numbered from the lowest."""
        return mode_names(len(self), self.intended)

    @property
    def first_parasitic(self) -> int | None:
        """Row of the lowest mode that is not intended; None where there is none among the modes."""
        return next((k for k in range(len(self)) if k not in self.intended), None)

    @property
    def first_parasitic_Hz(self) -> float:
        """Lowest frequency that is not that of an intended motion; with all drives held, the lowest of all.

        nan where there is none among the modes.
        """
        first = self.first_parasitic
        return float("nan") if first is None else float(self.frequency_Hz[first])


def intended_modes(motion: Array, omega_squared: Array, compliance: Array) -> NDArray[np.intp]:
    """Rows of the modes that are the intended motions of released drives, ascending.

    motion (k, d): coordinates of the drives in each mode; compliance (d, d): static compliance of the drives, the sum over
    all modes of motion motion^T / omega^2. In drive coordinates in which this sum is the unit matrix, the shares of all
    modes in any direction add to one, whatever combinations of motions the drives are. The mode with the largest share is
    taken, its direction removed, and this is repeated while no mode beyond those computed can have a larger share.
    """
    own = motion / np.sqrt(np.abs(omega_squared))[:, None]
    below = own[omega_squared < 0.0]
    # unstable modes count with positive sign, as the others
    total = compliance + 2.0 * below.T @ below
    scale = np.sqrt(np.abs(np.diagonal(total)))
    scale = np.where(scale > 0.0, scale, 1.0)
    value, axes = np.linalg.eigh(total / np.outer(scale, scale))
    kept = value > MIN_COMPLIANCE_RATIO * value.max(initial=0.0)
    share = own / scale @ axes[:, kept] / np.sqrt(value[kept])
    left, found = share.copy(), []
    for _ in range(min(left.shape)):
        size = np.sum(left**2, axis=1)
        k = int(np.argmax(size))
        direction = left[k] / np.sqrt(max(size[k], 1e-300))
        if size[k] <= 1.0 - np.sum((share @ direction) ** 2):
            break
        found.append(k)
        left -= np.outer(left @ direction, direction)
    return np.array(sorted(found), dtype=np.intp)


def mode_names(count: int, intended: NDArray[np.intp]) -> tuple[str, ...]:
    """Names of `count` modes, of which rows `intended` are intended motions (see `Modes.names`)."""
    names, numbers = [], {"intended": 0, "parasitic": 0}
    for k in range(count):
        kind = "intended" if k in intended else "parasitic"
        numbers[kind] += 1
        names.append("intended" if k in intended and len(intended) == 1 else f"{kind}_{numbers[kind]}")
    return tuple(names)


def _is_named_body(model: Model) -> Any:
    """Whether each node (nodes,) may name a mode: links may, and internal blocks with a mass of their own."""
    with_mass = {m.link for m in model.scene.masses if m.mass > 0.0}
    unlisted = model.scene.unlisted
    links = [n in with_mass or not ("/" in n or n in unlisted) for n in model.scene.links]
    return np.array(links + [False] * (len(model.node_names) - len(links)))


def _describe_dominant_body(model: Model, node: int, shape: Array, body: bool) -> str:
    """Describe the motion of a node, shape (6,); body: it is a link, otherwise leaf springs are named."""
    name, does = name_of_node(model, node), describe_node_motion(model, shape)
    if body or not does:
        return f"'{name}' {does}" if does else "the leaf springs"
    leaves = scene_leaves(model)
    leaf = whole_leaf_name(name, leaves)
    return f"'{leaf}' between the ends" if leaf in leaves else f"the leaf springs at '{name}', which {does}"


def _order_modes(values: Array, vectors: Array, count: int) -> tuple[Array, Array, Array]:
    """omega^2, shapes and growth rates of the modes with 1/omega^2 = values: those that grow first, then the lowest."""
    keep = np.abs(values) > MIN_EIGENVALUE_RATIO * np.abs(values).max(initial=0.0)
    values, vectors = values[keep], vectors[:, keep]
    growing, omega = grows(values), np.sqrt(1.0 / values + 0j)
    grown = np.where(growing, np.abs(omega.imag), 0.0)
    # a fluttering pair has the square of its frequency and the real part of its shape
    flutters = growing & (np.abs(values.imag) > 1e-6 * np.abs(values))
    squared = np.where(flutters, omega.real**2, (1.0 / values).real)
    order = np.lexsort((squared, ~growing))[:count]
    return squared[order], vectors[:, order].real, grown[order]


def grows(values: Array) -> Any:
    """Whether the modes with 1/omega^2 = values grow."""
    bound = 1e-9 * np.abs(values).max(initial=0.0)
    return (values.real < -bound) | (np.abs(values.imag) > np.maximum(bound, 1e-6 * np.abs(values)))


def _inverse_stiffness(tangent: Tangent, mass: Inertia, rigid: Array, loads: Array) -> Array:
    """K^-1 times loads (size, k), from the factored node tangent and the flexibilities of the leaf springs.

    rigid (size, m): motions without stiffness, of unit modal mass, which are removed from loads and response.
    """
    n = tangent.arrays.plan.unknowns
    if rigid.size:
        loads = loads - mass.matrix @ (rigid @ (rigid.T @ loads))
    response = np.empty_like(loads)
    many = loads.shape[1] > n
    response[:n] = tangent.solve(np.eye(n)) @ loads[:n] if many else tangent.solve(loads[:n])
    for inner, Z in (*((leaf.inner, leaf.Z) for leaf in mass.leaves), *mass.bubbles):
        response[inner] = Z @ loads[inner]
    return response - rigid @ (rigid.T @ (mass.matrix @ response)) if rigid.size else response


def _without_carried(tangent: Tangent, loads: Array) -> Array:
    """Loads (size, k) without what held drives and supports carry: it moves nothing, and would leave rounding."""
    names = (*tangent.model.drive_names, *tangent.model.support_names)
    held = [i for i, n in enumerate(names) if n not in tangent.freed]
    gradients = row_gradients(tangent.arrays, tangent.motion, held)
    found = np.array(loads, float)
    if held:
        nodes = found[: len(gradients)]
        nodes[:] = remove_row_components(tangent.arrays, tangent.arrays.size, gradients, nodes)[0]
    return found


def _rigid_motions(tangent: Tangent, mass: Inertia) -> Array:
    """Motions (size, m) without stiffness, of unit modal mass; raises KinematicsError where one has no mass either."""
    rigid = np.zeros((mass.size, tangent.free.shape[1]))
    if not rigid.size:
        return rigid
    rigid[: len(tangent.free)] = tangent.free
    rooted = mass.rooted(rigid)
    own = rooted.T @ rooted
    unit = np.sqrt(np.maximum(own.diagonal(), 0.0))
    unit[unit == 0.0] = 1.0
    if np.linalg.eigvalsh(own / np.outer(unit, unit))[0] <= MIN_MASS_SHARE:
        raise KinematicsError(
            f"with {', '.join(tangent.freed)} released a motion has neither stiffness nor mass, and so no frequency: give "
            "what moves a mass, or hold more drives"
        )
    return np.asarray(np.linalg.solve(cholesky(own).T, rigid.T).T)


def _drive_travel(tangent: Tangent, rigid: Array, own: Array) -> Array:
    """Motions (d, m) of drives with gradients own (unknowns, d) in motions without stiffness; zero where it is rounding."""
    nodes, start = rigid[: len(own)], tangent.arrays.start
    size = np.ones(len(own))
    size[start[start >= 0, None] + np.arange(3, 6)] = tangent.arrays.size
    travel = own.T @ nodes
    most = np.linalg.norm(own / size[:, None], axis=0)[:, None] * np.linalg.norm(
        nodes * size[:, None], axis=0
    )
    return np.where(np.abs(travel) > MIN_DRIVE_TRAVEL * most, travel, 0.0)


def _dense_pairs(tangent: Tangent, mass: Inertia, rigid: Array, count: int) -> tuple[Array, Array]:
    """1/omega^2 (k,) and vectors (size, k), including all unstable modes; complex where modes flutter."""
    M = mass.matrix.toarray()
    used = np.flatnonzero(M.diagonal() > 0.0)
    scale = 1.0 / np.sqrt(M.diagonal()[used])
    C, order, rank, _ = lapack.dpstrf(M[np.ix_(used, used)] * np.outer(scale, scale), lower=1)
    L = np.zeros((mass.size, rank))
    L[used[order - 1]] = (np.tril(C)[:, :rank].T / scale[order - 1]).T
    L = _without_carried(tangent, L)
    x = _inverse_stiffness(tangent, mass, rigid, L)
    # the BLAS of scipy, as `eigh` uses it: threads of numpy's own one would still occupy the cores
    A = blas.dgemm(1.0, L, x, trans_a=True)
    if tangent.skew is not None:
        values, vectors = eig(A)
        grow = np.flatnonzero(grows(values))
        chosen = np.union1d(grow, np.argsort(-np.abs(values))[: 2 * count])
        return values[chosen], x @ vectors[:, chosen]
    A = 0.5 * (A + A.T)
    values, vectors = eigh(A, subset_by_index=(max(0, rank - count), rank - 1))
    if tangent.unstable:
        below, more = eigh(A, subset_by_index=(0, min(rank, tangent.unstable) - 1))
        values, vectors = (
            np.concatenate([one[..., values > 0.0], other[..., below < 0.0]], axis=-1)
            for one, other in ((values, below), (vectors, more))
        )
    return values, x @ vectors


def _iterated_pairs(tangent: Tangent, mass: Inertia, rigid: Array, count: int) -> tuple[Array, Array]:
    """1/omega^2 (k,) and vectors (size, k) of many unknowns: the largest, and all unstable ones of conservative loads.

    Raises ConvergenceError where they are not found.
    """
    size, M = mass.size, mass.matrix
    values, vectors = np.zeros(0), np.zeros((size, 0))

    def inverse(load: Array) -> Array:
        # pairs that are known, of unit modal mass, are deflated
        known = vectors @ (values * (vectors.T @ load.ravel()))
        return np.asarray(_inverse_stiffness(tangent, mass, rigid, load.reshape(-1, 1))[:, 0] - known)

    def outermost(solve: Any, k: int, which: str) -> tuple[Array, Array]:
        start = np.random.default_rng(len(values)).normal(size=size)
        operator = LinearOperator((size, size), matvec=inverse, dtype=float)
        try:
            squared, shapes = solve(M, k=k, M=M, sigma=0.0, OPinv=operator, which=which, v0=start)
        except ArpackNoConvergence as reason:
            raise ConvergenceError(
                f"the lowest frequencies of {size} unknowns were not found; ask for fewer than {count} of them"
            ) from reason
        return 1.0 / squared, shapes

    if tangent.skew is not None:
        return outermost(eigs, min(2 * count + 4, size - 2), "LM")
    found = [outermost(eigsh, min(count, size - 1), "LA")]
    while True:
        values, vectors = np.concatenate([v for v, _ in found]), np.hstack([x for _, x in found])
        positive = np.sort(values[values > 0.0])[::-1][:count]
        missed = outermost(eigsh, 1, "LA")
        if missed[0][0] <= positive[-1]:
            break
        found.append(missed)
    for _ in range(tangent.unstable):
        found.append(outermost(eigsh, 1, "SA"))
        values, vectors = np.concatenate([v for v, _ in found]), np.hstack([x for _, x in found])
    return values, vectors


def lowest_squares(
    model: Model,
    motion: State,
    *,
    count: int = 8,
    freed: Iterable[str] = (),
    load_factor: float = 1.0,
    without_density: float = 0.0,
) -> Array:
    """omega^2 (k,) of loads that are not conservative, by modulus; complex where modes flutter.

    All of them up to MAX_DENSE_SKEW unknowns with mass, else about `count`. without_density: see `assemble_inertia`. Raises
    as `frequencies`.
    """
    fine, state = finer_state(model, motion, load_factor=load_factor)
    # a leaf bent to a full turn is neutral between fixed ends: its flexibility has a pole, which the spectrum has not
    state = state._replace(inner=(1.0 + OFF_POLE) * state.inner)
    mass = assemble_inertia(
        fine, state, load_factor=load_factor, without_density=without_density, with_bubbles=False
    )
    tangent = assemble_and_factor(fine, state, freed=freed, load_factor=load_factor)
    small = np.count_nonzero(mass.matrix.diagonal()) <= MAX_DENSE_SKEW
    values, _ = (_dense_pairs if small else _iterated_pairs)(
        tangent, mass, np.zeros((mass.size, 0)), mass.size if small else count
    )
    values = values[np.abs(values) > MIN_EIGENVALUE_RATIO * np.abs(values).max(initial=0.0)]
    return np.asarray(1.0 / values[np.argsort(-np.abs(values))] + 0j)


def _unit_modal_mass(mass: Inertia, vectors: Array, orthogonal: bool) -> Array:
    """Vectors (size, k) with unit modal mass; orthogonal: each also without what it has, by rounding, of those before it,
    which in stiff modes is softer by many orders."""
    rooted = mass.rooted(vectors)
    vectors = vectors / np.sqrt(np.sum(rooted**2, axis=0))
    if not orthogonal or not vectors.size:
        return vectors
    R = np.asarray(np.linalg.qr(rooted / np.sqrt(np.sum(rooted**2, axis=0)), mode="r"))
    return np.asarray(
        solve_triangular(R * np.sign(R.diagonal())[:, None], vectors.T, trans="T", lower=False).T
    )


def _backward_error(tangent: Tangent, mass: Inertia, rigid: Array, squared: Array, vectors: Array) -> float:
    """Normwise backward error of modes: their change by one more inverse iteration, relative to the response of the softest.

    squared: omega^2 (k,); vectors (size, k): of unit modal mass. Raises KinematicsError where it is too large.
    """
    if not len(squared):
        return 0.0
    again = squared * _inverse_stiffness(tangent, mass, rigid, mass.matrix @ vectors)
    change = np.linalg.norm(mass.rooted(again - vectors), axis=0)
    error = float(np.max(change * np.abs(squared).min() / np.abs(squared)))
    check_backward_error(error)
    return error


def frequencies(
    model: Model,
    motion: State,
    *,
    count: int = 6,
    freed: Iterable[str] = (),
    load_factor: float = 1.0,
    dense: bool | None = None,
) -> Modes:
    """The `count` lowest eigenfrequencies at `motion`, with all drives and supports held except those named in `freed`.

    Released drives keep their present force; a motion that this leaves without stiffness has 0 Hz. dense: True or False
    selects dense or sparse matrices. Raises SceneError where nothing has mass, KinematicsError where a motion has neither
    stiffness nor mass.
    """
    freed = names_of(freed, "freed")
    fine, state = finer_state(model, motion, load_factor=load_factor)
    mass = assemble_inertia(fine, state, load_factor=load_factor)
    tangent = assemble_and_factor(fine, state, freed=freed, load_factor=load_factor, free_motions=True)
    rigid = _rigid_motions(tangent, mass)
    # all modes are needed where the tangent is unsymmetric and its symmetric part is not positive definite
    all_needed = tangent.skew is not None and tangent.unstable
    massive = np.count_nonzero(mass.matrix.diagonal())
    gradient = row_gradients(fine.arrays, state, range(len(fine.drive_names)))
    own = gradient[:, [i for i, n in enumerate(fine.drive_names) if n in freed]]
    loads = np.zeros((mass.size, own.shape[1]))
    loads[: len(own)] = own
    compliance = loads.T @ _inverse_stiffness(tangent, mass, rigid, loads)
    compliance = 0.5 * (compliance + compliance.T)
    travel = _drive_travel(tangent, rigid, own)
    # combinations of drive forces that leave the motions without stiffness at rest
    balanced = null_space(travel.T) if travel.size else np.eye(own.shape[1])
    for wanted in (count, max(count, MIN_INTENDED_CANDIDATES)):
        most = MAX_DENSE_SKEW if all_needed else MAX_DENSE + MAX_DENSE_PER_MODE * wanted
        pairs = _dense_pairs if (massive <= most if dense is None else dense) else _iterated_pairs
        squared, vectors, grown = _order_modes(*pairs(tangent, mass, rigid, wanted), wanted)
        vectors = _unit_modal_mass(mass, vectors, tangent.skew is None)
        moved = vectors[: len(own)].T @ own
        intended = intended_modes(moved @ balanced, squared, balanced.T @ compliance @ balanced)
        if len(intended) == balanced.shape[1]:
            break
    # fluttering modes are parts of complex ones
    real = (grown == 0.0) | (squared < 0.0)
    error = _backward_error(
        tangent, mass, rigid, squared[:count][real[:count]], vectors[:, :count][:, real[:count]]
    )
    if rigid.size:
        first, zeros = int(np.count_nonzero(grown)), np.zeros(rigid.shape[1])
        squared, grown = np.insert(squared, first, zeros), np.insert(grown, first, zeros)
        vectors = np.insert(vectors, [first] * len(zeros), rigid, axis=1)
        driven = first + np.flatnonzero(travel.any(axis=0))
        intended = np.union1d(intended + len(zeros) * (intended >= first), driven)
    squared, vectors, grown = squared[:count], vectors[:, :count], grown[:count]
    shape = np.zeros((len(squared), len(fine.node_names), 6))
    for k in range(1, len(fine.node_names)):
        shape[:, k] = vectors[int(fine.arrays.start[k]) :][:6].T
    return Modes(
        model=fine,
        frequency_Hz=np.sign(squared) * np.sqrt(np.abs(squared)) / (2 * np.pi),
        omega_squared=squared,
        shape=shape,
        vector=vectors.T.copy(),
        drive_motion=vectors[: len(gradient)].T @ gradient,
        drive_compliance=compliance,
        intended=intended[intended < count],
        growth_per_s=grown,
        freed=freed,
        massless=mass.massless,
        mass=mass,
        motion=state,
        tangent=tangent,
        rigid=rigid,
        conservative=fine.arrays.conservative,
        backward_error=error,
    )

"""Samples of one shape of a joint: its finite element models driven over the stroke, and the values a record needs.

Interface A is ground, B a link that is driven by the intended motions and free otherwise, so the states are those of
pure intended motion. Several intended motions are sampled on a product grid, outwards from rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ksd.elements.corotational_values import ELEMENT_RECORD_SIZE, NODE_RECORD_SIZE
from ksd.errors import ConvergenceError, SceneError
from ksd.library.chains import element_axes, rotation_vectors
from ksd.library.functions import Array, Mesh
from ksd.model.arrays import State
from ksd.model.compile import Model, compile_as_is
from ksd.model.mesh import Mesh as LeafMesh
from ksd.model.reduced_bodies import relative_end_pose
from ksd.scene import Joint, Leaf
from ksd.solvers.configuration import Configuration
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.storage import NewtonStorage
from ksd.training.block_poses import block_poses
from ksd.training.designs import held_joint, redraw_joint
from ksd.training.stroke_checks import check_clear, check_plane, check_stays_soft, state_phrase

Samples = dict[tuple[Mesh, str], Array]
"""Values (grid points, *group shape) by mesh and group, groups as in `ksd.library.Functions`."""
SOLVE_TOLERANCE = 1e-9
"""Relative residual of the sampled equilibria."""


@dataclass(frozen=True)
class SamplingPlan:
    """Sampling of a joint: points of each motion as fractions of its largest magnitude, meshes, curvature modes of a leaf.

    max_plane_distance: of B from the plane of a one-axis joint, in rad and joint lengths. check_whole_stroke: check all
    points of the stroke, not only the corners of the motions, for colliding leaf springs and for other motions that
    become soft. refuse_collisions: whether leaf springs must not collide.
    """

    lines: tuple[tuple[float, ...], ...]
    meshes: tuple[Mesh, ...]
    orders: tuple[int, int, int]
    max_plane_distance: float = 1e-6
    check_whole_stroke: bool = False
    refuse_collisions: bool = True

    @property
    def grid(self) -> Array:
        """All points (g, m), as fractions of the largest magnitudes."""
        return np.stack(np.meshgrid(*self.lines, indexing="ij"), axis=-1).reshape(-1, len(self.lines))


def chebyshev_line(low: float, high: float, count: int) -> tuple[float, ...]:
    """Chebyshev-Lobatto points of [low, high], as fractions of its largest magnitude; rest is among them when centred."""
    x = -np.cos(np.pi * np.arange(count) / (count - 1))
    return _fractions(low, high, 0.5 * (x - x[::-1]))


def even_line(low: float, high: float, count: int) -> tuple[float, ...]:
    """Evenly spaced points of [low, high], as fractions of its largest magnitude."""
    return _fractions(low, high, np.linspace(-1, 1, count))


def _fractions(low: float, high: float, x: Array) -> tuple[float, ...]:
    """Points x in [-1, 1] of the range (low, high), as fractions of its largest magnitude."""
    reach = max(abs(low), abs(high))
    return tuple(float(v) for v in (0.5 * (low + high) + 0.5 * (high - low) * x) / reach)


def sample_joint(joint: Joint, plan: SamplingPlan) -> Samples:
    """All values that a record needs of `joint` at all grid points, for the meshes of `plan`.

    Raises SceneError when the joint cannot be represented: a state is not reached, is not the stable one, or leaves the
    plane of a one-axis joint; its leaf springs collide; or (where the whole stroke is checked) another motion becomes
    soft.
    """
    samples: Samples = {}
    for mesh in plan.meshes:
        model = _driven_model(joint, mesh, plan)
        states = _solve_grid(joint, model, plan, mesh)
        check_plane(joint, model, states, plan.max_plane_distance)
        if plan.refuse_collisions and mesh == plan.meshes[0]:
            check_clear(joint, [states[k] for k in np.flatnonzero(_contact_points(plan))])
        if plan.check_whole_stroke:
            check_stays_soft(joint, model, states)
        samples |= {(mesh, group): values for group, values in _read_groups(joint, model, states).items()}
    return samples


def _driven_model(joint: Joint, mesh: Mesh, plan: SamplingPlan) -> Model:
    """The joint between ground (A) and one driven link (B), joint axes global."""
    if mesh == "strain":
        # set for each leaf, so that a curved leaf does not choose its own
        joint = redraw_joint(joint, tuple(replace(leaf, orders=plan.orders) for leaf in joint.leaves()))
    scene, link = held_joint(joint)
    for motion in joint.motions:
        if motion.kind == "rotation":
            scene.actuate(link, name=motion.name, about=motion.axis)
        else:
            scene.actuate(link, name=motion.name, along=motion.axis, at=motion.point or joint.pose_B)
    if mesh == "strain":
        points = max(plan.orders) + (2 if all(leaf.curve is None for leaf in joint.leaves()) else 3)
        return compile_as_is(scene.scene(), LeafMesh("strain", orders=plan.orders, points=max(7, points)))
    return compile_as_is(scene.scene(), LeafMesh("corotational", elements=int(mesh)))


def _solve_grid(joint: Joint, model: Model, plan: SamplingPlan, mesh: Mesh) -> list[Configuration]:
    """Equilibrium at every grid point, each from the nearest one solved before, outwards from rest."""
    reach = np.array([max(abs(low), abs(high)) for low, high in (m.range for m in joint.motions)])
    grid = plan.grid
    storage = NewtonStorage(model)
    solved: dict[int, Configuration] = {}
    for i in np.argsort(np.linalg.norm(grid, axis=1), kind="stable"):
        nearest = min(solved, key=lambda k: float(np.linalg.norm(grid[k] - grid[i])), default=None)
        start = None
        if nearest is not None and np.linalg.norm(grid[nearest] - grid[i]) < np.linalg.norm(grid[i]):
            start = solved[nearest]
        values = {m.name: float(v) for m, v in zip(joint.motions, grid[i] * reach, strict=True)}
        state = f"{joint.family} ({mesh} mesh) at {state_phrase(joint, values)}"
        try:
            configuration = solve_conventional(
                model, values, start=start, rtol=SOLVE_TOLERANCE, storage=storage
            )
        except ConvergenceError as error:
            raise SceneError(f"{state} cannot be trained: {error}; reduce its range of motion.") from error
        if not configuration.stable:
            raise SceneError(
                f"{state} buckles or leaves the intended branch on the way; reduce its range of motion."
            )
        solved[int(i)] = configuration
    return [solved[i] for i in range(len(grid))]


def _contact_points(plan: SamplingPlan) -> NDArray[np.bool_]:
    """Mask (g,) of the points where collisions of leaf springs are checked: the corners of the motions, or all."""
    low, high = plan.grid.min(axis=0), plan.grid.max(axis=0)
    ends = np.isclose(plan.grid, low, atol=1e-12) | np.isclose(plan.grid, high, atol=1e-12)
    return np.asarray(ends.all(axis=1) | plan.check_whole_stroke)


def _read_groups(joint: Joint, model: Model, configurations: list[Configuration]) -> dict[str, Array]:
    """Interface, block and leaf functions of all states."""
    states = [c.motion for c in configurations]
    inner = [name for name in joint.blocks() if name not in ("A", "B")]
    nodes = [model.node_names.index(f"joint/{name}") for name in inner]
    points = [np.asarray(joint.blocks()[name], float) for name in inner]
    blocks = [block_poses(model, states, n, p, joint.length) for n, p in zip(nodes, points, strict=True)]
    groups = {
        "interface": block_poses(model, states, 1, np.asarray(joint.pose_B, float), joint.length),
        "blocks": np.stack(blocks, axis=1) if blocks else np.zeros((len(states), 0, 6)),
    }
    if model.chains:
        leaves = [_chain_rotations(model, states, i) for i in range(len(joint.leaves()))]
        return {**groups, "rotations": np.stack(leaves, axis=1)}
    pairs = [_strain_state(leaf, model, states, i) for i, leaf in enumerate(joint.leaves())]
    groups["amplitudes"] = np.stack([a for a, _ in pairs], axis=1)
    groups["wrench"] = np.stack([w for _, w in pairs], axis=1)
    return groups


def _strain_state(leaf: Leaf, model: Model, states: list[State], i: int) -> tuple[Array, Array]:
    """Dimensionless amplitudes (g, N) and wrench (g, 6) of leaf i."""
    members = model.arrays.members
    inner = np.array([s.inner[members.inner_at[i] : members.inner_at[i + 1]] for s in states])
    count, L = int(members.number[i, :3].sum()), float(members.length[i])
    bending = leaf.material.E * leaf.section.Iz
    unit = np.repeat([L**2 / bending, L / bending], 3)
    return L * inner[:, :count], unit * inner[:, count:]


def _chain_rotations(model: Model, states: list[State], i: int) -> Array:
    """Rotation vectors (g, 2n-1, 3) of the elements, then of the inner nodes, of leaf i; frame of end p."""
    members = model.arrays.members
    n = int(members.number[i, 0])
    value = members.value[members.value_at[i] : members.value_at[i] + ELEMENT_RECORD_SIZE * n + 9]
    inner = np.array(
        [s.inner[members.inner_at[i] : members.inner_at[i] + NODE_RECORD_SIZE * (n - 1)] for s in states]
    )
    nodes = inner.reshape(len(states), n - 1, NODE_RECORD_SIZE)
    d, Q = map(np.array, zip(*(relative_end_pose(members, i, s) for s in states), strict=True))
    position = np.concatenate([np.zeros((len(d), 1, 3)), nodes[:, :, :3], d[:, None]], axis=1)
    first = np.broadcast_to(np.eye(3), Q.shape)[:, None]
    last = (Q @ value[ELEMENT_RECORD_SIZE * n :].reshape(3, 3).T)[:, None]
    rotation = np.concatenate([first, nodes[:, :, 3:].reshape(len(d), n - 1, 3, 3), last], axis=1)
    rest = value[: ELEMENT_RECORD_SIZE * n].reshape(n, ELEMENT_RECORD_SIZE)[:, 7:].reshape(n, 3, 3)
    across = np.einsum("gnij,nj->gni", rotation[:, :-1] + rotation[:, 1:], rest[:, :, 1])
    axes = element_axes(np.diff(position, axis=1), across)
    elements = axes @ np.swapaxes(rest, 1, 2)
    return rotation_vectors(np.concatenate([elements, rotation[:, 1:-1]], axis=1))

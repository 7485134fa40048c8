"""Verification of a state by integration of every leaf spring as a geometrically exact rod.

From end p, with the wrench of the state there, the rod is integrated to its other end (`ksd.elements.rod`, order 8). Its
distance from end q is the error of the modes or elements of the leaf. Then the equilibrium of the mechanism with these rods
in place of its leaves (`ksd.model.rods`) is found by Newton steps from the state, mostly one; its distance from the state is
the error of the state: of method, mesh and residual together.

A leaf under tension so large that integration over its length is ill conditioned is divided into parts, whose first stations
are initially those of the state.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.answers.centrelines import cross_rows, poses_along
from ksd.answers.leaf_groups import EndFrames, chain_groups, end_frames, leaf_groups
from ksd.answers.leaf_rods import (
    MAX_GROWTHS_PER_PART_WITH_WEIGHT,
    RodParts,
    cut_rods,
    with_plate_moments,
)
from ksd.answers.printing import PrintableAnswer, format_number, format_table, render_text
from ksd.answers.tangent import AssembledTangent, assemble_tangent, factor_tangent, skew_block
from ksd.elements.rod import ROD_LOADS
from ksd.elements.strain_values import load_totals
from ksd.errors import KinematicsError
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.newton import assemble_nodes, largest_rotation, move_nodes
from ksd.model.rods import RodState, add_rods, move_rods

Array = NDArray[np.float64]
MAX_LINEAR_GAP = 0.01
"""Closure gap of a part (relative to its length, or in rad) above which a single Newton step does not suffice."""
MAX_QUADRATIC_SHARE = 0.2
"""Ratio of the quadratic (stretch) to the linear force of the gaps above which a single Newton step does not suffice."""
MAX_STEPS = 10
"""Largest number of Newton steps."""
MAX_LAST_STEP_SHARE = 0.1
"""Largest last step, relative to the distance from the state, at which that distance is known well enough."""
ROUNDING_STEP = 1e-13
"""Last step, relative to forces and displacements, that counts as rounding."""
MAX_TURN_PER_STEP = 0.5
"""Largest rotation of a link in a step [rad]."""
MAX_STEP_RATIO = 1.0
"""Largest ratio of the motion of the parts in a step to that in the step before; beyond it the iteration diverges."""
STATIONS_PER_PART = 16
"""Points of a leaf, per part, between which its stations are interpolated."""
GAP_CLIP = 1e3
"""Gap [m, rad] to which larger ones are clipped."""
ROUNDING_DISPLACEMENT = 1e-11
"""Displacement, relative to the size of the mechanism, that counts as rounding."""


class Gaps(NamedTuple):
    """Closure gaps of all leaves: distance of every leaf, integrated from its start, from its end.

    names (k,): of the leaves, or of elements in a nodal mesh; values (k, 6): displacement [m] and rotation [rad] in the axes
    of its start, for a leaf in parts the sum of their gaps; lengths (k,) [m].
    """

    names: tuple[str, ...]
    values: Array
    lengths: Array


@dataclass(frozen=True, repr=False)
class Verification(PrintableAnswer):
    """Error of a state by integration of every leaf spring, and the corrected state.

    gaps: of all leaves. forces: corrected forces of the drives [N or Nm]; force_errors: their corrections; reactions:
    corrected forces of the supports. links: corrected displacement (3,) [m] of the reference point and rotation matrix
    (3, 3), by name. displacement [m], rotation [rad]: largest correction of a link. relative: the larger of the relative
    errors of force and displacement. unclosed: leaves that could not be integrated to their ends; then nothing is corrected
    and relative is infinite.
    """

    gaps: Gaps
    forces: Mapping[str, float]
    force_errors: Mapping[str, float]
    reactions: Mapping[str, float]
    links: Mapping[str, tuple[Array, Array]]
    displacement: float
    rotation: float
    relative: float
    unclosed: tuple[str, ...] = ()

    def _line(self) -> str:
        if self.unclosed:
            return f"not known, '{self.unclosed[0]}' cannot be integrated to its end"
        return f"{format_number(100 * self.relative, 2, zero=1e-9)} % by integration of {len(self.gaps.names)} leaf springs"

    @property
    def sentence(self) -> str:
        """The error in one sentence."""
        if self.unclosed:
            names = ", ".join(f"'{name}'" for name in self.unclosed)
            return (
                f"Not verified: integration of {names} does not lead to the end it has; the state is too far from one of "
                "exact rods, or strained beyond what they bear"
            )
        shift, turn = (
            format_number(1e6 * self.displacement, 2, zero=1e-6),
            format_number(1e3 * self.rotation, 2, zero=1e-6),
        )
        worst = ""
        if self.gaps.names:
            miss = _relative_gaps(self.gaps.values, self.gaps.lengths)
            name, most = (
                self.gaps.names[int(np.argmax(miss))],
                format_number(100 * float(miss.max()), 2, zero=1e-12),
            )
            worst = f"; '{name}' misses its end most, by {most} % of its length"
        error = format_number(100 * self.relative, 2, zero=1e-9)
        return (
            f"Verified by integration of every leaf spring: {error} % off (links within "
            f"{shift} um and {turn} mrad{worst})"
        )

    def __str__(self) -> str:
        shift, turn = (
            np.linalg.norm(part, axis=1) for part in (self.gaps.values[:, :3], self.gaps.values[:, 3:])
        )
        rows = [
            (name, format_number(1e6 * a, 3, zero=1e-9), format_number(1e3 * b, 3, zero=1e-9))
            for name, a, b in zip(self.gaps.names, shift.tolist(), turn.tolist(), strict=True)
        ]
        forces = [
            (name, format_number(value, 6, zero=1e-12), format_number(self.force_errors[name], 2, zero=1e-12))
            for name, value in self.forces.items()
        ]
        drives = [format_table(("drive", "corrected [N, Nm]", "error [N, Nm]"), forces)] if forces else []
        return render_text(
            self.sentence, format_table(("leaf", "gap [um]", "rotation [mrad]"), rows), *drives
        )


def _wrenches(assembled: AssembledTangent, load_factor: float) -> tuple[EndFrames, Array, Array]:
    """End frames of all leaves, wrenches (k, 6) of a state at ends p in their axes, and their loads (k, ROD_LOADS),
    global."""
    model, motion, arrays, work = assembled.model, assembled.motion, assembled.arrays, assembled.work
    members, count = arrays.members, len(model.member_names)
    ends = end_frames(model, motion, slice(count))
    at_p, loads = work.lam[:count, :6].copy(), np.zeros((count, ROD_LOADS))
    at_p[:, 3:] += cross_rows(ends.d, at_p[:, :3])
    for i in np.flatnonzero(arrays.load_modes):
        D = 3 * int(arrays.load_modes[i])
        loads[i] = load_factor * arrays.weight[i, 1:]
        pull = work.store[: members.store_at[i + 1]][-D * (10 + D) :]
        f, first = (pull[k : k + D].reshape(-1, 3) for k in (0, D))
        total = arrays.weight[i, :1]
        if i in model.strain_leaves and members.number[i, 5]:
            total = load_totals(members.value[None, members.value_at[i] :], members.number[i])[0]
        at_p[i] += np.concatenate([total @ f, np.cross(first, f).sum(axis=0)])
    return ends, at_p, loads


def _initial_rod_state(
    model: Model, motion: State, cut: RodParts, ends: EndFrames, at_p: Array, loads: Array, load_factor: float
) -> RodState:
    """Rods with wrenches `at_p` (k, 6) at ends p, and stations at those of the leaves of a state."""
    first, count = cut.rods.at_part[:-1], len(cut.leaf)
    wrench, position, axes = np.zeros((count, 6)), np.zeros((count, 3)), np.zeros((count, 3, 3))
    wrench[first] = (at_p.reshape(-1, 2, 3) @ cut.start_axes).reshape(-1, 6)
    parts = np.diff(cut.rods.at_part)
    most = int(parts.max())
    if most > 1:
        row = np.empty(len(parts), int)
        for group in (*leaf_groups(model), *chain_groups(model)):
            row[:], row[group.members] = -1, np.arange(len(group.members))
            own = np.flatnonzero((cut.share > 0.0) & (row[cut.leaf] >= 0))
            if len(own):
                points = STATIONS_PER_PART * most
                position[own], axes[own] = poses_along(
                    model, motion, group, row[cut.leaf[own]], cut.share[own], points, load_factor
                )
        start, held = ends.start.copy(), ends.frame[:, None] @ at_p.reshape(-1, 2, 3, 1)
        n, m, axes_before = held[:, 0, :, 0], held[:, 1, :, 0], ends.frame.copy()
        for k in range(1, most):
            # equilibrium from one station to the next, with the loads between them in the middle
            own = np.flatnonzero(parts > k)
            at = first[own] + k
            middle = 0.5 * (cut.share[at - 1] + cut.share[at])[:, None]
            line = loads[own, 3:6] + middle * loads[own, 6:9]
            push = loads[own, 9:] * cut.rods.rod[cut.rods.at_step[at - 1], 0, 11:] * axes_before[own, :, 1]
            weight = cut.mass[at - 1, None] * loads[own, :3] + cut.length[at - 1, None] * (line + push)
            n[own] -= weight
            m[own] += cross_rows(n[own] + 0.5 * weight, position[at] - start[own])
            start[own], axes_before[own] = position[at], axes[at]
            wrench[at] = (np.stack([n[own], m[own]], axis=1) @ axes[at]).reshape(-1, 6)
    sizes = (6,), (6, 7), (6, 13), (6,)
    return RodState(loads, position, axes, wrench, *(np.zeros((count, *size)) for size in sizes))


class _RodMechanism:
    """A model with rods in place of its leaves, which starts at the state of a tangent.

    verified: the state that is verified; its distance decides about convergence. max_growth: see `cut_rods`.
    """

    def __init__(
        self,
        assembled: AssembledTangent,
        target: Array,
        load_factor: float,
        verified: _VerifiedState,
        max_growth: float,
    ) -> None:
        self.model, self.work, self.verified = assembled.model, assembled.work, verified
        self.target, self.load_factor = target, load_factor
        ends, at_p, loads = _wrenches(assembled, load_factor)
        self.motion = assembled.motion.copy()
        self.cut = with_plate_moments(self.model, self.motion, cut_rods(self.model, at_p, max_growth))
        self.state = _initial_rod_state(self.model, self.motion, self.cut, ends, at_p, loads, load_factor)
        self._assemble()

    def _assemble(self) -> None:
        """Assemble residual and tangent into the workspace."""
        motion, work = self.motion, self.work
        assemble_nodes(self.model.arrays, motion, self.load_factor, work, target=self.target)
        add_rods(self.model.arrays.ints, motion.x, motion.R, self.cut.rods, self.state, work.matrix, work.rhs)

    def gaps(self) -> Gaps:
        """Closure gaps of all leaves; those of the parts of a leaf are added."""
        rods = self.cut.rods
        lengths = np.add.reduceat(rods.step, rods.at_step[rods.at_part[:-1]])
        return Gaps(self.model.member_names, np.add.reduceat(self.state.gap, rods.at_part[:-1]), lengths)

    def _newton_step(self) -> Array:
        """Newton step (unknowns,) from the assembled residual and tangent."""
        arrays, motion, work = self.model.arrays, self.motion, self.work
        skew = skew_block(arrays, motion, self.load_factor, None)
        tangent = factor_tangent(AssembledTangent(self.model, motion, arrays, work.matrix, 0, skew, work))
        return tangent.solve(-work.rhs[:, None])[:, 0]

    def close(self) -> bool:
        """Close all gaps by Newton's method; returns whether it converges.

        Raises KinematicsError where a motion of the initial state has no stiffness.
        """
        arrays, motion, before = self.model.arrays, self.motion, math.inf
        model, begin, scale = self.verified
        for k in range(MAX_STEPS):
            if k > 0:
                self._assemble()
            if not np.isfinite(self.work.rhs).all():
                return False
            try:
                step = self._newton_step()
            except KinematicsError:
                if k == 0:
                    raise
                return False
            move_rods(arrays.ints, motion.x, motion.R, self.cut.rods, self.state, step)
            move_nodes(arrays, motion, step, 1.0)
            moves = _relative_gaps(self.state.closing, self.cut.length)
            largest = float(moves.max())
            if k == 0 and largest < MAX_LINEAR_GAP and _is_linear(self.cut, self.state, moves):
                return True
            last = scale.relative(*_step_change(self.model, step))
            total = scale.relative(*_state_change(model, begin, motion)[:2])
            if largest < MAX_LINEAR_GAP and last <= MAX_LAST_STEP_SHARE * total + ROUNDING_STEP:
                return True
            if not largest <= MAX_STEP_RATIO * before or largest_rotation(arrays, step) > MAX_TURN_PER_STEP:
                return False
            before = largest
        return False

    def unclosed(self) -> tuple[str, ...]:
        """Names of the leaves with the largest gaps."""
        clipped = np.clip(np.nan_to_num(self.state.gap, nan=GAP_CLIP), -GAP_CLIP, GAP_CLIP)
        gaps = _relative_gaps(clipped, self.cut.length)
        leaves = self.cut.leaf[gaps >= 0.5 * gaps.max()]
        return tuple(dict.fromkeys(self.model.member_names[i] for i in leaves))


def _relative_gaps(gap: Array, length: Array) -> Array:
    """The larger (k,) of displacement relative to length, and rotation [rad], of gaps (k, 6) of parts of lengths (k,)."""
    shift, turn = (np.sqrt((part * part).sum(axis=1)) for part in (gap[:, :3], gap[:, 3:]))
    return np.asarray(np.maximum(shift / length, turn))


def _is_linear(cut: RodParts, state: RodState, moves: Array) -> bool:
    """Whether the relative motions (p,) of the parts in a step were so small that their forces are linear in them."""
    force = (state.wrench_change[:, :3, :6] @ state.closing[..., None])[..., 0]
    most = MAX_QUADRATIC_SHARE * math.sqrt(float((force * force).sum(axis=1).max()))
    return float((cut.axial * moves * moves).max()) <= most


def _state_change(model: Model, before: State, now: State) -> tuple[Array, float, float]:
    """Change of the multipliers (c,) and largest displacement [m] and rotation [rad] of a link between two states."""
    return np.abs(now.multiplier - before.multiplier), *now.largest_move(before, model.links)


def _step_change(model: Model, step: Array) -> tuple[Array, float]:
    """Change of the multipliers (c,) and largest displacement of a link [m] in a Newton step."""
    shift = step[model.arrays.start[1 : model.links, None] + np.arange(3)]
    most = float((shift * shift).sum(axis=1).max(initial=0.0))
    return np.abs(step[model.arrays.terms.start]), math.sqrt(most)


class _StateScale(NamedTuple):
    """Largest drive force [N, Nm] and displacement of a link [m] of a state, rounding included; number of drives."""

    force: float
    shift: float
    drives: int

    def relative(self, force: Array, shift: float) -> float:
        """The larger of the relative changes of force and displacement; inf where they are not finite."""
        found = max(float(force[: self.drives].max(initial=0.0)) / self.force, shift / self.shift)
        return found if math.isfinite(found) else math.inf


class _VerifiedState(NamedTuple):
    """The state that is verified, and its scale."""

    model: Model
    motion: State
    scale: _StateScale


def _state_scale(model: Model, motion: State) -> _StateScale:
    """Scale of a state, see `_StateScale`."""
    arrays, links, drives = model.arrays, model.links, len(model.drive_names)
    moved = motion.x[:links] - model.rest.x[:links]
    rounding, stiffness = ROUNDING_DISPLACEMENT * arrays.size, arrays.members.stiffness_scale
    noise = rounding * float(stiffness.max(initial=0.0)) * min(1.0, arrays.size)
    force = noise + float(np.abs(motion.multiplier[:drives]).max(initial=0.0))
    shift = rounding + math.sqrt(float((moved * moved).sum(axis=1).max()))
    return _StateScale(max(force, 1e-300), shift, drives)


def verify(
    model: Model,
    motion: State,
    target: Array,
    *,
    load_factor: float = 1.0,
    of: tuple[Model, State] | None = None,
) -> Verification:
    """Verify a state of strain-mode leaves and chains by integration of every leaf.

    target (c,): values of drives and supports; load_factor: of the loads. of: model and state that are verified, where
    `motion` is a nearby state on another mesh; by default `motion` itself. Raises KinematicsError where a motion has no
    stiffness.
    """
    assembled = assemble_tangent(model, motion, load_factor=load_factor, target=target)
    begin = of or (model, motion)
    verified = _VerifiedState(*begin, _state_scale(*begin))
    if not len(model.member_names):
        step, now = factor_tangent(assembled).solve(-assembled.work.rhs[:, None])[:, 0], motion.copy()
        move_nodes(model.arrays, now, step, 1.0)
        return _verification(verified, now, Gaps((), np.zeros((0, 6)), np.zeros(0)), ())
    for max_growth in MAX_GROWTHS_PER_PART_WITH_WEIGHT:
        rods = _RodMechanism(assembled, target, load_factor, verified, max_growth)
        gaps = rods.gaps()
        closed = rods.close()
        if closed or not model.arrays.load_modes.any():
            break
    return _verification(verified, rods.motion, gaps, () if closed else rods.unclosed())


def _verification(
    verified: _VerifiedState, now: State, gaps: Gaps, unclosed: tuple[str, ...]
) -> Verification:
    """Verification of a state from the state `now` to which its rods lead."""
    model, motion, scale = verified
    drives = len(model.drive_names)
    if unclosed:
        now = State(*(np.full_like(part, math.nan) for part in now))
    change, shift, turn = _state_change(model, motion, now)
    moved = now.x[: model.links] - model.rest.x[: model.links]
    placed = {link: (moved[i], now.R[i].copy()) for i, link in enumerate(model.scene.links)}
    forces, named = -now.multiplier, (model.drive_names, model.support_names)
    return Verification(
        gaps, dict(zip(named[0], forces.tolist(), strict=False)), dict(zip(named[0], change.tolist(), strict=False)),
        dict(zip(named[1], forces[drives:].tolist(), strict=True)), placed, shift,
        turn, scale.relative(change, shift), unclosed,
    )  # fmt: skip

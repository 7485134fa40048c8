"""A state judged by integration: every leaf spring as the geometrically exact rod that its model stands for.

From end p, with the wrench that the state holds there, the rod is integrated to its other end (`ksd.beam.rod`, order 8).
By how far it misses end q is what the modes or elements of the leaf are wrong by. Then the mechanism is solved on from the
state with these rods in the place of its leaves (`ksd.model.rods`), by as many Newton steps as it takes, mostly one; the
distance gone is the error of the state, of method, mesh and residual together.

Where a leaf is so taut that integration over its length would lose its digits, it is cut at stations, which begin where the
state has them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.beam.strain_values import GRAVITY_BLOCK_SIZE
from ksd.errors import KinematicsError
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.newton import assemble_nodes, largest_rotation, move_nodes
from ksd.model.rods import RodState, add_rods, move_rods
from ksd.properties.leaf_groups import EndFrames, chain_groups, end_frames, leaf_groups
from ksd.properties.leaf_rods import RodParts, cut_rods, rod_sizes
from ksd.properties.printing import PrintableAnswer, format_number, format_table, render_text
from ksd.properties.shape import cross_rows, poses_along
from ksd.properties.tangent import AssembledTangent, assemble_tangent, factor_tangent, skew_block

Array = NDArray[np.float64]
WIDE = 0.01
"""Way of the end of a part to where its rod closes, over its length or in rad, from which one step is not enough."""
SQUARE = 0.2
"""Force of the stretch that goes with the square of that way, over the force that goes with it, from which one is not."""
ROUNDS = 10
"""Most steps."""
NEARLY = 0.1
"""Last step over the whole way at which this is known."""
NOTHING = 1e-13
"""Last step, over forces and displacements, that is rounding."""
MOST_TURN = 0.5
"""Largest turn of a link in a step [rad]."""
SHRINKS = 1.0
"""Way of the parts in a step over that in the step before, beyond which they go astray."""
BETWEEN = 16
"""Places of a leaf between which those of its stations are, for each."""
FAR = 1e3
"""Gap [m, rad] that stands for all larger ones."""
GRAIN = 1e-11
"""Displacement, over the size of the mechanism, that counts as rounding."""


class Gaps(NamedTuple):
    """By how far every leaf, integrated from its start, misses its end: names (of elements where the mesh is nodal), values
    (k, 6), shift [m] and turn [rad] in the axes of its start, and lengths (k,) [m]. Of a taut leaf, which is cut, what its
    parts miss, added up."""

    names: tuple[str, ...]
    values: Array
    lengths: Array


@dataclass(frozen=True, repr=False)
class Verification(PrintableAnswer):
    """What integration of every leaf spring says of a state, and the state that it corrects this to.

    gaps: of all leaves. forces: of the drives, corrected [N or Nm], force_errors: by how much; reactions: of the supports,
    corrected. links: corrected displacement (3,) [m] of the reference point and rotation matrix (3, 3), by name.
    displacement [m], rotation [rad]: the largest correction of a link. relative: the larger of force error over force and
    displacement error over displacement. unclosed: leaves that could not be integrated to their ends; then nothing is
    corrected and relative is infinite.
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
        """The error in words."""
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
            miss = _misses(self.gaps.values, self.gaps.lengths)
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
        return render_text(self.sentence, format_table(("leaf", "gap [um]", "turned [mrad]"), rows), *drives)


def _wrenches(assembled: AssembledTangent, mass: Array, load_factor: float) -> tuple[EndFrames, Array, Array]:
    """End frames of all leaves; wrenches (k, 6) at end p that a state holds, in its axes; gravity (k, 3), global."""
    model, motion, arrays, work = assembled.model, assembled.motion, assembled.arrays, assembled.work
    members, weight, count = arrays.members, arrays.weight, len(mass)
    ends = end_frames(model, motion, slice(count))
    at_p, gravity = work.lam[:count, :6].copy(), np.zeros((count, 3))
    at_p[:, 3:] += cross_rows(ends.d, at_p[:, :3])
    heavy = np.flatnonzero(mass > 0.0)
    if len(heavy):
        gravity[heavy] = load_factor * weight[heavy, 1:]
        own = (gravity[heavy, None] @ ends.frame[heavy])[:, 0]
        pull = work.store[
            (members.store_at[heavy + 1] - GRAVITY_BLOCK_SIZE)[:, None] + np.arange(GRAVITY_BLOCK_SIZE)
        ]
        at_p[heavy] += np.hstack([mass[heavy, None] * own, cross_rows(pull[:, 3:6], own)])
    return ends, at_p, gravity


def _begun(
    model: Model, motion: State, cut: RodParts, ends: EndFrames, at_p: Array, gravity: Array
) -> RodState:
    """Rods with wrenches (k, 6) at end p, and stations where the leaves of a state have them."""
    first, count = cut.rods.at_part[:-1], len(cut.of)
    wrench, place, axes = np.zeros((count, 6)), np.zeros((count, 3)), np.zeros((count, 3, 3))
    wrench[first] = (at_p.reshape(-1, 2, 3) @ cut.turn).reshape(-1, 6)
    parts = np.diff(cut.rods.at_part)
    most = int(parts.max())
    if most > 1:
        row = np.empty(len(parts), int)
        for group in (*leaf_groups(model), *chain_groups(model)):
            row[:], row[group.members] = -1, np.arange(len(group.members))
            own = np.flatnonzero((cut.share > 0.0) & (row[cut.of] >= 0))
            if len(own):
                where = row[cut.of[own]], cut.share[own]
                place[own], axes[own] = poses_along(model, motion, group, *where, BETWEEN * most)
        start, held = ends.start.copy(), ends.frame[:, None] @ at_p.reshape(-1, 2, 3, 1)
        n, m = held[:, 0, :, 0], held[:, 1, :, 0]
        for k in range(1, most):
            # from one station to the next by equilibrium, the weight between them halfway
            own = np.flatnonzero(parts > k)
            at = first[own] + k
            weight = cut.mass[at - 1, None] * gravity[own]
            n[own] -= weight
            m[own] += cross_rows(n[own] + 0.5 * weight, place[at] - start[own])
            start[own] = place[at]
            wrench[at] = (np.stack([n[own], m[own]], axis=1) @ axes[at]).reshape(-1, 6)
    sizes = (6,), (6, 7), (6, 13), (6,)
    return RodState(gravity, place, axes, wrench, *(np.zeros((count, *size)) for size in sizes))


class _Rods:
    """A model with rods in the place of its leaves, from the state that they are to be put to; judged: the state by whose
    distance they are close enough, and its scale."""

    def __init__(
        self,
        assembled: AssembledTangent,
        target: Array,
        load_factor: float,
        judged: tuple[Model, State, _Scale],
    ) -> None:
        self.model, self.work, self.judged = assembled.model, assembled.work, judged
        self.target, self.load_factor = target, load_factor
        ends, at_p, gravity = _wrenches(assembled, rod_sizes(self.model).mass, load_factor)
        self.cut = cut_rods(self.model, at_p)
        self.motion = assembled.motion.copy()
        self.state = _begun(self.model, self.motion, self.cut, ends, at_p, gravity)
        self._assemble()

    def _assemble(self) -> None:
        motion, work = self.motion, self.work
        assemble_nodes(self.model.arrays, motion, self.load_factor, work, target=self.target)
        add_rods(
            self.model.arrays.flat.ints, motion.x, motion.R, self.cut.rods, self.state, work.matrix, work.rhs
        )

    def gaps(self) -> Gaps:
        """By how far every leaf misses, its parts together."""
        rods = self.cut.rods
        lengths = np.add.reduceat(rods.step, rods.at_step[rods.at_part[:-1]])
        return Gaps(self.model.member_names, np.add.reduceat(self.state.gap, rods.at_part[:-1]), lengths)

    def _step(self) -> Array:
        arrays, motion, work = self.model.arrays, self.motion, self.work
        skew = skew_block(arrays, motion, self.load_factor)
        tangent = factor_tangent(AssembledTangent(self.model, motion, arrays, work.matrix, 0, skew, work))
        return tangent.solve(-work.rhs[:, None])[:, 0]

    def close(self) -> bool:
        """Newton's method to where all gaps are closed; whether they are. Raises KinematicsError where a motion of the state
        to begin with is left that nothing resists."""
        arrays, motion, before = self.model.arrays, self.motion, math.inf
        model, begin, scale = self.judged
        for k in range(ROUNDS):
            if k > 0:
                self._assemble()
            if not np.isfinite(self.work.rhs).all():
                return False
            try:
                step = self._step()
            except KinematicsError:
                if k == 0:
                    raise
                return False
            move_rods(arrays.flat.ints, motion.x, motion.R, self.cut.rods, self.state, step)
            move_nodes(arrays, motion, step, 1.0)
            ways = _misses(self.state.moved, self.cut.length)
            way = float(ways.max())
            if k == 0 and way < WIDE and _is_linear(self.cut, self.state, ways):
                return True
            last = scale.relative(*_step_way(self.model, step))
            whole = scale.relative(*_way(model, begin, motion))
            if way < WIDE and last <= NEARLY * whole + NOTHING:
                return True
            if not way <= SHRINKS * before or largest_rotation(arrays, step) > MOST_TURN:
                return False
            before = way
        return False

    def unclosed(self) -> tuple[str, ...]:
        """The leaves that miss most."""
        miss = _misses(np.clip(np.nan_to_num(self.state.gap, nan=FAR), -FAR, FAR), self.cut.length)
        return tuple(dict.fromkeys(self.model.member_names[i] for i in self.cut.of[miss >= 0.5 * miss.max()]))


def _misses(gap: Array, length: Array) -> Array:
    """Gaps (k, 6) over the lengths, (k,)."""
    shift, turn = (np.sqrt((part * part).sum(axis=1)) for part in (gap[:, :3], gap[:, 3:]))
    return np.asarray(np.maximum(shift / length, turn))


def _is_linear(cut: RodParts, state: RodState, ways: Array) -> bool:
    """Whether what the rods had to go in a step, of `_misses` ways, was so little that their forces went with it."""
    force = (state.back[:, :3, :6] @ state.moved[..., None])[..., 0]
    most = SQUARE * math.sqrt(float((force * force).sum(axis=1).max()))
    return float((cut.axial * ways * ways).max()) <= most


def _way(model: Model, before: State, now: State) -> tuple[Array, float]:
    """Between two states: change of the multipliers (c,) and largest displacement of a link [m]."""
    shift = now.x[: model.links] - before.x[: model.links]
    return np.abs(now.multiplier - before.multiplier), math.sqrt(float((shift * shift).sum(axis=1).max()))


def _turned(model: Model, before: State, now: State) -> float:
    """Largest rotation of a link between two states [rad]."""
    turned = now.R[: model.links] - before.R[: model.links]
    # of a rotation by t: 2 sqrt(2) sin(t / 2)
    apart = math.sqrt(float((turned * turned).sum(axis=(1, 2)).max()))
    return 2.0 * math.asin(min(apart / math.sqrt(8.0), 1.0))


def _step_way(model: Model, step: Array) -> tuple[Array, float]:
    """`_way` of a Newton step."""
    shift = step[model.arrays.start[1 : model.links, None] + np.arange(3)]
    most = float((shift * shift).sum(axis=1).max(initial=0.0))
    return np.abs(step[model.arrays.terms.start]), math.sqrt(most)


class _Scale(NamedTuple):
    """What a state is measured by: its largest drive force [N, Nm] and displacement of a link [m], rounding included."""

    force: float
    shift: float
    drives: int

    def relative(self, force: Array, shift: float) -> float:
        """The larger of force over force and displacement over displacement."""
        found = max(float(force[: self.drives].max(initial=0.0)) / self.force, shift / self.shift)
        return found if math.isfinite(found) else math.inf


def _scale(model: Model, motion: State) -> _Scale:
    arrays, links, drives = model.arrays, model.links, len(model.drive_names)
    moved = motion.x[:links] - model.rest.x[:links]
    noise = (
        GRAIN * arrays.size * float(arrays.members.stiffness_scale.max(initial=0.0)) * min(1.0, arrays.size)
    )
    force = noise + float(np.abs(motion.multiplier[:drives]).max(initial=0.0))
    shift = GRAIN * arrays.size + math.sqrt(float((moved * moved).sum(axis=1).max()))
    return _Scale(max(force, 1e-300), shift, drives)


def verify(
    model: Model,
    motion: State,
    target: Array,
    *,
    load_factor: float = 1.0,
    of: tuple[Model, State] | None = None,
) -> Verification:
    """Integrate every leaf of a state, its drives at target (c,) and loads times load_factor; leaves are strain-mode leaves
    or chains. of: the state next to it on another mesh that is verified, this one by default.

    Raises KinematicsError where a motion is left that nothing resists.
    """
    assembled = assemble_tangent(model, motion, load_factor=load_factor, target=target)
    begin = of or (model, motion)
    judged = (*begin, _scale(*begin))
    if not len(model.member_names):
        step, now = factor_tangent(assembled).solve(-assembled.work.rhs[:, None])[:, 0], motion.copy()
        move_nodes(model.arrays, now, step, 1.0)
        return _answer(*judged, now, Gaps((), np.zeros((0, 6)), np.zeros(0)), ())
    rods = _Rods(assembled, target, load_factor, judged)
    gaps = rods.gaps()
    unclosed = () if rods.close() else rods.unclosed()
    return _answer(*judged, rods.motion, gaps, unclosed)


def _answer(
    model: Model, motion: State, scale: _Scale, now: State, gaps: Gaps, unclosed: tuple[str, ...]
) -> Verification:
    """The verification of a state, from where its rods lead."""
    drives = len(model.drive_names)
    if unclosed:
        now = State(*(np.full_like(part, math.nan) for part in now))
    change, shift = _way(model, motion, now)
    moved = now.x[: model.links] - model.rest.x[: model.links]
    placed = {link: (moved[i], now.R[i].copy()) for i, link in enumerate(model.scene.links)}
    forces, named = -now.multiplier, (model.drive_names, model.support_names)
    return Verification(
        gaps, dict(zip(named[0], forces.tolist(), strict=False)), dict(zip(named[0], change.tolist(), strict=False)),
        dict(zip(named[1], forces[drives:].tolist(), strict=True)), placed, shift,
        math.nan if unclosed else _turned(model, motion, now), scale.relative(change, shift), unclosed,
    )  # fmt: skip

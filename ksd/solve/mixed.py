"""Modal bodies beside condensed KSD joints: steps 1 to 4 of the KSD method with some leafs as modal bodies.

Steps 1 and 2 place everything by the joints' records and condense the joints that are not reduced otherwise. The inner
coordinates of the modal bodies are found next, their ends held where step 1 put them (`ksd.modal.mixed.Settling`). Step 3
is the equilibrium of links, condensed joints and bodies, step 4 the recovery of the condensed joints.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ksd.bodies.joints import joint_bodies
from ksd.errors import ConvergenceError, SceneError
from ksd.modal.bodies import carried_over, member_pose, with_modal_bodies
from ksd.modal.choices import ModalBasis
from ksd.modal.mixed import LINEAR_INNER, Mixture, Settling, mixture
from ksd.model.arrays import MODAL, Motion, Work, make_work
from ksd.model.compile import Model
from ksd.model.system import assemble
from ksd.numerics.blocks import factor_blocks
from ksd.numerics.stopwatch import Stopwatch
from ksd.solve import pipeline
from ksd.solve.configuration import Configuration
from ksd.solve.driving import CAP, RTOL, Driven, drive_to
from ksd.solve.five import FiveSteps
from ksd.solve.newton import iterate
from ksd.solve.space_steps import condense_space, place_space, read_space, recover_space
from ksd.solve.steps import Step
from ksd.solve.stops import Stop

Near = Callable[[Mapping[str, float]], Motion]
MOST_SETTLING = 40
PARTS = (2, 4, 8, 16)
"""Equal parts of drives and loads together where the whole of them fails."""
SMALLEST = 1 / 128
"""Smallest part of the loads put on at a time."""
STIFFLY = 1e3
"""How much more stiffly columns without energy are held while a large basis finds its way."""
WAYS_THERE = (1, 2, 4, 8, 16)
"""Equal steps from rest in which the ends of a body are turned until its inner coordinates follow."""


class Prepared:
    """The mixture of one model with modal bodies or solids, with storage; smaller: the same of smaller bases, where a large
    one starts."""

    def __init__(self, modal: Any, steps: FiveSteps, smaller: Prepared | None = None) -> None:
        self.smaller = smaller
        self.mix: Mixture = mixture(modal, steps.bench.bodies.reduced)
        self.work: Work = make_work(self.mix.arrays)
        self.settling = {m: Settling(self.mix, m) for m in self.mix.bodies}
        self.settling_work = {m: make_work(s.arrays) for m, s in self.settling.items()}
        self.modal_work: Work = make_work(modal.arrays)
        self.held = _held(self.mix)
        self.own = [h.copy() for h in self.held]

    def stiffen(self, factor: float) -> None:
        """Hold columns without energy `factor` times as stiffly as their bodies do."""
        for held, own in zip(self.held, self.own, strict=True):
            held[:] = factor * own

    def settled(self, m: int, d: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, int]:
        """Inner coordinates of body m with its end q held at d, Q, and Newton steps taken."""
        body, work = self.settling[m], self.settling_work[m]
        large = None if self.smaller is None else self.mix.modal.bodies[body.member]
        if self.smaller is None or large is None or not large.choices.large:
            return _settled(body, work, d, Q)
        found, taken = self.smaller.settled(m, d, Q)
        small = self.smaller.mix.modal.bodies[body.member]
        assert small is not None
        motion = body.rest.copy()
        motion.inner[:] = start = carried_over(small, large, d, Q, found)
        body.hold(d, Q)
        reason, count, *_ = iterate(
            body.arrays, motion, np.zeros(0), 1.0, work, 1e-6, MOST_SETTLING, CAP, math.inf
        )
        return (motion.inner if reason == 0 else start), taken + count


def _held(mix: Mixture) -> list[np.ndarray]:
    """Views of the stiffnesses that hold columns without energy, of every basis once."""
    members, found = mix.arrays.members, {}
    for m in np.flatnonzero(members.kind == MODAL).tolist():
        first = int(members.value_at[m] + 18 + members.number[m, 2])
        found[first] = members.value[first : first + int(members.number[m, 1])]
    return list(found.values())


class MixedSolver:
    """A mechanism of modal bodies and condensed joints, prepared for repeated solves.

    full: the model whose leafs in `leafs` are chains. near: state of `full` to expand trained bases at. Raises what
    `ksd.bodies.joints.joint_bodies` does, and SceneError for leafs with weight.
    """

    def __init__(
        self,
        model: Model,
        full: Model,
        leafs: Mapping[str, ModalBasis],
        *,
        near: Near,
        records: Any,
        extrapolate: bool,
    ) -> None:
        if len(model.arrays.weight):
            raise SceneError(
                "leafs with weight beside modal bodies are not possible: compile without='gravity', or use another method"
            )
        bodies = joint_bodies(model, records, extrapolate=extrapolate)
        self.model, self.full, self.leafs, self.near = model, full, leafs, near
        self.steps = FiveSteps(model, bodies, extrapolate=extrapolate)
        self._at_rest: Prepared | None = None

    def _prepared(self, values: Mapping[str, float]) -> Prepared:
        """Bodies and storage; made once, unless a basis is expanded where the mechanism stands."""
        free = set(self.model.member_names[self.model.joint_members[-1].stop :])
        trained = {n for n, b in self.leafs.items() if b.expansion == "trained"} - free
        if trained:
            words = {"about": self.near(values), "at_rest": set(self.leafs) - trained}
            return self._made(words)
        if self._at_rest is None:
            self._at_rest = self._made({})
        return self._at_rest

    def _made(self, words: dict[str, Any]) -> Prepared:
        """Bodies and storage, with those of smaller bases where one is large."""
        small = None
        if any(b.large for b in self.leafs.values()):
            fewer = {n: b.smaller if b.large else b for n, b in self.leafs.items()}
            small = Prepared(with_modal_bodies(self.full, fewer, **words), self.steps)
        return Prepared(with_modal_bodies(self.full, self.leafs, **words), self.steps, small)

    def __call__(
        self, values: Mapping[str, float], *, passes: int = 0, patient: bool = True
    ) -> Configuration:
        """Solve at drive values. passes: rounds in which the joints are condensed again where they are; patient: take
        parts of loads and drives where the whole of them fails.

        Raises RangeError, ConvergenceError.
        """
        target = self.model.targets(values)
        placed = self.steps(values, target, method="kinematic", passes=0, estimate=False)
        clock = Stopwatch()
        ready = self._prepared(values)
        steps = [*placed.steps, Step("modal bases", 0, clock(), 0.0, Stop.CONVERGED)]
        b = self.steps.bench
        motion, settled = self._start(ready)
        steps.append(Step("bodies settled", settled, clock(), 0.0, Stop.CONVERGED, "ends held"))
        try:
            steps.append(_equilibrium(ready, motion, target, once=not patient))
        except ConvergenceError as reason:
            if not patient:
                raise
            motion, count = self._along(ready, values, reason)
            steps.append(
                Step("3 reduced equilibrium", count, clock(), 0.0, Stop.CONVERGED, "along the drive")
            )
        for n in range(passes + 1):
            if n > 0:
                condense_space(b.held, 0)
                self._condensed(ready, motion)
                steps.append(_equilibrium(ready, motion, target, once=True))
            links = self.model.links
            b.reduced.x[:], b.reduced.R[:] = motion.x[:links], motion.R[:links]
            clock()
            shift, _ = recover_space(b.held)
            steps.append(Step("4 recovery", 0, clock(), shift, Stop.CONVERGED))
        return self._answer(ready, motion, values, steps, placed)

    def _condensed(self, ready: Prepared, motion: Motion) -> None:
        """The condensed joints of step 2 into `motion`."""
        inner = self.steps.bench.reduced.inner
        for m in np.flatnonzero(ready.mix.joint >= 0).tolist():
            at = LINEAR_INNER * ready.mix.joint[m]
            ready.mix.own(motion, m)[:] = inner[at : at + LINEAR_INNER]

    def _along(
        self, ready: Prepared, values: Mapping[str, float], reason: ConvergenceError
    ) -> tuple[Motion, int]:
        """The equilibrium by way of others on the way to the drive values and loads; raises `reason` where it fails."""
        taken, target = 0, self.model.targets(values)
        for parts in PARTS:
            motion, stop = ready.mix.rest, Stop.CONVERGED
            for share in np.linspace(1.0 / parts, 1.0, parts):
                part = {name: float(share * value) for name, value in values.items()}
                self.steps(part, share * target, method="kinematic", passes=0, estimate=False)
                if motion is ready.mix.rest:
                    motion, _ = self._start(ready)
                self._condensed(ready, motion)
                found = iterate(
                    ready.mix.arrays,
                    motion,
                    share * target,
                    share,
                    ready.work,
                    RTOL,
                    MOST_SETTLING,
                    CAP,
                    math.inf,
                )
                stop, taken = Stop(found[0]), taken + found[1]
                if stop is not Stop.CONVERGED:
                    break
            if stop is Stop.CONVERGED:
                return motion, taken
        raise reason

    def _start(self, ready: Prepared) -> tuple[Motion, int]:
        """Where steps 1 and 2 put everything, the bodies settled there; and Newton steps taken for that."""
        mix, placed = ready.mix, self.steps.bench.full
        motion, count = mix.rest.copy(), 0
        motion.x[:], motion.R[:] = placed.x[mix.nodes], placed.R[mix.nodes]
        at, free = self.model.arrays.members.inner_at, self.model.joint_members[-1].stop
        alike: dict[tuple, np.ndarray] = {}
        for m, i in enumerate(mix.member):
            if m in ready.settling:
                d, Q = member_pose(mix.arrays.members, m, motion)
                pose = np.round(np.concatenate([d / mix.arrays.size, Q.ravel()]), 10) + 0.0
                key = int(mix.arrays.members.value_at[m]), pose.tobytes()
                if key not in alike:
                    alike[key], taken = ready.settled(m, d, Q)
                    count += taken
                mix.own(motion, m)[:] = alike[key]
            elif 0 <= i < free:
                mix.own(motion, m)[:] = placed.inner[at[i] : at[i + 1]]
        self._condensed(ready, motion)
        return motion, count

    def _answer(
        self,
        ready: Prepared,
        motion: Motion,
        values: Mapping[str, float],
        steps: list[Step],
        placed: Configuration,
    ) -> Configuration:
        """The state of all leafs, and what the joints' records say of it."""
        b, mix, modal = self.steps.bench, ready.mix, ready.mix.modal
        place_space(b.held)
        state = modal.rest.copy()
        state.x[:], state.R[:] = b.full.x, b.full.R
        state.x[mix.nodes], state.R[mix.nodes] = motion.x, motion.R
        state.multiplier[:] = motion.multiplier
        mine, theirs = modal.arrays.members.inner_at, self.model.arrays.members.inner_at
        for i in np.setdiff1d(np.arange(len(mine) - 1), mix.member):
            state.inner[mine[i] : mine[i + 1]] = b.full.inner[theirs[i] : theirs[i + 1]]
        for m in np.flatnonzero(mix.member >= 0).tolist():
            mix.theirs(state, m)[:] = mix.own(motion, m)
        # condensed joints cannot buckle, their leafs can
        _, _, inside, _ = assemble(
            modal.arrays, state, modal.targets(values), 1.0, ready.modal_work, RTOL, 0, 10.0
        )
        plan = modal.arrays.plan
        negatives, _ = factor_blocks(plan, ready.modal_work.value, ready.modal_work.spare, len(plan.size))
        read_space(b.held)
        near = bool(b.seen[1])
        reading, unknown = pipeline.read_motions(b, b.found.copy(), b.off.copy(), b.known, near=near)
        expected = len(modal.drive_names) + len(modal.support_names)
        return Configuration(
            modal, state, "modal", dict(values), tuple(steps), negatives=int(negatives + inside),
            expected=expected, reading=reading, notes=(*placed.notes, *unknown), near=near,
        )  # fmt: skip


def _equilibrium(ready: Prepared, motion: Motion, target: np.ndarray, *, once: bool) -> Step:
    """Step 3, in place: loads put on at once or, failing that, in parts, unless `once`; large bases held stiffly first.

    Raises ConvergenceError.
    """
    if ready.smaller is None:
        return _loaded(ready, motion, target, once=once)
    try:
        ready.stiffen(STIFFLY)
        first = _loaded(ready, motion, target, once=once)
    finally:
        ready.stiffen(1.0)
    last = _loaded(ready, motion, target, once=True)
    return last._replace(iterations=first.iterations + last.iterations, time=first.time + last.time)


def _loaded(ready: Prepared, motion: Motion, target: np.ndarray, *, once: bool) -> Step:
    """Step 3 with columns without energy held as they are."""
    clock, arrays = Stopwatch(), ready.mix.arrays

    def newton(want: np.ndarray, level: float, rtol: float, most: int, cap: float, limit: float) -> Any:
        return iterate(arrays, motion, want, level, ready.work, rtol, most, cap, limit)

    def driven_from(low: float, smallest: float) -> Driven:
        ways: dict[str, Any] = {"factors": (low, 1.0), "smallest": smallest, "pivoting": (arrays, ready.work)}
        return drive_to(motion, newton, start=target, target=target, **ways)

    driven = driven_from(0.0, 1.0)
    if driven.stop is not Stop.CONVERGED and not once:
        # without loads first: the place steps 1 and 2 give is no equilibrium of theirs
        reason, count, *_ = newton(target, 0.0, RTOL, 30, CAP, math.inf)
        if reason == Stop.CONVERGED:
            more = driven_from(0.0, SMALLEST)
            driven = more._replace(solves=driven.solves + count + more.solves, taken=more.taken + 1)
    parts = f"{driven.taken} load steps" if driven.taken > 1 else ""
    step = Step("3 reduced equilibrium", driven.solves, clock(), driven.residual, driven.stop, parts)
    if driven.stop is not Stop.CONVERGED and once:
        raise ConvergenceError(
            f"in a further pass {driven.stop.sentence}: the loads bend the joints too far from their intended motion to "
            "condense them there; take fewer passes, or use method='full'"
        )
    if driven.stop is not Stop.CONVERGED:
        raise ConvergenceError(
            f"basis no longer successful: beside condensed joints, at {100 * driven.reached:.3g} % of the loads, "
            f"{driven.stop.sentence}; name all joints, take expansion='trained', or use method='full'",
            reached=driven.reached,
        )
    return step


def _settled(body: Settling, work: Work, d: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, int]:
    """Inner coordinates with end q held at d, Q, in one go or along the way there; and Newton steps taken.

    Those of rest where none are found: the equilibrium of the mechanism may yet find them.
    """
    taken = 0
    for steps in WAYS_THERE:
        motion, reason = body.rest.copy(), 0
        for k in range(steps):
            body.hold(*body.between((k + 1) / steps, d, Q))
            reason, count, *_ = iterate(
                body.arrays, motion, np.zeros(0), 1.0, work, 1e-6, MOST_SETTLING, CAP, math.inf
            )
            taken += count
            if reason != 0:
                break
        if reason == 0:
            return motion.inner, taken
    return body.rest.inner, taken


__all__ = ["MixedSolver", "Prepared"]

"""How far a modal basis is good: stroke and local rotation of one leaf, found by driving it alone.

Three ways of bending bound what a leaf meets in a mechanism: a tip driven across with its rotation free, the same with
the rotation held (a guide), and a rotation. Each is driven further until the error indicator passes the wanted error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from ksd.errors import SceneError
from ksd.modal.basis import shortest_turn
from ksd.modal.bodies import ModalModel, body_nodes, inside, member_pose, with_modal_bodies
from ksd.modal.choices import ModalBasis
from ksd.modal.solid_health import SolidRange
from ksd.model.arrays import Motion, make_work
from ksd.model.compile import Model, compile_given
from ksd.model.mesh import Mesh
from ksd.numerics.stopwatch import Stopwatch
from ksd.properties.shape import scene_leafs
from ksd.properties.tangent import exact
from ksd.scene.mechanism import Mechanism
from ksd.solve.driving import CAP, RTOL
from ksd.solve.error import relative_error
from ksd.solve.load_steps import load_steps
from ksd.solve.newton import iterate
from ksd.solve.steps import ErrorEstimate, Step
from ksd.solve.stops import Stop
from ksd.solve.storage import Storage
from ksd.solve.whole_solids import bent as bent_solid
from ksd.solve.whole_solids import validity as solid_validity

WAYS = ("across", "guided", "turned")
"""Tip driven across, across without turning, and turned."""
FAR = {"across": 0.6, "guided": 0.6, "turned": np.deg2rad(75.0)}
"""As far as is tried: strokes over the length, and a rotation [rad]."""
STEPS, HALVINGS = 8, 4
CORRECTORS = 3
"""Corrector steps of the error indicator; more are taken while they still change it (see `indicator`)."""
MOST_CORRECTORS = 20
SETTLED = 0.02
"""Relative change of the indicator by further steps at which it is believed; at 0.1 one of 225 states was 62 % off."""


def indicator(
    model: ModalModel, motion: Motion, target: np.ndarray, *, correctors: int | None = None
) -> tuple[ErrorEstimate, Step]:
    """Error of a modal state by Newton steps of the full model from its nodes; the state is left alone.

    correctors: how many; when None, three, and two more each time while these change the result by 2 % or more: far
    from equilibrium the first steps of the full model lead astray.
    """
    clock = Stopwatch()
    full, state = model.full, inside(model, motion)
    arrays = exact(full.arrays)
    work, taken, last = make_work(arrays), 0, math.inf
    lost = ErrorEstimate(np.full(len(model.drive_names), math.inf), math.inf, math.inf, math.inf)
    while True:
        most = correctors or (CORRECTORS if taken == 0 else 2)
        reason, count, residual, _, _ = iterate(arrays, state, target, 1.0, work, RTOL, most, CAP, math.inf)
        taken += count
        sound = reason not in (Stop.NOT_FINITE, Stop.SINGULAR)
        estimate = relative_error(model, motion, state) if sound else lost
        settled = abs(estimate.relative - last) <= SETTLED * estimate.relative
        last = estimate.relative
        if correctors or settled or count < most or not sound:
            break
        if taken >= MOST_CORRECTORS:
            # what still wanders is no figure
            estimate = lost
            break
    spent = clock()
    stop = Stop.CONVERGED if sound else Stop(reason)
    return estimate, Step(
        "error estimate", taken, spent, residual, stop, f"{taken} corrector steps of the full model"
    )


def bent(model: ModalModel, motion: Motion) -> tuple[str, float, float]:
    """The leaf bent furthest: name, stroke of its end over its length, largest rotation [rad] against its chord."""
    worst, members = ("", 0.0, 0.0), model.arrays.members
    for i, body in enumerate(model.bodies):
        if body is None:
            continue
        d, Q = member_pose(members, i, motion)
        x, R = body_nodes(body, d, Q, motion.inner[members.inner_at[i] : members.inner_at[i + 1]])
        cosine = np.einsum("i,ki->k", shortest_turn(x[-1])[:, 0], R[:, :, 0]).min()
        stroke = float(np.linalg.norm(x[-1] - body.rest_end) / members.length[i])
        turn = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        if turn >= worst[2]:
            worst = (model.member_names[i], stroke, turn)
    return worst


@dataclass(frozen=True)
class Validity:
    """How far the basis of `leaf` stays within `error`, by way of bending (`WAYS`).

    stroke: displacement of its end over its length; turn: largest rotation against its chord, rad; beyond: ways in which
    the limit lies further than was tried (`FAR`).
    """

    leaf: str
    error: float
    stroke: dict[str, float]
    turn: dict[str, float]
    beyond: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """The range in words: the smallest of all ways."""
        at = min(self.stroke.values()), np.rad2deg(min(self.turn.values()))
        return f"leaf '{self.leaf}' is within {100 * self.error:g} % to a stroke of {at[0]:.2g} L and {at[1]:.2g} degrees"


def _bench(leaf: Any, way: str) -> Mechanism:
    """The leaf alone along x, its end driven in one way."""
    scene = Mechanism(f"leaf {way}")
    tip = scene.link("tip")
    reach = float(np.linalg.norm(np.subtract(leaf.end, leaf.start)))
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(reach, 0, 0), section=leaf.section, material=leaf.material,
        width_axis="z", profile=leaf.profile, curve=leaf.curve, name="leaf",
    )  # fmt: skip
    if way == "turned":
        scene.actuate(tip, about="z", name="way")
        return scene
    scene.actuate(tip, along="y", at=(reach, 0, 0), name="way")
    if way == "guided":
        scene.support(tip, about="z")
    return scene


def _limit(leaf: Any, mesh: Mesh, basis: ModalBasis, way: str, error: float) -> tuple[float, float, bool]:
    """Stroke and rotation at which the indicator passes `error` in one way, and whether it was further than tried."""
    model = with_modal_bodies(compile_given(_bench(leaf, way).scene(), mesh), basis)
    size = FAR[way] * (1.0 if way == "turned" else leaf.length)
    good, start, storage = (0.0, 0.0), (model.targets({"way": 0.0}), model.rest), Storage(model)

    def tried(share: float) -> tuple[Any, tuple[float, float] | None]:
        target = model.targets({"way": share * size})
        begin, state = start
        driven, _, motion, _ = load_steps(
            storage, state, start=begin, target=target, fresh=state is model.rest, planar=False
        )
        if driven.stop is not Stop.CONVERGED:
            return None, None
        estimate, _ = indicator(model, motion, target)
        _, stroke, turn = bent(model, motion)
        return (target, motion), (stroke, turn) if estimate.relative <= error else None

    low, high = 0.0, 1.0
    for k in range(1, STEPS + 1):
        found, reached = tried(k / STEPS)
        if reached is None:
            high = k / STEPS
            break
        low, good, start = k / STEPS, reached, found
    if low == 1.0:
        return *good, True
    for _ in range(HALVINGS):
        found, reached = tried(0.5 * (low + high))
        if reached is None:
            high = 0.5 * (low + high)
        else:
            low, good, start = 0.5 * (low + high), reached, found
    return *good, False


@lru_cache(maxsize=32)
def _range(leaf: Any, mesh: Mesh, basis: ModalBasis, error: float) -> tuple[tuple[float, float, bool], ...]:
    return tuple(_limit(leaf, mesh, basis, way, error) for way in WAYS)


def validity(model: Model, *, leaf: str | None = None, error: float = 0.01) -> Validity | SolidRange:
    """The range of the basis of one leaf, or solid, (the first when None), expanded at rest, within a relative `error`.

    Raises SceneError for an unknown leaf, and for bases expanded at a trained state: their range is about that state.
    """
    if hasattr(model, "solids"):
        return solid_validity(model, solid=leaf, error=error)  # type: ignore[arg-type]
    if not isinstance(model, ModalModel):
        raise SceneError("a validity range belongs to modal bodies; solve with method='modal'")
    bases = {n: b.choices for n, b in zip(model.member_names, model.bodies, strict=True) if b is not None}
    name = leaf or next((n for n, b in bases.items() if b.expansion == "rest"), next(iter(bases)))
    if name not in bases:
        raise SceneError(f"there is no modal leaf '{name}'; the modal leafs are: {', '.join(bases)}")
    basis, leafs = bases[name], scene_leafs(model.full)
    if basis.expansion != "rest":
        raise SceneError(
            "the basis is expanded at a trained state: it is good about that state, see the error estimate"
        )
    mesh = replace(model.full.mesh, leaf="corotational", elements=basis.elements)
    try:
        ranges = _range(leafs[name], mesh, basis, error)
    except TypeError:
        # a profile or curve of the user's own that cannot be remembered
        ranges = _range.__wrapped__(leafs[name], mesh, basis, error)
    found = dict(zip(WAYS, ranges, strict=True))
    return Validity(
        name, error, {w: f[0] for w, f in found.items()}, {w: f[1] for w, f in found.items()},
        tuple(w for w, f in found.items() if f[2]),
    )  # fmt: skip


@dataclass(frozen=True)
class Carried:
    """The reduced body bent furthest in a state, and how far its basis is good.

    name: of the leaf or solid; coordinates: independent ones of its basis, condition: of their columns; stroke: displacement
    of its end over its length, turn [rad]: largest rotation against its chord (of a solid: of face B); error, most_stroke,
    most_turn: it stays within this relative error up to these, nan for a basis expanded about a trained state.
    """

    name: str
    coordinates: int
    condition: float
    stroke: float
    turn: float
    error: float
    most_stroke: float
    most_turn: float


def carried(model: Any, motion: Any) -> Carried | None:
    """What an answer of reduced bodies says of its bases; None where there are none."""
    found: Validity | SolidRange | None
    if hasattr(model, "solids"):
        name, stroke, turn = bent_solid(model, motion)
        body, found = model.solids[name], validity(model, leaf=name)
        size, condition = body.unknowns, body.condition
    elif isinstance(model, ModalModel):
        name, stroke, turn = bent(model, motion)
        basis = model.bodies[model.member_names.index(name)]
        assert basis is not None
        size, condition = basis.rank, basis.condition
        found = validity(model, leaf=name) if basis.choices.expansion == "rest" else None
    else:
        return None
    if found is None:
        return Carried(name, size, condition, stroke, turn, math.nan, math.nan, math.nan)
    limits = min(found.stroke.values()), min(found.turn.values())
    return Carried(name, size, condition, stroke, turn, found.error, *limits)


__all__ = ["WAYS", "Carried", "Validity", "carried", "validity"]

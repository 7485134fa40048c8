"""Range of a basis: stroke and rotation up to which one modal leaf or reduced solid is accurate, found by driving it alone.

Three ways of bending bound what a leaf meets in a mechanism: its tip driven across with the rotation free, the same with the
rotation held (a guide), and a rotation. Each is driven further until the error indicator exceeds the given error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ksd.answers.centrelines import scene_leaves
from ksd.errors import SceneError
from ksd.modal.leaf_bodies import with_modal_bodies
from ksd.modal.solid_basis import SolidBasis, with_solids
from ksd.model.arrays import State
from ksd.model.compile import Model, compile_as_is
from ksd.model.constant_leaves import is_constant
from ksd.model.reduced_bodies import inner_state, relative_end_pose
from ksd.scene.mechanism import Mechanism
from ksd.solvers.branch_check import follow_load_path
from ksd.solvers.full_bodies import error_indicator
from ksd.solvers.load_steps import LoadPath
from ksd.solvers.steps import Stop
from ksd.solvers.storage import NewtonStorage

BENDING_MODES = ("across", "guided", "turned")
"""Ways to drive the tip: across with free rotation, across with held rotation, and rotated."""
MAX_TRIED = {"across": 0.6, "guided": 0.6, "turned": np.deg2rad(75.0)}
"""Largest drive value that is tried: strokes over the length, and a rotation [rad]."""
DRIVE_STEPS, BISECTIONS = 8, 4
"""Equal steps to that value, and bisections of the step in which the error is exceeded."""


@dataclass(frozen=True)
class Validity:
    """Range in which the basis of a modal leaf or reduced solid stays within a relative `error`, by bending mode.

    leaf: its name; word: "leaf" or "solid"; stroke: displacement of its end over its length; turn: largest rotation [rad]
    against its chord (of a solid: of face B); beyond: bending modes whose limit lies beyond what was tried (`MAX_TRIED`).
    """

    leaf: str
    error: float
    stroke: dict[str, float]
    turn: dict[str, float]
    beyond: tuple[str, ...]
    word: str = "leaf"

    def __str__(self) -> str:
        return self.sentence

    @property
    def sentence(self) -> str:
        """The range in one sentence: the smallest of all bending modes."""
        stroke, degrees = min(self.stroke.values()), np.rad2deg(min(self.turn.values()))
        return (
            f"{self.word} '{self.leaf}' is within {100 * self.error:g} % to a stroke of {stroke:.2g} L and "
            f"{degrees:.2g} degrees"
        )


def _single_leaf(leaf: Any, mode: str, *, is_2d: bool) -> Mechanism:
    """The leaf alone along x, its tip driven in one bending mode; is_2d: supports hold the tip out of the plane."""
    scene = Mechanism(f"leaf {mode}")
    tip = scene.link("tip")
    length = float(np.linalg.norm(np.subtract(leaf.end, leaf.start)))
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(length, 0, 0), section=leaf.section, material=leaf.material,
        width_axis="z", profile=leaf.profile, curve=leaf.curve, name="leaf",
    )  # fmt: skip
    if is_2d:
        scene.support(tip, along="z", at=(length, 0, 0))
        scene.support(tip, about="x")
        scene.support(tip, about="y")
    if mode == "turned":
        scene.actuate(tip, about="z", name="tip")
        return scene
    scene.actuate(tip, along="y", at=(length, 0, 0), name="tip")
    if mode == "guided":
        scene.support(tip, about="z")
    return scene


class _Limit(NamedTuple):
    """Stroke and turn at the limit of one bending mode, and whether the limit lies beyond what was tried."""

    stroke: float
    turn: float
    is_beyond: bool


def _limit(model: Model, name: str, mode: str, error: float) -> _Limit:
    """Drive one leaf in one bending mode until the error indicator exceeds `error`."""
    leaf, body = scene_leaves(model)[name], model.bodies[name]
    if isinstance(body, SolidBasis):
        scene = _single_leaf(leaf, mode, is_2d=body.solid.is_2d).scene()
        model = with_solids(compile_as_is(scene, model.mesh), {"leaf": body})
    else:
        mesh = replace(model.mesh, leaf="corotational", elements=body.choices.elements)
        scene = _single_leaf(leaf, mode, is_2d=False).scene()
        model = with_modal_bodies(compile_as_is(scene, mesh), body.choices)
    largest = MAX_TRIED[mode] * (1.0 if mode == "turned" else leaf.length)
    valid, start, storage = (0.0, 0.0), (model.targets({"tip": 0.0}), model.rest), NewtonStorage(model)

    def drive(share: float) -> tuple[Any, tuple[float, float] | None]:
        """Drive to a share of the largest value: (start of the next step, stroke and turn); the latter None where the error
        is exceeded or nothing converges."""
        target = model.targets({"tip": share * largest})
        begin, state = start
        driven, _, motion, _ = follow_load_path(
            storage, state, LoadPath(begin, target), from_rest=state is model.rest, planar=False
        )
        if driven.stop is not Stop.CONVERGED:
            return None, None
        estimate, _ = error_indicator(model, motion, target)
        _, stroke, turn = most_bent_body(model, motion)
        return (target, motion), (stroke, turn) if estimate.relative <= error else None

    low, high = 0.0, 1.0
    for k in range(1, DRIVE_STEPS + 1):
        end, reached = drive(k / DRIVE_STEPS)
        if reached is None:
            high = k / DRIVE_STEPS
            break
        low, valid, start = k / DRIVE_STEPS, reached, end
    if low == 1.0:
        return _Limit(*valid, is_beyond=True)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        end, reached = drive(middle)
        if reached is None:
            high = middle
        else:
            low, valid, start = middle, reached, end
    return _Limit(*valid, is_beyond=False)


def validity(model: Model, *, leaf: str | None = None, error: float = 0.01) -> Validity:
    """Range in which the basis of one leaf or solid (the first when None), expanded at rest, is within a relative `error`.

    Raises SceneError for an unknown leaf, and for bases expanded at a trained state, whose range is around that state.
    """
    bodies = model.bodies
    if not bodies or is_constant(model):
        raise SceneError("a validity range belongs to modal bodies; solve with method='modal'")
    name = leaf or next((n for n, body in bodies.items() if not body.trained), next(iter(bodies)))
    if name not in bodies:
        kind = "solid" if model.solids else "modal leaf"
        raise SceneError(f"there is no {kind} '{name}'; the {kind}s are: {', '.join(bodies)}")
    if bodies[name].trained:
        raise SceneError(
            "the basis is expanded at a trained state: it is good about that state, see the error estimate"
        )
    key = "validity", name, error
    if key not in model.derived:
        # the face of a guided solid does not turn, so that mode is no limit of its turn
        modes = [mode for mode in BENDING_MODES if mode != "guided" or name not in model.solids]
        limits = {mode: _limit(model, name, mode, error) for mode in modes}
        stroke = {mode: limit.stroke for mode, limit in limits.items()}
        turn = {mode: limit.turn for mode, limit in limits.items()}
        beyond = tuple(mode for mode, limit in limits.items() if limit.is_beyond)
        model.derived[key] = Validity(name, error, stroke, turn, beyond, bodies[name].word)
    return model.derived[key]


@dataclass(frozen=True)
class BasisUse:
    """The reduced body that is bent furthest in a state, and the range of its basis.

    name: of the leaf or solid; coordinates: number of independent coordinates of its basis; condition: condition number of
    their columns; stroke: displacement of its end over its length; turn [rad]: largest rotation against its chord (of a
    solid: of face B); error: relative error of the basis up to most_stroke and most_turn, nan for a basis expanded about a
    trained state.
    """

    name: str
    coordinates: int
    condition: float
    stroke: float
    turn: float
    error: float
    most_stroke: float
    most_turn: float


def basis_use(model: Model, motion: State) -> BasisUse | None:
    """The reduced body bent furthest and the range of its basis; None without reduced bodies."""
    if not model.bodies or is_constant(model):
        return None
    name, stroke, turn = most_bent_body(model, motion)
    body = model.bodies[name]
    coordinates, condition = body.unknowns, body.condition
    if body.trained:
        return BasisUse(name, coordinates, condition, stroke, turn, math.nan, math.nan, math.nan)
    limit = validity(model, leaf=name)
    most_stroke, most_turn = min(limit.stroke.values()), min(limit.turn.values())
    return BasisUse(name, coordinates, condition, stroke, turn, limit.error, most_stroke, most_turn)


def most_bent_body(model: Model, motion: State) -> tuple[str, float, float]:
    """The reduced body that is bent furthest: name, displacement of its end over its length, and largest rotation [rad]
    against its chord (of a solid: of face B)."""
    worst = ("", 0.0, -1.0)
    for name, body in model.bodies.items():
        i, members = model.member_names.index(name), model.arrays.members
        stroke, turn = body.stroke_and_rotation(
            *relative_end_pose(members, i, motion), inner_state(members, i, motion)
        )
        if turn >= worst[2]:
            worst = (name, stroke, turn)
    return worst

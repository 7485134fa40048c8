"""How far a basis is good: stroke and rotation of one modal leaf or reduced solid, found by driving it alone.

Three ways of bending bound what a leaf meets in a mechanism: a tip driven across with its rotation free, the same with
the rotation held (a guide), and a rotation. Each is driven further until the error indicator passes the wanted error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ksd.errors import SceneError
from ksd.modal.leaf_bodies import with_modal_bodies
from ksd.modal.solid_basis import SolidBasis, with_solids
from ksd.model.arrays import State
from ksd.model.compile import Model, compile_as_is
from ksd.model.constant_leaves import is_constant
from ksd.model.reduced_bodies import inner_state, relative_end_pose
from ksd.properties.shape import scene_leaves
from ksd.scene.mechanism import Mechanism
from ksd.solve.full_bodies import error_indicator
from ksd.solve.load_steps import LoadPath, follow_load_path
from ksd.solve.steps import Stop
from ksd.solve.storage import NewtonStorage

BENDING_MODES = ("across", "guided", "turned")
"""Tip driven across, across without turning, and turned."""
MAX_TRIED = {"across": 0.6, "guided": 0.6, "turned": np.deg2rad(75.0)}
"""As far as is tried: strokes over the length, and a rotation [rad]."""
STEPS, HALVINGS = 8, 4


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
        """The range in words: the smallest of all ways."""
        at = min(self.stroke.values()), np.rad2deg(min(self.turn.values()))
        said = f"to a stroke of {at[0]:.2g} L and {at[1]:.2g} degrees"
        return f"{self.word} '{self.leaf}' is within {100 * self.error:g} % {said}"


def _alone(leaf: Any, way: str, *, flat: bool) -> Mechanism:
    """The leaf alone along x, its end driven in one way; flat: held out of the plane."""
    scene = Mechanism(f"leaf {way}")
    tip = scene.link("tip")
    reach = float(np.linalg.norm(np.subtract(leaf.end, leaf.start)))
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(reach, 0, 0), section=leaf.section, material=leaf.material,
        width_axis="z", profile=leaf.profile, curve=leaf.curve, name="leaf",
    )  # fmt: skip
    if flat:
        scene.support(tip, along="z", at=(reach, 0, 0))
        scene.support(tip, about="x")
        scene.support(tip, about="y")
    if way == "turned":
        scene.actuate(tip, about="z", name="way")
        return scene
    scene.actuate(tip, along="y", at=(reach, 0, 0), name="way")
    if way == "guided":
        scene.support(tip, about="z")
    return scene


def _limit(model: Model, name: str, way: str, error: float) -> tuple[float, float, bool]:
    """Stroke and rotation at which the indicator passes `error` in one way, and whether it was further than tried."""
    leaf, body = scene_leaves(model)[name], model.bodies[name]
    if isinstance(body, SolidBasis):
        scene = _alone(leaf, way, flat=body.solid.is_2d).scene()
        model = with_solids(compile_as_is(scene, model.mesh), {"leaf": body})
    else:
        mesh = replace(model.mesh, leaf="corotational", elements=body.choices.elements)
        model = with_modal_bodies(compile_as_is(_alone(leaf, way, flat=False).scene(), mesh), body.choices)
    size = MAX_TRIED[way] * (1.0 if way == "turned" else leaf.length)
    good, start, storage = (0.0, 0.0), (model.targets({"way": 0.0}), model.rest), NewtonStorage(model)

    def tried(share: float) -> tuple[Any, tuple[float, float] | None]:
        target = model.targets({"way": share * size})
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


def validity(model: Model, *, leaf: str | None = None, error: float = 0.01) -> Validity:
    """The range of the basis of one leaf, or solid, (the first when None), expanded at rest, within a relative `error`.

    Raises SceneError for an unknown leaf, and for bases expanded at a trained state: their range is about that state.
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
        # the face of a guided solid does not turn
        ways = [way for way in BENDING_MODES if way != "guided" or name not in model.solids]
        found = {way: _limit(model, name, way, error) for way in ways}
        stroke, turn = ({way: f[k] for way, f in found.items()} for k in (0, 1))
        beyond = tuple(way for way in ways if found[way][2])
        model.derived[key] = Validity(name, error, stroke, turn, beyond, bodies[name].word)
    return model.derived[key]


@dataclass(frozen=True)
class BasisUse:
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


def basis_use(model: Model, motion: State) -> BasisUse | None:
    """What an answer of reduced bodies says of its bases; None where there are none."""
    if not model.bodies or is_constant(model):
        return None
    name, stroke, turn = most_bent_body(model, motion)
    body = model.bodies[name]
    size, condition = body.unknowns, body.condition
    if body.trained:
        return BasisUse(name, size, condition, stroke, turn, math.nan, math.nan, math.nan)
    found = validity(model, leaf=name)
    limits = min(found.stroke.values()), min(found.turn.values())
    return BasisUse(name, size, condition, stroke, turn, found.error, *limits)


def most_bent_body(model: Model, motion: State) -> tuple[str, float, float]:
    """The reduced body bent furthest: its name, displacement of its end over its length, and largest rotation [rad] against
    its chord (of a solid: of face B)."""
    worst = ("", 0.0, -1.0)
    for name, body in model.bodies.items():
        i = model.member_names.index(name)
        stroke, turn = body.stroke_and_rotation(
            *relative_end_pose(model.arrays.members, i, motion), inner_state(model, motion, i)
        )
        if turn >= worst[2]:
            worst = (name, stroke, turn)
    return worst

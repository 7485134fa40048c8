"""Compile a scene: links and internal blocks become nodes, leaf springs become members, drives and supports become rows.

Rigid links and connector blocks are neither elements nor constraints: leaf ends hang on their node by an offset.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ksd.checks import MAX_MAGNITUDE, clear_argument_errors, number, show, similar_name_hint
from ksd.errors import SceneError
from ksd.html import NotebookTables, PrintedText
from ksd.model.arrays import LINEAR, MODAL, ROTATION, SOLID, Arrays, State
from ksd.model.description import description_lines
from ksd.model.effects import EffectChoice, apply_effects, choose_effects
from ksd.model.leaves import cut_leaves
from ksd.model.mesh import DEFAULT_MESH, Mesh
from ksd.model.pack import replace_constants
from ksd.model.plane import refuse_plane
from ksd.model.scene_layout import SceneNumbers, SplitScene, split_scene
from ksd.model.template import (
    DesignArrays,
    LeafGeometry,
    Template,
    arrays_of_design,
    state_of_design,
    template_of,
)
from ksd.scene.plausibility import drive_value_warnings
from ksd.scene.scene import MECHANISM_HINT


@dataclass(frozen=True, repr=False)
class Model(NotebookTables):
    """What the computer solves: frozen arrays of one scene with one mesh, and its rest state.

    node_names: "ground", links, then "joint/block"; member_names: "joint/leaf", then free leaf springs. joint_members[j]
    is the slice of members of joint j. drive_names: the first rows; support_names: those after them, held at zero.
    spring_names: of `arrays.springs`. scene: what is simulated, so without the effects left out and with elastic links
    taken apart; said: the scene as it was described. choice: the effects and why, None when the scene was compiled as
    given. bodies: reduced bodies in the place of leaves, by name (`ksd.model.reduced_bodies`); full: the model whose chains
    the modal ones among them reduce, None without.
    """

    scene: Any
    mesh: Mesh
    arrays: Arrays
    rest: State
    node_names: tuple[str, ...]
    member_names: tuple[str, ...]
    joint_members: tuple[slice, ...]
    drive_names: tuple[str, ...]
    support_names: tuple[str, ...]
    spring_names: tuple[str, ...] = field(default=())
    said: Any = field(default=None)
    choice: Any = field(default=None)
    bodies: Mapping[str, Any] = field(default_factory=dict)
    full: Model | None = None

    @cached_property
    def solids(self) -> tuple[str, ...]:
        """Names of the leaf springs that are reduced solids."""
        return tuple(name for name, body in self.bodies.items() if body.kind == SOLID)

    @property
    def leaf_models(self) -> str:
        """What the leaf springs are, in words."""
        if self.full is not None and any(body.kind == LINEAR for body in self.bodies.values()):
            return f"bodies of constant stiffness, that at rest of {self.mesh}"
        modal = {n: b for n, b in self.bodies.items() if b.kind == MODAL}
        if len(modal) == len(self.member_names) and len({str(b) for b in modal.values()}) == 1:
            return f"modal bodies: {next(iter(modal.values()))}"
        words = "; ".join(
            f"{', '.join(n for n in modal if str(modal[n]) == said)}: {said}"
            for said in dict.fromkeys(map(str, modal.values()))
        )
        said = [f"modal bodies ({words})"] * bool(modal)
        said += [f"reduced solids ({', '.join(self.solids)})"] * bool(self.solids)
        return " beside ".join([*said, Mesh.__str__(self.mesh) if said else str(self.mesh)])

    @cached_property
    def derived(self) -> dict[Any, Any]:
        """What was computed from this model and nothing else, by what computed it; lives and dies with the model."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "derived"}

    def __repr__(self) -> str:
        unknowns = self.arrays.plan.unknowns
        return f"<Model of '{self.scene.name}': {len(self.member_names)} members, {unknowns} unknowns, {self.leaf_models}>"

    def __str__(self) -> str:
        """What is simulated and what is left out, with the reason, in a few lines."""
        lines = description_lines(self)
        return PrintedText("\n".join(f"{head}: {said}" for head, said in lines), [lines])

    @property
    def links(self) -> int:
        """Number of links, ground included; they are the first nodes."""
        return len(self.scene.links)

    @cached_property
    def conservative(self) -> bool:
        """Whether no load follows its link or is a moment in space."""
        return not self.arrays.loads.skew.any()

    @cached_property
    def kinds(self) -> frozenset[int]:
        """What there is among its members: STRAIN, COROTATIONAL, ... of `ksd.model.arrays`."""
        return frozenset(self.arrays.members.kind.tolist())

    def far_drives(self, values: Mapping[str, float]) -> tuple[str, ...]:
        """Drive values [m or rad] by name that were probably meant in another unit, a sentence each."""
        return drive_value_warnings(self.scene, values, self.arrays.size)

    def refuse_turns(self, target: np.ndarray) -> None:
        """SceneError for a drive that is to turn by more than the half turn either way that a pose tells."""
        if all(-math.pi <= value <= math.pi for value in target[: len(self.drive_names)].tolist()):
            return
        terms = self.arrays.terms
        for name, value, first, end in zip(
            self.drive_names, target, terms.first, terms.first[1:], strict=False
        ):
            most = np.pi * float(np.abs(terms.coefficient[first:end]).sum())
            if np.all(terms.kind[first:end] == ROTATION) and abs(value) > most:
                raise SceneError(
                    f"drive '{name}' = {np.rad2deg(value):.6g} deg: a prescribed rotation is read from the pose of its "
                    f"links, which tells it within {np.rad2deg(most):.6g} deg either way; turn further by a moment "
                    f"(mechanism.load){''.join(f'; {said}' for said in self.far_drives({name: value}))}"
                )

    def targets(self, values: Mapping[str, float]) -> np.ndarray:
        """Right-hand sides of all rows for drive values by name [m or rad]; SceneError for unknown or missing ones."""
        found = [v for n in self.drive_names if type(v := values.get(n)) is float and abs(v) <= MAX_MAGNITUDE]
        if len(values) == len(found) == len(self.drive_names):
            return np.array(found + [0.0] * len(self.support_names))
        for name in values:
            if name not in self.drive_names:
                known = ", ".join(self.drive_names) or "none"
                hint = similar_name_hint(name, self.drive_names)
                raise SceneError(f"drive '{name}' is not in this mechanism; its drives are: {known}{hint}")
        missing = [n for n in self.drive_names if n not in values]
        if missing:
            raise SceneError(f"drive '{missing[0]}' has no value; give one, for example {missing[0]}=0.0")
        found = [number(values[n], f"drive '{n}'", unit="m or rad") for n in self.drive_names]
        return np.array(found + [0.0] * len(self.support_names))


def reference_points(scene: Any) -> np.ndarray:
    """Reference position (3,) of every link: the mean of what hangs on it; ground at the origin."""
    index = {link: i for i, link in enumerate(scene.links)}
    found: list[list[np.ndarray]] = [[] for _ in scene.links]
    for j in scene.joints:
        found[index[j.a]].append(np.asarray(j.origin))
        found[index[j.b]].append(np.asarray(j.origin) + np.asarray(j.rotation) @ np.asarray(j.joint.pose_B))
    for _, a, b, leaf in cut_leaves(scene):
        found[index[a]].append(np.asarray(leaf.start, float))
        found[index[b]].append(np.asarray(leaf.end, float))
    places = np.array([np.mean(f, axis=0) if f else np.zeros(3) for f in found])
    places[0] = 0.0
    return places


class ModelSource(NamedTuple):
    """What a model was made of: its drawing, the template of its words, its numbers and, D = 1, its arrays."""

    split: SplitScene
    template: Template
    numbers: SceneNumbers
    design_arrays: DesignArrays


def _compile_source(scene: Any, mesh: Mesh) -> ModelSource:
    drawing = split_scene(scene, mesh)
    template = template_of(drawing.layout, mesh)
    numbers = template.numbers([drawing.numbers])
    return ModelSource(drawing, template, numbers, template(numbers))


def model_source(model: Model) -> ModelSource:
    """What the model of this scene and mesh is made of."""
    found: ModelSource | None = model.derived.get("source")
    if found is None:
        found = model.derived["source"] = _compile_source(model.scene, model.mesh)
    return found


def compile_as_is(scene: Any, mesh: Mesh, said: Any = None, choice: EffectChoice | None = None) -> Model:
    """The full model of a frozen scene exactly as it stands, no effect chosen: every leaf a member, every block a node.

    said, choice: see `Model`; the scene itself, and none, where they are None.
    """
    made = _compile_source(scene, mesh)
    model = model_of_design(scene, made.template, made.design_arrays, made.numbers, said=said, choice=choice)
    model.derived["source"] = made
    return model


def model_of_design(
    scene: Any, template: Template, filled: DesignArrays, numbers: SceneNumbers, d: int = 0, *, said: Any = None,
    choice: EffectChoice | None = None,
) -> Model:  # fmt: skip
    """The model of design d of those packed together; scene: its frozen scene; said, choice: as in `compile_given`."""
    layout = template.scene_layout
    model = Model(
        scene, template.mesh, arrays_of_design(filled.arrays, template.topology, d), state_of_design(filled.rest, d),
        template.node_names, template.member_names, template.joint_members, layout.drives, layout.supports,
        template.spring_names, scene if said is None else said, choice,
    )  # fmt: skip
    if choice is not None and choice["spatial"].present:
        refuse_plane(model, f"six unknowns per node are wanted: {choice['spatial'].reason}")
    leaves = LeafGeometry(*(a[d : d + 1] for a in filled.leaves))
    model.derived["leaves"] = template, leaves, numbers.explicit[d : d + 1]
    return model


def remesh_model(model: Model, mesh: Mesh) -> Model:
    """The model of the same scene on another mesh, no effect chosen anew."""
    made, leaves, given = model.derived.get("leaves", (None, None, None))
    template = None if made is None else made.on_mesh(mesh)
    if template is None or model.bodies:
        return compile_as_is(model.scene, mesh)
    # what is drawn is the same, but for the constants of leaf springs
    value, inner = template.packing.values(leaves, given)
    found = Model(
        model.scene, mesh, replace_constants(model.arrays, template.topology, value[0]), model.rest._replace(inner=inner[0]),
        model.node_names, model.member_names, model.joint_members, model.drive_names, model.support_names,
        model.spring_names, model.scene,
    )  # fmt: skip
    found.derived["leaves"] = template, leaves, given
    return found


@clear_argument_errors
def compile_scene(
    scene: Any,
    *,
    mesh: Mesh | None = None,
    effects: str | Iterable[str] = "auto",
    with_: str | Iterable[str] = (),
    without: str | Iterable[str] = (),
) -> Model:
    """The full model of a scene (a Mechanism or its frozen Scene) with the effects it mentions.

    mesh: of the leaf springs, `ksd.Mesh()` when None. effects: "auto", "all" or the names wanted; with_, without: single
    effects put on or off, see `ksd.model.effects`. Raises SceneError where the scene cannot be compiled (see
    `Mechanism.validate`) or an effect is unknown.
    """
    scene = scene.scene() if hasattr(scene, "scene") else scene
    if not hasattr(scene, "fingerprint"):
        raise SceneError(f"{show(scene)} is no mechanism; {MECHANISM_HINT}.")
    mesh = DEFAULT_MESH if mesh is None else mesh
    if not isinstance(mesh, Mesh):
        raise SceneError(
            f"mesh = {show(mesh)}: give a ksd.Mesh, for example ksd.Mesh('corotational', elements=5)."
        )
    return compile_with_effects(
        scene, mesh, choose_effects(scene, mesh, effects=effects, with_=with_, without=without)
    )


def compile_with_effects(scene: Any, mesh: Mesh, choice: EffectChoice) -> Model:
    """The model of a frozen scene with the effects of `choice`."""
    return compile_as_is(*apply_effects(scene, mesh, choice), scene, choice)

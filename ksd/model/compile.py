"""Compile a scene: links and internal blocks become nodes, leaf springs become members, drives and supports become rows.

Rigid links and connector blocks are neither elements nor constraints: leaf ends are attached to their node by an offset.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from ksd.checks import MAX_MAGNITUDE, clear_argument_errors, number, show, similar_name_hint
from ksd.errors import RecordError, SceneError
from ksd.html import NotebookTables, PrintedText
from ksd.model.arrays import (
    COROTATIONAL,
    FIELDS,
    LINEAR,
    MODAL,
    PLANAR,
    ROTATION,
    SOLID,
    STRAIN,
    Arrays,
    State,
)
from ksd.model.chosen_effects import EffectChoice, apply_effects, choose_effects
from ksd.model.description import constraint_lines, curved_bar_text, effect_lines, shape_text
from ksd.model.leaves import cut_leaves
from ksd.model.mesh import DEFAULT_MESH, Mesh
from ksd.model.pack import replace_constants
from ksd.model.plane import Plane, find_plane
from ksd.model.scene_layout import SceneNumbers, SplitScene, split_scene
from ksd.model.template import (
    DesignArrays,
    LeafGeometry,
    Template,
    state_of_design,
    template_of,
)
from ksd.scene.obstacle import has_contacts, refuse_contacts, without_contacts
from ksd.scene.plausibility import drive_value_warnings
from ksd.scene.scene import MECHANISM_HINT
from ksd.version import __version__

OTHER_VERSION = (
    "this pose or model was pickled by another version of ksd, whose numbers mean something else here; solve it again "
    "from its scene (scene files and tables are read by every version)"
)
"""Why a pickle is refused."""


def _layout() -> str:
    """What must be the same where a model is pickled and where it is read."""
    return " ".join([__version__, *FIELDS, *State._fields])


def _new_model(layout: str) -> Model:
    """A model whose fields are read from a pickle with this layout. Raises RecordError for another one."""
    if layout != _layout():
        raise RecordError(OTHER_VERSION)
    return object.__new__(Model)


@dataclass(frozen=True, repr=False)
class Model(NotebookTables):
    """What is solved: the frozen arrays of one scene with one mesh, and its undeformed state `rest`.

    node_names: "ground", links, then "joint/block"; member_names: "joint/leaf", then free leaf springs. joint_members[j] is
    the slice of members of joint j. drive_names: the first rows; support_names: those after them, held at zero.
    spring_names: of `arrays.springs`. scene: what is simulated, without the effects left out and with elastic links split
    into parts; original_scene: the scene as the user described it. choice: the effects and their reasons, None when the
    scene was compiled as it is. bodies: reduced bodies in the place of leaf springs, by name (`ksd.model.reduced_bodies`);
    full: the model that they reduce, None without.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> model = ksd.compile_scene(guide)
    >>> model.node_names, model.member_names, model.drive_names
    (('ground', 'table'), ('left', 'right'), ('table',))
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
    original_scene: Any = field(default=None)
    choice: Any = field(default=None)
    bodies: Mapping[str, Any] = field(default_factory=dict)
    full: Model | None = None

    @cached_property
    def solids(self) -> tuple[str, ...]:
        """Names of the leaf springs that are reduced solids."""
        return tuple(name for name, body in self.bodies.items() if body.kind == SOLID)

    @property
    def listed_names(self) -> tuple[str, ...]:
        """The node names without points made for moments and contacts along leaf springs."""
        unlisted = self.scene.unlisted
        return tuple(name for name in self.node_names if name not in unlisted)

    @property
    def leaf_models(self) -> str:
        """Text on the models of the leaf springs."""
        if self.full is not None and any(body.kind == LINEAR for body in self.bodies.values()):
            return f"bodies of constant stiffness, that at rest of {self.mesh}"
        modal = {n: b for n, b in self.bodies.items() if b.kind == MODAL}
        if len(modal) == len(self.member_names) and len({str(b) for b in modal.values()}) == 1:
            return f"modal bodies: {next(iter(modal.values()))}"
        modal_text = "; ".join(
            f"{', '.join(n for n in modal if str(modal[n]) == basis)}: {basis}"
            for basis in dict.fromkeys(map(str, modal.values()))
        )
        texts = [f"modal bodies ({modal_text})"] * bool(modal)
        texts += [f"reduced solids ({', '.join(self.solids)})"] * bool(self.solids)
        return " beside ".join([*texts, Mesh.__str__(self.mesh) if texts else str(self.mesh)])

    @cached_property
    def derived(self) -> dict[Any, Any]:
        """Cache of results that depend on this model only, by the name of the result; it is not pickled."""
        return {}

    def __new__(cls, *args: Any, **fields: Any) -> Self:
        if not (args or fields):
            # a pickle of the first release makes an object before it reads what is in it
            raise RecordError(OTHER_VERSION)
        return super().__new__(cls)

    def __reduce__(self) -> Any:
        return _new_model, (_layout(),), {n: value for n, value in vars(self).items() if n != "derived"}

    def __repr__(self) -> str:
        unknowns = self.arrays.plan.unknowns
        return f"<Model of '{self.scene.name}': {len(self.member_names)} members, {unknowns} unknowns, {self.leaf_models}>"

    def __str__(self) -> str:
        """What is simulated, and what is left out for which reason, in a few lines."""
        lines = self._description()
        return PrintedText("\n".join(f"{heading}: {text}" for heading, text in lines), [lines])

    def _description(self) -> list[tuple[str, str]]:
        """(heading, text) of every line: sizes, effects that are present or left out with the reason, what is made on
        demand."""
        scene, arrays, choice = self.scene, self.arrays, self.choice
        rows = len(self.drive_names) + len(self.support_names)
        # points on a leaf divide it into pieces
        more, loads = (
            len(scene.unlisted),
            len(arrays.loads.node) - len(scene.loads) + len(scene.loads_on_links),
        )
        present, absent = effect_lines(choice, self.mesh, self.original_scene)
        elastic = "other " if any(heading == "with compliance" for heading, _ in present) else ""
        lines = [
            (
                scene.name,
                f"{len(scene.links) - 1 - more} links, {len(scene.joints)} joints, {len(self.member_names) - more} leaf "
                "springs as "
                f"{self.leaf_models}",
            ),
            (
                "unknowns",
                f"{arrays.plan.unknowns - rows} at nodes, {rows} multiplier{'s' * (rows != 1)}, "
                f"{arrays.members.inner_at[-1]} condensed inside the leaf springs",
            ),
            (
                "simulated",
                f"bending, torsion and stretch of the leaf springs{shape_text(scene)}; {elastic}links and blocks are rigid "
                "and eliminated",
            ),
        ]
        if loads:
            weights = ", gravity among them" if scene.gravity else ""
            lines.append(("loads", f"{loads} on links{weights}"))
        lines += [*constraint_lines(scene), *present]
        if scene.loads_along:
            own = (("line load", scene.line_loads), ("pressure", scene.pressures))
            text = " and ".join(f"{len(x)} {n}{'s' * (len(x) > 1)}" for n, x in own if x)
            lines.append(("loads along leaf springs", text))
        if scene.gravity is not None and arrays.weight[:, 0].any():
            mass, pull = arrays.weight[:, 0].sum(), np.linalg.norm(arrays.weight[0, 1:4])
            lines.append(("weight of the leaf springs", f"{mass:.3g} kg along them, {mass * pull:.3g} N"))
        if isinstance(self.plane, str):
            lines.append(("with spatial", f"six unknowns per node, since {self.plane}"))
        else:
            lines.append(
                (
                    "without spatial",
                    "it lies in a plane: three unknowns per node, the answer checked in space",
                )
            )
        lines += absent
        curved = curved_bar_text(scene)
        if curved:
            lines.append(("not modelled", curved))
        lines.append(
            ("computed on request", "mass (frequencies, state space), spatial stiffness, stress, buckling")
        )
        return lines

    @property
    def plane(self) -> Plane | str:
        """The plane of the model, or the reason why it is not planar or is to be solved in space (`ksd.model.plane`)."""
        plane: Plane | str | None = self.derived.get("plane")
        if plane is None:
            plane = self.derived["plane"] = self._find_plane()
        return plane

    def _find_plane(self) -> Plane | str:
        if self.choice is not None and self.choice["spatial"].present:
            return f"six unknowns per node are wanted: {self.choice['spatial'].reason}"
        return find_plane(
            self.arrays, self.rest, self.scene, members=self.member_names, springs=self.spring_names,
            drives=self.drive_names, supports=self.support_names,
        )  # fmt: skip

    def refuse_plane(self, reason: str) -> None:
        """Take the model as not planar for this reason, because its out-of-plane forces do not balance."""
        self.derived["plane"] = reason

    @property
    def unknown_count(self) -> int:
        """Number of unknowns, those condensed inside its leaves included; of its planar model where it has one."""
        arrays = self.arrays if isinstance(self.plane, str) else self.plane.arrays
        members, inner = arrays.members, np.diff(arrays.members.inner_at)
        # a leaf of a planar model has its amplitudes of weak bending and three components of its wrench
        inner[members.kind == PLANAR] = members.number[members.kind == PLANAR, 0] + 3
        return int(arrays.plan.unknowns + inner.sum())

    @property
    def links(self) -> int:
        """Number of links, ground included; they are the first nodes."""
        return len(self.scene.links)

    @cached_property
    def conservative(self) -> bool:
        """Whether all loads have a potential: no follower load, no pressure, and no moment in space."""
        return self.arrays.conservative

    @cached_property
    def kinds(self) -> frozenset[int]:
        """The kinds of its members: STRAIN, COROTATIONAL, ... of `ksd.model.arrays`."""
        return frozenset(self.arrays.members.kind.tolist())

    @cached_property
    def strain_leaves(self) -> tuple[int, ...]:
        """Numbers of the members that are strain-mode leaf springs."""
        return tuple(np.flatnonzero(self.arrays.members.kind == STRAIN).tolist())

    @cached_property
    def chains(self) -> tuple[int, ...]:
        """Numbers of the members that are chains of Appendix A elements."""
        return tuple(np.flatnonzero(self.arrays.members.kind == COROTATIONAL).tolist())

    @cached_property
    def has_closed_bodies(self) -> bool:
        """Whether a member is a reduced solid or a condensed joint, into which no question looks."""
        return not self.kinds.isdisjoint((SOLID, LINEAR))

    @property
    def has_strain_leaves_only(self) -> bool:
        """Whether every member is a strain-mode leaf spring."""
        return len(self.strain_leaves) == len(self.member_names)

    def far_drives(self, values: Mapping[str, float]) -> tuple[str, ...]:
        """One sentence per drive value [m or rad] that was probably meant in another unit."""
        return drive_value_warnings(self.scene, values, self.arrays.size)

    def turn_to_guess(self, target: np.ndarray, begin: np.ndarray | None = None) -> str:
        """Why one solve from the drive values `begin` (c,), zero when None, to `target` (c,) would have to guess how a
        rotation drive turns; empty where each turns by half a turn at most."""
        change = target if begin is None else target - begin
        if all(-math.pi <= value <= math.pi for value in change[: len(self.drive_names)].tolist()):
            return ""
        terms = self.arrays.terms
        for i, name in enumerate(self.drive_names):
            own = slice(terms.first[i], terms.first[i + 1])
            limit = np.pi * float(np.abs(terms.coefficient[own]).sum())
            if np.all(terms.kind[own] == ROTATION) and abs(change[i]) > limit * (1.0 + 1e-12):
                value, most = np.rad2deg(target[i]), np.rad2deg(limit)
                away = "at rest" if begin is None else f"at {np.rad2deg(begin[i]):.6g} deg"
                return (
                    f"drive '{name}' = {value:.6g} deg: a single solve that starts {away} would have to guess how it turns "
                    f"there; follow the turn, by ksd.sweep through values at most {most:.6g} deg apart, by ksd.follow with "
                    "control='drives', or by ksd.solve with start= a pose on the way"
                    + "".join(f"; {warning}" for warning in self.far_drives({name: float(target[i])}))
                )
        return ""

    def refuse_turns(self, target: np.ndarray, begin: np.ndarray | None = None) -> None:
        """Raise SceneError with the sentence of `turn_to_guess`."""
        if reason := self.turn_to_guess(target, begin):
            raise SceneError(reason)

    def targets(self, values: Mapping[str, float]) -> np.ndarray:
        """Right-hand sides (c,) of all constraint rows for drive values by name [m or rad].

        Raises SceneError for an unknown drive or a missing value.
        """
        given = [v for n in self.drive_names if type(v := values.get(n)) is float and abs(v) <= MAX_MAGNITUDE]
        if len(values) == len(given) == len(self.drive_names):
            return np.array(given + [0.0] * len(self.support_names))
        for name in values:
            if name not in self.drive_names:
                known = ", ".join(self.drive_names) or "none"
                hint = similar_name_hint(name, self.drive_names)
                raise SceneError(f"drive '{name}' is not in this mechanism; its drives are: {known}{hint}")
        missing = [n for n in self.drive_names if n not in values]
        if missing:
            raise SceneError(f"drive '{missing[0]}' has no value; give one, for example {missing[0]}=0.0")
        given = [number(values[n], f"drive '{n}'", unit="m or rad") for n in self.drive_names]
        return np.array(given + [0.0] * len(self.support_names))


def reference_points(scene: Any) -> np.ndarray:
    """Reference position (3,) [m] of every link: the mean of its attachments; that of ground is the origin."""
    index = {link: i for i, link in enumerate(scene.links)}
    attached: list[list[np.ndarray]] = [[] for _ in scene.links]
    for j in scene.joints:
        attached[index[j.a]].append(np.asarray(j.origin))
        attached[index[j.b]].append(
            np.asarray(j.origin) + np.asarray(j.rotation) @ np.asarray(j.joint.pose_B)
        )
    for _, a, b, leaf in cut_leaves(scene):
        attached[index[a]].append(np.asarray(leaf.start, float))
        attached[index[b]].append(np.asarray(leaf.end, float))
    positions = np.array([np.mean(points, axis=0) if points else np.zeros(3) for points in attached])
    positions[0] = 0.0
    return positions


class ModelSource(NamedTuple):
    """What a model was made of: the split scene, the template of its layout, its numbers and its arrays with D = 1."""

    split: SplitScene
    template: Template
    numbers: SceneNumbers
    design_arrays: DesignArrays


def _compile_source(scene: Any, mesh: Mesh) -> ModelSource:
    split = split_scene(scene, mesh)
    template = template_of(split.layout, mesh)
    numbers = template.numbers([split.numbers])
    return ModelSource(split, template, numbers, template(numbers))


def model_source(model: Model) -> ModelSource:
    """What the model was made of, cached with the model."""
    source: ModelSource | None = model.derived.get("source")
    if source is None:
        source = model.derived["source"] = _compile_source(model.scene, model.mesh)
    return source


def compile_as_is(
    scene: Any, mesh: Mesh, original_scene: Any = None, choice: EffectChoice | None = None
) -> Model:
    """The full model of a frozen scene with all its effects: every leaf spring is a member, every block a node.

    original_scene, choice: see `Model`; original_scene is the scene itself where it is None.
    """
    source = _compile_source(scene, mesh)
    model = model_of_design(
        scene,
        source.template,
        source.design_arrays,
        source.numbers,
        original_scene=original_scene,
        choice=choice,
    )
    model.derived["source"] = source
    return model


def model_of_design(
    scene: Any, template: Template, packed: DesignArrays, numbers: SceneNumbers, d: int = 0, *, original_scene: Any = None,
    choice: EffectChoice | None = None,
) -> Model:  # fmt: skip
    """The model of design d of designs packed together; scene: its frozen scene; the rest: as in `compile_as_is`."""
    layout = template.scene_layout
    model = Model(
        scene, template.mesh, packed.arrays.design(d), state_of_design(packed.rest, d),
        template.node_names, template.member_names, template.joint_members, layout.drives, layout.supports,
        template.spring_names, scene if original_scene is None else original_scene, choice,
    )  # fmt: skip
    leaves = LeafGeometry(*(a[d : d + 1] for a in packed.leaves))
    model.derived["leaves"] = template, leaves, numbers.explicit[d : d + 1]
    return model


def remesh_model(model: Model, mesh: Mesh) -> Model:
    """The model of the same scene and effects on another mesh."""
    old, leaves, explicit = model.derived.get("leaves", (None, None, None))
    template = None if old is None else old.on_mesh(mesh)
    if template is None or model.bodies:
        return compile_as_is(model.scene, mesh)
    # only the constants and inner states of leaf springs differ
    value, inner = template.packing.values(leaves, explicit)
    remeshed = Model(
        model.scene, mesh, replace_constants(model.arrays, template.topology, value[0]), model.rest._replace(inner=inner[0]),
        model.node_names, model.member_names, model.joint_members, model.drive_names, model.support_names,
        model.spring_names, model.scene,
    )  # fmt: skip
    remeshed.derived["leaves"] = template, leaves, explicit
    return remeshed


@clear_argument_errors
def compile_scene(
    scene: Any,
    *,
    mesh: Mesh | None = None,
    effects: str | Iterable[str] = "auto",
    with_: str | Iterable[str] = (),
    without: str | Iterable[str] = (),
    one_sided: bool = False,
) -> Model:
    """The full model of a scene (a Mechanism or its frozen Scene) with the effects it mentions.

    mesh: of the leaf springs, `ksd.Mesh()` when None. effects: "auto", "all" or the names wanted; with_, without: single
    effects switched on or off, see `ksd.model.chosen_effects`. one_sided: take a scene with stops or cables, which the
    model does not have (`ksd.solvers.touching`), where they are refused else. Raises SceneError where the scene cannot be
    compiled (see `Mechanism.validate`) or an effect is unknown.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> model = ksd.compile_scene(guide, mesh=ksd.Mesh("corotational", elements=2))
    >>> model.member_names, len(model.node_names)
    (('left', 'right'), 2)
    """
    scene = scene.scene() if hasattr(scene, "scene") else scene
    if not hasattr(scene, "fingerprint"):
        raise SceneError(f"{show(scene)} is no mechanism; {MECHANISM_HINT}.")
    mesh = DEFAULT_MESH if mesh is None else mesh
    if not isinstance(mesh, Mesh):
        raise SceneError(
            f"mesh = {show(mesh)}: give a ksd.Mesh, for example ksd.Mesh('corotational', elements=5)."
        )
    if has_contacts(scene) and one_sided:
        bare = without_contacts(scene)
        model = compile_scene(bare, mesh=mesh, effects=effects, with_=with_, without=without)
        return replace(model, original_scene=scene)
    refuse_contacts(scene)
    return compile_with_effects(
        scene, mesh, choose_effects(scene, mesh, effects=effects, with_=with_, without=without)
    )


def compile_with_effects(scene: Any, mesh: Mesh, choice: EffectChoice) -> Model:
    """The model of a frozen scene with the effects of `choice`."""
    return compile_as_is(*apply_effects(scene, mesh, choice), scene, choice)

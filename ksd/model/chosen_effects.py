"""Which effects a model has: those that the scene mentions, or those that the user names.

What the scene mentions is simulated: gravity, springs, elastic links, heat, assembly errors, follower loads. Shear is always
simulated, as it costs nothing. Drive values, accuracy and estimates have no influence, so a scene has one model for all
drive values.

Restrained warping and plate stiffening change the standard beam, for which published stiffnesses and closed forms hold, by
up to 80 % in torsion and 10 % in bending; answers could not be compared with the literature if they were on by default. They
are simulated where the scene (`Mechanism.consider`), the mesh, `with_` or `effects="all"` mention them; an answer gives the
error of leaving them out in its state (`Configuration.left_out`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from ksd.checks import name_hint, show
from ksd.errors import SceneError
from ksd.model.elastic_links import with_elastic_links
from ksd.model.line_moments import with_moment_points
from ksd.model.mesh import Mesh
from ksd.model.plate_runs import has_width, plate_conditions
from ksd.model.scene_layout import has_gravity
from ksd.model.warping_runs import run_twists
from ksd.scene.effects import leaf_conditions
from ksd.scene.hinges import plane_supports
from ksd.scene.leaf import LeafCondition
from ksd.scene.line_load import load_edges
from ksd.scene.listing import vector_text
from ksd.scene.scene import LeafPoint

EFFECT_MEANINGS = {
    "spatial": "six unknowns per node",
    "shear": "Timoshenko shear of the leaf springs",
    "warping": "warping restrained at clamped ends",
    "plate": "plate stiffening of wide leaf springs",
    "gravity": "gravity on links, payloads and along the leaf springs",
    "following": "follower loads",
    "compliance": "compliance of links",
    "springs": "springs",
    "heat": "thermal strain",
    "fit": "prestress and assembly error of leaf springs",
}
"""All effects that can be switched, with a description."""
INTRINSIC_EFFECTS = ("spatial", "shear", "warping", "plate")
"""Effects of the leaf springs themselves, which can be switched on although the scene does not mention them."""


@dataclass(frozen=True)
class Effect:
    """One effect: whether it is simulated (`present`), and the reason."""

    name: str
    present: bool
    reason: str

    def __str__(self) -> str:
        return f"{self.name}: {self.reason}"


@dataclass(frozen=True)
class EffectChoice:
    """The effects of one model, in the order of `EFFECT_MEANINGS`."""

    effects: tuple[Effect, ...]

    @property
    def present(self) -> tuple[str, ...]:
        """Names of the effects simulated."""
        return tuple(e.name for e in self.effects if e.present)

    @property
    def absent(self) -> tuple[str, ...]:
        """Names of the effects left out."""
        return tuple(e.name for e in self.effects if not e.present)

    def __getitem__(self, name: str) -> Effect:
        return next(e for e in self.effects if e.name == name)


def _names(words: Any, what: str) -> tuple[str, ...]:
    """The effect names in `words`, one name or several; SceneError where there is no such effect."""
    names = (words,) if isinstance(words, str) else words
    if not isinstance(names, Iterable):
        also = ", 'auto' or 'all'" if what == "effects" else ""
        raise SceneError(f"{what} = {show(words)}: name effects, such as {what}='shear'{also}.")
    names = tuple(names)
    for name in names:
        if not isinstance(name, str) or name not in EFFECT_MEANINGS:
            known = (*EFFECT_MEANINGS, "auto", "all") if what == "effects" else EFFECT_MEANINGS
            raise SceneError(f"{what}: there is no effect {show(name)}{name_hint(name, known)}")
    return names


def mentioned_effects(scene: Any, mesh: Mesh) -> dict[str, str]:
    """The effects that the scene or the mesh mentions, by name, each with the reason; "spatial" and "shear" always are."""
    reasons = {"spatial": "where the scene leaves its plane", "shear": "part of the beam model"}
    reasons |= {n: "the mesh has it" for n in ("warping", "plate") if getattr(mesh, n)}
    reasons |= dict.fromkeys(scene.consider, "the scene considers it")
    if has_gravity(scene):
        heavy = [bool(leaf.material.density) for leaf in scene.leaf_names().values()]
        pulled = [_count(len(scene.masses), "mass", "masses")] if scene.masses else []
        if any(heavy):
            pulled.append(
                f"{sum(heavy)} of {_count(len(heavy), 'leaf', 'leaf springs')}, those of known density"
            )
        # gravity has no effect without masses
        if pulled:
            reasons["gravity"] = f"{vector_text(scene.gravity)} m/s^2 on {' and '.join(pulled)}"
    following = [load.link for load in scene.loads if load.following]
    if following:
        reasons["following"] = f"a load of {_listed(following)} turns with its link"
    if scene.compliances:
        reasons["compliance"] = f"{_listed([c.link for c in scene.compliances])} elastic"
    if scene.springs:
        reasons["springs"] = _listed([s.name for s in scene.springs])
    if scene.heats:
        reasons["heat"] = "; ".join(_heat_text(heat) for heat in scene.heats)
    if scene.fits:
        reasons["fit"] = f"of {_listed([fit.leaf for fit in scene.fits])}"
    return reasons


def _count(number: int, one: str, more: str) -> str:
    return f"{number} {one if number == 1 else more}"


def _listed(names: Iterable[str]) -> str:
    """Names in quotes, each once; the first four of many."""
    known = [f"'{n}'" for n in dict.fromkeys(names)]
    return ", ".join(known[:4]) + (f" and {len(known) - 4} more" if len(known) > 4 else "")


def _heat_text(heat: Any) -> str:
    through = f" and {heat.through:.4g} K through the thickness" if heat.through else ""
    of = "all leaf springs" if heat.leaves is None else _listed(heat.leaves)
    return f"{heat.temperature:.4g} K{through} on {of}"


def choose_effects(
    scene: Any,
    mesh: Mesh,
    *,
    effects: str | Iterable[str] = "auto",
    with_: str | Iterable[str] = (),
    without: str | Iterable[str] = (),
) -> EffectChoice:
    """Choose the effects of a model by the rule in the module docstring.

    effects: "auto" (those the scene mentions), "all" (these and all `INTRINSIC_EFFECTS`), or the names of the effects; with_
    and without switch single ones on and off. Raises SceneError for an unknown name, and for an effect that is switched on
    although the scene does not mention it.
    """
    on, off = _names(with_, "with_"), _names(without, "without")
    both = set(on) & set(off)
    if both:
        raise SceneError(f"'{min(both)}' is both in with_ and in without; keep one of them")
    named = None if isinstance(effects, str) and effects in ("auto", "all") else _names(effects, "effects")
    reasons = mentioned_effects(scene, mesh)
    for name in {*on, *(named or ())} - {*reasons, *INTRINSIC_EFFECTS}:
        raise SceneError(
            f"effect '{name}' is asked for, but the scene does not mention it; {_HOW_TO_MENTION[name]}"
        )

    asked = "plate" in (*on, *(named or ())) or (
        "plate" in scene.consider and "plate" not in off and named is None
    )
    if asked and not any(has_width(leaf.section) for leaf in scene.leaf_names().values()):
        raise SceneError(
            "effect 'plate' is asked for, but no leaf spring is wider than thick: round wires and sections given by numbers "
            "without width and thickness do not curl; leave 'plate' out"
        )
    everything = named is None and effects == "all"
    return _choose(tuple(reasons.items()), on, off, named, everything, mesh.shear, has_gravity(scene))


@lru_cache(maxsize=64)
def _choose(
    mentioned: tuple[tuple[str, str], ...], on: tuple[str, ...], off: tuple[str, ...], named: tuple[str, ...] | None,
    everything: bool, shear: bool, pulled: bool,
) -> EffectChoice:  # fmt: skip
    """`choose_effects` by (name, reason) of the effects mentioned; pulled: whether the scene has gravity.

    Cached, as most designs of a loop have the same effects.
    """
    reasons = dict(mentioned)

    def effect(name: str) -> Effect:
        known = name in reasons or name in INTRINSIC_EFFECTS
        because = f"; {reasons[name]}" if name in reasons and name not in INTRINSIC_EFFECTS else ""
        if name in on:
            return Effect(name, True, f"asked for{because}")
        if name in off and known:
            return Effect(name, False, f"switched off{because}")
        if name == "shear" and not shear:
            return Effect(name, False, "the mesh is without it")
        if named is not None and known:
            wanted = name in named
            return Effect(name, wanted, f"{'asked for' if wanted else 'not in the list'}{because}")
        if everything and known:
            return Effect(name, True, f"all effects are asked for{because}")
        if name == "spatial":
            # the plane is found from the model, and checked when the model is solved (ksd.model.plane)
            return Effect(name, False, "where the scene stays in its plane; checked in space")
        if name in reasons:
            return Effect(name, True, reasons[name])
        if name == "gravity" and pulled:
            return Effect(name, False, "no link has a mass and no leaf a density for it to pull at")
        return Effect(name, False, "not mentioned" if name in INTRINSIC_EFFECTS else NOT_MENTIONED)

    return EffectChoice(tuple(map(effect, EFFECT_MEANINGS)))


NOT_MENTIONED = "the scene does not mention it"
_HOW_TO_MENTION = {
    "gravity": "say mechanism.gravity = (0, -9.81, 0) and give links a mass or materials a density",
    "following": "say following=True of a load",
    "compliance": "give a link a section (mechanism.compliance)",
    "springs": "say mechanism.spring or mechanism.joint_spring",
    "heat": "say mechanism.heat",
    "fit": "say mechanism.fit",
}


def apply_effects(scene: Any, mesh: Mesh, choice: EffectChoice) -> tuple[Any, Mesh]:
    """The scene and the mesh with the chosen effects only, as they are compiled.

    Effects that are left out are removed from the scene, so they cost no unknown, no array and no call.
    """
    present = set(choice.present)
    dropped: dict[str, Any] = {}
    for name, empty in (("gravity", None), ("springs", ())):
        if name not in present and getattr(scene, name):
            dropped[name] = empty
    if "following" not in present and any(load.following for load in scene.loads):
        dropped["loads"] = tuple(replace(load, following=False) for load in scene.loads)
    heats = scene.heats if "heat" in present else ()
    fits = scene.fits if "fit" in present else ()
    if scene.heats or scene.fits:
        dropped |= {"heats": (), "fits": ()}
    if scene.consider:
        dropped["consider"] = ()
    plain = replace(scene, **dropped) if dropped else scene
    if heats or fits:
        plain = with_conditions(plain, leaf_conditions(scene.leaf_names(), heats, fits))
    if "warping" in present:
        plain = with_twists(plain)
    if "plate" in present:
        plain = with_conditions(plain, plate_conditions(plain))
    holds = plane_supports(plain)
    if holds and holds[0].name not in {s.name for s in plain.supports}:
        plain = replace(plain, supports=(*plain.supports, *holds))
    if scene.compliances:
        plain = with_elastic_links(plain) if "compliance" in present else replace(plain, compliances=())
    plain = with_load_points(with_middle_points(plain))
    words: dict[str, Any] = {name: name in present for name in ("shear", "warping", "plate")}
    if any(getattr(mesh, name) != value for name, value in words.items()):
        mesh = replace(mesh, **words)
    return plain, mesh


def with_middle_points(scene: Any) -> Any:
    """The scene with a point in the middle of every leaf with both ends on one link and no point: a member has two nodes."""
    known = {p.leaf for p in scene.points}
    middles = tuple(
        LeafPoint(f"{f.name} middle", f.name, 0.5 * f.leaf.length)
        for f in scene.leaves
        if f.a == f.b and f.name not in known
    )
    if not middles:
        return scene
    links = (*scene.links, *(p.name for p in middles))
    return replace(scene, links=links, points=(*scene.points, *middles))


def with_load_points(scene: Any) -> Any:
    """The scene with a point wherever a force along a leaf begins or ends inside it, so that every member is loaded all
    along, and with the points that moments along leaf springs stand on."""
    added = []
    for placed in scene.leaves if scene.line_loads or scene.pressures else ():
        length, known = placed.leaf.length, [p.s for p in scene.points if p.leaf == placed.name]
        for s in load_edges(scene, placed.name, length):
            if all(abs(s - other) > 1e-9 * length for other in known):
                added.append(LeafPoint(f"{placed.name} at {1e3 * s:.6g} mm", placed.name, s))
                known.append(s)
    links = (*scene.links, *(p.name for p in added))
    cut = replace(scene, links=links, points=(*scene.points, *added)) if added else scene
    return with_moment_points(cut)


def with_twists(scene: Any) -> Any:
    """The scene with the restrained warping of runs of leaf springs and of varying sections."""
    leaves = scene.leaf_names()
    conditions = {
        name: replace(leaves[name].condition or LeafCondition(), twist=twist)
        for name, twist in run_twists(scene).items()
    }
    return with_conditions(scene, conditions)


def with_conditions(scene: Any, conditions: Mapping[str, LeafCondition]) -> Any:
    """The scene with the given conditions, by full name of the leaf spring."""
    if not conditions:
        return scene
    joints = []
    for placed in scene.joints:
        inside = tuple(
            (leaf.name, conditions[f"{placed.name}/{leaf.name}"])
            for leaf in placed.joint.leaves()
            if f"{placed.name}/{leaf.name}" in conditions
        )
        joints.append(replace(placed, conditions=inside) if inside else placed)
    leaves = tuple(
        replace(placed, leaf=replace(placed.leaf, condition=conditions[placed.name]))
        if placed.name in conditions
        else placed
        for placed in scene.leaves
    )
    return replace(scene, joints=tuple(joints), leaves=leaves)

"""Which effects a model has: those the scene mentions, or the words of the user.

Mentioned is simulated: gravity, springs, an elastic link, heat, fits, loads that follow; shear is the nature of a leaf and
costs nothing. Drive values, accuracy and estimates have no part in it, so that a scene is one model whatever its drives do.

Restrained warping and plate stiffening change the standard beam, which is what published stiffnesses and closed forms are
given for, by up to 80 % in torsion and 10 % in bending; no answer could be compared with the literature if they came
unasked. They are simulated where the scene (`Mechanism.consider`), the mesh, `with_` or `effects="all"` mention them; an
answer says what leaving them out is worth in its state (`Configuration.left_out`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from ksd.checks import name_hint, show
from ksd.errors import SceneError
from ksd.model.elastic_links import with_elastic_links
from ksd.model.mesh import Mesh
from ksd.model.scene_layout import has_gravity
from ksd.model.warping_runs import run_torsion_factors
from ksd.scene.effects import leaf_conditions
from ksd.scene.hinges import plane_supports
from ksd.scene.leaf import LeafCondition

EFFECT_MEANINGS = {
    "spatial": "six unknowns per node",
    "shear": "Timoshenko shear of the leaf springs",
    "warping": "warping restrained at clamped ends",
    "plate": "plate stiffening of wide leaf springs",
    "gravity": "gravity on links, payloads and along the leaf springs",
    "following": "loads that turn with their link",
    "compliance": "compliance of links",
    "springs": "springs",
    "heat": "thermal strain",
    "fit": "prestress and assembly error of leaf springs",
}
"""The effects that can be switched, with what they are."""
INTRINSIC_EFFECTS = ("spatial", "shear", "warping", "plate")
"""Effects that need no sentence of the scene: any leaf can have them."""


@dataclass(frozen=True)
class Effect:
    """One effect: is it simulated, and why."""

    name: str
    present: bool
    reason: str

    def __str__(self) -> str:
        return f"{self.name}: {self.reason}"


@dataclass(frozen=True)
class EffectChoice:
    """The effects of one model, in the order of `WORDS`."""

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
    """Checked effect names from one word or several."""
    found = (words,) if isinstance(words, str) else words
    if not isinstance(found, Iterable):
        also = ", 'auto' or 'all'" if what == "effects" else ""
        raise SceneError(f"{what} = {show(words)}: name effects, such as {what}='shear'{also}.")
    found = tuple(found)
    for name in found:
        if not isinstance(name, str) or name not in EFFECT_MEANINGS:
            known = (*EFFECT_MEANINGS, "auto", "all") if what == "effects" else EFFECT_MEANINGS
            raise SceneError(f"{what}: there is no effect {show(name)}{name_hint(name, known)}")
    return found


def mentioned_effects(scene: Any, mesh: Mesh) -> dict[str, str]:
    """The effects the scene or the mesh speaks of, with what is said; a leaf always has shear, and a place in space."""
    found = {"spatial": "where the scene leaves its plane", "shear": "of every leaf, by its nature"}
    found |= {n: "the mesh has it" for n in ("warping", "plate") if getattr(mesh, n)}
    found |= dict.fromkeys(scene.consider, "the scene considers it")
    if has_gravity(scene):
        heavy = [bool(leaf.material.density) for leaf in scene.leaf_names().values()]
        pulled = [_count(len(scene.masses), "mass", "masses")] if scene.masses else []
        if any(heavy):
            pulled.append(
                f"{sum(heavy)} of {_count(len(heavy), 'leaf', 'leaf springs')}, those of known density"
            )
        # without masses there is nothing for it to pull at
        if pulled:
            found["gravity"] = f"{_vector(scene.gravity)} m/s^2 on {' and '.join(pulled)}"
    following = [load.link for load in scene.loads if load.following]
    if following:
        found["following"] = f"a load of {_listed(following)} turns with its link"
    if scene.compliances:
        found["compliance"] = f"{_listed([c.link for c in scene.compliances])} said to be elastic"
    if scene.springs:
        found["springs"] = _listed([s.name for s in scene.springs])
    if scene.heats:
        found["heat"] = "; ".join(_warmed(heat) for heat in scene.heats)
    if scene.fits:
        found["fit"] = f"of {_listed([fit.leaf for fit in scene.fits])}"
    return found


def _vector(values: Any) -> str:
    return f"({', '.join(f'{v:.4g}' for v in values)})"


def _count(number: int, one: str, more: str) -> str:
    return f"{number} {one if number == 1 else more}"


def _listed(names: Iterable[str]) -> str:
    """Names in quotes, each once; the first four of many."""
    known = [f"'{n}'" for n in dict.fromkeys(names)]
    return ", ".join(known[:4]) + (f" and {len(known) - 4} more" if len(known) > 4 else "")


def _warmed(heat: Any) -> str:
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
    """Decide about every effect; see the module for the rule.

    effects: "auto" (what the scene mentions), "all" (that, and all a leaf can have), or the names wanted; with_ and
    without override single ones. Raises SceneError for an unknown word, or for an effect asked for of which the scene
    says nothing.
    """
    on, off = _names(with_, "with_"), _names(without, "without")
    both = set(on) & set(off)
    if both:
        raise SceneError(f"'{min(both)}' is both in with_ and in without; keep one of them")
    named = None if isinstance(effects, str) and effects in ("auto", "all") else _names(effects, "effects")
    said = mentioned_effects(scene, mesh)
    for name in {*on, *(named or ())} - {*said, *INTRINSIC_EFFECTS}:
        raise SceneError(f"effect '{name}' is asked for, but the scene says nothing of it; {_HOW[name]}")

    everything = named is None and effects == "all"
    return _decided(tuple(said.items()), on, off, named, everything, mesh.shear, has_gravity(scene))


@lru_cache(maxsize=64)
def _decided(
    mentioned: tuple[tuple[str, str], ...], on: tuple[str, ...], off: tuple[str, ...], named: tuple[str, ...] | None,
    everything: bool, shear: bool, pulled: bool,
) -> EffectChoice:  # fmt: skip
    """`choose` by what is mentioned; pulled: the scene has gravity. Most designs of a loop decide the same."""
    said = dict(mentioned)

    def decided(name: str) -> Effect:
        known = name in said or name in INTRINSIC_EFFECTS
        because = f"; {said[name]}" if name in said and name not in INTRINSIC_EFFECTS else ""
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
            # the plane is found by looking at the model, and checked when it is solved (ksd.model.plane)
            return Effect(name, False, "where the scene stays in its plane; checked in space")
        if name in said:
            return Effect(name, True, said[name])
        if name == "gravity" and pulled:
            return Effect(name, False, "no link has a mass and no leaf a density for it to pull at")
        return Effect(name, False, "not mentioned" if name in INTRINSIC_EFFECTS else NOT_MENTIONED)

    return EffectChoice(tuple(map(decided, EFFECT_MEANINGS)))


NOT_MENTIONED = "the scene says nothing of it"
_HOW = {
    "gravity": "say mechanism.gravity = (0, -9.81, 0) and give links a mass or materials a density",
    "following": "say following=True of a load",
    "compliance": "give a link a section (mechanism.compliance)",
    "springs": "say mechanism.spring or mechanism.joint_spring",
    "heat": "say mechanism.heat",
    "fit": "say mechanism.fit",
}


def apply_effects(scene: Any, mesh: Mesh, choice: EffectChoice) -> tuple[Any, Mesh]:
    """The scene with only the effects chosen, and the mesh that goes with them: what is compiled.

    What is left out is not there any more: no unknown, no array, no call.
    """
    there = set(choice.present)
    dropped: dict[str, Any] = {}
    for name, empty in (("gravity", None), ("springs", ())):
        if name not in there and getattr(scene, name):
            dropped[name] = empty
    if "following" not in there and any(load.following for load in scene.loads):
        dropped["loads"] = tuple(replace(load, following=False) for load in scene.loads)
    heats = scene.heats if "heat" in there else ()
    fits = scene.fits if "fit" in there else ()
    if scene.heats or scene.fits:
        dropped |= {"heats": (), "fits": ()}
    if scene.consider:
        dropped["consider"] = ()
    plain = replace(scene, **dropped) if dropped else scene
    if heats or fits:
        plain = with_conditions(plain, leaf_conditions(scene.leaf_names(), heats, fits))
    if "warping" in there:
        plain = with_torsion(plain, run_torsion_factors(scene))
    holds = plane_supports(plain)
    if holds and holds[0].name not in {s.name for s in plain.supports}:
        plain = replace(plain, supports=(*plain.supports, *holds))
    if scene.compliances:
        plain = with_elastic_links(plain) if "compliance" in there else replace(plain, compliances=())
    words: dict[str, Any] = {name: name in there for name in ("shear", "warping", "plate")}
    if any(getattr(mesh, name) != value for name, value in words.items()):
        mesh = replace(mesh, **words)
    return plain, mesh


def with_torsion(scene: Any, factors: Mapping[str, float]) -> Any:
    """The scene whose leaf springs, by full name, know the factor on GJ of the run they are part of."""
    leaves = scene.leaf_names()
    own = {name: leaves[name].condition or LeafCondition() for name in factors}
    known = {n: replace(own[n], torsion_factor=factor) for n, factor in factors.items()}
    return with_conditions(scene, known) if known else scene


def with_conditions(scene: Any, conditions: Mapping[str, LeafCondition]) -> Any:
    """The scene whose leaf springs, by full name, are in these conditions."""
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

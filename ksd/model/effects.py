"""Which effects a model has: chosen by estimate, or by the words of the user, each with its reason.

An effect enters because the scene mentions it (gravity, springs, an elastic link, heat, ...) or because the leafs have
it by nature (shear); `effects="auto"` then keeps it when an estimate made beforehand says that it changes a quantity
asked for (drive forces, poses; for shear and warping also the support stiffness that may be asked afterwards) by more
than a tenth of the accuracy asked for: a tenth, so that all that is left out together stays within it.

Restrained warping and plate stiffening change the standard beam, which is what published stiffnesses and closed forms are
given for, by up to 80 % in torsion and 10 % in bending. Were they put on by estimate alone, no answer could be compared
with the literature. So they are looked at only where the scene (`Mechanism.consider`), the mesh, `with_` or
`effects="all"` mention them, and `print(model)` says what leaving them out costs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from ksd.errors import SceneError
from ksd.model import estimates
from ksd.model.mesh import Mesh
from ksd.model.runs import run_factors
from ksd.scene.leaf import Condition
from ksd.section.checks import nearest, number

WORDS = {
    "spatial": "six unknowns per node",
    "shear": "Timoshenko shear of the leafs",
    "warping": "warping restrained at clamped ends",
    "plate": "plate stiffening of wide leafs",
    "gravity": "gravity on links, payloads and along the leafs",
    "following": "loads that turn with their link",
    "compliance": "compliance of links",
    "springs": "springs",
    "heat": "thermal strain",
    "fit": "prestress and misfit of leafs",
}
"""The effects that can be switched, with what they are."""
MARGIN = 0.1
"""Part of the accuracy asked for that one left-out effect may take."""
NATURE = ("spatial", "shear", "warping", "plate")
"""Effects that need no sentence of the scene: any leaf can have them."""


@dataclass(frozen=True)
class Effect:
    """One effect: is it simulated, why, and by how much it changes the answer at most, relative (None: not estimated).

    by_estimate: it is left out because that is little; kept: it is simulated because that is much. later: it is left out
    of the motion and taken up by questions (`ksd.properties.later`).
    """

    name: str
    present: bool
    reason: str
    change: float | None = None
    by_estimate: bool = False
    kept: bool = False
    later: bool = False

    def __str__(self) -> str:
        return f"{self.name}: {self.reason}"


@dataclass(frozen=True)
class Choice:
    """The effects of one model, in the order of `WORDS`; `listed`: what the drawing itself brings, not switchable."""

    effects: tuple[Effect, ...]
    listed: tuple[str, ...] = ()

    @property
    def present(self) -> tuple[str, ...]:
        """Names of the effects simulated."""
        return tuple(e.name for e in self.effects if e.present)

    @property
    def absent(self) -> tuple[str, ...]:
        """Names of the effects left out."""
        return tuple(e.name for e in self.effects if not e.present)

    @property
    def wanted(self) -> tuple[str, ...]:
        """Names of the effects simulated now or taken up by questions: what to compile the same model from."""
        return tuple(e.name for e in self.effects if e.present or e.later)

    def too_coarse(self, accuracy: float) -> tuple[str, ...]:
        """Effects left out by an estimate that is too large for this accuracy."""
        limit = MARGIN * accuracy
        return tuple(
            e.name for e in self.effects if e.by_estimate and e.change is not None and e.change > limit
        )

    def __getitem__(self, name: str) -> Effect:
        return next(e for e in self.effects if e.name == name)


def _names(words: Any, what: str) -> tuple[str, ...]:
    """Checked effect names from one word or several."""
    found = (words,) if isinstance(words, str) else words
    if not isinstance(found, Iterable):
        raise SceneError(f"{what} = {words!r}: name effects, such as {what}='shear'")
    found = tuple(found)
    for name in found:
        if name not in WORDS:
            raise SceneError(f"{what}: there is no effect {name!r}{nearest(str(name), WORDS)}")
    return found


def mentioned(scene: Any, mesh: Mesh) -> set[str]:
    """The effects the scene or the mesh speaks of; a leaf always has shear, and a place in space."""
    found = {"spatial", "shear", *scene.consider}
    found |= {n for n in ("warping", "plate") if getattr(mesh, n)}
    # without masses there is nothing for gravity to pull at
    said = {
        "gravity": scene.gravity is not None and any(scene.gravity) and (scene.masses or _heavy(scene)),
        "following": any(load.following for load in scene.loads),
        "compliance": scene.compliances,
        "springs": scene.springs,
        "heat": scene.heats,
        "fit": scene.fits,
    }
    return found | {name for name, value in said.items() if value}


def _heavy(scene: Any) -> bool:
    return any(leaf.material.density for leaf in scene.leaf_names().values())


def choose(
    scene: Any,
    mesh: Mesh,
    *,
    effects: str | Iterable[str] = "auto",
    with_: str | Iterable[str] = (),
    without: str | Iterable[str] = (),
    accuracy: float = 1e-3,
    targets: Mapping[str, float] | None = None,
) -> Choice:
    """Decide about every effect; see the module for the rules.

    effects: "auto", "all" (everything the scene mentions, and all a leaf can have), or the names wanted; with_ and
    without override single ones. accuracy: relative error allowed. targets: drive values [m or rad] the estimates are
    made for; effects that depend on them are kept when they are not known. Raises SceneError for an unknown word, or
    for an effect asked for of which the scene says nothing.
    """
    on, off = _names(with_, "with_"), _names(without, "without")
    both = set(on) & set(off)
    if both:
        raise SceneError(f"'{min(both)}' is both in with_ and in without; keep one of them")
    named = None
    if not (isinstance(effects, str) and effects in ("auto", "all")):
        named = _names(effects, "effects (beside 'auto' and 'all')")
    spoken = mentioned(scene, mesh)
    for name in {*on, *(named or ())} - spoken - set(NATURE):
        raise SceneError(f"effect '{name}' is asked for, but the scene says nothing of it; {_HOW[name]}")
    asked = _Asked(
        frozenset(on), frozenset(off if mesh.shear else (*off, "shear")), named, effects == "all",
        frozenset(spoken), MARGIN * number(accuracy, "accuracy"),
    )  # fmt: skip
    looked = estimates.Estimates(scene, mesh, targets)
    return Choice(tuple(_decided(name, asked, looked) for name in WORDS), estimates.drawn(scene))


@dataclass(frozen=True)
class _Asked:
    """The words of the user: put on, put off, the list named (None: choose), all, what the scene speaks of, the limit."""

    on: frozenset[str]
    off: frozenset[str]
    named: tuple[str, ...] | None
    all: bool
    spoken: frozenset[str]
    limit: float


def _decided(name: str, asked: _Asked, looked: estimates.Estimates) -> Effect:
    """One effect by the words of the user, else by its estimate."""
    if name in asked.on:
        return _asked(name, looked, "asked for")
    if name in asked.off:
        return _without(name, looked, asked.spoken, said="switched off")
    if asked.named is not None:
        wanted = name in asked.named
        return _asked(name, looked, "asked for") if wanted else _without(name, looked, asked.spoken)
    if name not in asked.spoken and not (asked.all and name in NATURE):
        return _unspoken(name, looked)
    if asked.all:
        return _asked(name, looked, "all effects are asked for")
    return _estimated(name, looked, asked.limit)


_HOW = {
    "gravity": "say mechanism.gravity = (0, -9.81, 0) and give links a mass or materials a density",
    "following": "say following=True of a load",
    "compliance": "give a link a section (mechanism.compliance)",
    "springs": "say mechanism.spring or mechanism.joint_spring",
    "heat": "say mechanism.heat",
    "fit": "say mechanism.fit",
}


def _asked(name: str, looked: estimates.Estimates, said: str) -> Effect:
    change, words = looked.of(name)
    return Effect(name, True, f"{said}; {words}" if change is not None else said, change)


def _unspoken(name: str, looked: estimates.Estimates) -> Effect:
    """An effect nobody mentions."""
    if name in ("warping", "plate"):
        change, said = looked.of(name)
        return Effect(name, False, f"not mentioned; would be {said}", change)
    return Effect(name, False, "the scene says nothing of it")


def _without(
    name: str, looked: estimates.Estimates, spoken: frozenset[str], *, said: str = "not in the list"
) -> Effect:
    if name not in spoken and name not in NATURE:
        return Effect(name, False, "the scene says nothing of it")
    change, words = looked.of(name)
    return Effect(name, False, f"{said}; {words}" if words else said, change)


def _estimated(name: str, looked: estimates.Estimates, limit: float) -> Effect:
    """Kept or left out by its estimate."""
    if name == "spatial":
        # the plane is found by looking at the model, and checked when it is solved (ksd.model.plane)
        return Effect(name, False, "where the scene stays in its plane; checked in space")
    change, said = looked.of(name)
    if change is None:
        return Effect(name, True, said)
    kept = change > limit or not math.isfinite(change)
    tail = "" if kept else ", left out"
    return Effect(name, kept, said + tail, change, by_estimate=not kept, kept=kept)


def applied(scene: Any, mesh: Mesh, choice: Choice) -> tuple[Any, Mesh]:
    """The scene with only the effects chosen, and the mesh that goes with them: what is compiled.

    What is left out is not there any more: no unknown, no array, no call.
    """
    from ksd.model.elastic_links import with_elastic_links
    from ksd.scene.effects import leaf_conditions

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
        plain = with_torsion(plain, run_factors(scene))
    if scene.compliances:
        plain = with_elastic_links(plain) if "compliance" in there else replace(plain, compliances=())
    words: dict[str, Any] = {name: name in there for name in ("shear", "warping", "plate")}
    if any(getattr(mesh, name) != value for name, value in words.items()):
        mesh = replace(mesh, **words)
    return plain, mesh


def with_torsion(scene: Any, factors: Mapping[str, float]) -> Any:
    """The scene whose leafs, by full name, know the factor on GJ of the run they are part of."""
    leafs = scene.leaf_names()
    own = {name: leafs[name].condition or Condition() for name in factors}
    known = {n: replace(own[n], torsion=factor) for n, factor in factors.items()}
    return with_conditions(scene, known) if known else scene


def with_conditions(scene: Any, conditions: Mapping[str, Condition]) -> Any:
    """The scene whose leafs, by full name, are in these conditions."""
    joints = []
    for placed in scene.joints:
        inside = tuple(
            (leaf.name, conditions[f"{placed.name}/{leaf.name}"])
            for leaf in placed.joint.leafs()
            if f"{placed.name}/{leaf.name}" in conditions
        )
        joints.append(replace(placed, conditions=inside) if inside else placed)
    leafs = tuple(
        replace(placed, leaf=replace(placed.leaf, condition=conditions[placed.name]))
        if placed.name in conditions
        else placed
        for placed in scene.leafs
    )
    return replace(scene, joints=tuple(joints), leafs=leafs)

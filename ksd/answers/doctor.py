"""The constraint doctor: under-constrained motions and redundant constraints, by singular values, without a solve.

Every link has six freedoms; leaves and joints constrain those in their stiff directions, supports and drives those they
prescribe. The rank of all rows gives the number of remaining freedoms and of redundant rows. Redundant rows are found by
taking rows in order of stiffness and keeping those that increase the rank (Blanding's exact constraint rules, by linear
algebra). Overconstrained models can be solved: their leaf springs deform elastically.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from ksd.answers.printing import PrintableAnswer
from ksd.answers.rest_constraints import (
    LEAF_WORDS,
    Constraint,
    ElasticConnection,
    elastic_connections,
    leaf_rows,
    prescribed_rows,
    spring_rows,
)
from ksd.checks import clear_argument_errors
from ksd.errors import SceneError
from ksd.model.chosen_effects import with_load_points, with_middle_points
from ksd.model.compile import Model, compile_scene, reference_points
from ksd.model.line_moments import without_moments
from ksd.numerics.threads import small_matrices
from ksd.scene.hinges import PLANES
from ksd.scene.mechanism import Mechanism
from ksd.scene.obstacle import has_contacts, one_sided_sentences, without_contacts
from ksd.scene.plausibility import plausibility_warnings
from ksd.scene.rules import plane_hint
from ksd.scene.scene import MECHANISM_HINT, Scene

Array = NDArray[np.float64]
RANK_TOLERANCE = 1e-2
"""Singular value, relative to the largest, up to which it counts as zero: constraints redundant up to about half a
degree."""
EXACT_TOLERANCE = 1e-6
"""The same for constraints that are exactly redundant."""


@dataclass(frozen=True)
class FreeMotion:
    """A motion that no drive, support or stiff direction holds.

    stiffness [N/m, or Nm/rad for a rotation]: resistance of soft leaves, 0 without any; twist (links, 6): displacements [m]
    and rotations [rad] of all links; link: the one that moves most; turns: whether it turns, or slides; what: the
    motion in words.
    """

    sentence: str
    stiffness: float
    twist: Array
    link: str = ""
    turns: bool = False
    what: str = ""


@dataclass(frozen=True)
class RedundantConstraint:
    """A redundant constraint.

    what: the constraint; others: those it conflicts with; release: how to remove it; nearly: it is redundant up to a small
    misalignment; inside: names of the equal joints inside which it occurs, empty for one of the mechanism; free: the motion
    that it holds as soon as the links leave this singular position (toggle, dead centre), in words, empty elsewhere.
    """

    what: str
    others: tuple[str, ...]
    release: str
    nearly: bool = False
    inside: tuple[str, ...] = ()
    free: str = ""

    @property
    def sentence(self) -> str:
        """The constraint, those it conflicts with and its release in one sentence."""
        conflict = f"{self.what} {'nearly ' * self.nearly}conflicts with {_joined(self.others)}"
        if self.free:
            return (
                f"singular position (toggle, dead centre): here {conflict} and does not hold that {self.free}; draw the "
                f"mechanism some degrees off this position, or prescribe that motion instead of {self.what}"
            )
        return f"{conflict}; to release it, {self.release}"


@dataclass(frozen=True, repr=False)
class Diagnosis(PrintableAnswer):
    """Freedoms and constraints of a mechanism.

    freedoms: number of freedoms that joints, leaf springs and supports leave; held: number of these held by drives;
    constraints, independent: number of rows of joints, leaf springs and supports, and their rank; free: motions left with
    all drives held; redundant: redundant constraints, of the mechanism and then inside joints; singular_values: of all rows,
    descending; unusual: sentences about unusual sizes and materials (`ksd.scene.plausibility`); hint: set where links can
    leave a plane that the scene does not name; observed: sentences about sensors and dampers, which of them are about a
    motion that joints, leaf springs and supports hold, and about a motion in time.
    """

    mechanism: str
    freedoms: int
    held: int
    constraints: int
    independent: int
    free: tuple[FreeMotion, ...]
    redundant: tuple[RedundantConstraint, ...]
    singular_values: Array
    unusual: tuple[str, ...] = ()
    hint: str = ""
    observed: tuple[str, ...] = ()

    @property
    def exact(self) -> bool:
        """Whether every freedom is constrained exactly once, apart from the inside of joints."""
        return not self.free and not any(not f.inside for f in self.redundant)

    def _line(self) -> str:
        return str(self).splitlines()[0]

    def __str__(self) -> str:
        own = [f for f in self.redundant if not f.inside]
        lines = [
            f"{self.mechanism}: {self.freedoms} freedom{'s' * (self.freedoms != 1)} before driving, {self.held} held by "
            f"drives; {self.constraints} constraints, {self.independent} of them independent",
            "exactly constrained" + ", apart from the inside of joints" * bool(self.redundant)
            if self.exact
            else f"{len(self.free)} under-constrained motion{'s' * (len(self.free) != 1)}, {len(own)} redundant "
            f"constraint{'s' * (len(own) != 1)}",
        ]
        lines += [f"free: {sentence}" for sentence in _by_kind(self.free)]
        lines += [f"hint: {self.hint}"] * bool(self.hint and self.free)
        lines += [f"overconstrained: {sentence}" for sentence in _redundant_by_kind(own)]
        for names in dict.fromkeys(f.inside for f in self.redundant if f.inside):
            within = [f.what for f in self.redundant if f.inside == names]
            lines.append(f"inside {_joints(names)}, {len(within)} redundant by design: {_joined(within)}")
        if own:
            lines.append("with all of these released the mechanism would be exactly constrained")
        if self.redundant:
            lines.append("redundant constraints are solved as well: the leaf springs deform elastically")
        lines += [*self.observed, *(f"unusual: {sentence}" for sentence in self.unusual)]
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """Counts and sentences, ready for JSON."""
        return {
            "mechanism": self.mechanism,
            "freedoms": self.freedoms,
            "held_by_drives": self.held,
            "constraints": self.constraints,
            "independent_constraints": self.independent,
            "exact": self.exact,
            "free": [{"sentence": f.sentence, "stiffness": f.stiffness} for f in self.free],
            "overconstrained": [
                {"what": f.what, "conflicts_with": list(f.others), "release": f.release, "nearly": f.nearly,
                 "inside": list(f.inside), "free": f.free, "sentence": f.sentence}
                for f in self.redundant
            ],
            "singular_values": self.singular_values.tolist(),
            "unusual": list(self.unusual),
            "observed": list(self.observed),
        }  # fmt: skip


@clear_argument_errors
@small_matrices
def doctor(mechanism: Mechanism | Scene | Model) -> Diagnosis:
    """Find freedoms, redundant constraints and their releases of an undeformed mechanism (or Scene, or Model).

    Raises SceneError for a mechanism without links or with unknown names.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> found = ksd.doctor(guide)
    >>> found.freedoms, found.held, len(found.redundant)
    (1, 1, 1)
    """
    described, simulated = _scene_of(mechanism), _simulated(mechanism)
    still = without_moments(described)
    whole = with_load_points(with_middle_points(still))
    scene = without_contacts(whole)
    if scene.compliances or has_contacts(whole) or still is not described:
        # elastic links count as rigid: the beams in them are no freedoms of the mechanism, nor are points for moments
        scene, mechanism = replace(scene, compliances=()), scene
    model = mechanism if isinstance(mechanism, Model) else compile_scene(scene)
    positions, size = reference_points(scene), model.arrays.size
    index = {link: i for i, link in enumerate(scene.links)}
    springs, rows = elastic_connections(scene, index, positions, size)
    supports, drives = prescribed_rows(model, size)
    in_plane = []
    if scene.plane is not None:
        in_plane, supports, rows, drives = _constraints_in_plane(scene, supports, rows, drives)
    rows = sorted(rows, key=lambda c: -c.stiffness)
    own, everything = [*in_plane, *supports, *rows], [*in_plane, *supports, *rows, *drives]
    rank, total = _rank(own), _rank(everything)
    unknowns = 6 * (len(positions) - 1)
    redundant = [_redundant_constraint(*found) for found in _redundant_rows(everything, total)]
    free = _free_motions(everything, total, springs, (scene.links, positions, size))
    redundant = _in_singular_position(redundant, free, springs, scene, model)
    return Diagnosis(
        mechanism=scene.name,
        freedoms=unknowns - rank,
        held=total - rank,
        constraints=len(own) - len(in_plane),
        independent=rank - len(in_plane),
        free=tuple(free),
        redundant=(*redundant, *_redundant_inside_joints(scene)),
        singular_values=_singular_values(everything),
        unusual=plausibility_warnings(replace(whole, line_loads=described.line_loads)),
        hint=plane_hint(scene),
        observed=(*_observed(scene, own, positions, size), *one_sided_sentences(whole), *simulated),
    )


def _observed(scene: Scene, own: Sequence[Constraint], positions: Array, size: float) -> Iterator[str]:
    """A sentence about every sensor and damper; own: all constraints but the drives."""
    parts: list[tuple[str, Any, str]] = [("sensor", s, f"reads the {s.kind}") for s in scene.sensors]
    parts += [("damper", d, "resists the motion") for d in scene.dampers]
    if not parts:
        return
    _, values, basis = np.linalg.svd(_matrix(own), full_matrices=False)
    basis = basis[values > RANK_TOLERANCE * values.max(initial=0.0)]
    for kind, part, does in parts:
        term, row = part.term, np.zeros((len(positions), 6))
        direction = np.asarray(term.direction)
        for name, sign in ((term.link, 1.0), (term.base, -1.0)):
            node = scene.links.index(name)
            turned = np.cross(np.asarray(term.point) - positions[node], direction) / size
            row[node] = sign * np.concatenate(
                [np.zeros(3), direction] if term.kind == "rotation" else [direction, turned]
            )
        moving = row.ravel()[6:] / np.linalg.norm(row.ravel()[6:])
        free = float(np.linalg.norm(moving - basis.T @ (basis @ moving)))
        way = "about" if term.kind == "rotation" else "along"
        axis = "({:.3g} {:.3g} {:.3g})".format(*direction)
        sentence = f"{kind} '{part.name}' {does} of '{term.link}' {way} {axis} relative to '{term.base}'"
        if free <= RANK_TOLERANCE:
            sentence += (
                ": joints, leaf springs and supports hold it, so that little but their deformation is left"
            )
        yield sentence


SMALL_MOTION = 1e-3
"""Motion [size of the mechanism, or rad] by which a singular position is left, to first order."""
GAIN = 0.02
"""Independent part of a unit row per `SMALL_MOTION` above which the row holds what it did not; parts of second order are
less than `SMALL_MOTION`."""


def _simulated(mechanism: Any) -> tuple[str, ...]:
    """Sentences about the words of [simulate] of a mechanism. Raises SceneError for wrong ones."""
    words = mechanism.simulation if isinstance(mechanism, Mechanism) else None
    return () if words is None else tuple(f"simulate: {said}" for said in words.check(mechanism.draft()))


def _in_singular_position(
    redundant: list[RedundantConstraint],
    free: list[FreeMotion],
    springs: Sequence[ElasticConnection],
    scene: Scene,
    model: Model,
) -> list[RedundantConstraint]:
    """The redundant constraints, with the free motion that a drive or support among them holds off this position.

    In a singular position a prescribed row depends on the others, and no longer after a small free motion.
    """
    doubted = [i for i, r in enumerate(redundant) if r.what.startswith(("drive ", "support "))]
    found = list(redundant)
    if not doubted or not free:
        return found
    rest = _rows_off_rest(springs, scene, model, np.zeros((len(scene.links), 6)))
    for motion in free:
        size = model.arrays.size
        unit = motion.twist / np.abs(motion.twist / np.array([size, size, size, 1, 1, 1])).max()
        moved = [_rows_off_rest(springs, scene, model, h * unit) for h in (SMALL_MOTION, -SMALL_MOTION)]
        for i in doubted:
            what = redundant[i].what
            new = max(_independent_part(rows, what) for rows in moved)
            if not found[i].free and new - _independent_part(rest, what) > GAIN * SMALL_MOTION:
                found[i] = replace(redundant[i], free=motion.what)
    return found


def _rows_off_rest(
    springs: Sequence[ElasticConnection], scene: Scene, model: Model, twist: Array
) -> list[Constraint]:
    """All constraints after small motions of the links, twist (links, 6) [m, rad]; springs: of joints, then of leaves."""
    size, positions = model.arrays.size, reference_points(scene)
    moved, rows = positions + twist[:, :3], []
    for i, spring in enumerate(springs):
        joint = scene.joints[i].joint if i < len(scene.joints) else None
        expected = None if joint is None else 6 - len(joint.motions)
        now = spring.moved(twist, positions, turns_with_chord=joint is None)
        rows += spring_rows(now, moved, size, owner="", words=LEAF_WORDS, expected=expected)
    supports, drives = prescribed_rows(model, size, twist)
    if scene.plane is not None:
        in_plane, supports, rows, drives = _constraints_in_plane(scene, supports, rows, drives)
        rows = [*in_plane, *rows]
    return [*supports, *rows, *drives]


def _independent_part(rows: Sequence[Constraint], what: str) -> float:
    """Norm of the part of the row `what` that does not depend on the other rows, those that are new by motion included."""
    row = next(c.row[6:] for c in rows if c.what == what)
    _, values, basis = np.linalg.svd(_matrix([c for c in rows if c.what != what]), full_matrices=False)
    basis = basis[values > GAIN * SMALL_MOTION]
    return float(np.linalg.norm(row - basis.T @ (basis @ row)))


def _constraints_in_plane(scene: Scene, *parts: list[Constraint]) -> list[list[Constraint]]:
    """Constraints that hold every link in the plane of the scene, followed by the constraints `parts` within that plane."""
    k = PLANES[str(scene.plane)]
    out_of_plane = np.zeros(6)
    out_of_plane[[k, *(3 + c for c in range(3) if c != k)]] = 1.0
    count = len(scene.links)
    held = []
    for at in np.flatnonzero(np.tile(out_of_plane, count))[3:]:
        held.append(Constraint(f"plane {scene.plane}", np.eye(6 * count)[at], np.inf, "leave the plane out"))
    found = [held]
    for rows in parts:
        inside = [(c, c.row * np.tile(1.0 - out_of_plane, count)) for c in rows]
        found.append(
            [replace(c, row=r / np.linalg.norm(r)) for c, r in inside if np.linalg.norm(r) > np.sqrt(0.5)]
        )
    return found


def _scene_of(mechanism: Any) -> Scene:
    """Scene of a mechanism, scene or model; a mechanism may have links without connection. Raises SceneError."""
    if isinstance(mechanism, Model):
        described = mechanism.original_scene
        return described if described.compliances or mechanism.scene.unlisted else mechanism.scene
    scene = mechanism.draft() if hasattr(mechanism, "draft") else mechanism
    if not isinstance(scene, Scene):
        raise SceneError(f"{type(mechanism).__name__} is not a mechanism; {MECHANISM_HINT}.")
    if len(scene.links) < 2 and not scene.leaves:
        raise SceneError(f"mechanism '{scene.name}' has no link; add one with mechanism.link(name).")
    return scene


def _matrix(rows: Sequence[Constraint]) -> Array:
    """Rows of constraints (rows, 6 (nodes - 1)) without the first node, ground."""
    return np.array([c.row[6:] for c in rows]) if rows else np.zeros((0, 6))


def _singular_values(rows: Sequence[Constraint]) -> Array:
    """Singular values of constraint rows, descending."""
    return np.asarray(np.linalg.svd(_matrix(rows), compute_uv=False), float) if rows else np.zeros(0)


def _rank(rows: Sequence[Constraint]) -> int:
    """Number of singular values above RANK_TOLERANCE times the largest."""
    s = _singular_values(rows)
    return int(np.sum(s > RANK_TOLERANCE * s[0])) if len(s) and s[0] > 0.0 else 0


def _redundant_rows(
    rows: Sequence[Constraint], rank: int
) -> list[tuple[list[Constraint], Constraint, Array, float]]:
    """Rows that depend on rows before them: (independent rows, the row, its coefficients, norm of its independent part)."""
    A = _matrix(rows)
    kept: list[int] = []
    basis = np.zeros((0, A.shape[1]))
    new_part = np.ones(len(rows))
    for i, row in enumerate(A):
        rest = row - basis.T @ (basis @ row)
        # a second projection ensures orthogonality
        rest -= basis.T @ (basis @ rest)
        new_part[i] = np.linalg.norm(rest)
        if new_part[i] > 2.0 * RANK_TOLERANCE and len(kept) < rank:
            kept.append(i)
            basis = np.vstack([basis, rest / new_part[i]])
    found = []
    for i in sorted(set(range(len(rows))) - set(kept)):
        share = np.linalg.lstsq(A[kept].T, A[i], rcond=RANK_TOLERANCE)[0]
        found.append(([rows[k] for k in kept], rows[i], share, float(new_part[i])))
    return found[: len(rows) - rank]


def _redundant_constraint(
    kept: list[Constraint], row: Constraint, share: Array, new_part: float, *inside: str
) -> RedundantConstraint:
    """Description of a redundant row by the rows with the largest coefficients."""
    order = np.argsort(-np.abs(share))
    others = [kept[k].what for k in order[:3] if abs(share[k]) > 0.3 * np.abs(share).max()]
    nothing = () if others else ("nothing it could move",)
    return RedundantConstraint(
        row.what, (*others, *nothing), row.release, new_part > EXACT_TOLERANCE, tuple(inside)
    )


def _free_motions(
    rows: Sequence[Constraint],
    rank: int,
    springs: Sequence[ElasticConnection],
    where: tuple[Sequence[str], Array, float],
) -> list[FreeMotion]:
    """Motions that the rows leave free, each with the other ones held; where: names and positions of the links, and size."""
    links, positions, size = where
    unknowns = 6 * (len(positions) - 1)
    A = _matrix(rows)
    null = np.linalg.svd(A)[2][rank:].T if len(A) else np.eye(unknowns)
    if not null.shape[1]:
        return []
    # components that can be prescribed independently; the others follow
    _, _, picked = qr(null.T, pivoting=True)
    columns = null @ np.linalg.inv(null[picked[: null.shape[1]]])
    found = []
    for column in columns.T:
        motion = np.concatenate([np.zeros(6), column])
        energy = 0.0
        for spring in springs:
            own = spring.jacobian(positions, size) @ motion
            energy += float(own @ spring.K @ own)
        twist = motion.reshape(-1, 6) / np.array([1, 1, 1, size, size, size])
        found.append(_describe_free_motion(links, twist, energy, size))
    return found


def _describe_free_motion(links: Sequence[str], twist: Array, energy: float, size: float) -> FreeMotion:
    """Description and stiffness of a free motion, twist (links, 6), by the link that moves most."""
    amount = np.abs(twist * np.array([1, 1, 1, size, size, size]))
    link = int(np.argmax(np.linalg.norm(amount, axis=1)))
    # a rotation about a distant axis counts as a rotation, although the reference point moves more
    turns = amount[link, 3:].max() >= 0.5 * amount[link, :3].max()
    k = 3 + int(np.argmax(amount[link, 3:])) if turns else int(np.argmax(amount[link, :3]))
    twist = twist / twist[link, k]
    value = energy / (amount[link, k] / (size if turns else 1.0)) ** 2
    motion = f"turn about {'xyz'[k - 3]}" if turns else f"slide along {'xyz'[k]}"
    own = np.linalg.norm(twist[link, 3:])
    others = np.delete(amount, link, axis=0).max(initial=0.0)
    if turns and own > 1.0 + EXACT_TOLERANCE and others < EXACT_TOLERANCE * amount[link].max():
        # a link that turns alone, as a leg between two ball joints, has an axis of its own
        twist, value = twist / own, value / own**2
        motion = f"turn about its axis ({' '.join(f'{v:.3g}' for v in twist[link, 3:] + 0.0)})"
    unit = "Nm/rad" if turns else "N/m"
    resistance = f"only leaf springs that bend hold it, with {value:.3g} {unit}"
    why = resistance if value > 0.0 else "no leaf spring or support holds it"
    what = f"link '{links[link]}' can {motion}"
    return FreeMotion(f"{what}: {why}", value, twist, links[link], bool(turns), what)


MAX_OF_A_KIND = 3
"""Free motions or redundant constraints of one kind that are told one by one; more are told together."""


def _by_kind(free: Sequence[FreeMotion]) -> list[str]:
    """Sentences about free motions: one for all that turn, or slide, and are held by leaf springs, or by nothing."""
    kinds: dict[tuple[bool, bool], list[FreeMotion]] = {}
    for motion in free:
        kinds.setdefault((motion.turns, motion.stiffness > 0.0), []).append(motion)
    said = []
    for (turns, held), motions in kinds.items():
        if len(motions) <= MAX_OF_A_KIND:
            said += [m.sentence for m in motions]
            continue
        links = sorted({m.link for m in motions})
        names = _shortened([repr(n) for n in links])
        values = " to ".join(dict.fromkeys(f"{f(m.stiffness for m in motions):.3g}" for f in (min, max)))
        unit, verb = ("Nm/rad", "turn about") if turns else ("N/m", "slide along")
        counts = {sum(m.link == name for m in motions) for name in links}
        axes = {m.what.split(verb)[1].split(" (")[0].strip() for m in motions}
        if len(counts) > 1:
            who, way = f"links {names}", f"{verb.split()[0]}, {len(motions)} motions in all"
        else:
            each = counts.pop()
            who = f"each of the {len(links)} links {names}" if len(links) > 1 else f"link {names}"
            way = f"{verb} {f'{each} axes' if each > 1 else axes.pop() if len(axes) == 1 else 'one axis'}"
        them = "them" if who.startswith("links") else "it"
        why = (
            f"only leaf springs that bend hold {them}, with {values} {unit}"
            if held
            else f"nothing holds {them}"
        )
        said.append(f"{who} can {way}: {why}")
    return said


def _redundant_by_kind(redundant: Sequence[RedundantConstraint]) -> list[str]:
    """Sentences about redundant constraints: one for the same direction of many leaf springs, or of many joints."""
    kinds: dict[tuple[str, ...], list[tuple[RedundantConstraint, str]]] = {}
    for r in redundant:
        direction, _, owner = r.what.partition(" of ")
        alone = bool(r.free) or not owner
        key: tuple[str, ...] = (
            (r.what,)
            if alone
            else (direction, owner.split()[0], r.release.replace(owner, "each"), str(r.nearly))
        )
        kinds.setdefault(key, []).append((r, owner))
    said = []
    for kind_key, found in kinds.items():
        if len(found) <= MAX_OF_A_KIND:
            said += [r.sentence for r, _ in found]
            continue
        direction, kind, release, _ = kind_key
        owners = sorted(owner.removeprefix(f"{kind} ") for _, owner in found)
        others = list(dict.fromkeys(other for r, _ in found for other in r.others))
        said.append(
            f"{direction} of {len(found)} {'leaves' if kind == 'leaf' else 'joints'}, {_shortened(owners)}, "
            f"{'nearly ' * found[0][0].nearly}conflicts with {_shortened(others)}; to release it, {release}"
        )
    return said


def _shortened(names: Sequence[str]) -> str:
    """Names joined by commas and "and", the first six of many."""
    return _joined([*names[:6], *[f"{len(names) - 6} more"] * (len(names) > 6)])


def _redundant_inside_joints(scene: Scene) -> list[RedundantConstraint]:
    """Redundant constraints inside joints, once for all equal joints."""
    groups: dict[Any, list[Any]] = {}
    for placed in scene.joints:
        groups.setdefault(_joint_key(placed.joint), []).append(placed)
    found = []
    for equal in groups.values():
        joint, names = equal[0].joint, [p.name for p in equal]
        blocks = joint.blocks()
        index = {block: i for i, block in enumerate(["A", *(b for b in blocks if b != "A")])}
        positions = np.array([blocks[b] for b in index], float)
        leaves = [(f.name, f.start_block, f.end_block, f) for f in joint.leaves()]
        rows = sorted(leaf_rows(leaves, index, positions, joint.length), key=lambda c: -c.stiffness)
        rank = _rank(rows)
        found += [_redundant_constraint(*too, *names) for too in _redundant_rows(rows, rank)]
    return found


def _joint_key(joint: Any) -> Any:
    """Key that is the same for equal joints."""
    try:
        hash(joint)
    except TypeError:
        return id(joint)
    return joint


def _joined(names: Sequence[str]) -> str:
    """Names joined by commas and "and"."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


def _joints(names: Sequence[str]) -> str:
    """ "joint" or "joints" and their names."""
    return f"joint{'s' * (len(names) > 1)} {_joined([repr(n) for n in names])}"


__all__ = ["Diagnosis", "FreeMotion", "RedundantConstraint", "doctor"]

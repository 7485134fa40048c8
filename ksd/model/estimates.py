"""What every effect changes at most, estimated before anything is solved.

Closed forms where the leaf alone decides (shear, warping, plate); else the larger of a bound by force ratios and of what
the effect changes in one linear solution at rest, with and without it. Changes are relative: of drive forces to the
largest, of displacements to the largest. What cannot be known without drive values has no number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ksd.errors import KsdError
from ksd.model.mesh import Mesh
from ksd.model.runs import corners, half_held_factor, meetings, own_factor, run_factors
from ksd.scene.effects import Spring, leaf_conditions
from ksd.section.plate import plate_factor

Found = tuple[float | None, str]
AGAIN = 3.0
"""How much stiffer a mechanism may get over its stroke than the linear solution at rest knows; bounds are taken at both."""


def percent(change: float) -> str:
    """A relative change in words: "0.012 %"."""
    return f"{100 * change:.2g} %" if math.isfinite(change) else "more than the answer"


@dataclass(frozen=True)
class First:
    """The linear answer at rest: force (N; moments over the size) of every drive, displacement (k, 3) [m] and rotation
    (k, 3) [rad] of every link by name; effort: half the work of the drives [J]; bend [1/m]: by leaf."""

    force: np.ndarray
    shift: dict[str, np.ndarray]
    turn: dict[str, np.ndarray]
    effort: float
    bend: dict[str, float]
    size: float


def linear_answer(scene: Any, mesh: Mesh, targets: Mapping[str, float]) -> First:
    """One Newton step from rest at `targets`. Raises KsdError where it cannot be compiled or is singular."""
    from ksd.model.arrays import ROTATION, make_work
    from ksd.model.compile import compile_given
    from ksd.model.system import assemble, solve_step

    model = compile_given(scene, mesh)
    arrays, work = model.arrays, make_work(model.arrays)
    aim = model.targets(targets)
    assemble(arrays, model.rest, aim, 1.0, work, 1e-8, 0, 10.0)
    _, pivot = solve_step(arrays, work)
    step = work.rhs
    if not (pivot > 1e-14 and np.all(np.isfinite(step))):
        raise KsdError("singular at rest")
    drives = len(model.drive_names)
    raw = step[arrays.terms.start[:drives]]
    turning = arrays.terms.kind[arrays.terms.first[:drives]] == ROTATION
    moved = {n: step[arrays.start[k] :][:6] for k, n in enumerate(scene.links) if k > 0}
    moved["ground"] = np.zeros(6)
    bend = {name: _bend(model, step, i) for i, name in enumerate(model.member_names)}
    effort = 0.5 * abs(float(raw @ aim[:drives])) if drives else 0.0
    return First(
        np.where(turning, raw / arrays.size, raw),
        {n: u[:3].copy() for n, u in moved.items()},
        {n: u[3:].copy() for n, u in moved.items()},
        effort,
        bend,
        arrays.size,
    )


def _bend(model: Any, step: np.ndarray, i: int) -> float:
    """Larger end curvature about e3 [1/m] of leaf i, as a beam bent by the motion `step` of its nodes."""
    members, start = model.arrays.members, model.arrays.start
    axes, ends = members.frame[i, 0], []
    for e, node in enumerate(members.node[i]):
        u = np.zeros(6) if start[node] < 0 else step[start[node] :][:6]
        ends.append((axes.T @ (u[:3] + np.cross(u[3:], members.offset[i, e])), axes.T @ u[3:]))
    L = float(members.length[i])
    (up, p), (uq, q) = ends
    chord = 6.0 * (uq[1] - up[1]) / L
    return float(max(abs(4.0 * a[2] + 2.0 * b[2] - chord) for a, b in ((p, q), (q, p)))) / L


def change(one: First, two: First) -> float:
    """Largest relative change of drive forces and link displacements from `one` to `two`."""
    forces = _relative(one.force, two.force)
    links = [n for n in one.shift if n in two.shift]
    shifts = _relative(
        np.array([[*one.shift[n], *(one.size * one.turn[n])] for n in links]),
        np.array([[*two.shift[n], *(two.size * two.turn[n])] for n in links]),
    )
    return max(forces, shifts)


def _relative(a: np.ndarray, b: np.ndarray) -> float:
    most = max(np.abs(a).max(initial=0.0), np.abs(b).max(initial=0.0))
    return float(np.abs(a - b).max(initial=0.0) / most) if most > 0.0 else 0.0


def bare(scene: Any) -> Any:
    """The scene with leafs, links, drives and dead loads alone."""
    loads = tuple(replace(load, following=False) for load in scene.loads)
    return replace(
        scene, loads=loads, gravity=None, springs=(), compliances=(), heats=(), fits=(), consider=()
    )


class Estimates:
    """The estimates of one scene, each made when it is asked for and kept."""

    def __init__(self, scene: Any, mesh: Mesh, targets: Mapping[str, float] | None) -> None:
        self.scene, self.mesh, self.targets = scene, mesh, targets
        self._found: dict[str, Found] = {}

    def of(self, name: str) -> Found:
        """(relative change, words) of an effect; the change is None where it cannot be known beforehand."""
        if name not in self._found:
            self._found[name] = getattr(self, f"_{name}")() if name != "spatial" else (None, "")
        return self._found[name]

    @cached_property
    def leafs(self) -> dict[str, Any]:
        """All leafs of the scene by full name."""
        return dict(self.scene.leaf_names())

    @cached_property
    def first(self) -> First | None:
        """The linear answer of the bare scene, None without drive values or where there is none."""
        if self.targets is None or {d.name for d in self.scene.drives} - set(self.targets):
            return None
        try:
            return linear_answer(bare(self.scene), self.mesh, self.targets)
        except KsdError:
            return None

    def _against(self, said: str, bound: float, scene: Any) -> Found:
        """The larger of a bound and of the change in the linear answer when `scene` is taken instead of the bare one."""
        assert self.first is not None and self.targets is not None
        try:
            linear = change(self.first, linear_answer(scene, self.mesh, self.targets))
        except KsdError:
            return None, f"{said}; kept, since the mechanism is singular at rest"
        worst = max(bound, linear)
        return worst, f"{said}: {percent(worst)} of drive forces and displacements"

    @property
    def _force(self) -> float:
        """Force that moves the mechanism [N]: of the drives, else of the loads."""
        assert self.first is not None
        loads = [
            np.linalg.norm(p.force) + np.linalg.norm(p.moment) / self.first.size for p in self.scene.loads
        ]
        return float(max([np.abs(self.first.force).max(initial=0.0), *loads]))

    def _ratio(self, force: float) -> float:
        return force / self._force if self._force > 0.0 else (math.inf if force > 0.0 else 0.0)

    # What the leafs alone decide

    def _shear(self) -> Found:
        """12 E I / (k G A L^2) of the clamped-guided leaf, in the worse of both directions."""
        worst, said = 0.0, ""
        for name, leaf in self.leafs.items():
            q, m, L = leaf.section, leaf.material, leaf.length
            for inertia, k, size in ((q.Iz, q.ky, "t/L"), (q.Iy, q.kz, "w/L")):
                part = 12.0 * m.E * inertia / (k * m.G * q.A * L * L)
                if part > worst:
                    extent = q.thickness if size == "t/L" else q.width
                    worst, said = part, f"leaf '{name}', {size} = {extent / L:.3g}"
        return worst, f"{percent(worst / (1.0 + worst))} of the compliance of a guided leaf ({said})"

    def _warping(self) -> Found:
        """The factor of warping restrained at both ends, of a leaf or of the run it is part of, less one."""
        worst, said = 0.0, "no leaf has warping"
        runs = run_factors(self.scene)
        for name, leaf in self.leafs.items():
            if leaf.section.Iw > 0.0:
                more = (runs[name] if name in runs else own_factor(leaf)) - 1.0
                if more > worst:
                    worst = more
                    said = f"leaf '{name}', L/w = {leaf.length / max(leaf.section.width, 1e-300):.3g}"
        return worst, f"{percent(worst)} more torsional stiffness ({said}){self._meeting()}"

    def _meeting(self) -> str:
        """Words on leafs that meet end to end: runs that warping passes through, or what it would be if it did."""
        for one, two, block, passes in meetings(self.scene):
            if not all(self.leafs[n].section.Iw > 0.0 for n in (one, two)):
                continue
            alone = [f"{own_factor(self.leafs[n]):.3g}" for n in (one, two)]
            if passes:
                runs = run_factors(self.scene)
                return (
                    f"; warping passes from leaf '{one}' to '{two}', as '{block}' carries nothing else: one run, "
                    f"whose factors are {runs[one]:.3g} and {runs[two]:.3g} instead of {' and '.join(alone)}"
                )
            return (
                f"; leafs '{one}' and '{two}' meet end to end on '{block}', a body that holds their ends plane: their "
                f"factors are {' and '.join(alone)}, and would be less if warping could pass"
            )
        for one, two, block, _ in corners(self.scene):
            if all(self.leafs[n].section.Iw > 0.0 for n in (one, two)):
                factors = [
                    " and ".join(f"{f(self.leafs[n]):.3g}" for n in (one, two))
                    for f in (own_factor, half_held_factor)
                ]
                return (
                    f"; leafs '{one}' and '{two}' meet at an angle on '{block}', taken to hold their ends plane: their "
                    f"factors are {factors[0]}, and {factors[1]} if it did not hold them at all"
                )
        return ""

    def _plate(self) -> Found:
        """The transition factor less one at the curvature of the linear answer; its limit without drive values."""
        worst, said = 0.0, "no leaf is wide"
        for name, leaf in self.leafs.items():
            q, nu = leaf.section, leaf.material.nu
            if not q.width > q.thickness > 0.0:
                continue
            bend = math.inf if self.first is None else AGAIN * self.first.bend.get(name, 0.0)
            more = 1.0 / (1.0 - nu * nu) - 1.0
            if math.isfinite(bend):
                more = plate_factor(q.width, q.thickness, bend, nu) - 1.0
            if more > worst:
                searle = (
                    f"w^2/(R t) = {bend * q.width**2 / q.thickness:.3g}" if math.isfinite(bend) else "at most"
                )
                worst, said = more, f"leaf '{name}', {searle}"
        return worst, f"{percent(worst)} more bending stiffness ({said})"

    # What depends on how the mechanism is driven

    def _gravity(self) -> Found:
        if self.first is None:
            return None, "kept: its weight against the drive force is known only with drive values"
        # the leafs hang in it too
        weight = sum(m.mass for m in self.scene.masses)
        weight += sum((f.material.density or 0.0) * f.section.A * f.length for f in self.leafs.values())
        weight *= float(np.linalg.norm(self.scene.gravity))
        said = f"weight {weight:.3g} N against a drive force of {self._force:.3g} N"
        return self._against(said, self._ratio(weight), replace(bare(self.scene), gravity=self.scene.gravity))

    def _following(self) -> Found:
        if self.first is None or not self._force > 0.0:
            return None, "kept: whether a state is stable depends on it, however little its link turns"
        turning = [p for p in self.scene.loads if p.following]
        turned = max(float(np.linalg.norm(self.first.turn[p.link])) for p in turning)
        push = max(np.linalg.norm(p.force) + np.linalg.norm(p.moment) / self.first.size for p in turning)
        # a state may lean any way before it is left: LEAN counts for that
        worst = max(AGAIN * turned, LEAN) * min(1.0, self._ratio(float(push)))
        return (
            worst,
            f"the loaded link turns by {np.rad2deg(turned):.2g} deg at first: {percent(worst)} of the drive force",
        )

    def _springs(self) -> Found:
        if self.first is None:
            return None, "kept: their pull against the drive force is known only with drive values"
        pull, first = 0.0, self.first
        for s in self.scene.springs:
            if isinstance(s, Spring):
                length = float(np.linalg.norm(np.subtract(s.end, s.start)))
                stretch = max(float(np.linalg.norm(first.shift[n])) for n in (s.a, s.b))
                pull += s.stiffness * (abs(length - s.free_length) + AGAIN * stretch)
            else:
                angle = float(np.linalg.norm(first.turn[s.b] - first.turn[s.a]))
                pull += s.stiffness * (abs(s.rest_angle) + AGAIN * angle) / first.size
        said = f"pull {pull:.3g} N against a drive force of {self._force:.3g} N"
        return self._against(said, self._ratio(pull), replace(bare(self.scene), springs=self.scene.springs))

    def _compliance(self) -> Found:
        from ksd.model.elastic_links import beams_of, with_elastic_links

        if self.first is None:
            return None, "kept: its stiffness against that of the joints is known only with drive values"
        soft = 0.0
        for said in self.scene.compliances:
            if said.section is not None:
                stiff = said.material.E * min(said.section.Iy, said.section.Iz)
                lengths = [float(np.linalg.norm(b - a)) for a, b in beams_of(self.scene, said)]
                soft += sum(l**3 / (3.0 * stiff) + l * self.first.size**2 / stiff for l in lengths)
            else:
                K = np.asarray(said.matrix.stiffness)[6:9, 6:9]
                soft += 1.0 / max(float(np.linalg.eigvalsh(K)[0]), 1e-300)
        bound = self._force**2 * soft / (2.0 * self.first.effort) if self.first.effort > 0.0 else math.inf
        said = "energy in the links against that in the joints"
        elastic = with_elastic_links(replace(bare(self.scene), compliances=self.scene.compliances))
        return self._against(said, bound, elastic)

    def _heat(self) -> Found:
        return self._strained("thermal force", heats=self.scene.heats)

    def _fit(self) -> Found:
        return self._strained("force of fitting", fits=self.scene.fits)

    def _strained(self, words: str, **kinds: Any) -> Found:
        """A leaf held at both ends pushes with E A times its strain; bent and misfitted ones with their stiffness."""
        from ksd.model.effects import with_conditions

        if self.first is None:
            return None, "kept: its force against the drive force is known only with drive values"
        states = leaf_conditions(self.leafs, kinds.get("heats", ()), kinds.get("fits", ()))
        push = 0.0
        for name, state in states.items():
            leaf, q = self.leafs[name], self.leafs[name].section
            E, L = leaf.material.E, leaf.length
            strain = abs(state.stretch - 1.0) + abs(state.shift[0]) / L
            bent = abs(state.bow) + abs(state.turn[2]) / L + abs(state.shift[1]) / L**2
            wide = abs(state.turn[0]) / L + abs(state.turn[1]) / L + abs(state.shift[2]) / L**2
            push = max(push, E * q.A * strain, 12.0 * E * (q.Iz * bent + q.Iy * wide) / L)
        said = f"{words} up to {push:.3g} N against a drive force of {self._force:.3g} N"
        return self._against(said, self._ratio(push), with_conditions(bare(self.scene), states))


def drawn(scene: Any) -> tuple[str, ...]:
    """What the drawing itself brings and cannot be switched off: curved, tapered, notched, stiffened leafs."""
    kinds: dict[str, int] = {}
    for leaf in scene.leaf_names().values():
        for part, words in ((leaf.curve, "curved at rest"), (leaf.profile, "")):
            if part is not None:
                said = words or _PROFILES.get(type(part).__name__, "of varying section")
                kinds[said] = kinds.get(said, 0) + 1
    return tuple(f"{n} leaf{'s' * (n > 1)} {said}" for said, n in kinds.items())


_PROFILES = {
    "Taper": "tapered",
    "CircularNotch": "with a circular notch",
    "FilletedNotch": "with a filleted notch",
    "StiffenedMiddle": "with a stiffened middle",
}
LEAN = 0.1
"""Turn [rad] of a link under a following load that is counted whatever its first turn: stability asks for directions that
the first state does not show."""

"""The bank of hard cases as data: scene, what is hard, what is read, the verified answer, and how it was verified.

Answers marked "walk" come from 96 small load steps with strain-mode leaves of orders (6, 5, 9), or with the mesh of the
case; `python benchmarks/hard_cases.py --verify` computes them anew. Others are closed forms or published.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from hard_scenes import (
    arch,
    askew,
    bistable,
    cantilever,
    column,
    frame,
    guide,
    lee,
    long_arm,
    right_angle,
)
from scenes import STEEL, cross_flexure, fourbar, single_joint

import ksd
from ksd.section import rectangle
from ksd.units import deg

FINE = ksd.Mesh(orders=(9, 6, 9), points=14)
WALK = "walk of 96 load steps"
ROD = "exact planar rod: 1.225562 E I theta / L at 75 degrees (independent)"


@dataclass(frozen=True)
class Case:
    """One hard case. read: numbers (k,) of a configuration or path; answer: the verified ones, None where the right
    thing is to refuse; tolerance: relative. path: options of `ksd.follow` where the answer is on a path."""

    name: str
    hard: str
    build: Callable[[], Any]
    answer: tuple[float, ...] | None
    targets: Mapping[str, float] = field(default_factory=dict)
    read: Callable[[Any], Any] | None = None
    verified: str = WALK
    tolerance: float = 1e-3
    mesh: ksd.Mesh | None = None
    path: Mapping[str, Any] | None = None
    quick: bool = False

    def value(self, found: Any) -> np.ndarray:
        """What is compared: the first drive's force unless the case says otherwise."""
        if self.read is not None:
            return np.atleast_1d(self.read(found)).astype(float)
        return np.array([next(iter(found.forces.values()))])


def chain(n: int) -> ksd.Mesh:
    """n Appendix A elements per leaf."""
    return ksd.Mesh("corotational", elements=n)


def pushed(force: Any = None, moment: Any = None, **sizes: Any) -> Any:
    """The fourbar with a load on its top link."""
    joint = cross_flexure(**sizes)
    scene = fourbar(joint=joint)
    if force is not None or moment is not None:
        scene.load("top", force=force, moment=moment, at=(0, 0.3 + joint.length_AB, 0))
    return scene


def disturbed(force: float, thickness: float = 1e-3) -> Any:
    """The cross flexure with a force [N] along z on its interface B."""
    joint = cross_flexure(thickness=thickness)
    scene = single_joint(joint)
    if force:
        scene.load("tip", force=(0, 0, force), at=joint.pose_B)
    return scene


def twisted() -> Any:
    """The cross flexure turned, and tilted about x as if badly mounted."""
    scene = single_joint()
    scene.actuate("tip", about="x", name="tilt")
    return scene


def tip(found: Any) -> Any:
    """Displacement (x, y) of link 'tip'."""
    return found.links["tip"][0][:2]


def first_limit(found: Any) -> float:
    """First limit point of a path."""
    return found.limits[0]


ARM = STEEL.E * rectangle(2e-6, 20e-6).Iz * (np.pi / 6) / (50e-6 * np.cos(np.pi / 6))
"""Force [N] on the long arm at 30 degrees."""
EI = STEEL.E * rectangle(0.5e-3, 0.02).Iz
UNIT = STEEL.E * 0.08e-9 / 12 / 0.1**2
"""E I_sum / L^2 of the cross flexure [N]."""
SIDE = "loads out of the plane; the KSD start is far from the answer"
FAST = "one step from rest"


def _fourbars() -> list[Case]:
    cases = [
        Case(
            f"fourbar, {F} N out of plane",
            SIDE,
            partial(pushed, (0, 0, F)),
            (a,),
            {"top": 0.3},
            quick=F in (500, 1000),
        )
        for F, a in zip((100, 250, 500, 700, 1000), ANSWERS["out of plane"], strict=True)
    ]
    cases += [
        Case(
            f"fourbar, moment {M} Nm",
            "a moment turns the top link",
            partial(pushed, None, (0, 0, M)),
            (a,),
            {"top": 0.3},
            quick=M == -180,
        )
        for M, a in zip((-180, 120, 200), ANSWERS["moment"], strict=True)
    ]
    cases += [
        Case(
            f"fourbar, moment {M} Nm",
            hard,
            partial(pushed, None, (0, 0, M)),
            answer,
            {"top": 0.3},
            quick=M in (-310, 250),
            verified="ksd.follow at d = 0.3 m: " + how,
        )
        for M, hard, answer, how in (
            (-360, "beyond a limit point: it snaps", (2126.539803,), "past limit points at -318 and 135 Nm"),
            (-310, "buckled out of the plane", None, "bifurcation at -304.7 Nm"),
            (250, "beyond a limit point: it snaps", (1481.380118,), "past limit points at 216.5 and 71 Nm"),
        )
    ]
    wide = partial(pushed, (0, 0, 100), None, widths=(0.04, 0.08))
    cases.append(
        Case(
            "fourbar, wide outer leaf springs",
            "factor 4 on the outer widths",
            wide,
            ANSWERS["wide"],
            {"top": 0.3},
        )
    )
    cases += [
        Case(
            f"fourbar near dead centre, d = {d} m",
            "side links lie almost flat",
            pushed,
            (a,),
            {"top": d},
            quick=d == 0.36,
        )
        for d, a in zip((0.34, 0.36), ANSWERS["dead centre"], strict=True)
    ]
    cases.append(
        Case(
            "fourbar, 500 N out of plane, 4 elements",
            "loads out of the plane; another stable state at 549.70 N is not the one",
            partial(pushed, (0, 0, 500)),
            (542.33,),
            {"top": 0.3},
            verified="independent finite element code",
            tolerance=1e-4,
            mesh=chain(4),
        )
    )
    cases += [
        Case(
            f"fourbar, a joint mounted {1e3 * w:g} mrad askew",
            "overconstrained and misaligned: the loop closes by force alone",
            partial(askew, w),
            (a,),
            {"top": 0.3},
            quick=w == 0.01,
        )
        for w, a in zip((1e-3, 3e-3, 1e-2), ANSWERS["misaligned"], strict=True)
    ]
    turned = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turned *= np.sign(np.linalg.det(turned))
    for name, unit, way in (
        ("turned at random", 1.0, {"turn": turned}),
        ("1 km away", 1.0, {"shift": (1e3, -1e3, 1e3)}),
        ("in micrometres", 1e-6, {}),
        ("a million times larger", 1e6, {}),
    ):
        build = partial(frame, unit=unit, **way)
        answer = (ANSWERS["frame"][0] * unit**2,)
        cases.append(
            Case(
                f"fourbar {name}",
                "numbers of another size",
                build,
                answer,
                {"top": 0.3 * unit},
                verified="the same scene at its place and size, same mesh",
                tolerance=1e-9,
                mesh=ksd.Mesh(),
                quick=unit == 1e-6,
            )
        )
    return cases


def _joints() -> list[Case]:
    cases = [
        Case(
            f"cross flexure, {s} units along z at {a} degrees",
            SIDE,
            partial(disturbed, s * UNIT),
            (m,),
            {"turn": a * deg},
            quick=(s, a) == (16, 75),
        )
        for (s, a), m in zip(
            [(s, a) for s in (4, 16) for a in (15, 45, 75)], ANSWERS["disturbed"], strict=True
        )
    ]
    cases += [
        Case(
            f"cross flexure, {a} degrees at once",
            FAST,
            single_joint,
            (m,),
            {"turn": a * deg},
            verified=ROD if a == 75 else WALK,
            quick=a == 165,
        )
        for a, m in zip((75, 90, 120, 165), ANSWERS["turn"], strict=True)
    ]
    for n, a, m in ANSWERS["chains"]:
        hard = FAST if m is not None else "an element would turn more than 60 degrees"
        answer = None if m is None else (m,)
        cases.append(
            Case(
                f"cross flexure, {n} elements, {a} degrees at once",
                hard,
                single_joint,
                answer,
                {"turn": a * deg},
                mesh=chain(n),
                quick=(n, a) in ((4, 165), (6, 120), (1, 120)),
            )
        )
    cases += [
        Case(
            f"cross flexure, leaf springs of {1e3 * t:g} mm",
            f"slenderness {0.1 / t:.0f}",
            partial(disturbed, 0.0, t),
            (m,),
            {"turn": 75 * deg},
            verified=ROD,
            quick=t == 1e-5,
        )
        for t, m in ((t, 75 * deg * 13.333333 * 1.225562 * (t / 1e-3) ** 3) for t in (3e-4, 1e-4, 3e-5, 1e-5))
    ]
    cases += [
        Case(
            f"cross flexure mounted {1e3 * w:g} mrad askew",
            "overconstrained: torsion conflicts with the mount",
            twisted,
            (m,),
            {"turn": 45 * deg, "tilt": w},
            quick=w == 0.01,
        )
        for w, m in zip((1e-3, 1e-2), ANSWERS["askew"], strict=True)
    ]
    cases += [
        Case(
            f"parallel guide twisted {1e3 * w:g} mrad",
            "overconstrained",
            partial(guide, twist=True),
            (m,),
            {"stroke": 0.02, "twist": w},
        )
        for w, m in zip((0.0, 1e-3, 1e-2), ANSWERS["guide"], strict=True)
    ]
    return cases


def _beams() -> list[Case]:
    exact = "closed form"
    cases = [
        Case(
            f"roll-up, {k} turns by an end moment, level",
            "the tip turns beyond 360 degrees",
            partial(cantilever, moment=2 * np.pi * k * EI / 0.1, level=True),
            (0.0, 0.0),
            read=lambda c: tip(c) / 0.1 + [1.0, 0.0],
            verified=exact,
            tolerance=1e-6,
            mesh=FINE if k > 1 else None,
            quick=k == 2,
        )
        for k in (1, 2)
    ]
    cases += [
        Case(
            f"roll-up, {k} turns, free in space",
            "leaves its plane; a coarse leaf does not see it",
            partial(cantilever, moment=2 * np.pi * k * EI / 0.1),
            None,
            quick=k == 2,
            verified="two negative pivots with orders (8, 8, 12) and with 40 Appendix A elements",
        )
        for k in (1.5, 2)
    ]
    cases += [
        Case("elastica, PL^2/EI = 5", "large tip load in one step", partial(cantilever, force=(0, 5 * EI / 0.01, 0)),
             (0.71379152,), read=lambda c: tip(c)[1] / 0.1, verified="elliptic integrals"),
        Case("nearly coincident nodes", "leaf springs of 0.1 m and of 1 um in a row",
             partial(cantilever, force=(0, 5 * EI / 0.01, 0), pieces=(0.1, 1e-6)), (0.71379152,),
             read=lambda c: tip(c)[1] / 0.1, verified="elliptic integrals", quick=True),
        Case("arm of 1 m on a leaf of 50 um", "lengths from 2 um to 1 m", long_arm, (ARM,), {"end": 0.5},
             verified="closed form: the leaf bends as a circle of 30 degrees, F = E I theta / (L cos theta)", quick=True),
        Case("column at 0.95 of its Euler load", "close to a bifurcation", partial(column, 0.0, load=0.95), (0.0,),
             read=lambda c: c.links["middle"][0][1] / 0.1, verified=exact, tolerance=1e-9),
        Case("column at 1.1 of its Euler load, perfect", "the straight state is unstable", partial(column, 0.0, load=1.1),
             None, verified=exact, quick=True),
        Case("column at 1.1 of its Euler load, imperfect", "through the buckling load", partial(column, 1e-3, load=1.1),
             ANSWERS["column"], read=lambda c: c.links["middle"][0][1] / 0.1, quick=True),
        Case("right-angle frame at 0.95", "lateral buckling, feet on supports alone", partial(right_angle, 0.95), (0.0,),
             read=lambda c: c.links["corner"][0][2] / 0.24, verified=exact, tolerance=1e-9),
        Case("right-angle frame at 1.1, perfect", "beyond lateral buckling", partial(right_angle, 1.1), None,
             verified=exact, quick=True),
        Case("right-angle frame at 1.1, imperfect", "lateral buckling", partial(right_angle, 1.1, 1e-3), None,
             verified="ksd.follow: limit point at 0.91 of this load, in both leaf models"),
        Case("nothing loads it", "zero stays zero", partial(cantilever), (0.0, 0.0), read=tip, verified=exact,
             tolerance=1e-15),
    ]  # fmt: skip
    return cases


def _paths() -> list[Case]:
    return [
        Case("deep arch, limit load", "limit point", partial(arch, 107.5 * deg, hinged=False), (897.0,), read=first_limit,
             verified="Da Deppo and Schmidt 1975", tolerance=5e-3, path={"until": 1000.0, "first": 20.0}, quick=True),
        Case("shallow arch, limit load", "snap-through", partial(arch, 5 * deg, hinged=True), ANSWERS["shallow"],
             read=first_limit, verified="16 Appendix A elements per half", path={"until": 20000.0, "first": 20.0}),
        Case("Lee's frame, dead load", "limit point", lee, (18.55,), read=first_limit, tolerance=5e-3,
             verified="Lee, Manuel and Rossow 1968", path={"until": 30.0, "first": 1.0}, quick=True),
        Case("Lee's frame, following load", "unsymmetric tangent", partial(lee, following=True), ANSWERS["follower"],
             read=first_limit, verified="strain-mode leaves of orders (6, 5, 9)", tolerance=5e-3,
             path={"until": 60.0, "first": 1.0}),
        Case("right-angle frame, imperfect, limit load", "lateral buckling", partial(right_angle, 1.1, 1e-3),
             ANSWERS["lateral"], read=first_limit, verified="16 Appendix A elements per leg", tolerance=3e-3,
             path={"until": 0.95, "first": 0.05, "most": 60}),
        Case("bistable beam at its middle", "snaps between two states", lambda: bistable()[0], ANSWERS["bistable"],
             {"push": -0.003}, path={"control": "drives", "first": 0.02}, read=lambda p: p.states[-1].forces["push"]),
    ]  # fmt: skip


ANSWERS: dict[str, Any] = {
    "out of plane": (521.522366, 524.838473, 554.904551, 623.106280, 830.443475),
    "moment": (349.178744, 527.930117, 450.303886),
    "wide": (1257.573885,),
    "dead centre": (1518.096673, 12539.887900),
    "frame": (521.194785964,),
    "disturbed": (2.927803907, 9.713498302, 18.591734418, -26.116289877, -16.820619605, -7.498396161),
    "turn": (21.390089735, 27.257864061, 40.932132523, 67.609512365),
    "chains": (
        (1, 90, 33.032014845), (1, 120, None), (2, 120, 46.527287779), (3, 165, 74.428004201), (4, 165, 71.012623580),
        (6, 75, 21.521812090), (6, 120, 41.445446011), (10, 75, 21.437201164), (10, 165, 68.114718188),
    ),
    "misaligned": (521.194788, 521.195067, 521.198253),
    "askew": (11.447118983, 11.408362203),
    "guide": (31.159113791, 31.153485682, 30.605001878),
    "column": (0.2550738638,),
    "lateral": (0.90999,),
    "shallow": (6644.4,),
    "follower": (35.3922,),
    "bistable": (-13.110884763,),
}  # fmt: skip
CASES: list[Case] = [*_fourbars(), *_joints(), *_beams(), *_paths()]

"""Hard cases from the literature of stability and from flexure practice, with closed forms or an independent rod.

None was used when the thresholds of the checks were chosen. `rod` integrates the inextensible, unshearable planar rod by
Runge and Kutta and shoots for its clamp: no finite element and no code of the package is in it.
"""

from functools import cache, partial

import numpy as np
from hard_cases import Case
from scenes import STEEL, cross_flexure
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipk

import ksd
from ksd.section import numbers, rectangle

L, SECTION = 0.1, rectangle(0.5e-3, 0.02)
THIN = rectangle(10e-6, 0.02)
EI = STEEL.E * SECTION.Iz
FORCE = EI / L**2
EXACT = "closed form"
ROD = "planar rod by Runge and Kutta, shooting"


def _rod(p, a, rtol=1e-11):
    """Clamp (angle, curvature, x, y) seen from the tip of a rod whose tip leans by a against a dead force p [EI/L^2]."""

    def slope(_, z):
        # curvature seen from the tip inwards; angles against the force
        return [z[1], p * np.sin(z[0]), -np.cos(z[0]), -np.sin(z[0])]

    return solve_ivp(slope, (0, 1), [a, 0.0, 0.0, 0.0], rtol=rtol, atol=1e-3 * rtol).y[:, -1]


@cache
def rod(px, py):
    """Tip (x, y) over L of a rod clamped along x under a dead force on its tip: the state bent most towards the force."""
    p, way = np.hypot(px, py), np.arctan2(py, px)
    # the clamp leans by -way against the force; the tip least
    lean = -way * np.append(np.geomspace(1e-9, 0.1, 20), np.linspace(0.15, 1.0, 20))
    off = [_rod(p, a, 1e-6)[0] + way for a in lean]
    at = next(k for k in range(len(off)) if off[k] * off[k + 1] <= 0)
    end = _rod(p, brentq(lambda a: _rod(p, a)[0] + way, *lean[at : at + 2], xtol=1e-16))
    c, s = np.cos(way), np.sin(way)
    return float(-(c * end[2] - s * end[3])), float(-(s * end[2] + c * end[3]))


def strip(force=(0, 0, 0), *, held="", material=STEEL, section=SECTION, length=L, drive=None,
          follow=0.0, pieces=1, side=0.0):  # fmt: skip
    """A leaf along x from ground to 'tip' in `pieces`; force [EI/L^2], a share `follow` of it following; held: words
    such as "y rz" at the tip; drive: a word too; side: force [EI/L^2] along y on the middle."""
    unit = material.E * section.Iz / length**2
    scene, at = ksd.Mechanism("strip"), (length, 0, 0)
    links = [scene.ground, *(scene.link(f"part {k}") for k in range(1, pieces)), scene.link("tip")]
    for k in range(pieces):
        ends = {"start": (length * k / pieces, 0, 0), "end": (length * (k + 1) / pieces, 0, 0)}
        scene.leaf(links[k], links[k + 1], section=section, material=material, width_axis="z", **ends)
    for share, following in ((1.0 - follow, False), (follow, True)):
        if share and np.any(force):
            scene.load("tip", force=tuple(share * unit * np.array(force, float)), at=at, following=following)
    if side:
        scene.load(links[pieces // 2], force=(0, side * unit, 0), at=(length / 2, 0, 0))
    for words, hold in ((held, scene.support), (drive or "", scene.actuate)):
        for word in words.split():
            way = {"about": word[1]} if word[0] == "r" else {"along": word}
            hold("tip", at=at, name=f"{'drive' if hold == scene.actuate else 'hold'} {word}", **way)
    return scene


def place(found):
    """Tip (x, y) over L."""
    return found.links["tip"][0][:2] / L + [1.0, 0.0]


def shift(found):
    """Tip displacement across (y, z) over L."""
    return found.links["tip"][0][1:] / L


def critical(name, hard, build, verified=EXACT, low=0.97, high=1.03, read=shift, quick=False):
    """Two cases about a critical load: straight and stable below, refused above. build(share of it)."""
    return [
        Case(f"{name}, {low:g} of its critical load", hard, partial(build, low), (0.0, 0.0), read=read,
             verified=verified, tolerance=1e-7, quick=quick),
        Case(f"{name}, {high:g} of its critical load", hard, partial(build, high), None, verified=verified, quick=quick),
    ]  # fmt: skip


def pressed(factor, share, **ways):
    """The strip pressed by share * factor EI/L^2."""
    return strip((-share * factor, 0, 0), **ways)


def own_weight(share):
    """Greenhill 1881: a column stands by itself to q L^3 = 7.8373 EI."""
    scene = strip(material=ksd.Material(E=STEEL.E, G=STEEL.G, density=7800.0))
    scene.gravity = (-share * 7.83735 * EI / (7800.0 * SECTION.A * L**3), 0, 0)
    return scene


def edgewise(share):
    """Prandtl 1899: a strip loaded along its width at the tip tips over at 4.0126 sqrt(EI GJ) / L^2."""
    return strip((0, 0, share * 4.0126 * np.sqrt(EI * STEEL.G * SECTION.J) / L**2 / FORCE))


def topheavy(share, arm=0.05):
    """A leaf with a rigid arm on top, pressed at the end of the arm: tan(kL) = 1 / (k arm)."""
    k = brentq(lambda k: np.tan(k * L) * k * arm - 1.0, 1e-3, 0.5 * np.pi / L - 1e-6)
    scene = strip()
    scene.load("tip", force=(-share * EI * k**2, 0, 0), at=(L + arm, 0, 0))
    return scene


def wire(share):
    """A round wire: two buckling modes at the same load."""
    scene = ksd.Mechanism("wire")
    tip = scene.link("tip")
    scene.wire(scene.ground, tip, diameter=1e-3, material=STEEL, start=(0, 0, 0), end=(L, 0, 0))
    scene.load(tip, force=(-share * np.pi**2 / 4 * STEEL.E * np.pi * 1e-12 / 64 / L**2, 0, 0), at=(L, 0, 0))
    return scene


def stage(share=0.0, *, drive=True):
    """Two parallel leaf springs carrying a stage, pressed by share of its sway load 2 pi^2 EI / L^2."""
    scene = ksd.Mechanism("stage")
    tip = scene.link("tip")
    for y in (-0.03, 0.03):
        scene.leaf(
            scene.ground, tip, start=(0, y, 0), end=(L, y, 0), section=SECTION, material=STEEL, width_axis="z"
        )
    scene.load(tip, force=(-share * 2 * np.pi**2 * FORCE, 0, 0), at=(L, 0, 0))
    if drive:
        scene.actuate(tip, along="y", at=(L, 0, 0), name="drive y")
    return scene


def sway(p):
    """Stiffness [EI/L^3] of a guided leaf pressed by p EI/L^2 (drawn where p < 0)."""
    u = 0.5 * np.sqrt(abs(p))
    return p / (np.tan(u) / u - 1.0) if p > 0 else -p / (1.0 - np.tanh(u) / u)


def pushed_arm(p):
    """Force [EI/L^2] normal to the tip and turning with it: tip (x, y) from the tip inwards, in the axes of the tip."""
    end = solve_ivp(lambda s, z: [z[1], -p * np.cos(z[0]), np.cos(z[0]), np.sin(z[0])], (0, 1), [0.0] * 4,
                    rtol=1e-11, atol=1e-13).y[:, -1]  # fmt: skip
    c, s = np.cos(end[0]), np.sin(end[0])
    # the clamp seen from the tip, turned back
    return c * end[2] + s * end[3], c * end[3] - s * end[2]


@cache
def guided(d):
    """Force along y [EI/L^2] that shifts the tip by d L, kept level and free along x: two halves bent alike."""

    def half(F):
        # a clamped half of unit length with a force of F/4 [EI/L^2 of the half] on the inflexion
        return rod(0.0, F / 4)[1] - d

    return brentq(half, 0.1, 40.0)


def shortened(d):
    """Force [EI/L^2] of a clamped strip buckled so that its ends come closer by d L: four quarters of an elastica."""
    k = brentq(lambda k: 2.0 - 2.0 * ellipe(k * k) / ellipk(k * k) - d, 1e-4, 0.95)
    return 16.0 * ellipk(k * k) ** 2


def two_thicknesses():
    """Leaf springs of 5 mm and 5 um in a row, bent by a moment."""
    scene = ksd.Mechanism("two")
    middle, tip = scene.links("middle", "tip")
    thin = STEEL.E * rectangle(5e-6, 0.02).Iz
    for a, b, x, t in ((scene.ground, middle, 0.0, 5e-3), (middle, tip, L, 5e-6)):
        scene.leaf(
            a,
            b,
            start=(x, 0, 0),
            end=(x + L, 0, 0),
            section=rectangle(t, 0.02),
            material=STEEL,
            width_axis="z",
        )
    scene.load(tip, moment=(0, 0, 1.2 * thin / L), at=(2 * L, 0, 0))
    return scene


def bend():
    """Bathe and Bolourchi 1979: an eighth of a ring, R = 100, 1 x 1, E = 1e7, nu = 0, polar moment, 600 across it."""
    stuff, scene, a = ksd.Material(E=1e7, nu=0.0), ksd.Mechanism("bend"), np.pi / 4
    square = numbers(A=1.0, J=1 / 6, Iy=1 / 12, Iz=1 / 12, ky=1.0, kz=1.0, width=1.0, thickness=1.0)
    tip = scene.link("tip")
    end = (100 * np.sin(a), 100 * (1 - np.cos(a)), 0)
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=end, section=square, material=stuff, width_axis="z",
               curve=ksd.Arc(radius=100.0, angle=a))  # fmt: skip
    scene.load(tip, force=(0, 0, 600.0), at=end)
    return scene


def corner():
    """Two wires at a right angle, loaded out of their plane at the free end by next to nothing."""
    scene = ksd.Mechanism("corner")
    knee, tip = scene.links("knee", "tip")
    scene.wire(scene.ground, knee, diameter=1e-3, material=STEEL, start=(0, 0, 0), end=(L, 0, 0))
    scene.wire(knee, tip, diameter=1e-3, material=STEEL, start=(L, 0, 0), end=(L, L, 0))
    scene.load(tip, force=(0, 0, 1e-9), at=(L, L, 0))
    return scene


def door(size=0.0, angle=0.0):
    """A door on two hinges, each turned by `size` rad about its own direction; the upper one leans by `angle`."""
    scene, rng = ksd.Mechanism("door"), np.random.default_rng(11)
    leaf = scene.link("door")
    for z, lean in ((-0.2, 0.0), (0.2, angle)):
        v = rng.normal(size=3)
        T = Rotation.from_rotvec(size * v / np.linalg.norm(v) + [lean, 0, 0]).as_matrix()
        scene.join(
            scene.ground, leaf, cross_flexure(), at=(0, 0, z), axis=tuple(T[:, 2]), toward=tuple(T[:, 1])
        )
    scene.actuate(leaf, about="z", name="turn")
    return scene


def sarrus(askew=0.0):
    """Sarrus 1853: a plate on two folding legs at a right angle moves straight; one hinge askew by `askew` rad."""
    scene, joint = ksd.Mechanism("sarrus"), cross_flexure(length=0.02, thickness=0.2e-3, widths=(0.01, 0.005))
    top = scene.link("top")
    for k, turn in enumerate((0.0, np.pi / 2)):
        T = Rotation.from_euler("z", turn).as_matrix()
        low, high = scene.link(f"low {k}"), scene.link(f"high {k}")
        for n, (a, b, y, z) in enumerate(
            ((scene.ground, low, 0.2, 0.0), (low, high, 0.28, 0.1), (high, top, 0.2, 0.2))
        ):
            axis = T @ Rotation.from_rotvec([0, 0, askew * (n == 1 and k == 0)]).as_matrix() @ [1.0, 0, 0]
            scene.join(a, b, joint, at=tuple(T @ [0, y, z]), axis=tuple(axis), toward="z")
    scene.actuate(top, along="z", at=(0, 0, 0.2), name="lift")
    return scene


def loose():
    """A link that hangs on nothing."""
    scene = strip((0, 1, 0))
    scene.link("lost")
    scene.load("lost", force=(1, 0, 0), at=(0, 0.1, 0))
    return scene


def drive_force(found):
    """Force of the first drive, in EI/L^2."""
    return next(iter(found.forces.values())) / FORCE


SIDE = 1e-4
RODS = {
    1.152: (0.740457034, 0.593728792), 1.884: (0.123556143, 0.803209565), 4.03: (-0.340282293, 0.624644546),
    "elastica": (0.199999604, 0.917155447), "following": (0.275710123, 0.330157660), "guided": (11.845788917,),
}  # fmt: skip
"""What `rod`, `pushed_arm` and `guided` find; `test_hard_cases` computes some of them anew."""


def _buckled():
    """Cantilever columns far beyond their critical load, with a side force of 1e-4."""
    for p in (1.152, 1.884, 4.03):
        load = p * np.pi**2 / 4
        yield Case(f"elastica, {p:g} of the Euler load", "far beyond a bifurcation, nearly perfect",
                   partial(strip, (-load, SIDE * load, 0)), RODS[p], read=place,
                   verified=ROD, quick=p > 4)  # fmt: skip


CLASSICS = [
    *critical("column, clamped and free", "bifurcation", partial(pressed, np.pi**2 / 4)),
    *critical("column, clamped and pinned", "bifurcation", partial(pressed, 20.1907, held="y")),
    *critical("column, clamped and guided", "bifurcation", partial(pressed, np.pi**2, held="rz")),
    *critical("column under its own weight", "distributed load", own_weight, "Greenhill 1881"),
    *critical("strip on its edge", "lateral buckling", edgewise, "Prandtl 1899", 0.95, 1.05, lambda c: shift(c)[:1]),
    *critical("leaf with an arm on top", "load beyond the leaf", topheavy),
    *critical("round wire", "two modes at one load", wire),
    *critical("stage on two leaf springs", "sways", partial(stage, drive=False)),
    *critical("column, a quarter of its load following", "not conservative, divergence",
              partial(pressed, np.arccos(-1 / 3) ** 2, follow=0.25), "Bolotin 1963: cos k = -1/3",
              quick=True),
    *critical("Beck's column", "not conservative, flutter", partial(pressed, 20.051, follow=1.0), "Beck 1952", 0.99, 1.04,
              quick=True),
    *_buckled(),
    Case("force normal to the tip, 20 EI/L^2", "following, the tip turns by half a turn",
         partial(strip, (0, 20, 0), follow=1.0),
         RODS["following"], read=place, verified=ROD, mesh=ksd.Mesh(orders=(3, 2, 10), points=14)),
    Case("elastica, PL^2/EI = 50", "very large load in one step", partial(strip, (0, 50, 0)), RODS["elastica"],
         read=place, verified=ROD),
    Case("half a turn of the tip at once", "one step", partial(strip, drive="rz"), (np.pi * 0.99,),
         {"drive rz": 0.99 * np.pi}, read=lambda c: c.forces["drive rz"] / (EI / L), verified=EXACT),
    Case("guided leaf, 0.6 L", "one step, curvature of both signs", partial(strip, held="rz", drive="y"), RODS["guided"],
         {"drive y": 0.6 * L}, read=drive_force, verified=ROD),
    Case("guided leaf drawn by 1e4 EI/L^2", "boundary layers of a hundredth of its length", partial(strip, (1e4, 0, 0),
         held="rz", drive="y", section=THIN), (1e-3 * sway(-1e4),), {"drive y": 1e-3 * L},
         read=lambda c: c.forces["drive y"] / (STEEL.E * THIN.Iz / L**2), verified=EXACT,
         tolerance=1e-2, quick=True),
    Case("guided leaf pressed by twice its sway load", "pulls the other way",
         partial(strip, (-2 * np.pi**2, 0, 0), held="rz", drive="y"), (1e-3 * sway(2 * np.pi**2),), {"drive y": 1e-3 * L},
         read=drive_force, verified=EXACT),
    Case("stage at 0.95 of its sway load", "almost no stiffness left", partial(stage, 0.95),
         (2e-3 * sway(0.95 * np.pi**2),), {"drive y": 1e-3 * L}, read=drive_force, verified=EXACT, tolerance=5e-3),
    Case("stage at 1.5 times its sway load", "negative stiffness, held by its drive", partial(stage, 1.5),
         (2e-3 * sway(1.5 * np.pi**2),), {"drive y": 1e-3 * L}, read=drive_force, verified=EXACT, tolerance=5e-3),
    Case("clamped strip shortened by 30 %, perfect", "the straight state is unstable", partial(strip, held="y rz", drive="x",
         pieces=2), None, {"drive x": -0.3 * L}, verified=EXACT),
    Case("clamped strip shortened by 30 %, imperfect", "through the buckling load, one step", partial(strip, held="y rz",
         drive="x", pieces=2, side=0.01), (-shortened(0.3),), {"drive x": -0.3 * L}, read=drive_force, verified=EXACT,
         tolerance=3e-3),
    Case("thick cantilever, L/t = 3", "mostly shear", partial(strip, (0, 1e-4, 0), section=rectangle(L / 3, 0.02)),
         (1e-4 / 3 + 1e-4 * STEEL.E * rectangle(L / 3, 0.02).Iz / (5 / 6 * STEEL.G * 0.02 * L / 3) / L**2,),
         read=lambda c: c.links["tip"][0][1] / L, verified="closed form of Timoshenko, shear factor 5/6", tolerance=5e-3),
    Case("next to no load", "1e-12 of a unit", partial(strip, (0, 1e-12, 0)), (1 / 3,),
         read=lambda c: c.links["tip"][0][1] / L * 1e12, verified=EXACT, tolerance=2e-4),
    Case("leaf of 3 m, 1 um thick", "slenderness 3e6", partial(strip, length=3.0, section=rectangle(1e-6, 0.02), drive="rz"),
         (2.0 * STEEL.E * rectangle(1e-6, 0.02).Iz / 3.0,), {"drive rz": 2.0}, verified=EXACT, tolerance=1e-6),
    Case("leaf springs of 5 mm and 5 um in a row", "stiffness 1e9 apart", two_thicknesses,
         (np.sin(1.2) / 1.2, (1 - np.cos(1.2)) / 1.2),
         read=lambda c: c.links["tip"][0][:2] / L + [1.0, 0.0], verified=EXACT, tolerance=1e-6),
    Case("eighth of a ring, 600 across it", "bends and twists, one step", bend, (47.150, 15.685, 53.475),
         read=lambda c: c.links["tip"][0] + [100 * np.sin(np.pi / 4), 100 * (1 - np.cos(np.pi / 4)), 0.0],
         verified="exact rod, converged (independent); published 15.79, 47.23, 53.37"),
    Case("corner of two wires", "torsion, a load of 1 nN", corner,
         (L**3 * 1e-9 * (2 / 3 / (STEEL.E * np.pi / 64e12) + 1 / (STEEL.G * np.pi / 32e12)) * 1e9,),
         read=lambda c: c.links["tip"][0][2] * 1e9, verified=EXACT, tolerance=1e-4),
    Case("door on hinges 10 mrad askew", "overconstrained and misaligned", partial(door, 0.01), (20.074785,), {"turn": 0.7}),
    Case("door with a hinge leaning by 0.5 rad", "locks but for its elasticity", partial(door, 0.0, 0.5),
         (35.953366,), {"turn": 0.7}, verified="walk of 1,400 load steps, all stable, and exact rods", quick=True),
    Case("straight line of Sarrus", "overconstrained, six hinges in space", sarrus, (-1.00792273,), {"lift": -0.02}),
    Case("straight line of Sarrus, a hinge 5 mrad askew", "overconstrained and misaligned", partial(sarrus, 5e-3),
         (-0.99658041,), {"lift": -0.02}, quick=True),
    Case("a link that nothing holds", "no equilibrium", loose, None, verified=EXACT),
]  # fmt: skip

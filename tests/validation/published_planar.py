"""Independent numbers of planar links and of the planar gripper (papers 3 and 4).

Rods without stretch and shear are drawn with 1/EA and 1/GA at 1e-9 of EI/L^2: "inextensible" to 1e-9. Numbers that an
example shows stand in `test_examples.NUMBERS`.
"""

import math
import sys
from functools import partial
from pathlib import Path

import numpy as np
from planar_scenes import FINE, SOFT, rod, slider
from published import numbers

import ksd
from ksd.model.mesh import Mesh

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
import paper3

ARCS = Mesh(orders=(3, 2, 16), points=20)
SHOOTING = "shooting of exact rods, order 8"
"""Six-bar, grasper and gripper: scipy's DOP853 at 1e-13, Newton's method on places and wrenches to 1e-14."""
LINKS, GRIPPER = "Planar links (Lan 2005)", "Planar gripper with arc flexures (paper 3)"


def cantilever(force):
    """Place and angle of the tip."""
    EI, length = 0.08, 0.1016
    scene = ksd.Mechanism("cantilever", plane="xy")
    tip = scene.link("tip")
    scene.leaf("ground", tip, start=(0, 0, 0), end=(length, 0, 0), section=rod(EI, length), material=SOFT)
    scene.load(tip, force=force, at=(length, 0, 0))
    found = ksd.solve(scene)
    place = found.displacement("tip") + np.array((length, 0, 0))
    return place[0], place[1], found.rotation("tip")[2]


SIX_BAR = {
    "J1": (-0.088, 0.06), "J2": (-0.588, 0.06), "J3": (0, 0.4), "J4": (0.588, 0.06), "J5": (0, 0), "J6": (0.088, 0.06),
}  # fmt: skip
BARS = (("J1", "J2"), ("J2", "J3"), ("J5", "J3"), ("J3", "J4"), ("J4", "J6"))


def six_bar(force):
    """Figure 5.6, a four-bar and its mirror image, all links clamped to each other: place of J4, turn of J3."""
    places = {name: np.array([*place, 0.0]) for name, place in SIX_BAR.items()}
    scene = ksd.Mechanism("six-bar", plane="xy")
    joints = dict(zip(("J2", "J3", "J4"), scene.links("J2", "J3", "J4"), strict=True))
    for a, b in BARS:
        length = float(np.linalg.norm(places[b] - places[a]))
        scene.leaf(joints.get(a, "ground"), joints.get(b, "ground"), start=places[a], end=places[b], name=f"{a}-{b}",
                   section=rod(0.3, length), material=SOFT)  # fmt: skip
    scene.load("J2", force=(0, force, 0), at=places["J2"])
    found = ksd.solve(scene, mesh=FINE)
    return *found.displacement("J4")[:2], found.rotation("J3")[2]


def grasper(c):
    """Section 5.6: a link of Fourier sine shape, clamped and guided, moved across with its end kept along x."""
    points, weights = np.polynomial.legendre.leggauss(60)
    u = 0.5 * (points + 1)
    order = np.arange(1, len(c) + 1)
    angle = np.sin(2 * np.pi * np.outer(u, order)) @ c
    # the end of a leaf that begins along its own start, turned onto x
    chord, rise = 0.5 * weights @ np.cos(angle), 0.5 * weights @ np.sin(angle)
    length = 0.0508 / math.hypot(chord, rise)
    assert abs(rise) < 1e-9

    def curvature(s):
        return 0.0, 0.0, float(2 * np.pi * order * np.cos(2 * np.pi * order * s) @ c) / length

    scene = ksd.Mechanism("grasper", plane="xy")
    tip = scene.link("tip")
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.0508, 0, 0), curve=ksd.FreeCurve(length, curvature),
               section=rod(0.01, length), material=SOFT, name="link")  # fmt: skip
    scene.point("link", length / 3)
    scene.point("link", length / 1.5)
    scene.slider(tip, along="y", at=(0.0508, 0, 0))
    scene.actuate(tip, along="y", at=(0.0508, 0, 0), name="d")
    return (ksd.solve(scene, d=0.0127, mesh=FINE).forces["d"],)


def slider_at_45():
    found = ksd.solve(slider(math.radians(45)), d=15e-3)
    return found.forces["d"], *found.displacement("one", (0.1, 0, 0))[:2]


def inextensible(section):
    """The arcs without stretch and shear, to 3e-7 of the smallest answer. Stiffer ones are worse: of EA Newton counts
    the rounding of places, and from 1e5 times on ends a step earlier, 3e-6 off."""
    return ksd.numbers(
        A=1e4 * section.A, J=section.J, Iy=section.Iy, Iz=section.Iz, width=section.width, thickness=section.thickness
    )  # fmt: skip


# torque on the crank [Nm], force on the jaw [N]; inextensible; angles [rad] of crank and rocker .. of the jaw [mm]
ARC_ROWS = [
    ((2e-3, (0, 0)), False, (0.1332722410, 0.1178807792, -3.943817270, -0.083633456)),
    ((5e-3, (0, 0)), False, (0.3458772584, 0.3017728559, -9.994172531, -0.883410318)),
    ((5e-3, (0, 0)), True, (0.3457929069, 0.3017756105, -9.992201160, -0.885730133)),
    ((4e-3, (-0.05, 0.02)), False, (0.3645716629, 0.3183356513, -10.747696557, -0.610545527)),
]


def arcs(loads, stiff):
    section = inextensible(paper3.SECTION) if stiff else paper3.SECTION
    return paper3.answers(ksd.solve(paper3.gripper(*loads, section=section), mesh=ARCS))


def constant():
    """Every arc a matrix, balanced on the present lever: `method="constant"`."""
    scene = paper3.gripper(5e-3, section=inextensible(paper3.SECTION))
    return paper3.answers(ksd.solve(scene, method="constant", mesh=ARCS))


def linear():
    """The same balanced on the lever at rest, as the paper prints it."""
    return paper3.configuration_answers(
        paper3.solve_constant(5e-3, section=inextensible(paper3.SECTION), linear=True)
    )


def inverse():
    scene = paper3.gripper(driven=True, section=inextensible(paper3.SECTION))
    found = ksd.solve(scene, crank=math.radians(15), mesh=ARCS)
    return found.forces["crank"], paper3.answers(found)[2]


PARTS = (
    ("turn of the crank", "rad"),
    ("turn of the rocker", "rad"),
    ("jaw along x", "mm"),
    ("jaw along y", "mm"),
)


def _of_parts(case, values, *within):
    return [
        (f"{case}: {part}", unit, value, w)
        for (part, unit), value, w in zip(PARTS, values, within, strict=True)
    ]


def _rows():
    wanted = (
        ("cantilever, tip x", "m", 0.09802002),
        ("tip y", "m", 0.02464237),
        ("tip angle", "rad", 0.3538169),
    )
    yield numbers(LINKS, SHOOTING, partial(cantilever, (20, 12, 0)), *((*row, 1e-6) for row in wanted))
    # without any stretch; former .04365026 and -.0310615, .1606809 had some, 1.5e-7 L^2/EI
    for force, places in (
        (1, (-0.0022086155, 0.0436505651, 0.0770443485)),
        (4, (-0.0310619307, 0.1606824589, 0.3165071635)),
    ):
        parts = ("J4 along x", "m"), ("J4 along y", "m"), ("turn of J3", "rad")
        rows = [
            (f"six-bar under {force} N: {what}", u, v, 1e-6)
            for (what, u), v in zip(parts, places, strict=True)
        ]
        yield numbers(LINKS, SHOOTING, partial(six_bar, -force), *rows)
    # in three pieces: the curve of three terms, in one of at most 16 modes, is 1.9e-5 off, and says 2.0e-5
    for c, force in (
        ((1.3426,), 7.621551338),
        ((1.1412, 0.7817), 6.017377141),
        ((1.0628, 0.7668, 0.5197), 5.441198215),
    ):
        row = (f"grasper, {len(c)} Fourier terms: force", "N", force, 1e-6)
        yield numbers(LINKS, SHOOTING, partial(grasper, c), row)
    wanted = (
        ("slider, 45°: drive force", "N", 8.249490),
        ("C along x", "m", -0.922392e-3),
        ("C along y", "m", 12.423985e-3),
    )
    yield numbers(LINKS, SHOOTING, slider_at_45, *((*row, 1e-5) for row in wanted))
    for (torque, force), stiff, values in ARC_ROWS:
        case = f"{1e3 * torque:g} mNm" + f", {force} N" * any(force) + ", inextensible" * stiff
        ask = partial(arcs, (torque, force), stiff)
        yield numbers(GRIPPER, SHOOTING, ask, *_of_parts(case, values, *[1e-6] * 4))
    source, four = "paper 3, formulas derived anew", [2e-6] * 4
    values = (0.3593195, 0.3077203, -10.40541, -0.5206692)
    yield numbers(GRIPPER, source, constant, *_of_parts("constant matrix, 5 mNm", values, *four))
    values = (0.3529301, 0.3023480, -10.23457, -0.4779884)
    yield numbers(GRIPPER, source, linear, *_of_parts("linear balance, 5 mNm", values, *four))
    wanted = (
        ("torque that turns the crank by 15°", "Nm", 3.848441e-3, 1e-6),
        ("jaw along x there", "mm", -7.647798, 1e-6),
    )
    yield numbers(GRIPPER, SHOOTING, inverse, *wanted)


ROWS = [row for rows in _rows() for row in rows]

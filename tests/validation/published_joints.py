"""Published and independent numbers of joints and of mechanisms of joints (paper 1 and the literature of flexures)."""

from functools import cache, partial

import numpy as np
from published import numbers
from scenes import STEEL, cross_flexure, fourbar, single_joint

import ksd
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.scene.joint import Motion
from ksd.scene.leaf import Leaf
from ksd.section import rectangle
from ksd.solvers.conventional import solve_conventional
from ksd.units import deg, mm

RODS = "exact planar rods"
SPATIAL_RODS = "exact spatial rods, warping free"
FINITE_ELEMENTS = "independent finite elements"
CROSS, FOURBAR = "Cross flexure of paper 1, table 1", "Fourbar of paper 1, section 4.3"
GUIDE, PIVOTS = "Parallel guide, 100 x 30 x 0.5 mm", "Crossed pivots"
M_UNIT = STEEL.E * 0.08 * 1e-9 / 12 / 0.1
"""E I_sum / L of the cross flexure [Nm]."""
D0 = 0.1 * np.cos(np.pi / 4)

# M / (E I_sum theta / L) at 15, 45, 75 degrees, and D/D0 at 75; by Appendix A elements per leaf
MOMENTS = {
    2: (1.014307, 1.119823, 1.298602, 1.073320),
    4: (1.012007, 1.099556, 1.242758, 1.048950),
    6: (1.011603, 1.095977, 1.233110, 1.044619),
    "strain": (1.011284, 1.093157, 1.225562, 1.041186),
}
# n: (F at .1, F at .3, top rotation at .3), full, then reduced
FULL = {1: (64.867, 498.178, -0.0000412), 2: (64.169, 513.162, -0.0096861), 5: (64.027, 519.484, -0.0109678)}
REDUCED = {1: (64.869, 498.192), 2: (64.186, 519.032, -0.0120947), 5: (64.046, 525.516, -0.0138824)}
# (kx, ky, kz) [N/m] by angle of B in degrees, global axes, y along A to B
SUPPORT = {0: (8.0008e7, 8.0008e7, 1.1443e7), -30: (1.62247e6, 1.77981e6, 2.89875e6)}
# (kx, kz) [N/m] by stroke in mm
GUIDED = {0: (6.0000e7, 1.26302e6), 5: (2.2013e7, 5.21934e5), 20: (1.98244e6, 5.37276e4)}
# first parasitic frequency [Hz] by angle; mesh-extrapolated
PARASITIC = {0: 283.5, -20: 97.3, -45: 54.5}


def chain(n):
    return Mesh() if n == "strain" else Mesh("corotational", elements=n)


def moments(n):
    """M / (E I_sum theta / L) at 15, 45, 75 degrees, and the length there over that at rest."""
    model, last, found = compile_scene(single_joint(), mesh=chain(n)), None, []
    for angle in (15, 45, 75):
        last = solve_conventional(model, {"turn": angle * deg}, start=last)
        found.append(last.forces["turn"] / (M_UNIT * angle * deg))
    return *found, np.linalg.norm(last.motion.x[1]) / cross_flexure().length_AB


def stiffness_at_rest():
    return (solve_conventional(compile_scene(single_joint()), {"turn": 1e-4}).forces["turn"] / 1e-4,)


def moment_at_30():
    return (solve_conventional(compile_scene(single_joint()), {"turn": 30 * deg}).forces["turn"],)


def other_crossing(angle):
    """Thin leaf springs stand for inextensible ones."""
    model = compile_scene(single_joint(cross_flexure(angle=angle * deg, thickness=1e-4)))
    unit = 1e-3 * M_UNIT * deg
    return [
        solve_conventional(model, {"turn": turn * deg}).forces["turn"] / (unit * turn) for turn in (30, 60)
    ]


def crossed(ratio, turn, mesh=None):
    """A crossed pivot of thin leaf springs, turned by a moment alone."""
    joint = ksd.CrossedPivot(STEEL, length=0.1, angle=45 * deg, thickness=1e-4, width=0.02, ratio=ratio)
    return solve_conventional(compile_scene(single_joint(joint), mesh=mesh), {"turn": turn})


def crossed_stiffness(ratio):
    """Over E I / L of one leaf."""
    return (crossed(ratio, 1e-4).forces["turn"] / 1e-4 * 0.1 / (STEEL.E * 0.02 * 1e-12 / 12),)


def crossed_shift(ratio, turn=2 * deg):
    """How far the crossing moves along the symmetry axis, over its length and the square of the turn."""
    shift = crossed(ratio, turn).pivot_shift("hinge").shift
    return (np.linalg.norm(shift) / turn**2 / 0.1,)


def wheel():
    """Stiffness of a cartwheel over that of the crossed pivot of the same leaf springs."""
    joint = ksd.Cartwheel(STEEL, length=0.1, angle=45 * deg, thickness=1e-4, width=0.02)
    moment = solve_conventional(compile_scene(single_joint(joint)), {"turn": 1e-4}).forces["turn"]
    return (moment / crossed(0.5, 1e-4).forces["turn"],)


def forces(n, method):
    """Drive force of the fourbar at d = .1 and .3, and the rotation of its top link there, not corrected by the step that
    tells the error."""
    solve = ksd.prepare(fourbar(), mesh=chain(n))
    near, far = (solve(top=d, method=method, estimate=False) for d in (0.1, 0.3))
    return near.forces["top"], far.forces["top"], far.rotation("top")[2]


def second_reading():
    found = ksd.prepare(fourbar(reading=2))(top=0.3, method="full")
    return found.forces["top"], found.rotation("top")[2]


def out_of_plane():
    scene = fourbar()
    scene.load("top", force=(0, 0, 500), at=(0, 0.3 + D0, 0))
    return (ksd.prepare(scene, mesh=chain(4))(top=0.3, method="full").forces["top"],)


def cowper_cross(spacing=0.03):
    """The cross flexure with the shear coefficient of Cowper at nu = .3, which the independent rods have."""
    h = 0.05 * np.sin(np.pi / 4)
    leaves = [
        Leaf(
            start=(0, y, z), end=(D0, -y, z), width_axis=(0, 0, 1), section=rectangle(1e-3, w, cowper=0.3),
            material=STEEL, name=name,
        )
        for name, w, y, z in (("inner", 0.04, -h, 0), ("low", 0.02, h, -spacing), ("high", 0.02, h, spacing))
    ]  # fmt: skip
    turn = Motion("angle", "rotation", (0, 0, 1), (-1.3, 1.3))
    return ksd.DrawnJoint("cross", blocks={"A": (0, 0, 0), "B": (D0, 0, 0)}, leaves=leaves, motions=[turn])


def hinge(mesh=None):
    scene = ksd.Mechanism("hinge")
    tip = scene.link("tip")
    scene.actuate_joint(
        scene.join(scene.ground, tip, cowper_cross(), at=(0, 0, 0), axis="z", toward="y"), name="turn"
    )
    return compile_scene(scene, mesh=mesh)


def at_crossing(configuration):
    """Support stiffness at the crossing point at rest, moving with B; the drive holds the rotation about z."""
    found = configuration.stiffness("tip", at=(0, D0 / 2, 0))
    return [found.support(d) for d in "xyz"]


def support(angle):
    return at_crossing(solve_conventional(hinge(), {"turn": angle * deg}))


def guide(mesh=None):
    scene = ksd.Mechanism("guide")
    shuttle = scene.link("shuttle")
    for k, y in enumerate((-0.03, 0.03)):
        scene.leaf(
            scene.ground, shuttle, start=(0, y, 0), end=(0.1, y, 0), width_axis=(0, 0, 1), name=f"leaf {k}",
            section=rectangle(0.5 * mm, 30 * mm, cowper=0.3), material=STEEL,
        )  # fmt: skip
    scene.actuate(shuttle, along="y", at=(0.1, 0, 0), name="stroke")
    scene.support(shuttle, about="z", name="level")
    return compile_scene(scene, mesh=mesh)


def guided(stroke):
    """Rotation held by a moment while moving, then freed; stroke held, the other five free."""
    found = solve_conventional(guide(), {"stroke": stroke * mm}).stiffness(
        "shuttle", at=(0.1, 0, 0), freed=["level"]
    )
    return [found.support(d) for d in "xz"]


@cache
def payload():
    """Cross flexure with a payload of 1 kg, its outer leaf springs at z = +-35 mm."""
    steel = ksd.Material(E=200e9, nu=0.3, density=7800)
    joint = ksd.CrossFlexure(
        steel, length=0.1, angle=45 * deg, thickness=1e-3, widths=(0.04, 0.02), spacing=0.035
    )
    scene = ksd.Mechanism("payload")
    tip = scene.link("tip", mass=1.0, inertia=(1.2e-3, 0.8e-3, 1.2e-3), at=(0, D0 + 0.02, 0))
    scene.actuate_joint(scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="y"), name="turn")
    return compile_scene(scene)


def parasitic(angle):
    return (solve_conventional(payload(), {"turn": angle * deg}).frequencies(count=3).first_parasitic_Hz,)


def notch(ratio):
    joint = ksd.CircularNotchHinge(STEEL, radius=0.01, minimum=ratio * 0.01, width=0.005)
    scene = ksd.Mechanism("notch")
    tip = scene.link("tip")
    scene.actuate_joint(scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x"), name="turn")
    moment = solve_conventional(compile_scene(scene), {"turn": 1e-4}).forces["turn"]
    return (1e-4 / moment * STEEL.E * 0.005 * 0.01**2,)


def _rows():
    for n, values in MOMENTS.items():
        leaf = "" if n == "strain" else f", {n} elements"
        wanted = [
            (f"M L / (E I θ) at {a}°{leaf}", "", v, 2e-6) for a, v in zip((15, 45, 75), values, strict=False)
        ]
        source = RODS if n == "strain" else FINITE_ELEMENTS
        yield numbers(
            CROSS, source, partial(moments, n), *wanted, (f"D/D0 at 75°{leaf}", "", values[3], 2e-6)
        )
    closed = ("stiffness at rest", "Nm/rad", 13.33333, 1e-6)
    yield numbers(CROSS, "closed form E I / L, paper 1 eq. 4.3 corrected", stiffness_at_rest, closed)
    yield numbers(CROSS, RODS, moment_at_30, ("moment at 30°", "Nm", 7.28587, 2e-6))
    for angle, values in SUPPORT.items():
        wanted = [
            (f"support stiffness k{d} at {angle}°", "N/m", v, 3e-5)
            for d, v in zip("xyz", values, strict=True)
        ]
        yield numbers(CROSS, SPATIAL_RODS, partial(support, angle), *wanted)
    for angle, value in PARASITIC.items():
        wanted = (f"first parasitic frequency at {angle}°, 1 kg", "Hz", value, 3e-3)
        yield numbers(CROSS, FINITE_ELEMENTS + ", extrapolated, 0.3 %", partial(parasitic, angle), wanted)
    for angle, values in ((30, (1.014995, 1.057473)), (60, (1.120295, 1.361696))):
        wanted = [
            (f"M L / (E I θ) at {a}°, leaf springs at {angle}°", "", v, 2e-5)
            for a, v in zip((30, 60), values, strict=True)
        ]
        yield numbers(PIVOTS, RODS, partial(other_crossing, angle), *wanted)
    # without stretch
    zhao = "Zhao et al. 2011, small turns"
    for ratio in (-0.25, 0.0, 0.1, 0.35, 0.5, 0.8, 1.25):
        stiff = ("stiffness K L / (E I)", "", 8 * (1 - 3 * ratio + 3 * ratio**2), 1e-5)
        shift = abs(9 * ratio**2 - 9 * ratio + 1) / (15 * np.cos(45 * deg))
        ask = partial(crossed_stiffness, ratio)
        yield numbers(
            PIVOTS, "closed form, small turns", ask, (f"crossing at {ratio:g} L: {stiff[0]}", *stiff[1:])
        )
        wanted = (f"crossing at {ratio:g} L: pivot shift / (L θ²) at 2°", "", shift, 1e-3)
        yield numbers(PIVOTS, zhao, partial(crossed_shift, ratio), wanted)
    wanted = ("cartwheel, stiffness over that of the pivot crossed in the middle", "", 4.0, 2e-5)
    yield numbers(PIVOTS, "closed form, small turns", wheel, wanted)
    for method, table, within in (("full", FULL, 1e-5), ("reduced", REDUCED, 5e-5)):
        for n, values in table.items():
            wanted = [
                (f"{method}, {n} elements, drive force at {d} m", "N", v, within)
                for d, v in zip((0.1, 0.3), values, strict=False)
            ]
            if n > 1:
                wanted.append((f"{method}, {n} elements, rotation of the top link", "rad", values[2], 2e-3))
            yield numbers(FOURBAR, FINITE_ELEMENTS, partial(forces, n, method), *wanted)
    exact = (
        ("drive force at 0.3 m, second reading", "N", 212.398, 1e-5),
        ("top link rotation", "rad", -2.4972e-3, 1e-4),
    )
    yield numbers(FOURBAR, RODS, second_reading, *exact)
    wanted = ("drive force at 0.3 m, 500 N out of plane, 4 elements", "N", 542.33, 5e-4)
    yield numbers(FOURBAR, FINITE_ELEMENTS, out_of_plane, wanted)
    for stroke, values in GUIDED.items():
        wanted = [
            (f"support stiffness k{d} at {stroke} mm", "N/m", v, 3e-5)
            for d, v in zip("xz", values, strict=True)
        ]
        yield numbers(GUIDE, RODS, partial(guided, stroke), *wanted)
    for ratio, value in ((0.05, 25129.48), (0.2, 769.998)):
        wanted = (f"compliance C E b R², t/R = {ratio}", "", value, 1e-6)
        yield numbers("Circular notch hinge", "closed form, by quadrature", partial(notch, ratio), wanted)


ROWS = [row for rows in _rows() for row in rows]

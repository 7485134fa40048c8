"""Closed forms of critical load factors: levers, torques, forces that follow, moments made of dead forces."""

from functools import partial

import numpy as np
from published import numbers
from published_beams import inextensible
from scenes import STEEL
from scipy.optimize import brentq

import ksd
from ksd.answers.buckling import buckling
from ksd.model.compile import compile_scene
from ksd.section import rectangle
from ksd.solvers.conventional import solve_conventional

DIVERGENCE = "Divergence: critical load factors of rods"
L, ROD = 0.1, rectangle(1e-3, 1e-3)
EI = STEEL.E * ROD.Iz
SMALL = 1e-3


def clamped(section=ROD):
    """A rod along x, clamped at the origin."""
    scene = ksd.Mechanism("rod")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground,
        tip,
        start=(0, 0, 0),
        end=(L, 0, 0),
        section=section,
        material=STEEL,
        width_axis="y",
        name="leaf",
    )
    return scene, tip


def own_factors(scene, mesh=None):
    """Critical load factors of all loads of a scene, which are SMALL of their unit."""
    found = solve_conventional(compile_scene(scene, mesh=mesh), {}).buckling()
    return found, SMALL * found.factor


def on_an_arm(arm, mesh=None):
    """A force along the rod, at the end of a rigid arm."""
    scene, _ = clamped()
    model = compile_scene(scene, mesh=mesh)
    return buckling(model, model.rest, "tip", force=(-1, 0, 0), at=(L + arm, 0, 0), count=2)


def on_an_arm_exactly(arm):
    """k L of cot(kL) = k c, k^2 = P/EI."""
    return brentq(lambda x: np.cos(x) - x * arm / L * np.sin(x), 1e-6, 3.0)


def shaft(mesh=None):
    """A shaft on two bearings between torques fixed in space."""
    scene = ksd.Mechanism("shaft")
    left, right = scene.links("left", "right")
    scene.leaf(
        left, right, start=(0, 0, 0), end=(L, 0, 0), section=ROD, material=STEEL, width_axis="y", name="shaft"
    )
    # a hair to ground: every mechanism hangs on it
    scene.wire(scene.ground, left, diameter=2e-5, material=STEEL, start=(0, 0, 0.1), end=(0, 0, 0))
    for link, place, axes in ((left, 0, "xyz"), (right, L, "yz")):
        for axis in axes:
            scene.support(link, along=axis, at=(place, 0, 0))
    scene.support(left, about="x")
    unit = SMALL * EI / L
    scene.load(left, moment=(-unit, 0, 0))
    scene.load(right, moment=(unit, 0, 0))
    return own_factors(scene, mesh)


def on_arms(kind):
    """A torque of two forces on one arm ("quasi") or four on two arms ("semi"), that keep their directions."""
    scene, tip = clamped()
    arm, force = 0.01, SMALL * EI / L / (0.02 if kind == "quasi" else 0.04)
    for sign in (1, -1):
        scene.load(tip, force=(0, 0, sign * force), at=(L, sign * arm, 0))
        if kind == "semi":
            scene.load(tip, force=(0, -sign * force, 0), at=(L, 0, sign * arm))
    return own_factors(scene)


def beck(spring, mesh=None):
    """A force that follows the tip, and a lateral spring of `spring` EI/L^3: factors of what is added, and of its own."""
    # without stretch and shear, as the closed form
    scene, tip = clamped(inextensible(ROD))
    for far in ((L, 100 * L, 0), (L, 0, 100 * L)) if spring else ():
        # from so far away that its direction does not turn
        ends = {"start": far, "end": (L, 0, 0)}
        scene.spring(scene.ground, tip, **ends, stiffness=spring * EI / L**3, free_length=100 * L)
    model = compile_scene(scene, mesh=mesh)
    added = buckling(model, model.rest, "tip", force=(-1, 0, 0), at=(L, 0, 0), following=True)
    scene.load(tip, force=(-SMALL * EI / L**2, 0, 0), at=(L, 0, 0), following=True)
    return added, *own_factors(scene, mesh)


def beck_exactly(spring):
    """(k L)^2 of EI (kL)^3/(c L^3) = kL cos kL - sin kL: EI w'''' + P w'' = 0 with w'' = 0 and EI w''' = c w at the tip."""
    return brentq(lambda x: x**3 / spring - x * np.cos(x) + np.sin(x), 4.4934, 5.0) ** 2


def _rows():
    for arm in (0.5 * L, -0.3 * L):
        wanted = (
            f"column, force on a rigid arm of {arm / L:g} L: P L²/EI",
            "",
            on_an_arm_exactly(arm) ** 2,
            4e-3,
        )
        ask = partial(lambda arm: (on_an_arm(arm).factor[0] * L**2 / EI,), arm)
        yield numbers(DIVERGENCE, "Timoshenko and Gere, 2.1", ask, wanted)
    wanted = ("shaft on two bearings between torques fixed in space: M L/EI", "", 2 * np.pi, 6e-3)
    yield numbers(
        DIVERGENCE, "Greenhill 1883; Ziegler 1968, 5.2", lambda: (np.abs(shaft()[1]).min(),), wanted
    )
    for kind, name, share in (
        ("quasi", "two dead forces on one arm", 0.5),
        ("semi", "four on two arms", 1.0),
    ):
        wanted = (f"cantilever, torque of {name}: M L/EI", "", share * np.pi, 3e-3)
        ask = partial(lambda kind: (np.abs(on_arms(kind)[1]).min(),), kind)
        yield numbers(DIVERGENCE, "Ziegler 1968; Argyris et al. 1978", ask, wanted)
    wanted = ("force that follows, lateral spring of 100 EI/L³: P L²/EI", "", beck_exactly(100.0), 2e-5)
    yield numbers(DIVERGENCE, "beam column, closed form", lambda: (beck(100.0)[2][0],), wanted)


ROWS = [row for rows in _rows() for row in rows]

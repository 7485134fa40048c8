"""Closed forms of effects: heat, weight, prestress, assembly errors, springs, wide leaf springs, links that bend."""

from functools import partial

import numpy as np
from published import numbers

import ksd
from ksd.section import rectangle

EFFECTS = "Effects"
L, T, W = 0.1, 0.5e-3, 10e-3
ALPHA = 12e-6
STEEL = ksd.Material(E=200e9, nu=0.3, density=7800, expansion=ALPHA, name="steel")
A, INERTIA = T * W, W * T**3 / 12


LONG, THIN = 40.0, 10e-6


def blade(*, length=L, width=W, thickness=T, material=STEEL, **leaf):
    """A leaf along x from ground to link 'tip', thickness along y, width along z."""
    scene = ksd.Mechanism("blade")
    tip = scene.link("tip")
    words = {"section": rectangle(thickness, width), "material": material, "width_axis": (0, 0, 1), **leaf}
    scene.leaf("ground", tip, start=(0, 0, 0), end=(length, 0, 0), name="blade", **words)
    return scene


def held(scene, *directions):
    """Drives of the tip in the directions named, x y z and a b c (turning)."""
    for name in directions:
        axis = np.eye(3)["xyzabc".index(name) % 3]
        if name in "xyz":
            scene.actuate("tip", along=axis, at=(L, 0, 0), name=name)
        else:
            scene.actuate("tip", about=axis, name=name)
    return scene


def moved(found):
    """Displacement (3,) of the tip and its rotation about z."""
    R = found.motion.R[1]
    return found.motion.x[1] - found.model.rest.x[1], np.arctan2(R[1, 0], R[0, 0])


def solved(scene, targets=None, **words):
    return ksd.solve(scene, dict(targets or {}), method="conventional", strict=False, **words)


def heated(through):
    """Growth, or bow and turn, of a free leaf."""
    scene = blade()
    scene.heat(through=through) if through else scene.heat(50.0)
    shift, turn = moved(solved(scene))
    return (shift[1], turn) if through else (shift[0],)


def clamped_heat(through):
    """What two clamps feel of a warm leaf."""
    scene = held(blade(), *"xyzabc")
    scene.heat(through=through) if through else scene.heat(20.0)
    forces = solved(scene, dict.fromkeys("xyzabc", 0.0)).forces
    return (forces["c"] if through else forces["x"],)


def sag(gravity):
    """Of a leaf with a payload of .1 g, along a small weight."""
    scene = blade()
    scene.mass("tip", mass=1e-4, at=(L, 0, 0))
    scene.gravity = gravity
    return (moved(solved(scene))[0] @ np.sign(gravity),)


def sagged(second):
    """P l^3/3EI + P l/kGA of the payload, W l^3/8EI + W l/2kGA of the leaf, weight 9.81e-3 m/s^2."""
    P, own = 1e-4 * 9.81e-3, STEEL.density * A * L * 9.81e-3
    shear = L / (5 / 6 * STEEL.G * A)
    return P * (L**3 / (3 * 200e9 * second) + shear) + own * (L**3 / (8 * 200e9 * second) + shear / 2)


def pulled(pull):
    """Lateral stiffness of a guided leaf that was made too short, without shear."""
    scene = held(blade(), *"xyzabc")
    scene.fit("blade", natural_length=L / (1 + pull / (200e9 * A)))
    h = 1e-7
    pair = [
        solved(scene, dict.fromkeys("xzabc", 0.0) | {"y": s * h}, without="shear").forces for s in (1, -1)
    ]
    return (pair[0]["y"] - pair[1]["y"]) / (2 * h), pair[0]["x"]


def guided(pull):
    """k = N/(L - 2 tanh(b L/2)/b), b^2 = N/EI."""
    b = np.sqrt(complex(pull / (200e9 * INERTIA)))
    return float((pull / (L - 2 * np.tanh(b * L / 2) / b)).real)


def stretched():
    """Force of a leaf clamped 10 um too far out."""
    scene = held(blade(), *"xyzabc")
    scene.fit("blade", shift=(10e-6, 0, 0))
    return (solved(scene, dict.fromkeys("xyzabc", 0.0)).forces["x"],)


def balanced():
    """Moment of a hinge with a weight on a spring of zero free length, over that of the bare hinge, at three angles."""
    stuff = ksd.Material(E=200e9, G=76.9e9)
    joint = ksd.CrossFlexure(stuff, length=0.1, angle=np.pi / 4, thickness=1e-3, widths=(0.04, 0.02))
    arm, high, mass, middle = 0.3, 0.2, 2.0, joint.length_AB / 2

    def hinge(balanced):
        scene = ksd.Mechanism("arm")
        tip = scene.link("tip")
        placed = scene.join("ground", tip, joint, at=(0, 0, 0), axis="z", toward="y", name="hinge")
        # a stiff support of the pivot, so that it is one point
        for axis in "xy":
            scene.support(tip, along=axis, at=(0, middle, 0), name=f"pivot {axis}")
        scene.actuate_joint(placed, name="turn")
        if balanced:
            scene.mass(tip, mass=mass, at=(0, middle + arm, 0))
            scene.gravity = (0, -9.81, 0)
            ends = {"start": (0, middle + high, 0), "end": (0, middle + arm, 0)}
            scene.spring("ground", tip, **ends, stiffness=mass * 9.81 / high, free_length=0.0)
        return ksd.prepare(scene)

    bare, with_spring = hinge(False), hinge(True)
    pairs = [
        [s(turn=angle, method="conventional").forces["turn"] for s in (with_spring, bare)]
        for angle in (0.1, 0.4, -0.7)
    ]
    return [one / other for one, other in pairs]


def twisted(aspect):
    """Torsional stiffness with warping restrained over that without."""
    scene = held(blade(width=L / aspect), *"abcyz")
    targets = dict.fromkeys("bcyz", 0.0) | {"a": 1e-4}
    return (solved(scene, targets, with_="warping").forces["a"] / solved(scene, targets).forces["a"],)


def strip_by_energy(width, thickness, curvature, nu, n=1500):
    """M R / (E I) of a strip by minimising its energy over the shape of the cross-section, finite differences.

    U(k) = min over w(y) of int D/2 (k^2 + w''^2 + 2 nu k w'') + E t/2 (k w)^2 dy, M = dU/dk.
    """
    E, y = 1.0, np.linspace(-width / 2, width / 2, n + 1)
    h = y[1] - y[0]
    D = E * thickness**3 / (12 * (1 - nu**2))
    second = (np.eye(n + 1, k=1) - 2 * np.eye(n + 1) + np.eye(n + 1, k=-1))[1:-1] / h**2
    cell = np.full(n + 1, h)
    cell[[0, -1]] = h / 2
    # curvatures live between the edges; the outermost cells belong to the first and last of them
    bend = np.full(n - 1, h)
    bend[[0, -1]] = 1.5 * h
    H = D * second.T @ (bend[:, None] * second) + E * thickness * curvature**2 * np.diag(cell)
    w = np.linalg.solve(H, -D * nu * curvature * second.T @ bend)
    moment = D * (curvature * width + nu * bend @ (second @ w)) + E * thickness * curvature * cell @ w**2
    return moment / (E * width * thickness**3 / 12 * curvature)


def widely_bent(angle):
    """Moment of a thin leaf of 40 mm by 40 m bent to a circle, with plate stiffening, over EI/L times the angle.

    It is that long because clamps hold half a width of it flat.
    """
    scene = held(blade(width=40e-3, length=LONG, thickness=THIN), "c")
    beam = 200e9 * (40e-3 * THIN**3 / 12) * angle / LONG
    return (solved(scene, {"c": angle}, with_="plate").forces["c"] / beam,)


def sheared(without):
    """Sag of a cantilever 5 mm thick under 1 mN."""
    scene = blade(thickness=5e-3)
    scene.load("tip", force=(0, 1e-3, 0), at=(L, 0, 0))
    return (moved(solved(scene, without=without))[0][1],)


def lever():
    """What a link of 2 x 10 mm bends over 200 mm under .1 N."""
    places = []
    for elastic in (True, False):
        scene = blade(length=0.02)
        scene.load("tip", force=(0, 0.1, 0), at=(0.22, 0, 0), name="push")
        if elastic:
            scene.compliance("tip", section=rectangle(2e-3, 10e-3), material=STEEL, hub=(0.22, 0, 0))
        found = solved(scene, without="shear")
        node = found.model.scene.links.index("tip")
        x, R = found.motion.x[node], found.motion.R[node]
        places.append((x + R @ (np.array([0.22, 0, 0]) - found.model.rest.x[node]))[1])
    return (places[0] - places[1],)


def _rows():
    heat, kappa = "closed form of thermal strain", -ALPHA * 400.0 / T
    yield numbers(
        EFFECTS, heat, partial(heated, 0.0), ("growth of a leaf by 50 K", "m", ALPHA * 50 * L, 1e-9)
    )
    yield numbers(
        EFFECTS, heat, partial(heated, 400.0),
        ("bow of a leaf, 400 K through its thickness: across", "m", (1 - np.cos(kappa * L)) / kappa, 1e-8),
        ("the same: turn", "rad", kappa * L, 1e-9),
    )  # fmt: skip
    # less the part its own length takes
    force = -200e9 * A * ALPHA * 20 / (1 + ALPHA * 20)
    yield numbers(
        EFFECTS, heat, partial(clamped_heat, 0.0), ("force between clamps at 20 K", "N", force, 1e-9)
    )
    wanted = (
        "moment between clamps, 30 K through the thickness",
        "Nm",
        200e9 * INERTIA * ALPHA * 30 / T,
        1e-5,
    )
    yield numbers(EFFECTS, heat, partial(clamped_heat, 30.0), wanted)
    strong = T * W**3 / 12
    for name, gravity, second in (("soft", (0, -9.81e-3, 0), INERTIA), ("stiff", (0, 0, 9.81e-3), strong)):
        wanted = (f"sag under payload and own weight, {name} way", "m", sagged(second), 1e-8)
        yield numbers(EFFECTS, "closed form of Timoshenko's beam", partial(sag, gravity), wanted)
    for pull in (5.0, -2.0):
        wanted = (f"sideways stiffness of a guided leaf under {pull:g} N", "N/m", guided(pull), 1e-5)
        force = (f"its force, made too short for {pull:g} N", "N", pull, 1e-6)
        yield numbers(EFFECTS, "beam column, Timoshenko and Gere", partial(pulled, pull), wanted, force)
    wanted = ("force of a leaf clamped 10 um too far out", "N", 200e9 * A * 10e-6 / L, 1e-8)
    yield numbers(EFFECTS, "EA/L, first order", stretched, wanted)
    wanted = [
        (f"balanced weight at {a} rad: moment over that of the bare hinge", "", 1.0, 1e-9)
        for a in (0.1, 0.4, -0.7)
    ]
    yield numbers(EFFECTS, "Herder 2001, spring of zero free length", balanced, *wanted)
    for aspect, value in ((1, 1.828058), (3, 1.183652)):
        wanted = (f"torsion between clamps, factor of warping, L/w = {aspect}", "", value, 1e-6)
        yield numbers(EFFECTS, "closed form, Vlasov", partial(twisted, aspect), wanted)
    for angle in (0.05, 2.0):
        value = strip_by_energy(40e-3, THIN, angle / LONG, 0.3, 600)
        wanted = (f"wide leaf bent by {angle} rad, factor of plate stiffening", "", value, 2e-4)
        yield numbers(
            EFFECTS, "strip of least energy, finite differences", partial(widely_bent, angle), wanted
        )
    bending = 1e-3 * L**3 / (3 * 200e9 * W * (5e-3) ** 3 / 12)
    shear = 1e-3 * L / (5 / 6 * STEEL.G * 5e-3 * W)
    for name, without, value in (("without shear", "shear", bending), ("with shear", (), bending + shear)):
        wanted = (f"thick cantilever, {name}", "m", value, 1e-9)
        yield numbers(EFFECTS, "Euler and Bernoulli; Timoshenko", partial(sheared, without), wanted)
    wanted = (
        "link with a section: its bending",
        "m",
        0.1 * 0.2**3 / (3 * 200e9 * 10e-3 * (2e-3) ** 3 / 12),
        2e-3,
    )
    yield numbers(EFFECTS, "P l^3/3EI", lever, wanted)


ROWS = [row for rows in _rows() for row in rows]

"""Scenes of motion in time with values of independent dynamic models (acceptance of motion in the plane and in space)."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from scenes import cross_flexure, fourbar

import ksd
from ksd.section import rectangle

STEEL = ksd.Material(E=200e9, nu=0.3, density=7800)
HEIGHT = 0.3 + cross_flexure().length_AB


def motion(scene, until, **words):
    """The trace of a motion with steps dt."""
    return ksd.simulate(scene, until, **words).trace


def place(trace, link, t, point=None):
    """Displacement (3,) [m] of a point of a link at an instant that is a step."""
    node, i = trace.model.node_names.index(link), int(np.argmin(np.abs(trace.t - t)))
    assert abs(trace.t[i] - t) < 1e-9
    rest = trace.model.rest.x[node]
    arm = np.zeros(3) if point is None else np.asarray(point) - rest
    return trace.position[i, node] + trace.rotation[i, node] @ arm - arm - rest


def guide(plane="xy", **words):
    """Two leaf springs of 100 x 30 x .5 mm, a shuttle of .5 kg at their ends, pushed by 20 N."""
    joint = ksd.ParallelGuide(
        ksd.Material(E=200e9, nu=0.3, density=7800, **words),
        length=0.1,
        thickness=0.5e-3,
        width=0.03,
        spacing=0.06,
    )
    scene = ksd.Mechanism("guide", plane=plane)
    stage = scene.link("stage", mass=0.5, inertia=(4e-4, 4e-4, 4e-4), at=(0.1, 0, 0))
    scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis="z", toward="x")
    scene.load(stage, force=(0, 20, 0), at=(0.1, 0, 0), name="push")
    return scene


def four_hinges():
    """The fourbar of paper 1 with links that have mass, pushed by 150 N, its drive let go."""
    scene = fourbar()
    scene.mass("top", mass=2.0, inertia=(0.02, 0.02, 0.02), at=(0, HEIGHT, 0))
    for side, x in (("left", -0.2), ("right", 0.2)):
        scene.mass(side, mass=0.5, inertia=(2e-3, 2e-3, 2e-3), at=(x, HEIGHT / 2, 0))
    scene.load("top", force=(150, 0, 0), at=(0, HEIGHT, 0), name="push")
    return scene


def wire():
    """.4 m of round wire with 20 g on its end, in gravity."""
    scene = ksd.Mechanism("wire", plane="xy")
    tip = scene.link("tip", mass=0.02, at=(0.4, 0, 0))
    section = ksd.numbers(
        A=7.854e-7, J=9.818e-14, Iy=4.909e-14, Iz=4.909e-14, ky=0.9, kz=0.9, width=1e-3, thickness=1e-3
    )
    stuff = ksd.Material(E=200e9, G=200e9 / 2.6, density=7919)
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.4, 0, 0), section=section, material=stuff)
    scene.gravity = (0, -9.81, 0)
    return scene


def rod():
    """A rod of 1.11 x .0127 x .0032 m, bent by 7.187 N at its end."""
    scene = ksd.Mechanism("rod", plane="xy")
    tip = scene.link("tip")
    stuff = ksd.Material(E=200e9, G=80e9, density=7850)
    ends = {"start": (0, 0, 0), "end": (1.11, 0, 0)}
    scene.leaf(scene.ground, tip, **ends, section=rectangle(3.2e-3, 12.7e-3), material=stuff)
    scene.load(tip, force=(0, 7.187, 0), at=(1.11, 0, 0), name="pull")
    return scene


def pendulum():
    """A strip of .3 m on a pin with 50 g on its end, in gravity."""
    scene = ksd.Mechanism("pendulum", plane="xy")
    hub, tip = scene.links("hub", "tip")
    scene.pin(scene.ground, hub, at=(0, 0, 0))
    r = rectangle(0.5e-3, 20e-3)
    section = ksd.numbers(A=r.A, J=r.J, Iy=r.Iy, Iz=r.Iz, ky=0.9, kz=0.9, width=20e-3, thickness=0.5e-3)
    stuff = ksd.Material(E=2e9, G=2e9 / 2.6, density=1200)
    scene.leaf(hub, tip, start=(0, 0, 0), end=(0.3, 0, 0), section=section, material=stuff)
    scene.mass(tip, mass=0.05, inertia=(1e-6, 1e-6, 1e-6), at=(0.3, 0, 0))
    scene.gravity = (0, -9.81, 0)
    return scene


def pivot():
    """A cross flexure of .5 mm with 1 kg, its centre 20 mm beyond B, turned by 1 Nm."""
    joint = cross_flexure(thickness=0.5e-3)
    scene = ksd.Mechanism("pivot")
    tip = scene.link("tip", mass=1.0, inertia=(1e-3, 1e-3, 1e-3), at=(joint.length_AB + 0.02, 0, 0))
    scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x")
    scene.load(tip, moment=(0, 0, 1.0), name="turn")
    return scene


def strip(offset=0.01):
    """A strip in space with 30 g beside its axis, in gravity."""
    scene = ksd.Mechanism("strip")
    tip = scene.link("tip", mass=0.03, inertia=(2e-6, 2e-6, 2e-6), at=(0.25, 0, offset))
    stuff = ksd.Material(E=70e9, G=70e9 / 2.6, density=2700)
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(0.25, 0, 0), section=rectangle(0.5e-3, 20e-3), material=stuff,
        width_axis="z",
    )  # fmt: skip
    scene.gravity = (0, -9.81, 0)
    return scene


def driven_mass(mass=2.0):
    """A rigid body on a drive along x; a massless leaf on it carries 100 g that is held on it."""
    scene = ksd.Mechanism("driven", plane="xy")
    a = scene.link("a", mass=mass, inertia=(0.1, 0.1, 0.1), at=(0, 0, 0))
    b = scene.link("b", mass=0.1, inertia=(1e-4, 1e-4, 1e-4), at=(0.2, 0, 0))
    stuff = ksd.Material(E=200e9, nu=0.3)
    scene.leaf(a, b, start=(0.1, 0, 0), end=(0.2, 0, 0), section=rectangle(5e-4, 2e-2), material=stuff)
    scene.actuate(a, along="x", at=(0, 0, 0), name="push")
    scene.support(a, along="y", at=(0, 0, 0))
    scene.support(a, about="z")
    for axis in "xy":
        scene.support(b, along=axis, at=(0.2, 0, 0), relative_to=a)
    scene.support(b, about="z", relative_to=a)
    return scene


def carried_payload():
    """A payload on two massless leaf springs from a carriage that a drive holds, pushed by 20 N."""
    scene = ksd.Mechanism("carried", plane="xy")
    carriage = scene.link("carriage", mass=2.0, inertia=(0.1, 0.1, 0.1), at=(0, 0, 0))
    payload = scene.link("payload", mass=0.5, inertia=(4e-4, 4e-4, 4e-4), at=(0.1, 0, 0))
    words = {"section": rectangle(5e-4, 3e-2), "material": ksd.Material(E=200e9, nu=0.3)}
    for y in (-0.03, 0.03):
        scene.leaf(carriage, payload, start=(0, y, 0), end=(0.1, y, 0), **words)
    scene.slider(carriage, along="y", at=(0, 0, 0))
    scene.actuate(carriage, along="y", at=(0, 0, 0), name="push")
    scene.load(payload, force=(0, 20, 0), at=(0.1, 0, 0), name="hit")
    return scene


def carried_guide():
    """The same on the leaf springs of `guide`, which have mass."""
    scene = ksd.Mechanism("carried", plane="xy")
    carriage = scene.link("carriage", mass=2.0, inertia=(0.1, 0.1, 0.1), at=(0, 0, 0))
    payload = scene.link("payload", mass=0.5, inertia=(4e-4, 4e-4, 4e-4), at=(0.1, 0, 0))
    joint = ksd.ParallelGuide(STEEL, length=0.1, thickness=0.5e-3, width=0.03, spacing=0.06)
    scene.join(carriage, payload, joint, at=(0, 0, 0), axis="z", toward="x")
    scene.slider(carriage, along="y", at=(0, 0, 0))
    scene.actuate(carriage, along="y", at=(0, 0, 0), name="push")
    scene.load(payload, force=(0, 20, 0), at=(0.1, 0, 0), name="hit")
    return scene


def stage(gravity=0.0, loss_factor=None):
    """.5 kg on two upright leaf springs of 60 x 20 x .2 mm, held aside by .01 N."""
    scene = ksd.Mechanism("stage", plane="xy")
    top = scene.link("stage", mass=0.5, inertia=(1e-4, 1e-4, 1e-4), at=(0, 0.06, 0))
    stuff = ksd.Material(E=200e9, nu=0.3, density=7800, loss_factor=loss_factor)
    for x in (-0.03, 0.03):
        scene.leaf(
            "ground", top, start=(x, 0, 0), end=(x, 0.06, 0), section=rectangle(2e-4, 0.02), material=stuff
        )
    scene.load(top, force=(0.01, 0, 0), at=(0, 0.06, 0), name="hold")
    scene.sensor(top, along="x", at=(0, 0.06, 0), name="tip")
    scene.gravity = (0, gravity, 0)
    return scene


def reaction_mass():
    """Two stages of .5 kg above and below a free carriage of 2 kg, each pushed by 5 N, one to the left."""
    scene = ksd.Mechanism("reaction", plane="xy")
    carriage = scene.link("carriage", mass=2.0, inertia=(1e-2, 1e-2, 1e-2), at=(0, 0, 0))
    scene.slider(carriage, along="x", at=(0, 0, 0))
    for name, side in (("above", 1), ("below", -1)):
        end = scene.link(name, mass=0.5, inertia=(1e-4, 1e-4, 1e-4), at=(0, 0.06 * side, 0))
        for x in (-0.03, 0.03):
            ends = {"start": (x, 0, 0), "end": (x, 0.06 * side, 0)}
            scene.leaf(carriage, end, **ends, section=rectangle(3e-4, 0.02), material=STEEL)
        scene.load(end, force=(5.0 * side, 0, 0), at=(0, 0.06 * side, 0), name=f"push {name}")
    return scene


def bistable_beam():
    """Half of the curved beam of `examples/bistable.py`, of a density, on a shuttle of 10 g with a dashpot; force -500."""
    span, t, w = 0.1, 5e-4, 8e-3
    h = 6.0 * t
    x, shape = np.linspace(0, span / 2, 4001), ((h / 2, 2 * np.pi / span), (0.03 * t / 2, 4 * np.pi / span))
    slope = sum(a * b * np.sin(b * x) for a, b in shape)
    arc = np.concatenate(([0], np.cumsum(np.diff(x) * np.sqrt(1 + ((slope[1:] + slope[:-1]) / 2) ** 2))))
    bend = sum(a * b**2 * np.cos(b * x) for a, b in shape) / (1 + slope**2) ** 1.5
    curve = ksd.FreeCurve(float(arc[-1]), lambda s: (0, 0, np.interp(s * arc[-1], arc, bend)))
    end, scene = (span / 2, h, 0), ksd.Mechanism("bistable", plane="xy")
    shuttle = scene.link("shuttle", mass=0.01, at=end)
    stuff = ksd.Material(E=2e9, nu=0.35, density=1050)
    scene.leaf(
        "ground", shuttle, start=(0, 0, 0), end=end, curve=curve, section=rectangle(t, w), material=stuff
    )
    scene.slider(shuttle, along="y", at=end)
    scene.damper("ground", shuttle, damping=1.0, along="y", at=end)
    scene.load(shuttle, force=(0, -500 * 2e9 * w * t**3 / 12 * h / span**3, 0), at=end, name="push")
    scene.sensor(shuttle, along="y", at=end, name="place")
    return scene


def spinning_beam():
    """A beam of 10 m on a hub whose angle is driven; 2.8e7 N, 1e7 N in shear, 1.4e4 N m^2, 1.2 kg/m, 6e-4 kg m."""
    scene = ksd.Mechanism("spinning", plane="xy")
    hub, tip = scene.links("hub", "tip")
    scene.pin(scene.ground, hub, at=(0, 0, 0))
    section = ksd.numbers(A=1.0, J=1e-3, Iy=5e-4, Iz=5e-4, ky=1.0, kz=1.0, width=1.0, thickness=1.0)
    stuff = ksd.Material(E=2.8e7, G=1e7, density=1.2)
    scene.leaf(hub, tip, start=(0, 0, 0), end=(10, 0, 0), section=section, material=stuff)
    scene.actuate(hub, about="z", name="spin")
    return scene


SPEED, SPIN_UP = 6.0, 15.0


def spin(t):
    """Angle of the hub of the spinning beam (Lan 2005, eq. 4.1, before the end of the spin-up)."""
    part = SPIN_UP / (2.0 * np.pi)
    return SPEED / SPIN_UP * (0.5 * t**2 + part**2 * (np.cos(t / part) - 1.0))


def slider_crank():
    """The slider-crank of Lan 2005, example II.1, from its dead centre."""
    scene = ksd.Mechanism("slider-crank", plane="xy")
    hub, crank, rod_end, tip, block = scene.links("hub", "crank", "rod", "tip", "slider")
    words = {"A": 7.854e-5, "J": 9.818e-10, "Iy": 4.909e-10, "Iz": 4.909e-10, "ky": 0.9, "kz": 0.9}
    section = ksd.numbers(**words, width=0.01, thickness=0.01)
    C, B = (0.152, 0, 0), (0.456, 0, 0)
    scene.pin(scene.ground, hub, at=(0, 0, 0))
    scene.pin(crank, rod_end, at=C)
    scene.pin(tip, block, at=B)
    scene.slider(block, along="x", at=B)
    leaves = []
    for a, b, ends, E in ((hub, crank, ((0, 0, 0), C), 1e9), (rod_end, tip, (C, B), 5e7)):
        stuff = ksd.Material(E=E, G=E / 2.6, density=2770)
        leaves.append(scene.leaf(a, b, start=ends[0], end=ends[1], section=section, material=stuff))
    # rotary inertia of the sections, by Simpson's rule, of which leaf springs have none about this axis
    middles = [scene.point(leaf, 0.5 * leaf.leaf.length) for leaf in leaves]
    for links, x, L in (((hub, middles[0], crank), 0.0, 0.152), ((rod_end, middles[1], tip), 0.152, 0.304)):
        for k, link in enumerate(links):
            J, place = (1 / 6, 4 / 6, 1 / 6)[k] * 2770 * 4.909e-10 * L, (x + 0.5 * k * L, 0, 0)
            scene.mass(link, mass=0.0, inertia=(0, 0, J), at=place)
    scene.load(hub, moment=(0, 0, 1.0), name="torque")
    return scene


def lobatto(count):
    """Points from 0 to 1, both included, and weights."""
    u = np.polynomial.legendre.Legendre.basis(count - 1)
    s = np.concatenate([[-1.0], np.sort(u.deriv().roots().real), [1.0]])
    return 0.5 + 0.5 * s, 1.0 / (count * (count - 1) * u(s) ** 2)


def free_beam(pieces=3, lumps=6):
    """A beam of 10 m in free flight, 1e4 N, 1e4 N in shear, 500 N m^2, 1 kg/m.

    Its rotary inertia of 10 kg m stands on Lobatto points, as leaf springs have none about this axis.
    """
    scene = ksd.Mechanism("flight", plane="xy")
    names = [f"n{k}" for k in range(pieces * (lumps - 1) + 1)]
    nodes = scene.links(*names)
    first, last = np.array([6.0, 0, 0]), np.array([0, 8.0, 0])
    s, weight = lobatto(lumps)
    J, at = np.zeros(len(nodes)), np.zeros(len(nodes))
    for i in range(pieces):
        own = slice(i * (lumps - 1), (i + 1) * (lumps - 1) + 1)
        J[own] += 10.0 * 10.0 / pieces * weight
        at[own] = (i + s) / pieces
    section = ksd.numbers(A=1.0, J=0.1, Iy=0.05, Iz=0.05, ky=1.0, kz=1.0, width=1.0, thickness=1.0)
    stuff = ksd.Material(E=1e4, G=1e4, density=1.0)
    places = [first + x * (last - first) for x in at.tolist()]
    for k, node in enumerate(nodes):
        scene.mass(node, mass=0.0, inertia=(0, 0, J[k]), at=places[k])
        if k:
            scene.leaf(
                nodes[k - 1], node, start=places[k - 1], end=places[k], section=section, material=stuff
            )
    scene.load(nodes[0], force=(8, 0, 0), moment=(0, 0, -80), at=first, name="throw")
    # links without mass that let it go where it wants
    along_x, along_y = scene.links("along x", "along y")
    scene.slider(along_x, along="x", at=first)
    scene.slider(along_y, relative_to=along_x, along="y", at=first)
    scene.pin(along_y, nodes[0], at=first)
    return scene


class Case(NamedTuple):
    """A motion with values of an independent model.

    read: numbers (k, c) of its history, with names and units; values: at instants [s], nan where the model has none; steps
    [s] of three runs; within: of both finer runs extrapolated, over the largest value; order: how far from 2.
    """

    title: str
    make: Callable[[], Any]
    words: Mapping[str, Any]
    steps: tuple[float, float, float]
    read: Callable[[Any], Any]
    names: tuple[str, ...]
    values: Mapping[float, tuple[float, ...]]
    within: float
    order: float | None = 0.1

    def run(self, dt):
        """The history with steps dt."""
        return ksd.simulate(self.make(), max(self.values), dt=dt, **self.words)

    def found(self, dt):
        """Values (instants, c) with steps dt, and the largest (c,) of all instants."""
        history = self.run(dt)
        rows = np.asarray(self.read(history))
        at = [int(np.argmin(np.abs(history.t - t))) for t in self.values]
        assert np.abs(history.t[at] - list(self.values)).max() < 1e-9
        return rows[at], np.abs(rows).max(axis=0)

    def errors(self, found, largest):
        """Largest error over instants, relative to the largest value, of every number (c,)."""
        return np.nanmax(np.abs(found - np.array(list(self.values.values()))), axis=0) / largest


def angle_of(history, link):
    """Turn (k,) [rad] of a link about z, over whole turns too."""
    R = history[link].rotation
    return np.unwrap(np.arctan2(R[:, 1, 0], R[:, 0, 0]))


def _read_guide(h):
    stage = h["stage"].at((0.1, 0, 0))
    return np.column_stack([stage.displacement[:, 1], stage.displacement[:, 0], angle_of(h, "stage")])


def _read_fourbar(h):
    d = h["top"].at((0, HEIGHT, 0)).displacement[:, 0]
    return np.column_stack([d, angle_of(h, "top"), h.energy.strain, h.energy.kinetic])


def _read_tip(*point):
    return lambda h: h["tip"].at(point).position[:, :2]


def _read_rod(h):
    e = h.energy
    return np.column_stack([_read_tip(1.11, 0, 0)(h), e.kinetic + e.strain])


def _read_strip(h):
    return h["tip"].at((0.25, 0, 0)).position


def _read_spinning(h):
    psi, tip = spin(h.t), h["tip"].at((10, 0, 0)).position
    c, s = np.cos(psi), np.sin(psi)
    return np.column_stack([c * tip[:, 0] + s * tip[:, 1] - 10.0, c * tip[:, 1] - s * tip[:, 0]])


def _read_crank(h):
    block = h["slider"].at((0.456, 0, 0)).position[:, 0]
    return np.column_stack([block, angle_of(h, "hub"), h.energy.kinetic, h.energy.strain])


def _read_flight(h):
    ends = [h[n].at(at).position[:, :2] for n, at in (("n0", (6, 0, 0)), ("n15", (0, 8, 0)))]
    return np.column_stack(ends)


def _read_pivot(h):
    B = h["tip"].at((cross_flexure().length_AB, 0, 0)).displacement
    return np.column_stack([angle_of(h, "tip"), B[:, :2], h.energy.kinetic + h.energy.strain])


NONE = float("nan")
BENT = ksd.Ramp(0.04, end=0.0, start=1.0)
TORQUE = ksd.TimeTable([(0, 0), (0.5, 0.01), (0.7, 0.01), (1.2, 0)])
THROW = ksd.Ramp(0.5) + ksd.Ramp(0.5, end=-1.0, delay=2.5)
CASES = {
    "guide": Case(
        "Parallel guide, pushed", guide, {"loads": {"push": ksd.Ramp(0.02)}}, (2e-3, 1e-3, 5e-4), _read_guide,
        ("stroke [m]", "shortening [m]", "turn"),
        {0.02: (2.233342e-3, NONE, NONE), 0.04: (14.001642e-3, NONE, NONE), 0.06: (24.535613e-3, -3.693346e-3, 1.61445e-3),
         0.08: (22.577413e-3, NONE, NONE)}, 5e-5,
    ),
    "fourbar": Case(
        "Fourbar of cross flexures, pushed", four_hinges, {"loads": {"push": ksd.Ramp(0.1)}, "drives": {"top": None}},
        (5e-3, 2.5e-3, 1.25e-3), _read_fourbar, ("stroke [m]", "turn", "strain energy [J]", "kinetic energy [J]"),
        {0.1: (0.0830663, NONE, NONE, NONE), 0.15: (0.224575, NONE, NONE, NONE),
         0.2: (0.296481, -0.0105684, 41.7537, 0.62214),
         0.3: (0.136701, NONE, NONE, NONE), 0.4: (0.0415276, NONE, NONE, NONE)}, 1e-5,
    ),
    "pivot": Case(
        "Cross flexure, let go", pivot, {"loads": {"turn": ksd.Ramp(0.01, end=0.0, start=1.0)}}, (1e-3, 5e-4, 2.5e-4),
        _read_pivot, ("turn", "B along [m]", "B across [m]", "energy [J]"),
        {0.05: (0.340300, NONE, NONE, 0.277377), 0.1: (-0.213609, NONE, NONE, NONE),
         0.15: (-0.562299, -1.98633e-3, -19.92247e-3, NONE), 0.2: (-0.362748, NONE, NONE, NONE),
         0.3: (0.557200, NONE, NONE, NONE)},
        # vibrations of the leaf springs between their ends, here and in the model, that no step follows for long
        1e-3, None,
    ),
    "wire": Case(
        "Wire with a mass, dropped", wire, {"start": "undeformed"}, (1e-3, 5e-4, 2.5e-4), _read_tip(0.4, 0, 0),
        ("x [m]", "y [m]"),
        {0.2: (0.352712, -0.174352), 0.404: (0.094674, -0.335182), 0.6: (0.159274, -0.328487),
         0.95: (0.399759, -0.001370)}, 2e-5,
    ),
    "rod": Case(
        "Released rod", rod, {"loads": {"pull": BENT}}, (1e-3, 5e-4, 2.5e-4), _read_rod, ("x [m]", "y [m]", "energy [J]"),
        {0.1: (1.087728, 0.200987, 1.31699), 0.2: (1.060985, -0.299168, NONE), 0.3: (1.049328, -0.332983, NONE),
         0.48: (1.021985, 0.395979, NONE)}, 4e-5,
        # waves in the rod, which carries nothing, are resolved by the finest step only
        0.2,
    ),
    "pendulum": Case(
        "Pinned pendulum", pendulum, {"start": "undeformed"}, (4e-3, 2e-3, 1e-3), _read_tip(0.3, 0, 0), ("x [m]", "y [m]"),
        {0.1: (0.295133, -0.0491677), 0.2: (0.238212, -0.181934), 0.3: (0.0540298, -0.295054), 0.4: (-0.172033, -0.245648),
         0.5: (-0.282125, -0.101463)}, 2e-5,
    ),
    "strip": Case(
        "Strip in space, dropped", strip, {"start": "undeformed"}, (1e-3, 5e-4, 2.5e-4), _read_strip,
        ("x [m]", "y [m]", "z [m]"),
        {0.1: (0.244903, -0.046189, -0.000151), 0.2: (0.202592, -0.133048, -0.001607), 0.3: (0.166863, -0.166745, -0.002488),
         0.4: (0.206054, -0.128699, -0.001508)}, 2e-3,
    ),
    "spinning": Case(
        "Spinning beam", spinning_beam, {"drives": {"spin": spin}}, (2e-2, 1e-2, 5e-3), _read_spinning,
        ("along [m]", "across [m]"),
        {3.0: (-0.00272829, -0.217267), 6.0: (-0.016971, -0.54360), 7.5: (-0.017742, -0.55908), 9.0: (-0.011745, -0.46027),
         12.0: (-0.000804, -0.15090)}, 5e-4,
    ),
    "slider-crank": Case(
        "Slider-crank", slider_crank, {"loads": {"torque": TORQUE}}, (4e-3, 2e-3, 1e-3), _read_crank,
        ("slider [m]", "crank", "kinetic energy [J]", "strain energy [J]"),
        {0.4: (0.4477472, NONE, NONE, NONE), 0.8: (0.292384, NONE, NONE, NONE), 1.2: (0.160624, 3.61349, NONE, NONE),
         1.6: (0.418392, NONE, 1.985823e-2, 1.6215e-4)}, 5e-4,
    ),
    "flight": Case(
        "Free flight", free_beam, {"loads": {"throw": THROW}}, (2e-2, 1e-2, 5e-3),
        _read_flight, ("first x [m]", "first y [m]", "other x [m]", "other y [m]"),
        {3.0: (4.5741, -0.7940, NONE, NONE), 5.0: (5.0337, 3.8535, NONE, NONE),
         8.0: (16.904, 8.8871, 15.813, -0.9162)}, 1e-3,
    ),
}  # fmt: skip
"""Acceptance of motion in time: own finite elements extrapolated in step and mesh, most confirmed by a second code."""

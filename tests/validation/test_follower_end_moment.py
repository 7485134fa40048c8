"""A round wire bent or twisted by an end moment that turns with it: its verdict against the spectrum of a fine chain."""

import numpy as np
import pytest
from scenes import STEEL
from scipy.linalg import eigvals

import ksd
from ksd.answers.finer_model import finer_state
from ksd.answers.mass import assemble_inertia
from ksd.answers.nonconservative import skew_tangent
from ksd.answers.tangent import assemble_tangent

L, SECTION = 0.1, ksd.circle(1e-3)
CHAIN = ksd.Mesh("corotational", elements=40)


def wire(turns, kind, points=0, material=STEEL):
    """A clamped wire whose end moment turns it by `turns`; bending or twisting it."""
    scene = ksd.Mechanism("wire")
    tip = scene.link("tip")
    scene.leaf(
        "ground",
        tip,
        start=(0, 0, 0),
        end=(L, 0, 0),
        section=SECTION,
        material=material,
        width_axis="z",
        name="wire",
    )
    for s in np.linspace(0.0, L, points + 2)[1:-1]:
        scene.point("wire", s)
    stiffness = {"bending": STEEL.E * SECTION.Iz, "twist": STEEL.G * SECTION.J}[kind]
    moment = 2 * np.pi * turns * stiffness / L * np.array({"bending": (0, 0, 1), "twist": (1, 0, 0)}[kind])
    scene.load(tip, moment=tuple(moment), following=True)
    return scene


def spectrum(turns, kind):
    """omega^2 of a chain of 40 elements, by the generalised problem (K + S) x = omega^2 M x of all its unknowns."""
    pose = ksd.solve(wire(turns, kind), mesh=CHAIN, strict=False)
    fine, state = finer_state(pose.model, pose.motion)
    found = assemble_tangent(fine, state)
    K = found.matrix() + skew_tangent(found.arrays, state, 1.0)
    squared = eigvals(K, assemble_inertia(fine, state).matrix.toarray())
    return squared[np.argsort(np.abs(squared))]


@pytest.mark.parametrize(
    "kind, turns", [("bending", t) for t in (0.3, 0.5, 0.6, 0.8, 1.0)] + [("twist", 0.8)]
)
def test_the_verdict_is_that_of_a_fine_chain_whatever_the_points(kind, turns):
    """Half a turn has a singular symmetric part and a whole turn a pole of the condensed leaf; .6 of a turn was unstable
    without a point, .3 with three (in a mode at 24 kHz that a damping ratio of 8e-4 stops)."""
    squared = spectrum(turns, kind)
    real = np.abs(squared.imag) <= 1e-6 * np.abs(squared)
    assert not np.any(real & (squared.real < 0.0))
    lowest = np.sqrt(squared[:12][~real[:12] & (squared[:12].imag > 0.0)])
    growth = np.abs(lowest.imag)
    for points, mesh in ((0, None), (1, None), (2, None), (3, None), (0, CHAIN)):
        pose = ksd.solve(wire(turns, kind, points), strict=False, **({"mesh": mesh} if mesh else {}))
        said = str(pose.trust.stable)
        assert pose.negatives == pose.expected_negatives and pose.stable == (not len(lowest)), (points, said)
        if points in (0, 3):
            # paths by arc length and critical loads have the same verdict
            path = ksd.follow(wire(turns, kind, points), first=0.5)
            assert path.ended and path.states[-1].negatives == pose.negatives
            assert pose.buckling().unstable == 0
        if len(lowest):
            told = float(said.split("growing by ")[1].split(" per")[0])
            assert "FLUTTER" in said and np.abs(told / growth - 1.0).min() < 0.05, (points, said, growth)


@pytest.mark.parametrize("points", [0, 1, 3])
def test_without_a_density_nothing_diverges_either(points):
    """The number of slow departures does not wait for a mass."""
    steel = ksd.Material(E=STEEL.E, nu=STEEL.nu)
    pose = ksd.solve(wire(0.6, "bending", points, steel))
    assert pose.stable and "flutter was not checked" in str(pose.trust.stable)

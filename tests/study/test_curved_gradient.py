"""Gradients by the rest shape of a curved link against central differences of solves, and its optimum."""

import numpy as np
import pytest

import ksd

STEEL = ksd.Material(E=200e9, nu=0.3)
MESH = ksd.Mesh(orders=(3, 2, 16), points=20)
COLUMNS = ("d_force_N", "support_x_N_per_m", "d_stiffness_N_per_m", "stress_MPa")


def link(c1, c2, length, thickness, width, load):
    """A curved link, clamped and guided, its end pushed along x and driven across; chord and stroke go with its length."""
    curve = ksd.FreeCurve.sine([c1, c2], length=length)
    chord = float(curve.line(1.0)[0][0])
    scene = ksd.Mechanism("link", plane="xy")
    tip = scene.link("tip")
    scene.leaf("ground", tip, start=(0, 0, 0), end=(chord, 0, 0), curve=curve, name="link",
               section=ksd.rectangle(thickness, width), material=STEEL)  # fmt: skip
    scene.support(tip, about="z")
    scene.load(tip, force=(load, 0, 0), at=(chord, 0, 0))
    scene.actuate(tip, along="y", at=(chord, 0, 0), name="d")
    return scene


@pytest.mark.parametrize("seed", range(3))
def test_gradient_by_rest_shape_and_sizes(seed):
    """By amplitudes, length, thickness, width and load, of drive force, stiffness and stress: 1e-6 of central differences
    of fourth order."""
    rng = np.random.default_rng(seed)
    design = {
        "c1": rng.uniform(0.4, 1.0), "c2": rng.uniform(-0.4, 0.4), "length": rng.uniform(0.05, 0.1),
        "thickness": rng.uniform(3e-4, 6e-4), "width": rng.uniform(5e-3, 15e-3), "load": rng.uniform(-0.5, 0.5),
    }  # fmt: skip
    compare(link, design, {"mesh": MESH, "at": (0.05, 0, 0)})


def tapered(length, start, end, width, load):
    """A straight link that runs from one thickness to another, over a step in the middle, moved as `link`."""
    scene = ksd.Mechanism("link", plane="xy")
    tip, area = scene.link("tip"), ksd.rectangle
    profile = ksd.Varying(lambda s: area(start + (end - start) * s + (s > 0.5) * 1e-4, width), (0.5,))
    for k, shape in enumerate((ksd.Taper(thickness=(start, end), width=(width, width)), profile)):
        scene.leaf("ground", tip, start=(0, k * length, 0), end=(length, k * length, 0), name=f"leaf {k}",
                   section=area(start, width), profile=shape, material=STEEL)  # fmt: skip
    scene.load(tip, force=(load, 0, 0), at=(length, 0, 0))
    scene.actuate(tip, along="y", at=(length, 0, 0), name="d")
    return scene


def test_gradient_by_sizes_of_profiles():
    """The same of leaf springs with profiles, whose stresses are followed at a section of their own each."""
    design = {"length": 0.08, "start": 5e-4, "end": 4e-4, "width": 0.01, "load": 0.4}
    compare(tapered, design, {"at": (0.08, 0.04, 0)})


def filleted(length, radius, thickness, load):
    """A leaf spring with fillets at its ends, whose stress is largest where one of them begins."""
    scene = ksd.Mechanism("link", plane="xy")
    tip, notch = (
        scene.link("tip"),
        ksd.FilletedNotch(length=length, radius=radius, minimum=thickness, width=0.01),
    )
    scene.leaf("ground", tip, start=(0, 0, 0), end=(length, 0, 0), name="leaf",
               section=ksd.rectangle(thickness, 0.01), profile=notch, material=STEEL)  # fmt: skip
    scene.load(tip, force=(load, 0, 0), at=(length, 0, 0))
    scene.actuate(tip, along="y", at=(length, 0, 0), name="d")
    return scene


def test_gradient_by_what_moves_a_kink():
    """The same by sizes that move the kinks of a profile, and with them the places its stress is told at."""
    compare(filleted, {"length": 0.06, "radius": 0.006, "thickness": 4e-4, "load": 0.4}, {"at": (0.06, 0, 0)},
            (COLUMNS[0], COLUMNS[3]))  # fmt: skip


def compare(make, design, words, columns=COLUMNS):
    """Gradients of a design against central differences of solves of fourth order: 1e-6."""
    words = {
        "questions": ("force", "support_stiffness", "drive_stiffness", "stress"), "link": "tip",
        "d": 0.006, **words,
    }  # fmt: skip
    found = ksd.gradient(make, design, method="conventional", **words)

    def answers(name, value):
        row = ksd.gradient(make, {**design, name: value}, by="d", method="conventional", **words).values
        return np.array([row[c][0] for c in columns])

    for name, value in design.items():
        h = 4e-3 * abs(value)
        pairs = [(answers(name, value + k * h) - answers(name, value - k * h)) / (2 * k * h) for k in (1, 2)]
        want = (4 * pairs[0] - pairs[1]) / 3
        got = np.array([found[c, name][0] for c in columns])
        size = np.maximum(np.abs(want), 0.05 * np.abs([found.values[c][0] for c in columns]) / abs(value))
        assert np.abs(got - want) / size == pytest.approx(0.0, abs=1e-6), (name, got, want)

"""Which shape should the curved link of a grasper have, so that it takes the least force to move?

Lan (2005), section 5.6: a link between a clamp and a guide 50.8 mm apart, EI 0.0100 Nm^2, at most 85 mm long, its tip moved
transversely by 12.7 mm. Its slope at rest is a sine series: 7.62, 6.01 and 5.43 N with one, two and three terms.
"""

import ksd
from ksd.units import mm

EI, chord, stroke, longest = 0.0100, 50.8 * mm, 12.7 * mm, 85 * mm

stuff, area = ksd.Material(E=1e9, nu=0.3), EI / longest**2  # neither stretch nor shear: 1e9 EI/L^2
section = ksd.numbers(A=area, J=EI / 1e9, Iy=EI / 1e9, Iz=EI / 1e9, width=4 * mm, thickness=4 * mm)
fine = ksd.Mesh(orders=(3, 2, 12), points=16)


def link(**c):
    """The curve of the link with amplitudes c1, c2, ... [rad]."""
    return ksd.FreeCurve.sine(list(c.values()), chord=chord)


def grasper(**c):
    """The link between ground and a guide, driven transversely."""
    curve, tip = link(**c), (chord, 0, 0)
    scene = ksd.Mechanism("grasper", plane="xy")
    words = {"end": tip, "curve": curve, "section": section, "material": stuff, "name": "link"}
    scene.leaf(scene.ground, scene.link("guide"), start=(0, 0, 0), **words)
    for part in (1, 2):
        scene.point("link", part / 3 * curve.length)
    scene.slider("guide", along="y", at=tip)
    scene.actuate("guide", along="y", at=tip, name="d")
    return scene


def optimum(start):
    """The shape of least force with as many terms as amplitudes in `start`, where the search begins."""
    names = [f"c{i + 1}" for i in range(len(start))]
    rules = [lambda c: 1 - link(**c).length / longest]
    words = {"minimise": "d_force_N", "d": stroke, "method": "conventional", "rules": rules, "mesh": fine}
    return ksd.optimise(ksd.Job(grasper, vary=dict.fromkeys(names, (0.05, 2.0)), **words), start=start)


found = [optimum((1.0, 0.5, 0.5)[:terms]) for terms in (1, 2, 3)]
force_1, force_2, force_3 = (best.answers["d_force_N"] for best in found)
most_solves = max(best.evaluations + best.gradients for best in found)


def picture(path=None):
    """The best link of three terms, moved."""
    return ksd.solve(found[-1].mechanism, d=stroke, mesh=fine).plot(path)


for best in found:
    shape = ", ".join(f"{n} {v:.4f}" for n, v in best.design.items())
    print(
        f"{best.answers['d_force_N']:.4f} N at {shape}: {best.evaluations} values, {best.gradients} gradients"
    )

if __name__ == "__main__":
    picture("grasper.png")

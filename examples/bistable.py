"""At which force does a bistable switch snap, and where does it rest?

A double curved beam y = h/2 (1 - cos 2 pi x/l), moved at its middle. One half is modelled, its end on a slider. For a
perfect beam of large Q = h/t, Qiu, Lang and Slocum (J. MEMS 13, 2004) give snap forces of 740 and -370 EI h/l^3 and a
second rest position at 1.99 h.
"""

import numpy as np
from matplotlib.figure import Figure

import ksd
from ksd.units import GPa, mm

l, Q, t, w = 100 * mm, 6.0, 0.5 * mm, 8 * mm  # span of the full beam
h = Q * t
plastic = ksd.Material(E=2 * GPa, nu=0.35)

# the beam by its arc length: slope and curvature of the drawn curve
x = np.linspace(0, l / 2, 4001)
# with an imperfection in its third mode, 3 % of the thickness: the path of a perfect beam has a bifurcation
shape = ((h / 2, 2 * np.pi / l), (0.03 * t / 2, 4 * np.pi / l))
slope = sum(a * b * np.sin(b * x) for a, b in shape)
arc = np.concatenate(([0], np.cumsum(np.diff(x) * np.sqrt(1 + ((slope[1:] + slope[:-1]) / 2) ** 2))))
bend = sum(a * b**2 * np.cos(b * x) for a, b in shape) / (1 + slope**2) ** 1.5
curve = ksd.FreeCurve(float(arc[-1]), lambda s: (0, 0, np.interp(s * arc[-1], arc, bend)))

end = (l / 2, h, 0)

scene = ksd.Mechanism("bistable", plane="xy")
shuttle = scene.link("shuttle")
beam = {"curve": curve, "section": ksd.rectangle(t, w), "material": plastic}
scene.leaf(scene.ground, shuttle, start=(0, 0, 0), end=end, **beam)
scene.slider(shuttle, along="y", at=end)
scale = plastic.E * w * t**3 / 12 * h / l**3
scene.load(shuttle, force=(0, -500 * scale, 0), at=end)  # 1000 EI h/l^3 for both halves

load = ksd.follow(scene, until=0.8, first=0.01)
top, bottom = (1000 * factor for factor in load.limits[:2])
down = np.array([-state.displacement(shuttle)[1] for state in load.states]) / h
k = next(k for k in range(len(down)) if down[k] > 1.8 and load.factor[k] > 0)
rest = float(np.interp(0.0, load.factor[k - 1 : k + 1], down[k - 1 : k + 1]))


def picture(path=None):
    """Force over the motion of the shuttle; it snaps at the two limit points."""
    figure = Figure(figsize=(6, 3.6), layout="constrained")
    axes = figure.add_subplot(xlabel="motion over h", ylabel="force / (EI h/l^3)")
    axes.plot(down, 1000 * load.factor, color="#c2410c")
    axes.grid(color="#eceff4")
    axes.spines[["top", "right"]].set_visible(False)
    return figure if path is None else ksd.view.save_figure(figure, path)


print(f"snaps at {top * scale:.4f} N ({top:.1f} EI h/l^3), back at {bottom * scale:.4f} N ({bottom:.1f})")
print(f"second rest at {rest:.4f} h")

if __name__ == "__main__":
    picture("bistable.png")

"""How stiff can a guide with a stroke of 10 mm be within 400 MPa? A job solved by `scipy.optimize.minimize`.

Leaf springs of 100 mm x 30 mm, at least 0.3 mm thick, stiffened in their middle: thickness t and the flexible share f at
each end are varied. Bending stress of the flexible ends: 3 E t d / (L^2 (1 - (1 - 2 f)^3)), so that at the least thickness
2 f = 1 - (1 - 3 E t d / (sigma L^2))^(1/3).
"""

import numpy as np
from scipy.optimize import minimize

import ksd
from ksd.units import GPa, mm

steel = ksd.Material(E=200 * GPa, nu=0.3)


def guide(thickness, flexible):
    """A stage on two stiffened leaf springs, pushed across them."""
    joint = ksd.StiffenedGuide(
        steel, length=100 * mm, thickness=thickness, width=30 * mm, spacing=80 * mm, flexible=flexible
    )
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    placed = scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis="z", toward="x", name="guide")
    scene.actuate_joint(placed, name="push")
    return scene


job = ksd.Job(
    guide, push=10 * mm, link="stage", vary={"thickness": (0.3 * mm, 0.6 * mm), "flexible": (0.05, 0.3)},
    maximise="support_x_N_per_m", limits={"stress_MPa": 400}, method="conventional",
)  # fmt: skip
goal = [a.role == "maximise" for a in job.answers].index(True)
limits = [k for k, a in enumerate(job.answers) if a.role == "limit"]


def scaled(x):
    """Parameters of the job between 0 and 1."""
    low, high = job.bounds.T
    return low + x * (high - low)


span = np.diff(job.bounds)[:, 0]
best = minimize(
    lambda x: -np.log(job.values(scaled(x))[goal]), [0.5, 0.8], method="SLSQP", bounds=[(0, 1)] * 2,
    jac=lambda x: -job.jacobian(scaled(x))[goal] * span / job.values(scaled(x))[goal],
    constraints={"type": "ineq", "fun": lambda x: 1 - job.values(scaled(x))[limits] / 400,
                 "jac": lambda x: -job.jacobian(scaled(x))[limits] * span / 400},
)  # fmt: skip
thickness, flexible = scaled(best.x)
print(f"thickness {thickness / mm:.4f} mm, flexible {flexible:.4f} at every end, {best.nit} steps")


def picture(path=None):
    """The guide at its stroke."""
    return ksd.solve(guide(thickness, flexible), push=10 * mm).plot(path, color="stress")


if __name__ == "__main__":
    picture("job_in_scipy.png")

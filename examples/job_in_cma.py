"""How does CMA-ES (`pip install cma`) optimise a job, population by population?

The stiffest crossed pivot with at most 60 MPa at 2 degrees. Both leaf springs bend to an arc: stress E t turn / (2 L),
stiffness 2 EI / L. So the optimum has the largest L, and t = 2 L sigma / (E turn).
"""

import numpy as np

import ksd
from ksd.units import GPa, deg, mm

try:
    import cma
except ImportError:
    raise SystemExit("this example needs the package cma: pip install cma") from None

steel = ksd.Material(E=200 * GPa, nu=0.3)


def pivot(length, thickness):
    """An arm on two leaf springs that cross in their middle."""
    joint = ksd.CrossedPivot(steel, length=length, angle=45 * deg, thickness=thickness, width=20 * mm)
    scene = ksd.Mechanism("pivot")
    arm = scene.link("arm")
    placed = scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x", name="pivot")
    scene.actuate_joint(placed, name="turn")
    return scene


job = ksd.Job(
    pivot, turn=2 * deg, vary={"length": (40 * mm, 60 * mm), "thickness": (0.4 * mm, 1.5 * mm)},
    maximise="turn_stiffness_Nm_per_rad", limits={"stress_MPa": 60}, extrapolate=True,
)  # fmt: skip
low, high = job.bounds.T


def costs(places):
    """Minus the logarithm of the stiffness, plus ten times the violation of the limit; 1000 where a design fails."""
    values, _ = job.batch(low + np.array(places) * (high - low))
    beyond = np.array([-np.minimum(job.margins(v), 0).sum() for v in values])
    return np.nan_to_num(10 * beyond - np.log([job.merit(v) for v in values]), nan=1e3).tolist()


options = {"bounds": [0, 1], "seed": 1, "verbose": -9, "tolfun": 1e-3}
search = cma.CMAEvolutionStrategy([0.5, 0.5], 0.3, options)
while not search.stop():
    population = search.ask()
    search.tell(population, costs(population))
length, thickness = low + search.result.xbest * (high - low)
print(f"{length / mm:.3f} mm long, {thickness / mm:.4f} mm thick after {search.result.evaluations} designs")


def picture(path=None):
    """The pivot, turned."""
    return ksd.solve(pivot(length, thickness), turn=2 * deg, extrapolate=True).plot(path, color="stress")


if __name__ == "__main__":
    picture("job_in_cma.png")

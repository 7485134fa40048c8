"""How do the starts of an optimisation share a cluster? With Dask, as with any `concurrent.futures` executor.

Needs `pip install 'dask[distributed]'`. The workers here are threads of this process; `distributed.Client("address:8786")`
reaches others, which must be able to import the script. The stiffest crossed pivot within 60 MPa at 2 degrees has the
largest L, and t = 2 L sigma / (E turn).
"""

import ksd
from ksd.units import GPa, deg, mm

try:
    import distributed
except ImportError:
    raise SystemExit("this example needs dask: pip install 'dask[distributed]'") from None

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
with (
    distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    ) as cluster,
    distributed.Client(cluster) as client,
):
    best = ksd.optimise(job, starts=3, executor=client.get_executor())
length, thickness = best.design.values()
agreed = best.agreed
print(best)


def picture(path=None):
    """The designs of every start."""
    return best.plot(path)


if __name__ == "__main__":
    picture("job_on_a_cluster.png")
